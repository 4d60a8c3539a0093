// SPDX-License-Identifier: Apache-2.0
#include "acquire/calibrate/calibration.h"

#define TOML_EXCEPTIONS 1

#include <toml++/toml.h>

#include <algorithm>
#include <cmath>
#include <sstream>
#include <string>

#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/image/image_io.h"

namespace refield {

namespace {

constexpr int drive_level_count = 256;

std::size_t full_scale(int bits) {
  return (std::size_t{1} << bits) - 1;
}

[[noreturn]] void refuse(const std::string& where, const std::string& what) {
  throw InputError(where + ": " + what + "; repair that entry or calibrate again");
}

void require_positive(double value, const char* name, const std::string& where) {
  if (!(std::isfinite(value) && value > 0.0))
    refuse(where, std::string(name) + " is " + std::to_string(value) + " and must be above zero");
}

/// The level whose light above black is nearest to `wanted`.
std::uint8_t nearest_level(const std::vector<float>& radiance, float wanted) {
  const float target = radiance.front() + wanted;
  const auto above = std::ranges::lower_bound(radiance, target);
  if (above == radiance.begin()) return 0;
  // The lowest level that emits as much as the level just below the target.
  const auto below = std::ranges::lower_bound(radiance.begin(), above, *(above - 1));
  const bool take_below = above == radiance.end() || target - *below <= *above - target;
  return static_cast<std::uint8_t>((take_below ? below : above) - radiance.begin());
}

}  // namespace

bool CameraCalibration::is_linear() const {
  for (std::size_t dn = 0; dn < linear_from_dn.size(); ++dn)
    if (linear_from_dn[dn] != static_cast<float>(dn)) return false;
  return true;
}

void CameraCalibration::check(const std::string& where) const {
  if (bits < 1 || bits > 16) refuse(where, "bits is " + std::to_string(bits) + " and must be 1 to 16");
  const std::size_t size = full_scale(bits) + 1;
  if (linear_from_dn.size() != size)
    refuse(where, "the inverse response has " + std::to_string(linear_from_dn.size()) + " entries, " +
                      std::to_string(bits) + " bits need " + std::to_string(size));
  for (std::size_t dn = 0; dn < size; ++dn) {
    if (!std::isfinite(linear_from_dn[dn]))
      refuse(where, "entry " + std::to_string(dn) + " of the inverse response is not finite");
    if (dn > 0 && linear_from_dn[dn] < linear_from_dn[dn - 1])
      refuse(where, "the inverse response falls at entry " + std::to_string(dn));
  }
  if (linear_from_dn.front() == linear_from_dn.back()) refuse(where, "the inverse response is constant");
  if (!(saturation_dn >= 1.0 && saturation_dn <= static_cast<double>(full_scale(bits))))
    refuse(where, "saturation_dn is " + std::to_string(saturation_dn) + " and must be 1 to " +
                      std::to_string(full_scale(bits)));
  if (!(black_level_dn >= 0.0 && black_level_dn < linear_from_dn[static_cast<std::size_t>(saturation_dn)]))
    refuse(where, "black_level_dn is " + std::to_string(black_level_dn) +
                      " and must lie between 0 and the saturation");
  require_positive(electrons_per_dn, "electrons_per_dn", where);
  require_positive(electrons_per_radiance_second, "electrons_per_radiance_second", where);
  if (!(std::isfinite(read_noise_electrons) && read_noise_electrons >= 0.0))
    refuse(where, "read_noise_electrons is " + std::to_string(read_noise_electrons));
  flat_field.check(where + ", flat field");
}

std::vector<float> linear_response(int bits) {
  std::vector<float> table(full_scale(bits) + 1);
  for (std::size_t dn = 0; dn < table.size(); ++dn) table[dn] = static_cast<float>(dn);
  return table;
}

std::vector<float> gamma_response(int bits, double gamma) {
  std::vector<float> table(full_scale(bits) + 1);
  const auto full = static_cast<double>(full_scale(bits));
  for (std::size_t dn = 0; dn < table.size(); ++dn)
    table[dn] = static_cast<float>(full * std::pow(static_cast<double>(dn) / full, gamma));
  return table;
}

std::vector<float> srgb_response(int bits) {
  std::vector<float> table(full_scale(bits) + 1);
  const auto full = static_cast<float>(full_scale(bits));
  for (std::size_t dn = 0; dn < table.size(); ++dn)
    table[dn] = full * linear_from_srgb(static_cast<float>(dn) / full);
  return table;
}

void MonitorCalibration::check(const std::string& where) const {
  for (const auto& table : radiance_from_level) {
    if (table.size() != drive_level_count)
      refuse(where,
             "a tone curve of the monitor has " + std::to_string(table.size()) + " entries instead of 256");
    for (int level = 0; level < drive_level_count; ++level) {
      if (!(std::isfinite(table[level]) && table[level] >= 0.0f))
        refuse(where, "the monitor's radiance at level " + std::to_string(level) + " is " +
                          std::to_string(table[level]));
      if (level > 0 && table[level] < table[level - 1])
        refuse(where, "the monitor's radiance falls at level " + std::to_string(level));
    }
    if (table.front() == table.back())
      refuse(where, "a channel of the monitor emits the same light at all levels");
  }
  uniformity.check(where + ", uniformity of the screen");
}

void TimingCalibration::check(const std::string& where) const {
  const auto require_time = [&](Seconds time, const char* name) {
    if (!(std::isfinite(time.count()) && time.count() >= 0.0))
      refuse(where, std::string(name) + " is " + std::to_string(time.count()) + " s");
  };
  require_time(display_latency, "the display's latency");
  require_time(display_settling, "the display's settling");
  require_time(refresh_period, "the refresh period");
  require_time(exposure_unit, "the exposure unit");
  if (control_latency_frames < 0 || control_latency_frames > 1000)
    refuse(where, "control_latency_frames is " + std::to_string(control_latency_frames));
}

DriveImage drive_levels(const Image& wanted, const MonitorCalibration& monitor, std::size_t* out_of_range) {
  if (wanted.channels != 3) throw InputError("a light pattern needs 3 channels, not " + shape_text(wanted));
  DriveImage drive{wanted.width, wanted.height, std::vector<std::uint8_t>(wanted.values.size())};
  std::size_t too_bright = 0;
  for (std::size_t i = 0; i < wanted.values.size(); ++i) {
    const auto& table = monitor.radiance_from_level[i % 3];
    drive.levels[i] = nearest_level(table, wanted.values[i]);
    const float half_a_step =
        (table[255] - table[254]) / 2.0f;  // white is as near to this as any level can be
    too_bright += wanted.values[i] > table.back() - table.front() + half_a_step;
  }
  if (out_of_range) *out_of_range = too_bright;
  return drive;
}

Image emitted_above_black(const DriveImage& drive, const MonitorCalibration& monitor) {
  Image light(drive.width, drive.height, 3);
  for (std::size_t i = 0; i < light.values.size(); ++i) {
    const auto& table = monitor.radiance_from_level[i % 3];
    light.values[i] = table[drive.levels[i]] - table.front();
  }
  multiply(light, monitor.uniformity);
  return light;
}

DriveImage uniform_drive(int width, int height, std::uint8_t level) {
  return {width, height, std::vector<std::uint8_t>(static_cast<std::size_t>(width) * height * 3, level)};
}

// calibration.toml: what camera and monitor are known to do.

namespace fs = std::filesystem;

namespace {

constexpr std::array<const char*, 3> channel_names = {"red", "green", "blue"};

toml::array array_of(const std::vector<float>& values) {
  toml::array array;
  for (float value : values) array.push_back(static_cast<double>(value));
  return array;
}

std::vector<float> floats_of(const toml::array* array, const char* key, const fs::path& path) {
  if (!array) throw FormatError(path, "lacks the list '" + std::string(key) + "'");
  std::vector<float> values;
  values.reserve(array->size());
  for (const auto& node : *array) {
    const auto value = node.value<double>();
    if (!value) throw FormatError(path, "has something else than numbers in '" + std::string(key) + "'");
    values.push_back(static_cast<float>(*value));
  }
  return values;
}

double number(const toml::table& table, const char* key, const fs::path& path) {
  if (const auto value = table[key].value<double>()) return *value;
  throw FormatError(path, "lacks the number '" + std::string(key) + "'");
}

std::optional<toml::table> find_section(const fs::path& path, const char* section) {
  try {
    const toml::table whole = toml::parse(read_text(path), path.string());
    if (const toml::table* found = whole[section].as_table()) return *found;
    return std::nullopt;
  } catch (const toml::parse_error& error) {
    throw FormatError(
        path, "line " + std::to_string(error.source().begin.line) + ": " + std::string(error.description()));
  }
}

toml::table parse_section(const fs::path& path, const char* section) {
  if (auto found = find_section(path, section)) return *std::move(found);
  throw FormatError(path, "lacks the section [" + std::string(section) + "]");
}

toml::table table_of(const RelativeMap& map) {
  return toml::table{{"columns", map.columns}, {"rows", map.rows}, {"values", array_of(map.values)}};
}

/// The map under `key`; an empty one where there is none.
RelativeMap map_of(const toml::table& section, const char* key, const fs::path& path) {
  const toml::table* table = section[key].as_table();
  if (!table) return {};
  return {static_cast<int>(number(*table, "columns", path)), static_cast<int>(number(*table, "rows", path)),
          floats_of((*table)["values"].as_array(), key, path)};
}

toml::table table_of(const TimingCalibration& timing) {
  return toml::table{{"display_latency_s", timing.display_latency.count()},
                     {"display_settling_s", timing.display_settling.count()},
                     {"control_latency_frames", timing.control_latency_frames},
                     {"refresh_period_s", timing.refresh_period.count()},
                     {"exposure_unit_s", timing.exposure_unit.count()}};
}

}  // namespace

void write_calibration(const fs::path& path, const CameraCalibration& camera,
                       const std::optional<MonitorCalibration>& monitor,
                       const std::optional<TimingCalibration>& timing) {
  toml::table camera_table{{"bits", camera.bits},
                           {"black_level_dn", camera.black_level_dn},
                           {"saturation_dn", camera.saturation_dn},
                           {"electrons_per_dn", camera.electrons_per_dn},
                           {"read_noise_electrons", camera.read_noise_electrons},
                           {"electrons_per_radiance_second", camera.electrons_per_radiance_second}};
  if (camera.is_linear())
    camera_table.insert("response", "linear");
  else
    camera_table.insert("linear_from_dn", array_of(camera.linear_from_dn));
  if (!camera.flat_field.empty()) camera_table.insert("flat_field", table_of(camera.flat_field));
  toml::table file{{"camera", camera_table}};
  if (monitor) {
    toml::table table;
    for (int c = 0; c < 3; ++c) table.insert(channel_names[c], array_of(monitor->radiance_from_level[c]));
    if (!monitor->uniformity.empty()) table.insert("uniformity", table_of(monitor->uniformity));
    file.insert("monitor", table);
  }
  if (timing) file.insert("timing", table_of(*timing));
  std::ostringstream text;
  text << file << "\n";
  write_text_atomically(path, text.str());
}

CameraCalibration read_camera_calibration(const fs::path& path) {
  const toml::table table = parse_section(path, "camera");
  CameraCalibration camera;
  camera.bits = static_cast<int>(number(table, "bits", path));
  if (camera.bits < 1 || camera.bits > 16) throw FormatError(path, "bits must be 1 to 16");
  camera.black_level_dn = number(table, "black_level_dn", path);
  camera.saturation_dn = number(table, "saturation_dn", path);
  camera.electrons_per_dn = number(table, "electrons_per_dn", path);
  camera.read_noise_electrons = number(table, "read_noise_electrons", path);
  camera.electrons_per_radiance_second = table["electrons_per_radiance_second"].value_or(1.0);
  camera.linear_from_dn = table["response"].value_or(std::string()) == "linear"
                              ? linear_response(camera.bits)
                              : floats_of(table["linear_from_dn"].as_array(), "linear_from_dn", path);
  camera.flat_field = map_of(table, "flat_field", path);
  camera.check(path.string());
  return camera;
}

MonitorCalibration read_monitor_calibration(const fs::path& path) {
  const toml::table table = parse_section(path, "monitor");
  MonitorCalibration monitor;
  for (int c = 0; c < 3; ++c)
    monitor.radiance_from_level[c] = floats_of(table[channel_names[c]].as_array(), channel_names[c], path);
  monitor.uniformity = map_of(table, "uniformity", path);
  monitor.check(path.string());
  return monitor;
}

std::optional<TimingCalibration> read_timing_calibration(const fs::path& path) {
  const auto table = find_section(path, "timing");
  if (!table) return std::nullopt;
  TimingCalibration timing;
  timing.display_latency = Seconds(number(*table, "display_latency_s", path));
  timing.display_settling = Seconds(number(*table, "display_settling_s", path));
  timing.control_latency_frames = static_cast<int>(number(*table, "control_latency_frames", path));
  timing.refresh_period = Seconds((*table)["refresh_period_s"].value_or(0.0));
  timing.exposure_unit = Seconds((*table)["exposure_unit_s"].value_or(0.0));
  timing.check(path.string());
  return timing;
}

}  // namespace refield
