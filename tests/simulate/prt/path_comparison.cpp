// SPDX-License-Identifier: Apache-2.0
#include "tests/simulate/prt/path_comparison.h"

#include <cmath>

namespace refield::prt::test {

void RelativeError::add(const Eigen::Array3f& seen, const Eigen::Array3f& expected) {
  wrong_ += (seen - expected).square().sum();
  all_ += expected.square().sum();
}

double RelativeError::value() const {
  return std::sqrt(wrong_ / all_);
}

TracedVertices trace_vertices(const Scene& scene, std::size_t step, const PathLight& light,
                              const PathOptions& options) {
  TracedVertices traced;
  std::vector<SurfacePoint> points;
  for (std::size_t v = step / 2; v < scene.mesh.positions.size(); v += step) {
    traced.vertices.push_back(v);
    points.push_back(point_of_vertex(scene, v));
    const auto angle = static_cast<float>(v);
    const Eigen::Vector3f aside(std::sin(angle), std::cos(angle), std::sin(2.0f * angle));
    traced.to_viewer.push_back((points.back().normal + 0.6f * aside).normalized());
  }
  const MeshRays rays(scene.mesh);
  traced.radiance = path_trace(scene, rays, points, traced.to_viewer, light, options);
  return traced;
}

double error_of(const HarmonicTransfer& transfer, const Scene& scene, const HarmonicLight& light,
                const TracedVertices& traced) {
  RelativeError error;
  for (std::size_t k = 0; k < traced.vertices.size(); ++k)
    error.add(radiance(transfer, scene, light, traced.vertices[k], traced.to_viewer[k]), traced.radiance[k]);
  return error.value();
}

}  // namespace refield::prt::test
