// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace refield {

/// A field that darkens towards its corners: 1 − loss · (distance from the middle / distance of the
/// corners)².
struct Falloff {
  int width;
  int height;
  double loss;

  /// At a place from (0, 0) in one corner to (1, 1) in the opposite one.
  double at_share(double u, double v) const {
    const double dx = (2.0 * u - 1.0) * width;
    const double dy = (2.0 * v - 1.0) * height;
    return 1.0 - loss * (dx * dx + dy * dy) /
                     (static_cast<double>(width) * width + static_cast<double>(height) * height);
  }
  /// At the centre of a pixel.
  double at(int x, int y) const { return at_share((x + 0.5) / width, (y + 0.5) / height); }
};

}  // namespace refield
