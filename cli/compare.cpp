// SPDX-License-Identifier: Apache-2.0
#include <charconv>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "cli/common/options.h"
#include "cli/report/report.h"
#include "cli/run_context.h"
#include "cli/verbs.h"
#include "core/base/errors.h"
#include "core/base/output_lock.h"
#include "core/field/drift.h"
#include "core/field_io/reflectance_field_file.h"
#include "core/image/image_io.h"
#include "core/image/metrics.h"
#include "core/session/capture_session.h"
#include "estimate/rig/rig_model.h"
#include "relight/held_out.h"
#include "simulate/tabletop/simulate.h"

namespace refield::cli {

namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

struct CompareOptions {
  std::string predicted;
  CaptureOptions capture;  // session: the second argument, whatever it is
  fs::path truth;
  double noise_scale = 1.0;
  fs::path output;  ///< a map of errors or, of a field, a report
  std::vector<fs::path> more_fields;
  std::vector<std::string> pixels;
};

void print_prediction(const std::vector<HeldOutError>& errors) {
  if (errors.empty() || !errors.front().prediction) return;
  std::printf("\n%-16s %16s %22s %10s\n", "predicted error", "rank correlation", "median predicted/true",
              "median");
  for (const HeldOutError& error : errors)
    std::printf("%-16s %16.3f %22.3f %10.4f\n", error.kind.empty() ? "all" : error.kind.c_str(),
                error.prediction->rank_correlation, error.prediction->median_ratio,
                error.prediction->predicted_median);
}

/// Blackens pixels that do not count, and checks the others.
void require_comparable(Photograph& photograph, const fs::path& path, const Mask& mask) {
  Image& counted = photograph.radiance;
  for (std::size_t p = 0; p < mask.size() && p < counted.pixel_count(); ++p)
    if (!mask[p]) std::fill_n(counted.values.begin() + 3 * p, 3, 0.0f);
  require_finite(counted, path.string(), true, "repair that pixel or exclude it with --mask");
}

Photograph read_for_comparison(const fs::path& path) {
  // Integer formats carry no noise estimate; floats may.
  const std::string extension = path.extension().string();
  if (extension == ".exr") return read_photograph(path);
  return {read_image(path), {}};
}

void compare_images(const CompareOptions& options, const Common& common) {
  if (!options.truth.empty())
    throw InputError("--truth requires a field and a session; remove it when comparing images");
  if (options.capture.by_pairs() || options.capture.hold_out != 0)
    throw InputError(
        "--light, --observed and --hold-out require a field (.rfield); compare images with 'refield compare "
        "PREDICTED OBSERVED'");
  std::optional<OutputLock> lock;
  if (!options.output.empty())
    lock.emplace(options.output,
                 std::vector<fs::path>{options.predicted, options.capture.session, options.capture.mask},
                 ".exr");
  const auto pairs = pair_files(options.predicted, options.capture.session, "prediction", "observed image");
  const ImageHeader first = read_image_header(pairs.front().second);
  const std::string& mask_file = options.capture.mask;
  const Mask mask = mask_file.empty() ? Mask{} : read_mask(mask_file, first.width, first.height);
  SeriesError series(mask);
  std::vector<HeldOutImage> per_image;
  Progress progress(run_context(), "compare", pairs.size());
  for (const auto& [predicted_path, observed_path] : pairs) {
    run_context().throw_if_stopped();
    Photograph predicted = read_for_comparison(predicted_path);
    Photograph observed = read_for_comparison(observed_path);
    if (!predicted.radiance.same_shape(observed.radiance))
      throw InputError(predicted_path.string() + ": is " + shape_text(predicted.radiance) + ", " +
                       observed_path.string() + " is " + shape_text(observed.radiance) +
                       "; the images must have the same size");
    require_comparable(predicted, predicted_path, mask);
    require_comparable(observed, observed_path, mask);
    series.add(predicted.radiance, observed.radiance, observed.sigma);
    per_image.push_back({predicted_path.filename().string(), observed_path,
                         image_error(predicted.radiance, observed.radiance, mask, observed.sigma)});
    progress.advance();
  }
  const HeldOutError error = error_of(series, std::move(per_image));
  if (!options.output.empty()) write_exr(options.output, series.relative_rmse_map());
  if (common.json) {
    print_json(held_out_figures(error));
  } else {
    print_errors({error});
  }
}

std::array<int, 2> parse_pixel(const std::string& text) {
  std::array<int, 2> pixel{};
  const char* const end = text.data() + text.size();
  const auto x = std::from_chars(text.data(), end, pixel[0]);
  if (x.ec == std::errc{} && x.ptr != end && *x.ptr == ',') {
    const auto y = std::from_chars(x.ptr + 1, end, pixel[1]);
    if (y.ec == std::errc{} && y.ptr == end) return pixel;
  }
  throw InputError("--pixel " + text +
                   ": is not a pixel position; give column and row, for example --pixel 80,60");
}

/// The page of the fields, of which the first is the predicted one.
void write_report(const CompareOptions& options, const Common& common) {
  report::ReportRequest request;
  request.fields = {options.predicted};
  request.fields.insert(request.fields.end(), options.more_fields.begin(), options.more_fields.end());
  request.truth = fs::is_regular_file(options.truth) ? options.truth.parent_path() : options.truth;
  request.output = options.output;
  for (const std::string& pixel : options.pixels) request.pixels.push_back(parse_pixel(pixel));
  const CaptureOptions& capture = options.capture;
  std::vector<fs::path> inputs = request.fields;
  inputs.insert(inputs.end(),
                {capture.session, capture.light, capture.observed, capture.mask, request.truth});
  const OutputLock lock(request.output, inputs, ".html");
  request.session = open_capture(capture);
  request.find_held_out = capture.hold_out == 0;
  auto figures = report::write_report(request, run_context());
  const std::string path = request.output.string();
  if (common.json) {
    figures["report"] = path;
    print_json(figures);
  } else {
    std::printf("report: %s\n", path.c_str());
  }
}

void compare_field(const CompareOptions& options, const Common& common) {
  if (options.output.extension() == ".html") return write_report(options, common);
  if (!options.output.empty())
    throw InputError("--output " + options.output.string() +
                     ": a field is compared in a page; give the name of a page (.html)");
  CaptureSession session = open_capture(options.capture);
  if (session.folder.empty()) check_image_sizes(session);
  if (options.truth.empty()) remove_drift(session, run_context());
  const ReflectanceField field = read_image_field(options.predicted, run_context());
  find_held_out(options.capture, field, session);
  correct_held_out(field.provenance, session);
  std::optional<ReflectanceField> truth;
  if (!options.truth.empty())
    truth = read_image_field(
        fs::is_directory(options.truth) ? options.truth / transport_file_name : options.truth, run_context());
  const auto errors = held_out_errors(field, session, truth ? &*truth : nullptr, FrameRole::test,
                                      options.noise_scale, run_context());
  if (const std::string warning = training_warning(errors); !warning.empty()) run_context().note(warning);
  if (common.json) {
    print_json(ordered_json{{"held_out", held_out_figures(errors)}});
    return;
  }
  print_errors(errors);
  print_prediction(errors);
}

}  // namespace

void add_compare(CLI::App& app, const Common& common, Action& action) {
  const auto options = std::make_shared<CompareOptions>();
  CLI::App* verb = app.add_subcommand(
      "compare",
      "Measure the error of fields or images against photographs.\n"
      "\n"
      "Prints the relative RMSE sqrt(Σ(p − o)² / Σo²) over all samples, its median and 90th percentile over "
      "the pixels, and the PSNR of the tone-mapped images (99th percentile white, sRGB). A field is compared "
      "with the photographs that it was not estimated from; the report of a field (.html) shows errors, "
      "images, "
      "kernels and timings. --json adds the error of each image.\n"
      "\n"
      "Examples:\n"
      "  refield compare scene.rfield session\n"
      "  refield compare scene.rfield session -o report.html\n"
      "  refield compare scene.rfield --light 'light/*.exr' --observed 'observed/*.exr'\n"
      "  refield compare 'out/*.exr' 'observed/*.exr' -o error.exr");
  verb->add_option("predicted", options->predicted,
                   "Field (.rfield), or predicted images (file, quoted pattern or folder)")
      ->required();
  verb->add_option("session", options->capture.session,
                   "Capture session (folder) whose held-out photographs the field predicts; or observed "
                   "images (file, quoted "
                   "pattern or folder), paired by the text that the wildcards match or by name");
  verb->add_option(
      "-o,--output", options->output,
      "Report of a field to write (.html), or image with the relative RMSE of each pixel (.exr)");
  verb->add_option(
      "--field", options->more_fields,
      "Reflectance field (.rfield) of the same session, for the report; repeat the option for each");
  add_capture_options(*verb, options->capture);
  verb->add_option("--truth", options->truth,
                   "Folder that 'refield simulate' created (or its transport.rfield): adds errors against "
                   "noise-free images");
  verb->add_option(
          "--pixel", options->pixels,
          "Column,row of a pixel whose kernels the report shows; repeat the option for each (default: one "
          "pixel per pixel class)")
      ->group(further);
  verb->add_option("--noise-scale", options->noise_scale,
                   "Noise of held-out photographs without a stored standard deviation (sigma), relative to "
                   "the noise of "
                   "the training images; used to check the predicted error of a field")
      ->check(non_negative_number())
      ->capture_default_str()
      ->group(further);
  verb->callback([options, &common, &action] {
    action = [options, &common] {
      if (fs::path(options->predicted).extension() == ".rfield")
        compare_field(*options, common);
      else if (options->capture.session.empty() && !options->capture.by_pairs())
        throw InputError("no observed images are given; compare " + options->predicted +
                         " with images as 'refield compare PREDICTED OBSERVED', or with a session");
      else
        compare_images(*options, common);
    };
  });
}

}  // namespace refield::cli
