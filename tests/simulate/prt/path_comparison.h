// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

#include "bench/studies/dynamic/bounce_reference.h"
#include "tests/simulate/prt/harmonic_light.h"

namespace refield::prt::test {

/// Relative root mean square of differences, over points and channels.
class RelativeError {
 public:
  void add(const Eigen::Array3f& seen, const Eigen::Array3f& expected);
  double value() const;

 private:
  double wrong_ = 0.0, all_ = 0.0;
};

using PathLight = decltype(dynamic::PathLight::environment);

/// Some vertices of a scene, each with a viewer of its own, and what traced paths say they look like.
struct TracedVertices {
  std::vector<std::size_t> vertices;
  std::vector<Eigen::Vector3f> to_viewer;
  std::vector<Eigen::Array3f> radiance;
};
/// Every `step`-th vertex, under a distant or near light, of a scene without vertex colours, seen from up to
/// atan(1.4 tilt) off its normal.
TracedVertices trace_vertices(const Scene& scene, std::size_t step, const PathLight& light,
                              const dynamic::ReferenceOptions& options, float tilt = 0.6f);

/// Of a transfer against them.
double error_of(const HarmonicTransfer& transfer, const Scene& scene, const HarmonicLight& light,
                const TracedVertices& traced);

}  // namespace refield::prt::test
