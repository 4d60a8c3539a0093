// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <tbb/global_control.h>

#include <vector>

#include "estimate/estimate.h"
#include "estimate/job/estimate_job.h"

namespace refield {

/// Estimates memory and cuts the image into bands that fit, with fewer threads where the number is left to
/// it. Throws InputError where not even one row does.
EstimatePlan plan_job(const EstimateJob& job, const EstimateOptions& options);

/// The bands of the plan's rows, in order.
std::vector<RowRange> bands_of(const EstimatePlan& plan);

int thread_count(const EstimateOptions& options);

/// Holds oneTBB to that many threads while it lives.
[[nodiscard]] tbb::global_control limit_threads(int threads);

}  // namespace refield
