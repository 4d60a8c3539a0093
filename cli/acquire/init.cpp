// SPDX-License-Identifier: Apache-2.0
// refield acquire init: a session file to fill in.
#include <cerrno>
#include <cstdio>
#include <memory>
#include <string>

#include "acquire/v4l2_device.h"
#include "cli/acquire/verbs.h"
#include "core/errors.h"
#include "core/files.h"

namespace refield::cli {

namespace {

namespace fs = std::filesystem;

// Keys without a comment sign must be there or are worth a look; the others are at their defaults.
constexpr const char* before_camera =
    R"(# What 'refield acquire run' photographs, and with which devices (docs/reference/devices.md). Paths are
# relative to this file. Lines that begin with "# key =" show a key's default or, where it has none, an example.

[session]
output = "session"                # folder to make
calibration = "calibration.toml"  # 'refield acquire calibrate' writes it, 'refield acquire run' reads it
# reference_every = 20            # lights between two frames of one reference light, by which drift is measured; 0: none
# reference_light = "white.exr"   # that light; default: the white one, else the first
# mask = "mask.png"               # painted mask, white where the scene is; default: all pixels
# auto_mask = false               # true: mask the pixels that respond to the monitor's white
# background = "empty.exr"        # with auto_mask: photograph without the objects; what differs is the scene
# order = "given"                 # of the lights to estimate from: given, random or useful (most informative first)
# until_error = "2%"              # stop when the predicted error falls to this; default: photograph all lights
# keep_raw = false                # true: keep each exposure as a 16-bit PNG
# half = false                    # true: half-float photographs, half the size, rounding of 0.05 %
# preview = "last.png"            # the last photograph, replaced by each; default: none

[camera]
)";

constexpr const char* after_camera =
    R"(# format = "RGGB"                 # default: raw before processed, more bits first
# width = 1920                    # pixels; default: the format's largest
# height = 1080
# rate = 30                       # frames per second; default: the camera's
# window = [200, 100, 1280, 800]  # part of the frame to keep, pixels: left, top, width, height; default: all
# unit_gain = 100                 # value of the gain control that stands for gain 1; default: the control is left alone
# fixed_exposure = 0.01           # seconds, for a camera without an exposure control
# replug_patience = 30            # seconds to wait for an unplugged camera

[controls]                        # of the camera, by the names that 'refield acquire devices' prints
# white_balance_temperature = 5000
# focus_absolute = 30

[monitor]
# connector = "HDMI-A-1"          # default: the first one with a monitor
# card = "/dev/dri/card0"         # default: the first one that has the connector
# mode = "1920x1080@60"           # default: the monitor's preferred one
# window = false                  # true: a full-screen window in a desktop instead of a connector
# display = 0                     # with window: which display of the desktop
width = 160                       # size of the light maps, texels; each is shown as a square of whole pixels
height = 90
# width_mm = 520                  # where the screen stands as seen from the scene, for relighting by environment
# height_mm = 320                 # maps (docs/guide/relighting.md); default: not known
# distance_mm = 600               # millimetres from the scene's middle to the screen's plane
# yaw_degrees = 0                 # direction of the screen from the scene: 0 is where the camera looks
# pitch_degrees = 0
# roll_degrees = 0
# offset_x_mm = 0                 # of the screen's middle from the point straight ahead
# offset_y_mm = 0

# [trigger]                       # where the camera waits for one
# chip = "gpiochip0"              # or its label
# line = 17
# active_low = false
# pulse_ms = 1                    # milliseconds
# timeout = 2                     # seconds
# ready_line = 4                  # lines that the camera drives: ready for a trigger, exposing; default: none
# ready_active_low = false
# strobe_line = 5
# strobe_active_low = false
# lamp_line = 6                   # switched on for the capture; default: none
# lamp_active_low = false

[lights]
images = "lights/train_*.exr"     # light maps to estimate from: 'refield acquire lights --starter -o lights'
test_images = "lights/test_*.exr" # photographed as well, but held out: they measure the error
# session = "other"               # the lights of another session, with their roles
# panorama = "room.exr"           # lat-long map, of which the monitor shows views
# rotations = 60                  # views of the panorama
# fov_degrees = 90                # vertical, of a view
# white_percentile = 99           # of the panorama's brightness: shown as the monitor's white

[exposures]
# seconds = [0.005, 0.02, 0.08]   # default: metered under white, 'count' of them, each 'ratio' times the one before
# count = 4
# ratio = 4
# noise = "2%"                    # instead: as few exposures as keep the noise of a sample below this
# frames = 1                      # per exposure, averaged
# ambient_frames = 4              # the same for the ambient photograph
# gain = 1
)";

/// A camera that is there, else a name to replace.
std::string camera_line() {
  std::string device;
  for (const V4l2Identity& camera : find_v4l2_cameras())
    if (device.empty()) device = camera.card;
  std::string line = "device = \"";
  for (const char c : device.empty() ? std::string("HD Pro Webcam C920") : device)
    line += c == '"' || c == '\\' || static_cast<unsigned char>(c) < 32 ? '?' : c;
  line += "\"";
  line.resize(std::max<std::size_t>(line.size() + 1, 34), ' ');
  return line +
         (device.empty() ? "# replace it: 'refield acquire devices' lists names"
                         : "# found on this machine") +
         "; also /dev/video0 or a bus\n";
}

void init(const fs::path& file) {
  std::error_code error;
  if (fs::exists(fs::symlink_status(file, error)))
    throw InputError(file.string() + ": exists; name another file, or remove it");
  write_text_atomically(file, before_camera + camera_line() + after_camera);
  std::printf(
      "%s: edit [camera] and [monitor], then\n"
      "  refield acquire lights --starter -o lights\n"
      "  refield acquire calibrate %s\n"
      "  refield acquire run %s\n",
      file.c_str(), file.c_str(), file.c_str());
}

}  // namespace

void add_acquire_init(CLI::App& group, const Common& /*common*/, Action& action) {
  const auto file = std::make_shared<fs::path>("session.toml");
  CLI::App* verb = group.add_subcommand(
      "init",
      "Write a session file with all keys, their units and defaults, to edit: it names the devices for "
      "'refield acquire\n"
      "calibrate' and 'refield acquire run'. A capture by hand (docs/guide/capture.md) needs none.\n\n"
      "Example:\n"
      "  refield acquire init session.toml");
  verb->add_option("file", *file, "Session file to write (.toml)")->capture_default_str();
  verb->callback([file, &action] { action = [file] { init(*file); }; });
}

}  // namespace refield::cli
