// SPDX-License-Identifier: Apache-2.0
// Bases for light on surfaces, and BRDFs in terms.
#include <gtest/gtest.h>

#include <array>
#include <limits>

#include "bench/studies/dynamic/area_light_error.h"
#include "bench/studies/dynamic/factor_study.h"
#include "bench/studies/dynamic/fixed_basis.h"
#include "core/base/errors.h"
#include "simulate/geometry/mesh_shapes.h"

namespace refield::dynamic {
namespace {

constexpr auto infinite = std::numeric_limits<double>::infinity();
constexpr std::array kinds{BasisKind::spherical_harmonics, BasisKind::haar_wavelets, BasisKind::cosines};

/// Relative, over an area-weighted surface.
double error_of(const SurfaceBasis& basis, const Eigen::VectorXf& areas, const Eigen::MatrixXf& light) {
  const Eigen::MatrixXf left = light - basis.functions * (basis.to_weights * light);
  const Eigen::VectorXf root = areas.cwiseSqrt();
  return (root.asDiagonal() * left).norm() / (root.asDiagonal() * light).norm();
}

Eigen::MatrixXf gram(const SurfaceBasis& basis, const Eigen::VectorXf& areas) {
  return basis.functions.transpose() * areas.asDiagonal() * basis.functions;
}

TEST(FixedBasis, IsOrthonormalAndExactOnWhatItSpans) {
  const Mesh rabbit = prt::rabbit_mesh(10), plane = prt::plane_mesh(20);
  for (const Mesh& mesh : {rabbit, plane})
    for (const BasisKind kind : kinds) {
      const Eigen::VectorXf areas = areas_of(mesh);
      const SurfaceBasis basis = fixed_basis(kind, mesh, 16);
      EXPECT_TRUE(gram(basis, areas).isIdentity(1e-4f));
      EXPECT_LT(
          error_of(basis, areas, basis.functions * Eigen::VectorXf::LinSpaced(basis.functions.cols(), -1, 2)),
          1e-5);
      // The functions asked for are among what it spans, whatever became of them.
      EXPECT_LT(error_of(basis, areas, fixed_functions(kind, surface_places(mesh), 9)), 1e-4);
    }
}

TEST(FixedBasis, OfAnEvenPlaneNeedsNoChange) {
  const auto condition = [](BasisKind kind, const Mesh& mesh) {
    return condition_of(fixed_functions(kind, surface_places(mesh), 16));
  };
  // Cosines are twice as long where they vary along both sides.
  EXPECT_LT(condition(BasisKind::cosines, prt::plane_mesh(64)), 6.0);
  EXPECT_LT(condition(BasisKind::spherical_harmonics, prt::sphere_mesh(16)), 1.3);
}

TEST(FixedBasis, MeetsMeshesTooCoarseForItsFunctions) {
  const Mesh coarse = prt::sphere_mesh(2);  // 42 vertices
  for (const BasisKind kind : kinds) {
    const SurfaceBasis basis = fixed_basis(kind, coarse, 64);
    EXPECT_LE(basis.functions.cols(), 42);
    EXPECT_TRUE(basis.functions.allFinite() && basis.to_weights.allFinite());
    EXPECT_LT(basis.to_weights.norm(), 10.0f);
    EXPECT_EQ(condition_of(fixed_functions(kind, surface_places(coarse), 64)), infinite);
  }
}

/// Eqs. 6 and 7 on functions that are nearly alike: monomials.
TEST(BasisByInverse, FailsWhereTheMatrixIsBadAndOrthonormalWeightsDoNot) {
  const Eigen::Index vertices = 400;
  const Eigen::VectorXf areas = Eigen::VectorXf::Constant(vertices, 1.0f / 400);
  const Eigen::ArrayXf u = Eigen::ArrayXf::LinSpaced(vertices, 0, 1);
  const Eigen::VectorXf light = (3.0f * u).cos().matrix();
  const auto monomials = [&](Eigen::Index count) {
    Eigen::MatrixXf functions(vertices, count);
    for (Eigen::Index i = 0; i < count; ++i) functions.col(i) = u.pow(static_cast<float>(i)).matrix();
    return functions;
  };
  EXPECT_LT(condition_of(monomials(3)), 1e4);
  EXPECT_LT(error_of(basis_by_inverse(monomials(3)), areas, light), 0.12);
  EXPECT_GT(condition_of(monomials(9)), 1e10);
  EXPECT_GT(error_of(basis_by_inverse(monomials(9)), areas, light), 1.0)
      << "more functions should have made it worse";
  EXPECT_LT(error_of(surface_basis(monomials(9), areas), areas, light), 1e-3);
  EXPECT_THROW(basis_by_inverse(Eigen::MatrixXf::Ones(50, 2)), SolverError);
}

/// Iwasaki et al., figure 10: a sphere under an area light.
TEST(AreaLightError, OfFactorsByFourTermsServeLowExponentsAloneAndMoreTermsMendHighOnes) {
  constexpr double radius = 0.6;
  for (const float exponent : {4.0f, 8.0f, 16.0f, 64.0f, 128.0f}) {
    const Brdf brdf = dynamic_chart::half_glossy(exponent);
    const double error_of_four = area_light_error(brdf, factor(brdf, {.largest = 4}), radius);
    EXPECT_GT(error_of_four, exponent <= 16.0f ? 0.05 : 0.34) << exponent;
    EXPECT_LT(error_of_four, exponent <= 16.0f ? 0.23 : 1.0) << exponent;
    const BrdfFactors enough = factor(brdf, {.error = 0.1});
    EXPECT_LT(enough.terms(), 2.1 * exponent + 2.0);  // as the lobe's solid angle falls
    EXPECT_LT(area_light_error(brdf, enough, radius), 0.04) << exponent;
  }
}

}  // namespace
}  // namespace refield::dynamic
