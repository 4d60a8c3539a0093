// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "simulate/dynamic/dynamic_light.h"
#include "simulate/dynamic/dynamic_scene.h"

namespace refield::dynamic {

/// Where paths start: a vertex of an object, seen from a unit direction.
struct PathStart {
  std::uint32_t object, vertex;
  Eigen::Vector3f to_viewer;
};

PathStart path_start(const DynamicScene& scene, std::span<const Pose> poses, std::uint32_t object,
                     std::uint32_t vertex, const Eigen::Vector3f& eye);

/// What lights a scene.
struct PathLight {
  std::span<const AreaPoint> area_lights = {};  ///< many: at each point of a path one of them is drawn
  /// Radiance that arrives at a point from a unit direction in which nothing stands; empty: none.
  std::function<Eigen::Array3f(const Eigen::Vector3f& at, const Eigen::Vector3f& from)> environment = {};
};

struct ReferenceOptions {
  int paths = 1024;  ///< per vertex
  int bounces = 3;
  std::uint64_t seed = 1;
};

/// The reference for precomputed transport and for indirect light: radiance of vertices towards their
/// viewers, [bounces + 1][starts], each bounce by itself, 0 being direct light. Paths go from the vertex by
/// the material's own reflection (not its factors). Normals and colours are interpolated over triangles, and
/// nothing else is taken from vertices; backs of triangles are black. Path k of start i draws from
/// Rng(seed, i, k). Runs on all cores, with progress. Throws Interrupted.
std::vector<std::vector<Eigen::Array3f>> trace_bounces(const DynamicScene& scene, const SceneRays& rays,
                                                       std::span<const Pose> poses, const PathLight& light,
                                                       std::span<const PathStart> starts,
                                                       const ReferenceOptions& options,
                                                       const RunContext& run = {});

}  // namespace refield::dynamic
