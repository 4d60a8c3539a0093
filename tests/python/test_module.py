# SPDX-License-Identifier: Apache-2.0
"""What the module computes, against the command line, the definition of a field, and itself."""
import json
import logging
import pickle
import subprocess

import numpy as np
import pytest

import refield
from conftest import RECIPE, ROOT


def run(program, *arguments):
    return subprocess.run([program, "--quiet", *map(str, arguments)], check=True, capture_output=True, text=True).stdout


def random_lights(field, count):
    return np.random.default_rng(5).random((count, *field.light_shape), dtype=np.float32)


def same_content(a, b):
    """All but how the files are named."""
    assert a.shape == b.shape and a.light_shape == b.light_shape
    light = random_lights(a, 1)[0]
    assert np.array_equal(a.relight(light), b.relight(light))
    for name in ("predicted_error", "noise", "training_error"):
        assert np.array_equal(getattr(a, name), getattr(b, name)), name
    for x, y in ((0, 0), (11, 7), (23, 17)):
        assert a.kernels(x, y) == b.kernels(x, y)
        assert np.array_equal(a.transport(x, y), b.transport(x, y))


def test_estimate_equals_command_line_bit_for_bit(program, session, field, tmp_path):
    run(program, "estimate", session.folder, "-o", tmp_path / "cli.rfield")
    by_command = refield.Field.load(tmp_path / "cli.rfield")
    same_content(field, by_command)
    of_session = refield.estimate(session)
    of_session.save(tmp_path / "python.rfield")
    assert (tmp_path / "python.rfield").read_bytes() == (tmp_path / "cli.rfield").read_bytes()
    of_paths = refield.estimate([frame.light_path for frame in session.train], [frame.observed_path for frame in session.train],
                                threads=1)
    same_content(of_paths, by_command)


@pytest.mark.parametrize("mode", ["paper", "fast"])
def test_modes_and_kernel_cap(program, session, tmp_path, mode):
    run(program, "estimate", session.folder, "-o", tmp_path / "cli.rfield", "--mode", mode, "--kernels", 5)
    refield.estimate(session, mode=mode, max_kernels=5).save(tmp_path / "python.rfield")
    assert (tmp_path / "python.rfield").read_bytes() == (tmp_path / "cli.rfield").read_bytes()


def test_sigma_and_mask(arrays):
    light, observed = arrays
    sigma = np.full_like(observed, 1e-3)
    sigma[3] = np.inf  # as if it was never taken
    mask = np.zeros(observed.shape[1:3], dtype=bool)
    mask[4:9, 5:15] = True
    field = refield.estimate(light, observed, sigma, mask)
    assert field.kernels(0, 0) == [] and field.kernels(6, 5)
    wrong = observed.copy()
    wrong[3] = 7.0
    assert np.array_equal(refield.estimate(light, wrong, sigma, mask).relight(light[0]), field.relight(light[0]))


def test_types_and_strides(arrays, field):
    light, observed = arrays
    new_light = random_lights(field, 1)[0]
    expected = field.relight(new_light)
    channels_first = np.ascontiguousarray(observed.transpose(0, 3, 1, 2))
    same = refield.estimate(np.asfortranarray(light), channels_first.transpose(0, 2, 3, 1))
    assert np.array_equal(same.relight(new_light), expected)
    half = refield.estimate(light.astype(np.float16), observed.astype(np.float16))
    assert np.allclose(half.relight(new_light), expected, rtol=0.2, atol=0.05 * expected.max())
    # 65535 stands for 1, so that the field of scaled photographs is the scaled field.
    scale = observed.max()
    whole = refield.estimate(light, np.round(observed / scale * 65535).astype(np.uint16))
    assert np.allclose(whole.relight(new_light) * scale, expected, rtol=0.2, atol=0.05 * expected.max())
    with pytest.raises(refield.InputError, match="int64"):
        refield.estimate(light, observed.astype(np.int64))


def test_field_is_linear_and_its_parts_agree(field):
    lights = random_lights(field, 3)
    images = field.relight(lights)
    assert images.shape == (3, *field.shape) and images.dtype == np.float32
    assert np.allclose(field.relight(lights[0] + 2 * lights[1]), images[0] + 2 * images[1], rtol=1e-4, atol=1e-6)
    for x, y in ((2, 3), (20, 10)):
        row = field.transport(x, y)
        assert row.shape == field.light_shape
        assert np.allclose((row * lights[2]).sum(axis=(0, 1), dtype=np.float64), images[2, y, x], rtol=1e-4)
        assert np.allclose(field.lit_by(5, 4)[y, x], row[4, 5], rtol=1e-4, atol=1e-7)
        kernels = field.kernels(x, y)
        assert sum(kernel.energy_share for kernel in kernels) == pytest.approx(1.0, abs=1e-5)
        assert [k.energy_share for k in kernels] == sorted((k.energy_share for k in kernels), reverse=True)


def test_batches_and_out(program, session, field, tmp_path):
    lights = random_lights(field, 14)  # enough to be laid out
    out = np.empty((14, *field.shape), dtype=np.float32)
    assert field.relight(lights, out=out) is out
    singly = np.stack([field.relight(light) for light in lights])
    assert np.abs(out - singly).max() < 1e-5 * singly.max()
    field.save(tmp_path / "f.rfield")
    (tmp_path / "lights").mkdir()
    for i, light in enumerate(lights):
        refield.write_exr(tmp_path / f"lights/{i:02}.exr", light)
    run(program, "relight", tmp_path / "f.rfield", "--light", tmp_path / "lights", "-o", tmp_path / "images")
    for i in range(14):
        assert np.array_equal(refield.read_image(tmp_path / f"images/{i:02}.exr"), out[i])
    for wrong in (out[:13], out.astype(np.float64), np.empty((18, 24, 14, 3), np.float32), out[:, :, ::-1]):
        with pytest.raises(refield.InputError, match="out:"):
            field.relight(lights, out=wrong)


def test_relighter_updates(field):
    relighter = field.relighter("fine")
    light = random_lights(field, 1)[0]
    assert np.allclose(relighter.relight(light), field.relight(light), rtol=1e-5, atol=1e-5)
    for k in range(3):
        light[2:5, 3:7] *= 0.5 + k
        image = relighter.update(light, (3, 2, 7, 5))
        assert np.allclose(image, field.relight(light), rtol=1e-4, atol=1e-5)
    with pytest.raises(refield.InputError, match="outside"):
        relighter.update(light, (3, 2, 17, 5))
    light[3, 4, 1] = np.nan
    for relight in (field.relight, relighter.relight, lambda bad: relighter.update(bad, (3, 2, 7, 5))):
        with pytest.raises(refield.InputError, match="NaN|not finite|is nan"):
            relight(light)
    with pytest.raises(refield.InputError, match="precision"):
        field.relighter("coarse")


def test_files_pickle_and_packing(program, field, tmp_path):
    light = random_lights(field, 1)[0]
    field.save(tmp_path / "full.rfield")
    for again in (refield.Field.load(tmp_path / "full.rfield"), pickle.loads(pickle.dumps(field))):
        same_content(field, again)
        assert again.provenance == field.provenance
    packed = field.pack(1e-3)
    assert packed.bits in (8, 16) and field.bits == 32
    error = np.linalg.norm(packed.relight(light) - field.relight(light)) / np.linalg.norm(field.relight(light))
    assert 0 < error < 1e-3
    same = pickle.loads(pickle.dumps(packed))
    assert same.bits == packed.bits and np.array_equal(same.relight(light), packed.relight(light))
    packed.save(tmp_path / "python.rfield")
    run(program, "pack", tmp_path / "full.rfield", "-o", tmp_path / "cli.rfield", "--error", 1e-3)
    assert (tmp_path / "python.rfield").read_bytes() == (tmp_path / "cli.rfield").read_bytes()
    assert packed.provenance["pack"]["error"] < packed.provenance["pack"]["max_error"] == 1e-3
    with pytest.raises(refield.InputError, match="already packed"):
        packed.pack()
    assert field._repr_png_().startswith(b"\x89PNG") and "24×18" in repr(field)


def test_session_and_comparison(program, session, field, tmp_path):
    assert (len(session.train), session.shape, session.light_shape) == (40, (18, 24, 3), (12, 16, 3))
    assert {frame.role for frame in session} == {"train", "test"}
    field.save(tmp_path / "f.rfield")
    by_command = json.loads(run(program, "--json", "compare", tmp_path / "f.rfield", session.folder))["held_out"]
    for errors in refield.compare(field, session):
        assert errors.relative_rmse == pytest.approx(by_command[errors.kind]["relative_rmse"], rel=1e-12)
        assert len(errors.per_image) == errors.images
    frame = session.test[0]
    alone = refield.compare(field.relight(frame.light()), frame.observed())[0]
    in_series = [image for errors in refield.compare(field, session) for image in errors.per_image if image.name == frame.name]
    assert alone.relative_rmse == pytest.approx(in_series[0].relative_rmse)
    split = refield.Session.pairs(f"{session.folder}/illumination/train_*.exr", f"{session.folder}/observed/train_*.exr").held_out(10)
    assert (len(split.train), len(split.test)) == (36, 4)
    with pytest.raises(refield.InputError, match="hold-out 1"):
        session.held_out(1)
    with pytest.raises(IndexError):
        session[99]


def test_errors_have_the_text_of_the_command_line(session, arrays, field, tmp_path):
    light, observed = arrays
    with pytest.raises(ValueError, match="39 photographs"):
        refield.estimate(light, observed[:39])
    with pytest.raises(refield.InputError, match="give images×height×width×3"):
        refield.estimate(light[0], observed)
    with pytest.raises(refield.InputError, match="give files here, too"):
        refield.estimate(["a.exr"], observed)
    with pytest.raises(refield.InputError, match="mode"):
        refield.estimate(light, observed, mode="best")
    with pytest.raises(refield.InputError, match="--kernels"):
        refield.estimate(light, observed, max_kernels=400)
    with pytest.raises(refield.InputError, match="threads"):
        refield.estimate(light, observed, threads=-1)
    with pytest.raises(refield.InputError, match="resample the map"):
        field.relight(np.zeros((5, 5, 3), np.float32))
    with pytest.raises(OSError, match="nowhere"):
        refield.Field.load(tmp_path / "nowhere.rfield")
    (tmp_path / "text.rfield").write_text("no field")
    with pytest.raises(refield.FormatError, match="text.rfield"):
        refield.Field.load(tmp_path / "text.rfield")
    bad = light.copy()
    bad[3, 2, 1, 0] = np.nan
    with pytest.raises(refield.InputError, match="light map 3"):
        refield.estimate(bad, observed)
    with pytest.raises(refield.InputError, match="not an empty folder"):
        refield.simulate(RECIPE, session.folder)
    for error in (refield.InputError, refield.FormatError, refield.DeviceError, refield.SolverError):
        assert issubclass(error, refield.Error)


def test_progress_and_notes(arrays, caplog):
    light, observed = arrays
    seen = []
    refield.estimate(light, observed, progress=lambda *stage: seen.append(stage))
    assert ("estimate", 18 * 24, 18 * 24) in seen and all(0 <= done <= total for _, done, total in seen)
    tqdm = pytest.importorskip("tqdm")
    with tqdm.tqdm(file=open("/dev/null", "w")) as bar:
        refield.estimate(light, observed, progress=bar)
        assert bar.n == bar.total > 0

    def fail(stage, done, total):
        raise RuntimeError(f"in {stage}")

    with pytest.raises(RuntimeError, match="in "):
        refield.estimate(light, observed, progress=fail)
    flickering = observed.copy()
    flickering[7] *= 0.3
    with caplog.at_level(logging.WARNING, logger="refield"):
        refield.estimate(light, flickering)
    assert any(text.startswith("7 is left out") for text in caplog.messages), caplog.messages


def test_hdr_merge(tmp_path):
    truth = np.random.default_rng(1).uniform(0.05, 8.0, (6, 7, 3)).astype(np.float32)
    seconds = [0.05, 0.2, 0.8]
    images = np.minimum(1.0, np.stack([truth * exposure for exposure in seconds])).astype(np.float32)
    radiance, sigma = refield.hdr_merge(images, seconds)
    # Beside a clipped exposure the merge takes noise into account that is not there.
    assert np.isfinite(sigma).all() and (np.abs(radiance - truth) < sigma).all() and np.median(sigma / truth) < 0.02
    paths = [tmp_path / f"{i}.exr" for i in range(3)]
    for path, image in zip(paths, images):
        refield.write_exr(path, image)
    assert np.allclose(refield.hdr_merge(paths, seconds)[0], radiance, rtol=0.02)
    with pytest.raises(refield.InputError, match="exposure"):
        refield.hdr_merge(images, seconds[:2])


def test_environment(arrays, field, tmp_path):
    sky = np.ones((16, 32, 3), np.float32)
    with pytest.raises(refield.InputError, match="monitor"):
        refield.environment(sky, field)
    light = refield.environment(sky, field, monitor="520x320@600")
    assert light.shape == field.light_shape and np.allclose(light, 1.0, rtol=1e-5)
    ahead = sky.copy()
    ahead[:, :16] = 0.0  # the left half
    turned = refield.environment(ahead, shape=(12, 16), monitor="520x320@600", yaw=-90.0)
    assert np.allclose(refield.environment(ahead, shape=(12, 16), monitor="520x320@600")[:, 0], 0.0, atol=1e-6)
    assert np.allclose(turned[:, -1], 1.0, rtol=1e-4)
    placed = refield.estimate(*arrays, mode="fast", monitor="520x320@600", predict_errors=False)
    assert placed.monitors == ["520x320@600"] and np.array_equal(refield.environment(sky, placed), light)


@pytest.mark.parametrize("method, settings", [("clusters", {"resolution": 16, "epsilon": 1e-2}), ("sh", {"order": 3, "directions": 64})])
def test_precompute(program, tmp_path, method, settings):
    scene = ROOT / "datasets_synthetic/prt/small.toml"
    field = refield.precompute(scene, method, **settings)
    options = [word for name, value in settings.items() for word in (f"--{name}", value)]
    run(program, "simulate", "prt", scene, "--method", method, *options, "-o", tmp_path / "cli.rfield")
    field.save(tmp_path / "python.rfield")
    assert (tmp_path / "python.rfield").read_bytes() == (tmp_path / "cli.rfield").read_bytes()
    light = refield.environment(np.ones((16, 32, 3), np.float32), field)
    image = field.relight(light)
    assert image.shape == field.shape and image.max() > 0.1


def test_dynamic_scene(program, tmp_path, monkeypatch):
    monkeypatch.setenv("REFIELD_CACHE", "off")
    text = (ROOT / "tests/support/moving_ball.toml").read_text()
    for fine, coarse in {"tion = 5": "tion = 3", "tion = 8": "tion = 4", "64": "32", "48": "24"}.items():
        assert fine in text
        text = text.replace(fine, coarse)
    (tmp_path / "scene.toml").write_text(text)
    scene = refield.dynamic.Scene(tmp_path / "scene.toml")
    assert scene.duration == pytest.approx(0.2)
    images = [scene.frame(time) for time in (0.0, 0.2)]
    run(program, "simulate", "dynamic", tmp_path / "scene.toml", "--time", 0.2, "-o", tmp_path / "cli.exr")
    assert np.array_equal(images[1], refield.read_image(tmp_path / "cli.exr"))
    assert not np.array_equal(*images)
    with pytest.raises(refield.InputError, match="time"):
        scene.frame(-1.0)


def test_evaluate(session, tmp_path):
    from sklearn.linear_model import Ridge

    class Mean:
        def fit(self, light, observed):
            self.mean = observed.mean(axis=0)

        def predict(self, light):
            return np.tile(self.mean, (len(light), 1))

    table = refield.evaluate(session, {"refield": "default", "ridge": Ridge(alpha=1.0), "mean": Mean()})
    assert list(dict.fromkeys(row.estimator for row in table)) == ["refield", "ridge", "mean"]
    natural = {row.estimator: row.relative_rmse for row in table if row.kind == "natural"}
    assert natural["refield"] < natural["mean"]
    ours = {errors.kind: errors for errors in refield.compare(refield.estimate(session), session)}
    assert natural["refield"] == pytest.approx(ours["natural"].relative_rmse, rel=1e-5)
    assert "relative RMSE" in str(table) and "<table>" in table._repr_html_()
    table.chart(tmp_path / "chart.svg")
    assert (tmp_path / "chart.svg").stat().st_size > 5000
    with pytest.raises(refield.InputError, match="held-out"):
        refield.evaluate(refield.Session.pairs([frame.light_path for frame in session.train[:3]],
                                               [frame.observed_path for frame in session.train[:3]]), {})
