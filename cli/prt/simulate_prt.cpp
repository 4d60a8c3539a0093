// SPDX-License-Identifier: Apache-2.0
#include <cstdio>

#include "cli/common/options.h"
#include "cli/run_context.h"
#include "cli/verbs.h"
#include "core/base/json.h"
#include "core/base/output_lock.h"
#include "core/field_io/packed_field.h"
#include "relight/pack/pack.h"
#include "simulate/prt/clusters.h"
#include "simulate/prt/harmonic_transfer.h"

namespace refield::cli {

namespace {

struct PrtArguments {
  fs::path scene, output;
  std::string method = "clusters", mode = "refined";
  prt::ClusterOptions clusters;
  prt::HarmonicOptions harmonics;
  std::optional<double> epsilon;
  bool image = false;
};

constexpr int weight_bits = 8;  // relative error 4e-4

FieldRows precomputed(const prt::Scene& scene, const PrtArguments& arguments) {
  if (arguments.method == "sh") return prt::harmonic_field(scene, arguments.harmonics, run_context());
  prt::ClusterOptions options = arguments.clusters;
  const bool paper = arguments.mode == "paper";
  options.similarity = paper ? prt::Similarity::all_outputs : prt::Similarity::group;
  // The paper's ε: Johan and Nishita, section 6.1, for 73 196 vertices.
  options.epsilon = arguments.epsilon.value_or(paper ? 5e-5 : 1e-4);
  options.relighting = arguments.image ? prt::Relighting::image : prt::Relighting::geometry;
  prt::ClusterStatistics statistics;
  return prt::cluster_transfer(scene, options, statistics, run_context());
}

void simulate_prt(const PrtArguments& arguments, const Common& common) {
  const auto start = std::chrono::steady_clock::now();
  const OutputLock lock(arguments.output, {arguments.scene}, ".rfield");
  const bool glossy = arguments.method == "sh" || arguments.image;
  prt::Scene scene =
      prt::read_scene(arguments.scene, run_context(), glossy ? prt::Gloss::lobes : prt::Gloss::diffuse);
  prt::sort_vertices(scene);
  FieldRows rows = precomputed(scene, arguments);
  auto figures = json_from_text(rows.outline.provenance);
  Json provenance{{"program", "refield " REFIELD_VERSION},
                  {"scene", arguments.scene.filename().string()},
                  {"method", arguments.method}};
  provenance.update(figures);
  rows.outline.provenance = json_text(provenance);
  if (rows.outline.mesh) rows.outline.mesh->camera = scene.camera;
  write_packed_field(arguments.output, pack_rows(std::move(rows), weight_bits, run_context()));

  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  figures["vertices"] = scene.mesh.positions.size();
  figures["field"] = arguments.output.string();
  figures["bytes"] = fs::file_size(arguments.output);
  figures["seconds"] = seconds;
  if (figures.contains("clusters") && figures["clusters"].get<std::uint64_t>() == 0)
    run_context().note(arguments.scene,
                       ": no light reaches any vertex, so that every picture is black; if the surfaces face "
                       "inwards, flip their normals (the winding of their faces)");
  if (common.json) return print_json(figures);
  std::printf("%s: %zu vertices, %.1f MB, in %.1f s\n", arguments.output.c_str(), scene.mesh.positions.size(),
              static_cast<double>(fs::file_size(arguments.output)) / 1e6, seconds);
  if (figures.contains("clusters"))
    std::printf("%llu light clusters, %.0f per vertex\n",
                static_cast<unsigned long long>(figures["clusters"].get<std::uint64_t>()),
                figures["entries"].get<double>() / static_cast<double>(scene.mesh.positions.size()));
}

constexpr std::array cluster_options = {"--resolution",      "--mode",  "--epsilon",
                                        "--diffuse-bounces", "--image", "--pixel-samples"};
constexpr std::array harmonic_options = {"--sh-order", "--directions", "--radius"};

/// Throws InputError for an option of the method that was not chosen.
void refuse_foreign_options(const CLI::App& verb, const std::string& method) {
  const auto refuse = [&](const char* option, const char* other) {
    if (verb.count(option) > 0)
      throw InputError(option, " is an option of --method ", other, "; omit it with --method ", method);
  };
  if (method == "sh")
    for (const char* option : cluster_options) refuse(option, "clusters");
  else
    for (const char* option : harmonic_options) refuse(option, "sh");
}

void add_cluster_options(CLI::App& verb, PrtArguments& arguments) {
  prt::ClusterOptions& options = arguments.clusters;
  verb.add_option("--resolution", options.resolution,
                  "Width in texels of each face of the environment cube map (R), with clusters")
      ->capture_default_str()
      ->check(CLI::Range(1, 4096));
  verb.add_option("--mode", arguments.mode,
                  "Mode: refined (light clusters per group of 16 neighbouring vertices) or paper (for all "
                  "vertices together, equation 11 of Johan and Nishita)")
      ->check(CLI::IsMember({"refined", "paper"}))
      ->capture_default_str();
  verb.add_option("--epsilon", arguments.epsilon,
                  "Clustering error threshold ε; smaller values give smaller errors and larger fields "
                  "(default: 1e-4; in paper mode 5e-5)")
      ->check(positive_number());
  verb.add_option("--diffuse-bounces", options.bounces,
                  "Number of diffuse reflections of indirect light, with clusters")
      ->capture_default_str()
      ->check(CLI::Range(0, 16));
  CLI::Option* image = verb.add_flag("--image", arguments.image,
                                     "Precompute the image of the scene's camera, with any material, instead "
                                     "of a diffuse mesh for arbitrary views; with clusters");
  verb.add_option("--pixel-samples", options.pixel_samples,
                  "With --image: samples along each side of a pixel, against aliased edges")
      ->capture_default_str()
      ->check(CLI::Range(1, 8))
      ->needs(image)
      ->group(further);
}

void add_harmonic_options(CLI::App& verb, PrtArguments& arguments) {
  prt::HarmonicOptions& options = arguments.harmonics;
  verb.add_option("--sh-order", options.order,
                  "Order n of the spherical harmonics (n² coefficients); higher orders give sharper light "
                  "and shadows")
      ->capture_default_str()
      ->check(CLI::Range(2, 8));
  verb.add_option("--directions", options.directions, "Number of rays per vertex, with spherical harmonics")
      ->capture_default_str()
      ->check(CLI::Range(64, 1 << 20))
      ->group(further);
  verb.add_option("--radius", options.radius,
                  "Radius in scene units of the sphere on which the lights are, for light that decreases "
                  "with distance; 0: distant light; with spherical harmonics")
      ->capture_default_str()
      ->check(non_negative_number())
      ->group(further);
}

}  // namespace

void add_precompute(CLI::App& app, const Common& common, Action& action) {
  auto arguments = std::make_shared<PrtArguments>();
  CLI::App* verb =
      app.add_subcommand("precompute",
                         "Precompute radiance transfer of a mesh scene for real-time relighting.\n"
                         "\n"
                         "docs/method/prt.md compares the methods.\n"
                         "\n"
                         "Examples:\n"
                         "  refield precompute datasets_synthetic/prt/rabbit.toml -o rabbit.rfield\n"
                         "  refield relight rabbit.rfield --env sky.exr -o rabbit.png\n"
                         "  refield view rabbit.rfield\n"
                         "  refield precompute scene.toml --image -o glossy.rfield\n"
                         "  refield precompute bunny.ply --method sh --sh-order 5 -o bunny.rfield");
  verb->add_option("scene", arguments->scene,
                   "Scene (.toml, docs/reference/scene-files.md) or mesh (OBJ, PLY, OFF, glTF)")
      ->required();
  verb->add_option("-o,--output", arguments->output, "Reflectance field to write (.rfield)")->required();
  verb->add_option("--method", arguments->method,
                   "Representation of the illumination: clusters (clustered environment lights, all "
                   "frequencies) or sh (spherical harmonics, low frequencies only, the smallest field)")
      ->check(CLI::IsMember({"clusters", "sh"}))
      ->capture_default_str();
  add_cluster_options(*verb, *arguments);
  add_harmonic_options(*verb, *arguments);
  on_command(*verb, arguments, common, action, [verb](const PrtArguments& given, const Common& how) {
    refuse_foreign_options(*verb, given.method);
    simulate_prt(given, how);
  });
}

}  // namespace refield::cli
