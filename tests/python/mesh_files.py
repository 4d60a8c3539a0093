# SPDX-License-Identifier: Apache-2.0
"""Writes meshes in the variants that their formats allow, and tells what a reader must make of them.

Everything is computed here with NumPy, from the formats' descriptions, and not with the readers' code.
"""
import base64
import json
import struct

import numpy as np


def terrain():
    """4×3 vertices, 12 triangles, without any symmetry: z is a mirrored, sheared, rough surface."""
    x, y = np.meshgrid(np.arange(4.0), np.arange(3.0))
    positions = np.stack([x, y, 0.25 * x - 0.125 * y * y + 0.5 * (x == 1) * (y == 1)], -1).reshape(-1, 3)
    corner = np.array([i + 4 * j for j in range(2) for i in range(3)])
    quads = np.stack([corner, corner + 1, corner + 5, corner + 4], -1)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    colours = np.stack([np.linspace(20, 250, 12), np.linspace(240, 30, 12), np.full(12, 100)], -1).round()
    return {"positions": positions.astype(np.float32), "triangles": triangles, "quads": quads, "colours": colours,
            "places": np.stack([x / 3, y / 2], -1).reshape(-1, 2)}


M = terrain()


def linear(srgb):
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def truth(positions=None, triangles=None, reflectance=0.8, corner_colours=None):
    """Triangles in light axes: [m, 3, 6] of x, y, z and linear reflectance. Colours: [n, 3], or [m, 3, 3] of corners."""
    positions = M["positions"] if positions is None else np.asarray(positions)
    triangles = M["triangles"] if triangles is None else np.asarray(triangles)
    colours = np.broadcast_to(reflectance, positions.shape)
    corners = colours[triangles] if corner_colours is None else corner_colours
    return np.concatenate([positions[triangles] * [1, 1, -1], corners], -1)[:, ::-1]


def coloured(levels=255.0):
    """The terrain with its vertex colours, which OBJ, PLY and OFF have in sRGB; without a material, times 0.8."""
    return truth(reflectance=0.8 * linear(M["colours"] / levels))


# ---- PLY

PLY_TYPES = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4", "double": "f8"}


def strips():
    rows = [[v for i in range(4) for v in (4 * (j + 1) + i, 4 * j + i)] for j in range(2)]
    return rows[0] + [-1] + rows[1]


STRIP_TRIANGLES = [(a, b, c) if k % 2 == 0 else (b, a, c)
                   for row in (strips()[:8], strips()[9:]) for k, (a, b, c) in enumerate(zip(row, row[1:], row[2:]))]


def ply(encoding="ascii", end="\n", xyz="float", colour=None, names=("red", "green", "blue"), scale=1.0, count="uchar",
        index="int", faces="face", lists=None, list_name="vertex_indices", first=(), last=(), face_colour=None,
        positions=None, bom=False, comment="comment made by hand", faces_first=False, extra=()):
    """One PLY file. first, last: elements (name, properties, rows) around the mesh; extra: vertex properties."""
    positions = M["positions"] if positions is None else positions
    vertex = [(f"property {xyz} {axis}", xyz) for axis in "xyz"] + [(f"property {kind} {name}", kind) for kind, name in extra]
    vertex += [(f"property {colour} {name}", colour) for name in names] if colour else []
    rows = [[(kind, value) for (_, kind), value in zip(vertex, [*p, *(7 for _ in extra), *(scale * c)])]
            for p, c in zip(positions, M["colours"])]
    lists = M["triangles"] if lists is None else lists
    face = [f"property list {count} {index} {list_name}"]
    face += [f"property {face_colour} {name}" for name in names] if face_colour else []
    face_rows = [[(count, len(corners))] + [(index, corner) for corner in corners] +
                 ([(face_colour, value) for value in M["colours"][i % 12]] if face_colour else [])
                 for i, corners in enumerate(lists)]
    mesh = [("vertex", [text for text, _ in vertex], rows), (faces, face, face_rows)]
    elements = [*first, *(mesh[::-1] if faces_first else mesh), *last]
    header = ["ply", f"format {encoding} 1.0", comment]
    for name, properties, content in elements:
        header += [f"element {name} {len(content)}", *properties]
    text = end.join([*header, "end_header", ""]).encode()
    order = ">" if encoding == "binary_big_endian" else "<"
    for _, _, content in elements:
        for row in content:
            if encoding == "ascii":
                text += (" ".join(repr(float(v)) if k in ("float", "double") else str(int(v)) for k, v in row) + end).encode()
            else:
                text += b"".join(np.array(v).astype(order + PLY_TYPES[k]).tobytes() for k, v in row)
    return (b"\xef\xbb\xbf" if bom else b"") + text


def element(name, *values):
    return (name, [f"property float p{i}" for i in range(len(values))], [[("float", v) for v in values]])


# ---- OFF

def off(key="OFF", end="\n", colours=None, face_colours=None, lists=None, counts_in_first_line=False, comment=""):
    lists = M["triangles"] if lists is None else lists
    counts = f"12 {len(lists)} 0"
    lines = [comment, f"{key} {counts}"] if counts_in_first_line else [key, comment, counts] if key else [counts]
    for i, p in enumerate(M["positions"]):
        values = list(p) + ([0, 0, 1] if "N" in key else []) + (list(colours[i]) if colours is not None else [])
        lines.append(" ".join(map(str, values + (list(M["places"][i]) if "ST" in key else []))))
    for i, corners in enumerate(lists):
        lines.append(" ".join(map(str, [len(corners), *corners, *(face_colours[i] if face_colours is not None else ())])))
    return end.join(lines + [""]).encode()


# ---- OBJ

def obj(end="\n", head=(), colours=None, w="", relative=False, lists=None, places=False, bom=b"", between=(), number=str,
        corner="{p}", encoding="utf-8", positions=None):
    lists = M["triangles"] if lists is None else lists
    lines = [*head]
    for i, p in enumerate(M["positions"] if positions is None else positions):
        lines.append("v " + " ".join(map(number, p)) + w + ("" if colours is None else " " + " ".join(map(str, colours[i]))))
        if places:
            lines.append("vt " + " ".join(map(str, M["places"][i])))
    lines += between
    shift = -12 if relative else 1
    for corners in lists:
        lines.append("f " + " ".join(corner.format(p=c + shift) for c in corners))
    return bom + end.join(lines + [""]).encode(encoding)


def polypaint(colours=M["colours"], per_line=5):
    """As ZBrush writes colours of vertices."""
    words = ["ff" + "".join(f"{int(level):02x}" for level in colour) for colour in colours]
    return ["#Auto scale", *("#MRGB " + "".join(words[i:i + per_line]) for i in range(0, len(words), per_line)), "# End of MRGB block"]


def mtl(*lines):
    return "\n".join(["newmtl m", *lines, ""]).encode()


# ---- glTF

COMPONENTS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}


def gltf(positions=None, indices=None, component=5123, mode=None, colour=None, places=None, node=None, nodes=None,
         material=None, images=None, textures=None, required=(), used=(), binary=False, sparse=False, bom=b"", change=None,
         uri=None, texture_info=None, extra_attributes=(), stride=0, buffer_uri=None):
    """A document of one mesh, and its buffer: {name: bytes}. `change` edits the JSON."""
    positions = M["positions"] if positions is None else positions
    buffer, views, accessors = b"", [], []

    def add(values, kind, code, normalised=False, count=None, step=0):
        nonlocal buffer
        values = np.asarray(values).astype(COMPONENTS[code])
        data = values.tobytes()
        if step:
            data = b"".join(row.tobytes().ljust(step, b"\x7f") for row in values)
        buffer += b"\0" * (-len(buffer) % 4)
        views.append({"buffer": 0, "byteOffset": len(buffer), "byteLength": len(data), **({"byteStride": step} if step else {})})
        buffer += data
        accessor = {"bufferView": len(views) - 1, "componentType": code, "count": len(values), "type": kind}
        if kind == "VEC3" and code == 5126:
            accessor.update(min=values.min(0).tolist(), max=values.max(0).tolist())
        if normalised:
            accessor["normalized"] = True
        accessors.append(accessor)
        return len(accessors) - 1

    attributes = {"POSITION": add(np.zeros_like(positions) if sparse else positions, "VEC3", 5126, step=stride)}
    if sparse:  # all values are exceptions
        add(np.arange(len(positions)), "SCALAR", 5123)
        add(positions, "VEC3", 5126)
        del accessors[-2:]
        accessors[0]["sparse"] = {"count": len(positions), "indices": {"bufferView": 1, "componentType": 5123}, "values": {"bufferView": 2}}
    if colour is not None:
        values, code = colour
        attributes["COLOR_0"] = add(values, f"VEC{values.shape[1]}", code, code != 5126)
    if places is not None:
        values, code = places
        attributes["TEXCOORD_0"] = add(values, "VEC2", code, code != 5126)
    primitive = {"attributes": attributes}
    for name, values in extra_attributes:
        attributes[name] = add(values, "VEC2", 5126)
    if indices is not False:
        primitive["indices"] = add(np.asarray(M["triangles"] if indices is None else indices).ravel(), "SCALAR", component)
    if mode is not None:
        primitive["mode"] = mode
    document = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
                "nodes": nodes or [{"mesh": 0, **(node or {})}], "meshes": [{"primitives": [primitive]}],
                "accessors": accessors, "bufferViews": views}
    if material is not None:
        if texture_info is not None:
            material = {**material, "pbrMetallicRoughness": {**material.get("pbrMetallicRoughness", {}), "baseColorTexture": texture_info}}
        document["materials"] = [material]
        primitive["material"] = 0
    if images:
        document["images"], document["textures"] = images, textures or [{"source": 0}]
    if required:
        document["extensionsRequired"] = list(required)
    if required or used:
        document["extensionsUsed"] = [*required, *used]
    if change:
        change(document)
    document["buffers"] = [{"byteLength": len(buffer), **({"uri": buffer_uri} if buffer_uri else {})}]
    if binary:
        text = json.dumps(document).encode()
        text += b" " * (-len(text) % 4)
        buffer += b"\0" * (-len(buffer) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(buffer), b"BIN\0") + buffer
        return {"m.glb": b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks}
    files = {}
    if uri:
        files[uri[1]], document["buffers"][0]["uri"] = buffer, uri[0]
    else:
        document["buffers"][0]["uri"] = data_uri(buffer)
    return {"m.gltf": bom + json.dumps(document).encode(), **files}


# The terrain by draco_encoder 1.5.5 -qp 0 -cl 5.
DRACO = base64.b64decode("RFJBQ08CAgEBAAAADAwADAIABH+69in/AREB/wAAAQAJAwAAAAAAgD8AAIA/AAAgPwAAAAAAAIA/AAAAvgAAAAAAAAAAAAAAAAAA"
                         "gD8AAAAAAACAPgAAAEAAAIA/AADAPgAAAEAAAAAAAAAAPwAAQEAAAIA/AAAgPwAAQEAAAAAAAABAPwAAQEAAAABAAACAPgAAAEAA"
                         "AABAAAAAAAAAgD8AAABAAACAvgAAAAAAAABAAAAAvw==")


def draco(data=DRACO, triangles=12):
    extension = {"bufferView": 0, "attributes": {"POSITION": 0}}
    return {"m.gltf": json.dumps({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "extensionsUsed": ["KHR_draco_mesh_compression"], "extensionsRequired": ["KHR_draco_mesh_compression"],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1,
                                    "extensions": {"KHR_draco_mesh_compression": extension}}]}],
        "accessors": [{"componentType": 5126, "count": 12, "type": "VEC3", "min": [0, 0, -1], "max": [3, 2, 2]},
                      {"componentType": 5123, "count": 3 * triangles, "type": "SCALAR"}],
        "bufferViews": [{"buffer": 0, "byteLength": len(data)}],
        "buffers": [{"byteLength": len(data), "uri": data_uri(data)}]}).encode()}


def data_uri(data, kind="application/octet-stream"):
    return f"data:{kind};base64," + base64.b64encode(data).decode()


def png(pixels):
    """8 bits, RGB or RGBA: [height, width, channels]."""
    import zlib
    pixels = np.asarray(pixels, np.uint8)

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", pixels.shape[1], pixels.shape[0], 8, 2 if pixels.shape[2] == 3 else 6, 0, 0, 0)
    body = b"".join(b"\0" + row.tobytes() for row in pixels)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(body)) + chunk(b"IEND", b"")
