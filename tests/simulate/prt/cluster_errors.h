// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cmath>
#include <vector>

#include "bench/studies/prt/integrate.h"
#include "simulate/prt/clusters.h"
#include "tests/simulate/prt/small_scenes.h"

/// Errors of clusters against the sum over all lights.
namespace refield::prt::test {

inline ReflectanceField cluster(const Scene& scene, const ClusterOptions& options,
                                ClusterStatistics* figures = nullptr) {
  ClusterStatistics statistics;
  ReflectanceField field = field_of(cluster_transfer(scene, options, statistics));
  if (figures) *figures = statistics;
  return field;
}

/// Outputs of a relit image in the order of integrate_lights().
inline std::vector<Eigen::Array3d> outputs_of(const Image& image, const OutputLayout& layout) {
  std::vector<Eigen::Array3d> outputs(layout.outputs.size(), Eigen::Array3d::Zero());
  for (std::size_t pixel = 0; pixel < layout.place_of_pixel.size(); ++pixel)
    if (layout.place_of_pixel[pixel] != OutputLayout::none)
      for (int c = 0; c < 3; ++c) outputs[layout.place_of_pixel[pixel]][c] = image.values[3 * pixel + c];
  return outputs;
}

/// Relative RMSE of the outputs that count.
template <class Counts>
double error_of(const std::vector<Eigen::Array3d>& outputs, const std::vector<Eigen::Array3d>& exact,
                const Counts& counts) {
  double difference = 0.0, all = 0.0;
  for (std::size_t i = 0; i < exact.size(); ++i) {
    if (!counts(i)) continue;
    difference += (outputs[i] - exact[i]).square().sum();
    all += exact[i].square().sum();
  }
  return std::sqrt(difference / all);
}

/// Of a field under a light, against the sum over all lights.
inline double error_of(const ReflectanceField& field, const Scene& scene, Relighting relighting,
                       const LightMap& light) {
  const OutputLayout layout = layout_of(scene, relighting);
  const TransferSamples transfer(scene, {.relighting = relighting}, layout.outputs);
  return error_of(outputs_of(field.relight(light), layout), integrate_lights(transfer, {&light, 1})[0],
                  [](std::size_t) { return true; });
}

}  // namespace refield::prt::test
