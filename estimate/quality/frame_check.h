// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <vector>

#include "core/base/run_context.h"
#include "estimate/job/estimate_job.h"
#include "estimate/quality/outlier_frames.h"

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
  Drift drift;                    ///< of the capture, as its reference frames show it
};

/// Takes the frames out of a job that do not fit the others (outlier_frames.h) and says so on standard error,
/// but none with options.keep_outliers or where frames are few. Measures how bright the picture is. What it
/// finds does not depend on the rows asked for. Throws InputError when too few frames are left.
FrameReport check_frames(EstimateJob& job, const EstimateOptions& options, const RunContext& run = {});

}  // namespace refield
