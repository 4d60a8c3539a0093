// SPDX-License-Identifier: Apache-2.0
#include "estimate/fit/fit_pixel.h"
#include "core/base/linear_algebra.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <limits>
#include <map>

#include "core/base/rng.h"
#include "estimate/fit/refit.h"
#include "estimate/fit/weighted_fit.h"
#include "tests/support/synthetic_capture.h"

namespace refield {
namespace {

constexpr float not_measured = std::numeric_limits<float>::quiet_NaN();

/// Samples of one pixel that sees `boxes` with the given weights [boxes × 3].
struct Pixel {
  AlignedFloats samples;
  std::size_t stride;
  PixelSamples view() const { return {samples.data(), samples.data() + stride, samples.data() + 2 * stride}; }
};

Pixel pixel_of_boxes(const BoxTable& table, const std::vector<Box>& boxes, const std::vector<float>& weights,
                     double noise = 0.0) {
  Pixel pixel{AlignedFloats(3 * table.stride()), table.stride()};
  AlignedFloats column(3 * table.stride());
  for (std::size_t k = 0; k < boxes.size(); ++k) {
    table.column(boxes[k], column.data());
    for (int c = 0; c < 3; ++c)
      for (int j = 0; j < table.images(); ++j)
        pixel.samples[c * table.stride() + j] += weights[3 * k + c] * column[c * table.stride() + j];
  }
  Rng rng(5);
  for (int c = 0; c < 3; ++c)
    for (int j = 0; j < table.images(); ++j)
      pixel.samples[c * table.stride() + j] *= static_cast<float>(1.0 + noise * rng.normal());
  return pixel;
}

EstimateOptions options_for(EstimateMode mode, int kernels) {
  EstimateOptions options;
  options.mode = mode;
  options.kernels = kernels;
  return options;
}

/// The reflectance function as an image over the light map.
Image rendered(const std::vector<Box>& boxes, const std::vector<float>& weights, const LightDomain& domain) {
  Image image(domain.width, domain.height, 3);
  for (std::size_t k = 0; k < boxes.size(); ++k)
    for (int y = boxes[k].y0; y < boxes[k].y1; ++y)
      for (int x = boxes[k].x0; x < boxes[k].x1; ++x)
        for (int c = 0; c < 3; ++c) image.at(x, y, c) += weights[3 * k + c];
  return image;
}

class FitPixel : public ::testing::TestWithParam<EstimateMode> {};

TEST_P(FitPixel, RecoversAFewBoxesExactlyFromNoiseFreeSamples) {
  const auto lights = test::random_lights(100, 32, 24, 8);
  const BoxTable table(lights);
  // Boxes of the kd-tree's lattice: a quarter, a small one and a half that overlaps neither.
  const std::vector<Box> boxes = {{0, 0, 16, 12}, {16, 12, 20, 15}, {24, 0, 32, 12}};
  const std::vector<float> weights = {1.0f, 0.5f, 0.25f, 3.0f, 2.0f, 8.0f, 0.2f, 0.7f, 0.1f};
  const Pixel pixel = pixel_of_boxes(table, boxes, weights);
  const SmoothSpace none(table);
  KernelCache cache(table, none, GetParam());
  PixelFitter fitter(cache, options_for(GetParam(), 25));
  PixelKernels found = fitter.fit(pixel.view());
  MaskedSamples samples;
  samples.assign(pixel.view(), table.stride(), table.images());
  found = WeightFitter(table).fit(prepare_kernel_set(found.boxes, cache), samples, found.weights);
  const Image truth = rendered(boxes, weights, table.domain());
  const Image estimate = rendered(found.boxes, found.weights, table.domain());
  double error = 0.0, signal = 0.0;
  for (std::size_t i = 0; i < truth.values.size(); ++i) {
    error += std::pow(estimate.values[i] - truth.values[i], 2.0);
    signal += std::pow(truth.values[i], 2.0);
  }
  EXPECT_LT(std::sqrt(error / signal), 1e-3);  // float32 samples and columns
  EXPECT_LT(std::sqrt(found.squared_residual / found.squared_samples), 1e-5);
  EXPECT_LT(found.boxes.size(), 25u) << "growing should stop once the fit is exact";
}

TEST_P(FitPixel, LeavesCoverTheMapAtEveryStep) {
  const auto lights = test::random_lights(40, 20, 14, 2);
  const BoxTable table(lights);
  const Pixel pixel = pixel_of_boxes(table, {{3, 2, 11, 9}, {0, 0, 20, 14}}, {1, 2, 3, .1f, .1f, .1f}, 0.02);
  const SmoothSpace none(table);
  KernelCache cache(table, none, GetParam());
  PixelFitter fitter(cache, options_for(GetParam(), 20));
  int steps = 0;
  fitter.fit(pixel.view(), [&](int subdivisions, std::span<const Box> boxes, std::span<const float> weights) {
    EXPECT_EQ(subdivisions, steps++);
    EXPECT_EQ(boxes.size(), static_cast<std::size_t>(subdivisions) + 1);
    std::vector<int> covered(20 * 14);
    for (const Box& box : boxes)
      for (int y = box.y0; y < box.y1; ++y)
        for (int x = box.x0; x < box.x1; ++x) ++covered[y * 20 + x];
    EXPECT_TRUE(std::ranges::all_of(covered, [](int n) { return n == 1; }));
    EXPECT_TRUE(std::ranges::all_of(weights, [](float w) { return w >= 0.0f; }));
  });
  EXPECT_GE(steps, 10) << "the tree hardly grew";
}

TEST_P(FitPixel, AnUnmeasuredSampleCountsAsAMissingImage) {
  auto lights = test::random_lights(60, 20, 14, 4);
  const BoxTable table(lights);
  Pixel pixel = pixel_of_boxes(table, {{3, 2, 11, 9}, {0, 0, 20, 14}}, {1, 2, 3, .1f, .1f, .1f}, 0.05);
  // The last five images are not measured in any channel; the reference has never seen them.
  Pixel shorter{AlignedFloats(3 * padded_length(55)), padded_length(55)};
  for (int c = 0; c < 3; ++c) {
    for (int j = 0; j < 55; ++j)
      shorter.samples[c * shorter.stride + j] = pixel.samples[c * pixel.stride + j];
    for (int j = 55; j < 60; ++j) pixel.samples[c * pixel.stride + j] = not_measured;
  }
  lights.resize(55);
  const BoxTable shorter_table(lights);
  const SmoothSpace none(table), shorter_none(shorter_table);
  KernelCache cache(table, none, GetParam()), shorter_cache(shorter_table, shorter_none, GetParam());
  const auto a = PixelFitter(cache, options_for(GetParam(), 8)).fit(pixel.view());
  const auto b = PixelFitter(shorter_cache, options_for(GetParam(), 8)).fit(shorter.view());
  EXPECT_NEAR(a.squared_residual, b.squared_residual, 1e-4 * b.squared_residual);
  EXPECT_NEAR(a.squared_samples, b.squared_samples, 1e-6 * b.squared_samples);
  const Image image_a = rendered(a.boxes, a.weights, table.domain());
  const Image image_b = rendered(b.boxes, b.weights, table.domain());
  for (std::size_t i = 0; i < image_a.values.size(); ++i)
    EXPECT_NEAR(image_a.values[i], image_b.values[i], 2e-3);  // of weights around 1; sums in another order
}

TEST_P(FitPixel, ClippedSamplesDoNotPullTheFit) {
  const auto lights = test::random_lights(80, 20, 14, 12);
  const BoxTable table(lights);
  const std::vector<Box> boxes = {{0, 0, 10, 7}};
  const std::vector<float> weights = {1.0f, 1.0f, 1.0f};
  Pixel pixel = pixel_of_boxes(table, boxes, weights);
  for (int c = 0; c < 3; ++c)
    for (int j = 0; j < 80; ++j) {
      float& b = pixel.samples[c * pixel.stride + j];
      if (b > 30.0f) b = not_measured;
    }
  const SmoothSpace none(table);
  KernelCache cache(table, none, GetParam());
  const auto found = PixelFitter(cache, options_for(GetParam(), 10)).fit(pixel.view());
  const Image estimate = rendered(found.boxes, found.weights, table.domain());
  for (int y = 0; y < 14; ++y)
    for (int x = 0; x < 20; ++x) EXPECT_NEAR(estimate.at(x, y, 0), x < 10 && y < 7 ? 1.0 : 0.0, 2e-3);
}

TEST_P(FitPixel, DegenerateSamplesGiveFiniteKernels) {
  const auto lights = test::random_lights(12, 6, 5, 4);
  const BoxTable table(lights);
  const SmoothSpace none(table);
  KernelCache cache(table, none, GetParam());
  PixelFitter fitter(cache, options_for(GetParam(), 12));
  Pixel pixel{AlignedFloats(3 * table.stride()), table.stride()};
  EXPECT_TRUE(fitter.fit(pixel.view()).boxes.empty()) << "a black pixel needs no kernel";
  for (float& b : pixel.samples) b = -1.0f;
  EXPECT_TRUE(fitter.fit(pixel.view()).boxes.empty()) << "negative samples cannot be explained";
  for (float& b : pixel.samples) b = not_measured;
  EXPECT_TRUE(fitter.fit(pixel.view()).boxes.empty()) << "nothing was measured";
  for (float& b : pixel.samples) b = 1e30f;
  for (const float w : fitter.fit(pixel.view()).weights) EXPECT_TRUE(std::isfinite(w));
}

TEST_P(FitPixel, ASingleTexelHasOneKernel) {
  const auto lights = test::random_lights(5, 1, 1, 4);
  const BoxTable table(lights);
  const SmoothSpace none(table);
  KernelCache cache(table, none, GetParam());
  const Pixel pixel = pixel_of_boxes(table, {{0, 0, 1, 1}}, {2.0f, 3.0f, 4.0f});
  const auto found = PixelFitter(cache, options_for(GetParam(), 5)).fit(pixel.view());
  ASSERT_EQ(found.boxes.size(), 1u);
  EXPECT_NEAR(found.weights[1], 3.0f, 1e-5f);
}

// A mirror that clips whenever it sees the texel shine: in what it measured the texel is as dark as rounding.
TEST(MeasuredSamples, ARectangleThatNoneOfThemSawGetsNoWeight) {
  auto lights = test::random_lights(40, 16, 12, 7);
  for (std::size_t j = 0; j < lights.size(); j += 2)
    for (int c = 0; c < 3; ++c) lights[j].radiance.at(3, 3, c) = 1e-12f;
  const BoxTable table(lights);
  const std::vector<Box> boxes = {{3, 3, 4, 4}, {0, 0, 16, 12}};
  Pixel pixel = pixel_of_boxes(table, boxes, {1.0f, 1.0f, 1.0f, 0.02f, 0.02f, 0.02f}, 0.02);
  for (int c = 0; c < 3; ++c)
    for (int j = 0; j < table.images(); ++j)
      pixel.samples[c * table.stride() + j] =
          j % 2 == 0 ? pixel.samples[c * table.stride() + j] + 0.05f : not_measured;
  MaskedSamples samples;
  samples.assign(pixel.view(), table.stride(), table.images());
  const SmoothSpace smooth(table);
  KernelCache cache(table, smooth, EstimateMode::fast);
  const std::vector<float> start(6, 1.0f);
  for (const PixelKernels& found :
       {WeightFitter(table).fit(prepare_kernel_set(boxes, cache), samples, start),
        WeightedFit(table, smooth).fit(boxes, smooth.class_without(), samples, {1.0, 1.0, 1.0})}) {
    ASSERT_EQ(found.boxes.size(), 1u);
    EXPECT_EQ(found.boxes[0].area(), 16 * 12);
  }
}

INSTANTIATE_TEST_SUITE_P(Modes, FitPixel, ::testing::Values(EstimateMode::paper, EstimateMode::refined),
                         [](const auto& mode) { return std::string(name_of(mode.param)); });

/// The greedy algorithms as the books say, with dense linear algebra over all images: slow, and nothing
/// shared with the fitter but the definition of splits.
class SlowReference {
 public:
  SlowReference(const std::vector<LightMap>& lights, const Pixel& pixel, EstimateMode mode)
      : table_(lights), pixel_(pixel), mode_(mode) {}

  /// Squared residual after each of `steps` subdivisions.
  std::vector<double> residuals(int steps) {
    std::vector<Box> leaves = {{0, 0, table_.domain().width, table_.domain().height}};
    std::vector<double> history = {residual(leaves)};
    for (int step = 0; step < steps; ++step) {
      std::vector<Box> best_leaves;
      double best = -std::numeric_limits<double>::infinity();
      for (std::size_t l = 0; l < leaves.size(); ++l)
        for (const auto& [first, second] : halves(leaves[l])) {
          auto trial = leaves;
          trial[l] = first;
          trial.push_back(second);
          const double score =
              mode_ == EstimateMode::paper ? -residual(trial) : gain(leaves, leaves[l], first);
          if (score > best) {
            best = score;
            best_leaves = trial;
          }
        }
      leaves = best_leaves;
      history.push_back(residual(leaves));
    }
    return history;
  }

 private:
  std::vector<std::pair<Box, Box>> halves(const Box& box) const {
    std::vector<std::pair<Box, Box>> result;
    for (const int x : split_positions(box.x0, box.x1, mode_))
      result.push_back({{box.x0, box.y0, x, box.y1}, {x, box.y0, box.x1, box.y1}});
    for (const int y : split_positions(box.y0, box.y1, mode_))
      result.push_back({{box.x0, box.y0, box.x1, y}, {box.x0, y, box.x1, box.y1}});
    return result;
  }
  Eigen::VectorXd column(const Box& box, int c) const {
    AlignedFloats all(3 * table_.stride());
    table_.column(box, all.data());
    return Eigen::Map<const Eigen::VectorXf>(all.data() + c * table_.stride(), table_.images())
        .cast<double>();
  }
  Eigen::VectorXd samples(int c) const {
    return Eigen::Map<const Eigen::VectorXf>(pixel_.samples.data() + c * table_.stride(), table_.images())
        .cast<double>();
  }
  Eigen::MatrixXd matrix(const std::vector<Box>& boxes, int c) const {
    Eigen::MatrixXd A(table_.images(), boxes.size());
    for (std::size_t k = 0; k < boxes.size(); ++k) A.col(k) = column(boxes[k], c);
    return A;
  }
  /// Projected gradient with momentum (FISTA), run far past convergence.
  static Eigen::VectorXd nnls(const Eigen::MatrixXd& A, const Eigen::VectorXd& b) {
    const Eigen::VectorXd scale = A.colwise().norm().cwiseMax(1e-30);
    const Eigen::MatrixXd G =
        scale.cwiseInverse().asDiagonal() * (A.transpose() * A) * scale.cwiseInverse().asDiagonal();
    const Eigen::VectorXd h = scale.cwiseInverse().asDiagonal() * (A.transpose() * b);
    const double step = 1.0 / symmetric_eigenvalues(G).maxCoeff();
    Eigen::VectorXd x = Eigen::VectorXd::Zero(A.cols()), y = x;
    double t = 1.0;
    for (int i = 0; i < 20000; ++i) {
      const Eigen::VectorXd next = (y - step * (G * y - h)).cwiseMax(0.0);
      const double t_next = 0.5 * (1.0 + std::sqrt(1.0 + 4.0 * t * t));
      const bool restart = (y - next).dot(next - x) > 0.0;
      y = restart ? next : Eigen::VectorXd(next + (t - 1.0) / t_next * (next - x));
      t = restart ? 1.0 : t_next;
      x = next;
    }
    return x.cwiseQuotient(scale);
  }
  double residual(const std::vector<Box>& boxes) const {
    double sum = 0.0;
    for (int c = 0; c < 3; ++c) {
      const auto A = matrix(boxes, c);
      sum += (A * nnls(A, samples(c)) - samples(c)).squaredNorm();
    }
    return sum;
  }
  double gain(const std::vector<Box>& leaves, const Box& parent, const Box& half) {
    double sum = 0.0;
    for (int c = 0; c < 3; ++c) {
      const auto A = matrix(leaves, c);
      auto& r = residual_cache_[{leaves.size(), c}];
      if (r.size() == 0) r = samples(c) - A * nnls(A, samples(c));
      // The half without its part along the leaf that it splits (see Split).
      const Eigen::VectorXd p = column(parent, c);
      const Eigen::VectorXd a = column(half, c);
      const Eigen::VectorXd d = a - a.dot(p) / p.squaredNorm() * p;
      const Eigen::VectorXd perpendicular = d - A * solve_least_squares(A, d);
      sum += std::pow(d.dot(r), 2.0) / perpendicular.squaredNorm();
    }
    return sum;
  }
  BoxTable table_;
  const Pixel& pixel_;
  EstimateMode mode_;
  std::map<std::pair<std::size_t, int>, Eigen::VectorXd> residual_cache_;
};

TEST(FitPixelReference, GreedyChoicesMatchTheSlowReference) {
  for (const auto mode : {EstimateMode::paper, EstimateMode::refined}) {
    const auto lights = test::random_lights(50, 16, 12, 21);
    const BoxTable table(lights);
    const Pixel pixel = pixel_of_boxes(table, {{2, 3, 7, 11}, {9, 0, 13, 5}, {0, 0, 16, 12}},
                                       {1, 2, 1, 2, 1, 1, .1f, .2f, .1f}, 0.03);
    constexpr int steps = 6;
    const auto expected = SlowReference(lights, pixel, mode).residuals(steps);
    const SmoothSpace none(table);
    KernelCache cache(table, none, mode);
    PixelFitter fitter(cache, options_for(mode, steps + 1));
    MaskedSamples samples;
    samples.assign(pixel.view(), table.stride(), table.images());
    WeightFitter weights(table);
    std::vector<double> found;
    fitter.fit(pixel.view(), [&](int, std::span<const Box> boxes, std::span<const float> x) {
      found.push_back(weights.try_set(prepare_kernel_set(boxes, cache), samples, x, 1e300));
    });
    ASSERT_GE(found.size(), expected.size());
    for (std::size_t i = 0; i < expected.size(); ++i)
      EXPECT_NEAR(found[i], expected[i], 1e-3 * expected[i]) << name_of(mode) << ", subdivision " << i;
  }
}

}  // namespace
}  // namespace refield
