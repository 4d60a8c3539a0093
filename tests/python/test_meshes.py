# SPDX-License-Identifier: Apache-2.0
"""Each mesh format in the variants that it allows, one line for each: read as the truth, or refused, or with a note.

The table of docs/reference/scene-files.md has the same rows.
"""
import logging
import re

import h5py
import mesh_files
import numpy as np
import pytest
from mesh_files import (DRACO, M, STRIP_TRIANGLES, coloured, data_uri, draco, element, gltf, linear, mtl, obj, off, ply, png,
                        polypaint, strips, truth)

import refield

PLAIN, COLOURED = truth(), coloured()
MIRROR = np.float32([-1, 1, 1])


def as_m(name, data, **more):
    return {f"m.{name}": data, **more}


MTL = ["mtllib m.mtl", "usemtl m"]


def with_mtl(*lines, files={}):
    return as_m("obj", obj(places=True, corner="{p}/{p}", head=MTL), **{"m.mtl": mtl(*lines), **files})


def quads(factory, **options):
    return factory(lists=M["quads"], **options)


L_SHAPE = [0, 1, 2, 3, 7, 6, 5, 9, 8, 4]  # of the grid in z = 0: concave at vertex 5
WHITE = {"pbrMetallicRoughness": {"metallicFactor": 0}}  # 0.96 of the base colour and 0.04
LEVELS = M["colours"]
LINEAR = truth(reflectance=0.8 * LEVELS / 255)
RGBA = np.concatenate([LEVELS, np.full((12, 1), 64)], 1)


def material(base, positions=None, triangles=None):
    return truth(positions, triangles, reflectance=0.96 * np.asarray(base) + 0.04)


RED_BLUE = np.zeros((8, 8, 3)) + [255, 0, 0]
RED_BLUE[:, 4:] = [0, 0, 255]
HALVES = np.where(M["places"][:, :1] < 0.5, [1.0, 0.0, 0.0], [0.0, 0.0, 1.0])
TRANSPARENT_RED = np.zeros((8, 8, 4)) + [255, 0, 0, 0]
RED = {"images": [{"uri": data_uri(png(TRANSPARENT_RED), "image/png")}], "places": (M["places"], 5126), "texture_info": {"index": 0}}


def textured(info=None, image=RED_BLUE, **options):
    return gltf(material=options.pop("material", WHITE), places=options.pop("places", (M["places"], 5126)), texture_info={"index": 0, **(info or {})},
                images=options.pop("images", [{"uri": data_uri(png(image), "image/png")}]), **options)


def transform(**values):
    return {"extensions": {"KHR_texture_transform": values}}


def skinned(document):
    document["skins"] = [{"joints": [0]}]
    document["nodes"][0]["skin"] = 0


def morphing(document):
    document["meshes"][0]["weights"] = [0.5]
    document["meshes"][0]["primitives"][0]["targets"] = [{"POSITION": 0}]


def placed(matrix, positions=M["positions"]):
    return (np.asarray(positions) @ np.asarray(matrix)[:3, :3].T + np.asarray(matrix)[:3, 3]).astype(np.float32)


TURNED = np.array([[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, -2, 3], [0, 0, 0, 1.0]])  # determinant −2
FAN = [[0, 1, 5], [0, 5, 4]]
FLIPPED = np.array(M["triangles"])[:, ::-1]
INSTANCED = np.concatenate([PLAIN, truth(M["positions"] * MIRROR, FLIPPED)])

TETRAHEDRON = np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]), [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]

# (name, files, truth or None, pattern of the error or of the note)
READ = [
    ("ply ascii", as_m("ply", ply()), PLAIN, None),
    ("ply little endian", as_m("ply", ply("binary_little_endian")), PLAIN, None),
    ("ply big endian", as_m("ply", ply("binary_big_endian", colour="uchar")), COLOURED, None),
    ("ply lines of Windows", as_m("ply", ply(end="\r\n", colour="uchar")), COLOURED, None),
    ("ply binary, lines of Windows", as_m("ply", ply("binary_little_endian", "\r\n")), PLAIN, None),
    ("ply lines of Mac OS 9", as_m("ply", ply("binary_little_endian", "\r")), PLAIN, None),
    ("ply byte order mark", as_m("ply", ply(bom=True)), PLAIN, None),
    ("ply double", as_m("ply", ply("binary_big_endian", xyz="double", index="uint")), PLAIN, None),
    ("ply indices of a byte", as_m("ply", ply("binary_little_endian", index="uchar", count="int")), PLAIN, None),
    ("ply list vertex_index", as_m("ply", ply(list_name="vertex_index")), PLAIN, None),
    ("ply body begins with a line end", as_m("ply", ply("binary_little_endian", first=[("x", ["property uchar a"], [[("uchar", 10)]])])), PLAIN, None),
    ("ply body begins with a line end of Windows", as_m("ply", ply("binary_little_endian", "\r\n", first=[("x", ["property uchar a"], [[("uchar", 10)]])])), PLAIN, None),
    ("ply element before the vertices", as_m("ply", ply(first=[element("camera", 1, 2, 3)])), PLAIN, None),
    ("ply element after the faces", as_m("ply", ply("binary_big_endian", last=[element("edge", 1, 2)])), PLAIN, None),
    ("ply faces first", as_m("ply", ply("binary_little_endian", faces_first=True)), PLAIN, None),
    ("ply further properties", as_m("ply", ply("binary_little_endian", extra=[("double", "confidence"), ("char", "flag")], colour="uchar")), COLOURED, None),
    ("ply quadrilaterals", as_m("ply", quads(ply)), PLAIN, None),
    ("ply strips", as_m("ply", ply(faces="tristrips", lists=[strips()], count="int")),
     truth(triangles=STRIP_TRIANGLES), None),
    ("ply strips, binary", as_m("ply", ply("binary_big_endian", faces="tristrips", lists=[strips()], count="int")),
     truth(triangles=STRIP_TRIANGLES), None),
    ("ply fans", as_m("ply", ply(faces="trifans", lists=[[0, 1, 5, 4]])), truth(triangles=FAN), None),
    ("ply colours of floats", as_m("ply", ply(colour="float", scale=1 / 255)), COLOURED, None),
    ("ply colours of floats to 255", as_m("ply", ply(colour="float")), COLOURED, None),
    ("ply colours of int to 255", as_m("ply", ply(colour="int")), COLOURED, None),
    ("ply colours of 16 bits", as_m("ply", ply("binary_little_endian", colour="ushort", scale=257)), COLOURED, None),
    ("ply diffuse colours", as_m("ply", ply(colour="uchar", names=("diffuse_red", "diffuse_green", "diffuse_blue"))),
     COLOURED, None),
    ("ply names of capitals", as_m("ply", ply(colour="uchar", names=("Red", "Green", "BLUE"))), COLOURED, None),
    ("ply colours of faces", as_m("ply", ply("binary_little_endian", face_colour="uchar")),
     truth(corner_colours=np.repeat(0.8 * linear(LEVELS / 255)[:, None], 3, 1)), None),
    ("off", as_m("off", off()), PLAIN, None),
    ("off lines of Windows", as_m("off", off(end="\r\n")), PLAIN, None),
    ("off byte order mark", as_m("off", b"\xef\xbb\xbf" + off()), PLAIN, None),
    ("off comments", as_m("off", off(comment="# by hand")), PLAIN, None),
    ("off counts in the first line", as_m("off", off(counts_in_first_line=True)), PLAIN, None),
    ("off without its word", as_m("off", off(key="")), PLAIN, None),
    ("off quadrilaterals", as_m("off", quads(off)), PLAIN, None),
    ("off colours to 255", as_m("off", off("COFF", colours=RGBA.astype(int))), COLOURED, None),
    ("off colours to 1", as_m("off", off("COFF", colours=RGBA / 255)), COLOURED, None),
    ("off colours without alpha", as_m("off", off("COFF", colours=LEVELS.astype(int))), COLOURED, None),
    ("off normals, colours, coordinates", as_m("off", off("STCNOFF", colours=RGBA / 255)), COLOURED, None),
    ("off colours of faces", as_m("off", off(face_colours=LEVELS.astype(int))),
     truth(corner_colours=np.repeat(0.8 * linear(LEVELS / 255)[:, None], 3, 1)), None),
    ("obj", as_m("obj", obj()), PLAIN, None),
    ("obj lines of Windows", as_m("obj", obj(end="\r\n")), PLAIN, None),
    ("obj lines of Mac OS 9", as_m("obj", obj(end="\r")), PLAIN, None),
    ("obj byte order mark", as_m("obj", obj(bom=b"\xef\xbb\xbf")), PLAIN, None),
    ("obj relative indices", as_m("obj", obj(relative=True)), PLAIN, None),
    ("obj continued lines", as_m("obj", obj(corner="\\\n {p}")), PLAIN, None),
    ("obj w", as_m("obj", obj(w=" 1.0")), PLAIN, None),
    ("obj numbers with signs and exponents", as_m("obj", obj(number=lambda v: f"{v:+.9e}")), PLAIN, None),
    ("obj comments, groups, lines, points", as_m("obj", obj(between=["# f 1 2 3", "g a b", "s off", "l 1 2 3", "p 1 2"])), PLAIN, None),
    ("obj quadrilaterals", as_m("obj", quads(obj)), PLAIN, None),
    ("obj coordinates", as_m("obj", obj(places=True, corner="{p}/{p}")), PLAIN, None),
    ("obj colours", as_m("obj", obj(colours=LEVELS / 255)), COLOURED, None),
    ("obj colours to 255", as_m("obj", obj(colours=LEVELS)), COLOURED, None),
    ("obj colours of ZBrush", as_m("obj", obj(between=polypaint())), COLOURED, None),
    ("obj dark colours of ZBrush", as_m("obj", obj(between=polypaint(LEVELS // 200))),
     truth(reflectance=0.8 * linear(LEVELS // 200 / 255)), None),
    ("obj colours of some vertices", as_m("obj", obj(colours=[c if i % 2 else () for i, c in enumerate(LEVELS)])),
     truth(reflectance=0.8 * np.where(np.arange(12)[:, None] % 2, linear(LEVELS / 255), 1.0)), None),
    ("mtl Kd", with_mtl("Kd 0.1 0.2 0.3"), truth(reflectance=[0.1, 0.2, 0.3]), None),
    ("mtl byte order mark", as_m("obj", obj(head=MTL), **{"m.mtl": b"\xef\xbb\xbf" + mtl("Kd 0.3")}),
     truth(reflectance=0.3), None),
    ("mtl Kd of one value", with_mtl("Kd 0.3"), truth(reflectance=0.3), None),
    ("mtl illum 0", with_mtl("Kd 0.4 0.4 0.4", "Ks 0.5 0.5 0.5", "illum 0"), truth(reflectance=0.4), None),
    ("mtl illum 1", with_mtl("illum 1", "Kd 0.4 0.4 0.4", "Ks 0.5 0.5 0.5"), truth(reflectance=0.4), None),
    ("mtl illum 2", with_mtl("illum 2", "Kd 0.4 0.4 0.4", "Ks 0.5 0.5 0.5"), truth(reflectance=0.9), None),
    ("mtl comments, library named last", as_m("obj", obj(head=["# by hand", "usemtl m #1"], between=["mtllib m.mtl"]), **{"m.mtl": b"newmtl m #1\nKd 0.3 0.3 0.3 # grey\n"}), truth(reflectance=0.3), None),
    ("mtl keys in other cases", with_mtl("KD 0.3"), truth(reflectance=0.3), None),
    ("mtl name with blanks", as_m("obj", obj(head=["mtllib my own.mtl", "usemtl m"]), **{"my own.mtl": mtl("Kd 0.3")}),
     truth(reflectance=0.3), None),
    ("mtl of several files", as_m("obj", obj(head=["mtllib a.mtl b.mtl", "usemtl m"]), **{"a.mtl": b"newmtl a\nKd 1 0 0\n", "b.mtl": mtl("Kd 0.3")}), truth(reflectance=0.3), None),
    ("mtl path of Windows", as_m("obj", obj(head=["mtllib C:\\work\\m.mtl", "usemtl m"]), **{"m.mtl": mtl("Kd 0.3")}),
     truth(reflectance=0.3), None),
    ("mtl texture ignores alpha", with_mtl("Kd 1 1 1", "map_Kd my red.png", files={"my red.png": png(TRANSPARENT_RED)}), truth(reflectance=[1, 0, 0]), None),
    ("mtl texture scaled", with_mtl("map_Kd -s 0.4 1 1 m.png", files={"m.png": png(RED_BLUE)}),
     truth(reflectance=[1, 0, 0]), None),
    ("mtl texture moved", with_mtl("map_Kd -s 0.4 1 1 -o 0.55 0 -blendu on -type sphere 2.png", files={"2.png": png(RED_BLUE)}), truth(reflectance=[0, 0, 1]), None),
    ("gltf", gltf(), PLAIN, None),
    ("glb", gltf(binary=True), PLAIN, None),
    ("gltf byte order mark", gltf(bom=b"\xef\xbb\xbf"), PLAIN, None),
    ("gltf without indices", gltf(positions=M["positions"][M["triangles"]].reshape(-1, 3), indices=False), PLAIN, None),
    ("gltf indices of a byte", gltf(component=5121), PLAIN, None),
    ("gltf indices of 32 bits", gltf(component=5125), PLAIN, None),
    ("gltf strips", gltf(indices=strips()[:8], mode=5), truth(triangles=STRIP_TRIANGLES[:6]), None),
    ("gltf strips without indices", gltf(positions=M["positions"][strips()[:8]], indices=False, mode=5),
     truth(triangles=STRIP_TRIANGLES[:6]), None),
    ("gltf fans", gltf(indices=[0, 1, 5, 4], mode=6), truth(triangles=FAN), None),
    ("gltf sparse accessor", gltf(sparse=True), PLAIN, None),
    ("gltf Draco", draco(), PLAIN, None),
    ("gltf interleaved", gltf(stride=20), PLAIN, None),
    ("gltf colours of floats", gltf(colour=(LEVELS / 255, 5126)), LINEAR, None),
    ("gltf colours of bytes", gltf(colour=(RGBA, 5121)), LINEAR, None),
    ("gltf colours of 16 bits", gltf(colour=(257 * RGBA, 5123)), LINEAR, None),
    ("gltf mirrored", gltf(node={"scale": [-1, 1, 1]}), truth(M["positions"] * MIRROR, FLIPPED), None),
    ("gltf mirrored twice", gltf(nodes=[{"children": [1], "scale": [1, -1, 1]}, {"mesh": 0, "scale": [1, -1, 1]}]),
     PLAIN, None),
    ("gltf matrix that mirrors", gltf(node={"matrix": TURNED.T.ravel().tolist()}),
     truth(placed(TURNED), FLIPPED), None),
    ("gltf mesh in two nodes", gltf(nodes=[{"children": [1, 2]}, {"mesh": 0}, {"mesh": 0, "scale": [-1, 1, 1]}]), INSTANCED, None),
    ("gltf double-sided, closed", gltf(positions=TETRAHEDRON[0], indices=TETRAHEDRON[1], material={**WHITE, "doubleSided": True}), truth(*TETRAHEDRON, reflectance=1.0), None),
    ("gltf other scene", gltf(change=lambda d: d.update(scene=1, scenes=[{"nodes": []}, {"nodes": [0]}])), PLAIN, None),
    ("gltf name in percent encoding", gltf(uri=("my%20mesh%C3%A9.bin", "my meshé.bin")), PLAIN, None),
    ("gltf name with percent signs", gltf(uri=("100%25.bin", "100%25.bin")), PLAIN, None),
    ("gltf base colour", gltf(material={"pbrMetallicRoughness": {"metallicFactor": 0, "baseColorFactor": [0.2, 0.4, 0.6, 1]}}), material([0.2, 0.4, 0.6]), None),
    ("gltf opaque, alpha in the factor", gltf(material={"pbrMetallicRoughness": {"metallicFactor": 0, "baseColorFactor": [0.2, 0.4, 0.6, 0.1]}}), material([0.2, 0.4, 0.6]), None),
    ("gltf opaque, alpha in the texture", gltf(material=WHITE, **RED), material([1, 0, 0]), None),
    ("gltf unlit", gltf(material={**WHITE, "extensions": {"KHR_materials_unlit": {}}}, required=["KHR_materials_unlit"]), truth(reflectance=1.0), None),
    ("gltf texture", textured(), material(HALVES), None),
    ("gltf texture beside the mesh", {**textured(images=[{"uri": "my%20red.png"}]), "my red.png": png(RED_BLUE)},
     material(HALVES), None),
    ("gltf texture scaled", textured(transform(scale=[0.4, 1]), required=["KHR_texture_transform"]),
     material([1, 0, 0]), None),
    ("gltf texture moved", textured(transform(scale=[0.4, 1], offset=[0.55, 0]), used=["KHR_texture_transform"]),
     material([0, 0, 1]), None),
    # Counter-clockwise in an image whose rows go down: v is where u was.
    ("gltf texture turned", textured(transform(rotation=np.pi / 2, scale=[1, 0.4])), material([1, 0, 0]), None),
]
IGNORED = [
    ("ply colours of other names", as_m("ply", ply(colour="uchar", names=("ambient_red", "ambient_green", "ambient_blue"))),
     PLAIN, "property 'ambient_red' is ignored"),
    ("mtl black beside a texture", with_mtl("Kd 0 0 0", "map_Kd m.png", files={"m.png": png(RED_BLUE)}),
     truth(reflectance=HALVES), "multiply them by black"),
    ("gltf black beside a texture", textured(material={"pbrMetallicRoughness": {"metallicFactor": 0, "baseColorFactor": [0, 0, 0, 1]}}),
     material(HALVES), "multiply them by black"),
    ("ply texture missing", as_m("ply", ply(comment="comment TextureFile a.png")),
     truth(reflectance=1.0), "a texture of its materials is not in its folder"),
    ("off face colours of a colour map", as_m("off", off(face_colours=[[i] for i in range(12)])),
     PLAIN, "indices of a colour map are ignored"),
    ("obj material library missing", as_m("obj", obj(head=["mtllib absent.mtl", "usemtl m"])),
     PLAIN, "not all the materials"),
    ("mtl of two materials of one name", as_m("obj", obj(head=MTL), **{"m.mtl": b"newmtl m\nKd 0.3 0.3 0.3\nnewmtl m\nKd 0.9 0 0\n"}),
     truth(reflectance=0.3), "materials of one name"),
    ("obj free-form surface", as_m("obj", obj(between=["surf 0 1 0 1 1 2 3 4"])), PLAIN, "free-form"),
    ("mtl spectrum", with_mtl("Kd spectral a.rfl 1"), PLAIN, "spectra or CIE XYZ are ignored"),
    ("mtl CIE XYZ", with_mtl("Kd xyz 0.5 0.5 0.5"), PLAIN, "CIE XYZ are ignored"),
    ("mtl transparent", with_mtl("Kd 0.3", "d 0.5"), truth(reflectance=0.3), "transparency"),
    ("mtl Tr", with_mtl("Kd 0.3", "Tr 0.5"), truth(reflectance=0.3), "transparency"),
    ("mtl texture clamped", with_mtl("map_Kd -clamp on -mm 0 2 m.png", files={"m.png": png(RED_BLUE)}),
     truth(reflectance=HALVES), "options -clamp"),
    ("gltf mask", gltf(material={**WHITE, "alphaMode": "MASK"}, **RED), material([1, 0, 0]), "transparency"),
    ("gltf blend", gltf(material={**WHITE, "alphaMode": "BLEND"}, **RED), material([1, 0, 0]), "transparency"),
    ("gltf double-sided, open", gltf(material={**WHITE, "doubleSided": True}),
     truth(reflectance=1.0), "lit on one side"),
    ("gltf sampler that clamps", textured(change=lambda d: (d.update(samplers=[{"wrapS": 33071}]), d["textures"][0].update(sampler=0))), material(HALVES), "repeat, though their samplers"),
    ("gltf skin without bind matrices", gltf(change=skinned), PLAIN, "skins are ignored"),
    ("gltf morph targets", gltf(change=morphing), PLAIN, "morph targets are ignored"),
    ("gltf optional instancing", gltf(node={"extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 0}}}}, used=["EXT_mesh_gpu_instancing"]), PLAIN, "ignored.*: EXT_mesh_gpu_instancing"),
    ("gltf extension that it does not declare", gltf(material={**WHITE, "extensions": {"KHR_materials_ior": {"ior": 2.4}}}), material(1), "ignored.*: KHR_materials_ior"),
    ("gltf extensions of a vendor", gltf(used=["EXT_lights_ies", "MSFT_lod", "KHR_texture_transform"]), PLAIN, "ignored.*: EXT_lights_ies, MSFT_lod"),
    ("gltf clear coat", gltf(material={**WHITE, "extensions": {"KHR_materials_clearcoat": {"clearcoatFactor": 1}}}),
     truth(reflectance=1.0), "clear coat"),
    ("gltf texture without coordinates", textured(places=None), truth(reflectance=1.0), "first texture coordinates"),
    ("gltf second coordinates", textured({"texCoord": 1}, extra_attributes=[("TEXCOORD_1", M["places"])]),
     truth(reflectance=1.0), "first texture coordinates"),
]
FAR = np.float32([512345, 5812345, 112])
REFUSED = [
    ("obj far from the origin", as_m("obj", obj(positions=M["positions"] + FAR)), None, "times its size away from the origin"),
    ("ply doubles far from the origin", as_m("ply", ply("binary_little_endian", xyz="double", positions=M["positions"] + FAR.astype(float))),
     None, "times its size away from the origin"),
    ("gltf far from the origin", gltf(node={"translation": FAR.tolist()}), None, "times its size away from the origin"),
    ("ply of two textures", as_m("ply", ply(comment="comment TextureFile a.png\ncomment TextureFile b.png")), None, "several textures"),
    ("gltf without scenes", gltf(change=lambda d: (d.pop("scene"), d.pop("scenes"))), None, "has no scene"),
    ("gltf 1.0", gltf(change=lambda d: d.update(asset={"version": "1.0"})), None, "not of glTF 2.0"),
    ("glb named gltf", {"m.gltf": gltf(binary=True)["m.glb"]}, None, "it is a GLB file"),
    ("glb with a buffer beside it", gltf(binary=True, buffer_uri="a.bin"), None, "first buffer is another file"),
    ("ply index out of range", as_m("ply", ply(lists=[[0, 1, 99]])),
     None, "names vertex 99 of 12: the index is out of range"),
    ("ply negative index", as_m("ply", ply(lists=[[0, 1, -1]])), None, "index is out of range"),
    ("ply cut off", as_m("ply", ply("binary_little_endian")[:-5]), None, "cut off"),
    ("ply text cut off", as_m("ply", ply()[:-20]), None, "missing"),
    ("ply with more than it promises", as_m("ply", ply() + b"3 0 1 2\n"), None, "more than its header promises"),
    ("ply points", as_m("ply", ply(lists=[])), None, "convert a point cloud"),
    ("ply unknown list", as_m("ply", ply(list_name="corners")), None, "no list vertex_indices"),
    ("ply decimal commas", as_m("ply", ply().replace(b"0.25", b"0,25")), None, "decimal points"),
    ("off index out of range", as_m("off", off(lists=[[0, 1, 12]])), None, "names vertex 12 of 12"),
    ("off of four dimensions", as_m("off", off("4OFF")), None, "four-dimensional"),
    ("off binary", as_m("off", b"OFF BINARY\n" + bytes(60)), None, "binary"),
    ("off undeclared colours", as_m("off", off("OFF", colours=RGBA.astype(int))), None, "COFF"),
    ("off cut off", as_m("off", off()[:-12]), None, "cut off"),
    ("obj index out of range", as_m("obj", obj(lists=[[0, 1, 12]])),
     None, "names vertex 12 of 12|index is out of range"),
    ("obj colours of ZBrush for others", as_m("obj", obj(between=polypaint()[:2])), None, "of 5 of its 12 vertices"),
    ("obj colours of ZBrush cut off", as_m("obj", obj(between=["#MRGB ff1234"])), None, "8 hexadecimal digits"),
    ("obj index 0", as_m("obj", obj(lists=[[-1, 0, 1]])), None, "index is out of range"),
    ("obj UTF-16", as_m("obj", obj(bom=b"\xff\xfe", encoding="utf-16-le")), None, "UTF-16"),
    ("obj decimal commas", as_m("obj", obj(number=lambda v: str(v).replace(".", ","))),
     None, "line 1: .*decimal points"),
    ("obj points", as_m("obj", obj(lists=[])), None, "convert a point cloud"),
    ("gltf index out of range", gltf(indices=[[0, 1, 2], [0, 1, 99]]), None, "index is out of range"),
    ("gltf index out of range, strips", gltf(indices=[0, 1, 2, 99], mode=5), None, "index is out of range"),
    ("gltf of a later version", gltf(change=lambda document: document["asset"].update(version="2.1", minVersion="2.1")), None, "not of glTF 2.0"),
    ("gltf required extension", gltf(required=["EXT_meshopt_compression"]),
     None, "requires the glTF extension EXT_meshopt_compression"),
    ("gltf quantized positions", gltf(change=lambda d: d["accessors"][0].update(componentType=5122), stride=12),
     None, "POSITION is stored as integers"),
    ("gltf integer coordinates", textured(places=(255 * M["places"], 5121)), None, "TEXCOORD_0 is stored as integers"),
    ("gltf Draco cut off", draco(DRACO[:90]), None, "Draco data are damaged"),
    ("gltf Draco of other numbers", draco(triangles=13), None, "breaks the format|index is out of range"),
    ("gltf cut off", {"m.gltf": gltf()["m.gltf"][:-9]}, None, "JSON is damaged"),
    ("glb cut off", {"m.glb": gltf(binary=True)["m.glb"][:-9]}, None, "cut off"),
    ("gltf buffer missing", {"m.gltf": gltf(uri=("a.bin", "a.bin"))["m.gltf"]}, None, "cannot be opened"),
    ("gltf points", gltf(mode=0), None, "convert a point cloud"),
]


def corners_of(folder, files):
    """What refield reads, as truth() tells it."""
    for name, data in files.items():
        (folder / name).write_bytes(data)
    mesh = next(folder / name for name in files if name.split(".")[-1] in ("ply", "off", "obj", "gltf", "glb"))
    field = refield.precompute(mesh, "sh", sh_order=2, directions=64)
    field.save(folder / "m.rfield")
    with h5py.File(folder / "m.rfield") as file:
        values = np.concatenate([file["mesh/positions"][...], file["mesh/colours"][...]], 1)
        return values[file["mesh/triangles"][...]]


def in_order(corners):
    """Triangles begin with their smallest corner and are sorted."""
    first = [min(range(3), key=lambda i: tuple(triangle[i, :3].round(4) + 0.0)) for triangle in corners]
    turned = [np.roll(triangle, -i, 0) for triangle, i in zip(corners, first)]
    return np.array(sorted(turned, key=lambda triangle: tuple((triangle[:, :3].round(4) + 0.0).ravel())))


@pytest.mark.parametrize("name,files,expected,pattern", READ + IGNORED, ids=lambda value: value if isinstance(value, str) else "")
def test_variants_are_read_as_the_format_says(name, files, expected, pattern, tmp_path, caplog):
    with caplog.at_level(logging.WARNING, "refield"):
        corners = in_order(corners_of(tmp_path, files))
    notes = " ".join(record.getMessage() for record in caplog.records)
    expected = in_order(np.asarray(expected, float))
    assert corners.shape == expected.shape
    assert np.abs(corners[..., :3] - expected[..., :3]).max() < 1e-5
    assert np.abs(corners[..., 3:] - expected[..., 3:]).max() < 2e-3
    assert re.search(pattern, notes) if pattern else not notes


@pytest.mark.parametrize("name,files,expected,pattern", REFUSED, ids=lambda value: value if isinstance(value, str) else "")
def test_others_are_refused_by_name(name, files, expected, pattern, tmp_path):
    with pytest.raises(refield.FormatError, match=pattern):
        corners_of(tmp_path, files)


def test_a_concave_polygon_is_its_own_area(tmp_path):
    corners = corners_of(tmp_path, as_m("obj", obj(lists=[L_SHAPE])))
    projected = corners[..., :2]
    a, b = projected[:, 1] - projected[:, 0], projected[:, 2] - projected[:, 0]
    areas = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    assert len(corners) == 8 and (areas <= 1e-6).all() and abs(areas.sum() / 2 + 4) < 1e-5
