// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "cli/acquire/capture_report.h"
#include "cli/acquire/if_exists.h"
#include "cli/acquire/until_error.h"
#include "cli/acquire/verbs.h"
#include "cli/acquire/virtual_request.h"
#include "core/errors.h"
#include "core/output_lock.h"
#include "simulate/virtual_rig.h"

namespace refield::cli {

namespace {

/// What stands before the virtual camera must be known before anything is written.
void require_scene(const VirtualOptions& options) {
  const std::string remedy =
      "make it with 'refield simulate " + options.recipe.string() + " -o TRUTH' and give --truth TRUTH";
  if (options.truth.empty() && options.lights.empty())
    throw InputError("--truth: neither the scene's light transport nor lights are given; " + remedy);
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
  TracedScene scene = scene_of(options.truth, recipe);
  VirtualRig rig(std::move(scene.transport), std::move(scene.ambient), recipe.rig.monitor, recipe.rig.sensor,
                 seed);
  std::uint32_t references = 0;
  std::vector<std::uint32_t> repetition;
  for (const CaptureLight& light : request.lights)
    repetition.push_back(light.role == FrameRole::reference ? ++references : 0);
  request.before_light = [&](std::size_t i) {
    const double last = std::max<double>(1.0, static_cast<double>(request.lights.size()) - 1.0);
    rig.set_place(static_cast<double>(i) / last, repetition[i]);
  };
  const CaptureSummary summary =
      capture(request, rig.camera(), rig.illuminator(), options.trigger ? &rig.trigger() : nullptr);
  report_capture(summary, options.session, until ? &*until : nullptr, common);
}

}  // namespace

void add_acquire_virtual(CLI::App& group, const Common& common, Action& action) {
  const auto options = std::make_shared<VirtualOptions>();
  CLI::App* verb =
      group.add_subcommand("virtual",
                           "Photograph a synthetic scene by a virtual camera and monitor, which the recipe "
                           "describes; --truth holds "
                           "the\n"
                           "light transport that 'refield simulate RECIPE.toml -o TRUTH' traced.\n\n"
                           "Example:\n"
                           "  refield acquire virtual recipe.toml --truth truth -o session --auto-mask");
  verb->add_option("recipe", options->recipe, "Recipe (.toml) of the rig: [sensor], [monitor], [exposures]")
      ->required();
  verb->add_option("--truth", options->truth,
                   "Folder that 'refield simulate' made from the recipe.\n"
                   "Without it the scene is traced first, and --lights says what to show");
  verb->add_option("-o,--output", options->session, "Session folder to make")->required();
  verb->add_option(
      "--lights", options->lights,
      "Light maps to show, a quoted pattern or folder: linear radiance above the monitor's black.\n"
      "Default: the lights of the truth, with their roles and kinds");
  verb->add_option("--calibration", options->calibration,
                   "What 'refield acquire calibrate --virtual' measured; default: what the recipe says");
  CLI::Option* times = verb->add_option("--exposures", options->exposures,
                                        "Exposure times in seconds, growing, separated by commas")
                           ->delimiter(',');
  verb->add_option("--exposure-count", options->exposure_count, "Exposures of a photograph (recipe, else 4)")
      ->excludes(times);
  verb->add_option("--exposure-ratio", options->exposure_ratio, "Of each to the one before (recipe, else 4)")
      ->excludes(times);
  verb->add_option(
          "--noise", options->noise,
          "Instead: meter the scene and take as few exposures as keep the noise of a sample below this "
          "share of\nits radiance, such as 2%")
      ->excludes(times);
  verb->add_option("--frames", options->frames, "Frames taken with each exposure (recipe, else 1)");
  verb->add_option("--ambient-frames", options->ambient_frames,
                   "The same for the ambient photograph, whose noise enters all others")
      ->capture_default_str();
  CLI::Option* mask = verb->add_option("--mask", options->mask, "Painted mask, white where the scene is");
  CLI::Option* automatic =
      verb->add_flag("--auto-mask", options->auto_mask, "Mask the pixels that respond to the monitor's white")
          ->excludes(mask);
  verb->add_option("--background", options->background,
                   "With --auto-mask: photograph (.exr) under white without the objects; mask what differs")
      ->needs(automatic);
  verb->add_option("--order", options->order,
                   "Of the training lights: given, random, or useful: the next is the one that tells most "
                   "beside\nthose before it, so that a capture cut short has the best lights")
      ->capture_default_str();
  CLI::Option* until = verb->add_option(
      "--until-error", options->until_error,
      "Stop taking training photographs when the error predicted for the middle pixel on new photographs\n"
      "falls to this, such as 2%: a sample of pixels is estimated as the capture goes on");
  verb->add_option("--min-images", options->min_images, "With --until-error: look from so many images on")
      ->capture_default_str()
      ->needs(until);
  verb->add_option("--check-every", options->check_every, "With --until-error: look again after so many")
      ->capture_default_str()
      ->needs(until);
  verb->add_option("--reference-every", options->reference_every,
                   "Take a frame of a reference light first, last and after every N lights, from which\n"
                   "estimation tells the drift of monitor and camera (recipe, else 0: none)");
  verb->add_option("--reference-light", options->reference_light,
                   "That light (default: the white one among the lights, else the first)");
  verb->add_option("--seed", options->seed, "Of the virtual camera's noise (default: the recipe's)");
  verb->add_flag("--trigger", options->trigger, "Start each exposure through the trigger line");
  verb->add_flag("--keep-raw", options->keep_raw, "Keep every exposure as a 16-bit PNG in raw/");
  verb->add_flag("--half", options->half, "Half-float photographs: half the size, rounding of 0.05 %");
  add_if_exists(*verb, options->if_exists, "a capture");
  verb->callback(
      [options, &common, &action] { action = [options, &common] { acquire_virtual(*options, common); }; });
}

}  // namespace refield::cli
