// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/dynamic/parameterisation.h"

#include <gtest/gtest.h>

#include "bench/studies/dynamic/spherical_parameterisation.h"
#include "simulate/geometry/mesh_shapes.h"
#include "simulate/prt/transfer_samples.h"

namespace refield::dynamic {
namespace {

TEST(Octahedron, UnfoldsTheSphereOntoTheSquareAndBack) {
  for (const Eigen::Vector3d& exact : prt::hammersley_sphere(1000)) {
    const Eigen::Vector3f direction = exact.cast<float>();
    const Eigen::Vector2f square = square_of_sphere(direction);
    EXPECT_TRUE((square.array() >= 0.0f).all() && (square.array() <= 1.0f).all());
    EXPECT_LT((sphere_of_square(square) - direction).norm(), 1e-5f);
  }
}

/// A closed mesh bent so far that some of it lies behind itself, seen from the middle.
Mesh banana() {
  Mesh mesh = prt::sphere_mesh(10);
  for (auto& p : mesh.positions) p = {0.4f * p.x() + 6.0f * p.y() * p.y(), 2.0f * p.y(), 0.4f * p.z()};
  return mesh;
}

TEST(SphericalParameterisation, UnfoldsClosedMeshes) {
  EXPECT_EQ(folded_share(prt::rabbit_mesh(12), spherical_parameterisation(prt::rabbit_mesh(12), 0)), 0.0);
  EXPECT_GT(folded_share(banana(), spherical_parameterisation(banana(), 0)), 0.05);
  const auto places = spherical_parameterisation(banana());
  EXPECT_EQ(folded_share(banana(), places), 0.0);
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  for (const auto& place : places) {
    EXPECT_NEAR(place.norm(), 1.0, 1e-9);
    middle += place / static_cast<double>(places.size());
  }
  EXPECT_LT(middle.norm(), 0.1) << "all have run together";
}

TEST(SphericalParameterisation, TakesHardEdgesForOnePoint) {
  const Mesh box = prt::box_mesh(4);
  const auto places = spherical_parameterisation(box);
  for (std::size_t a = 0; a < places.size(); ++a)
    for (std::size_t b = 0; b < a; ++b)
      if (box.positions[a] == box.positions[b]) {
        EXPECT_EQ(places[a], places[b]);
      }
  EXPECT_EQ(folded_share(box, places), 0.0);
}

TEST(SurfacePlaces, OfPlanesAreTheirOwnCoordinates) {
  Mesh plane = prt::plane_mesh(5);
  for (auto& position : plane.positions) position = {3.0f * position.x() + 7.0f, 2.0f, position.z()};
  const auto places = surface_places(plane);
  for (std::size_t v = 0; v < places.size(); ++v) {
    EXPECT_NEAR(places[v].square.x(), (plane.positions[v].x() - 7.0f) / 3.0f + 0.5f, 1e-5f);
    EXPECT_NEAR(places[v].square.y(), plane.positions[v].z() + 0.5f, 1e-5f);
    EXPECT_LT((square_of_sphere(places[v].sphere) - places[v].square).norm(), 1.5f);
  }
}

}  // namespace
}  // namespace refield::dynamic
