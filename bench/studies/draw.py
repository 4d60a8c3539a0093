#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Draws the CSV files that refield-studies and the stability tests write.

    bench/studies/draw.py FOLDER [-o FOLDER]

Each known CSV file in the folder becomes one or more SVG files: chart.csv (time, size, images, relighting), prt.csv,
dynamic.csv, bases.csv, factors.csv, pack.csv, stability.csv, harmonics.csv and patterns.csv. Needs python3-matplotlib.
docs/method/studies.md lists the commands that write the CSV files.
"""
import argparse
import csv
import math
import pathlib
import sys

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt  # noqa: E402
import matplotlib.ticker  # noqa: E402

plt.rcParams.update({
    "svg.fonttype": "none", "svg.hashsalt": "refield", "font.family": "sans-serif", "font.size": 8, "axes.titlesize": 9,
    "axes.grid": True, "grid.color": "#e4e6e9", "axes.axisbelow": True, "legend.fontsize": 7, "lines.markersize": 4,
})
COLOURS = [plt.get_cmap("tab20")(k) for k in (*range(0, 20, 2), *range(1, 20, 2))]
MARKERS = "osD^vP*Xph"
style_of = {}  # label → number of its colour and marker in all panels of a figure


class Numbers(matplotlib.ticker.LogFormatter):
    """Numbers at powers of ten, and between them where an axis spans less than one and a half decades."""

    def __init__(self):
        super().__init__(minor_thresholds=(1.5, 0.7))

    def _num_to_string(self, x, vmin, vmax):
        return f"{x:g}"


def style(label):
    k = style_of.setdefault(label, len(style_of))
    return {"label": label, "color": COLOURS[k % len(COLOURS)], "marker": MARKERS[k % len(MARKERS)], "linewidth": 1}


def read_rows(path):
    with open(path, newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    if not rows:
        sys.exit(f"draw.py: {path}: has no rows; run the study again")
    return rows


def number(text):
    """NaN where a study has no figure."""
    return float(text) if text else math.nan


def group(rows, label, x, y):
    """Tracks of the rows: label → [(x, y)], in the order of the rows. x and y are functions of a row."""
    tracks = {}
    for row in rows:
        tracks.setdefault(label(row), []).append((x(row), y(row)))
    return tracks


def pareto_front(points):
    """Points than which none has both coordinates smaller, by ascending x."""
    front = []
    for x, y in sorted(points):
        if not front or y < front[-1][1]:
            front.append((x, y))
    return front


def draw_panel(axes, tracks, title, x_label, y_label, front=False):
    """Draws tracks on logarithmic axes, which have no place for zero and infinity; those points are left out."""
    visible = {
        label: [p for p in points if all(math.isfinite(v) and v > 0 for v in p)] for label, points in tracks.items()
    }
    for label, points in visible.items():
        axes.plot(*zip(*sorted(points)) if points else ([], []), **style(label))
    if front:
        corners = pareto_front([p for points in visible.values() for p in points])
        if corners:
            axes.step(*zip(*corners), where="post", color="#1c1e21", linestyle="--", linewidth=1, label="Pareto front")
    axes.set(title=title, xlabel=x_label, ylabel=y_label)
    if not any(visible.values()):
        return
    axes.set(xscale="log", yscale="log")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(Numbers())
        axis.set_minor_formatter(Numbers())


def make_figure(path, panels, columns, title=""):
    """Panels are functions of axes. One legend for all panels is beside them."""
    columns = min(columns, len(panels))
    rows = math.ceil(len(panels) / columns)
    style_of.clear()
    figure, grid = plt.subplots(rows, columns, figsize=(4.2 * columns, 3.2 * rows + 0.3), squeeze=False,
                                layout="constrained")
    for axes, panel in zip(grid.flat, panels):
        panel(axes)
    for axes in grid.flat[len(panels):]:
        axes.remove()
    entries = {}
    for axes in grid.flat[:len(panels)]:
        entries.update({label: handle for handle, label in zip(*axes.get_legend_handles_labels())})
    figure.legend(entries.values(), entries.keys(), loc="upper left", bbox_to_anchor=(1.0, 1.0))
    if title:
        figure.suptitle(title)
    figure.savefig(path, bbox_inches="tight", metadata={"Date": None})
    plt.close(figure)
    print(path)


def draw_chart(rows, output):
    """Methods against one another: error against time, size, images and relighting time, by kind of light."""
    lights = [name for name in ("natural", "bar", "square", "white") if name in rows[0]]
    most = max(int(row["images"]) for row in rows)
    figures = (("time", "Error and estimation time", "estimation time in seconds, including file reading", "seconds"),
               ("size", "Error and size", "bytes per pixel", "bytes_per_pixel"),
               ("images", "Error and number of images", "training images", "images"),
               ("relighting", "Error and relighting time", "relighting time in ms per frame", "relight_ms"))
    for name, title, x_label, column in figures:
        over_images = column == "images"
        some = rows if over_images else [row for row in rows if int(row["images"]) == most]
        panels = []
        for light in lights:
            for error, which in ((light, "whole image"), (light + "_median", "median pixel")):
                tracks = group(some, lambda row: row["method"] + (", " + row["setting"] if row["setting"] else ""),
                               lambda row: number(row[column]), lambda row, error=error: number(row[error]))
                panels.append(lambda axes, tracks=tracks, light=light, which=which: draw_panel(
                    axes, tracks, f"Held-out light: {light}, {which}", x_label, "relative RMSE", front=not over_images))
        make_figure(output / f"{name}.svg", panels, 2, title if over_images else f"{title} ({most} images)")


def draw_prt(rows, output):
    """Methods of precomputed radiance transfer."""
    def panel(title, x_label, column):
        tracks = group(rows, lambda row: row["method"], lambda row: number(row[column]),
                       lambda row: number(row["median_error"]))
        return lambda axes: draw_panel(axes, tracks, title, x_label, "relative RMSE, median of the lights", front=True)

    make_figure(output / "prt.svg", [
        panel("Error and relighting time", "relighting time in ms per light", "relight_ms"),
        panel("Error and size", "megabytes", "megabytes"),
        panel("Error and precomputation time", "precomputation time in seconds", "precompute_seconds")], 2)


def draw_dynamic(rows, output):
    """Settings of dynamic scenes."""
    def of_shadows(row):
        return row["method"].startswith(("shadow rays", "shadows"))

    def of_both(row):
        return not of_shadows(row) or row["method"].endswith("by points")

    def indirect(row):
        return not of_shadows(row)

    def panel(title, light, x_label, column, shown):
        tracks = group(filter(shown, rows), lambda row: row["method"], lambda row: number(row[column]),
                       lambda row: number(row[f"{light} of all"]))
        return lambda axes: draw_panel(axes, tracks, title, x_label, f"RMSE of {light} light over all light", front=True)

    make_figure(output / "dynamic.svg", [
        panel("All light and frame time", "all", "frame time in ms", "frame_ms", of_both),
        panel("Direct light and its time", "direct", "time of direct light in ms", "direct_ms", of_shadows),
        panel("Indirect light and frame time", "bounced", "frame time in ms", "frame_ms", indirect),
        panel("Indirect light and size", "bounced", "megabytes", "megabytes", indirect)], 2)


def draw_bases(rows, output):
    """Bases for light on surfaces."""
    def panel(title, surface, y_label, column, most):
        some = [row for row in rows if row["surface"] == surface and int(row["functions"]) <= most]
        tracks = group(some, lambda row: row["basis"], lambda row: number(row["functions"]),
                       lambda row: number(row[column]))
        return lambda axes: draw_panel(axes, tracks, f"{title}: {surface}", "basis functions N", y_label)

    surfaces = list(dict.fromkeys(row["surface"] for row in rows))
    box = surfaces[-1]
    panels = [panel("Error", s, "relative RMSE, median of the light sources", "error", 64) for s in surfaces[:-1]]
    panels += [panel("Condition of the matrix of equation 7", box, "condition", "condition", 256),
               panel("Error with its inverse", box, "relative RMSE", "inverse_error", 256),
               panel("Error with orthonormal weights", box, "relative RMSE", "error", 256)]
    make_figure(output / "bases.svg", panels, 3)


def draw_factors(rows, output):
    """BRDF factorisation."""
    def panel(title, column):
        tracks = group(rows, lambda row: f"n = {row['exponent']}", lambda row: number(row["terms"]),
                       lambda row: number(row[column]))
        return lambda axes: draw_panel(axes, tracks, title, "BRDF terms K", "relative RMSE")

    make_figure(output / "factors.svg", [panel("Error of the BRDF", "error"),
                                         panel("Error under a light source of 34° radius", "area_light_error")], 2)


def draw_pack(rows, output):
    """Size and error of packed fields."""
    kinds = list(rows[0])[list(rows[0]).index("pruned") + 1:]
    tracks = {kind: [(number(row["megabytes"]), number(row[kind])) for row in rows] for kind in kinds}
    full = number(rows[0]["full_megabytes"])
    make_figure(output / "pack.svg", [lambda axes: draw_panel(
        axes, tracks, "Relit images compared with the full field", f"size in MB (full field: {full:.1f} MB)",
        "relative RMSE by kind of light")], 1)


def draw_stability(rows, output):
    """Estimation from difficult captures: one panel per condition."""
    def panel(condition):
        some = [row for row in rows if row["condition"] == condition]

        def draw(axes):
            places = range(len(some))
            for column, label in (("error", "refield"), ("ridge", "ridge regression"), ("constant", "constant")):
                axes.plot(places, [number(row[column]) or math.nan for row in some], **style(label))
            axes.hlines([number(row["undisturbed"]) or math.nan for row in some], [p - 0.4 for p in places],
                        [p + 0.4 for p in places], color=COLOURS[0], linestyle="--", linewidth=1,
                        label="refield, undisturbed capture")
            axes.set(title=condition, ylabel="relative RMSE, held-out lights", yscale="log")
            axes.set_xticks(places, [row["setting"] for row in some], rotation=20, ha="right", fontsize=6)
        return draw

    make_figure(output / "stability.svg", [panel(c) for c in dict.fromkeys(row["condition"] for row in rows)], 3)


def draw_harmonics(rows, output):
    """Order and window of spherical harmonics."""
    degrees = sorted({float(row["degrees"]) for row in rows})

    def draw(axes, label, some, column, **settings):
        for name, points in group(some, label, lambda row: int(row["order"]), lambda row: number(row[column])).items():
            axes.plot(*zip(*sorted(points)), **style(name))
        axes.set(xlabel="order", **settings)

    def errors(axes):
        some = sorted((row for row in rows if row["window"] == "none"), key=lambda row: float(row["degrees"]))
        draw(axes, lambda row: f"{float(row['degrees']):.0f}°", some, "error", yscale="log", ylabel="relative RMSE",
             title="Error by order and width of the light")

    def ringing(axes):
        some = [row for row in rows if float(row["degrees"]) == degrees[0]]
        draw(axes, lambda row: f"window: {row['window']}", some, "darkest", ylabel="darkest ∕ brightest vertex",
             title=f"Ringing by order and window, light of {degrees[0]:.0f}°")

    make_figure(output / "harmonics.svg", [errors, ringing], 2)


def draw_patterns(rows, output):
    """Error against the number of photographs for each set of light patterns."""
    def panel(scene, kind):
        some = [row for row in rows if row["scene"] == scene]
        tracks = group(some, lambda row: f"{row['set']}, {row['mode']}, noise {100 * float(row['noise']):g} %",
                       lambda row: int(row["photographs"]), lambda row: number(row[kind]))
        return lambda axes: draw_panel(axes, tracks, f"{scene}: {kind}", "photographs", "relative RMSE, median pixel")

    scenes = dict.fromkeys(row["scene"] for row in rows)
    make_figure(output / "patterns.svg", [panel(scene, kind) for kind in ("natural", "bar") for scene in scenes], len(scenes))


FIGURES = {
    "chart.csv": draw_chart, "prt.csv": draw_prt, "dynamic.csv": draw_dynamic, "bases.csv": draw_bases,
    "factors.csv": draw_factors, "pack.csv": draw_pack, "stability.csv": draw_stability, "harmonics.csv": draw_harmonics,
    "patterns.csv": draw_patterns,
}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=pathlib.Path, help="folder with CSV files")
    parser.add_argument("-o", "--output", type=pathlib.Path, help="folder for the SVG files (default: the same folder)")
    arguments = parser.parse_args()
    output = arguments.output or arguments.folder
    known = [name for name in FIGURES if (arguments.folder / name).is_file()]
    if not known:
        sys.exit(f"draw.py: {arguments.folder}: holds none of {', '.join(FIGURES)}; give the folder that a study wrote")
    output.mkdir(parents=True, exist_ok=True)
    for name in known:
        FIGURES[name](read_rows(arguments.folder / name), output)


if __name__ == "__main__":
    main()
