// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/chart/chart.h"

#include <algorithm>
#include <tuple>

#include "bench/studies/chart/derived_kinds.h"
#include "bench/studies/chart/measure.h"
#include "cli/run_context.h"
#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/base/json.h"
#include "estimate/estimate.h"

namespace refield::chart {

namespace fs = std::filesystem;

namespace {

constexpr const char* data_record_name = "data.json";

/// Names the data that rows were measured on, so that rows of other data are never taken over.
std::string describe(const ChartData& data, const Sources& sources) {
  const auto stamp = [](const fs::path& path) {
    return Json{{"path", fs::absolute(path).lexically_normal().string()},
                {"bytes", fs::file_size(path)},
                {"modified", fs::last_write_time(path).time_since_epoch().count()}};
  };
  Json description = {{"reference", data.reference_note},
                      {"truth", sources.truth.string()},
                      {"clip_level", std::to_string(sources.clip_level)}};
  if (sources.kinds) description["kinds"] = stamp(*sources.kinds);
  if (data.session.mask) description["mask"] = stamp(*data.session.mask);
  const CaptureSession& test = sources.test ? *sources.test : sources.session;
  for (const auto* frames : {&data.session.frames, &test.frames})
    for (const CaptureFrame& frame : *frames) {
      description["files"].push_back(stamp(frame.illumination));
      description["files"].push_back(stamp(frame.observed));
    }
  return json_text(description, 1) + "\n";
}

std::vector<int> image_counts(const std::vector<int>& asked, int available) {
  std::vector<int> counts = asked;
  if (counts.empty()) {
    for (const int count : {25, 50, 100, 180})
      if (count < available) counts.push_back(count);
    counts.push_back(available);
  }
  std::ranges::sort(counts);
  counts.erase(std::unique(counts.begin(), counts.end()), counts.end());
  for (const int count : {counts.front(), counts.back()})
    if (count < 2 || count > available)
      throw InputError("--images " + std::to_string(count) + ": give numbers from 2 to the " +
                       std::to_string(available) + " training images that there are");
  return counts;
}

/// Rows of the folder's earlier chart, where it is of the same data.
std::vector<ChartRow> earlier_rows(const fs::path& folder, const std::string& description,
                                   const std::vector<std::string>& names) {
  if (!fs::exists(folder / "chart.csv")) return {};
  if (!fs::exists(folder / data_record_name) || read_text(folder / data_record_name) != description)
    throw InputError(folder.string() +
                     ": its rows were measured on other data; leave --resume out to replace them, or give "
                     "another folder");
  return rows_of_csv(folder / "chart.csv", names);
}

bool same_row(const ChartRow& row, const Task& task) {
  return row.method == task.method && row.setting == task.setting && row.images == task.images;
}

/// By number of images, then as all_methods() and --max-kernels have them, whatever order they were measured
/// in.
void sort_rows(std::vector<ChartRow>& rows) {
  const auto place = [](const ChartRow& row) {
    const auto found = std::ranges::find(all_methods(), row.method, &Method::name);
    return std::tuple(row.images, found - all_methods().begin(), row.setting != "default", row.setting.size(),
                      row.setting);
  };
  std::ranges::stable_sort(rows, {}, place);
}

void derive_kinds(ChartData& data, const ChartOptions& options, const fs::path& folder, bool resume) {
  const fs::path path = folder / "kinds.png";
  data.kinds_note = "pixel classes derived from the spread of our own field's transport, not from the scene";
  if (resume && fs::exists(path)) {
    data.pixel_kinds = read_pixel_kinds(path, data.session.width, data.session.height);
    return;
  }
  EstimateOptions estimate = options.estimate;
  estimate.kernels = std::min(estimate.kernels, static_cast<int>(data.session.frames.size()));
  data.pixel_kinds = derived_kinds(estimate_field(data.session, estimate, run_context()), data.mask);
  write_pixel_kinds(path, *data.pixel_kinds);
}

}  // namespace

ChartResult make_chart(const Sources& sources, const ChartOptions& options, const fs::path& folder) {
  std::vector<std::string> methods = options.methods;
  if (methods.empty())
    for (const Method& method : all_methods()) methods.push_back(method.name);
  for (const std::string& method : methods) method_named(method);
  for (const std::string& method : options.redo) method_named(method);
  for (const int kernels : options.kernels)
    if (kernels < 1 || kernels > 255)
      throw InputError("--max-kernels " + std::to_string(kernels) + ": give numbers from 1 to 255");
  ChartData data = load_chart_data(sources);
  const auto counts = image_counts(options.images, static_cast<int>(data.session.frames.size()));
  ChartResult result;
  std::erase_if(methods, [&](const std::string& method) {
    const auto reason = reason_against(method, data);
    if (reason) result.left_out.emplace_back(method, *reason);
    return reason.has_value();
  });
  create_folders(folder);
  const std::string description = describe(data, sources);
  if (!data.pixel_kinds) {
    const bool same_data = options.resume && fs::exists(folder / data_record_name) &&
                           read_text(folder / data_record_name) == description;
    derive_kinds(data, options, folder, same_data);
  }
  result.names = error_names(data);
  result.reference_note = data.reference_note;
  result.kinds_note = data.kinds_note;
  if (options.resume) {
    result.rows = earlier_rows(folder, description, result.names);
    std::erase_if(result.rows, [&](const ChartRow& row) {
      return std::ranges::find(options.redo, row.method) != options.redo.end();
    });
    result.kept_rows = static_cast<int>(result.rows.size());
  }
  write_text_atomically(folder / data_record_name, description);

  std::vector<Task> tasks = grid_of(methods, options.kernels, counts);
  std::erase_if(tasks, [&](const Task& task) {
    return std::ranges::any_of(result.rows, [&](const ChartRow& row) { return same_row(row, task); });
  });
  std::uint64_t work = 0;
  for (const Task& task : tasks) work += static_cast<std::uint64_t>(task.images);
  Progress progress(run_context(), "chart", work);
  for (const Task& task : tasks) {
    run_context().throw_if_stopped();
    result.rows.push_back(measure(task, data, options.estimate));
    sort_rows(result.rows);
    write_text_atomically(folder / "chart.csv", csv_of(result.rows, result.names));
    progress.advance(static_cast<std::uint64_t>(task.images));
  }
  return result;
}

}  // namespace refield::chart
