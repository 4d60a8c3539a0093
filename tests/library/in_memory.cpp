// SPDX-License-Identifier: Apache-2.0
// The library used in memory, as a program of its own: makes lights and photographs of a small scene,
// estimates its reflectance field, stops a second estimate, and relights. Writes no file and nothing to
// standard error.
#include <algorithm>
#include <atomic>
#include <cstdio>
#include <random>
#include <vector>

#include "refield/compare.h"
#include "refield/estimate.h"
#include "refield/relight.h"

using namespace refield;

namespace {

constexpr int images = 48;
constexpr LightDomain domain{16, 8, Parameterisation::monitor};

LightMap random_light(std::mt19937& random) {
  LightMap light{Image(domain.width, domain.height, 3), domain.parameterisation};
  for (float& value : light.radiance.values) value = std::uniform_real_distribution(0.0f, 1.0f)(random);
  return light;
}

/// Each pixel sees a rectangle of the light, by twice as much in green.
Image photograph(const LightMap& light) {
  Image seen(12, 8, 3);
  for (int y = 0; y < seen.height; ++y)
    for (int x = 0; x < seen.width; ++x)
      for (int v = y / 2; v < y / 2 + 4; ++v)
        for (int u = x; u < x + 4; ++u)
          for (int c = 0; c < 3; ++c)
            seen.at(x, y, c) += (c == 1 ? 0.1f : 0.05f) * light.radiance.at(u, v, c);
  return seen;
}

bool check(bool holds, const char* what) {
  std::printf("%s: %s\n", holds ? "ok" : "FAILED", what);
  return holds;
}

}  // namespace

int main() {
  std::mt19937 random(7);
  std::vector<LightMap> lights;
  std::vector<Image> photographs;
  for (int j = 0; j < images; ++j)
    photographs.push_back(photograph(lights.emplace_back(random_light(random))));
  const std::vector<LightMapView> light_views(lights.begin(), lights.end());
  const std::vector<ImageView> photograph_views(photographs.begin(), photographs.end());

  std::atomic<int> ended{0};
  std::atomic<std::uint64_t> pixels{0};
  RunContext run;
  run.max_threads = 2;
  run.on_progress = [&](const StageProgress& progress) {
    if (progress.event == StageProgress::Event::ended) ++ended;
    if (progress.stage == "estimate") pixels = progress.done;
  };
  const CaptureArrays capture{light_views, photograph_views};
  const Field field = estimate(capture, {}, run);
  bool holds = check(ended >= 2 && pixels == 12 * 8, "progress of all stages and pixels is reported");

  std::atomic<bool> stop{false};
  run.stop = &stop;
  run.on_progress = [&](const StageProgress& progress) { stop = stop || progress.stage == "estimate"; };
  bool is_stopped = false;
  try {
    estimate(capture, {}, run);
  } catch (const Interrupted&) {
    is_stopped = true;
  }
  holds &= check(is_stopped, "a second estimate stops when the caller asks for it");

  const LightMap light = random_light(random);
  const Image predicted = Relighter(field).relight(light), observed = photograph(light);
  const ImageView predicted_view = predicted, observed_view = observed;
  const double error = compare({&predicted_view, 1}, {&observed_view, 1}).relative_rmse;
  std::printf("relative error under a new light: %.4f\n", error);
  holds &= check(error < 0.05, "the field predicts the photograph under a new light");
  return holds ? 0 : 1;
}
