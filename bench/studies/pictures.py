#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Makes the film and the comparison of the README from the tabletop scene, and the documents' screenshots.

    bench/studies/pictures.py fields OUT --env MAP     # traces, estimates, relights: 1 hour on 2 cores at 1024x768
    bench/studies/pictures.py film OUT film.webp       # joins the frames; needs ffmpeg
    bench/studies/pictures.py crops OUT crops.jpg      # mirror, glass and shadow, enlarged
    bench/studies/pictures.py grain OUT --size 48x36   # error of the traced picture against one with 16 times the samples, in a
                                                       # window of that size (31 rows or more) of a picture of 1024x768
    bench/studies/pictures.py screens OUT docs/images --mesh MESH.rfield --env MAP   # viewer and web page, in Xvfb and Chromium

`fields` traces the scene with least noise (--quality 3), estimates a field in both modes from 180 designed patterns, and relights
it: a white bar that slides and the environment map MAP that turns (frames in OUT/bar and OUT/turn); and two held-out lights,
from which `crops` shows the traced picture, the paper's method, the default mode and the differences of both. The film's map is
sunset.exr of Debian's package blender-data (CC0). `grain` traces the scene with 17 seeds and compares the first with the mean of
the others: in total, and what remains of the difference after subtraction of its mean over 5×5 pixels, which is the grain.
Needs numpy and the Python module of OpenImageIO; `screens` also xvfb, chromium and chromium-driver.
"""
import argparse
import math
import os
import pathlib
import re
import subprocess
import sys
import tempfile

import numpy
import OpenImageIO as oiio

RECIPE = pathlib.Path(__file__).resolve().parents[2] / "datasets_synthetic/tabletop/recipe.toml"
MODES = ("paper", "refined")
# Centre as a part of width and height; name of the held-out light's kind.
CROPS = {"mirror": (0.165, 0.625, "natural"), "glass": (0.625, 0.70, "natural"), "shadow": (0.385, 0.76, "bar")}


def read_image(path):
    return oiio.ImageBuf(str(path)).get_pixels(oiio.FLOAT)[:, :, :3]


def held_out(truth):
    """The first held-out frame of each kind."""
    frames = {}
    for frame in (truth / "session.toml").read_text().split("[[frame]]")[1:]:
        entry = dict(re.findall(r"(\w+) = '([^']*)'", frame))
        if entry["role"] == "test":
            frames.setdefault(entry["kind"], entry)
    return frames


def fields(arguments):
    def refield(*words):
        subprocess.run([arguments.program, *map(str, words)], check=True)

    out, truth = arguments.out, arguments.out / "truth"
    refield("simulate", RECIPE, "--size", arguments.size, "--quality", 3, "--transport", "never", "--half", "-o", truth)
    for mode in MODES:
        refield("estimate", truth, "--mode", mode, "-o", out / f"{mode}.rfield")
        for kind in ("natural", "bar"):
            refield("relight", out / f"{mode}.rfield", "--light", truth / held_out(truth)[kind]["illumination"],
                    "-o", out / f"{mode}-{kind}.exr")
    refined = out / "refined.rfield"
    refield("relight", refined, "--bar", 0.125, "--frames", 30, "--format", "png", "-o", out / "bar")
    refield("relight", refined, "--env", arguments.env, "--rotate", "--frames", 48, "--exposure", 8, "--format", "png",
            "-o", out / "turn")


def film(arguments):
    frames = [frame for part in ("bar", "turn") for frame in sorted((arguments.out / part).glob("*.*"))]
    listing = arguments.out / "film.txt"
    listing.write_text("".join(f"file '{frame.resolve()}'\nduration 0.0833333\n" for frame in frames))
    subprocess.run(["ffmpeg", "-v", "error", "-y", "-f", "concat", "-safe", "0", "-i", listing, "-vf", "fps=12", "-loop", "0",
                    "-c:v", "libwebp", "-quality", "62", "-compression_level", "6", arguments.picture], check=True)


def display(pixels, exposure):
    linear = numpy.clip(pixels * exposure, 0, 1)
    return numpy.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def crops(arguments):
    out, columns = arguments.out, []
    frames = held_out(out / "truth")
    for x, y, kind in CROPS.values():
        reference = read_image(out / "truth" / frames[kind]["observed"])
        relit = [read_image(out / f"{mode}-{kind}.exr") for mode in MODES]
        height, width = reference.shape[:2]
        half_width, half_height = width // 12, height // 12
        centre = (round(y * height), round(x * width))
        window = numpy.s_[centre[0] - half_height:centre[0] + half_height, centre[1] - half_width:centre[1] + half_width]
        exposure = 0.9 / numpy.percentile(reference[window].max(axis=2), 98)
        pictures = [reference, *relit, *(4 * numpy.abs(picture - reference) for picture in relit)]
        tiles = [numpy.kron(display(picture[window], exposure), numpy.ones((2, 2, 1))) for picture in pictures]
        gap = numpy.ones((8, tiles[0].shape[1], 3))
        columns.append(numpy.vstack([part for tile in tiles for part in (tile, gap)][:-1]))
    gap = numpy.ones((columns[0].shape[0], 8, 3))
    sheet = numpy.hstack([part for column in columns for part in (column, gap)][:-1])
    buffer = oiio.ImageBuf(oiio.ImageSpec(sheet.shape[1], sheet.shape[0], 3, oiio.UINT8))
    buffer.set_pixels(oiio.ROI(), numpy.ascontiguousarray(sheet, numpy.float32))
    buffer.write(str(arguments.picture))


def box_mean(pixels, radius=2):
    """Mean over a square of pixels, smaller at the border."""
    rows, columns = pixels.shape[:2]
    sums = numpy.pad(pixels.cumsum(0).cumsum(1), ((1, 0), (1, 0), (0, 0)))
    y0, y1 = numpy.clip([numpy.arange(rows) - radius, numpy.arange(rows) + radius + 1], 0, rows)
    x0, x1 = numpy.clip([numpy.arange(columns) - radius, numpy.arange(columns) + radius + 1], 0, columns)
    total = sums[y1][:, x1] - sums[y0][:, x1] - sums[y1][:, x0] + sums[y0][:, x0]
    return total / ((y1 - y0)[:, None] * (x1 - x0)[None, :])[..., None]


def grain(arguments):
    lights, pictures = {}, {}
    rows = int(arguments.size.split("x")[1])
    field_of_view = 2 * math.degrees(math.atan(math.tan(math.radians(12.5)) * rows / 768))
    recipe = arguments.out / "window.toml"
    recipe.write_text(f'base = "{RECIPE}"\n[camera]\ntarget = [{arguments.target}]\nvertical_fov_degrees = {field_of_view}\n')
    for seed in range(17):
        truth = arguments.out / f"seed-{seed}"
        subprocess.run([arguments.program, "--quiet", "simulate", recipe, "--size", arguments.size, "--quality", str(arguments.quality),
                        "--seed", str(2004 + seed), "--light-size", "32x24", "--train", "1", "--test", "1,1,0", "--transport", "always", "--force", "-o", truth],
                       check=True)
        lights = lights or {kind: truth / frame["illumination"] for kind, frame in held_out(truth).items() if kind != "black"}
        for kind, light in lights.items():
            picture = truth / f"{kind}.exr"
            subprocess.run([arguments.program, "--quiet", "relight", truth / "transport.rfield", "--light", light, "--force", "-o", picture],
                           check=True)
            pictures.setdefault(kind, []).append(read_image(picture).astype(float))
    for kind, (first, *others) in pictures.items():
        reference = numpy.mean(others, axis=0)
        difference = first - reference
        rough = difference - box_mean(difference)
        level = numpy.sqrt((reference ** 2).mean(axis=2))
        whole, median = ([numpy.sqrt((error ** 2).mean() / (reference ** 2).mean()) for error in (difference, rough)],
                         [numpy.median(numpy.sqrt((error ** 2).mean(axis=2)) / numpy.maximum(level, 1e-9)) for error in (difference, rough)])
        print(f"{kind:9} whole picture {whole[0]:.4f}, of it grain {whole[1]:.4f}; median pixel {median[0]:.4f}, of it grain {median[1]:.4f}")


# Picture -> file and commands (docs/guide/viewer.md#scripts); positions are of a field of 320×240 pixels, light 128×96.
ROOM = RECIPE.parents[1] / "dynamic/room.toml"
LIGHTS = ["key B", "drag light 64 48 72 48 2"]
SCREENS = {
    "lights": ("refined.rfield", [*LIGHTS, "press Auto-expose"]),
    "kernels": ("refined.rfield", [*LIGHTS, "press Auto-expose", "pick 118 112"]),
    "probe": ("refined.rfield", ["where", "probe 50 70"]),
    "error": ("refined.rfield", [*LIGHTS, "key 3"]),
    "help": ("refined.rfield", [*LIGHTS, "press Auto-expose", "key F1"]),
    "mesh": ("mesh", ["where", "press Auto-expose", "pick 460 420"]),
    "scene": (ROOM, ["where", "drag image 366 588 470 596", "key ,"]),
}


def write_jpeg(picture, path):
    buffer = oiio.ImageBuf(str(picture))
    buffer.specmod().attribute("compression", "jpeg:90")
    buffer.write(str(path))


def screens(arguments):
    for name, (file, commands) in SCREENS.items():
        path = {"mesh": arguments.mesh, ROOM: ROOM}.get(file, arguments.out / str(file))
        if path is None:
            continue
        script, picture = arguments.out / f"{name}.txt", arguments.out / f"{name}.png"
        size = "1440x900" if path == ROOM else "1280x860"
        script.write_text("\n".join([*commands, "wait 20", f"screenshot {picture}", "quit", ""]))
        light = ["--light", arguments.env] if file == "mesh" else []
        subprocess.run(["xvfb-run", "-a", "-s", "-screen 0 1600x1000x24", arguments.program, "view", path, *light, "--script", script,
                        "--size", size], check=True, env={**os.environ, "LIBGL_ALWAYS_SOFTWARE": "1"})
        write_jpeg(picture, arguments.picture / f"viewer-{name}.jpg")
    page, field = arguments.out / "page", arguments.out / "table-top.rfield"  # its name is the heading of the page
    field.unlink(missing_ok=True)
    field.symlink_to("refined.rfield")
    subprocess.run([arguments.program, "export-web", field, "--env", arguments.env, "--force", "-o", page],
                   check=True)
    sys.path.insert(0, str(RECIPE.parents[2] / "tests/cli"))
    from webdriver import Browser
    with tempfile.TemporaryDirectory() as folder:
        browser = Browser(folder, ["--allow-file-access-from-files"])
        try:
            browser.command("POST", "/window/rect", {"width": 1280, "height": 960})
            browser.command("POST", "/url", {"url": (page / "index.html").resolve().as_uri()})
            browser.wait_until("typeof viewer !== 'undefined' && viewer !== null && viewer.atRest()")
            by_map = "const m = document.getElementById('maps'); m.value = '0'; m.dispatchEvent(new Event('change'));"
            for name, act in (("map", lambda: browser.run(by_map)), ("pixel", lambda: browser.drag("#scene", [(0.2125, 0.594)]))):
                act()
                browser.wait_until("viewer.atRest()")
                browser.screenshot(arguments.out / f"{name}.png")
                write_jpeg(arguments.out / f"{name}.png", arguments.picture / f"web-{name}.jpg")
                browser.click("input[value=bar]")
        finally:
            browser.close()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("step", choices=("fields", "film", "crops", "grain", "screens"))
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("picture", type=pathlib.Path, nargs="?", help="of film and crops; folder of screens")
    parser.add_argument("--mesh", type=pathlib.Path, help="field of a mesh, for screens")
    parser.add_argument("--env", default="/usr/share/blender/datafiles/studiolights/world/sunset.exr")
    parser.add_argument("--size", default="1024x768")
    parser.add_argument("--target", default="-0.10, 0.03, -0.20", help="of grain: middle of the window, in the scene (the yellow block)")
    parser.add_argument("--quality", type=int, default=3, help="of tracing, of grain")
    parser.add_argument("--program", default="build/release/cli/refield")
    arguments = parser.parse_args()
    {"fields": fields, "film": film, "crops": crops, "grain": grain, "screens": screens}[arguments.step](arguments)


if __name__ == "__main__":
    main()
