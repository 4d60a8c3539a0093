# SPDX-License-Identifier: Apache-2.0
"""Entry points of the module, each with small inputs of its own; prints the digest of what one of them gives.

    order_steps.py FOLDER STEP
"""
import hashlib
import pathlib
import shutil
import sys
import tempfile

import numpy as np

import refield

ROOT = pathlib.Path(__file__).resolve().parents[2]
MESH = """
[[object]]
shape = "sphere"
resolution = 12
on_ground = true
[[object]]
shape = "plane"
size = 3.0
resolution = 12
"""


def digest(*parts):
    return hashlib.sha256(b"".join(part if isinstance(part, bytes) else np.ascontiguousarray(part).tobytes()
                                   for part in parts)).hexdigest()


def saved(field, folder):
    path = pathlib.Path(folder) / "field.rfield"
    field.save(path)
    return path.read_bytes()


def simulate(inputs, folder):
    refield.simulate(ROOT / "datasets_synthetic/tabletop/recipe.toml", folder / "session", size=(16, 12),
                     light_size=(12, 8), train=6, test=(1, 0, 0), quality=1)
    return digest(*(path.read_bytes() for path in sorted((folder / "session").rglob("*.exr"))))


def precompute(inputs, folder):
    return digest(saved(refield.precompute(inputs / "scene.toml", "sh", sh_order=3, directions=64), folder))


def precompute_clusters(inputs, folder):
    return digest(saved(refield.precompute(inputs / "scene.toml", "clusters", resolution=8), folder))


def estimate(inputs, folder):
    return digest(saved(refield.estimate(np.load(inputs / "light.npy"), np.load(inputs / "observed.npy")), folder))


def estimate_dark(inputs, folder):
    """Half of the pixels are so dark that their squares are denormal."""
    observed = np.load(inputs / "observed.npy")
    observed[:, ::2] *= np.float32(3e-20)
    return digest(saved(refield.estimate(np.load(inputs / "light.npy"), observed), folder))


def relight(inputs, folder):
    field = refield.Field.load(inputs / "field.rfield")
    light = np.load(inputs / "light.npy")
    return digest(field.relight(light[0]), field.relight(light[1] * np.float32(1e-38)))


def pack(inputs, folder):
    return digest(saved(refield.Field.load(inputs / "field.rfield").pack(), folder))


def view(inputs, folder):
    light = np.load(inputs / "light.npy")
    frames = refield.Field.load(inputs / "field.rfield").relighter()
    first = frames.relight(light[0]).copy()
    changed = light[0].copy()
    changed[1:3, 2:5] *= np.float32(1e-38)
    return digest(first, frames.update(changed, (2, 1, 5, 3)))


STEPS = {step.__name__: step for step in
         (simulate, precompute, precompute_clusters, estimate, estimate_dark, relight, pack, view)}


def run(step, inputs):
    folder = pathlib.Path(tempfile.mkdtemp())
    try:
        return STEPS[step](pathlib.Path(inputs), folder)
    finally:
        shutil.rmtree(folder)


def make_inputs(inputs):
    random = np.random.default_rng(7)
    light = random.random((24, 6, 8, 3), np.float32)
    transport = random.random((6 * 8, 12 * 16), np.float32) ** 8
    observed = np.einsum("nlc,lp->npc", light.reshape(24, -1, 3), transport).reshape(24, 12, 16, 3)
    np.save(inputs / "light.npy", light)
    np.save(inputs / "observed.npy", observed.astype(np.float32))
    (inputs / "scene.toml").write_text(MESH)
    refield.estimate(light, observed.astype(np.float32)).save(inputs / "field.rfield")


if __name__ == "__main__":
    print(run(sys.argv[2], sys.argv[1]))
