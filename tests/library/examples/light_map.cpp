// SPDX-License-Identifier: Apache-2.0
// Makes a light map of a window of light, and says where a monitor would stand.
#include "refield/light_map.h"

#include <cstdio>

int main(int, char** arguments) {
  refield::LightMap light{refield::Image(16, 12, 3), refield::Parameterisation::monitor};
  const refield::Box window{2, 3, 8, 9};
  for (int y = window.y0; y < window.y1; ++y)
    for (int x = window.x0; x < window.x1; ++x)
      for (int c = 0; c < 3; ++c) light.radiance.at(x, y, c) = 1.0f;
  refield::write_exr(arguments[1], light.radiance);
  const auto monitor = refield::monitor_placement_from_text("520x320@600,yaw=90");
  std::printf("%s: from %.2f to %.2f of its distance\n", refield::text_of(monitor).c_str(), monitor.left(),
              monitor.right());
}
