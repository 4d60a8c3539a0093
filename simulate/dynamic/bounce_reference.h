// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "simulate/dynamic/dynamic_scene.h"
#include "simulate/dynamic/point_lights.h"
#include "simulate/dynamic/scene_rays.h"

namespace refield::dynamic {

/// A vertex of an object.
struct VertexOf {
  std::uint32_t object, vertex;
};

struct ReferenceOptions {
  int paths = 1024;  ///< a vertex
  int bounces = 3;
  std::uint64_t seed = 1;
};

/// The reference for indirect light: radiance of vertices towards an eye, [bounces + 1][vertices], each
/// bounce by itself, 0 being what area lights light. Paths go from the vertex by the material's own
/// reflection (not its factors), and at each point one of the `area lights` points (many; they are drawn
/// from) is asked for its light. Normals and colours are interpolated over triangles, and nothing else is
/// taken from vertices. Path k of vertex i draws from Rng(seed, i, k). Runs on all cores, with progress.
/// Throws Interrupted.
std::vector<std::vector<Eigen::Array3f>> trace_bounces(
    const DynamicScene& scene, const SceneRays& rays, std::span<const Pose> poses,
    std::span<const AreaPoint> area_lights, std::span<const VertexOf> vertices, const Eigen::Vector3f& eye,
    const ReferenceOptions& options, const RunContext& run = {});

}  // namespace refield::dynamic
