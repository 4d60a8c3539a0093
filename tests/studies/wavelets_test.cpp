// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/prt/wavelets.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

#include "bench/studies/prt/integrate.h"
#include "core/base/errors.h"
#include "core/base/rng.h"
#include "core/light/cube_map.h"
#include "tests/simulate/prt/small_scenes.h"
#include "tests/support/random_data.h"

namespace refield::prt {
namespace {

TEST(HaarTransform, KeepsLengthsAndLeadsBack) {
  constexpr int side = 16;
  Rng rng(1);
  const std::vector<float> values = refield::test::random_image(rng, side, side, 1).values;
  std::vector<float> there = values;
  haar_transform(there, side);
  const auto square = [](const std::vector<float>& v) {
    return std::inner_product(v.begin(), v.end(), v.begin(), 0.0);
  };
  EXPECT_NEAR(square(there), square(values), 1e-4);
  EXPECT_NEAR(there[0], std::accumulate(values.begin(), values.end(), 0.0) / side, 1e-4);
  inverse_haar_transform(there, side);
  for (std::size_t i = 0; i < values.size(); ++i) EXPECT_NEAR(there[i], values[i], 1e-5);
}

class Wavelets : public testing::Test {
 protected:
  static constexpr int resolution = 16;
  Scene scene = test::rabbit_scene();
  TransferSamples samples{scene, {}, layout_of(scene, Relighting::geometry).outputs};
  LightMap light = [] {
    Rng rng(2);
    return refield::test::random_light(rng, cube_domain(resolution));
  }();

  double error(const WaveletTransfer& wavelets, int terms) const {
    const auto exact = integrate_lights(samples, std::span(&light, 1)).front();
    const auto outputs = wavelets.relight(light, terms);
    double difference = 0.0, all = 0.0;
    for (std::size_t i = 0; i < exact.size(); ++i) {
      difference += (outputs[i].cast<double>() - exact[i]).square().sum();
      all += exact[i].square().sum();
    }
    return std::sqrt(difference / all);
  }
};

TEST_F(Wavelets, OfAllLightComeToTheExactSum) {
  // What is left is 8 bits of each weight, by the largest of its output.
  EXPECT_LT(error(WaveletTransfer(samples, resolution, 0.0), 6 * resolution * resolution), 1e-2);
}

TEST_F(Wavelets, ErrFewerTheMoreThereAre) {
  const WaveletTransfer wavelets(samples, resolution, 0.0);
  EXPECT_GT(error(wavelets, 6), 1.5 * error(wavelets, 400));
  EXPECT_GT(error(WaveletTransfer(samples, resolution, 0.2), 1 << 20), error(wavelets, 1 << 20));
  EXPECT_LT(WaveletTransfer(samples, resolution, 0.2).bytes(), wavelets.bytes());
}

TEST_F(Wavelets, NeedPowersOfTwo) {
  EXPECT_THROW(WaveletTransfer(samples, 12, 0.0), InputError);
}

}  // namespace
}  // namespace refield::prt
