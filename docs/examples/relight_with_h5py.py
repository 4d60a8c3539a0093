# SPDX-License-Identifier: Apache-2.0
"""Relights a scene from its .rfield file without refield: h5py and NumPy alone.

usage: relight_with_h5py.py FIELD.rfield LIGHT.npy OUT.npy
LIGHT: [height × width × 3], linear radiance. OUT: [height × width × 3].
"""
import sys
import zlib

import h5py
import numpy as np


def read(dataset):
    values = dataset[...]
    if "crc32" in dataset.attrs:
        assert zlib.crc32(values.tobytes()) == dataset.attrs["crc32"], dataset.name
    return values


def relight(path, light):
    with h5py.File(path, "r") as file:
        assert file.attrs["format"].decode() == "refield reflectance field" and file.attrs["version"] == 2
        width, height = file.attrs["width"], file.attrs["height"]
        assert light.shape == (file.attrs["light_height"], file.attrs["light_width"], 3)
        hats = file.attrs["hat_rows"], file.attrs["hat_columns"]
        x0, y0, x1, y1 = read(file["basis/boxes"]).T
        row_start = read(file["transfer/row_start"])
        column = read(file["transfer/column"])
        weight = read(file["transfer/weight"])

    # Each box's sum of texel values, through a summed-area table in double.
    table = np.zeros((light.shape[0] + 1, light.shape[1] + 1, 3))
    table[1:, 1:] = light.astype(np.float64).cumsum(0).cumsum(1)
    boxes = table[y1, x1] - table[y0, x1] - table[y1, x0] + table[y0, x0]
    # Hat functions come before the boxes: bilinear, nodes from edge to edge, row by row.
    def along(texels, nodes):
        position = (np.arange(texels) + 0.5) / texels * (nodes - 1)
        return np.ones((1, texels)) if nodes == 1 else np.maximum(0, 1 - abs(position - np.arange(nodes)[:, None]))

    ys, xs = along(light.shape[0], hats[0]), along(light.shape[1], hats[1])
    smooth = np.einsum("iy,jx,yxc->ijc", ys, xs, light.astype(np.float64)).reshape(-1, 3)
    coefficients = np.concatenate([smooth, boxes])

    # Each pixel is the sum of its entries.
    pixel = np.repeat(np.arange(width * height), np.diff(row_start).astype(np.int64))
    image = np.zeros((width * height, 3))
    np.add.at(image, pixel, weight * coefficients[column])
    return image.reshape(height, width, 3)


if __name__ == "__main__":
    field_path, light_path, out_path = sys.argv[1:]
    np.save(out_path, relight(field_path, np.load(light_path)).astype(np.float32))
