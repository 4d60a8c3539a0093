// SPDX-License-Identifier: Apache-2.0
#include "simulate/monitor_model.h"

#include <cmath>
#include <string>

#include "core/errors.h"
#include "simulate/falloff.h"

namespace refield {

void MonitorModel::check() const {
  const auto require = [](bool good, const char* what) {
    if (!good) throw InputError(std::string("monitor: ") + what);
  };
  for (double g : gamma) require(g >= 0.5 && g <= 5.0, "gamma must lie in 0.5 to 5");
  require(black_level >= 0.0 && black_level < 1.0,
          "black_level is a fraction of white and must lie in 0 to 1");
  require(white_radiance > 0.0 && std::isfinite(white_radiance), "white_radiance must be positive");
  require(falloff >= 0.0 && falloff < 1.0, "falloff must lie in 0 to 1");
  require(dimming >= 0.0 && dimming < 1.0, "dimming must lie in 0 to 1");
  require(pwm_hz == 0.0 || (pwm_hz >= 1.0 && pwm_hz <= 1e6), "pwm_hz must be 0 or lie in 1 to 1000000");
  require(pwm_depth >= 0.0 && pwm_depth <= 1.0, "pwm_depth must lie in 0 to 1");
  for (double change : drift)
    require(change > -1.0 && change <= 10.0, "drift must lie above -1 and up to 10");
  require(drift_settling >= 0.0 && drift_settling <= 100.0, "drift_settling must lie in 0 to 100");
  require(refresh_interval.count() >= 1e-4 && refresh_interval.count() <= 1.0,
          "refresh must lie in 1 to 10000 Hz");
  require(latency.count() >= 0.0 && latency.count() <= 10.0, "latency must lie in 0 to 10 s");
  require(settling.count() >= 0.0 && settling.count() <= 10.0, "settling must lie in 0 to 10 s");
}

double MonitorModel::gain(int channel, double done) const {
  const double share =
      drift_settling > 0.0 ? std::expm1(-done / drift_settling) / std::expm1(-1.0 / drift_settling) : done;
  return 1.0 + drift[channel] * share;
}

double MonitorModel::backlight(TimePoint start, TimePoint end) const {
  if (pwm_hz == 0.0 || pwm_depth == 0.0 || end <= start) return 1.0;
  // The integral of ±1 over whole periods is zero; within one it is a triangle.
  const auto integral = [&](TimePoint t) {
    const double periods = Seconds(t.time_since_epoch()).count() * pwm_hz;
    const double phase = periods - std::floor(periods);
    return (phase < 0.5 ? phase : 1.0 - phase) / pwm_hz;
  };
  return 1.0 + pwm_depth * (integral(end) - integral(start)) / Seconds(end - start).count();
}

std::array<std::vector<double>, 3> MonitorModel::tone_curve() const {
  std::array<std::vector<double>, 3> curve;
  for (int c = 0; c < 3; ++c)
    for (int level = 0; level < 256; ++level)
      curve[c].push_back(white_radiance *
                         (black_level + (1.0 - black_level) * std::pow(level / 255.0, gamma[c])));
  return curve;
}

LightMap MonitorModel::emitted(const DriveImage& image) const {
  const auto curve = tone_curve();
  LightMap light{Image(image.width, image.height, 3), Parameterisation::monitor};
  if (image.levels.size() != light.radiance.values.size())
    throw InputError("monitor: a drive image of " + std::to_string(image.width) + "×" +
                     std::to_string(image.height) + " texels has " + std::to_string(image.levels.size()) +
                     " levels; three a texel are needed");
  const Falloff screen{image.width, image.height, falloff};
  double sum = 0.0;
  std::size_t i = 0;
  for (int y = 0; y < image.height; ++y)
    for (int x = 0; x < image.width; ++x) {
      const double share = screen.at(x, y);
      for (int c = 0; c < 3; ++c, ++i) {
        const double radiance = curve[c][image.levels[i]];
        sum += radiance;
        light.radiance.values[i] = static_cast<float>(radiance * share);
      }
    }
  if (dimming > 0.0) {
    const double mean = sum / (white_radiance * static_cast<double>(image.levels.size()));
    for (float& value : light.radiance.values) value *= static_cast<float>(1.0 - dimming * mean);
  }
  return light;
}

}  // namespace refield
