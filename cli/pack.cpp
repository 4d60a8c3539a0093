// SPDX-License-Identifier: Apache-2.0
#include <array>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "cli/chart/panel.h"
#include "cli/option_checks.h"
#include "cli/verbs.h"
#include "core/errors.h"
#include "core/files.h"
#include "core/interrupt.h"
#include "core/json_text.h"
#include "core/output_lock.h"
#include "core/packed_field_file.h"
#include "core/progress.h"
#include "core/reflectance_field_file.h"
#include "relight/pack.h"

namespace refield::cli {

namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

struct PackOptions {
  fs::path field;
  fs::path output;
  fs::path chart;
  double error = 1e-3;
};

constexpr std::array charted_errors = {1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 2e-5};

ordered_json figures_of(const PackCost& cost, double asked) {
  ordered_json by_kind = ordered_json::object();
  for (const auto& error : cost.errors) by_kind[error.kind] = error.relative_rmse;
  return {{"error_asked", asked},     {"error", cost.worst_error()}, {"error_by_kind_of_light", by_kind},
          {"weight_bits", cost.bits}, {"weights", cost.entries},     {"pruned", cost.pruned}};
}

/// Says in the packed field what was done to it, beside how it was made.
void add_to_provenance(std::string& provenance, const ordered_json& figures) {
  ordered_json origin = ordered_json::parse(provenance, nullptr, false);
  if (!origin.is_object()) origin = {{"field", provenance}};
  origin["pack"] = figures;
  provenance = json_text(origin);
}

void print(const fs::path& output, const ordered_json& figures) {
  const double before = figures["bytes_before"], after = figures["bytes"];
  std::printf("%s: %.1f MB of %.1f MB, one in %.2f\n", output.c_str(), after * 1e-6, before * 1e-6,
              before / after);
  std::printf("weights of %d bits, %.1f %% of %.0f left out for their little energy\n",
              figures["weight_bits"].get<int>(),
              100.0 * figures["pruned"].get<double>() / std::max(1.0, figures["weights"].get<double>()),
              figures["weights"].get<double>());
  std::printf("error against the full field (relative RMSE), asked %.1e:\n",
              figures["error_asked"].get<double>());
  for (const auto& [kind, error] : figures["error_by_kind_of_light"].items())
    std::printf("  %-8s %.2e\n", kind.c_str(), error.get<double>());
}

ReflectanceField full_field(const fs::path& path) {
  auto either = read_either_field(path);
  if (std::holds_alternative<PackedField>(either))
    throw InputError(path.string() + ": is packed already, and errors would add up; give the full field");
  return std::get<ReflectanceField>(std::move(either));
}

/// Packs the field into a file, and says what came of it.
ordered_json pack_into(const ReflectanceField& field, double error, const PackOptions& options,
                       const fs::path& output) {
  PackResult packed = pack_field(field, error);
  ordered_json figures = figures_of(packed.cost, error);
  add_to_provenance(packed.field.outline.provenance, figures);
  write_packed_field(output, packed.field);
  figures["bytes_before"] = fs::file_size(options.field);
  figures["bytes"] = fs::file_size(output);
  return figures;
}

/// Size against error as a table and a picture, a line for each kind of light.
void write_chart(const fs::path& folder, const fs::path& field, const ordered_json& series) {
  const double before = series.front()["bytes_before"];
  char size[32];
  std::snprintf(size, sizeof size, "%.1f", before * 1e-6);
  chart::Panel panel{.title = "Relit pictures against the full field's, by kind of light",
                     .x_label = "size, MB (the full field: " + std::string(size) + " MB)",
                     .y_label = "relative RMSE",
                     .lines = true,
                     .tracks = {},
                     .front = false};
  std::string table = "asked,megabytes,weight_bits,pruned";
  for (const auto& [kind, error] : series.front()["error_by_kind_of_light"].items()) {
    table.append(",").append(kind);
    panel.tracks.push_back({kind, static_cast<int>(panel.tracks.size()), {}});
  }
  for (const ordered_json& figures : series) {
    const double megabytes = figures["bytes"].get<double>() * 1e-6;
    table += "\n" + json_text(figures["error_asked"]) + "," + json_text(ordered_json(megabytes)) + "," +
             json_text(figures["weight_bits"]) + "," +
             json_text(ordered_json(figures["pruned"].get<double>() / figures["weights"].get<double>()));
    for (chart::Track& track : panel.tracks) {
      const auto& error = figures["error_by_kind_of_light"][track.label];
      table.append(",").append(json_text(error));
      track.points.push_back({megabytes, error.get<double>()});
    }
  }
  for (chart::Track& track : panel.tracks) std::ranges::sort(track.points);
  write_text_atomically(folder / "pack.csv", table + "\n");
  write_text_atomically(
      folder / "pack.svg",
      chart::picture_svg(field.filename().string() + " packed: size against error", {panel}, 1));
}

void chart_packing(const PackOptions& options, const Common& common) {
  const OutputLock lock(options.chart, {});
  const fs::path packed = options.chart / "packing.rfield";
  require_not_an_input(packed, {options.field});
  const ReflectanceField field = full_field(options.field);
  create_folders(options.chart);
  ordered_json series = ordered_json::array();
  Progress progress("pack", charted_errors.size());
  for (const double error : charted_errors) {
    throw_if_interrupted();
    series.push_back(pack_into(field, error, options, packed));
    fs::remove(packed);
    progress.advance();
    if (!common.json)
      std::printf("asked %.0e: %6.2f MB, weights of %2d bits, worst error %.1e\n", error,
                  series.back()["bytes"].get<double>() * 1e-6, series.back()["weight_bits"].get<int>(),
                  series.back()["error"].get<double>());
  }
  write_chart(options.chart, options.field, series);
  if (common.json)
    std::printf("%s\n", json_text(series, 2).c_str());
  else
    std::printf("%s\n", (options.chart / "pack.svg").c_str());
}

void pack(const PackOptions& options, const Common& common) {
  if (!options.chart.empty()) return chart_packing(options, common);
  if (options.output.empty())
    throw InputError("--output or --chart is needed: where is the packed field to go?");
  const OutputLock lock(options.output, {options.field}, ".rfield");
  const ordered_json figures = pack_into(full_field(options.field), options.error, options, options.output);
  if (common.json)
    std::printf("%s\n", json_text(figures, 2).c_str());
  else
    print(options.output, figures);
}

}  // namespace

void add_pack(CLI::App& app, const Common& common, Action& action) {
  const auto options = std::make_shared<PackOptions>();
  CLI::App* verb =
      app.add_subcommand("pack", "Make a reflectance field smaller, to an error that you ask for");
  verb->footer(
      "Weights become whole numbers of 8 or 16 bits, kernels that neighbouring pixels share are named once\n"
      "for all of them, and kernels that carry little of the picture's energy are left out. The packed "
      "field\n"
      "goes wherever a field goes. The error is that of relit pictures under five kinds of light: white,\n"
      "scattered texels, bars, small squares, smooth; each stays below what is asked.\n"
      "Examples: refield pack scene.rfield -o small.rfield --error 1e-3\n"
      "          refield pack scene.rfield --chart folder   (which error is worth its bytes?)");
  verb->add_option("field", options->field, "Reflectance field (.rfield)")->required();
  auto* output = verb->add_option("-o,--output", options->output, "Packed field to write (.rfield)");
  verb->add_option("--error", options->error,
                   "Largest relative RMSE of relit pictures against the full field; 2e-5 and more can be had")
      ->check(positive_number())
      ->capture_default_str();
  verb->add_option("--chart", options->chart,
                   "Instead: try errors from 1e-2 to 2e-5 and write size against error to FOLDER/pack.csv "
                   "and pack.svg")
      ->type_name("FOLDER")
      ->excludes(output);
  verb->callback([options, &common, &action] { action = [options, &common] { pack(*options, common); }; });
}

}  // namespace refield::cli
