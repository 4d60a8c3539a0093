// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <span>

#include "acquire/calibrate/calibration.h"

namespace refield::test {

/// Fisher information that one raw sample holds of its mean number of electrons, μ: Σ over all DN of (dP/dμ)²
/// / P, with P the probability of the DN under shot noise (normal, variance μ: μ ≥ 50), read noise, rounding
/// and clipping at the calibration's saturation. Exact but for the normal shot noise.
double information_of_electrons(double mean, const CameraCalibration& camera);

/// The Cramér–Rao bound: no unbiased estimate of radiance from one sample at each exposure can have a smaller
/// standard deviation.
double cramer_rao_bound(double radiance, std::span<const double> exposures, const CameraCalibration& camera);

}  // namespace refield::test
