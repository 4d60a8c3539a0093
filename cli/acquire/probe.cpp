// SPDX-License-Identifier: Apache-2.0
// refield acquire probe: photographs of a mirror ball to lat-long light maps.
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "acquire/light_probe/light_probe.h"
#include "cli/common/options.h"
#include "cli/run_context.h"
#include "cli/verbs.h"
#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/base/output_lock.h"
#include "core/session/capture_session.h"

namespace refield::cli {

namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

/// Options of one side of the rig, as text.
struct SideOptions {
  std::vector<std::string> photographs;
  std::string ball;
  fs::path ball_mask;
  fs::path hide;
  EulerAngles turn;
};

struct ProbeOptionsText {
  SideOptions first;
  SideOptions second;
  std::optional<double> focal_px, field_of_view, distance, diameter;
  std::string reflectance = "chrome";
  std::string density = "0";
  ProbeRequest request;
};

ProbeSide side_of(const SideOptions& text, const ProbeOptionsText& options) {
  ProbeSide side;
  side.photographs = expand_globs(text.photographs);
  side.turn = text.turn;
  side.focal_px = options.focal_px;
  side.field_of_view_degrees = options.field_of_view;
  if (options.distance) side.distance_radii = 2.0 * *options.distance / *options.diameter;
  if (!text.ball.empty()) {
    const auto circle = channel_numbers(text.ball, "--ball");
    side.ball = ImageCircle{{circle[0], circle[1]}, circle[2]};
  }
  if (!text.ball_mask.empty()) side.ball_mask = text.ball_mask;
  if (!text.hide.empty()) side.hidden = text.hide;
  return side;
}

ProbeRequest request_of(const ProbeOptionsText& options) {
  if (!options.focal_px && !options.field_of_view && !options.distance)
    throw InputError(
        "the distance of the camera is required; give --distance and --diameter, --focal-px or "
        "--field-of-view");
  ProbeRequest request = options.request;
  request.sides.push_back(side_of(options.first, options));
  if (!options.second.photographs.empty()) request.sides.push_back(side_of(options.second, options));
  request.unwrap.reflectance = MirrorReflectance::from_text(options.reflectance);
  const auto density = channel_numbers(options.density, "--neutral-density");
  for (int c = 0; c < 3; ++c) {
    if (!(density[c] >= 0.0 && density[c] <= 12.0))
      throw InputError("--neutral-density: the optical density " + std::to_string(density[c]) +
                       " is out of range; give 0 to 12 (3.0 for a filter of 1:1000)");
    request.unwrap.gain[c] = std::pow(10.0, density[c]);
  }
  return request;
}

ordered_json figures_of(const ProbeSummary& summary) {
  ordered_json photographs = ordered_json::array();
  for (const ProbedPhotograph& p : summary.photographs)
    photographs.push_back({{"file", p.photograph.string()},
                           {"ball", {p.ball.centre.x(), p.ball.centre.y(), p.ball.radius}},
                           {"mean_radiance", p.verdict.mean_radiance},
                           {"sun_fraction", p.verdict.sun_fraction},
                           {"clipped_fraction", p.verdict.clipped_fraction},
                           {"unseen_fraction", p.verdict.unseen_fraction},
                           {"discarded", p.verdict.discarded}});
  return {{"kept", summary.kept()},
          {"width", summary.width},
          {"notes", summary.notes},
          {"photographs", photographs}};
}

void print(const ProbeSummary& summary, const fs::path& folder) {
  for (const std::string& note : summary.notes) std::printf("note: %s\n", note.c_str());
  for (const ProbedPhotograph& p : summary.photographs)
    if (!p.verdict.discarded.empty())
      std::printf("discarded: %s: %s\n", p.photograph.c_str(), p.verdict.discarded.c_str());
  std::printf(
      "%s: %zu light maps of %d×%d from %zu photographs; %.1f %% of the sphere was filled from its "
      "neighbourhood\n",
      folder.c_str(), summary.kept(), summary.width, summary.width / 2, summary.photographs.size(),
      100.0 * summary.photographs.front().verdict.unseen_fraction);
}

void probe(const ProbeOptionsText& options, const Common& common) {
  const ProbeRequest request = request_of(options);
  const OutputLock lock(request.folder, {});
  if (request.replace)
    for (const SideOptions* side : {&options.first, &options.second})
      require_outside(request.folder, {side->photographs.begin(), side->photographs.end()});
  const ProbeSummary summary = probe_light(request, run_context());
  if (common.json)
    print_json(figures_of(summary));
  else
    print(summary, request.folder);
  if (summary.kept() == 0)
    throw InputError("all photographs were discarded; the reasons are in " +
                     (request.folder / "probe.toml").string());
}

void add_turn(CLI::App& verb, const std::string& prefix, EulerAngles& turn, const std::string& whose) {
  verb.add_option(
      "--" + prefix + "yaw", turn.yaw,
      "Rotation of " + whose + " to the right of the centre of the map (+Z), in degrees (default: 0)");
  verb.add_option("--" + prefix + "pitch", turn.pitch,
                  "Downward rotation of " + whose + ", in degrees (default: 0)");
  verb.add_option(
      "--" + prefix + "roll", turn.roll,
      "Rotation of " + whose + " about its viewing direction, right side up, in degrees (default: 0)");
}

}  // namespace

void add_acquire_probe(CLI::App& group, const Common& common, Action& action) {
  const auto options = std::make_shared<ProbeOptionsText>();
  ProbeRequest& request = options->request;
  request.unwrap.width = 0;
  CLI::App* verb = group.add_subcommand(
      "probe",
      "Convert photographs of a mirror ball into lat-long environment maps.\n"
      "\n"
      "A map shows the environment as seen from the position of the ball, with the viewing direction of the "
      "camera in its centre (the outdoor setup of the paper; docs/guide/light-probe.md has a figure). "
      "Photographs are linear (.exr), as written by 'refield hdr' and 'refield acquire import'.\n"
      "\n"
      "Examples:\n"
      "  refield acquire probe ball.exr -o sky --distance 1500 --diameter 100\n"
      "  refield acquire probe 'roof/*.exr' -o sky --focal-px 5200 --ball 1980.5,1312,540 --pitch 35 \\\n"
      "      --hide tripod.png --neutral-density 3.0\n"
      "  refield acquire probe east.exr --join north.exr --join-yaw 90 -o sky --distance 20 --diameter 2");
  verb->add_option("photographs", options->first.photographs,
                   "Photographs of the ball: files, folders or quoted patterns")
      ->required();
  verb->add_option("-o,--output", request.folder, "Folder for the environment maps, times.tsv and probe.toml")
      ->required();
  CLI::Option* focal =
      verb->add_option("--focal-px", options->focal_px, "Focal length of the camera in pixels");
  CLI::Option* view =
      verb->add_option("--field-of-view", options->field_of_view,
                       "Horizontal field of view of the camera in degrees, instead of --focal-px")
          ->excludes(focal);
  CLI::Option* distance = verb->add_option("--distance", options->distance,
                                           "Distance from the lens to the centre of the ball in any unit, "
                                           "with --diameter, instead of --focal-px")
                              ->excludes(focal)
                              ->excludes(view);
  CLI::Option* diameter =
      verb->add_option("--diameter", options->diameter, "Diameter of the ball, in the unit of --distance")
          ->needs(distance)
          ->check(positive_number());
  distance->needs(diameter);
  verb->add_option("--ball", options->first.ball,
                   "Centre and radius of the ball in the photograph: X,Y,R in pixels from the top left "
                   "corner (default: detected)");
  verb->add_option("--ball-mask", options->first.ball_mask,
                   "Mask image of the ball, white on black, instead of --ball");
  verb->add_flag(
      "--ball-moves", request.ball_moves,
      "Detect the ball in each photograph; by default one position is used for all, for a fixed setup");
  verb->add_option("--hide", options->first.hide,
                   "Mask image, white over objects that are not part of the environment (tripod, stand, "
                   "photographer); these regions are filled from their neighbourhood");
  add_turn(*verb, "", options->first.turn, "the camera");
  verb->add_option("--reflectance", options->reflectance,
                   "Reflectance of the ball: chrome, silver, perfect, or the measured value at normal "
                   "incidence, R or R,G,B")
      ->capture_default_str();
  verb->add_option("--neutral-density", options->density,
                   "Total optical density of all filters, D or R,G,B; radiance is multiplied by 10^D")
      ->capture_default_str();
  verb->add_option(
          "--camera-region", request.unwrap.camera_region_degrees,
          "Angle in degrees around the reflection of the camera that is filled from its neighbourhood")
      ->capture_default_str();
  verb->add_option("--rim", request.unwrap.rim_px,
                   "Width in pixels of the ignored border inside the outline of the ball")
      ->capture_default_str();
  verb->add_option("--width", request.unwrap.width,
                   "Width of the environment maps in texels; the height is half of it (default: the "
                   "resolution of the ball image)");
  verb->add_option("--saturation", request.saturation,
                   "Value from which samples are clipped, for photographs without a noise estimate");
  verb->add_option("--most-sun", request.limits.max_sun,
                   "Discard a map if more than this fraction of its light comes from one spot of 3 degrees")
      ->capture_default_str();
  verb->add_option("--most-clipped", request.limits.max_clipped,
                   "Discard a map if more than this fraction of the sphere was clipped")
      ->capture_default_str();
  CLI::Option* second = verb->add_option(
      "--join", options->second.photographs,
      "Photographs from a second direction, one per photograph; they fill the directions behind the ball");
  verb->add_option("--join-ball", options->second.ball,
                   "Centre and radius of the ball in the photographs of --join, as for --ball")
      ->needs(second);
  verb->add_option("--join-ball-mask", options->second.ball_mask,
                   "Mask image of the ball in the photographs of --join, as for --ball-mask")
      ->needs(second);
  verb->add_option("--join-hide", options->second.hide,
                   "Mask image of hidden objects in the photographs of --join, as for --hide")
      ->needs(second);
  add_turn(*verb, "join-", options->second.turn, "the camera of --join");
  verb->add_flag("--force", request.replace, "Replace the environment maps of an earlier run");
  verb->callback([options, &common, &action] { action = [options, &common] { probe(*options, common); }; });
}

}  // namespace refield::cli
