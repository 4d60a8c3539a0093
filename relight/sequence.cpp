// SPDX-License-Identifier: Apache-2.0
#include "relight/sequence.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "core/errors.h"

namespace refield {

namespace {

/// Length of the part of [left, right) that lies in column [x, x + 1).
double overlap(double left, double right, int x) {
  return std::max(0.0, std::min(right, x + 1.0) - std::max(left, static_cast<double>(x)));
}

}  // namespace

LightMap sliding_bar(const LightDomain& domain, double width_fraction, int frame, int frames,
                     float radiance) {
  if (!(width_fraction > 0.0 && width_fraction <= 1.0))
    throw InputError("the bar's width is " + std::to_string(width_fraction) +
                     "; give a fraction of the light map's width above 0 and up to 1");
  if (frames < 1 || frame < 0 || frame >= frames)
    throw InputError("a sequence has no frame " + std::to_string(frame) + " of " + std::to_string(frames));
  const bool wraps = domain.parameterisation == Parameterisation::lat_long;
  const double bar = width_fraction * domain.width;
  const double left = wraps ? static_cast<double>(domain.width) * frame / frames
                            : (domain.width - bar) * frame / std::max(1, frames - 1);
  LightMap light{Image(domain.width, domain.height, 3), domain.parameterisation};
  for (int x = 0; x < domain.width; ++x) {
    double covered = overlap(left, left + bar, x);
    if (wraps) covered += overlap(left - domain.width, left + bar - domain.width, x);
    if (covered <= 0.0) continue;
    for (int y = 0; y < domain.height; ++y)
      for (int c = 0; c < 3; ++c) light.radiance.at(x, y, c) = static_cast<float>(radiance * covered);
  }
  return light;
}

LightMap rotated(const LightMap& light, double turns) {
  if (light.parameterisation != Parameterisation::lat_long)
    throw InputError("only lat-long light maps can be rotated, this one is a " +
                     std::string(name_of(light.parameterisation)) + " map; use a sliding bar instead");
  const Image& source = light.radiance;
  const double shift = (turns - std::floor(turns)) * source.width;
  const int whole = static_cast<int>(shift);
  const auto fraction = static_cast<float>(shift - whole);
  LightMap turned{Image(source.width, source.height, 3), light.parameterisation};
  for (int x = 0; x < source.width; ++x) {
    const int right = (x - whole + 2 * source.width) % source.width;
    const int left = (right + source.width - 1) % source.width;
    for (int y = 0; y < source.height; ++y)
      for (int c = 0; c < 3; ++c)
        turned.radiance.at(x, y, c) =
            (1.0f - fraction) * source.at(right, y, c) + fraction * source.at(left, y, c);
  }
  return turned;
}

LightMap mixed(const LightMap& a, const LightMap& b, double share) {
  if (a.domain() != b.domain()) throw InputError("lights of different sizes cannot fade into one another");
  LightMap light = a;
  const auto part = static_cast<float>(share);
  for (std::size_t i = 0; i < light.radiance.values.size(); ++i)
    light.radiance.values[i] = (1.0f - part) * a.radiance.values[i] + part * b.radiance.values[i];
  return light;
}

}  // namespace refield
