#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Measures refield and other methods on real photographs under single light sources.

    bench/studies/real_sets.py SET --data FOLDER -o OUT --program build/release/cli/refield

SET is cat, relief, face or led; FOLDER is a checkout of the public repository that holds it:

    cat      BelabdiMalak/Photometric_3D_Reconstruction  (DiLiGenT cat: 96 light sources, 16 bits)
    relief   sungam94/NeuralRTI                          (240 light sources, 8-bit JPEG)
    face     maxcrous/photometric-stereo                 (Yale face 02: 64 flashes, 8 bits)
    led      ShuheZhang-MUMC/elfpie_algorithm            (8×8 LED matrix below a microscope, 8 bits)

Each light source is one lit texel of a light map of 64×32 texels. Photographs under other light are weighted sums of the
photographs under single light sources: natural light (a random texture on the sphere with a few bright sources, another seed
for training and tests), bars of light sources, and single light sources. Training photographs have Gaussian noise (--noise, part of
each pixel's mean sample); test photographs have none. With --single the training photographs are those of the single
light sources.

Writes light/ and observed/ (pairs by name: train_*, natural_*, bar_*, single_*) and mask.png, runs `refield estimate`
and prints the relative RMSE of each kind of light inside the mask, median over pixels, beside least squares, ridge
regression (parameter per pixel and channel by leave-one-out) and non-negative least squares over the lit texels.
With --leave-one-out it prints the errors of interpolation between the light sources instead: each source is predicted from
the others by PTM, hemispherical harmonics, radial basis functions, Delaunay weights and refield.
Needs numpy, scipy and the Python module of OpenImageIO.
"""
import argparse
import functools
import json
import math
import pathlib
import re
import subprocess
import sys
import time

import numpy
import OpenImageIO as oiio

MAP_WIDTH, MAP_HEIGHT = 64, 32


def read_image(path):
    """Pixels [height, width, channels] as float32; integers scaled to 1."""
    buffer = oiio.ImageBuf(str(path))
    pixels = buffer.get_pixels(oiio.FLOAT)
    if pixels is None:
        sys.exit(f"{path}: {buffer.geterror()}")
    return pixels


def read_rgb(path):
    pixels = read_image(path)
    return pixels[..., :3] if pixels.shape[2] >= 3 else numpy.repeat(pixels[..., :1], 3, axis=2)


def write_image(path, pixels):
    pixels = numpy.ascontiguousarray(pixels)
    output = oiio.ImageOutput.create(str(path))
    format = "uint8" if pixels.dtype == numpy.uint8 else "float"
    output.open(str(path), oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], format))
    output.write_image(pixels)
    output.close()


# ---- the sets: photographs under single light sources [sources, height, width, 3], directions [sources, 3] (x right, y up,
# z towards the camera), mask [height, width]


def read_cat(folder):
    folder = folder / "data"
    names = (folder / "filenames.txt").read_text().split()
    intensities = numpy.loadtxt(folder / "light_intensities.txt")
    photographs = [read_rgb(folder / name) / intensity for name, intensity in zip(names, intensities)]
    return photographs, numpy.loadtxt(folder / "light_directions.txt"), read_image(folder / "mask.png")[..., 0] > 0.5


def linear(values):
    return numpy.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def read_relief(folder):
    lines = (folder / "data" / "dirs.lp").read_text().split("\n")[1:]
    entries = [line.split() for line in lines if line.strip()]
    photographs = [linear(read_rgb(folder / "data" / entry[0])) for entry in entries]
    directions = numpy.array([[float(value) for value in entry[1:4]] for entry in entries])
    return photographs, directions, numpy.ones(photographs[0].shape[:2], bool)


def read_face(folder):
    folder = folder / "photometrics_images" / "yaleB02"
    ambient = read_rgb(next(folder.glob("*Ambient.pgm")))
    photographs, directions = [], []
    for path in sorted(folder.glob("*E*.pgm")):
        azimuth, elevation = (math.radians(int(angle)) for angle in re.search(r"A([+-]\d+)E([+-]\d+)", path.name).groups())
        photographs.append(numpy.maximum(read_rgb(path) - ambient, 0.0))
        directions.append([math.cos(elevation) * math.sin(azimuth), math.sin(elevation),
                           math.cos(elevation) * math.cos(azimuth)])
    return photographs, numpy.array(directions), numpy.max(photographs, axis=(0, 3)) > 0.1


def spiral(side):
    """Cells of a square from the middle outwards, as the matrix was lit."""
    x, y, reach = side // 2 - 1, side // 2, 1
    yield x, y
    count = 1
    while True:
        for dx, dy in ((0, -1), (1, 0), (0, 1), (-1, 0)):
            for _ in range(reach):
                x, y, count = x + dx, y + dy, count + 1
                yield x, y
                if count == side * side:
                    return
            reach += dx != 0


def read_led(folder):
    folder = folder / "usaf_demo" / "raw_image20180708" / "pross"
    photographs = [read_rgb(folder / f"{number}.tif") for number in range(1, 65)]
    places = numpy.array(list(spiral(8)), float) - 3.5
    directions = numpy.column_stack([places[:, 0] * 0.2, -places[:, 1] * 0.2, numpy.ones(64)])
    return photographs, directions, numpy.ones(photographs[0].shape[:2], bool)


SETS = {"cat": read_cat, "relief": read_relief, "face": read_face, "led": read_led}


def texels_of(directions):
    """A texel of its own for each source: azimuth and elevation seen from the object, spread over the map."""
    d = directions / numpy.linalg.norm(directions, axis=1, keepdims=True)
    azimuth, elevation = numpy.arctan2(d[:, 0], d[:, 2]), numpy.arcsin(d[:, 1])

    def place(angle, size):
        low, high = angle.min(), angle.max()
        return numpy.clip(((angle - low) / (high - low) * (size - 2) + 1).astype(int), 0, size - 1)

    columns, rows = place(azimuth, MAP_WIDTH), place(-elevation, MAP_HEIGHT)
    taken = {}
    for source in range(len(d)):
        free = [(abs(dx) + abs(dy), columns[source] + dx, rows[source] + dy) for dx in range(-6, 7) for dy in range(-6, 7)
                if 0 <= columns[source] + dx < MAP_WIDTH and 0 <= rows[source] + dy < MAP_HEIGHT
                and (columns[source] + dx, rows[source] + dy) not in taken]
        taken[min(free)[1:]] = source
    texels = numpy.empty((len(d), 2), int)
    for texel, source in taken.items():
        texels[source] = texel
    return texels, d


# ---- light: [lights, sources, 3], radiance of each source


def natural_light(directions, count, rng):
    """Log-normal texture with a 1/f spectrum on the sphere, and up to three bright sources of a few degrees."""
    lights = []
    for _ in range(count):
        waves = 60
        frequency = numpy.exp(rng.uniform(math.log(0.7), math.log(40.0), waves))
        axes = rng.normal(size=(waves, 3))
        axes *= (frequency / numpy.linalg.norm(axes, axis=1))[:, None]
        phase = rng.uniform(0.0, 2.0 * math.pi, waves)
        colours = 1.0 + 0.25 * rng.normal(size=(waves, 3))
        pattern = numpy.cos(directions @ axes.T + phase) @ (colours * (0.5 / numpy.sqrt(frequency))[:, None])
        light = numpy.exp(pattern)
        for _ in range(rng.integers(0, 4)):
            centre = rng.normal(size=3)
            centre /= numpy.linalg.norm(centre)
            sharpness = rng.uniform(10.0, 100.0)
            lobe = numpy.exp(sharpness * (directions @ centre - 1.0))
            light += lobe[:, None] * math.exp(rng.uniform(math.log(3.0), math.log(30.0))) * (1.0 + 0.2 * rng.normal(size=3))
        lights.append(numpy.maximum(light, 0.0))
    return numpy.array(lights)


def environment_light(folder, directions, count, rng):
    """Lat-long environment maps of a folder, one after another, each turned at random and averaged over about 6°."""
    maps = []
    for path in sorted(folder.glob("*.exr")):
        whole = oiio.ImageBufAlgo.resize(oiio.ImageBuf(str(path)), filtername="box", roi=oiio.ROI(0, 64, 0, 32, 0, 1, 0, 3))
        maps.append(numpy.maximum(whole.get_pixels(oiio.FLOAT)[..., :3], 0.0))
    lights = []
    for number in range(count):
        rotation, _ = numpy.linalg.qr(rng.normal(size=(3, 3)))
        d = directions @ rotation.T
        environment = maps[number % len(maps)]
        row = numpy.clip((numpy.arccos(numpy.clip(d[:, 1], -1, 1)) / math.pi * 32).astype(int), 0, 31)
        column = ((numpy.arctan2(d[:, 0], d[:, 2]) / (2 * math.pi) + 0.5) * 64).astype(int) % 64
        lights.append(environment[row, column] / environment.mean())
    return numpy.array(lights)


def bars(texels, count, rng):
    """White upright and level bars, an eighth of the map wide, each over some of the sources."""
    lights = []
    while len(lights) < count:
        across = rng.integers(0, 2)
        size = (MAP_WIDTH, MAP_HEIGHT)[across]
        first = rng.uniform(0.0, size * 7.0 / 8.0)
        lit = (texels[:, across] >= first) & (texels[:, across] < first + size / 8.0)
        if lit.sum() >= 2:
            lights.append(numpy.repeat(lit[:, None].astype(float), 3, axis=1))
    return numpy.array(lights)


def photograph(sources, light):
    return numpy.einsum("jlc,lpc->jpc", light, sources)


# ---- other methods, one pixel and channel at a time: weights over the lit texels


def least_squares(lights, samples):
    return numpy.linalg.lstsq(lights, samples, rcond=None)[0]


def ridge(lights, samples):
    """[sources, pixels]; the parameter of each pixel by the leave-one-out residual, in the dual form."""
    values, vectors = numpy.linalg.eigh(lights @ lights.T)
    values = numpy.maximum(values, 0.0)
    coordinates = vectors.T @ samples
    best = numpy.full(samples.shape[1], numpy.inf)
    alpha = numpy.zeros_like(samples)
    for parameter in values.max() * numpy.logspace(-12, 1, 53):
        inverse = 1.0 / (values + parameter)
        dual = vectors @ (inverse[:, None] * coordinates)
        diagonal = (vectors**2) @ inverse
        error = numpy.sum((dual / diagonal[:, None]) ** 2, axis=0)
        better = error < best
        best[better] = error[better]
        alpha[:, better] = dual[:, better]
    return lights.T @ alpha


def non_negative(lights, samples):
    from scipy.optimize import nnls
    return numpy.column_stack([nnls(lights, samples[:, p])[0] for p in range(samples.shape[1])])


METHODS = {"least squares": least_squares, "ridge": ridge, "NNLS": non_negative}


def errors(predicted, truth):
    """Relative RMSE of each pixel, over photographs and channels."""
    squared = numpy.sum((predicted - truth) ** 2, axis=(0, 2))
    return numpy.sqrt(squared / numpy.maximum(numpy.sum(truth**2, axis=(0, 2)), 1e-30))


def build(options):
    """The set: sources [sources, pixels, 3] of a crop of the mask, light and noise-free photographs of each kind."""
    photographs, directions, mask = SETS[options.set](options.data)
    texels, directions = texels_of(directions)
    photographs = numpy.array(photographs, numpy.float32)
    step = options.stride
    mask, photographs = mask[step // 2::step, step // 2::step], photographs[:, step // 2::step, step // 2::step]
    rows, columns = numpy.nonzero(mask)
    side = options.crop
    if side:
        top = int(numpy.clip(numpy.median(rows) - side / 2, 0, max(0, mask.shape[0] - side)))
        left = int(numpy.clip(numpy.median(columns) - side / 2, 0, max(0, mask.shape[1] - side)))
        window = numpy.s_[top:top + side, left:left + side]
        mask, photographs = mask[window], photographs[:, window[0], window[1]]
    if options.keep_sources:
        texels, directions, photographs = (array[:options.keep_sources] for array in (texels, directions, photographs))
    sources = photographs.reshape(len(photographs), -1, 3).astype(float)
    identity = numpy.repeat(numpy.eye(len(sources))[..., None], 3, axis=2)
    train_rng, test_rng = numpy.random.default_rng(options.seed), numpy.random.default_rng(options.seed + 1000)
    natural = functools.partial(environment_light, options.environments) if options.environments else natural_light
    light = {"train": identity if options.single else natural(directions, options.pairs, train_rng),
             "natural": natural(directions, options.tests, test_rng),
             "bar": bars(texels, options.tests, test_rng),
             "single": identity[test_rng.permutation(len(sources))[:options.tests]]}
    truth = {kind: photograph(sources, values) for kind, values in light.items()}
    deviation = options.noise * truth["train"].mean(axis=0)
    noisy = truth["train"] + deviation * train_rng.normal(size=truth["train"].shape)
    return mask, texels, sources, light, truth, noisy


def write_pairs(folder, mask, texels, light, truth, noisy):
    for name in ("light", "observed"):
        (folder / name).mkdir(parents=True, exist_ok=True)
        for old in (folder / name).glob("*.exr"):
            old.unlink()
    write_image(folder / "mask.png", (mask[..., None] * 255).astype(numpy.uint8))
    for kind, values in light.items():
        observed = noisy if kind == "train" else truth[kind]
        for number, radiance in enumerate(values):
            light_map = numpy.zeros((MAP_HEIGHT, MAP_WIDTH, 3), numpy.float32)
            light_map[texels[:, 1], texels[:, 0]] = radiance
            name = f"{kind}_{number:04}.exr"
            write_image(folder / "light" / name, light_map)
            write_image(folder / "observed" / name, observed[number].reshape(*mask.shape, 3).astype(numpy.float32))


def relight(program, folder, field, kind, count, shape):
    """Photographs [count, pixels, 3] of the field under the light maps of a kind."""
    output = folder / "relit"
    output.mkdir(exist_ok=True)
    for old in output.glob("*.exr"):
        old.unlink()
    subprocess.run([program, "relight", field, "--light", f"{folder}/light/{kind}_*.exr", "-o", output], check=True, capture_output=True)
    return numpy.array([read_rgb(output / f"{kind}_{number:04}.exr").reshape(-1, 3) for number in range(count)])


# ---- interpolation between light sources: weights [tests, sources] of the sources at directions `at`, from directions of
# sources `to`. Plane: the first two components of a direction, as in Malzbender et al. 2001.


def fitted_weights(functions, to, at):
    """Least squares of functions of the direction."""
    return functions(at) @ numpy.linalg.pinv(functions(to))


def ptm_terms(d):
    u, v = d[:, 0], d[:, 1]
    return numpy.column_stack([u * u, v * v, u * v, u, v, numpy.ones(len(d))])


def hsh_terms(d, order):
    """Hemispherical harmonics: spherical ones with the cosine of the angle from the axis stretched from 0..1 to -1..1."""
    from scipy.special import lpmv
    cosine, azimuth = 2.0 * numpy.clip(d[:, 2], 0.0, 1.0) - 1.0, numpy.arctan2(d[:, 1], d[:, 0])
    terms = []
    for l in range(order):
        for m in range(-l, l + 1):
            scale = math.sqrt((2 * l + 1) * math.factorial(l - abs(m)) / (2 * math.pi * math.factorial(l + abs(m))))
            around = 1.0 if m == 0 else math.sqrt(2.0) * (numpy.cos(m * azimuth) if m > 0 else numpy.sin(-m * azimuth))
            terms.append(scale * lpmv(abs(m), l, cosine) * around)
    return numpy.column_stack(terms)


def rbf_weights(kernel, dimensions, to, at):
    from scipy.interpolate import RBFInterpolator
    return RBFInterpolator(to[:, :dimensions], numpy.eye(len(to)), kernel=kernel)(at[:, :dimensions])


def delaunay_weights(to, at):
    from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator
    weights = LinearNDInterpolator(to[:, :2], numpy.eye(len(to)))(at[:, :2])
    outside = numpy.isnan(weights).any(axis=1)
    weights[outside] = NearestNDInterpolator(to[:, :2], numpy.eye(len(to)))(at[outside, :2])
    return weights


INTERPOLATORS = {
    "PTM": functools.partial(fitted_weights, ptm_terms),
    **{f"HSH {n * n} terms": functools.partial(fitted_weights, functools.partial(hsh_terms, order=n)) for n in (2, 3, 4, 5)},
    **{f"RBF {kernel}": functools.partial(rbf_weights, kernel, 2) for kernel in ("linear", "thin_plate_spline", "cubic")},
    "RBF linear, sphere": functools.partial(rbf_weights, "linear", 3),
    "Delaunay": delaunay_weights,
}


def texel_directions(directions, height):
    """The middles of the sources' texels in a lat-long map, as `refield acquire import` places them; y is up."""
    d = directions / numpy.linalg.norm(directions, axis=1, keepdims=True)
    columns = numpy.floor(numpy.arctan2(-d[:, 0], d[:, 2]) / (2 * math.pi) % 1.0 * 2 * height).astype(int)
    rows = numpy.floor(numpy.arccos(numpy.clip(d[:, 1], -1, 1)) / math.pi * height).astype(int)
    phi, theta = (columns + 0.5) / height * math.pi, (rows + 0.5) / height * math.pi
    middle = numpy.column_stack([-numpy.sin(theta) * numpy.sin(phi), numpy.cos(theta), numpy.sin(theta) * numpy.cos(phi)])
    return middle, columns, rows


def matern_mixture(chords, length, share, fine_length):
    def matern(x):
        return (1.0 + math.sqrt(3.0) * x) * numpy.exp(-math.sqrt(3.0) * x)
    return (1.0 - share) * matern(chords / length) + share * matern(chords / fine_length)


def chords_of(a, b):
    return numpy.sqrt(numpy.maximum(2.0 - 2.0 * a @ b.T, 0.0))


def gaussian_process(sources, directions):
    """The interpolation of refield (core/field/light_interpolation.h) in numpy: its lengths and share."""
    chords = chords_of(directions, directions)
    numpy.fill_diagonal(chords, 0.0)
    spacing = numpy.sort((chords + 2.0 * numpy.eye(len(chords))).min(axis=1))[len(chords) // 2]
    responses = sources / numpy.sqrt(numpy.maximum(numpy.sum(sources**2, axis=(0, 2), keepdims=True), 1e-30))
    responses = responses[:, :300].reshape(len(chords), -1)
    best = (math.inf, None)
    for length in (0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 6.4):
        for share in (1e-4, 1e-3, 3e-3, 1e-2, 3e-2, 1e-1, 3e-1):
            covariance = matern_mixture(chords, length, share, 0.25 * spacing) + 1e-9 * numpy.eye(len(chords))
            inverse = numpy.linalg.inv(covariance)
            residuals = (inverse @ responses / numpy.diag(inverse)[:, None]).reshape(len(chords), -1, 3)
            error = numpy.log(numpy.maximum(numpy.sum(residuals**2, axis=(0, 2)), 1e-12)).mean()
            best = min(best, (error, (length, share, 0.25 * spacing)))
    return best[1]


def gaussian_process_weights(parameters, to, at):
    covariance = matern_mixture(chords_of(to, to), *parameters) + 1e-9 * numpy.eye(len(to))
    return numpy.linalg.solve(covariance, matern_mixture(chords_of(to, at), *parameters)).T


def left_out(weights_of, sources, directions):
    """Pictures of each source from all others."""
    predicted = numpy.empty_like(sources)
    for source in range(len(directions)):
        others = numpy.arange(len(directions)) != source
        weights = weights_of(directions[others], directions[source:source + 1])[0]
        predicted[source] = numpy.einsum("l,lpc->pc", weights, sources[others])
    return predicted


def check_interpolators():
    """On a plane that faces the light, lit by n·l: every method that knows linear functions is exact."""
    rng = numpy.random.default_rng(0)
    directions = numpy.column_stack([rng.uniform(-0.5, 0.5, (60, 2)), numpy.ones(60)])
    directions /= numpy.linalg.norm(directions, axis=1, keepdims=True)
    normals = numpy.array([[0.0, 0.0, 1.0], [0.3, -0.2, 0.9]])
    shading = (directions @ normals.T)[..., None].repeat(3, axis=2)
    parameters = gaussian_process(shading, directions)
    bounds = {"PTM": 0.01, "HSH 4 terms": 0.2, "Delaunay": 0.03}
    for name, weights_of in INTERPOLATORS.items() | {"refield": functools.partial(gaussian_process_weights, parameters)}.items():
        error = numpy.median(errors(left_out(weights_of, shading, directions), shading))
        if not error < bounds.get(name, 0.02):
            sys.exit(f"{name}: the error on a Lambertian plane is {error:.4f}")
    for name, weights_of in INTERPOLATORS.items():
        if name[:3] in ("RBF", "Del") and not numpy.allclose(weights_of(directions, directions), numpy.eye(60), atol=1e-6):
            sys.exit(f"{name}: is not exact at the light sources")


def print_left_out(options):
    """Leave-one-source-out errors of all interpolations; with --program, refield itself on every --every-th source."""
    check_interpolators()
    photographs, directions, mask = SETS[options.set](options.data)
    height = 128
    directions, columns, rows = texel_directions(directions, height)
    y, x = numpy.nonzero(mask)
    chosen = numpy.random.default_rng(options.seed).permutation(len(y))[:options.pixels]
    sources = numpy.array([photograph[y[chosen], x[chosen]] for photograph in photographs], float)
    print(f"{options.set}: {len(directions)} sources, {len(chosen)} pixels", flush=True)
    predictions = {name: left_out(weights_of, sources, directions) for name, weights_of in INTERPOLATORS.items()}
    parameters = gaussian_process(sources, directions)
    predictions["refield"] = left_out(functools.partial(gaussian_process_weights, parameters), sources, directions)
    for name, predicted in predictions.items():
        error = errors(predicted, sources)
        print(f"{name:22} median {numpy.median(error):.4f}  90th percentile {numpy.percentile(error, 90):.4f}", flush=True)
    print("length {:.3g}, fine share {:.3g}, fine length {:.3g}".format(*parameters))
    if not options.program:
        return
    width = min(len(chosen), 50)
    pixels = len(chosen) // width * width
    angle = math.pi / height * (numpy.cos(math.pi * rows / height) - numpy.cos(math.pi * (rows + 1) / height))
    light_folder, observed_folder = options.output / "light", options.output / "observed"
    for folder in (light_folder, observed_folder):
        folder.mkdir(parents=True, exist_ok=True)
        for old in folder.glob("*.exr"):
            old.unlink()
    for source in range(len(directions)):
        light = numpy.zeros((height, 2 * height, 3), numpy.float32)
        light[rows[source], columns[source]] = 1.0 / angle[source]
        write_image(light_folder / f"{source:04}.exr", light)
        write_image(observed_folder / f"{source:04}.exr", sources[source, :pixels].reshape(-1, width, 3).astype(numpy.float32))
    picked = numpy.arange(0, len(directions), options.every)
    field, left_out_light, shown = (options.output / name for name in ("left_out.rfield", "left_out.exr", "shown.exr"))
    left_out_photograph = options.output / "left_out_photograph.exr"
    relit = []
    for source in picked:
        name = f"{source:04}.exr"
        (light_folder / name).rename(left_out_light)
        (observed_folder / name).rename(left_out_photograph)
        field.unlink(missing_ok=True)
        subprocess.run([options.program, "--quiet", "estimate", "--light", f"{light_folder}/*.exr", "--observed", f"{observed_folder}/*.exr",
                        "--parameterisation", "lat_long", "-o", field], check=True, stdout=subprocess.DEVNULL)
        shown.unlink(missing_ok=True)
        subprocess.run([options.program, "--quiet", "relight", field, "--light", left_out_light, "-o", shown], check=True,
                       stdout=subprocess.DEVNULL)
        relit.append(read_rgb(shown).reshape(-1, 3))
        left_out_light.rename(light_folder / name)
        left_out_photograph.rename(observed_folder / name)
    truth = sources[picked, :pixels]
    print(f"{len(picked)} sources only: program {numpy.median(errors(numpy.array(relit), truth)):.4f}, "
          f"numpy {numpy.median(errors(predictions['refield'][picked, :pixels], truth)):.4f}", flush=True)


def print_truncated(options, sources, light):
    """Errors of the exact weights [sources, pixels, 3] after a truncated singular value decomposition."""
    left, values, right = numpy.linalg.svd(sources.reshape(len(sources), -1), full_matrices=False)
    for rank in map(int, options.ranks.split(",")):
        weights = ((left[:, :rank] * values[:rank]) @ right[:rank]).reshape(sources.shape)
        medians = {kind: numpy.median(errors(photograph(weights, light[kind]), photograph(sources, light[kind])))
                   for kind in light if kind != "train"}
        print(f"{options.set}, rank {rank}: " + "  ".join(f"{kind} {error:.4f}" for kind, error in medians.items()))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("set", choices=SETS)
    parser.add_argument("--data", type=pathlib.Path, required=True, help="folder of the repository's files")
    parser.add_argument("-o", "--output", type=pathlib.Path, required=True, help="folder to write")
    parser.add_argument("--program", help="refield program to measure (default: other methods only)")
    parser.add_argument("--pairs", type=int, default=200, help="training photographs (default: 200)")
    parser.add_argument("--single", action="store_true", help="train with one photograph per light source")
    parser.add_argument("--environments", type=pathlib.Path, help="folder of lat-long EXR for natural light (default: a random texture)")
    parser.add_argument("--noise", type=float, default=0.01, help="of training photographs, part of each pixel's mean (default: 0.01)")
    parser.add_argument("--seed", type=int, default=1, help="of light and noise; tests use seed + 1000 (default: 1)")
    parser.add_argument("--tests", type=int, default=24, help="test photographs of each kind (default: 24)")
    parser.add_argument("--crop", type=int, default=24, help="side of the square around the object's middle, in pixels; 0: all (default: 24)")
    parser.add_argument("--stride", type=int, default=1, help="measure every n-th pixel of every n-th row, before --crop (default: 1)")
    parser.add_argument("--keep-sources", type=int, default=0, help="use the first light sources only; 0: all (default: 0)")
    parser.add_argument("--methods", default="least squares,ridge,NNLS", help="other methods (default: all)")
    parser.add_argument("--leave-one-out", action="store_true",
                        help="print the errors of interpolation between light sources, and nothing else")
    parser.add_argument("--pixels", type=int, default=1000, help="of the mask, for --leave-one-out (default: 1000)")
    parser.add_argument("--every", type=int, default=16, help="sources that --leave-one-out leaves out of the program's field (default: each 16th)")
    parser.add_argument("--ranks", help="print the errors of exact weights truncated to these ranks, and nothing else")
    parser.add_argument("--check", type=float, help="fail if an error of refield exceeds the best other one this many times")
    parser.add_argument("--json", type=pathlib.Path, help="file for the figures")
    options = parser.parse_args()

    if options.leave_one_out:
        return print_left_out(options)
    mask, texels, sources, light, truth, noisy = build(options)
    if options.ranks:
        return print_truncated(options, sources[:, mask.reshape(-1)], light)
    write_pairs(options.output, mask, texels, light, truth, noisy)
    inside = mask.reshape(-1)
    kinds = [kind for kind in light if kind != "train"]
    figures = {}

    def report(name, error, seconds, note=""):
        figures[name] = {kind: float(numpy.median(error[kind])) for kind in kinds} | {"seconds": round(seconds, 2)}
        print(f"{name:14} " + "  ".join(f"{kind} {figures[name][kind]:.4f}" for kind in kinds) + f"  {seconds:.1f} s{note}", flush=True)

    print(f"{options.set}: {len(texels)} sources, {len(light['train'])} training photographs, {int(inside.sum())} pixels", flush=True)
    for name in filter(None, options.methods.split(",")):
        start = time.process_time()
        weights = numpy.stack([METHODS[name](light["train"][..., c], noisy[:, inside, c]) for c in range(3)], axis=2)
        error = {kind: errors(photograph(weights, light[kind]), truth[kind][:, inside]) for kind in kinds}
        report(name, error, time.process_time() - start)
    if options.program:
        field = options.output / "scene.rfield"
        start = time.monotonic()
        subprocess.run([options.program, "estimate", "--light", f"{options.output}/light/train_*.exr", "--observed",
                        f"{options.output}/observed/train_*.exr", "--mask", options.output / "mask.png", "-o", field],
                       check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        seconds = time.monotonic() - start
        error = {}
        for kind in kinds:
            shown = relight(options.program, options.output, field, kind, len(light[kind]), mask.shape)
            error[kind] = errors(shown[:, inside], truth[kind][:, inside])
        report("refield", error, seconds, f", {field.stat().st_size / 1e6:.2f} MB")
    if options.json:
        options.json.write_text(json.dumps(figures, indent=1) + "\n")
    if options.check:
        for kind in kinds:
            best = min(figures[name][kind] for name in figures if name != "refield")
            if figures["refield"][kind] > options.check * best:
                sys.exit(f"{options.set}, {kind}: the error of refield is {figures['refield'][kind]:.4f}, that of the best other method {best:.4f}")


if __name__ == "__main__":
    main()
