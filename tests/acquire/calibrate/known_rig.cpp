// SPDX-License-Identifier: Apache-2.0
#include "tests/acquire/calibrate/known_rig.h"

#include <array>
#include <cmath>

namespace refield::test {

namespace {
constexpr LightDomain domain{64, 48, Parameterisation::monitor};

/// Sixteen boxes that cover the display, and for the view of the screen its texels.
std::vector<Box> boxes_of(View view) {
  std::vector<Box> boxes;
  const int step_x = view == View::screen ? 1 : 16;
  const int step_y = view == View::screen ? 1 : 12;
  for (int y = 0; y < domain.height; y += step_y)
    for (int x = 0; x < domain.width; x += step_x) boxes.push_back({x, y, x + step_x, y + step_y});
  return boxes;
}
}  // namespace

VirtualRig known_rig(View view, const MonitorModel& monitor, const SensorModel& sensor, float ambient,
                     std::uint64_t seed) {
  ReflectanceField field;
  field.width = known_width;
  field.height = known_height;
  field.basis = {domain, {}, boxes_of(view)};
  constexpr float texels = 64.0f * 48.0f;
  for (int y = 0; y < known_height; ++y)
    for (int x = 0; x < known_width; ++x) {
      std::vector<std::uint32_t> columns;
      std::vector<float> weights;
      if (view == View::screen) {
        columns.push_back(static_cast<std::uint32_t>(y * domain.width + x));
        weights.assign(3, 0.3f);
      } else {
        // Brightness in steps like those of a chart, from a twelfth to one.
        const float albedo =
            view == View::card ? 0.8f : std::pow(2.0f, -static_cast<float>((x / 4 + 3 * (y / 4)) % 8) / 2.0f);
        for (std::uint32_t box = 0; box < 16; ++box) {
          const bool left = box % 4 < 2;
          const float lean = view == View::card ? 1.0f : (left == (x < known_width / 2) ? 1.6f : 0.4f);
          columns.push_back(box);
          for (float colour : {1.0f, 0.9f, 0.7f}) weights.push_back(0.3f * albedo * lean * colour / texels);
        }
      }
      field.transfer.append_row(columns, weights);
    }
  return VirtualRig(std::move(field), Image(known_width, known_height, 3, ambient), monitor, sensor, seed);
}

CameraCalibration true_calibration(const SensorModel& sensor) {
  CameraCalibration camera;
  camera.bits = sensor.bits;
  camera.linear_from_dn = gamma_response(sensor.bits, sensor.response_gamma);
  camera.black_level_dn = sensor.black_level_dn;
  const double full = sensor.full_scale();
  const double well = sensor.black_level_dn + sensor.full_well_electrons / sensor.electrons_per_dn;
  camera.saturation_dn = std::floor(full * std::pow(std::min(1.0, well / full), 1.0 / sensor.response_gamma));
  camera.electrons_per_dn = sensor.electrons_per_dn;
  camera.read_noise_electrons = sensor.read_noise_electrons;
  return camera;
}

}  // namespace refield::test
