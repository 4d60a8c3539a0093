// SPDX-License-Identifier: Apache-2.0
// What a V4L2 camera offers: formats, sizes, rates, controls.
#include <linux/videodev2.h>

#include <algorithm>
#include <cctype>
#include <functional>

#include "acquire/v4l2_device.h"

namespace refield {

namespace {

double rate_of(const v4l2_fract& interval) {
  return interval.numerator ? static_cast<double>(interval.denominator) / interval.numerator : 0.0;
}

std::vector<double> rates_of(const V4l2Device& device, std::uint32_t fourcc, int width, int height) {
  std::vector<double> rates;
  v4l2_frmivalenum entry{};
  entry.pixel_format = fourcc;
  entry.width = static_cast<__u32>(width);
  entry.height = static_cast<__u32>(height);
  for (; device.try_call(VIDIOC_ENUM_FRAMEINTERVALS, &entry) == 0; ++entry.index) {
    if (entry.type == V4L2_FRMIVAL_TYPE_DISCRETE) {
      rates.push_back(rate_of(entry.discrete));
      continue;
    }
    rates = {rate_of(entry.stepwise.min), rate_of(entry.stepwise.max)};
    break;
  }
  std::ranges::sort(rates, std::greater<>());
  return rates;
}

std::vector<V4l2FrameSize> sizes_of(const V4l2Device& device, std::uint32_t fourcc) {
  std::vector<V4l2FrameSize> sizes;
  const auto add = [&](__u32 width, __u32 height) {
    const auto w = static_cast<int>(width);
    const auto h = static_cast<int>(height);
    sizes.push_back({w, h, rates_of(device, fourcc, w, h)});
  };
  v4l2_frmsizeenum entry{};
  entry.pixel_format = fourcc;
  for (; device.try_call(VIDIOC_ENUM_FRAMESIZES, &entry) == 0; ++entry.index) {
    if (entry.type == V4L2_FRMSIZE_TYPE_DISCRETE) {
      add(entry.discrete.width, entry.discrete.height);
      continue;
    }
    add(entry.stepwise.min_width, entry.stepwise.min_height);
    add(entry.stepwise.max_width, entry.stepwise.max_height);
    break;
  }
  return sizes;
}

/// "Exposure Time, Absolute" as "exposure_time_absolute".
std::string control_name(const char* text) {
  std::string name;
  for (; *text; ++text) {
    if (std::isalnum(static_cast<unsigned char>(*text)))
      name += static_cast<char>(std::tolower(static_cast<unsigned char>(*text)));
    else if (!name.empty() && name.back() != '_')
      name += '_';
  }
  if (name.ends_with('_')) name.pop_back();
  return name;
}

std::vector<std::string> menu_of(const V4l2Device& device, const v4l2_query_ext_ctrl& control) {
  std::vector<std::string> menu;
  if (control.type != V4L2_CTRL_TYPE_MENU && control.type != V4L2_CTRL_TYPE_INTEGER_MENU) return menu;
  for (std::int64_t i = control.minimum; i <= control.maximum; ++i) {
    v4l2_querymenu entry{};
    entry.id = control.id;
    entry.index = static_cast<__u32>(i);
    if (device.try_call(VIDIOC_QUERYMENU, &entry) != 0) continue;
    menu.push_back(std::to_string(i) + "=" +
                   (control.type == V4L2_CTRL_TYPE_MENU ? reinterpret_cast<const char*>(entry.name)
                                                        : std::to_string(entry.value)));
  }
  return menu;
}

}  // namespace

std::vector<V4l2FormatInfo> formats_of(const V4l2Device& device) {
  std::vector<V4l2FormatInfo> formats;
  v4l2_fmtdesc entry{};
  entry.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  for (; device.try_call(VIDIOC_ENUM_FMT, &entry) == 0; ++entry.index)
    formats.push_back({entry.pixelformat, reinterpret_cast<const char*>(entry.description),
                       sizes_of(device, entry.pixelformat)});
  return formats;
}

std::vector<V4l2ControlInfo> controls_of(const V4l2Device& device) {
  std::vector<V4l2ControlInfo> controls;
  v4l2_query_ext_ctrl control{};
  control.id = V4L2_CTRL_FLAG_NEXT_CTRL;
  for (; device.try_call(VIDIOC_QUERY_EXT_CTRL, &control) == 0; control.id |= V4L2_CTRL_FLAG_NEXT_CTRL) {
    const bool is_number = control.type == V4L2_CTRL_TYPE_INTEGER || control.type == V4L2_CTRL_TYPE_BOOLEAN ||
                           control.type == V4L2_CTRL_TYPE_MENU || control.type == V4L2_CTRL_TYPE_INTEGER_MENU;
    if (!is_number || control.flags & V4L2_CTRL_FLAG_DISABLED) continue;
    v4l2_control current{control.id, 0};
    if (device.try_call(VIDIOC_G_CTRL, &current) != 0) continue;
    controls.push_back({control.id, control_name(control.name), control.minimum, control.maximum,
                        static_cast<std::int64_t>(control.step), control.default_value, current.value,
                        menu_of(device, control), !(control.flags & V4L2_CTRL_FLAG_READ_ONLY)});
  }
  return controls;
}

}  // namespace refield
