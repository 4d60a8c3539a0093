// SPDX-License-Identifier: Apache-2.0
#include "cli/report/html.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>

namespace refield::report {

std::string escaped(std::string_view text) {
  std::string safe;
  safe.reserve(text.size());
  for (const char c : text) switch (c) {
      case '&':
        safe += "&amp;";
        break;
      case '<':
        safe += "&lt;";
        break;
      case '>':
        safe += "&gt;";
        break;
      case '"':
        safe += "&quot;";
        break;
      case '\'':
        safe += "&#39;";
        break;
      default:
        safe += c;
    }
  return safe;
}

std::string base64(std::span<const std::uint8_t> bytes) {
  static constexpr char alphabet[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::size_t left = std::min<std::size_t>(3, bytes.size() - i);
    std::uint32_t group = 0;
    for (std::size_t k = 0; k < 3; ++k) group = group << 8 | (k < left ? bytes[i + k] : 0u);
    for (std::size_t k = 0; k < 4; ++k) text += k <= left ? alphabet[group >> (18 - 6 * k) & 63] : '=';
  }
  return text;
}

std::string fixed(double value, int decimals) {
  if (!std::isfinite(value)) return "–";
  std::array<char, 400> buffer;
  const auto end =
      std::to_chars(buffer.data(), buffer.data() + buffer.size(), value, std::chars_format::fixed, decimals)
          .ptr;
  return {buffer.data(), end};
}

std::string significant(double value, int digits) {
  if (!std::isfinite(value)) return "–";
  if (value == 0.0) return "0";
  // Round first: 9.996 to three digits is 10.0, which has a decimal less.
  std::array<char, 64> rounded;
  const auto end = std::to_chars(rounded.data(), rounded.data() + rounded.size(), value,
                                 std::chars_format::scientific, digits - 1)
                       .ptr;
  std::from_chars(rounded.data(), end, value);
  const int magnitude = static_cast<int>(std::floor(std::log10(std::abs(value)) + 1e-9));
  return fixed(value, std::max(0, digits - 1 - magnitude));
}

std::string percent(double fraction) {
  return std::isfinite(fraction) ? significant(100.0 * fraction, 3) + "\u00a0%" : "–";
}

std::string bytes_text(double bytes) {
  static constexpr std::array units = {"bytes", "kB", "MB", "GB", "TB"};
  std::size_t unit = 0;
  for (; bytes >= 999.5 && unit + 1 < units.size(); ++unit) bytes /= 1000.0;
  return (unit == 0 ? fixed(bytes, 0) : significant(bytes, 3)) + " " + units[unit];
}

std::string duration_text(double seconds) {
  if (!std::isfinite(seconds)) return "–";
  if (seconds < 0.9995) return significant(1000.0 * seconds, 2) + " ms";
  if (seconds < 59.95) return significant(seconds, seconds < 9.95 ? 2 : 3) + " s";
  const auto whole = static_cast<std::uint64_t>(std::llround(seconds));
  if (whole < 3600) return std::to_string(whole / 60) + " min " + std::to_string(whole % 60) + " s";
  const std::uint64_t minutes = (whole + 30) / 60;
  return std::to_string(minutes / 60) + " h " + std::to_string(minutes % 60) + " min";
}

std::string counted(std::uint64_t count, std::string_view noun) {
  return std::to_string(count) + " " + std::string(noun) + (count == 1 ? "" : "s");
}

namespace {

constexpr double chart_height = 270.0;
constexpr double left = 58.0, right = 14.0, top = 30.0, bottom = 46.0;
constexpr int palette_size = 6;

std::string px(double value) {
  return fixed(value, 1);
}

std::string colour_class(int colour) {
  return "c" + std::to_string(colour % palette_size);
}

/// Decimals that tell neighbouring ticks apart.
std::string tick_text(double value, double step, Numbers numbers) {
  const double unit = numbers == Numbers::percent ? 100.0 : 1.0;
  const int decimals = std::max(0, static_cast<int>(-std::floor(std::log10(step * unit) + 1e-9)));
  return fixed(value * unit, decimals) + (numbers == Numbers::percent ? " %" : "");
}

/// Four digits without idle zeros: "25", "0.5".
std::string short_text(double value) {
  std::string text = significant(value, 4);
  if (text.find('.') != std::string::npos) text.erase(text.find_last_not_of('0') + 1);
  if (text.ends_with('.')) text.pop_back();
  return text;
}

std::string value_text(double value, Numbers numbers) {
  return numbers == Numbers::percent ? percent(value) : significant(value, 3);
}

std::string text_at(double x, double y, const char* css, const std::string& content) {
  return "<text class=\"" + std::string(css) + "\" x=\"" + px(x) + "\" y=\"" + px(y) + "\">" +
         escaped(content) + "</text>";
}

/// Opens the SVG and draws what all charts share: title, labels, horizontal grid with its numbers.
std::string frame_svg(double width, const std::string& title, const std::string& x_label,
                      const std::string& y_label, Numbers numbers, const Scale& y) {
  std::string svg = "<svg class=\"chart\" role=\"img\" viewBox=\"0 0 " + px(width) + " " + px(chart_height) +
                    "\" aria-label=\"" + escaped(title) + "\">";
  svg += text_at(left, 14, "chart-title", title);
  const auto ticks = round_ticks(y.domain_low, y.domain_high, 5);
  const double step = ticks.size() > 1 ? ticks[1] - ticks[0] : 1.0;
  for (const double tick : ticks) {
    svg += "<line class=\"grid\" x1=\"" + px(left) + "\" x2=\"" + px(width - right) + "\" y1=\"" +
           px(y(tick)) + "\" y2=\"" + px(y(tick)) + "\"/>";
    svg += text_at(left - 6, y(tick) + 4, "tick-y", tick_text(tick, step, numbers));
  }
  svg += text_at((left + width - right) / 2, chart_height - 6, "axis-label", x_label);
  svg += "<text class=\"axis-label\" transform=\"translate(12 " + px((top + chart_height - bottom) / 2) +
         ") rotate(-90)\">" + escaped(y_label) + "</text>";
  return svg;
}

double highest(double value) {
  return value > 0.0 ? value * 1.08 : 1.0;
}

std::string legend_entry(int colour, bool dashed, const std::string& name) {
  return "<span class=\"key " + colour_class(colour) + (dashed ? " dashed" : "") + "\"><i></i>" +
         escaped(name) + "</span>";
}

}  // namespace

double Scale::operator()(double value) const {
  if (domain_high == domain_low) return (pixel_low + pixel_high) / 2;
  return pixel_low + (value - domain_low) / (domain_high - domain_low) * (pixel_high - pixel_low);
}

std::vector<double> round_ticks(double low, double high, int wanted) {
  if (!(high > low)) return {low};
  const double rough = (high - low) / std::max(1, wanted);
  double decade = std::pow(10.0, std::floor(std::log10(rough)));
  double step = 10.0 * decade;
  for (const double multiple : {1.0, 2.0, 5.0})
    if (multiple * decade >= rough * (1.0 - 1e-9)) {
      step = multiple * decade;
      break;
    }
  // A step that leaves fewer than two ticks inside is too long; the next finer one is at most 2.5 times
  // shorter.
  const double slack = 1e-9;
  const auto inside = [&](double s) {
    return std::floor(high / s + slack) - std::ceil(low / s - slack) + 1.0;
  };
  while (inside(step) < 2.0) step /= 2.0;
  std::vector<double> ticks;
  for (double k = std::ceil(low / step - slack); k <= std::floor(high / step + slack); k += 1.0)
    ticks.push_back(k == 0.0 ? 0.0 : k * step);
  return ticks;
}

double round_up(double value) {
  const double decade = std::pow(10.0, std::floor(std::log10(value)));
  for (const double multiple : {1.0, 2.0, 2.5, 5.0, 10.0})
    if (multiple * decade >= value * (1.0 - 1e-9)) return multiple * decade;
  return 10.0 * decade;
}

std::string line_chart_svg(const LineChart& chart) {
  constexpr double width = 520.0;
  double x_low = INFINITY, x_high = -INFINITY, y_high = 0.0;
  for (const Series& series : chart.series)
    for (const auto& [x, y] : series.points) {
      if (!std::isfinite(x) || !std::isfinite(y)) continue;
      x_low = std::min(x_low, x);
      x_high = std::max(x_high, x);
      y_high = std::max(y_high, y);
    }
  if (!std::isfinite(x_low)) x_low = x_high = 0.0;
  const Scale x{x_low, x_high, left + 12, width - right - 12};
  const double y_top = y_high == 0.0 && chart.y_low < 0.0 ? 0.0 : highest(y_high);
  const Scale y{chart.y_low, std::max(y_top, chart.y_low), chart_height - bottom, top};
  std::string svg = frame_svg(width, chart.title, chart.x_label, chart.y_label, chart.y_numbers, y);
  const auto ticks = chart.x_ticks.empty() ? round_ticks(x_low, x_high, 6) : chart.x_ticks;
  for (const double tick : ticks) {
    svg += "<line class=\"tick\" x1=\"" + px(x(tick)) + "\" x2=\"" + px(x(tick)) + "\" y1=\"" +
           px(y(chart.y_low)) + "\" y2=\"" + px(y(chart.y_low) + 4) + "\"/>";
    svg += text_at(x(tick), y(chart.y_low) + 17, "tick-x", short_text(tick));
  }
  for (const Series& series : chart.series) {
    std::string path, marks;
    for (const auto& [value_x, value_y] : series.points) {
      if (!std::isfinite(value_x) || !std::isfinite(value_y)) continue;
      if (series.marks != Marks::points)
        path += (path.empty() ? "M" : "L") + px(x(value_x)) + " " + px(y(value_y));
      if (series.marks == Marks::line) continue;
      marks +=
          "<circle cx=\"" + px(x(value_x)) + "\" cy=\"" + px(y(value_y)) + "\" r=\"3.5\"><title>" +
          escaped(series.name + ", " + short_text(value_x) + ": " + value_text(value_y, chart.y_numbers)) +
          "</title></circle>";
    }
    svg += "<g class=\"series " + colour_class(series.colour) + (series.dashed ? " dashed" : "") +
           "\"><path d=\"" + path + "\"/>" + marks + "</g>";
  }
  return svg + "</svg>";
}

std::string bar_chart_svg(const BarChart& chart) {
  const double width = chart.width_px;
  double y_high = 0.0;
  for (const BarSeries& series : chart.series)
    for (const double value : series.values)
      if (std::isfinite(value)) y_high = std::max(y_high, value);
  const Scale y{0.0, highest(y_high), chart_height - bottom, top};
  std::string svg = frame_svg(width, chart.title, chart.x_label, chart.y_label, chart.y_numbers, y);
  const auto groups = static_cast<double>(std::max<std::size_t>(1, chart.groups.size()));
  const double group_width = (width - left - right) / groups;
  const double bar_width =
      std::min(46.0, 0.84 * group_width / static_cast<double>(std::max<std::size_t>(1, chart.series.size())));
  // Names that would run into each other are thinned out.
  const auto every = static_cast<std::size_t>(std::max(1.0, std::ceil(22.0 / group_width)));
  for (std::size_t g = 0; g < chart.groups.size(); ++g) {
    const double centre = left + (static_cast<double>(g) + 0.5) * group_width;
    if (g % every == 0) svg += text_at(centre, y(0.0) + 17, "tick-x", chart.groups[g]);
    for (std::size_t s = 0; s < chart.series.size(); ++s) {
      const BarSeries& series = chart.series[s];
      if (g >= series.values.size() || !std::isfinite(series.values[g])) continue;
      const double value = series.values[g];
      const double x =
          centre + (static_cast<double>(s) - static_cast<double>(chart.series.size()) / 2) * bar_width;
      svg += "<rect class=\"bar " + colour_class(series.colour) + "\" x=\"" + px(x) + "\" y=\"" +
             px(y(value)) + "\" width=\"" + px(bar_width * 0.94) + "\" height=\"" + px(y(0.0) - y(value)) +
             "\"><title>" +
             escaped(series.name + ", " + chart.groups[g] + ": " + value_text(value, chart.y_numbers)) +
             "</title></rect>";
      if (chart.values_above)
        svg += text_at(x + bar_width * 0.47, y(value) - 4, "bar-value",
                       significant(value * (chart.y_numbers == Numbers::percent ? 100.0 : 1.0), 2));
    }
  }
  return svg + "</svg>";
}

std::string legend_html(const std::vector<Series>& series) {
  std::string html;
  for (const Series& s : series) html += legend_entry(s.colour, s.dashed, s.name);
  return "<p class=\"legend\">" + html + "</p>";
}

std::string legend_html(const std::vector<BarSeries>& series) {
  std::string html;
  for (const BarSeries& s : series) html += legend_entry(s.colour, false, s.name);
  return "<p class=\"legend\">" + html + "</p>";
}

namespace {

// Six colours that stay apart for colour-blind readers and on both grounds.
constexpr const char* style = R"css(
:root {
  color-scheme: light dark;
  --ground: #fbfbf9; --panel: #ffffff; --ink: #1c1e21; --soft: #5d6470; --line: #dcdfe3; --accent: #0f5fae;
  --c0: #0f6cbd; --c1: #d9680f; --c2: #14866d; --c3: #a3439a; --c4: #8a6d00; --c5: #6b7280;
}
@media (prefers-color-scheme: dark) {
  :root {
    --ground: #16181b; --panel: #1e2125; --ink: #e6e8ea; --soft: #9ba3ad; --line: #343a41; --accent: #7ab7f5;
    --c0: #5aa9f0; --c1: #f29a52; --c2: #45c0a2; --c3: #d588cd; --c4: #d3b340; --c5: #a2a9b3;
  }
}
* { box-sizing: border-box; }
body { margin: 0; background: var(--ground); color: var(--ink);
  font: 15px/1.55 system-ui, -apple-system, "Segoe UI", "Liberation Sans", "Noto Sans", sans-serif; }
main { max-width: 1200px; margin: 0 auto; padding: 28px 24px 40px; }
h1 { font-size: 34px; line-height: 1.15; margin: 0 0 18px; letter-spacing: -0.01em; }
h2 { font-size: 22px; margin: 0 0 14px; letter-spacing: -0.005em; }
h3 { font-size: 16px; margin: 22px 0 8px; }
p { max-width: 88ch; margin: 0 0 14px; }
.kicker { color: var(--accent); font-weight: 600; margin: 0 0 2px; }
.note, small, figcaption, .legend, .row-title span { color: var(--soft); }
.note { font-size: 13px; margin-top: 10px; max-width: 105ch; }
small { font-size: 12px; } code { font: 12px/1.4 ui-monospace, "Liberation Mono", monospace; color: var(--soft); overflow-wrap: anywhere; }
section { background: var(--panel); border: 1px solid var(--line); border-radius: 10px; padding: 22px 24px; margin: 22px 0; }
.hero { display: grid; grid-template-columns: 1fr 1fr 1fr; gap: 12px; align-items: end; }
.tiles { display: grid; grid-template-columns: repeat(auto-fit, minmax(150px, 1fr)); gap: 12px; margin-top: 18px; }
.tile { background: var(--panel); border: 1px solid var(--line); border-radius: 10px; padding: 12px 16px; }
.tile b { display: block; font-size: 25px; line-height: 1.2; font-weight: 650; font-variant-numeric: tabular-nums; }
.tile span { color: var(--soft); font-size: 13px; }
.split { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(440px, 100%), 1fr)); gap: 22px 28px; align-items: start; }
.split > * { min-width: 0; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-size: 14px; font-variant-numeric: tabular-nums; }
th, td { text-align: left; padding: 6px 12px 6px 0; border-bottom: 1px solid var(--line); vertical-align: top; }
thead th { color: var(--soft); font-weight: 500; font-size: 13px; vertical-align: bottom; }
th.num, td.num { text-align: right; } td.num { white-space: nowrap; }
tbody tr:last-child > * { border-bottom: 0; }
.facts th { width: 30%; color: var(--soft); font-weight: 500; } .made { min-width: 150px; } .facts td { overflow-wrap: anywhere; }
.letters th { width: 34px; } tr.quiet td { color: var(--soft); }
figure { margin: 0; min-width: 0; } figcaption { font-size: 12.5px; line-height: 1.4; padding-top: 3px; }
figcaption b { color: var(--ink); font-weight: 600; }
img { display: block; width: 100%; height: auto; border-radius: 3px; background: #000; outline: 1px solid var(--line); outline-offset: -1px; }
.grid { display: grid; grid-template-columns: repeat(var(--columns), minmax(0, 1fr)); gap: 8px; align-items: start; }
.grid.maps { margin-top: 18px; gap: 14px; align-items: start; }
.row { margin: 16px 0 22px; } .row-title { margin: 0 0 6px; max-width: none; } .row-title b { text-transform: capitalize; }
.colour-bar { display: inline-flex; gap: 6px; align-items: center; white-space: nowrap; }
.colour-bar i { width: 110px; height: 9px; border-radius: 2px; }
.kernels td { padding: 3px; border: 0; min-width: 74px; } .kernels th { padding: 3px 6px 3px 0; border: 0; text-align: center; vertical-align: middle; }
.kernels .done { text-align: center; vertical-align: middle; color: var(--soft); }
img.kernel { image-rendering: pixelated; border-radius: 0; outline: 1px solid var(--line); }
.marked { width: 100%; height: auto; border-radius: 3px; display: block; }
.mark circle, .mark rect { fill: none; stroke: #fff; stroke-width: calc(0.5 * var(--unit)); }
.mark .halo { stroke: #000; stroke-width: calc(1.1 * var(--unit)); }
.mark text { font: 700 calc(5 * var(--unit)) system-ui, sans-serif; fill: #fff; stroke: #000; stroke-width: calc(0.9 * var(--unit)); paint-order: stroke; stroke-linejoin: round; }
.chart { width: 100%; max-width: 620px; height: auto; display: block; font: 11.5px system-ui, "Liberation Sans", sans-serif; }
.chart text { fill: var(--soft); } .chart .chart-title { fill: var(--ink); font-weight: 600; font-size: 13px; }
.chart .grid { stroke: var(--line); display: inline; } .chart .tick { stroke: var(--soft); }
.chart .tick-x, .chart .axis-label, .chart .bar-value { text-anchor: middle; } .chart .tick-y { text-anchor: end; }
.chart .bar-value { font-size: 10.5px; fill: var(--ink); }
.chart-box { position: relative; max-width: 620px; } .chart:focus-visible { outline: 2px solid var(--accent); }
.hairline { stroke: var(--soft); stroke-dasharray: 2 3; }
.tip { position: absolute; top: 22px; max-width: 60%; pointer-events: none; background: var(--panel); border: 1px solid var(--line); border-radius: 6px;
  padding: 5px 9px; font-size: 12.5px; line-height: 1.45; box-shadow: 0 2px 8px rgb(0 0 0 / 0.18); font-variant-numeric: tabular-nums; }
.tip div::before { content: ""; display: inline-block; width: 9px; height: 9px; border-radius: 50%; margin-right: 6px; background: var(--colour); }
.series path { fill: none; stroke: var(--colour); stroke-width: 2.2; stroke-linejoin: round; }
.series circle { fill: var(--colour); stroke: var(--panel); stroke-width: 1.2; } .series.dashed path { stroke-dasharray: 6 4; }
.bar { fill: var(--colour); }
.c0 { --colour: var(--c0); } .c1 { --colour: var(--c1); } .c2 { --colour: var(--c2); }
.c3 { --colour: var(--c3); } .c4 { --colour: var(--c4); } .c5 { --colour: var(--c5); }
.legend { display: flex; flex-wrap: wrap; gap: 4px 18px; font-size: 13px; margin: 4px 0 0 30px; }
.key { white-space: nowrap; } .key i { display: inline-block; width: 18px; height: 0; margin-right: 7px; vertical-align: 4px; border-top: 3px solid var(--colour); } .key.dashed i { border-top-style: dashed; }
footer { color: var(--soft); font-size: 13px; } footer p { max-width: none; }
@media (max-width: 720px) { .hero { grid-template-columns: 1fr; } .grid { grid-template-columns: repeat(2, minmax(0, 1fr)); } }
@page { margin: 13mm; }
@media print {
  :root { color-scheme: light; --ground: #fff; --panel: #fff; --ink: #000; --soft: #444; --line: #bbb; --accent: #0f5fae;
    --c0: #0f6cbd; --c1: #d9680f; --c2: #14866d; --c3: #a3439a; --c4: #8a6d00; --c5: #6b7280; }
  * { -webkit-print-color-adjust: exact; print-color-adjust: exact; }
  .tip, .hairline { display: none; } body { font-size: 9.5pt; } main { max-width: none; padding: 0; } table { font-size: 8.5pt; }
  section { border: 0; padding: 0; } .wide { overflow: visible; } .kernels td { min-width: 0; }
  .split { grid-template-columns: 1fr 1fr; } .tiles { grid-template-columns: repeat(5, 1fr); } .tile { padding: 6px 10px; }
  .tile b { font-size: 15pt; }
  .row, .chart-box, .split, figure, tr { break-inside: avoid; } h2, h3, .row-title { break-after: avoid; }
}
)css";

// Shows the values of a chart at the pointer, or at the position that the arrow keys choose. The values are
// those of the marks' titles, which browsers without scripts show.
constexpr const char* script = R"js(
for (const svg of document.querySelectorAll('svg.chart')) {
  const groups = new Map();  // position on the x axis -> its marks
  for (const mark of svg.querySelectorAll('circle, .bar')) {
    const title = mark.querySelector('title'), parts = /^(.*), ([^,]*): (.*)$/.exec(title.textContent);
    if (!parts) continue;
    const [, name, place, value] = parts, box = mark.getBBox();
    if (!groups.has(place)) groups.set(place, {place, marks: []});
    groups.get(place).marks.push({name, value, x: box.x + box.width / 2, colour: getComputedStyle(mark).fill});
    mark.setAttribute('aria-label', title.textContent);
    title.remove();
  }
  const places = [...groups.values()];
  if (!places.length) continue;
  for (const p of places) p.x = p.marks.reduce((sum, mark) => sum + mark.x, 0) / p.marks.length;
  places.sort((a, b) => a.x - b.x);
  const ground = [...svg.querySelectorAll('.grid')].map(line => +line.getAttribute('y1'));
  const hairline = document.createElementNS(svg.namespaceURI, 'line'), tip = document.createElement('div');
  hairline.setAttribute('class', 'hairline');
  hairline.setAttribute('y1', Math.min(...ground));
  hairline.setAttribute('y2', Math.max(...ground));
  tip.className = 'tip';
  tip.setAttribute('role', 'status');
  let chosen = -1;
  const hide = () => { chosen = -1; hairline.remove(); tip.remove(); };
  const show = index => {
    if (index === chosen) return;
    chosen = index;
    const {x, place, marks} = places[index], width = svg.viewBox.baseVal.width;
    hairline.setAttribute('x1', x);
    hairline.setAttribute('x2', x);
    svg.prepend(hairline);
    const heading = document.createElement('b'), axis = svg.querySelector('.axis-label').textContent;
    heading.textContent = axis ? axis + ': ' + place : place;
    tip.replaceChildren(heading, ...marks.map(mark => {
      const row = document.createElement('div');
      row.style.setProperty('--colour', mark.colour);
      row.textContent = mark.name + ': ' + mark.value;
      return row;
    }));
    const [near, far] = x < width / 2 ? ['left', 'right'] : ['right', 'left'];
    tip.style[near] = `calc(${100 * (near === 'left' ? x : width - x) / width}% + 10px)`;
    tip.style[far] = 'auto';
    svg.parentNode.append(tip);
  };
  const nearest = event => {
    const x = new DOMPoint(event.clientX, 0).matrixTransform(svg.getScreenCTM().inverse()).x;
    show(places.reduce((best, p, i) => Math.abs(p.x - x) < Math.abs(places[best].x - x) ? i : best, 0));
  };
  svg.tabIndex = 0;
  svg.addEventListener('pointermove', nearest);
  svg.addEventListener('pointerdown', nearest);
  svg.addEventListener('pointerleave', hide);
  svg.addEventListener('blur', hide);
  svg.addEventListener('keydown', event => {
    const step = {ArrowLeft: -1, ArrowRight: 1}[event.key];
    if (!step) return;
    event.preventDefault();
    show(Math.min(places.length - 1, Math.max(0, chosen + step)));
  });
}
)js";

}  // namespace

std::string page_html(const std::string& title, const std::string& body, const std::string& made_by) {
  return "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
         "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>" +
         escaped(title) + "</title>\n<style>" + style + "</style>\n</head>\n<body>\n<main>\n" + body +
         "<footer><p>W. Matusik, M. Loper, H. Pfister: Progressively-Refined Reflectance Functions from "
         "Natural "
         "Illumination, Eurographics Symposium on Rendering 2004. Page made by <code>" +
         escaped(made_by) +
         "</code>.</p></footer>\n"
         "</main>\n<script>" +
         script + "</script>\n</body>\n</html>\n";
}

}  // namespace refield::report
