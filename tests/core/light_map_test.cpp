// SPDX-License-Identifier: Apache-2.0
#include "core/light/light_map.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <vector>

#include "core/base/errors.h"
#include "core/base/rng.h"
#include "core/image/tone_map.h"
#include "core/light/cube_map.h"

namespace refield {
namespace {

constexpr double rounding = 1e-9;

/// Pairs of different lights, [lights], that is_same_pattern() takes for the same.
int confused(const std::vector<Image>& lights) {
  std::vector<std::string> patterns;
  for (const Image& light : lights) patterns.push_back(pattern_of(light));
  int same = 0;
  for (std::size_t i = 0; i < patterns.size(); ++i)
    for (std::size_t j = 0; j < i; ++j) same += is_same_pattern(patterns[i], patterns[j]);
  return same;
}

TEST(LightPattern, TellsSingleTexelsColoursAndPatternsOnAGroundApart) {
  std::vector<Image> texels, grounds, colours;
  for (std::size_t p = 0; p < 48 * 32; ++p) {
    texels.emplace_back(48, 32, 3);
    for (int c = 0; c < 3; ++c) texels.back().values[3 * p + c] = 0.5f;
  }
  Rng rng(3);
  for (int i = 0; i < 100; ++i) {
    grounds.emplace_back(24, 16, 3);
    for (float& value : grounds.back().values) value = 0.5f + static_cast<float>(rng.uniform(0.0, 0.02));
  }
  for (int i = 0; i < 25; ++i) {
    colours.emplace_back(24, 16, 3);
    const std::array colour = {1.0f, 0.25f * static_cast<float>(i % 5), 0.25f * static_cast<float>(i / 5)};
    for (std::size_t k = 0; k < colours.back().values.size(); ++k) colours.back().values[k] = colour[k % 3];
  }
  grounds.emplace_back(24, 16, 3);  // black
  EXPECT_EQ(confused(texels), 0);
  EXPECT_EQ(confused(grounds), 0);
  EXPECT_EQ(confused(colours), 0);
}

TEST(LightPattern, SurvivesRoundingAndAnyBrightness) {
  Rng rng(4);
  for (int i = 0; i < 200; ++i) {
    Image light(24, 16, 3), rounded = light;
    const float brightness = static_cast<float>(rng.uniform(0.05, 20.0));
    for (std::size_t k = 0; k < light.values.size(); ++k) {
      light.values[k] = static_cast<float>(std::pow(rng.uniform(), 3.0));
      rounded.values[k] =
          brightness * linear_from_srgb(std::round(srgb_from_linear(light.values[k]) * 255.0f) / 255.0f);
    }
    EXPECT_TRUE(is_same_pattern(pattern_of(light), pattern_of(rounded))) << i;
  }
}

/// As JPEG with one colour for 2×2 texels stores it.
Image with_coarse_colour(const Image& light) {
  Image encoded = light;
  for (float& value : encoded.values) value = srgb_from_linear(value);
  Image decoded = light;
  for (int y = 0; y < light.height; ++y)
    for (int x = 0; x < light.width; ++x) {
      const auto luma = [&](int column, int row) {
        return 0.299f * encoded.at(column, row, 0) + 0.587f * encoded.at(column, row, 1) +
               0.114f * encoded.at(column, row, 2);
      };
      for (int c = 0; c < 3; ++c) {
        float difference = 0.0f;
        for (int k = 0; k < 4; ++k) {
          const int column = x / 2 * 2 + k % 2, row = y / 2 * 2 + k / 2;
          difference += (encoded.at(column, row, c) - luma(column, row)) / 4.0f;
        }
        decoded.at(x, y, c) = linear_from_srgb(std::clamp(luma(x, y) + difference, 0.0f, 1.0f));
      }
    }
  return decoded;
}

TEST(LightPattern, OfJpegFilesIsRecognisedByLuma) {
  Rng rng(5);
  std::vector<std::string> lights, copies, copies_as_png;
  for (int i = 0; i < 60; ++i) {
    Image light(24, 18, 3);
    const int side = 1 + i % 4;  // of saturated blocks
    std::vector<float> blocks(24 * 18 * 3);
    for (float& value : blocks) value = rng.uniform() < 0.5 ? 0.0f : 1.0f;
    for (std::size_t k = 0; k < light.values.size(); ++k) {
      const int column = static_cast<int>(k / 3) % 24, row = static_cast<int>(k / 3) / 24;
      light.values[k] = blocks[(row / side * 24 + column / side) * 3 + k % 3];
    }
    lights.push_back(pattern_of(light));
    copies.push_back(pattern_of(with_coarse_colour(light), true));
    copies_as_png.push_back(pattern_of(with_coarse_colour(light)));
  }
  for (std::size_t i = 0; i < lights.size(); ++i)
    for (std::size_t j = 0; j < lights.size(); ++j) {
      EXPECT_EQ(is_same_pattern(lights[i], copies[j]), i == j) << i << ' ' << j;
      EXPECT_EQ(is_same_pattern(copies_as_png[i], copies[j]), i == j) << i << ' ' << j;
    }
}

TEST(LatLong, DirectionsThatTheDocumentationNames) {
  const auto expect_direction = [](double column, double row, const Eigen::Vector3d& expected) {
    EXPECT_NEAR((lat_long_direction(column, row, 8, 4) - expected).norm(), 0.0, rounding)
        << column << ", " << row;
  };
  expect_direction(3.0, 0.0, {0, 1, 0});   // row 0 is straight up
  expect_direction(3.0, 4.0, {0, -1, 0});  // the last row straight down
  expect_direction(4.0, 2.0, {0, 0, 1});   // the centre looks along +Z
  expect_direction(0.0, 2.0, {0, 0, -1});  // the left edge along −Z
  expect_direction(8.0, 2.0, {0, 0, -1});  // and so does the right one
  expect_direction(2.0, 2.0, {-1, 0, 0});  // a quarter from the left along −X
  expect_direction(6.0, 2.0, {1, 0, 0});
}

TEST(LatLong, PositionUndoesDirection) {
  Rng rng(1);
  for (int i = 0; i < 1000; ++i) {
    const double column = rng.uniform(0.0, 640.0);
    const double row = rng.uniform(0.001, 319.999);
    const Eigen::Vector3d direction = lat_long_direction(column, row, 640, 320);
    EXPECT_NEAR(direction.norm(), 1.0, rounding);
    const Eigen::Vector2d position = lat_long_position(direction, 640, 320);
    constexpr double near_pole = 1e-4;  // texels: acos is steep there
    EXPECT_NEAR(position.x(), column, near_pole);
    EXPECT_NEAR(position.y(), row, near_pole);
  }
}

TEST(LatLong, PositionStaysInsideTheMap) {
  for (const Eigen::Vector3d& direction :
       {Eigen::Vector3d(0, 0, -1), Eigen::Vector3d(-1e-20, 0, -1), Eigen::Vector3d(1e-20, 0, -1),
        Eigen::Vector3d(0, 1.0000001, 0), Eigen::Vector3d(0, -1.0000001, 0)}) {
    const Eigen::Vector2d position = lat_long_position(direction, 640, 320);
    EXPECT_GE(position.x(), 0.0);
    EXPECT_LT(position.x(), 640.0);
    EXPECT_GE(position.y(), 0.0);
    EXPECT_LE(position.y(), 320.0);
  }
}

TEST(RadianceTowards, IsThatOfATexelInItsMiddleAndLinearBetween) {
  Rng rng(8);
  for (const LightDomain domain : {LightDomain{12, 6, Parameterisation::lat_long}, cube_domain(4)}) {
    const bool is_cube = domain.parameterisation == Parameterisation::cube;
    LightMap map{Image(domain.width, domain.height, 3), domain.parameterisation};
    for (float& value : map.radiance.values) value = static_cast<float>(rng.uniform());
    const auto direction = [&](double column, double row) {
      return is_cube ? cube_direction(column, row, domain.width)
                     : lat_long_direction(column, row, domain.width, domain.height);
    };
    for (int y = 0; y < domain.height; ++y)
      for (int x = 0; x < domain.width; ++x) {
        const Eigen::Array3f seen = radiance_towards(map, direction(x + 0.5, y + 0.5));
        for (int c = 0; c < 3; ++c) EXPECT_NEAR(seen[c], map.radiance.at(x, y, c), 1e-5f) << x << ' ' << y;
        if (is_cube && x + 1 == domain.width) continue;
        const float between =
            radiance_towards(map, direction(x + 1.0, y + 0.5))[0];  // lat-long: over the edge
        const float right = map.radiance.at((x + 1) % domain.width, y, 0);
        EXPECT_NEAR(between, 0.5f * (map.radiance.at(x, y, 0) + right), 1e-5f) << x << ' ' << y;
      }
    EXPECT_TRUE(radiance_towards(map, Eigen::Vector3d::UnitY()).allFinite());
    EXPECT_TRUE(radiance_towards(map, -Eigen::Vector3d::UnitZ()).allFinite());
  }
  EXPECT_THROW(radiance_towards({Image(2, 2, 3), Parameterisation::monitor}, Eigen::Vector3d::UnitY()),
               InputError);
}

TEST(Parameterisation, NamesRoundTrip) {
  for (auto p : {Parameterisation::monitor, Parameterisation::lat_long, Parameterisation::cube})
    EXPECT_EQ(parameterisation_from_name(name_of(p)), p);
  EXPECT_THROW(parameterisation_from_name("fisheye"), InputError);
}

TEST(KindOfLight, IsReadFromTheTexels) {
  const auto with = [](Box box, std::array<float, 3> colour) {
    Image light(8, 6, 3);
    for (int y = box.y0; y < box.y1; ++y)
      for (int x = box.x0; x < box.x1; ++x)
        for (int c = 0; c < 3; ++c) light.at(x, y, c) = colour[c];
    return light;
  };
  const std::array<float, 3> white{0.5f, 0.5f, 0.5f}, green{0.0f, 0.3f, 0.0f};
  EXPECT_EQ(kind_of_light(with({0, 0, 8, 6}, white)), "white");
  EXPECT_EQ(kind_of_light(with({0, 0, 8, 6}, green)), "primary");
  EXPECT_EQ(kind_of_light(with({0, 0, 8, 6}, {})), "black");
  EXPECT_EQ(kind_of_light(with({3, 0, 4, 6}, green)), "bar");
  EXPECT_EQ(kind_of_light(with({0, 2, 8, 3}, white)), "bar");
  EXPECT_EQ(kind_of_light(with({2, 2, 4, 4}, white)), "square");
  Image two = with({2, 2, 4, 4}, white);
  two.at(3, 3, 1) = 0.6f;
  EXPECT_EQ(kind_of_light(two), "natural");
  two = with({2, 2, 4, 4}, white);
  two.at(7, 5, 0) = 0.5f;
  EXPECT_EQ(kind_of_light(two), "natural") << "two rectangles";
  Image noise = with({0, 0, 8, 6}, white);
  noise.at(1, 1, 0) *= 1.0005f;
  EXPECT_EQ(kind_of_light(noise), "white");
}

}  // namespace
}  // namespace refield
