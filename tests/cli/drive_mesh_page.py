#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Drives the page of a field over a mesh in headless Chromium (mouse, wheel, fingers, keys) and compares what it draws with
`refield relight` from the same camera under the same light.

    drive_mesh_page.py REFIELD FIELD WORK_FOLDER [SCREENSHOT]

Exit status 77: Chromium or its driver is not installed."""
import os
import shutil
import subprocess
import sys
import time

from drive_page import SKIPPED, Check
from pictures import over_black, read_png, write_hdr, write_pfm
from webdriver import Browser

# Of 255. The page divides the texels of the panorama among those of the cube map, the program integrates them; at edges of
# triangles, the coordinates of the graphics processor have a 256th of a pixel.
CLOSE, MEAN, FEW = 2, 0.25, 0.01


class MeshCheck(Check):
    def camera(self):
        return self.browser.run("const {position, target, up, fov} = viewer.relighter.camera; return {position, target, up, fov}")

    def picture(self, light, exposure, *options):
        camera, image = self.camera(), os.path.join(self.folder, "cpu.png")
        vector = lambda v: ",".join(repr(x) for x in v)
        width, height = self.browser.run("return [viewer.field.width, viewer.field.height]")
        subprocess.run([self.refield, "relight", self.field, "--env", light, "-o", image, "--exposure", repr(exposure), "--fov", repr(camera["fov"]),
                        "--camera-position=" + vector(camera["position"]), "--camera-target=" + vector(camera["target"]), "--size", f"{width}x{height}", *options],
                       check=True, stdout=subprocess.DEVNULL)
        pixels = read_png(image)[2]
        return over_black(pixels) if len(pixels) == width * height * 4 else pixels

    def compare(self, what, *options):
        self.settle()
        state, light, pixels = self.page_state()
        file = os.path.join(self.folder, "light.pfm")
        write_pfm(file, state["width"], state["height"], light)
        self.expect_alike(what, pixels, self.picture(file, state["exposure"], *options))
        return pixels

    def expect_alike(self, what, seen, expected):
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
        before, after = self.moves("keys", lambda: self.browser.type("#scene", "\ue012\ue012\ue013+"))  # left, left, up
        self.compare("moved by keys")
        start = self.browser.run("return viewer.field.mesh.camera")
        self.browser.type("#scene", "f")
        self.settle()
        self.expect(self.camera() == start, "F resets the camera")

    def shows_the_background(self):
        self.browser.click("#background")
        self.compare("background", "--background")
        self.browser.click("#background")

    def shows_an_environment(self):
        """A panorama that the page brings along, against the program's own reading of the file."""
        self.browser.run("const maps = document.getElementById('maps'); maps.value = '0'; maps.dispatchEvent(new Event('change'));"
                         "return new Promise((done) => { const wait = () => viewer.map === null || viewer.state.kind !== 'map'"
                         " ? setTimeout(wait, 20) : done(); wait(); });")
        for degrees in (0, 90):
            self.browser.run(f"viewer.state.degrees = {degrees}; viewer.changed();")
            self.settle()
            pixels = self.page_state()[2]
            self.expect_alike(f"environment turned by {degrees}°", pixels,
                              self.picture(self.environment, self.browser.run("return viewer.exposure()"), "--yaw", str(degrees)))
            if degrees == 0:
                self.expect_exposure("environment", "--env", self.environment)

    def loads(self):
        for _ in range(1200):
            status = self.browser.run("return document.getElementById('status').className + document.getElementById('status').textContent")
            if self.browser.run("return viewer !== null") or status.startswith("error"):
                break
            time.sleep(0.1)
        self.settle()
        self.expect("vertices" in self.browser.run("return document.getElementById('status').textContent"), "the page loads from disk")

    def drags_a_light_source(self):
        self.browser.click("input[value=spot]")
        self.browser.drag("#light", [(0.4, 0.3), (0.55, 0.2)])
        self.compare("light source dragged")
        self.browser.click("#reset")


def main():
    refield, field, folder = sys.argv[1:4]
    if not shutil.which("chromedriver") or not shutil.which("chromium"):
        print("skipped: chromium and chromium-driver are not installed")
        return SKIPPED
    page = os.path.join(folder, "page")
    os.makedirs(folder, exist_ok=True)
    environment = os.path.join(folder, "sky.hdr")
    write_hdr(environment, 128, 64, bytes(v for y in range(64) for x in range(128)
              for v in (2 * x, 255 - 3 * y, 90 + (x * 7 + y * 5) % 130, 136 if (x, y) == (90, 15) else 128)))
    subprocess.run([refield, "export-web", field, "-o", page, "--env", environment], check=True)
    browser = Browser(os.path.join(folder, "profile"))
    try:
        check = MeshCheck(refield, field, folder, browser)
        check.environment = environment
        browser.command("POST", "/url", {"url": "file://" + os.path.abspath(os.path.join(page, "index.html"))})
        check.loads()
        check.compare("bar at the start")
        steps = [check.orbits, check.drags_a_light_source, check.shows_an_environment, check.prints_times]
        # Under harmonics, `relight --background` shows the cube map of 32 x 32 texels a side that lights the scene; the page shows the panorama.
        if browser.run("return viewer.field.harmonics") == 0:
            steps.append(check.shows_the_background)
        for step in steps:
            step()
        if len(sys.argv) > 4:
            browser.screenshot(sys.argv[4])
        complaints = browser.complaints()
        check.expect(not complaints, "the console is quiet" + "".join("\n      " + c for c in complaints))
        return 1 if check.failed else 0
    finally:
        browser.close()


if __name__ == "__main__":
    sys.exit(main())
