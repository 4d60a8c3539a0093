#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Drives the page of a field in tiles in headless Chromium (mouse, wheel, keys) and compares what it draws, enlarged or
not, with `refield relight` under the same light.

    drive_tiles_page.py REFIELD FIELD WORK_FOLDER [SCREENSHOT]

WORK_FOLDER/page is the page, of at least two levels. Exit status 77: Chromium or its driver is not installed."""
import glob
import math
import os
import sys

from drive_page import Check, visit


class TilesCheck(Check):
    def view(self):
        return self.browser.run("const {zoom, left, top, closest} = viewer.relighter.camera; return {zoom, left, top, closest}")

    def picture(self, light, exposure, *options):
        """Of the program's pixels those that the canvas shows."""
        pixels = self.relit("--light", light, "--exposure", repr(exposure), *options)
        canvas_width, canvas_height = self.browser.run("return [viewer.field.width, viewer.field.height]")
        tiles, view = self.browser.run("return viewer.field.tiles"), self.view()
        stride = max(tiles["stride"] // 2 ** math.floor(math.log2(view["zoom"])), tiles["finest"])
        density = tiles["stride"] / stride
        seen = lambda start, length: [math.floor((i + 0.5) / view["zoom"] * density + start * density) * stride for i in range(length)]
        columns, rows = seen(view["left"], canvas_width), seen(view["top"], canvas_height)
        starts = (3 * (y * tiles["width"] + x) for y in rows for x in columns)
        return b"".join(pixels[start:start + 3] for start in starts)

    def moves(self, what, action):
        before = self.view()
        action()
        self.settle()
        after = self.view()
        self.expect(after != before, f"{what}: {after['zoom']:.3g} times as large, from column {after['left']:.1f}, row {after['top']:.1f} on")
        return before, after

    def starts_with_the_overview(self):
        self.browser.run("viewer.state.x = 0.3; viewer.changed();")
        self.compare("overview")
        self.expect(self.browser.run("return viewer.relighter.tiles.size") == 0, "no tile is loaded for it")

    def enlarges(self):
        self.browser.click("#scene")
        before, after = self.moves("wheel", lambda: self.browser.wheel("#scene", -800))
        self.expect(abs(after["zoom"] / 1.1 ** 8 - 1) < 1e-6, "the wheel enlarges by a tenth for each line")
        self.expect(self.browser.run("return viewer.relighter.tiles.size") > 0, "tiles are loaded")
        self.compare("enlarged by the wheel")
        before, after = self.moves("drag", lambda: self.browser.drag("#scene", [(0.7, 0.7), (0.5, 0.6), (0.4, 0.5)]))
        self.expect(after["left"] > before["left"] and after["top"] > before["top"] and after["zoom"] == before["zoom"], "the picture follows the mouse")
        self.compare("panned")
        self.browser.drag("#light", [(0.3, 0.5), (0.6, 0.5)])
        self.compare("under another light")

    def shows_every_pixel(self):
        closest = self.view()["closest"]
        self.moves("keys", lambda: self.browser.type("#scene", "+" * 40))
        self.expect(self.view()["zoom"] == closest, f"{closest:g} times is the limit")
        self.compare("finest pixels, enlarged")
        finest = self.browser.run("const {stride, finest} = viewer.field.tiles; return stride / finest")
        self.browser.run("const [factor] = arguments; viewer.moveCamera((camera) => { camera.reset(); camera.approach(factor, [0, 0]); })", finest)
        self.compare("finest pixels")
        self.browser.run("viewer.moveCamera((camera) => camera.pan(-1e6, -1e6))")
        self.compare("finest pixels, at the right and lower edge")
        if finest == 2:
            return
        self.browser.run("viewer.moveCamera((camera) => { camera.reset(); camera.approach(2); })")
        self.compare("level before")

    def picks_a_pixel(self):
        self.browser.click("#scene")
        self.settle()
        tiles, view = self.browser.run("return viewer.field.tiles"), self.view()
        canvas = self.browser.run("return [viewer.field.width, viewer.field.height]")
        seen = self.browser.run("return {x: viewer.picked.x, y: viewer.picked.y, text: document.getElementById('picked').textContent}")
        wanted = [(start + size / 2 / view["zoom"]) * tiles["stride"] for start, size in zip((view["left"], view["top"]), canvas)]
        far = 2 * tiles["stride"] / view["zoom"]
        self.expect(abs(seen["x"] - wanted[0]) <= far and abs(seen["y"] - wanted[1]) <= far, "a click picks the pixel of the picture under it: " + seen["text"])

    def shows_all_again(self):
        self.moves("key F", lambda: self.browser.type("body", "f"))
        self.compare("overview again")

    def misses_a_tile(self):
        """The overview stands in for tiles that were not copied."""
        complaints = self.browser.complaints()  # before the browser's own, of each missing file
        self.expect(not complaints, "the console is quiet until then" + "".join("\n      " + c for c in complaints))
        for tile in glob.glob(os.path.join(self.folder, "page", "data-tile-*.js")):
            os.remove(tile)
        self.browser.run("const {tiles, camera} = viewer.relighter; tiles.clear(); viewer.moveCamera(() => camera.approach(2));")
        self.settle()
        status = self.browser.run("return document.getElementById('status').textContent")
        self.expect("missing" in status, "missing tiles are named: " + status)
        self.browser.complaints()


if __name__ == "__main__":
    sys.exit(visit(TilesCheck, [
        TilesCheck.loads, TilesCheck.starts_with_the_overview, TilesCheck.enlarges, TilesCheck.shows_every_pixel, TilesCheck.picks_a_pixel, TilesCheck.prints_times,
        TilesCheck.shows_all_again] + ([] if len(sys.argv) > 4 else [TilesCheck.misses_a_tile])))
