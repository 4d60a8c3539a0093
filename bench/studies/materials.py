#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Checks how materials of glTF and OBJ files are shown: ten meshes beside Blender's Cycles.

    bench/studies/materials.py MESH_FOLDER -o OUT --program build/release/cli/refield

Writes seven meshes, takes three from MESH_FOLDER (npm_teapot.obj, pmndrs_bunny.glb, pmndrs_suzi.glb), and precomputes each
with `refield precompute`: by harmonics where it has lobes, else by light clusters with two reflections. All are relit by
one smooth environment map and compared with Cycles, which draws the same triangles with its Principled BSDF; base colour,
metallic and roughness are given to it at the vertices, from the formulas that textures and factors of the files were made
from, so that nothing of the reading of materials is shared.

Prints a table: file, materials, method, vertices, relative RMSE over the pixels that the mesh covers whole, ratio of mean
brightness, noise of Cycles. Leaves the files and, per mesh, refield's picture, that of Cycles and four
times their difference in OUT/NAME/sky.png.

Needs Debian's blender, numpy, h5py and the Python module of OpenImageIO.
"""
import argparse
import json
import pathlib
import subprocess
import sys

import cycles
import numpy

DIRECTIONS, ORDER, BOUNCES = 1024, 6, 4
CAMERA = """
[camera]
position = [0.8, 0.7, -1.7]
target = [0.0, 0.0, 0.0]
vertical_fov_degrees = 40
width = {}
height = {}
"""
DIELECTRIC = 0.5  # of "Specular" of the Principled BSDF: 4 % at normal incidence
WHITE = (0.8, 0.8, 0.8)  # of files without materials


# ---- shapes: positions (right-handed, Y up) and texture coordinates on a grid, v up


def grid(columns, rows):
    u, v = numpy.meshgrid(numpy.linspace(0, 1, columns + 1), numpy.linspace(0, 1, rows + 1))
    a = (numpy.arange(rows)[:, None] * (columns + 1) + numpy.arange(columns)).ravel()
    faces = numpy.concatenate([numpy.stack([a, a + 1, a + columns + 2], 1), numpy.stack([a, a + columns + 2, a + columns + 1], 1)])
    return u.ravel(), v.ravel(), faces


def sphere(columns=64, rows=32, radius=0.5):
    u, v, faces = grid(columns, rows)
    azimuth, height = 2 * numpy.pi * u, -numpy.cos(numpy.pi * v)
    across = numpy.sin(numpy.pi * v)
    return radius * numpy.stack([across * numpy.sin(azimuth), height, across * numpy.cos(azimuth)], 1), numpy.stack([u, v], 1), faces


def torus(columns=64, rows=28):
    u, v, faces = grid(columns, rows)
    around, along = 2 * numpy.pi * u, 2 * numpy.pi * v
    across = 0.34 + 0.16 * numpy.cos(along)
    return (numpy.stack([across * numpy.sin(around), 0.16 * numpy.sin(along), across * numpy.cos(around)], 1),
            numpy.stack([u, v], 1), faces)


def floor(steps=24, height=-0.3):
    u, v, faces = grid(steps, steps)
    return numpy.stack([u - 0.5, numpy.full_like(u, height), 0.5 - v], 1), numpy.stack([u, v], 1), faces


# ---- patterns over texture coordinates [..., 2]


def wave(uv, columns, rows):
    return 0.5 + 0.5 * numpy.sin(2 * numpy.pi * columns * uv[..., 0]) * numpy.cos(2 * numpy.pi * rows * uv[..., 1])


def paint(uv):
    share = wave(uv, 3, 2)[..., None]
    return share * numpy.array([0.9, 0.5, 0.1]) + (1 - share) * numpy.array([0.1, 0.2, 0.6])


def tint(uv):
    return numpy.stack([0.3 + 0.7 * wave(uv, 2, 1), 0.6 + 0 * uv[..., 0], 0.9 - 0.6 * wave(uv, 1, 2)], -1)


def constant(*values):
    return lambda uv: numpy.broadcast_to(values, (*uv.shape[:-1], len(values)))


def texels(pattern, side=256):
    """An image of a pattern, upper row first."""
    u, v = numpy.meshgrid((numpy.arange(side) + 0.5) / side, 1 - (numpy.arange(side) + 0.5) / side)
    return pattern(numpy.stack([u, v], -1))


def srgb(linear):
    return numpy.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def write_image(path, values, kind):
    import OpenImageIO as oiio
    output = oiio.ImageOutput.create(str(path))
    output.open(str(path), oiio.ImageSpec(values.shape[1], values.shape[0], 3, kind))
    output.write_image((255 * values + 0.5).astype(numpy.uint8) if kind == "uint8" else values.astype(numpy.float32))
    output.close()


# ---- files


def normals_of(positions, faces):
    """The same for vertices in the same place, as at a seam of the texture."""
    p = positions[faces]
    across = numpy.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    _, place = numpy.unique(numpy.round(positions, 5), axis=0, return_inverse=True)
    sums = numpy.zeros((place.max() + 1, 3))
    for corner in range(3):
        numpy.add.at(sums, place.ravel()[faces[:, corner]], across)
    normals = sums[place.ravel()]
    return normals / numpy.maximum(numpy.linalg.norm(normals, axis=1, keepdims=True), 1e-12)


def write_gltf(path, parts):
    """`parts`: (shape, pbrMetallicRoughness, vertex colours or None, images by file name)."""
    data, views, accessors, primitives, materials, images = b"", [], [], [], [], []

    def accessor(values, kind, component):
        nonlocal data
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": values.nbytes})
        data += values.tobytes()
        accessors.append({"bufferView": len(views) - 1, "componentType": component, "count": len(values), "type": kind})
        if kind == "VEC3":
            accessors[-1].update(min=values.min(0).tolist(), max=values.max(0).tolist())
        return len(accessors) - 1

    for (positions, uv, faces), material, colours, maps in parts:
        flipped = numpy.stack([uv[:, 0], 1 - uv[:, 1]], 1)  # glTF counts from the upper row
        attributes = {"POSITION": accessor(positions.astype("<f4"), "VEC3", 5126),
                      "NORMAL": accessor(normals_of(positions, faces).astype("<f4"), "VEC3", 5126),
                      "TEXCOORD_0": accessor(flipped.astype("<f4"), "VEC2", 5126)}
        if colours is not None:
            attributes["COLOR_0"] = accessor(colours.astype("<f4"), "VEC3", 5126)
        primitives.append({"attributes": attributes, "indices": accessor(faces.astype("<u4").ravel(), "SCALAR", 5125),
                           "material": len(materials)})
        material = dict(material)
        for key, (name, values) in maps.items():
            write_image(path.parent / name, values, "uint8")
            material[key] = {"index": len(images)}
            images.append({"uri": name})
        materials.append({"pbrMetallicRoughness": material})
    path.with_suffix(".bin").write_bytes(data)
    path.write_text(json.dumps({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": primitives}], "materials": materials, "images": images,
        "textures": [{"source": i} for i in range(len(images))], "accessors": accessors, "bufferViews": views,
        "buffers": [{"uri": path.with_suffix(".bin").name, "byteLength": len(data)}]}))


def write_obj(path, parts):
    """`parts`: (shape, lines of its material, vertex colours or None)."""
    lines, materials, first = [f"mtllib {path.stem}.mtl"], [], 1
    for number, ((positions, uv, faces), material, colours) in enumerate(parts):
        materials += [f"newmtl m{number}", *material]
        points = positions if colours is None else numpy.hstack([positions, srgb(colours)])
        lines += [" ".join(["v", *(f"{x:.6f}" for x in point)]) for point in points]
        lines += [f"vt {u:.6f} {v:.6f}" for u, v in uv]
        lines += [f"usemtl m{number}"] + [" ".join(["f", *(f"{i + first}/{i + first}" for i in face)]) for face in faces]
        first += len(positions)
    path.write_text("\n".join(lines) + "\n")
    path.with_suffix(".mtl").write_text("\n".join(materials) + "\n")


class Case:
    """A file and what Cycles is told of its parts: (shape, base colour, and metallic, roughness, specular over texture
    coordinates). A part without a shape is the whole mesh."""

    def __init__(self, file, materials, parts, placement=""):
        self.file, self.materials, self.parts, self.placement = file, materials, parts, placement

    def surface(self, positions):
        """Base colours and lobes at points of the file: those of the nearest vertex that was written."""
        base, lobes = numpy.empty((len(positions), 3)), numpy.empty((len(positions), 3))
        nearest = numpy.full(len(positions), numpy.inf)
        for shape, colour, lobe in self.parts:
            if shape is None:
                base[:], lobes[:] = colour(numpy.zeros(2)), lobe(numpy.zeros(2))
                continue
            distance = numpy.linalg.norm(positions[:, None] - shape[0][None], axis=2)
            closest = distance.argmin(1)
            better = distance.min(1) < nearest
            uv = shape[1][closest]
            base[better], lobes[better] = colour(uv)[better], lobe(uv)[better]
            nearest = numpy.minimum(nearest, distance.min(1))
        return base, lobes


def generated(folder):
    ball, ring, ground = sphere(), torus(), floor()
    small = (0.6 * ball[0], ball[1], ball[2])
    gold, copper = (1.0, 0.77, 0.34), (0.95, 0.64, 0.54)

    def painted(uv):
        return srgb(paint(uv))

    def patches(uv):
        return numpy.stack([wave(uv, 2, 2), 0.5 + 0 * uv[..., 0], wave(uv, 2, 2)], -1)

    def lobe_of(metallic, roughness, specular=DIELECTRIC):
        return constant(metallic, roughness, specular)

    dull = {"metallicFactor": 0, "roughnessFactor": 0.6}
    write_gltf(folder / "metal.gltf", [(ball, {"baseColorFactor": [*gold, 1], "roughnessFactor": 0.5}, None, {})])
    yield Case(folder / "metal.gltf", "metallic factor", [(ball, constant(*gold), lobe_of(1, 0.5))])
    write_gltf(folder / "texture.gltf", [(ball, dull, None, {"baseColorTexture": ("paint.png", texels(painted))})])
    yield Case(folder / "texture.gltf", "base colour texture", [(ball, paint, lobe_of(0, 0.6))])
    write_gltf(folder / "patches.gltf", [(ring, {"baseColorFactor": [*copper, 1], "roughnessFactor": 1}, None,
                                          {"metallicRoughnessTexture": ("patches.png", texels(patches))})])
    yield Case(folder / "patches.gltf", "metallic-roughness texture",
               [(ring, constant(*copper), lambda uv: numpy.stack([wave(uv, 2, 2), 0.5 + 0 * uv[..., 0],
                                                                 DIELECTRIC + 0 * uv[..., 0]], -1))])
    write_gltf(folder / "colours.gltf", [(ring, {"metallicFactor": 1, "roughnessFactor": 0.6}, tint(ring[1]), {})])
    yield Case(folder / "colours.gltf", "metal, vertex colours", [(ring, tint, lobe_of(1, 0.6))])
    write_gltf(folder / "parts.gltf", [
        (small, {"baseColorFactor": [*gold, 1], "roughnessFactor": 0.5}, None, {}),
        (ground, {"metallicFactor": 0}, None, {"baseColorTexture": ("ground.png", texels(painted))})])
    yield Case(folder / "parts.gltf", "metal over textured floor",
               [(small, constant(*gold), lobe_of(1, 0.5)), (ground, paint, lobe_of(0, 1))])
    write_image(folder / "copper.png", texels(painted), "uint8")
    write_obj(folder / "pbr.obj", [(ring, ["Kd 1 1 1", "map_Kd copper.png", "Pm 1", "Pr 0.55"], None)])
    yield Case(folder / "pbr.obj", "MTL: map_Kd, Pm, Pr", [(ring, paint, lobe_of(1, 0.55))])
    # Ns 14 is α² = 1/8.
    write_obj(folder / "phong.obj", [(small, ["Kd 0.5 0.5 0.5", "Ks 0.3 0.3 0.3", "Ns 14", "illum 2"], tint(small[1])),
                                     (ground, ["Kd 0.6 0.5 0.4"], numpy.ones_like(ground[0]))])
    yield Case(folder / "phong.obj", "MTL: Ks, Ns; vertex colours",
               [(small, lambda uv: 0.5 * tint(uv), lobe_of(0, 8 ** -0.25, 0.3 / 0.08)),
                (ground, constant(0.6, 0.5, 0.4), lobe_of(0, 1, 0))])


def collected(folder):
    placed = "size = 1.0\nposition = [0, 0, 0]\n"
    yield Case(folder / "npm_teapot.obj", "none", [(None, constant(*WHITE), constant(0, 1, 0))], placed)
    yield Case(folder / "pmndrs_bunny.glb", "dielectric factor", [(None, constant(*WHITE), constant(0, 0.5, DIELECTRIC))], placed)
    yield Case(folder / "pmndrs_suzi.glb", "defaults: rough white metal", [(None, constant(1, 1, 1), constant(1, 1, 0))], placed)


def write_sky(path):
    """Two broad lights over a grey horizon."""
    width, height = 128, 64
    azimuth = numpy.radians((numpy.arange(width) + 0.5) * 360 / width - 180)
    elevation = numpy.radians(90 - (numpy.arange(height) + 0.5) * 180 / height)[:, None]
    directions = numpy.stack(numpy.broadcast_arrays(numpy.cos(elevation) * numpy.sin(azimuth), numpy.sin(elevation),
                                                    numpy.cos(elevation) * numpy.cos(azimuth)), -1)
    sky = numpy.full((height, width, 3), 0.15)
    for towards, width_of_light, colour in (((0.7, 0.7, -0.6), 6, (2.5, 2.2, 1.8)), ((-0.8, 0.3, -0.3), 5, (0.5, 0.8, 1.4))):
        cosine = directions @ (numpy.array(towards) / numpy.linalg.norm(towards))
        sky += numpy.exp(width_of_light * (cosine - 1))[..., None] * numpy.array(colour)
    write_image(path, sky, "float")


def run(program, *arguments):
    return subprocess.run([program, "--quiet", *map(str, arguments)], check=True, capture_output=True, text=True)


def measure(case, sky, arguments):
    """A row of the table."""
    folder = arguments.output / case.file.stem
    folder.mkdir(parents=True, exist_ok=True)
    scene, field = folder / "scene.toml", folder / f"{case.file.stem}.rfield"
    width, height = arguments.size.split("x")
    scene.write_text(f'[[object]]\nfile = "{case.file.resolve()}"\n{case.placement}{CAMERA.format(width, height)}')
    glossy = any((lobe(numpy.zeros((1, 2)))[0, 1] <= 0.9) for _, _, lobe in case.parts)
    method = ["--method", "sh", "--sh-order", ORDER, "--directions", DIRECTIONS] if glossy else ["--resolution", 128, "--diffuse-bounces", 2]
    run(arguments.program, "precompute", scene, "-o", field, *method)
    data, order = cycles.read_mesh(field)
    if (order > 1) != glossy:
        sys.exit(f"{case.file}: order {order} of outgoing harmonics; {'glossy' if glossy else 'diffuse'} materials are expected")
    # One scattering between microfacets, as glTF states it. Clusters reflect lobes diffusely, with all of their reflectance.
    data["microfacets"] = "GGX" if glossy else "MULTI_GGX"
    data["colours"], data["lobes"] = case.surface(data["positions"] * [1, 1, -1])
    halves, = cycles.trace(data, [sky], folder, arguments.size, arguments.samples, BOUNCES if glossy else 2)
    error, _, brightness, noise = cycles.compare(arguments.program, field, sky, halves, folder, arguments.size)
    return [case.file.name, case.materials, "harmonics" if glossy else "clusters", str(len(data["positions"])), f"{error:.3f}",
            f"{brightness:.3f}", f"{noise:.3f}"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("meshes", type=pathlib.Path, help="folder of the three meshes that are not generated")
    parser.add_argument("-o", "--output", type=pathlib.Path, required=True, help="folder for files and pictures")
    parser.add_argument("--program", default="refield", help="default: %(default)s")
    parser.add_argument("--size", default="160x120", help="WIDTHxHEIGHT of the pictures; default: %(default)s")
    parser.add_argument("--samples", type=int, default=256, help="of Cycles, per pixel; default: %(default)s")
    parser.add_argument("--only", help="stem of one file")
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    sky = arguments.output / "sky.exr"
    write_sky(sky)
    print("| file | materials | method | vertices | error | brightness | noise |\n| --- | --- | --- | --- | --- | --- | --- |")
    for case in [*generated(arguments.output), *collected(arguments.meshes)]:
        if arguments.only in (None, case.file.stem):
            print("| " + " | ".join(measure(case, sky, arguments)) + " |", flush=True)


if __name__ == "__main__":
    main()
