// SPDX-License-Identifier: Apache-2.0
#include "refield/estimate.h"

#include <cstdio>
#include <nlohmann/json.hpp>

#include "common/options.h"
#include "estimate_options.h"
#include "refield/compare.h"
#include "run_context.h"
#include "verbs.h"

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
RowRange rows_from_text(const std::string& text, const Session& session, const EstimateOptions& options) {
  const int height = session.height();
  const auto mark = text.find_first_of(":/");
  const bool is_shard = mark != std::string::npos && text[mark] == '/';
  const auto number = [&](const std::string& digits, int if_empty) {
    if (digits.size() > 9 || digits.find_first_not_of("0123456789") != std::string::npos ||
        (digits.empty() && is_shard))
      throw InputError("--rows ", text,
                       ": is not a range of rows; give A:B for rows A to B - 1, counted from 0, or I/N for "
                       "the I-th of N shards");
    return digits.empty() ? if_empty : std::stoi(digits);
  };
  const int first = number(mark == std::string::npos ? "no mark" : text.substr(0, mark), 0);
  const int second = number(text.substr(mark + 1), height);
  if (!is_shard) return {first, second};
  return rows_of_shard(session, first, second, options);
}

void dry_run(const EstimateArguments& arguments, const Session& session, const Common& common) {
  const EstimateCost cost = estimate_cost(session, arguments.options, run_context());
  if (common.json) return print_json(json_from_text(cost.log));
  const EstimatePlan& plan = cost.plan;
  std::printf("%d images are usable; nothing was written\n", plan.images);
  std::printf("rows %d to %d in %d bands of %d\n", plan.rows.first, plan.rows.last - 1, plan.bands,
              plan.band_rows);
  std::printf("memory: %.2f GiB of the %.1f GiB allowed\n", plan.memory_bytes / gib, arguments.memory_gib);
  std::printf(
      "time on %d threads: about %.0f s (check of frames %.1f, lights %.1f, photographs %.1f, fit %.1f; from "
      "%d pixels)\n",
      plan.threads, cost.seconds(), cost.check_seconds, cost.lights_seconds, cost.photographs_seconds,
      cost.fit_seconds, cost.sampled_pixels);
}

void announce(const EstimateArguments& arguments, const EstimatePlan& plan) {
  char text[256];
  std::snprintf(text, sizeof text,
                "estimate: %d images, rows %d to %d, %d bands of %d, %d threads, needs %.1f GiB of the %.1f "
                "GiB allowed",
                plan.images, plan.rows.first, plan.rows.last - 1, plan.bands, plan.band_rows, plan.threads,
                plan.memory_bytes / gib, arguments.memory_gib);
  run_context().note(text);
}

/// Errors on what --hold-out kept away from the estimate; nothing without it, or where only rows are there.
std::vector<HeldOutError> held_out_of(const EstimateArguments& arguments, const Session& session) {
  if (arguments.capture.hold_out == 0 || arguments.options.rows) return {};
  return compare(Field(arguments.output, run_context()), session, nullptr, 1.0, run_context());
}

void print(const EstimateArguments& arguments, const EstimateReport& report,
           const std::vector<HeldOutError>& held_out) {
  std::printf("%s: %.1f kernels per pixel, training error %.4f (median), %.1f s, %.2f GiB\n",
              arguments.output.c_str(), report.mean_kernels, report.median_training_error, report.seconds,
              report.peak_memory_bytes / gib);
  if (report.median_predicted_error)
    std::printf("predicted error on new photographs %.4f (median), of which photograph noise %.4f\n",
                *report.median_predicted_error, *report.median_photograph_noise);
  std::printf("%s", report.verdict.c_str());
  if (!report.advice.empty()) std::printf("%s\n", report.advice.c_str());
  std::string left_out;
  for (const std::string& name : report.left_out) left_out += (left_out.empty() ? "" : ", ") + name;
  if (!left_out.empty())
    std::printf("left out because they do not fit the other photographs: %s\n", left_out.c_str());
  if (!held_out.empty()) {
    std::printf("error on the images excluded by --hold-out %d:\n", arguments.capture.hold_out);
    print_errors(held_out);
  } else if (arguments.capture.hold_out != 0) {
    std::printf(
        "a shard is not compared with photographs; after 'refield merge', 'refield compare' prints the "
        "error\n");
  }
}

void run(EstimateArguments arguments, const Common& common) {
  const Session session = open_estimation(arguments);
  if (!arguments.rows.empty())
    arguments.options.rows = rows_from_text(arguments.rows, session, arguments.options);
  if (arguments.dry_run) return dry_run(arguments, session, common);
  if (arguments.output.empty()) throw InputError("--output is missing; add -o NAME.rfield");
  const EstimateReport report =
      estimate_to_file(session, arguments.options, arguments.output, arguments.resume, run_context(),
                       [&](const EstimatePlan& plan) { announce(arguments, plan); });
  auto log = json_from_text(report.log);
  const auto held_out = held_out_of(arguments, session);
  if (!held_out.empty())
    log["held_out"] = {{"every", arguments.capture.hold_out}, {"errors", held_out_figures(held_out)}};
  write_json(arguments.output + ".log.json", log);
  if (common.json)
    print_json(log);
  else
    print(arguments, report, held_out);
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
  verb.add_option("--mode", arguments.mode,
                  "Mode: refined (a smooth component plus rectangular light regions), paper (Matusik et al. "
                  "2004: light regions only) or fast (as paper, with a faster search)")
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
                  "another run, as in 'rig' of OUTPUT.log.json")
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
    throw InputError("--memory is ", arguments.memory_gib, "; give a number of GiB above 0");
  arguments.options.memory_bytes = static_cast<std::uint64_t>(arguments.memory_gib * gib);
  arguments.options.keep_rig = arguments.options.keep_drift = arguments.rig == "off";
  if (arguments.rig != "off" && arguments.rig != "auto")
    arguments.options.rig = rig_model(std::filesystem::path(arguments.rig));
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
  on_command(*verb, arguments, common, action, run);
}

}  // namespace refield::cli
