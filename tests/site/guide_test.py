#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs the commands of README.md and docs/guide as they are written, page by page, each page in a folder of its own.

usage: tests/site/guide_test.py PROGRAM [PAGE...]

What a reader has before a page begins (a session, a field, photographs, maps) is made first, by the program from
scenes of few pixels, under the names that the page uses. A command that cannot run here names the test that runs it.
"""
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import time

root = pathlib.Path(__file__).resolve().parents[2]

# Commands that are not run, by their beginning, and why. Every other one must succeed.
NOT_RUN = {
    "./dev": "builds and tests the project",
    "apt install": "tests/package/install.sh installs the packages",
    "cmake --install": "library.Installed",
    "refield view": "needs a window: ViewField.*, ViewScene.*",
    "refield acquire show": "needs a screen: ManualCapture.PatternsAreShownOnAScreenWithTheirTimes",
    "refield acquire import shots --light patterns": "ManualCapture.ImportedByOrderTheCamerasCurveIsEstimated",
    "refield acquire import shots --ambient-first": "ManualCapture.*, MatchSeries.*",
    "refield acquire import hdr": "ManualCapture.AMissedPhotographIsPairedByTime, MatchSeries.*",
    "refield acquire import roof": "needs photographs of a mirror ball: ProbeFiles.*",
    "refield acquire import city": "MatchSeries.*",
    "refield acquire import stage --light-sources ball": "needs photographs of a mirror ball: ChromeBallImport.*",
    "refield acquire colour": "needs a photograph of a chart: ColourVerb.*",
    "refield acquire geometry": "needs photographs of a ball: MonitorByBall.*",
    "refield acquire probe": "ProbeFiles.TheCommandMakesMapsOfTwoSides",
    "refield acquire calibrate rig.toml": "needs a camera: tests/devices/closed_loop.sh",
    "refield acquire guide mug": "needs a terminal: cli.GuidedCapture",
    "refield acquire run rig.toml": "needs a camera: tests/devices/closed_loop.sh",
    "refield acquire run ball.toml": "needs a camera: tests/devices/closed_loop.sh",
    "refield acquire import BRACKETS": "ManualCapture.*, bracket_response_test.cpp",
    "refield submit": "needs a Slurm cluster: tests/cluster/cluster_test.py (./dev check cluster)",
    "refield-studies": "Studies.*",
    "refield compare a.rfield SESSION": "a summary of the options",
    "refield estimate more --refine": "needs more photographs of the same scene: Refine.*",
    "oiiotool --create 128x96": "a light map of the demo's size",
}
FIRST_WORDS = ("refield", "python3", "oiiotool", "cmake", "apt", "exec", "./dev", "tests/")


def commands_of(text):
    """The commands in the indented and fenced blocks of a page, continued lines joined, comments and prompts removed."""
    lines = re.sub(r"\\\n\s*", "", text).split("\n")
    in_shell = False
    for line in lines:
        if line.startswith("```"):
            in_shell = line == "```sh"
            continue
        if not (line.startswith("    ") or in_shell):
            continue
        command = re.sub(r"^\$ ", "", line.strip())
        if command.startswith(FIRST_WORDS) and not re.match(r"refield(-\w+)?:|refield$", command):
            yield re.sub(r"\s+# .*", "", command)


class Reader:
    """What readers of the guide have."""

    def __init__(self, program, work):
        self.program, self.work = program, work
        self.base = work / "base"
        self.base.mkdir()
        scenes = self.base / "datasets_synthetic"
        shutil.copytree(root / "datasets_synthetic", scenes)
        for file in scenes.rglob("*.toml"):
            file.write_text(self.reduced(file.read_text()))
        recipe = scenes / "tabletop/recipe.toml"
        self.run("refield simulate datasets_synthetic/tabletop/recipe.toml -o truth", self.base)
        self.run("refield acquire run datasets_synthetic/tabletop/recipe.toml --truth truth --keep-raw -o session", self.base)
        self.run("refield estimate session -o scene.rfield", self.base)
        shutil.copy(recipe, self.base / "recipe.toml")
        # Maps of 32×16 texels, brighter above.
        for name, top in (("sky", "1,2,4"), ("dawn", "4,2,1"), ("noon", "4,4,4"), ("dusk", "2,1,3"), ("studio", "1,1,1")):
            suffix = "hdr" if name == "studio" else "exr"
            self.run(f"oiiotool --pattern fill:top={top}:bottom=0.2,0.2,0.2 32x16 3 -d float -o {name}.{suffix}", self.base)

    @staticmethod
    def reduced(text):
        """A scene of few pixels, vertices and lights."""
        text = re.sub(r"^resolution = (\d+)", lambda m: f"resolution = {min(int(m[1]), 6)}", text, flags=re.M)
        text = re.sub(r"^(width|height) = (\d+)", lambda m: f"{m[1]} = {max(6, int(m[2]) // 8)}", text, flags=re.M)
        for name, count in (("train", 16), ("natural", 2), ("bars", 1), ("squares", 1)):
            text = re.sub(rf"^{name} = \d+", f"{name} = {count}", text, flags=re.M)
        return re.sub(r"^count = 4", "count = 2", text, flags=re.M)

    def run(self, command, folder, **more):
        environment = {**os.environ, "PATH": f"{self.program.parent}:{pathlib.Path(sys.executable).parent}:{os.environ['PATH']}", **more}
        done = subprocess.run(["bash", "-c", command], cwd=folder, env=environment, capture_output=True, text=True)
        if done.returncode != 0:
            raise RuntimeError(f"{command}\n  ends with status {done.returncode}: {(done.stderr or done.stdout)[-600:]}")

    def prepare(self, page, part, folder):
        """The inputs of one page, or of a part of it."""
        def take(*names):
            for name in names:
                source, _, target = name.partition(">")
                copy = shutil.copytree if (self.base / source).is_dir() else shutil.copy
                copy(self.base / source, folder / (target or source))

        def pairs(light, observed):
            for source, target in (("illumination", light), ("observed", observed)):
                (folder / target).mkdir()
                for file in (self.base / "truth" / source).glob("train_*.exr"):
                    shutil.copy(file, folder / target / file.name.removeprefix("train_"))

        def photographs():
            return sorted((self.base / "truth/observed").glob("train_*.exr"))

        one_map = "truth/illumination/train_000.exr>"
        if page == "README.md":
            take("datasets_synthetic", "sky.exr", one_map + "new.exr")
            pairs("light", "observed")
        elif page == "capture.md":
            take("datasets_synthetic")
            if "Without hardware" not in part:
                # Light maps as those of `acquire lights --starter`.
                self.run("refield simulate datasets_synthetic/tabletop/recipe.toml -o session --light-size 160x90", folder)
        elif page == "cookbook.md":
            take("scene.rfield", "session", "sky.exr", one_map + "spot.exr")
            (folder / "maps").mkdir()
            take("dawn.exr>maps/dawn.exr", "noon.exr>maps/noon.exr")
            self.run("oiiotool session/observed/train_000.exr --mulc 0 --addc 1 --ch R -d uint8 -o mask.png", folder)
        elif page == "tutorial.md":
            take("datasets_synthetic", "sky.exr")
        elif page == "dynamic-scenes.md":
            take("datasets_synthetic", "datasets_synthetic/dynamic/room.toml>scene.toml")
        elif page == "hdr.md":
            take("recipe.toml", "truth", "session>session")
            photograph = photographs()[0]
            for i, seconds in enumerate((0.0167, 0.0668, 0.2672)):  # OpenImageIO 2.4 writes 1/4 s as infinite
                for name, kind in ((f"IMG_{i}.jpg", "uint8"), (f"{'abc'[i]}.tif", "uint16")):
                    curve = "--powc 0.4545" if kind == "uint8" else ""
                    self.run(f"oiiotool {photograph} --ch R,G,B --mulc {5 * seconds} --clamp:min=0:max=1 {curve} -d {kind} "
                             f"--attrib ExposureTime {seconds} -o {name}", folder)
        elif page == "image-pairs.md":
            take(one_map + "new.exr")
            pairs("light", "observed")
            shutil.copy(root / "docs/examples/relight_with_h5py.py", folder)
        elif page == "import.md":
            take("session/calibration.toml>calibration.toml", "sky.exr")
            for name in ("shots", "lights", "dome", "cat", "near", "card"):
                (folder / name).mkdir()
            lines = []
            for i, photograph in enumerate(photographs()):
                x, y = 0.5 - i % 4 / 3, 0.5 - i // 4 / 3
                lines.append((f"p{i:02}", f"{x:.3f} {y:.3f} {(1 - x * x - y * y) ** 0.5:.3f}"))
            levels = " ".join(f"{photograph} --ch R,G,B --mulc 0.5 --clamp:min=0:max=1 -d uint16 -o dome/p{i:02}.tif -o cat/p{i:02}.tif "
                              f"-o near/p{i:02}.tif --mulc 0 --addc 0.5 -d uint16 -o card/p{i:02}.tif"
                              for i, photograph in enumerate(photographs()))
            self.run(f"oiiotool {levels}", folder)
            (folder / "dome/dome.lp").write_text(f"{len(lines)}\n" + "".join(f"{name}.tif {xyz}\n" for name, xyz in lines))
            (folder / "near.csv").write_text("file,x,y,z\n" + "".join(f"{name}.tif,{xyz.replace(' ', ',')}\n" for name, xyz in lines))
            (folder / "cat/light_directions.txt").write_text("".join(f"{xyz}\n" for _, xyz in lines))
            (folder / "cat/filenames.txt").write_text("".join(f"{name}.tif\n" for name, _ in lines))
            self.run("oiiotool cat/p00.tif --mulc 0 --addc 1 --ch 0 -d uint8 -o cat/mask.png", folder)
            # The virtual camera's own exposures, as another program would have written them.
            plan = (self.base / "session/plan.toml").read_text()
            times = re.findall(r"[\d.e-]+", re.search(r"^seconds = \[(.*?)\]", plan, flags=re.M | re.S)[1])
            written = []
            for raw in sorted((self.base / "session/raw").glob("*_e*.png")):
                light, exposure = re.match(r"(\w+?)_e(\d)(?:_r0)?\.png", raw.name).groups() if "_r" not in raw.name or "_r0" in raw.name else ("test", 0)
                if light.startswith(("test", "primary", "reference")):  # not of the recipe's lights
                    continue
                name = "dark" if light == "ambient" else light
                written.append(f"{raw} --attrib ExposureTime {times[int(exposure)]} -o shots/{name}_e{exposure}.tif")
                if light != "ambient":
                    shutil.copy(self.base / f"truth/illumination/{light}.exr", folder / "lights")
            self.run("oiiotool " + " ".join(written), folder)
        elif page == "jobs.md":
            take("recipe.toml")
            text = (folder / "recipe.toml").read_text()
            (folder / "recipe.toml").write_text(re.sub(r"^height = 15", "height = 120", text, count=1, flags=re.M))
            self.run("refield simulate recipe.toml -o session", folder)
            self.run("for i in 1 2 4 5 6 7 8; do refield estimate session --rows $i/8 -o part$i.rfield || exit; done", folder)
        elif page == "light-probe.md":
            take("session")  # as 'acquire import --pair-by time' would have written it
        elif page == "meshes.md":
            take("datasets_synthetic", "sky.exr", "datasets_synthetic/prt/rabbit.toml>rabbit.toml", "datasets_synthetic/prt/glossy.toml>glossy.toml")
            corners = "".join(f"{i & 1} {i >> 1 & 1} {i >> 2}\n" for i in range(8))
            faces = "".join(f"4 {f}\n" for f in ("0 2 3 1", "4 5 7 6", "0 1 5 4", "2 6 7 3", "0 4 6 2", "1 3 7 5"))
            (folder / "bunny.ply").write_text(
                "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\nelement face 6\n"
                f"property list uchar int vertex_indices\nend_header\n{corners}{faces}")
            scene_files = (root / "docs/reference/scene-files.md").read_text()
            (folder / "lights.toml").write_text(re.search(r"## Area lights.*?```toml\n(.*?)```", scene_files, flags=re.S)[1])
        elif page == "relighting.md":
            take("scene.rfield", "sky.exr", "dawn.exr", "noon.exr", "dusk.exr", one_map + "map.exr", "datasets_synthetic")
            (folder / "maps").mkdir()
            take("dawn.exr>maps/dawn.exr", "noon.exr>maps/noon.exr")
            self.run("refield precompute datasets_synthetic/prt/small.toml --resolution 64 -o rabbit.rfield", folder)
        elif page == "report.md":
            take("scene.rfield>a.rfield")
            pairs("light", "observed")
        else:
            take("scene.rfield", "sky.exr", "studio.hdr")


def main():
    program = pathlib.Path(sys.argv[1]).resolve()
    pages = sys.argv[2:] or ["README.md"] + sorted(path.name for path in (root / "docs/guide").glob("*.md"))
    failures, ran, unused = [], 0, set(NOT_RUN)
    with tempfile.TemporaryDirectory() as work:
        reader = Reader(program, pathlib.Path(work))
        for page in pages:
            begun = time.monotonic()
            document = root / page if page == "README.md" else root / "docs/guide" / page
            text = document.read_text(encoding="utf-8")
            count = 0
            # The sections of this page are alternatives.
            for number, part in enumerate(text.split("\n## ") if page == "capture.md" else [text]):
                commands = list(dict.fromkeys(commands_of(part)))
                reasons = {command: [start for start in NOT_RUN if command.startswith(start)] for command in commands}
                unused -= {start for starts in reasons.values() for start in starts}
                if all(reasons.values()):
                    continue
                folder = pathlib.Path(work) / f"{page}-{number}"
                folder.mkdir()
                reader.prepare(page, part, folder)
                for command in (command for command in commands if not reasons[command]):
                    count += 1
                    try:
                        reader.run(command, folder, SESSION="session", SLURM_ARRAY_TASK_ID="1")
                    except RuntimeError as error:
                        failures.append(f"{page}: {error}")
            ran += count
            print(f"{page}: {count} commands, {time.monotonic() - begun:.1f} s")
    if len(sys.argv) == 2:  # all pages
        failures += [f"no page has a command that begins with: {start}" for start in sorted(unused)]
        if ran < 50:
            failures.append(f"only {ran} commands were found")
    print("\n".join(failures))
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
