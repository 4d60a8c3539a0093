// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/field/reflectance_field.h"
#include "core/session/capture_session.h"
#include "estimate/cost_estimate.h"
#include "estimate/options.h"
#include "estimate/quality/frame_check.h"

namespace refield {

/// What an estimation did.
struct EstimateSummary {
  EstimatePlan plan;
  FrameReport frames;
  int resumed_bands = 0;  ///< found finished on disk
  double seconds = 0.0;
  std::uint64_t peak_memory_bytes = 0;  ///< resident, of the whole process
  double mean_kernels = 0.0;            ///< non-zero kernels per pixel
  double median_training_error = 0.0;   ///< relative RMSE over the training images
  std::optional<double>
      median_predicted_error;  ///< relative RMSE expected on new photographs, where predicted
  std::optional<double> median_photograph_noise;
  std::vector<LearningPoint> learning_curve;  ///< error against the share of the images, where measured
};

/// Checks options and input, and estimates memory. Throws InputError for input that cannot be estimated from.
EstimatePlan plan_estimate(const CaptureSession& session, const EstimateOptions& options,
                           const RunContext& run = {});

/// Estimates the reflectance field of a session's training frames into `output` (.rfield), out of core by
/// bands of rows; with options.rows set, those rows into a part (core/field_io/field_shard.h). Finished bands
/// are kept in the folder `output`.partial; with `resume` they are taken over, and the result is the same bit
/// for bit. Throws Interrupted between units of work when asked to stop. Source: Matusik et al. 2004,
/// sections 3 to 5.
EstimateSummary estimate_to_file(const CaptureSession& session, const EstimateOptions& options,
                                 const std::filesystem::path& output, bool resume,
                                 const RunContext& run = {});

/// The same, kept in memory: for small sessions, tests and the report. With options.rows set the field's
/// height is theirs.
ReflectanceField estimate_field(const CaptureSession& session, const EstimateOptions& options,
                                const RunContext& run = {});

/// The same from arrays in memory; reads and writes no file. Photograph j was taken under light j; both are
/// scene-linear RGB. The caller keeps the arrays until this returns; bands of rows are copied as they are
/// needed.
///  - lights [images], all of one size and parameterisation;
///  - photographs [images], [height × width × 3], ambient light already subtracted;
///  - sigma [images] or empty: standard deviation of each sample, infinite where nothing was measured;
///  - mask [height × width] or empty: pixels of value 0 are not estimated.
/// Findings such as photographs that are left out go to run.on_note. Throws InputError for arrays that do not
/// fit together, counting images from 0, and Interrupted.
ReflectanceField estimate(std::span<const LightMapView> lights, std::span<const ImageView> photographs,
                          std::span<const ImageView> sigma, const Mask& mask, const EstimateOptions& options,
                          const RunContext& run = {});

/// A pixel's kernels after some number of subdivisions.
struct KernelSnapshot {
  int subdivisions = 0;
  std::vector<Box> boxes;
  std::vector<std::array<float, 3>> weights;  ///< of the sum of texel values in each box
};

/// How the kernels of one pixel unfold (Matusik et al. 2004, figure 8): a snapshot after each of the given
/// numbers of subdivisions, before spatial correction.
std::vector<KernelSnapshot> kernel_history(const CaptureSession& session, const EstimateOptions& options,
                                           int x, int y, const std::vector<int>& subdivisions,
                                           const RunContext& run = {});

}  // namespace refield
