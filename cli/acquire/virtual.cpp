// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "cli/acquire/capture_report.h"
#include "cli/acquire/until_error.h"
#include "cli/acquire/virtual_request.h"
#include "cli/run_context.h"
#include "cli/verbs.h"
#include "core/base/errors.h"
#include "core/base/output_lock.h"
#include "simulate/rig/virtual_rig.h"

namespace refield::cli {

namespace {

/// What stands before the virtual camera must be known before anything is written.
void require_scene(const VirtualOptions& options) {
  const std::string remedy =
      "make it with 'refield simulate " + options.recipe.string() + " -o TRUTH' and give --truth TRUTH";
  if (options.truth.empty() && options.lights.empty())
    throw InputError("neither --truth nor --lights is given; " + remedy);
  if (!options.truth.empty() && !fs::is_regular_file(options.truth / transport_file_name))
    throw InputError((options.truth / transport_file_name).string() +
                     ": the scene's light transport is missing; " + remedy);
}

void acquire_virtual(const VirtualOptions& options, const Common& common) {
  const Recipe recipe = read_recipe(options.recipe);
  require_scene(options);
  const std::uint64_t seed = options.seed.value_or(recipe.seed);
  check_session_folder(options.session, options.if_exists);
  const OutputLock lock(options.session, {});
  if (options.if_exists == IfExists::replace)
    require_outside(options.session, {options.lights, options.truth, options.calibration, options.mask,
                                      options.background, options.reference_light});
  CaptureRequest request = request_of(options, recipe, seed);
  std::optional<UntilError> until;
  if (!options.until_error.empty()) {
    until.emplace(error_from_text(options.until_error), options.min_images, options.check_every);
    until->attach(request);
  }
  VirtualRig rig = rig_of(options.truth, recipe, seed);
  request.before_light = place_teller(rig, request.lights);
  const CaptureSummary summary = capture(request, rig.camera(), rig.illuminator(),
                                         options.trigger ? &rig.trigger() : nullptr, run_context());
  report_capture(summary, options.session, until ? &*until : nullptr, common);
}

}  // namespace

void add_acquire_virtual(CLI::App& group, const Common& common, Action& action) {
  const auto options = std::make_shared<VirtualOptions>();
  CLI::App* verb =
      group.add_subcommand("virtual",
                           "Capture a session of a synthetic scene with a simulated camera.\n"
                           "\n"
                           "The recipe describes the camera and the monitor; --truth contains the light "
                           "transport that 'refield simulate RECIPE.toml -o TRUTH' traced.\n"
                           "\n"
                           "Example:\n"
                           "  refield acquire virtual recipe.toml --truth truth -o session --auto-mask");
  verb->add_option("recipe", options->recipe,
                   "Recipe (.toml) with the sections [sensor], [monitor] and [exposures]")
      ->required();
  verb->add_option("--truth", options->truth,
                   "Folder that 'refield simulate' created from the recipe; without it the scene is traced "
                   "first and --lights is required");
  verb->add_option("-o,--output", options->session, "Session folder to create")->required();
  verb->add_option("--lights", options->lights,
                   "Light maps to show, a quoted pattern or a folder: linear radiance above the black level "
                   "of the monitor (default: the light maps of --truth, with their roles and kinds)");
  verb->add_option("--calibration", options->calibration,
                   "Calibration file of 'refield acquire calibrate --virtual' (default: the values of the "
                   "recipe, without error)");
  CLI::Option* times =
      verb->add_option(
              "--exposures", options->exposures,
              "Exposure times in seconds, increasing, separated by commas (default: metered under white)")
          ->delimiter(',');
  verb->add_option("--exposure-count", options->exposure_count,
                   "Number of exposures per photograph (default: from the recipe, else 4)")
      ->excludes(times);
  verb->add_option("--exposure-ratio", options->exposure_ratio,
                   "Ratio of consecutive exposure times (default: from the recipe, else 4)")
      ->excludes(times);
  verb->add_option("--noise", options->noise,
                   "Meter the scene and take the smallest number of exposures that keeps the noise per "
                   "sample below this fraction of its radiance, such as 2%")
      ->excludes(times);
  verb->add_option("--frames", options->frames,
                   "Number of averaged frames per exposure (default: from the recipe, else 1)");
  verb->add_option(
          "--ambient-frames", options->ambient_frames,
          "Number of averaged frames per exposure of the ambient photograph, whose noise affects all others "
          "(default: an eighth of the training images, 4 to 64)")
      ->check(CLI::Range(0, 64));
  CLI::Option* mask =
      verb->add_option("--mask", options->mask, "Mask image, white where the scene is (default: all pixels)");
  CLI::Option* automatic =
      verb->add_flag("--auto-mask", options->auto_mask, "Mask the pixels that respond to a white monitor")
          ->excludes(mask);
  verb->add_option("--background", options->background,
                   "Photograph (.exr) under white without the objects, with --auto-mask; pixels that differ "
                   "from it belong to the scene")
      ->needs(automatic);
  verb->add_option("--order", options->order,
                   "Order of the training lights: given, random, or useful (most informative first, for "
                   "captures that may end early)")
      ->capture_default_str();
  CLI::Option* until = verb->add_option(
      "--until-error", options->until_error,
      "Stop taking training photographs when the predicted median error on new photographs falls to this "
      "value, such as 2%; a sample of the pixels is estimated during the capture");
  verb->add_option("--min-images", options->min_images,
                   "Number of images before the first error prediction of --until-error")
      ->capture_default_str()
      ->needs(until);
  verb->add_option("--check-every", options->check_every,
                   "Number of images between two error predictions of --until-error")
      ->capture_default_str()
      ->needs(until);
  verb->add_option(
      "--reference-every", options->reference_every,
      "Number of lights between two frames of the reference light, from which 'refield estimate' measures "
      "the drift of monitor and camera; 0: none (default: from the recipe, else 0)");
  verb->add_option("--reference-light", options->reference_light,
                   "Reference light map (default: the white light map, else the first)");
  verb->add_option("--seed", options->seed, "Seed of the simulated camera noise (default: from the recipe)");
  verb->add_flag("--trigger", options->trigger, "Start each exposure with the trigger line");
  verb->add_flag("--keep-raw", options->keep_raw, "Store every exposure as a 16-bit PNG in raw/");
  verb->add_flag("--half", options->half,
                 "Write 16-bit half-float photographs: half the size, relative rounding error 0.05 %");
  add_if_exists(*verb, options->if_exists, "a capture");
  verb->callback(
      [options, &common, &action] { action = [options, &common] { acquire_virtual(*options, common); }; });
}

}  // namespace refield::cli
