// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include <optional>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/field/mesh.h"
#include "simulate/dynamic/brdf_factors.h"
#include "simulate/geometry/mesh_rays.h"

namespace refield::dynamic {

/// A point that stands for a piece of an area light. Both its sides shine.
struct AreaPoint {
  Eigen::Vector3f position, normal;
  Eigen::Array3f power;  ///< radiance × area of the piece
  float area;
};

/// `count` points, each the middle of a piece of an area light (colours: radiance); pieces have equal area
/// times brightness, are about as wide as long, and stay the same wherever an area light goes. None where
/// nothing shines.
std::vector<AreaPoint> area_points(const Mesh& area_lights, int count);

/// About the middle of a mesh' bounding box, around all its vertices.
struct BoundingBall {
  Eigen::Vector3f middle;
  float radius;
};
BoundingBall bounding_ball(const Mesh& mesh);

/// [vertices]: a third of the area of the triangles about each.
Eigen::VectorXf vertex_areas(const Mesh& mesh);

/// The direction that all of a mesh faces; none where it is not flat.
std::optional<Eigen::Vector3f> facing_of(const Mesh& mesh);

/// Where light may come from: `count` points for each of `distances` (> 1), in radii of the bounding_ball(),
/// spread over spheres; for a flat mesh evenly over a square of twice
/// its radius, on the side that it faces, (distance − 1) radii above (Iwasaki et al., figure 2, have one
/// distance).
std::vector<Eigen::Vector3f> point_lights(const Mesh& mesh, int count, std::span<const float> distances);

/// L_k(x) = V h_k(ω) cosθ/r² of all vertices and of each of the BRDF's K terms under point lights of
/// intensity one, shadows of the mesh on itself included: [vertices · K × lights], row v·K + k. Runs on all
/// cores; throws Interrupted.
Eigen::MatrixXf light_terms(const Mesh& mesh, const prt::MeshRays& rays, const BrdfFactors& factors,
                            std::span<const Eigen::Vector3f> lights, const RunContext& run = {});

}  // namespace refield::dynamic
