// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <string>
#include <vector>

#include "core/light_map.h"
#include "simulate/prt/prt_scene.h"

namespace refield::prt_chart {

/// A cube map as lights of all frequencies see it, and the small one that harmonics are summed over.
struct ChartLight {
  std::string name;
  LightMap fine, coarse;
};

/// Radiance of each vertex before its colour, [lights][vertices].
using Shading = std::vector<std::vector<Eigen::Array3f>>;

/// What one method with one setting came to.
struct Peer {
  std::string method;   ///< a track of the chart
  std::string setting;  ///< "ε 0.002"
  std::uint64_t kernels = 0;
  double bytes = 0.0;
  double precompute_seconds = 0.0;
  double relight_ms = 0.0;  ///< of one light, all of the work
  Shading shading = {};
};

/// Each method in turn with settings from coarse to fine, on a diffuse scene under the lights. `resolution`:
/// of the fine maps. Throws Interrupted.
///  - clusters: each group of 16 vertices has its own
///  - clusters of the paper: equation 11 over all vertices
///  - wavelets: Ng et al. 2003, the light's largest
///  - harmonics, and the same with a Hann window
std::vector<Peer> all_peers(const prt::Scene& scene, const std::vector<ChartLight>& lights, int resolution);

}  // namespace refield::prt_chart
