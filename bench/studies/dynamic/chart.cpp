// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include "bench/studies/dynamic/picture_grid.h"
#include "bench/studies/studies.h"
#include "cli/common/options.h"
#include "cli/dynamic/simulate_dynamic.h"
#include "cli/run_context.h"
#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/base/output_lock.h"
#include "core/image/image_io.h"
#include "core/image/tone_map.h"

namespace refield::studies {

namespace {

using cli::FrameReference;
using cli::FrameTimes;
using cli::LightError;
using cli::non_negative_number;
using cli::PreparedScene;

struct DynamicChartArguments {
  std::filesystem::path scene, folder;
  double time = 0.0;
  int paths = 2048;
  bool pictures = false;
};

struct Setting {
  std::string method, what;
  dynamic::TransportOptions transport;
  dynamic::FrameOptions frame;
};

struct Charted {
  Setting setting;
  double megabytes = 0.0;
  FrameTimes times;
  std::vector<LightError> errors;

  double error(const std::string& what) const {
    return std::ranges::find(errors, what, &LightError::what)->of_all;
  }
};

/// From coarse to fine in one thing each, the others as by default, or as in the paper.
std::vector<Setting> settings() {
  std::vector<Setting> all;
  for (const int terms : {4, 16})
    for (const int functions : {4, 8, 16, 32}) {
      Setting paper{
          "as in the paper, K = " + std::to_string(terms), "N = " + std::to_string(functions), {}, {}};
      paper.transport = dynamic::as_in_the_paper({});
      paper.transport.functions = functions;
      paper.transport.factors.largest = terms;
      paper.frame.exact_direct = false;
      all.push_back(paper);
    }
  for (const int rays : {4, 8, 12, 16, 32, 64}) {
    all.push_back({"rays from vertices", std::to_string(rays) + " rays", {}, {}});
    all.back().frame.rays = rays;
  }
  for (const int terms : {1, 4, 9, 36}) {
    all.push_back({"by K", "K = " + std::to_string(terms), {}, {}});
    all.back().transport.factors = {.largest = terms, .error = 0.01};
  }
  for (const int functions : {4, 8, 16, 32, 64}) {
    all.push_back({"fields, by N", "N = " + std::to_string(functions), {}, {}});
    all.back().transport.fields = true;
    all.back().transport.functions = functions;
  }
  for (const int order : {3, 4, 5, 6}) {
    all.push_back({"fields, by order", "n = " + std::to_string(order), {}, {}});
    all.back().transport.fields = true;
    all.back().transport.order = order;
  }
  for (const int points : {1, 2, 4, 8, 16, 32, 128}) {
    all.push_back({"shadow rays, by points", std::to_string(points) + " points", {}, {}});
    all.back().frame.light_samples = points;
  }
  const auto add_without_rays = [&](const char* method, dynamic::DirectLightBy way, int order, int points,
                                    const std::string& what) {
    all.push_back({method, what, {}, {}});
    all.back().transport.fields = true;
    all.back().transport.order = order;
    all.back().frame.direct = way;
    all.back().frame.light_samples = points;
  };
  for (const int points : {2, 4, 8, 16, 32})
    add_without_rays("shadows by fields, by points", dynamic::DirectLightBy::field_edges, 4, points,
                     std::to_string(points) + " points");
  for (const int order : {3, 4, 6, 8}) {
    const std::string what = "n = " + std::to_string(order);
    add_without_rays("shadows by fields, by order", dynamic::DirectLightBy::field_edges, order, 16, what);
    add_without_rays("shadows by products, by order", dynamic::DirectLightBy::field_products, order, 16,
                     what);
  }
  return all;
}

std::string csv(const std::vector<Charted>& rows) {
  std::ostringstream text;
  text << "method,setting,megabytes,frame_ms,direct_ms,place_ms,bounces_ms,shade_ms";
  for (const LightError& error : rows.front().errors) text << ',' << error.what << " of all";
  text << '\n';
  for (const Charted& row : rows) {
    text << '"' << row.setting.method << "\",\"" << row.setting.what << "\"," << row.megabytes << ','
         << row.times.frame << ',' << row.times.direct << ',' << row.times.place << ',' << row.times.bounces
         << ',' << row.times.shade;
    for (const LightError& error : row.errors) text << ',' << error.of_all;
    text << '\n';
  }
  return text.str();
}

/// shadows.png: the scene with shadows by rays, by edges of occlusion fields and by products of harmonics.
void write_shadow_pictures(const DynamicChartArguments& arguments, const dynamic::DynamicScene& described) {
  PreparedScene scene(described, {.fields = true});
  std::vector<Image> pictures;
  ExposureMeter meter;
  for (const auto way : {dynamic::DirectLightBy::rays, dynamic::DirectLightBy::field_edges,
                         dynamic::DirectLightBy::field_products}) {
    dynamic::FrameOptions options;
    options.direct = way;
    scene.solve(arguments.time, cli::camera_of(scene.scene()), options);
    if (pictures.empty()) meter.add(scene.reflected_picture());
    pictures.push_back(scene.picture(0, scene.light().bounces()));
  }
  write_png(arguments.folder / "shadows.png", dynamic_chart::picture_grid(pictures, 3), {meter.exposure()});
}

void make_dynamic_chart(const DynamicChartArguments& arguments) {
  const OutputLock lock(arguments.folder, {});
  const dynamic::DynamicScene described = dynamic::read_dynamic_scene(arguments.scene, run_context());
  create_folders(arguments.folder);
  if (arguments.pictures) write_shadow_pictures(arguments, described);
  std::optional<FrameReference> reference;
  std::vector<Charted> rows;
  std::optional<PreparedScene> scene;
  dynamic::TransportOptions prepared;
  for (const Setting& setting : settings()) {
    if (!scene || !(setting.transport == prepared)) scene.emplace(described, setting.transport);
    prepared = setting.transport;
    if (!reference)
      reference = frame_reference(*scene, arguments.time, setting.frame.bounces, arguments.paths);
    rows.push_back({setting, static_cast<double>(scene->bytes()) / 1e6, measure_frames(*scene, setting.frame),
                    frame_errors(*scene, *reference, setting.frame)});
    const Charted& row = rows.back();
    std::printf(
        "%-26s %-12s %7.1f MB %7.2f ms, direct %6.2f   error of direct light %.4f, bounced %.4f, all %.4f\n",
        setting.method.c_str(), setting.what.c_str(), row.megabytes, row.times.frame, row.times.direct,
        row.error("direct"), row.error("bounced"), row.error("all"));
  }
  write_text_atomically(arguments.folder / "dynamic.csv", csv(rows));
}

}  // namespace

void add_dynamic_chart(CLI::App& app, Action& action) {
  auto arguments = std::make_shared<DynamicChartArguments>();
  CLI::App* verb =
      app.add_subcommand("dynamic-chart", "Compare settings of moving scenes: error, frame time and size");
  verb->footer(
      "Settings: number of rays from vertices, of BRDF terms and of light samples; indirect light by fields\n"
      "around objects, number of basis functions and of spherical harmonics; shadows by occlusion fields;\n"
      "the paper's method. Errors are relative to traced paths.\n"
      "Example: refield-studies dynamic-chart datasets_synthetic/dynamic/rabbit.toml -o chart");
  verb->add_option("scene", arguments->scene, "Scene (TOML, docs/reference/scene-files.md)")->required();
  verb->add_option("-o,--output", arguments->folder, "Folder for dynamic.csv")->required();
  verb->add_option("--time", arguments->time, "At which errors are looked at, seconds")
      ->check(non_negative_number())
      ->capture_default_str();
  verb->add_option("--paths", arguments->paths, "Of the reference, a vertex")
      ->check(CLI::Range(1, 1 << 24))
      ->capture_default_str();
  verb->add_flag(
      "--pictures", arguments->pictures,
      "Also write shadows.png: shadows by rays, by edges of occlusion fields, by products of harmonics");
  verb->callback([arguments, &action] { action = [arguments] { make_dynamic_chart(*arguments); }; });
}

}  // namespace refield::studies
