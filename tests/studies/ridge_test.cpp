// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/peers/ridge.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/QR>
#include <cmath>

#include "tests/studies/peer_fixture.h"
#include "tests/support/random_data.h"
#include "tests/support/synthetic_capture.h"

namespace refield {
namespace {

using peers::DualMethod;

constexpr LightDomain domain{8, 6, Parameterisation::monitor};
constexpr double float_rounding = 2e-4;  // α is kept in float, and the sums below cancel in part

Eigen::VectorXd random_vector(Rng& rng, Eigen::Index size) {
  return Eigen::VectorXd::NullaryExpr(size, [&] { return rng.normal(); });
}

TEST(DualFilters, RidgeInTheDualIsRidgeInThePrimal) {
  Rng rng(1);
  const Eigen::MatrixXd a = Eigen::MatrixXd::NullaryExpr(12, 30, [&] { return rng.normal(); });
  const Eigen::VectorXd b = random_vector(rng, 12);
  const peers::GramSpectrum spectrum(a * a.transpose());
  const peers::DualFilters filters(spectrum, DualMethod::ridge);
  for (Eigen::Index setting = 10; setting < peers::penalties; setting += 6) {
    const Eigen::VectorXd alpha =
        spectrum.vectors * filters.factors.col(setting).cwiseProduct(spectrum.vectors.transpose() * b);
    const Eigen::MatrixXd normal =
        a.transpose() * a + peers::penalty(spectrum, setting) * Eigen::MatrixXd::Identity(30, 30);
    const Eigen::VectorXd primal = normal.ldlt().solve(a.transpose() * b);
    EXPECT_LT((a.transpose() * alpha - primal).norm(), 1e-6 * primal.norm()) << setting;
  }
}

/// The criterion by its definition, from the smoother's matrix.
double gcv_of(const Eigen::MatrixXd& smoother, const Eigen::VectorXd& b) {
  const Eigen::MatrixXd left = Eigen::MatrixXd::Identity(b.size(), b.size()) - smoother;
  return static_cast<double>(b.size()) * (left * b).squaredNorm() / std::pow(left.trace(), 2.0);
}

TEST(DualFilters, GcvIsWhatItsDefinitionSays) {
  Rng rng(2);
  const Eigen::MatrixXd a = Eigen::MatrixXd::NullaryExpr(10, 25, [&] { return rng.normal(); });
  const Eigen::MatrixXd gram = a * a.transpose();
  const Eigen::VectorXd b = random_vector(rng, 10);
  const peers::GramSpectrum spectrum(gram);
  const Eigen::VectorXd squared = (spectrum.vectors.transpose() * b).cwiseAbs2();
  const auto ridge = peers::DualFilters(spectrum, DualMethod::ridge).criterion(squared);
  for (Eigen::Index setting = 12; setting < peers::penalties; setting += 4) {
    const Eigen::MatrixXd penalised =
        gram + peers::penalty(spectrum, setting) * Eigen::MatrixXd::Identity(10, 10);
    const double expected = gcv_of(penalised.ldlt().solve(gram).transpose(), b);
    EXPECT_NEAR(ridge(setting), expected, 1e-6 * expected);
  }
  const auto truncated = peers::DualFilters(spectrum, DualMethod::truncated_svd).criterion(squared);
  for (Eigen::Index rank = 0; rank < 10; ++rank) {
    const auto basis = spectrum.vectors.leftCols(rank);
    const double expected = gcv_of(basis * basis.transpose(), b);
    EXPECT_NEAR(truncated(rank), expected, 1e-9 * expected);
  }
}

TEST(DualFilters, MarginalLikelihoodIsThatOfTheNormalDistribution) {
  Rng rng(3);
  const Eigen::MatrixXd a = Eigen::MatrixXd::NullaryExpr(9, 20, [&] { return rng.normal(); });
  const Eigen::MatrixXd gram = a * a.transpose();
  const Eigen::VectorXd b = random_vector(rng, 9);
  const peers::GramSpectrum spectrum(gram);
  const auto criterion = peers::DualFilters(spectrum, DualMethod::smooth_ridge)
                             .criterion((spectrum.vectors.transpose() * b).cwiseAbs2());
  // −2 log N(b; 0, σ²C) = n log σ² + log|C| + bᵀC⁻¹b / σ², least at σ² = bᵀC⁻¹b / n; n − n log n is constant.
  for (Eigen::Index setting = 20; setting < peers::penalties; setting += 5) {
    const Eigen::LLT<Eigen::MatrixXd> c(gram +
                                        peers::penalty(spectrum, setting) * Eigen::MatrixXd::Identity(9, 9));
    const double log_determinant = 2.0 * c.matrixLLT().diagonal().array().log().sum();
    EXPECT_NEAR(criterion(setting), 9.0 * std::log(b.dot(c.solve(b))) + log_determinant, 1e-6);
  }
}

TEST(TruncatedSvd, IsExactAtFullRank) {
  // As many lights as texels, no noise: full rank interpolates, and T is recovered.
  const LightDomain small{3, 2, Parameterisation::monitor};
  Rng rng(5);
  const ReflectanceField truth = test::random_field(rng, 4, 3, small, 6, 4);
  std::vector<LightMap> lights;
  for (int j = 0; j < 9; ++j) lights.push_back(test::random_light(rng, small));
  const auto model = peers::fit_dual(test::photographed(truth, lights), DualMethod::truncated_svd);
  const LightMap light = test::random_light(rng, small);
  EXPECT_LT(test::relative_difference(model.relight(light), truth.relight(light)), float_rounding);
}

TEST(FitDual, ReproducesTrainingImagesWithoutNoise) {
  Rng rng(6);
  const ReflectanceField truth = test::random_field(rng, 5, 4, domain, 12, 4);
  const auto lights = test::random_lights(20, domain.width, domain.height, 3);
  for (const DualMethod method : {DualMethod::ridge, DualMethod::truncated_svd, DualMethod::smooth_ridge}) {
    const auto model = peers::fit_dual(test::photographed(truth, lights), method);
    double worst = 0.0;  // cross-validation keeps some penalty: no interpolation
    for (const LightMap& light : lights)
      worst = std::max(worst, test::relative_difference(model.relight(light), truth.relight(light)));
    EXPECT_LT(worst, 0.2) << static_cast<int>(method);
  }
}

TEST(FitDual, ASampleThatWasNotMeasuredIsLeftOutExactly) {
  Rng rng(7);
  const ReflectanceField truth = test::random_field(rng, 3, 2, domain, 8, 4);
  auto data = test::photographed(truth, test::random_lights(16, domain.width, domain.height, 3), 0.01);
  auto without = data;
  data.observed.row(5).setConstant(NAN);
  without.lights.erase(without.lights.begin() + 5);
  Eigen::MatrixXf rest(15, data.observed.cols());
  rest << without.observed.topRows(5), without.observed.bottomRows(10);
  without.observed = rest;
  const LightMap light = test::random_light(rng, domain);
  for (const DualMethod method : {DualMethod::ridge, DualMethod::truncated_svd, DualMethod::smooth_ridge})
    EXPECT_LT(test::relative_difference(peers::fit_dual(data, method).relight(light),
                                        peers::fit_dual(without, method).relight(light)),
              float_rounding)
        << static_cast<int>(method);
}

TEST(FitDual, SmoothnessHelpsWhereTransportIsSmooth) {
  const LightDomain map{16, 12, Parameterisation::monitor};
  // One wide bump, as texel-wide boxes.
  ReflectanceField truth;
  truth.width = truth.height = 1;
  truth.basis.domain = map;
  std::vector<std::uint32_t> columns;
  std::vector<float> weights;
  for (int y = 0; y < map.height; ++y)
    for (int x = 0; x < map.width; ++x) {
      columns.push_back(static_cast<std::uint32_t>(truth.basis.boxes.size()));
      truth.basis.boxes.push_back({x, y, x + 1, y + 1});
      const double d2 = std::pow((x - 6.0) / 7.0, 2.0) + std::pow((y - 5.0) / 6.0, 2.0);
      weights.insert(weights.end(), 3, static_cast<float>(std::exp(-d2)));
    }
  truth.transfer.append_row(columns, weights);
  const auto data = test::photographed(truth, test::random_lights(25, map.width, map.height, 8), 0.01);
  const auto smooth = peers::fit_dual(data, DualMethod::smooth_ridge);
  const auto plain = peers::fit_dual(data, DualMethod::ridge);
  double smooth_error = 0.0, plain_error = 0.0;
  for (const LightMap& light : test::random_lights(6, map.width, map.height, 77)) {
    smooth_error += test::relative_difference(smooth.relight(light), truth.relight(light));
    plain_error += test::relative_difference(plain.relight(light), truth.relight(light));
  }
  EXPECT_LT(smooth_error, 0.5 * plain_error);
}

TEST(TexelCovariance, IsTheMatrixOfItsDefinition) {
  const double length = 2.5;
  const peers::TexelCovariance covariance(domain, length);
  Rng rng(9);
  const Eigen::MatrixXd texels = random_vector(rng, domain.width * domain.height);
  Eigen::VectorXd expected = Eigen::VectorXd::Zero(texels.rows());
  for (int a = 0; a < texels.rows(); ++a)
    for (int b = 0; b < texels.rows(); ++b) {
      const double dx = a % domain.width - b % domain.width, dy = a / domain.width - b / domain.width;
      expected(a) += std::exp(-(dx * dx + dy * dy) / (2 * length * length)) * texels(b);
    }
  EXPECT_LT((covariance.times(texels) - expected).norm(), 1e-12 * expected.norm());
}

}  // namespace
}  // namespace refield
