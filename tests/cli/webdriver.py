# SPDX-License-Identifier: Apache-2.0
"""Headless Chromium with software rendering, driven by mouse and keys through chromedriver (W3C WebDriver)."""
import base64
import json
import subprocess
import urllib.error
import urllib.request

ELEMENT = "element-6066-11e4-a52e-4f735466cecf"  # W3C WebDriver, 11
PATIENCE = 1200  # seconds; ends what hangs


class Browser:
    """Chromium behind chromedriver's HTTP interface."""

    def __init__(self, folder, arguments=()):
        self.driver = subprocess.Popen(
            ["chromedriver", "--port=0"], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        self.base = None
        for line in self.driver.stdout:
            if "successfully on port" in line:
                self.base = f"http://127.0.0.1:{int(line.rsplit('port', 1)[1].strip(' .' + chr(10)))}"
                break
        if not self.base:
            raise RuntimeError("chromedriver does not start")
        arguments = [
            *arguments, "--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--window-size=1280,860", "--force-device-scale-factor=1",
            "--use-angle=swiftshader", "--enable-unsafe-swiftshader", f"--user-data-dir={folder}", "--no-first-run",
        ]
        capabilities = {"alwaysMatch": {"goog:chromeOptions": {"args": arguments}, "goog:loggingPrefs": {"browser": "ALL"}}}
        self.session = self.started(capabilities)
        self.command("POST", "/timeouts", {"script": 1000 * PATIENCE})

    def started(self, capabilities, attempts=3):
        """On a loaded machine Chromium may take longer to start than its driver waits."""
        for attempt in range(1, attempts + 1):
            try:
                return self.request("POST", "/session", {"capabilities": capabilities})["sessionId"]
            except RuntimeError:
                if attempt == attempts:
                    self.driver.terminate()
                    raise

    def request(self, method, path, body=None):
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(self.base + path, data, {"Content-Type": "application/json"}, method=method)
        try:
            with urllib.request.urlopen(request, timeout=PATIENCE) as answer:
                return json.load(answer)["value"]
        except urllib.error.HTTPError as error:
            raise RuntimeError(f"{path}: {json.load(error)['value']['message']}") from None

    def command(self, method, path, body=None):
        return self.request(method, f"/session/{self.session}{path}", body)

    def run(self, script, *arguments):
        return self.command("POST", "/execute/sync", {"script": script, "args": list(arguments)})

    def wait_until(self, condition):
        """Waits in the page, frame by frame, until a JavaScript expression holds."""
        script = f"const done = arguments[0]; const look = () => ({condition}) ? done() : requestAnimationFrame(look); look();"
        self.command("POST", "/execute/async", {"script": script, "args": []})

    def find(self, selector):
        return self.command("POST", "/element", {"using": "css selector", "value": selector})[ELEMENT]

    def pointer(self, actions):
        self.command("POST", "/actions", {"actions": [{"type": "pointer", "id": "mouse", "parameters": {"pointerType": "mouse"}, "actions": actions}]})

    def touch(self, *fingers):
        """Fingers that move at the same time, each a list of actions."""
        self.command("POST", "/actions", {"actions": [{"type": "pointer", "id": f"finger{i}", "parameters": {"pointerType": "touch"}, "actions": actions}
                                                      for i, actions in enumerate(fingers)]})

    def wheel(self, selector, pixels_down):
        place = self.place(selector, 0.5, 0.5)
        self.command("POST", "/actions", {"actions": [{"type": "wheel", "id": "wheel", "actions": [
            {"type": "scroll", "duration": 0, "deltaX": 0, "deltaY": pixels_down, **place}]}]})

    def place(self, selector, x, y):
        """Screen position of a point of an element, x and y from 0 to 1."""
        box = self.run("return document.querySelector(arguments[0]).getBoundingClientRect().toJSON()", selector)
        return {"x": round(box["x"] + x * box["width"]), "y": round(box["y"] + y * box["height"])}

    def path(self, selector, points, button=0):
        """Actions of a pointer that is pressed at the first point and let go at the last."""
        steps = [{"type": "pointerMove", "duration": 0, **self.place(selector, *points[0])}, {"type": "pointerDown", "button": button}]
        steps += [{"type": "pointerMove", "duration": 20, **self.place(selector, x, y)} for x, y in points[1:]]
        return steps + [{"type": "pointerUp", "button": button}]

    def drag(self, selector, points, button=0):
        self.pointer(self.path(selector, points, button))

    def click(self, selector):
        self.command("POST", f"/element/{self.find(selector)}/click", {})

    def type(self, selector, text):
        self.command("POST", f"/element/{self.find(selector)}/value", {"text": text})

    def screenshot(self, path):
        with open(path, "wb") as file:
            file.write(base64.b64decode(self.command("GET", "/screenshot")))

    def complaints(self):
        return [entry["message"] for entry in self.command("POST", "/se/log", {"type": "browser"}) if entry["level"] == "SEVERE"]

    def close(self):
        try:
            self.command("DELETE", "")
        finally:
            self.driver.terminate()
            self.driver.wait()
