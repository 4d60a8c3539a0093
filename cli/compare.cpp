// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "cli/verbs.h"
#include "core/capture_session.h"
#include "core/drift.h"
#include "core/errors.h"
#include "core/image_io.h"
#include "core/interrupt.h"
#include "core/metrics.h"
#include "core/progress.h"
#include "core/reflectance_field_file.h"
#include "relight/held_out.h"

namespace refield::cli {

namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

struct CompareOptions {
  std::string predicted;
  std::string observed;
  fs::path mask;
  fs::path truth;
  fs::path error_map;
  double noise_scale = 1.0;
};

/// JSON has no infinity; it stands as null there, as "inf" in text.
ordered_json finite_or_null(double value) {
  return std::isfinite(value) ? ordered_json(value) : ordered_json(nullptr);
}

ordered_json figures_of(const HeldOutError& error) {
  ordered_json figures = {{"images", error.images},
                          {"relative_rmse", finite_or_null(error.relative_rmse)},
                          {"median", finite_or_null(error.median)},
                          {"percentile_90", finite_or_null(error.percentile_90)},
                          {"psnr_db", finite_or_null(error.psnr_db)}};
  if (error.prediction)
    figures["predicted_error"] = {{"rank_correlation", finite_or_null(error.prediction->rank_correlation)},
                                  {"median_ratio", finite_or_null(error.prediction->median_ratio)},
                                  {"median", finite_or_null(error.prediction->predicted_median)}};
  return figures;
}

void print_prediction(const std::vector<HeldOutError>& errors) {
  if (errors.empty() || !errors.front().prediction) return;
  std::printf("\n%-16s %16s %22s %10s\n", "predicted error", "rank correlation", "predicted/true, median",
              "median");
  for (const HeldOutError& error : errors)
    std::printf("%-16s %16.3f %22.3f %10.4f\n", error.kind.empty() ? "all" : error.kind.c_str(),
                error.prediction->rank_correlation, error.prediction->median_ratio,
                error.prediction->predicted_median);
}

void print_header() {
  std::printf("%-16s %6s %14s %10s %10s %10s\n", "", "images", "relative RMSE", "median", "90 %", "PSNR dB");
}

void print_row(const std::string& label, const HeldOutError& error) {
  std::printf("%-16s %6zu %14.4f %10.4f %10.4f %10.2f\n", label.c_str(), error.images, error.relative_rmse,
              error.median, error.percentile_90, error.psnr_db);
}

/// Checks only pixels that count.
void require_comparable(const Photograph& photograph, const fs::path& path, const Mask& mask) {
  Image counted = photograph.radiance;
  for (std::size_t p = 0; p < mask.size() && p < counted.pixel_count(); ++p)
    if (!mask[p]) std::fill_n(counted.values.begin() + 3 * p, 3, 0.0f);
  require_finite(counted, path.string(), true, "repair that pixel, or leave it out by --mask");
}

Photograph read_for_comparison(const fs::path& path) {
  // Integer formats carry no noise estimate; floats may.
  const std::string extension = path.extension().string();
  if (extension == ".exr") return read_photograph(path);
  return {read_image(path), {}};
}

void compare_images(const CompareOptions& options, const Common& common) {
  if (!options.truth.empty()) throw InputError("--truth goes with a field and a session, not with images");
  const auto pairs = pair_files(options.predicted, options.observed, "prediction", "observed image");
  const ImageHeader first = read_image_header(pairs.front().second);
  const Mask mask = options.mask.empty() ? Mask{} : read_mask(options.mask, first.width, first.height);
  SeriesError series(mask);
  Progress progress("compare", pairs.size());
  for (const auto& [predicted_path, observed_path] : pairs) {
    throw_if_interrupted();
    const Photograph predicted = read_for_comparison(predicted_path);
    const Photograph observed = read_for_comparison(observed_path);
    if (!predicted.radiance.same_shape(observed.radiance))
      throw InputError(predicted_path.string() + ": is " + shape_text(predicted.radiance) + ", " +
                       observed_path.string() + " is " + shape_text(observed.radiance) +
                       "; compare images of one size");
    require_comparable(predicted, predicted_path, mask);
    require_comparable(observed, observed_path, mask);
    series.add(predicted.radiance, observed.radiance, observed.sigma);
    progress.advance();
  }
  const HeldOutError error{"",
                           series.images(),
                           series.relative_rmse(),
                           series.pixel_quantile(0.5),
                           series.pixel_quantile(0.9),
                           series.psnr_db(),
                           std::nullopt};
  if (!options.error_map.empty()) write_exr(options.error_map, series.relative_rmse_map());
  if (common.json) {
    std::printf("%s\n", figures_of(error).dump(2).c_str());
  } else {
    print_header();
    print_row("all", error);
  }
}

void compare_field(const CompareOptions& options, const Common& common) {
  if (!options.error_map.empty())
    throw InputError("-o goes with images: compare relit images to get an error map");
  CaptureSession session = read_capture_session(options.observed);
  if (options.truth.empty()) remove_drift(session);
  if (!options.mask.empty()) session.mask = options.mask;
  const ReflectanceField field = read_image_field(options.predicted);
  std::optional<ReflectanceField> truth;
  if (!options.truth.empty()) truth = read_image_field(options.truth);
  if (!(options.noise_scale >= 0.0))
    throw InputError("--noise-scale is " + std::to_string(options.noise_scale) + "; give 0 or more");
  const auto errors =
      held_out_errors(field, session, truth ? &*truth : nullptr, FrameRole::test, options.noise_scale);
  if (common.json) {
    ordered_json kinds = ordered_json::object();
    for (const HeldOutError& error : errors) kinds[error.kind] = figures_of(error);
    std::printf("%s\n", ordered_json{{"held_out", kinds}}.dump(2).c_str());
    return;
  }
  print_header();
  for (const HeldOutError& error : errors) print_row(error.kind.empty() ? "all" : error.kind, error);
  print_prediction(errors);
}

}  // namespace

void add_compare(CLI::App& app, const Common& common, Action& action) {
  const auto options = std::make_shared<CompareOptions>();
  CLI::App* verb = app.add_subcommand("compare",
                                      "Measure how far predicted images are from observed ones: relative "
                                      "RMSE sqrt(Σ(p − o)² / Σo²) over everything, "
                                      "its median and 90th percentile over pixels, and PSNR");
  verb->add_option(
          "predicted", options->predicted,
          "Image, quoted pattern or folder; or a field (.rfield), to be compared with a session's held-out "
          "frames")
      ->required();
  verb->add_option(
          "observed", options->observed,
          "Image, quoted pattern or folder, paired by what the wildcards stand for or by name; or a session")
      ->required();
  verb->add_option("--mask", options->mask, "Image of the observed size; pixels above one half count");
  verb->add_option("--truth", options->truth,
                   "Field whose noise-free images replace the session's photographs");
  verb->add_option("--noise-scale", options->noise_scale,
                   "Noise of held-out photographs that do not carry it (sigma), in units of the training "
                   "images';\nenters the check of a field's predicted error")
      ->capture_default_str();
  verb->add_option("-o,--output", options->error_map, "Write each pixel's relative RMSE (.exr)");
  verb->callback([options, &common, &action] {
    action = [options, &common] {
      if (fs::path(options->predicted).extension() == ".rfield")
        compare_field(*options, common);
      else
        compare_images(*options, common);
    };
  });
}

}  // namespace refield::cli
