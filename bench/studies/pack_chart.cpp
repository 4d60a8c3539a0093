// SPDX-License-Identifier: Apache-2.0
#include <array>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <sstream>
#include <variant>

#include "bench/studies/studies.h"
#include "cli/run_context.h"
#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/base/json.h"
#include "core/base/output_lock.h"
#include "core/field_io/packed_field.h"
#include "core/field_io/reflectance_field_file.h"
#include "relight/pack/pack.h"

namespace refield::studies {

namespace {

namespace fs = std::filesystem;

struct PackChartArguments {
  fs::path field, folder;
};

constexpr std::array error_bounds = {1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 2e-5};

std::string header(const PackCost& cost) {
  std::string line = "error_bound,full_megabytes,megabytes,weight_bits,pruned";
  for (const auto& error : cost.errors) line.append(",").append(error.kind);
  return line + "\n";
}

void make_pack_chart(const PackChartArguments& arguments, const Common& common) {
  const OutputLock lock(arguments.folder, {});
  const fs::path packed_path = arguments.folder / "packing.rfield";
  require_not_an_input(packed_path, {arguments.field});
  const auto read = read_either_field(arguments.field, run_context());
  if (std::holds_alternative<PackedField>(read))
    throw InputError(arguments.field.string() + ": is already packed; give the full field");
  const ReflectanceField& field = std::get<ReflectanceField>(read);
  create_folders(arguments.folder);
  std::ostringstream table;
  Json series = Json::array();
  Progress progress(run_context(), "pack", error_bounds.size());
  for (const double bound : error_bounds) {
    run_context().throw_if_stopped();
    const PackResult packed = pack_field(field, bound, run_context());
    write_packed_field(packed_path, packed.field);
    const auto bytes = fs::file_size(packed_path);
    fs::remove(packed_path);
    const PackCost& cost = packed.cost;
    if (series.empty()) table << header(cost);
    table << bound << ',' << 1e-6 * static_cast<double>(fs::file_size(arguments.field)) << ','
          << 1e-6 * static_cast<double>(bytes) << ',' << cost.bits << ','
          << static_cast<double>(cost.pruned) / static_cast<double>(cost.entries);
    for (const auto& error : cost.errors) table << ',' << error.relative_rmse;
    table << '\n';
    series.push_back({{"error_bound", bound}, {"error", cost.worst_error()}, {"bytes", bytes}});
    progress.advance();
    if (!common.json)
      std::printf("error bound %.0e: %6.2f MB, weights of %2d bits, largest error %.1e\n", bound,
                  1e-6 * static_cast<double>(bytes), cost.bits, cost.worst_error());
  }
  write_text_atomically(arguments.folder / "pack.csv", table.str());
  if (common.json) std::printf("%s\n", json_text(series, 2).c_str());
}

}  // namespace

void add_pack_chart(CLI::App& app, const Common& common, Action& action) {
  auto arguments = std::make_shared<PackChartArguments>();
  CLI::App* verb = app.add_subcommand(
      "pack-chart", "Pack a field with error bounds from 1e-2 to 2e-5 and compare size and error");
  verb->footer("Example: refield-studies pack-chart scene.rfield -o pack");
  verb->add_option("field", arguments->field, "Reflectance field that is not packed (.rfield)")->required();
  verb->add_option("-o,--output", arguments->folder, "Folder for pack.csv")->required();
  verb->callback([arguments, &common, &action] {
    action = [arguments, &common] { make_pack_chart(*arguments, common); };
  });
}

}  // namespace refield::studies
