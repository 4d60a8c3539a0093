// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/prt/integrate.h"

#include <tbb/parallel_for.h>

#include "core/base/errors.h"
#include "core/base/run_context.h"
#include "core/light/cube_map.h"

namespace refield::prt {

std::vector<std::vector<Eigen::Array3d>> integrate_lights(const TransferSamples& transfer,
                                                          std::span<const LightMap> lights,
                                                          const RunContext& run) {
  constexpr std::size_t group_outputs = TransferSamples::group_outputs;
  const std::size_t groups = transfer.groups();
  std::vector<std::vector<Eigen::Array3d>> outputs(
      lights.size(), std::vector<Eigen::Array3d>(groups * group_outputs, Eigen::Array3d::Zero()));
  if (lights.empty()) return outputs;
  const int resolution = lights[0].radiance.width;
  for (const LightMap& light : lights)
    if (light.domain() != cube_domain(resolution))
      throw InputError("integration takes cube maps of one size; one is " + shape_text(light.radiance));

  const std::size_t grey = transfer.channels() == 1 ? 0 : group_outputs;  // from a channel to the next
  Progress progress(run, "integrating all lights", groups * cube_faces);
  tbb::parallel_for(std::size_t{0}, groups, [&](std::size_t g) {
    std::vector<float> values(transfer.group_values());
    for (int y = 0; y < cube_faces * resolution; ++y) {
      if (run.is_stopped()) return;  // thrown away
      for (int x = 0; x < resolution; ++x) {
        transfer.evaluate(g, cube_direction(x + 0.5, y + 0.5, resolution).cast<float>(), values);
        const double solid_angle = cube_solid_angle(x, y, resolution);
        for (std::size_t l = 0; l < lights.size(); ++l)
          for (int c = 0; c < 3; ++c) {
            const double light = solid_angle * lights[l].radiance.at(x, y, c);
            for (std::size_t i = 0; i < group_outputs; ++i)
              outputs[l][g * group_outputs + i][c] += light * values[static_cast<std::size_t>(c) * grey + i];
          }
      }
      if ((y + 1) % resolution == 0) progress.advance();
    }
  });
  run.throw_if_stopped();
  return outputs;
}

}  // namespace refield::prt
