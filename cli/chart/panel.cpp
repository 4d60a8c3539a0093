// SPDX-License-Identifier: Apache-2.0
#include "cli/chart/panel.h"

#include <algorithm>
#include <cmath>

#include "cli/chart/label_layout.h"
#include "cli/chart/pareto.h"
#include "cli/report/html.h"
#include "cli/report/svg_chart.h"

namespace refield::chart {

namespace {

using report::escaped;
using report::Scale;

constexpr double left = 64.0, right = 16.0, top = 34.0, bottom = 48.0;
constexpr double right_of_lines = 150.0;  // room for the names of lines
constexpr int colours = 8;
constexpr double label_gap = 14.0;

std::string px(double value) {
  return report::fixed(value, 1);
}

struct Axes {
  Scale x, y;  // of decimal logarithms
  double at_x(double value) const { return x(std::log10(value)); }
  double at_y(double value) const { return y(std::log10(value)); }
};

bool drawable(const std::array<double, 2>& point) {
  return std::isfinite(point[0]) && std::isfinite(point[1]) && point[0] > 0.0 && point[1] > 0.0;
}

/// Logarithms of the smallest and largest coordinate, with a margin.
std::array<double, 2> range_of(const std::vector<Track>& tracks, std::size_t axis, double margin) {
  double low = INFINITY, high = -INFINITY;
  for (const Track& track : tracks)
    for (const auto& point : track.points)
      if (drawable(point)) {
        low = std::min(low, std::log10(point[axis]));
        high = std::max(high, std::log10(point[axis]));
      }
  if (!std::isfinite(low)) return {0.0, 1.0};
  const double extra = std::max(margin * (high - low), 0.06);
  return {low - extra, high + extra};
}

std::string text(const char* css, double x, double y, const std::string& content) {
  return "<text class=\"" + std::string(css) + "\" x=\"" + px(x) + "\" y=\"" + px(y) + "\">" +
         escaped(content) + "</text>";
}

std::string line(const char* css, double x0, double y0, double x1, double y1) {
  return "<line class=\"" + std::string(css) + "\" x1=\"" + px(x0) + "\" y1=\"" + px(y0) + "\" x2=\"" +
         px(x1) + "\" y2=\"" + px(y1) + "\"/>";
}

/// "0.005", "0.15", "5000".
std::string tick_text(double value) {
  std::string digits = report::significant(value, 2);
  if (digits.find('.') != std::string::npos) digits.erase(digits.find_last_not_of('0') + 1);
  if (digits.ends_with('.')) digits.pop_back();
  return digits;
}

std::string frame_svg(const Panel& panel, const Axes& axes) {
  const double x0 = axes.x.pixel_low, x1 = axes.x.pixel_high;
  const double y0 = axes.y.pixel_low, y1 = axes.y.pixel_high;
  std::string svg = text("title", left, 20, panel.title);
  for (const double tick : log_ticks(std::pow(10.0, axes.y.domain_low), std::pow(10.0, axes.y.domain_high))) {
    svg += line("grid", x0, axes.at_y(tick), x1, axes.at_y(tick));
    svg += text("tick-y", x0 - 6, axes.at_y(tick) + 4, tick_text(tick));
  }
  for (const double tick : log_ticks(std::pow(10.0, axes.x.domain_low), std::pow(10.0, axes.x.domain_high))) {
    svg += line("grid", axes.at_x(tick), y0, axes.at_x(tick), y1);
    svg += text("tick-x", axes.at_x(tick), y0 + 16, tick_text(tick));
  }
  svg += text("axis", (x0 + x1) / 2, panel_height - 10, panel.x_label);
  svg += "<text class=\"axis\" transform=\"translate(14 " + px((y0 + y1) / 2) + ") rotate(-90)\">" +
         escaped(panel.y_label) + "</text>";
  return svg;
}

/// The front's corners in pixels: steps from point to point, what can be had at most at each cost.
std::vector<std::pair<double, double>> front_corners(const Panel& panel, const Axes& axes) {
  std::vector<std::array<double, 2>> points;
  for (const Track& track : panel.tracks)
    for (const auto& point : track.points)
      if (drawable(point)) points.push_back(point);
  std::vector<std::pair<double, double>> corners;
  for (const std::size_t k : pareto_front(points)) {
    const double x = axes.at_x(points[k][0]), y = axes.at_y(points[k][1]);
    if (!corners.empty()) corners.emplace_back(x, corners.back().second);
    corners.emplace_back(x, y);
  }
  if (!corners.empty()) corners.emplace_back(axes.x.pixel_high, corners.back().second);
  return corners;
}

std::string front_svg(const std::vector<std::pair<double, double>>& corners) {
  std::string path;
  for (const auto& [x, y] : corners) path += (path.empty() ? "M" : "L") + px(x) + " " + px(y);
  return path.empty() ? "" : "<path class=\"front\" d=\"" + path + "\"/>";
}

/// What labels should keep off: the front's steps.
std::vector<Extent> extents_of(const std::vector<std::pair<double, double>>& corners) {
  std::vector<Extent> extents;
  for (std::size_t k = 1; k < corners.size(); ++k) {
    const auto [x0, x1] = std::minmax(corners[k - 1].first, corners[k].first);
    const auto [y0, y1] = std::minmax(corners[k - 1].second, corners[k].second);
    extents.push_back({x0 - 1, y0 - 1, x1 + 1, y1 + 1});
  }
  return extents;
}

std::string tracks_svg(const Panel& panel, const Axes& axes) {
  std::string svg;
  for (const Track& track : panel.tracks) {
    std::string path, marks;
    for (const auto& point : track.points) {
      if (!drawable(point)) continue;
      const std::string x = px(axes.at_x(point[0])), y = px(axes.at_y(point[1]));
      path += (path.empty() ? "M" : "L") + x + " " + y;
      marks += "<circle cx=\"" + x + "\" cy=\"" + y + "\" r=\"4\"><title>" +
               escaped(track.label + ": " + report::significant(point[0], 3) + ", " +
                       report::significant(point[1], 3)) +
               "</title></circle>";
    }
    svg += "<g class=\"k" + std::to_string(track.colour % colours) + "\">" +
           (panel.lines ? "<path class=\"track\" d=\"" + path + "\"/>" : "") + marks + "</g>";
  }
  return svg;
}

std::string label_svg(const Track& track, double x, double y) {
  return "<g class=\"k" + std::to_string(track.colour % colours) + "\">" + text("label", x, y, track.label) +
         "</g>";
}

/// Names at the right end of lines, pushed apart.
std::string end_labels_svg(const Panel& panel, const Axes& axes) {
  std::vector<const Track*> named;
  std::vector<double> wanted;
  for (const Track& track : panel.tracks) {
    const auto last = std::find_if(track.points.rbegin(), track.points.rend(), drawable);
    if (last == track.points.rend()) continue;
    named.push_back(&track);
    wanted.push_back(axes.at_y((*last)[1]));
  }
  const auto at = spread_apart(wanted, label_gap, axes.y.pixel_high + 4, axes.y.pixel_low - 4);
  std::string svg;
  for (std::size_t k = 0; k < named.size(); ++k)
    svg += line("join", axes.x.pixel_high - 4, wanted[k], axes.x.pixel_high + 8, at[k]) +
           label_svg(*named[k], axes.x.pixel_high + 11, at[k] + 4);
  return svg;
}

/// Names beside single points.
std::string point_labels_svg(const Panel& panel, const Axes& axes, const std::vector<Extent>& obstacles) {
  std::vector<std::string> labels;
  std::vector<const Track*> owners;
  std::vector<std::pair<double, double>> points;
  for (const Track& track : panel.tracks)
    for (const auto& point : track.points) {
      if (!drawable(point)) continue;
      labels.push_back(track.label);
      owners.push_back(&track);
      points.emplace_back(axes.at_x(point[0]), axes.at_y(point[1]));
    }
  const Extent frame{axes.x.pixel_low, axes.y.pixel_high, axes.x.pixel_high, axes.y.pixel_low};
  const auto placed = place_labels(labels, points, obstacles, frame);
  std::string svg;
  for (std::size_t k = 0; k < labels.size(); ++k) {
    const Extent& e = placed[k].extent;
    if (placed[k].far)
      svg += line("join", points[k].first, points[k].second, std::clamp(points[k].first, e.x0, e.x1),
                  std::clamp(points[k].second, e.y0, e.y1));
    svg += label_svg(*owners[k], e.x0, e.y1 - 3);
  }
  return svg;
}

}  // namespace

std::vector<double> log_ticks(double low, double high) {
  const double decades = std::log10(high / low);
  // The finest that does not crowd the axis.
  const std::vector<double> digits = decades > 3.0   ? std::vector<double>{1.0}
                                     : decades > 1.0 ? std::vector<double>{1.0, 2.0, 5.0}
                                                     : std::vector<double>{1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0};
  std::vector<double> ticks;
  for (int decade = static_cast<int>(std::floor(std::log10(low))); std::pow(10.0, decade) <= high; ++decade)
    for (const double digit : digits) {
      const double tick = digit * std::pow(10.0, decade);
      if (tick >= low * (1.0 - 1e-9) && tick <= high * (1.0 + 1e-9)) ticks.push_back(tick);
    }
  return ticks;
}

std::string panel_style() {
  return "<style>"
         "text{font:11px system-ui,sans-serif;fill:#1c1e21}"
         ".title{font-size:14px;font-weight:600}.axis{text-anchor:middle;font-size:12px}"
         ".tick-x{text-anchor:middle;fill:#5d6470}.tick-y{text-anchor:end;fill:#5d6470}"
         ".grid{stroke:#e4e6e9}.join{stroke:#a2a9b3;stroke-width:.8}"
         ".front{fill:none;stroke:#1c1e21;stroke-width:1.3;stroke-dasharray:5 4}"
         ".track{fill:none;stroke:currentColor;stroke-width:2}"
         "circle{fill:currentColor;stroke:#fff}.label{fill:currentColor}"
         ".k0{color:#0f6cbd}.k1{color:#d9680f}.k2{color:#14866d}.k3{color:#a3439a}.k4{color:#8a6d00}"
         ".k5{color:#6b7280}.k6{color:#c0262d}.k7{color:#3f3fa8}"
         "</style>";
}

std::string panel_svg(const Panel& panel) {
  const auto [x_low, x_high] = range_of(panel.tracks, 0, panel.lines ? 0.04 : 0.12);
  const auto [y_low, y_high] = range_of(panel.tracks, 1, 0.08);
  const double end = panel_width - (panel.lines ? right_of_lines : right);
  const Axes axes{{x_low, x_high, left, end}, {y_low, y_high, panel_height - bottom, top}};
  const auto front = panel.front ? front_corners(panel, axes) : decltype(front_corners(panel, axes)){};
  return frame_svg(panel, axes) + front_svg(front) + tracks_svg(panel, axes) +
         (panel.lines ? end_labels_svg(panel, axes) : point_labels_svg(panel, axes, extents_of(front)));
}

std::string picture_svg(const std::string& title, const std::vector<Panel>& panels, int columns) {
  const int count = static_cast<int>(panels.size());
  const int across = std::min(columns, count), down = (count + columns - 1) / columns;
  const double width = across * panel_width, height = down * panel_height + 34.0;
  std::string svg = "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"" + px(width) + "\" height=\"" +
                    px(height) + "\" viewBox=\"0 0 " + px(width) + " " + px(height) +
                    "\" role=\"img\" aria-label=\"" + escaped(title) + "\">" + panel_style() +
                    "<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>" + text("title", 16, 22, title);
  for (int k = 0; k < count; ++k)
    svg += "<g transform=\"translate(" + px(k % columns * panel_width) + " " +
           px(34.0 + k / columns * panel_height) + ")\">" + panel_svg(panels[static_cast<std::size_t>(k)]) +
           "</g>";
  return svg + "</svg>\n";
}

}  // namespace refield::chart
