// SPDX-License-Identifier: Apache-2.0
#include "tests/support/mesh_field.h"

#include <algorithm>
#include <limits>
#include <numbers>
#include <utility>

#include "core/light/cube_map.h"

namespace refield::test {

ReflectanceField unshadowed_field(Mesh mesh, int resolution) {
  ReflectanceField field;
  field.basis.domain = cube_domain(resolution);
  field.basis.measure = Measure::solid_angle;
  std::vector<Eigen::Vector3f> directions;
  for (int y = 0; y < field.basis.domain.height; ++y)
    for (int x = 0; x < resolution; ++x) {
      field.basis.boxes.push_back({x, y, x + 1, y + 1});
      directions.push_back(cube_direction(x + 0.5, y + 0.5, resolution).cast<float>());
    }
  field.mesh = OutputMesh{std::move(mesh)};
  field.width = output_image_width;
  field.height = output_image_height(field.mesh->outputs());

  constexpr std::size_t none = std::numeric_limits<std::size_t>::max();
  std::vector<std::size_t> vertex_at(static_cast<std::size_t>(field.width) * field.height, none);
  for (std::size_t v = 0; v < field.mesh->positions.size(); ++v) vertex_at[pixel_of_output(v)] = v;
  for (const std::size_t vertex : vertex_at) {
    std::vector<std::uint32_t> columns;
    std::vector<float> weights;
    for (std::uint32_t k = 0; vertex != none && k < directions.size(); ++k) {
      const float weight = field.mesh->normals[vertex].dot(directions[k]) / std::numbers::pi_v<float>;
      if (weight <= 0.0f) continue;
      columns.push_back(k);
      weights.insert(weights.end(), 3, weight);
    }
    field.transfer.append_row(columns, weights);
  }
  return field;
}

}  // namespace refield::test
