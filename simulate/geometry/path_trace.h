// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "core/base/rng.h"
#include "core/base/run_context.h"
#include "simulate/geometry/mesh_rays.h"
#include "simulate/prt/prt_scene.h"

namespace refield::prt {

/// A point of a scene's surface, as light meets it.
struct SurfacePoint {
  Eigen::Vector3f position, normal;
  Eigen::Array3f diffuse;  ///< reflectance: Material::diffuse times the mesh' colour
  Eigen::Array3f specular;
  float exponent;
};

SurfacePoint point_of_vertex(const Scene& scene, std::size_t vertex);
/// Normal and colour go evenly from corner to corner.
SurfacePoint point_of_hit(const Scene& scene, const MeshHit& hit);

/// A unit direction whose cosine with `axis` is drawn in proportion to its power `exponent`.
Eigen::Vector3f draw_around(const Eigen::Vector3f& axis, float exponent, Rng& rng);

/// Radiance that arrives at a point from a unit direction in which nothing stands.
using PathLight = std::function<Eigen::Array3f(const Eigen::Vector3f& at, const Eigen::Vector3f& from)>;

struct PathOptions {
  int paths = 4096;
  int reflections = 8;  ///< at most; 1: direct light alone
  std::uint64_t seed = 1;
};

/// The reference for precomputed transport: radiance of each point towards its viewer (unit direction), by
/// tracing paths from it and sampling the material's own reflection (diffuse by the cosine, Phong's lobe by
/// its power, mixed by reflectance). Unbiased up to the number of reflections; backs of triangles are black.
/// Point k draws from Rng(seed, k): results depend on nothing else. Runs on all cores.
std::vector<Eigen::Array3f> path_trace(const Scene& scene, const MeshRays& rays,
                                       std::span<const SurfacePoint> points,
                                       std::span<const Eigen::Vector3f> to_viewer, const PathLight& light,
                                       const PathOptions& options, const RunContext& run = {});

}  // namespace refield::prt
