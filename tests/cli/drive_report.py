#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Points at the charts of a report in headless Chromium, from disk: they show the values that the page holds.

usage: tests/cli/drive_report.py PROGRAM RECIPE [PICTURE.png]

Exit status 77: Chromium or its driver is not there.
"""
import base64
import html
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

from webdriver import Browser


def values_of(svg):
    """{position: {name: value}} of a chart's marks, from their titles."""
    values = {}
    for title in re.findall(r"<title>(.*?)</title>", svg):
        name, position, value = re.fullmatch(r"(.*), ([^,]*): (.*)", html.unescape(title)).groups()
        values.setdefault(position, {})[name] = value
    return values


def point_at(browser, chart, part):
    """Moves the pointer over a part, from 0 to 1, of a chart's width; what is shown then."""
    box = browser.run("const svg = document.querySelectorAll('svg.chart')[arguments[0]]; svg.scrollIntoView({block: 'center'});"
                      "return svg.getBoundingClientRect().toJSON()", chart)
    browser.pointer([{"type": "pointerMove", "duration": 0, "x": round(box["x"] + part * box["width"]), "y": round(box["y"] + 0.6 * box["height"])}])
    return shown(browser)


def shown(browser):
    return browser.run("return [...document.querySelectorAll('.tip')].map(tip => ({place: tip.firstChild.textContent,"
                       "rows: [...tip.querySelectorAll('div')].map(row => row.textContent)}))")


def check(browser, page, picture):
    charts = [values_of(svg) for svg in re.findall(r'<svg class="chart".*?</svg>', page, flags=re.S)]
    charts = list(enumerate(charts))
    assert len(charts) >= 3, f"{len(charts)} charts"
    seen = 0
    for number, values in charts:
        if not values:
            continue
        for part in (0.15, 0.5, 0.85):
            tips = point_at(browser, number, part)
            assert len(tips) == 1, f"chart {number}: {len(tips)} tips"
            position = tips[0]["place"].rpartition(": ")[2]
            expected = [f"{name}: {value}" for name, value in values[position].items()]
            assert tips[0]["rows"] == expected, f"chart {number} at {position}: {tips[0]['rows']}, not {expected}"
            seen += 1
        if picture and len(values) > 3:
            picture.write_bytes(base64.b64decode(browser.command("GET", "/screenshot")))
            picture = None
    assert seen >= 9, f"{seen} positions"
    before = shown(browser)
    browser.run("document.querySelectorAll('svg.chart')[arguments[0]].focus()", number)
    browser.command("POST", "/actions", {"actions": [{"type": "key", "id": "keys", "actions": [
        {"type": "keyDown", "value": "\ue012"}, {"type": "keyUp", "value": "\ue012"}]}]})  # the left arrow
    after = shown(browser)
    places = list(charts[-1][1])
    assert places.index(after[0]["place"].rpartition(": ")[2]) == places.index(before[0]["place"].rpartition(": ")[2]) - 1, f"{before} → {after}"
    browser.command("POST", "/goog/cdp/execute", {"cmd": "Emulation.setEmulatedMedia", "params": {"media": "print"}})
    # A tip of our own: the page for print has another layout, in which the pointer may have left the chart and its tip be gone.
    assert browser.run("const tip = document.body.appendChild(document.createElement('div')); tip.className = 'tip';"
                       "const {display} = getComputedStyle(tip); tip.remove(); return display") == "none", "the tip is printed"
    browser.command("POST", "/goog/cdp/execute", {"cmd": "Emulation.setEmulatedMedia", "params": {"media": "screen"}})
    browser.pointer([{"type": "pointerMove", "duration": 0, "x": 2, "y": 2}])
    assert not shown(browser), "the tip stays"
    errors = [entry["message"] for entry in browser.command("POST", "/se/log", {"type": "browser"}) if entry["level"] == "SEVERE"]
    assert not errors, errors


def main():
    if len(sys.argv) not in (3, 4):
        sys.exit(__doc__.split("\n\n")[1])
    if not (shutil.which("chromedriver") and shutil.which("chromium")):
        print("no Chromium with its driver here (Debian: chromium, chromium-driver)")
        return 77
    program, recipe = (str(pathlib.Path(argument).resolve()) for argument in sys.argv[1:3])
    picture = pathlib.Path(sys.argv[3]).resolve() if len(sys.argv) == 4 else None
    with tempfile.TemporaryDirectory() as folder:
        for arguments in (["simulate", recipe, "-o", "truth", "--width", "32", "--height", "24", "--light-width", "16", "--light-height", "12",
                           "--train", "40", "--natural", "3", "--bars", "2", "--squares", "2", "--quality", "1", "--noise", "0.005"],
                          ["estimate", "truth", "-o", "a.rfield"], ["estimate", "truth", "--mode", "paper", "-o", "b.rfield"],
                          ["report", "truth", "--field", "a.rfield", "--field", "b.rfield", "-o", "report.html"]):
            subprocess.run([program, "--quiet", *arguments], cwd=folder, check=True, capture_output=True)
        page = pathlib.Path(folder) / "report.html"
        browser = Browser(pathlib.Path(folder) / "profile")
        try:
            browser.command("POST", "/url", {"url": page.as_uri()})
            check(browser, page.read_text(encoding="utf-8"), picture)
        finally:
            browser.command("DELETE", "")
            browser.driver.terminate()
    return 0


if __name__ == "__main__":
    sys.exit(main())
