// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "cli/acquire/capture_report.h"
#include "cli/acquire/session_rig.h"
#include "cli/acquire/until_error.h"
#include "cli/common/options.h"
#include "cli/run_context.h"
#include "cli/verbs.h"
#include "core/base/files.h"
#include "core/base/number_text.h"
#include "core/base/output_lock.h"
#include "core/image/image_io.h"
#include "core/image/tone_map.h"
#include "core/session/capture_session.h"
#include "estimate/quality/light_order.h"
#include "simulate/rig/light_maps.h"
#include "simulate/tabletop/surface.h"

namespace refield::cli {

namespace {

/// What replaces values of the rig file or the recipe.
struct RunOptions {
  fs::path rig;  ///< rig file or recipe
  fs::path truth;
  fs::path session;
  fs::path calibration;
  std::string light;
  std::vector<double> exposures;
  std::string max_noise;
  bool auto_mask = false;
  std::string order;
  std::string until_error;
  int min_images = 30;
  bool keep_raw = false;
  IfExists if_exists = IfExists::refuse;
  bool follow_error = false;
  bool quick = false;
  int check_every = 0;
};

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

std::string text_of(const VirtualCameraOptions& camera, const Recipe& recipe) {
  std::string text = "virtual rig: recipe " + checksum_of(recipe.path);
  if (!recipe.base.empty()) text += ", base " + checksum_of(recipe.base);
  if (camera.truth.empty()) {
    text += ", traced";
  } else {
    text += ", transport " + checksum_of(camera.truth / transport_file_name);
    const fs::path ambient = camera.truth / ambient_file_name;
    text += ", ambient " + (fs::exists(ambient) ? checksum_of(ambient) : std::string("none"));
  }
  return text + ", seed " + std::to_string(recipe.seed);
}

/// The plan names devices by what decides their frames, and by what stays the same when a cable is plugged in
/// again.
std::string rig_text(const SessionFile& session, SessionRig& rig) {
  if (rig.recipe()) return text_of(std::get<VirtualCameraOptions>(session.camera), *rig.recipe());
  const auto text_of_value = [](const auto& value) {
    if constexpr (std::is_same_v<std::decay_t<decltype(value)>, std::string>)
      return value;
    else
      return std::to_string(value);
  };
  std::string text = "camera " + rig.camera().describe().name + " ";
  std::visit(
      [&](const auto& options) {
        text += options.format;
        if (options.window)
          text += " window " + std::to_string(options.window->x) + "," + std::to_string(options.window->y);
        for (const auto& [name, value] : options.controls) text += " " + name + "=" + text_of_value(value);
      },
      session.camera);
  text += "; monitor " + rig.monitor().describe().name;
  return text + (session.trigger ? "; trigger " + session.trigger->trigger.text() : "");
}

/// The brightest radiance that the monitor has in every channel.
float white_of(const MonitorCalibration& monitor) {
  float white = INFINITY;
  for (const auto& curve : monitor.radiance_from_level) white = std::min(white, curve.back() - curve.front());
  return white;
}

/// Keeps what a DSLR that needs 8 s for a pattern photographs within five minutes, with four ambient brackets
/// and a reference frame first and last: 30 training lights, the primaries among them, and a held-out one, a
/// natural image in what 'acquire lights' writes. 27 designed patterns leave about the error of 45 natural
/// images (docs/method/patterns.md).
void keep_quick(std::vector<CaptureLight>& lights) {
  const auto primaries = std::ranges::count(lights, "primary", &CaptureLight::kind);
  std::map<FrameRole, std::ptrdiff_t> left = {{FrameRole::train, 30 - primaries}, {FrameRole::test, 1}};
  std::erase_if(
      lights, [&](const CaptureLight& light) { return light.kind != "primary" && left[light.role]-- <= 0; });
}

/// The images that `pattern` (a quoted pattern or a folder) names, as training lights, but for references by
/// their name. The kind is that of the texels, kind_of_light().
std::vector<CaptureLight> lights_of_files(const std::string& pattern) {
  std::vector<CaptureLight> lights;
  for (const GlobMatch& match : expand_glob(pattern)) {
    const std::string name = match.path.stem().string();
    const bool is_reference = role_of_light(name) == FrameRole::reference;
    const Image light = read_light_map(match.path, Parameterisation::monitor, run_context()).radiance;
    lights.push_back({name, is_reference ? FrameRole::reference : FrameRole::train,
                      std::string(kind_of_light(light)), match.path});
  }
  return lights;
}

/// Puts the monitor's primaries, one at a time, before the lights where none is one yet, since captures may
/// end early, and gives the white light to repeat as the reference: that of the lights, which are then
/// without it, else, like the primaries, one that is written into `folder` with the radiance `white`.
fs::path add_primaries_and_white(std::vector<CaptureLight>& lights, int width, int height, float white,
                                 const fs::path& folder) {
  const auto write = [&](const std::string& name, const std::array<float, 3>& colour) {
    create_folders(folder);
    write_exr(folder / (name + ".exr"), uniform_light(width, height, colour));
    return folder / (name + ".exr");
  };
  if (std::ranges::find(lights, "primary", &CaptureLight::kind) == lights.end()) {
    const std::array<std::pair<const char*, std::array<float, 3>>, 3> primaries = {
        {{"primary_red", {white, 0, 0}}, {"primary_green", {0, white, 0}}, {"primary_blue", {0, 0, white}}}};
    for (auto light = lights.begin(); const auto& [name, colour] : primaries)
      light = 1 + lights.insert(light, {name, FrameRole::train, "primary", write(name, colour)});
  }
  fs::path reference;
  for (const CaptureLight& light : lights)
    if (light.kind == "white" && reference.empty()) reference = light.wanted;
  std::erase_if(lights, [](const CaptureLight& light) { return light.role == FrameRole::reference; });
  return reference.empty() ? write("reference", {white, white, white}) : reference;
}

/// The lights of a session, with their roles and kinds.
std::vector<CaptureLight> lights_of_session(const fs::path& folder) {
  std::vector<CaptureLight> lights;
  for (const CaptureFrame& frame : read_capture_session(folder).frames)
    lights.push_back({frame.name, frame.role, frame.kind, frame.illumination});
  return lights;
}

/// Puts frames of one light, to tell drift by, first, last, and after every `every` lights (0: none). Without
/// a `reference` it is the white one among the lights, else the first.
std::vector<CaptureLight> with_references(const std::vector<CaptureLight>& lights, int every,
                                          fs::path reference) {
  if (every <= 0 || lights.empty()) return lights;
  if (reference.empty()) {
    const auto white = std::ranges::find(lights, "white", &CaptureLight::kind);
    reference = (white != lights.end() ? *white : lights.front()).wanted;
  }
  std::vector<CaptureLight> result;
  int count = 0;
  const auto add_reference = [&] {
    result.push_back({formatted("reference_%03d", count++), FrameRole::reference, "reference", reference});
  };
  for (std::size_t i = 0; i < lights.size(); ++i) {
    if (i % static_cast<std::size_t>(every) == 0) add_reference();
    result.push_back(lights[i]);
  }
  add_reference();
  return result;
}

/// Puts the training lights first, in the given order: "given", "random" or "useful" (max_useful_order()).
/// Throws InputError for another word.
void order_lights(std::vector<CaptureLight>& lights, const std::string& order, std::uint64_t seed) {
  if (order == "given") return;
  if (order != "random" && order != "useful")
    throw InputError("--order ", order, ": give useful, given or random");
  const auto others = std::stable_partition(
      lights.begin(), lights.end(), [](const CaptureLight& light) { return light.role == FrameRole::train; });
  const std::vector<CaptureLight> trained(lights.begin(), others);
  std::vector<int> places;
  if (order == "random") {
    places = random_order(static_cast<int>(trained.size()), seed);
  } else {
    std::vector<LightMap> maps;
    Progress progress(run_context(), "ordering lights", trained.size());
    for (const CaptureLight& light : trained) {
      run_context().throw_if_stopped();
      maps.push_back(read_light_map(light.wanted, Parameterisation::monitor, run_context()));
      progress.advance();
    }
    places = max_useful_order(maps);
  }
  for (std::size_t i = 0; i < places.size(); ++i) lights[i] = trained[places[i]];
}

std::vector<CaptureLight> lights_of(const SessionFile& session, const IlluminatorDescription& monitor,
                                    const MonitorCalibration& calibration, bool quick) {
  const SessionLights& wanted = session.lights;
  std::vector<CaptureLight> lights;
  const auto add = [&](std::vector<CaptureLight> more, std::optional<FrameRole> role = std::nullopt) {
    for (CaptureLight& light : more) {
      if (role && light.role != FrameRole::reference) light.role = *role;
      lights.push_back(std::move(light));
    }
  };
  if (!wanted.session.empty()) add(lights_of_session(wanted.session));
  if (!wanted.images.empty()) add(lights_of_files(wanted.images));
  if (!wanted.test_images.empty()) add(lights_of_files(wanted.test_images), FrameRole::test);
  fs::path reference = session.reference_light;
  order_lights(lights, session.order, session.order_seed);
  if (wanted.session.empty() || session.is_recipe) {  // else the photographs of that session again
    const fs::path white = add_primaries_and_white(
        lights, monitor.width, monitor.height, white_of(calibration), fs::path(session.output) += "_lights");
    if (reference.empty()) reference = white;
  }
  int every = session.reference_every;
  if (quick) {
    keep_quick(lights);
    if (every > 0) every = static_cast<int>(lights.size());
  }
  return with_references(lights, every, reference);
}

CaptureRequest request_of(const SessionFile& session, SessionRig& rig, bool quick) {
  CaptureRequest request;
  request.folder = session.output;
  if (session.calibration.empty()) {
    const Recipe& recipe = *rig.recipe();
    request.camera = calibration_of(recipe.rig.sensor, recipe.scene.camera, session.gain);
    request.monitor = calibration_of(recipe.rig.monitor, recipe.scene.monitor);
    request.timing = timing_of(recipe.rig);
  } else {
    request.camera = read_camera_calibration(session.calibration);
    request.monitor = read_monitor_calibration(session.calibration);
    request.timing = read_timing_calibration(session.calibration);
  }
  request.lights = lights_of(session, rig.monitor().describe(), request.monitor, quick);
  request.rig = rig_text(session, rig);
  request.monitors = session.placements;
  if (rig.recipe() && request.monitors.empty()) request.monitors = monitor_placements(rig.recipe()->scene);
  for (double seconds : session.exposures) request.exposures.emplace_back(seconds);
  request.exposure_plan.count = session.exposure_count;
  request.exposure_plan.ratio = session.exposure_ratio;
  if (!session.max_noise.empty())
    request.exposure_plan.relative_noise = error_from_text(session.max_noise);
  else if (session.longest_exposure)
    request.exposure_plan.shortest =
        *session.longest_exposure * std::pow(session.exposure_ratio, 1 - session.exposure_count);
  if (request.timing) request.exposure_plan.multiple_of = request.timing->exposure_unit;
  request.frames_per_exposure = session.frames;
  request.ambient_repeats = session.ambient_frames;
  request.gain = session.gain;
  if (!session.mask.empty()) request.mask = {MaskSource::Kind::painted, session.mask};
  if (session.auto_mask) request.mask = {MaskSource::Kind::automatic, session.background};
  request.keep_raw = session.keep_raw;
  request.precision = session.half ? Precision::half : Precision::single;
  return request;
}

/// Replaces `file` by each photograph, so bright that one pixel in a hundred is white: a viewer that looks
/// at the file again shows the capture as it goes on.
std::function<void(const Photograph&)> preview_into(const fs::path& file) {
  if (file.extension() != ".png")
    throw InputError(file, ": the preview must be a PNG file; give a name that ends in .png");
  return [file](const Photograph& photograph) {
    write_png(file, photograph.radiance, {exposure_to_white(photograph.radiance)});
  };
}

/// Predicts the error during the capture where the options ask for it. `until_error`: "" or where to stop.
std::optional<UntilError> predict_errors(const RunOptions& options, const std::string& until_error) {
  constexpr int every = 10;
  if (until_error.empty() && !options.follow_error && !options.quick) return std::nullopt;
  return std::make_optional<UntilError>(until_error.empty() ? 0.0 : error_from_text(until_error),
                                        options.min_images, every);
}

/// What a recipe does not say must be given before anything is written.
void require_scene(const RunOptions& options) {
  const std::string remedy =
      "make it with 'refield simulate " + options.rig.string() + " -o TRUTH' and give --truth TRUTH";
  if (options.session.empty()) throw InputError("--output is missing; give the session folder to create");
  if (options.truth.empty() && options.light.empty())
    throw InputError("neither --truth nor --light is given; ", remedy);
  if (!options.truth.empty() && !fs::is_regular_file(options.truth / transport_file_name))
    throw InputError(options.truth / transport_file_name, ": the scene's light transport is missing; ",
                     remedy);
}

/// The rig file with what the options replace.
SessionFile session_of(const RunOptions& options) {
  SessionFile session = read_session_file(options.rig);
  if (session.is_recipe) {
    require_scene(options);
    session.lights.session = options.truth;
  }
  if (!options.truth.empty()) {
    auto* simulated = std::get_if<VirtualCameraOptions>(&session.camera);
    if (!simulated)
      throw InputError("--truth belongs to a simulated rig; the camera of ", options.rig, " is real");
    simulated->truth = options.truth;
  }
  const auto replace = [](const auto& given, auto& value) {
    if (!given.empty()) value = given;
  };
  replace(options.session, session.output);
  replace(options.calibration, session.calibration);
  replace(options.order, session.order);
  replace(options.until_error, session.until_error);
  if (!options.light.empty()) {
    session.lights = {};
    session.lights.images = options.light;
  }
  if (!options.exposures.empty()) session.max_noise.clear();
  replace(options.exposures, session.exposures);
  if (!options.max_noise.empty()) session.exposures.clear();
  replace(options.max_noise, session.max_noise);
  session.auto_mask |= options.auto_mask;
  session.keep_raw |= options.keep_raw;
  return session;
}

void run_session(RunOptions& options, const Common& common) {
  options.if_exists = if_exists(options.if_exists, common);
  const SessionFile session = session_of(options);
  check_session_folder(session.output, options.if_exists);
  const OutputLock lock(session.output, {});
  if (options.if_exists == IfExists::replace) {
    const SessionLights& lights = session.lights;
    require_outside(session.output,
                    {lights.session, lights.images, lights.test_images, options.truth, session.calibration,
                     session.mask, session.background, session.reference_light});
  }
  SessionRig rig(session);
  CaptureRequest request = request_of(session, rig, options.quick);
  request.if_exists = options.if_exists;
  request.before_light = rig.before_light(request.lights);
  if (!session.preview.empty()) request.on_photograph = preview_into(session.preview);
  if (!request.timing)
    tell(session.calibration.string() +
         ": has no [timing] section, so the latency of the monitor is assumed to be zero; 'refield acquire "
         "calibrate' measures it");
  auto until = predict_errors(options, session.until_error);
  if (until) until->attach(request);
  CaptureWatch watch(options.check_every);
  if (options.check_every > 0) watch.attach(request);
  const CaptureSummary summary = capture(request, rig.camera(), rig.monitor(), rig.trigger(), run_context());
  const CameraTroubles troubles = rig.troubles();
  if (troubles.damaged + troubles.restarts + troubles.replugs > 0)
    tell("the camera delivered " + std::to_string(troubles.damaged) +
         " damaged frames, restarted its stream " + std::to_string(troubles.restarts) +
         " times and was reconnected " + std::to_string(troubles.replugs) +
         " times; the affected frames were discarded");
  report_capture(summary, session.output, session.until_error.empty() ? nullptr : &*until, common);
}

}  // namespace

void add_acquire_run(CLI::App& group, const Common& common, Action& action) {
  const auto options = std::make_shared<RunOptions>();
  CLI::App* verb = group.add_subcommand(
      "run",
      "Capture a session with a camera and a monitor, real or simulated.\n"
      "\n"
      "The rig file names the devices, light maps and exposures (docs/reference/devices.md); options replace "
      "its values. A frame is used for a light map only if its time stamp shows that it was exposed after "
      "the monitor had changed. A recipe describes a simulated camera and monitor instead, before the scene "
      "whose light transport 'refield simulate RECIPE.toml -o TRUTH' traced.\n"
      "\n"
      "After a disconnected device, an interruption or a full disk, the same command with --resume "
      "continues.\n"
      "\n"
      "Examples:\n"
      "  refield acquire run rig.toml\n"
      "  refield acquire run recipe.toml --truth truth -o session --auto-mask");
  add_rig_argument(*verb, options->rig);
  verb->add_option("-o,--output", options->session, "Session folder to create (default: from the rig file)");
  add_truth_option(*verb, options->truth);
  verb->add_option("--light", options->light,
                   "Light maps: folder or quoted pattern; linear radiance above the black level of the "
                   "monitor (default: those of the rig file or, with their roles and kinds, of --truth)");
  CLI::Option* times =
      verb->add_option("--exposures", options->exposures,
                       "Exposure times of a photograph in seconds, separated by commas; increasing (default: "
                       "from the rig file or the recipe, else metered under white)")
          ->delimiter(',');
  add_max_noise_option(*verb, options->max_noise)->excludes(times);
  add_until_error_option(*verb, options->until_error);
  verb->add_flag("--follow-error", options->follow_error,
                 "Print the predicted error of the reflectance field on new photographs during the capture");
  verb->add_flag("--quick", options->quick,
                 "Take 30 training photographs (primaries, then the first patterns) and a held-out one only, "
                 "and print the predicted error: a first field, in less than five minutes with a DSLR");
  verb->add_option("--check-every", options->check_every,
                   "Check the photographs after every N training photographs, as 'refield info' does, and "
                   "stop when the camera has moved, the room light has changed or photographs do not fit the "
                   "others; 0: only at the end")
      ->type_name("N")
      ->check(non_negative_number())
      ->capture_default_str();
  verb->add_flag("--auto-mask", options->auto_mask, "Mask the pixels that respond to a white monitor");
  add_resume_flag(*verb, options->if_exists);
  verb->add_option("--calibration", options->calibration,
                   "Calibration file of 'refield acquire calibrate' (default: that of the rig file; the "
                   "values of the recipe, without error)")
      ->group(further);
  verb->add_option("--order", options->order,
                   "Order of the training lights: given, random, or useful (most informative first, for "
                   "captures that may end early; default: from the rig file, else given)")
      ->group(further);
  verb->add_option("--min-images", options->min_images, "Number of images before the first predicted error")
      ->capture_default_str()
      ->group(further);
  verb->add_flag("--keep-raw", options->keep_raw, "Store every exposure as a 16-bit PNG in raw/")
      ->group(further);
  on_command(*verb, options, common, action, run_session);
}

}  // namespace refield::cli
