// SPDX-License-Identifier: Apache-2.0
#include "estimate/estimate.h"

#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "cli/verbs.h"
#include "core/errors.h"
#include "core/files.h"

namespace refield::cli {

namespace {

struct EstimateArguments {
  std::string session;
  std::string light_glob;
  std::string observed_glob;
  std::string parameterisation = "monitor";
  std::string mask;
  std::string mode = "refined";
  std::string output;
  double memory_gib = 4.0;
  bool resume = false;
  EstimateOptions options;
};

CaptureSession open_capture(const EstimateArguments& arguments) {
  const bool by_globs = !arguments.light_glob.empty() || !arguments.observed_glob.empty();
  if (by_globs == !arguments.session.empty())
    throw InputError("give either a SESSION folder, or both --light and --observed");
  if (by_globs && (arguments.light_glob.empty() || arguments.observed_glob.empty()))
    throw InputError(
        "--light and --observed go together: one pattern for the light maps, one for the photographs");
  CaptureSession session = by_globs ? pair_by_globs(arguments.light_glob, arguments.observed_glob,
                                                    parameterisation_from_name(arguments.parameterisation))
                                    : read_capture_session(arguments.session);
  if (!arguments.mask.empty()) session.mask = arguments.mask;
  return session;
}

nlohmann::ordered_json log_of(const EstimateArguments& arguments, const EstimateSummary& summary) {
  return {{"stage", "estimate"},
          {"field", arguments.output},
          {"mode", arguments.mode},
          {"kernels", arguments.options.kernels},
          {"images", summary.plan.images},
          {"bands", summary.plan.bands},
          {"resumed_bands", summary.resumed_bands},
          {"seconds", summary.seconds},
          {"foreseen_memory_bytes", summary.plan.memory_bytes},
          {"peak_memory_bytes", summary.peak_memory_bytes},
          {"mean_kernels", summary.mean_kernels},
          {"median_training_error", summary.median_training_error}};
}

void run(EstimateArguments arguments, const Common& common) {
  constexpr double gib = 1024.0 * 1024.0 * 1024.0;
  arguments.options.mode = estimate_mode_from_name(arguments.mode);
  if (!(arguments.memory_gib > 0.0 && arguments.memory_gib < 1e6))
    throw InputError("--memory is " + std::to_string(arguments.memory_gib) +
                     "; give a number of GiB above 0");
  arguments.options.memory_bytes = static_cast<std::uint64_t>(arguments.memory_gib * gib);
  const CaptureSession session = open_capture(arguments);
  const EstimatePlan plan = plan_estimate(session, arguments.options);
  if (!common.quiet)
    std::fprintf(stderr, "%d images, %d bands of %d rows, foresees %.1f GiB of the %.1f allowed\n",
                 plan.images, plan.bands, plan.band_rows, plan.memory_bytes / gib, arguments.memory_gib);
  const EstimateSummary summary =
      estimate_to_file(session, arguments.options, arguments.output, arguments.resume);
  const auto log = log_of(arguments, summary);
  write_text_atomically(arguments.output + ".log.json", log.dump(2) + "\n");
  if (common.json)
    std::printf("%s\n", log.dump(2).c_str());
  else
    std::printf("%s: %.1f kernels a pixel, training error %.4f (median), %.1f s, %.2f GiB\n",
                arguments.output.c_str(), summary.mean_kernels, summary.median_training_error,
                summary.seconds, summary.peak_memory_bytes / gib);
}

}  // namespace

void add_estimate(CLI::App& app, const Common& common, Action& action) {
  auto arguments = std::make_shared<EstimateArguments>();
  CLI::App* verb =
      app.add_subcommand("estimate", "Estimate a reflectance field from photographs under known light");
  verb->footer(
      "Examples:\n"
      "  refield estimate session -o scene.rfield\n"
      "  refield estimate --light 'light/train_*.exr' --observed 'observed/train_*.exr' -o scene.rfield\n"
      "Light maps and photographs pair up by what the wildcards stand for. Both are scene-linear OpenEXR.\n"
      "An interrupted estimation goes on with --resume; finished rows wait in OUTPUT.partial.");
  verb->add_option("session", arguments->session,
                   "Capture session folder, as refield acquire or simulate makes it");
  verb->add_option("--light", arguments->light_glob,
                   "Light maps of another capture: pattern in quotes, or folder");
  verb->add_option("--observed", arguments->observed_glob,
                   "Photographs of another capture: pattern, or folder");
  verb->add_option("--parameterisation", arguments->parameterisation,
                   "Of the light maps: monitor, lat_long or cube")
      ->capture_default_str();
  verb->add_option("--mask", arguments->mask,
                   "Image that is bright where the scene is; other pixels stay empty");
  verb->add_option("-o,--output", arguments->output, "Reflectance field to write (.rfield)")->required();
  verb->add_option("--mode", arguments->mode,
                   "refined: splits at thirds and halves; paper: even splits as published in 2004")
      ->capture_default_str();
  verb->add_option("--kernels", arguments->options.kernels, "Most kernels a pixel may have")
      ->capture_default_str();
  verb->add_option("--spatial-passes", arguments->options.spatial_passes,
                   "Sweeps in which pixels try their neighbours' kernels")
      ->capture_default_str();
  verb->add_option("--clip", arguments->options.clip_level,
                   "Leave out samples of at least this radiance (clipped by the camera)");
  verb->add_option("--memory", arguments->memory_gib, "Limit in GiB; rows are worked on in bands that fit")
      ->capture_default_str();
  verb->add_option("--threads", arguments->options.threads,
                   "0: all cores; the result is the same for any number")
      ->capture_default_str();
  verb->add_flag("--resume", arguments->resume, "Take over the finished rows of an interrupted estimation");
  verb->callback(
      [arguments, &common, &action] { action = [arguments, &common] { run(*arguments, common); }; });
}

}  // namespace refield::cli
