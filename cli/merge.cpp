// SPDX-License-Identifier: Apache-2.0
#include <cstdio>

#include "cli/common/options.h"
#include "cli/report/report.h"
#include "cli/run_context.h"
#include "cli/verbs.h"
#include "core/base/json.h"
#include "core/base/output_lock.h"
#include "core/field_io/field_shard.h"

namespace refield::cli {

namespace {

struct MergeArguments {
  std::vector<fs::path> parts;
  fs::path output;
};

void merge(const MergeArguments& arguments, const Common& common) {
  const auto start = std::chrono::steady_clock::now();
  const OutputLock lock(arguments.output, arguments.parts, ".rfield");
  const ReflectanceField field = merge_field_parts(arguments.parts, arguments.output, run_context());
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  const Json figures = {{"parts", arguments.parts.size()},
                        {"width", field.width},
                        {"height", field.height},
                        {"distinct_boxes", field.basis.boxes.size()},
                        {"kernels", field.transfer.row_start.back()}};
  report::write_run_log(arguments.output, "merge", seconds, figures);
  if (common.json)
    print_json(figures);
  else
    std::printf("%s: %d×%d pixels from %zu shards, %.1f s\n", arguments.output.c_str(), field.width,
                field.height, arguments.parts.size(), seconds);
}

}  // namespace

void add_merge(CLI::App& app, const Common& common, Action& action) {
  const auto arguments = std::make_shared<MergeArguments>();
  CLI::App* verb = app.add_subcommand(
      "merge",
      "Merge the shards of a reflectance field, each estimated with --rows, into one file.\n"
      "\n"
      "The result equals the field of a single run over all rows, byte for byte. The shards may be estimated "
      "at the same time and on different machines.\n"
      "\n"
      "Example:\n"
      "  for i in 1 2 3 4; do refield estimate session --rows $i/4 -o part$i.rfield; done\n"
      "  refield merge part*.rfield -o whole.rfield");
  verb->add_option("parts", arguments->parts,
                   "Shards of one field, in any order; together they must contain every row exactly once")
      ->required();
  verb->add_option("-o,--output", arguments->output, "Reflectance field to write (.rfield)")->required();
  on_command(*verb, arguments, common, action, merge);
}

}  // namespace refield::cli
