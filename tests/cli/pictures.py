# SPDX-License-Identifier: Apache-2.0
"""Light maps out, images in and out, by nothing but the standard library."""
import struct
import zlib


def write_pfm(path, width, height, floats):
    """Portable float map: rows from the bottom up."""
    row = width * 3
    with open(path, "wb") as file:
        file.write(f"PF\n{width} {height}\n-1.0\n".encode())
        for y in reversed(range(height)):
            file.write(floats[y * row : (y + 1) * row].tobytes())


def read_png(path):
    """An 8-bit RGB or RGBA PNG as (width, height, bytes)."""
    data = open(path, "rb").read()
    width, height, bits, kind = struct.unpack(">IIBB", data[16:26])
    assert (bits, kind) in ((8, 2), (8, 6)), "not an 8-bit RGB or RGBA PNG"
    channels = 4 if kind == 6 else 3
    packed, at = b"", 8
    while at < len(data):
        length, name = struct.unpack(">I4s", data[at : at + 8])
        if name == b"IDAT":
            packed += data[at + 8 : at + 8 + length]
        at += length + 12
    raw, stride, before, result = zlib.decompress(packed), width * channels, bytearray(width * channels), bytearray()
    for y in range(height):
        line = bytearray(raw[y * (stride + 1) + 1 : (y + 1) * (stride + 1)])
        unfilter(raw[y * (stride + 1)], line, before, channels)
        result += line
        before = line
    return width, height, bytes(result)


def over_black(rgba):
    """RGB of sRGB pixels whose alpha is not premultiplied, over black."""
    def linear(v):
        return v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4

    def encoded(v):
        return round(255 * (12.92 * v if v <= 0.0031308 else 1.055 * v ** (1 / 2.4) - 0.055))

    rgb = bytearray(len(rgba) // 4 * 3)
    for c in range(3):
        rgb[c::3] = rgba[c::4]
    for p, alpha in enumerate(rgba[3::4]):
        if alpha < 255:
            rgb[3 * p : 3 * p + 3] = (encoded(linear(v / 255) * alpha / 255) for v in rgb[3 * p : 3 * p + 3])
    return bytes(rgb)


def unfilter(kind, line, above, channels=3):
    """Undoes a PNG row filter in place (PNG specification, 9.2)."""
    for i in range(len(line)):
        a, b, c = (line[i - channels] if i >= channels else 0), above[i], (above[i - channels] if i >= channels else 0)
        if kind == 1:
            line[i] = (line[i] + a) & 255
        elif kind == 2:
            line[i] = (line[i] + b) & 255
        elif kind == 3:
            line[i] = (line[i] + (a + b) // 2) & 255
        elif kind == 4:
            p = a + b - c
            nearest = min((abs(p - a), 0, a), (abs(p - b), 1, b), (abs(p - c), 2, c))[2]
            line[i] = (line[i] + nearest) & 255


def write_png(path, width, height, rgb):
    def chunk(name, content):
        return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))

    rows = b"".join(b"\0" + rgb[y * width * 3 : (y + 1) * width * 3] for y in range(height))
    with open(path, "wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
                   + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


def write_hdr(path, width, height, rgbe):
    """Radiance HDR with run-length encoded channels. `rgbe`: four bytes per pixel."""
    with open(path, "wb") as file:
        file.write(f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n".encode())
        for y in range(height):
            file.write(bytes((2, 2, width >> 8, width & 255)))
            for channel in range(4):
                file.write(runs(rgbe[(y * width) * 4 + channel : (y + 1) * width * 4 : 4]))


def runs(values):
    """Runs of equal bytes as 128 + length and the byte, others one by one."""
    result, at = b"", 0
    while at < len(values):
        length = 1
        while length < 127 and at + length < len(values) and values[at + length] == values[at]:
            length += 1
        result += bytes((128 + length, values[at])) if length > 1 else bytes((1, values[at]))
        at += length
    return result
