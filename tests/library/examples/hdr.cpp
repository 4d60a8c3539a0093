// SPDX-License-Identifier: Apache-2.0
// Merges two exposures of a linear camera into radiance and its standard deviation.
#include "refield/hdr.h"

#include <array>

int main(int, char**) {
  const std::array<refield::Image, 2> exposures = {refield::Image(8, 6, 3, 0.2f),
                                                   refield::Image(8, 6, 3, 0.8f)};
  const std::array<refield::ImageView, 2> views = {exposures[0], exposures[1]};
  const std::array<double, 2> seconds = {0.01, 0.04};
  const refield::Photograph merged = refield::merge_exposures(views, seconds);
  const float radiance = merged.radiance.at(0, 0, 0);  // 0.2 in 0.01 s: 20 per second
  return radiance > 19.9f && radiance < 20.1f ? 0 : 1;
}
