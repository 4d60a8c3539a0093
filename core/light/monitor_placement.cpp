// SPDX-License-Identifier: Apache-2.0
#include "core/light/monitor_placement.h"

#include <Eigen/Geometry>

#include <cmath>

#include "core/base/config_file.h"
#include "core/base/number_text.h"
#include "core/base/units.h"
#include "core/light/light_map.h"

namespace refield {

namespace {

constexpr double longest_mm = 1e6;

[[noreturn]] void fail(const std::string& text) {
  throw InputError(
      "--placement ", text,
      ": give width x height @ distance of the screen in mm, such as 520x320@600, and if it is not straight "
      "ahead of the camera, ',yaw=90' (to the right), pitch, roll in degrees and x, y in mm");
}

/// Takes a number off the front of `rest`, and the mark behind it.
double take_number(std::string_view& rest, std::string_view mark, const std::string& text) {
  double value = 0.0;
  const auto [end, error] = std::from_chars(rest.data(), rest.data() + rest.size(), value);
  if (error != std::errc() || !std::isfinite(value)) fail(text);
  rest.remove_prefix(static_cast<std::size_t>(end - rest.data()));
  if (!rest.starts_with(mark)) fail(text);
  rest.remove_prefix(mark.size());
  return value;
}

void require_range(const std::string& name, const char* what, double value, double low, double high) {
  if (!(value >= low && value <= high)) {
    throw InputError(name, ": the monitor's ", what,
                     formatted(" is %g; give a number from %g to %g", value, low, high));
  }
}

}  // namespace

Eigen::Vector3d screen_direction(const MonitorPlacement& monitor, double u, double v) {
  return rotation_of(monitor.turn) * Eigen::Vector3d(monitor.left() + u * (monitor.right() - monitor.left()),
                                                     monitor.top() + v * (monitor.bottom() - monitor.top()),
                                                     1.0);
}

void MonitorPlacement::check(const std::string& name) const {
  require_range(name, "width_mm", width_mm, 1e-3, longest_mm);
  require_range(name, "height_mm", height_mm, 1e-3, longest_mm);
  require_range(name, "distance_mm", distance_mm, 1e-3, longest_mm);
  require_range(name, "yaw", turn.yaw, -360.0, 360.0);
  require_range(name, "pitch", turn.pitch, -360.0, 360.0);
  require_range(name, "roll", turn.roll, -360.0, 360.0);
  require_range(name, "offset_x_mm", offset_x_mm, -longest_mm, longest_mm);
  require_range(name, "offset_y_mm", offset_y_mm, -longest_mm, longest_mm);
}

void check_placements(std::span<const MonitorPlacement> monitors, const LightDomain& domain,
                      const std::string& name) {
  if (monitors.empty()) return;
  if (domain.parameterisation != Parameterisation::monitor)
    throw InputError(name, ": places a monitor, but its light is a ", name_of(domain.parameterisation),
                     " map; remove the monitor");
  const auto count = static_cast<int>(monitors.size());
  if (domain.height % count != 0)
    throw InputError(name, ": has ", count, " monitor placements, and light maps ", domain.height,
                     " texels high, which do not divide into as many equal windows");
  for (const MonitorPlacement& monitor : monitors) monitor.check(name);
}

bool read_placement(ConfigSection& section, MonitorPlacement& place) {
  bool given = false;
  const auto read = [&](const char* key, double& value, double low, double high) {
    section.number(key, value, low, high);
    given = given || section.has(key);
  };
  read("width_mm", place.width_mm, 1e-3, longest_mm);
  read("height_mm", place.height_mm, 1e-3, longest_mm);
  read("distance_mm", place.distance_mm, 1e-3, longest_mm);
  read("yaw_degrees", place.turn.yaw, -360.0, 360.0);
  read("pitch_degrees", place.turn.pitch, -360.0, 360.0);
  read("roll_degrees", place.turn.roll, -360.0, 360.0);
  read("offset_x_mm", place.offset_x_mm, -longest_mm, longest_mm);
  read("offset_y_mm", place.offset_y_mm, -longest_mm, longest_mm);
  if (!given) return false;
  for (const char* key : {"width_mm", "height_mm", "distance_mm"}) section.require(key);
  return true;
}

MonitorPlacement v0_2::monitor_placement_from_text(const std::string& text) {
  std::string_view rest = text;
  MonitorPlacement monitor;
  monitor.width_mm = take_number(rest, "x", text);
  monitor.height_mm = take_number(rest, "@", text);
  monitor.distance_mm = take_number(rest, "", text);
  while (!rest.empty()) {
    const auto equals = rest.find('=');
    if (rest.front() != ',' || equals == std::string_view::npos) fail(text);
    const std::string_view key = rest.substr(1, equals - 1);
    double* value = key == "yaw"     ? &monitor.turn.yaw
                    : key == "pitch" ? &monitor.turn.pitch
                    : key == "roll"  ? &monitor.turn.roll
                    : key == "x"     ? &monitor.offset_x_mm
                    : key == "y"     ? &monitor.offset_y_mm
                                     : nullptr;
    if (!value) fail(text);
    rest.remove_prefix(equals + 1);
    *value = take_number(rest, "", text);
  }
  monitor.check("--placement " + text);
  return monitor;
}

std::vector<MonitorPlacement> v0_2::placements_from_texts(const std::vector<std::string>& texts) {
  std::vector<MonitorPlacement> monitors;
  for (const std::string& text : texts) monitors.push_back(monitor_placement_from_text(text));
  return monitors;
}

std::string v0_2::text_of(const MonitorPlacement& monitor) {
  std::string text = formatted("%gx%g@%g", monitor.width_mm, monitor.height_mm, monitor.distance_mm);
  const auto add = [&](const char* key, double value) {
    if (value != 0.0) text += formatted(",%s=%g", key, value);
  };
  add("yaw", monitor.turn.yaw);
  add("pitch", monitor.turn.pitch);
  add("roll", monitor.turn.roll);
  add("x", monitor.offset_x_mm);
  add("y", monitor.offset_y_mm);
  return text;
}

Eigen::Matrix3d rotation_of(const EulerAngles& turn) {
  constexpr double max_degrees = 1e6;
  for (const auto& [name, angle] : {std::pair("yaw", turn.yaw), {"pitch", turn.pitch}, {"roll", turn.roll}})
    if (!(std::abs(angle) <= max_degrees)) {
      throw InputError(formatted("%s: is %g degrees; give an angle from -1e6 to 1e6", name, angle));
    }
  return (Eigen::AngleAxisd(radians_from_degrees(turn.yaw), Eigen::Vector3d::UnitY()) *
          Eigen::AngleAxisd(radians_from_degrees(turn.pitch), Eigen::Vector3d::UnitX()) *
          Eigen::AngleAxisd(radians_from_degrees(turn.roll), Eigen::Vector3d::UnitZ()))
      .toRotationMatrix();
}

bool EulerAngles::is_none() const {
  return std::fmod(yaw, 360.0) == 0.0 && std::fmod(pitch, 360.0) == 0.0 && std::fmod(roll, 360.0) == 0.0;
}

}  // namespace refield
