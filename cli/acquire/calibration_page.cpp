// SPDX-License-Identifier: Apache-2.0
#include "cli/acquire/calibration_page.h"

#include <algorithm>
#include <cmath>

#include "cli/report/html.h"
#include "cli/report/picture.h"
#include "cli/report/sections.h"

namespace refield::cli {

namespace {

using namespace report;

std::string with_legend(const LineChart& chart) {
  return "<div class=\"chart-box\">" + line_chart_svg(chart) + legend_html(chart.series) + "</div>";
}

LineChart chart_of(const std::string& title, const std::string& x_label, const std::string& y_label) {
  LineChart chart;
  chart.title = title;
  chart.x_label = x_label;
  chart.y_label = y_label;
  return chart;
}

Series change_series(const std::string& name, int colour, const std::vector<ChangeFrame>& frames,
                     Seconds shown) {
  Series series{name, colour, false, {}, Marks::points};
  for (const ChangeFrame& frame : frames) {
    const double middle = frame.start_s + frame.exposure_s / 2.0;
    if (middle <= shown.count()) series.points.push_back({1e3 * middle, frame.share});
  }
  return series;
}

// Plots, each an inline SVG with its legend.

std::string change_plot(const DisplayTiming& timing) {
  const Seconds end = timing.latency + timing.settling;
  const Seconds shown = 3.0 * end;
  LineChart chart = chart_of("Change of light after a page flip", "time since the page flip, ms",
                             "fraction of the new light");
  chart.series = {change_series("up", 0, timing.rising, shown),
                  change_series("down", 1, timing.falling, shown),
                  {"fit for instants",
                   5,
                   true,
                   {{0.0, 0.0},
                    {1e3 * timing.latency.count(), 0.0},
                    {1e3 * end.count(), 1.0},
                    {1e3 * shown.count(), 1.0}},
                   Marks::line}};
  return with_legend(chart);
}

std::string step_plot(const ControlLatency& latency) {
  LineChart chart =
      chart_of("Brightness after a change of exposure", "frames since the change", "mean of lit samples, DN");
  chart.y_numbers = Numbers::plain;
  Series series{"frames", 0, false, {}};
  for (std::size_t i = 0; i < std::min<std::size_t>(latency.level_dn.size(), 16); ++i)
    series.points.push_back({static_cast<double>(i), latency.level_dn[i]});
  chart.series = {series};
  return with_legend(chart);
}

std::string banding_plot(const Banding& banding) {
  LineChart chart =
      chart_of("Brightness per second of exposure", "exposure, ms", "relative to a smooth curve");
  Series series{"frames", 0, false, {}, Marks::points};
  double largest = 0.005;
  for (const auto& [exposure, deviation] : banding.deviation) {
    series.points.push_back({1e3 * exposure, deviation});
    largest = std::max(largest, std::abs(deviation));
  }
  chart.y_low = -1.08 * largest;
  chart.series = {series};
  return with_legend(chart);
}

std::string response_plot(const CameraResponse& response) {
  LineChart chart = chart_of("Response", "raw sample, DN", "light, fraction of saturation");
  Series measured{"measured", 0, false, response.points, Marks::points};
  Series table{"table", 1, false, {}, Marks::line};
  const double black = response.black_level_dn;
  const auto top = static_cast<std::size_t>(response.saturation_dn);
  for (int i = 0; i <= 100; ++i) {
    const double dn = black + (response.saturation_dn - black) * i / 100.0;
    table.points.push_back({dn, (response.linear_from_dn[static_cast<std::size_t>(dn)] - black) /
                                    (response.linear_from_dn[top] - black)});
  }
  chart.series = {measured, table};
  return with_legend(chart);
}

std::string noise_plot(const PhotonTransfer& noise, const CameraResponse& response) {
  LineChart chart = chart_of("Photon transfer", "signal above black, linear DN", "variance, DN²");
  chart.y_numbers = Numbers::plain;
  const double top = noise.points.empty() ? 1.0 : noise.points.back()[0];
  // The full well and the range give the slope at the gain that was used.
  const double range =
      response.linear_from_dn[static_cast<std::size_t>(response.saturation_dn)] - response.black_level_dn;
  const double slope = range / noise.full_well_electrons;
  const double dark = std::pow(noise.read_noise_electrons * slope, 2);
  chart.series = {{"measured", 0, false, noise.points, Marks::points},
                  {"read noise² + signal / (electrons per DN)",
                   1,
                   false,
                   {{0.0, dark}, {top, dark + slope * top}},
                   Marks::line}};
  return with_legend(chart);
}

std::string tone_plot(const ToneCurve& curve) {
  LineChart chart = chart_of("Tone curves", "drive level", "radiance relative to white");
  const std::array<std::pair<const char*, int>, 3> channels = {{{"red", 1}, {"green", 2}, {"blue", 0}}};
  for (int c = 0; c < 3; ++c) {
    Series line{channels[c].first, channels[c].second, false, {}, Marks::line};
    for (int level = 0; level < 256; level += 3)
      line.points.push_back({static_cast<double>(level), curve.light_from_level[c][level]});
    chart.series.push_back(line);
  }
  std::vector<Series> drawn = chart.series;
  for (int c = 0; c < 3; ++c) {
    Series points{channels[c].first, channels[c].second, false, curve.measured[c], Marks::points};
    drawn.push_back(points);
  }
  const auto named = chart.series;
  chart.series = drawn;
  return "<div class=\"chart-box\">" + line_chart_svg(chart) + legend_html(named) + "</div>";
}

std::string milliseconds(Seconds time) {
  return significant(1e3 * time.count(), 3) + "\u00a0ms";
}

std::string tile(const std::string& figure, const std::string& meaning) {
  return "<div class=\"tile\"><b>" + escaped(figure) + "</b><span>" + escaped(meaning) + "</span></div>";
}

std::string opening(const RigMeasurements& rig) {
  const CameraDescription& camera = rig.camera_description;
  const IlluminatorDescription& display = rig.display_description;
  const bool holds = rig.superposition.holds();
  std::string html =
      "<p class=\"kicker\">Calibration</p><h1>" + escaped(camera.name) + " and " + escaped(display.name) +
      "</h1><p>" +
      (holds ? "Light is additive: sessions captured with this calibration are valid within the errors below."
             : "<strong>Light is not additive (see Superposition). Do not capture with these device "
               "settings: relighting would be wrong.</strong>") +
      "</p>";
  html += "<div class=\"tiles\">" +
          tile(milliseconds(rig.timing.display_latency + rig.timing.display_settling),
               camera.takes_photographs ? "assumed from a page flip until the light is stable"
                                        : "from a page flip until the light is stable");
  if (!camera.takes_photographs)
    html += tile(counted(static_cast<std::uint64_t>(rig.timing.control_latency_frames), "frame"),
                 "until camera settings take effect") +
            tile(rig.timing.exposure_unit.count() > 0.0 ? milliseconds(rig.timing.exposure_unit) : "any",
                 "step of exposure times without banding");
  html += tile(significant(rig.camera.electrons_per_dn, 3), "electrons per DN, at gain 1") +
          tile(significant(rig.camera.read_noise_electrons, 3), "electrons of read noise") +
          tile(percent(rig.superposition.largest_error()), "largest error of superposition") + "</div>";
  if (rig.warnings.empty()) return html + "<p class=\"note\">No warnings.</p>";
  html += "<h3>Warnings</h3><ul>";
  for (const std::string& warning : rig.warnings) html += "<li>" + escaped(warning) + "</li>";
  return html + "</ul>";
}

std::string timing(const RigMeasurements& rig) {
  const DisplayTiming& display = rig.display_timing;
  return section_html(
      "Timing of light and settings",
      "<div class=\"split\"><div>" + change_plot(display) +
          "<p>Each point is a frame during a change of the display: the fraction of the new light against "
          "the centre of its exposure. Light starts to change " +
          milliseconds(display.latency) + " after the time stamp of the page flip and is stable " +
          milliseconds(display.latency + display.settling) + " after it (up: " +
          milliseconds(display.rise.settling) + " of change, down: " + milliseconds(display.fall.settling) +
          "). The capture uses a frame for a pattern only if its exposure started later; no fixed delay is "
          "needed.</p></div><div>" +
          step_plot(rig.control_latency) + "<p>The exposure was set to " +
          significant(rig.control_latency.expected_ratio, 2) + " times the previous time at frame 0. " +
          counted(static_cast<std::uint64_t>(rig.control_latency.frames), "frame") +
          " still had the old exposure; the capture discards as many frames after every change, whatever the "
          "driver reports.</p></div></div>");
}

std::string banding(const RigMeasurements& rig) {
  const Banding& measured = rig.banding;
  std::string words;
  if (measured.ripples.empty())
    words =
        "Brightness per second does not depend on the exposure time: no flicker between 20 Hz and 2 kHz was "
        "detected, so any exposure time is valid. The remaining deviation, " +
        percent(measured.noise) +
        " RMS from frame to frame, has no period: slow drift of the light, or noise.";
  else
    words = "The light flickers at " + significant(measured.ripples.front().hz, 5) + " Hz by " +
            percent(measured.ripples.front().depth) +
            ". Exposures that are not a whole number of periods vary in brightness; the capture rounds "
            "exposure times to multiples of " +
            milliseconds(measured.exposure_unit) +
            ". Flicker that remains at the highest brightness of the display comes from the room light: "
            "switch it off.";
  if (measured.refresh_period.count() > 0.0)
    words += " The display refreshes every " + milliseconds(measured.refresh_period) + " (" +
             significant(1.0 / measured.refresh_period.count(), 4) + " Hz).";
  return section_html("Banding", "<div class=\"split\"><div>" + banding_plot(measured) + "</div><p>" +
                                     escaped(words) + "</p></div>");
}

std::string camera(const RigMeasurements& rig) {
  const CameraResponse& response = rig.response;
  const std::string words =
      "Without light the camera returns " + significant(rig.black.dn, 4) + " DN; samples from " +
      fixed(response.saturation_dn, 0) + " DN on may be clipped" +
      (response.saturation_seen ? "" : " (full scale: no sample was saturated)") +
      ". Between them, samples are " +
      (response.is_linear ? "proportional to light."
                          : "nonlinear; the table in the calibration file linearises them.") +
      " Points deviate by " + percent(response.residual) +
      " of the range. A curve with steps, or a deviation of more than 1 %, indicates automatic camera "
      "settings.";
  const PhotonTransfer& noise = rig.noise;
  const std::string noise_words =
      "Photon noise has a variance proportional to light: from the slope, one DN corresponds to " +
      significant(noise.electrons_per_dn, 3) +
      " electrons (at gain 1); from the intercept, the read noise is " +
      significant(noise.read_noise_electrons, 3) + " electrons. The sensor has " +
      significant(noise.full_well_electrons, 3) +
      " electrons at saturation: the lowest relative noise of a single sample is " +
      percent(1.0 / std::sqrt(std::max(1.0, noise.full_well_electrons))) +
      ". Points below the line at the bright end indicate denoising in the camera, points above it a "
      "flickering light.";
  return section_html("The camera", "<div class=\"split\"><div>" + response_plot(response) + "<p>" +
                                        escaped(words) + "</p></div><div>" + noise_plot(noise, response) +
                                        "<p>" + escaped(noise_words) + "</p></div></div>");
}

std::string display(const RigMeasurements& rig) {
  return section_html(
      "The display's tone curves",
      "<div class=\"split\"><div>" + tone_plot(rig.tone_curve) +
          "</div><p>Radiance of each channel against drive level, above black, relative to white: points are "
          "measured, lines are written to the calibration file. Patterns are converted with the inverse "
          "curves, so that the display shows the requested radiance. A curve that is flat before level 255 "
          "indicates a contrast setting that is too high; one that is dark for many levels, a brightness "
          "setting that is too low.</p></div>");
}

std::string superposition(const RigMeasurements& rig) {
  std::string table =
      "<table><thead><tr><th>Patterns A and B</th><th class=\"num\">error</th><th class=\"num\">± noise</th>"
      "<th class=\"num\">worst block</th></tr></thead><tbody>";
  for (const SuperpositionPair& pair : rig.superposition.pairs)
    table += "<tr><td>" + escaped(pair.name) + "</td><td class=\"num\">" + fixed(100.0 * pair.error, 3) +
             " %</td><td class=\"num\">" + fixed(100.0 * pair.uncertainty, 3) + " %</td><td class=\"num\">" +
             fixed(100.0 * pair.worst_block, 3) + " %</td></tr>";
  table += "</tbody></table>";
  return section_html(
      "Superposition: " + std::string(rig.superposition.holds() ? "holds" : "broken"),
      "<p>I(A) + I(B) − I(black) must equal I(A+B), since relighting assumes it. An error above " +
          percent(rig.superposition.tolerance) +
          " indicates a display that dims itself: turn off dynamic contrast, local dimming, power saving and "
          "automatic brightness; on OLED displays, reduce the brightness until the power limit is not "
          "reached.</p>" +
          table);
}

std::string map_html(const std::string& heading, const UniformityMap& measured, const std::string& words) {
  Image picture(240, 180, 1);
  for (int y = 0; y < picture.height; ++y)
    for (int x = 0; x < picture.width; ++x) picture.at(x, y, 0) = measured.map.at_pixel(x, y, picture);
  return section_html(heading, "<div class=\"split\"><figure>" + image_html(picture, 1.0, heading) +
                                   "<figcaption>black 0, white 1; lowest " + percent(measured.least) +
                                   "</figcaption></figure><p>" + escaped(words) + "</p></div>");
}

}  // namespace

std::string calibration_page(const RigMeasurements& rig) {
  std::string body = opening(rig) + superposition(rig);
  if (!rig.camera_description.takes_photographs) body += timing(rig) + banding(rig);
  body += camera(rig) + display(rig);
  if (rig.flat_field)
    body += map_html(
        "Vignetting", *rig.flat_field,
        "Relative light at each position of the frame. Photographs are divided by it. It should be smooth "
        "and symmetric about the centre: a slope from one side to the other indicates an unevenly lit card.");
  if (rig.screen)
    body += map_html("Uniformity of the screen", *rig.screen,
                     "Relative brightness of each position of the screen, seen from the camera. The light "
                     "maps of a session are multiplied by it. LCDs also darken at oblique angles: place the "
                     "camera at the position of the scene for this measurement.");
  return page_html("Calibration of " + rig.camera_description.name, body, "refield acquire calibrate");
}

}  // namespace refield::cli
