// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "cli/report/html.h"
#include "cli/report/sections.h"
#include "cli/report/svg_chart.h"

namespace refield::report {

namespace {

/// The noise of a field's middle pixel.
double middle_noise(const ReflectanceField& field) {
  std::vector<float> noise;
  for (std::size_t p = 0; p < field.photograph_noise.size(); ++p)
    if (field.predicted_error[p] > 0.0f) noise.push_back(field.photograph_noise[p]);
  return noise.empty() ? 0.0 : quantile(std::move(noise), 0.5);
}

}  // namespace

std::string more_images_html(const ReportInput& input) {
  LineChart chart;
  chart.title = "Median pixel error against number of images";
  chart.x_label = "number of images relative to the training images";
  chart.y_label = "relative RMSE on new images";
  chart.x_ticks = {0.25, 0.5, 1.0, 2.0};
  std::string advice;
  for (std::size_t f = 0; f < input.fields.size(); ++f) {
    const FieldEntry& entry = input.fields[f];
    const LearningCurve curve(entry.field.learning_curve, middle_noise(entry.field));
    if (!curve.known()) continue;
    Series measured{entry.label + ": measured", static_cast<int>(f), false, {}};
    Series foreseen{entry.label + ": extrapolated", static_cast<int>(f), true, {}};
    for (const LearningPoint& point : entry.field.learning_curve)
      measured.points.push_back({point.share, point.error});
    for (const double share : {0.8, 1.0, 1.25, 1.5, 1.75, 2.0})
      foreseen.points.push_back({share, curve.error_at(share)});
    chart.series.push_back(std::move(measured));
    chart.series.push_back(std::move(foreseen));
    advice += "<p><b>" + escaped(entry.label) + "</b>: " + escaped(curve.advice()) + ".</p>";
  }
  if (chart.series.empty()) return "";
  return section_html(
      "Error against the number of images",
      "<div class=\"split\"><div><p>On a sparse grid of pixels, the field was also estimated from 25 %, 50 % "
      "and 80 % of the training images, and each estimate was tested on the remaining images. The curve "
      "extrapolates these errors, down to the photograph noise as the lower limit.</p>" +
          advice + "</div><div class=\"chart-box\">" + line_chart_svg(chart) + legend_html(chart.series) +
          "</div></div>");
}

}  // namespace refield::report
