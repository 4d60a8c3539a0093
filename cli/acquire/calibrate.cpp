// SPDX-License-Identifier: Apache-2.0
#include "acquire/calibrate/calibrate.h"

#include <cstdio>

#include "cli/acquire/session_rig.h"
#include "cli/common/options.h"
#include "cli/report/page.h"
#include "cli/run_context.h"
#include "cli/verbs.h"
#include "core/base/files.h"
#include "core/base/json.h"
#include "core/base/output_lock.h"

namespace refield::cli {

namespace {

struct CalibrateVerbOptions {
  fs::path rig;  ///< rig file or recipe
  fs::path truth;
  fs::path output;
  fs::path page;  ///< beside it
  std::string target = "scene";
  std::vector<fs::path> copy_from;
  double patience = 0.5;
  int step = 5;
};

CalibrateOptions options_of(const CalibrateVerbOptions& given) {
  CalibrateOptions options;
  options.target = given.target == "card"     ? CalibrationTarget::card
                   : given.target == "screen" ? CalibrationTarget::screen
                                              : CalibrationTarget::scene;
  options.patience = Seconds(given.patience);
  options.tone_step = given.step;
  for (const fs::path& file : given.copy_from) {
    const RelativeMap flat_field = read_camera_calibration(file).flat_field,
                      uniformity = read_monitor_calibration(file).uniformity;
    if (flat_field.empty() && uniformity.empty())
      throw InputError(file,
                       ": has no flat field and no uniformity; make one with 'refield acquire calibrate "
                       "--target card' or '--target screen'");
    if (!flat_field.empty()) options.flat_field = flat_field;
    if (!uniformity.empty()) options.uniformity = uniformity;
  }
  options.check();
  return options;
}

Json figures_of(const RigMeasurements& rig) {
  Json pairs = Json::array();
  for (const SuperpositionPair& pair : rig.superposition.pairs)
    pairs.push_back({{"patterns", pair.name},
                     {"error", pair.error},
                     {"uncertainty", pair.uncertainty},
                     {"worst_block", pair.worst_block}});
  Json ripples = Json::array();
  for (const Ripple& ripple : rig.banding.ripples)
    ripples.push_back({{"hz", ripple.hz}, {"depth", ripple.depth}});
  Json figures = {{"display_latency_s", rig.timing.display_latency.count()},
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

/// The inverse response at 100 steps of the range: light as a fraction of saturation.
Json response_table(const CameraResponse& response, double range_dn) {
  Json table;
  const double black = response.black_level_dn;
  for (int i = 0; i <= 100; ++i) {
    const double dn = black + (response.saturation_dn - black) * i / 100.0;
    table.push_back({dn, (response.linear_from_dn[static_cast<std::size_t>(dn)] - black) / range_dn});
  }
  return table;
}

Json tone_curves(const ToneCurve& curve) {
  Json channels;
  for (int c = 0; c < 3; ++c) {
    Json table;
    for (int level = 0; level < 256; level += 3) table.push_back({level, curve.light_from_level[c][level]});
    channels.push_back(
        {{"name", std::array{"red", "green", "blue"}[c]}, {"table", table}, {"measured", curve.measured[c]}});
  }
  return channels;
}

/// (middle of the exposure in seconds, fraction of the new light).
Json changes_json(const std::vector<ChangeFrame>& frames) {
  Json changes = Json::array();
  for (const ChangeFrame& frame : frames)
    changes.push_back({frame.start_s + frame.exposure_s / 2.0, frame.share});
  return changes;
}

Json map_json(const char* heading, const UniformityMap& measured, const char* text) {
  Image picture(240, 180, 1);
  for (int y = 0; y < picture.height; ++y)
    for (int x = 0; x < picture.width; ++x) picture.at(x, y, 0) = measured.map.at_pixel(x, y, picture);
  return {{"heading", heading},
          {"map", report::picture_json(picture, 1.0)},
          {"lowest", measured.least},
          {"text", text}};
}

/// What the page draws (cli/report/calibration.js): the figures, and what they were read from.
Json page_data(const RigMeasurements& rig) {
  const CameraResponse& response = rig.response;
  const double range_dn =
      response.linear_from_dn[static_cast<std::size_t>(response.saturation_dn)] - response.black_level_dn;
  Json data = figures_of(rig);
  data["page"] = "calibration";
  data["command"] = "refield acquire calibrate";
  data["camera"] = rig.camera_description.name;
  data["display"] = rig.display_description.name;
  data["streams"] = !rig.camera_description.takes_photographs;
  data["tolerance"] = rig.superposition.tolerance;
  data["display_changes"] = {{"rising", changes_json(rig.display_timing.rising)},
                             {"falling", changes_json(rig.display_timing.falling)},
                             {"rise_settling", rig.display_timing.rise.settling.count()},
                             {"fall_settling", rig.display_timing.fall.settling.count()}};
  data["exposure_step"] = {{"level_dn", rig.control_latency.level_dn},
                           {"expected_ratio", rig.control_latency.expected_ratio}};
  data["banding"] = {{"deviation", rig.banding.deviation}, {"noise", rig.banding.noise}};
  data["response"] = {
      {"points", response.points}, {"table", response_table(response, range_dn)}, {"range_dn", range_dn}};
  data["noise"] = rig.noise.points;
  data["tone_curves"] = tone_curves(rig.tone_curve);
  data["maps"] = Json::array();
  if (rig.flat_field)
    data["maps"].push_back(map_json("Vignetting", *rig.flat_field,
                                    "Relative light at each position of the frame. Photographs are divided "
                                    "by it. It should be smooth and symmetric about the centre: a slope from "
                                    "one side to the other indicates an unevenly lit card."));
  if (rig.screen)
    data["maps"].push_back(
        map_json("Uniformity of the screen", *rig.screen,
                 "Relative brightness of each position of the screen, seen from the camera. The light maps "
                 "of a session are multiplied by it. LCDs also darken at oblique angles: place the camera at "
                 "the position of the scene for this measurement."));
  return data;
}

void print(const RigMeasurements& rig, const CalibrateVerbOptions& given) {
  std::printf("%s: calibration; %s shows and explains each figure\n", given.output.c_str(),
              given.page.c_str());
  if (rig.camera_description.takes_photographs) {
    std::printf(
        "display: assumed stable %.1f ms after a page flip; timing and flicker need a camera that streams\n",
        1e3 * rig.timing.display_latency.count());
  } else {
    std::printf("display: light changes %.1f ms after a page flip and is stable after %.1f ms\n",
                1e3 * rig.timing.display_latency.count(),
                1e3 * (rig.timing.display_latency + rig.timing.display_settling).count());
    if (rig.timing.control_latency_frames == 0)
      std::printf("camera: a new exposure or gain takes effect with the next frame\n");
    else
      std::printf("camera: a new exposure or gain takes effect after %d more frames\n",
                  rig.timing.control_latency_frames);
    if (rig.timing.exposure_unit.count() > 0.0)
      std::printf("exposures: whole multiples of %.4g ms\n", 1e3 * rig.timing.exposure_unit.count());
    else
      std::printf("exposures: any, the light does not flicker\n");
  }
  std::printf("camera: black %.2f DN, saturation %.0f DN, %s\n", rig.camera.black_level_dn,
              rig.camera.saturation_dn,
              rig.response.is_linear ? "linear" : "nonlinear (a table was written)");
  std::printf("camera: %.3g electrons per DN, read noise %.3g electrons, %.4g electrons at saturation\n",
              rig.camera.electrons_per_dn, rig.camera.read_noise_electrons, rig.noise.full_well_electrons);
  if (rig.flat_field)
    std::printf("lens: the darkest corner receives %.1f %% of the light\n", 100.0 * rig.flat_field->least);
  if (rig.screen)
    std::printf("screen: the darkest region emits %.1f %% of the light\n", 100.0 * rig.screen->least);
  std::printf("superposition: largest error %.2f %%\n", 100.0 * rig.superposition.largest_error());
  for (const std::string& warning : rig.warnings) std::printf("warning: %s\n", warning.c_str());
}

void refuse_existing(const CalibrateVerbOptions& given) {
  for (const fs::path& path : {given.output, given.page})
    if (fs::exists(path))
      throw InputError(path, ": already exists; give --force to replace it, or another name");
}

void acquire_calibrate(CalibrateVerbOptions given, const Common& common) {
  SessionFile session = read_session_file(given.rig);
  if (session.is_recipe)
    std::get<VirtualCameraOptions>(session.camera).truth = given.truth;
  else if (!given.truth.empty())
    throw InputError("--truth belongs to a recipe; a rig file names it as 'truth' in [camera]");
  if (given.output.empty()) given.output = session.calibration;
  if (given.output.empty()) throw InputError("--output is missing; give the calibration file to write");
  given.page = fs::path(given.output).replace_extension(".html");
  if (!common.force) refuse_existing(given);
  const std::vector<fs::path> inputs = {given.rig};
  const OutputLock lock(given.output, inputs), page_lock(given.page, inputs, ".html");
  CalibrateOptions options = options_of(given);
  options.gain = session.gain;
  SessionRig rig(session);
  const RigMeasurements measured =
      calibrate(rig.camera(), rig.monitor(), rig.trigger(), options, run_context());
  write_calibration(given.output, measured.camera, measured.monitor, measured.timing);
  write_text_atomically(given.page, report::page_html(page_data(measured)));
  if (common.json)
    print_json(figures_of(measured));
  else
    print(measured, given);
  if (!measured.superposition.holds())
    throw InputError("display '", measured.display_description.name,
                     "': light is not additive, I(A) + I(B) − I(black) differs from I(A+B) by up to ",
                     100.0 * measured.superposition.largest_error(),
                     " %, because the display dims itself. Switch off dynamic contrast, local dimming, power "
                     "saving and automatic brightness, then calibrate again. ",
                     given.page, " shows details");
}

}  // namespace

void add_acquire_calibrate(CLI::App& group, const Common& common, Action& action) {
  const auto options = std::make_shared<CalibrateVerbOptions>();
  CLI::App* verb = group.add_subcommand(
      "calibrate",
      "Measure the camera and the monitor and write a calibration file.\n"
      "\n"
      "Measures display latency and settling, control latency, banding, response and black level, noise, "
      "tone curves and additivity of light with the camera itself. Writes a calibration file for 'refield "
      "acquire run' and a page (.html) that shows and explains each result. The exit status is 2 if light is "
      "not additive (the display dims itself), since captures would be wrong.\n"
      "\n"
      "Only the display may change in the view of the camera; the room must be dark. docs/guide/capture.md "
      "describes the procedure.\n"
      "\n"
      "Examples:\n"
      "  refield acquire calibrate rig.toml                              # devices of a rig file\n"
      "  refield acquire calibrate recipe.toml --truth truth -o calibration.toml\n"
      "  refield acquire calibrate … --target card -o lens.toml          # vignetting: blurred white card\n"
      "  refield acquire calibrate … --target screen --copy-from lens.toml   # uniformity");
  add_rig_argument(*verb, options->rig);
  verb->add_option("-o,--output", options->output,
                   "Calibration file to write (.toml; default: the file named in the rig file)");
  add_truth_option(*verb, options->truth);
  verb->add_option("--target", options->target,
                   "Object in the view of the camera: scene (any), card (plain and evenly lit, measures "
                   "vignetting) or screen (the whole display, measures its uniformity)")
      ->check(CLI::IsMember({"scene", "card", "screen"}))
      ->capture_default_str();
  verb->add_option("--copy-from", options->copy_from,
                   "Calibration file whose flat field (vignetting) or screen uniformity is copied; repeat "
                   "the option for each");
  verb->add_option("--patience", options->patience,
                   "Time in seconds after which the display has certainly settled")
      ->capture_default_str();
  verb->add_option("--level-step", options->step,
                   "Step between the measured levels of the tone curves: 1, 3, 5, 15, 17, 51 or 85")
      ->capture_default_str();
  on_command(*verb, options, common, action, acquire_calibrate);
}

}  // namespace refield::cli
