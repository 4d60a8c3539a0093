// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <filesystem>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "refield/field.h"
#include "refield/session.h"

/// Estimation of a reflectance field from photographs under known lights (Matusik et al. 2004).
namespace refield {

struct RigModel;

inline namespace v0_2 {

/// `refined`: a smooth part and few rectangles, as many as the data bear (docs/method/estimation.md): most
/// accurate. `paper`: Matusik et al. 2004 as published: even splits, every candidate split re-solved by NNLS.
/// `fast`: the paper's splits scored by projected gain, without spatial correction.
enum class EstimateMode { refined, paper, fast };

REFIELD_API std::string_view name_of(EstimateMode mode);
/// Throws InputError for an unknown name.
REFIELD_API EstimateMode estimate_mode_from_name(std::string_view name);

struct REFIELD_API EstimateOptions {
  EstimateMode mode = EstimateMode::refined;
  int kernels = 0;                          ///< cap on the kernels of a pixel, 1 to 255; 0: by the data
  int spatial_passes = 1;                   ///< sweeps of spatial correction in paper mode; 0: none
  std::uint64_t memory_bytes = 4ull << 30;  ///< limit that row bands are planned for
  /// Samples at or above this radiance are clipped and left out, besides those that the capture marked.
  float clip_level = std::numeric_limits<float>::infinity();
  bool keep_drift = false;     ///< leave brightness as it is where reference frames show drift
  bool keep_outliers = false;  ///< estimate from frames that do not fit the others, too
  bool keep_rig = false;       ///< do not look for what contradicts B = T L
  /// The rig to correct for; null: estimated from the photographs. rig_model() reads one.
  std::shared_ptr<const RigModel> rig = nullptr;
  /// Rows of the picture to estimate, for a job array: the output is then a part of a field. Empty: all.
  std::optional<RowRange> rows;
  int threads = 0;             ///< 0: all cores. The result does not depend on it.
  bool predict_errors = true;  ///< cross-validate a lattice of pixels: a fifth more time

  /// A field of the same capture (.rfield) that takes in the images it was not made from. Empty: a fresh
  /// start.
  std::filesystem::path refine = {};
  /// The cap that `kernels` stands for.
  int max_kernels() const;
  /// Sweeps of spatial correction that the mode makes.
  int sweeps() const { return mode == EstimateMode::paper ? spatial_passes : 0; }

  /// Throws InputError naming the option and its range.
  void check() const;
};

/// A rig from JSON text, as `refield estimate` writes it into OUTPUT.log.json. Throws InputError naming
/// `name` for text that is none.
REFIELD_API std::shared_ptr<const RigModel> rig_model(const std::string& text, const std::string& name);

/// A capture in memory: photograph j was taken under light j; both are scene-linear RGB. The caller keeps the
/// arrays while they are used.
struct CaptureArrays {
  std::span<const LightMapView> lights;    ///< [images], all of one size and parameterisation
  std::span<const ImageView> photographs;  ///< [images], [height × width × 3], ambient light subtracted
  /// [images] or empty: standard deviation of each sample, infinite where nothing was measured.
  std::span<const ImageView> sigma{};
  Mask mask{};                               ///< [height × width]: pixels of value 0 are not estimated
  std::vector<MonitorPlacement> monitors{};  ///< where the monitor stood, kept in the field
};

/// Estimates the field of a session's training frames. Findings such as photographs that are left out go to
/// run.on_note. Throws InputError for input that cannot be estimated from, and Interrupted.
/// Source: Matusik et al. 2004, sections 3 to 5.
REFIELD_API Field estimate(const Session& session, const EstimateOptions& options = {},
                           const RunContext& run = {});
/// The same from arrays; reads and writes no file. Throws InputError for arrays that do not fit together,
/// counting images from 0. Bands of rows are copied as they are needed.
REFIELD_API Field estimate(const CaptureArrays& capture, const EstimateOptions& options = {},
                           const RunContext& run = {});

}  // namespace v0_2
}  // namespace refield
