// SPDX-License-Identifier: Apache-2.0
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "acquire/import/bracket_merge.h"
#include "acquire/import/bracket_response.h"
#include "cli/common/options.h"
#include "cli/verbs.h"
#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/base/output_lock.h"

namespace refield::cli {

namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

struct HdrOptions {
  std::vector<std::string> images;
  fs::path output;
  std::vector<double> exposures;
  BracketCamera camera;
  bool half = false;
};

void hdr(const HdrOptions& options, const Common& common) {
  const OutputLock lock(options.output, {options.images.begin(), options.images.end()}, ".exr");
  const std::vector<Seconds> exposures(options.exposures.begin(), options.exposures.end());
  Bracket bracket = read_bracket(expand_globs(options.images), options.camera, exposures);
  BracketCamera camera = options.camera;
  const std::vector<BracketSamples> samples = {samples_of(bracket)};
  const std::vector<std::string> notes = settle_response(samples, camera);
  MergeStatistics statistics;
  const Photograph merged = merge_bracket(bracket, camera, &statistics);
  write_photograph(options.output, merged, options.half ? Precision::half : Precision::single);

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
  std::printf("%s: %.3f %% of the samples are clipped in every exposure\n", options.output.c_str(),
              100.0 * statistics.clipped_fraction);
}

}  // namespace

void add_hdr(CLI::App& app, const Common& common, Action& action) {
  const auto options = std::make_shared<HdrOptions>();
  CLI::App* verb = app.add_subcommand(
      "hdr",
      "Merge bracketed exposures of one view into a linear HDR photograph.\n"
      "\n"
      "The output (.exr) holds linear radiance and the standard deviation of each sample (channels sigma.R, "
      "sigma.G, sigma.B; infinite where all exposures are clipped). Radiance 1 fills the range of the images "
      "in one second. Exposures that contradict each other are rejected; if they contradict the assumed "
      "response curve, the curve is estimated from them (docs/guide/import.md).\n"
      "\n"
      "Examples:\n"
      "  refield hdr a.tif b.tif c.tif -o view.exr --exposures 0.01,0.04,0.16\n"
      "  refield hdr 'IMG_*.jpg' -o view.exr                # sRGB files with EXIF exposure times\n"
      "  refield hdr 'session/raw/train_000_*.png' -o f.exr --exposures 0.01,0.04 \\\n"
      "      --response session/calibration.toml            # raw frames kept by 'refield acquire'");
  verb->add_option("images", options->images,
                   "Images of one view, all of one size and file type: PNG, TIFF, JPEG (8 or 16 bits) or "
                   "EXR; files or quoted patterns")
      ->required();
  verb->add_option("-o,--output", options->output, "HDR photograph to write (.exr)")->required();
  verb->add_option("--exposures", options->exposures,
                   "Exposure times in seconds, separated by commas, in the order of the images (default: "
                   "from the metadata of the files)")
      ->delimiter(',');
  add_bracket_camera(*verb, options->camera);
  verb->add_flag("--half", options->half, "Write 16-bit half-float values (default: 32-bit)");
  verb->callback([options, &common, &action] { action = [options, &common] { hdr(*options, common); }; });
}

}  // namespace refield::cli
