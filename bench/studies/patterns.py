#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Compares sets of light patterns: error of the field against the number of photographs.

    bench/studies/patterns.py TRUTH -o OUT [--set NAME=FOLDER] [--photographs 30 90 180] [--noise 0.006] [--mixing 0.12]

TRUTH is a folder of `refield simulate` with its transport.rfield; its held-out lights and photographs are the test. The sets
`natural` and `designed` are those of `refield acquire lights --starter`; --set adds the light maps (*.exr) of a folder. The
photographs of each pattern are exact images, made by `refield relight`, with shot noise (--noise at the mean level of the
natural set's photographs) and read noise of a sixth of it. --mixing makes the camera's channels mix: C = [1 m m/6, 2m/3 1 5m/4,
m/12 m 1].

Writes patterns.csv: set, noise, mode, photographs and for each kind of held-out light the relative RMSE of the median pixel and
of the whole picture, and the median ratio of predicted to true error. Needs numpy and the Python module of OpenImageIO.
"""
import argparse
import csv
import json
import pathlib
import re
import shutil
import subprocess
import tempfile

import numpy
import OpenImageIO as oiio


def read_image(path):
    return oiio.ImageBuf(str(path)).get_pixels(oiio.FLOAT)


def write_image(path, pixels):
    height, width, channels = pixels.shape
    buffer = oiio.ImageBuf(oiio.ImageSpec(width, height, channels, oiio.FLOAT))
    buffer.set_pixels(oiio.ROI(), numpy.ascontiguousarray(pixels, numpy.float32))
    buffer.write(str(path))


class Study:
    def __init__(self, arguments):
        self.arguments = arguments
        self.manifest = (arguments.truth / "session.toml").read_text().split("[[frame]]")
        self.arguments.output.mkdir(parents=True, exist_ok=True)

    def refield(self, *words):
        command = [self.arguments.program, "--quiet", *map(str, words)]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout

    def lights(self, name):
        """The light maps of a set; the program's own are made for the session's light domain."""
        given = dict(pair.split("=", 1) for pair in self.arguments.set)
        folder = pathlib.Path(given.get(name, self.arguments.output / "lights" / name))
        if name not in given and not folder.exists():
            size = [re.search(rf"\[light\][^[]*?{key} = (\d+)", self.manifest[0]).group(1) for key in ("width", "height")]
            count = max(self.arguments.photographs) * 6 // 5 + 1
            self.refield("acquire", "lights", "--starter", "--kind", name, "--count", max(12, count), "--size", "x".join(size),
                         "-o", folder)
        return sorted(path for path in folder.glob("*.exr") if not path.name.startswith("test_"))

    def photographs(self, name):
        """Exact images under the lights of a set."""
        folder = self.arguments.output / "exact" / name
        if not folder.exists():
            lights = self.lights(name)
            self.refield("relight", self.arguments.truth / "transport.rfield", "--light", *lights, "-o", folder)
        return folder

    def level(self):
        if not hasattr(self, "level_"):
            folder = self.photographs("natural")
            self.level_ = numpy.mean([read_image(path).mean() for path in sorted(folder.glob("*.exr"))[:60]])
        return self.level_

    def write_session(self, name, count, noise, folder):
        level, m = self.level(), self.arguments.mixing
        colour = numpy.array([[1, m, m / 6], [m * 2 / 3, 1, m * 5 / 4], [m / 12, m, 1]])
        for part in ("illumination", "observed"):
            (folder / part).mkdir(parents=True)
        text = self.manifest[0]
        exact = self.photographs(name)

        def photograph(source, target, sigma):
            image = read_image(source) @ colour.T
            variance = sigma**2 * level * numpy.maximum(image, 0) + (sigma * level / 6) ** 2
            random = numpy.random.default_rng([self.arguments.seed, *target.name.encode()])
            write_image(target, image + numpy.sqrt(variance) * random.standard_normal(image.shape))

        for light in self.lights(name)[:count]:
            shutil.copy(light, folder / "illumination")
            photograph(exact / light.name, folder / "observed" / light.name, noise)
            text += (f"[[frame]]\nillumination = 'illumination/{light.name}'\nkind = '{name}'\nname = '{light.stem}'\n"
                     f"observed = 'observed/{light.name}'\nrole = 'train'\n\n")
        for frame in self.manifest[1:]:
            if "role = 'test'" in frame:
                text += "[[frame]]" + frame
                file = re.search(r"illumination = 'illumination/(.*)'", frame).group(1)
                shutil.copy(self.arguments.truth / "illumination" / file, folder / "illumination")
                photograph(self.arguments.truth / "observed" / file, folder / "observed" / file, 0.0)
        (folder / "session.toml").write_text(text)

    def measure(self, name, count, noise, mode):
        with tempfile.TemporaryDirectory(dir=self.arguments.output) as temporary:
            session, field = pathlib.Path(temporary) / "session", pathlib.Path(temporary) / "scene.rfield"
            self.write_session(name, count, noise, session)
            self.refield("estimate", session, "--mode", mode, "-o", field)
            held_out = json.loads(self.refield("--json", "compare", field, session, "--noise-scale", 0))["held_out"]
            if self.arguments.mixing:
                print(name, count, "rig found:", json.loads(pathlib.Path(f"{field}.log.json").read_text()).get("rig"), flush=True)
        row = {"set": name, "noise": noise, "mode": mode, "photographs": count}
        for kind in ("natural", "bar", "square", "coloured"):
            if kind in held_out:
                row[kind] = round(held_out[kind]["median"], 5)
                row[kind + "_whole"] = round(held_out[kind]["relative_rmse"], 5)
                row[kind + "_predicted"] = round(held_out[kind].get("predicted_error", {}).get("median_ratio", float("nan")), 3)
        return row

    def run(self):
        names = list(dict.fromkeys(["natural", "designed", *(pair.split("=", 1)[0] for pair in self.arguments.set)]))
        rows = []
        for noise in self.arguments.noise:
            for count in self.arguments.photographs:
                for name in names:
                    if len(self.lights(name)) < count:
                        continue
                    rows.append(self.measure(name, count, noise, self.arguments.mode))
                    print(rows[-1], flush=True)
                    with open(self.arguments.output / "patterns.csv", "w", newline="", encoding="utf-8") as file:
                        table = csv.DictWriter(file, rows[0].keys())
                        table.writeheader()
                        table.writerows(rows)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("truth", type=pathlib.Path)
    parser.add_argument("-o", "--output", type=pathlib.Path, required=True)
    parser.add_argument("--program", default="build/release/cli/refield")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=FOLDER")
    parser.add_argument("--photographs", type=int, nargs="+", default=[10, 20, 30, 60, 90, 120, 180])
    parser.add_argument("--noise", type=float, nargs="+", default=[0.006])
    parser.add_argument("--mode", default="refined")
    parser.add_argument("--mixing", type=float, default=0.0)
    parser.add_argument("--seed", type=int, default=1)
    Study(parser.parse_args()).run()


if __name__ == "__main__":
    main()
