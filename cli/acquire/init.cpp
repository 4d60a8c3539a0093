// SPDX-License-Identifier: Apache-2.0
// A rig file to fill in.
#include <cerrno>
#include <cstdio>
#include <memory>
#include <sstream>
#include <string>

#include "acquire/devices/v4l2_device.h"
#include "cli/acquire/session_rig.h"
#include "cli/verbs.h"
#include "core/base/errors.h"
#include "core/base/files.h"

namespace refield::cli {

namespace {

namespace fs = std::filesystem;

// Keys without a comment sign must be there or are worth a look; the others are at their defaults.
constexpr const char* before_camera =
    R"(# Settings of 'refield acquire run': devices, light maps and exposures (docs/reference/devices.md). Paths are
# relative to this file. Lines that start with "# key =" show the default of a key or, if it has none, an example.

[session]
output = "session"                # folder to create
calibration = "calibration.toml"  # 'refield acquire calibrate' writes it, 'refield acquire run' reads it
# reference_every = 20            # lights between two frames of the reference light (measures drift); 0: none
# reference_light = "white.exr"   # reference light; default: the white light map, else the first
# mask = "mask.png"               # mask image, white where the scene is; default: all pixels
# auto_mask = false               # true: mask the pixels that respond to a white monitor
# background = "empty.exr"        # with auto_mask: photograph without the objects; the scene is what differs
# order = "given"                 # order of the training lights: given, random or useful (most informative first)
# until_error = "2%"              # stop at this predicted error; default: photograph all lights
# keep_raw = false                # true: store each exposure as a 16-bit PNG
# half = false                    # true: half-float photographs, half the size, relative rounding error 0.05 %
# preview = "last.png"            # preview image, replaced after each photograph; default: none

[camera]
)";

constexpr const char* after_camera =
    R"(# pixel_format = "RGGB"           # default: the raw format with the most bits
# width = 1920                    # pixels; default: the size that the camera is set to
# height = 1080
# fps = 30                        # frames per second; default: set by the camera
# region = [200, 100, 1280, 800]  # region of the frame in pixels: left, top, width, height; default: all
# unit_gain = 100                 # value of the gain control for gain 1; default: the control is not changed
# fixed_exposure = 0.01           # seconds, for a camera without an exposure control
# replug_patience = 30            # seconds to wait for an unplugged camera
# truth = "truth"                 # with virtual: folder of 'refield simulate'; default: the scene is traced

[controls]                        # camera controls, with the names that 'refield acquire devices' prints
# white_balance_temperature = 5000
# focus_absolute = 30

[monitor]
# connector = "HDMI-A-1"          # default: the first connector with a monitor
# card = "/dev/dri/card0"         # default: the first card with the connector
# mode = "1920x1080@60"           # default: preferred mode of the monitor
# window = false                  # true: full-screen window on a desktop instead of a connector
# display = 0                     # with window: number of the desktop display
width = 160                       # size of the light maps, texels; each is shown as a square of whole pixels
height = 90
# width_mm = 520                  # size of the screen, for relighting by environment maps
# height_mm = 320                 # (docs/guide/relighting.md); default: unknown
# distance_mm = 600               # distance from the centre of the scene to the plane of the screen
# yaw_degrees = 0                 # direction of the screen from the scene: 0 is the viewing direction of the camera
# pitch_degrees = 0
# roll_degrees = 0
# offset_x_mm = 0                 # offset of the screen's centre from the point straight ahead
# offset_y_mm = 0

# [trigger]                       # for a camera with an external trigger
# chip = "gpiochip0"              # name or label of the GPIO chip
# line = 17
# active_low = false
# pulse_ms = 1                    # length of the trigger pulse in milliseconds
# timeout = 2                     # seconds to wait for a frame
# ready_line = 4                  # output lines of the camera: ready for a trigger, exposing; default: none
# ready_active_low = false
# strobe_line = 5
# strobe_active_low = false
# light_source_line = 6                   # line that switches the light on during the capture; default: none
# light_source_active_low = false

[lights]
images = "lights/train_*.exr"     # training light maps: 'refield acquire lights --starter -o lights'
test_images = "lights/test_*.exr" # held-out light maps, which measure the error
# session = "other"               # use the lights of another session, with their roles
# panorama = "room.exr"           # lat-long environment map; the monitor shows views of it
# rotations = 60                  # number of views of the panorama
# vertical_fov_degrees = 90       # of a view
# white_percentile = 99           # percentile of the panorama's brightness that is shown as white

[exposures]
# seconds = [0.005, 0.02, 0.08]   # default: metered under white, with 'count' and 'ratio'
# count = 4
# ratio = 4
# max_noise = "2%"                # alternative: the smallest number of exposures with noise per sample below this
# averaged_frames = 1             # number of averaged frames per exposure
# ambient_frames = 0              # averaged frames per exposure of the ambient photograph; 0: a number by
#                                 # that of the lights
# gain = 1
)";

/// A camera that is there, else a name to replace.
std::string camera_line() {
  std::string device;
  for (const V4l2Identity& camera : find_v4l2_cameras())
    if (device.empty()) device = camera.card;
  std::string line = "device = " + toml_text(device.empty() ? "HD Pro Webcam C920" : device);
  line.resize(std::max<std::size_t>(line.size() + 1, 34), ' ');
  return line + (device.empty() ? "# 'refield acquire devices' lists names" : "# found on this machine") +
         "; also /dev/video0, a bus, genicam:SERIAL, gphoto:MODEL or\n"
         "                                  # virtual:RECIPE.toml, a simulated rig\n";
}

}  // namespace

std::string session_template() {
  return before_camera + camera_line() + after_camera;
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
