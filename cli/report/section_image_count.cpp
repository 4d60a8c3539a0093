// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "cli/report/html.h"
#include "cli/report/picture.h"
#include "cli/report/sections.h"
#include "cli/report/svg_chart.h"
#include "core/image_io.h"

namespace refield::report {

namespace {

std::string chart_html(const ImageCountStudy& study, const std::string& kind) {
  LineChart chart;
  chart.title = "Held-out " + (kind.empty() ? std::string("light") : kind);
  chart.x_label = "training images";
  chart.y_label = "relative RMSE";
  for (const StudyPoint& point : study.series.front().points) chart.x_ticks.push_back(point.images);
  for (std::size_t s = 0; s < study.series.size(); ++s) {
    const StudySeries& series = study.series[s];
    Series line{series.name, static_cast<int>(s), series.options.spatial_passes == 0, {}};
    for (const StudyPoint& point : series.points)
      if (const HeldOutError* error = find_kind(point.errors, kind))
        line.points.push_back({static_cast<double>(point.images), error->relative_rmse});
    chart.series.push_back(std::move(line));
  }
  return "<div class=\"chart-box\">" + line_chart_svg(chart) + legend_html(chart.series) + "</div>";
}

std::string picture_rows(const ReportInput& input, const ImageCountStudy& study, std::size_t frame) {
  const double exposure = display_exposure(study.reference[frame], study.mask);
  const auto& counts = study.series.front().points;
  const auto figure = [&](const Image& image, const std::string& text) {
    return "<figure>" + image_html(shrunk(image, max_picture_width), exposure, text) + "<figcaption>" + text +
           "</figcaption></figure>";
  };
  std::string html =
      "<p class=\"row-title\"><b>" +
      escaped(study.picture_frames[frame].kind.empty() ? "light" : study.picture_frames[frame].kind) +
      "</b> <code>" + escaped(study.picture_frames[frame].name) + "</code> <span>exposure ×" +
      significant(exposure, 2) + "</span></p>";
  for (std::size_t s = 0; s < study.series.size(); ++s) {
    const StudySeries& series = study.series[s];
    html += "<p class=\"series-name\"><span class=\"key c" + std::to_string(s % 6) +
            (series.options.spatial_passes == 0 ? " dashed" : "") + "\"><i></i>" + escaped(series.name) +
            "</span></p><div class=\"grid\" style=\"--columns:" + std::to_string(counts.size() + 1) + "\">" +
            figure(study.reference[frame], "Actual: " + input.reference_name());
    for (auto point = series.points.rbegin(); point != series.points.rend(); ++point)
      html += figure(point->predicted[frame],
                     std::to_string(point->images) + " images <b>" +
                         percent(relative_rmse(point->predicted[frame], study.reference[frame], study.mask)) +
                         "</b>");
    html += "</div>";
  }
  return "<div class=\"row\">" + html + "</div>\n";
}

/// The whole photograph with the window marked.
std::string located_window(const ReportInput& input, const ImageCountStudy& study) {
  if (study.picture_frames.empty()) return "";
  const std::string& name = study.picture_frames.front().name;
  const auto frame = std::ranges::find(input.session.frames, name, &CaptureFrame::name);
  const Image photograph = read_photograph(frame->observed).radiance;
  const auto number = [](int value) { return "\"" + std::to_string(value) + "\""; };
  const auto rectangle = [&](const char* css) {
    return std::string("<rect class=\"").append(css) + "\" x=" + number(study.window.x0) +
           " y=" + number(study.window.y0) + " width=" + number(study.window.width()) +
           " height=" + number(study.window.height()) + "/>";
  };
  return "<svg class=\"marked\" viewBox=\"0 0 " + std::to_string(photograph.width) + " " +
         std::to_string(photograph.height) +
         "\" role=\"img\" aria-label=\"photograph with the window marked\"><image width=" +
         number(photograph.width) + " height=" + number(photograph.height) +
         " preserveAspectRatio=\"none\" href=\"" +
         png_address(shrunk(photograph, max_picture_width), display_exposure(photograph, input.mask)) +
         "\"/><g class=\"mark\" style=\"--unit:" + fixed(photograph.width / 100.0, 3) + "px\">" +
         rectangle("halo") + rectangle("") + "</g></svg>";
}

}  // namespace

std::string image_count_html(const ReportInput& input, const ImageCountStudy& study) {
  if (study.series.empty()) return "";
  std::string text =
      "<p>How many photographs does it take? The field was estimated again from the first 25, 50, 75, 100 "
      "and all "
      "training images, and each result measured on the held-out images against the " +
      input.reference_name() + "s. With fewer images than kernels, there are as many kernels as images.</p>";
  const bool whole = study.window == Box{0, 0, input.session.width, input.session.height};
  if (!whole)
    text = "<div class=\"split located\"><div>" + text + "<p>To keep this quick, only the marked window, " +
           std::to_string(study.window.width()) + " × " + std::to_string(study.window.height()) +
           " pixels, was estimated. Of all windows of that size it resembles the whole picture best, by the "
           "spread "
           "of its pixels’ kernels and by their training errors.</p></div>" +
           located_window(input, study) + "</div>";
  std::string charts;
  int count = 0;
  for (const std::string& kind : kinds_of(input.session))
    if (kind != "black" && count++ < 2) charts += chart_html(study, kind);
  std::string pictures;
  for (std::size_t i = 0; i < study.picture_frames.size(); ++i) pictures += picture_rows(input, study, i);
  return section_html("How many images", text + "<div class=\"split\">" + charts + "</div>" + pictures);
}

}  // namespace refield::report
