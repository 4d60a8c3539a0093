// SPDX-License-Identifier: Apache-2.0
#include "cli/acquire/session_rig.h"

#include <cstdio>
#include <sstream>

#include "acquire/devices/v4l2_device.h"
#include "cli/run_context.h"
#include "core/base/config_file.h"
#include "core/field_io/reflectance_field_file.h"
#include "core/image/image_io.h"
#include "simulate/tabletop/scene.h"
#include "simulate/tabletop/simulate.h"

namespace refield::cli {

extern const std::string_view rig_template;  // rig.toml, made part of the program by CMake

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
  if (lights.session.empty() && lights.images.empty())
    section.fail("images", "no light maps are given; give images (a folder or a pattern) or a session");
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

void read_recipe_of(const fs::path& path, SessionFile& session) {
  const Recipe recipe = read_recipe(path);
  session.is_recipe = true;
  VirtualCameraOptions camera;
  camera.recipe = path;
  session.camera = camera;
  session.exposure_count = recipe.rig.exposures.count;
  session.exposure_ratio = recipe.rig.exposures.ratio;
  session.longest_exposure = recipe.rig.exposures.longest;
  session.frames = recipe.rig.exposures.frames;
  session.ambient_frames = recipe.rig.exposures.ambient_frames;
  session.reference_every = recipe.rig.reference_every;
  session.order_seed = recipe.seed;
}

RunContext run_with_notices() {
  RunContext run = run_context();
  run.on_note = tell;
  return run;
}

std::optional<Recipe> recipe_of(const SessionFile& session) {
  const auto* simulated = std::get_if<VirtualCameraOptions>(&session.camera);
  return simulated ? std::optional(read_recipe(simulated->recipe)) : std::nullopt;
}

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

/// The virtual camera and monitor of a recipe, with all that it says of them. The scene is traced for each
/// position of a camera that moves.
VirtualRig virtual_rig(const fs::path& truth, const Recipe& recipe) {
  TracedScene scene = scene_of(truth, recipe);
  Recipe traced = recipe;  // 'refield simulate' may have been told another size
  traced.scene.camera.width = scene.transport.width;
  traced.scene.camera.height = scene.transport.height;
  traced.scene.monitor.texels = scene.transport.basis.domain;
  VirtualRig rig(std::move(scene.transport), std::move(scene.ambient), recipe.rig.monitor, recipe.rig.sensor,
                 recipe.seed);
  rig.disturb(recipe.rig.disturbances, [truth, traced](const Disturbances::Move& to) {
    if (to.right_px == 0.0 && to.down_px == 0.0) return scene_of(truth, traced);
    Recipe moved = traced;
    moved.scene.camera = turned(moved.scene.camera, to.right_px, to.down_px);
    return scene_of({}, moved);
  });
  return rig;
}

std::unique_ptr<TetheredCamera> open_camera(const SessionFile& session) {
  if (const auto* genicam = std::get_if<GenicamCameraOptions>(&session.camera))
    return open_camera(*genicam, run_with_notices());
  if (const auto* gphoto = std::get_if<GphotoCameraOptions>(&session.camera))
    return open_camera(*gphoto, run_with_notices());
  return open_camera(std::get<V4l2CameraOptions>(session.camera), run_with_notices());
}

std::unique_ptr<Illuminator> open_monitor(const SessionFile& session) {
  if (!session.window) return std::make_unique<DrmMonitor>(session.monitor);
  auto window = std::make_unique<WindowMonitor>(*session.window);
  if (!window->waits_for_blanking())
    tell(window->describe().name +
         ": does not wait for vertical blanking (a remote or virtual display); its time stamps may be too "
         "early, so the calibration file must contain the latency measured by 'refield acquire calibrate'");
  return window;
}

}  // namespace

void add_rig_argument(CLI::App& verb, fs::path& rig) {
  verb.add_option("rig_file", rig,
                  "Rig file (.toml) that names the devices ('refield acquire devices -o rig.toml' writes "
                  "one), or recipe of a simulated scene, camera and monitor")
      ->required();
}

CLI::Option* add_truth_option(CLI::App& verb, fs::path& truth) {
  return verb.add_option("--truth", truth,
                         "Folder that 'refield simulate' created (from the recipe of a simulated rig; "
                         "default: the scene is traced first)");
}

SessionFile read_session_file(const fs::path& path) {
  const ConfigFile file(path, "rig file or recipe", "docs/reference/devices.md");
  SessionFile session;
  session.path = path;
  if (!file.has("session")) {
    read_recipe_of(path, session);
    return session;
  }
  file.check_names({"session", "camera", "controls", "monitor", "trigger", "lights", "exposures"});
  const fs::path folder = fs::absolute(path).parent_path();
  read_session(file.section("session"), folder, session);
  session.camera = read_camera(file.section("camera"), file.optional_section("controls"), folder);
  read_monitor(file.optional_section("monitor"), session);
  if (file.has("trigger")) session.trigger = read_trigger(file.section("trigger"));
  read_lights(file.section("lights"), folder, session.lights);
  read_exposures(file.optional_section("exposures"), session);
  return session;
}

SessionRig::SessionRig(const SessionFile& session) : recipe_(recipe_of(session)) {
  if (recipe_) {
    virtual_.emplace(virtual_rig(std::get<VirtualCameraOptions>(session.camera).truth, *recipe_));
  } else {
    camera_ = open_camera(session);
    monitor_ = open_monitor(session);
  }
  if (session.trigger) trigger_.emplace(*session.trigger, run_context());
}

std::function<void(std::size_t)> SessionRig::before_light(const std::vector<CaptureLight>& lights) {
  if (!virtual_) return nullptr;
  std::uint32_t references = 0;
  std::vector<std::uint32_t> repetition;
  for (const CaptureLight& light : lights)
    repetition.push_back(light.role == FrameRole::reference ? ++references : 0);
  return [this, repetition](std::size_t i) {
    const double last = std::max<double>(1.0, static_cast<double>(repetition.size()) - 1.0);
    virtual_->set_place(static_cast<double>(i) / last, repetition[i]);
  };
}

void tell(const std::string& sentence) {
  static std::mutex mutex;            // cameras tell from threads of their own
  static std::set<std::string> told;  // devices are opened several times
  const std::scoped_lock lock(mutex);
  if (!told.insert(sentence).second) return;
  std::fprintf(stderr, "\nrefield: note: %s\n", sentence.c_str());
}

std::string session_template() {
  std::string text(rig_template);
  const auto cameras = find_v4l2_cameras();
  if (!cameras.empty()) set_session_value(text, "camera", "device", toml_text(cameras.front().card));
  return text;
}

std::string toml_text(const std::string& text) {
  std::string result = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') result += '\\';
    result += static_cast<unsigned char>(c) < 32 ? '?' : c;
  }
  return result + "\"";
}

void set_session_value(std::string& text, const std::string& section, const std::string& key,
                       const std::string& value) {
  std::istringstream lines(text);
  std::string result, line, rest;
  bool inside = false, is_set = false;
  const auto set = [&](const std::string& comment) {
    std::string entry = key + " = " + value;
    if (!comment.empty()) entry.resize(std::max<std::size_t>(entry.size() + 1, 34), ' ');
    result += entry + comment + "\n";
    is_set = true;
  };
  while (std::getline(lines, line)) {
    const std::string bare = line.starts_with("# ") ? line.substr(2) : line;
    if (bare.starts_with("[")) {
      if (inside && !is_set) set("");
      inside = line.starts_with("[" + section + "]");
    } else if (inside && !is_set && bare.starts_with(key + " = ")) {
      const auto comment =
          bare.find("  # ") != std::string::npos ? bare.find("  # ") + 2 : bare.find(" # ") + 1;
      set(comment == 0 ? "" : bare.substr(comment));
      continue;
    }
    result += line + "\n";
  }
  if (inside && !is_set) set("");
  if (!is_set) {
    result += "\n[" + section + "]\n";
    set("");
  }
  text = result;
}

}  // namespace refield::cli
