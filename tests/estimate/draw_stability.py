#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Draws the figures of the stability suite, one panel a condition.

REFIELD_FIGURES=out build/release/tests/estimate/test_estimate --gtest_filter='Poor*:Outlier*:Drift*'
tests/estimate/draw_stability.py out/stability.csv docs/images/stability.svg
"""
import csv
import html
import math
import sys

COLUMNS = 3
WIDTH, HEIGHT = 340, 230  # of a panel
LEFT, RIGHT, TOP, BOTTOM = 52, 12, 30, 62
SERIES = [("error", "ours", "#0f6cbd"), ("ridge", "ridge regression", "#d9680f"), ("constant", "constant", "#6b7280")]


def panels_of(path):
    panels = {}
    with open(path, newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            figures = {name: float(row[name]) for name in ("error", "undisturbed", "constant", "ridge")}
            panels.setdefault(row["condition"], []).append((row["setting"], figures))
    return panels


def text(x, y, content, **attributes):
    given = "".join(f' {name.replace("_", "-")}="{value}"' for name, value in attributes.items())
    return f'<text x="{x:.1f}" y="{y:.1f}"{given}>{html.escape(content)}</text>'


def wrapped(setting, room):
    """At most three lines of at most `room` letters."""
    lines = [""]
    for word in setting.split():
        if lines[-1] and len(lines[-1]) + 1 + len(word) > room:
            lines.append("")
        lines[-1] = (lines[-1] + " " + word).strip()
    if len(lines) > 3:
        lines = lines[:3]
        lines[-1] += " …"
    return lines


def panel(title, rows):
    values = [v for _, figures in rows for v in figures.values() if v > 0]
    low = math.floor(math.log10(min(values)) - 0.05)
    high = math.ceil(math.log10(max(values)) + 0.05)
    bottom, end = HEIGHT - BOTTOM, WIDTH - RIGHT
    step = (end - LEFT) / len(rows)

    def y_of(value):
        return bottom - (math.log10(value) - low) / (high - low) * (bottom - TOP)

    def x_of(i):
        return LEFT + (i + 0.5) * step

    parts = [text(LEFT, 16, title, font_weight="600", font_size="13")]
    for decade in range(low, high + 1):
        y = y_of(10.0**decade)
        parts.append(f'<line x1="{LEFT}" x2="{end}" y1="{y:.1f}" y2="{y:.1f}" stroke="#e4e6e9"/>')
        label = f"{10.0**decade:g}" if decade > -5 else f"1e{decade}"
        parts.append(text(LEFT - 6, y + 4, label, text_anchor="end", fill="#5d6470"))
    for i, (setting, figures) in enumerate(rows):
        for n, line in enumerate(wrapped(setting, max(6, int(step / 5.2)))):
            parts.append(text(x_of(i), bottom + 14 + 11 * n, line, text_anchor="middle", fill="#5d6470", font_size="9.5"))
        if figures["undisturbed"] > 0:
            y = y_of(figures["undisturbed"])
            parts.append(f'<line x1="{x_of(i) - 0.4 * step:.1f}" x2="{x_of(i) + 0.4 * step:.1f}" y1="{y:.1f}" y2="{y:.1f}" '
                         'stroke="#0f6cbd" stroke-dasharray="4 3"/>')
    for name, _, colour in SERIES:
        points = [(x_of(i), y_of(f[name])) for i, (_, f) in enumerate(rows) if f[name] > 0]
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        parts.append(f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-opacity=".45"/>')
        parts += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3.4" fill="{colour}"/>' for x, y in points]
    return "".join(parts)


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    panels = panels_of(sys.argv[1])
    rows = math.ceil(len(panels) / COLUMNS)
    width, height = COLUMNS * WIDTH, 34 + rows * HEIGHT
    parts = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="0 0 {width} {height}" '
             'font-family="system-ui,sans-serif" font-size="11"><rect width="100%" height="100%" fill="#fff"/>']
    x = 16
    for _, label, colour in SERIES:
        parts.append(f'<circle cx="{x}" cy="16" r="4" fill="{colour}"/>' + text(x + 9, 20, label))
        x += 130
    parts.append(f'<line x1="{x - 8}" x2="{x + 12}" y1="16" y2="16" stroke="#0f6cbd" stroke-dasharray="4 3"/>' +
                 text(x + 18, 20, "ours, the capture undisturbed; all: relative RMSE on held-out lights"))
    for i, (title, figures) in enumerate(panels.items()):
        parts.append(f'<g transform="translate({i % COLUMNS * WIDTH} {34 + i // COLUMNS * HEIGHT})">{panel(title, figures)}</g>')
    with open(sys.argv[2], "w", encoding="utf-8") as file:
        file.write("".join(parts) + "</svg>\n")


if __name__ == "__main__":
    main()
