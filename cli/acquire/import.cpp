// SPDX-License-Identifier: Apache-2.0
// refield acquire import: photographs of other tools, bracketed or of a light stage, to a capture session or
// a series of HDR photographs.
#include <algorithm>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "acquire/capture/exposure_plan.h"
#include "acquire/hdr/hdr_merge.h"
#include "acquire/import/bracket_merge.h"
#include "acquire/import/bracket_response.h"
#include "acquire/light_probe/unwrap.h"
#include "cli/acquire/capture_report.h"
#include "cli/acquire/import.h"
#include "cli/common/options.h"
#include "cli/run_context.h"
#include "cli/verbs.h"
#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/base/output_lock.h"

namespace refield::cli {

namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

ImportRequest request_of(const ImportOptions& options) {
  ImportRequest request = options.request;
  request.photographs = expand_globs(options.photographs);
  if (!options.ambient.empty()) request.ambient = expand_globs({options.ambient});
  if (!options.light.empty()) request.lights = expand_globs({options.light});
  if (options.light_sources == "ball") {
    request.ball.emplace();
    request.ball->field_of_view_degrees = options.horizontal_fov;
    if (options.ball != "find") {
      const auto circle = channel_numbers(options.ball, "--ball");
      request.ball->circle = ImageCircle{{circle[0], circle[1]}, circle[2]};
    }
  } else if (!options.light_sources.empty()) {
    std::optional<Eigen::Vector3d> object;
    if (!options.object_at.empty()) object.emplace(options.object_at.data());
    request.stage = read_light_stage(options.light_sources, object);
  }
  if (!options.flat_fields.empty()) request.flat_fields = expand_globs({options.flat_fields});
  for (double seconds : options.exposures) request.exposures.emplace_back(seconds);
  request.lights_by_order =
      options.pair_by.empty() ? request.rule.pattern.empty() : options.pair_by == "order";
  if (options.light_content == "drive") {
    request.light_content = LightContent::drive_levels;
    if (request.monitor.empty() && fs::is_regular_file(request.camera.response))
      request.monitor = request.camera.response;
  }
  request.parameterisation = parameterisation_of(options.parameterisation, options.light);
  if (!options.placements.empty()) request.monitors = placements_from_texts(options.placements);
  if (!options.mask.empty()) request.mask = options.mask;
  return request;
}

ordered_json figures_of(const ImportSummary& summary) {
  ordered_json exposures = ordered_json::array();
  for (std::size_t i = 0; i < summary.useful_fraction.size(); ++i)
    exposures.push_back(
        {{"seconds", summary.exposures[i].count()}, {"useful_fraction", summary.useful_fraction[i]}});
  return {{"photographs", summary.photographs},
          {"taken_over", summary.found_done},
          {"with_time", summary.timed},
          {"exposures", exposures},
          {"response_estimated", summary.response_estimated},
          {"notes", summary.notes},
          {"clipped_fraction", summary.clipped_fraction}};
}

void print(const ImportSummary& summary, const fs::path& folder) {
  std::printf("%s: %zu photographs", folder.c_str(), summary.photographs);
  if (summary.found_done > 0) std::printf(", %zu steps reused from an earlier run", summary.found_done);
  std::printf("; %zu have a time stamp\n", summary.timed);
  for (const std::string& note : summary.notes) std::printf("note: %s\n", note.c_str());
  if (summary.useful_fraction.empty()) return;
  std::printf("exposures:");
  for (std::size_t i = 0; i < summary.exposures.size(); ++i)
    std::printf(" %.4g s (useful for %.1f %% of the samples)%s", summary.exposures[i].count(),
                100.0 * summary.useful_fraction[i], i + 1 < summary.exposures.size() ? "," : "\n");
  std::printf("clipped in every exposure: %.3f %% of the samples\n", 100.0 * summary.clipped_fraction);
  if (is_much_clipped(summary.clipped_fraction)) std::printf("note: %s\n", clipping_remedy);
  if (std::ranges::is_sorted(summary.exposures))
    for (const std::string& sentence : wasted_exposures(summary.exposures, summary.useful_fraction))
      std::printf("note: %s\n", sentence.c_str());
}

/// One HDR photograph of all files.
void merge_one_view(const ImportOptions& options, const Common& common) {
  const fs::path& output = options.request.folder;
  const OutputLock lock(output, {options.photographs.begin(), options.photographs.end()}, ".exr");
  const std::vector<Seconds> exposures(options.exposures.begin(), options.exposures.end());
  Bracket bracket = read_bracket(expand_globs(options.photographs), options.request.camera, exposures);
  BracketCamera camera = options.request.camera;
  const std::vector<BracketSamples> samples = {samples_of(bracket)};
  const std::vector<std::string> notes = settle_response(samples, camera);
  MergeStatistics statistics;
  const Photograph merged = merge_bracket(bracket, camera, &statistics);
  write_photograph(output, merged);

  ordered_json images = ordered_json::array();
  for (std::size_t i = 0; i < bracket.paths.size(); ++i)
    images.push_back({{"file", bracket.paths[i].string()},
                      {"seconds", bracket.exposures[i].count()},
                      {"useful_fraction", statistics.useful_fraction[i]}});
  if (common.json) {
    print_json(ordered_json{{"images", images},
                            {"response_estimated", !camera.curve.empty()},
                            {"notes", notes},
                            {"clipped_fraction", statistics.clipped_fraction}});
    return;
  }
  for (const std::string& note : notes) std::printf("note: %s\n", note.c_str());
  for (const auto& image : images)
    std::printf("%s: %.6g s, useful for %.1f %% of the samples\n", image["file"].get<std::string>().c_str(),
                image["seconds"].get<double>(), 100.0 * image["useful_fraction"].get<double>());
  std::printf("%s: %.3f %% of the samples are clipped in every exposure\n", output.c_str(),
              100.0 * statistics.clipped_fraction);
}

void run_import(const ImportOptions& options, const Common& common) {
  const fs::path& output = options.request.folder;
  if (options.light_sources != "ball" && (options.ball != "find" || options.horizontal_fov))
    throw InputError("--ball and --horizontal-fov require --light-sources ball");
  if (options.pair_by == "time") return match_by_time(options, common);
  if (output.extension() == ".exr") return merge_one_view(options, common);
  if (output.extension() == ".toml") return estimate_camera_response(options, common);
  const ImportRequest request = request_of(options);
  const OutputLock lock(request.folder, {});
  if (request.if_exists == IfExists::replace) {
    std::vector<fs::path> inputs = {options.mask, options.light, options.light_sources, options.ambient,
                                    options.flat_fields};
    inputs.insert(inputs.end(), options.photographs.begin(), options.photographs.end());
    require_outside(request.folder, inputs);
  }
  const ImportSummary summary = import_series(request, run_context());
  if (common.json) {
    auto figures = figures_of(summary);
    report_check(request.folder, &figures);
    print_json(figures);
  } else {
    print(summary, request.folder);
    report_check(request.folder);
  }
}

}  // namespace

void add_acquire_import(CLI::App& group, const Common& common, Action& action) {
  const auto options = std::make_shared<ImportOptions>();
  ImportRequest& request = options->request;
  CLI::App* verb = group.add_subcommand(
      "import",
      "Import photographs taken with other software, or merge brackets into HDR photographs.\n"
      "\n"
      "With --light or --light-sources, writes a capture session for 'refield estimate'; without them, a "
      "folder of HDR photographs (.exr) with their times. For an output .exr all files are exposures of one "
      "view, for .toml static views from which the response curve of the camera is estimated. Reads TIFF, "
      "PNG, JPEG, EXR and camera RAW files, with exposure times from EXIF. docs/guide/import.md explains the "
      "rules.\n"
      "\n"
      "Files are grouped into brackets by name (--names), by number (--bracket-size) or otherwise by "
      "exposure time: a repeated exposure time starts the next bracket. Brackets are paired with lights by "
      "name (with --names), by order or by time. The order is checked by brightness, and by times.tsv of "
      "'refield acquire show' beside the lights: black, missing and repeated brackets are found and named.\n"
      "\n"
      "Examples:\n"
      "  refield acquire import shots --light patterns --ambient-first -o session\n"
      "  refield acquire import shots --light lights --names '{light}_e*.tif' \\\n"
      "      --response calibration.toml -o session\n"
      "  refield acquire import dome --light-sources dome/dome.lp -o session\n"
      "  refield acquire import shots --light-sources ball --flat-fields card -o session\n"
      "  refield acquire import roof -o roof-hdr\n"
      "  refield acquire import 'city/*.exr' --light sky --pair-by time --offset auto -o session\n"
      "  refield acquire import a.tif b.tif c.tif --exposures 0.01,0.04,0.16 -o view.exr");
  verb->add_option("photographs", options->photographs, "Photographs: folders, files or quoted patterns")
      ->required();
  verb->add_option(
          "-o,--output", request.folder,
          "Session folder, folder for HDR photographs, one HDR photograph (.exr) or response curve (.toml)")
      ->required();
  CLI::Option* light = verb->add_option("--light", options->light,
                                        "Light maps: folder or quoted pattern of those that were shown");
  CLI::Option* sources =
      verb->add_option(
              "--light-sources", options->light_sources,
              "Light sources of a dome or light stage, one per photograph: a .lp file (count, then 'name x y "
              "z' per line), a table whose first line names the columns file,x,y,z and optionally r,g,b, or "
              "directions 'x y z' per line with filenames.txt and light_intensities.txt in the same folder. "
              "Axes: x right, y up, z towards the camera. Or 'ball': the highlights of a mirror ball in the "
              "photographs show the directions. The light maps are lat_long")
          ->excludes(light);
  verb->add_option("--pair-by", options->pair_by,
                   "How brackets are paired with lights: by name, by order, or HDR photographs by time "
                   "(default: name with --names, otherwise order)")
      ->check(CLI::IsMember({"name", "order", "time"}))
      ->needs(light);
  verb->add_flag("--ambient-first", request.ambient_first,
                 "Use the first bracket as the ambient light, since 'refield acquire show' starts with "
                 "black; further black brackets are left out");
  verb->add_option("--exposures", options->exposures,
                   "Exposure times of a photograph in seconds, separated by commas; in the order of the "
                   "files' names (default: from the metadata of the files)")
      ->delimiter(',');
  add_bracket_camera(*verb, request.camera);
  add_mask_option(*verb, options->mask);
  add_hold_out_option(*verb, request.test_every);
  add_resume_flag(*verb, request.if_exists);

  const char* brackets = "Brackets";
  verb->add_option("--names", request.rule.pattern,
                   "Pattern of the file names: {light} matches the name of the view, * and ? match any text, "
                   "as in '{light}_e*.tif'")
      ->group(brackets);
  verb->add_option("--bracket-size", request.rule.count,
                   "Number of files per bracket, in the order of their names")
      ->check(positive_number())
      ->group(brackets);
  verb->add_option("--ambient", options->ambient,
                   "Photographs of the ambient light, one bracket, subtracted from all others: folder or "
                   "quoted pattern")
      ->group(brackets);
  verb->add_option("--flat-fields", options->flat_fields,
                   "Photographs of a white card in the place of the object, facing the camera, one per light "
                   "source (or bracket): folder or quoted pattern. Photographs are divided by them, which "
                   "removes fall-off, intensity and vignetting")
      ->excludes(light)
      ->group(brackets);
  const char* lights = "Lights";
  verb->add_option("--light-content", options->light_content,
                   "Content of the light maps: radiance (linear, above the black level of the monitor; PNG "
                   "files are decoded from sRGB) or drive (8-bit levels as sent to the monitor)")
      ->check(CLI::IsMember({"radiance", "drive"}))
      ->capture_default_str()
      ->needs(light)
      ->group(lights);
  add_parameterisation_option(*verb, options->parameterisation);
  add_placement_option(*verb, options->placements, "For relighting by environment maps.")
      ->needs(light)
      ->group(lights);
  verb->add_option("--object-at", options->object_at,
                   "Position of the object, X,Y,Z, in the axes and unit of --light-sources, whose vectors "
                   "are then positions of near light sources: light falls with the square of the distance "
                   "(default: the vectors are directions)")
      ->delimiter(',')
      ->expected(3)
      ->needs(sources)
      ->group(lights);
  add_ball_option(*verb, options->ball, ", with --light-sources ball; it is excluded from the mask")
      ->needs(sources)
      ->group(lights);
  add_horizontal_fov_option(*verb, options->horizontal_fov)->needs(sources)->group(lights);
  const char* times = "Pairs by time (--pair-by time)";
  verb->add_option("--offset", options->offset,
                   "Offset in seconds of the scene camera's clock relative to the clock of the light maps; "
                   "auto: estimated from the brightness of both series")
      ->capture_default_str()
      ->group(times);
  verb->add_option(
          "--drift", options->drift,
          "Drift of the scene camera's clock in parts per million; auto: estimated, requires --offset auto")
      ->capture_default_str()
      ->group(times);
  verb->add_option("--max-gap", options->max_gap,
                   "Maximum time in seconds between a photograph and its light map (default: half the median "
                   "interval of the light maps)")
      ->check(non_negative_number())
      ->group(times);
  verb->callback([options, &common, &action] {
    action = [options, &common] {
      options->request.if_exists = if_exists(options->request.if_exists, common);
      run_import(*options, common);
    };
  });
}

}  // namespace refield::cli
