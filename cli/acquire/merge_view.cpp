// SPDX-License-Identifier: Apache-2.0
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "acquire/import/bracket_merge.h"
#include "acquire/import/bracket_response.h"
#include "cli/acquire/import.h"
#include "cli/common/options.h"
#include "cli/verbs.h"
#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/base/output_lock.h"

namespace refield::cli {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

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

}  // namespace refield::cli
