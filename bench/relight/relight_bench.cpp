// SPDX-License-Identifier: Apache-2.0
// Relighting at full size: 1024×768 pixels, 25 kernels a pixel, a light map of 800×600. The product T L reads
// every entry of the transfer once, so memory bandwidth limits it: ReadMemory measures that limit on this
// machine, and the GB/s of the others stand beside it.
#include <benchmark/benchmark.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "core/reflectance_field.h"
#include "core/rng.h"

namespace {

using refield::Box;

constexpr refield::LightDomain domain{800, 600, refield::Parameterisation::monitor};
constexpr int width = 1024;
constexpr int height = 768;
constexpr int kernels = 25;
constexpr int boxes_of_a_tile = 200;  // neighbouring pixels share most of their boxes, as in estimated fields

std::int32_t below(refield::Rng& rng, int count) {
  return static_cast<std::int32_t>(rng.below(count));
}

/// Boxes of a random kd-tree's nodes: sizes from single texels to the whole map.
std::vector<Box> kd_tree_boxes(refield::Rng& rng, std::size_t count) {
  std::vector<Box> boxes = {{0, 0, domain.width, domain.height}};
  for (std::size_t i = 0; boxes.size() < count; ++i) {
    const Box box = boxes[i];
    if (box.width() < 2 && box.height() < 2) continue;
    Box first = box;
    Box second = box;
    if (box.width() >= 2 && (box.height() < 2 || rng.below(2) == 0)) {
      first.x1 = second.x0 = box.x0 + 1 + below(rng, box.width() - 1);
    } else {
      first.y1 = second.y0 = box.y0 + 1 + below(rng, box.height() - 1);
    }
    boxes.push_back(first);
    boxes.push_back(second);
  }
  return boxes;
}

const refield::ReflectanceField& full_size_field() {
  static const refield::ReflectanceField field = [] {
    refield::Rng rng(1);
    refield::ReflectanceField made;
    made.width = width;
    made.height = height;
    made.basis = {
        domain, {}, kd_tree_boxes(rng, 88'000)};  // as many distinct boxes as prototypes of that size had
    std::vector<std::uint32_t> columns(kernels);
    std::vector<float> weights(3 * kernels);
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) {
        refield::Rng tile(2, x / 16, y / 16);
        const auto first = tile.below(made.basis.boxes.size() - boxes_of_a_tile);
        for (auto& column : columns) column = static_cast<std::uint32_t>(first + rng.below(boxes_of_a_tile));
        for (auto& weight : weights) weight = static_cast<float>(rng.uniform());
        made.transfer.append_row(columns, weights);
      }
    return made;
  }();
  return field;
}

refield::LightMap random_light() {
  refield::Rng rng(3);
  refield::LightMap light{refield::Image(domain.width, domain.height, 3), domain.parameterisation};
  for (float& value : light.radiance.values) value = static_cast<float>(rng.uniform());
  return light;
}

std::int64_t transfer_bytes(const refield::SparseTransfer& transfer) {
  return static_cast<std::int64_t>(transfer.entries() * (sizeof(std::uint32_t) + 3 * sizeof(float)) +
                                   transfer.rows() * (sizeof(std::uint64_t) + 3 * sizeof(float)));
}

/// Greatest relative difference from the product in double.
double worst_relative_error(const refield::ReflectanceField& field, const std::vector<float>& coefficients,
                            const std::vector<float>& outputs) {
  double worst = 0.0;
  for (std::size_t row = 0; row < field.transfer.rows(); row += 97)
    for (std::size_t c = 0; c < 3; ++c) {
      double exact = 0.0;
      for (auto e = field.transfer.row_start[row]; e < field.transfer.row_start[row + 1]; ++e)
        exact += double{field.transfer.weight[3 * e + c]} * coefficients[3 * field.transfer.column[e] + c];
      worst = std::max(worst, std::abs(outputs[3 * row + c] - exact) / exact);
    }
  return worst;
}

/// The limit: all cores read memory that no cache holds.
void ReadMemory(benchmark::State& state) {
  const std::vector<std::uint64_t> memory(40'000'000, 1);
  for (auto _ : state)
    benchmark::DoNotOptimize(tbb::parallel_reduce(
        tbb::blocked_range<std::size_t>(0, memory.size(), 1 << 16), std::uint64_t{0},
        [&](const auto& range, std::uint64_t sum) {
          for (std::size_t i = range.begin(); i != range.end(); ++i) sum += memory[i];
          return sum;
        },
        std::plus<>()));
  state.SetBytesProcessed(state.iterations() * static_cast<std::int64_t>(memory.size() * sizeof(memory[0])));
}
BENCHMARK(ReadMemory)->Unit(benchmark::kMillisecond)->UseRealTime();

void ApplyTransfer(benchmark::State& state) {
  const auto& field = full_size_field();
  const auto coefficients = field.basis.project(random_light());
  std::vector<float> outputs(3 * field.transfer.rows());
  for (auto _ : state) {
    field.transfer.apply(coefficients, outputs);
    benchmark::ClobberMemory();
  }
  state.SetBytesProcessed(state.iterations() * transfer_bytes(field.transfer));
  state.counters["worst_relative_error"] = worst_relative_error(field, coefficients, outputs);
}
BENCHMARK(ApplyTransfer)->Unit(benchmark::kMillisecond)->UseRealTime();

void ProjectLight(benchmark::State& state) {
  const auto& field = full_size_field();
  const auto light = random_light();
  for (auto _ : state) benchmark::DoNotOptimize(field.basis.project(light).data());
}
BENCHMARK(ProjectLight)->Unit(benchmark::kMillisecond)->UseRealTime();

void RelightWholeImage(benchmark::State& state) {
  const auto& field = full_size_field();
  const auto light = random_light();
  for (auto _ : state) benchmark::DoNotOptimize(field.relight(light).values.data());
  state.SetBytesProcessed(state.iterations() * transfer_bytes(field.transfer));
}
BENCHMARK(RelightWholeImage)->Unit(benchmark::kMillisecond)->UseRealTime();

}  // namespace
