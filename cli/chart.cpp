// SPDX-License-Identifier: Apache-2.0
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "cli/chart/measure.h"
#include "cli/verbs.h"
#include "core/errors.h"
#include "core/files.h"
#include "core/interrupt.h"
#include "core/progress.h"

namespace refield::cli {

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
  std::vector<std::string> methods;
  std::vector<int> images;
  std::vector<int> kernels = {10, 25};
  bool resume = false;
  EstimateOptions base;
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
  sources.clip_level = arguments.base.clip_level;
  return sources;
}

/// Those asked for; else about a seventh, a quarter, a half and all of the training images.
std::vector<int> image_counts(const ChartArguments& arguments, int available) {
  std::vector<int> counts = arguments.images;
  if (counts.empty())
    for (const int count : {25, 50, 100, 180, available})
      if (count < available || count == available) counts.push_back(count);
  std::ranges::sort(counts);
  counts.erase(std::unique(counts.begin(), counts.end()), counts.end());
  for (const int count : counts)
    if (count < 2 || count > available)
      throw InputError("--images " + std::to_string(count) + ": give numbers from 2 to the " +
                       std::to_string(available) + " training images that there are");
  return counts;
}

void run(const ChartArguments& arguments, const Common& common) {
  std::vector<std::string> methods = arguments.methods;
  if (methods.empty())
    for (const chart::Method& method : chart::all_methods()) methods.push_back(method.name);
  for (const std::string& method : methods) chart::method_named(method);
  const chart::ChartData data = chart::load_chart_data(open_sources(arguments));
  std::erase_if(methods, [&](const std::string& method) {
    const auto reason = chart::reason_against(method, data);
    if (reason && !common.quiet) std::fprintf(stderr, "%s: left out: %s\n", method.c_str(), reason->c_str());
    return reason.has_value();
  });
  const auto counts = image_counts(arguments, static_cast<int>(data.session.frames.size()));
  const auto tasks = chart::grid_of(methods, arguments.kernels, counts);
  const auto names = chart::error_names(data);
  create_folders(arguments.output);
  const fs::path csv = arguments.output / "chart.csv";
  std::vector<chart::ChartRow> rows;
  std::uint64_t work = 0;
  for (const chart::Task& task : tasks) work += static_cast<std::uint64_t>(task.images);
  Progress progress("chart", work);
  for (const chart::Task& task : tasks) {
    throw_if_interrupted();
    rows.push_back(chart::measure(task, data, arguments.base));
    write_text_atomically(csv, chart::csv_of(rows, names));
    progress.advance(static_cast<std::uint64_t>(task.images));
  }
}

}  // namespace

void add_chart(CLI::App& app, const Common& common, Action& action) {
  auto arguments = std::make_shared<ChartArguments>();
  CLI::App* verb = app.add_subcommand(
      "chart", "Chart methods and settings against one another on a data set: error, time, size, images");
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
  verb->add_option("--kinds", arguments->kinds, "Map of pixel kinds, as 'refield simulate' writes kinds.png");
  verb->add_option("-o,--output", arguments->output, "Folder to write")->required();
  verb->add_option("--methods", arguments->methods, "Of ours,paper,ridge,svd,smooth,haar,box,cells")
      ->delimiter(',');
  verb->add_option("--images", arguments->images, "Numbers of training images")->delimiter(',');
  verb->add_option("--kernels", arguments->kernels, "Kernels a pixel")->delimiter(',')->capture_default_str();
  verb->add_option("--clip", arguments->base.clip_level, "Leave out samples of at least this radiance");
  verb->add_flag("--resume", arguments->resume, "Keep the rows that are in the folder's chart.csv");
  verb->callback(
      [arguments, &common, &action] { action = [arguments, &common] { run(*arguments, common); }; });
}

}  // namespace refield::cli
