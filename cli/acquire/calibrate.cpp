// SPDX-License-Identifier: Apache-2.0
#include "acquire/calibrate/calibrate.h"

#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "cli/acquire/calibration_page.h"
#include "cli/acquire/session_rig.h"
#include "cli/acquire/verbs.h"
#include "cli/acquire/virtual_request.h"
#include "core/errors.h"
#include "core/files.h"
#include "simulate/virtual_rig.h"

namespace refield::cli {

namespace {

using nlohmann::ordered_json;

struct CalibrateVerbOptions {
  fs::path session;
  fs::path recipe;
  fs::path truth;
  fs::path output;
  fs::path page;
  std::string target = "scene";
  fs::path flat_field;
  fs::path uniformity;
  double patience = 0.5;
  std::optional<double> gain;
  double tolerance = 0.01;
  int step = 5;
  bool trigger = false;
  bool force = false;
};

CalibrateOptions options_of(const CalibrateVerbOptions& given) {
  CalibrateOptions options;
  options.target = given.target == "card"     ? CalibrationTarget::card
                   : given.target == "screen" ? CalibrationTarget::screen
                                              : CalibrationTarget::scene;
  options.patience = Seconds(given.patience);
  options.gain = given.gain.value_or(1.0);
  options.superposition_tolerance = given.tolerance;
  options.tone_step = given.step;
  if (!given.flat_field.empty()) {
    options.flat_field = read_camera_calibration(given.flat_field).flat_field;
    if (options.flat_field.empty())
      throw InputError(given.flat_field.string() +
                       ": has no flat field; make one with 'refield acquire calibrate --target card'");
  }
  if (!given.uniformity.empty()) {
    options.uniformity = read_monitor_calibration(given.uniformity).uniformity;
    if (options.uniformity.empty())
      throw InputError(given.uniformity.string() +
                       ": has no uniformity; make one with 'refield acquire calibrate --target screen'");
  }
  options.check();
  return options;
}

ordered_json figures_of(const RigMeasurements& rig) {
  ordered_json pairs = ordered_json::array();
  for (const SuperpositionPair& pair : rig.superposition.pairs)
    pairs.push_back({{"patterns", pair.name},
                     {"error", pair.error},
                     {"uncertainty", pair.uncertainty},
                     {"worst_block", pair.worst_block}});
  ordered_json ripples = ordered_json::array();
  for (const Ripple& ripple : rig.banding.ripples)
    ripples.push_back({{"hz", ripple.hz}, {"depth", ripple.depth}});
  ordered_json figures = {{"display_latency_s", rig.timing.display_latency.count()},
                          {"display_settling_s", rig.timing.display_settling.count()},
                          {"control_latency_frames", rig.timing.control_latency_frames},
                          {"refresh_period_s", rig.timing.refresh_period.count()},
                          {"exposure_unit_s", rig.timing.exposure_unit.count()},
                          {"ripples", ripples},
                          {"black_level_dn", rig.camera.black_level_dn},
                          {"saturation_dn", rig.camera.saturation_dn},
                          {"saturation_seen", rig.response.saturation_seen},
                          {"linear", rig.response.is_linear},
                          {"response_residual", rig.response.residual},
                          {"electrons_per_dn", rig.camera.electrons_per_dn},
                          {"read_noise_electrons", rig.camera.read_noise_electrons},
                          {"full_well_electrons", rig.noise.full_well_electrons},
                          {"superposition_holds", rig.superposition.holds()},
                          {"superposition", pairs},
                          {"warnings", rig.warnings}};
  if (rig.flat_field) figures["darkest_corner"] = rig.flat_field->least;
  if (rig.screen) figures["darkest_of_screen"] = rig.screen->least;
  return figures;
}

void print(const RigMeasurements& rig, const CalibrateVerbOptions& given) {
  std::printf("%s: %s\n", given.output.c_str(), given.page.c_str());
  std::printf("display: light changes %.1f ms after a flip and stands still %.1f ms after it\n",
              1e3 * rig.timing.display_latency.count(),
              1e3 * (rig.timing.display_latency + rig.timing.display_settling).count());
  std::printf("camera: settings act after %d frames\n", rig.timing.control_latency_frames);
  if (rig.timing.exposure_unit.count() > 0.0)
    std::printf("exposures: whole multiples of %.4g ms\n", 1e3 * rig.timing.exposure_unit.count());
  else
    std::printf("exposures: any, the light does not pulse\n");
  std::printf("camera: black %.2f DN, saturation %.0f DN, %s\n", rig.camera.black_level_dn,
              rig.camera.saturation_dn, rig.response.is_linear ? "linear" : "bent (a table was written)");
  std::printf("camera: %.3g electrons a DN, read noise %.3g electrons, %.4g electrons at saturation\n",
              rig.camera.electrons_per_dn, rig.camera.read_noise_electrons, rig.noise.full_well_electrons);
  if (rig.flat_field)
    std::printf("lens: the darkest corner gets %.1f %% of the light\n", 100.0 * rig.flat_field->least);
  if (rig.screen)
    std::printf("screen: its darkest place has %.1f %% of the light\n", 100.0 * rig.screen->least);
  std::printf("superposition: largest error %.2f %%\n", 100.0 * rig.superposition.largest_error());
  for (const std::string& warning : rig.warnings) std::printf("warning: %s\n", warning.c_str());
}

void refuse_existing(const CalibrateVerbOptions& given) {
  for (const fs::path& path : {given.output, given.page})
    if (fs::exists(path) && !given.force)
      throw InputError(path.string() + ": exists; give --force to replace it, or another name");
}

RigMeasurements calibrate_devices(const SessionFile& session, CalibrateOptions options, bool gain_given) {
  if (!gain_given) options.gain = session.gain;
  SessionRig rig(session);
  return calibrate(rig.camera(), rig.monitor(), rig.trigger(), options);
}

RigMeasurements calibrate_virtual_rig(const CalibrateVerbOptions& given, const CalibrateOptions& options) {
  const Recipe recipe = read_recipe(given.recipe);
  TracedScene scene = scene_of(given.truth, recipe);
  VirtualRig rig(std::move(scene.transport), std::move(scene.ambient), recipe.rig.monitor, recipe.rig.sensor,
                 recipe.seed);
  return calibrate(rig.camera(), rig.illuminator(), given.trigger ? &rig.trigger() : nullptr, options);
}

void acquire_calibrate(CalibrateVerbOptions given, const Common& common) {
  std::optional<SessionFile> session;
  if (!given.session.empty()) session = read_session_file(given.session);
  if (session.has_value() != given.recipe.empty())
    throw InputError("give either a session file, which names the devices, or --virtual with a recipe");
  if (given.output.empty() && session) given.output = session->calibration;
  if (given.output.empty()) throw InputError("-o: no calibration file to write is given");
  if (given.page.empty()) given.page = fs::path(given.output).replace_extension(".html");
  refuse_existing(given);
  const CalibrateOptions options = options_of(given);
  const RigMeasurements measured = session ? calibrate_devices(*session, options, given.gain.has_value())
                                           : calibrate_virtual_rig(given, options);
  write_calibration(given.output, measured.camera, measured.monitor, measured.timing);
  write_text_atomically(given.page, calibration_page(measured));
  if (common.json)
    std::printf("%s\n", figures_of(measured).dump(2).c_str());
  else
    print(measured, given);
  if (!measured.superposition.holds())
    throw InputError(
        "display '" + measured.display_description.name +
        "': light does not add up, I(A) + I(B) − I(black) "
        "differs from I(A+B) by up to " +
        std::to_string(100.0 * measured.superposition.largest_error()) +
        " %: it dims itself. Turn off dynamic contrast, local dimming, power saving and automatic "
        "brightness, then calibrate again. " +
        given.page.string() + " shows more");
}

}  // namespace

void add_acquire_calibrate(CLI::App& group, const Common& common, Action& action) {
  const auto options = std::make_shared<CalibrateVerbOptions>();
  CLI::App* verb = group.add_subcommand(
      "calibrate",
      "Measure camera and display with the camera itself: display latency and settling, control latency, "
      "banding,\n"
      "response and black level, noise, tone curves, and whether light adds up. Writes a calibration file "
      "for\n"
      "'refield acquire' and a page (.html) that shows and explains each figure. Ends with exit status 2 "
      "when light\n"
      "does not add up (the display dims itself): no capture could be trusted then.\n\n"
      "Nothing in view may move or change but by the display; the room must be dark. docs/capture.md leads "
      "through "
      "it.\n\n"
      "Examples:\n"
      "  refield acquire calibrate session.toml                          devices that the session file "
      "names; writes\n"
      "                                                                  the calibration file that it names, "
      "too\n"
      "  refield acquire calibrate --virtual recipe.toml --truth truth -o calibration.toml\n"
      "  refield acquire calibrate … --target card -o lens.toml          vignetting: plain white card, out "
      "of focus\n"
      "  refield acquire calibrate … --target screen --flat-field lens.toml -o rig.toml\n"
      "                                                                  uniformity: the camera sees the "
      "whole display");
  CLI::Option* session = verb->add_option("session", options->session,
                                          "Session file (.toml) of 'refield acquire run', for its devices");
  verb->add_option("--virtual", options->recipe, "Instead: recipe (.toml) of a virtual rig")
      ->excludes(session);
  verb->add_option(
      "--truth", options->truth,
      "With --virtual: folder that 'refield simulate' made from the recipe (default: traced first)");
  verb->add_option("-o,--output", options->output,
                   "Calibration file to write (.toml; default: the one that the session file names)");
  verb->add_option("--page", options->page, "Page to write (default: the same name, .html)");
  verb->add_option(
          "--target", options->target,
          "What the camera looks at: scene (anything), card (plain and evenly lit: measures vignetting), or\n"
          "screen (the whole display: measures its uniformity)")
      ->check(CLI::IsMember({"scene", "card", "screen"}))
      ->capture_default_str();
  verb->add_option("--flat-field", options->flat_field,
                   "Calibration file whose flat field (vignetting) to keep");
  verb->add_option("--uniformity", options->uniformity,
                   "Calibration file whose uniformity of the screen to keep");
  verb->add_option("--patience", options->patience, "Seconds after which the display has surely settled")
      ->capture_default_str();
  verb->add_option("--gain", options->gain, "Of the camera, for all measurements (session file, else 1)");
  verb->add_option("--tolerance", options->tolerance, "Of superposition, relative")->capture_default_str();
  verb->add_option("--levels-apart", options->step, "Of the tone curves: 1, 3, 5, 15, 17, 51 or 85")
      ->capture_default_str();
  verb->add_flag("--trigger", options->trigger,
                 "With --virtual: start each exposure through the trigger line");
  verb->add_flag("--force", options->force, "Replace the output files");
  verb->callback(
      [options, &common, &action] { action = [options, &common] { acquire_calibrate(*options, common); }; });
}

}  // namespace refield::cli
