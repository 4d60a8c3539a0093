// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <sstream>
#include <string>

#include "bench/studies/prt/integrate.h"
#include "bench/studies/prt/peers.h"
#include "bench/studies/prt/pictures.h"
#include "bench/studies/studies.h"
#include "cli/run_context.h"
#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/base/output_lock.h"
#include "core/base/rng.h"
#include "core/image/metrics.h"
#include "core/light/cube_map.h"
#include "relight/environment/environment.h"

namespace refield::studies {

namespace {

namespace fs = std::filesystem;
using prt_chart::ChartLight;
using prt_chart::ChartScene;
using prt_chart::Peer;
using prt_chart::Shading;

struct PrtChartArguments {
  fs::path scene, folder;
  std::vector<std::string> maps, fields;
  int resolution = 256;
  std::size_t vertices = 1024;
  bool pictures = false;
  std::optional<double> sky;
};

constexpr int harmonics_resolution = 32;

std::vector<ChartLight> lights_of(const PrtChartArguments& arguments) {
  const EnvironmentProjector fine(cube_domain(arguments.resolution), {}, run_context()),
      coarse(cube_domain(harmonics_resolution), {}, run_context());
  std::vector<ChartLight> lights;
  const auto add = [&](const std::string& name, const LightMap& map) {
    lights.push_back({name, fine.project(map, {}, run_context()).light, {}});
    lights.back().coarse = coarse.project(lights.back().fine, {}, run_context()).light;
  };
  if (arguments.sky) add("sky", clear_sky(sun_direction(*arguments.sky, {}), {}));
  for (const fs::path path : arguments.maps) add(path.stem().string(), read_environment(path, run_context()));
  if (lights.empty()) throw InputError("nothing to compare under: give environment maps or --sky");
  return lights;
}

/// So many vertices at random, always the same ones; all where there are no more.
std::vector<std::uint32_t> some_vertices(std::size_t vertices, std::size_t count) {
  std::vector<std::uint32_t> some;
  Rng rng(1);
  for (std::uint32_t v = 0; v < vertices && some.size() < count; ++v)
    if (rng.uniform() * static_cast<double>(vertices - v) < static_cast<double>(count - some.size()))
      some.push_back(v);
  return some;
}

/// Every texel's light, one by one.
Shading exact_shading(const ChartScene& chart, const std::vector<ChartLight>& lights) {
  std::vector<LightMap> maps;
  for (const ChartLight& light : lights) maps.push_back(light.fine);
  const auto exact =
      prt::integrate_lights(prt::TransferSamples(chart.scene, {}, chart.vertices), maps, run_context());
  Shading shading(lights.size());
  for (std::size_t l = 0; l < lights.size(); ++l)
    for (std::size_t v = 0; v < chart.vertices.size(); ++v) shading[l].push_back(exact[l][v].cast<float>());
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
  text << "method,setting,kernels,weights_per_vertex,megabytes,precompute_seconds,relight_ms,two_area_lights_"
          "ms,"
          "median_error";
  for (const ChartLight& light : lights) text << ',' << light.name;
  text << '\n';
  for (const Row& row : rows) {
    text << '"' << row.peer->method << "\",\"" << row.peer->setting << "\"," << row.peer->kernels << ','
         << row.peer->weights << ',' << row.peer->bytes / 1e6 << ',' << row.peer->precompute_seconds << ','
         << row.peer->relight_ms << ',' << row.peer->two_area_lights_ms << ',' << row.median();
    for (const double error : row.errors) text << ',' << error;
    text << '\n';
  }
  return text.str();
}

std::vector<Peer> peers_of(const PrtChartArguments& arguments, const ChartScene& chart,
                           const std::vector<ChartLight>& lights) {
  if (arguments.fields.empty()) return prt_chart::all_peers(chart, lights, arguments.resolution);
  std::vector<Peer> peers;
  for (const std::string& field : arguments.fields)
    peers.push_back(prt_chart::peer_of_field(field, chart, lights));
  return peers;
}

void print(const Row& row) {
  std::printf("%-24s %-22s %6.0f weights per vertex %8.2f MB %7.1f s %8.2f ms %6.2f ms   error %.4f\n",
              row.peer->method.c_str(), row.peer->setting.c_str(), row.peer->weights, row.peer->bytes / 1e6,
              row.peer->precompute_seconds, row.peer->relight_ms, row.peer->two_area_lights_ms, row.median());
}

void make_chart(const PrtChartArguments& arguments) {
  const OutputLock lock(arguments.folder, {});
  prt::Scene scene = prt::read_scene(arguments.scene, run_context(), prt::Gloss::diffuse);
  prt::sort_vertices(scene);
  const std::size_t vertices = scene.mesh.positions.size();
  const ChartScene chart{scene, some_vertices(vertices, arguments.pictures ? vertices : arguments.vertices)};
  const std::vector<ChartLight> lights = lights_of(arguments);
  create_folders(arguments.folder);
  const Shading exact = exact_shading(chart, lights);
  const std::vector<Peer> peers = peers_of(arguments, chart, lights);
  std::vector<Row> rows;
  for (const Peer& peer : peers) {
    rows.push_back({&peer, {}});
    for (std::size_t l = 0; l < lights.size(); ++l)
      rows.back().errors.push_back(error_of(peer.shading[l], exact[l]));
    print(rows.back());
  }
  if (arguments.pictures)
    prt_chart::write_comparison(arguments.folder / "pictures.png", scene, exact.front(), peers);
  write_text_atomically(arguments.folder / "prt.csv", csv(rows, lights));
}

}  // namespace

void add_prt_chart(CLI::App& app, Action& action) {
  auto arguments = std::make_shared<PrtChartArguments>();
  CLI::App* verb =
      app.add_subcommand("prt-chart", "Compare methods of precomputed transport: error, time and size");
  verb->footer(
      "Methods: light clusters (ours and the paper's), wavelets and spherical harmonics, each with settings "
      "from\n"
      "coarse to fine. Errors are relative to the exact sum over all texels.\n"
      "Example: refield-studies prt-chart datasets_synthetic/prt/rabbit.toml sky.exr room.exr -o chart");
  verb->add_option("scene", arguments->scene, "Diffuse scene (TOML) or mesh")->required();
  verb->add_option("maps", arguments->maps, "Environment maps of any size");
  verb->add_option("-o,--output", arguments->folder, "Folder for prt.csv and pictures")->required();
  verb->add_option("--resolution", arguments->resolution,
                   "Of a face of the cube maps; a power of two, for the wavelets")
      ->capture_default_str()
      ->check(CLI::Range(8, 1024));
  verb->add_option(
          "--sky", arguments->sky,
          "Before the maps a clear sky, so much of its day being over: 0 sunrise, 0.5 noon, 1 sunset")
      ->check(CLI::Range(0.0, 1.0));
  verb->add_option("--vertices", arguments->vertices,
                   "Errors are looked at for that many vertices, drawn at random; all: as many as there are. "
                   "Wavelets are computed for these alone")
      ->capture_default_str()
      ->check(CLI::Range(std::size_t{1}, std::size_t{1} << 26));
  verb->add_option("--fields", arguments->fields,
                   "Compares fields that 'precompute --method clusters' made of this scene in place of "
                   "computing all methods");
  verb->add_flag("--pictures", arguments->pictures,
                 "Also pictures.png under the first map: all methods' pictures beside the exact one, and "
                 "below each its difference in false colours. Looks at all vertices");
  verb->callback([arguments, &action] { action = [arguments] { make_chart(*arguments); }; });
}

}  // namespace refield::studies
