// SPDX-License-Identifier: Apache-2.0
// refield acquire import: photographs of other tools, bracketed or of a light stage, to a capture session or
// a series of HDR photographs.
#include <cmath>
#include <cstdio>

#include "acquire/capture/exposure_plan.h"
#include "acquire/hdr/hdr_merge.h"
#include "acquire/import/bracket_merge.h"
#include "acquire/import/import_series.h"
#include "acquire/light_probe/unwrap.h"
#include "acquire/series/match_series.h"
#include "cli/acquire/capture_report.h"
#include "cli/common/options.h"
#include "cli/run_context.h"
#include "cli/verbs.h"
#include "core/base/files.h"
#include "core/base/json.h"
#include "core/base/output_lock.h"

namespace refield::cli {

namespace {

/// Options of `refield acquire import`.
struct ImportOptions {
  ImportRequest request;
  std::vector<std::string> photographs;
  std::string ambient;
  std::string light;
  std::string light_sources;  ///< a file, or "ball"
  std::vector<double> object_at;
  std::string ball = "find";
  std::optional<double> horizontal_fov;
  std::string flat_fields;
  std::string
      pair_by;  ///< "name", "order", "time"; empty: by name where the names have a pattern, else by order
  std::string light_content = "radiance";
  std::string parameterisation;
  std::vector<std::string> placements;
  std::vector<double> exposures;
  std::string mask;
  std::string offset = "0", drift = "0";  ///< of clocks: a number or "auto"
  std::optional<double> max_gap;
};

ImportRequest request_of(const ImportOptions& options) {
  ImportRequest request = options.request;
  request.photographs = expand_globs(options.photographs);
  if (!options.ambient.empty()) request.ambient = expand_globs({options.ambient});
  if (!options.light.empty()) request.lights = expand_globs({options.light});
  if (options.light_sources == "ball") {
    request.ball.emplace();
    request.ball->field_of_view_degrees = options.horizontal_fov;
    request.ball->circle = circle_from_text(options.ball);
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

Json figures_of(const ImportSummary& summary) {
  Json exposures = Json::array();
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

  Json images = Json::array();
  for (std::size_t i = 0; i < bracket.paths.size(); ++i)
    images.push_back({{"file", bracket.paths[i].string()},
                      {"seconds", bracket.exposures[i].count()},
                      {"useful_fraction", statistics.useful_fraction[i]}});
  if (common.json)
    return print_json(Json{{"images", images},
                           {"response_estimated", !camera.curve.empty()},
                           {"notes", notes},
                           {"clipped_fraction", statistics.clipped_fraction}});
  for (const std::string& note : notes) std::printf("note: %s\n", note.c_str());
  for (const auto& image : images)
    std::printf("%s: %.6g s, useful for %.1f %% of the samples\n", image["file"].get<std::string>().c_str(),
                image["seconds"].get<double>(), 100.0 * image["useful_fraction"].get<double>());
  std::printf("%s: %.3f %% of the samples are clipped in every exposure\n", output.c_str(),
              100.0 * statistics.clipped_fraction);
}

/// At most twenty of the brackets, evenly spread.
std::vector<BracketSamples> brackets_of(const ImportOptions& given) {
  ImportRequest request;
  request.photographs = expand_globs(given.photographs);
  request.rule = given.request.rule;
  for (const double seconds : given.exposures) request.exposures.emplace_back(seconds);
  constexpr std::size_t enough = 20;
  auto brackets = sample_series(views_of(request, run_context()), request, enough, run_context());
  for (const BracketSamples& bracket : brackets) {
    const std::string first = bracket.paths.front().string();
    if (bracket.is_sensor || bracket.bits == 0)
      throw InputError(
          first,
          ": RAW and float files are proportional to light and need no curve; import them as they are");
    if (bracket.bits != brackets.front().bits)
      throw InputError(first, ": has a different bit depth from earlier files; give files of one kind");
    if (bracket.seconds.size() < 2)
      throw InputError(first, ": is a single exposure; photograph each view with two or more exposure times");
    require_brighter_with_time(bracket, {});
  }
  return brackets;
}

double spread_under(const std::vector<BracketSamples>& brackets, const BracketCamera& camera) {
  double squares = 0.0;
  for (const BracketSamples& bracket : brackets)
    squares += std::pow(compare_exposures(bracket, camera).spread, 2) / static_cast<double>(brackets.size());
  return std::sqrt(squares);
}

/// The response curve of the camera.
void estimate_camera_response(const ImportOptions& given, const Common& common) {
  const fs::path& output = given.request.folder;
  if (fs::exists(output) && !common.force)
    throw InputError(output, ": already exists; give --force to replace it, or another name");
  const OutputLock lock(output, {given.photographs.begin(), given.photographs.end()});
  const auto brackets = brackets_of(given);
  const ResponseEstimate estimate = estimate_response(brackets);
  BracketCamera camera;
  const double assumed = spread_under(brackets, camera);
  camera.curve = estimate.linear_from_dn;
  const double estimated = spread_under(brackets, camera);
  CameraCalibration calibration = bracket_calibration(camera, brackets.front().bits);
  // Saturation was not measured; cameras bend samples below full scale.
  const MergeOptions& margin = calibration.bits == 8 ? with_compressed_samples : with_unmeasured_saturation;
  calibration.saturation_dn = std::floor((1.0 - margin.clip_margin) * calibration.saturation_dn);
  write_calibration(output, calibration, std::nullopt);
  if (common.json)
    return print_json(Json{{"brackets", brackets.size()},
                           {"places", estimate.places},
                           {"residual", estimate.residual},
                           {"disagreement_assumed", assumed},
                           {"disagreement", estimated}});
  std::printf("%s: response estimated from %zu samples of %zu brackets\n", output.c_str(), estimate.places,
              brackets.size());
  std::printf("exposures disagree by %.1f %% with this response, by %.1f %% with %s\n", 100.0 * estimated,
              100.0 * assumed, brackets.front().bits == 8 ? "sRGB" : "a linear response");
  std::printf(
      "noise is not measured; the file contains the default noise values of 'refield acquire import'\n");
}

std::optional<double> number_or_auto(const std::string& text, const char* option) {
  if (text == "auto") return std::nullopt;
  char* end = nullptr;
  const double number = std::strtod(text.c_str(), &end);
  if (end == text.c_str() || *end != '\0' || !std::isfinite(number))
    throw InputError(option, ": '", text, "' is not valid; give a number or auto");
  return number;
}

Json figures_of(const MatchSummary& summary) {
  const auto list = [](const std::vector<LeftOut>& files) {
    Json array = Json::array();
    for (const LeftOut& file : files)
      array.push_back({{"file", file.file.string()}, {"reason", file.reason}});
    return array;
  };
  Json pairs = Json::array();
  for (const MatchedPair& pair : summary.pairs)
    pairs.push_back({{"observed", pair.observed.string()},
                     {"light", pair.probe.string()},
                     {"apart_seconds", pair.apart_seconds}});
  Json figures = {{"offset_seconds", summary.clocks.offset_seconds},
                  {"drift_ppm", 1e6 * summary.clocks.drift},
                  {"tolerance_seconds", summary.tolerance_seconds}};
  if (summary.estimate) {
    figures["correlation"] = summary.estimate->correlation;
    figures["runner_up"] = summary.estimate->runner_up;
  }
  figures["pairs"] = pairs;
  figures["observed_left_out"] = list(summary.observed_left_out);
  figures["lights_left_out"] = list(summary.probes_left_out);
  return figures;
}

void print(const MatchSummary& summary, const fs::path& folder) {
  if (summary.estimate)
    std::printf(
        "clocks, estimated from brightness: the scene camera is %.2f s ahead and gains %.1f ppm (correlation "
        "%.3f; second-best offset %.3f)\n",
        summary.clocks.offset_seconds, 1e6 * summary.clocks.drift, summary.estimate->correlation,
        summary.estimate->runner_up);
  for (const auto& [what, files] :
       {std::pair{"photograph", &summary.observed_left_out}, std::pair{"light", &summary.probes_left_out}})
    for (const LeftOut& file : *files)
      std::printf("left out: %s %s: %s\n", what, file.file.c_str(), file.reason.c_str());
  double sum = 0.0, most = 0.0;
  for (const MatchedPair& pair : summary.pairs) {
    sum += std::abs(pair.apart_seconds);
    most = std::max(most, std::abs(pair.apart_seconds));
  }
  std::printf(
      "%s: %zu pairs, %.2f s apart on average, %.2f s at most; left out: %zu photographs, %zu lights\n",
      folder.c_str(), summary.pairs.size(), sum / static_cast<double>(summary.pairs.size()), most,
      summary.observed_left_out.size(), summary.probes_left_out.size());
}

/// HDR photographs, paired with light maps by their times.
void match_by_time(const ImportOptions& options, const Common& common) {
  if (options.photographs.size() != 1)
    throw InputError("--pair-by time takes one folder or quoted pattern of HDR photographs (.exr)");
  MatchRequest request;
  request.observed = options.photographs.front();
  request.probes = options.light;
  request.folder = options.request.folder;
  request.if_exists = options.request.if_exists;
  request.test_every = options.request.test_every;
  request.offset_seconds = number_or_auto(options.offset, "--offset");
  request.drift_ppm = number_or_auto(options.drift, "--drift");
  request.tolerance_seconds = options.max_gap;
  request.parameterisation = parameterisation_of(options.parameterisation, options.light);
  if (!options.mask.empty()) request.mask = options.mask;
  const OutputLock lock(request.folder, {});
  if (request.if_exists == IfExists::replace)
    require_outside(request.folder, {request.observed, request.probes, options.mask});
  const MatchSummary summary = match_series(request, run_context());
  if (common.json)
    print_json(figures_of(summary));
  else
    print(summary, request.folder);
}

/// Options that say what is known of the camera behind bracketed image files.
void add_bracket_camera(CLI::App& verb, BracketCamera& camera) {
  verb.add_option("--response", camera.response,
                  "Response of the camera: linear, srgb, gamma:X (sample = light^(1/X)) or a "
                  "calibration.toml (default: as PNG chunks and ICC profiles state it, else srgb for 8-bit "
                  "files and linear for others; estimated if the exposures contradict it)");
  verb.add_option("--layout", camera.layout,
                  "Layout of one-channel files: grey, bayer_rggb (or bayer), bayer_grbg, bayer_gbrg or "
                  "bayer_bggr (default: grey; for camera RAW files, from the file)")
      ->check(CLI::IsMember({"grey", "bayer", "bayer_rggb", "bayer_grbg", "bayer_gbrg", "bayer_bggr"}))
      ->group(further);
  verb.add_option("--black", camera.black,
                  "Black level of the camera in linearised sample units (default: from RAW files, else 0)")
      ->group(further);
  add_saturation_option(verb, camera.saturation);
}

void run_import(ImportOptions& options, const Common& common) {
  options.request.if_exists = if_exists(options.request.if_exists, common);
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
  on_command(*verb, options, common, action, run_import);
}

}  // namespace refield::cli
