#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A capture with a DSLR as a careful amateur makes it, from the files of the camera to the field.

    bench/studies/amateur_capture.py -o OUT --program build/release/cli/refield [--defects NAME,...] [--check 1.3]

Renders the scene of datasets_synthetic/tabletop (exact pictures of two samples per pixel and direction), photographs it
under the patterns of `refield acquire lights --starter` as bracketed JPEG files with EXIF, and runs the commands of
docs/guide/capture.md: import, info, estimate. Does this twice, with and without the defects, and prints the errors of
both fields against exact light: medians over pixels of natural light, bars and full-screen primaries, and the whole
picture under natural light, with the brightness that fits the median sample best (highlights clip in every exposure).
--width 80 takes a quarter of the time of 160. With --check the study fails where an error exceeds that many times the other.

Defects (default: all):
    contrast   the camera's picture style bends samples
    times      files state 1/60, 1/15 and 1/4 s for 2^-6, 2^-4 and 2^-2 s
    mixing     each channel of the camera sees 10 % of other primaries of the monitor
    creep      the picture moves by half a pixel from the first photograph to the last
    tone       the monitor has an exponent of 2.1 in place of sRGB
    hot        40 hot pixels
    missing    the bracket of train_040 is missing
    doubled    that of train_100 is there twice
    black      one black bracket more before the first and after the last pattern
    room       the room light is on in the photograph of train_070
    dark       the room light is on in the first black bracket (not in the default)
Needs numpy and the Python module of OpenImageIO.
"""
import argparse
import pathlib
import re
import shutil
import subprocess
import sys
import time

import numpy
import OpenImageIO as oiio

FINER = 2  # samples of the exact picture per pixel and direction
DEFECTS = ["contrast", "times", "mixing", "creep", "tone", "hot", "missing", "doubled", "black", "room"]
MIXING = numpy.array([[1, .1, .02], [.07, 1, .12], [.01, .1, 1]])
POWERS, MARKED = (-6, -4, -2), (1 / 60, 1 / 15, 1 / 4)  # of exposure times, and what cameras call them
ROOM = 0.5  # room light of the capture, as a share of the scene's ambient light
EVERY = 6.0  # seconds per pattern


def read(path):
    return oiio.ImageBuf(str(path)).get_pixels(oiio.FLOAT)[..., :3]


def write(path, pixels):
    height, width, channels = pixels.shape
    buffer = oiio.ImageBuf(oiio.ImageSpec(width, height, channels, oiio.FLOAT))
    buffer.set_pixels(buffer.spec().roi, numpy.ascontiguousarray(pixels, numpy.float32))
    if not buffer.write(str(path)):
        sys.exit(f"{path}: {buffer.geterror()}")


def srgb(linear):
    return numpy.where(linear <= 0.0031308, 12.92 * linear, 1.055 * numpy.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)


def emitted(pattern, defects):
    """Linear light of the monitor for an 8-bit pattern."""
    levels = read(pattern)
    if "tone" in defects:
        return levels**2.1
    return numpy.where(levels <= 0.04045, levels / 12.92, ((levels + 0.055) / 1.055) ** 2.4)


def seen(fine, dx, dy, defects):
    """The camera's picture [height, width, 3]: moved by (dx, dy) of its pixels, channels mixed."""
    height, width = fine.shape[:2]
    y = numpy.clip(numpy.arange(height) - FINER * dy, 0, height - 1.001)
    x = numpy.clip(numpy.arange(width) - FINER * dx, 0, width - 1.001)
    v, u = y.astype(int), x.astype(int)
    b, a = (y - v)[:, None, None], (x - u)[None, :, None]
    rows = fine[v] * (1 - b) + fine[v + 1] * b
    moved = rows[:, u] * (1 - a) + rows[:, u + 1] * a
    mean = moved.reshape(height // FINER, FINER, width // FINER, FINER, 3).mean((1, 3))
    return mean @ MIXING.T if "mixing" in defects else mean


class Photographer:
    """Writes brackets of a capture."""

    def __init__(self, folder, defects, gain):
        self.folder, self.defects, self.gain, self.time, self.count = folder, defects, gain, 0.0, 0
        folder.mkdir(parents=True)
        self.rng = numpy.random.default_rng(7)
        self.hot = numpy.random.default_rng(11).random((40 if "hot" in defects else 0, 3))

    def bracket(self, picture, again=False):
        for place, (power, marked) in enumerate(zip(POWERS, MARKED)):
            seconds = 2.0**power
            light = 64.0 * self.gain * seconds * numpy.maximum(picture, 0.0)
            for column, row, charge in self.hot:
                light[int(row * light.shape[0]), int(column * light.shape[1])] += 6.0 * charge * seconds
            light += numpy.sqrt(light / 20000.0) * self.rng.standard_normal(light.shape)
            encoded = srgb(numpy.clip(light, 0.0, 1.0))
            if "contrast" in self.defects:  # the S of a picture style
                encoded = encoded - 0.48 * numpy.sin(2 * numpy.pi * encoded) * encoded * (1 - encoded)
            self.write(encoded, marked if "times" in self.defects else seconds, place + (0.4 - EVERY if again else 0.0))
        if not again:
            self.time += EVERY

    def write(self, encoded, stated, after):
        height, width = encoded.shape[:2]
        spec = oiio.ImageSpec(width, height, 3, oiio.UINT8)
        spec.attribute("CompressionQuality", 98)
        spec.attribute("jpeg:subsampling", "4:4:4")
        spec.attribute("ExposureTime", float(stated) * 1.000002)  # OpenImageIO 2.4 writes 1/64 as 1/0
        when = time.strftime("%Y:%m:%d %H:%M:%S", time.gmtime(1087812137 + self.time + after))
        spec.attribute("DateTime", when)
        output = oiio.ImageOutput.create("file.jpg")
        output.open(str(self.folder / f"IMG_{1000 + self.count}.jpg"), spec)
        output.write_image(numpy.ascontiguousarray(numpy.rint(255 * encoded), numpy.uint8))
        output.close()
        self.count += 1


class Study:
    def __init__(self, arguments):
        self.arguments, self.out = arguments, pathlib.Path(arguments.output)
        self.out.mkdir(parents=True, exist_ok=True)

    def run(self, *words, show=False):
        done = subprocess.run([self.arguments.program, *map(str, words)], capture_output=True, text=True)
        if show or done.returncode != 0:
            print(f"$ refield {' '.join(map(str, words))}\n{done.stdout}{done.stderr}", flush=True)
        if done.returncode != 0:
            sys.exit(1)

    def truth(self):
        truth = self.out / "truth"
        if (truth / "session.toml").exists():
            return truth
        recipe = pathlib.Path(__file__).parents[2] / "datasets_synthetic/tabletop/recipe.toml"
        text = recipe.read_text()
        width, height = FINER * self.arguments.width, FINER * self.arguments.width * 3 // 4
        for before, after in (("width = 160", f"width = {width}"), ("height = 120", f"height = {height}"),
                              ("width = 128", "width = 32"), ("height = 96", "height = 24"), ("train = 180", "train = 2")):
            text = re.sub(f"(?m)^{before}", after, text)
        (self.out / "recipe.toml").write_text(text)
        self.run("simulate", self.out / "recipe.toml", "-o", truth)
        return truth

    def photograph(self, name, defects):
        """shots/, and light/ and exact/ of the held-out patterns."""
        folder = self.out / name
        shutil.rmtree(folder, ignore_errors=True)
        patterns = sorted((self.out / "patterns").glob("*.png"))
        for kind in ("light", "exact", "all"):
            (folder / kind).mkdir(parents=True)
        for pattern in patterns:
            write(folder / "all" / f"{pattern.stem}.exr", emitted(pattern, defects))
        self.run("relight", self.truth() / "transport.rfield", "--light", folder / "all", "-o", folder / "fine")
        ambient = ROOM * read(self.truth() / "ambient.exr")
        white = read(folder / "fine" / "test_029.exr")
        camera = Photographer(folder / "shots", defects, 0.35 / numpy.quantile(white, 0.99))
        black = seen(ambient, 0, 0, defects)
        for _ in range(2 if "black" in defects else 1):
            camera.bracket(30 * black if "dark" in defects and camera.count == 0 else black)
        for i, pattern in enumerate(patterns):
            place = 0.5 * i / (len(patterns) - 1) if "creep" in defects else 0.0
            fine = read(folder / "fine" / f"{pattern.stem}.exr")
            room = 30 if "room" in defects and pattern.stem == "train_070" else 1
            picture = seen(fine + room * ambient, place, -0.6 * place, defects)
            if "missing" in defects and pattern.stem == "train_040":
                camera.time += EVERY
            else:
                camera.bracket(picture)
            if "doubled" in defects and pattern.stem == "train_100":
                camera.bracket(picture, again=True)
            if pattern.stem.startswith("test"):
                (folder / "all" / f"{pattern.stem}.exr").rename(folder / "light" / f"{pattern.stem}.exr")
                write(folder / "exact" / f"{pattern.stem}.exr", seen(fine, 0, 0, defects))
        for _ in range(2 if "black" in defects else 1):
            camera.bracket(seen(ambient, place, -0.6 * place, defects))
        for kind in ("all", "fine"):
            shutil.rmtree(folder / kind)

    def errors(self, name):
        folder = self.out / name
        self.run("relight", folder / "scene.rfield", "--light", folder / "light", "-o", folder / "relit")
        names = sorted(path.name for path in (folder / "exact").glob("*.exr"))
        exact = numpy.array([read(folder / "exact" / file) for file in names])
        relit = numpy.array([read(folder / "relit" / file) for file in names])
        bright = (exact[:15] > numpy.quantile(exact[:15], 0.3)) & (relit[:15] > 0)
        relit *= numpy.median(exact[:15][bright] / relit[:15][bright])
        difference, found = (relit - exact) ** 2, []
        for part in (slice(0, 15), slice(15, 23), slice(26, 29)):  # natural light, bars, primaries
            energy = (exact[part] ** 2).sum((0, 3))
            lit = energy > 0
            found.append(numpy.median(numpy.sqrt(difference[part].sum((0, 3))[lit] / energy[lit])))
        return [*found, numpy.sqrt(difference[:15].sum() / (exact[:15] ** 2).sum())]

    def capture(self, name, defects):
        folder = self.out / name
        self.photograph(name, defects)
        self.run("acquire", "import", folder / "shots", "--light", self.out / "patterns", "--ambient-first", "-o",
                 folder / "session", "--force", show=True)
        self.run("info", folder / "session", show=True)
        self.run("estimate", folder / "session", "-o", folder / "scene.rfield", show=True)
        found = self.errors(name)
        print("{}: natural {:.4f}, bars {:.4f}, primaries {:.4f}, whole picture {:.4f}".format(name, *found), flush=True)
        return found

    def run_all(self):
        defects = self.arguments.defects.split(",")
        self.run("acquire", "lights", "--starter", "--light-size", "32x24", "-o", self.out / "lights", "--png", self.out / "patterns",
                 "--force")
        clean = self.capture("clean", [])
        ratios = [a / b for a, b in zip(self.capture("amateur", defects), clean)]
        print("amateur / clean: natural {:.2f}, bars {:.2f}, primaries {:.2f}, whole picture {:.2f}".format(*ratios))
        if self.arguments.check and max(ratios) > self.arguments.check:
            sys.exit(f"an error exceeds {self.arguments.check} times that without defects")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", required=True, help="folder for all files")
    parser.add_argument("--program", required=True, help="the program refield")
    parser.add_argument("--width", type=int, default=160, help="width of the photographs, a multiple of 4")
    parser.add_argument("--defects", default=",".join(DEFECTS), help="names, separated by commas")
    parser.add_argument("--check", type=float, help="largest ratio of the errors")
    Study(parser.parse_args()).run_all()


if __name__ == "__main__":
    main()
