// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <filesystem>
#include <limits>
#include <memory>
#include <optional>
#include <string_view>

#include "core/field/reflectance_field.h"
#include "estimate/rig/rig_model.h"

namespace refield {

/// `refined`: a smooth part and few rectangles, as many as the data bear (docs/method/estimation.md): most
/// accurate. `paper`: Matusik et al. 2004 as published: even splits, every candidate split re-solved by NNLS.
/// `fast`: the paper's splits scored by projected gain, without spatial correction.
enum class EstimateMode { refined, paper, fast };

std::string_view name_of(EstimateMode mode);
EstimateMode estimate_mode_from_name(std::string_view name);

struct EstimateOptions {
  EstimateMode mode = EstimateMode::refined;
  int kernels = 0;                          ///< cap on the kernels of a pixel, 1 to 255; 0: by the data
  int spatial_passes = 1;                   ///< sweeps of spatial correction in paper mode; 0: none
  std::uint64_t memory_bytes = 4ull << 30;  ///< limit that row bands are planned for
  /// Samples at or above this radiance are clipped and left out, besides those that the capture marked.
  float clip_level = std::numeric_limits<float>::infinity();
  bool keep_drift = false;     ///< leave brightness as it is where reference frames show drift
  bool keep_outliers = false;  ///< estimate from frames that do not fit the others, too
  bool keep_rig = false;       ///< do not look for what contradicts B = T L (estimate/rig/rig_model.h)
  /// The rig to correct for; null: estimated from the photographs.
  std::shared_ptr<const RigModel> rig = nullptr;
  /// Rows of the picture to estimate, for a job array: the output is then a part
  /// (core/field_io/field_shard.h). Empty: all.
  std::optional<RowRange> rows;
  int threads = 0;  ///< 0: all cores. The result does not depend on it.
  bool predict_errors =
      true;  ///< cross-validate a lattice of pixels (a fifth more time), see core/field/predicted_error.h

  /// A field of the same capture (.rfield) that takes in the images it was not made from, see
  /// estimate/job/refinement.h. Empty: a fresh start.
  std::filesystem::path refine = {};
  /// Not asked for but found by check_frames(): mean square of the picture's samples, beside which pixels are
  /// worth more or less effort; 0: full effort everywhere.
  double mean_square = 0.0;
  /// The cap that `kernels` stands for.
  int max_kernels() const;
  /// Sweeps of spatial correction that the mode makes.
  int sweeps() const { return mode == EstimateMode::paper ? spatial_passes : 0; }

  /// Throws InputError naming the option and its range.
  void check() const;
};

}  // namespace refield
