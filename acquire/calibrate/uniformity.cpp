// SPDX-License-Identifier: Apache-2.0
#include "acquire/calibrate/uniformity.h"

#include <algorithm>
#include <cmath>

#include "core/errors.h"
#include "core/run_context.h"

namespace refield {

namespace {

constexpr int frames_per_mean = 8;

Photograph above_black(CalibrationBench& bench, const CameraCalibration& camera,
                       const std::vector<Seconds>& exposures, const DriveImage& image,
                       const Photograph& black, const RunContext& run) {
  bench.show(image);
  Photograph shot = photograph(bench, camera, exposures, frames_per_mean, run);
  for (std::size_t i = 0; i < shot.radiance.values.size(); ++i) {
    shot.radiance.values[i] -= black.radiance.values[i];
    shot.sigma.values[i] = std::hypot(shot.sigma.values[i], black.sigma.values[i]);
  }
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
    throw InputError("the flat field cannot be measured: the image varies by " +
                     std::to_string(100.0 * result.texture) +
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
        throw InputError("the screen's uniformity cannot be measured: a white square in column " +
                         std::to_string(i + 1) + " and row " + std::to_string(j + 1) +
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
