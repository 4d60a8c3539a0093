// SPDX-License-Identifier: Apache-2.0
#include <cstdio>

#include "cli/common/options.h"
#include "cli/report/page.h"
#include "cli/run_context.h"
#include "cli/verbs.h"
#include "cli/web/export.h"
#include "core/base/files.h"
#include "core/base/json.h"
#include "core/base/output_lock.h"
#include "core/field_io/field_sampler.h"
#include "core/field_io/reflectance_field_file.h"
#include "core/light/monitor_placement.h"
#include "relight/environment/environment.h"

namespace refield::cli {

namespace {

struct ExportWebOptions {
  fs::path field;
  fs::path output;
  std::vector<std::string> environments;
  std::vector<std::string> placements;
};

/// Maps of all directions in the form that a page takes: of the field's own kind as the field sees them, for
/// a monitor's window as panoramas.
std::vector<web::PageMap> maps_of(const ExportWebOptions& options, const ReflectanceField& field) {
  constexpr int max_columns = 1024;  // finer than the texels of most windows
  LightDomain domain = field.basis.domain;
  const bool has_window = domain.parameterisation == Parameterisation::monitor;
  if (has_window && field.monitors.size() != 1)
    throw InputError(
        options.field,
        ": does not say where the monitor stood, or names several places, and environment maps need one; "
        "give the screen's width x height @ distance from the scene in mm by --placement 520x320@600,yaw=90");
  std::vector<web::PageMap> maps;
  for (const fs::path& file : expand_globs(options.environments)) {
    LightMap map = read_environment(file, run_context());
    const bool panorama = map.parameterisation == Parameterisation::lat_long;
    if (has_window) {
      const int columns = panorama ? std::min(map.radiance.width, max_columns) : max_columns;
      domain = {columns, columns / 2, Parameterisation::lat_long};
    }
    if (map.domain() != domain)
      map = EnvironmentProjector(domain, {}, run_context()).project(map, {}, run_context()).light;
    maps.push_back({file.stem().string(), std::move(map.radiance)});
  }
  return maps;
}

/// The field that a page holds, and the stride of its pixels: of one that is too large for a browser, every
/// n-th pixel, since the mean of 6 × 6 pixels has 13 times as
/// many kernels as one of them (304 and 23 in an estimated field), so the page could hold fewer pixels.
std::pair<ReflectanceField, int> read_page_field(const fs::path& path) {
  const auto large = FieldSampler::open(path, run_context());
  if (!large) return {read_reflectance_field(path, run_context()), 1};
  constexpr double max_weights = 4096.0 * 4096.0;  // a texture that every browser has
  const double pixels = static_cast<double>(large->outline().width) * large->outline().height;
  const PixelGrid grid = large->whole_image(
      static_cast<std::int64_t>(max_weights * pixels / static_cast<double>(large->entries())));
  return {large->read(grid, run_context()), grid.stride};
}

void export_web(const ExportWebOptions& options, const Common& common) {
  if (fs::exists(options.output) && !fs::is_directory(options.output))
    throw InputError(options.output, ": is a file; give a folder for the page");
  const OutputLock lock(options.output, {});
  auto [field, stride] = read_page_field(options.field);
  if (!options.placements.empty()) {
    field.monitors = placements_from_texts(options.placements);
    check_placements(field.monitors, field.basis.domain, "--placement");
  }
  const std::string title = options.field.stem().string();
  const web::ExportReport report = web::export_page(
      field, title, options.output,
      options.environments.empty() ? std::vector<web::PageMap>() : maps_of(options, field), run_context());
  if (common.json)
    return print_json(Json{{"page", (options.output / "index.html").string()},
                           {"stride", stride},
                           {"files", report.files},
                           {"bytes", report.bytes},
                           {"relative_rmse", report.relative_rmse},
                           {"largest_8_bit_difference", report.largest_difference},
                           {"exposure", report.exposure}});
  std::printf("%s: %zu files, %s\n", (options.output / "index.html").c_str(), report.files,
              report::bytes_text(static_cast<double>(report.bytes)).c_str());
  if (stride > 1)
    std::printf("the field is too large for a browser: the page shows 1 of %d×%d pixels, %d×%d\n", stride,
                stride, field.width, field.height);
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
                         "  refield export-web scene.rfield -o page\n"
                         "  refield export-web scene.rfield --env sky.exr -o page");
  verb->add_option("field", options->field, "Reflectance field (.rfield)")->required();
  verb->add_option("-o,--output", options->output, "Folder for the page; open its index.html in a browser")
      ->required();
  verb->add_option(
      "--env", options->environments,
      "Environment map of any size, lat-long (twice as wide as high) or cube, that the page offers. If the "
      "field was captured with a monitor, it is shown through the window of the monitor");
  add_placement_option(*verb, options->placements, "Replaces that of the field.");
  on_command(*verb, options, common, action, export_web);
}

}  // namespace refield::cli
