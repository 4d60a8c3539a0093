// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "acquire/hdr/bracket_files.h"
#include "acquire/hdr/hdr_merge.h"

namespace refield {

/// What is known of the camera behind ordinary image files.
struct BracketCamera {
  /// How samples encode light: "linear", "srgb", "gamma:X" (sample = light^(1/X)) or a calibration.toml.
  /// Empty: as the files state it (`stated`), else srgb for 8 bits and linear for others.
  std::string response;
  std::string stated;  ///< as BracketFile::response; counts where `response` is empty
  std::vector<float>
      curve;  ///< [2^bits], inverse response estimated from brackets; empty: as `response` says
  /// Exposure times as files state them, and what they are where exposures overlap (settle_times()).
  std::vector<std::pair<Seconds, Seconds>> measured_times;
  std::string
      layout;  ///< of one-channel files: name of a PixelLayout, "bayer" (RGGB); empty: grey, RAW: theirs
  /// Of samples without light, in linearised units; nullopt: as RAW files state it, else 0.
  std::optional<double> black;
  /// Lowest sample that may be clipped; nullopt: where the samples pile up (highest_samples()), else as RAW
  /// files state it, else the largest; none for float files.
  std::optional<double> saturation;
  double full_scale_electrons = 20000.0;
  double read_noise_electrons = 5.0;
};

/// The layout that BracketCamera::layout names; nullopt: empty. Throws InputError for another name.
std::optional<PixelLayout> layout_of(const std::string& name);

/// Exposures of one view.
struct Bracket {
  std::vector<fs::path> paths;
  std::vector<BracketFile> files;
  std::vector<Seconds> exposures;
};

/// Reads the files of a bracket. `exposures`: one for each file, or none: as the files' metadata state them.
/// Throws InputError when files differ in size, bits, channels, encoding or, where `exposures` are not given,
/// in settings (require_same_settings()), or do not state their exposure.
Bracket read_bracket(const std::vector<fs::path>& paths, const BracketCamera& camera,
                     std::span<const Seconds> exposures = {});

/// The response of integer files: "linear", "srgb", "gamma:X" or a calibration file.
std::string response_of(const BracketCamera& camera, int bits);

/// Camera of integer files: a calibration file as it is; else radiance 1 fills the range in one second.
/// Throws InputError naming the option.
CameraCalibration bracket_calibration(const BracketCamera& camera, int bits);

/// Merges a bracket (whose images are moved out of it) by merge_exposures() or, for float files,
/// merge_linear_exposures(), and divides by the calibration's flat field. Throws InputError as
/// require_brighter_with_time().
Photograph merge_bracket(Bracket& bracket, const BracketCamera& camera,
                         MergeStatistics* statistics = nullptr);

/// What the highest samples of a bracket say about the level at which its camera saturates.
struct HighestSamples {
  double level = 0.0;          ///< highest sample of all exposures
  std::size_t at_level = 0;    ///< samples of `file` within 0.1 % of it
  fs::path file;               ///< exposure with the most of them
  bool piles_up = false;       ///< far more samples have that level than the levels below it
  bool is_saturation = false;  ///< they pile up, and no evenly lit surface explains it
};

/// Looks for samples that pile up below the saturation that the files state (RAW: their white level;
/// integers: the largest value; floats: none). A flat surface without noise piles up too. Clipping is certain
/// if the level is 2^k − 1 of fewer bits, or 1 for floats (12 bits in 16, a developed picture as floats), if
/// two exposures of different times end at it, or if two colours of a sensor do.
HighestSamples highest_samples(const Bracket& bracket);

/// Some samples of a bracket, the same places in each exposure; in order of exposure time.
struct BracketSamples {
  int bits = 0;            ///< as BracketFile::bits
  bool is_sensor = false;  ///< a sensor's own samples (RAW or Bayer), which no tone curve has bent
  std::string response;    ///< as BracketFile::response
  bool automatic_white_balance = false;  ///< developed files say so (EXIF)
  std::optional<double> black;           ///< of RAW files
  HighestSamples highest;
  std::vector<fs::path> paths;
  std::vector<double> seconds;
  std::vector<std::vector<float>> values;  ///< [exposures][samples], as stored
};

/// Samples spread over the frame, at most some ten thousand for each exposure. The bracket must be as
/// read_bracket() returned it.
BracketSamples samples_of(const Bracket& bracket);

/// Throws InputError naming the files when a longer exposure is not brighter than a shorter one: swapped
/// times, or one file given twice.
void require_brighter_with_time(const BracketSamples& bracket, const BracketCamera& camera);

/// How well the exposures of a bracket agree on radiance under an assumed response.
struct ExposureAgreement {
  std::size_t compared = 0;  ///< samples well exposed in two exposures
  /// RMS over brightness by which radiances of neighbouring exposures differ, relative, apart from a factor
  /// that they have in common: what a wrong response makes.
  double spread = 0.0;
  /// The common factor furthest from 1: measured over stated ratio of two exposure times.
  double factor = 1.0;
  std::size_t shorter = 0, longer = 0;  ///< the exposures that `factor` is of
};

/// Compares the exposures of one bracket, linearised by the camera's response. Float files are linear.
ExposureAgreement compare_exposures(const BracketSamples& bracket, const BracketCamera& camera);

/// An inverse response estimated from brackets.
struct ResponseEstimate {
  std::vector<float> linear_from_dn;  ///< [2^bits], 0 at 0
  double residual = 0.0;   ///< RMS by which radiances of one scene point differ, relative, weighted
  std::size_t places = 0;  ///< samples of scene points that it rests on
};

/// Estimates the response that makes samples proportional to exposure time: log light of each scene point =
/// log g(sample) − log time, solved for g and the lights by weighted least squares. One curve serves all
/// channels, for cameras apply their tone curve to each alike. Throws InputError where the brackets cover too
/// little of the range.
/// Source: Debevec and Malik 1997, eq. 3. Deviations: log g is sRGB's plus 33 hat functions, and it is the
/// difference from sRGB that is kept smooth, since that is what smooth is of a camera's curve; weights are
/// the inverse variance of the logarithm; the result is made monotone (never_falling()).
ResponseEstimate estimate_response(std::span<const BracketSamples> brackets);

/// Checks what `camera` assumes against some brackets of one kind: sets `camera.saturation` where it was not
/// given and samples pile up below the level that the files state, and, where no response was given and the
/// brackets contradict the assumed one, estimates the response from them into `camera.curve`. Returns what
/// the user should know, one sentence each. Throws InputError as require_brighter_with_time().
std::vector<std::string> settle_response(std::span<const BracketSamples> brackets, BracketCamera& camera);

/// Measures the ratios of exposure times where exposures overlap, medians over the brackets, after
/// settle_response(). Where they differ from the stated ones by more than 1.5 % and their uncertainty
/// (cameras round: 1/60, 1/30 and 1/15 s are 2^-6, 2^-5 and 2^-4 s), sets `camera.measured_times`. A curve
/// that was estimated with wrong times has adapted to them: there the powers of 2^(1/3) nearest to the stated
/// times are tried, and taken with their curve where the samples fit it clearly better. Returns what the
/// user should know; empty: the times stay.
std::string settle_times(std::span<const BracketSamples> brackets, BracketCamera& camera);

}  // namespace refield
