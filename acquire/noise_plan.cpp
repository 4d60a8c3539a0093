// SPDX-License-Identifier: Apache-2.0
// Exposures planned from the scene's dynamic range and the camera's noise.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

#include "acquire/exposure_plan.h"
#include "core/errors.h"

namespace refield {

namespace {

constexpr double head_room = 0.9;  // of saturation: a sample brighter than metered must not clip at once

/// What a sample of the camera can hold and adds, in electrons.
struct Well {
  double saturation;
  double floor_variance;
};

Well well_of(const CameraCalibration& calibration, double gain) {
  const double per_dn = calibration.electrons_per_dn / gain;
  const auto top = static_cast<std::size_t>(calibration.saturation_dn);
  return {(calibration.linear_from_dn[top] - calibration.black_level_dn) * per_dn,
          calibration.read_noise_electrons * calibration.read_noise_electrons + per_dn * per_dn / 12.0};
}

/// What exposures are whole multiples of; 0: anything.
Seconds unit_of(const ExposurePlanOptions& options, const CameraDescription& camera) {
  return options.multiple_of.count() > 0.0 ? options.multiple_of : camera.exposure_step;
}

Seconds rounded_down(Seconds time, const ExposurePlanOptions& options, const CameraDescription& camera) {
  const Seconds unit = unit_of(options, camera);
  if (unit.count() > 0.0) {
    constexpr double rounding = 1e-9;
    time = unit * std::max(1.0, std::floor(time / unit + rounding));
  }
  return std::clamp(time, camera.shortest_exposure, camera.longest_exposure);
}

/// A value that was measured, not one between two: it names a pixel's radiance. Reorders `values`.
double value_at_quantile(std::vector<float>& values, double q) {
  const auto rank = static_cast<std::ptrdiff_t>(q * static_cast<double>(values.size() - 1));
  std::ranges::nth_element(values, values.begin() + rank);
  return values[rank];
}

}  // namespace

SceneRange meter_range(const CameraDescription& camera, const CameraCalibration& calibration,
                       const Probe& probe) {
  constexpr double ratio = 8.0;
  constexpr int most_probes = 4;
  constexpr double typical_light = 0.2;  // of white, the mean of natural patterns
  std::vector<RawFrame> frames;
  Seconds exposure = shortest_useful_exposure(camera, calibration, probe);
  for (int i = 0; i < most_probes; ++i) {
    frames.push_back(probe(exposure));
    if (exposure == camera.longest_exposure) break;
    exposure = std::min(exposure * ratio, camera.longest_exposure);
  }
  std::vector<float> radiance = merge_exposures(frames, calibration).radiance.values;
  SceneRange range;
  range.bright = value_at_quantile(radiance, 0.999);
  // Places that are black even under white have no noise worth asking for.
  range.dark = typical_light * std::max<double>(value_at_quantile(radiance, 0.05), range.bright * 1e-4);
  return range;
}

double predicted_noise(double radiance, const std::vector<Seconds>& exposures,
                       const CameraCalibration& calibration, double gain, int frames_per_exposure) {
  const Well well = well_of(calibration, gain);
  double information = 0.0;
  for (Seconds exposure : exposures) {
    const double per_radiance = exposure.count() * calibration.electrons_per_radiance_second;
    const double electrons = radiance * per_radiance;
    if (electrons > well.saturation) continue;
    information += frames_per_exposure * per_radiance * per_radiance / (electrons + well.floor_variance);
  }
  return information > 0.0 ? 1.0 / (std::sqrt(information) * radiance)
                           : std::numeric_limits<double>::infinity();
}

NoisePlan fewest_exposures(const SceneRange& range, const ExposurePlanOptions& options,
                           const CameraDescription& camera, const CameraCalibration& calibration, double gain,
                           int frames_per_exposure) {
  options.check();
  if (!(range.dark > 0.0 && range.dark <= range.bright && options.relative_noise > 0.0))
    throw InputError("exposures cannot be planned for radiance from " + std::to_string(range.dark) + " to " +
                     std::to_string(range.bright) + " with a relative noise of " +
                     std::to_string(options.relative_noise));
  const double bound = options.relative_noise;
  const double full =
      head_room * well_of(calibration, gain).saturation / calibration.electrons_per_radiance_second;
  NoisePlan plan;
  plan.range = range;
  const auto noise_with = [&](double radiance, std::optional<Seconds> further = std::nullopt) {
    std::vector<Seconds> exposures = plan.exposures;
    if (further) exposures.push_back(*further);
    return predicted_noise(radiance, exposures, calibration, gain, frames_per_exposure);
  };
  plan.exposures.push_back(rounded_down(Seconds(full / range.bright), options, camera));
  constexpr std::size_t most_exposures = 16;
  while (noise_with(range.dark) > bound && plan.exposures.size() < most_exposures) {
    // The darkest radiance that is carried already: noise grows as light falls.
    double carried = range.bright, lost = range.dark;
    for (int i = 0; i < 60; ++i) {
      const double middle = std::sqrt(carried * lost);
      (noise_with(middle) <= bound ? carried : lost) = middle;
    }
    Seconds next = rounded_down(Seconds(full / carried), options, camera);
    if (next <= plan.exposures.back()) break;  // the camera's end, or one exposure is too noisy by itself
    // No longer than the dark end needs.
    Seconds enough = next, short_of = plan.exposures.back();
    for (int i = 0; i < 40 && noise_with(range.dark, next) <= bound; ++i) {
      const Seconds middle(std::sqrt(enough.count() * short_of.count()));
      (noise_with(range.dark, middle) <= bound ? enough : short_of) = middle;
    }
    const Seconds rounded_up = rounded_down(enough + unit_of(options, camera), options, camera);
    plan.exposures.push_back(std::max(plan.exposures.back(), std::min(next, rounded_up)));
  }
  constexpr int probes = 200;
  for (int i = 0; i <= probes; ++i)
    plan.worst_noise = std::max(
        plan.worst_noise, noise_with(range.dark * std::pow(range.bright / range.dark, i / double{probes})));
  plan.reached = plan.worst_noise <= bound * 1.001;
  return plan;
}

std::string NoisePlan::sentence() const {
  char text[256];
  std::snprintf(text, sizeof text,
                "%zu exposure%s cover%s the scene's range of 1:%.0f with noise of at most %.1f %%%s",
                exposures.size(), exposures.size() == 1 ? "" : "s", exposures.size() == 1 ? "s" : "",
                range.bright / range.dark, 100.0 * worst_noise,
                reached ? "" : ", above the limit: take more frames per exposure");
  return text;
}

}  // namespace refield
