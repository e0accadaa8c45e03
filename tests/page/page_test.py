# SPDX-License-Identifier: Apache-2.0
"""The viewer's page in headless Chromium, in front of a real daemon: what docs/live.md says of it. `make page` runs it."""
import base64
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
import unittest
import urllib.parse
import urllib.request

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from chromium import Page

PIXELS = "(() => { const c = document.getElementById('picture'); return Array.from(c.getContext('2d').getImageData(0, 0, c.width, c.height).data) })()"
SUM = "(() => { const c = document.getElementById('picture'); let s = 0; for (const v of c.getContext('2d').getImageData(0, 0, c.width, c.height).data) s = (s * 31 + v) >>> 0; return s })()"
DONE = "document.body.dataset.state === 'done' && Number(document.body.dataset.frames) > {}"


def field(path, value):
    return (f"(() => {{ const i = document.querySelector('.field[data-path=\"{path}\"] input[type=number]'); i.value = '{value}'; "
            "i.dispatchEvent(new Event('input', {bubbles: true})); return true })()")


class PageTest(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory(prefix="gobo-page-")
        self.addCleanup(self.folder.cleanup)
        self.port = 0
        self.start()
        self.page = Page()
        self.addCleanup(self.page.close)

    def start(self, *more):
        command = [os.environ["GOBO_GOBOD"], "--listen", f"unix:{self.folder.name}/s", "--web", f"127.0.0.1:{self.port}", "--log", "error", "--threads", "2", *more]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE)
        self.addCleanup(self.process.stdout.close)
        self.addCleanup(self.process.wait)
        self.addCleanup(self.process.kill)
        self.port = int(re.search(rb"http://127\.0\.0\.1:(\d+)", self.process.stdout.readline())[1])
        self.url = f"http://127.0.0.1:{self.port}/"

    def open(self, scene="cornell"):
        self.page.go(self.url + "#scene=" + scene)
        self.page.until("document.readyState === 'complete' && Number(document.body?.dataset.frames) > 0")

    def frames(self):
        return self.page.run("Number(document.body.dataset.frames)")

    def small(self):
        """A picture that is soon done: 320 x 240, 16 samples."""
        self.page.run("(() => { const s = document.getElementById('size'); s.value = '320x240'; s.dispatchEvent(new Event('change')); return true })()")
        self.page.run(field("halt.spp", 16))
        self.page.until("document.body.dataset.state === 'done' && document.getElementById('status').textContent.startsWith('320 x 240 · 16 samples')", 60)

    def test_the_last_picture_is_the_servers(self):
        self.open()
        self.small()
        request = {"scene": "cornell", "width": 320, "height": 240, "halt": {"spp": 16}, "encoding": {"format": "JPEG", "jpeg_quality": 90}}
        with urllib.request.urlopen(urllib.request.Request(self.url + "v1/render", json.dumps(request).encode(), {"Content-Type": "application/json"})) as answer:
            data = base64.b64encode(answer.read()).decode()
        worst = self.page.run("(async () => { const shown = " + PIXELS + f"; const bitmap = await createImageBitmap(await (async () => {{ const t = atob('{data}'); "
                              "return new Blob([Uint8Array.from(t, (c) => c.charCodeAt(0))]) })()); const c = new OffscreenCanvas(320, 240); "
                              "const x = c.getContext('2d'); x.drawImage(bitmap, 0, 0); const own = x.getImageData(0, 0, 320, 240).data; "
                              "return Math.max(...shown.map((v, i) => Math.abs(v - own[i]))) })()")
        self.assertEqual(worst, 0)
        self.assertEqual(self.page.complaints(), [])

    def test_drag_keys_and_wheel_move_the_camera(self):
        self.open()
        self.small()
        seen = {self.page.run(SUM)}

        def moved(what):
            before = self.frames()
            self.page.until(DONE.format(before), 60)
            picture = self.page.run(SUM)
            self.assertNotIn(picture, seen, what)
            seen.add(picture)

        box = self.page.run("(() => { const r = document.getElementById('picture').getBoundingClientRect(); return [r.x + r.width / 2, r.y + r.height / 2] })()")
        self.page.mouse("mousePressed", *box)
        for i in range(1, 9):
            self.page.mouse("mouseMoved", box[0] + 5 * i, box[1] + i)
        self.page.mouse("mouseReleased", box[0] + 40, box[1] + 8)
        moved("drag")
        self.page.call("Input.dispatchMouseEvent", type="mouseWheel", x=box[0], y=box[1], deltaX=0, deltaY=60)
        moved("wheel")
        self.page.run("document.getElementById('picture').focus()")
        for key in ("ArrowLeft", "ArrowUp", "+"):
            self.page.key(key)
            moved(key)
        self.page.key("Home")
        self.page.until(DONE.format(self.frames()), 60)
        self.assertIn(self.page.run(SUM), seen, "Home is where it began")
        self.assertEqual(self.page.complaints(), [])

    def test_a_field_is_edited_refused_and_reset(self):
        self.open()
        self.small()
        plain, before = self.page.run(SUM), self.frames()
        self.page.run(field("tone_map.exposure", 1.5))
        self.page.until(DONE.format(before), 60)
        self.assertNotEqual(self.page.run(SUM), plain)
        self.page.run(field("integrator.max_bounces", 900))
        self.page.until("document.body.dataset.state === 'error'")
        self.assertIn("integrator.max_bounces = 900: must be at most 64", self.page.run("document.getElementById('error').textContent"))
        self.page.complaints()  # the browser says that a call was refused
        for path in ("integrator.max_bounces", "tone_map.exposure"):
            before = self.frames()
            self.page.run(f"document.querySelector('.field[data-path=\"{path}\"] button').click()")
            self.page.until(DONE.format(before), 60)
        self.assertEqual(self.page.run(SUM), plain)
        self.assertEqual(self.page.run("document.getElementById('error').textContent"), "")
        # Every number, choice and vector of the schema has its control; the search finds one and leaves the plan alone.
        with urllib.request.urlopen(self.url + "v1/schema") as answer:
            messages = json.load(answer)["messages"]
        for name, path in (("Integrator", "integrator"), ("ToneMap", "tone_map"), ("Halt", "halt"), ("LightEdit", "lights.light")):
            for f in messages[name]["fields"]:
                if f["kind"] in ("number", "integer", "bool", "enum", "vector") and "oneof" not in f and f["name"] != "kind":
                    self.assertTrue(self.page.run(f"document.querySelector('.field[data-path=\"{path}.{f['name']}\"]') !== null"), f"{path}.{f['name']}")
        self.page.run("(() => { const s = document.getElementById('search'); s.value = 'bounces'; s.dispatchEvent(new Event('input')); return true })()")
        self.assertEqual(self.page.run("[...document.querySelectorAll('.field')].filter((r) => r.offsetParent).map((r) => r.dataset.path)"), ["integrator.max_bounces"])
        self.assertTrue(self.page.run("document.getElementById('plan').closest('details').offsetParent !== null"))
        self.assertEqual(self.page.complaints(), [])

    def test_the_latest_of_many_edits_is_shown(self):
        self.open()
        self.small()
        for i in range(30):
            self.page.run(field("tone_map.exposure", i / 10))
        self.page.until("document.body.dataset.state === 'done'", 60)
        last = self.page.run(SUM)
        self.page.run("document.getElementById('reset').click()")
        self.small()
        before = self.frames()
        self.page.run(field("tone_map.exposure", 2.9))
        self.page.until(DONE.format(before), 60)
        self.assertEqual(self.page.run(SUM), last)

    def test_a_and_b(self):
        self.open()
        self.small()
        first, before = self.page.run(PIXELS), self.frames()
        self.page.run("document.getElementById('keep').click()")
        self.page.run(field("tone_map.exposure", 2))
        self.page.until(DONE.format(before), 60)
        both, row = self.page.run(PIXELS), 120 * 320 * 4
        self.assertEqual(both[row:row + 150 * 4], first[row:row + 150 * 4])
        self.assertNotEqual(both[row + 170 * 4:row + 320 * 4], first[row + 170 * 4:row + 320 * 4])

    def test_a_lost_server_is_said_and_found_again(self):
        self.open()
        self.small()
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()
        self.page.run(field("tone_map.exposure", 1))
        self.page.until("document.body.dataset.state === 'offline'")
        self.assertIn("trying again", self.page.run("document.getElementById('error').textContent"))
        before = self.frames()
        time.sleep(0.5)
        self.start()
        self.page.until(DONE.format(before), 60)
        self.assertEqual(self.page.run("document.getElementById('error').textContent"), "")

    def test_leaving_frees_the_cores(self):
        self.open()
        self.page.run(field("halt.spp", 1 << 18))
        self.page.until("document.body.dataset.state === 'rendering'")
        self.page.go("about:blank")

        def running():
            with urllib.request.urlopen(self.url + "v1/status") as answer:
                return json.load(answer).get("running", 0)

        end = time.monotonic() + 10
        while running():
            self.assertLess(time.monotonic(), end)
            time.sleep(0.02)

    def test_fits_a_phone_in_the_dark(self):
        self.page.call("Emulation.setDeviceMetricsOverride", width=400, height=800, deviceScaleFactor=1, mobile=True)
        self.page.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": "dark"}])
        self.open()
        self.assertLessEqual(self.page.run("document.documentElement.scrollWidth"), 400)
        self.assertTrue(self.page.run("[...document.querySelectorAll('input, select, button, canvas')].every((e) => e.ariaLabel || e.labels?.length || e.textContent.trim())"))


class TokenTest(unittest.TestCase):
    def test_gobo_view_and_a_wrong_token(self):
        process = subprocess.Popen([os.environ["GOBO_CLI"], "--local", "view", "cornell"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        self.addCleanup(process.stdout.close)
        self.addCleanup(process.wait)
        self.addCleanup(process.kill)
        url = process.stdout.readline().decode().strip()
        parts = urllib.parse.urlsplit(url)
        page = Page()
        self.addCleanup(page.close)
        page.go(f"{parts.scheme}://{parts.netloc}/#token=wrong&scene=cornell")
        page.until("document.getElementById('token')?.hidden === false")
        self.assertIn("token", page.run("document.getElementById('error').textContent"))
        self.assertNotIn("wrong", page.run("location.href"))
        token = urllib.parse.parse_qs(parts.fragment)["token"][0]
        page.run(f"(() => {{ document.querySelector('#token input').value = '{token}'; document.querySelector('#token button').click(); return true }})()")
        page.until("Number(document.body.dataset.frames) > 0")
        self.assertTrue(page.run("document.getElementById('token').hidden"))
        page.call("Page.reload")
        page.until("document.readyState === 'complete' && Number(document.body?.dataset.frames) > 0 && document.getElementById('error').textContent === ''")


if __name__ == "__main__":
    unittest.main()
