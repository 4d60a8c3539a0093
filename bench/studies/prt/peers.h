// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "core/light/light_map.h"
#include "simulate/prt/prt_scene.h"

namespace refield::prt_chart {

/// A cube map as lights of all frequencies see it, and the small one that harmonics are summed over.
struct ChartLight {
  std::string name;
  LightMap fine, coarse;
};

/// What methods are compared on: a diffuse scene, its vertices in their order (sort_vertices()), and those of
/// them at which errors are looked at.
struct ChartScene {
  const prt::Scene& scene;
  std::vector<std::uint32_t> vertices;  ///< ascending
  double share() const {
    return static_cast<double>(vertices.size()) / static_cast<double>(scene.mesh.positions.size());
  }
};

/// Radiance before its colour of each vertex that is looked at, [lights][vertices].
using Shading = std::vector<std::vector<Eigen::Array3f>>;

/// What one method with one setting came to.
struct Peer {
  std::string method;   ///< a track of the chart
  std::string setting;  ///< "ε 0.002"
  std::uint64_t kernels = 0;
  double weights = 0.0;  ///< a vertex
  double bytes = 0.0;
  double precompute_seconds = 0.0;
  double relight_ms = 0.0;          ///< of one light, all of the work
  double two_area_lights_ms = 0.0;  ///< RelightTimes; 0 where a method relights whole maps alone
  Shading shading = {};
};

/// Each method in turn with settings from coarse to fine, under the lights. `resolution`: of the fine maps.
/// Throws Interrupted.
///  - clusters: each group of 16 vertices has its own
///  - clusters of the paper: equation 11 over all vertices
///  - wavelets: Ng et al. 2003, the light's largest. Only vertices that are looked at are computed; sizes and
///    times are those of as many as the scene has
///  - harmonics, and the same with a Hann window
std::vector<Peer> all_peers(const ChartScene& chart, const std::vector<ChartLight>& lights, int resolution);

/// A packed field that precompute made of the scene, in squares of cube maps of the lights' resolution. Its
/// precomputation time is not known (0). Throws InputError for other fields.
Peer peer_of_field(const std::filesystem::path& path, const ChartScene& chart,
                   const std::vector<ChartLight>& lights);

}  // namespace refield::prt_chart
