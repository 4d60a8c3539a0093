// SPDX-License-Identifier: Apache-2.0
#include "acquire/calibrate/superposition.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include "core/run_context.h"

namespace refield {

namespace {

constexpr int shots_per_pattern = 4;
constexpr double beyond_chance = 5.0;  // standard deviations

/// White where `inside` says so, of places from (0, 0) to (1, 1).
DriveImage pattern(const IlluminatorDescription& display, const std::function<bool(double, double)>& inside) {
  DriveImage image = uniform_drive(display.width, display.height, 0);
  std::size_t i = 0;
  for (int y = 0; y < display.height; ++y)
    for (int x = 0; x < display.width; ++x, i += 3)
      if (inside((x + 0.5) / display.width, (y + 0.5) / display.height))
        std::fill_n(image.levels.begin() + static_cast<std::ptrdiff_t>(i), 3, std::uint8_t{255});
  return image;
}

/// Sums over a part of the frame.
struct Balance {
  double missing = 0.0;   // I(A) + I(B) − I(black) − I(A+B)
  double light = 0.0;     // I(A+B) − I(black)
  double variance = 0.0;  // of `missing`
  double error() const { return light > 0.0 ? missing / light : 0.0; }
  double uncertainty() const { return light > 0.0 ? std::sqrt(variance) / light : 0.0; }
};

struct Shots {
  const Photograph &a, &b, &black, &both;
};

void add_sample(const Shots& shots, std::size_t i, Balance& balance) {
  double variance = 0.0;
  for (const Photograph* shot : {&shots.a, &shots.b, &shots.black, &shots.both})
    variance += static_cast<double>(shot->sigma.values[i]) * shot->sigma.values[i];
  if (!std::isfinite(variance)) return;
  const auto at = [i](const Photograph& shot) { return static_cast<double>(shot.radiance.values[i]); };
  balance.missing += at(shots.a) + at(shots.b) - at(shots.black) - at(shots.both);
  balance.light += at(shots.both) - at(shots.black);
  balance.variance += variance;
}

SuperpositionPair compare(const std::string& name, const Shots& shots) {
  constexpr int columns = 6, rows = 4;
  std::vector<Balance> blocks(columns * rows);
  const Image& frame = shots.both.radiance;
  std::size_t i = 0;
  for (int y = 0; y < frame.height; ++y)
    for (int x = 0; x < frame.width; ++x)
      for (int c = 0; c < frame.channels; ++c)
        add_sample(shots, i++, blocks[y * rows / frame.height * columns + x * columns / frame.width]);
  Balance all;
  for (const Balance& block : blocks) {
    all.missing += block.missing;
    all.light += block.light;
    all.variance += block.variance;
  }
  SuperpositionPair pair{name, all.error(), all.uncertainty(), 0.0};
  const double much_light = 0.2 * all.light / (columns * rows);
  for (const Balance& block : blocks) {
    const double certain = std::max(0.0, std::abs(block.error()) - beyond_chance * block.uncertainty());
    if (block.light > much_light) pair.worst_block = std::max(pair.worst_block, certain);
  }
  return pair;
}

}  // namespace

bool Superposition::holds() const {
  return std::ranges::all_of(pairs, [&](const SuperpositionPair& pair) {
    return std::abs(pair.error) <= std::max(tolerance, beyond_chance * pair.uncertainty) &&
           pair.worst_block <= 2.0 * tolerance;
  });
}

double Superposition::largest_error() const {
  double largest = 0.0;
  for (const SuperpositionPair& pair : pairs)
    largest = std::max({largest, std::abs(pair.error), pair.worst_block});
  return largest;
}

Superposition measure_superposition(CalibrationBench& bench, const CameraCalibration& camera,
                                    const std::vector<Seconds>& exposures, double tolerance,
                                    const RunContext& run) {
  using Inside = std::function<bool(double, double)>;
  const std::vector<std::pair<std::string, Inside>> patterns = {
      {"left and right half", [](double u, double) { return u < 0.5; }},
      {"upper and lower half", [](double, double v) { return v < 0.5; }},
      {"squares of a chequerboard",
       [](double u, double v) { return (static_cast<int>(8 * u) + static_cast<int>(6 * v)) % 2 == 0; }},
      {"small square and the rest of the screen",
       [](double u, double v) { return std::abs(u - 0.5) < 0.125 && std::abs(v - 0.5) < 0.125; }}};
  Superposition result;
  result.tolerance = tolerance;
  Progress progress(run, "testing superposition", 2 * patterns.size() + 2);
  const auto shoot = [&](const Inside& inside) {
    bench.show(pattern(bench.display(), inside));
    Photograph shot = photograph(bench, camera, exposures, shots_per_pattern, run);
    progress.advance();
    return shot;
  };
  const Photograph black = shoot([](double, double) { return false; });
  const Photograph both = shoot([](double, double) { return true; });
  for (const auto& [name, pattern_a] : patterns) {
    const Inside& inside = pattern_a;  // lambdas cannot capture structured bindings
    const Photograph a = shoot(inside);
    const Photograph b = shoot([&](double u, double v) { return !inside(u, v); });
    result.pairs.push_back(compare(name, {a, b, black, both}));
  }
  return result;
}

}  // namespace refield
