// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include "bench/studies/dynamic/frame_errors.h"
#include "bench/studies/studies.h"
#include "cli/common/options.h"
#include "cli/run_context.h"
#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/base/output_lock.h"
#include "core/image/image_io.h"

namespace refield::studies {

namespace {

using cli::non_negative_number;

struct DynamicChartArguments {
  std::filesystem::path scene, folder;
  double time = 0.0;
  int paths = 2048, traced = 0;
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
      paper.transport.fields = true;
      paper.transport.functions = functions;
      paper.transport.factors.largest = terms;
      paper.frame.direct_by_fields = true;
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
  for (const int points : {1, 2, 4, 8, 16, 32, 128}) {
    all.push_back({"shadow rays, by points", std::to_string(points) + " points", {}, {}});
    all.back().frame.light_samples = points;
  }
  for (const int order : {3, 4, 6, 8}) {
    all.push_back({"as in the paper, by order", "n = " + std::to_string(order), {}, {}});
    all.back().transport.fields = true;
    all.back().transport.order = order;
    all.back().frame.direct_by_fields = true;
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

void make_dynamic_chart(const DynamicChartArguments& arguments) {
  const OutputLock lock(arguments.folder, {});
  const dynamic::DynamicScene described = dynamic::read_dynamic_scene(arguments.scene, run_context());
  create_folders(arguments.folder);
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
  if (arguments.traced > 0)
    write_exr(arguments.folder / "traced.exr",
              traced_picture(*scene, arguments.time, dynamic::FrameOptions().bounces, arguments.traced));
}

}  // namespace

void add_dynamic_chart(CLI::App& app, Action& action) {
  auto arguments = std::make_shared<DynamicChartArguments>();
  CLI::App* verb =
      app.add_subcommand("dynamic-chart", "Compare settings of moving scenes: error, frame time and size");
  verb->footer(
      "Settings: number of rays from vertices, of BRDF terms and of light samples; the paper's method, by\n"
      "number of BRDF terms, of basis functions and of spherical harmonics. Errors are relative to traced "
      "paths.\n"
      "Example: refield-studies dynamic-chart datasets_synthetic/dynamic/rabbit.toml -o chart");
  verb->add_option("scene", arguments->scene, "Scene (TOML, docs/reference/scene-files.md)")->required();
  verb->add_option("-o,--output", arguments->folder, "Folder for dynamic.csv")->required();
  verb->add_option("--time", arguments->time, "At which errors are looked at, seconds")
      ->check(non_negative_number())
      ->capture_default_str();
  verb->add_option("--paths", arguments->paths, "Of the reference, a vertex")
      ->check(CLI::Range(1, 1 << 24))
      ->capture_default_str();
  verb->add_option("--traced", arguments->traced,
                   "Also trace a picture, traced.exr, with these paths per vertex")
      ->check(CLI::Range(1, 1 << 20));
  verb->callback([arguments, &action] { action = [arguments] { make_dynamic_chart(*arguments); }; });
}

}  // namespace refield::studies
