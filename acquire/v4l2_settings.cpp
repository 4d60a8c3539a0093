// SPDX-License-Identifier: Apache-2.0
#include "acquire/v4l2_settings.h"

#include <linux/videodev2.h>

#include <algorithm>
#include <array>
#include <cerrno>

#include "core/errors.h"

namespace refield {

namespace {

/// A control that lets the camera change pictures on its own.
struct AutomaticMode {
  std::uint32_t id;
  std::int64_t off;
  const char* what;
  bool spoils_captures;  ///< no session can be trusted with it
};

constexpr std::array automatic_modes = {
    AutomaticMode{V4L2_CID_EXPOSURE_AUTO, V4L2_EXPOSURE_MANUAL, "exposure", true},
    AutomaticMode{V4L2_CID_AUTOGAIN, 0, "gain", true},
    AutomaticMode{V4L2_CID_ISO_SENSITIVITY_AUTO, V4L2_ISO_SENSITIVITY_MANUAL, "ISO sensitivity", true},
    AutomaticMode{V4L2_CID_AUTO_WHITE_BALANCE, 0, "white balance", true},
    AutomaticMode{V4L2_CID_AUTOBRIGHTNESS, 0, "brightness", true},
    AutomaticMode{V4L2_CID_WIDE_DYNAMIC_RANGE, 0, "tone mapping", true},
    AutomaticMode{V4L2_CID_FOCUS_AUTO, 0, "focus", true},
    AutomaticMode{V4L2_CID_EXPOSURE_AUTO_PRIORITY, 0, "frame rate", false},
    AutomaticMode{V4L2_CID_HUE_AUTO, 0, "hue", false},
    AutomaticMode{V4L2_CID_CHROMA_AGC, 0, "chroma gain", false},
    AutomaticMode{V4L2_CID_BACKLIGHT_COMPENSATION, 0, "backlight compensation", false},
    AutomaticMode{V4L2_CID_IMAGE_STABILIZATION, 0, "image stabilisation", false},
    AutomaticMode{V4L2_CID_POWER_LINE_FREQUENCY, V4L2_CID_POWER_LINE_FREQUENCY_DISABLED, "flicker reduction",
                  false},
};

std::string range_text(const V4l2ControlInfo& control) {
  if (!control.menu.empty()) {
    std::string text = "its choices are";
    for (const std::string& choice : control.menu) text += " " + choice;
    return text;
  }
  return "its range is " + std::to_string(control.lowest) + " to " + std::to_string(control.highest) +
         " in steps of " + std::to_string(control.step);
}

}  // namespace

V4l2Settings::V4l2Settings(const V4l2Device& device, const std::map<std::string, std::int64_t>& wanted)
    : device_(device), controls_(controls_of(device)) {
  switch_off_automatic_modes(wanted);
  make(wanted);
  if (const auto* control = find(V4L2_CID_EXPOSURE_ABSOLUTE)) exposure_ = *control;
  for (std::uint32_t id : {V4L2_CID_ANALOGUE_GAIN, V4L2_CID_GAIN})
    if (const auto* control = find(id); control && !gain_) gain_ = *control;
}

const V4l2ControlInfo* V4l2Settings::find(std::uint32_t id) const {
  const auto found = std::ranges::find(controls_, id, &V4l2ControlInfo::id);
  return found == controls_.end() ? nullptr : &*found;
}

void V4l2Settings::switch_off_automatic_modes(const std::map<std::string, std::int64_t>& wanted) {
  for (const AutomaticMode& mode : automatic_modes) {
    const V4l2ControlInfo* control = find(mode.id);
    if (!control || wanted.contains(control->name)) continue;
    v4l2_control setting{mode.id, static_cast<__s32>(mode.off)};
    device_.try_call(VIDIOC_S_CTRL, &setting);
    v4l2_control now{mode.id, 0};
    device_.call(VIDIOC_G_CTRL, &now, "does not report its control " + control->name);
    if (now.value == mode.off) continue;
    const std::string sentence = std::string("keeps choosing its ") + mode.what + " by itself (control " +
                                 control->name + " stays at " + std::to_string(now.value) + ")";
    if (mode.spoils_captures)
      throw DeviceError(device_.node().string(), EINVAL,
                        sentence +
                            "; photographs would not be comparable: use another camera, or set the control "
                            "in the session file");
    warnings_.push_back(device_.node().string() + ": " + sentence);
  }
}

void V4l2Settings::make(const std::map<std::string, std::int64_t>& wanted) {
  for (const auto& [name, value] : wanted) {
    const auto control = std::ranges::find(controls_, name, &V4l2ControlInfo::name);
    const std::string prefix = device_.node().string() + ": control " + name;
    if (control == controls_.end())
      throw InputError(prefix + " is not there; 'refield acquire devices' lists controls");
    if (value < control->lowest || value > control->highest)
      throw InputError(prefix + " = " + std::to_string(value) + ": " + range_text(*control));
    if (const std::int64_t now = set(*control, value); now != value)
      throw DeviceError(device_.node().string(), EINVAL,
                        "control " + name + " reads " + std::to_string(now) + " after it was set to " +
                            std::to_string(value) + "; " + range_text(*control));
  }
}

std::int64_t V4l2Settings::set(const V4l2ControlInfo& control, std::int64_t value) const {
  v4l2_control setting{control.id, static_cast<__s32>(value)};
  device_.call(VIDIOC_S_CTRL, &setting, "refuses control " + control.name + " = " + std::to_string(value));
  v4l2_control now{control.id, 0};
  device_.call(VIDIOC_G_CTRL, &now, "does not report its control " + control.name);
  return now.value;
}

}  // namespace refield
