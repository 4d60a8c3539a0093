#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Drives an exported page in headless Chromium as a person would (mouse, keys, file dialogue) and compares what it draws
with `refield relight`.

    drive_page.py REFIELD FIELD WORK_FOLDER [SCREENSHOT]

Exit status 77: Chromium or its driver is not installed."""
import array
import base64
import json
import os
import shutil
import subprocess
import sys

from pictures import read_png, write_hdr, write_pfm, write_png
from webdriver import Browser

SKIPPED = 77
MEAN_OF_SAMPLING = 1.5  # of 255: the page samples a panorama, the program integrates it
EXPOSURE_MARGIN = (1.0, 1.04)  # the program takes 2 % less than exposes to white, rounded down to three digits
LARGEST_DIFFERENCE = 1  # of 255: what the asked accuracy is, and the rounding of two roundings


class Check:
    LOADED = "weights"  # what the page's status names then

    def __init__(self, refield, field, folder, browser):
        self.refield, self.field, self.folder, self.browser = refield, field, folder, browser
        self.failed = False

    def expect(self, holds, what):
        print(("ok    " if holds else "WRONG ") + what, flush=True)
        self.failed = self.failed or not holds

    def settle(self):
        """Waits for the frame that the last input asked for."""
        self.browser.wait_until("viewer !== null && !viewer.requested && !viewer.refinement")

    def page_state(self):
        """The page's light and the pixels that it draws under it."""
        state = self.browser.run("""
            const base64 = (bytes) => {
              let text = '';
              for (let i = 0; i < bytes.length; i += 8192) text += String.fromCharCode(...bytes.subarray(i, i + 8192));
              return btoa(text);
            };
            viewer.relighter.draw(viewer.exposure());
            const pixels = viewer.relighter.readPixels(), values = viewer.light.values;
            return {width: viewer.light.width, height: viewer.light.height, exposure: viewer.exposure(),
                    light: base64(new Uint8Array(values.buffer)), pixels: base64(pixels)};""")
        rgba = base64.b64decode(state["pixels"])
        pixels = bytearray(len(rgba) // 4 * 3)
        for c in range(3):
            pixels[c::3] = rgba[c::4]
        return state, array.array("f", base64.b64decode(state["light"])), bytes(pixels)

    def compare(self, what, *options):
        """The page's pixels with the program's under the very light that the page shows."""
        self.settle()
        state, light, pixels = self.page_state()
        light_file = os.path.join(self.folder, "light.pfm")
        write_pfm(light_file, state["width"], state["height"], light)
        self.expect_equal(what, pixels, self.picture(light_file, state["exposure"], *options))
        return pixels

    def picture(self, light, exposure, *options):
        """The program's pixels."""
        return self.relit("--light", light, "--exposure", repr(exposure), *options)

    def relit(self, *arguments):
        image = os.path.join(self.folder, "cpu.png")
        subprocess.run([self.refield, "relight", self.field, "-o", image, *arguments], check=True, stdout=subprocess.DEVNULL)
        return read_png(image)[2]

    def expect_exposure(self, what, *light):
        """The page's exposure is the one that the program chooses, but for its margin and rounding."""
        image = os.path.join(self.folder, "exposed.png")
        command = [self.refield, "relight", self.field, *light, "-o", image, "--json"]
        chosen = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)["exposures"][0]
        exposure = self.browser.run("return viewer.exposure()")
        self.expect(EXPOSURE_MARGIN[0] < exposure / chosen < EXPOSURE_MARGIN[1],
                    f"{what}: exposed by {exposure:.4g}, by the program {chosen:.4g}")

    def expect_equal(self, what, seen, expected):
        largest = max(abs(a - b) for a, b in zip(seen, expected))
        differing = sum(a != b for a, b in zip(seen, expected)) / len(expected)
        mean = sum(expected) / len(expected)
        self.expect(len(seen) == len(expected) and largest <= LARGEST_DIFFERENCE and mean > 1,
                    f"{what}: at most {largest} of 255 from the program's, {100 * differing:.1f} % of values differ, mean {mean:.0f}")

    def loads(self):
        self.browser.wait_until("viewer !== null || document.getElementById('status').className.startsWith('error')")
        self.settle()
        self.expect(self.LOADED in self.browser.run("return document.getElementById('status').textContent"), "the page loads from disk")

    def drags_the_bar(self):
        before = self.compare("bar at the start")
        self.browser.drag("#light", [(0.5, 0.5), (0.6, 0.4), (0.75, 0.4)])
        self.settle()
        x = self.browser.run("return viewer.state.x")
        self.expect(abs(x - 0.75) < 0.02, f"the bar follows the mouse to {x:.2f}")
        self.expect(self.compare("bar dragged") != before, "the image follows the bar")

    def drags_a_light_source(self):
        self.browser.click("input[value=spot]")
        self.browser.drag("#light", [(0.2, 0.3), (0.3, 0.4)])
        self.compare("light source dragged")
        before = self.browser.run("return viewer.state.y")
        self.browser.type("body", "\ue015\ue015")  # arrow down
        self.settle()
        self.expect(abs(self.browser.run("return viewer.state.y") - before - 0.02) < 1e-9, "arrow keys move the light source")

    def exposes(self):
        self.browser.type("#exposure", "\ue014" * 10)  # arrow right: 0.1 stops each
        self.settle()
        stops = self.browser.run("return viewer.state.stops")
        self.expect(abs(stops - 1) < 1e-6, f"the slider exposes by {stops} stops")
        self.compare("exposed")
        self.browser.type("#exposure", "\ue012" * 10)

    def loads_a_map(self):
        width, height = self.browser.run("return [viewer.field.light.width, viewer.field.light.height]")
        rgb = bytes(v for y in range(height) for x in range(width)
                    for v in ((255 * x) // width, (255 * y) // height, 200 if (x // 8 + y // 8) % 2 else 30))
        path = os.path.join(self.folder, "map.png")
        write_png(path, width, height, rgb)
        self.browser.type("#map-file", path)
        self.browser.wait_until("viewer.state.kind === 'map'")
        pixels = self.compare("map loaded")
        self.expect_exposure("map loaded", "--light", path)
        self.expect_equal("map loaded, read by the program itself", pixels, self.picture(path, self.browser.run("return viewer.exposure()")))

    def takes_a_dropped_map(self):
        width, height = self.browser.run("return [viewer.field.light.width, viewer.field.light.height]")
        rgbe = bytes(v for y in range(height) for x in range(width)
                     for v in (200, (255 * x) // width, (255 * y) // height, 131 if x // 6 == y // 6 else 127))  # exponents of 8 and 1/2
        path = os.path.join(self.folder, "map.hdr")
        write_hdr(path, width, height, rgbe)
        with open(path, "rb") as file:
            self.browser.run("""
                const bytes = Uint8Array.from(atob(arguments[0]), (letter) => letter.charCodeAt(0)), dropped = new DataTransfer();
                dropped.items.add(new File([bytes], 'map.hdr'));
                const before = viewer.map;
                document.body.dispatchEvent(new DragEvent('drop', {bubbles: true, cancelable: true, dataTransfer: dropped}));
                return new Promise((done) => { const wait = () => viewer.map === before ? setTimeout(wait, 20) : done(); wait(); });""",
                             base64.b64encode(file.read()).decode())
        pixels = self.compare("HDR map dropped")
        self.expect_exposure("HDR map dropped", "--light", path)
        self.expect_equal("HDR map dropped, read by the program itself", pixels, self.picture(path, self.browser.run("return viewer.exposure()")))

    def chooses_a_map(self):
        self.browser.run("const maps = document.getElementById('maps'); maps.value = '0'; maps.dispatchEvent(new Event('change'));"
                         "return new Promise((done) => { const wait = () => viewer.map === null || viewer.state.kind !== 'map'"
                         " ? setTimeout(wait, 20) : done(); wait(); });")

    def shows_an_environment(self):
        """A panorama that the page brings along, against the program's own projection."""
        if self.browser.run("return viewer.field.maps.length") == 0:
            return
        self.chooses_a_map()
        for degrees in (0, 90):
            self.browser.run(f"viewer.state.degrees = {degrees}; viewer.changed();")
            pixels = self.compare(f"environment turned by {degrees}°")
            expected = self.relit("--env", self.environment, "--yaw", str(degrees), "--exposure", repr(self.browser.run("return viewer.exposure()")))
            mean = sum(abs(a - b) for a, b in zip(pixels, expected)) / len(expected)
            if degrees == 0:
                self.expect_exposure("environment", "--env", self.environment)
            self.expect(mean < MEAN_OF_SAMPLING and sum(expected) / len(expected) > 1,
                        f"environment turned by {degrees}°: {mean:.2f} of 255 from 'refield relight --env' in the mean")

    def turns_the_map(self):
        if self.browser.run("return viewer.latLong"):
            self.browser.drag("#light", [(0.3, 0.5), (0.55, 0.5)])
            self.settle()
            degrees = self.browser.run("return viewer.state.degrees")
            self.expect(abs(degrees - 90) < 8, f"dragging turns the map by {degrees:.0f}°")
            self.compare("map turned")

    def picks_a_pixel(self):
        self.browser.click("#scene")  # its middle
        self.settle()
        seen = self.browser.run("return {x: viewer.picked.x, y: viewer.picked.y, kernels: viewer.picked.list.length, width: viewer.field.width,"
                                " height: viewer.field.height, text: document.getElementById('picked').textContent}")
        self.expect(abs(seen["x"] - seen["width"] / 2) <= 1 and abs(seen["y"] - seen["height"] / 2) <= 1 and seen["kernels"] > 0
                    and f"{seen['kernels']} kernels" in seen["text"], "a click picks the pixel under it: " + seen["text"])
        # The row of the transfer matrix that is shown over the map must be the one that is drawn with.
        difference = self.browser.run("""
            viewer.relighter.draw(viewer.exposure());
            const {x, y, list} = viewer.picked, seen = viewer.relighter.readPixels(x, y, 1, 1);
            const sum = [0, 0, 0], interpolator = viewer.projector.interpolator;
            const map = interpolator ? interpolator.gathered(viewer.light) : viewer.light;
            for (const {kernel, weight} of list)
              for (let ty = kernel.y0; ty < kernel.y1; ++ty)
                for (let tx = kernel.x0; tx < kernel.x1; ++tx)
                  for (let c = 0; c < 3; ++c)
                    sum[c] += weight[c] * kernel.value(tx, ty) * map.values[(ty * map.width + tx) * 3 + c];
            const mixing = viewer.field.mixing;
            const mixed = [0, 3, 6].map((row) => mixing[row] * sum[0] + mixing[row + 1] * sum[1] + mixing[row + 2] * sum[2]);
            const encoded = mixed.map((v) => { v = Math.min(v * viewer.exposure(), 1); return 255 * (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055); });
            return Math.max(...encoded.map((v, c) => Math.abs(v - seen[c])));""")
        self.expect(difference < 0.55, f"the pixel's kernels add up to what is drawn ({difference:.2f} of 255)")

    def prints_times(self):
        times = self.browser.run("""
            const times = [];
            const spacing = viewer.spacing();
            const frame = (spaced) => { viewer.lightChanged = true; viewer.frame(0, spaced); times.push([viewer.timing.light, viewer.timing.draw]); };
            for (let i = 0; i < 5; ++i) frame(1);
            const whole = times.sort((a, b) => a[1] - b[1])[2];
            times.length = 0;
            for (let i = 0; i < 5; ++i) frame(spacing);
            return [...whole, times.sort((a, b) => a[1] - b[1])[2][1], spacing];""")
        print(f"      light {times[0]:.1f} ms, image {times[1]:.1f} ms, while moving {times[2]:.1f} ms (every {times[3]} pixels) on {self.browser.run('const gl = viewer.relighter.gl; return gl.getParameter(gl.getExtension(`WEBGL_debug_renderer_info`).UNMASKED_RENDERER_WEBGL)')}")


def drive(kind, sun, steps):
    """Exports a page and runs `steps` of a check of that kind on it. `sun`: texel of the environment and its exponent."""
    refield, field, folder = sys.argv[1:4]
    os.makedirs(folder, exist_ok=True)
    environment = os.path.join(folder, "sky.hdr")
    write_hdr(environment, 128, 64, bytes(v for y in range(64) for x in range(128)
              for v in (2 * x, 255 - 3 * y, 90 + (x * 7 + y * 5) % 130, sun[2] if (x, y) == sun[:2] else 128)))
    subprocess.run([refield, "export-web", field, "-o", os.path.join(folder, "page"), "--env", environment], check=True)
    kind.environment = environment
    return visit(kind, steps)


def visit(kind, steps):
    """Runs `steps` of a check of that kind on the page in the work folder."""
    refield, field, folder = sys.argv[1:4]
    if not shutil.which("chromedriver") or not shutil.which("chromium"):
        print("skipped: chromium and chromium-driver are not installed")
        return SKIPPED
    browser = Browser(os.path.join(folder, "profile"))
    try:
        check = kind(refield, field, folder, browser)
        browser.command("POST", "/url", {"url": "file://" + os.path.abspath(os.path.join(folder, "page", "index.html"))})
        for step in steps:
            step(check)
        if len(sys.argv) > 4:
            browser.screenshot(sys.argv[4])
        complaints = browser.complaints()
        check.expect(not complaints, "the console is quiet" + "".join("\n      " + c for c in complaints))
        return 1 if check.failed else 0
    finally:
        browser.close()


if __name__ == "__main__":
    sys.exit(drive(Check, (90, 25, 134), [
        Check.loads, Check.drags_the_bar, Check.drags_a_light_source, Check.exposes, Check.loads_a_map, Check.takes_a_dropped_map, Check.turns_the_map,
        Check.shows_an_environment, Check.picks_a_pixel, Check.prints_times]))
