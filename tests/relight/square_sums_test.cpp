// SPDX-License-Identifier: Apache-2.0
#include "relight/tiles/box_sums.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "core/base/rng.h"
#include "core/light/cube_map.h"
#include "tests/support/random_data.h"

namespace refield {
namespace {

LightBasis random_squares(Rng& rng, int resolution) {
  LightBasis basis{cube_domain(resolution), {}, {}, Measure::solid_angle};
  const auto square = [&] {
    int size = resolution;
    while (size > 1 && rng.uniform() < 0.6) size /= 2;
    const auto place = [&] {
      return size * static_cast<int>(rng.below(static_cast<std::uint64_t>(resolution / size)));
    };
    const int x = place(), y = resolution * static_cast<int>(rng.below(cube_faces)) + place();
    return Box{x, y, x + size, y + size};
  };
  for (int i = 0; i < 300; ++i) {
    basis.boxes.push_back(square());
    const Eigen::Vector3f vector(static_cast<float>(rng.uniform()),
                                 static_cast<float>(rng.uniform(-1.0, 1.0)),
                                 static_cast<float>(rng.uniform(-1.0, 1.0)));
    basis.vector_boxes.push_back({square(), vector});
  }
  return basis;
}

std::vector<SmallBox> small_boxes(const LightBasis& basis) {
  std::vector<SmallBox> boxes;
  for (const Box& box : basis.boxes) boxes.push_back(small_box(box));
  return boxes;
}

// From one texel per face to sixteen blocks.
TEST(SquareSums, AreThoseOfTheBasis) {
  Rng rng(4);
  for (const int resolution : {1, 2, 16, 64, 256}) {
    const LightBasis basis = random_squares(rng, resolution);
    const auto boxes = small_boxes(basis);
    ASSERT_TRUE(SquareSums::can_sum(resolution, basis.vector_boxes, boxes));
    const SquareSums squares(resolution, basis.vector_boxes, boxes);
    LightMap light = test::random_light(rng, basis.domain);
    light.radiance.at(resolution / 2, resolution / 3, 1) = 1e5f;
    const std::vector<float> expected = basis.project(light);
    std::vector<float> sums(expected.size());
    Image copy(resolution, cube_faces * resolution, 3);
    ASSERT_TRUE(squares.project(light.radiance, copy, sums));
    EXPECT_EQ(copy.values, light.radiance.values);
    for (std::size_t k = 0; k < basis.size(); ++k)
      for (std::size_t c = 0; c < 3; ++c) {
        const Box box = basis.support(k);
        double of_box = 0.0;
        for (int y = box.y0; y < box.y1; ++y)
          for (int x = box.x0; x < box.x1; ++x)
            of_box += cube_solid_angle(x, y, resolution) * light.radiance.at(x, y, static_cast<int>(c));
        ASSERT_NEAR(sums[3 * k + c], expected[3 * k + c], 2e-6 * of_box) << resolution << " " << k;
      }

    // Planes of channels, as NumPy may have them.
    std::vector<float> planes(light.radiance.values.size());
    const auto pixels = light.radiance.pixel_count();
    for (std::size_t i = 0; i < planes.size(); ++i) planes[i % 3 * pixels + i / 3] = light.radiance.values[i];
    const ImageView view(planes.data(), resolution, cube_faces * resolution, 3,
                         static_cast<std::ptrdiff_t>(pixels), 1, resolution);
    std::vector<float> again(sums.size());
    ASSERT_TRUE(squares.project(view, copy, again));
    EXPECT_EQ(again, sums);
  }
}

TEST(SquareSums, FindWhatIsNotFiniteAndNothingElse) {
  constexpr int resolution = 128;
  Rng rng(5);
  const LightBasis basis = random_squares(rng, resolution);
  const SquareSums squares(resolution, basis.vector_boxes, small_boxes(basis));
  Image copy(resolution, cube_faces * resolution, 3);
  std::vector<float> sums(3 * basis.size());
  for (const float value : {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity(),
                            -std::numeric_limits<float>::infinity()}) {
    Image light(resolution, cube_faces * resolution, 3, 1.0f);
    light.at(77, 500, 2) = value;
    EXPECT_FALSE(squares.project(light, copy, sums));
  }
  // Sums that leave the range of float do not make the light wrong.
  const Image bright(resolution, cube_faces * resolution, 3, std::numeric_limits<float>::max());
  EXPECT_TRUE(squares.project(bright, copy, sums));
}

TEST(SquareSums, TakeSquaresOfAQuadtreeAlone) {
  const auto can = [](int resolution, const SmallBox& box) {
    return SquareSums::can_sum(resolution, {}, {&box, 1});
  };
  EXPECT_TRUE(can(16, {8, 24, 16, 32}));
  EXPECT_FALSE(can(12, {0, 0, 4, 4}));
  EXPECT_FALSE(can(16, {8, 24, 16, 28}));
  EXPECT_FALSE(can(16, {4, 24, 12, 32}));
  EXPECT_FALSE(can(16, {0, 0, 16, 96}));
  const VectorBox odd{{0, 0, 3, 3}, {1.0f, 0.0f, 0.0f}};
  EXPECT_FALSE(SquareSums::can_sum(16, {&odd, 1}, {}));
}

}  // namespace
}  // namespace refield
