// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "acquire/calibrate/calibration.h"
#include "acquire/camera.h"

namespace refield {

/// Interpolates a plane of Bayer samples to RGB, bilinearly, by masked filtering; at the border by what
/// samples there are. Measured samples stay as they are. Sigma follows the filter's weights; that
/// neighbouring interpolated pixels then share their noise is not recorded. A pixel that rests on any clipped
/// sample (infinite sigma) has infinite sigma: brighter neighbours left out would make it too dark. Both
/// planes are [height × width × 1], the layout is a Bayer one; throws InputError otherwise or below 2×2
/// pixels.
Photograph demosaic(const Image& radiance, const Image& sigma, PixelLayout layout);

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
  /// Where the samples show that they clip below the level that the files state: the level used.
  std::optional<double> found_saturation{};
};

/// Merges frames of one scene, taken with several exposures (or several times with one), into a photograph of
/// linear radiance and its standard deviation, in the unit that the calibration sets.
///
/// A pixel's samples, black subtracted and linearised, lie on a line through the origin over exposure: the
/// response line. Its slope, fitted by weighted least squares, is the radiance. The weights are the inverse
/// of the variance (shot, read and quantisation noise) that the line itself *predicts*: weights from the
/// observed samples would favour those that came out low and bias the result. The prediction starts from Σ
/// electrons / Σ exposure, which is unbiased. Clipped samples are left out, except where noise alone may have
/// clipped them; a sample that is clipped in an exposure counts as clipped in those at least
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
  /// Lowest value that may be clipped; by default none is.
  double saturation = std::numeric_limits<double>::infinity();
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

/// Share of the samples of a photograph, ambient light subtracted, that were darker than the ambient light by
/// more than 10 % of it and five standard deviations.
double darker_share(const Photograph& photograph, const Photograph& ambient);

/// A photograph is darker than the ambient one from this share of its samples on, and the ambient one has
/// light that the others lack from this number of photographs on.
inline constexpr double clearly_darker_share = 0.02;
inline constexpr std::size_t enough_darker_photographs = 3;
/// What to do then: names the ambient photograph and the first of the darker ones.
std::string darker_text(const std::string& ambient, const std::vector<std::string>& darker);

/// Clipped samples are left out of an estimate: from two in ten thousand on, highlights suffer.
constexpr bool is_much_clipped(double share) {
  return share >= 2e-4;
}
inline constexpr const char* clipping_remedy =
    "samples clip in every exposure, and highlights will be known less well: add a shorter exposure";

}  // namespace refield
