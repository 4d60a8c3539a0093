// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

#include "core/image.h"
#include "core/metrics.h"

namespace refield {

/// The exposure at which the 99th percentile of the brightest channel becomes white, over the pixels inside
/// the mask that show any light: a black background does not count. 1 for a black image. Every picture that
/// the program exposes by itself follows this rule: relight, simulate, the viewer, the report and the web
/// page.
double exposure_to_white(const Image& image, const Mask& mask = {});

/// Collects pixels of one or several pictures that share an exposure.
class ExposureMeter {
 public:
  void add(const Image& image, const Mask& mask = {});

  /// As exposure_to_white(), over all pixels that were added.
  double exposure_to_white();
  /// A little less (by 3 % at most), in three digits, so that fewer than one pixel in a hundred reaches the
  /// highest of 256 levels and that the printed number repeats the picture bit for bit.
  double exposure();

 private:
  std::vector<float> brightest_;  // [pixels that show light], of the channels
};

/// The share of an image's pixels that show light which reach the highest of 256 levels in any channel.
double clipped_share(const Image& image, double exposure);

}  // namespace refield
