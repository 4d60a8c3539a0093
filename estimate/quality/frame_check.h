// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/run_context.h"
#include "estimate/estimate.h"
#include "estimate/job/estimate_job.h"

namespace refield {

/// Takes the frames out of a job that do not fit the others (outlier_frames.h) and says so to run.on_note,
/// but none with options.keep_outliers or where frames are few. Measures how bright the picture is. What it
/// finds does not depend on the rows asked for. Throws InputError when too few frames are left.
FrameReport check_frames(EstimateJob& job, const EstimateOptions& options, const RunContext& run = {});

}  // namespace refield
