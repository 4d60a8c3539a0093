// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace refield::report {

/// Text made safe for HTML and SVG content and for double-quoted attributes.
std::string escaped(std::string_view text);

/// RFC 4648, with padding.
std::string base64(std::span<const std::uint8_t> bytes);

/// `value` with a fixed number of decimals, "–" when it is not finite. Never depends on the locale.
std::string fixed(double value, int decimals);

/// `value` with a number of significant digits, never in exponent form: "0.0123", "340".
std::string significant(double value, int digits);

/// A fraction as a percentage with three significant digits: 0.0234 becomes "2.34 %", with a
/// no-break space.
std::string percent(double fraction);

/// "1.23 MB", decimal prefixes.
std::string bytes_text(double bytes);

/// "38 ms", "4.2 s", "2 min 5 s", "1 h 12 min".
std::string duration_text(double seconds);

/// "1 image", "3 images".
std::string counted(std::uint64_t count, std::string_view noun);

/// Maps data to a pixel axis, linearly: domain_low lies at pixel_low, domain_high at pixel_high.
struct Scale {
  double domain_low = 0.0;
  double domain_high = 1.0;
  double pixel_low = 0.0;
  double pixel_high = 1.0;
  double operator()(double value) const;
};

/// Round numbers, 1, 2 or 5 times a power of ten apart, inside [low, high]: about `wanted` of them, at least
/// two wherever high > low. An axis without extent has its one value.
std::vector<double> round_ticks(double low, double high, int wanted);

/// The smallest round number (1, 2, 2.5 or 5 times a power of ten) that is not below `value` > 0.
double round_up(double value);

/// How the numbers of an axis are written.
enum class Numbers { plain, percent };

/// What is drawn of a series.
enum class Marks { line_and_points, line, points };

struct Series {
  std::string name;
  int colour = 0;  ///< index into the page's palette, see page_style()
  bool dashed = false;
  std::vector<std::array<double, 2>> points;  ///< (x, y); points that are not finite are left out
  Marks marks = Marks::line_and_points;
};

struct LineChart {
  std::string title{};
  std::string x_label{};
  std::string y_label{};
  Numbers y_numbers = Numbers::percent;
  std::vector<double> x_ticks{};  ///< empty: round numbers
  double y_low = 0.0;             ///< lower end of the y axis
  std::vector<Series> series{};
};

/// A line chart with markers, as an inline SVG that takes its colours from the page.
std::string line_chart_svg(const LineChart& chart);

struct BarSeries {
  std::string name;
  int colour = 0;
  std::vector<double> values;  ///< [groups]; a value that is not finite leaves a gap
};

struct BarChart {
  std::string title;
  std::string x_label;
  std::string y_label;
  Numbers y_numbers = Numbers::percent;
  std::vector<std::string> groups;
  std::vector<BarSeries> series;
  bool values_above = false;  ///< writes each value over its bar
  int width_px = 520;
};

/// Bars side by side, a group for each name, y axis from zero.
std::string bar_chart_svg(const BarChart& chart);

/// The keys of a chart's series, as HTML.
std::string legend_html(const std::vector<Series>& series);
std::string legend_html(const std::vector<BarSeries>& series);

/// The whole HTML document around a body: one file, nothing loaded from elsewhere. A script shows the values
/// of charts at the pointer; without scripts the page is complete. Follows the reader's light or dark scheme
/// and prints on white. `made_by`: the command.
std::string page_html(const std::string& title, const std::string& body,
                      const std::string& made_by = "refield report");

}  // namespace refield::report
