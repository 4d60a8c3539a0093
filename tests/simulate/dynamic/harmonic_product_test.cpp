// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/dynamic_light.h"

#include <gtest/gtest.h>

#include <numbers>

#include "core/base/rng.h"
#include "core/light/harmonics.h"
#include "simulate/prt/transfer_samples.h"

namespace refield::dynamic {
namespace {

std::vector<float> random_harmonics(int order, std::uint64_t seed) {
  Rng rng(seed);
  std::vector<float> values(static_cast<std::size_t>(harmonics_of(order)));
  for (float& value : values) value = static_cast<float>(rng.normal());
  return values;
}

/// By sums over directions.
std::vector<double> slow_product(int order, const std::vector<float>& a, const std::vector<float>& b) {
  constexpr int directions = 40000;
  std::vector<double> product(a.size(), 0.0), y(a.size());
  for (const Eigen::Vector3d& direction : prt::hammersley_sphere(directions)) {
    evaluate_harmonics(order, direction, y);
    double of_a = 0.0, of_b = 0.0;
    for (std::size_t i = 0; i < y.size(); ++i) {
      of_a += a[i] * y[i];
      of_b += b[i] * y[i];
    }
    for (std::size_t i = 0; i < y.size(); ++i)
      product[i] += of_a * of_b * y[i] * 4.0 * std::numbers::pi / directions;
  }
  return product;
}

Eigen::VectorXf product(int order, const std::vector<float>& a, const std::vector<float>& b) {
  return HarmonicProduct(order).matrix(b) *
         Eigen::Map<const Eigen::VectorXf>(a.data(), static_cast<Eigen::Index>(a.size()));
}

TEST(HarmonicProduct, IsThatOfTheFunctions) {
  for (const int order : {2, 3, 5}) {
    const auto a = random_harmonics(order, 1), b = random_harmonics(order, 2);
    const auto slow = slow_product(order, a, b);
    const Eigen::VectorXf fast = product(order, a, b);
    for (std::size_t i = 0; i < slow.size(); ++i)
      EXPECT_NEAR(fast[static_cast<Eigen::Index>(i)], slow[i], 5e-3) << order << ' ' << i;
  }
}

TEST(HarmonicProduct, WithOneChangesNothing) {
  const int order = 5;
  const auto a = random_harmonics(order, 3);
  std::vector<float> one(a.size(), 0.0f);
  one[0] = static_cast<float>(std::sqrt(4.0 * std::numbers::pi));
  const Eigen::VectorXf same = product(order, a, one);
  for (std::size_t i = 0; i < a.size(); ++i) EXPECT_NEAR(same[static_cast<Eigen::Index>(i)], a[i], 1e-5f);
}

TEST(HarmonicProduct, HasFewCoefficients) {
  EXPECT_LT(HarmonicProduct(5).coefficients(), 25u * 25u * 25u / 8u);
}

}  // namespace
}  // namespace refield::dynamic
