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

/// What check_frames() found of a job whose inputs and options job_key() names, as text for
/// `frame_check_name`.
std::string frame_check_text(const EstimateJob& job, const FrameReport& report, const std::string& key);

/// What names the input of check_frames(): job_key() before frames are left out, and how drift and outliers
/// are treated.
std::string frame_check_key(const EstimateJob& job, const EstimateOptions& options);

/// check_frames() of a shard: for small shards most of the work, and the same for all of them. Takes the
/// findings from `file` where they are those of the same inputs and options, else checks and writes the file.
FrameReport check_frames_once(EstimateJob& job, const EstimateOptions& options, const fs::path& file,
                              const RunContext& run = {});

}  // namespace refield
