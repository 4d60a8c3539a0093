// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/brdf_factors.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

#include "core/base/errors.h"
#include "tests/simulate/dynamic/hemisphere.h"
#include "tests/support/singular_values.h"

namespace refield::dynamic {
namespace {

constexpr double pi = std::numbers::pi;

Brdf phong(float exponent, float diffuse = 0.0f) {
  return {.diffuse = Eigen::Array3f::Constant(diffuse),
          .specular = Eigen::Array3f::Constant(0.5f),
          .lobe = Lobe::phong,
          .exponent = exponent};
}

Brdf ggx(float roughness) {
  return {.diffuse = {0.3f, 0.2f, 0.1f},
          .specular = {0.04f, 0.05f, 0.06f},
          .lobe = Lobe::ggx,
          .roughness = roughness};
}

/// BrdfFactors::error() by plain summation over pairs of directions that are no nodes.
double measured_error(const Brdf& brdf, const BrdfFactors& factors, int directions) {
  const auto ins = test::hemisphere(directions), outs = test::hemisphere(directions + 17);
  const auto terms = static_cast<std::size_t>(factors.terms());
  std::vector<std::vector<Eigen::Array3f>> g(outs.size(), std::vector<Eigen::Array3f>(terms));
  for (std::size_t o = 0; o < outs.size(); ++o) factors.outgoing(outs[o], g[o]);
  std::vector<float> h(terms);
  double wrong = 0.0, all = 0.0;
  for (const Eigen::Vector3f& in : ins) {
    factors.incoming(in, h);
    for (std::size_t o = 0; o < outs.size(); ++o) {
      const Eigen::Array3f exact = brdf(in, outs[o]);
      Eigen::Array3f sum = -exact;
      for (std::size_t k = 0; k < terms; ++k) sum += g[o][k] * h[k];
      const double weight = in.z() * outs[o].z();
      wrong += weight * sum.matrix().squaredNorm();
      all += weight * exact.matrix().squaredNorm();
    }
  }
  return std::sqrt(wrong / all);
}

TEST(BrdfFactors, OfADiffuseSurfaceIsOneTerm) {
  const Brdf brdf{.diffuse = {0.8f, 0.4f, 0.2f}};
  const BrdfFactors factors = factor(brdf, {.error = 0.0});
  EXPECT_EQ(factors.terms(), 1);
  EXPECT_LT(factors.error(), 1e-5);
  EXPECT_LT(measured_error(brdf, factors, 50), 1e-5);
}

TEST(BrdfFactors, OfABlackSurfaceAreNone) {
  const BrdfFactors factors = factor({.diffuse = {0, 0, 0}}, {});
  EXPECT_EQ(factors.terms(), 0);
  EXPECT_EQ(factors.error(), 0.0);
}

/// The singular values of f sampled over hemisphere × hemisphere as one matrix.
Eigen::VectorXd plain_singular_values(const Brdf& brdf, int directions) {
  const auto all = test::hemisphere(directions);
  Eigen::MatrixXd a(directions, 3 * directions);
  for (int i = 0; i < directions; ++i)
    for (int j = 0; j < directions; ++j) {
      const Eigen::Vector3f &in = all[static_cast<std::size_t>(i)], &out = all[static_cast<std::size_t>(j)];
      a.block<1, 3>(i, 3 * j) =
          (brdf(in, out) * std::sqrt(in.z() * out.z())).matrix().transpose().cast<double>();
    }
  return refield::test::singular_values(a) * (2.0 * pi / directions);
}

TEST(BrdfFactors, AreThoseOfOneLargeDecomposition) {
  for (const Brdf& brdf : {phong(10, 0.2f), ggx(0.5f)}) {
    const Eigen::VectorXd plain = plain_singular_values(brdf, 300);
    for (const int terms : {4, 9}) {
      const double best = std::sqrt(plain.tail(plain.size() - terms).squaredNorm() / plain.squaredNorm());
      // A pair may have to be left out as a whole, for a later single term.
      EXPECT_GE(factor(brdf, {.largest = terms, .error = 0.0}).error(), best - 0.01) << terms;
      EXPECT_LE(factor(brdf, {.largest = terms + 1, .error = 0.0}).error(), best + 0.01) << terms;
    }
  }
}

TEST(BrdfFactors, HaveTheErrorThatTheyState) {
  for (const Brdf& brdf : {phong(1), phong(10, 0.2f), phong(64), ggx(1.0f), ggx(0.3f)})
    for (const double error : {0.3, 0.05}) {
      const BrdfFactors factors = factor(brdf, {.error = error});
      EXPECT_NEAR(measured_error(brdf, factors, 700), factors.error(), 0.005 + 0.05 * error)
          << factors.terms() << " terms of an exponent of " << brdf.exponent;
      EXPECT_TRUE(factors.error() <= error || factors.terms() + 1 >= FactorOptions::max_terms);
    }
}

TEST(BrdfFactors, DoNotDependOnTheTurnOfTheFrame) {
  for (const Brdf& brdf : {phong(20), ggx(0.4f)})
    for (const int largest : {3, 8, 17}) {
      const BrdfFactors factors = factor(brdf, {.largest = largest, .error = 0.0});
      EXPECT_LE(factors.terms(), largest);
      const Eigen::Matrix3f turn = Eigen::AngleAxisf(0.7f, Eigen::Vector3f::UnitZ()).toRotationMatrix();
      for (const Eigen::Vector3f& in : test::hemisphere(30))
        for (const Eigen::Vector3f& out : test::hemisphere(30)) {
          const Eigen::Array3f once = factors(in, out), turned = factors(turn * in, turn * out);
          EXPECT_LT((once - turned).abs().maxCoeff(), 2e-4f);
        }
    }
}

TEST(BrdfFactors, StayReciprocal) {
  const BrdfFactors factors = factor(phong(20, 0.3f), {.largest = 9, .error = 0.0});
  for (const Eigen::Vector3f& in : test::hemisphere(30))
    for (const Eigen::Vector3f& out : test::hemisphere(30))
      EXPECT_NEAR(factors(in, out)[0], factors(out, in)[0], 2e-3f);
}

TEST(BrdfFactors, OutgoingOnesAreOrthonormalUnderTheCosine) {
  const BrdfFactors factors = factor(ggx(0.4f), {.largest = 12, .error = 0.0});
  const auto terms = static_cast<std::size_t>(factors.terms());
  std::vector<Eigen::Array3f> g(terms);
  Eigen::MatrixXd gram = Eigen::MatrixXd::Zero(factors.terms(), factors.terms());
  for (const Eigen::Vector3f& out : test::hemisphere(5000)) {
    factors.outgoing(out, g);
    const Eigen::Map<const Eigen::MatrixXf> rows(g.front().data(), 3, factors.terms());
    gram += rows.cast<double>().transpose() * rows.cast<double>() * (out.z() * 2.0 * pi / 5000);
  }
  EXPECT_TRUE(gram.isIdentity(0.02)) << gram;
}

TEST(BrdfFactors, OfExtremeLobesAreFiniteAndTruthful) {
  for (const Brdf& brdf : {phong(0), phong(1), phong(1e4f), ggx(0.01f), ggx(1.0f)}) {
    const bool sharp = brdf.exponent > 1e3f || brdf.roughness < 0.1f;
    const BrdfFactors factors = factor(brdf, {.largest = 16});
    EXPECT_GE(factors.error(), sharp ? 0.99 : 0.0);  // 16 terms are nothing to a mirror
    EXPECT_LE(factors.error(), sharp ? 1.0 : 0.2);
    EXPECT_LE(factors.terms(), 16);
    for (const Eigen::Vector3f& in : {Eigen::Vector3f(0, 0, 1), Eigen::Vector3f(1, 0, 1e-20f),
                                      Eigen::Vector3f(0.6f, 0, 0.8f), Eigen::Vector3f(0, 1, 0)})
      EXPECT_TRUE(factors(in, in).isFinite().all());
  }
}

}  // namespace
}  // namespace refield::dynamic
