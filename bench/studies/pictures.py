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
it: a white bar that slides, the environment map MAP that turns, and a day behind haze (frames in OUT/bar, OUT/turn and OUT/day);
and two held-out lights, from which `crops` shows the traced picture, the paper's method, the default mode and the differences of
both. The film's map is sunset.exr of Debian's package blender-data (CC0). `grain` traces the scene with 17 seeds and compares the
first with the mean of the others, in pixels that are not black: in total, and what remains of the difference after subtraction of
its mean over 5×5 pixels, which is the grain.
Needs numpy and the Python module of OpenImageIO; `screens` also xvfb, xdotool, chromium and chromium-driver.
"""
import argparse
import math
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import time

import numpy
import OpenImageIO as oiio

RECIPE = pathlib.Path(__file__).resolve().parents[2] / "datasets_synthetic/tabletop/recipe.toml"
MODES = ("paper", "refined")
PARTS = ("bar", "turn", "day")
# Centre as a part of width and height, magnification, and the kind of the held-out light.
CROPS = {"mirror": (0.205, 0.620, 3, "natural"), "glass": (0.625, 0.704, 2, "natural"), "shadow edge": (0.445, 0.706, 4, "bar")}
TILE = (288, 384)


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


def write_image(path, pixels, type=oiio.HALF):
    buffer = oiio.ImageBuf(oiio.ImageSpec(pixels.shape[1], pixels.shape[0], 3, type))
    buffer.set_pixels(oiio.ROI(), numpy.ascontiguousarray(pixels, numpy.float32))
    if type == oiio.UINT8:
        buffer.specmod().attribute("compression", "jpeg:85")
    buffer.write(str(path))


def day_light(hour, width=128, height=96):
    """What the monitor shows at `hour`, 0 at sunrise to 1 at sunset: a sky, and the sun behind haze. Its disc of half a degree
    would be one texel; haze spreads it over a fifth of the width, which 180 patterns resolve and in which no grain is seen."""
    y, x = numpy.mgrid[0:height, 0:width] + 0.5
    elevation = math.sin(math.pi * hour)
    sun_x, sun_y = width * (0.04 + 0.92 * hour), height * (0.92 - 0.80 * elevation)
    distance2 = (x - sun_x) ** 2 + (y - sun_y) ** 2
    path = 1 / (elevation + 0.12)  # through the air, in units of the zenith's
    sun = numpy.exp(-numpy.array([0.06, 0.16, 0.34]) * path)
    horizon = (y / height)[..., None]
    sky = (0.25 + elevation) * ((1 - horizon) * numpy.array([0.08, 0.14, 0.28]) + horizon * (0.06 + 0.16 * sun))
    haze = sum(share * numpy.exp(-0.5 * distance2 / (sigma * width) ** 2) for share, sigma in ((3.0, 0.086), (0.3, 0.234)))
    return sky + haze[..., None] * sun


def fields(arguments):
    def refield(*words):
        subprocess.run([arguments.program, *map(str, words)], check=True)

    out, truth = arguments.out, arguments.out / "truth"
    refield("simulate", RECIPE, "--size", arguments.size, "--quality", 3, "--transport", "never", "--half", "-o", truth)
    refined, sky = out / "refined.rfield", out / "day-light"
    sky.mkdir(exist_ok=True)
    for frame in range(48):
        write_image(sky / f"{frame:04}.exr", day_light(frame / 47))
    for mode in reversed(MODES):
        refield("estimate", truth, "--mode", mode, "-o", out / f"{mode}.rfield")
        for kind in ("natural", "bar"):
            refield("relight", out / f"{mode}.rfield", "--light", truth / held_out(truth)[kind]["illumination"],
                    "-o", out / f"{mode}-{kind}.exr")
    lights = {"bar": ["--bar", 0.125, "--frames", 30], "turn": ["--env", arguments.env, "--rotate", "--frames", 48, "--exposure", 8],
              "day": ["--light", sky, "--exposure", 20]}
    for part in PARTS:
        refield("relight", refined, *lights[part], "--format", "png", "-o", out / part)


def film(arguments):
    frames = [frame for part in PARTS for frame in sorted((arguments.out / part).glob("*.*"))]
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
    for x, y, zoom, kind in CROPS.values():
        pictures = [read_image(path) for path in (out / "truth" / frames[kind]["observed"], *(out / f"{mode}-{kind}.exr" for mode in MODES))]
        (rows, columns_of_tile), (height, width) = (size // zoom for size in TILE), pictures[0].shape[:2]
        top, left = round(y * height) - rows // 2, round(x * width) - columns_of_tile // 2
        columns.append([picture[top:top + rows, left:left + columns_of_tile] for picture in pictures])
    write_image(arguments.picture, sheet(columns), oiio.UINT8)


def sheet(columns):
    """Of each place the reference and the pictures of both modes, enlarged, and four times their errors."""
    names = ("traced", "paper", "refield", "4 times the error of the paper", "4 times the error of refield")
    sheets = []
    for reference, *relit in columns:
        exposure = 0.9 / numpy.percentile(reference.max(axis=2), 95)
        zoom = TILE[1] // reference.shape[1]
        tiles = [display(picture, exposure) for picture in (reference, *relit, *(4 * numpy.abs(picture - reference) for picture in relit))]
        tiles = [numpy.kron(tile, numpy.ones((zoom, zoom, 1))) for tile in tiles]
        sheets.append(numpy.pad(numpy.vstack([numpy.pad(tile, ((48, 0), (0, 0), (0, 0)), constant_values=1) for tile in tiles]),
                                ((0, 0), (0, 8), (0, 0)), constant_values=1))
    pixels = numpy.hstack(sheets)[:, :-8]
    buffer = oiio.ImageBuf(oiio.ImageSpec(pixels.shape[1], pixels.shape[0], 3, oiio.FLOAT))
    buffer.set_pixels(oiio.ROI(), numpy.ascontiguousarray(pixels, numpy.float32))
    for row, name in enumerate(names):
        oiio.ImageBufAlgo.render_text(buffer, 4, row * (TILE[0] + 48) + 36, name, 34, "DejaVuSans", (0, 0, 0))
    return buffer.get_pixels(oiio.FLOAT)


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
        if not lights:
            write_image(arguments.out / "day.exr", day_light(0.25, 32, 24))
            lights = {kind: truth / frame["illumination"] for kind, frame in held_out(truth).items() if kind in ("natural", "bar", "white")}
            lights["day"] = arguments.out / "day.exr"
        for kind, light in lights.items():
            picture = truth / f"{kind}.exr"
            subprocess.run([arguments.program, "--quiet", "relight", truth / "transport.rfield", "--light", light, "--force", "-o", picture],
                           check=True)
            pictures.setdefault(kind, []).append(read_image(picture).astype(float))
    for kind, (first, *others) in pictures.items():
        reference = numpy.mean(others, axis=0)
        level = numpy.sqrt((reference ** 2).mean(axis=2))
        lit = level > 0.01 * numpy.percentile(level, 99)
        words = []
        for error in (first - reference, (first - reference) - box_mean(first - reference)):
            pixels = numpy.sqrt((error ** 2).mean(axis=2))[lit] / level[lit]
            whole = numpy.sqrt((error ** 2).mean() / (reference ** 2).mean())
            words.append(f"whole {whole:.4f}, median {numpy.median(pixels):.4f}, 90 % of the pixels below {numpy.percentile(pixels, 90):.4f}, "
                         f"{100 * (pixels <= 0.01).mean():.0f} % of them within 0.01")
        print(f"{kind:8} error: {words[0]}\n         grain: {words[1]}")


# Picture -> file and what mouse and keys do; positions are of a picture of 320×240 pixels, light 128×96, or of a mesh's picture.
ROOM = RECIPE.parents[1] / "dynamic/room.toml"
LIGHTS = ["key b", "drag light 64 48 72 48"]
SCREENS = {
    "lights": ("refined.rfield", [*LIGHTS, "key a"]),
    "kernels": ("refined.rfield", [*LIGHTS, "key a", "click image 118 112"]),
    "probe": ("refined.rfield", ["hold light 50 70"]),
    "error": ("refined.rfield", [*LIGHTS, "key 3"]),
    "help": ("refined.rfield", [*LIGHTS, "key a", "key F1"]),
    "mesh": ("mesh", ["key a", "click mesh 460 420"]),
    "scene": (ROOM, ["drag mesh 366 588 470 596", "key comma"]),
}


def in_window(what, x, y):
    """Where a window of 1280×860 shows a pixel or a texel (relight/viewer/gui/viewer_window.cpp, draw)."""
    if what == "mesh":
        return 8 + x, 8 + y
    return (862.4 + 3.2 * (x + 0.5), 8 + 3.2 * (y + 0.5)) if what == "light" else (8 + 2.645 * (x + 0.5), 97.6 + 2.645 * (y + 0.5))


def screenshot(program, words, title, actions, picture, environment):
    """What `view` shows after xdotool moved its mouse and keys."""
    def xdotool(*words):
        subprocess.run(["xdotool", *map(str, words)], check=True, env=environment)
        time.sleep(1.0)

    with tempfile.TemporaryDirectory() as folder:
        viewer = subprocess.Popen([pathlib.Path(program).resolve(), "view", *words], cwd=folder, env=environment)
        xdotool("search", "--sync", "--name", title + " – refield")
        for action in actions:
            verb, *rest = action.split()
            if verb == "key":
                xdotool("key", *rest)
                continue
            places = [in_window(rest[0], float(x), float(y)) for x, y in zip(rest[1::2], rest[2::2])]
            xdotool("mousemove", *map(round, places[0]), "mousedown", 3 if verb == "hold" else 1)
            if verb == "drag":
                xdotool("mousemove", *map(round, places[1]))
            if verb != "hold":
                xdotool("mouseup", 1)
        xdotool("key", "s")
        shutil.move(pathlib.Path(folder) / "view-0001.png", picture)
        xdotool("mouseup", 3, "key", "shift+q")
        viewer.wait()


def write_jpeg(picture, path):
    buffer = oiio.ImageBuf(str(picture))
    buffer.specmod().attribute("compression", "jpeg:90")
    buffer.write(str(path))


def screens(arguments):
    screen = subprocess.Popen(["Xvfb", "-displayfd", "1", "-screen", "0", "1600x1000x24"], stdout=subprocess.PIPE, text=True)
    environment = {**os.environ, "DISPLAY": ":" + screen.stdout.readline().strip(), "LIBGL_ALWAYS_SOFTWARE": "1"}
    for name, (file, commands) in SCREENS.items():
        path = {"mesh": arguments.mesh, ROOM: ROOM}.get(file, arguments.out / str(file))
        if path is None:
            continue
        picture = arguments.out / f"{name}.png"
        size = "1440x900" if path == ROOM else "1280x860"
        light = ["--light", pathlib.Path(arguments.env).resolve()] if file == "mesh" else []
        screenshot(arguments.program, [path.resolve(), *light, "--size", size], path.name, commands, picture, environment)
        write_jpeg(picture, arguments.picture / f"viewer-{name}.jpg")
    screen.terminate()
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
