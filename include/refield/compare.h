// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstddef>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "refield/field.h"
#include "refield/session.h"

/// How well fields predict photographs. Errors are relative RMSE, sqrt(Σ(predicted − observed)² ∕ Σ
/// observed²).
namespace refield {
inline namespace v0_2 {

/// How well a field predicted its own errors, pixel by pixel.
struct PredictionCheck {
  double rank_correlation = 0.0;  ///< Spearman, predicted against true error
  double median_ratio = 0.0;      ///< of predicted to true error
  double predicted_median = 0.0;
};

/// One photograph under held-out light.
struct HeldOutImage {
  std::string name;                ///< the frame's
  std::filesystem::path observed;  ///< the photograph's file
  ImageError error;
};

/// How well a field predicts photographs that it was not estimated from, for one kind of light. All errors
/// are relative RMSE, unitless: over everything, and as quantiles of the errors that single pixels make over
/// the kind's images.
struct HeldOutError {
  std::string kind;
  std::size_t images = 0;
  /// Number of these images that the field was estimated from, by the names and patterns of light in its
  /// provenance (in whatever encoding, at whatever brightness); nothing where it has none. Their errors are
  /// training errors.
  std::optional<std::size_t> trained_on;
  double relative_rmse = 0.0;
  double median = 0.0;
  double percentile_90 = 0.0;
  double tone_mapped_psnr_db = 0.0;           ///< of the series, each image at its own exposure
  std::optional<PredictionCheck> prediction;  ///< where the field holds predicted errors
  std::vector<HeldOutImage> per_image;        ///< [images], in the order of frames
  Image map{};  ///< of each pixel over the images [height × width × 1]; 0 outside the mask
};

/// Relights a field with a session's held-out frames, by kind of light: those of role test, and those that
/// the field's provenance says it held out; of pairs of files without roles, those that it was not estimated
/// from. Errors on images that it was estimated from are named in run.on_note. With `truth`, another field's
/// noise-free images stand in for the photographs. `noise_scale`: noise of photographs without sigma,
/// relative to that of the training images; for the check of predicted errors. Throws InputError for a field
/// of a mesh, when there is no such frame and when sizes differ.
REFIELD_API std::vector<HeldOutError> compare(const Field& field, const Session& session,
                                              const Field* truth = nullptr, double noise_scale = 1.0,
                                              const RunContext& run = {});

/// Compares the images of two files, patterns or folders, which are paired as those of a Session, one pair
/// at a time. Samples of infinite sigma and pixels where the file `mask` is dark are left out. Throws
/// InputError for a file without a partner, for sizes that differ, and for samples that count but are not
/// finite.
REFIELD_API HeldOutError compare(const std::string& predicted, const std::string& observed,
                                 const std::filesystem::path& mask = {}, const RunContext& run = {});

/// Compares images [images] of equal size. Samples of infinite `sigma` [images] are left out, if it is given.
/// Throws InputError for other numbers, sizes that differ and samples that count but are not finite.
REFIELD_API HeldOutError compare(std::span<const ImageView> predicted, std::span<const ImageView> observed,
                                 std::span<const ImageView> sigma = {}, const Mask& mask = {});

}  // namespace v0_2
}  // namespace refield
