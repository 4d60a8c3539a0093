#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Compares sets of light patterns: error of the field against the number of photographs.

    bench/studies/patterns.py SCENE -o OUT [--set NAME=FOLDER] [--photographs 30 90 180] [--noise 0.006] [--mixing 0.12]

SCENE is tabletop, diffuse (the tabletop with matt materials), mirrors (most objects chrome, gold and glass) or foliage (300
small leaves, some translucent), which is traced at --size first, or a folder of `refield simulate` with its transport.rfield.
Its held-out lights and photographs are the test. The sets `natural` and `designed` are those of `refield acquire lights
--starter`; --set adds the light maps (*.exr) of a folder. The photographs of each pattern are exact images, made by `refield
relight`, with shot noise (--noise at the mean level of the natural set's photographs) and read noise of a sixth of it. --mixing
makes the camera's channels mix: C = [1 m m/6, 2m/3 1 5m/4, m/12 m 1]. With --sigma the photographs state their noise, as those
of a capture do.

Writes patterns.csv: scene, set, noise, mode, photographs and for each kind of held-out light the relative RMSE of the median
pixel and of the whole picture, and the median ratio of predicted to true error; `draw.py OUT` draws it. Needs numpy and the
Python module of OpenImageIO.
"""
import argparse
import csv
import json
import pathlib
import re
import shutil
import subprocess
import tempfile
import tomllib

import numpy
import OpenImageIO as oiio

RECIPE = pathlib.Path(__file__).resolve().parents[2] / "datasets_synthetic/tabletop/recipe.toml"
SCENES = ("tabletop", "diffuse", "mirrors", "foliage")
MATT = {"diffuse", "translucent"}


def read_image(path):
    return oiio.ImageBuf(str(path)).get_pixels(oiio.FLOAT)


def write_image(path, pixels, sigma=None):
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], 3, oiio.FLOAT)
    if sigma is not None:
        pixels = numpy.concatenate([pixels, sigma], axis=2)
        spec.nchannels, spec.channelnames = 6, ("R", "G", "B", "sigma.R", "sigma.G", "sigma.B")
    buffer = oiio.ImageBuf(spec)
    buffer.set_pixels(oiio.ROI(), numpy.ascontiguousarray(pixels, numpy.float32))
    buffer.write(str(path))


def leaves(count=300):
    """Small tilted plates, as in a bush."""
    random = numpy.random.default_rng(7)
    for k in range(count):
        x, y, z = random.uniform([-0.32, 0.01, -0.25], [0.28, 0.27, 0.25])
        yield {"name": f"leaf {k}", "shape": "box", "material": ("lime", "wax", "paint", "porcelain")[k % 4],
               "position": [round(float(v), 4) for v in (x, y, z)],
               "stretch": [round(float(v), 4) for v in (random.uniform(0.02, 0.05), 0.001, random.uniform(0.015, 0.03))],
               "rotation": [round(float(v), 1) for v in random.uniform(-180, 180, 3)]}


def recipe_of(scene):
    """The tabletop's recipe with other materials or objects."""
    recipe = tomllib.loads(RECIPE.read_text())
    text = f'base = "{RECIPE}"\n'
    if scene == "diffuse":
        for material in recipe["material"]:
            colour = material.get("diffuse") or material.get("specular") or material["transmittance"]
            kept = {key: material[key] for key in ("texture", "second_colour", "scale_m") if key in material}
            if material["kind"] not in MATT:
                colour = [round(0.7 * c, 3) for c in colour]
            material_of = {"name": material["name"], "kind": "diffuse", "diffuse": colour, **kept}
            text += "[[material]]\n" + "".join(f"{key} = {json.dumps(value)}\n" for key, value in material_of.items())
    elif scene in ("mirrors", "foliage"):
        objects = recipe["object"]
        if scene == "mirrors":
            movable = [thing for thing in objects if thing["shape"] != "plane" and thing["material"] != "cloth"]
            for k, thing in enumerate(movable):
                thing["material"] = ("chrome", "gold", "glass")[k % 3]
        else:
            objects = [thing for thing in objects if thing["shape"] == "plane"] + list(leaves())
        for thing in objects:
            text += "[[object]]\n" + "".join(f"{key} = {json.dumps(value)}\n" for key, value in thing.items())
    return text


class Study:
    def __init__(self, arguments):
        self.arguments = arguments
        self.arguments.output.mkdir(parents=True, exist_ok=True)
        self.scene = str(arguments.scene)
        if self.scene in SCENES:
            arguments.truth = arguments.output / f"truth-{self.scene}"
            recipe = arguments.output / f"{self.scene}.toml"
            recipe.write_text(recipe_of(self.scene))
            if not (arguments.truth / "session.toml").exists():
                self.refield("simulate", recipe, "--size", arguments.size, "--train", 1, "-o", arguments.truth)
        else:
            arguments.truth = pathlib.Path(self.scene)
        self.manifest = (arguments.truth / "session.toml").read_text().split("[[frame]]")

    def refield(self, *words):
        command = [self.arguments.program, "--quiet", *map(str, words)]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout

    def lights(self, name):
        """The light maps of a set; the program's own are made for the session's light domain."""
        given = dict(pair.split("=", 1) for pair in self.arguments.set)
        folder = pathlib.Path(given.get(name, self.arguments.output / "lights" / name))
        if name not in given and not folder.exists():
            size = [re.search(rf"\[light\][^[]*?{key} = (\d+)", self.manifest[0]).group(1) for key in ("width", "height")]
            count = 240 * 6 // 5 + 1
            self.refield("acquire", "lights", "--starter", "--kind", name, "--patterns", max(12, count), "--light-size", "x".join(size),
                         "-o", folder)
        return sorted(path for path in folder.glob("*.exr") if re.fullmatch(r"train_\d+", path.stem))

    def photographs(self, name):
        """Exact images under the lights of a set."""
        folder = self.arguments.output / f"exact-{pathlib.Path(self.scene).name}" / name
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
            sigma = numpy.sqrt(variance)
            write_image(target, image + sigma * random.standard_normal(image.shape), sigma if self.arguments.sigma else None)

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
        row = {"scene": pathlib.Path(self.scene).name, "set": name, "noise": noise, "mode": mode, "photographs": count}
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
                    path = self.arguments.output / "patterns.csv"
                    with open(path, "a", newline="", encoding="utf-8") as file:
                        table = csv.DictWriter(file, rows[0].keys())
                        if path.stat().st_size == 0:
                            table.writeheader()
                        table.writerow(rows[-1])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", metavar="SCENE")
    parser.add_argument("--size", default="240x180", metavar="WIDTHxHEIGHT")
    parser.add_argument("-o", "--output", type=pathlib.Path, required=True)
    parser.add_argument("--program", default="build/release/cli/refield")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=FOLDER")
    parser.add_argument("--photographs", type=int, nargs="+", default=[10, 20, 30, 60, 90, 120, 180])
    parser.add_argument("--noise", type=float, nargs="+", default=[0.006])
    parser.add_argument("--mode", default="refined")
    parser.add_argument("--mixing", type=float, default=0.0)
    parser.add_argument("--sigma", action="store_true")
    parser.add_argument("--seed", type=int, default=1)
    Study(parser.parse_args()).run()


if __name__ == "__main__":
    main()
