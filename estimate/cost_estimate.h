// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <tbb/global_control.h>

#include <cstdint>
#include <vector>

#include "core/base/run_context.h"
#include "core/session/capture_session.h"
#include "estimate/job/estimate_band.h"
#include "estimate/job/estimate_job.h"
#include "estimate/options.h"
#include "estimate/quality/frame_check.h"

namespace refield {

/// What an estimation will need, known before it starts.
struct EstimatePlan {
  int images = 0;
  int threads = 0;
  RowRange rows;      ///< of the picture
  int band_rows = 0;  ///< rows of photographs held at a time
  int bands = 0;
  std::uint64_t memory_bytes = 0;  ///< estimated peak
};

/// Estimates memory and cuts the image into bands that fit, with fewer threads where the number is left to
/// it. Throws InputError where not even one row does.
EstimatePlan plan_job(const EstimateJob& job, const EstimateOptions& options);

/// The bands of the plan's rows, in order.
std::vector<RowRange> bands_of(const EstimatePlan& plan);

int thread_count(const EstimateOptions& options);

/// Holds oneTBB to that many threads while it lives.
[[nodiscard]] tbb::global_control limit_threads(int threads);

/// What an estimation would take, measured on a sample of it: `refield estimate --dry-run`.
struct CostEstimate {
  EstimatePlan plan;
  FrameReport frames;
  double check_seconds = 0.0;        ///< comparing the frames with each other
  double lights_seconds = 0.0;       ///< reading all lights and building their table
  double photographs_seconds = 0.0;  ///< reading all bands of all photographs
  double fit_seconds = 0.0;
  int sampled_pixels = 0;  ///< that were fitted to find out
  double seconds() const { return check_seconds + lights_seconds + photographs_seconds + fit_seconds; }
};

/// Checks options and all input as estimate_to_file() does (the header of every image, the values of every
/// light, the values of the photographs' rows that the sample reads) and measures on this machine what the
/// work costs: reads all lights, some rows of all photographs, and fits tiles of pixels spread over the
/// picture for about two seconds. Writes nothing. Throws InputError for input that cannot be estimated from.
CostEstimate estimate_cost(const CaptureSession& session, const EstimateOptions& options,
                           const RunContext& run);

}  // namespace refield
