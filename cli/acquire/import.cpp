// SPDX-License-Identifier: Apache-2.0
// refield acquire import: bracketed photographs of other tools to a capture session or a series of HDR
// photographs.
#include <algorithm>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "acquire/exposure_plan.h"
#include "acquire/import/import_series.h"
#include "cli/acquire/if_exists.h"
#include "cli/acquire/verbs.h"
#include "cli/bracket_options.h"
#include "cli/option_checks.h"
#include "core/errors.h"
#include "core/files.h"
#include "core/json_text.h"
#include "core/output_lock.h"

namespace refield::cli {

namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

struct ImportOptions {
  ImportRequest request;
  std::vector<std::string> photographs;
  std::string ambient;
  std::string lights;
  std::string lights_by;
  std::string lights_hold = "radiance";
  std::string parameterisation = "monitor";
  std::vector<double> exposures;
  fs::path mask;
  bool half = false;
};

ImportRequest request_of(const ImportOptions& options) {
  ImportRequest request = options.request;
  request.photographs = expand_globs(options.photographs);
  if (!options.ambient.empty()) request.ambient = expand_globs({options.ambient});
  if (!options.lights.empty()) request.lights = expand_globs({options.lights});
  for (double seconds : options.exposures) request.exposures.emplace_back(seconds);
  request.lights_by_order =
      options.lights_by.empty() ? request.rule.pattern.empty() : options.lights_by == "order";
  if (options.lights_hold == "drive") {
    request.light_content = LightContent::drive_levels;
    if (request.monitor.empty() && fs::is_regular_file(request.camera.response))
      request.monitor = request.camera.response;
  }
  request.parameterisation = parameterisation_from_name(options.parameterisation);
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
  if (summary.found_done > 0) std::printf(", %zu steps of an earlier run taken over", summary.found_done);
  std::printf("; %zu state when they were taken\n", summary.timed);
  for (const std::string& note : summary.notes) std::printf("note: %s\n", note.c_str());
  if (summary.useful_fraction.empty()) return;
  std::printf("exposures:");
  for (std::size_t i = 0; i < summary.exposures.size(); ++i)
    std::printf(" %.4g s (useful for %.1f %% of the samples)%s", summary.exposures[i].count(),
                100.0 * summary.useful_fraction[i], i + 1 < summary.exposures.size() ? "," : "\n");
  std::printf("clipped in every exposure: %.3f %% of the samples\n", 100.0 * summary.clipped_fraction);
  if (std::ranges::is_sorted(summary.exposures))
    for (const std::string& sentence : wasted_exposures(summary.exposures, summary.useful_fraction))
      std::printf("note: %s\n", sentence.c_str());
}

void run_import(const ImportOptions& options, const Common& common) {
  const ImportRequest request = request_of(options);
  const OutputLock lock(request.folder, {});
  if (request.if_exists == IfExists::replace) {
    std::vector<fs::path> inputs = {options.mask, options.lights, options.ambient};
    inputs.insert(inputs.end(), options.photographs.begin(), options.photographs.end());
    require_outside(request.folder, inputs);
  }
  const ImportSummary summary = import_series(request);
  if (common.json)
    std::printf("%s\n", json_text(figures_of(summary), 2).c_str());
  else
    print(summary, request.folder);
}

}  // namespace

void add_acquire_import(CLI::App& group, const Common& common, Action& action) {
  const auto options = std::make_shared<ImportOptions>();
  ImportRequest& request = options->request;
  CLI::App* verb = group.add_subcommand(
      "import",
      "Merge bracketed photographs of other tools: with --lights into a capture session for 'refield "
      "estimate',\n"
      "without into a folder of HDR photographs (.exr) with their times, for 'acquire probe' and 'acquire "
      "match'.\n"
      "TIFF, PNG, JPEG, EXR and cameras' RAW files; exposure times from EXIF. docs/guide/import.md explains "
      "the rules.\n\n"
      "Which files make a bracket: --pattern by name, --count so many at a time, else a time that comes "
      "again\n"
      "begins the next bracket. Which light belongs to it: its name (with --pattern), else the order of "
      "names.\n\n"
      "Examples:\n"
      "  refield acquire import shots --lights lights --pattern '{light}_e*.tif' --response calibration.toml "
      "-o session\n"
      "  refield acquire import shots --lights shown --lights-hold drive --count 4 --ambient 'dark/*.tif' "
      "\\\n"
      "      --response calibration.toml -o session\n"
      "  refield acquire import shots --lights patterns --ambient-first -o session     shown by 'acquire "
      "show'\n"
      "  refield acquire import roof -o roof-hdr                                       cameras' RAW files\n");
  verb->add_option("photographs", options->photographs, "Photographs: folders, files or quoted patterns")
      ->required();
  verb->add_option("-o,--output", request.folder, "Session folder, or folder for photographs")->required();
  verb->add_option(
      "--pattern", request.rule.pattern,
      "Of file names: {light} stands for the view's name, * and ? for anything, as in '{light}_e*.tif'");
  verb->add_option("--count", request.rule.count, "So many files, in the order of names, make a bracket")
      ->check(positive_number());
  verb->add_option(
          "--exposures", options->exposures,
          "Exposure times of a bracket's files in seconds, separated by commas, in the order of names\n"
          "(default: as the files' metadata state them)")
      ->delimiter(',');
  verb->add_option("--lights", options->lights, "Light maps that were shown: folder or quoted pattern");
  verb->add_option("--lights-by", options->lights_by, "Which light belongs to a bracket: name or order")
      ->check(CLI::IsMember({"name", "order"}));
  verb->add_option(
          "--lights-hold", options->lights_hold,
          "What the files of lights hold: radiance (linear, above the monitor's black; PNG is decoded from\n"
          "sRGB) or drive (8-bit levels as sent to the monitor)")
      ->check(CLI::IsMember({"radiance", "drive"}))
      ->capture_default_str();
  verb->add_option(
      "--monitor-calibration", request.monitor,
      "calibration.toml with the monitor's tone curve, for drive levels (default: that of --response)");
  verb->add_option("--parameterisation", options->parameterisation,
                   "Of the light maps: monitor, lat_long or cube")
      ->capture_default_str();
  verb->add_option(
      "--ambient", options->ambient,
      "Photographs of the ambient light, one bracket: folder or quoted pattern; subtracted from all");
  verb->add_flag("--ambient-first", request.ambient_first,
                 "The first bracket is the ambient light, as 'refield acquire show' begins with black");
  verb->add_option("--mask", options->mask, "Painted mask, white where the scene is");
  verb->add_option(
          "--test-every", request.test_every,
          "Hold out every so many frames for validation, beside those whose light is named test… (0: none)")
      ->check(non_negative_number())
      ->capture_default_str();
  add_bracket_camera(*verb, request.camera);
  verb->add_flag("--half", options->half, "Half-float photographs: half the size, rounding of 0.05 %");
  add_if_exists(*verb, request.if_exists, "what is");
  verb->callback(
      [options, &common, &action] { action = [options, &common] { run_import(*options, common); }; });
}

}  // namespace refield::cli
