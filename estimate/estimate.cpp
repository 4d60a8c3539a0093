// SPDX-License-Identifier: Apache-2.0
#include "estimate/estimate.h"

#include <fstream>

#include "core/base/run_context.h"
#include "core/base/units.h"
#include "core/field_io/field_shard.h"
#include "core/field_io/reflectance_field_file.h"
#include "estimate/cost_estimate.h"
#include "estimate/fit/light_groups.h"
#include "estimate/job/checkpoint.h"
#include "estimate/job/estimate_band.h"
#include "estimate/job/estimate_job.h"
#include "estimate/job/light_tables.h"
#include "estimate/quality/frame_check.h"

namespace refield {

namespace {

/// Where training lights of few degrees of freedom were not black; empty if nowhere was.
std::vector<Box> observed_by(const TexelRegressions* texels, const LightDomain& domain) {
  if (!texels) return {};
  std::int64_t lit = 0;
  for (const Box& cell : texels->cells()) lit += cell.area();
  return lit < std::int64_t{domain.width} * domain.height ? texels->cells() : std::vector<Box>{};
}

struct BandsDone {
  int resumed = 0;                  ///< taken over
  std::vector<Box> observed_light;  ///< see FieldOutline
  LightErrorModel light_error;      ///< see FieldQuality
};

/// Estimates all bands that `find` does not already have, handing each to `keep`.
template <class Find, class Keep>
BandsDone estimate_bands(const EstimateJob& job, const EstimateOptions& options, const EstimatePlan& plan,
                         Find find, Keep keep, const RunContext& run) {
  const int width = job.session.width;
  const int height = job.session.height;
  FitWorkers workers;
  std::uint64_t pixels = 0;
  std::vector<RowRange> missing;
  const auto bands = bands_of(plan);
  for (const RowRange& rows : bands)
    if (!find(rows)) {
      missing.push_back(rows);
      pixels += static_cast<std::uint64_t>(width) * rows_fitted(rows, height, options).count();
    }
  // Also where no band is missing, for what depends on the lights alone.
  std::unique_ptr<LightTables> lights;
  if (options.mode == EstimateMode::refined || options.predict_errors || !missing.empty())
    lights = std::make_unique<LightTables>(job, options, run);
  if (job.refinement) job.refinement->use_frames(job.frames);
  Progress progress(run, "estimate", pixels);
  std::optional<ObservationBand> band;
  for (std::size_t i = 0; i < missing.size(); ++i) {
    const RowRange rows = missing[i];
    const RowRange needed = rows_needed(rows, height, options);
    if (!band || needed.first < band->first_row() || needed.last > band->last_row()) {
      RowRange held = needed;
      for (std::size_t next = i + 1; next < missing.size(); ++next) {
        const RowRange more = rows_needed(missing[next], height, options);
        if (more.first > held.last || more.last - held.first > plan.held_rows) break;
        held.last = more.last;
      }
      band.reset();
      band = read_observations(job.frames, width, held.first, held.last, options.clip_level, run);
      if (lights->weighs_images()) band->weight_images(job.noise.image_weights);
    }
    keep(rows, estimate_band({lights->table(), *band, rows, height, job.mask, options, job.mean_square,
                              job.refinement.get(), lights->texels(), &job.noise},
                             workers, progress, run));
  }
  const auto resumed = static_cast<int>(bands.size() - missing.size());
  if (!lights) return {resumed, {}, {}};
  return {resumed, observed_by(lights->texels(), job.session.light), lights->light_error()};
}

/// `field` holds the job's rows alone, the mask the whole picture.
void summarise(const ReflectanceField& field, const EstimateJob& job, EstimateSummary& summary) {
  const std::size_t before = static_cast<std::size_t>(job.rows.first) * job.session.width;
  std::size_t active = 0;
  std::vector<float> errors;
  for (std::size_t p = 0; p < field.transfer.rows(); ++p) {
    if (!job.mask.empty() && job.mask[before + p] == 0) continue;
    ++active;
    errors.push_back(field.quality.training_error[p]);
  }
  summary.mean_kernels = active > 0 ? static_cast<double>(field.transfer.row_start.back()) / active : 0.0;
  summary.median_training_error = quantile(std::move(errors), 0.5);
  if (field.quality.predicted_error.empty()) return;
  std::vector<float> predicted, noise;
  for (std::size_t p = 0; p < field.quality.predicted_error.size(); ++p) {
    if (!(field.quality.predicted_error[p] > 0.0f)) continue;
    predicted.push_back(field.quality.predicted_error[p]);
    noise.push_back(field.quality.photograph_noise[p]);
  }
  if (predicted.empty()) return;
  summary.median_predicted_error = quantile(std::move(predicted), 0.5);
  summary.median_photograph_noise = quantile(std::move(noise), 0.5);
  summary.learning_curve = field.quality.learning_curve;
}

std::optional<double> median_shared_error(std::span<const ErrorEvidence> evidence) {
  std::vector<float> shared;
  for (const ErrorEvidence& pixel : evidence)
    if (std::isfinite(pixel.shared)) shared.push_back(pixel.shared);
  if (shared.empty()) return std::nullopt;
  return std::sqrt(std::max(0.0, quantile(std::move(shared), 0.5)));
}

/// The most memory that this program held. getrusage() would also count what started it held before.
std::uint64_t peak_memory_bytes() {
  std::ifstream status("/proc/self/status");
  std::uint64_t kibibytes = 0;
  for (std::string word; status >> word;)
    if (word == "VmHWM:") status >> kibibytes;
  return kibibytes * 1024;
}

/// A whole picture without any kernel tells nothing: says why.
[[noreturn]] void refuse_empty(const EstimateJob& job, const EstimateOptions& options,
                               const RunContext& run) {
  const auto sample =
      read_pixel_sample(job.frames, job.session.width, job.session.height, job.mask, options.clip_level, run);
  const bool measured =
      std::ranges::any_of(sample.values, [](float value) { return std::isfinite(value) && value != 0.0f; });
  const bool dark = std::ranges::any_of(sample.values, [](float value) { return value == 0.0f; });
  throw InputError(
      job.frames.front().observed, " and the other photographs: ",
      measured ? "no pixel could be fitted; check that light maps and photographs belong together"
      : dark   ? "they are black under all lights, so there is nothing to estimate; check the exposure and "
                 "the mask"
             : "no sample was measured (all are at or above --clip, or marked by sigma = inf); raise --clip "
               "or expose shorter");
}

EstimateOptions with_thread_limit(EstimateOptions options, const RunContext& run) {
  if (run.max_threads > 0)
    options.threads = options.threads > 0 ? std::min(options.threads, run.max_threads) : run.max_threads;
  return options;
}

/// Of fewer lights, the light tables have said so.
void note_unpredicted(const EstimateJob& job, const FieldOutline& field, const RunContext& run) {
  const std::vector<float>& predicted = field.quality.predicted_error;
  if (predicted.empty() || static_cast<int>(job.frames.size()) < min_lights_for_errors ||
      std::ranges::any_of(predicted, [](float error) { return error > 0.0f; }))
    return;
  run.note(
      "the error on new photographs cannot be predicted: the field fits its photographs so closely that they "
      "tell nothing of others; photograph more lights that differ");
}

ReflectanceField field_of(EstimateJob job, const EstimateOptions& wanted, const RunContext& run) {
  const EstimateOptions options = with_thread_limit(wanted, run);
  const auto limit = limit_threads(plan_job(job, options, FieldGoes::to_memory).threads);
  check_frames(job, options, run);
  FieldAssembler assembler(job, options);
  BandsDone done = estimate_bands(
      job, options, plan_job(job, options, FieldGoes::to_memory), [](RowRange) { return false; },
      [&](RowRange, const std::vector<PixelKernels>& kernels) { assembler.append(kernels); }, run);
  ReflectanceField field = assembler.take(std::move(done.observed_light), std::move(done.light_error));
  note_unpredicted(job, field, run);
  return field;
}

}  // namespace

EstimatePlan plan_estimate(const CaptureSession& session, const EstimateOptions& options,
                           const RunContext& run) {
  return plan_job(open_job(session, options, run), options);
}

EstimateSummary estimate_to_file(const CaptureSession& session, const EstimateOptions& wanted,
                                 const fs::path& output, bool resume, const RunContext& run,
                                 const std::function<void(const EstimatePlan&)>& announce) {
  const auto start = std::chrono::steady_clock::now();
  const EstimateOptions options = with_thread_limit(wanted, run);
  EstimateJob job = open_job(session, options, run);
  const EstimatePlan first_plan = plan_job(job, options);
  if (announce) announce(first_plan);
  const auto limit = limit_threads(first_plan.threads);
  EstimateSummary summary;
  summary.frames = options.rows
                       ? check_frames_once(job, options, output.parent_path() / frame_check_name, run)
                       : check_frames(job, options, run);
  summary.plan = plan_job(job, options);
  const std::string key = job_key(job, options);
  Checkpoint checkpoint(output, key);
  if (resume)
    checkpoint.resume();
  else
    checkpoint.remove();
  const int width = job.session.width;
  BandsDone done = estimate_bands(
      job, options, summary.plan, [&](RowRange rows) { return checkpoint.has(rows); },
      [&](RowRange rows, const std::vector<PixelKernels>& kernels) { checkpoint.store(rows, kernels); }, run);
  summary.resumed_bands = done.resumed;

  // The transfer goes from the finished bands to the file; only what is known of each pixel is held of all.
  FieldAssembler assembler(job, options);
  const std::vector<RowRange> bands = bands_of(summary.plan);
  Progress writing(run, "write", (needs_whole_field(job, options) ? 1 : 2) * bands.size());
  const auto kernels_of = [&](const RowRange& rows) {
    run.throw_if_stopped();
    auto kernels = checkpoint.load(rows, width);
    if (!kernels)
      throw InputError(output, ".partial: a finished band is damaged; run again with --resume to redo it");
    writing.advance();
    return *std::move(kernels);
  };
  const bool is_held = needs_whole_field(job, options);
  for (const RowRange& rows : bands)
    is_held ? assembler.append(kernels_of(rows)) : assembler.note(kernels_of(rows));
  FieldPart part{assembler.take(std::move(done.observed_light), std::move(done.light_error)), job.rows,
                 job.session.height, key, assembler.take_evidence()};
  const ReflectanceField& field = part.field;
  summary.median_shared_error = median_shared_error(part.error_evidence);
  if (!options.rows && !assembler.has_weights()) {
    checkpoint.remove();
    refuse_empty(job, options, run);
  }
  SparseTransfer piece;
  const TransferPieces transfer{field.transfer.row_start, bands.size(),
                                [&](std::size_t i) -> const SparseTransfer& {
                                  piece = {};  // before the next is made
                                  piece = assembler.transfer_of(kernels_of(bands[i]));
                                  return piece;
                                }};
  if (options.rows) {
    write_field_part(output, part, transfer, run);
  } else {
    part.error_evidence = {};  // has been used
    if (is_held)
      write_reflectance_field(output, field);
    else
      write_reflectance_field(output, field, transfer, run);
  }
  checkpoint.remove();

  note_unpredicted(job, field, run);
  summarise(field, job, summary);
  summary.seconds = seconds_since(start);
  summary.peak_memory_bytes = peak_memory_bytes();
  return summary;
}

ReflectanceField estimate_field(const CaptureSession& session, const EstimateOptions& options,
                                const RunContext& run) {
  return field_of(open_job(session, options, run), options, run);
}

ReflectanceField estimate(std::span<const LightMapView> lights, std::span<const ImageView> photographs,
                          std::span<const ImageView> sigma, const Mask& mask, const EstimateOptions& options,
                          const RunContext& run) {
  if (lights.size() != photographs.size() || (!sigma.empty() && sigma.size() != photographs.size()))
    throw InputError(lights.size(), " light maps, ", photographs.size(), " photographs and ", sigma.size(),
                     " arrays of sigma do not belong together; give one light map for each photograph, and "
                     "one sigma for each or none");
  CaptureSession session;
  for (std::size_t j = 0; j < lights.size(); ++j) {
    const std::string number = std::to_string(j);
    if (lights[j].parameterisation != lights[0].parameterisation)
      throw InputError("light map ", number, ": has another parameterisation than light map 0");
    CaptureFrame& frame = session.frames.emplace_back();
    frame.name = number;
    frame.illumination = "light map " + number;
    frame.observed = "photograph " + number;
    frame.order = static_cast<double>(j);
    frame.views = {lights[j].radiance, photographs[j], sigma.empty() ? ImageView() : sigma[j]};
    session.light.parameterisation = lights[j].parameterisation;
  }
  EstimateJob job = open_job(session, options, run);
  if (!mask.empty()) {
    if (mask.size() != static_cast<std::size_t>(job.session.width) * job.session.height)
      throw InputError("the mask has ", mask.size(), " pixels, the photographs are ", job.session.width, "×",
                       job.session.height);
    require_any_inside(mask, "the mask");
    job.mask = mask;
  }
  return field_of(std::move(job), options, run);
}

std::vector<KernelSnapshot> kernel_history(const CaptureSession& session, const EstimateOptions& options,
                                           int x, int y, const std::vector<int>& subdivisions,
                                           const RunContext& run) {
  const EstimateJob job = open_job(session, options, run);
  if (x < 0 || y < 0 || x >= job.session.width || y >= job.session.height)
    throw InputError("pixel (", x, ", ", y, ") lies outside the ", job.session.width, "×", job.session.height,
                     " image");
  const BoxTable table(job.frames, job.session.light, {}, run);
  const auto band = read_observations(job.frames, job.session.width, y, y + 1, options.clip_level, run);
  const SmoothSpace none(table);
  KernelCache cache(table, none, options.mode);
  std::vector<KernelSnapshot> history;
  PixelFitter(cache, options)
      .fit({band.samples(x, y, 0), band.samples(x, y, 1), band.samples(x, y, 2)},
           [&](int count, std::span<const Box> boxes, std::span<const float> weights) {
             if (std::ranges::find(subdivisions, count) == subdivisions.end()) return;
             KernelSnapshot& snapshot = history.emplace_back();
             snapshot.subdivisions = count;
             snapshot.boxes.assign(boxes.begin(), boxes.end());
             const auto factor = static_cast<float>(1.0 / table.unit());
             for (std::size_t k = 0; k < boxes.size(); ++k)
               snapshot.weights.push_back(
                   {factor * weights[3 * k], factor * weights[3 * k + 1], factor * weights[3 * k + 2]});
           });
  return history;
}

}  // namespace refield
