// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <vector>

#include "acquire/camera.h"
#include "core/image.h"
#include "core/units.h"

namespace refield {

/// How a virtual sensor turns scene radiance into digital numbers (DN). The linear camera model of EMVA 1288:
///   electrons = min(full well, Poisson(sensitivity · radiance · exposure) + read noise)
///   DN        = black level + gain · electrons / electrons per DN
/// then clipped to the full scale, bent by the response curve and rounded.
struct SensorModel {
  PixelLayout layout = PixelLayout::rgb;
  int bits = 12;                         ///< 8, 10 or 12; full scale is 2^bits − 1
  double sensitivity = 200000.0;         ///< electrons a sample for unit radiance and one second
  double electrons_per_dn = 4.0;         ///< at gain 1
  double full_well_electrons = 15000.0;  ///< a well holds no more
  double read_noise_electrons = 3.0;     ///< standard deviation
  double black_level_dn = 64.0;  ///< added before quantisation, so that noise around zero is not cut off
  double vignetting =
      0.0;  ///< share of the light that the corners lose; grows with the square of the distance
  double response_gamma = 1.0;  ///< DN/full scale becomes its power 1/response_gamma; 1: linear
  double largest_gain = 16.0;   ///< gains from 1 to this
  Seconds shortest_exposure{1.0 / 4000};
  Seconds longest_exposure{4.0};
  Seconds frame_interval{1.0 / 30};  ///< shortest time from one exposure's start to the next
  int control_latency_frames = 0;    ///< frames that still begin with the old settings after a change of them
  int latency_frames = 1;            ///< frames that wait in the driver's queue: the next frame is this old

  /// Throws InputError naming the property and its range.
  void check() const;

  int full_scale() const { return (1 << bits) - 1; }

  /// Mean and variance of a sample's DN before clipping, response and rounding; `radiance` ≥ 0.
  double mean_dn(double radiance, Seconds exposure, double gain) const;
  double variance_dn(double radiance, Seconds exposure, double gain) const;

  /// One frame of `radiance` [height × width × 3] behind the vignetting lens; a Bayer sample sees its own
  /// channel, a grey one the mean of three. The noise is a function of `noise_key` alone; runs on all cores.
  std::vector<std::uint16_t> expose(const Image& radiance, Seconds exposure, double gain,
                                    std::uint64_t noise_key) const;
};

}  // namespace refield
