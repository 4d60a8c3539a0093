// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <span>
#include <vector>

#include "core/base/rng.h"
#include "core/image/image.h"
#include "core/session/capture_session.h"

namespace refield::chart {

/// How noisy a camera with certain exposures is at each radiance, learnt from photographs that carry the
/// standard deviation of their samples: the median of sigma in half octaves of radiance, log-linear between.
/// Below the darkest and above the brightest, sigma stays what it is there.
class NoiseCurve {
 public:
  /// Reads a few of the frames, evenly spread. Where they carry no sigma the curve stays empty.
  explicit NoiseCurve(std::span<const CaptureFrame> frames);

  bool known() const { return !log_radiance_.empty(); }
  double sigma(double radiance) const;  ///< 0 where the curve is empty
  /// Adds normal noise of this size to every sample.
  void add_to(Image& image, Rng& rng) const;

 private:
  std::vector<double> log_radiance_, log_sigma_;
};

}  // namespace refield::chart
