// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "cli/report/html.h"

namespace refield::report {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr double nan = std::numeric_limits<double>::quiet_NaN();
/// Ticks are products of an integer and a power of ten: off by a few units in the last place.
constexpr double rounding = 1e-12;

std::string encoded(const std::string& text) {
  return base64({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
}

std::size_t occurrences(const std::string& text, const std::string& part) {
  std::size_t count = 0;
  for (auto at = text.find(part); at != std::string::npos; at = text.find(part, at + part.size())) ++count;
  return count;
}

TEST(ReportText, EscapesWhatHtmlWouldRead) {
  EXPECT_EQ(escaped("a<b>&\"c'"), "a&lt;b&gt;&amp;&quot;c&#39;");
  EXPECT_EQ(escaped("Größe 5 × 3"), "Größe 5 × 3");
}

TEST(ReportText, Base64OfRfc4648) {
  EXPECT_EQ(encoded(""), "");
  EXPECT_EQ(encoded("f"), "Zg==");
  EXPECT_EQ(encoded("fo"), "Zm8=");
  EXPECT_EQ(encoded("foo"), "Zm9v");
  EXPECT_EQ(encoded("foobar"), "Zm9vYmFy");
  EXPECT_EQ(encoded(std::string("\xff\xfe\x00", 3)), "//4A");
}

TEST(ReportText, NumbersForReaders) {
  EXPECT_EQ(fixed(2.345, 1), "2.3");
  EXPECT_EQ(fixed(nan, 1), "–");
  EXPECT_EQ(significant(0.012345, 3), "0.0123");
  EXPECT_EQ(significant(9.996, 3), "10.0");
  EXPECT_EQ(significant(1234.5, 2), "1200");
  EXPECT_EQ(significant(-0.5, 1), "-0.5");
  EXPECT_EQ(significant(0.0, 3), "0");
  EXPECT_EQ(percent(0.023456), "2.35\u00a0%");
  EXPECT_EQ(percent(infinity), "–");
  EXPECT_EQ(bytes_text(999), "999 bytes");
  EXPECT_EQ(bytes_text(4.0e9), "4.00 GB");
  EXPECT_EQ(duration_text(0.0032), "3.2 ms");
  EXPECT_EQ(duration_text(4.24), "4.2 s");
  EXPECT_EQ(duration_text(59.97), "1 min 0 s");
  EXPECT_EQ(duration_text(125.0), "2 min 5 s");
  EXPECT_EQ(duration_text(3599.6), "1 h 0 min");
  EXPECT_EQ(duration_text(7200.0), "2 h 0 min");
}

TEST(ReportChart, ScaleIsLinearAndMayRunBackwards) {
  const Scale down{0.0, 4.0, 200.0, 100.0};
  EXPECT_DOUBLE_EQ(down(0.0), 200.0);
  EXPECT_DOUBLE_EQ(down(1.0), 175.0);
  EXPECT_DOUBLE_EQ(down(4.0), 100.0);
  EXPECT_DOUBLE_EQ((Scale{3.0, 3.0, 0.0, 10.0})(3.0), 5.0) << "no extent: the middle";
}

TEST(ReportChart, TicksAreRoundNumbersInside) {
  EXPECT_EQ(round_ticks(0.0, 1.0, 5), (std::vector{0.0, 0.2, 0.4, 0.6000000000000001, 0.8, 1.0}));
  EXPECT_EQ(round_ticks(7.0, 7.0, 5), std::vector{7.0});
  for (const double low : {0.0, -3.7, 24.0, 1e-7})
    for (const double extent : {1e-6, 0.013, 0.9, 1.0, 75.0, 3.3e5}) {
      const auto ticks = round_ticks(low, low + extent, 5);
      ASSERT_GE(ticks.size(), 2u) << low << " + " << extent;
      EXPECT_LE(ticks.size(), 11u) << low << " + " << extent;
      const double step = ticks[1] - ticks[0];
      for (std::size_t i = 0; i < ticks.size(); ++i) {
        EXPECT_GE(ticks[i], low - 1e-6 * step);
        EXPECT_LE(ticks[i], low + extent + 1e-6 * step);
        EXPECT_NEAR(ticks[i], ticks[0] + static_cast<double>(i) * step, 1e-6 * step);
      }
    }
}

TEST(ReportChart, RoundUpGivesTheNextRoundNumber) {
  for (const auto& [value, up] :
       {std::pair{0.031, 0.05}, {0.02, 0.02}, {2.1, 2.5}, {6.0, 10.0}, {100.0, 100.0}})
    EXPECT_NEAR(round_up(value), up, rounding * up) << value;
}

TEST(ReportChart, LineChartPlacesPointsOnItsAxes) {
  LineChart chart{"Error <1>", "images", "error", Numbers::plain, {0.0, 10.0}, 0.0, {}};
  chart.series.push_back({"a", 0, false, {{0.0, 1.0}, {5.0, 0.5}, {10.0, 0.0}, {20.0, nan}}});
  const std::string svg = line_chart_svg(chart);
  EXPECT_NE(svg.find("Error &lt;1&gt;"), std::string::npos);
  EXPECT_EQ(occurrences(svg, "<circle"), 3u) << "a value that is no number has no mark";
  EXPECT_EQ(svg.find("nan"), std::string::npos);
  // Three points on a line: the middle one halfway between the others.
  std::vector<double> x, y;
  for (auto at = svg.find("<circle"); at != std::string::npos; at = svg.find("<circle", at + 1)) {
    x.push_back(std::stod(svg.substr(svg.find("cx=\"", at) + 4)));
    y.push_back(std::stod(svg.substr(svg.find("cy=\"", at) + 4)));
  }
  constexpr double written_px = 0.1;  // coordinates are written to a tenth of a pixel
  EXPECT_NEAR(x[1], (x[0] + x[2]) / 2, written_px);
  EXPECT_NEAR(y[1], (y[0] + y[2]) / 2, written_px);
  EXPECT_LT(x[0], x[2]);
  EXPECT_LT(y[0], y[2]) << "high values lie above";
}

TEST(ReportChart, BarsAreAsHighAsTheirValues) {
  BarChart chart;
  chart.groups = {"one", "two", "none"};
  chart.series = {{"s", 0, {0.1, 0.2, infinity}}};
  const std::string svg = bar_chart_svg(chart);
  std::vector<double> heights;
  for (auto at = svg.find("<rect"); at != std::string::npos; at = svg.find("<rect", at + 1))
    heights.push_back(std::stod(svg.substr(svg.find("height=\"", at) + 8)));
  ASSERT_EQ(heights.size(), 2u) << "no bar for a value that is not finite";
  EXPECT_NEAR(heights[1], 2.0 * heights[0], 0.2) << "written to a tenth of a pixel";
  EXPECT_EQ(occurrences(svg, "20.0\u00a0%"), 1u) << "values can be read";
}

TEST(ReportChart, EmptyChartsAreStillCharts) {
  EXPECT_NE(line_chart_svg({}).find("</svg>"), std::string::npos);
  EXPECT_NE(bar_chart_svg({}).find("</svg>"), std::string::npos);
}

}  // namespace
}  // namespace refield::report
