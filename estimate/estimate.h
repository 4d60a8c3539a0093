// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/run_context.h"
#include "core/field/drift.h"
#include "core/field/reflectance_field.h"
#include "core/session/capture_session.h"
#include "estimate/options.h"
#include "estimate/quality/outlier_frames.h"
#include "estimate/rig/estimate_rig.h"

namespace refield {

/// A training frame that is not estimated from, and why.
struct LeftOutFrame {
  std::string name;
  std::string why;
  OutlierFrame found;
};

/// What the check of the frames against each other found.
struct FrameReport {
  std::vector<LeftOutFrame> left_out;
  /// Frames that disagree but are kept, since they are too many to be the exception.
  std::vector<LeftOutFrame> doubtful;
  double typical_residual = 0.0;  ///< relative; 0: frames were not checked
  double clipped_share = 0.0;     ///< of the samples that were compared: not measured
  double noise = 0.0;             ///< of a sample, relative standard deviation; 0: unknown
  Drift drift;                    ///< of the capture, as its reference frames show it
  RigReport rig;                  ///< what contradicts B = T L, and what of it is corrected
  /// Of each photograph, relative to what the others predict, as photographed and with the rig corrected;
  /// empty where an earlier check is taken over.
  std::vector<double> residuals_before, residuals;
};

struct EstimateSummary : EstimateReport {
  FrameReport frames;
  std::optional<double> median_shared_error;  ///< root of the median of ErrorEvidence::shared, where known
  std::vector<LearningPoint> learning_curve;  ///< error against the share of the images, where measured
};

/// Checks options and input, and estimates memory. Throws InputError for input that cannot be estimated from.
EstimatePlan plan_estimate(const CaptureSession& session, const EstimateOptions& options,
                           const RunContext& run = {});

/// See refield/estimate.h, of a session with photographs like `photograph`; blocks too high for that number
/// of shards are cut anywhere.
RowRange rows_of_shard(int shard, int shards, const ImageHeader& photograph, const EstimateOptions& options);

/// The file in which the shards of one folder share the check of frames.
inline constexpr const char* frame_check_name = "frame-check.json";

struct CostEstimate : EstimateCost {
  FrameReport frames;
  /// Content of the file `frame_check_name` in the folder of shards, which saves them the check.
  std::string frame_check;
};

/// See refield/estimate.h.
CostEstimate estimate_cost(const CaptureSession& session, const EstimateOptions& options,
                           const RunContext& run);

/// See refield/estimate.h; of the report, the texts are left out. Parts of a field
/// (core/field_io/field_shard.h) share the check of frames as `frame_check_name`. Source: Matusik et al.
/// 2004, sections 3 to 5.
EstimateSummary estimate_to_file(const CaptureSession& session, const EstimateOptions& options,
                                 const fs::path& output, bool resume, const RunContext& run = {},
                                 const std::function<void(const EstimatePlan&)>& announce = {});

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
