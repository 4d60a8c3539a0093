// SPDX-License-Identifier: Apache-2.0
#include "simulate/rig/light_maps.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>
#include <numeric>

namespace refield {
namespace {

constexpr LightDomain domain{128, 96, Parameterisation::monitor};

std::vector<LightMap> lights_of(const LightPlan& plan, std::uint64_t seed,
                                std::vector<LightSpec>* list_out = nullptr) {
  const auto list = list_lights(plan);
  std::vector<LightMap> lights(list.size());
  make_lights(list, domain, seed,
              [&](std::size_t place, LightMap&& light) { lights[place] = std::move(light); });
  if (list_out) *list_out = list;
  return lights;
}

// Eighteen natural lights of three panoramas: made once, several tests look at them.
const std::vector<LightMap>& natural_lights() {
  static const auto lights =
      lights_of({.train = 18, .natural = 0, .bars = 0, .squares = 0, .white = 0, .black = 0}, 7);
  return lights;
}

double green(const LightMap& light, int x, int y) {
  return light.radiance.at(x, y, 1);
}

// Power of the horizontal frequencies 1 … count of a windowed 96×96 part, mean over rows: a discrete Fourier
// transform by its definition.
std::vector<double> row_power(const LightMap& light, int count) {
  constexpr int n = 96;
  double mean = 0.0;
  for (int y = 0; y < n; ++y)
    for (int x = 0; x < n; ++x) mean += green(light, x, y) / (n * n);
  std::vector<double> power(count, 0.0);
  for (int y = 0; y < n; ++y)
    for (int k = 1; k <= count; ++k) {
      std::complex<double> sum = 0.0;
      for (int x = 0; x < n; ++x) {
        const double window = 0.5 - 0.5 * std::cos(2.0 * std::numbers::pi * (x + 0.5) / n);
        sum += window * (green(light, x, y) - mean) * std::polar(1.0, -2.0 * std::numbers::pi * k * x / n);
      }
      power[k - 1] += std::norm(sum) / n;
    }
  return power;
}

TEST(NaturalLights, PowerSpectrumFallsAsInNaturalImages) {
  constexpr int lowest = 3, highest = 32;  // the window smears what is below, resampling dims what is above
  std::vector<double> power(highest, 0.0);
  for (const LightMap& light : natural_lights()) {
    const auto one = row_power(light, highest);
    for (int k = 0; k < highest; ++k) power[k] += one[k];
  }
  // Slope of log power over log frequency. A cut through a picture whose two-dimensional spectrum falls as
  // f^-a falls as f^-(a-1). Collections of photographs have a = 1.9 ± 0.4 (van der Schaaf and van Hateren
  // 1996) to 2.4 ± 0.3 (Tolhurst et al. 1992, twice the amplitude's 1.2).
  double sx = 0, sy = 0, sxx = 0, sxy = 0, n = 0;
  for (int k = lowest; k <= highest; ++k) {
    const double x = std::log(k), y = std::log(power[k - 1]);
    sx += x, sy += y, sxx += x * x, sxy += x * y, n += 1;
  }
  const double slope = (n * sxy - sx * sy) / (n * sxx - sx * sx) - 1.0;
  EXPECT_LT(slope, -1.5);
  EXPECT_GT(slope, -2.7);
}

TEST(NaturalLights, GradientsAreHeavyTailed) {
  std::vector<double> kurtoses;
  for (const LightMap& light : natural_lights()) {
    double second = 0.0, fourth = 0.0, count = 0.0;
    for (int y = 0; y < domain.height; ++y)
      for (int x = 1; x < domain.width; ++x) {
        const double d = green(light, x, y) - green(light, x - 1, y);
        second += d * d;
        fourth += d * d * d * d;
        ++count;
      }
    kurtoses.push_back(fourth * count / (second * second));
  }
  std::ranges::sort(kurtoses);
  EXPECT_GT(kurtoses[kurtoses.size() / 2], 6.0);  // a normal distribution has 3, a Laplacian one 6
}

TEST(NaturalLights, FitTheMonitorAndHaveContrastAndColour) {
  for (const LightMap& light : natural_lights()) {
    ASSERT_EQ(light.domain(), domain);
    double mean = 0.0, square = 0.0, chroma = 0.0;
    const double count = static_cast<double>(light.radiance.pixel_count());
    for (std::size_t p = 0; p < light.radiance.pixel_count(); ++p) {
      const float* v = light.radiance.values.data() + 3 * p;
      for (int c = 0; c < 3; ++c) ASSERT_TRUE(v[c] >= 0.0f && v[c] <= 1.0f);
      mean += v[1] / count;
      square += v[1] * v[1] / count;
      chroma += std::abs(v[0] - v[2]) / count;
    }
    EXPECT_GT(mean, 0.03);
    EXPECT_GT(std::sqrt(square - mean * mean), 0.05);
    EXPECT_GT(chroma, 0.005);
  }
}

TEST(NaturalLights, AllDifferAndTheSeedDecides) {
  const auto& lights = natural_lights();
  for (std::size_t a = 0; a < lights.size(); ++a)
    for (std::size_t b = a + 1; b < lights.size(); ++b) {
      double difference = 0.0, size = 0.0;
      for (std::size_t i = 0; i < lights[a].radiance.values.size(); ++i) {
        difference += std::pow(lights[a].radiance.values[i] - lights[b].radiance.values[i], 2);
        size += std::pow(lights[a].radiance.values[i], 2);
      }
      EXPECT_GT(difference, 0.1 * size) << a << " and " << b;
    }
  const LightPlan one{.train = 1, .natural = 1, .bars = 0, .squares = 0, .white = 0, .black = 0};
  const auto again = lights_of(one, 7), other = lights_of(one, 8);
  EXPECT_EQ(again[0].radiance.values, lights[0].radiance.values);  // more lights change none of the first
  EXPECT_NE(other[0].radiance.values, lights[0].radiance.values);
  EXPECT_NE(again[1].radiance.values, again[0].radiance.values);
}

// 24 designed lights; several tests look at them.
const std::vector<LightMap>& designed_lights() {
  static const auto lights = lights_of(
      {.train = 24, .kind = "designed", .natural = 0, .bars = 0, .squares = 0, .white = 0, .black = 0}, 7);
  return lights;
}

// Means over a grid of cells of 16 × 16 texels of one channel, less their own mean, scaled to norm 1.
std::vector<double> coarse(const LightMap& light, int channel) {
  constexpr int columns = domain.width / 16, rows = domain.height / 16;
  std::vector<double> cells(columns * rows);
  for (int y = 0; y < domain.height; ++y)
    for (int x = 0; x < domain.width; ++x)
      cells[y / 16 * columns + x / 16] += light.radiance.at(x, y, channel) / 256.0;
  double mean = 0.0, square = 0.0;
  for (const double v : cells) mean += v / (columns * rows);
  for (double& v : cells) {
    v -= mean;
    square += v * v;
  }
  for (double& v : cells) v /= std::sqrt(square);
  return cells;
}

// Root mean square correlation of the channels of a light, and of each channel between lights.
std::pair<double, double> coarse_correlations(const std::vector<LightMap>& lights) {
  double channels = 0.0, pairs = 0.0;
  const auto squared = [](const std::vector<double>& a, const std::vector<double>& b) {
    return std::pow(std::inner_product(a.begin(), a.end(), b.begin(), 0.0), 2);
  };
  const double n = static_cast<double>(lights.size());
  for (std::size_t i = 0; i < lights.size(); ++i) {
    for (int c = 0; c < 3; ++c)
      channels += squared(coarse(lights[i], c), coarse(lights[i], (c + 1) % 3)) / (3.0 * n);
    for (std::size_t j = 0; j < i; ++j)
      pairs += squared(coarse(lights[i], 1), coarse(lights[j], 1)) / (0.5 * n * (n - 1.0));
  }
  return {std::sqrt(channels), std::sqrt(pairs)};
}

TEST(DesignedLights, AreSaturatedWithEqualMeansAndAllSizes) {
  double square = 0.0;
  std::vector<int> runs;  // of equal texels along rows
  for (const LightMap& light : designed_lights()) {
    ASSERT_EQ(light.domain(), domain);
    double mean = 0.0;
    for (const float v : light.radiance.values) {
      ASSERT_TRUE(v == 0.0f || v == 1.0f);
      mean += v / static_cast<double>(light.radiance.values.size());
    }
    EXPECT_NEAR(mean, 0.5, 0.1);
    square += std::pow(mean - 0.5, 2) / static_cast<double>(designed_lights().size());
    for (int y = 0; y < domain.height; ++y)
      for (int x = 1, run = 1; x <= domain.width; ++x, ++run)
        if (x == domain.width || green(light, x, y) != green(light, x - 1, y)) runs.push_back(run), run = 0;
  }
  EXPECT_LT(std::sqrt(square), 0.04);
  const auto shorter = [&](int length) {
    return static_cast<double>(std::ranges::count_if(runs, [&](int run) { return run <= length; })) /
           static_cast<double>(runs.size());
  };
  for (const int length : {4, 8, 16, 32, 64}) {  // each octave has its part
    EXPECT_GT(shorter(length) - shorter(length / 2), 0.02) << length;
  }
}

// Of random levels, which follow the few large leaves of a map, both are 0.24 and more; natural channels have
// 0.9.
TEST(DesignedLights, AreLessCorrelatedThanChance) {
  const auto [channels, pairs] = coarse_correlations(designed_lights());
  constexpr double by_chance = 0.24;
  EXPECT_LT(channels, by_chance);
  EXPECT_LT(pairs, by_chance);
  EXPECT_GT(coarse_correlations(natural_lights()).first, 3.0 * channels);
}

TEST(DesignedLights, MoreLightsChangeNoneOfTheFirst) {
  LightPlan one{
      .train = 1, .kind = "designed", .natural = 0, .bars = 0, .squares = 0, .white = 0, .black = 0};
  EXPECT_EQ(lights_of(one, 7)[0].radiance.values, designed_lights()[0].radiance.values);
  EXPECT_NE(lights_of(one, 8)[0].radiance.values, designed_lights()[0].radiance.values);
}

// Maps that are tall, tiny, or stacked windows of several monitors.
TEST(DesignedLights, FillMapsOfAnyShape) {
  for (const LightDomain shape :
       {LightDomain{8, 8, Parameterisation::monitor}, LightDomain{40, 160, Parameterisation::monitor}}) {
    LeafPatterns patterns(shape, 3);
    for (int i = 0; i < 4; ++i) {
      const LightMap light = patterns.next();
      ASSERT_EQ(light.domain(), shape);
      const double lit = static_cast<double>(std::ranges::count(light.radiance.values, 1.0f)) /
                         static_cast<double>(light.radiance.values.size());
      EXPECT_GT(lit, 0.15);
      EXPECT_LT(lit, 0.85);
    }
  }
}

TEST(ColouredLights, HaveOneOrTwoPrimariesEach) {
  std::vector<LightSpec> list;
  const auto lights = lights_of(
      {.train = 1, .natural = 1, .coloured = 6, .bars = 0, .squares = 0, .white = 0, .black = 0}, 7, &list);
  const std::vector<std::string> lit = {"r", "g", "b", "gb", "rb", "rg"};
  for (std::size_t i = 2; i < lights.size(); ++i) {
    EXPECT_EQ(list[i].kind, "coloured");
    EXPECT_EQ(list[i].role, FrameRole::test);
    std::string channels;
    for (int c = 0; c < 3; ++c)
      for (std::size_t p = c; p < lights[i].radiance.values.size(); p += 3)
        if (lights[i].radiance.values[p] > 0.0f) {
          channels += "rgb"[c];
          break;
        }
    EXPECT_EQ(channels, lit[i - 2]);
  }
}

TEST(TestLights, BarsSlideFromEdgeToEdgeAndSquaresLieInside) {
  std::vector<LightSpec> list;
  const auto lights =
      lights_of({.train = 1, .natural = 0, .bars = 8, .squares = 6, .white = 1, .black = 1}, 1, &list);
  int next_bar_left = 0, squares = 0;
  for (std::size_t place = 0; place < list.size(); ++place) {
    const Image& image = lights[place].radiance;
    int left = domain.width, right = -1, top = domain.height, bottom = -1;
    double sum = 0.0;
    for (int y = 0; y < domain.height; ++y)
      for (int x = 0; x < domain.width; ++x)
        if (image.at(x, y, 0) > 0.0f) {
          left = std::min(left, x), right = std::max(right, x), top = std::min(top, y),
          bottom = std::max(bottom, y);
          sum += image.at(x, y, 0);
        }
    if (list[place].kind == "bar") {
      EXPECT_EQ(right - left + 1, 16);
      EXPECT_EQ(left, next_bar_left);
      EXPECT_EQ(sum, 16.0 * domain.height);
      next_bar_left += 16;  // eight bars of an eighth each lie side by side
    } else if (list[place].kind == "square") {
      EXPECT_EQ(right - left + 1, 8);
      EXPECT_EQ(bottom - top + 1, 8);
      EXPECT_EQ(sum, 64.0);
      ++squares;
    } else if (list[place].kind == "white") {
      EXPECT_EQ(sum, 1.0 * domain.width * domain.height);
    } else if (list[place].kind == "black") {
      EXPECT_EQ(sum, 0.0);
    }
    EXPECT_EQ(list[place].role, list[place].kind == "natural" ? FrameRole::train : FrameRole::test);
  }
  EXPECT_EQ(next_bar_left, 128);
  EXPECT_EQ(squares, 6);
}

TEST(PanoramaView, LooksWhereItIsTold) {
  // A panorama that is red where x > 0, green where y > 0, blue where z > 0.
  Image panorama(256, 128, 3);
  for (int y = 0; y < 128; ++y)
    for (int x = 0; x < 256; ++x) {
      const Eigen::Vector3d d = lat_long_direction(x + 0.5, y + 0.5, 256, 128);
      for (int c = 0; c < 3; ++c) panorama.at(x, y, c) = d[c] > 0.0 ? 1.0f : 0.0f;
    }
  const Image ahead = view_of_panorama(panorama, {.horizontal_fov_degrees = 60}, 32, 24);  // along +Z
  EXPECT_FLOAT_EQ(ahead.at(16, 12, 2), 1.0f);
  EXPECT_FLOAT_EQ(ahead.at(16, 2, 1), 1.0f);
  EXPECT_FLOAT_EQ(ahead.at(16, 21, 1), 0.0f);
  // Not mirrored: as in the panorama itself, +X lies to the right of +Z.
  EXPECT_FLOAT_EQ(ahead.at(28, 12, 0), 1.0f);
  EXPECT_FLOAT_EQ(ahead.at(3, 12, 0), 0.0f);
  const Image up = view_of_panorama(panorama, {.turn = {.pitch = -80}, .horizontal_fov_degrees = 10}, 8, 8);
  EXPECT_FLOAT_EQ(up.at(4, 4, 1), 1.0f);
}

}  // namespace
}  // namespace refield
