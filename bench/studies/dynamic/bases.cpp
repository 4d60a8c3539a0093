// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <sstream>
#include <string>

#include "bench/studies/dynamic/basis_pictures.h"
#include "bench/studies/dynamic/basis_study.h"
#include "bench/studies/dynamic/factor_study.h"
#include "bench/studies/studies.h"
#include "cli/run_context.h"
#include "core/base/files.h"
#include "core/base/output_lock.h"
#include "core/image/image_io.h"
#include "simulate/geometry/mesh_file.h"
#include "simulate/geometry/mesh_shapes.h"

namespace refield::studies {

namespace {

namespace fs = std::filesystem;
using dynamic_chart::BasisRow;
using dynamic_chart::FactorRow;
using dynamic_chart::StudySurface;

struct BasesArguments {
  fs::path folder, mesh;
  float exponent = 10.0f;
  int terms = 4, area_lights = 12;
};

const std::vector<int> numbers_of_functions = {1, 2, 4, 8, 16, 32, 64, 128, 256};
constexpr int max_charted = 64;  // figure 8; conditions go on
const std::vector<float> exponents = {4, 8, 16, 32, 64, 128};

/// What figure 8 looks at, and what its bases meet on fewer vertices.
std::vector<StudySurface> surfaces_of(const BasesArguments& arguments) {
  using dynamic::Lobe;
  const auto matte = dynamic::factor({}, {}, run_context());
  const auto glossy = dynamic::factor({.diffuse = {0.3f, 0.3f, 0.3f},
                                       .specular = {0.5f, 0.5f, 0.5f},
                                       .lobe = Lobe::phong,
                                       .exponent = arguments.exponent},
                                      {.largest = arguments.terms, .error = 0.0}, run_context());
  const Mesh figure = arguments.mesh.empty() ? prt::rabbit_mesh(18)
                                             : prt::read_mesh_file(arguments.mesh, {}, run_context()).mesh;
  const std::string name = arguments.mesh.empty() ? "rabbit" : arguments.mesh.stem().string();
  return {{"floor", prt::plane_mesh(63), matte},
          {name, figure, matte},
          {name + ", glossy", figure, glossy},
          {"box of 150 vertices", prt::box_mesh(4), matte}};
}

std::string csv(const std::vector<BasisRow>& rows) {
  std::ostringstream text;
  text << "surface,basis,functions,kept,condition,error,inverse_error\n";
  for (const BasisRow& row : rows) {
    text << '"' << row.surface << "\",\"" << row.basis << "\"," << row.functions << ',' << row.kept << ','
         << row.condition << ',' << row.error << ',';
    if (row.inverse_error) text << *row.inverse_error;
    text << '\n';
  }
  return text.str();
}

std::string csv(const std::vector<FactorRow>& rows) {
  std::ostringstream text;
  text << "exponent,terms,error,area_light_error\n";
  for (const FactorRow& row : rows)
    text << row.exponent << ',' << row.terms << ',' << row.error << ',' << row.area_light_error << '\n';
  return text.str();
}

void print(const std::vector<BasisRow>& rows) {
  std::printf("%-22s %-16s %4s %5s %10s %8s %8s\n", "surface", "basis", "N", "kept", "condition", "error",
              "inverse");
  for (const BasisRow& row : rows) {
    std::printf("%-22s %-16s %4d %5ld %10.3g %8.4f ", row.surface.c_str(), row.basis.c_str(), row.functions,
                static_cast<long>(row.kept), row.condition, row.error);
    if (row.inverse_error)
      std::printf("%8.4f\n", *row.inverse_error);
    else
      std::printf("%8s\n", "none");
  }
}

void make_bases_chart(const BasesArguments& arguments) {
  const std::vector<StudySurface> surfaces = surfaces_of(arguments);
  const OutputLock lock(arguments.folder, {});
  create_folders(arguments.folder);
  std::vector<BasisRow> rows;
  for (std::size_t s = 0; s < surfaces.size(); ++s) {
    const prt::MeshRays rays(surfaces[s].mesh);
    const int most = s + 1 < surfaces.size() ? max_charted : numbers_of_functions.back();
    const auto bases = dynamic_chart::bases_of(surfaces[s], rays, most);
    const auto light = dynamic_chart::area_light_terms(surfaces[s], rays, arguments.area_lights);
    std::ranges::copy(dynamic_chart::study(surfaces[s], bases, light, numbers_of_functions),
                      std::back_inserter(rows));
    if (s < 2) {
      const Eigen::Vector3f away =
          s == 0 ? Eigen::Vector3f(0.3f, 0.5f, -0.2f) : Eigen::Vector3f(0.9f, 0.9f, -1.1f);
      write_png(arguments.folder / (s == 0 ? "bases-floor.png" : "bases-figure.png"),
                dynamic_chart::basis_picture(surfaces[s], bases,
                                             dynamic_chart::area_light_terms(surfaces[s], rays, away)));
    }
  }
  print(rows);
  write_text_atomically(arguments.folder / "bases.csv", csv(rows));

  const std::vector<FactorRow> factors = dynamic_chart::study_factors(exponents);
  write_text_atomically(arguments.folder / "factors.csv", csv(factors));
  write_png(arguments.folder / "factors.png", dynamic_chart::factor_picture(exponents, 96));
}

}  // namespace

void add_dynamic_bases(CLI::App& app, Action& action) {
  auto arguments = std::make_shared<BasesArguments>();
  CLI::App* verb =
      app.add_subcommand("dynamic-bases", "Compare bases for light on surfaces, and numbers of BRDF terms");
  verb->footer(
      "Light of area lights on a floor and on a figure in 1 to 64 spherical harmonics, wavelets, cosines or "
      "principal\n"
      "components; the condition of the matrix that gives the weights; Phong BRDFs with exponents 4 to 128 "
      "in 1 to\n"
      "256 terms. docs/method/dynamic-bases.md explains them.\n"
      "Examples: refield-studies dynamic-bases -o bases\n"
      "          refield-studies dynamic-bases --mesh bunny.obj -o bases");
  verb->add_option("-o,--output", arguments->folder, "Folder for bases.csv, factors.csv and pictures")
      ->required();
  verb->add_option("--mesh", arguments->mesh,
                   "Figure in place of the built-in rabbit; closed, without handles");
  verb->add_option("--exponent", arguments->exponent, "Phong's exponent of the glossy figure")
      ->capture_default_str()
      ->check(CLI::Range(0.0f, 1e5f));
  verb->add_option("--terms", arguments->terms, "Terms of its BRDF")
      ->capture_default_str()
      ->check(CLI::Range(1, 64));
  verb->add_option("--area-lights", arguments->area_lights, "Area lights that errors are the median of")
      ->capture_default_str()
      ->check(CLI::Range(1, 1000));
  verb->callback([arguments, &action] { action = [arguments] { make_bases_chart(*arguments); }; });
}

}  // namespace refield::studies
