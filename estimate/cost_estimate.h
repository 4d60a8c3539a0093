// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "estimate/estimate.h"
#include "estimate/job/estimate_job.h"

namespace refield {

/// Whether all of a field must stand in memory before it is written: interpolation between light sources is
/// fitted to its pixels.
bool needs_whole_field(const EstimateJob& job, const EstimateOptions& options);

/// Whether a field is written from its finished bands, or handed over as a whole.
enum class FieldGoes { to_file, to_memory };

/// Estimates memory and cuts the image into bands that fit, with fewer threads where the number is left to
/// it. Throws InputError where not even one row does.
EstimatePlan plan_job(const EstimateJob& job, const EstimateOptions& options,
                      FieldGoes to = FieldGoes::to_file);

/// The bands of the plan's rows, in order.
std::vector<RowRange> bands_of(const EstimatePlan& plan);

int thread_count(const EstimateOptions& options);

/// Holds oneTBB to that many threads while it lives.
[[nodiscard]] tbb::global_control limit_threads(int threads);

}  // namespace refield
