// SPDX-License-Identifier: Apache-2.0
// refield acquire import --pair-by time: two series of photographs, of the scene and of the light, matched by
// time into a session.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "acquire/series/match_series.h"
#include "cli/acquire/import.h"
#include "cli/common/options.h"
#include "cli/run_context.h"
#include "cli/verbs.h"
#include "core/base/errors.h"
#include "core/base/output_lock.h"

namespace refield::cli {

namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

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

}  // namespace

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

}  // namespace refield::cli
