// SPDX-License-Identifier: Apache-2.0
#include "estimate/estimate.h"

#include "core/base/isolated.h"
#include "core/base/json.h"
#include "core/base/output_lock.h"
#include "core/field/drift.h"
#include "core/image/image_io.h"
#include "core/image/metrics.h"
#include "estimate/rig/rig_model.h"
#include "estimate/rig/verdict.h"
#include "library/data.h"
#include "refield/compare.h"
#include "refield/estimate.h"
#include "relight/held_out.h"

namespace refield {

IsolatedReader v0_2::isolated_reader(const fs::path& program, const std::atomic<bool>* stop) {
  return [program, run = RunContext{.stop = stop}](const IsolatedReading& reading) {
    return read_in_process(program, reading, run);
  };
}

std::shared_ptr<const RigModel> v0_2::rig_model(const std::string& text, const std::string& name) {
  return std::make_shared<const RigModel>(rig_from_text(text, name));
}

std::shared_ptr<const RigModel> v0_2::rig_model(const fs::path& file) {
  return std::make_shared<const RigModel>(read_rig(file));
}

Field v0_2::estimate(const Session& session, const EstimateOptions& options, const RunContext& run) {
  options.check();
  return guarded(run, [&] { return public_field(estimate_field(session.internal(), options, run)); });
}

Field v0_2::estimate(const CaptureArrays& capture, const EstimateOptions& options, const RunContext& run) {
  options.check();
  if (!capture.lights.empty()) check_placements(capture.monitors, capture.lights[0].domain(), "monitor");
  return guarded(run, [&] {
    ReflectanceField field =
        estimate(capture.lights, capture.photographs, capture.sigma, capture.mask, options, run);
    field.monitors = capture.monitors;
    return public_field(std::move(field));
  });
}

// ---- estimation into a file

namespace {

Json plan_figures(const EstimateOptions& options, const EstimatePlan& plan) {
  return {{"mode", name_of(options.mode)},
          {"kernels", options.kernels},
          {"images", plan.images},
          {"threads", plan.threads},
          {"rows", {plan.rows.first, plan.rows.last}},
          {"bands", plan.bands},
          {"rows_per_band", plan.band_rows},
          {"estimated_memory_bytes", plan.memory_bytes}};
}

/// What was found about the frames, for the log.
Json frame_figures(const FrameReport& report) {
  static constexpr const char* kinds[] = {"brightness", "light", "region"};
  const auto list = [](const std::vector<LeftOutFrame>& frames) {
    Json result = Json::array();
    for (const LeftOutFrame& frame : frames)
      result.push_back({{"frame", frame.name},
                        {"why", frame.why},
                        {"kind", kinds[static_cast<int>(frame.found.kind)]},
                        {"residual", frame.found.residual},
                        {"times_typical", frame.found.times_typical},
                        {"share_of_picture", frame.found.share}});
    return result;
  };
  Json figures = {{"left_out", list(report.left_out)}};
  if (!report.doubtful.empty()) figures["doubtful"] = list(report.doubtful);
  if (!report.drift.points.empty()) {
    Json points = Json::array();
    for (const DriftPoint& point : report.drift.points)
      points.push_back({{"frame", point.frame},
                        {"order", point.order},
                        {"gain", point.gain},
                        {"uncertainty", point.uncertainty},
                        {"used", point.used}});
    figures["drift"] = {{"removed", report.drift.significant},
                        {"largest_change", report.drift.largest},
                        {"reference_frames", points}};
  }
  if (!report.rig.findings.empty() || !report.rig.model.is_identity())
    figures["rig"] = json_from_text(rig_text(report.rig.model));
  if (report.typical_residual > 0.0) figures["typical_frame_residual"] = report.typical_residual;
  return figures;
}

Json more_images_figures(int images, const std::vector<LearningPoint>& points, const LearningCurve& curve) {
  auto measured = Json::array();
  for (const LearningPoint& point : points)
    measured.push_back({{"images", std::lround(point.share * images)}, {"error", point.error}});
  return {{"measured", measured},
          {"error_now", curve.error_at(1.0)},
          {"error_with_twice_the_images", curve.error_at(2.0)},
          {"advice", curve.advice()}};
}

/// Fills in the texts of a report.
void tell(EstimateSummary& summary, const fs::path& file, const EstimateOptions& options) {
  Json log = {{"stage", "estimate"}, {"field", file.string()}, {"version", REFIELD_VERSION}};
  log.update(plan_figures(options, summary.plan));
  log.update({{"resumed_bands", summary.resumed_bands},
              {"seconds", summary.seconds},
              {"peak_memory_bytes", summary.peak_memory_bytes},
              {"mean_kernels", summary.mean_kernels},
              {"median_training_error", summary.median_training_error}});
  log.update(frame_figures(summary.frames));
  for (const LeftOutFrame& frame : summary.frames.left_out) summary.left_out.push_back(frame.name);
  const CaptureVerdict verdict = verdict_of(summary.frames, summary.plan.images);
  if (verdict.state() != RigFinding::State::good) summary.verdict = verdict_table(verdict);
  log["check"] = verdict_json(verdict);
  const std::string unexplained = unexplained_error(
      summary.median_training_error, summary.median_photograph_noise.value_or(summary.frames.noise),
      summary.median_shared_error, verdict);
  if (!unexplained.empty()) log["unexplained_error"] = unexplained;
  if (summary.median_predicted_error)
    log.update({{"median_predicted_error", *summary.median_predicted_error},
                {"median_photograph_noise", *summary.median_photograph_noise}});
  const LearningCurve curve(summary.learning_curve, summary.median_photograph_noise.value_or(0.0));
  if (curve.known())
    log["more_images"] = more_images_figures(summary.plan.images, summary.learning_curve, curve);
  summary.advice = !unexplained.empty() ? unexplained : curve.known() ? curve.advice() : "";
  summary.log = json_text(log, 2);
}

/// What an output must not replace.
std::vector<fs::path> inputs_of(const CaptureSession& session) {
  std::vector<fs::path> inputs = {session.folder, session.mask.value_or("")};
  if (session.folder.empty())
    for (const CaptureFrame& frame : session.frames)
      inputs.insert(inputs.end(), {frame.illumination, frame.observed});
  return inputs;
}

}  // namespace

EstimateReport v0_2::estimate_to_file(const Session& session, const EstimateOptions& options,
                                      const fs::path& file, bool resume, const RunContext& run,
                                      const std::function<void(const EstimatePlan&)>& announce) {
  options.check();
  return guarded(run, [&]() -> EstimateReport {
    const OutputLock lock(file, inputs_of(session.internal()), ".rfield");
    EstimateSummary summary = estimate_to_file(session.internal(), options, file, resume, run, announce);
    tell(summary, file, options);
    return summary;
  });
}

EstimateCost v0_2::estimate_cost(const Session& session, const EstimateOptions& options,
                                 const RunContext& run) {
  options.check();
  return guarded(run, [&]() -> EstimateCost {
    CostEstimate cost = estimate_cost(session.internal(), options, run);
    Json figures = plan_figures(options, cost.plan);
    figures.update({{"estimated_seconds", cost.seconds()},
                    {"estimated_seconds_lights", cost.lights_seconds},
                    {"estimated_seconds_photographs", cost.photographs_seconds},
                    {"estimated_seconds_fit", cost.fit_seconds},
                    {"estimated_seconds_frame_check", cost.check_seconds},
                    {"sampled_pixels", cost.sampled_pixels}});
    figures.update(frame_figures(cost.frames));
    cost.log = json_text(figures, 2);
    return cost;
  });
}

RowRange v0_2::rows_of_shard(const Session& session, int shard, int shards, const EstimateOptions& options) {
  if (shard < 1 || shard > shards || shards > session.height())
    throw InputError("--rows ", shard, "/", shards,
                     ": the shard does not exist; give I/N with I from 1 to N, and N at most the ",
                     session.height(), " rows of the image");
  return rows_of_shard(shard, shards, read_image_header(session.frame(0).observed), options);
}

// ---- comparison

namespace {

std::shared_ptr<const ReflectanceField> image_rows(const Field& field) {
  if (field.has_mesh())
    throw InputError(field.internal().name,
                     ": is a mesh field, but an image field is required; use 'refield relight' or 'refield "
                     "view' for mesh fields");
  return field.internal().rows();
}

/// Integer formats carry no noise; floats may.
Photograph read_image_of_series(const fs::path& file) {
  return file.extension() == ".exr" ? read_photograph(file) : Photograph{read_image(file), {}};
}

/// Blackens pixels that do not count, and checks the others.
void require_comparable(Image& image, const fs::path& file, const Mask& mask) {
  for (std::size_t p = 0; p < mask.size() && p < image.pixel_count(); ++p)
    if (!mask[p]) std::fill_n(image.values.begin() + 3 * p, 3, 0.0f);
  require_finite(image, file.string(), true, "repair that pixel or exclude it with --mask");
}

}  // namespace

std::vector<HeldOutError> v0_2::compare(const Field& field, const Session& given, const Field* truth,
                                        double noise_scale, const RunContext& run) {
  return guarded(run, [&] {
    CaptureSession session = given.internal();
    const auto rows = image_rows(field), exact = truth ? image_rows(*truth) : nullptr;
    mark_held_out(session, rows->provenance);
    if (!truth) remove_drift(session, run);
    correct_held_out(rows->provenance, session);
    auto errors = held_out_errors(*rows, session, exact.get(), FrameRole::test, noise_scale, run);
    if (const std::string warning = training_warning(errors); !warning.empty()) run.note(warning);
    return errors;
  });
}

HeldOutError v0_2::compare(const std::string& predicted, const std::string& observed,
                           const fs::path& mask_file, const RunContext& run) {
  return guarded(run, [&] {
    const auto pairs = pair_files(predicted, observed, "prediction", "observed image");
    const ImageHeader first = read_image_header(pairs.front().second);
    const Mask mask = mask_file.empty() ? Mask{} : read_mask(mask_file, first.width, first.height);
    SeriesError series(mask);
    std::vector<HeldOutImage> per_image;
    Progress progress(run, "compare", pairs.size());
    for (const auto& [predicted_file, observed_file] : pairs) {
      run.throw_if_stopped();
      Image image = read_image_of_series(predicted_file).radiance;
      Photograph reference = read_image_of_series(observed_file);
      if (!image.same_shape(reference.radiance))
        throw InputError(predicted_file, ": is ", shape_text(image), ", ", observed_file, " is ",
                         shape_text(reference.radiance), "; the images must have the same size");
      require_comparable(image, predicted_file, mask);
      require_comparable(reference.radiance, observed_file, mask);
      series.add(image, reference.radiance, reference.sigma);
      per_image.push_back({predicted_file.filename().string(), observed_file,
                           image_error(image, reference.radiance, mask, reference.sigma)});
      progress.advance();
    }
    return error_of(series, std::move(per_image));
  });
}

HeldOutError v0_2::compare(std::span<const ImageView> predicted, std::span<const ImageView> observed,
                           std::span<const ImageView> sigma, const Mask& mask) {
  if (predicted.empty() || predicted.size() != observed.size() ||
      (!sigma.empty() && sigma.size() != predicted.size()))
    throw InputError(predicted.size(), " predicted and ", observed.size(),
                     " observed images do not belong together; give as many of both");
  SeriesError series(mask);
  std::vector<HeldOutImage> per_image;
  for (std::size_t i = 0; i < predicted.size(); ++i) {
    const Image a(predicted[i]), b(observed[i]), s = sigma.empty() ? Image() : Image(sigma[i]);
    series.add(a, b, s);
    for (std::size_t k = 0; k < b.values.size(); ++k)
      if ((!std::isfinite(a.values[k]) || !std::isfinite(b.values[k])) &&
          (s.empty() || !std::isinf(s.values[k])) && (mask.empty() || mask[k / 3] != 0))
        throw InputError(std::isfinite(b.values[k]) ? "predicted" : "observed", "[", i,
                         "]: has a sample that is not finite; exclude it by the mask, or mark ",
                         "it as unmeasured (sigma = inf)");
    per_image.push_back({std::to_string(i), {}, image_error(a, b, mask, s)});
  }
  return error_of(series, std::move(per_image));
}

}  // namespace refield
