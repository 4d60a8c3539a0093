#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Measures the models of polynomial relighting viewers on a session of a monitor, beside refield's fields.

    PYTHONPATH=build/release/python bench/studies/polynomial.py SESSION --truth TRUTH/transport.rfield

A pixel's response to light from direction d is a sum of K functions of d: biquadratic polynomials (PTM, Malzbender et al.
2001) or hemispherical harmonics about the monitor's normal (HSH, Gautron et al. 2004). The coefficients of each pixel and
channel are fitted by least squares to the session's photographs under patterns, whose lights are sums of directions. Held-out
lights are compared with exact pictures, as by `refield compare --truth`. Prints a line of JSON per model: relative RMSE of the
whole picture and of the median pixel for natural lights and bars, bytes per pixel (32-bit floats, as refield-studies counts
them) and milliseconds per picture. Needs numpy, scipy and the Python module.
"""
import argparse
import json
import re
import time

import numpy
import real_sets
import refield


def directions_of(session):
    """Unit vectors [texels, 3] from the centre of the scene to the monitor's texels; z is its normal."""
    size = re.search(r"(\d+)x(\d+)@(\d+)", refield.Field.load(options.truth).monitors[0])
    width, height, distance = (float(value) for value in size.groups())
    rows, columns = session.light_shape[:2]
    x = ((numpy.arange(columns) + 0.5) / columns - 0.5) * width
    y = (0.5 - (numpy.arange(rows) + 0.5) / rows) * height
    vectors = numpy.stack([*numpy.meshgrid(x, y), numpy.full((rows, columns), distance)], axis=-1).reshape(-1, 3)
    return vectors / numpy.linalg.norm(vectors, axis=1, keepdims=True)


def relative_rmse(predicted, exact):
    squares, power = numpy.square(predicted - exact).sum(axis=(0, 2)), numpy.square(exact).sum(axis=(0, 2))
    lit = power > 0
    return float(numpy.sqrt(squares.sum() / power.sum())), float(numpy.median(numpy.sqrt(squares[lit] / power[lit])))


parser = argparse.ArgumentParser()
parser.add_argument("session")
parser.add_argument("--truth", required=True)
options = parser.parse_args()
session = refield.Session(options.session)
exact = refield.Field.load(options.truth)
directions = directions_of(session)
patterns = [frame for frame in session.train if frame.kind != "primary"]
lights = numpy.stack([frame.light() for frame in patterns]).reshape(len(patterns), -1, 3)
observed = numpy.stack([frame.observed() for frame in patterns]).reshape(len(patterns), -1, 3)
tests = {kind: numpy.stack([frame.light() for frame in session.test if frame.kind == kind]) for kind in ("natural", "bar")}
models = {"ptm": real_sets.ptm_terms(directions)}
models |= {f"hsh{order * order}": real_sets.hsh_terms(directions, order) for order in (2, 3, 4, 5)}
for name, functions in models.items():
    projected = numpy.einsum("jtc,tk->jkc", lights, functions)
    coefficients = numpy.stack([numpy.linalg.lstsq(projected[..., c], observed[..., c], rcond=None)[0] for c in range(3)], axis=-1)
    line = {"model": name, "bytes_per_pixel": 12 * functions.shape[1]}
    for kind, maps in tests.items():
        sums = numpy.einsum("jtc,tk->jkc", maps.reshape(len(maps), -1, 3), functions)
        begun = time.perf_counter()
        pictures = numpy.stack([numpy.maximum(sum(sums[j, k] * coefficients[k] for k in range(len(coefficients))), 0) for j in range(len(maps))])
        line["ms"] = round(1000 * (time.perf_counter() - begun) / len(maps), 2)
        line[kind], line[kind + "_median"] = relative_rmse(pictures, exact.relight(maps).reshape(len(maps), -1, 3))
    print(json.dumps(line))
