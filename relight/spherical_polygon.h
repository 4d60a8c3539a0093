// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <vector>

namespace refield {

/// A convex polygon on the sphere, smaller than a half of it: corners in order, as directions of any length,
/// joined by great circles. Fewer than three corners: empty.
using SphericalPolygon = std::vector<Eigen::Vector3d>;

/// Divides a polygon by the plane through the origin: `inside` gets what lies where normal · p ≥ 0, `outside`
/// the rest. Their old content is lost; `polygon` must be neither of them.
void split(const SphericalPolygon& polygon, const Eigen::Vector3d& normal, SphericalPolygon& inside,
           SphericalPolygon& outside);

/// Steradians: the sum over the triangles of a fan (van Oosterom and Strackee 1983, eq. 8).
double solid_angle(const SphericalPolygon& polygon);

}  // namespace refield
