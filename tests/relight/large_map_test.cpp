// SPDX-License-Identifier: Apache-2.0
// Maps of 4096×2048 texels with a sun of 1e5: float tables and sums would drown what is dark.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <vector>

#include "core/base/rng.h"
#include "core/field/reflectance_field.h"
#include "relight/environment/environment.h"
#include "relight/relight.h"

namespace refield {
namespace {

constexpr LightDomain domain{4096, 2048, Parameterisation::lat_long};
constexpr int sun_x = 1234, sun_y = 567;
constexpr float sun = 1e5f;
constexpr double allowed_error = 1e-6;
constexpr int pixels = 400, kernels = 25;

/// From one texel to the whole map, all sizes alike often; some hold the sun, some miss it by a texel.
std::vector<Box> boxes_of_all_sizes(Rng& rng) {
  std::vector<Box> boxes{{0, 0, domain.width, domain.height},
                         {sun_x, sun_y, sun_x + 1, sun_y + 1},
                         {sun_x + 1, sun_y, sun_x + 2, sun_y + 1},
                         {sun_x + 1, 0, domain.width, domain.height},
                         {0, sun_y + 1, domain.width, domain.height},
                         {domain.width - 1, domain.height - 1, domain.width, domain.height}};
  while (boxes.size() < 300) {
    const int width = static_cast<int>(std::exp(rng.uniform(0.0, std::log(domain.width + 0.999))));
    const int height = static_cast<int>(std::exp(rng.uniform(0.0, std::log(domain.height + 0.999))));
    const int x = static_cast<int>(rng.below(domain.width - width + 1));
    const int y = static_cast<int>(rng.below(domain.height - height + 1));
    boxes.push_back({x, y, x + width, y + height});
  }
  return boxes;
}

/// Of all kernels: texels, or the sum of a hat's values.
std::vector<double> areas_of(const LightBasis& basis) {
  std::vector<double> areas;
  for (std::size_t k = 0; k < basis.size(); ++k) areas.push_back(basis.area(k));
  return areas;
}

/// Weights such that small boxes count as much as large ones.
ReflectanceField field_of(const std::vector<Box>& boxes, Rng& rng) {
  ReflectanceField field;
  field.width = pixels;
  field.height = 1;
  field.basis = {domain, {3, 2}, boxes};
  const auto areas = areas_of(field.basis);
  for (int p = 0; p < pixels; ++p) {
    std::vector<std::uint32_t> columns;
    std::vector<float> weights;
    for (int k = 0; k < kernels; ++k) {
      columns.push_back(static_cast<std::uint32_t>(rng.below(field.basis.size())));
      for (int c = 0; c < 3; ++c)
        weights.push_back(static_cast<float>(rng.uniform() / areas[columns.back()]));
    }
    field.transfer.append_row(columns, weights);
  }
  return field;
}

LightMap natural_map() {
  LightMap light{Image(domain.width, domain.height, 3), domain.parameterisation};
  Rng rng(7);
  for (float& value : light.radiance.values)  // heavy-tailed, from 1e-4 to 100
    value = static_cast<float>(1e-4 / (rng.uniform() + 1e-6));
  for (int c = 0; c < 3; ++c) light.radiance.at(sun_x, sun_y, c) = sun;
  return light;
}

/// Each kernel summed texel by texel from the map itself, all in double.
std::vector<double> reference(const ReflectanceField& field, const LightMap& light) {
  std::vector<double> coefficients(3 * field.basis.size());
  for (std::size_t k = 0; k < field.basis.size(); ++k) {
    const Box within = field.basis.support(k);
    for (int y = within.y0; y < within.y1; ++y) {
      double row[3] = {};
      for (int x = within.x0; x < within.x1; ++x) {
        const auto value = static_cast<double>(field.basis.value(k, x, y));
        for (int c = 0; c < 3; ++c) row[c] += value * light.radiance.at(x, y, c);
      }
      for (int c = 0; c < 3; ++c) coefficients[3 * k + c] += row[c];
    }
  }
  std::vector<double> image(3 * pixels);
  const SparseTransfer& t = field.transfer;
  for (std::size_t p = 0; p < pixels; ++p)
    for (auto e = t.row_start[p]; e < t.row_start[p + 1]; ++e)
      for (int c = 0; c < 3; ++c)
        image[3 * p + c] += static_cast<double>(t.weight[3 * e + c]) * coefficients[3 * t.column[e] + c];
  return image;
}

struct Errors {
  double rmse = 0.0;   ///< relative, over all pixels
  double worst = 0.0;  ///< of single samples, relative
};

Errors errors_of(const Image& found, const std::vector<double>& expected) {
  double squares = 0.0, signal = 0.0, worst = 0.0;
  for (std::size_t i = 0; i < expected.size(); ++i) {
    const double error = found.values[i] - expected[i];
    squares += error * error;
    signal += expected[i] * expected[i];
    if (expected[i] > 0.0) worst = std::max(worst, std::abs(error) / expected[i]);
  }
  return {std::sqrt(squares / signal), worst};
}

class LargeMap : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    Rng rng(11);
    field_ = field_of(boxes_of_all_sizes(rng), rng);
  }
  static inline ReflectanceField field_;
};

TEST_F(LargeMap, WithASunIsRelitToAMillionth) {
  const LightMap light = natural_map();
  const Errors errors = errors_of(field_.relight(light), reference(field_, light));
  std::printf("4096×2048 with a sun of 1e5: relative RMSE %.2g, worst sample %.2g\n", errors.rmse,
              errors.worst);
  EXPECT_LE(errors.rmse, allowed_error);
  EXPECT_LE(errors.worst, allowed_error);  // pixels that never see the sun, too
}

TEST_F(LargeMap, OfOneValueGivesTheKernelsEnergy) {
  const LightMap light{Image(domain.width, domain.height, 3, 0.7f), domain.parameterisation};
  const auto areas = areas_of(field_.basis);
  std::vector<double> expected(3 * pixels);
  const SparseTransfer& t = field_.transfer;
  for (std::size_t p = 0; p < pixels; ++p)
    for (auto e = t.row_start[p]; e < t.row_start[p + 1]; ++e)
      for (int c = 0; c < 3; ++c)
        expected[3 * p + c] += static_cast<double>(0.7f) * t.weight[3 * e + c] * areas[t.column[e]];
  EXPECT_LE(errors_of(field_.relight(light), expected).worst, allowed_error);
}

TEST_F(LargeMap, OfOneLitTexelGivesTheKernelsThere) {
  for (const auto& [x, y] : {std::pair{sun_x, sun_y}, {0, 0}, {domain.width - 1, domain.height - 1}}) {
    LightMap light{Image(domain.width, domain.height, 3), domain.parameterisation};
    for (int c = 0; c < 3; ++c) light.radiance.at(x, y, c) = sun;
    std::vector<double> expected(3 * pixels);
    const SparseTransfer& t = field_.transfer;
    for (std::size_t p = 0; p < pixels; ++p)
      for (auto e = t.row_start[p]; e < t.row_start[p + 1]; ++e)
        for (int c = 0; c < 3; ++c)
          expected[3 * p + c] += static_cast<double>(sun) * t.weight[3 * e + c] *
                                 static_cast<double>(field_.basis.value(t.column[e], x, y));
    const Image image = field_.relight(light);
    const Errors errors = errors_of(image, expected);
    EXPECT_LE(errors.rmse, allowed_error);
    EXPECT_LE(errors.worst, allowed_error);
    for (std::size_t i = 0; i < expected.size(); ++i)
      if (expected[i] == 0.0) {
        EXPECT_EQ(image.values[i], 0.0f);
      }
  }
}

TEST_F(LargeMap, TurnedByAFullCircleIsItself) {
  const LightMap light = natural_map();
  EXPECT_TRUE(rotated(light, 1.0).radiance.values == light.radiance.values);
  EXPECT_TRUE(rotated(rotated(light, 0.25), 0.75).radiance.values == light.radiance.values);
  const EnvironmentProjector projector(domain, {});
  EXPECT_TRUE(projector.project(light, {360, -360, 720}).light.radiance.values == light.radiance.values);
  EXPECT_TRUE(projector.project(light, {90, 0, 0}).light.radiance.values ==
              rotated(light, 0.25).radiance.values);
}

}  // namespace
}  // namespace refield
