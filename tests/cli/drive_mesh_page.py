#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Drives the page of a field over a mesh in headless Chromium (mouse, wheel, fingers, keys) and compares what it draws with
`refield relight` from the same camera under the same light.

    drive_mesh_page.py REFIELD FIELD WORK_FOLDER [SCREENSHOT]

Exit status 77: Chromium or its driver is not installed."""
import sys

from drive_page import Check, drive
from pictures import over_black

# Of 255. The page divides the texels of the panorama among those of the cube map, the program integrates them; at edges of
# triangles, the coordinates of the graphics processor have a 256th of a pixel.
CLOSE, MEAN, FEW = 2, 0.25, 0.01


class MeshCheck(Check):
    LOADED = "vertices"

    def camera(self):
        return self.browser.run("const {position, target, up, fov} = viewer.relighter.camera; return {position, target, up, fov}")

    def picture(self, light, exposure, *options):
        camera = self.camera()
        vector = lambda v: ",".join(repr(x) for x in v)
        width, height = self.browser.run("return [viewer.field.width, viewer.field.height]")
        pixels = self.relit("--env", light, "--exposure", repr(exposure), "--vertical-fov", repr(camera["fov"]), "--camera-position=" + vector(camera["position"]),
                            "--camera-target=" + vector(camera["target"]), "--size", f"{width}x{height}", *options)
        return over_black(pixels) if len(pixels) == width * height * 4 else pixels

    def expect_equal(self, what, seen, expected):
        differences = sorted(abs(a - b) for a, b in zip(seen, expected))
        mean, other = sum(differences) / len(differences), sum(d > CLOSE for d in differences) / len(differences)
        bright = sum(expected) / len(expected)
        self.expect(len(seen) == len(expected) and mean < MEAN and other < FEW and bright > 1,
                    f"{what}: {mean:.3f} of 255 from the program's in the mean, {100 * other:.2f} % of values by more than {CLOSE}, "
                    f"at most {differences[-1]}; mean {bright:.0f}")

    def moves(self, what, action):
        before = self.camera()
        action()
        self.settle()
        after = self.camera()
        self.expect(after != before, f"{what}: the camera moves to {', '.join(f'{x:.2f}' for x in after['position'])}")
        return before, after

    @staticmethod
    def distance(camera):
        return sum((p - t) ** 2 for p, t in zip(camera["position"], camera["target"])) ** 0.5

    def starts_with_a_bar(self):
        self.compare("bar at the start")

    def orbits(self):
        self.moves("drag", lambda: self.browser.drag("#scene", [(0.5, 0.5), (0.45, 0.5), (0.4, 0.45)]))
        self.compare("orbited")
        before, after = self.moves("wheel", lambda: self.browser.wheel("#scene", -200))
        self.expect(abs(self.distance(before) / self.distance(after) - 1.21) < 1e-6, "the wheel approaches by a tenth for each line")
        before, after = self.moves("right button", lambda: self.browser.drag("#scene", [(0.5, 0.5), (0.52, 0.55)], button=2))
        self.expect(after["target"] != before["target"] and abs(self.distance(after) - self.distance(before)) < 1e-5, "the right button pans")
        self.compare("approached and panned")
        before, after = self.moves("two fingers", lambda: self.browser.touch(self.browser.path("#scene", [(0.4, 0.5), (0.45, 0.5)]),
                                                                             self.browser.path("#scene", [(0.6, 0.5), (0.55, 0.5)])))
        self.expect(abs(self.distance(after) / self.distance(before) - 2) < 0.05, "two fingers that come together move away")
        self.moves("keys", lambda: self.browser.type("#scene", "\ue012\ue012\ue013+"))  # left, left, up
        self.compare("moved by keys")
        start = self.browser.run("return viewer.field.mesh.camera")
        self.browser.type("#scene", "f")
        self.settle()
        self.expect(self.camera() == start, "F resets the camera")

    def shows_the_background(self):
        # Under harmonics, `relight --show-environment` shows the cube map of 32×32 texels that lights the scene; the page shows the panorama.
        if self.browser.run("return viewer.field.harmonics") > 0:
            return
        self.browser.click("#background")
        self.compare("background", "--show-environment")
        self.browser.click("#background")

    def shows_an_environment(self):
        """A panorama that the page brings along, against the program's own reading of the file."""
        self.chooses_a_map()
        for degrees in (0, 90):
            self.browser.run(f"viewer.state.degrees = {degrees}; viewer.changed();")
            self.settle()
            pixels = self.page_state()[2]
            self.expect_equal(f"environment turned by {degrees}°", pixels,
                              self.picture(self.environment, self.browser.run("return viewer.exposure()"), "--yaw", str(degrees)))
            if degrees == 0:
                self.expect_exposure("environment", "--env", self.environment)

    def drags_a_light_source(self):
        self.browser.click("input[value=spot]")
        self.browser.drag("#light", [(0.4, 0.3), (0.55, 0.2)])
        self.compare("light source dragged")
        self.browser.click("#reset")


if __name__ == "__main__":
    sys.exit(drive(MeshCheck, (90, 15, 136), [
        MeshCheck.loads, MeshCheck.starts_with_a_bar, MeshCheck.orbits, MeshCheck.drags_a_light_source, MeshCheck.shows_an_environment, MeshCheck.prints_times,
        MeshCheck.shows_the_background]))
