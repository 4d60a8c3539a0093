// SPDX-License-Identifier: Apache-2.0
#include "cli/acquire/virtual_request.h"

#include <algorithm>
#include <cmath>

#include "cli/acquire/light_list.h"
#include "cli/acquire/until_error.h"
#include "cli/run_context.h"
#include "core/base/errors.h"
#include "core/field_io/reflectance_field_file.h"
#include "core/image/image_io.h"
#include "core/session/capture_session.h"
#include "simulate/tabletop/scene.h"
#include "simulate/tabletop/surface.h"

namespace refield::cli {

namespace {

RelativeMap map_of(const Falloff& falloff) {
  if (falloff.loss == 0.0) return {};
  RelativeMap map{17, 13, {}};
  for (int j = 0; j < map.rows; ++j)
    for (int i = 0; i < map.columns; ++i)
      map.values.push_back(
          static_cast<float>(falloff.at_share(i / (map.columns - 1.0), j / (map.rows - 1.0))));
  return map;
}

/// What a calibration of the virtual camera would find out.
CameraCalibration calibration_of(const SensorModel& sensor, const SceneCamera& place, double gain) {
  CameraCalibration camera;
  camera.bits = sensor.bits;
  camera.linear_from_dn = sensor.response_gamma == 1.0 ? linear_response(sensor.bits)
                                                       : gamma_response(sensor.bits, sensor.response_gamma);
  camera.black_level_dn = sensor.black_level_dn;
  const double full = sensor.full_scale();
  const double full_well_dn =
      sensor.black_level_dn + gain * sensor.full_well_electrons / sensor.electrons_per_dn;
  camera.saturation_dn =
      std::round(full * std::pow(std::min(full_well_dn / full, 1.0), 1.0 / sensor.response_gamma));
  camera.electrons_per_dn = sensor.electrons_per_dn;
  camera.read_noise_electrons = sensor.read_noise_electrons;
  camera.electrons_per_radiance_second = sensor.sensitivity;
  camera.flat_field = map_of({place.width, place.height, sensor.vignetting});
  return camera;
}

MonitorCalibration calibration_of(const MonitorModel& model, const MonitorInScene& place) {
  MonitorCalibration monitor;
  monitor.uniformity = map_of({place.texels.width, place.texels.height, model.falloff});
  const auto curve = model.as_stated().tone_curve();
  for (int c = 0; c < 3; ++c) monitor.radiance_from_level[c].assign(curve[c].begin(), curve[c].end());
  return monitor;
}

TimingCalibration timing_of(const RigRecipe& rig) {
  TimingCalibration timing;
  timing.display_latency = rig.monitor.latency;
  timing.display_settling = rig.monitor.settling;
  timing.control_latency_frames = rig.sensor.control_latency_frames;
  timing.refresh_period = rig.monitor.refresh_interval;
  if (rig.monitor.pwm_hz > 0.0) timing.exposure_unit = Seconds(1.0 / rig.monitor.pwm_hz);
  return timing;
}

/// From the file of --calibration, else what the recipe says: a calibration without error.
void fill_calibration(const VirtualOptions& options, const Recipe& recipe, CaptureRequest& request) {
  if (options.calibration.empty()) {
    request.camera = calibration_of(recipe.rig.sensor, recipe.scene.camera, request.gain);
    request.monitor = calibration_of(recipe.rig.monitor, recipe.scene.monitor);
    request.timing = timing_of(recipe.rig);
  } else {
    request.camera = read_camera_calibration(options.calibration);
    request.monitor = read_monitor_calibration(options.calibration);
    request.timing = read_timing_calibration(options.calibration);
  }
  if (request.timing) request.exposure_plan.multiple_of = request.timing->exposure_unit;
}

std::vector<CaptureLight> lights_of(const VirtualOptions& options) {
  return options.light.empty() ? lights_of_session(options.truth) : lights_of_files(options.light);
}

/// The plan names devices by what decides their frames.
std::string rig_text(const VirtualOptions& options, const Recipe& recipe, std::uint64_t seed) {
  std::string text = "virtual rig: recipe " + checksum_text(recipe.path);
  if (!recipe.base.empty()) text += ", base " + checksum_text(recipe.base);
  if (options.truth.empty()) {
    text += ", traced";
  } else {
    text += ", transport " + checksum_text(options.truth / transport_file_name);
    const fs::path ambient = options.truth / ambient_file_name;
    text += ", ambient " + (fs::exists(ambient) ? checksum_text(ambient) : std::string("none"));
  }
  return text + ", seed " + std::to_string(seed);
}

void fill_exposures(const VirtualOptions& options, const Recipe& recipe, CaptureRequest& request) {
  const ExposureSeries& series = recipe.rig.exposures;
  for (double seconds : options.exposures) request.exposures.emplace_back(seconds);
  request.exposure_plan.count = series.count;
  request.exposure_plan.ratio = series.ratio;
  request.frames_per_exposure = series.frames;
  request.ambient_repeats = series.ambient_frames;
  if (!options.max_noise.empty()) request.exposure_plan.relative_noise = error_from_text(options.max_noise);
  if (series.longest && options.max_noise.empty())
    request.exposure_plan.shortest =
        *series.longest * std::pow(request.exposure_plan.ratio, 1 - request.exposure_plan.count);
}

}  // namespace

namespace {

/// The scene before the virtual camera: from the folder `truth` that 'refield simulate' made or, where it is
/// empty, traced now.
TracedScene scene_of(const fs::path& truth, const Recipe& recipe) {
  constexpr int balanced_quality = 2;
  if (truth.empty())
    return trace_scene(recipe.scene, TraceOptions::of_quality(balanced_quality, recipe.seed), run_context());
  const fs::path ambient = truth / ambient_file_name;
  return {read_reflectance_field(truth / transport_file_name, run_context()),
          fs::exists(ambient) ? read_image(ambient) : Image()};
}

}  // namespace

VirtualRig rig_of(const fs::path& truth, const Recipe& recipe, std::uint64_t seed) {
  TracedScene scene = scene_of(truth, recipe);
  Recipe traced = recipe;  // 'refield simulate' may have been told another size
  traced.scene.camera.width = scene.transport.width;
  traced.scene.camera.height = scene.transport.height;
  traced.scene.monitor.texels = scene.transport.basis.domain;
  VirtualRig rig(std::move(scene.transport), std::move(scene.ambient), recipe.rig.monitor, recipe.rig.sensor,
                 seed);
  rig.disturb(recipe.rig.disturbances, [truth, traced](const Disturbances::Move& to) {
    if (to.right_px == 0.0 && to.down_px == 0.0) return scene_of(truth, traced);
    Recipe moved = traced;
    moved.scene.camera = turned(moved.scene.camera, to.right_px, to.down_px);
    return scene_of({}, moved);
  });
  return rig;
}

std::function<void(std::size_t)> place_teller(VirtualRig& rig, const std::vector<CaptureLight>& lights) {
  std::uint32_t references = 0;
  std::vector<std::uint32_t> repetition;
  for (const CaptureLight& light : lights)
    repetition.push_back(light.role == FrameRole::reference ? ++references : 0);
  return [&rig, repetition](std::size_t i) {
    const double last = std::max<double>(1.0, static_cast<double>(repetition.size()) - 1.0);
    rig.set_place(static_cast<double>(i) / last, repetition[i]);
  };
}

CaptureRequest request_of(const VirtualOptions& options, const Recipe& recipe, std::uint64_t seed) {
  CaptureRequest request;
  request.folder = options.session;
  auto lights = lights_of(options);
  order_lights(lights, options.order.empty() ? "given" : options.order, seed);
  request.lights = with_references(lights, recipe.rig.reference_every, {});
  fill_calibration(options, recipe, request);
  request.monitors = monitor_placements(recipe.scene);
  request.rig = rig_text(options, recipe, seed);
  fill_exposures(options, recipe, request);
  if (options.auto_mask) request.mask = {MaskSource::Kind::automatic, {}};
  request.keep_raw = options.keep_raw;
  request.if_exists = options.if_exists;
  return request;
}

}  // namespace refield::cli
