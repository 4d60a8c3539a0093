// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "acquire/calibrate/bench.h"

namespace refield {

/// One sample of the sensor at one exposure, averaged over frames.
struct ResponseDatum {
  int source = 0;  ///< data of one source see the same light
  double exposure_s = 0.0;
  double dn = 0.0;
  double variance = 0.0;  ///< of `dn`
};

/// From raw samples to numbers proportional to light.
struct ResponseFit {
  std::vector<double> dn;     ///< knots, from black to saturation
  std::vector<double> light;  ///< 0 at black, 1 at saturation, never falling
  double residual = 0.0;      ///< RMS of the data about the curve, share of the range
};

/// Fits the inverse response g with g(DN) = light of the source × exposure: unknown are g at knots and the
/// light of all sources; the equations are linear in both and solved at once, weighted by the inverse of the
/// predicted variance, with a pull towards parabolas over neighbouring knots. As in Debevec and Malik 1997,
/// eq. 3, but without the logarithm (black is known, and small samples are noisy) and made monotone
/// afterwards (never_falling()). Throws InputError when data are too few or cover too little of the range.
ResponseFit fit_response(const std::vector<ResponseDatum>& data, double black_dn, double saturation_dn);

/// What the camera gives without light.
struct BlackLevel {
  double dn = 0.0;
  double clipped = 0.0;  ///< share of samples at 0 DN in the darkest frames
};

/// The brightness under black at short exposures, extrapolated to an exposure of zero: neither ambient light
/// nor dark current count, and no lens cap is needed.
BlackLevel measure_black_level(CalibrationBench& bench, const RunContext& run);

/// What the camera makes of light, measured.
struct CameraResponse {
  int bits = 12;
  std::vector<float> linear_from_dn;  ///< [2^bits]; keeps black and saturation where they are
  bool is_linear = false;             ///< within the tolerance; the table is then exactly so
  double black_level_dn = 0.0;
  double saturation_dn = 0.0;
  bool saturation_seen = false;  ///< else it is full scale, for want of light
  double darkest_share = 0.0;    ///< of the range: what lies below the data was interpolated
  double residual = 0.0;
  std::vector<std::array<double, 2>> points;  ///< (DN, share of the range), a selection for a plot
  std::vector<Seconds> exposures;             ///< that were used
};

/// Measures saturation (where samples stand still though the exposure doubles) and response. Exposures are
/// whole multiples of `exposure_unit`. Throws DeviceError where brightness does not follow exposure.
CameraResponse measure_response(CalibrationBench& bench, const BlackLevel& black, Seconds exposure_unit,
                                const RunContext& run);

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
