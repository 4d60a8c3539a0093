// SPDX-License-Identifier: Apache-2.0
#include "acquire/calibrate/bench.h"

#include <cmath>

#include "core/base/number_text.h"

namespace refield {

namespace {
constexpr int max_control_latency = 12;  // frames; real cameras need 2 to 4
}

CalibrationBench::CalibrationBench(Camera& camera, Illuminator& illuminator, Trigger* trigger, double gain,
                                   Seconds patience)
    : camera_(camera),
      illuminator_(illuminator),
      trigger_(trigger),
      gain_(gain),
      patience_(patience),
      camera_description_(camera.describe()),
      display_description_(illuminator.describe()) {
  timing_.display_latency = patience;
  timing_.control_latency_frames = max_control_latency;
}

void CalibrationBench::use(const TimingCalibration& timing) {
  timing_ = timing;
  pairing_.reset();
}

void CalibrationBench::show(const DriveImage& image) {
  if (!pairing_) pairing_.emplace(camera_, illuminator_, trigger_, timing_);
  pairing_->show(image);
}

void CalibrationBench::show(std::uint8_t grey_level) {
  show(uniform_drive(display_description_.width, display_description_.height, grey_level));
}

RawFrame CalibrationBench::frame(Seconds exposure, const RunContext& run) {
  run.throw_if_stopped();
  return pairing_.value().photograph(exposure, gain_);
}

TimePoint CalibrationBench::show_at_once(std::uint8_t grey_level) {
  pairing_.reset();
  return illuminator_.show(
      uniform_drive(display_description_.width, display_description_.height, grey_level));
}

TimePoint CalibrationBench::set_exposure(Seconds exposure) {
  pairing_.reset();
  return camera_.set_exposure(exposure, gain_);
}

RawFrame CalibrationBench::next_frame(Seconds exposure, const RunContext& run) {
  run.throw_if_stopped();
  constexpr Seconds slack{5.0};  // frames on their way may have a longer exposure
  if (trigger_) trigger_->fire();
  return camera_.next_frame(exposure + 4 * camera_description_.frame_interval + slack);
}

SampleMoments sample_moments(CalibrationBench& bench, Seconds exposure, int count,
                             const std::vector<float>* linear, std::span<const std::uint32_t> steadied,
                             double black, const RunContext& run) {
  std::vector<std::vector<float>> frames;
  std::vector<double> level;
  SampleMoments moments;
  for (int i = 0; i < count; ++i) {
    const RawFrame frame = bench.frame(exposure, run);
    moments.exposure = frame.exposure;
    std::vector<float>& values = frames.emplace_back(frame.samples.begin(), frame.samples.end());
    if (linear)
      for (std::size_t s = 0; s < values.size(); ++s) values[s] = (*linear)[frame.samples[s]];
    level.push_back(mean_over(values, steadied) - black);
  }
  double mean_level = 0.0;
  for (double l : level) mean_level += l / count;
  const std::size_t size = frames.front().size();
  moments.mean.resize(size);
  moments.variance.resize(size);
  for (int i = 0; i < count && mean_level > 0.0; ++i)
    for (float& value : frames[i])
      value = static_cast<float>(black + (value - black) * mean_level / level[i]);
  for (std::size_t s = 0; s < size; ++s) {
    double sum = 0.0;
    for (const auto& values : frames) sum += values[s];
    const double mean = sum / count;
    double squares = 0.0;
    for (const auto& values : frames) squares += (values[s] - mean) * (values[s] - mean);
    moments.mean[s] = static_cast<float>(mean);
    moments.variance[s] = static_cast<float>(squares / std::max(1, count - 1));
  }
  return moments;
}

std::vector<Seconds> exposure_series(const CameraDescription& camera, Seconds low, Seconds high, int count,
                                     Seconds unit) {
  const Seconds shortest = std::clamp(low, camera.shortest_exposure, camera.longest_exposure);
  const Seconds longest = std::clamp(high, shortest, camera.longest_exposure);
  std::vector<Seconds> series;
  for (int i = 0; i < count; ++i) {
    Seconds time = shortest * std::pow(longest / shortest, count > 1 ? i / (count - 1.0) : 0.0);
    if (unit.count() > 0.0) {
      time = unit * std::max(1.0, std::round(time / unit));
      if (time > camera.longest_exposure) time = unit * std::floor(camera.longest_exposure / unit);
    }
    time = settable_exposure(time, camera);
    if (series.empty() || time > series.back()) series.push_back(time);
  }
  return series;
}

namespace {

constexpr double target_share = 0.6;     // of full scale, for the brightest hundredth
constexpr double least_response = 0.05;  // of full scale
constexpr double max_room_light = 0.75;  // of the target, where the display is dimmed
constexpr Seconds longest_useful{2.0};   // a calibration has hundreds of frames

double brightness(CalibrationBench& bench, Seconds exposure, const RunContext& run) {
  const RawFrame frame = bench.frame(exposure, run);
  const double full = (1 << bench.camera().bits) - 1;
  return quantile_of({frame.samples.begin(), frame.samples.end()}, 0.99) / full;
}

/// The exposure at which the pattern shown has the target brightness, within the camera's range.
Seconds meter_exposure(CalibrationBench& bench, const RunContext& run) {
  Seconds low = bench.camera().shortest_exposure;
  Seconds high = std::max(low, std::min(bench.camera().longest_exposure, longest_useful));
  for (int i = 0; i < 10; ++i) {
    const Seconds middle(std::sqrt(low.count() * high.count()));
    (brightness(bench, middle, run) > target_share ? high : low) = middle;
  }
  // Of listed times, the longest that is not too bright.
  if (!bench.camera().exposures.empty()) return settable_exposure(low, bench.camera());
  return Seconds(std::sqrt(low.count() * high.count()));
}

std::string percent_text(double share) {
  return formatted("%.1f %%", 100.0 * share);
}

}  // namespace

Metering meter(CalibrationBench& bench, Seconds wanted, const RunContext& run) {
  Metering result;
  bench.show(result.level);
  result.exposure = meter_exposure(bench, run);
  constexpr std::uint8_t lowest_level = 24;
  constexpr double usual_gamma = 2.2;
  for (int attempt = 0; attempt < 3 && result.exposure < wanted * 0.7 && result.level > lowest_level;
       ++attempt) {
    const double dimmed = result.level * std::pow(result.exposure / wanted, 1.0 / usual_gamma);
    const auto level = static_cast<std::uint8_t>(std::max<double>(lowest_level, std::round(dimmed)));
    bench.show(level);
    const Seconds exposure = meter_exposure(bench, run);
    bench.show(0);
    if (brightness(bench, exposure, run) > max_room_light * target_share) break;
    result.level = level;
    result.exposure = exposure;
  }
  bench.show(result.level);
  const double reached = brightness(bench, result.exposure, run);
  if (reached > 0.9)
    throw InputError("camera '", bench.camera().name, "': ", percent_text(reached),
                     " of full scale at its shortest exposure: too bright; close the aperture, lower the "
                     "display's brightness or darken the room");
  constexpr int frames = 4;
  const auto light = sample_moments(bench, result.exposure, frames, nullptr, {}, 0.0, run).mean;
  bench.show(0);
  const auto dark = sample_moments(bench, result.exposure, frames, nullptr, {}, 0.0, run).mean;
  std::vector<float> response(light.size());
  for (std::size_t s = 0; s < light.size(); ++s) response[s] = light[s] - dark[s];
  const double full = (1 << bench.camera().bits) - 1;
  const double most = quantile_of(response, 0.99);
  if (most < least_response * full)
    throw InputError("camera '", bench.camera().name, "': the display's light changes the image by ",
                     percent_text(most / full), " of full scale at an exposure of ", result.exposure.count(),
                     " s, at least ", percent_text(least_response),
                     " are needed: the scene is too dark, or the room is too bright compared with the "
                     "display. Check the lens cap and the framing, open the aperture, raise the display's "
                     "brightness or the camera's gain, darken the room");
  for (std::size_t s = 0; s < response.size(); ++s)
    if (response[s] > 0.2 * most) result.lit.push_back(static_cast<std::uint32_t>(s));
  result.lit_dn = mean_over(light, result.lit);
  result.dark_dn = mean_over(dark, result.lit);
  return result;
}

}  // namespace refield
