// SPDX-License-Identifier: Apache-2.0
#include "estimate/fit/cell_fit.h"

#include <gtest/gtest.h>

#include "core/base/rng.h"
#include "estimate/fit/fit_block.h"
#include "estimate/quality/error_evidence.h"

namespace refield {
namespace {

/// Lights of random rectangles, 0 or 1, from a texel to half of the map; the first `images` train.
struct Lights {
  static constexpr int images = 80, tests = 40, width = 64, height = 48, rectangles = 600;

  explicit Lights(bool are_grey) {
    for (int j = 0; j < images + tests; ++j) {
      Rng rng(3, j);
      LightMap& light = all.emplace_back(LightMap{Image(width, height, 3, 0.0f), Parameterisation::monitor});
      for (int k = 0; k < 3 * rectangles; ++k) {
        const auto side = [&] { return static_cast<int>(std::pow(32.0, rng.uniform())); };
        const int right = static_cast<int>(width * rng.uniform()) + 1;
        const int bottom = static_cast<int>(height * rng.uniform()) + 1;
        const int left = std::max(right - side(), 0), top = std::max(bottom - side(), 0);
        const float level = rng.uniform() < 0.5 ? 0.0f : 1.0f;
        for (int y = top; y < bottom; ++y)
          for (int x = left; x < right; ++x)
            for (int c = 0; c < 3; ++c)
              if (are_grey || c == k % 3) light.radiance.at(x, y, c) = level;
      }
    }
  }
  std::vector<LightMap> all;
};

/// A pixel whose transport is a sum of rectangles, and fits to its noisy samples.
struct Seen {
  Seen(std::span<const Box> boxes, std::span<const float> weights, double noise, bool grey_lights = false)
      : lights(grey_lights),
        table(std::span(lights.all).first(Lights::images), hat_grid_for(lights.all[0].domain(), 80)),
        tests(std::span(lights.all).subspan(Lights::images), table.hats()),
        space(table),
        cache(table, space, EstimateMode::refined) {
    values = samples_in(table, boxes, weights);
    exact = samples_in(tests, boxes, weights);
    Rng rng(4);
    for (float& b : values) b *= static_cast<float>(1.0 + noise * rng.normal());
    masked.assign(pixel(), table.stride(), table.images());
  }
  static AlignedFloats samples_in(const BoxTable& of, std::span<const Box> boxes,
                                  std::span<const float> weights) {
    AlignedFloats sums(3 * of.stride(), 0.0f), column(sums.size());
    for (std::size_t k = 0; k < boxes.size(); ++k) {
      of.column(boxes[k], column.data());
      for (std::size_t i = 0; i < sums.size(); ++i) sums[i] += weights[3 * k + i / of.stride()] * column[i];
    }
    return sums;
  }
  PixelSamples pixel() const {
    return {values.data(), values.data() + table.stride(), values.data() + 2 * table.stride()};
  }
  PixelKernels rectangles() {
    FitTuning tuning;
    tuning.fits_cells = false;
    return BlockFitter(cache, Lights::images, 0.0, tuning).fit(std::vector{pixel()}, 1)[0];
  }
  /// Relative, under the tests' lights.
  double error_of(const PixelKernels& kernels) const {
    AlignedFloats found = samples_in(tests, kernels.boxes, kernels.weights);
    for (std::size_t h = 0; h < kernels.smooth.size() / 3; ++h)
      for (int c = 0; c < 3; ++c)
        for (int j = 0; j < tests.images(); ++j)
          found[c * tests.stride() + j] +=
              kernels.smooth[3 * h + c] * static_cast<float>(tests.hat_sums(static_cast<int>(h), c)[j]);
    double error = 0.0, all = 0.0;
    for (std::size_t i = 0; i < found.size(); ++i) {
      error += (found[i] - exact[i]) * (found[i] - exact[i]);
      all += exact[i] * exact[i];
    }
    return std::sqrt(error / all);
  }

  Lights lights;
  BoxTable table, tests;
  SmoothSpace space;
  KernelCache cache;
  AlignedFloats values, exact;
  MaskedSamples masked;
};

/// What the edge of a mirror sees: 200 texels of an ellipse, of random weights, the same for all channels but
/// for the colour or not.
Seen ragged_pixel(bool has_one_colour = true, bool grey_lights = false) {
  Rng rng(5);
  std::vector<Box> texels;
  std::vector<float> weights;
  for (int y = 12; y < 28; ++y)
    for (int x = 20; x < 44; ++x) {
      const double u = (x - 31.5) / 11.0, v = (y - 19.5) / 6.0;
      if (u * u + v * v > 1.0) continue;
      texels.push_back({x, y, x + 1, y + 1});
      auto weight = static_cast<float>(rng.uniform());
      for (const float colour : {1.0f, 0.8f, 0.5f}) {
        weights.push_back(colour * weight * weight);
        if (!has_one_colour) weight = static_cast<float>(rng.uniform());
      }
    }
  return Seen(texels, weights, 0.003, grey_lights);
}

TEST(CellFit, FollowsARaggedMirrorFurtherThanRectangles) {
  Seen seen = ragged_pixel();
  const PixelKernels rectangles = seen.rectangles();
  CellFit fit(seen.table, seen.space);
  const auto cells = fit.fit(rectangles, seen.masked);
  ASSERT_TRUE(cells);
  EXPECT_GT(seen.error_of(rectangles), 0.02) << "rectangles suffice; the test shows nothing";
  EXPECT_LT(seen.error_of(*cells), 0.75 * seen.error_of(rectangles));
}

TEST(CellFit, TellsItsErrorByLeaveOneOut) {
  // Of grey light the channels of a photograph are one sample; each alone would be predicted from the others.
  for (const bool grey_lights : {false, true}) {
    Seen seen = ragged_pixel(true, grey_lights);
    CellFit fit(seen.table, seen.space);
    const auto cells = fit.fit(seen.rectangles(), seen.masked);
    ASSERT_TRUE(cells);
    AlignedFloats residuals(3 * seen.table.stride());
    const double squared =
        ErrorEvaluator(seen.table, {}).leave_one_out(*cells, seen.cache, seen.masked, residuals.data());
    const double predicted = std::sqrt(squared / cells->squared_samples);
    // The rectangles, whose mean is theirs, have seen what is left out; grey light tells less to begin with.
    EXPECT_GT(predicted, (grey_lights ? 0.4 : 0.7) * seen.error_of(*cells));
    EXPECT_LT(predicted, 1.3 * seen.error_of(*cells));
  }
}

TEST(CellFit, LeavesRectanglesThatSuffice) {
  const std::array boxes{Box{8, 8, 24, 20}, Box{40, 20, 44, 40}};
  for (const double noise : {0.003, 0.03, 0.1}) {
    // In one colour, and in two: cells share theirs.
    for (const float blue : {1.0f, 0.2f}) {
      const std::array weights{1.0f, 1.0f, 1.0f, 1.0f, 0.5f, blue};
      Seen seen(boxes, weights, noise);
      EXPECT_FALSE(CellFit(seen.table, seen.space).fit(seen.rectangles(), seen.masked))
          << noise << ' ' << blue;
    }
  }
}

TEST(CellFit, HarmsNoPixelWhoseChannelsSeeOtherShapes) {
  Seen seen = ragged_pixel(false);
  const PixelKernels rectangles = seen.rectangles();
  const auto cells = CellFit(seen.table, seen.space).fit(rectangles, seen.masked);
  ASSERT_TRUE(cells);
  EXPECT_LT(seen.error_of(*cells), seen.error_of(rectangles));
}

TEST(CellFit, IsLeftOutWhereKernelsAreLimited) {
  const Seen seen = ragged_pixel();
  EstimateOptions options;
  const std::vector samples{seen.pixel()};
  EXPECT_GT(BlockModel(seen.table, options, 0.0).fit(samples, 1)[0].boxes.size(), 80u);
  options.kernels = 40;
  EXPECT_LE(BlockModel(seen.table, options, 0.0).fit(samples, 1)[0].boxes.size(), 40u);
}

}  // namespace
}  // namespace refield
