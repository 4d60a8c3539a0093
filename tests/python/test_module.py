# SPDX-License-Identifier: Apache-2.0
"""What the module computes, against the command line, the definition of a field, and itself."""
import json
import logging
import multiprocessing
import os
import pickle
import subprocess
import types

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
        assert np.array_equal(getattr(a, name), getattr(b, name), equal_nan=True), name
    for x, y in ((0, 0), (11, 7), (23, 17)):
        assert a.kernels(x, y) == b.kernels(x, y)
        assert np.array_equal(a.transport(x, y), b.transport(x, y))


def test_predicted_error_follows_the_light(field):
    natural = random_lights(field, 1)[0]
    error = field.predicted_error_under(natural)
    assert error.shape == field.predicted_error.shape
    assert np.allclose(field.predicted_error_under(3 * natural), error, rtol=1e-5, equal_nan=True)
    texel = np.zeros_like(natural)
    texel[natural.shape[0] // 2, natural.shape[1] // 2] = 1
    assert np.nanmedian(field.predicted_error_under(texel)) > np.nanmedian(error)
    assert not np.nan_to_num(field.predicted_error_under(np.zeros_like(natural))).any()
    with pytest.raises(refield.InputError):
        field.predicted_error_under(natural[1:])


@pytest.mark.parametrize("lights,pattern", [(5, "its error on new photographs cannot be predicted"),
                                            (11, "the error on new photographs cannot be predicted")])
def test_error_that_cannot_be_predicted_is_nan_and_said(lights, pattern, caplog):
    random = np.random.default_rng(3)
    light = random.random((lights, 4, 8, 3), dtype=np.float32) ** 3
    observed = (random.random((20, 32)) @ light.reshape(lights, 32, 3)).reshape(lights, 4, 5, 3)
    observed *= 1 + 0.02 * random.standard_normal(observed.shape)
    with caplog.at_level(logging.WARNING, "refield"):
        field = refield.estimate(light, observed, rig="off")
    assert pattern in caplog.text
    assert np.isnan(field.predicted_error).all() and np.isnan(field.noise).all()


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
    run(program, "estimate", session.folder, "-o", tmp_path / "cli.rfield", "--mode", mode, "--max-kernels", 5)
    refield.estimate(session, mode=mode, max_kernels=5).save(tmp_path / "python.rfield")
    assert (tmp_path / "python.rfield").read_bytes() == (tmp_path / "cli.rfield").read_bytes()


def test_sigma_and_mask(arrays):
    light, observed = arrays
    sigma = np.full_like(observed, 1e-3)
    sigma[3] = np.inf  # as if it was never taken
    mask = np.zeros(observed.shape[1:3], dtype=bool)
    mask[4:9, 5:15] = True
    field = refield.estimate(light, observed, sigma, mask)
    for other in (0.4 + 0.2 * mask, mask.astype(int), np.uint8(255) * mask, -2.0 + 3.0 * mask):
        assert refield.compare(observed * 1.1 ** ~mask[..., None], observed, mask=other)[0].relative_rmse == 0.0
    assert field.kernels(0, 0) == [] and field.kernels(6, 5)
    wrong = observed.copy()
    wrong[3] = 7.0
    assert np.array_equal(refield.estimate(light, wrong, sigma, mask).relight(light[0]), field.relight(light[0]))


@pytest.mark.parametrize("lights,shown,kind", [(30, 1, "rectangles"), (30, 4, "texels"), (60, 1, "texels"), (10, 4, "Gaussians")])
def test_clean_arrays_of_random_lights_are_not_corrected(lights, shown, kind, caplog):
    """Sharp pixels that random texels light look as if a tone curve bent the light. Errors are predicted, with the noise."""
    noise = 0.01
    random = np.random.default_rng(1)
    y, x = np.mgrid[:4, :8]
    transport = np.zeros((256, 4, 8))
    for pixel in transport:
        if kind == "texels":
            pixel.ravel()[random.choice(32, 2, replace=False)] = 0.2 + random.random(2)
        elif kind == "rectangles":
            x0, y0 = random.integers(0, 7), random.integers(0, 3)
            pixel[y0:random.integers(y0 + 1, 5), x0:random.integers(x0 + 1, 9)] = 0.2 + random.random()
        else:
            pixel[:] = np.exp(-((x + 0.5 - 8 * random.random()) ** 2 + (y + 0.5 - 4 * random.random()) ** 2) / (2 * (0.6 + 2 * random.random()) ** 2))
    light = np.tile(random.random((lights, 4, 8, 3), np.float32), (shown, 1, 1, 1))
    clean = np.einsum("nhwc,phw->npc", light, transport)
    scale = np.sqrt((clean**2).mean((0, 2)))
    observed = clean + noise * scale[:, None] * random.standard_normal(clean.shape)
    with caplog.at_level(logging.WARNING, "refield"):
        field = refield.estimate(light, observed.reshape(-1, 16, 16, 3))
    assert "rig" not in caplog.text
    held_out = random.random((40, 4, 8, 3), np.float32)
    error = field.relight(held_out).reshape(40, 256, 3) - np.einsum("nhwc,phw->npc", held_out, transport)
    with_noise = np.sqrt((error**2).mean((0, 2)) / scale**2 + noise**2)
    assert np.median(with_noise) < 3 * noise
    assert 0.8 < np.nanmedian(field.predicted_error.ravel() / with_noise) < (1.25 if lights > 10 else 1.5)


def test_types_and_strides(arrays):
    light, observed = arrays

    def estimate(light, observed):
        return refield.estimate(light, observed, mode="fast", predict_errors=False)

    field = estimate(light, observed)
    new_light = random_lights(field, 1)[0]
    expected = field.relight(new_light)
    assert np.array_equal(field.relight(new_light.astype(">f4")), expected)  # the other byte order
    channels_first = np.ascontiguousarray(observed.transpose(0, 3, 1, 2))
    same = estimate(np.asfortranarray(light), channels_first.transpose(0, 2, 3, 1))
    assert np.array_equal(same.relight(new_light), expected)
    half = estimate(light.astype(np.float16), observed.astype(np.float16))
    assert np.allclose(half.relight(new_light), expected, rtol=0.2, atol=0.05 * expected.max())
    # 65535 stands for 1, so that the field of scaled photographs is the scaled field.
    scale = observed.max()
    whole = estimate(light, np.round(observed / scale * 65535).astype(">u2"))
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
    run(program, "pack", tmp_path / "full.rfield", "-o", tmp_path / "cli.rfield", "--max-error", 1e-3)
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
    assert all(errors.trained_on == 0 for errors in refield.compare(field, session))  # estimated from arrays
    from_files = refield.estimate(session, mode="fast", predict_errors=False)
    assert all(errors.trained_on == 0 for errors in refield.compare(from_files, session))
    alone = refield.compare(field.relight(frame.light()), frame.observed())[0]
    in_series = [image for errors in refield.compare(field, session) for image in errors.per_image if image.name == frame.name]
    assert alone.relative_rmse == pytest.approx(in_series[0].relative_rmse)
    split = refield.Session.pairs(f"{session.folder}/illumination/train_*.exr", f"{session.folder}/observed/train_*.exr").held_out(10)
    assert (len(split.train), len(split.test)) == (36, 4)
    assert refield.compare(field, split)[0].trained_on == 4  # recognised by their light maps
    with pytest.raises(refield.InputError, match="held_out 1"):
        session.held_out(1)
    with pytest.raises(IndexError):
        session[99]


def test_jpeg_copies_of_training_lights_are_recognised(arrays, tmp_path):
    image = pytest.importorskip("PIL.Image")
    random = np.random.default_rng(2)
    lights = np.repeat(np.repeat(random.integers(0, 2, (24, 6, 8, 3)), 2, 1), 2, 2).astype(np.float32)
    for name in ("exr", "jpg", "photographs"):
        (tmp_path / name).mkdir()
    for j, light in enumerate(lights):
        refield.write_exr(tmp_path / f"exr/{j:02}.exr", light)
        image.fromarray(np.uint8(255 * light)).save(tmp_path / f"jpg/copy{j:02}.jpg", quality=90, subsampling=2)
        refield.write_exr(tmp_path / f"photographs/{j:02}.exr", arrays[1][j])

    def pairs(kind, chosen):
        return refield.Session.pairs(sorted((tmp_path / kind).iterdir())[chosen], sorted((tmp_path / "photographs").iterdir())[chosen])

    for trained, compared in (("exr", "jpg"), ("jpg", "exr")):
        field = refield.estimate(pairs(trained, slice(0, 16)), mode="fast", rig="off", predict_errors=False)
        both = pairs(compared, slice(8, 24)).held_out(2)
        assert refield.compare(field, both)[0].trained_on == 4 and len(both.test) == 8


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
    with pytest.raises(refield.InputError, match="max_kernels"):
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


WRONG_CALLS = {
    "shape is 1073741824×1073741824": lambda a: refield.environment(a.sky, shape=(2**30, 2**30)),
    "shape is 3.5": lambda a: refield.environment(a.sky, shape=(3.5, 4)),
    "give a field, or the shape": lambda a: refield.environment(a.sky, shape=12),
    "omit it": lambda a: refield.environment(a.sky, a.field, shape=(3, 4)),
    "yaw is nan": lambda a: refield.environment(a.sky, a.field, placement="520x320@600", yaw=np.nan),
    "light and observed are empty": lambda a: refield.Session.pairs([], []),
    "light is None": lambda a: refield.Session.pairs(None, None),
    "every is 2.5": lambda a: a.session.held_out(2.5),
    "index is 'a'": lambda a: a.session["a"],
    "mask: holds NaN": lambda a: refield.estimate(a.light, a.observed, mask=np.full((18, 24), np.nan)),
    "mask: is nowhere above one half": lambda a: refield.estimate(a.light, a.observed, mask=np.full((18, 24), 0.4)),
    "whole numbers such as 90": lambda a: refield.estimate(a.light, a.observed, mask=np.full((18, 24), 90, np.uint8)),
    "is given for": lambda a: refield.Session.pairs([f.light_path for f in a.session.train],
                                                    [a.session.train[0].observed_path] * len(a.session.train)),
    "darker than images": lambda a: refield.hdr_merge(np.linspace(0.4, 0.2, 2 * 1296).reshape(2, 18, 24, 3), [1.0, 2.0]),
    "too small for float32": lambda a: refield.estimate(a.light, a.observed.astype(float) * 1e-50),
    "height×width 18×24": lambda a: refield.compare(a.observed, a.observed, mask=np.ones(18 * 24)),
    r"observed\[0\]: has a sample that is not finite": lambda a: refield.compare(a.observed, a.observed * np.nan),
    "max_kernels is 0": lambda a: refield.estimate(a.light, a.observed, max_kernels=0),
    "max_kernels is 2.5": lambda a: refield.estimate(a.light, a.observed, max_kernels=2.5),
    "predict_errors is 'no'": lambda a: refield.estimate(a.light, a.observed, predict_errors="no"),
    "memory is None": lambda a: refield.estimate(a.light, a.observed, memory=None),
    "masked array": lambda a: refield.estimate(a.light, np.ma.masked_greater(a.observed, 0.1)),
    "is a masked array": lambda a: refield.estimate(a.light, [np.ma.masked_greater(image, 0.1) for image in a.observed]),
    "mask: is a masked array": lambda a: refield.estimate(a.light, a.observed, mask=np.ma.masked_less(np.eye(18, 24), 0.5)),
    "images of the types float32, uint8": lambda a: refield.estimate(a.light, [a.observed[0], *np.uint8(255 * a.observed[1:])]),
    "images of the types uint16, uint8": lambda a: a.field.relight([np.ones((12, 16, 3), np.uint8), np.ones((12, 16, 3), np.uint16)]),
    "observed: is no array": lambda a: refield.estimate(a.light, [a.observed[0], a.observed[1][:3]]),
    "observed: has the shape 0×18": lambda a: refield.estimate(a.light[:0], a.observed[:0]),
    "at most 1048576 images": lambda a: refield.estimate(np.broadcast_to(np.float32(1), (2**28, 4, 4, 3)), a.observed),
    "too bright": lambda a: a.field.relight(a.light[0] * 1e37),
    "out is \\[1, 2\\]": lambda a: a.field.relight(a.light[0], out=[1, 2]),
    "aligned": lambda a: a.field.relight(a.light[0], out=np.zeros(5185, np.uint8)[1:].view(np.float32).reshape(18, 24, 3)),
    "threads is -1": lambda a: a.field.relight(a.light[0], threads=-1),
    "x is 1.5": lambda a: a.field.transport(1.5, 2),
    "u is None": lambda a: a.field.lit_by(None, 2),
    "y is 1099511627776": lambda a: a.field.kernels(2, 2**40),
    "max_error is \'a\'": lambda a: a.field.pack("a"),
    "changed is \\(3, 3, 3, 3\\)": lambda a: a.field.relighter().update(a.light[0], (3, 3, 3, 3)),
    "four numbers": lambda a: a.field.relighter().update(a.light[0], None),
    "path is 3": lambda a: refield.Field.load(3),
    r"path is 'f\.rfield\\x00'": lambda a: refield.Field.load("f.rfield\0"),
    "ends in .exr": lambda a: refield.write_exr("image.png", a.observed[0]),
    "size is 2.5": lambda a: refield.simulate(RECIPE, "folder", size=(2.5, 2)),
    "an option of the method 'clusters'": lambda a: refield.precompute("mesh.obj", "sh", epsilon=0.1),
    "pixel_samples is an option of images": lambda a: refield.precompute("mesh.obj", pixel_samples=2),
    "sh_order is 3.5": lambda a: refield.precompute("mesh.obj", "sh", sh_order=3.5),
    "exposures is inf": lambda a: refield.hdr_merge(a.observed[:2], [1.0, np.inf]),
    "omit it$": lambda a: refield.hdr_merge(a.observed[:2], [1.0, 2.0], response="srgb"),
    "pictures: has the shape 8×18×24×3": lambda a: refield.show([a.observed[:8]]),
    "titles: 2 for 1 pictures": lambda a: refield.show(a.observed[0], ["a", "b"]),
    "columns is 0": lambda a: refield.show(a.observed[0], columns=0),
    "exposure is 'auto'": lambda a: refield.show(a.observed[0], exposure="auto"),
    "session is array": lambda a: refield.evaluate(a.observed, {"a": "paper"}),
    "an object with fit and predict": lambda a: refield.evaluate(a.session, {"a": object()}),
}


@pytest.mark.parametrize("message", WRONG_CALLS)
def test_wrong_arguments_are_named(message, session, arrays, field):
    given = types.SimpleNamespace(session=session, light=arrays[0], observed=arrays[1], field=field,
                                  sky=np.ones((16, 32, 3), np.float32))
    with pytest.raises(refield.InputError, match=message):
        WRONG_CALLS[message](given)


def test_damaged_and_unusual_files(field, tmp_path):
    light = random_lights(field, 1)[0]
    file = tmp_path / "Größe 光.rfield"
    field.save(file)
    data = file.read_bytes()
    with pytest.raises(refield.FormatError, match="truncated"):
        refield._from_bytes(data[:len(data) // 2])  # what a pickle holds
    again = refield.Field.load(os.fsencode(file))
    again.save(file)  # onto the file that it was read from
    assert np.array_equal(refield.Field.load(file).relight(light), field.relight(light))


def test_messages_name_the_image_and_the_argument(arrays, field):
    lights = random_lights(field, 14)
    for batch in (lights, lights[:4]):
        broken = batch.copy()
        broken[3, 0, 0, 0] = np.nan
        with pytest.raises(refield.InputError, match=r"light\[3\]"):
            field.relight(broken)
    with pytest.raises(refield.InputError, match="^max_kernels is 300"):
        refield.estimate(*arrays, max_kernels=300)
    with pytest.raises(refield.InputError, match=r"predicted\[1\]"):
        refield.compare(np.stack([lights[0], lights[1] * np.nan]), lights[:2])


def _after_fork(call, answers):
    try:
        call()
        answers.put("worked")
    except refield.Error as error:
        answers.put(str(error))


def test_after_a_fork_calls_raise_at_once(field, tmp_path):
    light = random_lights(field, 1)[0]
    refield.write_exr(tmp_path / "light.exr", light)
    context = multiprocessing.get_context("fork")
    for call in (lambda: field.relight(light), lambda: refield.write_exr(tmp_path / "other.exr", light), lambda: field.kernels(0, 0),
                 lambda: refield.compare(light, light), lambda: refield.read_image(tmp_path / "light.exr")):
        answers = context.SimpleQueue()
        process = context.Process(target=_after_fork, args=(call, answers))
        process.start()
        process.join(300)  # only what hangs
        assert process.exitcode == 0 and "forked" in answers.get()


def test_out_may_overlap_the_light(field):
    memory = np.zeros((2, *field.shape), np.float32)
    lights = memory.reshape(-1)[:2 * light_size(field)].reshape(2, *field.light_shape)
    lights[:] = random_lights(field, 2)
    expected = field.relight(lights)
    assert np.array_equal(field.relight(lights, out=memory), expected)


def light_size(field):
    return int(np.prod(field.light_shape))


def test_progress_and_notes(arrays, caplog):
    light, observed = arrays
    seen = []
    refield.estimate(light, observed, mode="fast", progress=lambda *stage: seen.append(stage))
    assert ("estimate", 18 * 24, 18 * 24) in seen and all(0 <= done <= total for _, done, total in seen)
    tqdm = pytest.importorskip("tqdm")
    with tqdm.tqdm(file=open("/dev/null", "w")) as bar:
        refield.estimate(light, observed, mode="fast", progress=bar)
        assert bar.n == bar.total > 0

    def fail(stage, done, total):
        raise RuntimeError(f"in {stage}")

    with pytest.raises(RuntimeError, match="in "):
        refield.estimate(light, observed, progress=fail)
    flickering = observed.copy()
    flickering[7] *= 0.3
    with caplog.at_level(logging.WARNING, logger="refield"):
        refield.estimate(light, flickering, mode="fast")
    assert any(text.startswith("7 is left out") for text in caplog.messages), caplog.messages
    half_black = np.random.default_rng(1).random((12, 4, 8, 3), dtype=np.float32)
    half_black[:, :, :4] = 0.0
    with caplog.at_level(logging.WARNING, logger="refield"):
        refield.estimate(half_black, half_black).relight(np.ones((4, 8, 3), np.float32))
    assert caplog.messages[-1].startswith("50 % of the light comes from texels that were black"), caplog.messages


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
    light = refield.environment(sky, field, placement="520x320@600")
    assert light.shape == field.light_shape and np.allclose(light, 1.0, rtol=1e-5)
    ringing = sky.copy()
    ringing[3, 4] = -0.01  # of lossy compression
    assert refield.environment(ringing, field, placement="520x320@600").min() >= 0.0
    ahead = sky.copy()
    ahead[:, :16] = 0.0  # the left half
    turned = refield.environment(ahead, shape=(12, 16), placement="520x320@600", yaw=-90.0)
    assert np.allclose(refield.environment(ahead, shape=(12, 16), placement="520x320@600")[:, 0], 0.0, atol=1e-6)
    assert np.allclose(turned[:, -1], 1.0, rtol=1e-4)
    placed = refield.estimate(*arrays, mode="fast", placement="520x320@600", predict_errors=False)
    assert placed.monitors == ["520x320@600"] and np.array_equal(refield.environment(sky, placed), light)


@pytest.mark.parametrize("method, settings", [("clusters", {"resolution": 16, "epsilon": 1e-2, "diffuse_bounces": 1}), ("sh", {"sh_order": 3, "directions": 64})])
def test_precompute(program, tmp_path, method, settings):
    scene = ROOT / "datasets_synthetic/prt/small.toml"
    field = refield.precompute(scene, method, **settings)
    options = [word for name, value in settings.items() for word in ("--" + name.replace("_", "-"), value)]
    run(program, "precompute", scene, "--method", method, *options, "-o", tmp_path / "cli.rfield")
    field.save(tmp_path / "python.rfield")
    assert (tmp_path / "python.rfield").read_bytes() == (tmp_path / "cli.rfield").read_bytes()
    light = refield.environment(np.ones((16, 32, 3), np.float32), field)
    image = field.relight(light)
    assert image.shape == field.shape and image.max() > 0.1


def test_dynamic_scene(program, tmp_path):
    text = (ROOT / "tests/support/moving_ball.toml").read_text()
    for fine, coarse in {"tion = 5": "tion = 3", "tion = 8": "tion = 4", "64": "32", "48": "24"}.items():
        assert fine in text
        text = text.replace(fine, coarse)
    (tmp_path / "scene.toml").write_text(text)
    scene = refield.dynamic.Scene(tmp_path / "scene.toml")
    assert scene.duration == pytest.approx(0.2)
    images = [scene.frame(time) for time in (0.0, 0.2)]
    run(program, "render", tmp_path / "scene.toml", "--time", 0.2, "-o", tmp_path / "cli.exr")
    assert np.array_equal(images[1], refield.read_image(tmp_path / "cli.exr"))
    assert not np.array_equal(*images)
    with pytest.raises(refield.InputError, match="time"):
        scene.frame(-1.0)


def test_pictures_are_shown_as_relight_writes_them(program, field, tmp_path):
    light = random_lights(field, 1)[0]
    refield.write_exr(tmp_path / "light.exr", light)
    image = field.relight(light)
    field.save(tmp_path / "field.rfield")
    run(program, "relight", tmp_path / "field.rfield", "--light", tmp_path / "light.exr", "--exposure", 0.7, "-o", tmp_path / "by.png")
    drawn = [axes.images[0].get_array() for axes in refield.show([image, image], exposure=0.7).axes]
    written = refield.show(refield.read_image(tmp_path / "by.png"), exposure=1.0).axes[0].images[0].get_array()
    assert np.abs(drawn[0] - written).max() <= 0.6 / 255  # PNG has 256 levels
    assert np.array_equal(*drawn)
    # The 99th percentile becomes white, whatever the units.
    own = [refield.show(factor * image).axes[0].images[0].get_array() for factor in (1.0, 1000.0)]
    assert np.allclose(*own, atol=1e-5) and 0 < np.mean(own[0].max(axis=2) > 0.9999) <= 0.02
    figure = refield.show([image, field.predicted_error, image], "relit", columns=2)
    assert [axes.get_title() for axes in figure.axes if axes.get_title()] == ["relit"]
    assert figure.axes[1].images[0].get_clim()[0] == 0.0
    refield.show(np.zeros((4, 5, 3))).savefig(tmp_path / "black.png")


def test_evaluate_leaves_out_what_compare_does(session, monkeypatch):
    def sigma(frame):
        return np.where(frame.observed() > np.quantile(frame.observed(), 0.8), np.inf, np.float32(1e-3)).astype(np.float32)

    monkeypatch.setattr(refield.Frame, "sigma", sigma)

    class Brighter:
        def fit(self, light, observed):
            pass

        def predict(self, light):
            frames = [frame for frame in session.test if frame.kind == "natural"]
            images = np.stack([np.where(np.isinf(frame.sigma()), 99, 1.1 * frame.observed()) for frame in frames])
            return images.reshape(len(images), -1) if len(light) == len(images) else np.zeros((len(light), images[0].size))

    rows = refield.evaluate(session, {"brighter": Brighter()})
    assert rows[0].kind == "natural" and rows[0].relative_rmse == pytest.approx(0.1, rel=1e-3)


def test_evaluate(session, tmp_path):
    from sklearn.linear_model import Ridge

    class Mean:
        def fit(self, light, observed):
            self.mean = observed.mean(axis=0)

        def predict(self, light):
            return np.tile(self.mean, (len(light), 1))

    table = refield.evaluate(session, {"refield": "fast", "ridge": Ridge(alpha=1.0), "mean": Mean()})
    assert list(dict.fromkeys(row.estimator for row in table)) == ["refield", "ridge", "mean"]
    natural = {row.estimator: row.relative_rmse for row in table if row.kind == "natural"}
    assert natural["refield"] < natural["mean"]
    ours = {errors.kind: errors for errors in refield.compare(refield.estimate(session, mode="fast"), session)}
    assert natural["refield"] == pytest.approx(ours["natural"].relative_rmse, rel=1e-5)
    assert "relative RMSE" in str(table) and "<table>" in table._repr_html_()
    table.chart(tmp_path / "chart.svg")
    assert (tmp_path / "chart.svg").stat().st_size > 5000
    class Lost(Mean):
        def predict(self, light):
            return np.full((len(light), self.mean.size), np.nan)

    with pytest.raises(refield.InputError, match="lost: .*not finite for image 0"):
        refield.evaluate(session, {"lost": Lost()})
    with pytest.raises(refield.InputError, match="held-out"):
        refield.evaluate(refield.Session.pairs([frame.light_path for frame in session.train[:3]],
                                               [frame.observed_path for frame in session.train[:3]]), {})
