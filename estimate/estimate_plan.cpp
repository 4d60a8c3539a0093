// SPDX-License-Identifier: Apache-2.0
#include "estimate/estimate_plan.h"

#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>

#include "core/errors.h"
#include "core/reflectance_field.h"

namespace refield {

namespace {

constexpr int most_band_rows = 64;
constexpr int fewest_band_rows = 16;  ///< below, the rows that bands share would cost more than a tenth
constexpr int fewest_bands = 8;
constexpr double gib = 1024.0 * 1024.0 * 1024.0;
/// The program, its libraries and small allocations.
constexpr std::uint64_t base_bytes = 200ull << 20;
/// What a fit keeps between pixels besides its cache: mostly the Gram matrices of 112 rectangles for each
/// class of smooth parts.
constexpr std::uint64_t fitter_bytes = 5ull << 20;

/// Kernels of a pixel that a whole picture has on average: where the data decide, less than half the cap.
int usual_kernels(const EstimateOptions& options) {
  return options.kernels > 0 ? options.kernels : std::min(options.most_kernels(), 30);
}

/// Fits to all images and, where errors are predicted, to parts of them.
std::uint64_t bytes_of_a_thread(const EstimateOptions& options) {
  const std::uint64_t parts = options.predict_errors ? ErrorJudge::parts : 0;
  return cache_limit_bytes + fitter_bytes + parts * (ErrorJudge::part_cache_bytes + fitter_bytes);
}

}  // namespace

int thread_count(const EstimateOptions& options) {
  return options.threads > 0 ? options.threads : tbb::this_task_arena::max_concurrency();
}

EstimatePlan plan_job(const EstimateJob& job, const EstimateOptions& options) {
  const CaptureSession& session = job.session;
  const int images = static_cast<int>(job.frames.size());
  const std::uint64_t pixels = static_cast<std::uint64_t>(session.width) * job.rows.count();
  constexpr std::uint64_t entry_bytes = sizeof(std::uint32_t) + 3 * sizeof(float);
  const std::uint64_t kernel_bytes =
      usual_kernels(options) * (sizeof(Box) + 3 * sizeof(float)) + sizeof(PixelKernels);

  const std::uint64_t old_field = job.refinement ? std::filesystem::file_size(job.refinement->path()) : 0;
  const std::uint64_t shared = base_bytes + old_field + BoxTable::bytes(session.light, images);
  // A row holds its samples, its kernels before and after a sweep, and each thread's share of images being
  // read.
  const std::uint64_t row_of_all =
      ObservationBand::bytes(session.width, 1, images) + 3 * session.width * kernel_bytes;
  const std::uint64_t row_of_thread = 16 * session.width * 9 * sizeof(float);
  const std::uint64_t overlap = 2 * static_cast<std::uint64_t>(most_rows_beyond(options));
  // Assembly happens after the tables are gone: twice the field, while vectors grow.
  const std::uint64_t assembly = base_bytes + old_field + 2 * pixels * usual_kernels(options) * entry_bytes;
  const auto needed = [&](std::uint64_t threads, std::uint64_t rows) {
    return shared + rows * row_of_all + threads * (bytes_of_a_thread(options) + rows * row_of_thread);
  };
  // Fewer threads need less; asked for, they are kept.
  std::uint64_t threads = thread_count(options);
  while (options.threads == 0 && threads > 1 &&
         needed(threads, fewest_band_rows + overlap) > options.memory_bytes)
    --threads;
  const std::uint64_t least = std::max(needed(threads, 1 + overlap), assembly);
  if (least > options.memory_bytes)
    throw InputError("this estimation needs at least " +
                     std::to_string(std::ceil(10.0 * least / gib) / 10.0).substr(0, 4) + " GiB (" +
                     std::to_string(images) + " light maps of " + std::to_string(session.light.width) + "×" +
                     std::to_string(session.light.height) +
                     " are held as tables of 24 bytes per texel); --memory allows " +
                     std::to_string(options.memory_bytes / gib).substr(0, 4) +
                     ": raise it, or resample the light maps");
  EstimatePlan plan;
  plan.images = images;
  plan.threads = static_cast<int>(threads);
  plan.rows = job.rows;
  const std::uint64_t affordable =
      (options.memory_bytes - needed(threads, overlap)) / (row_of_all + threads * row_of_thread);
  const int wanted = std::min(
      std::clamp((job.rows.count() + fewest_bands - 1) / fewest_bands, fewest_band_rows, most_band_rows),
      job.rows.count());
  plan.band_rows = static_cast<int>(std::min<std::uint64_t>(wanted, affordable));
  // Bands of whole blocks of pixels share no work.
  if (plan.band_rows > block_side_px) plan.band_rows -= plan.band_rows % block_side_px;
  plan.bands = (job.rows.count() + plan.band_rows - 1) / plan.band_rows;
  plan.memory_bytes = std::max(needed(threads, plan.band_rows + overlap), assembly);
  return plan;
}

std::vector<RowRange> bands_of(const EstimatePlan& plan) {
  std::vector<RowRange> bands;
  for (int row = plan.rows.first; row < plan.rows.last; row += plan.band_rows)
    bands.push_back({row, std::min(row + plan.band_rows, plan.rows.last)});
  return bands;
}

tbb::global_control limit_threads(int threads) {
  return {tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(threads)};
}

}  // namespace refield
