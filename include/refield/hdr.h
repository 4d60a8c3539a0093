// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <span>
#include <string>

#include "refield/image.h"

/// High dynamic range photographs from exposure series.
namespace refield {
inline namespace v0_2 {

/// What is known of the camera of an exposure series.
struct ExposureCamera {
  /// How samples encode light: "linear", "srgb", "gamma:X" (sample = light^(1/X)) or a calibration.toml.
  /// Empty: as the files state it, else srgb for 8 bits and linear for others; estimated if the exposures
  /// contradict it. Images in memory are linear.
  std::string response{};
  double full_scale_electrons = 20000.0;  ///< that the largest sample stands for; of images in memory, 1.0
  double read_noise_electrons = 5.0;
};

/// Merges files of one view: PNG, TIFF, JPEG, EXR or camera RAW. The result is relative radiance and its
/// standard deviation [height × width × 3]; samples that are clipped in every exposure have infinite sigma.
/// `seconds`: the exposure time of each file, or empty: as the files state it. Throws InputError for files
/// that differ in size or layout, or where a longer exposure is not brighter than a shorter one.
/// Source: Matusik et al. 2004, section 6.
REFIELD_API Photograph merge_exposures(std::span<const std::filesystem::path> files,
                                       std::span<const double> seconds, const ExposureCamera& camera = {},
                                       const RunContext& run = {});
/// The same of linear images [height × width × 3], in which 1 is the lowest value that may be clipped.
REFIELD_API Photograph merge_exposures(std::span<const ImageView> images, std::span<const double> seconds,
                                       const ExposureCamera& camera = {}, const RunContext& run = {});

}  // namespace v0_2
}  // namespace refield
