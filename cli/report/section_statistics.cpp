// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cmath>

#include "cli/report/html.h"
#include "cli/report/picture.h"
#include "cli/report/sections.h"
#include "cli/report/svg_chart.h"
#include "core/run_context.h"

namespace refield::report {

namespace {

struct PaperScene {
  const char* name;
  double nonzero, of_99, of_95;
};

/// Matusik et al. 2004, table 1.
constexpr std::array<PaperScene, 4> paper_scenes = {{{"Hardrock", 0.774, 0.710, 0.608},
                                                     {"Molasses", 0.978, 0.936, 0.839},
                                                     {"Santa", 0.962, 0.924, 0.838},
                                                     {"Teacups", 0.993, 0.973, 0.888}}};

std::string share_row(const std::string& name, double nonzero, double of_99, double of_95,
                      const std::string& css) {
  const auto cell = [](double share) { return "<td class=\"num\">" + fixed(100.0 * share, 1) + " %</td>"; };
  return "<tr class=\"" + css + "\"><td>" + name + "</td>" + cell(nonzero) + cell(of_99) + cell(of_95) +
         "</tr>";
}

std::string energy_table(const ReportInput& input) {
  std::string html =
      "<table><thead><tr><th>Scene</th><th class=\"num\">Non-zero</th><th class=\"num\">99 % of energy</th>"
      "<th class=\"num\">95 % of energy</th></tr></thead><tbody>";
  for (std::size_t f = 0; f < input.fields.size(); ++f) {
    const KernelStatistics& statistics = input.fields[f].statistics;
    html += share_row("<span class=\"key c" + std::to_string(f % 6) + "\"><i></i>" +
                          escaped(input.fields[f].label) + "</span>",
                      statistics.nonzero_share, statistics.share_of_99_percent,
                      statistics.share_of_95_percent, "");
  }
  for (const PaperScene& scene : paper_scenes)
    html += share_row(std::string(scene.name) + " <small>(2004)</small>", scene.nonzero, scene.of_99,
                      scene.of_95, "quiet");
  return html + "</tbody></table>";
}

std::string histogram(const ReportInput& input) {
  BarChart chart;
  chart.title = "Kernels a pixel";
  chart.x_label = "stored kernels per pixel";
  chart.y_label = "fraction of pixels";
  std::size_t longest = 0;
  for (const FieldEntry& entry : input.fields) longest = std::max(longest, entry.statistics.histogram.size());
  for (std::size_t count = 1; count < longest; ++count) chart.groups.push_back(std::to_string(count));
  for (std::size_t f = 0; f < input.fields.size(); ++f) {
    const KernelStatistics& statistics = input.fields[f].statistics;
    BarSeries series{input.fields[f].label, static_cast<int>(f), {}};
    for (std::size_t count = 1; count < statistics.histogram.size(); ++count)
      series.values.push_back(static_cast<double>(statistics.histogram[count]) /
                              static_cast<double>(std::max<std::uint64_t>(1, statistics.pixels)));
    chart.series.push_back(std::move(series));
  }
  if (chart.groups.empty()) return "";
  return "<div class=\"chart-box\">" + bar_chart_svg(chart) + legend_html(chart.series) + "</div>";
}

/// Shares of pixels by predicted error, in twelve equal steps; the last one takes all above.
std::string predicted_histogram(const ReportInput& input) {
  constexpr int steps = 12;
  double high = 0.0;
  for (const FieldEntry& entry : input.fields)
    if (!entry.field.predicted_error.empty())
      high = std::max(high, quantile(entry.field.predicted_error, 0.95));
  if (!(high > 0.0)) return "";
  high = round_up(high);
  BarChart chart;
  chart.title = "Predicted error of pixels";
  chart.x_label = "relative RMSE predicted for new photographs, upper end, %";
  chart.y_label = "fraction of pixels";
  for (int i = 1; i <= steps; ++i)
    chart.groups.push_back(i == steps ? "more" : significant(100.0 * high * i / steps, 2));
  for (std::size_t f = 0; f < input.fields.size(); ++f) {
    BarSeries series{input.fields[f].label, static_cast<int>(f), std::vector<double>(steps)};
    double pixels = 0.0;
    for (const float error : input.fields[f].field.predicted_error)
      if (error > 0.0f) {
        series.values[std::min(static_cast<int>(steps * (error / high)), steps - 1)] += 1.0;
        pixels += 1.0;
      }
    if (!(pixels > 0.0)) continue;
    for (double& value : series.values) value /= pixels;
    chart.series.push_back(std::move(series));
  }
  return "<div class=\"chart-box\">" + bar_chart_svg(chart) + legend_html(chart.series) + "</div>";
}

Image kernel_count_map(const ReflectanceField& field) {
  Image map(field.width, field.height, 1);
  for (std::size_t p = 0; p < map.pixel_count(); ++p)
    map.values[p] = static_cast<float>(field.transfer.row_start[p + 1] - field.transfer.row_start[p]);
  return map;
}

std::string map_figure(const Image& map, double high, const Mask& mask, const std::string& title,
                       const std::string& high_text) {
  return "<figure>" + image_html(shrunk(false_coloured(map, high, mask), max_picture_width), 1.0, title) +
         "<figcaption>" + escaped(title) + "<br>" + colour_bar_html("0", high_text) +
         "</figcaption></figure>";
}

struct ErrorMap {
  std::string title;
  Image map;
};

/// Errors pixel by pixel, where known: on the training images, on the first kind of held-out light.
std::vector<ErrorMap> error_maps(const ReportInput& input, const FieldEntry& entry, const RunContext& run) {
  std::vector<ErrorMap> maps;
  if (!entry.field.training_error.empty()) {
    maps.push_back({"relative RMSE on its training images", Image(entry.field.width, entry.field.height, 1)});
    maps.back().map.values = entry.field.training_error;
  }
  if (!entry.field.predicted_error.empty()) {
    maps.push_back(
        {"relative RMSE predicted for new photographs", Image(entry.field.width, entry.field.height, 1)});
    maps.back().map.values = entry.field.predicted_error;
  }
  const auto kinds = kinds_of(input.session);
  if (!kinds.empty())
    maps.push_back({"relative RMSE on held-out light" + (kinds.front().empty() ? "" : ", " + kinds.front()),
                    held_out_map(entry.field, input.reference(), kinds.front(), run)});
  return maps;
}

/// A row of maps for each field; all rows share their scales.
std::string maps(const ReportInput& input, const RunContext& run) {
  double most = 1.0, worst = 0.0;
  std::vector<std::vector<ErrorMap>> errors;
  for (const FieldEntry& entry : input.fields) {
    most = std::max(most, static_cast<double>(entry.statistics.histogram.size()) - 1.0);
    errors.push_back(error_maps(input, entry, run));
    for (const ErrorMap& error : errors.back())
      worst = std::max(worst, quantile(values_in_mask(error.map, input.mask), 0.9));
  }
  const double error_high = worst > 0.0 && std::isfinite(worst) ? round_up(worst) : 0.01;
  std::string html;
  for (std::size_t f = 0; f < input.fields.size(); ++f) {
    const FieldEntry& entry = input.fields[f];
    html += "<div class=\"grid maps\" style=\"--columns:" + std::to_string(1 + errors[f].size()) + "\">" +
            map_figure(kernel_count_map(entry.field), most, input.mask, entry.label + ": kernels per pixel",
                       fixed(most, 0));
    for (const ErrorMap& error : errors[f])
      html += map_figure(error.map, error_high, input.mask, entry.label + ": " + error.title,
                         significant(100.0 * error_high, 2) + " % and above");
    html += "</div>";
  }
  return html;
}

}  // namespace

std::string statistics_html(const ReportInput& input, const RunContext& run) {
  return section_html("Kernel statistics",
                      "<p>The fraction of the allowed kernels with a nonzero weight, and the smallest "
                      "fractions that contain 99\u00a0% and 95\u00a0% of the energy of the scene (weight × "
                      "area). Reflective and refractive scenes need fewer kernels. For comparison: table 1 "
                      "of Matusik, Loper and Pfister (2004).</p><div class=\"split\"><div>" +
                          energy_table(input) + "</div>" + histogram(input) + predicted_histogram(input) +
                          "</div>" + maps(input, run));
}

}  // namespace refield::report
