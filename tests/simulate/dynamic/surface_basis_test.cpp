// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/object_transport.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <numbers>

#include "bench/studies/dynamic/fixed_basis.h"
#include "core/base/errors.h"
#include "simulate/geometry/mesh_shapes.h"
#include "tests/support/singular_values.h"

namespace refield::dynamic {
namespace {

BrdfFactors matte() {
  return factor({.diffuse = {1, 1, 1}}, {});
}

BrdfFactors glossy() {
  return factor(
      {.diffuse = {0.3f, 0.3f, 0.3f}, .specular = {0.5f, 0.5f, 0.5f}, .lobe = Lobe::phong, .exponent = 10},
      {.largest = 4});
}

/// Relative, over an area-weighted surface.
double error_of(const SurfaceBasis& basis, const Eigen::VectorXf& areas, const Eigen::MatrixXf& light) {
  const Eigen::MatrixXf left = light - basis.functions * (basis.to_weights * light);
  const Eigen::VectorXf root = areas.cwiseSqrt();
  return (root.asDiagonal() * left).norm() / (root.asDiagonal() * light).norm();
}

Eigen::MatrixXf gram(const SurfaceBasis& basis, const Eigen::VectorXf& areas) {
  return basis.functions.transpose() * areas.asDiagonal() * basis.functions;
}

TEST(SurfaceBasis, DropsWhatItHasTwice) {
  const Eigen::VectorXf areas = Eigen::VectorXf::Constant(50, 0.02f);
  Eigen::MatrixXf functions = Eigen::MatrixXf::Zero(50, 4);
  functions.col(0).setOnes();
  functions.col(1) = Eigen::VectorXf::LinSpaced(50, 0, 1);
  functions.col(2) = functions.col(0) - 2.0f * functions.col(1);
  const SurfaceBasis basis = surface_basis(functions, areas);
  EXPECT_EQ(basis.functions.cols(), 2);
  EXPECT_LT(error_of(basis, areas, functions), 1e-5);
}

TEST(PrincipalBasis, IsThatOfAFullDecomposition) {
  const Mesh mesh = prt::rabbit_mesh(6);
  const prt::MeshRays rays(mesh);
  const Eigen::VectorXf areas = areas_of(mesh);
  const BrdfFactors factors = glossy();
  const PrincipalOptions options{.lights = 40, .distances = {1.2f, 3.0f}};
  Eigen::MatrixXf light = light_terms(mesh, rays, factors, point_lights(mesh, 40, options.distances));
  for (auto column : light.colwise()) column.normalize();
  Eigen::MatrixXf columns(areas.size(), light.cols() * factors.terms());
  for (Eigen::Index l = 0; l < light.cols(); ++l)
    for (Eigen::Index row = 0; row < light.rows(); ++row)
      columns(row / factors.terms(), l * factors.terms() + row % factors.terms()) = light(row, l);
  const Eigen::VectorXd all =
      refield::test::singular_values((areas.cwiseSqrt().asDiagonal() * columns).cast<double>());
  for (const int count : {1, 8, 30}) {
    const SurfaceBasis basis = principal_basis(mesh, rays, factors, count, options);
    ASSERT_EQ(basis.functions.cols(), count);
    EXPECT_TRUE(gram(basis, areas).isIdentity(1e-3f));
    const double best = all.tail(all.size() - count).norm() / all.norm();
    EXPECT_NEAR(error_of(basis, areas, columns), best, 0.003) << count;
  }
}

TEST(PrincipalBasis, HasNoMoreFunctionsThanLightsSpan) {
  const Mesh mesh = prt::sphere_mesh(8);
  const prt::MeshRays rays(mesh);
  const PrincipalOptions few{.lights = 5, .distances = {2.0f}};
  EXPECT_EQ(principal_basis(mesh, rays, matte(), 16, few).functions.cols(), 5);
  EXPECT_THROW(principal_basis(mesh, rays, factor({.diffuse = {0, 0, 0}}, {}), 4, few), InputError);
  Mesh inwards = mesh;
  for (auto& normal : inwards.normals) normal = -normal;
  EXPECT_THROW(principal_basis(inwards, rays, matte(), 4, few), InputError);
}

TEST(LightTerms, AreWhatAPointLightBrings) {
  Mesh plane = prt::plane_mesh(8);
  const prt::MeshRays rays(plane);
  const std::vector<Eigen::Vector3f> lights{{0.2f, 0.7f, -0.1f}, {0.2f, -0.7f, -0.1f}};
  const Eigen::MatrixXf terms = light_terms(plane, rays, matte(), lights);
  float h = 0.0f;
  matte().incoming({0, 0, 1}, std::span(&h, 1));
  for (std::size_t v = 0; v < plane.positions.size(); ++v) {
    const Eigen::Vector3f way = lights[0] - plane.positions[v];
    EXPECT_NEAR(terms(static_cast<Eigen::Index>(v), 0), h * way.y() / std::pow(way.norm(), 3.0f), 1e-4f);
    EXPECT_EQ(terms(static_cast<Eigen::Index>(v), 1), 0.0f);
  }
}

TEST(LightTerms, KnowTheShadowOfAMeshOnItself) {
  const Mesh rabbit = prt::rabbit_mesh(16);
  const prt::MeshRays rays(rabbit);
  const std::vector<Eigen::Vector3f> above{{0.0f, 5.0f, 0.0f}};
  const Eigen::MatrixXf terms = light_terms(rabbit, rays, matte(), above);
  int shadowed = 0, lit = 0;
  for (std::size_t v = 0; v < rabbit.positions.size(); ++v)
    if (rabbit.normals[v].dot(above[0] - rabbit.positions[v]) > 0.0f)
      ++(terms(static_cast<Eigen::Index>(v), 0) > 0.0f ? lit : shadowed);
  EXPECT_GT(lit, 500);
  EXPECT_GT(shadowed, 20);
}

TEST(PointLights, StandAboveAPlaneAndAroundASolid) {
  const std::array distances{1.5f};
  for (const auto& light : point_lights(prt::plane_mesh(2), 16, distances)) EXPECT_GT(light.y(), 0.1f);
  const Mesh sphere = prt::sphere_mesh(4);
  for (const auto& light : point_lights(sphere, 16, distances)) EXPECT_NEAR(light.norm(), 0.75f, 1e-3f);
  EXPECT_FALSE(facing_of(sphere));
  EXPECT_TRUE(facing_of(prt::plane_mesh(2))->isApprox(Eigen::Vector3f::UnitY()));
}

}  // namespace
}  // namespace refield::dynamic
