# SPDX-License-Identifier: Apache-2.0
"""Writes image files of every variant that the formats allow, byte by byte, with NumPy and the standard library
alone (JPEG: Pillow). Arrays are [rows × columns × 3] as shown upright; `turned` gives what a file stores."""
import io
import struct
import zlib

import numpy as np

BLACK, WHITE = 256, 4095  # of RAW files
BAYER = {"rggb": (0, 1, 1, 2), "grbg": (1, 0, 2, 1), "gbrg": (1, 2, 0, 1), "bggr": (2, 1, 1, 0)}
RESOLUTIONS = {1: "-Y {h} +X {w}", 2: "-Y {h} -X {w}", 3: "+Y {h} -X {w}", 4: "+Y {h} +X {w}",
               5: "+X {w} -Y {h}", 6: "-X {w} -Y {h}", 7: "-X {w} +Y {h}", 8: "+X {w} +Y {h}"}


def scene(height, width, seed=1):
    """Values from .05 to .9 without any symmetry."""
    y, x = np.mgrid[0:height, 0:width]
    rgb = np.stack([x / width, y / height, (x * 3 + y * 5) % 11 / 11], -1)
    return (0.05 + 0.7 * rgb + 0.15 * np.random.default_rng(seed).random((height, width, 3))).astype(np.float64)


def turned(upright, orientation):
    """The array that a file of that orientation (TIFF 6.0, tag 274) stores for an upright picture."""
    return {1: lambda a: a, 2: lambda a: a[:, ::-1], 3: lambda a: a[::-1, ::-1], 4: lambda a: a[::-1],
            5: lambda a: a.swapaxes(0, 1), 6: lambda a: a[:, ::-1].swapaxes(0, 1)[:, :],
            7: lambda a: a[::-1, ::-1].swapaxes(0, 1), 8: lambda a: a[::-1].swapaxes(0, 1)}[orientation](upright)


def to_srgb(x):
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 1e-9) ** (1 / 2.4) - 0.055)


def integers(x, bits):
    return np.round(np.clip(x, 0, 1) * (2 ** bits - 1)).astype(np.uint8 if bits == 8 else np.uint16)


# ── TIFF, DNG, EXIF ──

def directory(tags, order, base, big=False):
    """A TIFF directory that begins at `base`: {tag: (type, values)}. Returns its bytes and those behind it."""
    codes = {1: "B", 2: "s", 3: "H", 4: "I", 5: "II", 6: "b", 7: "B", 8: "h", 9: "i", 10: "ii", 11: "f", 12: "d", 16: "Q"}
    inline, head, entry = (8, "Q", "HHQ") if big else (4, "H", "HHI")
    first = base + struct.calcsize("<" + head) + len(tags) * (4 + 2 * inline) + inline
    out, extra = struct.pack(order + head, len(tags)), b""
    for tag, (kind, values) in sorted(tags.items()):
        if kind == 2:
            data, count = values.encode() + b"\0", len(values) + 1
        else:
            flat = list(np.ravel(values))
            step = len(codes[kind])
            data = b"".join(struct.pack(order + codes[kind], *flat[i:i + step]) for i in range(0, len(flat), step))
            count = len(flat) // step
        out += struct.pack(order + entry, tag, kind, count)
        if len(data) <= inline:
            out += data.ljust(inline, b"\0")
        else:
            out += struct.pack(order + ("Q" if big else "I"), first + len(extra))
            extra += data + b"\0" * (len(data) % 2)
    return out + b"\0" * inline + extra


def exif_tags(iso=None, f_number=None, seconds=None, focal=None, white_balance=None, light_source=None, digital_zoom=None, more=None, **_):
    """`more`: further tags, {tag: (type, values)}."""
    fraction = lambda v: (5, (round(v * 10000), 10000))
    return {k: v for k, v in {**(more or {}), 33434: seconds and fraction(seconds), 33437: f_number and fraction(f_number),
                              34855: iso and (3, iso), 37386: focal and fraction(focal),
                              41988: None if digital_zoom is None else fraction(digital_zoom),
                              41987: None if white_balance is None else (3, white_balance),
                              37384: None if light_source is None else (3, light_source)}.items() if v}


def exif_block(orientation=1, order="<", **settings):
    tags = {274: (3, orientation), 34665: (4, 0)}
    length = len(directory(tags, order, 8))
    tags[34665] = (4, 8 + length)
    mark = b"II*\0" if order == "<" else b"MM\0*"
    return (mark + struct.pack(order + "I", 8) + directory(tags, order, 8) +
            directory(exif_tags(**settings), order, 8 + length))


def tiff(stored, order="<", orientation=1, compression=1, planar=1, tile=0, big=False, icc=b"", grey_is_white=False,
         tags=None, **settings):
    """`stored`: uint8, uint16, float16, float32 or float64 [rows × columns × samples], as the file holds it."""
    height, width, samples = stored.shape
    data = stored.astype(stored.dtype.newbyteorder(order))
    blocks = []
    if tile:
        for plane in range(samples) if planar == 2 else [slice(None)]:
            for y in range(0, height, tile):
                for x in range(0, width, tile):
                    part = np.zeros((tile, tile) + data[0, 0, plane].shape, data.dtype)
                    cut = data[y:y + tile, x:x + tile, plane]
                    part[:cut.shape[0], :cut.shape[1]] = cut
                    blocks.append(part.tobytes())
    else:
        blocks = [data[..., c].tobytes() for c in range(samples)] if planar == 2 else [data.tobytes()]
    if compression == 8:
        blocks = [zlib.compress(block) for block in blocks]
    kind = 16 if big else 4
    all_tags = {256: (4, width), 257: (4, height), 258: (3, [data.dtype.itemsize * 8] * samples),
                259: (3, compression), 262: (3, 2 if samples == 3 else 0 if grey_is_white else 1), 277: (3, samples), 284: (3, planar),
                274: (3, orientation), 339: (3, [3 if data.dtype.kind == "f" else 1] * samples)}
    offsets, counts = (324, 325) if tile else (273, 279)
    all_tags.update({322: (4, tile), 323: (4, tile)} if tile else {278: (4, height)})
    if icc:
        all_tags[34675] = (7, list(icc))
    all_tags.update(tags or {})
    exif = exif_tags(**settings)
    if exif:
        all_tags[34665] = (kind, 0)
    all_tags[counts] = (kind, [len(block) for block in blocks])
    all_tags[offsets] = (kind, [0] * len(blocks))
    start = 16 if big else 8
    end = start + len(directory(all_tags, order, start, big))
    sub = directory(exif, order, end, big) if exif else b""
    if exif:
        all_tags[34665] = (kind, end)
    places, at = [], end + len(sub)
    for block in blocks:
        places.append(at)
        at += len(block)
    all_tags[offsets] = (kind, places)
    mark = (b"II" if order == "<" else b"MM") + (struct.pack(order + "HHHQ", 43, 8, 0, 16) if big else struct.pack(order + "HI", 42, 8))
    return mark + directory(all_tags, order, start, big) + sub + b"".join(blocks)


def mosaic(sensor, layout):
    """One sample per pixel of [rows × columns × 3], by the colours of the sites."""
    out = np.empty(sensor.shape[:2], sensor.dtype)
    for i, c in enumerate(BAYER[layout]):
        out[i // 2::2, i % 2::2] = sensor[i // 2::2, i % 2::2, c]
    return out


def dng(samples, colours=(0, 1, 1, 2), orientation=1, order="<", black=BLACK, white=WHITE, period=2, tags=None,
        neutral=(1, 1, 1), **settings):
    """`samples`: [rows × columns] of a mosaic, or [rows × columns × 3] linear, in sensor order."""
    is_mosaic = samples.ndim == 2
    data = samples[..., None] if is_mosaic else samples
    more = {254: (4, 0), 262: (3, 32803 if is_mosaic else 34892), 271: (2, "refield"), 272: (2, "virtual"),
            50706: (1, [1, 4, 0, 0]), 50708: (2, "refield virtual"),
            50714: (4, [black] * data.shape[2] if np.ndim(black) == 0 else list(black)), 50717: (4, [white] * data.shape[2]),
            50721: (10, [1, 1, 0, 1, 0, 1, 0, 1, 1, 1, 0, 1, 0, 1, 0, 1, 1, 1]),
            50728: (5, [round(v * 1000) if i == 0 else 1000 for v in neutral for i in range(2)]), 50778: (3, 21)}
    if is_mosaic and colours is not None:
        more.update({33421: (3, [period, period]), 33422: (1, list(colours)), 50710: (1, [0, 1, 2])})
    if colours is None:
        more[262] = (3, 34892)
        for tag in (50721, 50728, 50778):
            del more[tag]
    more.update(tags or {})
    return tiff(data, order, orientation, tags=more, **settings)


def dng_behind_preview(samples, colours=(0, 1, 1, 2), order="<", tags=None):
    """As cameras write it: the first directory is a thumbnail, the mosaic is in a directory below it."""
    height, width = samples.shape
    thumb = np.full((16, 32, 3), 77, np.uint8)
    raw = {254: (4, 0), 256: (4, width), 257: (4, height), 258: (3, 16), 259: (3, 1), 262: (3, 32803), 273: (4, 0), 277: (3, 1),
           278: (4, height), 279: (4, 2 * samples.size), 284: (3, 1), 33421: (3, [2, 2]), 33422: (1, list(colours)),
           50710: (1, [0, 1, 2]), 50714: (4, BLACK), 50717: (4, WHITE), **(tags or {})}
    first = {254: (4, 1), 256: (4, 32), 257: (4, 16), 258: (3, [8] * 3), 259: (3, 1), 262: (3, 2), 271: (2, "refield"), 272: (2, "virtual"),
             273: (4, 0), 277: (3, 3), 278: (4, 16), 279: (4, thumb.size), 284: (3, 1), 330: (4, 0), 50706: (1, [1, 4, 0, 0]),
             50708: (2, "refield virtual"), 50721: (10, [1, 1, 0, 1, 0, 1, 0, 1, 1, 1, 0, 1, 0, 1, 0, 1, 1, 1]),
             50728: (5, [1] * 6), 50778: (3, 21)}
    below = 8 + len(directory(first, order, 8))
    data = below + len(directory(raw, order, below))
    first[330], first[273], raw[273] = (4, below), (4, data), (4, data + thumb.size)
    return ((b"II" if order == "<" else b"MM") + struct.pack(order + "HI", 42, 8) + directory(first, order, 8) +
            directory(raw, order, below) + thumb.tobytes() + samples.astype(order + "u2").tobytes())


# ── ICC profiles: a header, the curve and the primaries ──

# Colorants of Adobe RGB (1998), adapted to D50.
ADOBE_RGB = ((0.60974, 0.31111, 0.01947), (0.20528, 0.62567, 0.06087), (0.14919, 0.06322, 0.74457))


def icc(curve, tag=b"rTRC", colorants=()):
    body = {"linear": b"curv" + struct.pack(">II", 0, 0),
            "table": b"curv" + struct.pack(">II", 0, 1024) + np.round(65535 * np.where(
                (t := np.linspace(0, 1, 1024)) <= 0.04045, t / 12.92, ((t + 0.055) / 1.055) ** 2.4)).astype(">u2").tobytes(),
            "srgb": b"para" + struct.pack(">IHH5i", 0, 3, 0, *(round(v * 65536) for v in (2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045))),
            "odd": b"curv" + struct.pack(">II", 0, 3) + struct.pack(">3H", 0, 60000, 65535),
            "table of 2": b"curv" + struct.pack(">II2H", 0, 2, 0, 65535)}.get(curve)
    if body is None:
        body = b"curv" + struct.pack(">IIH", 0, 1, round(float(curve) * 256))
    tags = [(tag, body)] + [(name, b"XYZ " + struct.pack(">I3i", 0, *(round(v * 65536) for v in xyz)))
                            for name, xyz in zip((b"rXYZ", b"gXYZ", b"bXYZ"), colorants)]
    table, content = struct.pack(">I", len(tags)), b""
    for name, data in tags:
        table += struct.pack(">4sII", name, 132 + 12 * len(tags) + len(content), len(data))
        content += data + b"\0" * (-len(data) % 4)
    profile = bytes(128) + table + content
    profile = struct.pack(">I", len(profile)) + bytes(8) + b"mntrRGB XYZ " + profile[24:]
    return profile[:36] + b"acsp" + profile[40:]


# ── PNG ──

def png(stored, chunks=(), palette=False):
    """`stored`: uint8 or uint16 [rows × columns × 1 to 4]."""
    def chunk(name, data):
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
    height, width, samples = stored.shape
    kind = {1: 0, 2: 4, 3: 2, 4: 6}[samples]
    extra = b""
    if palette:
        colours, places = np.unique(stored.reshape(-1, 3), axis=0, return_inverse=True)
        assert len(colours) <= 256
        kind, extra, stored = 3, chunk(b"PLTE", colours.tobytes()), places.reshape(height, width, 1).astype(np.uint8)
    rows = b"".join(b"\0" + row.astype(row.dtype.newbyteorder(">")).tobytes() for row in stored)
    return (b"\x89PNG\r\n\x1a\n" +
            chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, stored.dtype.itemsize * 8, kind, 0, 0, 0)) +
            b"".join(chunk(*c) for c in chunks) + extra + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


PNG_CURVES = {"none": [], "sRGB": [(b"sRGB", b"\0")], "gAMA 1": [(b"gAMA", struct.pack(">I", 100000))],
              "gAMA 1/2": [(b"gAMA", struct.pack(">I", 50000))],
              "sRGB and gAMA 1/2.2": [(b"gAMA", struct.pack(">I", 45455)), (b"sRGB", b"\0")],
              "iCCP srgb": [(b"iCCP", b"p\0\0" + zlib.compress(icc("srgb")))],
              "iCCP 1.8": [(b"iCCP", b"p\0\0" + zlib.compress(icc("1.8")))],
              "cICP linear": [(b"cICP", bytes([1, 8, 0, 1]))], "cICP srgb": [(b"cICP", bytes([1, 13, 0, 1]))]}


def encoded(light, curve, default):
    """Encodes linear light as a file of that curve (keys of PNG_CURVES, names of icc()) does."""
    if curve in ("none", ""):
        curve = default
    if "2" in curve and "gAMA 1/2" == curve:
        return light ** 0.5
    if "1.8" in curve:
        return light ** (1 / round(1.8 * 256) * 256)
    return light if curve in ("gAMA 1", "cICP linear", "linear", "table of 2") else to_srgb(light)


def jpeg(stored, orientation=1, profile=b"", **settings):
    from PIL import Image
    out = io.BytesIO()
    Image.fromarray(stored).save(out, "JPEG", quality=100, subsampling=0,
                                 exif=b"Exif\0\0" + exif_block(orientation, **settings), icc_profile=profile or None)
    return out.getvalue()


# ── Radiance ──

def rgbe(upright, orientation=1, coding="new", header=(), kind="rgbe"):
    """Returns the file and the values that it holds, upright. `coding`: new, old or flat."""
    stored = np.ascontiguousarray(turned(upright, orientation)).astype(np.float64)
    high = stored.max(-1)
    mantissa, exponent = np.frexp(high)
    scale = np.where(high > 0, mantissa * 256 / np.maximum(high, 1e-30), 0)
    pixels = np.concatenate([np.floor(stored * scale[..., None]), np.where(high > 0, exponent + 128, 0)[..., None]], -1).astype(np.uint8)
    values = pixels[..., :3] * np.ldexp(1.0, pixels[..., 3:].astype(int) - 136) * (pixels[..., 3:] > 0)
    back = {6: 8, 8: 6}.get(orientation, orientation)
    out = ("\n".join(["#?RADIANCE", *header, f"FORMAT=32-bit_rle_{kind}", "",
                      RESOLUTIONS[orientation].format(h=upright.shape[0], w=upright.shape[1])]) + "\n").encode()
    for row in pixels:
        if coding == "flat":
            out += row.tobytes()
        elif coding == "old":
            x = 0
            while x < len(row):
                run = 1
                while x + run < len(row) and (row[x + run] == row[x]).all():
                    run += 1
                out += row[x].tobytes()
                rest = run - 1
                while rest > 0:
                    out += bytes([1, 1, 1, rest & 255])
                    rest >>= 8
                x += run
        else:
            out += bytes([2, 2, len(row) >> 8, len(row) & 255])
            for channel in row.T:
                for at in range(0, len(channel), 100):
                    part = channel[at:at + 100]
                    out += bytes([128 + len(part), part[0]]) if len(part) < 128 and (part == part[0]).all() else bytes([len(part)]) + part.tobytes()
    return out, turned(values, back)


# ── OpenEXR and PFM ──

def exr(channels, attributes=(), tile=0, window=None, display=None, compression=0):
    """`channels`: {name: float16, float32 or uint32 [rows × columns]}."""
    names = sorted(channels)
    height, width = channels[names[0]].shape
    x0, y0 = window or (0, 0)
    box = struct.pack("<4i", x0, y0, x0 + width - 1, y0 + height - 1)
    kinds = {"u": 0, "e": 1, "f": 2}
    listing = b"".join(n.encode() + b"\0" + struct.pack("<iiii", kinds[channels[n].dtype.char if channels[n].dtype.kind == "f" else "u"], 0, 1, 1) for n in names) + b"\0"
    attribute = lambda name, kind, data: name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(data)) + data
    all_attributes = [("channels", "chlist", listing), ("compression", "compression", bytes([compression])), ("dataWindow", "box2i", box),
                      ("displayWindow", "box2i", display or box), ("lineOrder", "lineOrder", b"\0"),
                      ("pixelAspectRatio", "float", struct.pack("<f", 1)), ("screenWindowCenter", "v2f", bytes(8)),
                      ("screenWindowWidth", "float", struct.pack("<f", 1)), *attributes]
    if tile:
        all_attributes.append(("tiles", "tiledesc", struct.pack("<IIB", tile, tile, 0)))
    head = struct.pack("<II", 20000630, 2 | (0x200 if tile else 0)) + b"".join(attribute(*a) for a in all_attributes) + b"\0"

    def packed(data):
        if compression == 0:
            return data
        split = np.frombuffer(data[::2] + data[1::2], np.uint8).astype(int)
        delta = np.concatenate([split[:1], (split[1:] - split[:-1] + 128) % 256]).astype(np.uint8)
        small = zlib.compress(delta.tobytes())
        return small if len(small) < len(data) else data
    chunks = []
    if tile:
        for y in range(0, height, tile):
            for x in range(0, width, tile):
                data = packed(b"".join(channels[n][row, x:x + tile].tobytes() for row in range(y, min(y + tile, height)) for n in names))
                chunks.append(struct.pack("<5i", x // tile, y // tile, 0, 0, len(data)) + data)
    else:
        rows = 16 if compression == 3 else 1
        for y in range(0, height, rows):
            data = packed(b"".join(channels[n][row].tobytes() for row in range(y, min(y + rows, height)) for n in names))
            chunks.append(struct.pack("<2i", y0 + y, len(data)) + data)
    places, at = b"", len(head) + 8 * len(chunks)
    for chunk in chunks:
        places += struct.pack("<Q", at)
        at += len(chunk)
    return head + places + b"".join(chunks)


def rgb_channels(image, dtype=np.float32):
    return {n: np.ascontiguousarray(image[..., c].astype(dtype)) for c, n in enumerate("RGB")}


def chromaticities(xy):
    return ("chromaticities", "chromaticities", struct.pack("<8f", *xy))


def envmap(kind):
    return ("envmap", "envmap", bytes([kind]))


def openexr_cube(radiance, size):
    """Faces as ImfEnvmap.cpp defines them, of a function of directions in OpenEXR's axes [..., 3]."""
    p = (np.arange(size) + 0.5) / size * 2 - 1
    a, b = np.meshgrid(p, p, indexing="ij")  # position in the face: x, y
    one = np.ones_like(a)
    directions = [(one, a, b), (-one, a, b), (a, one, b), (a, -one, b), (a, b, one), (a, b, -one)]
    faces = np.empty((6, size, size, 3))
    i, j = np.meshgrid(np.arange(size), np.arange(size), indexing="ij")
    far = size - 1
    places = [(j, far - i), (far - j, far - i), (i, far - j), (i, j), (far - i, far - j), (i, far - j)]
    for face, (direction, (column, row)) in enumerate(zip(directions, places)):
        faces[face, row, column] = radiance(np.stack(direction, -1))
    return faces.reshape(6 * size, size, 3)


def read_exr(path):
    """{channel: [rows × columns]} of a file with scan lines, as refield writes them."""
    data = open(path, "rb").read()
    at, head = 8, {}
    while data[at]:
        name, kind, rest = data[at:].split(b"\0", 2)
        at += len(name) + len(kind) + 2
        size, = struct.unpack_from("<i", data, at)
        head[name] = data[at + 4:at + 4 + size]
        at += 4 + size
    names, listing = [], head[b"channels"]
    while listing[0]:
        name, rest = listing.split(b"\0", 1)
        names.append((name.decode(), {0: np.uint32, 1: np.float16, 2: np.float32}[rest[0]]))
        listing = rest[16:]
    x0, y0, x1, y1 = struct.unpack("<4i", head[b"dataWindow"])
    width, height = x1 - x0 + 1, y1 - y0 + 1
    rows = {0: 1, 2: 1, 3: 16}[head[b"compression"][0]]
    out = {n: np.empty((height, width), np.float32) for n, _ in names}
    for k in range((height + rows - 1) // rows):
        place, = struct.unpack_from("<Q", data, at + 1 + 8 * k)
        first, size = struct.unpack_from("<ii", data, place)
        count = min(rows, y1 + 1 - first)
        whole = count * width * sum(np.dtype(t).itemsize for _, t in names)
        block = data[place + 8:place + 8 + size]
        if size < whole:
            delta = np.frombuffer(zlib.decompress(block), np.uint8).astype(np.int64)
            values = (np.cumsum(delta) - 128 * np.arange(len(delta))).astype(np.uint8)
            half = (len(values) + 1) // 2
            joined = np.empty_like(values)
            joined[::2], joined[1::2] = values[:half], values[half:]
            block = joined.tobytes()
        offset = 0
        for y in range(first, first + count):
            for n, t in names:
                out[n][y - y0] = np.frombuffer(block, t, width, offset)
                offset += width * np.dtype(t).itemsize
    return out


def pfm(upright, order="<"):
    height, width = upright.shape[:2]
    kind = b"PF" if upright.ndim == 3 else b"Pf"
    return kind + b"\n%d %d\n%d\n" % (width, height, -1 if order == "<" else 1) + upright[::-1].astype(order + "f4").tobytes()


# ── A field whose pixels are the texels of its light map ──

def write_identity_field(path, height, width, parameterisation):
    import h5py
    y, x = np.mgrid[0:height, 0:width]
    count = height * width
    with h5py.File(path, "w") as file:
        text = lambda name, value: file.attrs.create(name, np.bytes_(value))
        text("format", "refield reflectance field")
        text("light_parameterisation", parameterisation)
        text("provenance", '{"made_by": "identity"}')
        for name, value in {"version": 2, "width": width, "height": height, "light_width": width,
                            "light_height": height, "hat_columns": 0, "hat_rows": 0}.items():
            file.attrs.create(name, value, dtype=np.int32)
        file["basis/boxes"] = np.stack([x, y, x + 1, y + 1], -1).reshape(count, 4).astype(np.int32)
        file["statistics/training_error"] = np.empty(0, np.float32)
        file["transfer/column"] = np.arange(count, dtype=np.uint32)
        file["transfer/row_start"] = np.arange(count + 1, dtype=np.uint64)
        file["transfer/weight"] = np.ones((count, 3), np.float32)
