// SPDX-License-Identifier: Apache-2.0
#include "acquire/calibrate/calibration.h"

#define TOML_EXCEPTIONS 1

#include <toml++/toml.h>

#include <cmath>
#include <sstream>

#include "core/base/config_file.h"
#include "core/base/files.h"
#include "core/base/linear_algebra.h"

namespace refield {

namespace {

/// The nodes around a point and their bilinear weights.
struct Corner {
  int node;
  double weight;
};

std::array<Corner, 4> corners_around(double u, double v, int columns, int rows) {
  const double x = std::clamp(u, 0.0, 1.0) * (columns - 1);
  const double y = std::clamp(v, 0.0, 1.0) * (rows - 1);
  const int i = std::min(static_cast<int>(x), columns - 2);
  const int j = std::min(static_cast<int>(y), rows - 2);
  const double fx = x - i;
  const double fy = y - j;
  const int node = j * columns + i;
  return {{{node, (1 - fx) * (1 - fy)},
           {node + 1, fx * (1 - fy)},
           {node + columns, (1 - fx) * fy},
           {node + columns + 1, fx * fy}}};
}

/// Adds `weight` · (second difference of three nodes in a line)² to the normal equations.
void add_straightness(Eigen::MatrixXd& normal, int before, int middle, int after, double weight) {
  const std::array<std::pair<int, double>, 3> difference{{{before, 1.0}, {middle, -2.0}, {after, 1.0}}};
  for (const auto& [a, factor_a] : difference)
    for (const auto& [b, factor_b] : difference) normal(a, b) += weight * factor_a * factor_b;
}

/// Calls change(value, factor of the map there) for all values of all channels; for none where the map is
/// empty.
template <class Change>
void for_each_value(Image& image, const RelativeMap& map, const Change& change) {
  if (map.empty()) return;
  std::size_t i = 0;
  for (int y = 0; y < image.height; ++y)
    for (int x = 0; x < image.width; ++x) {
      const float factor = map.at_pixel(x, y, image);
      for (int c = 0; c < image.channels; ++c) change(image.values[i++], factor);
    }
}

constexpr int drive_level_count = 256;

std::size_t full_scale(int bits) {
  return (std::size_t{1} << bits) - 1;
}

template <class... Parts>
[[noreturn]] void refuse(const std::string& where, const Parts&... what) {
  throw InputError(where, ": ", concatenated(what...), "; repair that entry or calibrate again");
}

void require_positive(double value, const char* name, const std::string& where) {
  if (!(std::isfinite(value) && value > 0.0)) refuse(where, name, " is ", value, " and must be above zero");
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

constexpr std::array<const char*, 3> channel_names = {"red", "green", "blue"};

toml::array array_of(const std::vector<float>& values) {
  toml::array array;
  for (float value : values) array.push_back(static_cast<double>(value));
  return array;
}

constexpr double unlimited = ConfigSection::unlimited;
constexpr int max_map_nodes = 65536;  // in either direction

ConfigFile open_calibration(const fs::path& path) {
  return {path, "calibration", "docs/reference/capture-session-format.md"};
}

double required_number(ConfigSection& section, const char* key) {
  double value = 0.0;
  section.require(key);
  section.number(key, value, -unlimited, unlimited);
  return value;
}

std::vector<float> required_floats(ConfigSection& section, const char* key) {
  std::vector<double> values;
  section.require(key);
  section.numbers(key, values, -unlimited, unlimited);
  std::vector<float> floats;
  for (const double value : values) floats.push_back(static_cast<float>(value));
  return floats;
}

toml::table table_of(const RelativeMap& map) {
  return toml::table{{"columns", map.columns}, {"rows", map.rows}, {"values", array_of(map.values)}};
}

/// The map under `key`; an empty one where there is none.
RelativeMap map_of(ConfigSection& section, const char* key) {
  RelativeMap map;
  if (auto table = section.table(key)) {
    for (const char* required : {"columns", "rows"}) table->require(required);
    table->integer("columns", map.columns, 1, max_map_nodes);
    table->integer("rows", map.rows, 1, max_map_nodes);
    map.values = required_floats(*table, "values");
    table->finish();
  }
  return map;
}

toml::table table_of(const TimingCalibration& timing) {
  return toml::table{{"display_latency_s", timing.display_latency.count()},
                     {"display_settling_s", timing.display_settling.count()},
                     {"control_latency_frames", timing.control_latency_frames},
                     {"refresh_period_s", timing.refresh_period.count()},
                     {"exposure_unit_s", timing.exposure_unit.count()}};
}

}  // namespace

float RelativeMap::at(double u, double v) const {
  if (empty()) return 1.0f;
  double sum = 0.0;
  for (const Corner& corner : corners_around(u, v, columns, rows)) sum += corner.weight * values[corner.node];
  return static_cast<float>(sum);
}

void RelativeMap::check(const std::string& where) const {
  if (empty() && columns == 0 && rows == 0) return;
  const std::string remedy = "; repair that entry or calibrate again";
  if (columns < 2 || rows < 2 || columns > 1024 || rows > 1024 ||
      values.size() != static_cast<std::size_t>(columns) * rows)
    throw InputError(where, ": has ", values.size(), " values for ", columns, "×", rows, " nodes", remedy);
  for (float value : values)
    if (!(std::isfinite(value) && value > 0.0f))
      throw InputError(where, ": has a value of ", value, ", which must be above zero", remedy);
}

RelativeMap fit_relative_map(const Image& image, const Image& weight, int columns, int rows) {
  if (image.channels != 1 || !image.same_shape(weight))
    throw InputError("a relative map is fitted to one channel, not ", shape_text(image));
  const int nodes = columns * rows;
  Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(nodes, nodes);
  Eigen::VectorXd right = Eigen::VectorXd::Zero(nodes);
  double total = 0.0;
  for (int y = 0; y < image.height; ++y)
    for (int x = 0; x < image.width; ++x) {
      const double w = weight.at(x, y, 0);
      if (!(w > 0.0)) continue;
      const auto around = corners_around((x + 0.5) / image.width, (y + 0.5) / image.height, columns, rows);
      for (const Corner& a : around) {
        right(a.node) += w * a.weight * image.at(x, y, 0);
        for (const Corner& b : around) normal(a.node, b.node) += w * a.weight * b.weight;
      }
      total += w;
    }
  if (!(total > 0.0)) throw InputError("a relative map cannot be fitted: no pixel counts");
  const double pull =
      0.02 * total / nodes;  // of a node's data: smooths noise, bends a falloff by less than 1e-3
  for (int j = 0; j < rows; ++j)
    for (int i = 0; i < columns; ++i) {
      const int node = j * columns + i;
      if (i > 0 && i + 1 < columns) add_straightness(normal, node - 1, node, node + 1, pull);
      if (j > 0 && j + 1 < rows) add_straightness(normal, node - columns, node, node + columns, pull);
    }
  const Eigen::VectorXd fitted = solve_symmetric(normal, right);
  RelativeMap map{columns, rows, std::vector<float>(nodes)};
  for (int node = 0; node < nodes; ++node)
    map.values[node] = static_cast<float>(fitted(node) / fitted.maxCoeff());
  map.check("fitted map");
  return map;
}

void multiply(Image& image, const RelativeMap& map) {
  for_each_value(image, map, [](float& value, float factor) { value *= factor; });
}

void divide(Photograph& photograph, const RelativeMap& map) {
  const auto through = [](float& value, float factor) { value /= factor; };
  for_each_value(photograph.radiance, map, through);
  for_each_value(photograph.sigma, map, through);
}

bool CameraCalibration::is_linear() const {
  for (std::size_t dn = 0; dn < linear_from_dn.size(); ++dn)
    if (linear_from_dn[dn] != static_cast<float>(dn)) return false;
  return true;
}

void CameraCalibration::check(const std::string& where) const {
  if (bits < 1 || bits > 16) refuse(where, "bits is ", bits, " and must be 1 to 16");
  const std::size_t size = full_scale(bits) + 1;
  if (linear_from_dn.size() != size)
    refuse(where, "the inverse response has ", linear_from_dn.size(), " entries, ", bits, " bits need ",
           size);
  for (std::size_t dn = 0; dn < size; ++dn) {
    if (!std::isfinite(linear_from_dn[dn]))
      refuse(where, "entry ", dn, " of the inverse response is not finite");
    if (dn > 0 && linear_from_dn[dn] < linear_from_dn[dn - 1])
      refuse(where, "the inverse response falls at entry ", dn);
  }
  if (linear_from_dn.front() == linear_from_dn.back()) refuse(where, "the inverse response is constant");
  if (!(saturation_dn >= 1.0 && saturation_dn <= static_cast<double>(full_scale(bits))))
    refuse(where, "saturation_dn is ", saturation_dn, " and must be 1 to ", full_scale(bits));
  if (!(black_level_dn >= 0.0 && black_level_dn < linear_from_dn[static_cast<std::size_t>(saturation_dn)]))
    refuse(where, "black_level_dn is ", black_level_dn, " and must lie between 0 and the saturation");
  require_positive(electrons_per_dn, "electrons_per_dn", where);
  require_positive(electrons_per_radiance_second, "electrons_per_radiance_second", where);
  if (!(std::isfinite(read_noise_electrons) && read_noise_electrons >= 0.0))
    refuse(where, "read_noise_electrons is ", read_noise_electrons);
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
      refuse(where, "a tone curve of the monitor has ", table.size(), " entries instead of 256");
    for (int level = 0; level < drive_level_count; ++level) {
      if (!(std::isfinite(table[level]) && table[level] >= 0.0f))
        refuse(where, "the monitor's radiance at level ", level, " is ", table[level]);
      if (level > 0 && table[level] < table[level - 1])
        refuse(where, "the monitor's radiance falls at level ", level);
    }
    if (table.front() == table.back())
      refuse(where, "a channel of the monitor emits the same light at all levels");
  }
  uniformity.check(where + ", uniformity of the screen");
}

void TimingCalibration::check(const std::string& where) const {
  const auto require_time = [&](Seconds time, const char* name) {
    if (!(std::isfinite(time.count()) && time.count() >= 0.0))
      refuse(where, name, " is ", time.count(), " s");
  };
  require_time(display_latency, "the display's latency");
  require_time(display_settling, "the display's settling");
  require_time(refresh_period, "the refresh period");
  require_time(exposure_unit, "the exposure unit");
  if (control_latency_frames < 0 || control_latency_frames > 1000)
    refuse(where, "control_latency_frames is ", control_latency_frames);
}

DriveImage drive_levels(const Image& wanted, const MonitorCalibration& monitor, std::size_t* out_of_range) {
  if (wanted.channels != 3) throw InputError("a light pattern needs 3 channels, not ", shape_text(wanted));
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
  const ConfigFile file = open_calibration(path);
  ConfigSection section = file.section("camera");
  CameraCalibration camera;
  section.require("bits");
  section.integer("bits", camera.bits, 1, 16);
  camera.black_level_dn = required_number(section, "black_level_dn");
  camera.saturation_dn = required_number(section, "saturation_dn");
  camera.electrons_per_dn = required_number(section, "electrons_per_dn");
  camera.read_noise_electrons = required_number(section, "read_noise_electrons");
  section.number("electrons_per_radiance_second", camera.electrons_per_radiance_second, -unlimited,
                 unlimited);
  std::string response;
  section.text("response", response);
  if (!response.empty() && response != "linear")
    section.fail("response", "give \"linear\", or the table linear_from_dn instead");
  camera.linear_from_dn =
      response.empty() ? required_floats(section, "linear_from_dn") : linear_response(camera.bits);
  camera.flat_field = map_of(section, "flat_field");
  section.finish();
  camera.check(path.string());
  return camera;
}

MonitorCalibration read_monitor_calibration(const fs::path& path) {
  const ConfigFile file = open_calibration(path);
  ConfigSection section = file.section("monitor");
  MonitorCalibration monitor;
  for (int c = 0; c < 3; ++c) monitor.radiance_from_level[c] = required_floats(section, channel_names[c]);
  monitor.uniformity = map_of(section, "uniformity");
  section.finish();
  monitor.check(path.string());
  return monitor;
}

std::optional<TimingCalibration> read_timing_calibration(const fs::path& path) {
  const ConfigFile file = open_calibration(path);
  if (!file.has("timing")) return std::nullopt;
  ConfigSection section = file.section("timing");
  TimingCalibration timing;
  timing.display_latency = Seconds(required_number(section, "display_latency_s"));
  timing.display_settling = Seconds(required_number(section, "display_settling_s"));
  section.require("control_latency_frames");
  section.integer("control_latency_frames", timing.control_latency_frames, 0, 1'000'000);
  section.seconds("refresh_period_s", timing.refresh_period, Seconds(1), 0.0, unlimited);
  section.seconds("exposure_unit_s", timing.exposure_unit, Seconds(1), 0.0, unlimited);
  section.finish();
  timing.check(path.string());
  return timing;
}

std::vector<double> never_falling(std::vector<double> values, std::vector<double> weights) {
  if (weights.empty()) weights.assign(values.size(), 1.0);
  struct Pool {
    double value;
    double weight;
    std::size_t size;
  };
  std::vector<Pool> pools;
  for (std::size_t i = 0; i < values.size(); ++i) {
    pools.push_back({values[i], weights[i], 1});
    while (pools.size() > 1 && pools[pools.size() - 2].value > pools.back().value) {
      const Pool last = pools.back();
      pools.pop_back();
      Pool& into = pools.back();
      into.value = (into.value * into.weight + last.value * last.weight) / (into.weight + last.weight);
      into.weight += last.weight;
      into.size += last.size;
    }
  }
  std::size_t i = 0;
  for (const Pool& pool : pools)
    for (std::size_t k = 0; k < pool.size; ++k) values[i++] = pool.value;
  return values;
}

MonotoneCurve::MonotoneCurve(std::vector<double> x, std::vector<double> y)
    : x_(std::move(x)), y_(std::move(y)), slope_(x_.size(), 0.0) {
  const std::size_t n = x_.size();
  if (n < 2 || y_.size() != n || !std::ranges::is_sorted(x_, std::less_equal<>()))
    throw InputError("a curve needs at least two points in growing order");
  std::vector<double> step(n - 1), secant(n - 1);
  for (std::size_t i = 0; i + 1 < n; ++i) {
    step[i] = x_[i + 1] - x_[i];
    secant[i] = (y_[i + 1] - y_[i]) / step[i];
  }
  for (std::size_t i = 1; i + 1 < n; ++i) {
    if (secant[i - 1] * secant[i] <= 0.0) continue;
    const double before = 2.0 * step[i] + step[i - 1];
    const double after = step[i] + 2.0 * step[i - 1];
    slope_[i] = (before + after) / (before / secant[i - 1] + after / secant[i]);
  }
  // At the ends as a parabola would have it, but not so steep that the curve overshoots.
  const auto end_slope = [](double s0, double s1, double h0, double h1) {
    const double slope = ((2.0 * h0 + h1) * s0 - h0 * s1) / (h0 + h1);
    if (slope * s0 <= 0.0) return 0.0;
    return std::abs(slope) > 3.0 * std::abs(s0) ? 3.0 * s0 : slope;
  };
  if (n == 2) {
    slope_.assign(2, secant[0]);
  } else {
    slope_[0] = end_slope(secant[0], secant[1], step[0], step[1]);
    slope_[n - 1] = end_slope(secant[n - 2], secant[n - 3], step[n - 2], step[n - 3]);
  }
}

std::size_t MonotoneCurve::interval(double x) const {
  const auto above = std::ranges::upper_bound(x_, x) - x_.begin();
  return static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(above - 1, 0, std::ssize(x_) - 2));
}

double MonotoneCurve::operator()(double x) const {
  if (x <= x_.front()) return y_.front() + slope_.front() * (x - x_.front());
  if (x >= x_.back()) return y_.back() + slope_.back() * (x - x_.back());
  const std::size_t i = interval(x);
  const double h = x_[i + 1] - x_[i];
  const double t = (x - x_[i]) / h;
  const double u = 1.0 - t;
  return y_[i] * u * u * (1.0 + 2.0 * t) + y_[i + 1] * t * t * (3.0 - 2.0 * t) +
         h * t * u * (slope_[i] * u - slope_[i + 1] * t);
}

double MonotoneCurve::slope(double x) const {
  if (x <= x_.front()) return slope_.front();
  if (x >= x_.back()) return slope_.back();
  const std::size_t i = interval(x);
  const double h = x_[i + 1] - x_[i];
  const double t = (x - x_[i]) / h;
  return 6.0 * t * (1.0 - t) * (y_[i + 1] - y_[i]) / h + slope_[i] * (1.0 - t) * (1.0 - 3.0 * t) +
         slope_[i + 1] * t * (3.0 * t - 2.0);
}

}  // namespace refield
