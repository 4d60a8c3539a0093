// SPDX-License-Identifier: Apache-2.0
#include "cli/acquire/calibration_plots.h"

#include <algorithm>
#include <cmath>

#include "cli/report/svg_chart.h"

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

}  // namespace

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

}  // namespace refield::cli
