// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/chart/chart.h"

#include <cmath>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "bench/studies/chart/verdict.h"
#include "bench/studies/studies.h"
#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/base/json.h"
#include "core/base/output_lock.h"

namespace refield::studies {

namespace {

namespace fs = std::filesystem;

struct ChartArguments {
  std::string session;
  std::string light, observed, test_light, test_observed;
  std::string parameterisation = "monitor";
  std::string mask;
  fs::path truth;
  fs::path kinds;
  fs::path output;
  chart::ChartOptions options;
};

chart::Sources open_sources(const ChartArguments& arguments) {
  const bool by_globs = !arguments.light.empty() || !arguments.observed.empty();
  if (by_globs == !arguments.session.empty())
    throw InputError(
        "give either a SESSION folder, or --light, --observed, --test-light and --test-observed");
  if (by_globs && (arguments.light.empty() || arguments.observed.empty() || arguments.test_light.empty() ||
                   arguments.test_observed.empty()))
    throw InputError(
        "--light, --observed, --test-light and --test-observed go together: patterns of light maps and "
        "photographs, to estimate from and to compare with");
  chart::Sources sources;
  const auto parameterisation = parameterisation_from_name(arguments.parameterisation);
  if (by_globs) {
    sources.session = pair_by_globs(arguments.light, arguments.observed, parameterisation);
    sources.test = pair_by_globs(arguments.test_light, arguments.test_observed, parameterisation);
  } else {
    sources.session = read_capture_session(arguments.session);
  }
  if (!arguments.mask.empty()) sources.session.mask = arguments.mask;
  sources.truth = arguments.truth;
  if (!arguments.kinds.empty()) sources.kinds = arguments.kinds;
  sources.clip_level = arguments.options.estimate.clip_level;
  return sources;
}

Json json_of(const chart::ChartResult& result, const std::vector<chart::Verdict>& verdicts,
             const fs::path& folder) {
  Json json = {{"folder", folder.string()},
               {"rows", result.rows.size()},
               {"kept_rows", result.kept_rows},
               {"reference", result.reference_note},
               {"pixel_kinds", result.kinds_note}};
  json["left_out"] = Json::object();
  for (const auto& [method, reason] : result.left_out) json["left_out"][method] = reason;
  const auto number = [](double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); };
  for (const chart::Verdict& verdict : verdicts)
    json["verdicts"].push_back({{"images", verdict.images},
                                {"measure", verdict.measure},
                                {"best", verdict.best},
                                {"error", number(verdict.error)},
                                {"ours", number(verdict.ours)},
                                {"best_other", verdict.rival},
                                {"best_other_error", number(verdict.rival_error)},
                                {"ours_is_best", verdict.ours_is_best()}});
  return json;
}

void run(const ChartArguments& arguments, const Common& common) {
  const OutputLock lock(arguments.output, {});
  const chart::ChartResult result =
      chart::make_chart(open_sources(arguments), arguments.options, arguments.output);
  const auto verdicts = chart::verdicts_of(result.rows, result.names);
  const auto json = json_of(result, verdicts, arguments.output);
  write_text_atomically(arguments.output / "chart.json", json_text(json, 2) + "\n");
  if (common.json) {
    std::printf("%s\n", json_text(json, 2).c_str());
    return;
  }
  for (const auto& [method, reason] : result.left_out)
    std::printf("%s: not available: %s\n", method.c_str(), reason.c_str());
  std::printf("Relative RMSE against %s; %s.\n\n", result.reference_note.c_str(), result.kinds_note.c_str());
  std::printf("%s\n", chart::verdict_table(verdicts, result.rows.back().images).c_str());
  std::printf("%s: %zu rows in chart.csv; verdicts for every number of images in chart.json\n",
              arguments.output.c_str(), result.rows.size());
}

}  // namespace

void add_chart(CLI::App& app, const Common& common, Action& action) {
  auto arguments = std::make_shared<ChartArguments>();
  CLI::App* verb = app.add_subcommand(
      "chart", "Compare methods of estimation on a data set: error, time, size, number of images");
  verb->footer(
      "Examples:\n"
      "  refield-studies chart session --truth truth -o chart\n"
      "  refield-studies chart --light 'light/train_*.exr' --observed 'observed/train_*.exr'\n"
      "                        --test-light 'light/test_*.exr' --test-observed 'observed/test_*.exr' -o "
      "chart\n"
      "Writes chart.csv and chart.json. docs/method/chart.md describes the methods.");
  verb->add_option("session", arguments->session, "Capture session folder with held-out frames");
  verb->add_option("--light", arguments->light, "Light maps to estimate from: pattern in quotes, or folder");
  verb->add_option("--observed", arguments->observed, "Their photographs");
  verb->add_option("--test-light", arguments->test_light, "Light maps to compare under");
  verb->add_option("--test-observed", arguments->test_observed, "Their photographs");
  verb->add_option("--parameterisation", arguments->parameterisation,
                   "Of the light maps: monitor, lat_long or cube")
      ->capture_default_str();
  verb->add_option("--mask", arguments->mask, "Image that is bright where the scene is");
  verb->add_option(
      "--truth", arguments->truth,
      "Folder that 'refield simulate' wrote, or its transport: exact images replace photographs");
  verb->add_option(
      "--kinds", arguments->kinds,
      "Recipe of the simulated scene (.toml), which tells the pixel classes, or a map of them (.png)");
  verb->add_option("-o,--output", arguments->output, "Folder to write")->required();
  verb->add_option("--methods", arguments->options.methods, "Of ours,paper,ridge,svd,smooth,haar,box,cells")
      ->delimiter(',');
  verb->add_option("--images", arguments->options.images, "Numbers of training images")->delimiter(',');
  verb->add_option("--max-kernels", arguments->options.kernels, "Kernels a pixel")
      ->delimiter(',')
      ->capture_default_str();
  verb->add_option("--clip", arguments->options.estimate.clip_level,
                   "Leave out samples of at least this radiance");
  verb->add_flag("--resume", arguments->options.resume, "Keep the rows that are in the folder's chart.csv");
  verb->add_option("--redo", arguments->options.redo, "With --resume: measure the rows of these methods anew")
      ->delimiter(',');
  verb->callback(
      [arguments, &common, &action] { action = [arguments, &common] { run(*arguments, common); }; });
}

}  // namespace refield::studies
