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
#include "acquire/import/import_series.h"
#include "acquire/light_probe/unwrap.h"
#include "cli/acquire/capture_report.h"
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

struct ImportOptions {
  ImportRequest request;
  std::vector<std::string> photographs;
  std::string ambient;
  std::string lights;
  fs::path light_sources;
  std::vector<double> object_at;
  std::string ball;
  std::optional<double> field_of_view;
  std::string flat_fields;
  std::string lights_by;
  std::string lights_hold = "radiance";
  std::string parameterisation = "monitor";
  std::vector<std::string> monitors;
  std::vector<double> exposures;
  fs::path mask;
  bool half = false;
};

ImportRequest request_of(const ImportOptions& options) {
  ImportRequest request = options.request;
  request.photographs = expand_globs(options.photographs);
  if (!options.ambient.empty()) request.ambient = expand_globs({options.ambient});
  if (!options.lights.empty()) request.lights = expand_globs({options.lights});
  if (!options.light_sources.empty()) {
    std::optional<Eigen::Vector3d> object;
    if (!options.object_at.empty()) object.emplace(options.object_at.data());
    request.stage = read_light_stage(options.light_sources, object);
  }
  if (!options.ball.empty()) {
    request.ball.emplace();
    request.ball->field_of_view_degrees = options.field_of_view;
    if (options.ball != "find") {
      const auto circle = channel_numbers(options.ball, "--ball");
      request.ball->circle = ImageCircle{{circle[0], circle[1]}, circle[2]};
    }
  }
  if (!options.flat_fields.empty()) request.flat_fields = expand_globs({options.flat_fields});
  for (double seconds : options.exposures) request.exposures.emplace_back(seconds);
  request.lights_by_order =
      options.lights_by.empty() ? request.rule.pattern.empty() : options.lights_by == "order";
  if (options.lights_hold == "drive") {
    request.light_content = LightContent::drive_levels;
    if (request.monitor.empty() && fs::is_regular_file(request.camera.response))
      request.monitor = request.camera.response;
  }
  request.parameterisation = parameterisation_from_name(options.parameterisation);
  if (!options.monitors.empty()) request.monitors = placements_from_texts(options.monitors);
  if (!options.mask.empty()) request.mask = options.mask;
  if (options.half) request.precision = Precision::half;
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

void run_import(const ImportOptions& options, const Common& common) {
  const ImportRequest request = request_of(options);
  const OutputLock lock(request.folder, {});
  if (request.if_exists == IfExists::replace) {
    std::vector<fs::path> inputs = {options.mask, options.lights, options.light_sources, options.ambient,
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
      "Import bracketed or light-stage photographs taken with other software.\n"
      "\n"
      "With --lights, --light-sources or --ball, writes a capture session for 'refield "
      "estimate'; without them, a folder of HDR photographs (.exr) with their times, "
      "for 'refield acquire probe' "
      "and 'refield acquire match'. Reads TIFF, PNG, JPEG, EXR and camera RAW files, "
      "with exposure times from EXIF. docs/guide/import.md explains the rules.\n"
      "\n"
      "Files are grouped into brackets by name (--pattern), by number (--count) or "
      "otherwise by exposure time: a repeated exposure time starts the next bracket. "
      "Brackets are assigned to lights by name (with --pattern) or by order. The order is checked by "
      "brightness, and by times.tsv of 'refield acquire show' beside the lights: black, missing and "
      "repeated brackets are found and named.\n"
      "\n"
      "Examples:\n"
      "  refield acquire import shots --lights lights --pattern '{light}_e*.tif' \\\n"
      "      --response calibration.toml -o session\n"
      "  refield acquire import shots --lights shown --lights-hold drive --count 4 \\\n"
      "      --ambient 'dark/*.tif' --response calibration.toml -o session\n"
      "  refield acquire import shots --lights patterns --ambient-first -o session\n"
      "  refield acquire import dome --light-sources dome/dome.lp -o session\n"
      "  refield acquire import shots --ball 310,2260,118 --flat-fields card -o session\n"
      "  refield acquire import roof -o roof-hdr");
  verb->add_option("photographs", options->photographs,
                   "Photographs to import: folders, files or quoted patterns")
      ->required();
  verb->add_option("-o,--output", request.folder, "Session folder, or folder for the HDR photographs")
      ->required();
  verb->add_option("--pattern", request.rule.pattern,
                   "Pattern of the file names: {light} matches the name of the view, * and ? match any text, "
                   "as in '{light}_e*.tif'");
  verb->add_option("--count", request.rule.count, "Number of files per bracket, in the order of their names")
      ->check(positive_number());
  verb->add_option("--exposures", options->exposures,
                   "Exposure times of the files of a bracket in seconds, separated by commas, in the order "
                   "of their names (default: from the metadata of the files)")
      ->delimiter(',');
  CLI::Option* lights =
      verb->add_option("--lights", options->lights, "Light maps that were shown: folder or quoted pattern");
  CLI::Option* sources =
      verb->add_option("--light-sources", options->light_sources,
                       "Light sources of a dome or light stage, one per photograph: a .lp file (count, then "
                       "'name x y z' per line), a table whose first line names the columns file,x,y,z and "
                       "optionally r,g,b, or directions 'x y z' per line with filenames.txt and "
                       "light_intensities.txt in the same folder. Axes: x right, y up, z towards the camera. "
                       "The light maps are lat_long")
          ->excludes(lights);
  verb->add_option(
          "--object-at", options->object_at,
          "Position of the object, X,Y,Z, in the axes and unit of --light-sources, whose vectors are "
          "then positions of near light sources: light falls with the square of the distance "
          "(default: the vectors are directions)")
      ->delimiter(',')
      ->expected(3)
      ->needs(sources);
  CLI::Option* ball =
      verb->add_option("--ball", options->ball,
                       "Mirror ball in the photographs of a light stage, instead of --light-sources: its "
                       "highlight shows the direction of the light source. Centre and radius X,Y,R in "
                       "pixels from the top left corner, or 'find'. The ball is excluded from the mask")
          ->excludes(lights)
          ->excludes(sources);
  verb->add_option("--field-of-view", options->field_of_view,
                   "Horizontal field of view of the camera in degrees, for --ball (default: far camera, "
                   "directions relative to that from the ball to the camera)")
      ->needs(ball);
  verb->add_option("--flat-fields", options->flat_fields,
                   "Photographs of a white card in the place of the object, facing the camera, one per light "
                   "source (or bracket): folder or quoted pattern. Photographs are divided by them, which "
                   "removes fall-off, intensity and vignetting")
      ->excludes(lights);
  verb->add_option("--lights-by", options->lights_by,
                   "How brackets are assigned to lights: name or order (default: name with --pattern, "
                   "otherwise order)")
      ->check(CLI::IsMember({"name", "order"}))
      ->needs(lights);
  verb->add_option("--lights-hold", options->lights_hold,
                   "Content of the light maps: radiance (linear, above the black level of the monitor; PNG "
                   "files are decoded from sRGB) or drive (8-bit levels as sent to the monitor)")
      ->check(CLI::IsMember({"radiance", "drive"}))
      ->capture_default_str()
      ->needs(lights);
  verb->add_option("--monitor-calibration", request.monitor,
                   "Calibration file (.toml) with the tone curve of the monitor, for drive levels (default: "
                   "the file of --response)")
      ->needs(lights);
  verb->add_option("--parameterisation", options->parameterisation,
                   "Parameterisation of the light maps: monitor, lat_long or cube")
      ->capture_default_str()
      ->needs(lights);
  verb->add_option("--monitor", options->monitors,
                   "Placement of the monitor, such as 520x320@600,yaw=90 (mm, degrees), for relighting by "
                   "environment maps. Repeat the option for each window of stacked light maps")
      ->needs(lights);
  verb->add_option(
      "--ambient", options->ambient,
      "Photographs of the ambient light, one bracket, subtracted from all others: folder or quoted pattern");
  verb->add_flag(
      "--ambient-first", request.ambient_first,
      "Use the first bracket as the ambient light, since 'refield acquire show' starts with black; "
      "further black brackets are left out");
  verb->add_option("--mask", options->mask, "Mask image, white where the scene is (default: all pixels)");
  verb->add_option("--test-every", request.test_every,
                   "Hold out every N-th frame for validation, in addition to frames whose light is named "
                   "test…; 0: none")
      ->check(non_negative_number())
      ->capture_default_str();
  add_bracket_camera(*verb, request.camera);
  verb->add_flag("--half", options->half,
                 "Write 16-bit half-float photographs: half the size, relative rounding error 0.05 %");
  add_if_exists(*verb, request.if_exists, "existing files");
  verb->callback(
      [options, &common, &action] { action = [options, &common] { run_import(*options, common); }; });
}

}  // namespace refield::cli
