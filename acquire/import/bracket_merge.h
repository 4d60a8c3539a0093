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

}  // namespace refield
