// SPDX-License-Identifier: Apache-2.0
#include "estimate/fit/select_kernels.h"
#include "core/base/linear_algebra.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>

#include "core/base/rng.h"
#include "estimate/fit/fit_block.h"
#include "tests/support/synthetic_capture.h"

namespace refield {
namespace {

/// A dictionary grown for one pixel, and that pixel in its coordinates.
struct Grown {
  Grown(int images, int hats_cap, const std::vector<Box>& boxes, double smooth, double noise)
      : lights(test::random_lights(images, 32, 24, 8)),
        table(lights, hat_grid_for(lights[0].domain(), hats_cap)),
        space(table),
        cache(table, space, EstimateMode::refined),
        search(cache, 40) {
    Rng rng(3);
    values.assign(3 * space.extent(), 0.0f);
    AlignedFloats column(3 * table.stride());
    for (const Box& box : boxes) {
      table.column(box, column.data());
      for (int c = 0; c < 3; ++c)
        for (int j = 0; j < images; ++j) values[c * space.extent() + j] += column[c * table.stride() + j];
    }
    for (int c = 0; c < 3; ++c)
      for (int j = 0; j < images; ++j) {
        float& b = values[c * space.extent() + j];
        // A smooth function over the light map: the hats' weights rise from node to node.
        for (int h = 0; h < table.hats().count(); ++h)
          b += static_cast<float>(smooth * (1.0 + 0.1 * h) * table.hat_sums(h, c)[j]);
        b *= static_cast<float>(1.0 + noise * rng.normal());
      }
    SearchTargets targets;
    for (int c = 0; c < 3; ++c) {
      space.extend(values.data() + c * space.extent(), c);
      targets[c] = {values.data() + c * space.extent()};
    }
    const TreeDictionary& dictionary = search.grow(targets, 3.0 * images, 56);
    for (int c = 0; c < 3; ++c) {
      const float* b = values.data() + c * space.extent();
      std::vector<const float*> basis;
      for (int k = 0; k < dictionary.rank; ++k)
        basis.push_back(dictionary.basis[c].data() + k * space.stride());
      pixel.inside[c].resize(dictionary.rank);
      dots(b, basis.data(), dictionary.rank, space.stride(), pixel.inside[c].data());
      pixel.smooth[c].assign(b + space.stride(), b + space.stride() + space.rank());
      for (int j = 0; j < images; ++j) pixel.squared[c] += static_cast<double>(b[j]) * b[j];
    }
    pixel.measured = 3.0 * images;
  }
  std::vector<LightMap> lights;
  BoxTable table;
  SmoothSpace space;
  KernelCache cache;
  TreeSearch search;
  AlignedFloats values;
  PixelCoordinates pixel;
};

TEST(SelectKernels, TwoBoxesOfTheTreeAreFoundAndNoMore) {
  Grown grown(80, 0, {{0, 0, 16, 12}, {24, 12, 32, 24}}, 0.0, 0.01);
  KernelSelector selector(grown.space);
  selector.prepare(grown.search.dictionary());
  ClassGuess guess;
  const KernelChoice choice = selector.select(grown.pixel, 25, guess);
  EXPECT_LE(choice.boxes.size(), 4u);
  const PixelWeights weights = selector.solve(grown.pixel, choice, {1.0, 1.0, 1.0});
  for (int c = 0; c < 3; ++c)
    EXPECT_LT(std::sqrt(weights.squared_residual[c] / grown.pixel.squared[c]), 0.012);
}

TEST(SelectKernels, ASmoothPixelTakesHatsAndHardlyABox) {
  Grown grown(80, 25, {}, 1.0, 0.01);
  KernelSelector selector(grown.space);
  selector.prepare(grown.search.dictionary());
  ClassGuess guess;
  const KernelChoice choice = selector.select(grown.pixel, 25, guess);
  EXPECT_TRUE(grown.space.classes()[choice.smooth_class].smooth);
  EXPECT_LE(choice.boxes.size(), 1u);
  const PixelWeights weights = selector.solve(grown.pixel, choice, {1.0, 1.0, 1.0});
  for (int c = 0; c < 3; ++c)
    EXPECT_LT(std::sqrt(weights.squared_residual[c] / grown.pixel.squared[c]), 0.012);
}

TEST(SelectKernels, AHighlightOnASmoothPixelTakesHatsAndABox) {
  Grown grown(80, 25, {{16, 12, 20, 16}}, 0.1, 0.005);
  KernelSelector selector(grown.space);
  selector.prepare(grown.search.dictionary());
  ClassGuess guess;
  const KernelChoice choice = selector.select(grown.pixel, 25, guess);
  EXPECT_TRUE(grown.space.classes()[choice.smooth_class].smooth);
  EXPECT_GE(choice.boxes.size(), 1u);
  EXPECT_LE(choice.boxes.size(), 5u) << "no more than 25 kernels with the hats";
}

/// Relative error on the samples of a pixel that sees two small spots, far apart, under lights of random
/// cells of 4×4 texels, of which a large rectangle around a spot tells little.
double error_of_two_spots(const FitTuning& tuning) {
  constexpr int images = 60, width = 64, height = 48, cell = 4;
  std::vector<LightMap> lights;
  for (int j = 0; j < images; ++j) {
    Rng rng(3, j);
    std::vector<float> levels;
    for (int k = 0; k < width / cell * (height / cell) * 3; ++k)
      levels.push_back(rng.uniform() < 0.5 ? 0.0f : 1.0f);
    LightMap& light = lights.emplace_back(LightMap{Image(width, height, 3, 0.0f), Parameterisation::monitor});
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x)
        for (int c = 0; c < 3; ++c)
          light.radiance.at(x, y, c) = levels[3 * (y / cell * (width / cell) + x / cell) + c];
  }
  const BoxTable table(lights, hat_grid_for(lights[0].domain(), 64));
  const SmoothSpace space(table);
  KernelCache cache(table, space, EstimateMode::refined);
  AlignedFloats values(3 * table.stride(), 0.0f), column(3 * table.stride());
  for (const Box& box : {Box{9, 20, 13, 24}, Box{47, 22, 51, 25}}) {
    table.column(box, column.data());
    std::ranges::transform(values, column, values.begin(), std::plus<>());
  }
  Rng rng(4);
  for (float& b : values) b *= static_cast<float>(1.0 + 0.005 * rng.normal());
  const float* b = values.data();
  const std::vector<PixelSamples> samples = {{b, b + table.stride(), b + 2 * table.stride()}};
  const auto kernels = BlockFitter(cache, 64, 0.0, tuning).fit(samples, 1);
  return std::sqrt(kernels[0].squared_residual / kernels[0].squared_samples);
}

TEST(SelectKernels, SplitsFindSpotsThatTheTreeMisses) {
  FitTuning tuning;
  EXPECT_LT(error_of_two_spots(tuning), 0.006) << "noise is 0.005";
  tuning.split_rounds = 0;
  EXPECT_GT(error_of_two_spots(tuning), 0.1) << "the tree finds them; the test shows nothing";
}

TEST(SelectKernels, NoiseAloneTakesNothing) {
  Grown grown(60, 25, {}, 0.0, 0.0);
  Rng rng(9);
  for (int c = 0; c < 3; ++c) {
    float* b = grown.values.data() + c * grown.space.extent();
    for (int j = 0; j < 60; ++j) b[j] = static_cast<float>(rng.normal());
    grown.space.extend(b, c);
  }
  SearchTargets targets;
  for (int c = 0; c < 3; ++c) targets[c] = {grown.values.data() + c * grown.space.extent()};
  const TreeDictionary& dictionary = grown.search.grow(targets, 180.0, 56);
  for (int c = 0; c < 3; ++c) {
    const float* b = grown.values.data() + c * grown.space.extent();
    std::vector<const float*> basis;
    for (int k = 0; k < dictionary.rank; ++k)
      basis.push_back(dictionary.basis[c].data() + k * grown.space.stride());
    grown.pixel.inside[c].resize(dictionary.rank);
    dots(b, basis.data(), dictionary.rank, grown.space.stride(), grown.pixel.inside[c].data());
    grown.pixel.smooth[c].assign(b + grown.space.stride(), b + grown.space.stride() + grown.space.rank());
    grown.pixel.squared[c] = 0.0;
    for (int j = 0; j < 60; ++j) grown.pixel.squared[c] += static_cast<double>(b[j]) * b[j];
  }
  KernelSelector selector(grown.space);
  selector.prepare(dictionary);
  ClassGuess guess;
  EXPECT_LE(selector.select(grown.pixel, 40, guess).boxes.size(), 1u);
}

TEST(SmoothSpaceMetric, EqualsTheDenseOneForEveryClass) {
  const auto lights = test::random_lights(30, 32, 24, 8);
  const BoxTable table(lights, hat_grid_for(lights[0].domain(), 25));
  const SmoothSpace space(table);
  AlignedFloats a(space.extent()), b(space.extent());
  Rng rng(4);
  for (int j = 0; j < 30; ++j) {
    a[j] = static_cast<float>(rng.normal());
    b[j] = static_cast<float>(rng.normal());
  }
  space.extend(a.data(), 1);
  space.extend(b.data(), 1);
  const int hats = space.hats();
  Eigen::MatrixXd H(30, hats);
  for (int h = 0; h < hats; ++h)
    for (int j = 0; j < 30; ++j) H(j, h) = table.hat_sums(h, 1)[j];
  const Eigen::VectorXd dense_a = Eigen::Map<Eigen::VectorXf>(a.data(), 30).cast<double>();
  const Eigen::VectorXd dense_b = Eigen::Map<Eigen::VectorXf>(b.data(), 30).cast<double>();
  for (const SmoothClass& smooth : space.classes()) {
    double product = dense_a.dot(dense_b);
    for (int k = 0; k < space.rank(); ++k)
      product += static_cast<double>(smooth.correction[1][k]) * a[space.stride() + k] * b[space.stride() + k];
    double dense = dense_a.dot(dense_b);
    if (smooth.smooth) {
      // (I + H Λ⁻¹ Hᵀ)⁻¹ = I − H (HᵀH + Λ)⁻¹ Hᵀ, Λ the prior's part of the normal equations.
      const Eigen::MatrixXd prior = Eigen::Map<const Eigen::MatrixXd>(smooth.penalty[1].data(), hats, hats);
      dense -=
          (H.transpose() * dense_a).dot(solve_symmetric(H.transpose() * H + prior, H.transpose() * dense_b));
    }
    EXPECT_NEAR(product, dense, 1e-3 * (1.0 + std::abs(dense)));
  }
  std::vector<double> products(hats);
  space.hat_products(a.data() + space.stride(), 1, products.data());
  const Eigen::VectorXd exact = H.transpose() * dense_a;
  for (int h = 0; h < hats; ++h) EXPECT_NEAR(products[h], exact[h], 1e-4 * exact.norm());
}

}  // namespace
}  // namespace refield
