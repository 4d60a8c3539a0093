// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/peers/haar.h"

#include <gtest/gtest.h>

#include <numeric>

#include "bench/studies/peers/haar_pursuit.h"
#include "core/base/errors.h"
#include "tests/studies/peer_fixture.h"
#include "tests/support/random_data.h"
#include "tests/support/synthetic_capture.h"

namespace refield {
namespace {

constexpr float float_rounding = 1e-5f;
constexpr LightDomain domain{16, 12, Parameterisation::monitor};

std::vector<float> unit(int side, int place) {
  std::vector<float> square(static_cast<std::size_t>(side) * side, 0.0f);
  square[static_cast<std::size_t>(place)] = 1.0f;
  return square;
}

TEST(HaarTransform, IsOrthonormal) {
  constexpr int side = 8;
  std::vector<std::vector<float>> wavelets;
  for (int k = 0; k < side * side; ++k) {
    wavelets.push_back(unit(side, k));
    peers::inverse_haar_transform(wavelets.back(), side);
  }
  for (std::size_t a = 0; a < wavelets.size(); ++a)
    for (std::size_t b = 0; b < wavelets.size(); ++b)
      EXPECT_NEAR(std::inner_product(wavelets[a].begin(), wavelets[a].end(), wavelets[b].begin(), 0.0f),
                  a == b ? 1.0f : 0.0f, float_rounding)
          << a << ", " << b;
}

TEST(HaarTransform, InverseUndoesIt) {
  Rng rng(4);
  const Image image = test::random_image(rng, 16, 16, 1);
  std::vector<float> square = image.values;
  peers::haar_transform(square, 16);
  EXPECT_NEAR(square[0], 16.0f * std::reduce(image.values.begin(), image.values.end()) / 256.0f, 1e-4f);
  peers::inverse_haar_transform(square, 16);
  for (std::size_t i = 0; i < square.size(); ++i) EXPECT_NEAR(square[i], image.values[i], float_rounding);
}

TEST(HaarTransform, OneTexelAndPrimeSizes) {
  EXPECT_EQ(peers::haar_side({1, 1, Parameterisation::monitor}), 1);
  EXPECT_EQ(peers::haar_side({13, 7, Parameterisation::monitor}), 16);
  std::vector<float> single = {3.0f};
  peers::haar_transform(single, 1);
  EXPECT_EQ(single[0], 3.0f);
}

/// Transport that is a few wavelets, and photographs of it.
peers::HaarModel wavelet_scene() {
  peers::HaarModel truth{domain, 3, 2, {}};
  for (int p = 0; p < 6; ++p) {
    Rng rng(11, p);
    // The mean keeps predictions positive; two finer wavelets lie within the map.
    const std::vector<std::uint32_t> atoms = {0, 1 + static_cast<std::uint32_t>(rng.below(3)),
                                              17 + static_cast<std::uint32_t>(rng.below(3))};
    std::vector<float> weights;
    for (int k = 0; k < 9; ++k)
      weights.push_back(static_cast<float>(k < 3 ? rng.uniform(2.0, 3.0) : rng.uniform(0.3, 0.5)));
    truth.transfer.append_row(atoms, weights);
  }
  return truth;
}

peers::PeerData photographs_of(const peers::HaarModel& truth, int images) {
  peers::PeerData data;
  data.domain = domain;
  data.width = truth.width;
  data.height = truth.height;
  data.lights = test::random_lights(images, domain.width, domain.height, 21);
  data.observed.resize(images, 3 * data.pixels());
  for (int j = 0; j < images; ++j) {
    const Image photograph = truth.relight(data.lights[static_cast<std::size_t>(j)]);
    data.observed.row(j) =
        Eigen::Map<const Eigen::RowVectorXf>(photograph.values.data(), data.observed.cols());
  }
  return data;
}

TEST(HaarPursuit, FindsTransportOfAFewWavelets) {
  const peers::HaarModel truth = wavelet_scene();
  const auto model = peers::fit_haar(photographs_of(truth, 80), 8);
  for (const LightMap& light : test::random_lights(3, domain.width, domain.height, 99))
    EXPECT_LT(test::relative_difference(model.relight(light), truth.relight(light)), 1e-3);
}

TEST(HaarPursuit, MoreWaveletsNeverFitTheTrainingImagesWorse) {
  const LightDomain map = domain;
  const ReflectanceField scene = test::field_of_boxes(4, 3, map, {{1, 2, 9, 7}, {3, 0, 16, 12}}, 2);
  const peers::PeerData data = test::photographed(scene, test::random_lights(60, 16, 12, 7));
  double before = 1e9;
  for (const int wavelets : {1, 2, 4, 8, 16, 32}) {
    const auto model = peers::fit_haar(data, wavelets);
    double squared = 0.0;
    for (int j = 0; j < data.images(); ++j) {
      const Image fitted = model.relight(data.lights[static_cast<std::size_t>(j)]);
      for (Eigen::Index i = 0; i < data.observed.cols(); ++i)
        squared += std::pow(fitted.values[static_cast<std::size_t>(i)] - data.observed(j, i), 2.0);
    }
    EXPECT_LE(squared, before * (1.0 + 1e-4)) << wavelets;  // 1e-4: residuals near rounding
    before = squared;
  }
}

TEST(HaarPursuit, LeavesOutSamplesThatWereNotMeasured) {
  const peers::HaarModel truth = wavelet_scene();
  peers::PeerData data = photographs_of(truth, 80);
  for (int k = 0; k < 40; ++k) data.observed((7 * k) % 80, k % data.observed.cols()) = NAN;
  const auto model = peers::fit_haar(data, 12);
  for (const LightMap& light : test::random_lights(3, domain.width, domain.height, 99))
    EXPECT_LT(test::relative_difference(model.relight(light), truth.relight(light)), 0.03);
}

TEST(HaarPursuit, RefusesMoreWaveletsThanImages) {
  const peers::PeerData data = photographs_of(wavelet_scene(), 10);
  EXPECT_THROW(peers::fit_haar(data, 10), InputError);
  EXPECT_THROW(peers::fit_haar(data, 0), InputError);
}

}  // namespace
}  // namespace refield
