// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/prt/measure.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <functional>
#include <vector>

#include "core/image/metrics.h"

namespace refield::prt_chart {

namespace {

double median_ms(std::vector<double> seconds) {
  std::ranges::nth_element(seconds, seconds.begin() + static_cast<std::ptrdiff_t>(seconds.size() / 2));
  return 1e3 * seconds[seconds.size() / 2];
}

/// A round area light on one face.
struct AreaLight {
  double x, y, radius;  // texels of the map
  float radiance;
  Box box() const {
    return {static_cast<int>(x - radius), static_cast<int>(y - radius), static_cast<int>(x + radius) + 1,
            static_cast<int>(y + radius) + 1};
  }
};

constexpr float ambient = 1.0f;

/// Draws the box anew: the ambient light, and the area light where it is.
void draw(LightMap& light, const Box& box, const AreaLight& area_light) {
  for (int y = box.y0; y < box.y1; ++y)
    for (int x = box.x0; x < box.x1; ++x) {
      const bool lit = std::hypot(x + 0.5 - area_light.x, y + 0.5 - area_light.y) < area_light.radius;
      for (int c = 0; c < 3; ++c) light.radiance.at(x, y, c) = lit ? area_light.radiance : ambient;
    }
}

Box joined(const Box& a, const Box& b) {
  return {std::min(a.x0, b.x0), std::min(a.y0, b.y0), std::max(a.x1, b.x1), std::max(a.y1, b.y1)};
}

}  // namespace

double seconds_of(const std::function<void()>& action) {
  const auto start = std::chrono::steady_clock::now();
  action();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

RelightTimes measure_relighting(TileRelighter& relighter) {
  const LightDomain domain = relighter.domain();
  LightMap light{Image(domain.width, domain.height, 3), domain.parameterisation};
  std::ranges::fill(light.radiance.values, ambient);
  const double side = domain.width;
  // On the right face and on the one behind.
  std::array<AreaLight, 2> area_lights{AreaLight{0.3 * side, 0.4 * side, 0.05 * side, 20.0f},
                                       AreaLight{0.3 * side, 5.4 * side, 0.10 * side, 10.0f}};
  for (const AreaLight& area_light : area_lights) draw(light, area_light.box(), area_light);

  RelightTimes times;
  constexpr int runs = 9, moves = 40;
  std::vector<double> whole, moved;
  for (int run = 0; run < runs; ++run) whole.push_back(seconds_of([&] { relighter.relight(light); }));
  for (int move = 0; move < moves; ++move) {
    std::array<Box, 2> changed;
    for (std::size_t i = 0; i < area_lights.size(); ++i) {
      const Box before = area_lights[i].box();
      area_lights[i].x += (move < moves / 2 ? 0.25 : -0.25) * std::min(area_lights[i].radius, 0.05 * side);
      changed[i] = joined(before, area_lights[i].box());
      draw(light, changed[i], area_lights[i]);
    }
    moved.push_back(seconds_of([&] {
      for (const Box& box : changed) relighter.update(light, box);
    }));
  }
  times.whole_ms = median_ms(whole);
  times.two_area_lights_ms = median_ms(moved);
  const Image updated = relighter.update(light, {0, 0, 1, 1});
  times.update_error = relative_rmse(updated, relighter.relight(light));
  return times;
}

}  // namespace refield::prt_chart
