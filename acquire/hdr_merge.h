// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <span>
#include <vector>

#include "acquire/calibration.h"
#include "acquire/camera.h"
#include "core/image_io.h"

namespace refield {

struct MergeOptions {
  /// Samples less than this fraction below saturation count as clipped too. 0 where saturation was measured,
  /// as calibration does: it is then the lowest sample that may be clipped. Where it was not, sensors bend
  /// below it.
  double clip_margin = 0.0;
};

/// For cameras whose saturation was not measured.
inline constexpr MergeOptions with_unmeasured_saturation{0.01};
/// For 8-bit files of theirs: clipped samples next to edges are 246 and more in JPEG files of quality 90
/// to 97.
inline constexpr MergeOptions with_compressed_samples{0.04};

/// What each exposure was good for.
struct MergeStatistics {
  /// [exposures] fraction of the samples for which the exposure holds at least 0.4 / n of the information: a
  /// tenth, of four exposures. One near zero could have been saved.
  std::vector<double> useful_fraction;
  double clipped_fraction = 0.0;  ///< of the samples, clipped in every exposure
};

/// Merges frames of one scene, taken with several exposures (or several times with one), into a photograph of
/// linear radiance and its standard deviation, in the unit that the calibration sets.
///
/// A pixel's samples, black subtracted and linearised, lie on a line through the origin over exposure: the
/// response line. Its slope, fitted by weighted least squares, is the radiance. The weights are the inverse
/// of the variance (shot, read and quantisation noise) that the line itself *predicts*: weights from the
/// observed samples would favour those that came out low and bias the result. The prediction starts from Σ
/// electrons / Σ exposure, which is unbiased. Clipped samples are left out, except where noise alone may have
/// clipped them (ResponseLines); a sample that is clipped in an exposure counts as clipped in those at least
/// half as long again. Where all are clipped, sigma is
/// +infinity and the radiance a lower bound, the clipping level of the shortest exposure. Radiance may be
/// negative near black; it is kept, so that averages stay true. Bayer samples are merged before they are
/// interpolated, grey ones are repeated in all channels.
///
/// Throws InputError when the frames differ in size or layout or do not fit the calibration.
/// Source: Matusik et al. 2004, section 6 (the response line); the weights after Robertson et al. 2003, with
/// predicted variances in place of a confidence curve.
Photograph merge_exposures(std::span<const RawFrame> frames, const CameraCalibration& calibration,
                           const MergeOptions& options = {}, MergeStatistics* statistics = nullptr);

/// What is known of float images, such as bracketed EXR files. Values are taken as black + scale · light.
struct LinearSensor {
  double black = 0.0;
  double saturation = 1.0;               ///< lowest value that may be clipped
  double electrons_per_value = 20000.0;  ///< photo-electrons that a value of 1 above black stands for
  double read_noise_electrons = 5.0;
};

/// The same for linear images [height × width × 3]; radiance is in image values a second.
Photograph merge_linear_exposures(std::span<const Image> images, std::span<const Seconds> exposures,
                                  const LinearSensor& sensor, const MergeOptions& options = {},
                                  MergeStatistics* statistics = nullptr);

/// photograph − ambient; the variances add. Where either was clipped, sigma stays infinite.
/// Throws InputError when the sizes differ.
void subtract_ambient(Photograph& photograph, const Photograph& ambient);

}  // namespace refield
