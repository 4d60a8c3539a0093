#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Reads files of every variant that the image formats allow (orientation × layout × depth × metadata × container),
which image_corpus.py writes, as photographs (`refield acquire import`) and as light maps (`relight`), and
compares them with values that NumPy computes. Each variant is right, or is refused with the stated message.
docs/reference/image-files.md lists them. A new kind is one line of `cases`.

usage: tests/images/image_files_test.py PROGRAM [TEXT in the names of the cases [STEP: takes every STEPth]]
"""
import concurrent.futures
import io
import itertools
import pathlib
import re
import struct
import subprocess
import sys
import tempfile
import zlib

import numpy as np

import image_corpus as corpus
from image_corpus import BAYER, PNG_CURVES, dng, encoded, exr, icc, integers, jpeg, pfm, png, rgb_channels, rgbe, tiff, turned

HEIGHT, WIDTH = 16, 32
SCENE = corpus.scene(HEIGHT, WIDTH)
FULL = 65535.0
HALF = 2.0 ** -11      # relative resolution of half floats
FLOAT = 1e-5
ACESCG = (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767)
ADOBE = (0.64, 0.33, 0.21, 0.71, 0.15, 0.06, 0.3127, 0.3290)
REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)


def case(name, files, truth=None, refused=None, note=None, tolerance=FLOAT, how="photograph", options=(), where=None, without=None):
    """`files`: {name: bytes}, the first ones in order are given. `truth` [rows × columns × 3]; `where`: of which
    samples. `refused`, `note`: a pattern that the messages have; `without`: one that they lack."""
    return dict(name=name, files=files, truth=truth, refused=refused, note=note, tolerance=tolerance, how=how,
                options=list(options), where=where, without=without)


def sites(layout, shape):
    where = np.zeros(shape + (3,), bool)
    for i, c in enumerate(BAYER[layout]):
        where[i // 2::2, i % 2::2, c] = True
    return where


def raw_cases():
    light = corpus.scene(48, 64)  # LibRaw refuses less than 22 rows
    sensor = np.round(corpus.BLACK + light * 3000).astype(np.uint16)
    truth = (sensor - corpus.BLACK) / FULL
    for layout, orientation, order in itertools.product(BAYER, range(1, 9), "<>"):
        container = "dng" if order == "<" else "tif"
        yield case(f"RAW {layout} orientation {orientation} order {order} .{container}",
                   {f"a.{container}": dng(corpus.mosaic(sensor, layout), BAYER[layout], orientation, order, iso=100)},
                   truth, where=sites(layout, light.shape[:2]))
    for height, width in itertools.product((60, 68, 100), (64, 66)):  # memory that libraries overwrote
        tall = np.full((height, width), 1000, np.uint16)
        yield case(f"RAW {height}×{width} in portrait", {"a.dng": dng(tall, orientation=6)},
                   np.full((height, width, 3), (1000 - corpus.BLACK) / FULL))
    for orientation in range(1, 9):
        yield case(f"LinearRaw orientation {orientation}", {"a.dng": dng(sensor, orientation=orientation)}, truth)
    for layout in ("grey", "bayer_rggb"):
        yield case(f"LinearRaw with --layout {layout}", {"a.dng": dng(sensor)}, truth, options=["--layout", layout])
    grey = sensor[..., 1]
    yield case("RAW of a monochrome camera", {"a.dng": dng(grey, None)}, np.repeat(truth[..., 1:2], 3, 2))
    yield case("RAW, layout given", {"a.dng": dng(corpus.mosaic(sensor, "grbg"))}, truth,
               where=sites("grbg", light.shape[:2]), options=["--layout", "bayer_grbg"])
    blacks = (200, 260, 300, 240)
    for layout in BAYER:  # a level per site
        of_sites = np.tile(np.reshape(blacks, (2, 2)), (24, 32))
        raised = (corpus.mosaic(sensor, layout) + of_sites - corpus.BLACK).astype(np.uint16)
        yield case(f"RAW {layout}, black level per site", {"a.dng": dng(raised, BAYER[layout], black=blacks, tags={50713: (3, [2, 2])})},
                   truth, where=sites(layout, light.shape[:2]))
    raised = (sensor + np.subtract(blacks[:3], corpus.BLACK)).astype(np.uint16)
    columns, rows = np.arange(64) % 7 * 9 + 3, np.arange(48) % 5 * 11
    fractions = lambda v: (10, np.stack([4 * v, np.full(len(v), 4)], -1).ravel())
    uneven = (sensor + columns[None, :, None] + rows[:, None, None]).astype(np.uint16)
    deltas = {50715: fractions(columns), 50716: fractions(rows)}
    for name, stored, where in (("RAW", corpus.mosaic(uneven, "rggb"), sites("rggb", light.shape[:2])), ("LinearRaw", uneven, None)):
        for order, tags in itertools.product("<>", (deltas, {50715: fractions(columns)})):
            shown = stored if len(tags) == 2 else (stored - (rows[:, None] if stored.ndim == 2 else rows[:, None, None])).astype(np.uint16)
            yield case(f"{name}, {len(tags)} of BlackLevelDelta, order {order}", {"a.dng": dng(shown, order=order, tags=tags)}, truth, where=where)
    lower = columns - 10  # below the common level
    for kind, order in itertools.product((1, 3, 4, 5, 8, 9, 10, 11, 12), "<>"):
        shift = columns if kind < 6 else lower
        values = np.stack([4 * shift, np.full(64, 4)], -1).ravel() if kind in (5, 10) else shift
        yield case(f"RAW, BlackLevelDelta of type {kind}, order {order}",
                   {"a.dng": dng(corpus.mosaic((sensor + shift[None, :, None]).astype(np.uint16), "rggb"), order=order, tags={50715: (kind, values)})},
                   truth, where=sites("rggb", light.shape[:2]))
    yield case("RAW, BlackLevelDelta of other columns", {"a.dng": dng(corpus.mosaic(sensor, "rggb"), tags={50715: fractions(columns[:50])})},
               refused="BlackLevelDelta.*50 rows or columns.*64")
    yield case("RAW, BlackLevelDelta of signed bytes", {"a.dng": dng(corpus.mosaic(sensor, "rggb"), tags={50715: (6, lower)})},
               refused="BlackLevelDelta. of an unknown type")
    for layout, order in itertools.product(BAYER, "<>"):
        yield case(f"RAW {layout} behind a thumbnail, order {order}", {"a.dng": corpus.dng_behind_preview(corpus.mosaic(sensor, layout), BAYER[layout], order)},
                   truth, where=sites(layout, light.shape[:2]))
    yield case("RAW behind a thumbnail, BlackLevelDelta", {"a.tif": corpus.dng_behind_preview(corpus.mosaic(sensor + columns[None, :, None].astype(np.uint16), "rggb"), tags={50715: fractions(columns)})},
               truth, where=sites("rggb", light.shape[:2]))
    for y, x in ((2, 4), (1, 1)):  # LibRaw leaves an odd row and column out, too
        masked = np.full((56, 72), 300, np.uint16)
        masked[y:y + 48, x:x + 64] = corpus.mosaic(sensor, "rggb")
        yield case(f"RAW with ActiveArea at {y}, {x}", {"a.dng": dng(masked, tags={50829: (4, [y, x, y + 48, x + 64])})},
                   truth[y % 2:, x % 2:], where=sites("rggb", light.shape[:2])[y % 2:, x % 2:])
        masked[y:y + 48, x:x + 64] = corpus.mosaic(uneven, "rggb")
        yield case(f"RAW with ActiveArea at {y}, {x}, BlackLevelDelta", {"a.dng": dng(masked, tags={50829: (4, [y, x, y + 48, x + 64]), **deltas})},
                   truth[y % 2:, x % 2:], where=sites("rggb", light.shape[:2])[y % 2:, x % 2:])
        masked[y:y + 48, x:x + 64] += (of_sites - corpus.BLACK - columns - rows[:, None]).astype(np.uint16)
        yield case(f"RAW with ActiveArea at {y}, {x}, black level per site",
                   {"a.dng": dng(masked, black=blacks, tags={50713: (3, [2, 2]), 50829: (4, [y, x, y + 48, x + 64])})},
                   truth[y % 2:, x % 2:], where=sites("rggb", light.shape[:2])[y % 2:, x % 2:])
    yield case("RAW with planes of BGR", {"a.dng": dng(corpus.mosaic(sensor, "rggb"), tags={50710: (1, [2, 1, 0])})}, refused="colour filter 'BGR'")
    yield case("RAW of staggered rows", {"a.dng": dng(corpus.mosaic(sensor, "rggb"), tags={50711: (3, 6)})}, refused="staggered")
    for name, pattern, planes in (("CMY", (3, 4, 4, 5), (3, 4, 5)), ("GMCY", (1, 4, 3, 5), (1, 4, 3, 5)), ("RGBW", (0, 1, 6, 2), (0, 1, 2, 6)),
                                  ("RGB, planes of CMY", (0, 1, 1, 2), (3, 4, 5))):
        for options in ((), ("--layout", "bayer_rggb")):
            yield case(f"RAW of {name} {' '.join(options)}", {"a.dng": dng(corpus.mosaic(sensor, "rggb"), pattern, tags={50710: (1, planes)})},
                       refused="has the colour filter '[CMYRGBW]+'", options=options)
    yield case("LinearRaw, black level per channel", {"a.dng": dng(raised, black=blacks[:3])}, truth)
    dark = {f"{t}.dng": dng(corpus.mosaic(np.round(black + light * t * 1500).astype(np.uint16), "rggb"), black=black)
            for t, black in ((1, 256), (2, 400))}
    yield case("RAW, black level differs within a bracket", dark, light * 1500 / FULL, where=sites("rggb", light.shape[:2]), tolerance=0.01,
               options=["--exposures", "1,2"], without="times as bright|contradict")
    yield case("RAW of tiles without compression", {"a.dng": dng(grey, tile=16)}, refused="tiles without compression")
    xtrans = [1, 1, 0, 1, 1, 2, 1, 1, 2, 1, 1, 0, 2, 0, 1, 0, 2, 1, 1, 1, 2, 1, 1, 0, 1, 1, 0, 1, 1, 2, 0, 2, 1, 2, 0, 1]
    yield case("RAW of X-Trans", {"a.dng": dng(grey, xtrans, period=6)}, refused="colour filter 'X-Trans'")
    yield case("RAW of X-Trans, layout given", {"a.dng": dng(grey, xtrans, period=6)}, refused="X-Trans", options=["--layout", "grey"])
    yield case("RAW of float samples", {"a.dng": dng(grey.astype(np.float32))}, refused="floating-point|by LibRaw")
    yield case("RAW of half samples", {"a.dng": dng(grey.astype(np.float16))}, refused="floating-point")
    yield case("RAW of half samples, layout given", {"a.dng": dng(grey.astype(np.float16))}, refused="floating-point", options=["--layout", "grey"])
    yield case("RAW cut off", {"a.dng": dng(corpus.mosaic(sensor, "rggb"))[:700]}, refused="LibRaw|plausible|truncated")
    yield case("RAW as a light map", {"a.tif": dng(corpus.mosaic(sensor, "rggb"))}, refused="sensor|environment map", how="map")


def tiff_cases():
    for orientation, dtype in itertools.product(range(1, 9), (np.uint8, np.uint16, np.float32)):
        bits = np.dtype(dtype).itemsize * 8
        stored = turned(SCENE, orientation)
        stored = stored.astype(dtype) if bits == 32 else integers(stored, bits)
        light = stored / (2 ** bits - 1) if bits < 32 else stored.astype(float)
        file = {"a.tif": tiff(stored, orientation=orientation)}
        upright = turned(light, {6: 8, 8: 6}.get(orientation, orientation))
        yield case(f"TIFF {bits} bits orientation {orientation}: photograph upright", file, upright, options=["--response", "linear"])
        yield case(f"TIFF {bits} bits orientation {orientation}: map upright", file,
                   upright if bits == 32 else srgb_decoded(upright), how="map")
    sixteen = integers(SCENE, 16)
    light = sixteen / FULL
    for order, planar, compression, tile, big in itertools.product("<>", (1, 2), (1, 8), (0, 16), (False, True)):
        name = f"TIFF order {order} planar {planar} compression {compression} tile {tile} {'Big' * big}"
        kinds = dict(order=order, planar=planar, compression=compression, tile=tile, big=big)
        yield case(name, {"a.tif": tiff(sixteen, **kinds)}, light)
        yield case(name + " float", {"a.tif": tiff(SCENE.astype(np.float32), **kinds)}, SCENE, how="map")
    for dtype in (np.float16, np.float64):
        yield case(f"TIFF {np.dtype(dtype).name}", {"a.tif": tiff(SCENE.astype(dtype))}, SCENE, tolerance=HALF)
    grey = np.repeat(light[..., :1], 3, 2)
    yield case("TIFF grey", {"a.tif": tiff(sixteen[..., :1])}, grey)
    for how in ("photograph", "map"):
        yield case(f"TIFF grey, 0 is white: {how}", {"a.tif": tiff(65535 - sixteen[..., :1], grey_is_white=True)},
                   refused="white as zero", how=how)
    def of_pages(first, second):
        """Of tiff(): the second follows, its offsets moved."""
        moved = bytearray(second[8:])
        count = struct.unpack("<H", second[8:10])[0]
        shift = len(first) - 8
        for at in range(2, 2 + 12 * count, 12):
            tag, kind, number, value = struct.unpack("<HHII", moved[at:at + 12])
            if tag == 273 or number * {3: 2, 4: 4}.get(kind, 4) > 4:
                struct.pack_into("<I", moved, at + 8, value + shift)
        first = bytearray(first)
        end = 10 + 12 * struct.unpack("<H", first[8:10])[0]
        struct.pack_into("<I", first, end, len(first))
        return bytes(first) + bytes(moved)
    page = tiff(sixteen[..., :1])
    for how in ("photograph", "map"):
        yield case(f"TIFF of 32-bit integers: {how}", {"a.tif": tiff(sixteen.astype(np.uint32))}, refused="integer samples of neither", how=how)
        yield case(f"TIFF of CMYK: {how}", {"a.tif": tiff(np.concatenate([sixteen, sixteen[..., :1]], -1), tags={262: (3, 5)})}, refused="CMYK", how=how)
        yield case(f"TIFF of five channels: {how}", {"a.tif": tiff(np.concatenate([sixteen, sixteen[..., :2]], -1), tags={338: (3, [0, 0])})},
                   refused="5 channels", how=how)
        yield case(f"TIFF of channels as pages: {how}", {"a.tif": of_pages(page, page)}, refused="several images", how=how)
        yield case(f"TIFF and its thumbnail: {how}", {"a.tif": of_pages(tiff(sixteen), tiff(sixteen[::2, ::2], tags={254: (4, 1)}))},
                   light if how == "photograph" else srgb_decoded(light), how=how)
        yield case(f"TIFF without BitsPerSample: {how}", {"a.tif": tiff(sixteen[..., :1]).replace(struct.pack("<HH", 258, 3), struct.pack("<HH", 257, 3), 1)},
                   refused="no number of bits", how=how)
        ramp = [v for k in range(3) for v in (0, 1, 65535, 1)]
        studio = [v for low, high in ((16, 235), (128, 240), (128, 240)) for v in (low * 257, 1, high * 257, 1)]
        as_read = light if how == "photograph" else srgb_decoded(light)
        yield case(f"TIFF with ReferenceBlackWhite of the full range: {how}", {"a.tif": tiff(sixteen, tags={532: (5, ramp)})}, as_read, how=how)
        yield case(f"TIFF with ReferenceBlackWhite of less: {how}", {"a.tif": tiff(sixteen, tags={532: (5, studio)})},
                   refused="ReferenceBlackWhite", how=how)
        chroma = {258: (3, [8, 8, 8]), 262: (3, 6), 530: (3, [1, 1]), 532: (5, [n for v in (15, 235, 128, 240, 128, 240) for n in (v, 1)])}
        grey_levels = np.linspace(15, 235, 32).astype(np.uint8)[None, :, None].repeat(16, 0)
        stored = np.concatenate([grey_levels, np.full((16, 32, 2), 128, np.uint8)], -1)
        yield case(f"TIFF of chroma with ReferenceBlackWhite: {how}", {"a.tif": tiff(stored, tags=chroma)},
                   srgb_decoded((grey_levels.astype(float) - 15) / 220).repeat(3, 2), tolerance=0.06, how=how)
        yield case(f"TIFF of double in tiles: {how}", {"a.tif": tiff(SCENE, tile=16)}, refused="64-bit samples", how=how)
        yield case(f"TIFF with GrayResponseCurve: {how}", {"a.tif": tiff(sixteen[..., :1], tags={290: (3, 3), 291: (3, list(range(0, 65536, 256)))})},
                   refused="states an encoding", how=how)
        yield case(f"TIFF with TransferFunction: {how}", {"a.tif": tiff(sixteen, tags={301: (3, list(range(0, 65536, 256)))})},
                   refused="states an encoding", how=how)
    for curve, how in itertools.product(("srgb", "1.8"), ("photograph", "map")):
        profile = icc(curve)
        yield case(f"TIFF float with ICC profile {curve}: {how}", {"a.tif": tiff(encoded(SCENE, curve, "").astype(np.float32), icc=profile)},
                   SCENE, tolerance=1e-3, how=how)
        of_grey = {"a.tif": tiff(integers(encoded(SCENE[..., :1], curve, ""), 16), icc=icc(curve, b"kTRC"))}
        yield case(f"TIFF grey with grey ICC profile {curve}: {how}", of_grey, np.repeat(SCENE[..., :1], 3, 2), tolerance=4e-3, how=how)
    for how in ("photograph", "map"):
        yield case(f"TIFF with a profile of tables: {how}", {"a.tif": tiff(sixteen, icc=icc("srgb", b"A2B0"))}, refused="states an encoding", how=how)
        yield case(f"TIFF float with a profile of tables: {how}", {"a.tif": tiff(SCENE.astype(np.float32), icc=icc("srgb", b"A2B0"))},
                   refused="states an encoding", how=how)
        yield case(f"TIFF that begins with a thumbnail: {how}", {"a.tif": tiff(sixteen, tags={254: (4, 1)})}, refused="thumbnail", how=how)
        yield case(f"TIFF of LogLuv: {how}", {"a.tif": tiff(sixteen, tags={262: (3, 32845)})}, refused="LogLuv", how=how)
    yield case("TIFF, ICC profile of another curve: map", {"a.tif": tiff(sixteen, icc=icc("odd"))}, refused="states an encoding", how="map")
    for curve, bits in itertools.product(("linear", "srgb", "table", "1.8", "table of 2"), (8, 16)):
        stored = integers(encoded(SCENE, curve, ""), bits)
        yield case(f"TIFF {bits} bits, ICC profile {curve}", {"a.tif": tiff(stored, icc=icc(curve))}, SCENE,
                   tolerance=0.08 if bits == 8 else 4e-3)
    yield case("TIFF 16 bits, ICC profile of another curve", {"a.tif": tiff(sixteen, icc=icc("odd"))}, refused="states an encoding.*--response")
    fractions = lambda xy: (5, [n for v in xy for n in (round(v * 1e4), 10000)])
    yield case("TIFF PrimaryChromaticities of Adobe RGB: map", {"a.tif": tiff(SCENE.astype(np.float32), tags={318: fractions(ADOBE[6:]), 319: fractions(ADOBE[:6])})},
               np.maximum(SCENE @ REC709_FROM_ADOBE.T, 0), tolerance=1e-3, how="map", note="primaries.*converted")
    yield case("TIFF with '?' in its name", {"a?b=1.tif": tiff(sixteen)}, light)


def png_cases():
    for curve, bits, how in itertools.product(PNG_CURVES, (8, 16), ("photograph", "map")):
        default = "linear" if bits == 16 and how == "photograph" else "sRGB"
        stored = integers(encoded(SCENE, curve, default), bits)
        yield case(f"PNG {bits} bits, {curve}: {how}", {"a.png": png(stored, PNG_CURVES[curve])}, SCENE,
                   tolerance=0.08 if bits == 8 else 4e-3, how=how)
    for orientation in (3, 6):
        stored = integers(turned(SCENE, orientation), 16)
        file = {"a.png": png(stored, [(b"eXIf", corpus.exif_block(orientation))])}
        yield case(f"PNG eXIf orientation {orientation}: photograph upright", file, integers(SCENE, 16) / FULL)
        yield case(f"PNG eXIf orientation {orientation}: map upright", file, srgb_decoded(integers(SCENE, 16) / FULL), how="map")
    for how in ("photograph", "map"):
        yield case(f"PNG cICP of PQ: {how}", {"a.png": png(integers(SCENE, 16), [(b"cICP", bytes([9, 16, 0, 1]))])}, refused="states an encoding", how=how)
        yield case(f"PNG cICP of studio range: {how}", {"a.png": png(integers(SCENE, 16), [(b"cICP", bytes([1, 13, 0, 0]))])}, refused="not the full range", how=how)
        yield case(f"PNG gAMA of zero: {how}", {"a.png": png(integers(SCENE, 16), [(b"gAMA", bytes(4))])},
                   integers(SCENE, 16) / FULL if how == "photograph" else srgb_decoded(integers(SCENE, 16) / FULL), how=how)
    linear = integers(SCENE, 16)
    adobe = np.maximum(linear / FULL @ REC709_FROM_ADOBE.T, 0)
    chrm = struct.pack(">8I", *(round(v * 1e5) for v in ADOBE[6:] + ADOBE[:6]))
    for name, chunks in (("cHRM", [(b"gAMA", struct.pack(">I", 100000)), (b"cHRM", chrm)]),
                         ("iCCP", [(b"iCCP", b"p\0\0" + zlib.compress(icc("linear", colorants=corpus.ADOBE_RGB)))])):
        yield case(f"PNG {name} of Adobe RGB: map", {"a.png": png(linear, chunks)}, adobe, tolerance=2e-2, how="map", note="primaries.*converted")
        yield case(f"PNG {name} of Adobe RGB: photograph", {"a.png": png(linear, chunks)}, linear / FULL)
    yield case("PNG cICP of BT.2020: map", {"a.png": png(linear, [(b"cICP", bytes([9, 8, 0, 1]))])}, np.maximum(linear / FULL @ REC709_FROM_2020.T, 0),
               tolerance=1e-3, how="map", note="primaries.*converted")
    grey = integers(SCENE[..., :1], 8)
    yield case("PNG grey", {"a.png": png(grey)}, np.repeat(srgb_decoded(grey / 255), 3, 2))
    few = (integers(SCENE, 8) // 64 * 64).astype(np.uint8)
    yield case("PNG palette", {"a.png": png(few, palette=True)}, srgb_decoded(few / 255), how="map")
    alpha = np.concatenate([few, np.full(few.shape[:2] + (1,), 128, np.uint8)], -1)
    yield case("PNG alpha: photograph without", {"a.png": png(alpha)}, srgb_decoded(few / 255))
    yield case("PNG alpha: map multiplied", {"a.png": png(alpha)}, srgb_decoded(few / 255) * 128 / 255, how="map")


def jpeg_cases():
    try:
        import PIL.Image
    except ImportError:
        print("SKIPPED JPEG: Pillow (python3-pil) is not there")
        return
    flat = np.repeat(np.repeat(corpus.scene(2, 4), 8, 0), 8, 1)  # blocks of one colour survive JPEG
    for orientation in range(1, 9):
        stored = np.ascontiguousarray(integers(corpus.to_srgb(turned(flat, orientation)), 8))
        file = {"a.jpg": jpeg(stored, orientation)}
        yield case(f"JPEG orientation {orientation}: photograph upright", file, flat, tolerance=0.08)
        yield case(f"JPEG orientation {orientation}: map upright", file, flat, tolerance=0.08, how="map")
    inks = io.BytesIO()
    PIL.Image.fromarray(integers(flat, 8)).convert("CMYK").save(inks, "JPEG")
    for how in ("photograph", "map"):
        yield case(f"JPEG of CMYK: {how}", {"a.jpg": inks.getvalue()}, refused="CMYK", how=how)
    plain = jpeg(integers(corpus.to_srgb(flat), 8))
    for how in ("photograph", "map"):
        yield case(f"JPEG of studio range: {how}", {"a.jpg": plain[:2] + b"\xff\xfe\0\x0cCS=ITU601\0" + plain[2:]}, refused="not the full range", how=how)
    for curve in ("srgb", "1.8", "linear"):
        stored = integers(encoded(flat, curve, ""), 8)
        yield case(f"JPEG, ICC profile {curve}", {"a.jpg": jpeg(stored, profile=icc(curve))}, flat, tolerance=0.08, how="map")
    profile, stored = icc("1.8"), jpeg(integers(encoded(flat, "1.8", ""), 8))
    parts = [b"\xff\xe2" + struct.pack(">H", len(part) + 16) + b"ICC_PROFILE\0" + bytes([i + 1, 3]) + part
             for i, part in enumerate((profile[:90], profile[90:150], profile[150:]))]
    for order in itertools.permutations(range(3)):
        yield case(f"JPEG, parts {order} of an ICC profile", {"a.jpg": stored[:2] + b"".join(parts[i] for i in order) + stored[2:]}, flat,
                   tolerance=0.08, how="map")


def radiance_cases():
    runs = SCENE.copy()
    runs[:, 5:20] = runs[:, 5:6]
    runs[3] = 0
    for orientation, coding in itertools.product(range(1, 9), ("new", "old", "flat")):
        file, values = rgbe(runs, orientation, coding)
        for how in ("photograph", "map"):
            yield case(f"Radiance orientation {orientation} coding {coding}: {how}", {"a.hdr": file}, values, how=how)
    for name, header, divisor in (("EXPOSURE", ["EXPOSURE=2"], 2), ("two of EXPOSURE", ["EXPOSURE=2", "EXPOSURE= 0.125"], 0.25),
                                  ("COLORCORR", ["COLORCORR=1 2 4", "EXPOSURE=0.5"], np.array([0.5, 1, 2])),
                                  ("PRIMARIES of Radiance", ["PRIMARIES=.64 .33 .29 .6 .15 .06 .3333 .3333"], 1),
                                  ("line feeds of DOS", ["SOFTWARE=x\r"], 1)):
        file, values = rgbe(runs, header=header)
        for how in ("photograph", "map"):
            yield case(f"Radiance {name}: {how}", {"a.hdr": file}, values / divisor, how=how)
    file, values = rgbe(SCENE @ XYZ_FROM_REC709.T, kind="xyze")
    yield case("Radiance XYZE", {"a.hdr": file}, values @ np.linalg.inv(XYZ_FROM_REC709).T, tolerance=1e-4, how="map")
    yield case("Radiance PRIMARIES of ACEScg", {"a.hdr": rgbe(SCENE, header=["PRIMARIES=" + " ".join(map(str, ACESCG))])[0]},
               np.maximum(rgbe(SCENE)[1] @ REC709_FROM_ACESCG.T, 0), tolerance=1e-3, how="map", note="primaries.*converted")
    for how in ("photograph", "map"):
        yield case(f"Radiance GAMMA: {how}", {"a.hdr": rgbe(SCENE, header=["GAMMA=2.2"])[0]}, refused="GAMMA=2.2", how=how)
        yield case(f"Radiance GAMMA of 1: {how}", {"a.hdr": rgbe(SCENE, header=["GAMMA=1.0"])[0]}, rgbe(SCENE)[1], how=how)
    yield case("Radiance FORMAT behind a blank", {"a.hdr": rgbe(SCENE)[0].replace(b"FORMAT=", b"FORMAT= ")}, rgbe(SCENE)[1])
    wide = np.tile(SCENE, (1, 40, 1))
    file, values = rgbe(np.where(wide > 2, wide, 0.5), coding="old")
    yield case("Radiance old run lengths of more than 255", {"a.hdr": file}, values)
    narrow, values = rgbe(SCENE[:, :6], coding="flat")
    yield case("Radiance of 6 columns", {"a.hdr": narrow}, values)
    file, _ = rgbe(SCENE)
    yield case("Radiance EXPOSURE of zero", {"a.hdr": rgbe(SCENE, header=["EXPOSURE=0"])[0]}, refused="EXPOSURE=0.*not above zero")
    yield case("Radiance cut off", {"a.hdr": file[:-5]}, refused="damaged or truncated")
    yield case("Radiance of unknown pixels", {"a.hdr": file.replace(b"32-bit_rle_rgbe", b"32-bit_rle_cmyk")}, refused="pixels of the kind")


def exr_cases():
    for dtype, compression, tile, window in itertools.product((np.float16, np.float32), (0, 3), (0, 8), ((0, 0), (-3, 5))):
        file = {"a.exr": exr(rgb_channels(SCENE, dtype), compression=compression, tile=tile, window=window)}
        yield case(f"EXR {np.dtype(dtype).name} compression {compression} tile {tile} window {window}", file, SCENE, tolerance=HALF)
    bright = SCENE * 50
    yield case("EXR above 1: no saturation", {"a.exr": exr(rgb_channels(bright))}, bright)
    yield case("EXR of Y", {"a.exr": exr({"Y": SCENE[..., 0].astype(np.float32)})}, np.repeat(SCENE[..., :1], 3, 2), how="map")
    named = lambda *names: {n: SCENE[..., c].astype(np.float32) for c, n in enumerate(names)}
    for names, how in itertools.product((("X", "Y", "Z"), ("N.X", "N.Y", "N.Z"), ("RY", "Y", "BY")), ("photograph", "map")):
        yield case(f"EXR of {', '.join(names)}: {how}", {"a.exr": exr(named(*names))}, refused="has no colour", how=how)
    yield case("EXR of a layer and normals", {"a.exr": exr({**named("V.Combined.R", "V.Combined.G", "V.Combined.B"), **named("V.N.X", "V.N.Y", "V.N.Z")})},
               SCENE, how="map")
    yield case("EXR of uint", {"a.exr": exr(rgb_channels(SCENE * 1000, np.uint32))}, refused="whole numbers", how="map")
    numbers = {**rgb_channels(SCENE), "object.id": np.ones(SCENE.shape[:2], np.uint32)}
    yield case("EXR with a uint channel beside R, G, B", {"a.exr": exr(numbers)}, SCENE, how="map")
    yield case("EXR of lat-long (envmap)", {"a.exr": exr(rgb_channels(SCENE), [corpus.envmap(0)])}, SCENE, how="map")
    for name, xy, truth, note in (("Rec.709", REC709, SCENE, None), ("ACEScg", ACESCG, np.maximum(SCENE @ REC709_FROM_ACESCG.T, 0), "primaries.*converted")):
        yield case(f"EXR chromaticities of {name}", {"a.exr": exr(rgb_channels(SCENE), [corpus.chromaticities(xy)])}, truth,
                   tolerance=1e-3, how="map", note=note)
    radiance = lambda d: 1 + np.stack([d[..., 0], d[..., 1], d[..., 2]], -1) / np.linalg.norm(d, axis=-1, keepdims=True)
    faces = corpus.openexr_cube(radiance, 4)
    mirrored = lambda d: radiance(d * [-1, 1, 1])  # axes of refield are left-handed
    for tile, dtype in itertools.product((0, 4), (np.float16, np.float32)):
        yield case(f"EXR of a cube (envmap) tile {tile} {np.dtype(dtype).name}",
                   {"a.exr": exr(rgb_channels(faces, dtype), [corpus.envmap(1)], tile=tile)}, refield_cube(mirrored, 4), tolerance=HALF, how="cube")
    cube = refield_cube(mirrored, 4)
    for tile in (0, 4):
        yield case(f"EXR of a cube without attribute, tile {tile}", {"a.exr": exr(rgb_channels(cube), tile=tile)}, cube, how="cube")
    yield case("EXR whose envmap contradicts its size", {"a.exr": exr(rgb_channels(SCENE), [corpus.envmap(1)])}, refused="envmap", how="map")
    for order in "<>":
        yield case(f"PFM order {order}", {"a.pfm": pfm(SCENE, order)}, SCENE, how="map")
    yield case("PFM grey", {"a.pfm": pfm(SCENE[..., 0])}, np.repeat(SCENE[..., :1], 3, 2), how="map")


def setting_cases():
    """Two photographs of a bracket or dome that differ in one setting, in every container that states it."""
    sensor = corpus.mosaic(np.round(corpus.BLACK + corpus.scene(48, 64) * 3000).astype(np.uint16), "rggb")
    sixteen = integers(SCENE / 4, 16)
    containers = {"dng": lambda **s: dng(sensor, **s), "tif": lambda **s: tiff(sixteen, **s),
                  "png": lambda **s: png(sixteen, [(b"eXIf", corpus.exif_block(**s))]),
                  "jpg": lambda **s: jpeg((sixteen // 256).astype(np.uint8), **s)}
    try:
        import PIL  # noqa: F401
    except ImportError:
        del containers["jpg"]
    for setting, values, text in (("iso", (100, 200), "ISO speed 200.*100"), ("f_number", (8, 11), "aperture f/ ?11.*8"),
                                  ("focal", (50, 70), "focal length.*70.*50"), ("white_balance", (0, 1), "WhiteBalance 1.*0"),
                                  ("light_source", (1, 3), "LightSource.*3.*1"), ("orientation", (1, 3), "Orientation 3.*1"),
                                  ("digital_zoom", (0, 2), "DigitalZoomRatio 2.*1")):
        for container, write in containers.items():
            files = {f"{i}.{container}": write(seconds=0.01, **{setting: value}) for i, value in enumerate(values)}
            of_development = setting in ("white_balance", "light_source", "orientation", "digital_zoom")
            yield case(f"{setting} differs, {container}", files, how="dome",
                       **({"truth": True} if container == "dng" and of_development else {"refused": text}))
    # EXIF 2.3: 65535 where ISOSpeed or another kind of sensitivity tells more; logarithms to base 2; a signed fraction.
    for name, first, second, text in (("ISOSpeed", {34855: (3, 65535), 34867: (4, 102400)}, {34855: (3, 65535), 34867: (4, 204800)}, "ISO speed 2.048e"),
                                      ("RecommendedExposureIndex", {34866: (4, 400)}, {34866: (4, 800)}, "ISO speed 800.*400"),
                                      ("ApertureValue", {37378: (5, [4, 1])}, {37378: (5, [6, 1])}, "aperture f/ ?8.*4")):
        files = {f"{i}.tif": tiff(sixteen, seconds=0.01, more=tags) for i, tags in enumerate((first, second))}
        yield case(f"{name} differs", files, how="dome", refused=text)
    files = {f"{i}.tif": tiff(integers(SCENE / 4 * 4.0 ** i, 16), more={37377: (10, [1 - 2 * i, 1])}) for i in range(2)}
    yield case("exposure time from ShutterSpeedValue", files, SCENE / 2, options=["--bracket-size", "2"], tolerance=0.01)
    for setting, value in (("iso", 100), ("f_number", 8)):
        for container, write in containers.items():
            yield case(f"{setting} is equal, {container}",
                       {f"{i}.{container}": write(seconds=0.01, **{setting: value}) for i in range(2)}, truth=True, how="dome")
    neutrals = {f"{i}.dng": dng(sensor, neutral=n, seconds=0.01) for i, n in enumerate(((1, 1, 1), (0.4, 1, 0.7)))}
    yield case("white balance of RAW files differs", neutrals, truth=True, how="dome")
    for container, write in containers.items():
        yield case(f"automatic white balance is noted, {container}", {f"{i}.{container}": write(seconds=0.01, white_balance=0) for i in range(2)},
                   truth=True, how="dome", **({} if container == "dng" else {"note": "automatic white balance"}))
    depths = {"0.tif": tiff(sixteen, seconds=0.01), "1.tif": tiff((sixteen // 257).astype(np.uint8), seconds=0.01)}
    yield case("depth differs where no encoding is stated", depths, how="dome", refused="depth in bits of 8.*16")
    curves = {"0.png": png(sixteen), "1.png": png(sixteen, PNG_CURVES["sRGB"])}
    yield case("encoding differs in a bracket", curves, refused="another encoding", options=["--exposures", "1,2"])


def saturation_cases():
    """Brackets that clip below the level that the files state."""
    times = (1, 4, 16)

    def bracket(full, write, noise=0):
        random = np.random.default_rng(7)
        light = corpus.scene(96, 128) * np.linspace(0.02, 1, 128)[None, :, None]
        shots = [np.minimum(light * t / 4 * full + noise * random.standard_normal(light.shape), full) for t in times]
        return light / 4, {f"{t:02}.{write[0]}": write[1](shot) for t, shot in zip(times, shots)}
    options = ["--exposures", ",".join(map(str, times))]
    sixteen = lambda shot: np.round(np.maximum(shot, 0)).astype(np.uint16)
    for bits in (10, 12, 14):
        full = 2 ** bits - 1
        light, files = bracket(full, ("tif", lambda s: tiff(sixteen(s))), noise=0.3)
        yield case(f"{bits} bits in TIFF of 16", files, light * full / FULL, tolerance=0.08 if bits == 10 else 0.04, options=options, note=f"level {full}")
    for full in (16372, 16383, 15311):
        light, files = bracket(full, ("png", lambda s: png(sixteen(s))), noise=3)
        yield case(f"PNG that clips at {full}", files, light * full / FULL, tolerance=0.02, options=options, note=f"level {full}")
        for layout in BAYER:
            light, files = bracket(full - 800, ("dng", lambda s: dng(corpus.mosaic(sixteen(s + 800), layout), BAYER[layout], black=800, white=17220)), noise=3)
            yield case(f"RAW {layout}, white level 17220, clips at {full}", files, light * (full - 800) / FULL, tolerance=0.02,
                       options=options, note=f"level {full}", where=sites(layout, light.shape[:2]))
            one = dict(list(files.items())[-1:])
            yield case(f"RAW {layout}, one exposure, clips at {full}", one, light * (full - 800) / FULL * 16, tolerance=0.02,
                       options=["--exposures", "1"], note=f"level {full}", where=sites(layout, light.shape[:2]) & (light * 16 < 0.97))
    light, files = bracket(1.0, ("exr", lambda s: exr(rgb_channels(s))))
    yield case("EXR clipped at 1", files, light, tolerance=0.02, options=options, note="level 1")
    light, files = bracket(1e9, ("exr", lambda s: exr(rgb_channels(s))))
    yield case("EXR that clips nowhere in the bracket", {k: exr(rgb_channels(light * t)) for k, t in zip(files, times)}, light, options=options)
    flat = np.full((64, 64, 3), 20000, np.uint16)
    flat[:32] = 5000
    yield case("a flat surface without noise is no saturation", {"a.tif": tiff(flat)}, flat / FULL)


# ── running ──

def srgb_decoded(x):
    return np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)


def xyz_from_rgb(xy):
    columns = np.array([[x / y, 1, (1 - x - y) / y] for x, y in zip(xy[::2], xy[1::2])]).T
    return columns[:, :3] * np.linalg.solve(columns[:, :3], columns[:, 3])


def adapted(source, target):
    """Bradford."""
    white = lambda xy: np.array([xy[6] / xy[7], 1, (1 - xy[6] - xy[7]) / xy[7]])
    cones = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
    gain = np.diag(cones @ white(target) / (cones @ white(source)))
    return np.linalg.inv(xyz_from_rgb(target)) @ np.linalg.inv(cones) @ gain @ cones @ xyz_from_rgb(source)


XYZ_FROM_REC709 = xyz_from_rgb(REC709)
REC709_FROM_ACESCG = adapted(ACESCG, REC709)
REC709_FROM_ADOBE = adapted(ADOBE, REC709)
REC709_FROM_2020 = adapted((0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290), REC709)


def refield_cube(radiance, size):
    """Six faces in the layout of docs/reference/conventions.md: what someone inside sees, upright, up from +Z with −Z
    at the top edge, down with +Z at the top edge."""
    p = (np.arange(size) + 0.5) / size * 2 - 1
    v, u = np.meshgrid(-p, p, indexing="ij")
    axes = [((0, 0, -1), (0, 1, 0), (1, 0, 0)), ((0, 0, 1), (0, 1, 0), (-1, 0, 0)), ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
            ((1, 0, 0), (0, 0, 1), (0, -1, 0)), ((1, 0, 0), (0, 1, 0), (0, 0, 1)), ((-1, 0, 0), (0, 1, 0), (0, 0, -1))]
    return np.concatenate([radiance(u[..., None] * np.array(right) + v[..., None] * np.array(up) + np.array(ahead))
                           for right, up, ahead in axes])


def judge(item, program, folder):
    """None where the case is right, else what is wrong."""
    folder.mkdir()
    for name, data in item["files"].items():
        (folder / name).write_bytes(data)
    files, out = [str(folder / name) for name in item["files"]], str(folder / "out.exr")
    if item["how"] == "photograph":
        options = item["options"] if {"--exposures", "--bracket-size"} & set(item["options"]) else item["options"] + ["--exposures", "1"]
        command = ["acquire", "import", *files, "-o", out, *options]
    elif item["how"] == "dome":
        (folder / "dome.lp").write_text(f"{len(files)}\n" + "".join(f"{pathlib.Path(f).name} {k * 0.3} 0.1 0.9\n" for k, f in enumerate(files)))
        out = str(folder / "session")
        command = ["acquire", "import", *files, "--light-sources", str(folder / "dome.lp"), "-o", out]
    else:
        size, kind = ((24, 4), "cube") if item["how"] == "cube" else (item["truth"].shape[:2] if item["truth"] is not None else (HEIGHT, WIDTH), "lat_long")
        corpus.write_identity_field(folder / "identity.rfield", *size, kind)
        command = ["relight", str(folder / "identity.rfield"), "--env", files[0], "-o", out]
    ran = subprocess.run([program, *command], capture_output=True, text=True, errors="replace", timeout=600)
    text = ran.stdout + ran.stderr
    if item["refused"]:
        if ran.returncode != 2 or not re.search(item["refused"], text, re.S):
            return f"exit {ran.returncode}, expected a refusal with '{item['refused']}': {text.strip()[:300]}"
        return None
    if ran.returncode != 0:
        return f"exit {ran.returncode}: {text.strip()[:300]}"
    if item["note"] and not re.search(item["note"], text, re.S):
        return f"lacks the note '{item['note']}': {text.strip()[:300]}"
    if item["without"] and re.search(item["without"], text, re.S):
        return f"has a note like '{item['without']}': {text.strip()[:300]}"
    if item["how"] == "dome":
        return None
    channels = corpus.read_exr(out)
    read = np.stack([channels[c] for c in "RGB"], -1).astype(float)
    if read.shape != item["truth"].shape:
        return f"is {read.shape}, expected {item['truth'].shape}"
    error = np.abs(read - item["truth"]) / np.maximum(np.abs(item["truth"]), 1e-2 * np.abs(item["truth"]).max())
    if item["where"] is not None:
        error = error[item["where"]]
    # Of brackets, noise leaves some samples off by more.
    worst = np.quantile(error, 0.99) if len(item["files"]) > 1 else error.max()
    return None if worst <= item["tolerance"] else f"differs by {worst:.2e} of the value, tolerance {item['tolerance']:.1e}"


def main():
    program = str(pathlib.Path(sys.argv[1]).resolve())
    wanted = sys.argv[2] if len(sys.argv) > 2 else ""
    step = int(sys.argv[3]) if len(sys.argv) > 3 else 1
    groups = (raw_cases, tiff_cases, png_cases, jpeg_cases, radiance_cases, exr_cases, setting_cases, saturation_cases)
    items = [item for group in groups for item in group() if wanted in item["name"]][::step]
    with tempfile.TemporaryDirectory() as work, concurrent.futures.ThreadPoolExecutor(2) as pool:
        wrong = 0
        results = pool.map(lambda k: judge(items[k], program, pathlib.Path(work) / str(k)), range(len(items)))
        for item, result in zip(items, results):
            if result:
                wrong += 1
                print(f"{item['name']}: {result}", flush=True)
    print(f"{len(items)} variants, {wrong} wrong")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
