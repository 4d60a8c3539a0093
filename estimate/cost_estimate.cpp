// SPDX-License-Identifier: Apache-2.0
#include "estimate/cost_estimate.h"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include "core/base/run_context.h"
#include "core/base/units.h"
#include "core/field/reflectance_field.h"
#include "core/image/image_io.h"
#include "estimate/fit/cell_fit.h"
#include "estimate/job/estimate_band.h"
#include "estimate/quality/frame_check.h"

namespace refield {

namespace {

constexpr int max_band_rows = 64;
constexpr int min_band_rows = 16;  ///< below, the rows that bands share would cost more than a tenth
constexpr int min_bands = 8;
/// Rows of bands for which photographs are read together: bands share a few rows, and blocks of rows in the
/// files. Shards are rarely higher.
constexpr int max_read_rows = 128;
constexpr double gib = 1024.0 * 1024.0 * 1024.0;
/// The program, its libraries and small allocations.
constexpr std::uint64_t base_bytes = 200ull << 20;
/// What a fit keeps between pixels besides its cache: mostly the Gram matrices of 112 rectangles for each
/// class of smooth parts.
constexpr std::uint64_t fitter_bytes = 5ull << 20;

/// Kernels of a pixel that a whole picture has on average: where the data decide, less than half the cap.
int usual_kernels(const EstimateOptions& options) {
  return options.kernels > 0 ? options.kernels : std::min(options.max_kernels(), 30);
}

/// Fits to all images and, where errors are predicted, to parts of them.
std::uint64_t bytes_of_a_thread(const EstimateOptions& options) {
  const std::uint64_t parts = options.predict_errors ? ErrorEvaluator::parts : 0;
  return cache_limit_bytes + fitter_bytes + parts * (ErrorEvaluator::part_cache_bytes + fitter_bytes);
}

}  // namespace

int thread_count(const EstimateOptions& options) {
  return options.threads > 0 ? options.threads : tbb::this_task_arena::max_concurrency();
}

bool needs_whole_field(const EstimateJob& job, const EstimateOptions& options) {
  return !options.rows && job.session.light.parameterisation == Parameterisation::lat_long;
}

EstimatePlan plan_job(const EstimateJob& job, const EstimateOptions& options, FieldGoes to) {
  const CaptureSession& session = job.session;
  const int images = static_cast<int>(job.frames.size());
  const std::uint64_t pixels = static_cast<std::uint64_t>(session.width) * job.rows.count();
  const std::uint64_t kernel_bytes =
      usual_kernels(options) * (sizeof(Box) + 3 * sizeof(float)) + sizeof(PixelKernels);

  const std::uint64_t old_field = job.refinement ? fs::file_size(job.refinement->path()) : 0;
  const std::uint64_t shared = base_bytes + old_field + BoxTable::bytes(session.light, images);
  // A row that is held has its samples and each thread's share of images being read; one that is estimated,
  // kernels before and after a sweep besides.
  const std::uint64_t row_of_samples = ObservationBand::bytes(session.width, 1, images);
  const std::uint64_t row_of_kernels = 3 * session.width * kernel_bytes;
  const std::uint64_t row_of_thread = 16 * session.width * 9 * sizeof(float);
  const std::uint64_t overlap = 2 * static_cast<std::uint64_t>(max_rows_beyond(options));
  // Writing happens after the tables are gone. It holds one band, and of all pixels where their entries begin
  // and the statistics, some of them twice while medians are taken; and the numbers of all boxes, of which
  // there are fewer than pixels.
  constexpr std::uint64_t pixel_bytes = sizeof(std::uint64_t) + sizeof(ErrorEvidence) + 8 * sizeof(float);
  constexpr std::uint64_t number_bytes = 4 * sizeof(Box);
  constexpr std::uint64_t entry_bytes = sizeof(std::uint32_t) + 3 * sizeof(float);
  // Vectors of a field in memory hold it twice while they grow.
  const std::uint64_t transfer = to == FieldGoes::to_memory || needs_whole_field(job, options)
                                     ? 2 * pixels * usual_kernels(options) * entry_bytes
                                     : 0;
  const auto assembly = [&](std::uint64_t rows) {
    return base_bytes + old_field + pixels * (pixel_bytes + number_bytes) + rows * row_of_kernels + transfer;
  };
  const auto needed = [&](std::uint64_t threads, std::uint64_t rows, std::uint64_t held) {
    return shared + rows * row_of_kernels + held * row_of_samples +
           threads * (bytes_of_a_thread(options) + CellFit::bytes(session.light) + held * row_of_thread);
  };
  // Fewer threads need less; asked for, they are kept.
  std::uint64_t threads = thread_count(options);
  while (options.threads == 0 && threads > 1 &&
         needed(threads, min_band_rows + overlap, min_band_rows + overlap) > options.memory_bytes)
    --threads;
  const std::uint64_t least = std::max(needed(threads, 1 + overlap, 1 + overlap), assembly(1));
  if (least > options.memory_bytes)
    throw InputError(
        "this estimation needs at least ", std::to_string(std::ceil(10.0 * least / gib) / 10.0).substr(0, 4),
        " GiB (", images, " light maps of ", session.light.width, "×", session.light.height,
        " are held as tables of 24 bytes per texel); --memory allows ",
        std::to_string(options.memory_bytes / gib).substr(0, 4), ": raise it, or resample the light maps");
  EstimatePlan plan;
  plan.images = images;
  plan.threads = static_cast<int>(threads);
  plan.rows = job.rows;
  const std::uint64_t row_of_held = row_of_samples + threads * row_of_thread;
  const std::uint64_t affordable =
      std::min((options.memory_bytes - needed(threads, overlap, overlap)) / (row_of_kernels + row_of_held),
               (options.memory_bytes - assembly(0)) / row_of_kernels);
  const int wanted =
      std::min(std::clamp((job.rows.count() + min_bands - 1) / min_bands, min_band_rows, max_band_rows),
               job.rows.count());
  plan.band_rows = static_cast<int>(std::min<std::uint64_t>(wanted, affordable));
  // Bands of whole blocks of pixels share no work.
  if (plan.band_rows > block_side_px) plan.band_rows -= plan.band_rows % block_side_px;
  plan.bands = (job.rows.count() + plan.band_rows - 1) / plan.band_rows;
  // Nothing lies beyond the picture's edges.
  const std::uint64_t height = static_cast<std::uint64_t>(session.height);
  const std::uint64_t rows = std::min(plan.band_rows + overlap, height);
  const std::uint64_t more = (options.memory_bytes - needed(threads, rows, rows)) / row_of_held;
  const int wanted_held = std::max(plan.band_rows, std::min(job.rows.count(), max_read_rows));
  plan.held_rows = static_cast<int>(
      std::min(std::min<std::uint64_t>(wanted_held, plan.band_rows + more) + overlap, height));
  plan.memory_bytes = std::max(needed(threads, rows, plan.held_rows), assembly(plan.band_rows));
  return plan;
}

RowRange rows_of_shard(int shard, int shards, const ImageHeader& photograph, const EstimateOptions& options) {
  const int height = photograph.height;
  // Cuts between the blocks of pixels that are fitted together make no work twice.
  int block = std::max(photograph.block_rows, block_side_px);
  if (static_cast<std::int64_t>(shards) * block > height) block = block_side_px;
  if (static_cast<std::int64_t>(shards) * block > height) block = 1;
  const RowRange cut{block, 2 * block};
  const bool reads_beyond = rows_needed(cut, 3 * block, options) != cut;
  const int shift = reads_beyond ? block / 2 / block_side_px * block_side_px : 0;
  const auto edge = [&](int number) {
    if (number == 0 || number == shards) return number == 0 ? 0 : height;
    const double even = static_cast<double>(height) * number / shards;
    return static_cast<int>(std::lround((even - shift) / block)) * block + shift;
  };
  return {edge(shard - 1), edge(shard)};
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

namespace {

/// Where the real table would be larger, the lights are sampled more coarsely: a fit walks much the same
/// tree.
constexpr std::uint64_t max_table_bytes = 192ull << 20;
constexpr int sampled_bands = 4;
constexpr int sampled_rows = 16;  ///< rows of a band: the side of a tile, and of an EXR file's block of rows
constexpr double seconds_per_band = 0.5;

using Clock = std::chrono::steady_clock;

/// Sums of `step` × `step` texels.
LightMap coarsened(const LightMap& light, int step) {
  if (step == 1) return light;
  const Image& fine = light.radiance;
  LightMap coarse{Image((fine.width + step - 1) / step, (fine.height + step - 1) / step, 3),
                  light.parameterisation};
  for (int y = 0; y < fine.height; ++y)
    for (int x = 0; x < fine.width; ++x)
      for (int c = 0; c < 3; ++c) coarse.radiance.at(x / step, y / step, c) += fine.at(x, y, c);
  return coarse;
}

std::vector<LightMap> read_lights(const EstimateJob& job, int step, const RunContext& run) {
  std::vector<LightMap> lights(job.frames.size());
  tbb::parallel_for(std::size_t{0}, lights.size(), [&](std::size_t j) {
    run.throw_if_stopped();
    const LightMap light = read_illumination(job.frames[j], job.session.light.parameterisation, run);
    require_usable(light, job.session.light, job.frames[j].illumination.string());
    lights[j] = coarsened(light, step);
  });
  return lights;
}

/// Pixels that the plan fits, those of overlapping rows once for each band; and the rows it reads.
struct Work {
  double pixels = 0.0;
  double rows = 0.0;
};

Work work_of(const EstimateJob& job, const EstimateOptions& options, const EstimatePlan& plan) {
  const std::size_t width = job.session.width;
  Work work;
  for (const RowRange& band : bands_of(plan)) {
    const RowRange fitted = rows_fitted(band, job.session.height, options);
    work.pixels += job.mask.empty()
                       ? static_cast<double>(width) * fitted.count()
                       : static_cast<double>(std::count_if(job.mask.begin() + width * fitted.first,
                                                           job.mask.begin() + width * fitted.last,
                                                           [](unsigned char m) { return m != 0; }));
  }
  const int overlap = 2 * max_rows_beyond(options);
  if (plan.held_rows == job.session.height)  // each row is read once
    work.rows = std::min(plan.rows.count() + overlap, job.session.height);
  else
    work.rows = plan.rows.count() * (1.0 + overlap / static_cast<double>(plan.held_rows - overlap));
  return work;
}

/// Rows spread evenly over the plan's.
std::vector<RowRange> bands_to_sample(const RowRange& rows) {
  std::vector<RowRange> bands;
  const int count = std::clamp(rows.count() / sampled_rows, 1, sampled_bands);
  for (int i = 0; i < count; ++i) {
    const int centre = rows.first + rows.count() * (2 * i + 1) / (2 * count);
    // Whole blocks of rows, where there are enough of them.
    const int first = std::max(rows.first, centre / sampled_rows * sampled_rows);
    bands.push_back({first, std::min(first + sampled_rows, rows.last)});
  }
  return bands;
}

/// Fits ever more tiles of a band, from left to right with gaps, until the time is up.
struct FitSample {
  const EstimateJob& job;
  const EstimateOptions& options;
  const BoxTable& table;
  TexelRegressions* texels;
  FitWorkers workers{};
  double seconds = 0.0;
  int pixels = 0;

  void add(const ObservationBand& band, const RowRange& rows, const RunContext& run) {
    const int width = job.session.width;
    const int tiles = (width + sampled_rows - 1) / sampled_rows;
    const int batch = std::min(tiles, 2 * thread_count(options));
    const int batches = (tiles + batch - 1) / batch;
    const auto start = Clock::now();
    for (int b = 0; b < batches && seconds_since(start) < seconds_per_band; ++b) {
      Mask chosen(static_cast<std::size_t>(width) * job.session.height, 0);
      int count = 0;
      for (int y = rows.first; y < rows.last; ++y)
        for (int x = 0; x < width; ++x) {
          const std::size_t p = static_cast<std::size_t>(y) * width + x;
          if (x / sampled_rows % batches != b || (!job.mask.empty() && job.mask[p] == 0)) continue;
          chosen[p] = 1;
          ++count;
        }
      if (count == 0) continue;
      const auto before = Clock::now();
      Progress within(run, "fit", 1);  // not shown: another is
      estimate_band({table, band, rows, job.session.height, chosen, options, job.mean_square, nullptr, texels,
                     &job.noise},
                    workers, within, run);
      seconds += seconds_since(before);
      pixels += count;
    }
  }
};

}  // namespace

CostEstimate estimate_cost(const CaptureSession& session, const EstimateOptions& options,
                           const RunContext& run) {
  const ThreadLimit most(run);
  EstimateJob job = open_job(session, options, run);
  const auto limit = limit_threads(plan_job(job, options).threads);
  CostEstimate cost;
  const auto begin = Clock::now();
  const std::string key = frame_check_key(job, options);
  cost.frames = check_frames(job, options, run);
  cost.frame_check = frame_check_text(job, cost.frames, key);
  cost.check_seconds = seconds_since(begin);
  cost.plan = plan_job(job, options);
  const int images = cost.plan.images;
  int step = 1;
  const auto coarse = [&](int texels) { return (texels + step - 1) / step; };
  const LightDomain& light = job.session.light;
  while (BoxTable::bytes({coarse(light.width), coarse(light.height), light.parameterisation}, images) >
         max_table_bytes)
    ++step;
  const auto start = Clock::now();
  const auto lights = read_lights(job, step, run);
  const double read_seconds = seconds_since(start);
  const BoxTable table(lights, hats_of(options, job.session.light, images), run);
  cost.lights_seconds = read_seconds + (seconds_since(start) - read_seconds) * step * step;
  std::optional<TexelRegressions> texels;
  if (options.mode == EstimateMode::refined) {
    const auto before = Clock::now();
    texels.emplace(table).of_all();
    cost.lights_seconds += seconds_since(before);
  }

  const Work work = work_of(job, options, cost.plan);
  FitSample sample{job, options, table, texels ? &*texels : nullptr};
  double reading = 0.0;
  double rows_read = 0.0;
  const auto bands = bands_to_sample(cost.plan.rows);
  Progress progress(run, "fitting sample pixels", bands.size());
  for (const RowRange& rows : bands) {
    const RowRange held = rows_needed(rows, job.session.height, options);
    const auto before = Clock::now();
    const auto band =
        read_observations(job.frames, job.session.width, held.first, held.last, options.clip_level, run);
    reading += seconds_since(before);
    rows_read += held.count();
    sample.add(band, rows, run);
    progress.advance();
  }
  cost.photographs_seconds = reading / rows_read * work.rows;
  cost.sampled_pixels = sample.pixels;
  if (sample.pixels > 0) cost.fit_seconds = sample.seconds / sample.pixels * work.pixels;
  return cost;
}

}  // namespace refield
