// SPDX-License-Identifier: Apache-2.0
#include "cli/dynamic/frame_times.h"

#include <algorithm>
#include <chrono>
#include <vector>

namespace refield::cli {

FrameTimes measure_frames(PreparedScene& scene, const dynamic::FrameOptions& options) {
  constexpr int frames = 15;
  const PinholeCamera camera = camera_of(scene.scene());
  std::vector<FrameTimes> all;
  using Clock = std::chrono::steady_clock;
  const auto ms_since = [](Clock::time_point start) {
    return std::chrono::duration<double, std::milli>(Clock::now() - start).count();
  };
  for (int frame = 0; frame < frames; ++frame) {
    const auto start = Clock::now();
    scene.solve(scene.scene().duration() * frame / frames, camera, options);
    scene.light().radiance(0, scene.light().bounces());
    const double solved = ms_since(start);
    const auto before_picture = Clock::now();
    scene.picture(0, scene.light().bounces());
    const dynamic::DynamicLight::Times& times = scene.light().times();
    all.push_back({solved, 1e3 * times.direct, 1e3 * times.place, 1e3 * times.bounces, 1e3 * times.shade,
                   ms_since(before_picture) - 1e3 * times.shade});
  }
  const auto median = [&](double FrameTimes::*part) {
    std::vector<double> values;
    for (const FrameTimes& times : all) values.push_back(times.*part);
    std::ranges::nth_element(values, values.begin() + frames / 2);
    return values[frames / 2];
  };
  return {median(&FrameTimes::frame),   median(&FrameTimes::direct), median(&FrameTimes::place),
          median(&FrameTimes::bounces), median(&FrameTimes::shade),  median(&FrameTimes::picture)};
}

}  // namespace refield::cli
