// SPDX-License-Identifier: Apache-2.0
// Summed-area tables: speed beside accuracy. `worst_relative_error` is that of one-texel boxes in the dark of
// a map with a sun of 1e5.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>

#include "core/base/rng.h"
#include "core/light/summed_area_table.h"

namespace {

refield::Image map_with_sun(int width, int height) {
  refield::Rng rng(1);
  refield::Image image(width, height, 3);
  for (float& value : image.values) value = static_cast<float>(rng.uniform(0.01, 1.0));
  for (int y = height / 4; y < height / 4 + 8; ++y)
    for (int x = width / 3; x < width / 3 + 8; ++x)
      for (int c = 0; c < 3; ++c) image.at(x, y, c) = 1e5f;
  return image;
}

double worst_relative_error(const refield::Image& image, const refield::SummedAreaTable& table) {
  refield::Rng rng(2);
  double worst = 0.0;
  for (int i = 0; i < 10'000; ++i) {
    const int x = static_cast<int>(rng.below(image.width));
    const int y = static_cast<int>(rng.below(image.height));
    const auto sum = table.sum({x, y, x + 1, y + 1});
    for (int c = 0; c < 3; ++c)
      worst = std::max(worst, std::abs(sum[c] - image.at(x, y, c)) / image.at(x, y, c));
  }
  return worst;
}

void BuildSummedAreaTable(benchmark::State& state) {
  const auto width = static_cast<int>(state.range(0));
  const auto height = static_cast<int>(state.range(1));
  const refield::Image image = map_with_sun(width, height);
  for (auto _ : state) {
    refield::SummedAreaTable table(image);
    benchmark::DoNotOptimize(table.sum({0, 0, width, height}));
  }
  state.counters["worst_relative_error"] = worst_relative_error(image, refield::SummedAreaTable(image));
  state.SetBytesProcessed(state.iterations() * static_cast<std::int64_t>(width) * height * 3 * (4 + 8));
}
BENCHMARK(BuildSummedAreaTable)
    ->Args({128, 96})
    ->Args({800, 600})
    ->Args({4096, 2048})
    ->Unit(benchmark::kMillisecond);

}  // namespace
