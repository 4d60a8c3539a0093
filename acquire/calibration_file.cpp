// SPDX-License-Identifier: Apache-2.0
// calibration.toml: what camera and monitor are known to do.
#define TOML_EXCEPTIONS 1
#include <toml++/toml.h>

#include <sstream>

#include "acquire/calibration.h"
#include "core/errors.h"
#include "core/files.h"

namespace refield {

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
