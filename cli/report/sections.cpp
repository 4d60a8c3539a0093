// SPDX-License-Identifier: Apache-2.0
#include "cli/report/sections.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <map>

#include "cli/report/html.h"
#include "cli/report/picture.h"
#include "core/base/run_context.h"
#include "core/image/image_io.h"
#include "estimate/rig/verdict.h"

namespace refield::report {

namespace {

constexpr int max_kernel_width = 160;

std::string letter(std::size_t index) {
  return std::string(1, static_cast<char>('A' + index % 26));
}

/// The photograph with rings around the pixels.
std::string marked_photograph(const ReportInput& input, const KernelStudy& study) {
  const auto kinds = kinds_of(input.session);
  const CaptureFrame frame =
      kinds.empty() ? input.session.frames.front() : spread_frames(input.session, kinds.front(), 1).front();
  const Image photograph = read_observed(frame).radiance;
  const double exposure = display_exposure(photograph, input.mask);
  const int width = photograph.width, height = photograph.height;
  std::string svg =
      "<svg class=\"marked\" viewBox=\"0 0 " + std::to_string(width) + " " + std::to_string(height) +
      "\" role=\"img\" aria-label=\"photograph with the chosen pixels marked\"><image width=\"" +
      std::to_string(width) + "\" height=\"" + std::to_string(height) +
      "\" preserveAspectRatio=\"none\" href=\"" +
      png_address(shrunk(photograph, 2 * max_picture_width), exposure) + "\"/>";
  const double unit = width / 100.0;
  for (std::size_t i = 0; i < study.pixels.size(); ++i) {
    const ChosenPixel& pixel = study.pixels[i].pixel;
    const double x = pixel.x + 0.5, y = pixel.y + 0.5;
    // The letter goes to the side where there is room.
    const bool on_the_left = x > 0.9 * width;
    svg += "<g class=\"mark\" style=\"--unit:" + fixed(unit, 3) + "px\"><circle class=\"halo\" cx=\"" +
           fixed(x, 1) + "\" cy=\"" + fixed(y, 1) + "\" r=\"" + fixed(1.6 * unit, 2) + "\"/><circle cx=\"" +
           fixed(x, 1) + "\" cy=\"" + fixed(y, 1) + "\" r=\"" + fixed(1.6 * unit, 2) +
           "\"/><text text-anchor=\"" + (on_the_left ? "end" : "start") + "\" x=\"" +
           fixed(x + (on_the_left ? -2.6 : 2.6) * unit, 1) + "\" y=\"" + fixed(y + 1.7 * unit, 1) + "\">" +
           letter(i) + "</text></g>";
  }
  return svg + "</svg>";
}

std::string panel(const Image& density, const std::string& alt) {
  const float highest = *std::ranges::max_element(density.values);
  return "<td>" +
         image_html(shrunk_by_maximum(density, max_kernel_width), highest > 0.0f ? 1.0 / highest : 1.0, alt,
                    "kernel") +
         "</td>";
}

}  // namespace

std::string kernels_html(const ReportInput& input, const KernelStudy& study) {
  if (study.pixels.empty()) return "";
  const bool has_exact = study.pixels.front().exact.has_value();
  std::string html = "<div class=\"split\"><div>" + marked_photograph(input, study) +
                     "</div><div><p>The reflectance of a pixel is a sum of kernels: rectangles of the light "
                     "map, each with a weight. The estimation starts with one rectangle and splits it where "
                     "this reduces the error most. The panels show the weights over the light map for the "
                     "marked pixels after a number of splits (before spatial correction), in the field “" +
                     escaped(input.fields.front().label) + "”";
  html += has_exact ? ", and in the exact light transport of the scene" : "";
  html +=
      ". Grey levels show the weight: white is the highest weight of the panel, black is zero.</p><table "
      "class=\"facts letters\">";
  for (std::size_t i = 0; i < study.pixels.size(); ++i) {
    const ChosenPixel& pixel = study.pixels[i].pixel;
    html += "<tr><th>" + letter(i) + "</th><td>" + escaped(pixel.kind) + " <small>(" +
            std::to_string(pixel.x) + ", " + std::to_string(pixel.y) + ")</small></td></tr>";
  }
  html += "</table></div></div><div class=\"wide\"><table class=\"kernels\"><thead><tr><th></th>";
  for (const int count : study.subdivisions) html += "<th>" + std::to_string(count) + "</th>";
  bool any_done = false;
  html += "<th>field</th>" + std::string(has_exact ? "<th>exact</th>" : "") + "</tr></thead><tbody>";
  for (std::size_t i = 0; i < study.pixels.size(); ++i) {
    const PixelKernels& kernels = study.pixels[i];
    const std::string name = "pixel " + letter(i) + ", ";
    html += "<tr><th>" + letter(i) + "</th>";
    for (std::size_t s = 0; s < kernels.after.size(); ++s) {
      if (kernels.after[s])
        html += panel(*kernels.after[s], name + std::to_string(study.subdivisions[s]) + " subdivisions");
      else
        html += "<td class=\"done\">–</td>";
      any_done = any_done || !kernels.after[s];
    }
    html += panel(kernels.in_field, name + "in the field");
    if (kernels.exact) html += panel(*kernels.exact, name + "exact");
    html += "</tr>";
  }
  html +=
      "</tbody></table></div><p class=\"note\">Up to " + std::to_string(study.kernels) + " kernels, mode " +
      std::string(name_of(input.fields.front().options.mode)) +
      ". Pixel classes are determined from the spread of the kernel energy, not from the scene description.";
  if (any_done) html += " “–”: no further split reduced the error.";
  if (input.session.light.width > max_kernel_width)
    html += " Each point of a panel shows the highest weight of the texels that it covers.";
  return section_html("Kernels of selected pixels", html + "</p>");
}

namespace {

/// The noise of a field's median pixel.
double middle_noise(const ReflectanceField& field) {
  std::vector<float> noise;
  for (std::size_t p = 0; p < field.quality.photograph_noise.size(); ++p)
    if (field.quality.predicted_error[p] > 0.0f) noise.push_back(field.quality.photograph_noise[p]);
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
    const LearningCurve curve(entry.field.quality.learning_curve, middle_noise(entry.field));
    if (!curve.known()) continue;
    Series measured{entry.label + ": measured", static_cast<int>(f), false, {}};
    Series estimated{entry.label + ": extrapolated", static_cast<int>(f), true, {}};
    for (const LearningPoint& point : entry.field.quality.learning_curve)
      measured.points.push_back({point.share, point.error});
    for (const double share : {0.8, 1.0, 1.25, 1.5, 1.75, 2.0})
      estimated.points.push_back({share, curve.error_at(share)});
    chart.series.push_back(std::move(measured));
    chart.series.push_back(std::move(estimated));
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

namespace {

std::string tile(const std::string& value, const std::string& what) {
  return "<div class=\"tile\"><b>" + escaped(value) + "</b><span>" + escaped(what) + "</span></div>";
}

/// The session's folder; the one around it where that is called "session", as captures are often kept. Of
/// pairs the folder of the photographs, or the one that holds the light maps' folder, too.
std::string session_name(const CaptureSession& session) {
  if (session.folder.empty() && !session.frames.empty()) {
    const CaptureFrame& frame = session.frames.front();
    const auto observed = std::filesystem::weakly_canonical(frame.observed).parent_path();
    const auto light = std::filesystem::weakly_canonical(frame.illumination).parent_path();
    const bool side_by_side = observed != light && observed.parent_path() == light.parent_path();
    return (side_by_side ? observed.parent_path() : observed).filename().string();
  }
  auto folder = std::filesystem::weakly_canonical(session.folder);
  if (!folder.has_filename()) folder = folder.parent_path();
  if (folder.filename() == "session" && folder.has_parent_path()) folder = folder.parent_path();
  return folder.filename().string();
}

std::string first_impression(const ReportInput& input, const RunContext& run) {
  const auto kinds = kinds_of(input.session);
  if (kinds.empty()) return "";
  const CaptureFrame frame = spread_frames(input.session, kinds.front(), 1).front();
  const LightMap light = read_illumination(frame, input.session.light.parameterisation, run);
  const Image observed = read_observed(frame).radiance;
  const double exposure = display_exposure(observed, input.mask);
  const auto figure = [&](const Image& image, double scale, const std::string& title,
                          const std::string& text) {
    return "<figure>" + image_html(shrunk(image, max_picture_width), scale, title) + "<figcaption><b>" +
           escaped(title) + "</b> " + escaped(text) + "</figcaption></figure>";
  };
  return "<div class=\"hero\">" +
         figure(light.radiance, display_exposure(light.radiance, {}), "Light",
                "on the display, never used in estimation") +
         figure(observed, exposure, "Photograph", "of the scene under this light") +
         figure(input.fields.front().field.relight(light), exposure, "Prediction",
                "by " + input.fields.front().label + ", same exposure") +
         "</div>";
}

}  // namespace

std::string section_html(const std::string& heading, const std::string& content) {
  if (content.empty()) return "";
  return "<section><h2>" + escaped(heading) + "</h2>\n" + content + "</section>\n";
}

std::string opening_html(const ReportInput& input, const std::vector<FieldFigures>& figures,
                         const RunContext& run) {
  const FieldEntry& entry = input.fields.front();
  std::string tiles;
  if (!figures.front().errors.empty()) {
    const ReferenceErrors& errors = figures.front().errors.back();
    for (const char* kind : {"natural", "bar"})
      if (const HeldOutError* error = find_kind(errors.kinds, kind))
        tiles +=
            tile(percent(error->relative_rmse), std::string("relative RMSE, held-out ") +
                                                    (kind == std::string("bar") ? "bars" : "natural light"));
    if (tiles.empty() && !errors.kinds.empty()) {  // pairs of images state no kind of light
      const HeldOutError& error = errors.kinds.front();
      tiles +=
          tile(percent(error.relative_rmse), "relative RMSE, " + counted(error.images, "held-out image"));
      if (!error.per_image.empty())
        tiles += tile(percent(spread_of(error.per_image).median), "relative RMSE of the median image");
    }
  }
  const double pixels = static_cast<double>(entry.field.width) * entry.field.height;
  tiles += tile(fixed(entry.statistics.mean_stored, 1), "kernels per pixel");
  tiles += tile(significant(static_cast<double>(entry.file_bytes) / pixels, 3), "bytes per pixel on disk");
  tiles += tile(duration_text(figures.front().relight_seconds), "to relight a frame");
  return "<header><p class=\"kicker\">Reflectance field report</p><h1>" +
         escaped(session_name(input.session)) + "</h1>\n" + first_impression(input, run) +
         "<div class=\"tiles\">" + tiles + "</div>" +
         (input.fields.size() > 1
              ? "<p class=\"note\">Picture and figures above: " + escaped(entry.label) + ".</p>"
              : "") +
         "</header>\n";
}

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
  const LightMap light = read_illumination(frame, input.session.light.parameterisation, run);
  const Image observed = read_observed(frame).radiance;
  const Image reference = read_observed(same_frame(input.reference(), frame.name)).radiance;
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
    if (!entry.field.quality.predicted_error.empty())
      high = std::max(high, quantile(entry.field.quality.predicted_error, 0.95));
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
    for (const float error : input.fields[f].field.quality.predicted_error)
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
  if (!entry.field.quality.training_error.empty()) {
    maps.push_back({"relative RMSE on its training images", Image(entry.field.width, entry.field.height, 1)});
    maps.back().map.values = entry.field.quality.training_error;
  }
  if (!entry.field.quality.predicted_error.empty()) {
    maps.push_back(
        {"relative RMSE predicted for new photographs", Image(entry.field.width, entry.field.height, 1)});
    maps.back().map.values = entry.field.quality.predicted_error;
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
  html += "</tbody></table></div>";
  for (std::size_t f = 0; f < input.fields.size(); ++f) {
    if (figures[f].errors.empty()) continue;
    if (const std::string warning = training_warning(figures[f].errors.front().kinds); !warning.empty())
      html += "<p><b>" + escaped(input.fields[f].label) + ": " + escaped(warning) + "</b>.</p>";
  }
  return html;
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

/// How well the predicted errors hold under each kind of held-out light.
std::string prediction_table(const ReportInput& input, const std::vector<FieldFigures>& figures) {
  std::string list;
  for (std::size_t f = 0; f < input.fields.size(); ++f)
    for (const HeldOutError& error : figures[f].errors.back().kinds) {
      const auto& prediction = error.prediction;
      if (!prediction || !std::isfinite(prediction->median_ratio)) continue;
      list += "<tr><td><span class=\"key c" + std::to_string(f % 6) + "\"><i></i>" +
              escaped(input.fields[f].label) + "</span></td><td>" + escaped(kind_name(error.kind)) +
              "</td><td class=\"num\">" + percent(prediction->predicted_median) + "</td><td class=\"num\">" +
              fixed(prediction->median_ratio, 2) + "</td><td class=\"num\">" +
              fixed(prediction->rank_correlation, 2) + "</td></tr>";
    }
  if (list.empty()) return "";
  return "<h3>Predicted error by kind of light</h3><div class=\"wide\"><table><thead><tr><th>Field</th>"
         "<th>Light</th><th class=\"num\">Predicted, median pixel</th><th class=\"num\">Predicted ∕ true</th>"
         "<th class=\"num\">Rank correlation</th></tr></thead><tbody>" +
         list +
         "</tbody></table></div><p class=\"note\">Predicted pixel by pixel from the training images "
         "alone, and compared with the error under held-out light, on " +
         escaped(figures.front().errors.back().reference) +
         ": median of the ratio, and Spearman's rank correlation over the pixels.</p>";
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
  return section_html("Summary",
                      html + "</p>" + image_spread(input, figures) + prediction_table(input, figures));
}

namespace {

std::string verdict_html(const CaptureVerdict& verdict) {
  std::string rows;
  for (const VerdictRow& row : verdict.rows) {
    rows += "<tr><td>" + escaped(row.property) + "</td><td><b>" + std::string(name_of(row.state)) +
            "</b></td><td>" + escaped(row.measured) + "</td><td class=\"num\">";
    if (row.residual_before && *row.residual_before > 0.0)
      rows += percent(*row.residual_before) + " → " + percent(*row.residual_after);
    rows += "</td><td>" + escaped(row.remedy) + "</td></tr>";
  }
  return "<div class=\"wide\"><table><thead><tr><th>Property</th><th>State</th><th>Measured</th>"
         "<th class=\"num\">Residual without → with correction</th><th>Remedy</th></tr></thead><tbody>" +
         rows + "</tbody></table></div>";
}

/// What a chart shows over the photographs, from 1.
Series over_photographs(const std::string& name, int colour, std::size_t count,
                        const std::function<double(std::size_t)>& value) {
  Series series{name, colour, false, {}, Marks::points};
  for (std::size_t j = 0; j < count; ++j) series.points.push_back({static_cast<double>(j + 1), value(j)});
  return series;
}

/// Nothing where no series has points.
std::string rig_chart(LineChart chart) {
  std::erase_if(chart.series, [](const Series& series) { return series.points.empty(); });
  if (chart.series.empty()) return "";
  double low = 0.0;
  for (const Series& series : chart.series)
    for (const auto& point : series.points) low = std::min(low, point[1]);
  if (low < 0.0) chart.y_low = -round_up(-low);
  chart.x_label = "training photograph";
  return "<div class=\"chart-box\">" + line_chart_svg(chart) + legend_html(chart.series) + "</div>";
}

std::string rig_charts(const FrameReport& found) {
  constexpr std::array<const char*, 3> channels{"red", "green", "blue"};
  const RigModel& rig = found.rig.model;
  LineChart path{.title = "Path of the camera", .y_label = "shift of the picture in pixels"};
  path.y_numbers = Numbers::plain;
  for (const std::size_t axis : {0, 1})
    path.series.push_back(over_photographs(axis == 0 ? "to the right" : "down", static_cast<int>(axis),
                                           rig.shift_px.size(),
                                           [&](std::size_t j) { return rig.shift_px[j][axis]; }));
  LineChart gains{.title = "Brightness and room light", .y_label = "relative change"};
  for (std::size_t c = 0; c < 3; ++c)
    gains.series.push_back(over_photographs(std::string("gain, ") + channels[c], static_cast<int>(c),
                                            rig.gain.size(),
                                            [&](std::size_t j) { return rig.gain[j][c] - 1.0; }));
  gains.series.push_back(
      over_photographs("room light", 3, rig.room.size(), [&](std::size_t j) { return rig.room[j]; }));
  LineChart residuals{.title = "Residual of each photograph", .y_label = "median over pixels"};
  residuals.series.push_back(over_photographs("as photographed", 1, found.residuals_before.size(),
                                              [&](std::size_t j) { return found.residuals_before[j]; }));
  if (!rig.is_identity())
    residuals.series.push_back(over_photographs("corrected", 0, found.residuals.size(),
                                                [&](std::size_t j) { return found.residuals[j]; }));
  std::string matrix;
  if (rig.mixes_colours()) {
    matrix = "<div><h3>Colour mixing</h3><table><thead><tr><th></th>";
    for (const char* channel : channels)
      matrix += std::string("<th class=\"num\">") + channel + " light</th>";
    matrix += "</tr></thead><tbody>";
    for (int c = 0; c < 3; ++c) {
      matrix += std::string("<tr><th>") + channels[c] + " channel</th>";
      for (int p = 0; p < 3; ++p) matrix += "<td class=\"num\">" + fixed(rig.mixing(c, p), 3) + "</td>";
      matrix += "</tr>";
    }
    matrix += "</tbody></table></div>";
  }
  return "<div class=\"split\">" + rig_chart(residuals) + rig_chart(path) + "</div><div class=\"split\">" +
         rig_chart(gains) + matrix + "</div>";
}

}  // namespace

std::string check_html(const FrameReport& found, int photographs) {
  return section_html(
      "Check of the capture",
      "<p>Whether photographs and lights obey B = T L, as <code>refield info</code> checks it: each "
      "photograph is compared with what the others predict under its light. What is corrected is corrected "
      "whenever photographs are read; the session stays as it was photographed.</p>" +
          verdict_html(verdict_of(found, photographs)) + rig_charts(found));
}

std::string timing_html(const ReportInput& input, const std::vector<FieldFigures>& figures,
                        const std::vector<RunLog>& logs) {
  std::string rows;
  const auto row = [&](const std::string& stage, const std::string& what, const std::string& time,
                       const std::string& memory, const std::string& threads, const std::string& details) {
    rows += "<tr><td>" + escaped(stage) + "</td><td class=\"made\"><code>" + escaped(what) +
            "</code></td><td class=\"num\">" + time + "</td><td class=\"num\">" + memory +
            "</td><td class=\"num\">" + threads + "</td><td><small>" + escaped(details) +
            "</small></td></tr>";
  };
  for (const RunLog& log : logs) {
    std::string made = log.path.string();
    if (const auto end = made.rfind(".log.json"); end != std::string::npos) made.resize(end);
    row(log.stage, made, log.seconds ? duration_text(*log.seconds) : "–",
        log.peak_memory_bytes ? bytes_text(static_cast<double>(*log.peak_memory_bytes)) : "–",
        log.threads ? std::to_string(*log.threads) : "–", log.details);
  }
  for (std::size_t f = 0; f < figures.size(); ++f)
    if (figures[f].relight_seconds > 0.0)
      row("relight", input.fields[f].path.string(), duration_text(figures[f].relight_seconds) + " per frame",
          bytes_text(static_cast<double>(input.fields[f].field.transfer.entries()) * 16.0), "all",
          "measured for this page: " + fixed(1.0 / figures[f].relight_seconds, 0) +
              " frames per second; memory: the field");
  if (rows.empty()) return "";
  return section_html(
      "Time and memory",
      "<div class=\"wide\"><table><thead><tr><th>Stage</th><th>Made</th><th "
      "class=\"num\">Time</th><th class=\"num\">Peak "
      "memory</th><th class=\"num\">Threads</th><th>Details</th></tr></thead><tbody>" +
          rows +
          "</tbody></table></div><p class=\"note\">From the logs of the last run of each stage. For "
          "comparison: the 2004 paper reports two hours for a field of 1024 × 768 pixels from 180 images, "
          "and 0.5 frames per second for relighting, on a PC of that time.</p>");
}

}  // namespace refield::report
