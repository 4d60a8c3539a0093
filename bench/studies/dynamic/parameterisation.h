// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <vector>

#include "core/field/mesh.h"

namespace refield::dynamic {

/// Octahedral maps (Praun and Hoppe 2003): the unit sphere onto [0, 1]², its lower half folded out over the
/// corners, so that each edge of the square is glued to itself. Inverse of each other.
Eigen::Vector2f square_of_sphere(const Eigen::Vector3f& direction);
Eigen::Vector3f sphere_of_square(const Eigen::Vector2f& point);

/// A vertex in both: (u, v) in [0, 1]² and a place on the unit sphere.
struct SurfacePlace {
  Eigen::Vector2f square;
  Eigen::Vector3f sphere;
};

/// [vertices]. A flat mesh: (u, v) are the two coordinates along it (x and z of one that faces up) in its
/// bounding rectangle, laid around the sphere. Any other: spherical_parameterisation(), unfolded. Deviation:
/// the paper cuts and flattens meshes as geometry images (Gu et al. 2002), with less stretch and a boundary
/// of its own for each.
std::vector<SurfacePlace> surface_places(const Mesh& mesh);

}  // namespace refield::dynamic
