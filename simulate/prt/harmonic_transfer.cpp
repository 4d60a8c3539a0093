// SPDX-License-Identifier: Apache-2.0
#include "simulate/prt/harmonic_transfer.h"

#include <tbb/parallel_for.h>
#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <numbers>
#include <string>

#include "core/base/errors.h"
#include "core/base/json.h"
#include "core/field/transfer_tiles.h"
#include "core/light/cube_map.h"
#include "simulate/geometry/place_mesh.h"
#include "simulate/prt/harmonic_passes.h"

namespace refield::prt {

namespace {

/// Vertices may lie as far from the middle as this share of the lights' radius: nearer to the lights the
/// samples stand out one by one.
constexpr float farthest_share = 0.95f;

void check_radius(const Mesh& mesh, double radius) {
  if (radius == 0.0) return;
  const Eigen::Vector3f centre = middle(mesh);
  float farthest = 0.0f;
  for (const auto& position : mesh.positions) farthest = std::max(farthest, (position - centre).norm());
  if (farthest > farthest_share * radius)
    throw InputError("harmonics: radius " + std::to_string(radius) +
                     " of the sphere of lights: the scene reaches " + std::to_string(farthest) +
                     " from its middle; give at least " + std::to_string(farthest / farthest_share) +
                     ", or 0 for distant light");
}

/// HarmonicStatistics::pass_energy of a pass. Uniform light has the coefficient √4π of y_00 alone, and
/// irradiance is I_0 ∕ y_00.
double energy_of(const ArrivingLight& light, const std::vector<float>& areas) {
  double sum = 0.0, area = 0.0;
  for (std::size_t v = 0; v < areas.size(); ++v) {
    for (int c = 0; c < light.channels; ++c) sum += 4.0 * areas[v] * light.of(v, c)(0, 0) / light.channels;
    area += areas[v];
  }
  return area > 0.0 ? sum / area : 0.0;
}

/// `total` with as many channels as `pass`, plus it.
void add(ArrivingLight& total, const ArrivingLight& pass, std::size_t vertices) {
  if (total.channels == pass.channels) {
    std::ranges::transform(total.values, pass.values, total.values.begin(), std::plus<>());
    return;
  }
  ArrivingLight sum = pass;
  for (std::size_t v = 0; v < vertices; ++v)
    for (int c = 0; c < sum.channels; ++c) sum.of(v, c) += total.of(v, 0);
  total = std::move(sum);
}

ArrivingLight all_passes(const Scene& scene, const HarmonicOptions& options, const SurfaceResponse& response,
                         std::vector<double>& energy, const RunContext& run) {
  const std::vector<float> areas = vertex_areas(scene.mesh.positions, scene.mesh.triangles);
  HarmonicPasses passes(scene, options, response);
  ArrivingLight last = passes.shadow(run);
  ArrivingLight total = last;
  energy = {energy_of(last, areas)};
  for (int pass = 0; pass < options.max_passes && energy.back() > options.until * energy.front(); ++pass) {
    last = passes.interreflection(last, run);
    energy.push_back(energy_of(last, areas));
    add(total, last, scene.mesh.positions.size());
  }
  return total;
}

HarmonicTransfer reflect(const ArrivingLight& light, const Scene& scene, const HarmonicOptions& options,
                         const SurfaceResponse& response) {
  const std::size_t vertices = scene.mesh.positions.size();
  HarmonicTransfer transfer;
  transfer.order = options.order;
  transfer.outputs = light.rows;
  for (std::size_t v = 0; v < vertices; ++v) transfer.colours.push_back(response.colour(v));
  // Where a vertex is both diffuse and glossy, its channels may differ though the light's do not.
  const bool grey = light.channels == 1 && (light.rows == 1 || response.is_grey());
  transfer.channels = grey ? 1 : 3;
  const float y_00 = static_cast<float>(std::sqrt(0.25 / std::numbers::pi));
  const auto of_vertex = static_cast<std::size_t>(light.rows) * transfer.channels * light.columns;
  transfer.values.resize(vertices * of_vertex);
  tbb::parallel_for(std::size_t{0}, vertices, [&](std::size_t v) {
    const std::vector<RowMatrix> sent = response.reflect(v, light.channels_of(v), transfer.channels, false);
    float* to = transfer.values.data() + v * of_vertex;
    for (int i = 0; i < light.rows; ++i)
      for (int c = 0; c < transfer.channels; ++c, to += light.columns)
        Eigen::Map<Eigen::RowVectorXf>(to, light.columns) =
            (light.rows == 1 ? y_00 : 1.0f) * sent[static_cast<std::size_t>(c)].row(i);
  });
  return transfer;
}

}  // namespace

void HarmonicOptions::check() const {
  const auto require = [](bool good, const std::string& what, const std::string& remedy) {
    if (!good) throw InputError("harmonics: " + what + ": " + remedy);
  };
  require(order >= 2 && order <= 8, "order " + std::to_string(order), "give 2 to 8");
  require(directions >= 64 && directions <= 1 << 20, "directions " + std::to_string(directions),
          "give 64 to 1048576");
  require(until > 0.0, "until " + std::to_string(until), "give a share above 0, such as 0.002");
  require(max_passes >= 0, "max_passes " + std::to_string(max_passes), "give 0 or more");
  require(radius >= 0.0 && std::isfinite(radius), "radius " + std::to_string(radius),
          "give a length in units of the scene, or 0 for distant light");
  require(map_resolution >= 4 && map_resolution <= 4096, "map_resolution " + std::to_string(map_resolution),
          "give 4 to 4096 texels per face");
}

std::span<const float> HarmonicTransfer::row(std::size_t vertex, int output, int channel) const {
  const auto width = static_cast<std::size_t>(columns());
  const std::size_t at = (vertex * static_cast<std::size_t>(outputs) + static_cast<std::size_t>(output)) *
                             static_cast<std::size_t>(channels) +
                         static_cast<std::size_t>(std::min(channel, channels - 1));
  return {values.data() + at * width, width};
}

Eigen::Vector3f middle(const Mesh& mesh) {
  const Eigen::AlignedBox3f box = bounds_of(mesh);
  return box.isEmpty() ? Eigen::Vector3f::Zero() : Eigen::Vector3f(box.center());
}

HarmonicTransfer harmonic_transfer(const Scene& scene, const HarmonicOptions& options,
                                   HarmonicStatistics& statistics, const RunContext& run) {
  const ThreadLimit limit(run);
  options.check();
  if (scene.mesh.empty()) throw InputError("harmonics: the scene has no vertices; give it a mesh");
  check_radius(scene.mesh, options.radius);
  const SurfaceResponse response(scene, options.order);
  return reflect(all_passes(scene, options, response, statistics.pass_energy, run), scene, options, response);
}

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
  FieldOutline& outline = field.outline;
  outline.basis.domain = cube_domain(map_resolution);
  outline.basis.measure = Measure::solid_angle;
  outline.basis.harmonics = {transfer.order};
  OutputMesh mesh{scene.mesh, transfer.outputs == 1 ? 0 : transfer.order, scene.camera};
  mesh.colours = std::move(transfer.colours);
  outline.width = output_image_width;
  outline.height = output_image_height(mesh.outputs());
  const std::size_t outputs = mesh.outputs();
  outline.mesh = std::move(mesh);
  field.rows = [shared = std::make_shared<const HarmonicTransfer>(std::move(transfer)),
                outputs](RowRange range) {
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

FieldRows harmonic_field(const Scene& scene, const HarmonicOptions& options, const RunContext& run) {
  HarmonicStatistics statistics;
  FieldRows field =
      harmonic_field(scene, harmonic_transfer(scene, options, statistics, run), options.map_resolution);
  field.outline.provenance = json_text({{"order", options.order},
                                        {"window", "none"},
                                        {"directions", options.directions},
                                        {"radius", options.radius},
                                        {"pass_energy", statistics.pass_energy}});
  return field;
}

}  // namespace refield::prt
