# SPDX-License-Identifier: Apache-2.0
"""One page of a headless Chromium, over its DevTools pipe: NUL-ended JSON on descriptors 3 (to it) and 4 (from it). No network but what the page does."""
import base64
import json
import os
import select
import shutil
import subprocess
import tempfile
import time


class Failed(Exception):
    pass


def program():
    """Debian's browser: the one without windows, or the whole one; None: neither is there."""
    return shutil.which("chromium-headless-shell") or shutil.which("chromium")


class Page:
    def __init__(self, width=1280, height=800):
        self.folder = tempfile.TemporaryDirectory(prefix="gobo-page-", ignore_cleanup_errors=True)
        read_end, self.to = os.pipe()
        self.back, write_end = os.pipe()
        # The program finds its ends at 3 and 4; a shell moves them there whatever numbers they have here.
        # WebGL2 is the browser's own SwiftShader, whatever GPU is there.
        # WebGL2 is the browser's own SwiftShader, whatever GPU is there.
        command = ["bash", "-c", f'exec 3<&{read_end} 4>&{write_end}; exec "$0" "$@"', program(), "--headless", "--no-sandbox", "--use-angle=swiftshader",
                   "--enable-unsafe-swiftshader", "--disable-dev-shm-usage", "--disable-extensions", "--disable-background-networking", "--remote-debugging-pipe",
                   f"--user-data-dir={self.folder.name}", f"--window-size={width},{height}", "about:blank"]
        self.process = subprocess.Popen(command, pass_fds=(read_end, write_end), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        os.close(read_end)
        os.close(write_end)
        self.held, self.number, self.session, self.events = b"", 0, None, []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(domain + ".enable")

    def close(self):
        self.process.kill()
        self.process.wait()
        os.close(self.to)
        os.close(self.back)
        self.folder.cleanup()

    def call(self, method, seconds=30, **parameters):
        self.number += 1
        message = {"id": self.number, "method": method, "params": parameters} | ({"sessionId": self.session} if self.session else {})
        os.write(self.to, json.dumps(message).encode() + b"\0")
        end = time.monotonic() + seconds
        while True:
            got = self._next(end - time.monotonic(), method)
            if got.get("id") == self.number:
                if "error" in got:
                    raise Failed(f"{method}: {got['error']}")
                return got["result"]
            self.events.append(got)

    def _next(self, seconds, what):
        end = time.monotonic() + seconds
        while b"\0" not in self.held:
            if not select.select([self.back], [], [], max(0, end - time.monotonic()))[0]:
                raise Failed(f"{what}: no answer from the browser")
            part = os.read(self.back, 1 << 20)
            if not part:
                raise Failed("the browser has ended")
            self.held += part
        line, self.held = self.held.split(b"\0", 1)
        return json.loads(line)

    def run(self, script):
        """The value of an expression in the page; promises are waited for."""
        got = self.call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in got:
            raise Failed(f"{script}: {got['exceptionDetails'].get('exception', got['exceptionDetails'])}")
        return got["result"].get("value")

    def until(self, script, seconds=30):
        end = time.monotonic() + seconds
        while not (value := self.run(script)):
            if time.monotonic() > end:
                raise Failed(f"never true: {script}; the page says {self.run('[document.body.dataset.state, document.body.innerText.slice(0, 400)]')}")
            time.sleep(0.05)
        return value

    def go(self, url):
        self.call("Page.navigate", url=url)

    def mouse(self, kind, x, y, **more):
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **({"button": "left", "buttons": 1, "clickCount": 1} | more))

    def key(self, name):
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=name)

    def screenshot(self, path):
        with open(path, "wb") as file:
            file.write(base64.b64decode(self.call("Page.captureScreenshot")["data"]))

    def complaints(self):
        """What the console and uncaught exceptions said since the last call."""
        self.run("0")
        said = []
        for e in self.events:
            if e["method"] == "Runtime.exceptionThrown":
                said.append(e["params"]["exceptionDetails"].get("exception", {}).get("description", "exception"))
            elif e["method"] == "Runtime.consoleAPICalled" and e["params"]["type"] in ("error", "warning"):
                said.append(str(e["params"]["args"]))
            elif e["method"] == "Log.entryAdded" and e["params"]["entry"]["level"] == "error":
                said.append(e["params"]["entry"]["text"] + " " + e["params"]["entry"].get("url", ""))
        self.events = []
        return said
