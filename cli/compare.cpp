// SPDX-License-Identifier: Apache-2.0
#include <charconv>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "common/options.h"
#include "refield/compare.h"
#include "report/request.h"
#include "run_context.h"
#include "verbs.h"

namespace refield::cli {

namespace {

namespace fs = std::filesystem;
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

void compare_images(const CompareOptions& options, const Common& common) {
  if (!options.truth.empty())
    throw InputError("--truth requires a field and a session; remove it when comparing images");
  if (options.capture.by_pairs() || options.capture.hold_out != 0)
    throw InputError(
        "--light, --observed and --hold-out require a field (.rfield); compare images with 'refield compare "
        "PREDICTED OBSERVED'");
  const CaptureOptions& files = options.capture;
  std::shared_ptr<const void> reserved;
  if (!options.output.empty())
    reserved = reserve_output(options.output, {options.predicted, files.session, files.mask}, ".exr");
  const HeldOutError error = compare(options.predicted, files.session, files.mask, run_context());
  if (!options.output.empty()) write_exr(options.output, error.map);
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
  throw InputError("--pixel ", text,
                   ": is not a pixel position; give column and row, for example --pixel 80,60");
}

/// The page of the fields, of which the first is the predicted one.
void write_report(const CompareOptions& options, const Common& common) {
  std::vector<fs::path> fields = {options.predicted};
  fields.insert(fields.end(), options.more_fields.begin(), options.more_fields.end());
  const fs::path truth = fs::is_regular_file(options.truth) ? options.truth.parent_path() : options.truth;
  std::vector<std::array<int, 2>> pixels;
  for (const std::string& pixel : options.pixels) pixels.push_back(parse_pixel(pixel));
  const CaptureOptions& capture = options.capture;
  std::vector<fs::path> inputs = fields;
  inputs.insert(inputs.end(), {capture.session, capture.light, capture.observed, capture.mask, truth});
  const auto reserved = reserve_output(options.output, inputs, ".html");
  auto figures =
      report::write_report({open_capture(capture), fields, truth, pixels, options.output}, run_context());
  const std::string path = options.output.string();
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
    throw InputError("--output ", options.output,
                     ": a field is compared in a page; give the name of a page (.html)");
  const Session session = open_capture(options.capture);
  const Field field(options.predicted, run_context());
  std::optional<Field> truth;
  if (!options.truth.empty())
    truth.emplace(fs::is_directory(options.truth) ? options.truth / "transport.rfield" : options.truth,
                  run_context());
  const auto errors = compare(field, session, truth ? &*truth : nullptr, options.noise_scale, run_context());
  if (common.json) return print_json(Json{{"held_out", held_out_figures(errors)}});
  print_errors(errors);
  print_prediction(errors);
}

void run_compare(const CompareOptions& options, const Common& common) {
  if (fs::path(options.predicted).extension() == ".rfield") return compare_field(options, common);
  if (options.capture.session.empty() && !options.capture.by_pairs())
    throw InputError("no observed images are given; compare ", options.predicted,
                     " with images as 'refield compare PREDICTED OBSERVED', or with a session");
  compare_images(options, common);
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
      "images, kernels and timings. --json adds the error of each image.\n"
      "\n"
      "Examples:\n"
      "  refield compare scene.rfield session\n"
      "  refield compare scene.rfield session -o report.html\n"
      "  refield compare scene.rfield --light 'light/*.exr' --observed 'observed/*.exr'\n"
      "  refield compare 'out/*.exr' 'observed/*.exr' -o error.exr");
  verb->add_option("predicted", options->predicted,
                   "Field (.rfield), or predicted images (file, quoted pattern or folder)")
      ->required();
  verb->add_option(
      "session", options->capture.session,
      "Capture session (folder) whose held-out photographs the field predicts; or observed images (file, "
      "quoted pattern or folder), paired by the text that the wildcards match or by name");
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
  verb->add_option("--pixel", options->pixels,
                   "Column,row of a pixel whose kernels the report shows; repeat the option for each "
                   "(default: one pixel per pixel class)")
      ->group(further);
  verb->add_option("--noise-scale", options->noise_scale,
                   "Noise of held-out photographs without a stored standard deviation (sigma), relative to "
                   "the noise of the training images; used to check the predicted error of a field")
      ->check(non_negative_number())
      ->capture_default_str()
      ->group(further);
  on_command(*verb, options, common, action, run_compare);
}

}  // namespace refield::cli
