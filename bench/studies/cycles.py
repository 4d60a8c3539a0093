#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Compares a field over a diffuse mesh with pictures of the same scene by another renderer, Blender's Cycles.

    bench/studies/cycles.py FIELD MAP... -o OUT --program build/release/cli/refield

FIELD was written by `refield precompute SCENE` for a diffuse scene with a camera; MAP are lat-long environment maps
(EXR). Both programs draw the field's mesh as that camera sees it: refield by `refield relight --env`, Cycles by tracing
paths with as many diffuse reflections as the field's provenance states (--bounces for harmonics). Backs of triangles are
black in both.

Prints, per map, over the pixels that the mesh covers whole: the relative RMSE; the same over the quarter of them that
differs least from its neighbours in Cycles' picture, where no shadow ends; the ratio of mean brightness; and the noise of
Cycles' picture, from two renderings with half of the samples each. Leaves both pictures (EXR) and, side by side, ours,
that of Cycles and four times their difference (PNG) in OUT.

Needs Debian's blender, numpy, h5py and the Python module of OpenImageIO.
"""
import argparse
import json
import pathlib
import subprocess
import sys

import numpy

try:
    import bpy
except ImportError:
    bpy = None


# ---- inside Blender: right-handed, +X right, +Y ahead, +Z up


def axes(vectors):
    """Of Blender, from refield's (left-handed, +Y up, +Z ahead)."""
    return numpy.ascontiguousarray(numpy.asarray(vectors)[..., [0, 2, 1]], dtype=float)


def build_mesh(data):
    mesh = bpy.data.meshes.new("scene")
    # The change of axes is a reflection, so that corners are named the other way round.
    mesh.from_pydata(axes(data["positions"]).tolist(), [], data["triangles"][:, ::-1].tolist())
    mesh.polygons.foreach_set("use_smooth", [True] * len(mesh.polygons))
    mesh.use_auto_smooth = True
    mesh.normals_split_custom_set_from_vertices(axes(data["normals"]).tolist())
    material = bpy.data.materials.new("material")
    material.use_nodes = True
    nodes, link = material.node_tree.nodes, material.node_tree.links.new
    nodes.clear()

    def at_vertices(name, values):
        colours = mesh.attributes.new(name, "FLOAT_COLOR", "POINT")
        opaque = numpy.hstack([values, numpy.ones((len(values), 1))])
        colours.data.foreach_set("color", opaque.ravel().tolist())
        node = nodes.new("ShaderNodeAttribute")
        node.attribute_name = name
        return node.outputs["Color"]

    glossy = "lobes" in data
    geometry = nodes.new("ShaderNodeNewGeometry")
    front, back = nodes.new("ShaderNodeBsdfPrincipled" if glossy else "ShaderNodeBsdfDiffuse"), nodes.new("ShaderNodeBsdfDiffuse")
    mix, output = nodes.new("ShaderNodeMixShader"), nodes.new("ShaderNodeOutputMaterial")
    back.inputs["Color"].default_value = (0.0, 0.0, 0.0, 1.0)
    link(at_vertices("reflectance", data["colours"]), front.inputs["Base Color" if glossy else "Color"])
    if glossy:
        front.distribution = str(data["microfacets"])
        parts = nodes.new("ShaderNodeSeparateColor")
        link(at_vertices("lobes", data["lobes"]), parts.inputs[0])
        for part, name in enumerate(("Metallic", "Roughness", "Specular")):
            link(parts.outputs[part], front.inputs[name])
    link(geometry.outputs["Backfacing"], mix.inputs[0])
    link(front.outputs[0], mix.inputs[1])
    link(back.outputs[0], mix.inputs[2])
    link(mix.outputs[0], output.inputs["Surface"])
    mesh.materials.append(material)
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("scene", mesh))


def build_camera(data, size):
    import mathutils
    position, target, up = (mathutils.Vector(axes(data["camera"][3 * i:3 * i + 3])) for i in range(3))
    camera = bpy.data.cameras.new("camera")
    camera.sensor_fit = "VERTICAL"
    camera.angle = numpy.radians(data["camera"][9])
    back = (position - target).normalized()
    right = up.cross(back).normalized()
    placed = bpy.data.objects.new("camera", camera)
    placed.matrix_world = mathutils.Matrix((
        (right.x, back.cross(right).x, back.x, position.x), (right.y, back.cross(right).y, back.y, position.y),
        (right.z, back.cross(right).z, back.z, position.z), (0.0, 0.0, 0.0, 1.0)))
    scene = bpy.context.scene
    scene.collection.objects.link(placed)
    scene.camera = placed
    scene.render.resolution_x, scene.render.resolution_y = size
    scene.render.resolution_percentage = 100


def build_world(path):
    world = bpy.data.worlds.new("world")
    world.use_nodes = True
    nodes, link = world.node_tree.nodes, world.node_tree.links.new
    nodes.clear()
    place, turn = nodes.new("ShaderNodeTexCoord"), nodes.new("ShaderNodeMapping")
    texture, background = nodes.new("ShaderNodeTexEnvironment"), nodes.new("ShaderNodeBackground")
    texture.image = bpy.data.images.load(path)
    texture.image.colorspace_settings.name = "Non-Color"
    texture.interpolation = "Closest"
    turn.inputs["Rotation"].default_value = (0.0, 0.0, -numpy.pi / 2.0)  # the map's centre lies at +X
    link(place.outputs["Generated"], turn.inputs["Vector"])
    link(turn.outputs["Vector"], texture.inputs["Vector"])
    link(texture.outputs["Color"], background.inputs["Color"])
    link(background.outputs[0], nodes.new("ShaderNodeOutputWorld").inputs["Surface"])
    bpy.context.scene.world = world


def render(job):
    data = numpy.load(job["mesh"])
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.samples, cycles.use_adaptive_sampling, cycles.use_denoising = job["samples"] // 2, False, False
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = job["bounces"]
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    cycles.pixel_filter_type = "BOX"
    scene.render.filter_size = 1.0
    scene.render.film_transparent = True
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    scene.render.image_settings.color_mode = "RGBA"
    build_mesh(data)
    build_camera(data, job["size"])
    for path, outputs in job["maps"]:
        build_world(path)
        for seed, output in enumerate(outputs):
            cycles.seed = seed
            scene.render.filepath = output
            bpy.ops.render.render(write_still=True)


# ---- outside


def read_exr(path):
    import OpenImageIO as oiio
    buffer = oiio.ImageBuf(str(path))
    pixels = buffer.get_pixels(oiio.FLOAT)
    if pixels is None:
        sys.exit(f"{path}: {buffer.geterror()}")
    return pixels


def write_pictures(path, images):
    import OpenImageIO as oiio
    row = numpy.concatenate(images, 1)
    white = numpy.percentile(images[1], 99.0)
    shown = numpy.clip(row / white, 0.0, 1.0) ** (1.0 / 2.2)
    output = oiio.ImageOutput.create(str(path))
    output.open(str(path), oiio.ImageSpec(shown.shape[1], shown.shape[0], 3, "uint8"))
    output.write_image((255.0 * shown + 0.5).astype(numpy.uint8))
    output.close()


def differences_of_neighbours(picture):
    grey = picture.mean(2)
    return numpy.abs(numpy.gradient(grey)).max(0)


def relative_rmse(values, truth):
    return float(numpy.sqrt(((values - truth) ** 2).sum() / (truth**2).sum()))


def read_mesh(field):
    """Mesh and camera of a field, as arrays, and the order of the outgoing harmonics of its vertices, 1 if diffuse."""
    import h5py
    with h5py.File(field) as file:
        if "mesh/camera" not in file:
            sys.exit(f"{field}: is no field over a mesh with a camera")
        data = {name: file[f"mesh/{name}"][...] for name in ("positions", "normals", "colours", "triangles", "camera")}
        order = int(file.attrs.get("outgoing_order", 1))
    data["camera"] = data["camera"].ravel()
    return data, order


def trace(data, maps, folder, size, samples, bounces):
    """Files of two renderings per map, each with half of the samples. `data`: of read_mesh(), colours being diffuse
    reflectance; or, with "lobes" [vertices × 3], base colours, and metallic, roughness and specular of Blender's
    Principled BSDF, with its distribution "microfacets"."""
    folder.mkdir(parents=True, exist_ok=True)
    folder = folder.resolve()
    numpy.savez(folder / "mesh.npz", **data)
    halves = [[folder / f"{path.stem}_cycles_{half}.exr" for half in (0, 1)] for path in maps]
    job = {"mesh": str(folder / "mesh.npz"), "samples": samples, "bounces": bounces,
           "size": [int(length) for length in size.split("x")],
           "maps": [(str(path.resolve()), [str(half) for half in of_map]) for path, of_map in zip(maps, halves)]}
    (folder / "job.json").write_text(json.dumps(job))
    subprocess.run(["blender", "--background", "--factory-startup", "-noaudio", "--python-exit-code", "1", "--python",
                    __file__, "--", folder / "job.json"], check=True, stdout=subprocess.DEVNULL)
    return halves


def compare(program, field, path, halves, folder, size):
    """Relights the field by a map and writes both pictures; relative RMSE over the pixels that the mesh covers whole and over
    the smooth quarter of them, ratio of brightness, noise of Cycles."""
    picture = folder / f"{path.stem}.exr"
    subprocess.run([program, "--quiet", "relight", field, "--env", path, "--size", size, "-o", picture], check=True,
                   stdout=subprocess.DEVNULL)
    ours, traced = read_exr(picture), [read_exr(half) for half in halves]
    whole = (ours[..., 3] > 0.999) & (traced[0][..., 3] > 0.999)
    truth = 0.5 * (traced[0] + traced[1])[..., :3]
    noise = relative_rmse(traced[0][whole, :3], traced[1][whole, :3]) / 2.0
    steps = differences_of_neighbours(truth)
    smooth = whole & (steps <= numpy.quantile(steps[whole], 0.25))
    seen = numpy.where(whole[..., None], ours[..., :3], 0.0)
    expected = numpy.where(whole[..., None], truth, 0.0)
    write_pictures(folder / f"{path.stem}.png", [seen, expected, 4.0 * numpy.abs(seen - expected)])
    errors = [relative_rmse(seen[where], expected[where]) for where in (whole, smooth)]
    return *errors, seen.sum() / expected.sum(), noise


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("field", type=pathlib.Path)
    parser.add_argument("maps", nargs="+", type=pathlib.Path)
    parser.add_argument("-o", "--output", type=pathlib.Path, required=True, help="folder for pictures")
    parser.add_argument("--program", default="refield", help="default: %(default)s")
    parser.add_argument("--size", default="320x240", help="WIDTHxHEIGHT of the pictures; default: %(default)s")
    parser.add_argument("--samples", type=int, default=1024, help="of Cycles, per pixel; default: %(default)s")
    parser.add_argument("--bounces", type=int, help="diffuse reflections of Cycles; default: as of the field")
    arguments = parser.parse_args()
    data, order = read_mesh(arguments.field)
    if order > 1:
        sys.exit(f"{arguments.field}: has glossy materials, which this script does not give to Cycles")
    provenance = json.loads(subprocess.run([arguments.program, "info", arguments.field, "--json"], check=True,
                                           stdout=subprocess.PIPE).stdout)["provenance"]
    bounces = provenance.get("bounces", 16) if arguments.bounces is None else arguments.bounces
    halves = trace(data, arguments.maps, arguments.output, arguments.size, arguments.samples, bounces)
    print("map                      RMSE   smooth  brightness   noise of Cycles")
    for path, of_map in zip(arguments.maps, halves):
        error, smooth, brightness, noise = compare(arguments.program, arguments.field, path, of_map, arguments.output,
                                                   arguments.size)
        print(f"{path.stem:24s} {error:.4f}  {smooth:.4f}  {brightness:.4f}       {noise:.4f}")


if __name__ == "__main__":
    if bpy:
        render(json.loads(pathlib.Path(sys.argv[sys.argv.index("--") + 1]).read_text()))
    else:
        main()
