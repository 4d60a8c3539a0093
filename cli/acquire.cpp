// SPDX-License-Identifier: Apache-2.0
#include "acquire/capture.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "cli/acquire_progress.h"
#include "cli/report/run_log.h"
#include "cli/verbs.h"
#include "core/errors.h"
#include "core/files.h"
#include "core/reflectance_field_file.h"
#include "simulate/recipe.h"
#include "simulate/simulate.h"
#include "simulate/virtual_rig.h"

namespace refield::cli {

namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

struct AcquireOptions {
  fs::path recipe;
  fs::path truth;
  fs::path session;
  std::string lights;
  std::vector<double> exposures;
  std::optional<int> exposure_count;
  std::optional<double> exposure_ratio;
  std::optional<int> frames;
  int ambient_frames = 4;
  fs::path mask;
  bool auto_mask = false;
  fs::path background;
  std::optional<std::uint64_t> seed;
  std::string order = "given";
  std::string until_error;
  int min_images = 30;
  int check_every = 10;
  std::optional<int> reference_every;
  fs::path reference_light;
  bool trigger = false;
  bool keep_raw = false;
  bool half = false;
  bool resume = false;
  bool force = false;
};

/// What a calibration of the virtual camera would find out.
CameraCalibration calibration_of(const SensorModel& sensor, double gain) {
  CameraCalibration camera;
  camera.bits = sensor.bits;
  camera.linear_from_dn = sensor.response_gamma == 1.0 ? linear_response(sensor.bits)
                                                       : gamma_response(sensor.bits, sensor.response_gamma);
  camera.black_level_dn = sensor.black_level_dn;
  const double full = sensor.full_scale();
  const double full_well_dn =
      sensor.black_level_dn + gain * sensor.full_well_electrons / sensor.electrons_per_dn;
  camera.saturation_dn =
      std::round(full * std::pow(std::min(full_well_dn / full, 1.0), 1.0 / sensor.response_gamma));
  camera.electrons_per_dn = sensor.electrons_per_dn;
  camera.read_noise_electrons = sensor.read_noise_electrons;
  camera.electrons_per_radiance_second = sensor.sensitivity;
  return camera;
}

MonitorCalibration calibration_of(const MonitorModel& model) {
  MonitorCalibration monitor;
  const auto curve = model.tone_curve();
  for (int c = 0; c < 3; ++c) monitor.radiance_from_level[c].assign(curve[c].begin(), curve[c].end());
  return monitor;
}

std::vector<CaptureLight> lights_of(const AcquireOptions& options) {
  std::vector<CaptureLight> lights;
  if (!options.lights.empty()) {
    for (const GlobMatch& match : expand_glob(options.lights))
      lights.push_back({match.path.stem().string(), FrameRole::train, "", match.path});
    return lights;
  }
  for (const CaptureFrame& frame : read_capture_session(options.truth).frames)
    lights.push_back({frame.name, frame.role, frame.kind, frame.illumination});
  return lights;
}

/// Puts frames of one light, to tell drift by, first, last, and after every so many lights.
std::vector<CaptureLight> with_references(const std::vector<CaptureLight>& lights, int every,
                                          fs::path reference) {
  if (every <= 0 || lights.empty()) return lights;
  if (reference.empty()) {
    const auto white = std::ranges::find(lights, "white", &CaptureLight::kind);
    reference = (white != lights.end() ? *white : lights.front()).wanted;
  }
  std::vector<CaptureLight> result;
  int count = 0;
  const auto add_reference = [&] {
    char name[32];
    std::snprintf(name, sizeof name, "reference_%03d", count++);
    result.push_back({name, FrameRole::reference, "reference", reference});
  };
  for (std::size_t i = 0; i < lights.size(); ++i) {
    if (i % static_cast<std::size_t>(every) == 0) add_reference();
    result.push_back(lights[i]);
  }
  add_reference();
  return result;
}

std::string checksum_text(const fs::path& file) {
  char text[9];
  std::snprintf(text, sizeof text, "%08x", inspect_file(fs::path(), file.string()).crc32);
  return text;
}

/// The plan names devices by what decides their frames.
std::string rig_text(const AcquireOptions& options, const Recipe& recipe, std::uint64_t seed) {
  std::string text = "virtual rig: recipe " + checksum_text(recipe.path);
  if (options.truth.empty()) {
    text += ", traced";
  } else {
    text += ", transport " + checksum_text(options.truth / transport_file_name);
    const fs::path ambient = options.truth / ambient_file_name;
    text += ", ambient " + (fs::exists(ambient) ? checksum_text(ambient) : std::string("none"));
  }
  text += ", seed " + std::to_string(seed);
  return text + (options.trigger ? ", triggered" : "");
}

void fill_exposures(const AcquireOptions& options, const Recipe& recipe, CaptureRequest& request) {
  const ExposureSeries& series = recipe.rig.exposures;
  for (double seconds : options.exposures) request.exposures.emplace_back(seconds);
  request.exposure_plan.count = options.exposure_count.value_or(series.count);
  request.exposure_plan.ratio = options.exposure_ratio.value_or(series.ratio);
  request.frames_per_exposure = options.frames.value_or(series.frames);
  if (series.longest)
    request.exposure_plan.shortest =
        *series.longest * std::pow(request.exposure_plan.ratio, 1 - request.exposure_plan.count);
}

CaptureRequest request_of(const AcquireOptions& options, const Recipe& recipe, std::uint64_t seed) {
  CaptureRequest request;
  request.folder = options.session;
  const int every = options.reference_every.value_or(recipe.rig.reference_every);
  if (every < 0)
    throw InputError("--reference-every is " + std::to_string(every) + "; give 0 (none) or more");
  auto lights = lights_of(options);
  order_lights(lights, options.order, seed);
  request.lights = with_references(lights, every, options.reference_light);
  request.camera = calibration_of(recipe.rig.sensor, request.gain);
  request.monitor = calibration_of(recipe.rig.monitor);
  request.rig = rig_text(options, recipe, seed);
  fill_exposures(options, recipe, request);
  request.ambient_repeats = options.ambient_frames;
  if (!options.mask.empty()) request.mask = {MaskSource::Kind::painted, options.mask};
  if (options.auto_mask) request.mask = {MaskSource::Kind::automatic, options.background};
  request.keep_raw = options.keep_raw;
  request.precision = options.half ? Precision::half : Precision::single;
  if (options.resume) request.if_exists = IfExists::resume;
  if (options.force) request.if_exists = IfExists::replace;
  return request;
}

ordered_json figures_of(const CaptureSummary& summary, const UntilError* until) {
  ordered_json exposures = ordered_json::array();
  for (std::size_t i = 0; i < summary.exposures.size(); ++i) {
    exposures.push_back({{"seconds", summary.exposures[i].count()}});
    if (!summary.useful_fraction.empty()) exposures.back()["useful_fraction"] = summary.useful_fraction[i];
  }
  ordered_json figures = {{"lights", summary.lights},
                          {"left_out", summary.left_out},
                          {"taken_over", summary.found_done},
                          {"damaged_and_repeated", summary.found_damaged},
                          {"exposures", exposures},
                          {"clipped_fraction", summary.clipped_fraction},
                          {"lights_brighter_than_monitor", summary.out_of_range_lights},
                          {"frames_discarded_early", summary.discarded.early},
                          {"frames_discarded_stale", summary.discarded.stale},
                          {"frames_lost", summary.discarded.lost},
                          {"seconds", summary.seconds}};
  if (until && until->last().images > 0)
    figures["until_error"] = {{"asked", until->asked()},
                              {"reached", until->reached()},
                              {"predicted", until->last().predicted},
                              {"photograph_noise", until->last().noise},
                              {"images", until->last().images},
                              {"images_that_would_do", until->images_for()}};
  return figures;
}

void print(const UntilError& until, const CaptureSummary& summary) {
  if (until.last().images == 0) return;
  std::printf("predicted error %.2f %% after %d images, asked were %.2f %%: ", 100.0 * until.last().predicted,
              until.last().images, 100.0 * until.asked());
  if (until.reached())
    std::printf("reached, %zu lights left out\n", summary.left_out);
  else if (until.last().noise > until.asked())
    std::printf("cannot be reached, the photographs' own noise is %.2f %%; take more frames an exposure\n",
                100.0 * until.last().noise);
  else if (const int needed = until.images_for(); needed > 0)
    std::printf("not reached, about %d images would do\n", needed);
  else
    std::printf("not reached, and more images of this kind would hardly reach it\n");
}

void print(const CaptureSummary& summary, const fs::path& session) {
  if (summary.useful_fraction.empty()) {
    std::printf("%s: already complete, %zu photographs\n", session.c_str(), summary.lights);
    return;
  }
  std::printf("%s: %zu photographs", session.c_str(), summary.lights);
  if (summary.found_done > 0) std::printf(", %zu steps from an earlier run", summary.found_done);
  if (summary.found_damaged > 0) std::printf(", %zu damaged ones repeated", summary.found_damaged);
  std::printf("\nexposures:");
  for (std::size_t i = 0; i < summary.exposures.size(); ++i)
    std::printf(" %.4g s (useful for %.1f %% of the samples)%s", summary.exposures[i].count(),
                100.0 * summary.useful_fraction[i], i + 1 < summary.exposures.size() ? "," : "\n");
  std::printf("clipped in every exposure: %.3f %% of the samples\n", 100.0 * summary.clipped_fraction);
  std::printf("discarded frames: %llu early, %llu with old settings; lost: %llu\n",
              static_cast<unsigned long long>(summary.discarded.early),
              static_cast<unsigned long long>(summary.discarded.stale),
              static_cast<unsigned long long>(summary.discarded.lost));
  if (summary.out_of_range_lights > 0)
    std::printf("%zu lights are brighter in places than the monitor; what it emitted is on record\n",
                summary.out_of_range_lights);
  for (const std::string& sentence : wasted_exposures(summary.exposures, summary.useful_fraction))
    std::printf("note: %s\n", sentence.c_str());
}

/// What stands before the virtual camera must be known before anything is written.
void require_scene(const AcquireOptions& options) {
  const std::string remedy =
      "make it with 'refield simulate " + options.recipe.string() + " -o TRUTH' and give --truth TRUTH";
  if (options.truth.empty() && options.lights.empty())
    throw InputError("--truth: neither the scene's light transport nor lights are given; " + remedy);
  if (!options.truth.empty() && !fs::is_regular_file(options.truth / transport_file_name))
    throw InputError((options.truth / transport_file_name).string() +
                     ": the scene's light transport is missing; " + remedy);
}

/// The transport that 'refield simulate' kept or, without it, traced now.
TracedScene scene_of(const AcquireOptions& options, const Recipe& recipe) {
  constexpr int balanced_quality = 2;
  if (options.truth.empty())
    return trace_scene(recipe.scene, TraceOptions::of_quality(balanced_quality, recipe.seed));
  const fs::path ambient = options.truth / ambient_file_name;
  return {read_reflectance_field(options.truth / transport_file_name),
          fs::exists(ambient) ? read_image(ambient) : Image()};
}

void acquire(const AcquireOptions& options, const Common& common) {
  const Recipe recipe = read_recipe(options.recipe);
  require_scene(options);
  const std::uint64_t seed = options.seed.value_or(recipe.seed);
  check_session_folder(options.session, options.force    ? IfExists::replace
                                        : options.resume ? IfExists::resume
                                                         : IfExists::refuse);
  CaptureRequest request = request_of(options, recipe, seed);
  std::optional<UntilError> until;
  if (!options.until_error.empty()) {
    until.emplace(error_from_text(options.until_error), options.min_images, options.check_every);
    until->attach(request);
  }
  TracedScene scene = scene_of(options, recipe);
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
  // A capture that was already complete keeps the log of the run that made it.
  if (!summary.useful_fraction.empty())
    report::write_run_log(options.session, "acquire", summary.seconds,
                          {{"lights", summary.lights},
                           {"taken_over", summary.found_done},
                           {"exposures", summary.exposures.size()},
                           {"clipped_fraction", summary.clipped_fraction},
                           {"frames_discarded_early", summary.discarded.early},
                           {"frames_discarded_stale", summary.discarded.stale},
                           {"frames_lost", summary.discarded.lost}});
  if (common.json)
    std::printf("%s\n", figures_of(summary, until ? &*until : nullptr).dump(2).c_str());
  else
    print(summary, options.session);
  if (until && !common.json) print(*until, summary);
}

}  // namespace

void add_acquire(CLI::App& app, const Common& common, Action& action) {
  const auto options = std::make_shared<AcquireOptions>();
  CLI::App* verb = app.add_subcommand(
      "acquire",
      "Photograph a scene under many lights: HDR, ambient light subtracted, into a capture session.\n"
      "Devices and scene are virtual: the recipe describes camera and monitor, --truth holds the light "
      "transport\n"
      "that 'refield simulate RECIPE.toml -o TRUTH' traced.\n\n"
      "Killed or interrupted at any moment, the same command with --resume goes on, and the session ends in "
      "the\n"
      "same bytes. docs/capture-session-format.md describes the folder.\n\n"
      "Example:\n"
      "  refield acquire recipe.toml --truth truth -o session --auto-mask");
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
  CLI::Option* times = verb->add_option("--exposures", options->exposures,
                                        "Exposure times in seconds, growing, separated by commas")
                           ->delimiter(',');
  verb->add_option("--exposure-count", options->exposure_count, "Exposures of a photograph (recipe, else 4)")
      ->excludes(times);
  verb->add_option("--exposure-ratio", options->exposure_ratio, "Of each to the one before (recipe, else 4)")
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
  CLI::Option* resume = verb->add_flag("--resume", options->resume, "Go on with a capture that was stopped");
  verb->add_flag("--force", options->force, "Replace a capture in the output folder")->excludes(resume);
  verb->callback([options, &common, &action] { action = [options, &common] { acquire(*options, common); }; });
}

}  // namespace refield::cli
