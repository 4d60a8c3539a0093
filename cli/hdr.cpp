// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "acquire/bracket_files.h"
#include "acquire/calibration.h"
#include "acquire/exposure_plan.h"
#include "acquire/hdr_merge.h"
#include "cli/verbs.h"
#include "core/errors.h"
#include "core/files.h"

namespace refield::cli {

namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

struct HdrOptions {
  std::vector<std::string> images;
  fs::path output;
  std::vector<double> exposures;
  std::string response;
  std::string layout = "grey";
  std::optional<double> black;
  std::optional<double> saturation;
  double full_scale_electrons = 20000.0;
  double read_noise_electrons = 5.0;
  bool half = false;
};

struct Bracket {
  std::vector<fs::path> paths;
  std::vector<BracketFile> files;
  std::vector<Seconds> exposures;
};

/// Times from the option or, for all images, from their metadata.
std::vector<Seconds> exposures_of(const HdrOptions& options, const Bracket& bracket) {
  std::vector<Seconds> exposures;
  if (!options.exposures.empty()) {
    if (options.exposures.size() != bracket.files.size())
      throw InputError("--exposures gives " + std::to_string(options.exposures.size()) + " times for " +
                       std::to_string(bracket.files.size()) +
                       " images; give one time for each image, in order");
    for (double seconds : options.exposures) exposures.emplace_back(seconds);
    return exposures;
  }
  for (std::size_t i = 0; i < bracket.files.size(); ++i) {
    const BracketFile& file = bracket.files[i];
    if (!file.exposure)
      throw InputError(bracket.paths[i].string() +
                       ": does not state its exposure time; give the times of all images with --exposures");
    if (file.iso != bracket.files[0].iso)
      throw InputError(bracket.paths[i].string() + ": was taken at another ISO speed than " +
                       bracket.paths[0].string() + "; give times multiplied by speed with --exposures");
    exposures.push_back(*file.exposure);
  }
  return exposures;
}

PixelLayout layout_of(const std::string& name) {
  const auto place = std::ranges::find(layout_names, name) - layout_names.begin();
  return name == "bayer" ? PixelLayout::bayer_rggb : static_cast<PixelLayout>(place);
}

Bracket read_bracket(const HdrOptions& options) {
  Bracket bracket;
  for (const std::string& pattern : options.images) {
    if (fs::is_regular_file(pattern))
      bracket.paths.emplace_back(pattern);
    else
      for (const GlobMatch& match : expand_glob(pattern)) bracket.paths.push_back(match.path);
  }
  const PixelLayout one_channel = layout_of(options.layout);
  for (const fs::path& path : bracket.paths) {
    bracket.files.push_back(read_bracket_file(path, one_channel));
    const BracketFile& first = bracket.files.front();
    const BracketFile& file = bracket.files.back();
    if (file.bits != first.bits || file.frame.layout != first.frame.layout ||
        file.frame.width != first.frame.width || file.frame.height != first.frame.height ||
        !file.linear.same_shape(first.linear))
      throw InputError(path.string() + ": differs in size, bits or channels from " +
                       bracket.paths.front().string() + "; merge exposures of one camera and one view");
  }
  bracket.exposures = exposures_of(options, bracket);
  return bracket;
}

/// Camera of ordinary files: radiance 1 fills the range in one second.
CameraCalibration calibration_of(const HdrOptions& options, int bits) {
  const std::string response = options.response.empty() ? (bits == 8 ? "srgb" : "linear") : options.response;
  if (fs::is_regular_file(response)) return read_camera_calibration(response);
  CameraCalibration camera;
  camera.bits = bits;
  if (response == "linear") {
    camera.linear_from_dn = linear_response(bits);
  } else if (response == "srgb") {
    camera.linear_from_dn = srgb_response(bits);
  } else if (response.starts_with("gamma:")) {
    char* end = nullptr;
    const double gamma = std::strtod(response.c_str() + 6, &end);
    if (*end != '\0' || !(gamma >= 0.1 && gamma <= 10.0))
      throw InputError("--response " + response + ": give a gamma from 0.1 to 10, for example gamma:2.2");
    camera.linear_from_dn = gamma_response(bits, gamma);
  } else {
    throw InputError("--response " + response +
                     ": is neither linear, srgb, gamma:X nor an existing calibration file");
  }
  const double full = camera.linear_from_dn.back();
  camera.black_level_dn = options.black.value_or(0.0);
  camera.saturation_dn = options.saturation.value_or(full);
  camera.electrons_per_dn = options.full_scale_electrons / full;
  camera.read_noise_electrons = options.read_noise_electrons;
  camera.electrons_per_radiance_second = options.full_scale_electrons;
  camera.check("--black, --saturation and noise options");
  return camera;
}

Photograph merge(const HdrOptions& options, Bracket& bracket, MergeStatistics& statistics) {
  if (bracket.files[0].bits == 0) {
    if (!options.response.empty() && options.response != "linear")
      throw InputError("--response " + options.response + ": float images are linear already; leave it out");
    LinearSensor sensor;
    sensor.black = options.black.value_or(0.0);
    sensor.saturation = options.saturation.value_or(1.0);
    sensor.electrons_per_value = options.full_scale_electrons;
    sensor.read_noise_electrons = options.read_noise_electrons;
    std::vector<Image> images;
    for (std::size_t i = 0; i < bracket.files.size(); ++i) {
      require_finite(bracket.files[i].linear, bracket.paths[i].string(), true, "repair that pixel");
      images.push_back(std::move(bracket.files[i].linear));
    }
    return merge_linear_exposures(images, bracket.exposures, sensor, {}, &statistics);
  }
  std::vector<RawFrame> frames;
  for (std::size_t i = 0; i < bracket.files.size(); ++i) {
    frames.push_back(std::move(bracket.files[i].frame));
    frames.back().exposure = bracket.exposures[i];
  }
  return merge_exposures(frames, calibration_of(options, bracket.files[0].bits), {}, &statistics);
}

void hdr(const HdrOptions& options, const Common& common) {
  Bracket bracket = read_bracket(options);
  for (const fs::path& path : bracket.paths)
    if (std::error_code error; fs::equivalent(path, options.output, error))
      throw InputError(options.output.string() + ": is also an input; give another output");
  MergeStatistics statistics;
  const Photograph merged = merge(options, bracket, statistics);
  write_photograph(options.output, merged, options.half ? Precision::half : Precision::single);

  ordered_json images = ordered_json::array();
  for (std::size_t i = 0; i < bracket.paths.size(); ++i)
    images.push_back({{"file", bracket.paths[i].string()},
                      {"seconds", bracket.exposures[i].count()},
                      {"useful_fraction", statistics.useful_fraction[i]}});
  if (common.json) {
    std::printf(
        "%s\n",
        ordered_json{{"images", images}, {"clipped_fraction", statistics.clipped_fraction}}.dump(2).c_str());
    return;
  }
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
      "Merge bracketed exposures of one view into a photograph of linear radiance (.exr) with the standard\n"
      "deviation of every sample (channels sigma.R, sigma.G, sigma.B; infinite where all exposures clip).\n"
      "Radiance 1 fills the range of the images in one second.\n\n"
      "Examples:\n"
      "  refield hdr a.tif b.tif c.tif -o view.exr --exposures 0.01,0.04,0.16\n"
      "  refield hdr 'IMG_*.jpg' -o view.exr                    sRGB files with EXIF exposure times\n"
      "  refield hdr 'session/raw/train_000_*.png' -o f.exr --exposures 0.01,0.04 \\\n"
      "      --response session/calibration.toml                raw frames that 'refield acquire --keep-raw' "
      "kept");
  verb->add_option(
          "images", options->images,
          "PNG, TIFF, JPEG (8 or 16 bits) or EXR; files or quoted patterns, all of one size and kind")
      ->required();
  verb->add_option("-o,--output", options->output, "Photograph to write (.exr)")->required();
  verb->add_option("--exposures", options->exposures,
                   "Exposure times in seconds, separated by commas, in the order of the images\n"
                   "(default: as the files' metadata state them)")
      ->delimiter(',');
  verb->add_option(
      "--response", options->response,
      "How samples encode light: linear, srgb, gamma:X (sample = light^(1/X)) or a calibration.toml.\n"
      "Default: srgb for 8 bits, else linear");
  verb->add_option("--layout", options->layout,
                   "Of one-channel files: grey, bayer_rggb (or bayer), bayer_grbg, bayer_gbrg, bayer_bggr")
      ->check(CLI::IsMember({"grey", "bayer", "bayer_rggb", "bayer_grbg", "bayer_gbrg", "bayer_bggr"}))
      ->capture_default_str();
  verb->add_option("--black", options->black,
                   "What the camera gives without light, in linearised sample units (default 0)");
  verb->add_option("--saturation", options->saturation,
                   "Lowest sample value that may be clipped (default: the largest; 1.0 for float images)");
  verb->add_option("--full-scale-electrons", options->full_scale_electrons,
                   "Photo-electrons at full scale: sets the shot noise that weights and sigma rest on")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  verb->add_option("--read-noise", options->read_noise_electrons, "Read noise in electrons")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  verb->add_flag("--half", options->half, "Half-float output");
  verb->callback([options, &common, &action] { action = [options, &common] { hdr(*options, common); }; });
}

}  // namespace refield::cli
