// SPDX-License-Identifier: Apache-2.0
// Shows a field under a light map and then, faster, under the same map with one changed texel.
#include "refield/relight.h"

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
}
