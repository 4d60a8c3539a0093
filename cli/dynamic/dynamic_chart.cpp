// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include "cli/chart/panel.h"
#include "cli/dynamic/frame_errors.h"
#include "cli/dynamic/frame_times.h"
#include "cli/option_checks.h"
#include "cli/verbs.h"
#include "core/errors.h"
#include "core/files.h"
#include "core/output_lock.h"

namespace refield::cli {

namespace {

struct DynamicChartArguments {
  std::filesystem::path scene, folder;
  double time = 0.0;
  int paths = 2048;
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

constexpr const char *rays_by_points = "rays, by points", *fields_by_points = "fields, by points",
                     *fields_by_order = "fields, by order", *products_by_order = "products, by order";

/// From coarse to fine in one thing each, the others as by default, or as in the paper.
std::vector<Setting> settings() {
  std::vector<Setting> all;
  for (const int terms : {4, 16})
    for (const int functions : {4, 8, 16, 32}) {
      Setting paper{
          "as in the paper, K = " + std::to_string(terms), "N = " + std::to_string(functions), {}, {}};
      paper.transport.modes = dynamic::ModeKind::separate;
      paper.transport.compression = 0.0;
      paper.transport.functions = functions;
      paper.transport.factors.largest = terms;
      paper.frame.exact_direct = false;
      all.push_back(paper);
    }
  for (const int functions : {4, 8, 16, 32, 64}) {
    all.push_back({"by N", "N = " + std::to_string(functions), {}, {}});
    all.back().transport.functions = functions;
  }
  for (const int terms : {1, 4, 9, 36}) {
    all.push_back({"by K", "K = " + std::to_string(terms), {}, {}});
    all.back().transport.factors = {.largest = terms, .error = 0.01};
  }
  for (const int order : {3, 4, 5, 6}) {
    all.push_back({"by order", "n = " + std::to_string(order), {}, {}});
    all.back().transport.order = order;
  }
  for (const int points : {1, 2, 4, 8, 16, 32, 128}) {
    all.push_back({rays_by_points, std::to_string(points) + " points", {}, {}});
    all.back().frame.lamp_points = points;
  }
  const auto add_without_rays = [&](const char* method, dynamic::DirectLightBy way, int order, int points,
                                    const std::string& what) {
    all.push_back({method, what, {}, {}});
    all.back().transport.order = order;
    all.back().frame.direct = way;
    all.back().frame.lamp_points = points;
  };
  for (const int points : {2, 4, 8, 16, 32})
    add_without_rays(fields_by_points, dynamic::DirectLightBy::field_edges, 4, points,
                     std::to_string(points) + " points");
  for (const int order : {3, 4, 6, 8}) {
    const std::string what = "n = " + std::to_string(order);
    add_without_rays(fields_by_order, dynamic::DirectLightBy::field_edges, order, 16, what);
    add_without_rays(products_by_order, dynamic::DirectLightBy::field_products, order, 16, what);
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

struct Axis {
  const char* label;
  double (*value)(const Charted&);
};
const Axis frame_ms{"ms a frame", [](const Charted& row) { return row.times.frame; }};
const Axis direct_ms{"ms of direct light", [](const Charted& row) { return row.times.direct; }};
const Axis megabytes{"megabytes", [](const Charted& row) { return row.megabytes; }};

/// Error of one light, a track for each method of which `shown` is true.
template <class Shown>
chart::Panel panel(const std::vector<Charted>& rows, const char* title, const char* light, const Axis& axis,
                   const Shown& shown) {
  chart::Panel panel{title, axis.label, std::string("RMSE of ") + light + " light over all light",
                     true,  {},         true};
  for (const Charted& row : rows) {
    if (!shown(row)) continue;
    auto track = std::ranges::find(panel.tracks, row.setting.method, &chart::Track::label);
    if (track == panel.tracks.end())
      track = panel.tracks.insert(track, {row.setting.method, static_cast<int>(panel.tracks.size()), {}});
    track->points.push_back({axis.value(row), row.error(light)});
  }
  return panel;
}

std::string picture(const std::vector<Charted>& rows, const std::string& title) {
  const auto by_rays = [](const Charted& row) {
    return row.setting.frame.direct == dynamic::DirectLightBy::rays;
  };
  const auto of_direct = [&](const Charted& row) {
    return !by_rays(row) || row.setting.method == rays_by_points;
  };
  const auto of_all = [&](const Charted& row) {
    return by_rays(row) || row.setting.method == fields_by_points;
  };
  return chart::picture_svg(
      title,
      {panel(rows, "All light, against frame time", "all", frame_ms, of_all),
       panel(rows, "Direct light, against its time", "direct", direct_ms, of_direct),
       panel(rows, "Light that bounced, against frame time", "bounced", frame_ms, by_rays),
       panel(rows, "Light that bounced, against size", "bounced", megabytes, by_rays)},
      2);
}

void make_dynamic_chart(const DynamicChartArguments& arguments) {
  const OutputLock lock(arguments.folder, {});
  const dynamic::DynamicScene described = dynamic::read_dynamic_scene(arguments.scene);
  create_folders(arguments.folder);
  std::optional<FrameReference> reference;
  std::vector<Charted> rows;
  std::optional<PreparedScene> scene;
  dynamic::TransportOptions prepared;
  for (const Setting& setting : settings()) {
    if (!scene || !(setting.transport == prepared))
      scene.emplace(described, setting.transport, dynamic::TransportCache({}));
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
  write_text_atomically(
      arguments.folder / "dynamic.svg",
      picture(rows, arguments.scene.filename().string() + ", errors against " +
                        std::to_string(arguments.paths) + " paths a vertex; dashed: Pareto front"));
}

}  // namespace

void add_simulate_dynamic_chart(CLI::App& app, const Common&, Action& action) {
  auto arguments = std::make_shared<DynamicChartArguments>();
  CLI::App* verb = app.add_subcommand(
      "dynamic-chart",
      "Compare settings of light between moving objects: error against frame time and bytes\n\n"
      "Our way by number of functions, terms, harmonics and points of lamps, shadows from lamps by rays and "
      "by "
      "occlusion fields, and the paper's way, against traced paths.\n"
      "  refield simulate dynamic-chart datasets_synthetic/dynamic/hare.toml -o chart");
  verb->add_option("scene", arguments->scene, "Scene (TOML, docs/reference/mesh-scenes.md)")->required();
  verb->add_option("-o,--output", arguments->folder, "Folder for dynamic.csv and dynamic.svg")->required();
  verb->add_option("--time", arguments->time, "At which errors are looked at, seconds")
      ->check(non_negative_number())
      ->capture_default_str();
  verb->add_option("--paths", arguments->paths, "Of the reference, a vertex")
      ->check(CLI::Range(1, 1 << 24))
      ->capture_default_str();
  verb->callback([arguments, &action] { action = [arguments] { make_dynamic_chart(*arguments); }; });
}

}  // namespace refield::cli
