// SPDX-License-Identifier: Apache-2.0
#include "simulate/trace_rows.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <algorithm>

#include "core/errors.h"
#include "core/run_context.h"

namespace refield {

namespace {
constexpr int pixels_of_a_band = 4096;  // enough to keep all cores busy, few enough for a quick stop
constexpr int pixels_of_a_task = 32;
}  // namespace

LightSums::LightSums(const LightHierarchy& hierarchy, std::size_t lights)
    : hierarchy_(hierarchy), lights_(lights), sums_(std::size_t{hierarchy.size()} * 3 * lights) {}

void LightSums::set(std::size_t place, const LightMap& light) {
  const LightDomain& domain = hierarchy_.domain();
  if (light.domain() != domain)
    throw InputError("light sums: the light map does not have the monitor's size");
  // First all sums of this light side by side, then one pass that spreads them out among the other lights'.
  std::vector<float> sums(std::size_t{hierarchy_.size()} * 3);
  std::ranges::copy(light.radiance.values, sums.begin());  // level 0 comes first, row by row
  // Each square is the sum of its four quarters: pairwise summation, so float is exact enough.
  for (int level = 1; level <= hierarchy_.coarsest_level(); ++level)
    for (int row = 0; row < hierarchy_.rows(level); ++row)
      for (int column = 0; column < hierarchy_.columns(level); ++column) {
        float* sum = sums.data() + std::size_t{3} * hierarchy_.node(level, column, row);
        for (int j = 2 * row; j < std::min(2 * row + 2, hierarchy_.rows(level - 1)); ++j)
          for (int i = 2 * column; i < std::min(2 * column + 2, hierarchy_.columns(level - 1)); ++i)
            for (int c = 0; c < 3; ++c) sum[c] += sums[std::size_t{3} * hierarchy_.node(level - 1, i, j) + c];
      }
  for (std::size_t k = 0; k < sums.size(); ++k) sums_[k * lights_ + place] = sums[k];
}

void apply_row(const std::vector<TransportEntry>& entries, const LightSums& sums, float* out) {
  const std::size_t lights = sums.lights();
  std::fill_n(out, 3 * lights, 0.0f);
  for (const TransportEntry& entry : entries) {
    const float* light = sums.of(entry.node);
    for (int c = 0; c < 3; ++c) {
      const float weight = entry.weight[c];
      float* to = out + c * lights;
      for (std::size_t l = 0; l < lights; ++l) to[l] += weight * light[c * lights + l];
    }
  }
}

std::uint64_t trace_rows(const Scene& scene, const LightHierarchy& hierarchy, const TraceOptions& options,
                         const std::function<void(int, std::vector<PixelTransport>&)>& take,
                         const RunContext& run) {
  const int width = scene.description().camera.width, height = scene.description().camera.height;
  const int band = std::max(1, pixels_of_a_band / width);
  tbb::enumerable_thread_specific<TraceScratch> scratch([&] { return TraceScratch(hierarchy); });
  Progress progress(run, "tracing light", static_cast<std::uint64_t>(width) * height);
  for (int first = 0; first < height; first += band) {
    run.throw_if_stopped();
    const int count = std::min(band, height - first) * width;
    std::vector<PixelTransport> pixels(count);
    tbb::parallel_for(tbb::blocked_range<int>(0, count, pixels_of_a_task), [&](const auto& range) {
      if (run.is_stopped()) return;  // the band is thrown away
      TraceScratch& mine = scratch.local();
      for (int p = range.begin(); p != range.end(); ++p)
        pixels[p] = trace_pixel(scene, hierarchy, options, p % width, first + p / width, mine);
      progress.advance(range.size());
    });
    run.throw_if_stopped();
    take(first, pixels);
  }
  std::uint64_t rays = 0;
  for (const TraceScratch& mine : scratch) rays += mine.rays();
  return rays;
}

FieldBuilder::FieldBuilder(const LightHierarchy& hierarchy, int width, int height) : hierarchy_(hierarchy) {
  field_.width = width;
  field_.height = height;
  field_.basis.domain = hierarchy.domain();
}

void FieldBuilder::append(const std::vector<PixelTransport>& pixels) {
  for (const PixelTransport& pixel : pixels) {
    for (const TransportEntry& entry : pixel.entries) {
      field_.transfer.column.push_back(entry.node);
      field_.transfer.weight.insert(field_.transfer.weight.end(), entry.weight, entry.weight + 3);
    }
    field_.transfer.row_start.push_back(field_.transfer.column.size());
  }
}

ReflectanceField FieldBuilder::finish() {
  constexpr std::uint32_t unused = 0xffffffffu;
  std::vector<std::uint32_t> place(hierarchy_.size(), unused);
  for (std::uint32_t node : field_.transfer.column) place[node] = 0;
  for (std::uint32_t node = 0; node < hierarchy_.size(); ++node)
    if (place[node] != unused) {
      place[node] = static_cast<std::uint32_t>(field_.basis.boxes.size());
      field_.basis.boxes.push_back(hierarchy_.box(node));
    }
  for (std::uint32_t& column : field_.transfer.column) column = place[column];
  return std::move(field_);
}

}  // namespace refield
