#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Draws what order and windows do to lights of several sizes.

REFIELD_FIGURES=out build/release/tests/simulate/test_simulate --gtest_filter='*HarmonicOrder*'
tests/simulate/prt/draw_harmonics.py out/harmonics.csv docs/images/harmonics.svg
"""
import csv
import math
import sys

WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 460, 300, 60, 70, 34, 40
COLOURS = ["#0f6cbd", "#d9680f", "#2e7d32", "#8e24aa", "#6b7280"]
ORDERS = range(2, 9)


def text(x, y, content, more=""):
    return f'<text x="{x:.1f}" y="{y:.1f}" {more}>{content}</text>'


def x_of(order):
    return LEFT + (order - 2) / 6 * (WIDTH - LEFT - RIGHT)


def panel(title, lines, marks, y_of):
    """lines: label and {order: value}; marks: value and label."""
    parts = [text(LEFT, 18, title, 'font-weight="600" font-size="13"')]
    for value, label in marks:
        y = y_of(value)
        parts.append(f'<line x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{y:.1f}" y2="{y:.1f}" stroke="#e4e6e9"/>')
        parts.append(text(LEFT - 6, y + 4, label, 'text-anchor="end" fill="#5d6470"'))
    for order in ORDERS:
        parts.append(text(x_of(order), HEIGHT - BOTTOM + 16, order, 'text-anchor="middle" fill="#5d6470"'))
    parts.append(text((LEFT + WIDTH - RIGHT) / 2, HEIGHT - 8, "order", 'text-anchor="middle" fill="#5d6470"'))
    ends = {}  # labels keep apart
    for label, values in sorted(lines, key=lambda line: y_of(line[1][8])):
        ends[label] = max([y_of(values[8])] + [y + 12 for y in ends.values()])
    for (label, values), colour in zip(lines, COLOURS):
        points = [(x_of(order), y_of(values[order])) for order in ORDERS]
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        parts.append(f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="1.6"/>')
        parts += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="2.6" fill="{colour}"/>' for x, y in points]
        parts.append(text(points[-1][0] + 8, ends[label] + 4, label, f'fill="{colour}"'))
    return "".join(parts)


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    rows = {}  # (degrees, window) to {order: (error, darkest)}
    with open(sys.argv[1], newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            key = (float(row["degrees"]), row["window"])
            rows.setdefault(key, {})[int(row["order"])] = (float(row["error"]), float(row["darkest"]))
    bottom = HEIGHT - BOTTOM

    def of_error(value):
        return bottom - (math.log10(value) + 3) / 3 * (bottom - TOP)

    def of_darkness(value):
        return TOP - value / 0.3 * (bottom - TOP)

    degrees = sorted({key[0] for key in rows})
    errors = [(f"{d:.0f}°", {o: rows[d, "none"][o][0] for o in ORDERS}) for d in degrees]
    small = degrees[0]
    windows = [(w, {o: rows[small, w][o][1] for o in ORDERS}) for w in ("none", "lanczos", "hann")]
    left = panel("Error by order; lights by their width", errors, [(10.0**k, f"{10.0**k:g}") for k in range(-3, 1)], of_error)
    right = panel(f"Darkest over brightest vertex, a light of {small:.0f}°", windows,
                  [(-k / 20, f"{-k / 20:.2f}") for k in range(7)], of_darkness)
    with open(sys.argv[2], "w", encoding="utf-8") as file:
        file.write(f'<svg xmlns="http://www.w3.org/2000/svg" width="{2 * WIDTH}" height="{HEIGHT}" '
                   f'viewBox="0 0 {2 * WIDTH} {HEIGHT}" font-family="system-ui,sans-serif" font-size="11">'
                   f'<rect width="100%" height="100%" fill="#fff"/>{left}<g transform="translate({WIDTH} 0)">{right}</g></svg>\n')


if __name__ == "__main__":
    main()
