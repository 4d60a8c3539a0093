// SPDX-License-Identifier: Apache-2.0

#define TOML_EXCEPTIONS 1

#include <toml++/toml.h>

#include <cmath>
#include <sstream>

#include "acquire/capture/capture.h"
#include "acquire/capture/exposure_plan.h"
#include "acquire/hdr/hdr_merge.h"
#include "core/base/config_file.h"
#include "core/base/number_text.h"
#include "core/base/run_context.h"
#include "core/session/journal.h"

namespace refield {

// plan.toml: what a capture is to become, so that it can be resumed only as the same capture.

namespace {

constexpr const char* format_name = "refield capture plan";
constexpr int format_version = 1;
constexpr int max_ambient_count = 64;

template <class T>
std::string_view bytes_of(const std::vector<T>& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)};
}

std::uint32_t checksum_of(const RelativeMap& map, std::uint32_t before) {
  return map.empty() ? before
                     : crc32_of(bytes_of(map.values), before + static_cast<std::uint32_t>(map.columns));
}

/// Of what decides samples and light; timing decides only which frames are taken.
std::uint32_t checksum_of(const CameraCalibration& camera, const MonitorCalibration& monitor) {
  const std::vector<double> numbers = {
      static_cast<double>(camera.bits), camera.black_level_dn,       camera.saturation_dn,
      camera.electrons_per_dn,          camera.read_noise_electrons, camera.electrons_per_radiance_second};
  std::uint32_t crc = crc32_of(bytes_of(camera.linear_from_dn), crc32_of(bytes_of(numbers)));
  for (const auto& table : monitor.radiance_from_level) crc = crc32_of(bytes_of(table), crc);
  return checksum_of(monitor.uniformity, checksum_of(camera.flat_field, crc));
}

/// In the order of MaskSource::Kind.
constexpr const char* mask_sources[] = {"none", "painted", "automatic"};

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
  if (!camera.exposures.empty()) {
    const auto above = std::ranges::upper_bound(camera.exposures, time);
    return above == camera.exposures.begin() ? *above : *(above - 1);
  }
  const Seconds unit = unit_of(options, camera);
  if (unit.count() > 0.0) {
    constexpr double rounding = 1e-9;
    time = unit * std::max(1.0, std::floor(time / unit + rounding));
  }
  return std::clamp(time, camera.shortest_exposure, camera.longest_exposure);
}

}  // namespace

void CaptureRequest::check(const CameraDescription& described, const IlluminatorDescription& display,
                           const RunContext& run) const {
  if (lights.empty()) throw InputError("there are no light maps; give at least one");
  std::set<std::string> names = {"ambient", "mask"};
  Progress progress(run, "checking lights", lights.size());
  for (const CaptureLight& light : lights) {
    run.throw_if_stopped();
    if (light.name.empty() || light.name.front() == '.' ||
        light.name.find_first_of("/\t\n\r") != std::string::npos)
      throw InputError(light.wanted, ": '", light.name, "' cannot name a frame; rename the file");
    if (!names.insert(light.name).second)
      throw InputError(light.wanted, ": two frames would be named '", light.name, "'; rename one");
    // Read whole, so that a damaged or impossible light is found before the first photograph, not in the
    // middle.
    const Image wanted = read_light_map(light.wanted, Parameterisation::monitor, run).radiance;
    if (wanted.width != display.width || wanted.height != display.height)
      throw InputError(light.wanted, ": is ", wanted.width, "×", wanted.height, " texels, the monitor shows ",
                       display.width, "×", display.height, "; make the light map at that size");
    progress.advance();
  }
  camera.check("camera calibration");
  monitor.check("monitor calibration");
  if (timing) timing->check("timing calibration");
  if (camera.bits != described.bits)
    throw InputError("the calibration is for ", camera.bits, " bits, camera '", described.name, "' gives ",
                     described.bits, "; calibrate it in this mode");
  if (frames_per_exposure < 1 || frames_per_exposure > 64)
    throw InputError("frames per exposure is ", frames_per_exposure, "; give 1 to 64");
  if (ambient_repeats < 0 || ambient_repeats > max_ambient_count)
    throw InputError("the number of ambient repeats is ", ambient_repeats,
                     "; give 1 to 64, or 0 for a number by that of the lights");
  if (!(gain > 0.0)) throw InputError("the gain must be above zero");
  if (mask.kind == MaskSource::Kind::painted) read_mask(mask.file, described.width, described.height);
  if (mask.kind == MaskSource::Kind::automatic && !mask.file.empty()) {
    const Image background = read_photograph(mask.file).radiance;
    if (background.width != described.width || background.height != described.height)
      throw InputError(mask.file, ": the background is ", shape_text(background), ", the camera takes ",
                       described.width, "×", described.height, "; take it with this camera");
  }
  if (!exposures.empty()) {
    check_exposures(exposures, described);
    require_listed_exposures(exposures, described);
  } else {
    exposure_plan.check();
  }
}

int usual_ambient_count(int training_frames) {
  return std::clamp(training_frames / 8, 4, max_ambient_count);
}

int CaptureRequest::ambient_count() const {
  if (ambient_repeats > 0) return ambient_repeats;
  const auto training = static_cast<int>(
      std::ranges::count(lights, FrameRole::train, [](const CaptureLight& light) { return light.role; }));
  return usual_ambient_count(training * frames_per_exposure);
}

std::string checksum_of(const fs::path& file) {
  return crc32_text(inspect_file(file.parent_path(), file.filename().string()).crc32);
}

std::string capture_plan_text(const CaptureRequest& request, const std::vector<Seconds>& exposures,
                              const CameraDescription& camera, const IlluminatorDescription& display) {
  toml::array times;
  for (Seconds time : exposures) times.push_back(time.count());
  toml::table how{{"seconds", times},
                  {"metered", request.is_metered()},
                  {"frames_per_exposure", request.frames_per_exposure},
                  {"ambient_repeats", request.ambient_count()},
                  {"gain", request.gain}};
  if (request.is_metered()) {
    if (request.exposure_plan.relative_noise > 0.0) {
      how.insert("relative_noise", request.exposure_plan.relative_noise);
    } else {
      how.insert("count", request.exposure_plan.count);
      how.insert("ratio", request.exposure_plan.ratio);
    }
    how.insert("multiple_of", request.exposure_plan.multiple_of.count());
  }
  toml::table mask{{"source", mask_sources[static_cast<std::size_t>(request.mask.kind)]}};
  if (!request.mask.file.empty()) mask.insert("crc32", checksum_of(request.mask.file));
  toml::array lights;
  for (const CaptureLight& light : request.lights)
    lights.push_back(toml::table{{"name", light.name},
                                 {"role", std::string(name_of(light.role))},
                                 {"kind", light.kind},
                                 {"wanted_crc32", checksum_of(light.wanted)}});
  toml::table plan{
      {"format", format_name},
      {"version", format_version},
      {"rig", request.rig},
      {"camera", toml::table{{"name", camera.name}, {"width", camera.width}, {"height", camera.height}}},
      {"display", toml::table{{"name", display.name}, {"width", display.width}, {"height", display.height}}},
      {"calibration", toml::table{{"crc32", crc32_text(checksum_of(request.camera, request.monitor))}}},
      {"exposures", how},
      {"mask", mask},
      {"files",
       toml::table{{"keep_raw", request.keep_raw}, {"half_precision", request.precision == Precision::half}}},
      {"light", lights}};
  if (!request.stop_rule.empty()) plan.insert("stop", request.stop_rule);
  std::ostringstream text;
  text << plan << "\n";
  return text.str();
}

std::vector<Seconds> exposures_of_plan(const fs::path& plan) {
  const ConfigFile file(plan, "capture plan", "docs/reference/capture-session-format.md");
  ConfigSection section = file.section("exposures");
  std::vector<double> seconds;
  section.require("seconds");
  section.numbers("seconds", seconds, 0.0, ConfigSection::unlimited);
  std::vector<Seconds> exposures;
  for (const double time : seconds) exposures.emplace_back(time);
  return exposures;
}

// Exposures planned from the scene's dynamic range and the camera's noise.

SceneRange meter_range(const CameraDescription& camera, const CameraCalibration& calibration,
                       const Probe& probe) {
  constexpr double ratio = 8.0;
  constexpr int max_probes = 4;
  constexpr double typical_light = 0.2;  // of white, the mean of natural patterns
  std::vector<RawFrame> frames;
  Seconds exposure = shortest_useful_exposure(camera, calibration, probe);
  for (int i = 0; i < max_probes; ++i) {
    frames.push_back(probe(exposure));
    if (exposure == camera.longest_exposure) break;
    exposure = std::min(exposure * ratio, camera.longest_exposure);
  }
  const std::vector<float> radiance = merge_exposures(frames, calibration).radiance.values;
  SceneRange range;
  range.bright = quantile_of(radiance, 0.999);
  // Places that are black even under white have no noise worth asking for.
  range.dark = typical_light * std::max<double>(quantile_of(radiance, 0.05), range.bright * 1e-4);
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

NoisePlan min_exposures(const SceneRange& range, const ExposurePlanOptions& options,
                        const CameraDescription& camera, const CameraCalibration& calibration, double gain,
                        int frames_per_exposure) {
  options.check();
  if (!(range.dark > 0.0 && range.dark <= range.bright && options.relative_noise > 0.0))
    throw InputError("exposures cannot be planned for radiance from ", range.dark, " to ", range.bright,
                     " with a relative noise of ", options.relative_noise);
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
  constexpr std::size_t max_exposures = 16;
  while (noise_with(range.dark) > bound && plan.exposures.size() < max_exposures) {
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
    const auto listed = std::ranges::lower_bound(camera.exposures, enough);
    const Seconds rounded_up = listed != camera.exposures.end()
                                   ? *listed
                                   : rounded_down(enough + unit_of(options, camera), options, camera);
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
  return formatted("%zu exposure%s cover%s the scene's range of 1:%.0f with noise of at most %.1f %%%s",
                   exposures.size(), exposures.size() == 1 ? "" : "s", exposures.size() == 1 ? "s" : "",
                   range.bright / range.dark, 100.0 * worst_noise,
                   reached ? "" : ", above the limit: take more frames per exposure");
}

}  // namespace refield
