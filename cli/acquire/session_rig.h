// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <CLI/CLI.hpp>

#include <variant>

#include "acquire/capture/capture.h"
#include "acquire/devices/gpio_trigger.h"
#include "acquire/devices/monitors.h"
#include "acquire/devices/tethered_camera.h"
#include "acquire/illuminator.h"
#include "simulate/rig/virtual_rig.h"
#include "simulate/tabletop/recipe.h"

namespace refield::cli {

/// What a session is lit by.
struct SessionLights {
  fs::path session;         ///< another session, whose lights with their roles are shown
  std::string images;       ///< folder or pattern of light maps to estimate from
  std::string test_images;  ///< held out
};

/// The simulated camera and monitor of a recipe, instead of devices.
struct VirtualCameraOptions : CameraOptions {
  fs::path recipe;
  fs::path truth;                               ///< folder of 'refield simulate'; empty: traced when opened
  std::map<std::string, std::string> controls;  ///< none; for code that treats all cameras alike
};

/// A rig file, or what a recipe says of the capture of its scene: everything that `refield acquire run` needs
/// to know, see docs/reference/devices.md.
struct SessionFile {
  fs::path path;
  bool is_recipe = false;
  fs::path output;
  fs::path calibration;  ///< empty: what the recipe says, without error
  /// By the prefixes "genicam:", "gphoto:" and "virtual:".
  std::variant<V4l2CameraOptions, GenicamCameraOptions, GphotoCameraOptions, VirtualCameraOptions> camera;
  DrmMonitorOptions monitor;
  std::optional<WindowMonitorOptions> window;  ///< instead of `monitor`
  std::vector<MonitorPlacement> placements;    ///< where the monitor stands, one or, if it is not known, none
  std::optional<GpioTriggerOptions> trigger;
  SessionLights lights;
  std::vector<double> exposures;  ///< seconds; empty: by count and ratio
  int exposure_count = 4;
  double exposure_ratio = 4.0;
  std::optional<Seconds> longest_exposure;  ///< else metered
  std::string max_noise;  ///< instead: as few exposures as keep it below this share, such as "2%"
  int frames = 1;
  int ambient_frames = 0;  ///< CaptureRequest::ambient_repeats
  double gain = 1.0;
  fs::path mask, background;
  bool auto_mask = false;
  int reference_every = 20;
  fs::path reference_light;
  std::string order = "given";
  std::uint64_t order_seed = 1;
  std::string until_error;
  bool keep_raw = false;
  bool half = false;
  fs::path preview;  ///< PNG of the last photograph, replaced by each; empty: none
};

/// Reads a rig file, in which paths are relative to its folder, or a recipe, which has no section "session"
/// and says neither output nor lights. Throws InputError naming file, line, key, value and remedy.
SessionFile read_session_file(const fs::path& path);

/// The argument "rig", a rig file or a recipe, and --truth.
void add_rig_argument(CLI::App& verb, fs::path& rig);
CLI::Option* add_truth_option(CLI::App& verb, fs::path& truth);

/// A rig file to fill in, with all keys.
std::string session_template();

/// Sets a key of a rig file, whose comments stay. `value` is in TOML's notation.
void set_session_value(std::string& text, const std::string& section, const std::string& key,
                       const std::string& value);
/// A text in TOML's notation.
std::string toml_text(const std::string& text);

/// The devices that a rig file names, opened.
class SessionRig {
 public:
  /// Throws InputError for what a device cannot do, DeviceError where one is missing or refuses.
  explicit SessionRig(const SessionFile& session);

  Camera& camera() { return virtual_ ? virtual_->camera() : *camera_; }
  Illuminator& monitor() { return virtual_ ? virtual_->illuminator() : *monitor_; }
  /// For CaptureRequest::before_light: tells a virtual rig how far the capture is, see
  /// VirtualRig::set_place(); null for real devices.
  std::function<void(std::size_t)> before_light(const std::vector<CaptureLight>& lights);
  /// Null for real devices.
  const Recipe* recipe() const { return recipe_ ? &*recipe_ : nullptr; }
  /// None for virtual devices.
  CameraTroubles troubles() const { return camera_ ? camera_->troubles() : CameraTroubles(); }
  Trigger* trigger() { return trigger_ ? &*trigger_ : nullptr; }

 private:
  std::optional<Recipe> recipe_;
  std::optional<VirtualRig> virtual_;
  std::unique_ptr<TetheredCamera> camera_;
  std::unique_ptr<Illuminator> monitor_;
  std::optional<GpioTrigger> trigger_;
};

/// Prints an image on the terminal in 24-bit colour, two pixels per character, no wider than the terminal.
/// Returns the number of lines.
int print_image(const Image& image);

/// Shows the frames of the camera on the terminal under a white monitor, each with its sharpness, until Enter
/// is pressed; the exposure follows the brightness. Of a camera that takes photographs, one is shown.
void live_view(SessionRig& rig, double gain);

/// On standard error, where progress is, too: what a person should know but need not act on. A sentence is
/// printed once.
void tell(const std::string& sentence);

}  // namespace refield::cli
