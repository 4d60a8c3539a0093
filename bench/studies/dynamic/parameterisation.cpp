// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/dynamic/parameterisation.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "bench/studies/dynamic/spherical_parameterisation.h"
#include "simulate/dynamic/object_transport.h"

namespace refield::dynamic {

namespace {

float sign(float value) {
  return value < 0.0f ? -1.0f : 1.0f;
}

std::vector<Eigen::Vector2f> flat_squares(const Mesh& mesh, const Eigen::Vector3f& facing) {
  Eigen::Index across = 0;
  facing.cwiseAbs().maxCoeff(&across);
  const Eigen::Index first = across == 0 ? 1 : 0, second = across == 2 ? 1 : 2;
  Eigen::AlignedBox2f bounds;
  std::vector<Eigen::Vector2f> squares;
  for (const auto& position : mesh.positions) {
    squares.emplace_back(position[first], position[second]);
    bounds.extend(squares.back());
  }
  const Eigen::Vector2f sides = bounds.sizes().cwiseMax(1e-30f);
  for (auto& square : squares) square = (square - bounds.min()).cwiseQuotient(sides);
  return squares;
}

}  // namespace

Eigen::Vector2f square_of_sphere(const Eigen::Vector3f& direction) {
  const Eigen::Vector3f on_octahedron = direction / direction.lpNorm<1>();
  Eigen::Vector2f point = on_octahedron.head<2>();
  if (on_octahedron.z() < 0.0f)
    point = {sign(on_octahedron.x()) * (1.0f - std::abs(on_octahedron.y())),
             sign(on_octahedron.y()) * (1.0f - std::abs(on_octahedron.x()))};
  return (point.array() * 0.5f + 0.5f).matrix();
}

Eigen::Vector3f sphere_of_square(const Eigen::Vector2f& point) {
  const Eigen::Vector2f p = (point.array() * 2.0f - 1.0f).matrix();
  Eigen::Vector3f direction(p.x(), p.y(), 1.0f - p.lpNorm<1>());
  if (direction.z() < 0.0f)
    direction.head<2>() << sign(p.x()) * (1.0f - std::abs(p.y())), sign(p.y()) * (1.0f - std::abs(p.x()));
  return direction.normalized();
}

std::vector<SurfacePlace> surface_places(const Mesh& mesh) {
  std::vector<SurfacePlace> result;
  if (const auto facing = facing_of(mesh)) {
    for (const auto& square : flat_squares(mesh, *facing))
      result.push_back({square, sphere_of_square(square)});
  } else {
    for (const auto& exact : spherical_parameterisation(mesh)) {
      const Eigen::Vector3f place = exact.cast<float>();
      result.push_back({square_of_sphere(place), place});
    }
  }
  return result;
}

}  // namespace refield::dynamic
