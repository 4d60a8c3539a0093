// SPDX-License-Identifier: Apache-2.0
#include "cli/report/page.h"

#include "cli/report/html.h"

namespace refield::report {

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
  body { font-size: 9.5pt; } main { max-width: none; padding: 0; } table { font-size: 8.5pt; }
  section { border: 0; padding: 0; } .wide { overflow: visible; } .kernels td { min-width: 0; }
  .split { grid-template-columns: 1fr 1fr; } .tiles { grid-template-columns: repeat(5, 1fr); } .tile { padding: 6px 10px; }
  .tile b { font-size: 15pt; }
  .row, .chart-box, .split, figure, tr { break-inside: avoid; } h2, h3, .row-title { break-after: avoid; }
}
)css";

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
         "</main>\n</body>\n</html>\n";
}

}  // namespace refield::report
