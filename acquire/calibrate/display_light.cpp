// SPDX-License-Identifier: Apache-2.0
#include "acquire/calibrate/calibrate.h"

#include <cerrno>
#include <cmath>

#include "acquire/calibrate/calibration.h"
#include "acquire/hdr/hdr_merge.h"
#include "core/base/run_context.h"

namespace refield {

namespace {

constexpr std::array<const char*, 3> channel_names = {"red", "green", "blue"};

DriveImage one_channel(const IlluminatorDescription& display, int channel, int level) {
  DriveImage image = uniform_drive(display.width, display.height, 0);
  for (std::size_t i = channel; i < image.levels.size(); i += 3)
    image.levels[i] = static_cast<std::uint8_t>(level);
  return image;
}

/// Share of `full` light in `light`, both above `black`.
double projection(const Photograph& light, const Photograph& full, const Photograph& black) {
  double top = 0.0, bottom = 0.0;
  for (std::size_t i = 0; i < full.radiance.values.size(); ++i) {
    if (std::isinf(light.sigma.values[i]) || std::isinf(full.sigma.values[i])) continue;
    const double expected = full.radiance.values[i] - black.radiance.values[i];
    top += expected * (light.radiance.values[i] - black.radiance.values[i]);
    bottom += expected * expected;
  }
  return bottom > 0.0 ? top / bottom : 0.0;
}

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

constexpr int frames_per_mean = 8;

Photograph above_black(CalibrationBench& bench, const CameraCalibration& camera,
                       const std::vector<Seconds>& exposures, const DriveImage& image,
                       const Photograph& black, const RunContext& run) {
  bench.show(image);
  Photograph shot = photograph(bench, camera, exposures, frames_per_mean, run);
  subtract_ambient(shot, black);
  return shot;
}

Photograph black_frame(CalibrationBench& bench, const CameraCalibration& camera,
                       const std::vector<Seconds>& exposures, const RunContext& run) {
  bench.show(0);
  return photograph(bench, camera, exposures, frames_per_mean, run);
}

double least_of(const RelativeMap& map) {
  return *std::ranges::min_element(map.values);
}

/// Mean over the channels, each relative to its own mean over the frame; clipped pixels get no weight.
/// `noise` receives the relative variance of a pixel.
void single_channel(const Photograph& shot, Image& value, Image& weight, double& noise) {
  const int channels = shot.radiance.channels;
  std::vector<double> mean(channels, 0.0);
  const auto pixels = static_cast<double>(shot.radiance.pixel_count());
  for (std::size_t i = 0; i < shot.radiance.values.size(); ++i)
    mean[i % channels] += shot.radiance.values[i] / pixels;
  value = Image(shot.radiance.width, shot.radiance.height, 1);
  weight = value;
  noise = 0.0;
  for (std::size_t p = 0; p < value.values.size(); ++p) {
    bool clipped = false;
    for (int c = 0; c < channels; ++c) {
      const double sigma = shot.sigma.values[p * channels + c];
      clipped = clipped || std::isinf(sigma);
      value.values[p] += static_cast<float>(shot.radiance.values[p * channels + c] / mean[c] / channels);
      if (!clipped) noise += std::pow(sigma / mean[c] / channels, 2) / pixels;
    }
    weight.values[p] = clipped ? 0.0f : 1.0f;
  }
}

}  // namespace

Photograph photograph(CalibrationBench& bench, const CameraCalibration& camera,
                      const std::vector<Seconds>& exposures, int repeats, const RunContext& run) {
  std::vector<RawFrame> frames;
  for (Seconds exposure : exposures)
    for (int i = 0; i < repeats; ++i) frames.push_back(bench.frame(exposure, run));
  return merge_exposures(frames, camera);
}

ToneCurve measure_tone_curve(CalibrationBench& bench, const CameraCalibration& camera,
                             const std::vector<Seconds>& exposures, int step, const RunContext& run) {
  ToneCurve result;
  constexpr int repeats = 2;
  bench.show(0);
  const Photograph black = photograph(bench, camera, exposures, 2 * repeats, run);
  Progress progress(run, "measuring tone curves", 3 * (255 / step + 1));
  for (int c = 0; c < 3; ++c) {
    bench.show(one_channel(bench.display(), c, 255));
    const Photograph full = photograph(bench, camera, exposures, 2 * repeats, run);
    std::vector<double> levels = {0.0};
    std::vector<double> light = {0.0};
    for (int level = step; level < 255; level += step) {
      bench.show(one_channel(bench.display(), c, level));
      levels.push_back(level);
      light.push_back(projection(photograph(bench, camera, exposures, repeats, run), full, black));
      result.falls[c] = std::max(result.falls[c], light[light.size() - 2] - light.back());
      progress.advance();
    }
    levels.push_back(255.0);
    light.push_back(1.0);
    for (std::size_t i = 0; i < levels.size(); ++i) result.measured[c].push_back({levels[i], light[i]});
    constexpr double impossible = 0.05;  // of white
    if (result.falls[c] > impossible)
      throw DeviceError(bench.display().name, EIO, "its ", channel_names[c], " channel becomes darker by ",
                        100.0 * result.falls[c],
                        " % of white from one level to a higher one; turn off dynamic contrast and "
                        "colour management, and let nothing move");
    for (double& value : light) value = std::clamp(value, 0.0, 1.0);
    const MonotoneCurve curve(levels, never_falling(light));
    for (int level = 0; level < 256; ++level)
      result.light_from_level[c].push_back(static_cast<float>(curve(level)));
  }
  return result;
}

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
                                    const std::vector<Seconds>& exposures, const RunContext& run) {
  using Inside = std::function<bool(double, double)>;
  const std::vector<std::pair<std::string, Inside>> patterns = {
      {"left and right half", [](double u, double) { return u < 0.5; }},
      {"upper and lower half", [](double, double v) { return v < 0.5; }},
      {"squares of a chequerboard",
       [](double u, double v) { return (static_cast<int>(8 * u) + static_cast<int>(6 * v)) % 2 == 0; }},
      {"small square and the rest of the screen",
       [](double u, double v) { return std::abs(u - 0.5) < 0.125 && std::abs(v - 0.5) < 0.125; }}};
  Superposition result;
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

UniformityMap measure_flat_field(CalibrationBench& bench, const CameraCalibration& camera,
                                 const std::vector<Seconds>& exposures, const RunContext& run) {
  const Photograph black = black_frame(bench, camera, exposures, run);
  const auto& display = bench.display();
  const Photograph white =
      above_black(bench, camera, exposures, uniform_drive(display.width, display.height, 255), black, run);
  Image value, weight;
  double noise = 0.0;
  single_channel(white, value, weight, noise);
  const auto nodes = [](int pixels) { return std::clamp(pixels / 6, 3, 17); };
  UniformityMap result;
  result.map = fit_relative_map(value, weight, nodes(value.width), nodes(value.height));
  result.least = least_of(result.map);
  double sum_map = 0.0, sum_value = 0.0, count = 0.0;
  for (int y = 0; y < value.height; ++y)
    for (int x = 0; x < value.width; ++x) {
      if (weight.at(x, y, 0) == 0.0f) continue;
      sum_map += result.map.at_pixel(x, y, value);
      sum_value += value.at(x, y, 0);
      count += 1.0;
    }
  double squares = 0.0;
  for (int y = 0; y < value.height; ++y)
    for (int x = 0; x < value.width; ++x)
      if (weight.at(x, y, 0) > 0.0f)
        squares +=
            std::pow(value.at(x, y, 0) / (result.map.at_pixel(x, y, value) * sum_value / sum_map) - 1.0, 2) /
            count;
  result.texture = std::sqrt(std::max(0.0, squares - noise));
  constexpr double plain = 0.03;
  if (result.texture > plain)
    throw InputError("the flat field cannot be measured: the image varies by ", 100.0 * result.texture,
                     " % in addition to a smooth falloff, and at most 3 % is allowed; fill the frame with a "
                     "plain white card, out of focus, or skip this measurement");
  return result;
}

UniformityMap measure_screen_uniformity(CalibrationBench& bench, const CameraCalibration& camera,
                                        const std::vector<Seconds>& exposures, const RunContext& run) {
  constexpr int columns = 8, rows = 6;
  const auto& display = bench.display();
  const Photograph black = black_frame(bench, camera, exposures, run);
  Image places(columns, rows, 1);
  Progress progress(run, "measuring the screen's uniformity", columns * rows);
  for (int j = 0; j < rows; ++j)
    for (int i = 0; i < columns; ++i) {
      DriveImage image = uniform_drive(display.width, display.height, 0);
      for (int y = display.height * j / rows; y < display.height * (j + 1) / rows; ++y)
        for (int x = display.width * i / columns; x < display.width * (i + 1) / columns; ++x)
          std::fill_n(image.levels.begin() + (static_cast<std::ptrdiff_t>(y) * display.width + x) * 3, 3,
                      std::uint8_t{255});
      Photograph shot = above_black(bench, camera, exposures, image, black, run);
      divide(shot, camera.flat_field);
      // What is at least half as bright as the brightest lies within the square, its blurred edge left out.
      const double brightest = quantile_of(shot.radiance.values, 1.0);
      double sum = 0.0, count = 0.0;
      for (std::size_t s = 0; s < shot.radiance.values.size(); ++s)
        if (shot.radiance.values[s] > 0.5 * brightest && std::isfinite(shot.sigma.values[s])) {
          sum += shot.radiance.values[s];
          count += 1.0;
        }
      constexpr double fewest = 12.0;
      if (count < fewest)
        throw InputError("the screen's uniformity cannot be measured: a white square in column ", i + 1,
                         " and row ", j + 1,
                         " of 8 × 6 is not visible; point the camera at the whole display");
      places.at(i, j, 0) = static_cast<float>(sum / count);
      progress.advance();
    }
  UniformityMap result;
  result.map = fit_relative_map(places, Image(columns, rows, 1, 1.0f), columns + 1, rows + 1);
  result.least = least_of(result.map);
  return result;
}

}  // namespace refield
