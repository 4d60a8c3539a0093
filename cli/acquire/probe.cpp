// SPDX-License-Identifier: Apache-2.0
// refield acquire probe: photographs of a mirror ball to lat-long light maps.
#include <cmath>
#include <cstdio>

#include "acquire/light_probe/light_probe.h"
#include "cli/common/options.h"
#include "cli/run_context.h"
#include "cli/verbs.h"
#include "core/base/files.h"
#include "core/base/json.h"
#include "core/base/output_lock.h"

namespace refield::cli {

namespace {

/// Options as text. Those that are lists hold a value for the photographs and one for those of --join.
struct ProbeOptionsText {
  std::vector<std::string> photographs, join;
  std::vector<std::string> ball, hide, camera_turn;
  std::optional<double> horizontal_fov, distance, diameter;
  std::string reflectance = "chrome";
  std::string density = "0";
  std::string light_size;
  ProbeRequest request;
};

/// "YAW" or "YAW,PITCH,ROLL".
EulerAngles turn_from_text(const std::string& text) {
  EulerAngles turn;
  char rest = '\0';
  const int count = std::sscanf((text + (text.find(',') == std::string::npos ? ",0,0;" : ";")).c_str(),
                                "%lf,%lf,%lf%c", &turn.yaw, &turn.pitch, &turn.roll, &rest);
  if (count != 4 || rest != ';' || !std::isfinite(turn.yaw + turn.pitch + turn.roll))
    throw InputError("--camera-turn ", text, ": give YAW or YAW,PITCH,ROLL in degrees");
  return turn;
}

/// Of the photographs or, where `side` is 1, of those of --join.
ProbeSide side_of(const std::vector<std::string>& photographs, std::size_t side,
                  const ProbeOptionsText& options) {
  const auto text_of = [side](const std::vector<std::string>& texts) {
    return side < texts.size() ? texts[side] : std::string();
  };
  ProbeSide result;
  result.photographs = expand_globs(photographs);
  if (const std::string turn = text_of(options.camera_turn); !turn.empty())
    result.turn = turn_from_text(turn);
  result.field_of_view_degrees = options.horizontal_fov;
  if (options.distance) result.distance_radii = 2.0 * *options.distance / *options.diameter;
  const std::string ball = text_of(options.ball), hide = text_of(options.hide);
  if (!ball.empty()) result.ball = circle_from_text(ball);
  if (!hide.empty()) result.hidden = hide;
  return result;
}

ProbeRequest request_of(const ProbeOptionsText& options) {
  if (!options.horizontal_fov && !options.distance)
    throw InputError(
        "the distance of the camera is required; give --distance and --diameter, or --horizontal-fov");
  ProbeRequest request = options.request;
  const std::size_t sides = options.join.empty() ? 1 : 2;
  for (const auto& [option, texts] : {std::pair{"--ball", &options.ball},
                                      {"--hide", &options.hide},
                                      {"--camera-turn", &options.camera_turn}})
    if (texts->size() > sides)
      throw InputError(option, " is given ", texts->size(),
                       " times; give it once, and once more for the photographs of --join");
  request.sides.push_back(side_of(options.photographs, 0, options));
  if (sides == 2) request.sides.push_back(side_of(options.join, 1, options));
  if (!options.light_size.empty()) {
    const PictureSize size = read_picture_size(options.light_size, {8, 4}, "--light-size");
    if (size.width != 2 * size.height)
      throw InputError("--light-size ", options.light_size, ": lat-long maps are twice as wide as high");
    request.unwrap.width = size.width;
  }
  request.unwrap.reflectance = MirrorReflectance::from_text(options.reflectance);
  const auto density = channel_numbers(options.density, "--neutral-density");
  for (int c = 0; c < 3; ++c) {
    if (!(density[c] >= 0.0 && density[c] <= 12.0))
      throw InputError("--neutral-density: the optical density ", density[c],
                       " is out of range; give 0 to 12 (3.0 for a filter of 1:1000)");
    request.unwrap.gain[c] = std::pow(10.0, density[c]);
  }
  return request;
}

Json figures_of(const ProbeSummary& summary) {
  Json photographs = Json::array();
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
  ProbeRequest request = request_of(options);
  request.replace = common.force;
  const OutputLock lock(request.folder, {});
  if (request.replace)
    for (const auto* photographs : {&options.photographs, &options.join})
      require_outside(request.folder, {photographs->begin(), photographs->end()});
  const ProbeSummary summary = probe_light(request, run_context());
  if (common.json)
    print_json(figures_of(summary));
  else
    print(summary, request.folder);
  if (summary.kept() == 0)
    throw InputError("all photographs were discarded; the reasons are in ", request.folder / "probe.toml");
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
      "Photographs are linear (.exr), as written by 'refield acquire import'.\n"
      "\n"
      "Examples:\n"
      "  refield acquire probe ball.exr -o sky --distance 1500 --diameter 100\n"
      "  refield acquire probe 'roof/*.exr' -o sky --horizontal-fov 24 --ball 1980.5,1312,540 \\\n"
      "      --camera-turn 0,35,0 --hide tripod.png --neutral-density 3.0\n"
      "  refield acquire probe east.exr --join north.exr --camera-turn 0 --camera-turn 90 -o sky \\\n"
      "      --distance 2000 --diameter 200");
  verb->add_option("photographs", options->photographs,
                   "Photographs: of the ball, files, folders or quoted patterns")
      ->required();
  verb->add_option("-o,--output", request.folder, "Folder for the environment maps, times.tsv and probe.toml")
      ->required();
  CLI::Option* view = add_horizontal_fov_option(*verb, options->horizontal_fov);
  CLI::Option* distance =
      verb->add_option("--distance", options->distance,
                       "Distance from the lens to the centre of the ball in mm, instead of --horizontal-fov")
          ->excludes(view);
  CLI::Option* diameter = add_diameter_option(*verb, options->diameter);
  diameter->needs(distance);
  distance->needs(diameter);
  const char* twice = "; a second value is for the photographs of --join";
  verb->add_option(
          "--ball", options->ball,
          "Centre and radius of the mirror ball, X,Y,R in pixels from the top left corner, or 'find'" +
              std::string(twice))
      ->default_str("find");
  verb->add_option("--camera-turn", options->camera_turn,
                   "Rotation of the camera to the right of the centre of the map (+Z), downward and about "
                   "its viewing direction, YAW or YAW,PITCH,ROLL in degrees (default: 0,0,0)" +
                       std::string(twice));
  verb->add_option("--hide", options->hide,
                   "Mask image, white over objects that are not part of the environment (tripod, stand, "
                   "photographer); these regions are filled from their neighbourhood" +
                       std::string(twice));
  verb->add_option(
      "--join", options->join,
      "Photographs from a second direction, one per photograph; they fill the directions behind the ball");
  verb->add_option("--reflectance", options->reflectance,
                   "Reflectance of the ball: chrome, silver, perfect, or the measured value at normal "
                   "incidence, R or R,G,B")
      ->capture_default_str();
  verb->add_option("--neutral-density", options->density,
                   "Total optical density of all filters, D or R,G,B; radiance is multiplied by 10^D")
      ->capture_default_str();
  verb->add_flag(
          "--ball-moves", request.ball_moves,
          "Detect the ball in each photograph; by default one position is used for all, for a fixed setup")
      ->group(further);
  verb->add_option("--light-size", options->light_size,
                   "Size of the light maps in texels (default: the resolution of the ball image)")
      ->type_name("WIDTHxHEIGHT")
      ->group(further);
  verb->add_option("--max-sun", request.limits.max_sun,
                   "Discard a map if more than this fraction of its light comes from one spot of 3 degrees")
      ->capture_default_str()
      ->group(further);
  verb->add_option("--max-clipped", request.limits.max_clipped,
                   "Discard a map if more than this fraction of the sphere was clipped")
      ->capture_default_str()
      ->group(further);
  add_saturation_option(*verb, request.saturation);
  on_command(*verb, options, common, action, probe);
}

}  // namespace refield::cli
