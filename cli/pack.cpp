// SPDX-License-Identifier: Apache-2.0
#include <cstdio>

#include "cli/common/options.h"
#include "cli/run_context.h"
#include "cli/verbs.h"
#include "core/base/json.h"
#include "core/base/output_lock.h"
#include "core/field_io/packed_field.h"
#include "core/field_io/reflectance_field_file.h"
#include "relight/pack/pack.h"

namespace refield::cli {

namespace {

struct PackOptions {
  fs::path field;
  fs::path output;
  double error = 1e-3;
};

void print(const fs::path& output, const Json& figures) {
  const double before = figures["bytes_before"], after = figures["bytes"];
  std::printf("%s: %.1f MB instead of %.1f MB, compression ratio %.2f\n", output.c_str(), after * 1e-6,
              before * 1e-6, before / after);
  std::printf("weights of %d bits; %.1f %% of %.0f weights removed\n", figures["weight_bits"].get<int>(),
              100.0 * figures["pruned"].get<double>() / std::max(1.0, figures["weights"].get<double>()),
              figures["weights"].get<double>());
  std::printf("error against the full field (relative RMSE), maximum %.1e:\n",
              figures["max_error"].get<double>());
  for (const auto& [kind, error] : figures["error_by_kind_of_light"].items())
    std::printf("  %-8s %.2e\n", kind.c_str(), error.get<double>());
}

ReflectanceField full_field(const fs::path& path) {
  auto either = read_either_field(path, run_context());
  if (std::holds_alternative<PackedField>(either))
    throw InputError(path, ": is already packed, and the errors would accumulate; give the full field");
  return std::get<ReflectanceField>(std::move(either));
}

void pack(const PackOptions& options, const Common& common) {
  const OutputLock lock(options.output, {options.field}, ".rfield");
  const PackResult packed = pack_field(full_field(options.field), options.error, run_context());
  Json figures = json_from_text(packed.field.outline.provenance)["pack"];
  write_packed_field(options.output, packed.field);
  figures["bytes_before"] = fs::file_size(options.field);
  figures["bytes"] = fs::file_size(options.output);
  if (common.json)
    print_json(figures);
  else
    print(options.output, figures);
}

}  // namespace

void add_pack(CLI::App& app, const Common& common, Action& action) {
  const auto options = std::make_shared<PackOptions>();
  CLI::App* verb = app.add_subcommand(
      "pack",
      "Compress a reflectance field to a given maximum error.\n"
      "\n"
      "Weights are quantised to 8 or 16 bits, kernels shared by neighbouring pixels are stored once, and "
      "kernels with little energy are removed. A packed field can be used like any other field. The error is "
      "the relative RMSE of relit images against the full field under five kinds of light (white, single "
      "texels, bars, small squares, smooth); each of them stays below the given maximum.\n"
      "\n"
      "Example:\n"
      "  refield pack scene.rfield -o small.rfield --max-error 1e-3");
  verb->add_option("field", options->field, "Reflectance field (.rfield)")->required();
  verb->add_option("-o,--output", options->output, "Packed field to write (.rfield)")->required();
  verb->add_option("--max-error", options->error,
                   "Maximum relative RMSE of relit images against the full field, 2e-5 or more")
      ->check(positive_number())
      ->capture_default_str();
  on_command(*verb, options, common, action, pack);
}

}  // namespace refield::cli
