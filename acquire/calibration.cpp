// SPDX-License-Identifier: Apache-2.0
#include "acquire/calibration.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "core/errors.h"
#include "core/image_io.h"

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

}  // namespace refield
