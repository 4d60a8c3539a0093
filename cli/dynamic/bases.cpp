// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <sstream>
#include <string>

#include "cli/chart/panel.h"
#include "cli/dynamic/basis_pictures.h"
#include "cli/dynamic/basis_study.h"
#include "cli/dynamic/factor_study.h"
#include "cli/verbs.h"
#include "core/files.h"
#include "core/image_io.h"
#include "core/output_lock.h"
#include "simulate/prt/mesh_file.h"
#include "simulate/prt/mesh_shapes.h"

namespace refield::cli {

namespace {

namespace fs = std::filesystem;
using dynamic_chart::BasisRow;
using dynamic_chart::FactorRow;
using dynamic_chart::StudySurface;

struct BasesArguments {
  fs::path folder, mesh;
  float exponent = 10.0f;
  int terms = 4, lamps = 12;
};

const std::vector<int> numbers_of_functions = {1, 2, 4, 8, 16, 32, 64, 128, 256};
constexpr int most_charted = 64;  // figure 8; conditions go on
const std::vector<float> exponents = {4, 8, 16, 32, 64, 128};

/// What figure 8 looks at, and what its bases meet on fewer vertices.
std::vector<StudySurface> surfaces_of(const BasesArguments& arguments) {
  using dynamic::Lobe;
  const auto matte = dynamic::factor({}, {});
  const auto glossy = dynamic::factor({.diffuse = {0.3f, 0.3f, 0.3f},
                                       .specular = {0.5f, 0.5f, 0.5f},
                                       .lobe = Lobe::phong,
                                       .exponent = arguments.exponent},
                                      {.largest = arguments.terms, .error = 0.0});
  const Mesh figure = arguments.mesh.empty() ? prt::hare_mesh(18) : prt::read_mesh_file(arguments.mesh);
  const std::string name = arguments.mesh.empty() ? "hare" : arguments.mesh.stem().string();
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
  text << "exponent,terms,error,lamp_error\n";
  for (const FactorRow& row : rows)
    text << row.exponent << ',' << row.terms << ',' << row.error << ',' << row.lamp_error << '\n';
  return text.str();
}

/// A track for each basis on a surface.
chart::Panel basis_panel(const std::vector<BasisRow>& rows, const std::string& surface,
                         const std::string& title, const char* y_label, int most,
                         double (*y)(const BasisRow&)) {
  chart::Panel panel{title, "functions N", y_label, true, {}, false};
  for (const BasisRow& row : rows) {
    if (row.surface != surface || row.functions > most) continue;
    if (panel.tracks.empty() || panel.tracks.back().label != row.basis)
      panel.tracks.push_back({row.basis, static_cast<int>(panel.tracks.size()), {}});
    panel.tracks.back().points.push_back({static_cast<double>(row.functions), y(row)});
  }
  return panel;
}

chart::Panel factor_panel(const std::vector<FactorRow>& rows, const char* title,
                          double (*y)(const FactorRow&)) {
  chart::Panel panel{title, "terms K", "relative RMSE", true, {}, false};
  for (const FactorRow& row : rows) {
    const std::string label = "n = " + std::to_string(static_cast<int>(row.exponent));
    if (panel.tracks.empty() || panel.tracks.back().label != label)
      panel.tracks.push_back({label, static_cast<int>(panel.tracks.size()), {}});
    panel.tracks.back().points.push_back({static_cast<double>(row.terms), y(row)});
  }
  return panel;
}

std::string basis_chart(const std::vector<BasisRow>& rows, const std::vector<StudySurface>& surfaces) {
  const auto error = [](const BasisRow& row) { return row.error; };
  std::vector<chart::Panel> panels;
  for (std::size_t s = 0; s + 1 < surfaces.size(); ++s)
    panels.push_back(basis_panel(rows, surfaces[s].name, "Error: " + surfaces[s].name,
                                 "relative RMSE, median of lamps", most_charted, error));
  const std::string& few = surfaces.back().name;
  panels.push_back(basis_panel(rows, few, "Condition of eq. 7's matrix: " + few, "condition", 256,
                               [](const BasisRow& row) { return row.condition; }));
  panels.push_back(basis_panel(rows, few, "Error by its inverse: " + few, "relative RMSE", 256,
                               [](const BasisRow& row) { return row.inverse_error.value_or(NAN); }));
  panels.push_back(
      basis_panel(rows, few, "Error by orthonormal weights: " + few, "relative RMSE", 256, error));
  return chart::picture_svg("Light on surfaces in N functions", panels, 3);
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
    const int most = s + 1 < surfaces.size() ? most_charted : numbers_of_functions.back();
    const auto bases = dynamic_chart::bases_of(surfaces[s], rays, most);
    const auto light = dynamic_chart::lamp_light(surfaces[s], rays, arguments.lamps);
    std::ranges::copy(dynamic_chart::study(surfaces[s], bases, light, numbers_of_functions),
                      std::back_inserter(rows));
    if (s < 2) {
      const Eigen::Vector3f away =
          s == 0 ? Eigen::Vector3f(0.3f, 0.5f, -0.2f) : Eigen::Vector3f(0.9f, 0.9f, -1.1f);
      write_png(arguments.folder / (s == 0 ? "bases-floor.png" : "bases-figure.png"),
                dynamic_chart::basis_picture(surfaces[s], bases,
                                             dynamic_chart::lamp_light(surfaces[s], rays, away)));
    }
  }
  print(rows);
  write_text_atomically(arguments.folder / "bases.csv", csv(rows));
  write_text_atomically(arguments.folder / "bases.svg", basis_chart(rows, surfaces));

  const std::vector<FactorRow> factors = dynamic_chart::study_factors(exponents);
  write_text_atomically(arguments.folder / "factors.csv", csv(factors));
  write_text_atomically(
      arguments.folder / "factors.svg",
      chart::picture_svg(
          "Half diffuse, half Phong in K terms",
          {factor_panel(factors, "Error of the BRDF", [](const FactorRow& row) { return row.error; }),
           factor_panel(factors, "Error under a lamp of 34° radius",
                        [](const FactorRow& row) { return row.lamp_error; })},
          2));
  write_png(arguments.folder / "factors.png", dynamic_chart::factor_picture(exponents, 96));
}

}  // namespace

void add_simulate_dynamic_bases(CLI::App& app, const Common&, Action& action) {
  auto arguments = std::make_shared<BasesArguments>();
  CLI::App* verb = app.add_subcommand(
      "dynamic-bases",
      "Compare bases for light on surfaces, and how many terms a glossy BRDF takes\n\n"
      "The experiments behind dynamic scenes: light of lamps on a floor and a figure in 1 to 64 harmonics, "
      "wavelets, cosines or principal components; the condition of the matrix that weights are found with; "
      "Phong's BRDF of exponents 4 to 128 in 1 to 256 terms. See docs/method/dynamic-bases.md.\n"
      "  refield simulate dynamic-bases -o bases\n"
      "  refield simulate dynamic-bases --mesh bunny.obj -o bases");
  verb->add_option("-o,--output", arguments->folder,
                   "Folder for bases.csv, bases.svg, factors.csv, factors.svg and pictures")
      ->required();
  verb->add_option("--mesh", arguments->mesh,
                   "Figure in place of the built-in hare; closed, without handles");
  verb->add_option("--exponent", arguments->exponent, "Phong's exponent of the glossy figure")
      ->capture_default_str()
      ->check(CLI::Range(0.0f, 1e5f));
  verb->add_option("--terms", arguments->terms, "Terms of its BRDF")
      ->capture_default_str()
      ->check(CLI::Range(1, 64));
  verb->add_option("--lamps", arguments->lamps, "Lamps that errors are the median of")
      ->capture_default_str()
      ->check(CLI::Range(1, 1000));
  verb->callback([arguments, &action] { action = [arguments] { make_bases_chart(*arguments); }; });
}

}  // namespace refield::cli
