# SPDX-License-Identifier: Apache-2.0
"""Relights a scene from its .rfield file without refield: h5py and NumPy alone.

usage: relight_with_h5py.py FIELD.rfield LIGHT OUT

LIGHT: the light map, as large as the field's: .npy [height × width × 3] or Radiance .hdr, linear radiance;
.exr where OpenImageIO, OpenCV or OpenEXR for Python is installed. OUT: .npy, .hdr or .exr in the same way.
Reads fields of version 2 and packed ones (version 3). As a module: relight(path, light) with NumPy arrays.
"""
import os
import sys
import zlib

import h5py
import numpy as np

TILE, GROUP = 16, 4  # pixels on a side


class FieldError(Exception):
    pass


def read(file, name):
    values = file[name][...]
    if "crc32" in file[name].attrs and zlib.crc32(values.tobytes()) != file[name].attrs["crc32"]:
        raise FieldError(f"{name} is damaged (its checksum differs)")
    return values


def entries_by_rows(file):
    """boxes [boxes × 4], and of each entry its pixel, kernel and weights [entries × 3]."""
    row_start = read(file, "transfer/row_start").astype(np.int64)
    pixel = np.repeat(np.arange(len(row_start) - 1), np.diff(row_start))
    return read(file, "basis/boxes"), pixel, read(file, "transfer/column"), read(file, "transfer/weight")


def entries_of_tiles(file, width, height, hats):
    """The same of a packed field; boxes that one tile has for itself follow the common ones."""
    W = {8: np.uint8, 16: np.uint16}[int(file.attrs["weight_bits"])]
    start, memory = read(file, "tiles/start"), read(file, "tiles/memory").view(np.uint8)
    boxes = [read(file, "basis/boxes").reshape(-1, 4)]
    count = hats + len(boxes[0])  # kernels so far
    pixels, columns, weights = [], [], []
    kinds = [np.uint32, np.uint32, (np.int16, 4), np.uint32, (np.uint32, 2), np.uint32, np.uint32, np.uint32,
             np.float32, (W, 4), np.float32, W]
    across = (width + TILE - 1) // TILE
    for tile in range(len(start) - 1):
        at = int(start[tile])
        lengths = memory[at : at + 48].view(np.uint32)
        at += 48
        arrays = []
        for length, kind in zip(lengths, kinds):
            kind = np.dtype(kind)
            size = int(length) * kind.itemsize
            base, shape = (kind.base, (-1,) + kind.shape) if kind.shape else (kind, (-1,))
            arrays.append(memory[at : at + size].view(base).reshape(shape))
            at += (size + 7) // 8 * 8
        (_, _, support, dense_kernels, runs, group, record_kernel, common, scale, sparse, record_scale,
         record_weight) = arrays
        own = len(support) - len(common)
        number = np.concatenate([common, count + np.arange(own)]).astype(np.int64)
        boxes.append(support[len(common) :].astype(np.int32))
        count += own
        # Sparse weights: kernel by kernel, as often as its run says.
        kernel = np.repeat(np.arange(len(support)), np.repeat(runs[:, 1], runs[:, 0]))
        in_tile = [sparse[:, 3].astype(np.int64)]
        column = [number[kernel]]
        weight = [sparse[:, :3] * scale[kernel, None]]
        # Dense weights: a record for the 16 pixels of a group; grey tiles hold one channel for all three.
        records = len(record_kernel)
        if records:
            dense = record_weight.reshape(records, -1, GROUP * GROUP) * record_scale[:, None, None]
            dense = np.broadcast_to(dense, (records, 3, GROUP * GROUP)).transpose(0, 2, 1)
            group_of = np.repeat(np.arange(GROUP * GROUP), np.diff(group.astype(np.int64)))
            in_tile.append((group_of[:, None] * GROUP * GROUP + np.arange(GROUP * GROUP)).ravel())
            column.append(np.repeat(number[dense_kernels[record_kernel]], GROUP * GROUP))
            weight.append(dense.reshape(-1, 3))
        in_tile, column, weight = map(np.concatenate, (in_tile, column, weight))
        g, within = in_tile // (GROUP * GROUP), in_tile % (GROUP * GROUP)
        x = tile % across * TILE + g % 4 * GROUP + within % GROUP
        y = tile // across * TILE + g // 4 * GROUP + within // GROUP
        there = (x < width) & (y < height)
        pixels.append((y * width + x)[there])
        columns.append(column[there])
        weights.append(weight[there])
    return tuple(map(np.concatenate, (boxes, pixels, columns, weights)))


def read_field(path):
    with h5py.File(path, "r") as file:
        attrs = {name: value.decode() if isinstance(value, bytes) else value for name, value in file.attrs.items()}
        if attrs.get("format") != "refield reflectance field":
            raise FieldError(f"is no whole reflectance field (format '{attrs.get('format')}')")
        if "light_measure" in attrs or "harmonics_order" in attrs or "mesh" in file:
            raise FieldError("is precomputed transport; this program reads fields of a camera's pixels")
        if attrs["version"] == 2:
            field = entries_by_rows(file)
        elif attrs["version"] == 3:
            hats = int(attrs["hat_rows"]) * int(attrs["hat_columns"])
            field = entries_of_tiles(file, int(attrs["width"]), int(attrs["height"]), hats)
        else:
            raise FieldError(f"has format version {attrs['version']}; this program reads 2 and 3")
        mixing = read(file, "output_from_primaries") if "output_from_primaries" in file else np.eye(3)
        interpolation = None
        if "basis/interpolation" in file:
            interpolation = read(file, "basis/observed_light"), read(file, "basis/interpolation")[0]
    return attrs, interpolation, mixing, field


def interpolated(light, sources, numbers):
    """Light of dark texels moved onto the light sources of a light stage ("Interpolation" in the format)."""
    length, share, fine_length, reach = numbers
    rows, columns = light.shape[:2]

    def direction(column, row):
        phi, theta = 2 * np.pi * column / columns, np.pi * row / rows
        phi, theta = np.broadcast_arrays(phi, theta)
        return np.stack([-np.sin(theta) * np.sin(phi), np.cos(theta), -np.sin(theta) * np.cos(phi)], axis=-1)

    def chords(a, b):
        return np.sqrt(np.maximum(2 - 2 * a @ b.T, 0))

    def covariance(chord):
        def matern(x):
            return (1 + np.sqrt(3) * x) * np.exp(-np.sqrt(3) * x)

        return (1 - share) * matern(chord / length) + share * matern(chord / fine_length)

    edges = np.cos(np.pi * np.arange(rows + 1) / rows)
    angle = np.repeat((2 * np.pi / columns * -np.diff(edges))[:, None], columns, axis=1)
    middle = direction((sources[:, 0] + sources[:, 2]) / 2, (sources[:, 1] + sources[:, 3]) / 2)
    lit = np.zeros((rows, columns), bool)
    for x0, y0, x1, y1 in sources:
        lit[y0:y1, x0:x1] = True
    result = np.where(lit[..., None], light, 0.0)
    dark = ~lit & np.any(light != 0, axis=2)
    y, x = np.nonzero(dark)
    chord = chords(middle, direction(x + 0.5, y + 0.5))
    near = np.clip(3 - 2 * chord.min(axis=0, initial=np.inf) / reach, 0, 1)
    irradiance = covariance(chord) @ (light[dark] * (near * angle[dark])[:, None])
    irradiance = np.linalg.solve(covariance(chords(middle, middle)) + 1e-9 * np.eye(len(middle)), irradiance)
    for (x0, y0, x1, y1), value in zip(sources, irradiance):
        result[y0:y1, x0:x1] += value / angle[y0:y1, x0:x1].sum()
    return result


def relight(path, light):
    """The scene of a field file under a light map [height × width × 3], as [height × width × 3]."""
    attrs, interpolation, mixing, (corners, pixel, column, weight) = read_field(path)
    x0, y0, x1, y1 = corners.reshape(-1, 4).T
    width, height = int(attrs["width"]), int(attrs["height"])
    needed = (int(attrs["light_height"]), int(attrs["light_width"]), 3)
    if light.shape != needed:
        raise FieldError(f"takes light maps of shape {needed}, this one has {light.shape}; resize it first")
    light = light.astype(np.float64)
    if interpolation is not None:
        light = interpolated(light, *interpolation)

    # Each box's sum of texel values, through a summed-area table in double.
    table = np.zeros((light.shape[0] + 1, light.shape[1] + 1, 3))
    table[1:, 1:] = light.cumsum(0).cumsum(1)
    boxes = table[y1, x1] - table[y0, x1] - table[y1, x0] + table[y0, x0]
    # Hat functions come before the boxes: bilinear, nodes from edge to edge, row by row.
    def along(texels, nodes):
        position = (np.arange(texels) + 0.5) / texels * (nodes - 1)
        return np.ones((1, texels)) if nodes == 1 else np.maximum(0, 1 - abs(position - np.arange(nodes)[:, None]))

    ys = along(light.shape[0], int(attrs["hat_rows"]))
    xs = along(light.shape[1], int(attrs["hat_columns"]))
    smooth = np.einsum("iy,jx,yxc->ijc", ys, xs, light, optimize=True).reshape(-1, 3)
    coefficients = np.concatenate([smooth, boxes])

    # Each pixel is the sum of its entries.
    image = [np.bincount(pixel, weight[:, c] * coefficients[column, c], width * height) for c in range(3)]
    return (np.stack(image, axis=1) @ mixing.T).reshape(height, width, 3)


def exr_library():
    """(read(path), write(path, image)) of the first library that is installed."""
    try:
        import OpenImageIO as oiio

        def read_oiio(path):
            image = oiio.ImageInput.open(path)
            if image is None:
                raise FieldError(oiio.geterror())
            names = list(image.spec().channelnames)
            return np.asarray(image.read_image("float"))[..., [names.index(c) for c in "RGB"]]

        def write_oiio(path, image):
            out = oiio.ImageOutput.create(path)
            out.open(path, oiio.ImageSpec(image.shape[1], image.shape[0], 3, "float"))
            out.write_image(np.ascontiguousarray(image))
            out.close()

        return read_oiio, write_oiio
    except ImportError:
        pass
    try:
        os.environ.setdefault("OPENCV_IO_ENABLE_OPENEXR", "1")
        import cv2

        return (lambda path: cv2.imread(path, cv2.IMREAD_UNCHANGED)[..., 2::-1],
                lambda path, image: cv2.imwrite(path, np.ascontiguousarray(image[..., ::-1])))
    except ImportError:
        pass
    try:
        import OpenEXR

        def read_openexr(path):
            channels = OpenEXR.File(path).channels()
            return channels["RGB"].pixels if "RGB" in channels else np.dstack([channels[c].pixels for c in "RGB"])

        return read_openexr, lambda path, image: OpenEXR.File({}, {"RGB": image}).write(path)
    except ImportError:
        raise FieldError("EXR needs a library: 'apt install python3-openimageio' or 'pip install OpenEXR'; or "
                         "convert by 'oiiotool in.exr -o out.hdr'") from None


def read_hdr(path):
    """Radiance RGBE: a header of text, an empty line, the size, then pixels, run-length coded by rows or not."""
    data = open(path, "rb").read()
    end = data.index(b"\n\n") + 2
    line = data[end : data.index(b"\n", end)]
    words = line.split()
    if not data.startswith(b"#?") or len(words) != 4 or words[0] != b"-Y" or words[2] != b"+X":
        raise FieldError("is no Radiance picture of the usual orientation (-Y +X)")
    height, width, at = int(words[1]), int(words[3]), end + len(line) + 1
    rows = np.zeros((height, 4, width), np.uint8)
    for y in range(height):
        if data[at : at + 2] != b"\x02\x02" or not 8 <= width < 32768:  # not coded: four bytes a pixel
            rows[y:] = np.frombuffer(data, np.uint8, (height - y) * width * 4, at).reshape(-1, width, 4).transpose(0, 2, 1)
            break
        at += 4
        for c in range(4):
            x = 0
            while x < width:
                count = data[at]
                if count > 128:  # a run
                    rows[y, c, x : x + count - 128] = data[at + 1]
                    x, at = x + count - 128, at + 2
                else:
                    rows[y, c, x : x + count] = np.frombuffer(data, np.uint8, count, at + 1)
                    x, at = x + count, at + 1 + count
    exponent = rows[:, 3].astype(np.int32)
    factor = np.where(exponent > 0, np.ldexp(1.0, exponent - 136), 0.0)
    return rows[:, :3].transpose(0, 2, 1) * factor[..., None]


def write_hdr(path, image):
    largest = np.maximum(image.max(axis=2), 1e-32)
    mantissa, exponent = np.frexp(largest)
    rgb = np.clip(np.round(image * (mantissa * 256 / largest)[..., None]), 0, 255)
    rgbe = np.dstack([rgb, exponent + 128]).astype(np.uint8)
    with open(path, "wb") as file:
        file.write(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n" % image.shape[:2])
        file.write(rgbe.tobytes())


def read_image(path):
    kind = os.path.splitext(path)[1].lower()
    if kind == ".npy":
        return np.load(path)
    if kind == ".hdr":
        return read_hdr(path)
    if kind == ".exr":
        return exr_library()[0](path)
    raise FieldError("is neither .npy, .hdr nor .exr")


def write_image(path, image):
    kind = os.path.splitext(path)[1].lower()
    if kind == ".npy":
        np.save(path, image)
    elif kind == ".hdr":
        write_hdr(path, image)
    elif kind == ".exr":
        exr_library()[1](path, image)
    else:
        raise FieldError("is neither .npy, .hdr nor .exr")


def main():
    if len(sys.argv) != 4:
        sys.exit(__doc__.split("\n\n")[1])
    field_path, light_path, out_path = path = sys.argv[1:]
    try:
        path = light_path
        light = read_image(light_path)
        path = field_path
        image = relight(field_path, light)
        path = out_path
        write_image(out_path, image.astype(np.float32))
    except (FieldError, OSError, ValueError, KeyError) as error:
        sys.exit(f"{path}: {error}")


if __name__ == "__main__":
    main()
