// SPDX-License-Identifier: Apache-2.0
#include "cli/acquire/session_rig.h"

#include <cstdio>
#include <mutex>
#include <set>

#include "cli/acquire/virtual_request.h"
#include "cli/run_context.h"
#include "core/base/config_file.h"
#include "core/light/monitor_placement.h"

namespace refield::cli {

namespace fs = std::filesystem;

namespace {

constexpr int max_pixels = 65536;

/// A path of the file: relative to the file's own folder.
void read_path(ConfigSection& section, const std::string& key, const fs::path& folder, fs::path& path) {
  std::string text;
  section.text(key, text);
  if (!text.empty()) path = folder / text;
}

void read_pattern(ConfigSection& section, const std::string& key, const fs::path& folder,
                  std::string& pattern) {
  fs::path path;
  read_path(section, key, folder, path);
  if (!path.empty()) pattern = path;
}

/// The keys that all cameras have; `section` knows of no others yet.
void read_tethered_options(ConfigSection& section, CameraOptions& camera) {
  std::vector<int> window(4, 0);
  section.integers("region", window, 0, max_pixels);
  if (section.has("region")) camera.window = FrameWindow{window[0], window[1], window[2], window[3]};
  section.seconds("replug_patience", camera.replug_patience, Seconds(1), 0.0, 86'400.0);
}

/// Those that all cameras have that stream.
void read_camera_options(ConfigSection& section, CameraOptions& camera) {
  read_tethered_options(section, camera);
  section.text("pixel_format", camera.format);
  section.number("fps", camera.rate, 0.01, 10'000.0);
  section.number("unit_gain", camera.unit_gain, 1e-6, 1e9);
}

decltype(SessionFile::camera) read_camera(ConfigSection section, ConfigSection controls,
                                          const fs::path& folder) {
  const std::string genicam = "genicam:", gphoto = "gphoto:", simulated = "virtual:";
  std::string device;
  section.require("device");
  section.text("device", device);
  if (device.starts_with(genicam)) {
    GenicamCameraOptions camera;
    camera.device = device.substr(genicam.size());
    read_camera_options(section, camera);
    section.text("trigger", camera.trigger);
    section.finish();
    camera.controls = controls.texts();
    return camera;
  }
  if (device.starts_with(gphoto)) {
    GphotoCameraOptions camera;
    camera.device = device.substr(gphoto.size());
    read_tethered_options(section, camera);
    section.finish();
    camera.controls = controls.texts();
    return camera;
  }
  if (device.starts_with(simulated)) {
    VirtualCameraOptions camera;
    camera.recipe = folder / device.substr(simulated.size());
    read_path(section, "truth", folder, camera.truth);
    section.finish();
    controls.finish();
    return camera;
  }
  V4l2CameraOptions camera;
  camera.device = device;
  read_camera_options(section, camera);
  section.integer("width", camera.width, 1, max_pixels);
  section.integer("height", camera.height, 1, max_pixels);
  section.seconds("fixed_exposure", camera.fixed_exposure, Seconds(1), 1e-6, 3600.0);
  section.finish();
  camera.controls = controls.settings();
  return camera;
}

void read_monitor(ConfigSection section, SessionFile& session) {
  DrmMonitorOptions& monitor = session.monitor;
  bool is_window = false;
  int display = 0;
  section.flag("window", is_window);
  section.integer("display", display, 0, 63);
  section.text("card", monitor.card);
  section.text("connector", monitor.connector);
  section.text("mode", monitor.mode);
  section.integer("width", monitor.width, 1, max_pixels);
  section.integer("height", monitor.height, 1, max_pixels);
  // Where the monitor stands, for relighting by environment maps: all of it may be left out.
  if (MonitorPlacement place; read_placement(section, place)) session.placements = {place};
  if (is_window) {
    for (const char* key : {"card", "connector", "mode"})
      if (section.has(key))
        section.fail(key,
                     "is not valid with window = true, since the desktop sets the mode; give 'display', or "
                     "remove 'window'");
    session.window = WindowMonitorOptions{display, monitor.width, monitor.height};
  } else if (section.has("display")) {
    section.fail("display", "requires window = true; without a window, give a connector");
  }
  section.finish();
}

/// "ready_line = 4" and "ready_active_low = true", on the trigger's chip.
std::optional<GpioLineAddress> read_line(ConfigSection& section, const std::string& name,
                                         const std::string& chip) {
  GpioLineAddress address{chip, 0, false};
  int line = 0;
  section.integer(name + "line", line, 0, 65535);
  section.flag(name + "active_low", address.active_low);
  address.line = static_cast<unsigned>(line);
  return section.has(name + "line") ? std::optional(address) : std::nullopt;
}

GpioTriggerOptions read_trigger(ConfigSection section) {
  for (const char* key : {"chip", "line"}) section.require(key);
  std::string chip;
  section.text("chip", chip);
  GpioTriggerOptions trigger;
  trigger.trigger = *read_line(section, "", chip);
  trigger.ready = read_line(section, "ready_", chip);
  trigger.strobe = read_line(section, "strobe_", chip);
  trigger.light_source = read_line(section, "light_source_", chip);
  section.seconds("pulse_ms", trigger.pulse_width, Seconds(1e-3), 1e-3, 1000.0);
  section.seconds("timeout", trigger.timeout, Seconds(1), 1e-3, 3600.0);
  section.finish();
  return trigger;
}

void read_lights(ConfigSection section, const fs::path& folder, SessionLights& lights) {
  read_path(section, "session", folder, lights.session);
  read_pattern(section, "images", folder, lights.images);
  read_pattern(section, "test_images", folder, lights.test_images);
  read_path(section, "panorama", folder, lights.panorama);
  section.integer("rotations", lights.rotations, 1, 100'000);
  section.number("vertical_fov_degrees", lights.fov_degrees, 1.0, 170.0);
  section.number("white_percentile", lights.white_percentile, 1.0, 100.0);
  if (lights.session.empty() && lights.images.empty() && lights.panorama.empty())
    section.fail("images",
                 "no light maps are given; give images (a folder or a pattern), a session or a panorama");
  section.finish();
}

void read_exposures(ConfigSection section, SessionFile& session) {
  section.numbers("seconds", session.exposures, 1e-6, 3600.0);
  section.integer("count", session.exposure_count, 1, 16);
  section.number("ratio", session.exposure_ratio, 1.1, 100.0);
  section.text("max_noise", session.max_noise);
  section.integer("averaged_frames", session.frames, 1, 1000);
  section.integer("ambient_frames", session.ambient_frames, 0, 64);
  section.number("gain", session.gain, 1e-3, 1e4);
  section.finish();
}

void read_session(ConfigSection section, const fs::path& folder, SessionFile& session) {
  for (const char* key : {"output", "calibration"}) section.require(key);
  read_path(section, "output", folder, session.output);
  read_path(section, "calibration", folder, session.calibration);
  read_path(section, "mask", folder, session.mask);
  read_path(section, "background", folder, session.background);
  section.flag("auto_mask", session.auto_mask);
  section.integer("reference_every", session.reference_every, 0, 100'000);
  read_path(section, "reference_light", folder, session.reference_light);
  section.text("order", session.order);
  section.text("until_error", session.until_error);
  section.flag("keep_raw", session.keep_raw);
  section.flag("half", session.half);
  read_path(section, "preview", folder, session.preview);
  section.finish();
}

}  // namespace

bool is_recipe(const fs::path& path) {
  return !ConfigFile(path, "rig file or recipe", "docs/reference/devices.md").has("session");
}

void add_rig_argument(CLI::App& verb, fs::path& rig) {
  verb.add_option(
          "rig_file", rig,
          "Rig file (.toml) that names the devices ('refield acquire devices -o rig.toml' writes one), or "
          "recipe of a simulated scene, camera and monitor")
      ->required();
}

CLI::Option* add_truth_option(CLI::App& verb, fs::path& truth) {
  return verb.add_option("--truth", truth,
                         "Folder that 'refield simulate' created (from the recipe of a simulated rig; "
                         "default: the scene is traced first)");
}

SessionFile read_session_file(const fs::path& path) {
  const ConfigFile file(path, "rig file", "docs/reference/devices.md");
  file.check_names({"session", "camera", "controls", "monitor", "trigger", "lights", "exposures"});
  SessionFile session;
  session.path = path;
  const fs::path folder = fs::absolute(path).parent_path();
  read_session(file.section("session"), folder, session);
  session.camera = read_camera(file.section("camera"), file.optional_section("controls"), folder);
  read_monitor(file.optional_section("monitor"), session);
  if (file.has("trigger")) session.trigger = read_trigger(file.section("trigger"));
  read_lights(file.section("lights"), folder, session.lights);
  read_exposures(file.optional_section("exposures"), session);
  return session;
}

namespace {

RunContext run_with_notices() {
  RunContext run = run_context();
  run.on_note = tell;
  return run;
}

/// What never fails.
class SimulatedCamera final : public TetheredCamera {
 public:
  explicit SimulatedCamera(Camera& camera) : camera_(camera) {}
  CameraDescription describe() const override { return camera_.describe(); }
  TimePoint set_exposure(Seconds exposure, double gain) override {
    return camera_.set_exposure(exposure, gain);
  }
  RawFrame next_frame(Seconds timeout) override { return camera_.next_frame(timeout); }

 private:
  Camera& camera_;
};

std::optional<VirtualRig> virtual_rig_of(const SessionFile& session) {
  const auto* simulated = std::get_if<VirtualCameraOptions>(&session.camera);
  if (!simulated) return std::nullopt;
  const Recipe recipe = read_recipe(simulated->recipe);
  return rig_of(simulated->truth, recipe, recipe.seed);
}

std::unique_ptr<TetheredCamera> camera_of(const SessionFile& session, std::optional<VirtualRig>& simulated) {
  if (simulated) return std::make_unique<SimulatedCamera>(simulated->camera());
  if (const auto* genicam = std::get_if<GenicamCameraOptions>(&session.camera))
    return open_camera(*genicam, run_with_notices());
  if (const auto* gphoto = std::get_if<GphotoCameraOptions>(&session.camera))
    return open_camera(*gphoto, run_with_notices());
  return open_camera(std::get<V4l2CameraOptions>(session.camera), run_with_notices());
}

/// null where the virtual rig has one.
std::unique_ptr<Illuminator> monitor_of(const SessionFile& session) {
  if (std::holds_alternative<VirtualCameraOptions>(session.camera)) return nullptr;
  if (!session.window) return std::make_unique<DrmMonitor>(session.monitor);
  auto window = std::make_unique<WindowMonitor>(*session.window);
  if (!window->waits_for_blanking())
    tell(window->describe().name +
         ": does not wait for vertical blanking (a remote or virtual display); its time stamps may be too "
         "early, so the calibration file must contain the latency measured by 'refield acquire calibrate'");
  return window;
}

}  // namespace

SessionRig::SessionRig(const SessionFile& session)
    : virtual_(virtual_rig_of(session)),
      camera_(camera_of(session, virtual_)),
      monitor_(monitor_of(session)) {
  if (session.trigger) trigger_.emplace(*session.trigger, run_context());
}

std::function<void(std::size_t)> SessionRig::before_light(const std::vector<CaptureLight>& lights) {
  return virtual_ ? place_teller(*virtual_, lights) : nullptr;
}

void tell(const std::string& sentence) {
  static std::mutex mutex;            // cameras tell from threads of their own
  static std::set<std::string> told;  // devices are opened several times
  const std::scoped_lock lock(mutex);
  if (!told.insert(sentence).second) return;
  std::fprintf(stderr, "\nrefield: note: %s\n", sentence.c_str());
}

}  // namespace refield::cli
