// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <tbb/enumerable_thread_specific.h>

#include "core/base/run_context.h"
#include "core/field/reflectance_field.h"
#include "core/image/metrics.h"
#include "estimate/fit/refit.h"
#include "estimate/fit/sample_pooling.h"
#include "estimate/job/observations.h"
#include "estimate/job/refinement.h"
#include "estimate/quality/error_evidence.h"

namespace refield {

/// What each thread keeps between pixels.
struct FitWorker {
  FitWorker(const BoxTable& table, const EstimateOptions& options, double mean_square,
            TexelRegressions* texels = nullptr, NoiseModel noise = {})
      : model(table, options, mean_square, texels ? texels->of_all() : nullptr),
        weights(table),
        evaluator(table, options, mean_square, texels),
        pool(std::move(noise), table.images()) {}
  BlockModel model;
  WeightFitter weights;
  ErrorEvaluator evaluator;
  SamplePool pool;
};
using FitWorkers = tbb::enumerable_thread_specific<std::unique_ptr<FitWorker>>;

/// A thread's cache of columns and splits is emptied beyond this.
inline constexpr std::uint64_t cache_limit_bytes = 96ull << 20;

/// Rows that are fitted in order to estimate rows [first, last): whole blocks of pixels; in paper mode each
/// sweep of spatial correction reaches one row further. So bands overlap and no result depends on how the
/// image is cut into bands.
RowRange rows_fitted(RowRange wanted, int height, const EstimateOptions& options);
/// Rows of photographs that this needs: in refined mode also those that samples are pooled with. Rows that
/// rows_needed() adds at most at one side.
int max_rows_beyond(const EstimateOptions& options);
RowRange rows_needed(RowRange wanted, int height, const EstimateOptions& options);

/// What a band of rows is estimated from. Refers to the caller's objects.
struct BandInput {
  const BoxTable& table;
  /// Holds at least rows_needed(rows, height, options), weighted as the table is.
  const ObservationBand& band;
  RowRange rows;     ///< to be estimated
  int height = 0;    ///< of the picture
  const Mask& mask;  ///< [height × width of the band] or empty
  const EstimateOptions& options;
  double mean_square = 0.0;                ///< see BlockFitter
  const Refinement* refinement = nullptr;  ///< pixels start from its field's kernels, if any
  TexelRegressions* texels = nullptr;      ///< see BlockModel; null: rectangles alone
  const NoiseModel* noise = nullptr;       ///< refined mode pools samples accordingly; null: it does not
};

/// Estimates the pixels of `input.rows`; returns them row by row, with the evidence about their error where
/// the options ask for it. Throws Interrupted between tiles when asked to stop.
std::vector<PixelKernels> estimate_band(const BandInput& input, FitWorkers& workers, Progress& progress,
                                        const RunContext& run = {});

}  // namespace refield
