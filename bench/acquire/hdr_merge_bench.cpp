// SPDX-License-Identifier: Apache-2.0
// What a photograph costs between the sensor and the disk: four 12-bit exposures of 1024×768 pixels.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>

#include "acquire/hdr/hdr_merge.h"
#include "core/base/rng.h"

namespace {

using namespace refield;

constexpr int photograph_width = 1024;
constexpr int photograph_height = 768;

CameraCalibration calibration() {
  CameraCalibration camera;
  camera.linear_from_dn = linear_response(12);
  camera.black_level_dn = 64.0;
  camera.electrons_per_dn = 4.0;
  camera.read_noise_electrons = 3.0;
  camera.electrons_per_radiance_second = 200'000.0;
  return camera;
}

std::vector<RawFrame> bracket(PixelLayout layout, const std::vector<double>& radiance) {
  std::vector<RawFrame> frames;
  Rng random(1);
  const auto camera = calibration();
  for (double seconds : {0.0625, 0.25, 1.0, 4.0}) {
    RawFrame frame{photograph_width, photograph_height, layout, {}, {}, Seconds(seconds), 1.0, 0};
    for (double r : radiance) {
      const double mean = r * seconds * camera.electrons_per_radiance_second;
      const double electrons = mean + std::sqrt(mean + 9.0) * random.normal();
      frame.samples.push_back(static_cast<std::uint16_t>(std::clamp(64.5 + electrons / 4.0, 0.0, 4095.0)));
    }
    frames.push_back(std::move(frame));
  }
  return frames;
}

void merge(benchmark::State& state, PixelLayout layout) {
  const std::size_t samples =
      std::size_t{photograph_width} * photograph_height * (layout == PixelLayout::rgb ? 3 : 1);
  Rng random(2);
  std::vector<double> radiance(samples);
  for (double& r : radiance) r = 0.3 * std::pow(random.uniform(), 4.0);
  const auto frames = bracket(layout, radiance);
  const auto camera = calibration();
  double error = 0.0;
  for (auto _ : state) {
    const Photograph photograph = merge_exposures(frames, camera);
    benchmark::DoNotOptimize(photograph.radiance.values.data());
    if (layout == PixelLayout::rgb) {
      state.PauseTiming();
      double difference = 0.0;
      double sum = 0.0;
      for (std::size_t i = 0; i < samples; ++i) {
        difference += std::pow(photograph.radiance.values[i] - radiance[i], 2);
        sum += radiance[i] * radiance[i];
      }
      error = std::sqrt(difference / sum);
      state.ResumeTiming();
    }
  }
  state.SetBytesProcessed(
      static_cast<std::int64_t>(state.iterations() * 4 * samples * sizeof(std::uint16_t)));
  if (layout == PixelLayout::rgb) state.counters["relative_rmse"] = error;  // speed never without accuracy
}

BENCHMARK_CAPTURE(merge, rgb, PixelLayout::rgb)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK_CAPTURE(merge, bayer, PixelLayout::bayer_rggb)->Unit(benchmark::kMillisecond)->UseRealTime();

}  // namespace
