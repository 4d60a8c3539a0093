// SPDX-License-Identifier: Apache-2.0
#include "simulate/prt/harmonic_field.h"

#include <cmath>
#include <limits>
#include <memory>

#include "core/cube_map.h"
#include "core/transfer_tiles.h"

namespace refield::prt {

namespace {

constexpr std::size_t dark = std::numeric_limits<std::size_t>::max();

/// Number of the output at each pixel of some image rows, or `dark` where there is none.
std::vector<std::size_t> outputs_at(RowRange rows, std::size_t outputs) {
  std::vector<std::size_t> at(static_cast<std::size_t>(rows.last - rows.first) * output_image_width, dark);
  // A row of tiles holds successive outputs.
  constexpr std::size_t of_tile_row = std::size_t{output_image_width} * tile_side_px;
  const std::size_t first = static_cast<std::size_t>(rows.first / tile_side_px) * of_tile_row,
                    last =
                        static_cast<std::size_t>((rows.last + tile_side_px - 1) / tile_side_px) * of_tile_row;
  const std::size_t before = static_cast<std::size_t>(rows.first) * output_image_width;
  for (std::size_t s = first; s < std::min(last, outputs); ++s) {
    const std::size_t pixel = pixel_of_output(s);
    if (pixel >= before && pixel - before < at.size()) at[pixel - before] = s;
  }
  return at;
}

/// Kernels and weights of one output.
struct SignedRow {
  std::vector<std::uint32_t> kernels;
  std::vector<float> weights;

  void set(const HarmonicTransfer& transfer, std::size_t output) {
    kernels.clear();
    weights.clear();
    const auto outputs = static_cast<std::size_t>(transfer.outputs);
    std::span<const float> channel[3];
    for (int c = 0; c < 3; ++c)
      channel[c] = transfer.row(output / outputs, static_cast<int>(output % outputs), c);
    for (std::size_t j = 0; j < channel[0].size(); ++j)
      for (const float sign : {1.0f, -1.0f}) {
        const float weight[3] = {std::max(0.0f, sign * channel[0][j]), std::max(0.0f, sign * channel[1][j]),
                                 std::max(0.0f, sign * channel[2][j])};
        if (weight[0] + weight[1] + weight[2] <= 0.0f) continue;
        kernels.push_back(static_cast<std::uint32_t>(2 * j + (sign < 0.0f)));
        weights.insert(weights.end(), weight, weight + 3);
      }
  }
};

}  // namespace

FieldRows harmonic_field(const Scene& scene, HarmonicTransfer transfer, int map_resolution) {
  FieldRows field;
  ReflectanceField& outline = field.outline;
  outline.basis.domain = cube_domain(map_resolution);
  outline.basis.measure = Measure::solid_angle;
  outline.basis.harmonics = {transfer.order};
  outline.mesh = scene.mesh;
  outline.mesh.colours = std::move(transfer.colours);
  outline.outgoing_order = transfer.outputs == 1 ? 0 : transfer.order;
  outline.camera = scene.camera;
  outline.width = output_image_width;
  outline.height = output_image_height(outline.mesh_outputs());
  field.rows = [shared = std::make_shared<const HarmonicTransfer>(std::move(transfer)),
                outputs = outline.mesh_outputs()](RowRange range) {
    SparseTransfer rows;
    SignedRow row;
    for (const std::size_t output : outputs_at(range, outputs)) {
      if (output == dark)
        rows.append_row({}, {});
      else {
        row.set(*shared, output);
        rows.append_row(row.kernels, row.weights);
      }
    }
    return rows;
  };
  return field;
}

}  // namespace refield::prt
