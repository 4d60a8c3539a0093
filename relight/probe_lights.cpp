// SPDX-License-Identifier: Apache-2.0
#include "relight/probe_lights.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/rng.h"

namespace refield {

namespace {

LightMap dark(const LightDomain& domain) {
  return {Image(domain.width, domain.height, 3), domain.parameterisation};
}

/// White inside a rectangle given in shares of the map; at least one texel.
LightMap rectangle(const LightDomain& domain, double x0, double y0, double width, double height) {
  const auto span_of = [](double first, double size, int texels) {
    const int from = std::clamp(static_cast<int>(std::lround(first * texels)), 0, texels - 1);
    const int count = std::max(1, static_cast<int>(std::lround(size * texels)));
    return std::pair(from, std::min(from + count, texels));
  };
  const auto [left, right] = span_of(x0, width, domain.width);
  const auto [top, bottom] = span_of(y0, height, domain.height);
  LightMap light = dark(domain);
  for (int y = top; y < bottom; ++y) std::fill_n(&light.radiance.at(left, y, 0), 3 * (right - left), 1.0f);
  return light;
}

LightMap single_texels(const LightDomain& domain, Rng& rng) {
  LightMap light = dark(domain);
  const auto texels = light.radiance.pixel_count();
  for (std::size_t i = 0; i < std::max<std::size_t>(1, texels / 100); ++i) {
    const std::size_t at = rng.below(texels);
    for (std::size_t c = 0; c < 3; ++c) light.radiance.values[3 * at + c] = static_cast<float>(rng.uniform());
  }
  return light;
}

/// Adds random values on a grid of nodes, linear in between.
void add_octave(LightMap& light, int nodes, double amplitude, Rng& rng) {
  const auto side = static_cast<std::size_t>(nodes) + 1;
  std::vector<double> values(side * side * 3);
  for (double& value : values) value = amplitude * rng.uniform();
  Image& radiance = light.radiance;
  for (int y = 0; y < radiance.height; ++y)
    for (int x = 0; x < radiance.width; ++x) {
      const double u = (x + 0.5) / radiance.width * nodes, v = (y + 0.5) / radiance.height * nodes;
      const auto i = static_cast<std::size_t>(u), j = static_cast<std::size_t>(v);
      const double right = u - static_cast<double>(i), below = v - static_cast<double>(j);
      for (std::size_t c = 0; c < 3; ++c) {
        const auto node = [&](std::size_t column, std::size_t row) {
          return values[(row * side + column) * 3 + c];
        };
        radiance.at(x, y, static_cast<int>(c)) +=
            static_cast<float>((node(i, j) * (1 - right) + node(i + 1, j) * right) * (1 - below) +
                               (node(i, j + 1) * (1 - right) + node(i + 1, j + 1) * right) * below);
      }
    }
}

LightMap smooth(const LightDomain& domain, Rng& rng) {
  LightMap light = dark(domain);
  for (int nodes = 2; nodes <= std::max(2, std::min(domain.width, domain.height) / 2); nodes *= 2)
    add_octave(light, nodes, 1.0 / nodes, rng);
  // Bright places few and far between, as lamps and windows are.
  for (float& value : light.radiance.values) value = value * value * value;
  return light;
}

}  // namespace

std::vector<ProbeLights> probe_lights(const LightDomain& domain) {
  Rng rng(20);
  std::vector<ProbeLights> probes = {{"white", {rectangle(domain, 0, 0, 1, 1)}},
                                     {"texels", {}},
                                     {"bar", {}},
                                     {"square", {}},
                                     {"smooth", {}}};
  constexpr double bar = 1.0 / 8;
  for (const double at : {0.25, 0.625}) {
    probes[1].lights.push_back(single_texels(domain, rng));
    probes[2].lights.push_back(rectangle(domain, at, 0, bar, 1));
    probes[2].lights.push_back(rectangle(domain, 0, at, 1, bar));
    probes[4].lights.push_back(smooth(domain, rng));
  }
  const double side = std::min(domain.width, domain.height) / 20.0;
  for (const auto& [x, y] : {std::pair(0.15, 0.15), std::pair(0.8, 0.15), std::pair(0.5, 0.5),
                             std::pair(0.15, 0.8), std::pair(0.8, 0.8)})
    probes[3].lights.push_back(rectangle(domain, x, y, side / domain.width, side / domain.height));
  return probes;
}

}  // namespace refield
