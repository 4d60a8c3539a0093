// SPDX-License-Identifier: Apache-2.0
#include "acquire/calibrate/calibrate.h"

#include <cmath>

#include "core/base/number_text.h"

namespace refield {

namespace {

TimingCalibration timing_so_far(const RigMeasurements& rig, Seconds patience) {
  TimingCalibration timing;
  timing.display_latency = patience;
  timing.control_latency_frames = rig.control_latency.frames;
  timing.refresh_period = rig.banding.refresh_period;
  timing.exposure_unit = rig.banding.exposure_unit;
  return timing;
}

CameraCalibration camera_of(const RigMeasurements& rig, const RelativeMap& flat_field) {
  CameraCalibration camera;
  camera.bits = rig.response.bits;
  camera.linear_from_dn = rig.response.linear_from_dn;
  camera.black_level_dn = rig.response.black_level_dn;
  camera.saturation_dn = rig.response.saturation_dn;
  camera.electrons_per_dn = rig.noise.electrons_per_dn;
  camera.read_noise_electrons = rig.noise.read_noise_electrons;
  camera.flat_field = flat_field;
  camera.check("measured camera calibration");
  return camera;
}

std::vector<std::string> warnings_of(const RigMeasurements& rig) {
  std::vector<std::string> warnings;
  const auto warn = [&](bool when, const std::string& text) {
    if (when) warnings.push_back(text);
  };
  const CameraResponse& response = rig.response;
  warn(!response.saturation_seen,
       formatted("No sample reached saturation, so full scale, %.0f DN, is used. If the sensor saturates "
                 "below it, bright regions will be wrong without a warning: calibrate again with a longer "
                 "exposure or more light.",
                 response.saturation_dn));
  warn(rig.black.clipped > 0.01,
       formatted("%.0f %% of the samples are 0 in the dark: the camera clips noise below zero, so dark "
                 "regions are too bright. Raise its black level (often called brightness or offset).",
                 100.0 * rig.black.clipped));
  warn(response.darkest_share > 0.05,
       formatted("The response is measured from %.0f %% of the range on and interpolated below: shorter "
                 "exposures or a wider range of brightness in the scene would show more.",
                 100.0 * response.darkest_share));
  warn(std::abs(rig.noise.excess_at_the_top) > 0.2,
       formatted(
           "The brightest samples are %.0f %% %s noisy than photons are: %s.",
           100.0 * std::abs(rig.noise.excess_at_the_top), rig.noise.excess_at_the_top > 0.0 ? "more" : "less",
           rig.noise.excess_at_the_top > 0.0 ? "light or camera flicker from place to place"
                                             : "the camera smooths or compresses; choose a raw format"));
  if (!rig.banding.ripples.empty()) {
    const Ripple& ripple = rig.banding.ripples.front();
    warn(true, formatted("The display flickers at %.1f Hz by %.1f %%: use exposure times that are whole "
                         "multiples of %.4g s, or brightness varies between frames (bands with a rolling "
                         "shutter). The capture does this automatically.",
                         ripple.hz, 100.0 * ripple.depth, rig.timing.exposure_unit.count()));
  }
  warn(rig.banding.noise > 0.01,
       formatted("Brightness varies by %.1f %% from frame to frame without a period: daylight, another light "
                 "source, or automatic camera settings.",
                 100.0 * rig.banding.noise));
  const double misfit = std::max(rig.display_timing.rise.residual, rig.display_timing.fall.residual);
  warn(misfit > 0.05, formatted("The display's change of light does not follow a ramp (%.0f %% off, RMS); "
                                "settling is set by the last frame that differed.",
                                100.0 * misfit));
  for (double fall : rig.tone_curve.falls)
    warn(fall > 0.01,
         formatted(
             "A higher drive level gave less light, by %.1f %% of white; the tone curve was smoothed there.",
             100.0 * fall));
  return warnings;
}

/// Exposures of photographs of light up to white: the metered one and longer ones, four times apart.
std::vector<Seconds> bracket_for(CalibrationBench& bench, int count, Seconds exposure_unit,
                                 const RunContext& run) {
  const Metering metering = meter(bench, Seconds(0), run);  // under white
  constexpr double ratio = 4.0;
  return exposure_series(bench.camera(), metering.exposure, metering.exposure * std::pow(ratio, count - 1),
                         count, exposure_unit);
}

}  // namespace

void CalibrateOptions::check() const {
  if (!(gain > 0.0)) throw InputError("the gain must be above zero");
  if (!(patience.count() >= 0.02 && patience.count() <= 60.0))
    throw InputError("the patience is ", patience.count(), " s; give 0.02 to 60");
  if (tone_step < 1 || tone_step > 85 || 255 % tone_step != 0)
    throw InputError("the step between drive levels is ", tone_step, "; give 1, 3, 5, 15, 17, 51 or 85");
  flat_field.check("flat field");
  uniformity.check("uniformity of the screen");
}

RigMeasurements calibrate(Camera& camera, Illuminator& illuminator, Trigger* trigger,
                          const CalibrateOptions& options, const RunContext& run) {
  options.check();
  CalibrationBench bench(camera, illuminator, trigger, options.gain, options.patience);
  RigMeasurements rig;
  rig.camera_description = bench.camera();
  rig.display_description = bench.display();
  rig.target = options.target;
  rig.gain = options.gain;

  const bool streams = !bench.camera().takes_photographs;
  run.note(streams ? "metering; control latency of the camera" : "metering");
  const Seconds steady_exposure = std::max(Seconds(0.03), bench.camera().frame_interval);
  const Metering metering = meter(bench, steady_exposure, run);
  if (streams) rig.control_latency = measure_control_latency(bench, metering, run);
  bench.use(timing_so_far(rig, options.patience));
  run.note(streams ? "black level of the camera; banding" : "black level of the camera");
  rig.black = measure_black_level(bench, run);
  if (streams) rig.banding = measure_banding(bench, metering, rig.black.dn, run);
  rig.timing = timing_so_far(rig, options.patience);
  const Seconds unit = rig.timing.exposure_unit;
  run.note("saturation and response of the camera");
  rig.response = measure_response(bench, rig.black, unit, run);
  if (streams && !rig.response.is_linear)
    rig.banding = linearised(rig.banding, rig.black.dn, rig.response.linear_from_dn);
  if (streams) {
    run.note("latency and settling of the display");
    rig.display_timing = measure_display_timing(bench, rig.response, unit, run);
    rig.timing.display_latency = rig.display_timing.latency;
    rig.timing.display_settling = rig.display_timing.settling;
    bench.use(rig.timing);
  }
  run.note("noise of the camera");
  rig.noise = measure_photon_transfer(bench, meter(bench, std::max(steady_exposure, 32.0 * unit), run),
                                      rig.response, unit, run);
  rig.camera = camera_of(rig, options.flat_field);

  constexpr int exposures_of_photographs = 3;
  const auto exposures = bracket_for(bench, exposures_of_photographs, unit, run);
  rig.superposition = measure_superposition(bench, rig.camera, exposures, run);
  rig.tone_curve = measure_tone_curve(bench, rig.camera, exposures, options.tone_step, run);
  rig.monitor.radiance_from_level = rig.tone_curve.light_from_level;
  rig.monitor.uniformity = options.uniformity;
  if (options.target == CalibrationTarget::card) {
    rig.flat_field = measure_flat_field(bench, rig.camera, exposures, run);
    rig.camera.flat_field = rig.flat_field->map;
  }
  if (options.target == CalibrationTarget::screen) {
    rig.screen = measure_screen_uniformity(bench, rig.camera, exposures, run);
    rig.monitor.uniformity = rig.screen->map;
  }
  rig.monitor.check("measured monitor calibration");
  rig.warnings = warnings_of(rig);
  return rig;
}

}  // namespace refield
