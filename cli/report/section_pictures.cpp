// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "cli/report/html.h"
#include "cli/report/picture.h"
#include "cli/report/sections.h"
#include "cli/report/svg_chart.h"
#include "core/image_io.h"
#include "core/run_context.h"

namespace refield::report {

namespace {

std::size_t pictures_of(const std::string& kind) {
  if (kind == "natural" || kind.empty()) return 3;
  if (kind == "bar") return 2;
  return kind == "black" ? 0 : 1;
}

std::string figure(const Image& image, double exposure, const std::string& title,
                   const std::string& detail = "") {
  return "<figure>" + image_html(shrunk(image, max_picture_width), exposure, title) + "<figcaption>" +
         escaped(title) + (detail.empty() ? "" : " <b>" + escaped(detail) + "</b>") +
         "</figcaption></figure>";
}

const CaptureFrame& same_frame(const CaptureSession& session, const std::string& name) {
  return *std::ranges::find(session.frames, name, &CaptureFrame::name);
}

/// One held-out light: all of its pictures at one exposure.
std::string row_html(const ReportInput& input, const CaptureFrame& frame, const RunContext& run) {
  const LightMap light = read_light_map(frame.illumination, input.session.light.parameterisation, run);
  const Image observed = read_photograph(frame.observed).radiance;
  const Image reference = read_photograph(same_frame(input.reference(), frame.name).observed).radiance;
  const double light_exposure = display_exposure(light.radiance, {});
  const double exposure = display_exposure(reference, input.mask);

  std::vector<Image> predicted, errors;
  double high = 0.0;
  for (const FieldEntry& entry : input.fields) {
    predicted.push_back(entry.field.relight(light));
    errors.push_back(error_magnitude(predicted.back(), reference));
    high = std::max(high, quantile(values_in_mask(errors.back(), input.mask), 0.98) * exposure);
  }
  // The best-known round number below which 98 % of the worst field's pixels lie, as a share of the pictures'
  // white.
  high = high > 0.0 && std::isfinite(high) ? round_up(high) : 0.01;

  std::string pictures = figure(light.radiance, light_exposure, "Light, ×" + significant(light_exposure, 2)) +
                         figure(observed, exposure, "Photograph");
  for (std::size_t f = 0; f < predicted.size(); ++f) {
    const double error = relative_rmse(predicted[f], reference, input.mask);
    pictures += figure(predicted[f], exposure, "Predicted, " + input.fields[f].label);
    pictures += figure(false_coloured(errors[f], high / exposure, input.mask), 1.0, "Error", percent(error));
  }
  return "<div class=\"row\"><p class=\"row-title\"><b>" +
         escaped(frame.kind.empty() ? "light" : frame.kind) + "</b> <code>" + escaped(frame.name) +
         "</code> <span>exposure ×" + significant(exposure, 2) + " · error " +
         colour_bar_html("0", significant(100.0 * high, 2) + " % of white and above") +
         "</span></p><div class=\"grid\" style=\"--columns:" + std::to_string(2 + 2 * predicted.size()) +
         "\">" + pictures + "</div></div>\n";
}

}  // namespace

std::string pictures_html(const ReportInput& input, const RunContext& run) {
  std::vector<CaptureFrame> frames;
  for (const std::string& kind : kinds_of(input.session))
    std::ranges::copy(spread_frames(input.session, kind, pictures_of(kind)), std::back_inserter(frames));
  if (frames.empty()) return "";
  std::string html =
      "<p>The scene under held-out light: natural images, and the more difficult white bars and squares on "
      "black. Frames are selected evenly from the held-out series. In each row, the photograph and all "
      "predictions have the same exposure; errors (root mean square of the three channels, against the " +
      input.reference_name() +
      ") have the same colour scale. “White” is the radiance that is displayed as white.</p>";
  Progress progress(run, "pictures", frames.size());
  for (const CaptureFrame& frame : frames) {
    run.throw_if_stopped();
    html += row_html(input, frame, run);
    progress.advance();
  }
  return section_html("Under new light", html);
}

}  // namespace refield::report
