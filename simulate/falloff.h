// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace refield {

/// A field that darkens towards its corners: 1 − loss · (distance from the middle / distance of the
/// corners)².
struct Falloff {
  int width;
  int height;
  double loss;

  /// At the centre of a pixel.
  double at(int x, int y) const {
    const double dx = x + 0.5 - width / 2.0;
    const double dy = y + 0.5 - height / 2.0;
    return 1.0 - loss * 4.0 * (dx * dx + dy * dy) /
                     (static_cast<double>(width) * width + static_cast<double>(height) * height);
  }
};

}  // namespace refield
