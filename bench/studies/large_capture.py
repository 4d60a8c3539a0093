#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Makes a large capture or field from a small one, to measure how the program scales.

    refield simulate datasets_synthetic/tabletop/recipe.toml -o base --size 240x160 --train 200 \\
      --half --transport never --noise 0.005
    bench/studies/large_capture.py base --size 6000x4000 -o large

    refield estimate base --mode fast -o base.rfield
    bench/studies/large_capture.py base.rfield --size 6000x4000 -o large.rfield

The picture is repeated in both directions, every second copy mirrored, so that there are no seams. Copies have
the same transport, noise and kernels. The light maps of a session are linked, its photographs are
written as half-float EXR (zip). They compress better than photographs: repeated rows take 7 % of their
144 MB. The field is written row by row, without the checksums of refield's own files.
Needs numpy, h5py and the Python module of OpenImageIO.
"""
import argparse
import os
import pathlib
import re
import sys

import numpy


def copies(length, base):
    """Where each of `length` pixels comes from: base pixels there and back, again and again."""
    place = numpy.arange(length) % (2 * base)
    return numpy.where(place < base, place, 2 * base - 1 - place)


def tile_photograph(source, target, width, height):
    import OpenImageIO as oiio
    image = oiio.ImageBuf(str(source))
    pixels = image.get_pixels(oiio.HALF)
    if pixels is None:
        sys.exit(f"{source}: {image.geterror()}")
    spec = oiio.ImageSpec(width, height, pixels.shape[2], "half")
    spec.attribute("compression", "zip:1")
    output = oiio.ImageOutput.create(str(target))
    if not output or not output.open(str(target), spec):
        sys.exit(f"{target}: {oiio.geterror()}")
    rows = copies(height, pixels.shape[0])
    wide = numpy.ascontiguousarray(pixels[:, copies(width, pixels.shape[1])])
    band = 256
    for y in range(0, height, band):
        end = min(y + band, height)
        if not output.write_scanlines(y, end, 0, numpy.ascontiguousarray(wide[rows[y:end]])):
            sys.exit(f"{target}: {output.geterror()}")
    output.close()


def tile_session(source, target, width, height):
    manifest = (source / "session.toml").read_text()
    camera = re.search(r"\[camera\][^\[]*", manifest)
    sized = re.sub(r"width = \d+", f"width = {width}", camera[0])
    sized = re.sub(r"height = \d+", f"height = {height}", sized)
    (target / "observed").mkdir(parents=True)
    (target / "illumination").symlink_to(os.path.relpath(source / "illumination", target))
    photographs = sorted((source / "observed").glob("*.exr"))
    for i, photograph in enumerate(photographs):
        print(f"\r{i + 1} of {len(photographs)} photographs", end="", flush=True)
        tile_photograph(photograph, target / "observed" / photograph.name, width, height)
    print()
    # Last: a session without manifest is not complete.
    (target / "session.toml").write_text(manifest.replace(camera[0], sized))


def tile_field(source, target, width, height):
    import h5py
    with h5py.File(source) as base, h5py.File(target, "w", alignment_threshold=1 << 16, alignment_interval=4096) as large:
        base_width, base_height = int(base.attrs["width"]), int(base.attrs["height"])
        if "transfer" not in base:
            sys.exit(f"{source}: is a packed field; give one written by 'refield estimate'")
        for name, value in base.attrs.items():
            large.attrs.create(name, value, dtype=base.attrs.get_id(name).dtype)
        for name, size in (("width", width), ("height", height)):
            large.attrs.modify(name, numpy.int32(size))
        xs, ys = copies(width, base_width), copies(height, base_height)
        pixels = base_width * base_height
        for group in ("basis", "statistics"):
            for name, values in base[group].items():
                if values.shape[0] != pixels:
                    large.create_dataset(f"{group}/{name}", data=values[()])
                else:
                    large.create_dataset(f"{group}/{name}", data=values[()].reshape(base_height, base_width)[ys][:, xs].ravel())

        start = base["transfer/row_start"][()].astype(numpy.int64)
        column, weight = base["transfer/column"][()], base["transfer/weight"][()]
        count = numpy.diff(start).reshape(base_height, base_width)
        row_start = numpy.zeros(width * height + 1, numpy.uint64)
        numpy.cumsum(count[ys][:, xs].ravel(), out=row_start[1:])
        large.create_dataset("transfer/row_start", data=row_start)
        entries = int(row_start[-1])
        columns = large.create_dataset("transfer/column", (entries,), "<u4")
        weights = large.create_dataset("transfer/weight", (entries, 3), "<f4")
        for y in range(height):
            of_row = start[ys[y] * base_width + xs]
            counts = count[ys[y], xs]
            first = int(row_start[y * width])
            # Entry i of the row: of its pixel, as far behind that pixel's first as in the row written.
            behind = numpy.arange(counts.sum()) - numpy.repeat(numpy.cumsum(counts) - counts, counts)
            take = numpy.repeat(of_row, counts) + behind
            columns[first:first + len(take)] = column[take]
            weights[first:first + len(take)] = weight[take]
            if y % 100 == 0:
                print(f"\r{y} of {height} rows", end="", flush=True)
        print(f"\r{entries} entries, {os.path.getsize(target) / (width * height):.0f} bytes per pixel")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("base", type=pathlib.Path, help="session folder or field (.rfield)")
    parser.add_argument("--size", required=True, help="of the picture to write, WIDTHxHEIGHT")
    parser.add_argument("-o", "--output", type=pathlib.Path, required=True, help="new folder or field")
    arguments = parser.parse_args()
    size = re.fullmatch(r"(\d+)x(\d+)", arguments.size)
    if not size:
        sys.exit(f"--size {arguments.size}: give WIDTHxHEIGHT, such as 6000x4000")
    if arguments.output.exists():
        sys.exit(f"{arguments.output}: exists; give another name")
    tile = tile_session if arguments.base.is_dir() else tile_field
    tile(arguments.base, arguments.output, int(size[1]), int(size[2]))


if __name__ == "__main__":
    main()
