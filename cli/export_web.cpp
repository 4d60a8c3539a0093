// SPDX-License-Identifier: Apache-2.0
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "cli/report/html.h"
#include "cli/verbs.h"
#include "cli/web/export.h"
#include "core/errors.h"
#include "core/json_text.h"
#include "core/output_lock.h"
#include "core/reflectance_field_file.h"

namespace refield::cli {

namespace {

namespace fs = std::filesystem;

struct ExportWebOptions {
  fs::path field;
  fs::path output;
  std::string title;
};

void export_web(const ExportWebOptions& options, const Common& common) {
  if (fs::exists(options.output) && !fs::is_directory(options.output))
    throw InputError(options.output.string() + ": is a file; give a folder for the page");
  const OutputLock lock(options.output, {});
  const ReflectanceField field = read_image_field(options.field);
  const std::string title = options.title.empty() ? options.field.stem().string() : options.title;
  const web::ExportReport report = web::export_page(field, title, options.output);
  if (common.json) {
    std::printf("%s\n",
                json_text(nlohmann::ordered_json{{"page", (options.output / "index.html").string()},
                                                 {"files", report.files},
                                                 {"bytes", report.bytes},
                                                 {"relative_rmse", report.relative_rmse},
                                                 {"largest_8_bit_difference", report.largest_difference},
                                                 {"exposure", report.exposure}},
                          2)
                    .c_str());
    return;
  }
  std::printf("%s: %zu files, %s\n", (options.output / "index.html").c_str(), report.files,
              report::bytes_text(static_cast<double>(report.bytes)).c_str());
  std::printf(
      "rounding error under white light and four bars: relative RMSE %.2g, at most %d of 255 levels after "
      "tone mapping\n",
      report.relative_rmse, report.largest_difference);
}

}  // namespace

void add_export_web(CLI::App& app, const Common& common, Action& action) {
  const auto options = std::make_shared<ExportWebOptions>();
  CLI::App* verb =
      app.add_subcommand("export-web",
                         "Export a reflectance field as a web page for interactive relighting.\n"
                         "\n"
                         "The page runs in any browser with WebGL 2, from disk or from a static web server.\n"
                         "\n"
                         "Example:\n"
                         "  refield export-web scene.rfield -o page");
  verb->add_option("field", options->field, "Reflectance field (.rfield)")->required();
  verb->add_option("-o,--output", options->output, "Folder for the page; open its index.html in a browser")
      ->required();
  verb->add_option("--title", options->title, "Heading of the page (default: the name of the field)");
  verb->callback(
      [options, &common, &action] { action = [options, &common] { export_web(*options, common); }; });
}

}  // namespace refield::cli
