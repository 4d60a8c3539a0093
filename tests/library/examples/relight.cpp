// SPDX-License-Identifier: Apache-2.0
// Shows a field under a light map, faster under the same map with one changed texel, and on a morning.
#include "refield/relight.h"

#include <cstdio>

int main(int, char** arguments) {
  const refield::Field field(arguments[1]);
  refield::LightMap light = refield::read_light_map(arguments[2], field.light_domain().parameterisation);
  refield::Relighter relighter(field);
  refield::Image picture = relighter.relight(light);
  refield::write_exr(arguments[3], picture, refield::Precision::half, field.colour_space());
  light.radiance.at(0, 0, 1) += 5.0f;
  relighter.update(light, {0, 0, 1, 1}, picture.values);

  // What a monitor to the right of the camera shows of the sky.
  refield::Image sky(32, 16, 3, 0.2f);
  for (float& value : sky.row(2)) value = 2.0f;
  const auto monitor = refield::placements_from_texts({"520x320@600,yaw=90"});
  const refield::LightMap seen =
      refield::Environment(sky).project(field.light_domain(), monitor, {.yaw = 30.0});
  refield::write_exr(arguments[4], field.relight(seen));

  // A picture an hour under a clear sky, all of one exposure.
  std::vector<refield::IlluminationFunction> hours;
  std::vector<std::filesystem::path> files;
  for (int hour = 1; hour <= 3; ++hour) {
    hours.emplace_back(
        [=] { return refield::TurnedEnvironment{refield::Environment(hour / 12.0, {.width = 64})}; });
    files.emplace_back("hour_" + std::to_string(hour) + ".png");
  }
  const refield::PictureReport report =
      refield::relight_to_files(field, hours, files, {.monitors = monitor, .is_sequence = true});
  std::printf("the monitor covers %.1f %% of all directions\n", 100.0 * report.seen[0].sphere);
}
