// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <map>

#include "cli/report/html.h"
#include "cli/report/sections.h"
#include "cli/report/svg_chart.h"

namespace refield::report {

namespace {

std::string size_html(int width, int height) {
  return std::to_string(width) + " × " + std::to_string(height);
}

std::string kind_name(const std::string& kind) {
  return kind.empty() ? "all" : kind;
}

std::string frames_text(const CaptureSession& session, FrameRole role) {
  std::map<std::string, int> kinds;
  int total = 0;
  for (const CaptureFrame& frame : session.frames_of(role)) {
    ++kinds[kind_name(frame.kind)];
    ++total;
  }
  if (total == 0) return "none";
  std::string list;
  for (const auto& [kind, count] : kinds)
    list += (list.empty() ? "" : ", ") + std::to_string(count) + " " + kind;
  return std::to_string(total) + " (" + list + ")";
}

std::string session_table(const ReportInput& input) {
  const CaptureSession& session = input.session;
  const auto row = [](const std::string& name, const std::string& value) {
    return "<tr><th>" + escaped(name) + "</th><td>" + escaped(value) + "</td></tr>";
  };
  std::string html = "<table class=\"facts\">";
  html += row(session.folder.empty() ? "Image pairs" : "Session", text_of(session));
  html += row("Camera", size_html(session.width, session.height) + " pixels");
  html += row("Light map", size_html(session.light.width, session.light.height) + " texels, " +
                               std::string(name_of(session.light.parameterisation)));
  html += row("Training images", frames_text(session, FrameRole::train));
  html += row("Held-out images", frames_text(session, FrameRole::test));
  html += row("Ambient image", session.ambient ? "taken, subtracted" : "none");
  html += row("Mask", session.mask ? "yes: pixels outside are ignored" : "none: all pixels are used");
  if (input.truth) html += row("Exact reference", input.truth_note);
  return html + "</table>";
}

std::string field_table(const ReportInput& input) {
  std::string html =
      "<div class=\"wide\"><table><thead><tr><th>Field</th><th>Mode</th><th class=\"num\">Kernels per pixel, "
      "maximum</th>"
      "<th class=\"num\">Stored, mean</th><th class=\"num\">Distinct boxes</th><th class=\"num\">File</th>"
      "<th class=\"num\">Bytes per pixel</th></tr></thead><tbody>";
  for (std::size_t f = 0; f < input.fields.size(); ++f) {
    const FieldEntry& entry = input.fields[f];
    const double pixels = static_cast<double>(entry.field.width) * entry.field.height;
    html += "<tr><td><span class=\"key c" + std::to_string(f % 6) + "\"><i></i>" + escaped(entry.label) +
            "</span></td><td>" +
            escaped(entry.options_recorded ? name_of(entry.options.mode) : "not recorded") +
            "</td><td class=\"num\">" +
            (!entry.options_recorded     ? "–"
             : entry.options.kernels > 0 ? std::to_string(entry.options.kernels)
                                         : std::string("automatic")) +
            "</td><td class=\"num\">" + fixed(entry.statistics.mean_stored, 1) + "</td><td class=\"num\">" +
            std::to_string(entry.statistics.distinct_boxes) + "</td><td class=\"num\">" +
            bytes_text(static_cast<double>(entry.file_bytes)) + "</td><td class=\"num\">" +
            significant(static_cast<double>(entry.file_bytes) / pixels, 3) + "</td></tr>";
  }
  return html + "</tbody></table></div>";
}

std::string error_table(const ReportInput& input, const std::vector<FieldFigures>& figures) {
  const auto kinds = kinds_of(input.session);
  std::string html = "<div class=\"wide\"><table class=\"errors\"><thead><tr><th>Field</th><th>Against</th>";
  for (const std::string& kind : kinds) html += "<th class=\"num\">" + escaped(kind_name(kind)) + "</th>";
  html += "</tr></thead><tbody>";
  for (std::size_t f = 0; f < input.fields.size(); ++f)
    for (const ReferenceErrors& errors : figures[f].errors) {
      html += "<tr><td><span class=\"key c" + std::to_string(f % 6) + "\"><i></i>" +
              escaped(input.fields[f].label) + "</span></td><td>" + escaped(errors.reference) + "</td>";
      for (const std::string& kind : kinds) {
        const HeldOutError* error = find_kind(errors.kinds, kind);
        html += "<td class=\"num\">";
        if (error)
          html += "<b>" + percent(error->relative_rmse) + "</b><br><small>" + percent(error->median) + " · " +
                  percent(error->percentile_90) + "</small><br><small>" +
                  (std::isfinite(error->tone_mapped_psnr_db) ? fixed(error->tone_mapped_psnr_db, 1) : "∞") +
                  " dB</small>";
        html += "</td>";
      }
      html += "</tr>";
    }
  return html + "</tbody></table></div>";
}

/// One sentence for each kind of light: how far single images lie apart, and which is the worst.
std::string image_spread(const ReportInput& input, const std::vector<FieldFigures>& figures) {
  std::string list;
  for (std::size_t f = 0; f < input.fields.size(); ++f)
    for (const HeldOutError& error : figures[f].errors.back().kinds) {
      if (error.per_image.empty() || error.kind == "black") continue;
      const ErrorSpread spread = spread_of(error.per_image);
      list += "<tr><td><span class=\"key c" + std::to_string(f % 6) + "\"><i></i>" +
              escaped(input.fields[f].label) + "</span></td><td>" + escaped(kind_name(error.kind)) +
              "</td><td class=\"num\">" + std::to_string(error.images) + "</td><td class=\"num\">" +
              percent(spread.median) + "</td><td class=\"num\">" + percent(spread.mean) +
              "</td><td class=\"num\">" + percent(spread.largest) + "</td><td><code>" +
              escaped(error.per_image[spread.worst].name) + "</code></td></tr>";
    }
  if (list.empty()) return "";
  return "<h3>Errors per image</h3><div class=\"wide\"><table><thead><tr><th>Field</th><th>Light</th>"
         "<th class=\"num\">Images</th><th class=\"num\">Median</th><th class=\"num\">Mean</th>"
         "<th class=\"num\">Largest</th><th>Image</th></tr></thead><tbody>" +
         list + "</tbody></table></div>";
}

std::string error_chart(const ReportInput& input, const std::vector<FieldFigures>& figures) {
  BarChart chart;
  chart.title = "Held-out relative RMSE against " + figures.front().errors.back().reference;
  chart.y_label = "relative RMSE";
  chart.values_above = true;
  for (const std::string& kind : kinds_of(input.session))
    if (kind != "black") chart.groups.push_back(kind);
  for (std::size_t f = 0; f < input.fields.size(); ++f) {
    BarSeries series{input.fields[f].label, static_cast<int>(f), {}};
    for (const std::string& kind : chart.groups) {
      const HeldOutError* error = find_kind(figures[f].errors.back().kinds, kind);
      series.values.push_back(error ? error->relative_rmse : NAN);
    }
    chart.series.push_back(std::move(series));
  }
  for (std::string& group : chart.groups) group = kind_name(group);
  if (chart.groups.empty()) return "";
  return "<div class=\"chart-box\">" + bar_chart_svg(chart) + legend_html(chart.series) + "</div>";
}

}  // namespace

std::string summary_html(const ReportInput& input, const std::vector<FieldFigures>& figures) {
  std::string html = "<div class=\"split\"><div>" + session_table(input) + "</div>";
  const bool evaluated = !figures.front().errors.empty();
  if (evaluated) html += error_chart(input, figures);
  html += "</div>" + field_table(input);
  if (!evaluated)
    return section_html("Summary", html +
                                       "<p class=\"note\">The session has no held-out images (role “test”), "
                                       "so the error of predictions cannot be measured.</p>");
  html += "<h3>Error on held-out light</h3>" + error_table(input, figures);
  html +=
      "<p class=\"note\">Relative RMSE, √(Σ(predicted − reference)² ∕ Σ reference²), over all images of a "
      "kind, pixels and channels; below it, the median and the 90th percentile of the same measure per "
      "pixel, and the PSNR of the tone-mapped images in dB (99th percentile white). “Photographs” contain "
      "camera noise, which cannot be predicted";
  html += input.truth ? "; “exact images” are " + escaped(input.truth_note) + "." : ".";
  for (const std::string& kind : kinds_of(input.session))
    if (kind == "black")
      html += " Under black light the reference is almost zero: this error measures noise, not the field.";
  return section_html("Summary", html + "</p>" + image_spread(input, figures));
}

}  // namespace refield::report
