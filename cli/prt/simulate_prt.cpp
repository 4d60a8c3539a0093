// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "cli/option_checks.h"
#include "cli/prt/measure.h"
#include "cli/verbs.h"
#include "core/errors.h"
#include "core/json_text.h"
#include "core/output_lock.h"
#include "core/packed_field_file.h"
#include "relight/pack.h"
#include "simulate/prt/clusters.h"
#include "simulate/prt/harmonic_field.h"

namespace refield::cli {

namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

struct PrtArguments {
  fs::path scene, output;
  std::string method = "clusters", similarity = "group", window = "none";
  prt::ClusterOptions clusters;
  prt::HarmonicOptions harmonics;
  std::optional<double> epsilon;
  bool image = false, measure = false;
  int bits = 8;
};

struct NamedSimilarity {
  const char* name;
  prt::Similarity similarity;
  double epsilon;  ///< by default
};
constexpr NamedSimilarity similarities[] = {
    {"group", prt::Similarity::group, 1e-4},
    {"solid-angle", prt::Similarity::all_by_solid_angle, 4e-5},
    {"all", prt::Similarity::all_outputs, 5e-5}};  // Johan and Nishita, section 6.1, for 73 196 vertices

/// Figures of the computation for the summary; fills in `rows`.
ordered_json compute_clusters(const prt::Scene& scene, PrtArguments arguments, FieldRows& rows) {
  prt::ClusterOptions& options = arguments.clusters;
  const NamedSimilarity& chosen = *std::ranges::find_if(
      similarities, [&](const auto& each) { return arguments.similarity == each.name; });
  options.similarity = chosen.similarity;
  options.epsilon = arguments.epsilon.value_or(chosen.epsilon);
  options.relighting = arguments.image ? prt::Relighting::image : prt::Relighting::geometry;
  prt::ClusterStatistics statistics;
  rows = prt::cluster_transfer(scene, options, statistics);
  return ordered_json::parse(rows.outline.provenance);
}

ordered_json compute_harmonics(const prt::Scene& scene, PrtArguments arguments, FieldRows& rows) {
  prt::HarmonicOptions& options = arguments.harmonics;
  if (arguments.window == "hann") options.window = HarmonicWindow::hann;
  if (arguments.window == "lanczos") options.window = HarmonicWindow::lanczos;
  options.check();
  prt::HarmonicStatistics statistics;
  rows =
      prt::harmonic_field(scene, prt::harmonic_transfer(scene, options, statistics), options.map_resolution);
  return {{"order", options.order},
          {"window", arguments.window},
          {"directions", options.directions},
          {"radius", options.radius},
          {"pass_energy", statistics.pass_energy}};
}

void simulate_prt(const PrtArguments& arguments, const Common& common) {
  const auto start = std::chrono::steady_clock::now();
  if (arguments.image && arguments.method == "sh")
    throw InputError("--image goes with --method clusters; harmonics are for vertices seen from anywhere");
  const OutputLock lock(arguments.output, {arguments.scene}, ".rfield");
  prt::Scene scene = prt::read_scene(arguments.scene);
  prt::sort_vertices(scene);
  FieldRows rows;
  ordered_json figures = arguments.method == "sh" ? compute_harmonics(scene, arguments, rows)
                                                  : compute_clusters(scene, arguments, rows);
  ordered_json provenance{{"program", "refield " REFIELD_VERSION},
                          {"scene", arguments.scene.filename().string()},
                          {"method", arguments.method}};
  provenance.update(figures);
  rows.outline.provenance = json_text(provenance);
  if (!rows.outline.mesh.empty()) rows.outline.camera = scene.camera;
  PackedField packed = pack_rows(std::move(rows), arguments.bits);
  write_packed_field(arguments.output, packed);

  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  figures["vertices"] = scene.mesh.positions.size();
  figures["field"] = arguments.output.string();
  figures["bytes"] = fs::file_size(arguments.output);
  figures["seconds"] = seconds;
  if (arguments.measure) {
    Relighter relighter(std::move(packed));
    const auto times = prt_chart::measure_relighting(relighter);
    figures["relight_ms"] = times.whole_ms;
    figures["two_lamps_ms"] = times.two_lamps_ms;
    figures["update_error"] = times.update_error;
  }
  if (common.json) {
    std::printf("%s\n", json_text(figures, 2).c_str());
    return;
  }
  std::printf("%s: %zu vertices, %.1f MB, in %.1f s\n", arguments.output.c_str(), scene.mesh.positions.size(),
              static_cast<double>(fs::file_size(arguments.output)) / 1e6, seconds);
  if (figures.contains("clusters"))
    std::printf("%llu squares of light, %.0f a vertex\n",
                static_cast<unsigned long long>(figures["clusters"].get<std::uint64_t>()),
                figures["entries"].get<double>() / static_cast<double>(scene.mesh.positions.size()));
  if (arguments.measure)
    std::printf("relighting %.2f ms, two lamps moved %.2f ms\n", figures["relight_ms"].get<double>(),
                figures["two_lamps_ms"].get<double>());
}

void add_cluster_options(CLI::App& verb, PrtArguments& arguments) {
  const char* group = "Clustered environment lights (--method clusters)";
  prt::ClusterOptions& options = arguments.clusters;
  verb.add_option("--resolution", options.resolution, "R: light comes from cube maps of R×R texels a face")
      ->capture_default_str()
      ->check(CLI::Range(1, 4096))
      ->group(group);
  verb.add_option(
          "--epsilon", arguments.epsilon,
          "What is let pass when lights are taken for one; smaller is more exact and larger. Default: 1e-4 "
          "(group) or 4e-5 (solid-angle) of white, 5e-5 as in the paper (all)")
      ->check(positive_number())
      ->group(group);
  verb.add_option(
          "--similarity", arguments.similarity,
          "Who decides which lights are alike: 'group', 16 neighbouring vertices each for themselves, "
          "or all vertices together, by what a square of light can bring ('solid-angle') or, as in the "
          "paper, by its transfer alone ('all', equation 11)")
      ->check(CLI::IsMember({"group", "solid-angle", "all"}))
      ->capture_default_str()
      ->group(group);
  verb.add_option("--samples", options.samples, "Lights tried along a square's side")
      ->capture_default_str()
      ->check(CLI::Range(2, 16))
      ->group(group);
  verb.add_flag(
          "--image", arguments.image,
          "Relight the picture of the scene's camera, with any material, in place of a diffuse mesh that "
          "is seen from anywhere")
      ->group(group);
}

void add_harmonic_options(CLI::App& verb, PrtArguments& arguments) {
  const char* group = "Spherical harmonics (--method sh)";
  prt::HarmonicOptions& options = arguments.harmonics;
  verb.add_option("--order", options.order, "n: n² harmonics; more for sharper light and shadow")
      ->capture_default_str()
      ->check(CLI::Range(2, 8))
      ->group(group);
  verb.add_option("--directions", options.directions, "Rays a vertex")
      ->capture_default_str()
      ->check(CLI::Range(16, 1 << 20))
      ->group(group);
  verb.add_option("--until", options.until,
                  "Interreflection ends with a pass that brings less than this share of the first; 1: none")
      ->capture_default_str()
      ->check(positive_number())
      ->group(group);
  verb.add_option("--radius", options.radius,
                  "Of the sphere that lights stand on, for light that falls off with distance; 0: far away")
      ->capture_default_str()
      ->check(non_negative_number())
      ->group(group);
  verb.add_option("--window", arguments.window, "Damps the ringing of sharp lights: none, hann, lanczos")
      ->capture_default_str()
      ->check(CLI::IsMember({"none", "hann", "lanczos"}))
      ->group(group);
}

}  // namespace

void add_simulate_prt(CLI::App& app, const Common& common, Action& action) {
  auto arguments = std::make_shared<PrtArguments>();
  CLI::App* verb =
      app.add_subcommand("prt",
                         "Precompute how meshes turn light into shading, for relighting in real time\n\n"
                         "  refield simulate prt datasets_synthetic/prt/hare.toml -o hare.rfield\n"
                         "  refield relight hare.rfield --env sky.exr -o hare.png\n"
                         "  refield view hare.rfield\n"
                         "  refield simulate prt scene.toml --image -o glossy.rfield\n"
                         "  refield simulate prt bunny.ply --method sh --order 5 -o bunny.rfield\n\n"
                         "docs/method/prt.md compares the methods.");
  verb->add_option("scene", arguments->scene,
                   "Scene (TOML, docs/reference/mesh-scenes.md) or mesh (OBJ, PLY, OFF, glTF)")
      ->required();
  verb->add_option("-o,--output", arguments->output, "Reflectance field to write (.rfield)")->required();
  verb->add_option("--method", arguments->method,
                   "clusters: all frequencies of light; sh: soft light alone, and the smallest field")
      ->check(CLI::IsMember({"clusters", "sh"}))
      ->capture_default_str();
  verb->add_option("--bits", arguments->bits, "Of a weight: 8 (4e-4 of error) or 16")
      ->check(CLI::IsMember({8, 16}))
      ->capture_default_str();
  verb->add_flag("--measure", arguments->measure, "Measure how fast the field is relit, too");
  add_cluster_options(*verb, *arguments);
  add_harmonic_options(*verb, *arguments);
  verb->callback(
      [arguments, &common, &action] { action = [arguments, &common] { simulate_prt(*arguments, common); }; });
}

}  // namespace refield::cli
