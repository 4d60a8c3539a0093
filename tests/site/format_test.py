#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The Python program in docs/reference/reflectance-field-format.md, and the one in docs/examples, relight as
`refield relight` does: a field of natural light with hats, and one of a light stage.

usage: tests/site/format_test.py PROGRAM
"""
import pathlib
import re
import sys
import tempfile

import numpy as np

from guide_test import Reader, root

sys.path.insert(0, str(root / "docs/examples"))
import relight_with_h5py  # noqa: E402

TOLERANCE = 1e-5  # of the brightest sample: sums in float there, in double here


def write_pfm(path, image):
    height, width, _ = image.shape
    path.write_bytes(b"PF\n%d %d\n-1\n" % (width, height) + image[::-1].astype("<f4").tobytes())


def main():
    text = (root / "docs/reference/reflectance-field-format.md").read_text(encoding="utf-8")
    document = {}
    exec(re.search(r"```python\n(.*?)```", text, flags=re.S)[1], document)
    failures = 0
    with tempfile.TemporaryDirectory() as work:
        reader = Reader(pathlib.Path(sys.argv[1]).resolve(), pathlib.Path(work))
        folder = pathlib.Path(work) / "fields"
        folder.mkdir()
        reader.prepare("import.md", "", folder)
        reader.run("refield acquire import dome --light-sources dome/dome.lp -o dome-session && "
                   "refield estimate dome-session -o light-stage.rfield", folder)
        reader.run("cp ../base/scene.rfield natural.rfield", folder)
        read_exr, _ = relight_with_h5py.exr_library()
        random = np.random.default_rng(1)
        for name in ("natural", "light-stage"):
            field = folder / f"{name}.rfield"
            with relight_with_h5py.h5py.File(field) as file:
                height, width = int(file.attrs["light_height"]), int(file.attrs["light_width"])
                assert int(file.attrs["hat_rows"]) > 0 or name != "natural", "the field has no hats"
                assert ("basis/observed_light" in file) == (name == "light-stage"), f"{name}: the light that was observed"
            light = random.random((height, width, 3)).astype(np.float32) ** 4
            write_pfm(folder / "light.pfm", light)
            reader.run(f"refield relight {name}.rfield --light light.pfm -o out.exr", folder)
            expected = read_exr(str(folder / "out.exr"))
            assert expected.max() > 0, "the picture is black"
            programs = [("the format's page", document["relight"]), ("relight_with_h5py.py", relight_with_h5py.relight)]
            if name == "light-stage":
                programs = programs[1:]  # the page's program does not interpolate between light sources
            for what, relight in programs:
                error = abs(relight(field, light) - expected).max() / expected.max()
                print(f"{name}, {what}: largest difference {error:.1e} of the brightest sample")
                failures += error > TOLERANCE
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
