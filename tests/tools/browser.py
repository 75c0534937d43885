"""Headless Chromium, driven through chromedriver by the W3C WebDriver protocol (plain HTTP)."""

import base64
import json
import shutil
import socket
import subprocess
import tempfile
import time
import urllib.error
import urllib.request

# The driver is on this machine, whatever proxy there may be.
OPENER = urllib.request.build_opener(urllib.request.ProxyHandler({}))

ARGUMENTS = [
    "--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--hide-scrollbars",
    # WebGL without a graphics card.
    "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--disable-background-networking", "--disable-component-update", "--no-first-run",
]


def find():
    """The paths of chromium and chromedriver, or None where one of them is missing."""
    paths = shutil.which("chromium"), shutil.which("chromedriver")
    return paths if all(paths) else None


class Browser:
    """One window of `width` by `height` pixels. A context manager."""

    def __init__(self, width=1400, height=1000):
        chromium, chromedriver = find()
        with socket.socket() as listener:
            listener.bind(("127.0.0.1", 0))
            port = listener.getsockname()[1]
        self._profile = tempfile.TemporaryDirectory(prefix="locvol-chromium-")
        self._driver = subprocess.Popen([chromedriver, f"--port={port}"],
                                        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self._url = f"http://127.0.0.1:{port}"
        try:
            self._wait_until_ready()
            options = {
                "binary": chromium,
                "args": ARGUMENTS + [f"--user-data-dir={self._profile.name}",
                                     f"--window-size={width},{height}"],
            }
            capabilities = {"browserName": "chrome", "goog:chromeOptions": options,
                            "goog:loggingPrefs": {"browser": "ALL", "performance": "ALL"},
                            "timeouts": {"script": 120000, "pageLoad": 120000}}
            session = self._post("/session", {"capabilities": {"alwaysMatch": capabilities}})
            self._url += f"/session/{session['sessionId']}"
        except BaseException:
            self._stop()
            raise

    def __enter__(self):
        return self

    def __exit__(self, *_):
        try:
            self._call("DELETE", "", None)
        finally:
            self._stop()

    def resize(self, width, height):
        """Lays pages out for such a screen, which may be smaller than any window."""
        self._post("/goog/cdp/execute", {
            "cmd": "Emulation.setDeviceMetricsOverride",
            "params": {"width": width, "height": height, "deviceScaleFactor": 1,
                       "mobile": False}})

    def open(self, url):
        self._post("/url", {"url": url})

    def run(self, script, *arguments):
        """What the script returns; a promise is waited for."""
        return self._post("/execute/sync", {"script": script, "args": list(arguments)})

    def log(self, kind):
        """What came since the last call: `kind` is browser (the console) or performance."""
        return self._post("/se/log", {"type": kind})

    def screenshot(self):
        return base64.b64decode(self._call("GET", "/screenshot", None))

    def act(self, actions):
        """Pointer and key actions, as the protocol describes them."""
        self._post("/actions", {"actions": actions})

    def _wait_until_ready(self):
        for _ in range(200):
            try:
                if self._call("GET", "/status", None)["ready"]:
                    return
            except (urllib.error.URLError, ConnectionError):
                pass
            time.sleep(0.1)
        raise RuntimeError("chromedriver does not answer")

    def _stop(self):
        self._driver.terminate()
        self._driver.wait()
        self._profile.cleanup()

    def _post(self, path, body):
        return self._call("POST", path, body)

    def _call(self, method, path, body):
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(self._url + path, data, method=method,
                                         headers={"Content-Type": "application/json"})
        try:
            with OPENER.open(request, timeout=180) as answer:
                return json.load(answer)["value"]
        except urllib.error.HTTPError as error:
            raise RuntimeError(json.load(error)["value"]["message"]) from None
