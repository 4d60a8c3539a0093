// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <optional>

#include "cli/acquire/capture_report.h"
#include "cli/acquire/light_list.h"
#include "cli/acquire/session_rig.h"
#include "cli/acquire/until_error.h"
#include "cli/common/options.h"
#include "cli/run_context.h"
#include "cli/verbs.h"
#include "core/base/errors.h"
#include "core/base/output_lock.h"
#include "core/image/tone_map.h"

namespace refield::cli {

namespace {

namespace fs = std::filesystem;

struct RunOptions {
  fs::path file;
  IfExists if_exists = IfExists::refuse;
  bool predict_error = false;
  bool quick = false;
  int check_every = 0;
};

/// The plan names devices by what decides their frames, and by what stays the same when a cable is plugged in
/// again.
std::string rig_text(const SessionFile& session, const CameraDescription& camera,
                     const IlluminatorDescription& monitor) {
  const auto text_of = [](const auto& value) {
    if constexpr (std::is_same_v<std::decay_t<decltype(value)>, std::string>)
      return value;
    else
      return std::to_string(value);
  };
  std::string text = "camera " + camera.name + " ";
  std::visit(
      [&](const auto& options) {
        text += options.format;
        if (options.window)
          text += " window " + std::to_string(options.window->x) + "," + std::to_string(options.window->y);
        for (const auto& [name, value] : options.controls) text += " " + name + "=" + text_of(value);
      },
      session.camera);
  text += "; monitor " + monitor.name;
  return text + (session.trigger ? "; trigger " + session.trigger->trigger.text() : "");
}

/// The brightest radiance that the monitor has in every channel.
float white_of(const MonitorCalibration& monitor) {
  float white = INFINITY;
  for (const auto& curve : monitor.radiance_from_level) white = std::min(white, curve.back() - curve.front());
  return white;
}

/// Keeps the first training lights and a few held-out ones, spread over their list, whose kinds follow one
/// another: a quick capture. 30 designed patterns leave about the error of 50 natural images
/// (docs/method/patterns.md).
void keep_quick(std::vector<CaptureLight>& lights) {
  constexpr std::size_t max_train = 30, max_test = 5;
  std::vector<CaptureLight> kept, held_out;
  std::size_t patterns = 0;  // without the primaries, which are few
  for (CaptureLight& light : lights)
    if (light.role == FrameRole::test)
      held_out.push_back(std::move(light));
    else if (light.kind == "primary" || patterns++ < max_train)
      kept.push_back(std::move(light));
  const std::size_t count = std::min(max_test, held_out.size());
  for (std::size_t i = 0; i < count; ++i)
    kept.push_back(std::move(held_out[(2 * i + 1) * held_out.size() / (2 * count)]));
  lights = std::move(kept);
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
  if (!wanted.panorama.empty())
    add(panorama_lights(wanted, monitor.width, monitor.height, white_of(calibration),
                        fs::path(session.output) += "_lights"));
  if (!wanted.test_images.empty()) add(lights_of_files(wanted.test_images), FrameRole::test);
  fs::path reference = session.reference_light;
  if (wanted.session.empty()) {
    const fs::path white = add_primaries_and_white(
        lights, monitor.width, monitor.height, white_of(calibration), fs::path(session.output) += "_lights");
    if (reference.empty()) reference = white;
  }
  constexpr std::uint64_t order_seed = 1;
  order_lights(lights, session.order, order_seed);
  if (quick) keep_quick(lights);
  return with_references(lights, session.reference_every, reference);
}

CaptureRequest request_of(const SessionFile& session, const CameraDescription& camera,
                          const IlluminatorDescription& monitor, bool quick) {
  CaptureRequest request;
  request.folder = session.output;
  request.camera = read_camera_calibration(session.calibration);
  request.monitor = read_monitor_calibration(session.calibration);
  request.timing = read_timing_calibration(session.calibration);
  request.lights = lights_of(session, monitor, request.monitor, quick);
  request.rig = rig_text(session, camera, monitor);
  request.monitors = session.placements;
  for (double seconds : session.exposures) request.exposures.emplace_back(seconds);
  request.exposure_plan.count = session.exposure_count;
  request.exposure_plan.ratio = session.exposure_ratio;
  if (!session.noise.empty()) request.exposure_plan.relative_noise = error_from_text(session.noise);
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
    throw InputError(file.string() + ": the preview must be a PNG file; give a name that ends in .png");
  return [file](const Photograph& photograph) {
    write_png(file, photograph.radiance, {exposure_to_white(photograph.radiance)});
  };
}

void run_session(const RunOptions& options, const Common& common) {
  const SessionFile session = read_session_file(options.file);
  check_session_folder(session.output, options.if_exists);
  const OutputLock lock(session.output, {});
  if (options.if_exists == IfExists::replace) {
    const SessionLights& lights = session.lights;
    require_outside(session.output,
                    {lights.session, lights.images, lights.test_images, lights.panorama, session.calibration,
                     session.mask, session.background, session.reference_light});
  }
  SessionRig rig(session);
  CaptureRequest request =
      request_of(session, rig.camera().describe(), rig.monitor().describe(), options.quick);
  request.if_exists = options.if_exists;
  request.before_light = rig.before_light(request.lights);
  if (!session.preview.empty()) request.on_photograph = preview_into(session.preview);
  if (!request.timing)
    tell(session.calibration.string() +
         ": has no [timing] section, so the latency of the monitor is assumed to be zero; 'refield acquire "
         "calibrate' measures it");
  std::optional<UntilError> until;
  const bool may_stop = !session.until_error.empty();
  if (may_stop || options.predict_error || options.quick) {
    constexpr int min_images = 30, check_every = 10;
    until.emplace(may_stop ? error_from_text(session.until_error) : 0.0, min_images, check_every);
    until->attach(request);
  }
  CaptureWatch watch(options.check_every);
  if (options.check_every > 0) watch.attach(request);
  const CaptureSummary summary = capture(request, rig.camera(), rig.monitor(), rig.trigger(), run_context());
  const CameraTroubles& troubles = rig.camera().troubles();
  if (troubles.damaged + troubles.restarts + troubles.replugs > 0)
    tell("the camera delivered " + std::to_string(troubles.damaged) +
         " damaged frames, restarted its stream " + std::to_string(troubles.restarts) +
         " times and was reconnected " + std::to_string(troubles.replugs) +
         " times; the affected frames were discarded");
  report_capture(summary, session.output, may_stop ? &*until : nullptr, common);
}

}  // namespace

void add_acquire_run(CLI::App& group, const Common& common, Action& action) {
  const auto options = std::make_shared<RunOptions>();
  CLI::App* verb = group.add_subcommand(
      "run",
      "Capture a session with a real camera and monitor.\n"
      "\n"
      "The session file names the devices, light maps and exposures (docs/reference/devices.md); 'refield "
      "acquire devices' lists the available devices. A frame is used for a light map only if its time stamp "
      "shows that it was exposed after the monitor had changed.\n"
      "\n"
      "After a disconnected device, an interruption or a full disk, the same command with --resume "
      "continues.\n"
      "\n"
      "Example:\n"
      "  refield acquire run session.toml");
  verb->add_option("session", options->file, "Session file (.toml)")->required();
  verb->add_flag("--predict-error", options->predict_error,
                 "Print the predicted error of the reflectance field on new photographs, first after 30 "
                 "training photographs and then after every 10");
  verb->add_flag("--quick", options->quick,
                 "Take the first 30 training light maps and 5 held-out ones only, and print the predicted "
                 "error: a first field, in less than five minutes with a DSLR");
  verb->add_option(
          "--check-every", options->check_every,
          "Check the photographs after every N training photographs, as 'refield info' does, and stop "
          "when the camera has moved, the room light has changed or photographs do not fit the others; "
          "0: only at the end")
      ->check(non_negative_number())
      ->capture_default_str();
  add_if_exists(*verb, options->if_exists, "a capture");
  verb->callback(
      [options, &common, &action] { action = [options, &common] { run_session(*options, common); }; });
}

}  // namespace refield::cli
