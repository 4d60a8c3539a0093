// SPDX-License-Identifier: Apache-2.0
#include "simulate/prt/clusters.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>
#include <numeric>
#include <string>

#include "core/cube_map.h"
#include "core/errors.h"
#include "simulate/prt/cube_quadtree.h"
#include "simulate/prt/group_cuts.h"
#include "simulate/prt/light_clusters.h"

namespace refield::prt {

namespace {

constexpr std::size_t group_outputs = TransferSamples::group_outputs;

void check(const ClusterOptions& options) {
  const auto require = [](bool met, const std::string& what) {
    if (!met) throw InputError(what);
  };
  require(options.resolution >= 1 && options.resolution <= largest_cube_resolution,
          "resolution " + std::to_string(options.resolution) +
              " of the cube's faces is out of range; give 1 to " + std::to_string(largest_cube_resolution));
  require(options.samples >= 2 && options.samples <= 16,
          "samples " + std::to_string(options.samples) +
              " along the side of a light cluster is out of range; give 2 to 16");
  require(options.epsilon >= 0.0,
          "epsilon " + std::to_string(options.epsilon) + " is not a valid threshold; give 0 or more");
  require(options.pixel_samples >= 1 && options.pixel_samples <= 8,
          "samples " + std::to_string(options.pixel_samples) +
              " along a pixel's side is out of range; give 1 to 8");
  require(options.bounces >= 0 && options.bounces <= 16,
          "bounces " + std::to_string(options.bounces) + " of light are out of range; give 0 to 16");
}

/// Gives the squares in use their numbers in the basis, by name: whole faces first, then their quarters, …
std::vector<Box> number_squares(std::vector<GroupWeights>& weights, int resolution) {
  std::vector<bool> used;
  for (const GroupWeights& group : weights)
    for (const std::uint32_t name : group.square) {
      if (name >= used.size()) used.resize(name + 1);
      used[name] = true;
    }
  std::vector<std::uint32_t> names;
  for (std::uint32_t name = 0; name < used.size(); ++name)
    if (used[name]) names.push_back(name);
  tbb::parallel_for(std::size_t{0}, weights.size(), [&](std::size_t g) {
    for (std::uint32_t& square : weights[g].square)
      square = static_cast<std::uint32_t>(std::ranges::lower_bound(names, square) - names.begin());
  });
  std::vector<Box> boxes;
  for (const std::uint32_t name : names) boxes.push_back(box_of_name(name, resolution));
  return boxes;
}

/// What rows of the field are made from.
struct Clusters {
  OutputLayout layout;
  int channels = 1;
  std::vector<GroupWeights> weights;

  SparseTransfer rows(RowRange range) const {
    SparseTransfer transfer;
    std::vector<std::uint32_t> columns;
    std::vector<float> row;
    const auto width = static_cast<std::size_t>(layout.width);
    for (std::size_t pixel = range.first * width; pixel < range.last * width; ++pixel) {
      columns.clear();
      row.clear();
      if (const std::uint32_t place = layout.place_of_pixel[pixel]; place != OutputLayout::none)
        append_output(weights[place / group_outputs], place % group_outputs, columns, row);
      transfer.append_row(columns, row);
    }
    return transfer;
  }

 private:
  void append_output(const GroupWeights& group, std::size_t output, std::vector<std::uint32_t>& columns,
                     std::vector<float>& row) const {
    const std::uint8_t* weight = group.weight.data() + output;
    for (std::size_t k = 0; k < group.square.size(); ++k) {
      std::array<float, 3> values{};
      for (int c = 0; c < channels; ++c, weight += group_outputs)
        values[c] = group.scale[k] * static_cast<float>(*weight);
      if (channels == 1) values.fill(values[0]);
      if (values[0] + values[1] + values[2] == 0.0f) continue;
      columns.push_back(group.square[k]);
      row.insert(row.end(), values.begin(), values.end());
    }
  }
};

void count(const Clusters& clusters, ClusterStatistics& statistics) {
  constexpr float bytes_of_white = 255.0f * std::numbers::pi_v<float>;
  for (const GroupWeights& group : clusters.weights) {
    const std::size_t size = group_outputs * static_cast<std::size_t>(clusters.channels);
    for (std::size_t k = 0; k < group.square.size(); ++k)
      for (std::size_t i = 0; i < group_outputs; ++i) {
        bool any = false;
        for (std::size_t v = k * size + i; v < (k + 1) * size; v += group_outputs) {
          any |= group.weight[v] > 0;
          statistics.bytes_of_paper +=
              group.scale[k] * static_cast<float>(group.weight[v]) * bytes_of_white >= 0.5f;
        }
        statistics.entries += any;
      }
  }
}

std::string provenance_of(const ClusterOptions& options, const ClusterStatistics& statistics) {
  nlohmann::ordered_json provenance = {
      {"relighting", options.relighting == Relighting::image ? "image" : "geometry"},
      {"similarity", name_of(options.similarity)},
      {"resolution", options.resolution},
      {"samples", options.samples},
      {"epsilon", options.epsilon},
      {"bounces", options.bounces},
      {"clusters", statistics.clusters},
      {"entries", statistics.entries},
      {"bytes_as_the_paper_counts", statistics.bytes_of_paper},
      {"lights", statistics.lights},
      {"rays", statistics.rays},
      {"peak_vectors", statistics.peak_vectors}};
  if (options.relighting == Relighting::image) provenance["pixel_samples"] = options.pixel_samples;
  return provenance.dump();
}

/// With colours as core/mesh.h has them: what a vertex' light is multiplied by.
Mesh coloured(const Scene& scene) {
  Mesh mesh = scene.mesh;
  mesh.colours = diffuse_reflectance(scene);
  return mesh;
}

}  // namespace

std::string_view name_of(Similarity similarity) {
  switch (similarity) {
    case Similarity::all_outputs:
      return "all_outputs";
    case Similarity::all_by_solid_angle:
      return "all_by_solid_angle";
    case Similarity::group:
      return "group";
  }
  throw InputError("unknown similarity");
}

FieldRows cluster_transfer(const Scene& scene, const ClusterOptions& options, ClusterStatistics& statistics,
                           const RunContext& run) {
  const ThreadLimit limit(run);
  check(options);
  const auto start = std::chrono::steady_clock::now();
  statistics = {};
  const auto clusters = std::make_shared<Clusters>();
  clusters->layout = layout_of(scene, options.relighting);
  const TransferSamples transfer(scene, {options.relighting, options.pixel_samples, options.bounces},
                                 clusters->layout.outputs, run);
  clusters->channels = transfer.channels();
  const auto outputs = static_cast<std::size_t>(std::ranges::count_if(
      clusters->layout.outputs, [](std::uint32_t output) { return output != OutputLayout::none; }));
  clusters->weights = options.similarity == Similarity::group
                          ? cut_groups(transfer, options, statistics, run)
                          : cluster_lights(transfer, outputs, options, statistics, run);

  FieldRows field;
  field.outline.width = clusters->layout.width;
  field.outline.height = clusters->layout.height;
  field.outline.basis.domain = cube_domain(options.resolution);
  field.outline.basis.measure = Measure::solid_angle;
  field.outline.basis.boxes = number_squares(clusters->weights, options.resolution);
  if (options.relighting == Relighting::geometry) field.outline.mesh = coloured(scene);
  statistics.clusters = field.outline.basis.boxes.size();
  count(*clusters, statistics);
  statistics.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  field.outline.provenance = provenance_of(options, statistics);
  field.rows = [clusters](RowRange range) { return clusters->rows(range); };
  return field;
}

}  // namespace refield::prt
