// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <numeric>
#include <sstream>
#include <string>

#include "cli/chart/panel.h"
#include "cli/prt/peers.h"
#include "cli/verbs.h"
#include "core/cube_map.h"
#include "core/errors.h"
#include "core/files.h"
#include "core/metrics.h"
#include "relight/environment.h"
#include "simulate/prt/integrate.h"

namespace refield::cli {

namespace {

namespace fs = std::filesystem;
using prt_chart::ChartLight;
using prt_chart::Peer;
using prt_chart::Shading;

struct PrtChartArguments {
  fs::path scene, folder;
  std::vector<std::string> maps;
  int resolution = 256;
};

constexpr int harmonics_resolution = 32;

std::vector<ChartLight> lights_of(const PrtChartArguments& arguments) {
  const EnvironmentProjector fine(cube_domain(arguments.resolution), {}),
      coarse(cube_domain(harmonics_resolution), {});
  std::vector<ChartLight> lights;
  for (const fs::path path : arguments.maps) {
    const LightMap map = read_environment(path);
    lights.push_back({path.stem().string(), fine.project(map, {}).light, {}});
    lights.back().coarse = coarse.project(lights.back().fine, {}).light;
  }
  return lights;
}

/// Every texel's light, one by one.
Shading exact_shading(const prt::Scene& scene, const std::vector<ChartLight>& lights) {
  std::vector<std::uint32_t> vertices(scene.mesh.positions.size());
  std::iota(vertices.begin(), vertices.end(), 0u);
  std::vector<LightMap> maps;
  for (const ChartLight& light : lights) maps.push_back(light.fine);
  const auto exact = prt::integrate_lights(prt::TransferSamples(scene, {}, vertices), maps);
  Shading shading(lights.size());
  for (std::size_t l = 0; l < lights.size(); ++l)
    for (std::size_t v = 0; v < vertices.size(); ++v) shading[l].push_back(exact[l][v].cast<float>());
  return shading;
}

double error_of(const std::vector<Eigen::Array3f>& shading, const std::vector<Eigen::Array3f>& exact) {
  const auto image = [](const std::vector<Eigen::Array3f>& triples) {
    Image outputs(static_cast<int>(triples.size()), 1, 3);
    std::copy_n(triples.data()->data(), outputs.values.size(), outputs.values.data());
    return outputs;
  };
  return relative_rmse(image(shading), image(exact));
}

struct Row {
  const Peer* peer;
  std::vector<double> errors;  // of each light
  double median() const { return quantile(std::vector<float>(errors.begin(), errors.end()), 0.5); }
};

std::string csv(const std::vector<Row>& rows, const std::vector<ChartLight>& lights) {
  std::ostringstream text;
  text << "method,setting,kernels,megabytes,precompute_seconds,relight_ms,median_error";
  for (const ChartLight& light : lights) text << ',' << light.name;
  text << '\n';
  for (const Row& row : rows) {
    text << '"' << row.peer->method << "\",\"" << row.peer->setting << "\"," << row.peer->kernels << ','
         << row.peer->bytes / 1e6 << ',' << row.peer->precompute_seconds << ',' << row.peer->relight_ms << ','
         << row.median();
    for (const double error : row.errors) text << ',' << error;
    text << '\n';
  }
  return text.str();
}

chart::Panel panel(const std::vector<Row>& rows, const char* title, const char* x_label,
                   double (*x)(const Peer&)) {
  chart::Panel panel{title, x_label, "relative RMSE, median of the lights", true, {}, true};
  for (const Row& row : rows) {
    if (panel.tracks.empty() || panel.tracks.back().label != row.peer->method)
      panel.tracks.push_back({row.peer->method, static_cast<int>(panel.tracks.size()), {}});
    panel.tracks.back().points.push_back({x(*row.peer), row.median()});
  }
  return panel;
}

void make_chart(const PrtChartArguments& arguments) {
  prt::Scene scene = prt::read_scene(arguments.scene);
  prt::sort_vertices(scene);
  const std::vector<ChartLight> lights = lights_of(arguments);
  create_folders(arguments.folder);
  const Shading exact = exact_shading(scene, lights);
  const std::vector<Peer> peers = prt_chart::all_peers(scene, lights, arguments.resolution);
  std::vector<Row> rows;
  for (const Peer& peer : peers) {
    rows.push_back({&peer, {}});
    for (std::size_t l = 0; l < lights.size(); ++l)
      rows.back().errors.push_back(error_of(peer.shading[l], exact[l]));
    std::printf("%-24s %-22s %8.2f MB %7.1f s %8.2f ms   error %.4f\n", peer.method.c_str(),
                peer.setting.c_str(), peer.bytes / 1e6, peer.precompute_seconds, peer.relight_ms,
                rows.back().median());
  }
  write_text_atomically(arguments.folder / "prt.csv", csv(rows, lights));
  const std::string title = std::to_string(scene.mesh.positions.size()) + " vertices, " +
                            std::to_string(lights.size()) + " lights of 6×" +
                            std::to_string(arguments.resolution) + "² texels; dashed: Pareto front";
  write_text_atomically(
      arguments.folder / "prt.svg",
      chart::picture_svg(
          title,
          {panel(rows, "Error against relighting time", "relighting, ms a light",
                 [](const Peer& peer) { return peer.relight_ms; }),
           panel(rows, "Error against size", "megabytes", [](const Peer& peer) { return peer.bytes / 1e6; }),
           panel(rows, "Error against precomputation", "precomputation, seconds",
                 [](const Peer& peer) { return peer.precompute_seconds; })},
          2));
}

}  // namespace

void add_simulate_prt_chart(CLI::App& app, const Common&, Action& action) {
  auto arguments = std::make_shared<PrtChartArguments>();
  CLI::App* verb = app.add_subcommand(
      "prt-chart",
      "Compare methods of precomputed transport: error against time and bytes\n\n"
      "Clustered lights, ours and the paper's, wavelets and harmonics, each from coarse to fine, against the "
      "exact sum over all texels.\n"
      "  refield simulate prt-chart datasets_synthetic/prt/hare.toml sky.exr room.exr -o chart");
  verb->add_option("scene", arguments->scene, "Diffuse scene (TOML) or mesh, of at most 65 536 vertices")
      ->required();
  verb->add_option("maps", arguments->maps, "Environment maps of any size")->required();
  verb->add_option("-o,--output", arguments->folder, "Folder for prt.csv and prt.svg")->required();
  verb->add_option("--resolution", arguments->resolution,
                   "Of a face of the cube maps; a power of two, for the wavelets")
      ->capture_default_str()
      ->check(CLI::Range(8, 1024));
  verb->callback([arguments, &action] { action = [arguments] { make_chart(*arguments); }; });
}

}  // namespace refield::cli
