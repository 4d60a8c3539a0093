// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>

#include "acquire/calibrate/bench.h"
#include "acquire/calibrate/response.h"
#include "core/base/run_context.h"

namespace refield {

/// The camera's noise.
struct PhotonTransfer {
  double electrons_per_dn = 1.0;      ///< at gain 1, of linear DN
  double read_noise_electrons = 0.0;  ///< quantisation not included
  double full_well_electrons = 0.0;   ///< at saturation, at the gain used
  /// How much the noise of the brightest samples exceeds (or falls short of) what the fit predicts, relative.
  double excess_at_the_top = 0.0;
  std::vector<std::array<double, 2>> points;  ///< (mean above black, variance), linear DN and its square
};

/// Photon transfer curve (Janesick 2007, chapter 5; EMVA 1288, section 6.6): the variance over time of
/// samples that see steady light is read noise² + signal / (electrons per DN), in linear DN at gain 1; its
/// slope over the signal gives the gain, its value without light the read noise. Fixed patterns do not enter,
/// since each sample is compared with itself; flicker of the whole frame is divided out. Exposures as
/// `response` used them. Throws InputError where noise does not grow with light, as in frames that were
/// denoised or compressed.
PhotonTransfer measure_photon_transfer(CalibrationBench& bench, const Metering& metering,
                                       const CameraResponse& response, Seconds exposure_unit,
                                       const RunContext& run = {});

}  // namespace refield
