// SPDX-License-Identifier: Apache-2.0
#include "cli/report/report.h"
#include "cli/run_context.h"

#include <charconv>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "cli/common/options.h"
#include "cli/verbs.h"
#include "core/base/errors.h"
#include "core/base/output_lock.h"

namespace refield::cli {

namespace {

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

}  // namespace

void add_report(CLI::App& app, const Common& common, Action& action) {
  struct Options {
    CaptureOptions capture;
    report::ReportRequest request;
    std::vector<std::string> pixels;
  };
  const auto options = std::make_shared<Options>();
  report::ReportRequest& request = options->request;
  CLI::App* verb = app.add_subcommand(
      "report",
      "Write an HTML report on the relighting quality of reflectance fields.\n"
      "\n"
      "The page shows errors, images, kernels and timings on the held-out photographs of a session.\n"
      "\n"
      "Example:\n"
      "  refield report session --field scene.rfield -o report.html");
  verb->add_option("session", options->capture.session,
                   "Capture session folder whose held-out photographs are predicted");
  verb->add_option("--field", request.fields,
                   "Reflectance field estimated from the session; give several to compare them")
      ->required();
  verb->add_option(
      "--truth", request.truth,
      "Folder of the simulation that a virtual capture was made from; adds errors against noise-free images");
  add_capture_options(*verb, options->capture,
                      "Predict every N-th pair, as in the estimation with --hold-out N (default: the pairs "
                      "that the first field was not estimated from)");
  verb->add_option(
      "--pixel", options->pixels,
      "Column,row of a pixel whose kernels are shown; may be repeated (default: one pixel per pixel class)");
  verb->add_option("-o,--output", request.output, "HTML page to write (.html)")->required();
  verb->callback([options, &common, &action] {
    action = [options, &common] {
      for (const std::string& pixel : options->pixels) options->request.pixels.push_back(parse_pixel(pixel));
      const CaptureOptions& capture = options->capture;
      std::vector<std::filesystem::path> inputs = options->request.fields;
      inputs.insert(inputs.end(),
                    {capture.session, capture.light, capture.observed, capture.mask, options->request.truth});
      const OutputLock lock(options->request.output, inputs, ".html");
      options->request.session = open_capture(options->capture);
      options->request.find_held_out = options->capture.hold_out == 0;
      auto figures = report::write_report(options->request, run_context());
      const std::string path = options->request.output.string();
      if (common.json) {
        figures["report"] = path;
        print_json(figures);
      } else {
        std::printf("report: %s\n", path.c_str());
      }
    };
  });
}

}  // namespace refield::cli
