// SPDX-License-Identifier: Apache-2.0
#include "estimate/estimate.h"

#include <sys/resource.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <unordered_map>

#include "core/errors.h"
#include "core/files.h"
#include "core/progress.h"
#include "core/reflectance_field_file.h"
#include "estimate/checkpoint.h"
#include "estimate/estimate_band.h"

namespace refield {

namespace fs = std::filesystem;

namespace {

constexpr int most_band_rows = 64;
constexpr int fewest_bands = 8;
constexpr double gib = 1024.0 * 1024.0 * 1024.0;
/// The program, its libraries and small allocations.
constexpr std::uint64_t base_bytes = 200ull << 20;

/// Training frames of a session whose images fit together, and the mask.
struct Job {
  CaptureSession session;
  std::vector<CaptureFrame> frames;
  Mask mask;
};

/// What messages call the capture: its folder or, for one given by patterns, its first photograph's folder.
std::string name_of(const CaptureSession& session) {
  if (!session.folder.empty() || session.frames.empty()) return session.folder.string();
  return session.frames.front().observed.parent_path().string();
}

Job open_job(const CaptureSession& session, const EstimateOptions& options) {
  options.check();
  Job job{session, session.frames_of(FrameRole::train), {}};
  const int images = static_cast<int>(job.frames.size());
  if (images < 2)
    throw InputError(name_of(session) + ": holds " +
                     (images == 0 ? "no training image" : "one training image only") +
                     "; a reflectance field needs many lights, about 100 for 25 kernels a pixel");
  if (images < options.kernels)
    throw InputError(name_of(session) + ": " + std::to_string(images) + " training images cannot determine " +
                     std::to_string(options.kernels) + " kernels a pixel; add images or give --kernels " +
                     std::to_string(images) + " or less");
  job.session.frames = job.frames;
  check_image_sizes(job.session);
  if (session.mask) job.mask = read_mask(*session.mask, job.session.width, job.session.height);
  return job;
}

int thread_count(const EstimateOptions& options) {
  return options.threads > 0 ? options.threads : tbb::this_task_arena::max_concurrency();
}

EstimatePlan plan_job(const Job& job, const EstimateOptions& options) {
  const CaptureSession& session = job.session;
  const int images = static_cast<int>(job.frames.size());
  const std::uint64_t threads = thread_count(options);
  const std::uint64_t pixels = static_cast<std::uint64_t>(session.width) * session.height;
  constexpr std::uint64_t entry_bytes = sizeof(std::uint32_t) + 3 * sizeof(float);
  const std::uint64_t kernel_bytes =
      options.kernels * (sizeof(Box) + 3 * sizeof(float)) + sizeof(PixelKernels);

  const std::uint64_t fixed =
      base_bytes + BoxTable::bytes(session.light, images) + threads * cache_limit_bytes;
  // A row holds its samples, its kernels before and after a sweep, and its share of the images being read.
  const std::uint64_t row = ObservationBand::bytes(session.width, 1, images) +
                            3 * session.width * kernel_bytes +
                            threads * 16 * session.width * 9 * sizeof(float);
  const std::uint64_t overlap = 2 * static_cast<std::uint64_t>(options.spatial_passes);
  // Assembly happens after the tables are gone: twice the field, while vectors grow.
  const std::uint64_t assembly = base_bytes + 2 * pixels * options.kernels * entry_bytes;
  const std::uint64_t least = std::max(fixed + (1 + overlap) * row, assembly);
  if (least > options.memory_bytes)
    throw InputError(
        "this estimation needs at least " +
        std::to_string(std::ceil(10.0 * least / gib) / 10.0).substr(0, 4) + " GiB (" +
        std::to_string(images) + " light maps of " + std::to_string(session.light.width) + "×" +
        std::to_string(session.light.height) + " are held as tables of 24 bytes a texel); --memory allows " +
        std::to_string(options.memory_bytes / gib).substr(0, 4) + ": raise it, or resample the light maps");
  EstimatePlan plan;
  plan.images = images;
  const std::uint64_t affordable = (options.memory_bytes - fixed) / row - overlap;
  const int wanted = std::clamp((session.height + fewest_bands - 1) / fewest_bands, 1, most_band_rows);
  plan.band_rows = static_cast<int>(std::min<std::uint64_t>(wanted, affordable));
  plan.bands = (session.height + plan.band_rows - 1) / plan.band_rows;
  plan.memory_bytes = std::max(fixed + (plan.band_rows + overlap) * row, assembly);
  return plan;
}

/// Names everything that the result depends on.
std::string describe(const Job& job, const EstimateOptions& options) {
  nlohmann::ordered_json description = {{"program", "refield"},
                                        {"mode", name_of(options.mode)},
                                        {"kernels", options.kernels},
                                        {"spatial_passes", options.spatial_passes}};
  if (std::isfinite(options.clip_level)) description["clip_level"] = options.clip_level;
  const auto stamp = [](const fs::path& path) {
    return nlohmann::ordered_json{{"path", path.string()},
                                  {"bytes", fs::file_size(path)},
                                  {"modified", fs::last_write_time(path).time_since_epoch().count()}};
  };
  if (job.session.mask) description["mask"] = stamp(*job.session.mask);
  for (const CaptureFrame& frame : job.frames) {
    description["inputs"].push_back(stamp(frame.illumination));
    description["inputs"].push_back(stamp(frame.observed));
  }
  return description.dump(1);
}

std::string provenance_of(const Job& job, const EstimateOptions& options) {
  nlohmann::ordered_json provenance = {{"made_by", "refield estimate"},
                                       {"version", REFIELD_VERSION},
                                       {"method", "Matusik, Loper and Pfister 2004"},
                                       {"mode", name_of(options.mode)},
                                       {"kernels", options.kernels},
                                       {"spatial_passes", options.spatial_passes},
                                       {"images", job.frames.size()}};
  if (std::isfinite(options.clip_level)) provenance["clip_level"] = options.clip_level;
  if (!job.session.folder.empty()) provenance["session"] = job.session.folder.filename().string();
  for (const CaptureFrame& frame : job.frames) provenance["frames"].push_back(frame.name);
  return provenance.dump();
}

/// Gathers pixels into a field; boxes get their numbers in order of first use.
class FieldAssembler {
 public:
  explicit FieldAssembler(const Job& job, const EstimateOptions& options) {
    field_.width = job.session.width;
    field_.height = job.session.height;
    field_.basis.domain = job.session.light;
    field_.provenance = provenance_of(job, options);
  }
  void append(std::span<const PixelKernels> kernels) {
    std::vector<std::uint32_t> columns;
    for (const PixelKernels& pixel : kernels) {
      columns.clear();
      for (const Box& box : pixel.boxes) {
        const auto [entry, is_new] =
            numbers_.try_emplace(box, static_cast<std::uint32_t>(field_.basis.boxes.size()));
        if (is_new) field_.basis.boxes.push_back(box);
        columns.push_back(entry->second);
      }
      field_.transfer.append_row(columns, pixel.weights);
      field_.training_error.push_back(
          pixel.squared_samples > 0.0
              ? static_cast<float>(std::sqrt(pixel.squared_residual / pixel.squared_samples))
              : 0.0f);
    }
  }
  ReflectanceField take() { return std::move(field_); }

 private:
  ReflectanceField field_;
  std::unordered_map<Box, std::uint32_t, BoxHash> numbers_;
};

std::vector<fs::path> illumination_paths(const std::vector<CaptureFrame>& frames) {
  std::vector<fs::path> paths;
  for (const CaptureFrame& frame : frames) paths.push_back(frame.illumination);
  return paths;
}

std::vector<RowRange> bands_of(int height, int band_rows) {
  std::vector<RowRange> bands;
  for (int row = 0; row < height; row += band_rows) bands.push_back({row, std::min(row + band_rows, height)});
  return bands;
}

/// Estimates all bands that `find` does not already have, handing each to `keep`. Returns the number taken
/// over.
template <class Find, class Keep>
int estimate_bands(const Job& job, const EstimateOptions& options, const EstimatePlan& plan, Find find,
                   Keep keep) {
  const int width = job.session.width;
  const int height = job.session.height;
  std::optional<BoxTable> table;  // built only when there is work to do
  FitWorkers workers;
  std::uint64_t pixels = 0;
  std::vector<RowRange> missing;
  const auto bands = bands_of(height, plan.band_rows);
  for (const RowRange& rows : bands)
    if (!find(rows)) {
      missing.push_back(rows);
      const RowRange held = rows_needed(rows, height, options);
      pixels += static_cast<std::uint64_t>(width) * (held.last - held.first);
    }
  if (!missing.empty()) table.emplace(illumination_paths(job.frames), job.session.light);
  Progress progress("estimate", pixels);
  for (const RowRange& rows : missing) {
    const RowRange held = rows_needed(rows, height, options);
    const auto band = read_observations(job.frames, width, held.first, held.last, options.clip_level);
    keep(rows, estimate_band(*table, band, rows, job.mask, options, workers, progress));
  }
  return static_cast<int>(bands.size() - missing.size());
}

void summarise(const ReflectanceField& field, const Mask& mask, EstimateSummary& summary) {
  std::size_t active = 0;
  std::vector<float> errors;
  for (std::size_t p = 0; p < field.transfer.rows(); ++p) {
    if (!mask.empty() && mask[p] == 0) continue;
    ++active;
    errors.push_back(field.training_error[p]);
  }
  summary.mean_kernels = active > 0 ? static_cast<double>(field.transfer.entries()) / active : 0.0;
  summary.median_training_error = quantile(std::move(errors), 0.5);
}

std::optional<tbb::global_control> limit_threads(const EstimateOptions& options) {
  if (options.threads == 0) return std::nullopt;
  return std::optional<tbb::global_control>(std::in_place, tbb::global_control::max_allowed_parallelism,
                                            options.threads);
}

}  // namespace

EstimatePlan plan_estimate(const CaptureSession& session, const EstimateOptions& options) {
  return plan_job(open_job(session, options), options);
}

EstimateSummary estimate_to_file(const CaptureSession& session, const EstimateOptions& options,
                                 const fs::path& output, bool resume) {
  const auto start = std::chrono::steady_clock::now();
  const auto limit = limit_threads(options);
  const Job job = open_job(session, options);
  EstimateSummary summary;
  summary.plan = plan_job(job, options);
  Checkpoint checkpoint(output, describe(job, options));
  if (resume)
    checkpoint.resume();
  else
    checkpoint.remove();
  const int width = job.session.width;
  summary.resumed_bands = estimate_bands(
      job, options, summary.plan, [&](RowRange rows) { return checkpoint.load(rows, width).has_value(); },
      [&](RowRange rows, const std::vector<PixelKernels>& kernels) { checkpoint.store(rows, kernels); });

  FieldAssembler assembler(job, options);
  for (const RowRange& rows : bands_of(job.session.height, summary.plan.band_rows)) {
    const auto kernels = checkpoint.load(rows, width);
    if (!kernels)
      throw InputError(output.string() +
                       ".partial: a finished band is damaged; run again with --resume to redo it");
    assembler.append(*kernels);
  }
  const ReflectanceField field = assembler.take();
  write_reflectance_field(output, field);
  checkpoint.remove();

  summarise(field, job.mask, summary);
  summary.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  summary.peak_memory_bytes = static_cast<std::uint64_t>(usage.ru_maxrss) * 1024;
  return summary;
}

ReflectanceField estimate_field(const CaptureSession& session, const EstimateOptions& options) {
  const auto limit = limit_threads(options);
  const Job job = open_job(session, options);
  FieldAssembler assembler(job, options);
  estimate_bands(
      job, options, plan_job(job, options), [](RowRange) { return false; },
      [&](RowRange, const std::vector<PixelKernels>& kernels) { assembler.append(kernels); });
  return assembler.take();
}

std::vector<KernelSnapshot> kernel_history(const CaptureSession& session, const EstimateOptions& options,
                                           int x, int y, const std::vector<int>& subdivisions) {
  const Job job = open_job(session, options);
  if (x < 0 || y < 0 || x >= job.session.width || y >= job.session.height)
    throw InputError("pixel (" + std::to_string(x) + ", " + std::to_string(y) + ") lies outside the " +
                     std::to_string(job.session.width) + "×" + std::to_string(job.session.height) + " image");
  const BoxTable table(illumination_paths(job.frames), job.session.light);
  const auto band = read_observations(job.frames, job.session.width, y, y + 1, options.clip_level);
  FitWorker worker(table, options);
  std::vector<KernelSnapshot> history;
  worker.tree.fit({band.samples(x, y, 0), band.samples(x, y, 1), band.samples(x, y, 2)},
                  [&](int count, std::span<const Box> boxes, std::span<const float> weights) {
                    if (std::ranges::find(subdivisions, count) == subdivisions.end()) return;
                    KernelSnapshot& snapshot = history.emplace_back();
                    snapshot.subdivisions = count;
                    snapshot.boxes.assign(boxes.begin(), boxes.end());
                    for (std::size_t k = 0; k < boxes.size(); ++k)
                      snapshot.weights.push_back({weights[3 * k], weights[3 * k + 1], weights[3 * k + 2]});
                  });
  return history;
}

}  // namespace refield
