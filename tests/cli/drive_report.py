#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Points at the charts of a report in headless Chromium, from disk: they show the values that the page holds.

usage: tests/cli/drive_report.py PROGRAM RECIPE [PICTURE.png]

Exit status 77: Chromium or its driver is not there.
"""
import base64
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

from webdriver import Browser


def values_of(browser):
    """Of each chart {position: {name: value}}, from the labels of its marks."""
    charts = []
    for labels in browser.run("return [...document.querySelectorAll('svg.chart')].map(svg => "
                              "[...svg.querySelectorAll('circle, .bar')].map(mark => mark.getAttribute('aria-label')))"):
        charts.append({})
        for label in labels:
            name, position, value = re.fullmatch(r"(.*), ([^,]*): (.*)", label).groups()
            charts[-1].setdefault(position, {})[name] = value
    return charts


# JavaScript expressions over the page's script and what they give.
EXPRESSIONS = {
    "String(html`<b title=\"${'\"'}\">${'a<b>&'}</b>`)": "<b title=\"&#34;\">a&#60;b&#62;&#38;</b>",
    "fixed(2.345, 1)": "2.3", "fixed(null, 1)": "–", "significant(0.012345, 3)": "0.0123", "significant(9.996, 3)": "10.0",
    "significant(1234.5, 2)": "1200", "significant(-0.5, 1)": "-0.5", "significant(0, 3)": "0", "percent(0.023456)": "2.35\u00a0%",
    "bytesText(999)": "999 bytes", "bytesText(4e9)": "4.00 GB", "durationText(0.0032)": "3.2 ms", "durationText(4.24)": "4.2 s",
    "durationText(59.97)": "1 min 0 s", "durationText(125)": "2 min 5 s", "durationText(3599.6)": "1 h 0 min",
    "durationText(7200)": "2 h 0 min", "short(0.5)": "0.5", "roundUp(0.021)": 0.025,
    "linear(0, 4, 200, 100)(1)": 175, "linear(3, 3, 0, 10)(3)": 5, "roundTicks(7, 7, 5)": [7],
    "roundTicks(0, 1, 5).map(tick => fixed(tick, 6))": ["0.000000", "0.200000", "0.400000", "0.600000", "0.800000", "1.000000"],
    # Ticks of all extents: at least two, at most eleven, inside.
    "[0, -3.7, 24, 1e-7].flatMap(low => [1e-6, 0.013, 0.9, 1, 75, 3.3e5].map(size => roundTicks(low, low + size, 5).filter("
    "tick => tick >= low - 1e-6 * size && tick <= low + (1 + 1e-6) * size).length)).every(count => count >= 2 && count <= 11)": True,
}
LINE = """{title: 'Error <1>', x: 'images', y: 'error', plain: true, ticks: [0, 10],
           series: [{name: 'a', colour: 0, points: [[0, 1], [5, 0.5], [10, 0], [20, null]]}]}"""
BARS = "{title: '', y: '', groups: ['one', 'two', 'none'], series: [{name: 's', colour: 0, values: [0.1, 0.2, null]}]}"


def check_script(browser):
    for expression, expected in EXPRESSIONS.items():
        found = browser.run(f"return {expression}")
        assert found == expected, f"{expression}: {found}, not {expected}"
    marks = ("const box = document.createElement('div'); box.innerHTML = %s; return [...box.querySelectorAll('circle, rect')]"
             ".map(mark => ['cx', 'cy', 'height'].map(name => Number(mark.getAttribute(name))))")
    # Three points on a line, as the fourth is no number: the middle one halfway between the others. To a tenth of a pixel.
    (x0, y0, _), (x1, y1, _), (x2, y2, _) = browser.run(marks % f"lineChart({LINE})")
    assert abs(x1 - (x0 + x2) / 2) <= 0.1 and abs(y1 - (y0 + y2) / 2) <= 0.1 and x0 < x2 and y0 < y2, (x0, x1, x2, y0, y1, y2)
    # What needs more photographs, or a rig with errors, than the page below has.
    learning = browser.run("return String(moreImages([{label: 'a', number: 0, learning: {measured: [[0.5, 0.2], [0.8, 0.1]],"
                           "extrapolated: [[1, 0.08], [2, 0.05]], advice: 'twice the images'}}]))")
    assert "a: measured, 0.8: 10.0\u00a0%" in learning and "twice the images." in learning, learning
    rig = browser.run("return String(check({rows: [{property: 'motion', state: 'corrected', measured: 'it moved', residual_before: 0.2,"
                      "residual_after: 0.1, remedy: 'fix the camera'}], residuals_before: [0.08, 0.2], residuals_corrected: [0.04, 0.05],"
                      "shift_px: [[0, 0], [-0.25, -0.5]], gain: [[1, 1, 1], [1.02, 1, 0.98]], room: [], mixing: [[1, 0.125, 0],"
                      "[0, 1, 0], [0, 0, 1]]}))")
    for words in ("20.0\u00a0% → 10.0\u00a0%", "as photographed, 2: 20.0", "corrected, 2: 5.00", "to the right, 2: -0.25", "down, 2: -0.5",
                  "gain, red, 2: 2.00", "red channel", '<td class="num">0.125</td>'):
        assert words in rig, f"{words}: {rig}"
    assert "room light, " not in rig, rig
    (_, _, low), (_, _, high) = browser.run(marks % f"barChart({BARS})")
    assert abs(high - 2 * low) <= 0.2, f"bars {low} and {high} pixels high"


def point_at(browser, chart, part):
    """Moves the pointer over a part, from 0 to 1, of a chart's width; what is shown then."""
    box = browser.run("const svg = document.querySelectorAll('svg.chart')[arguments[0]]; svg.scrollIntoView({block: 'center'});"
                      "return svg.getBoundingClientRect().toJSON()", chart)
    browser.pointer([{"type": "pointerMove", "duration": 0, "x": round(box["x"] + part * box["width"]), "y": round(box["y"] + 0.6 * box["height"])}])
    return shown(browser)


def shown(browser):
    return browser.run("return [...document.querySelectorAll('.tip')].map(tip => ({place: tip.firstChild.textContent,"
                       "rows: [...tip.querySelectorAll('div')].map(row => row.textContent)}))")


def check(browser, picture):
    headings = browser.run("return [...document.querySelectorAll('h2')].map(heading => heading.textContent)")
    assert headings == ["Summary", "Check of the capture", "Under new light", "Kernels of selected pixels", "Kernel statistics",
                        "Time and memory"], headings
    charts = list(enumerate(values_of(browser)))
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
        for arguments in (["simulate", recipe, "-o", "truth", "--size", "32x24", "--light-size", "16x12",
                           "--train", "40", "--test", "3,2,2", "--quality", "1", "--noise", "0.005"],
                          ["estimate", "truth", "-o", "a.rfield"], ["estimate", "truth", "--mode", "paper", "-o", "b.rfield"],
                          ["compare", "a.rfield", "truth", "--field", "b.rfield", "-o", "report.html"]):
            subprocess.run([program, "--quiet", *arguments], cwd=folder, check=True, capture_output=True)
        page = pathlib.Path(folder) / "report.html"
        browser = Browser(pathlib.Path(folder) / "profile")
        try:
            browser.command("POST", "/url", {"url": page.as_uri()})
            check_script(browser)
            check(browser, picture)
        finally:
            browser.command("DELETE", "")
            browser.driver.terminate()
    return 0


if __name__ == "__main__":
    sys.exit(main())
