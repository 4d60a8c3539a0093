// SPDX-License-Identifier: Apache-2.0
#include "acquire/capture/exposure_plan.h"

#include <cmath>

#include "core/base/number_text.h"

namespace refield {

namespace {

std::string text(Seconds time) {
  return formatted("%.6g s", time.count());
}

Seconds rounded_to_multiple(Seconds time, Seconds period) {
  if (period.count() <= 0.0) return time;
  return period * std::max(1.0, std::round(time / period));
}

}  // namespace

void ExposurePlanOptions::check() const {
  if (count < 1 || count > 16) throw InputError("the number of exposures is ", count, "; give 1 to 16");
  if (!(ratio > 1.0 && ratio <= 64.0))
    throw InputError("the ratio of exposures is ", ratio, "; give more than 1 and at most 64");
  if (!(relative_noise >= 0.0 && relative_noise < 1.0))
    throw InputError("the relative noise to plan for is ", relative_noise,
                     "; give a fraction such as 0.02, or 0 for a fixed series");
  if (!(shortest.count() >= 0.0 && multiple_of.count() >= 0.0))
    throw InputError("exposure times must not be negative");
}

double quantile_of(std::vector<float> values, double q) {
  const auto rank = static_cast<std::ptrdiff_t>(q * static_cast<double>(values.size() - 1));
  std::ranges::nth_element(values, values.begin() + rank);
  return values[rank];
}

std::vector<Seconds> exponential_exposures(const ExposurePlanOptions& options,
                                           const CameraDescription& camera) {
  options.check();
  if (options.shortest.count() <= 0.0) throw InputError("the shortest exposure must be above zero");
  std::vector<Seconds> exposures;
  const Seconds first = rounded_to_multiple(options.shortest, options.multiple_of);
  for (int i = 0; i < options.count; ++i)
    exposures.push_back(rounded_to_multiple(first * std::pow(options.ratio, i), options.multiple_of));
  check_exposures(exposures, camera);
  return exposures;
}

void check_exposures(const std::vector<Seconds>& exposures, const CameraDescription& camera) {
  if (exposures.empty()) throw InputError("the plan has no exposures; give at least one");
  for (std::size_t i = 0; i < exposures.size(); ++i) {
    const bool grows = i == 0 || exposures[i] > exposures[i - 1];
    if (!(exposures[i].count() > 0.0 && std::isfinite(exposures[i].count())) || !grows)
      throw InputError("exposure ", i + 1, " of the plan is ", text(exposures[i]),
                       "; give times above zero in growing order");
    // Times pass through decimal text and back: allow for its rounding.
    constexpr double rounding = 1e-9;
    if (exposures[i] < camera.shortest_exposure * (1.0 - rounding) ||
        exposures[i] > camera.longest_exposure * (1.0 + rounding))
      throw InputError("exposure ", i + 1, " of the plan, ", text(exposures[i]),
                       ", lies outside the range of camera '", camera.name, "', ",
                       text(camera.shortest_exposure), " to ", text(camera.longest_exposure),
                       "; plan fewer exposures, a smaller ratio or another shortest exposure");
  }
}

void require_listed_exposures(const std::vector<Seconds>& exposures, const CameraDescription& camera) {
  constexpr double rounding = 0.01;  // 0.0167 means 1/60
  if (camera.exposures.empty()) return;
  for (std::size_t i = 0; i < exposures.size(); ++i) {
    const Seconds wanted = exposures[i];
    if (std::abs(settable_exposure(wanted, camera) / wanted - 1.0) <= rounding) continue;
    const auto above = std::ranges::upper_bound(camera.exposures, wanted);
    std::string nearest;
    if (above != camera.exposures.begin()) nearest = text(*(above - 1));
    if (above != camera.exposures.end()) nearest += (nearest.empty() ? "" : " and ") + text(*above);
    throw InputError("exposure ", i + 1, " of the plan, ", text(wanted), ", is no shutter time of camera '",
                     camera.name, "'; the nearest are ", nearest);
  }
}

Seconds settable_exposure(Seconds time, const CameraDescription& camera) {
  if (!camera.exposures.empty())
    return *std::ranges::min_element(camera.exposures, {},
                                     [&](Seconds listed) { return std::abs(std::log(listed / time)); });
  if (camera.exposure_step.count() <= 0.0) return time;
  const Seconds nearest = rounded_to_multiple(time, camera.exposure_step);
  return std::clamp(nearest, camera.shortest_exposure, camera.longest_exposure);
}

std::vector<Seconds> settable_exposures(const std::vector<Seconds>& exposures,
                                        const CameraDescription& camera) {
  std::vector<Seconds> settable;
  for (Seconds exposure : exposures)
    if (const Seconds next = settable_exposure(exposure, camera); settable.empty() || next > settable.back())
      settable.push_back(next);
  return settable;
}

Seconds shortest_useful_exposure(const CameraDescription& camera, const CameraCalibration& calibration,
                                 const Probe& probe) {
  constexpr double clipped_allowed = 1e-3;
  constexpr double head_room = 0.8;  // of the range: light maps may be a little brighter than the probe
  constexpr double useful_signal = 0.05;
  constexpr int max_probes = 12;
  const auto linear_at = [&](double dn) {
    return calibration.linear_from_dn[static_cast<std::size_t>(dn)] - calibration.black_level_dn;
  };
  const double full = linear_at(calibration.saturation_dn);
  Seconds exposure =
      std::sqrt(camera.shortest_exposure.count() * camera.longest_exposure.count()) * Seconds(1.0);
  for (int attempt = 0; attempt < max_probes; ++attempt) {
    if (!camera.exposures.empty()) exposure = settable_exposure(exposure, camera);
    const RawFrame frame = probe(exposure);
    const double bright = quantile_of({frame.samples.begin(), frame.samples.end()}, 1.0 - clipped_allowed);
    const double signal = linear_at(bright) / full;
    const bool clipped = bright >= calibration.saturation_dn;
    const double factor = clipped ? 1.0 / 16.0 : head_room / std::max(signal, head_room / 64.0);
    const Seconds next = std::clamp(exposure * factor, camera.shortest_exposure, camera.longest_exposure);
    const bool at_the_end =
        next == exposure || (!camera.exposures.empty() && settable_exposure(next, camera) == exposure);
    if (at_the_end && !clipped && signal <= 0.0)
      throw InputError("camera '", camera.name, "' sees no light at its longest exposure, ", text(exposure),
                       "; check the lens cap, the monitor and the aim");
    exposure = next;
    // A weak probe measures mostly noise: go on until the answer rests on a good signal.
    if (at_the_end || (!clipped && signal >= useful_signal)) break;
  }
  return exposure;
}

std::vector<std::string> wasted_exposures(const std::vector<Seconds>& exposures,
                                          const std::vector<double>& useful) {
  constexpr double negligible = 5e-4;  // of the samples: fewer than a small highlight
  std::vector<std::string> sentences;
  for (std::size_t i = 0; i < exposures.size(); ++i)
    if (useful[i] < negligible)
      sentences.push_back("the exposure of " + text(exposures[i]) +
                          " adds no information to the others; a capture without it would be faster");
  return sentences;
}

}  // namespace refield
