// SPDX-License-Identifier: Apache-2.0
// refield acquire match: two series of photographs, of the scene and of the light, matched by time into a
// session.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "acquire/series/match_series.h"
#include "cli/acquire/capture_report.h"
#include "cli/common/options.h"
#include "cli/run_context.h"
#include "cli/verbs.h"
#include "core/base/errors.h"
#include "core/base/output_lock.h"

namespace refield::cli {

namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

struct MatchOptions {
  MatchRequest request;
  std::string offset = "0";
  std::string drift = "0";
  std::optional<double> tolerance;
  std::string parameterisation = "lat_long";
  fs::path mask;
};

std::optional<double> number_or_auto(const std::string& text, const char* option) {
  if (text == "auto") return std::nullopt;
  char* end = nullptr;
  const double number = std::strtod(text.c_str(), &end);
  if (end == text.c_str() || *end != '\0' || !std::isfinite(number))
    throw InputError(std::string(option) + ": '" + text + "' is not valid; give a number or auto");
  return number;
}

ordered_json figures_of(const MatchSummary& summary) {
  const auto list = [](const std::vector<LeftOut>& files) {
    ordered_json array = ordered_json::array();
    for (const LeftOut& file : files)
      array.push_back({{"file", file.file.string()}, {"reason", file.reason}});
    return array;
  };
  ordered_json pairs = ordered_json::array();
  for (const MatchedPair& pair : summary.pairs)
    pairs.push_back({{"observed", pair.observed.string()},
                     {"light", pair.probe.string()},
                     {"apart_seconds", pair.apart_seconds}});
  ordered_json figures = {{"offset_seconds", summary.clocks.offset_seconds},
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

void match(const MatchOptions& options, const Common& common) {
  MatchRequest request = options.request;
  request.offset_seconds = number_or_auto(options.offset, "--offset");
  request.drift_ppm = number_or_auto(options.drift, "--drift");
  request.tolerance_seconds = options.tolerance;
  request.parameterisation = parameterisation_from_name(options.parameterisation);
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

}  // namespace

void add_acquire_match(CLI::App& group, const Common& common, Action& action) {
  const auto options = std::make_shared<MatchOptions>();
  MatchRequest& request = options->request;
  CLI::App* verb = group.add_subcommand(
      "match",
      "Pair scene photographs with light maps by capture time.\n"
      "\n"
      "Writes a capture session from the photographs of two cameras with separate clocks (the outdoor setup "
      "of the paper). Times are read from times.tsv in the folder, else from the metadata of the files, else "
      "from their names (IMG_20040621_123005, 2004-06-21T12.30.05). Each photograph is paired with the light "
      "map closest in time. Files without a partner are listed, as are files that 'refield acquire probe' "
      "discarded.\n"
      "\n"
      "Examples:\n"
      "  refield acquire match --observed city --lights sky -o session --tolerance 20\n"
      "  refield acquire match --observed city --lights sky -o session --offset auto --drift auto\n"
      "  refield acquire match --observed hdr --lights patterns --parameterisation monitor \\\n"
      "      --offset auto -o session");
  verb->add_option("--observed", request.observed,
                   "Photographs of the scene (.exr): folder or quoted pattern")
      ->required();
  verb->add_option("--lights", request.probes,
                   "Light maps (.exr, or .png as shown on a monitor): folder or quoted pattern")
      ->required();
  verb->add_option("--parameterisation", options->parameterisation,
                   "Parameterisation of the light maps: lat_long, monitor or cube")
      ->capture_default_str();
  verb->add_option("-o,--output", request.folder, "Session folder to create")->required();
  verb->add_option("--offset", options->offset,
                   "Offset in seconds of the scene camera's clock relative to the clock of the light maps; "
                   "auto: estimated from the brightness of both series")
      ->capture_default_str();
  verb->add_option(
          "--drift", options->drift,
          "Drift of the scene camera's clock in parts per million; auto: estimated, requires --offset auto")
      ->capture_default_str();
  verb->add_option("--largest-offset", request.largest_offset_seconds,
                   "Largest offset in seconds that --offset auto searches")
      ->check(positive_number())
      ->capture_default_str();
  verb->add_option("--tolerance", options->tolerance,
                   "Maximum time in seconds between a photograph and its light map (default: half the median "
                   "interval of the light maps)")
      ->check(non_negative_number());
  verb->add_option("--test-every", request.test_every, "Hold out every N-th pair for validation; 0: none")
      ->check(non_negative_number())
      ->capture_default_str();
  verb->add_option("--mask", options->mask, "Mask image, white where the scene is (default: all pixels)");
  add_if_exists(*verb, request.if_exists, "a session");
  verb->callback([options, &common, &action] { action = [options, &common] { match(*options, common); }; });
}

}  // namespace refield::cli
