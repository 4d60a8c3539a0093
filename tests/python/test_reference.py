# SPDX-License-Identifier: Apache-2.0
"""Precomputed transport against sums over all directions, by code that shares nothing with the program.

Meshes, ray casts, environment maps, cameras and materials are written here a second time, in NumPy, from
docs/reference: conventions.md and scene-files.md. Every ray is tested against every
triangle.
"""
import numpy as np
import pytest

import refield

ROWS, COLUMNS = 16, 32  # of the environment
SUN = (4, 21)  # its texel


def normalised(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


# ---- meshes: positions [vertices, 3], normals [vertices, 3], triangles [triangles, 3], in the axes of light maps


def quad(corner, along, across, steps):
    """A rectangle of steps × steps squares; its front is where along × across points in right-handed axes."""
    corner, along, across = (np.array(vector, float) for vector in (corner, along, across))
    j, i = np.mgrid[: steps + 1, : steps + 1].reshape(2, -1, 1) / steps
    first = (np.arange(steps)[:, None] * (steps + 1) + np.arange(steps)).reshape(-1, 1)
    squares = first + [0, 1, steps + 2, 0, steps + 2, steps + 1]
    positions = corner + i * along + j * across
    normal = normalised(np.cross(along, across))
    return positions, np.broadcast_to(normal, positions.shape), squares.reshape(-1, 3)


def sphere(centre, radius, rings):
    """By latitude and longitude. Normals are what files of meshes get: means of the triangles', weighted by area."""
    row, column = np.mgrid[: rings + 1, : 2 * rings].reshape(2, -1)
    polar, azimuth = np.pi * row / rings, np.pi * column / rings
    outward = np.stack([np.sin(polar) * np.cos(azimuth), np.cos(polar), np.sin(polar) * np.sin(azimuth)], 1)
    positions, number = np.unique(outward.round(9), axis=0, return_inverse=True)
    number = number.reshape(rings + 1, 2 * rings)
    here, right = number[:, :, None], np.roll(number, -1, 1)[:, :, None]
    squares = np.concatenate([here[:-1], right[1:], here[1:], here[:-1], right[:-1], right[1:]], 2)
    triangles = squares.reshape(-1, 3)
    areas = np.cross(positions[triangles[:, 1]] - positions[triangles[:, 0]],
                     positions[triangles[:, 2]] - positions[triangles[:, 0]])
    kept = np.linalg.norm(areas, axis=1) > 1e-9
    triangles, areas = triangles[kept], areas[kept]
    normals = np.zeros_like(positions)
    for corner in range(3):
        np.add.at(normals, triangles[:, corner], areas)
    return centre + radius * positions, normalised(normals), triangles


def write_obj(path, mesh):
    """Files are right-handed: z turns, and the order of corners with it."""
    positions, normals, triangles = mesh
    lines = ["v {:.9g} {:.9g} {:.9g}".format(x, y, -z) for x, y, z in positions]
    lines += ["vn {:.9g} {:.9g} {:.9g}".format(x, y, -z) for x, y, z in normals]
    lines += ["f {0}//{0} {1}//{1} {2}//{2}".format(*corners) for corners in triangles[:, ::-1] + 1]
    path.write_text("\n".join(lines) + "\n")


class Scene:
    """Parts are (mesh, material), a material being the keys of a scene file."""

    def __init__(self, parts, camera=""):
        counts = np.cumsum([0] + [len(mesh[0]) for mesh, _ in parts])
        self.parts, self.camera = parts, camera
        self.positions = np.concatenate([mesh[0] for mesh, _ in parts])
        self.normals = np.concatenate([mesh[1] for mesh, _ in parts])
        self.triangles = np.concatenate([mesh[2] + start for (mesh, _), start in zip(parts, counts)])
        self.part = np.repeat(np.arange(len(parts)), np.diff(counts))  # of each vertex

        self.colours = np.array([material["diffuse"] for _, material in parts])[self.part]

    def write(self, folder):
        text = self.camera
        for i, (mesh, material) in enumerate(self.parts):
            write_obj(folder / f"{i}.obj", mesh)
            keys = "".join(f"{key} = {value}\n" for key, value in material.items())
            text += f"[[material]]\nname = '{i}'\n{keys}[[object]]\nfile = '{i}.obj'\nmaterial = '{i}'\n"
        (folder / "scene.toml").write_text(text)
        return folder / "scene.toml"

    def hit(self, origins, directions):
        """The nearest triangle of each ray (-1: none) and the weights of its three corners there."""
        distance = np.full(len(origins), np.inf)
        triangle, weights = np.full(len(origins), -1), np.zeros((len(origins), 3))
        for number, (a, b, c) in enumerate(self.positions[self.triangles]):
            # Cramer's rule on origin + t direction = a + u (b − a) + v (c − a).
            normal, to_a = np.cross(b - a, c - a), a - origins
            with np.errstate(divide="ignore", invalid="ignore"):
                scale = 1.0 / (directions @ normal)
                t = (to_a @ normal) * scale
                turned = np.cross(to_a, directions)
                u, v = (turned @ (c - a)) * scale, -(turned @ (b - a)) * scale
            nearer = (t > 0.0) & (t < distance) & (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0)
            distance[nearer], triangle[nearer] = t[nearer], number
            weights[nearer] = np.stack([1.0 - u - v, u, v], 1)[nearer]
        return triangle, weights


def off_surface(positions, normals):
    return positions + 1e-4 * normals


# ---- light


def environment():
    """A sky that changes slowly, different in each channel, and a sun of one texel."""
    down, right = np.mgrid[:ROWS, :COLUMNS] + 0.5
    polar, azimuth = np.pi * down / ROWS, 2.0 * np.pi * right / COLUMNS
    waves = [0.5 * np.cos(azimuth + phase) * np.sin(polar) for phase in (0, 1, 2)]
    sky = 1.0 + np.stack(waves, 2) + 0.4 * np.cos(polar)[..., None]
    sky[SUN] = [90.0, 80.0, 60.0]
    return sky.astype(np.float32)


def directions(fine):
    """Unit directions and solid angles of fine × fine parts of each texel, and the texel's number."""
    rows, columns = np.mgrid[: ROWS * fine, : COLUMNS * fine].reshape(2, -1)
    polar, azimuth = np.pi * (rows + 0.5) / (ROWS * fine), 2.0 * np.pi * (columns + 0.5) / (COLUMNS * fine)
    unit = np.stack([-np.sin(polar) * np.sin(azimuth), np.cos(polar), -np.sin(polar) * np.cos(azimuth)], 1)
    edges = np.cos(np.pi * np.arange(ROWS * fine + 1) / (ROWS * fine))
    angle = (edges[:-1] - edges[1:])[rows] * 2.0 * np.pi / (COLUMNS * fine)
    return unit, angle, (rows // fine) * COLUMNS + columns // fine


def relative_rmse(values, truth):
    return np.sqrt(np.sum((values - truth) ** 2) / np.sum(truth**2))


class Camera:
    """With fine × fine lines of sight per pixel."""

    def __init__(self, position, target, width, height, fov, fine=1):
        self.position, self.width, self.height = np.array(position), width, height
        self.text = f"[camera]\nposition = {list(position)}\ntarget = {list(target)}\n"
        self.text += f"vertical_fov_degrees = {fov}\nwidth = {width}\nheight = {height}\n"
        ahead = normalised(np.array(target) - self.position)
        right = normalised(np.cross([0.0, 1.0, 0.0], ahead))
        up, edge = np.cross(ahead, right), np.tan(np.radians(fov / 2.0))
        self.fine = fine
        y, x = (np.mgrid[:height * fine, :width * fine].reshape(2, -1, 1) + 0.5) / fine
        across = edge * ((2.0 * x - width) * right + (height - 2.0 * y) * up) / height
        self.sight = normalised(ahead + across)

    def hit(self, scene):
        return scene.hit(np.broadcast_to(self.position, self.sight.shape), self.sight)

    def pixels(self, values):
        """[height, width, lines of sight, channels]."""
        split = values.reshape(self.height, self.fine, self.width, self.fine, -1).transpose(0, 2, 1, 3, 4)
        return split.reshape(self.height, self.width, self.fine**2, -1)


def seen(scene, camera, radiance):
    """The picture of a mesh whose vertices have `radiance`, and which pixels and neighbours one part fills."""
    triangle, weights = camera.hit(scene)
    picture = camera.pixels((radiance[scene.triangles[triangle]] * weights[:, :, None]).sum(1)).mean(2)
    part = camera.pixels(np.where(triangle < 0, -1, scene.part[scene.triangles[triangle, 0]]))
    low, high = (np.pad(extreme, 1, mode="edge") for extreme in (part.min((2, 3)), part.max((2, 3))))
    around = [np.s_[1 + j:low.shape[0] - 1 + j, 1 + i:low.shape[1] - 1 + i] for j in (-1, 0, 1) for i in (-1, 0, 1)]
    lowest = np.min([low[place] for place in around], 0)
    return picture, (lowest >= 0) & (lowest == np.max([high[place] for place in around], 0))


def gather(scene, positions, normals, fine):
    """Of white diffuse points: direct light of each texel [points, texels], and reflected light of each vertex
    [points, vertices], which the vertices of a triangle that is hit share."""
    unit, angle, texel = directions(fine)
    direct = np.zeros((len(positions), ROWS * COLUMNS))
    reflected = np.zeros((len(positions), len(scene.positions)))
    for point, normal in enumerate(normals):
        ahead = unit @ normal > 0.0
        factor = (unit[ahead] @ normal) * angle[ahead] / np.pi
        origin = np.broadcast_to(off_surface(positions[point], normal), (ahead.sum(), 3))
        triangle, weights = scene.hit(origin, unit[ahead])
        free = triangle < 0
        np.add.at(direct[point], texel[ahead][free], factor[free])
        # The backs of triangles are black.
        a, b, c = scene.positions[scene.triangles[triangle]].transpose(1, 0, 2)
        seen = ~free & ((np.cross(b - a, c - a) * unit[ahead]).sum(1) < 0.0)
        np.add.at(reflected[point], scene.triangles[triangle[seen]], factor[seen, None] * weights[seen])
    return direct, reflected


FLOOR = quad([-1.5, 0.0, 1.5], [3.0, 0.0, 0.0], [0.0, 0.0, -3.0], 8)


# Bounds are 1.5 times the measured errors: .0032, .0025 and .0015; .0077, .0069, .0068 and .0036; .0043.


def test_shadow(tmp_path):
    """Direct light from clusters: the sun draws an edge."""
    camera = Camera([0.5, 2.5, -2.5], [0.0, 0.0, 0.0], 48, 36, 50.0, 2)
    blocker = quad([-0.5, 0.6, 0.4], [0.9, 0.2, 0.1], [0.1, 0.1, -0.9], 1)
    scene = Scene([(FLOOR, {"diffuse": [0.8, 0.5, 0.2]}), (blocker, {"diffuse": [0.3, 0.3, 0.3]})], camera.text)
    sky = environment()
    direct, _ = gather(scene, scene.positions, scene.normals, 6)
    truth, whole = seen(scene, camera, scene.colours * (direct @ sky.reshape(-1, 3)))
    errors = []
    for epsilon in (1e-3, 1e-4, 1e-5):
        field = refield.precompute(scene.write(tmp_path), resolution=128, epsilon=epsilon)
        image = field.relight(refield.environment(sky, field))
        errors.append(relative_rmse(image[whole], truth[whole]))
    # What is left is the sun, one texel, in squares that the edge crosses: which ones is luck while they are large.
    assert errors[0] < 0.0036 and errors[1] < 0.0036 and errors[2] < 0.0015


@pytest.mark.parametrize("method, settings, bound", [
    ("clusters", {"resolution": 32, "diffuse_bounces": 0}, 0.0115), ("clusters", {"resolution": 32, "diffuse_bounces": 1}, 0.0104),
    ("clusters", {"resolution": 32, "diffuse_bounces": 3}, 0.0101), ("sh", {"sh_order": 8, "directions": 8192}, 0.0054)])
def test_corner(tmp_path, method, settings, bound):
    """Coloured walls that light each other. They pass through each other, so that no vertex lies in another plane."""
    camera = Camera([1.6, 1.6, -2.2], [-0.3, 0.7, 0.3], 48, 36, 50.0, 2)
    scene = Scene([(quad([-1.0, 0.0, 1.0], [2.0, 0.0, 0.0], [0.0, 0.0, -2.0], 4), {"diffuse": [0.8, 0.8, 0.8]}),
                   (quad([-1.05, -0.05, 0.95], [0.0, 2.0, 0.0], [2.0, 0.0, 0.0], 4), {"diffuse": [0.8, 0.2, 0.1]}),
                   (quad([-0.95, -0.05, -1.05], [0.0, 2.0, 0.0], [0.0, 0.0, 2.1], 4), {"diffuse": [0.1, 0.3, 0.8]})],
                  camera.text)
    field = refield.precompute(scene.write(tmp_path), method, **settings)
    sky = environment()
    sky[SUN] = sky[SUN[0], SUN[1] + 1]  # harmonics cannot represent it
    direct, reflected = gather(scene, scene.positions, scene.normals, 3)
    first = direct @ sky.reshape(-1, 3)
    light = first
    for _ in range(settings.get("diffuse_bounces", 30)):
        light = first + reflected @ (scene.colours * light)
    truth, whole = seen(scene, camera, scene.colours * light)
    image = field.relight(refield.environment(sky, field))
    assert relative_rmse(image[whole], truth[whole]) < bound


def test_highlights(tmp_path):
    """The image of a camera: a Phong lobe on a floor and on a sphere that shades it."""
    camera = Camera([0.5, 1.2, -2.8], [0.0, 0.3, 0.0], 16, 12, 40.0)
    floor = {"kind": "'phong'", "diffuse": [0.4, 0.3, 0.2], "specular": [0.3, 0.3, 0.3], "exponent": 12.0}
    ball = {"kind": "'phong'", "diffuse": [0.1, 0.2, 0.3], "specular": [0.5, 0.4, 0.3], "exponent": 6.0}
    scene = Scene([(FLOOR, floor), (sphere([0.0, 0.45, 0.0], 0.45, 8), ball)], camera.text)
    field = refield.precompute(scene.write(tmp_path), resolution=64, image=True)
    sky = environment()
    image = field.relight(refield.environment(sky, field))
    triangle, weights = camera.hit(scene)
    unit, angle, texel = directions(3)
    truth = np.zeros((len(triangle), 3))
    for pixel in np.flatnonzero(triangle >= 0):
        corners = scene.triangles[triangle[pixel]]
        point = weights[pixel] @ scene.positions[corners]
        normal = normalised(weights[pixel] @ scene.normals[corners])
        lit = unit @ normal > 0.0
        omega, cosine = unit[lit], unit[lit] @ normal
        free = scene.hit(np.broadcast_to(off_surface(point, normal), omega.shape), omega)[0] < 0
        material = scene.parts[scene.part[corners[0]]][1]
        mirrored = 2.0 * cosine[:, None] * normal - omega
        lobe = np.maximum(mirrored @ -camera.sight[pixel], 0.0) ** material["exponent"]
        lobe *= (material["exponent"] + 2.0) / (2.0 * np.pi)
        transfer = np.array(material["diffuse"]) / np.pi + np.array(material["specular"]) * lobe[:, None]
        truth[pixel] = ((cosine * angle[lit] * free)[:, None] * transfer * sky.reshape(-1, 3)[texel[lit]]).sum(0)
    truth = truth.reshape(image.shape)
    assert relative_rmse(image, truth) < 0.0065
    assert np.array_equal(image.max(2) > 0.0, truth.max(2) > 0.0)
