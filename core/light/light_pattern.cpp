// SPDX-License-Identifier: Apache-2.0
#include "core/light/light_pattern.h"

#include <Eigen/Core>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>

#include "core/base/rng.h"

namespace refield {

namespace {
constexpr std::string_view pattern_letters =
    "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz-_";
}

std::string pattern_of(const Image& radiance) {
  constexpr std::size_t parts = 8, places = 4;  // two lights of one texel each are alike once in 2^24
  constexpr double visible = 1e-5;              // part of the energy; of less contrast, 8 bits show nothing
  const auto texels = static_cast<double>(radiance.pixel_count());
  Eigen::Array3d mean = Eigen::Array3d::Zero();
  for (std::size_t i = 0; i < radiance.values.size(); ++i) mean[i % 3] += radiance.values[i] / texels;
  std::array<double, parts * places> sketch{};
  double energy = 0.0;
  for (std::size_t p = 0; p < radiance.pixel_count(); ++p) {
    Rng rng(p);
    for (int c = 0; c < 3; ++c) {
      std::uint64_t random = rng.next();
      const double value = radiance.values[3 * p + c] - mean[c];
      energy += value * value;
      for (std::size_t part = 0; part < parts; ++part, random >>= 4)
        sketch[part * places + (random >> 1) % places] += random & 1 ? value : -value;
    }
  }
  const double ground = mean.square().sum() * texels;
  std::string letters;
  const auto add = [&](double value) {
    letters +=
        pattern_letters[static_cast<std::size_t>(std::lround(31.5 + 31.5 * std::clamp(value, -1.0, 1.0)))];
  };
  for (const double value : sketch) add(energy > visible * ground ? value / std::sqrt(energy) : 0.0);
  for (const double value : mean) add(ground > 0.0 ? value / std::sqrt(ground / texels) : 0.0);
  add(energy > visible * ground ? std::sqrt(energy / (energy + ground)) : 0.0);
  return letters;
}

bool is_same_pattern(std::string_view a, std::string_view b) {
  constexpr std::ptrdiff_t rounding = 1;
  return std::ranges::equal(a, b, [](char x, char y) {
    return std::abs(static_cast<std::ptrdiff_t>(pattern_letters.find(x)) -
                    static_cast<std::ptrdiff_t>(pattern_letters.find(y))) <= rounding;
  });
}

}  // namespace refield
