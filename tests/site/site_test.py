#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Opens pages of the documentation site in headless Chromium, without a network, on a wide and a narrow window.

usage: tests/site/site_test.py SITE [--pictures FOLDER] [--axe AXE.js] [PAGE...]

A page must load nothing from elsewhere, show all its images, and be no wider than the window. AXE.js (npm:
axe-core) also checks contrast, texts and headings.
"""
import argparse
import base64
import functools
import http.server
import pathlib
import sys
import tempfile
import threading

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "cli"))
from webdriver import Browser  # noqa: E402

PAGES = ["index.html", "how-good.html", "guide/tutorial.html", "guide/troubleshooting.html", "guide/relighting.html",
         "guide/capture.html", "reference/reflectance-field-format.html",
         "reference/commands/relight.html", "reference/cpp/relight.html", "reference/python.html", "method/estimation.html",
         "method/chart.html", "gallery.html"]
WIDTHS = {"wide": 1280, "narrow": 390}

# What is wrong on the page, as texts.
COMPLAINTS = """
const found = [];
for (const entry of performance.getEntriesByType('resource'))
  if (!/^(data|blob):/.test(entry.name) && new URL(entry.name).origin !== location.origin) found.push('loads ' + entry.name);
for (const image of document.images)
  if (image.loading !== 'lazy' && !(image.complete && image.naturalWidth > 0)) found.push('does not show ' + image.src);
for (const video of document.querySelectorAll('video'))
  if (video.error) found.push('does not show ' + video.src);
const window_width = arguments[0];
const width = document.scrollingElement.scrollWidth;
if (width > window_width) {
  const wide = [...document.querySelectorAll('.md-content *')].filter(e => e.getBoundingClientRect().right > window_width + 1 && !e.closest('.md-typeset__scrollwrap, pre, .gallery'));
  found.push(`is ${width} px wide in a window of ${window_width}: ` + wide.slice(0, 3).map(e => e.outerHTML.slice(0, 80)).join(' | '));
}
return found;
"""
AXE = """
const done = arguments[arguments.length - 1];
axe.run(document, {iframes: false, resultTypes: ['violations']}).then(result => done(result.violations.map(
  v => `${v.id} (${v.impact}): ${v.nodes.length} of ${v.help}: ${v.nodes[0].html.slice(0, 120)} ${(v.nodes[0].any[0] || {message: ''}).message.slice(0, 160)}`)));
"""


class Silent(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *arguments):
        pass

    def copyfile(self, source, outputfile):
        try:
            super().copyfile(source, outputfile)
        except ConnectionError:  # the browser has seen enough of a film
            pass


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("site", type=pathlib.Path)
    parser.add_argument("--pictures", type=pathlib.Path)
    parser.add_argument("--axe", type=pathlib.Path)
    parser.add_argument("pages", nargs="*")
    options = parser.parse_args()
    pages = options.pages or [page for page in PAGES if (options.site / page).exists()]
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Silent, directory=options.site))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    complaints = []
    with tempfile.TemporaryDirectory() as folder:
        # No name is resolved, so that a request to another machine fails as it does without a network.
        browser = Browser(folder, ["--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1"])
        try:
            for page in pages:
                for kind, width in WIDTHS.items():
                    browser.command("POST", "/goog/cdp/execute", {"cmd": "Emulation.setDeviceMetricsOverride", "params": {
                        "width": width, "height": 860, "deviceScaleFactor": 1, "mobile": width < 600}})
                    browser.command("POST", "/url", {"url": f"http://127.0.0.1:{server.server_port}/{page}"})
                    found = browser.run(COMPLAINTS, width)
                    if options.axe:
                        browser.run(options.axe.read_text())
                        found += browser.command("POST", "/execute/async", {"script": AXE, "args": []})
                    if options.pictures:
                        options.pictures.mkdir(parents=True, exist_ok=True)
                        picture = browser.command("GET", "/screenshot")
                        name = page.removesuffix(".html").replace("/", "-")
                        (options.pictures / f"{name}-{kind}.png").write_bytes(base64.b64decode(picture))
                    complaints += [f"{page} ({kind}): {text}" for text in found]
                for entry in browser.command("POST", "/se/log", {"type": "browser"}):
                    if entry["level"] == "SEVERE":
                        complaints.append(f"{page}: {entry['message']}")
        finally:
            browser.command("DELETE", "")
            browser.driver.terminate()
            server.shutdown()
    print("\n".join(complaints))
    return 1 if complaints else 0


if __name__ == "__main__":
    sys.exit(main())
