// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <tbb/global_control.h>

#include <cstdint>
#include <vector>

#include "estimate/estimate_band.h"
#include "estimate/estimate_job.h"

namespace refield {

/// What an estimation will need, known before it starts.
struct EstimatePlan {
  int images = 0;
  int threads = 0;
  RowRange rows;      ///< of the picture
  int band_rows = 0;  ///< rows of photographs held at a time
  int bands = 0;
  std::uint64_t memory_bytes = 0;  ///< foreseen peak
};

/// Foresees memory and cuts the image into bands that fit, with fewer threads where the number is left to it.
/// Throws InputError where not even one row does.
EstimatePlan plan_job(const EstimateJob& job, const EstimateOptions& options);

/// The bands of the plan's rows, in order.
std::vector<RowRange> bands_of(const EstimatePlan& plan);

int thread_count(const EstimateOptions& options);

/// Holds oneTBB to that many threads while it lives.
[[nodiscard]] tbb::global_control limit_threads(int threads);

}  // namespace refield
