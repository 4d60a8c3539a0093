// SPDX-License-Identifier: Apache-2.0
#include "estimate/estimate.h"

#include <cmath>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "cli/common/options.h"
#include "cli/estimate_options.h"
#include "cli/run_context.h"
#include "cli/verbs.h"
#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/base/json_text.h"
#include "core/base/number_text.h"
#include "core/base/output_lock.h"
#include "core/field/drift.h"
#include "core/field_io/reflectance_field_file.h"
#include "core/image/image_io.h"
#include "estimate/rig/rig_model.h"
#include "estimate/rig/verdict.h"
#include "relight/held_out.h"

namespace refield::cli {

namespace {

constexpr double gib = 1024.0 * 1024.0 * 1024.0;

struct EstimateArguments : EstimationArguments {
  std::string output;
  std::string rows;
  bool resume = false;
  bool dry_run = false;
};

/// "A:B", "A:", ":B", or "I/N": the I-th of N shards, from 1.
RowRange rows_from_text(const std::string& text, const CaptureSession& session,
                        const EstimateOptions& options) {
  const ImageHeader photograph = read_image_header(session.frames.front().observed);
  const int height = photograph.height;
  const auto mark = text.find_first_of(":/");
  const bool is_shard = mark != std::string::npos && text[mark] == '/';
  const auto number = [&](const std::string& digits, int if_empty) {
    if (digits.size() > 9 || digits.find_first_not_of("0123456789") != std::string::npos ||
        (digits.empty() && is_shard))
      throw InputError("--rows " + text +
                       ": is not a range of rows; give A:B for rows A to B - 1, counted from 0, or I/N for "
                       "the I-th of N shards");
    return digits.empty() ? if_empty : std::stoi(digits);
  };
  const int first = number(mark == std::string::npos ? "no mark" : text.substr(0, mark), 0);
  const int second = number(text.substr(mark + 1), height);
  if (!is_shard) return {first, second};
  if (first < 1 || first > second || second > height)
    throw InputError("--rows " + text +
                     ": the shard does not exist; give I/N with I from 1 to N, and N at most the " +
                     std::to_string(height) + " rows of the image");
  return rows_of_shard(first, second, photograph, options);
}

nlohmann::ordered_json plan_figures(const EstimateArguments& arguments, const EstimatePlan& plan) {
  return {{"mode", arguments.mode},
          {"kernels", arguments.options.kernels},
          {"images", plan.images},
          {"threads", plan.threads},
          {"rows", {plan.rows.first, plan.rows.last}},
          {"bands", plan.bands},
          {"rows_per_band", plan.band_rows},
          {"estimated_memory_bytes", plan.memory_bytes}};
}

/// What was found about the frames, for the log.
nlohmann::ordered_json frame_figures(const FrameReport& report) {
  static constexpr const char* kinds[] = {"brightness", "light", "region"};
  const auto list = [](const std::vector<LeftOutFrame>& frames) {
    nlohmann::ordered_json result = nlohmann::ordered_json::array();
    for (const LeftOutFrame& frame : frames)
      result.push_back({{"frame", frame.name},
                        {"why", frame.why},
                        {"kind", kinds[static_cast<int>(frame.found.kind)]},
                        {"residual", frame.found.residual},
                        {"times_typical", frame.found.times_typical},
                        {"share_of_picture", frame.found.share}});
    return result;
  };
  nlohmann::ordered_json figures = {{"left_out", list(report.left_out)}};
  if (!report.doubtful.empty()) figures["doubtful"] = list(report.doubtful);
  if (!report.drift.points.empty()) {
    nlohmann::ordered_json points = nlohmann::ordered_json::array();
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
    figures["rig"] = nlohmann::ordered_json::parse(rig_text(report.rig.model));
  if (report.typical_residual > 0.0) figures["typical_frame_residual"] = report.typical_residual;
  return figures;
}

nlohmann::ordered_json more_images_figures(int images, const EstimateSummary& summary) {
  const auto& points = summary.learning_curve;
  const LearningCurve curve(points, summary.median_photograph_noise.value_or(0.0));
  auto measured = nlohmann::ordered_json::array();
  for (const LearningPoint& point : points)
    measured.push_back({{"images", std::lround(point.share * images)}, {"error", point.error}});
  return {{"measured", measured},
          {"error_now", curve.error_at(1.0)},
          {"error_with_twice_the_images", curve.error_at(2.0)},
          {"advice", curve.advice()}};
}

nlohmann::ordered_json log_of(const EstimateArguments& arguments, const EstimateSummary& summary) {
  nlohmann::ordered_json log = {
      {"stage", "estimate"}, {"field", arguments.output}, {"version", REFIELD_VERSION}};
  log.update(plan_figures(arguments, summary.plan));
  log.update({{"resumed_bands", summary.resumed_bands},
              {"seconds", summary.seconds},
              {"peak_memory_bytes", summary.peak_memory_bytes},
              {"mean_kernels", summary.mean_kernels},
              {"median_training_error", summary.median_training_error}});
  log.update(frame_figures(summary.frames));
  const CaptureVerdict verdict = verdict_of(summary.frames, summary.plan.images);
  log["check"] = nlohmann::ordered_json::parse(verdict_json(verdict));
  const std::string unexplained = unexplained_error(
      summary.median_training_error, summary.median_photograph_noise.value_or(summary.frames.noise), verdict);
  if (!unexplained.empty()) log["unexplained_error"] = unexplained;
  if (summary.median_predicted_error)
    log.update({{"median_predicted_error", *summary.median_predicted_error},
                {"median_photograph_noise", *summary.median_photograph_noise}});
  if (const LearningCurve curve(summary.learning_curve, summary.median_photograph_noise.value_or(0.0));
      curve.known())
    log["more_images"] = more_images_figures(summary.plan.images, summary);
  return log;
}

void dry_run(const EstimateArguments& arguments, const CaptureSession& session, const Common& common) {
  const CostEstimate cost = estimate_cost(session, arguments.options, run_context());
  auto figures = plan_figures(arguments, cost.plan);
  figures.update({{"estimated_seconds", cost.seconds()},
                  {"estimated_seconds_lights", cost.lights_seconds},
                  {"estimated_seconds_photographs", cost.photographs_seconds},
                  {"estimated_seconds_fit", cost.fit_seconds},
                  {"estimated_seconds_frame_check", cost.check_seconds},
                  {"sampled_pixels", cost.sampled_pixels}});
  figures.update(frame_figures(cost.frames));
  if (common.json) {
    print_json(figures);
    return;
  }
  const EstimatePlan& plan = cost.plan;
  std::printf("%d images are usable; nothing was written\n", plan.images);
  std::printf("rows %d to %d in %d bands of %d\n", plan.rows.first, plan.rows.last - 1, plan.bands,
              plan.band_rows);
  std::printf("memory: %.2f GiB of the %.1f GiB allowed\n", plan.memory_bytes / gib, arguments.memory_gib);
  std::printf(
      "time on %d threads: about %.0f s (check of frames %.1f, lights %.1f, photographs %.1f, fit %.1f; from "
      "%d "
      "pixels)\n",
      plan.threads, cost.seconds(), cost.check_seconds, cost.lights_seconds, cost.photographs_seconds,
      cost.fit_seconds, cost.sampled_pixels);
}

void announce(const EstimateArguments& arguments, const EstimatePlan& plan) {
  run_context().note(
      formatted("estimate: %d images, rows %d to %d, %d bands of %d, %d threads, needs %.1f GiB of the %.1f "
                "GiB allowed",
                plan.images, plan.rows.first, plan.rows.last - 1, plan.bands, plan.band_rows, plan.threads,
                plan.memory_bytes / gib, arguments.memory_gib));
}

/// Errors on what --hold-out kept away from the estimate; nothing without it, or where only rows are there.
std::vector<HeldOutError> held_out_of(const EstimateArguments& arguments, CaptureSession session) {
  if (arguments.capture.hold_out == 0 || arguments.options.rows) return {};
  if (session.folder.empty()) check_image_sizes(session);
  if (!arguments.options.keep_drift) remove_drift(session, run_context());
  const ReflectanceField field = read_image_field(arguments.output, run_context());
  correct_held_out(field.provenance, session);
  return held_out_errors(field, session, nullptr, FrameRole::test, 1.0, run_context());
}

void run(EstimateArguments arguments, const Common& common) {
  const CaptureSession session = open_estimation(arguments).internal();
  if (!arguments.rows.empty())
    arguments.options.rows = rows_from_text(arguments.rows, session, arguments.options);
  if (arguments.dry_run) return dry_run(arguments, session, common);
  if (arguments.output.empty()) throw InputError("--output is missing; add -o NAME.rfield");
  const CaptureOptions& capture = arguments.capture;
  const OutputLock lock(arguments.output, {capture.session, capture.light, capture.observed, capture.mask},
                        ".rfield");
  const EstimateSummary summary =
      estimate_to_file(session, arguments.options, arguments.output, arguments.resume, run_context(),
                       [&](const EstimatePlan& plan) { announce(arguments, plan); });
  auto log = log_of(arguments, summary);
  const auto held_out = held_out_of(arguments, session);
  if (!held_out.empty())
    log["held_out"] = {{"every", arguments.capture.hold_out}, {"errors", held_out_figures(held_out)}};
  write_text_atomically(arguments.output + ".log.json", json_text(log, 2) + "\n");
  if (common.json) {
    print_json(log);
    return;
  }
  std::printf("%s: %.1f kernels per pixel, training error %.4f (median), %.1f s, %.2f GiB\n",
              arguments.output.c_str(), summary.mean_kernels, summary.median_training_error, summary.seconds,
              summary.peak_memory_bytes / gib);
  if (summary.median_predicted_error)
    std::printf("predicted error on new photographs %.4f (median), of which photograph noise %.4f\n",
                *summary.median_predicted_error, *summary.median_photograph_noise);
  const CaptureVerdict verdict = verdict_of(summary.frames, summary.plan.images);
  if (verdict.state() != RigFinding::State::good) std::printf("%s", verdict_table(verdict).c_str());
  const std::string unexplained = unexplained_error(
      summary.median_training_error, summary.median_photograph_noise.value_or(summary.frames.noise), verdict);
  if (!unexplained.empty())
    std::printf("%s\n", unexplained.c_str());
  else if (const LearningCurve curve(summary.learning_curve, summary.median_photograph_noise.value_or(0.0));
           curve.known())
    std::printf("%s\n", curve.advice().c_str());
  if (!summary.frames.left_out.empty())
    std::printf("left out because they do not fit the other photographs: %s\n",
                listed(summary.frames.left_out, summary.frames.left_out.size(), &LeftOutFrame::name).c_str());
  if (!held_out.empty()) {
    std::printf("error on the images excluded by --hold-out %d:\n", arguments.capture.hold_out);
    print_errors(held_out);
  } else if (arguments.capture.hold_out != 0) {
    std::printf(
        "a shard is not compared with photographs; after 'refield merge', 'refield compare' prints the "
        "error\n");
  }
}

}  // namespace

CLI::Option* add_dry_run_flag(CLI::App& verb, bool& dry_run) {
  return verb.add_flag("--dry-run", dry_run,
                       "Check all input and print the plan with memory and time; write nothing");
}

void add_estimation_options(CLI::App& verb, EstimationArguments& arguments) {
  verb.add_option("session", arguments.capture.session,
                  "Capture session (folder), as written by 'refield acquire' or 'refield simulate'");
  add_capture_options(verb, arguments.capture);
  verb.add_option(
          "--mode", arguments.mode,
          "Mode: refined (a smooth component plus rectangular light regions), paper (Matusik et al. 2004: "
          "light regions only) or fast (as paper, with a faster search)")
      ->capture_default_str();
  add_placement_option(
      verb, arguments.placements,
      "Stored in the field for relighting by environment maps (default: that of the session).");
  verb.add_option("--max-kernels", arguments.options.kernels,
                  "Maximum number of kernels per pixel; 0: as many as the data support")
      ->capture_default_str()
      ->group(further);
  verb.add_option("--clip", arguments.options.clip_level,
                  "Radiance from which samples are ignored as clipped by the camera (default: none)")
      ->group(further);
  verb.add_flag("--keep-outliers", arguments.options.keep_outliers,
                "Keep photographs that do not fit the others (flicker, stray light, a person in view); by "
                "default they are detected, listed and left out")
      ->group(further);
  verb.add_option("--rig", arguments.rig,
                  "Correction of the rig: auto (find wrong pairs, camera motion, colour mixing, tone curve, "
                  "brightness and drift from the photographs), off, or a file (JSON) with the model of "
                  "another run, as in "
                  "'rig' of OUTPUT.log.json")
      ->capture_default_str()
      ->group(further);
  verb.add_option("--memory", arguments.memory_gib,
                  "Memory limit in GiB; the image is processed in bands of rows that fit")
      ->capture_default_str();
  verb.add_option("--threads", arguments.options.threads,
                  "Number of threads; 0: all cores. The result does not depend on it")
      ->capture_default_str()
      ->group(further);
  verb.add_option("--refine", arguments.options.refine,
                  "Field (.rfield) of the same capture, estimated from fewer of its images. Kernels are "
                  "chosen among those of this field, which saves most of the search")
      ->group(further);
}

Session open_estimation(EstimationArguments& arguments) {
  arguments.options.mode = estimate_mode_from_name(arguments.mode);
  if (!(arguments.memory_gib > 0.0 && arguments.memory_gib < 1e6))
    throw InputError("--memory is " + std::to_string(arguments.memory_gib) +
                     "; give a number of GiB above 0");
  arguments.options.memory_bytes = static_cast<std::uint64_t>(arguments.memory_gib * gib);
  arguments.options.keep_rig = arguments.options.keep_drift = arguments.rig == "off";
  if (arguments.rig != "off" && arguments.rig != "auto")
    arguments.options.rig = std::make_shared<const RigModel>(read_rig(arguments.rig));
  Session session = open_capture(arguments.capture);
  if (!arguments.placements.empty()) session.set_monitors(placements_from_texts(arguments.placements));
  return session;
}

void add_estimate(CLI::App& app, const Common& common, Action& action) {
  auto arguments = std::make_shared<EstimateArguments>();
  CLI::App* verb = app.add_subcommand(
      "estimate",
      "Estimate a reflectance field from photographs under known illumination.\n"
      "\n"
      "The input is a capture session, or light maps and photographs (scene-linear OpenEXR) that are paired "
      "by the text that the wildcards match. An interrupted estimation continues with --resume; finished "
      "rows are kept in OUTPUT.partial. OUTPUT.log.json records the settings and results.\n"
      "\n"
      "Examples:\n"
      "  refield estimate session -o scene.rfield\n"
      "  refield estimate --light 'light/*.exr' --observed 'observed/*.exr' --hold-out 10 -o scene.rfield");
  add_estimation_options(*verb, *arguments);
  verb->add_option("-o,--output", arguments->output, "Reflectance field to write (.rfield)");
  verb->add_option("--rows", arguments->rows,
                   "Rows to estimate, written as a shard for 'refield merge': A:B for rows A to B - 1, "
                   "counted from 0, or I/N for the I-th of N shards of about equal height")
      ->group(further);
  add_dry_run_flag(*verb, arguments->dry_run);
  verb->add_flag("--resume", arguments->resume, "Continue an interrupted run: keep the finished rows");
  verb->callback(
      [arguments, &common, &action] { action = [arguments, &common] { run(*arguments, common); }; });
}

}  // namespace refield::cli
