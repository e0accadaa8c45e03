# SPDX-License-Identifier: Apache-2.0
"""The viewer's page in headless Chromium, in front of a real daemon: what docs/live.md says of it. One browser and one daemon for all of it but what ends them."""
import base64
import hashlib
import json
import os
import random
import re
import shlex
import subprocess
import sys
import tempfile
import time
import unittest
import urllib.parse
import urllib.request

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from chromium import Page, program

PIXELS = "(() => { const c = document.getElementById('picture'); return Array.from(c.getContext('2d').getImageData(0, 0, c.width, c.height).data) })()"
SUM = "(() => { const c = document.getElementById('picture'); let s = 0; for (const v of c.getContext('2d').getImageData(0, 0, c.width, c.height).data) s = (s * 31 + v) >>> 0; return s })()"
DONE = "document.body.dataset.state === 'done' && Number(document.body.dataset.frames) > {}"
W, H = 120, 90


def field(path, value):
    return (f"(() => {{ const i = document.querySelector('.field[data-path=\"{path}\"] :is(input[type=number], input[type=text], textarea, select)'); i.value = {json.dumps(str(value))}; "
            "i.dispatchEvent(new Event('input', {bubbles: true})); return true })()")


def power(stops):
    return f"(() => {{ const l = document.querySelector('#lamp input[type=range]'); l.min = -12; l.value = {stops}; l.dispatchEvent(new Event('input', {{bubbles: true}})); return true }})()"


def camera_question(then):
    """Wraps the page's fetch: what becomes of the question for the camera, which comes as EXR."""
    return f"(() => {{ const own = window.fetch; window.fetch = async (path, o) => {{ if (String(o?.body).includes('\"EXR\"')) {{ {then} }} return own(path, o) }}; return true }})()"


def text(element):
    return f"document.getElementById('{element}').textContent"


class Daemon:
    def __init__(self):
        self.folder = tempfile.TemporaryDirectory(prefix="gobo-page-")
        self.port, self.process = 0, None
        self.start()

    def start(self):
        command = [os.environ["GOBO_GOBOD"], "--listen", f"unix:{self.folder.name}/s", "--web", f"127.0.0.1:{self.port}", "--log", "error", "--threads", "2"]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE)
        self.port = int(re.search(rb"http://127\.0\.0\.1:(\d+)", self.process.stdout.readline())[1])
        self.url = f"http://127.0.0.1:{self.port}/"

    def kill(self):
        self.process.kill()
        self.process.wait()
        self.process.stdout.close()

    def close(self):
        self.kill()
        self.folder.cleanup()

    def call(self, path, body=None):
        data = None if body is None else json.dumps(body).encode()
        with urllib.request.urlopen(urllib.request.Request(self.url + "v1/" + path, data, {"Content-Type": "application/json"})) as answer:
            return answer.read()

    def get(self, path):
        return json.loads(self.call(path))


class PageCase(unittest.TestCase):
    opened = 0

    @classmethod
    def setUpClass(cls):
        if "page" in PageCase.__dict__:
            return
        PageCase.daemon = Daemon()
        unittest.addModuleCleanup(PageCase.daemon.close)
        PageCase.page = Page(1280, 900)
        unittest.addModuleCleanup(PageCase.page.close)

    def tearDown(self):
        # A stream that an edit or Stop has left ends in the middle of a part; a lost one the page itself speaks of.
        self.assertEqual([c for c in self.page.complaints() if "ERR_INCOMPLETE_CHUNKED_ENCODING" not in c], [])

    def open(self, scene="cornell", search="", frames="half", clean=0):
        """A picture that is soon done. How fast pictures come is the machine's; what they look like then is not to depend on it: half floats, as sampled."""
        request = urllib.parse.quote(json.dumps({"width": W, "height": H, "halt": {"spp": 4}}))
        PageCase.opened += 1
        self.page.go(f"{self.daemon.url}?{search}{PageCase.opened}#scene={scene}&frames={frames}&clean={clean}&request={request}")
        self.page.until(f"location.search === '?{search}{PageCase.opened}' && document.readyState === 'complete' && document.body?.dataset.camera === 'known' && "
                        f"document.body.dataset.state === 'done' && {text('status')}.startsWith('{W} x {H} \u00b7 4 samples')", 60)

    def frames(self):
        return self.page.run("Number(document.body.dataset.frames)")

    def after(self, script, seconds=60):
        """Runs something that asks for a picture; until that is there."""
        before = self.frames()
        self.page.run(script)
        self.page.until(DONE.format(before), seconds)

    def request(self):
        self.page.run("document.getElementById('copied').value = ''; document.getElementById('copy').click()")
        return json.loads(self.page.until("document.getElementById('copied').value"))

    def box(self, element="picture"):
        return self.page.run(f"(() => {{ const r = document.getElementById('{element}').getBoundingClientRect(); return [r.x, r.y, r.width, r.height] }})()")

    def drag(self, x, y, dx, dy, **more):
        self.page.mouse("mousePressed", x, y, **more)
        for i in range(1, 5):
            self.page.mouse("mouseMoved", x + dx * i / 4, y + dy * i / 4, **more)
        self.page.mouse("mouseReleased", x + dx, y + dy, **more)

    def apart(self, data, own=PIXELS):
        """The largest difference of the canvas and a picture in a file's bytes, code values."""
        return self.page.run(f"(async () => {{ const shown = {own}; const t = atob('{base64.b64encode(data).decode()}'); "
                             "const bitmap = await createImageBitmap(new Blob([Uint8Array.from(t, (c) => c.charCodeAt(0))])); const c = new OffscreenCanvas(bitmap.width, bitmap.height); "
                             "const x = c.getContext('2d'); x.drawImage(bitmap, 0, 0); const own = x.getImageData(0, 0, c.width, c.height).data; "
                             "return own.length === shown.length ? shown.reduce((m, v, i) => Math.max(m, Math.abs(v - own[i])), 0) : 999 })()")


class Display(PageCase):
    def test_the_canvas_is_the_commands_picture(self):
        # The command that the page copies, run as it stands, for both painters, every curve, exposures beside the default, a camera and a light of one's own.
        for search in ("", "cpu&"):
            self.open(search=search)
            self.assertEqual(self.page.run("[document.body.dataset.painter, document.body.dataset.format]"), ["2d" if search else "webgl2", "RAW_HALF"])
            self.page.run("document.getElementById('picture').focus()")
            self.page.key("ArrowLeft")
            self.after(power(1))
            for curve, exposure in (("LINEAR", 0.5), ("REINHARD", 2), ("FILMIC", -1.25), ("ACES", 1), ("PBR_NEUTRAL", 0)):
                self.page.run(field("tone_map.curve", curve))
                self.page.run(field("tone_map.exposure", exposure))
                self.page.run("document.getElementById('copied').value = ''; document.getElementById('copy-command').click()")
                command = shlex.split(self.page.until("document.getElementById('copied').value"))
                self.assertEqual(command[:2], ["gobo", "render"])
                self.assertTrue(any(part.startswith("lights.light.gain=2,2,2") for part in command), command)
                out = f"{self.daemon.folder.name}/picture.png"
                subprocess.run([os.environ["GOBO_CLI"], *command[1:]], check=True, capture_output=True, cwd=self.daemon.folder.name,
                               env=os.environ | {"GOBO_SERVER": f"unix:{self.daemon.folder.name}/s"})
                with open(out, "rb") as file:
                    self.assertLessEqual(self.apart(file.read()), 1, (search, curve))

    def test_exposure_and_curve_cost_no_request(self):
        self.open()
        count = "performance.getEntriesByType('resource').length"
        requests, frames, seen = self.page.run(count), self.frames(), {self.page.run(SUM)}
        for path, value in (("tone_map.exposure", 1.5), ("tone_map.exposure", -2), ("tone_map.curve", "ACES"), ("tone_map.curve", "LINEAR")):
            self.page.run(field(path, value))
            seen.add(self.page.run(SUM))
        self.assertEqual(len(seen), 5)
        time.sleep(0.1)
        self.assertEqual((self.page.run(count), self.frames()), (requests, frames))
        # The next edit takes them along.
        self.after(field("seed", 1))
        self.assertEqual(self.request()["tone_map"], {"exposure": -2, "curve": "LINEAR"})

    def test_at_rest_the_noise_goes(self):
        self.open(clean=1)
        clean, noisy = "document.body.dataset.clean === 'yes'", "document.body.dataset.clean === 'no'"
        for edit in (None, field("seed", 5), power(1)):
            if edit:
                self.after(edit)
            self.page.until(clean, 60)
            plain = self.request()
            self.assertNotIn("denoise", plain, "it is not the request's")
            picture = self.daemon.call("render", plain | {"denoise": {"auto": {"fast": True}}, "encoding": {"format": "PNG"}})
            self.assertLessEqual(self.apart(picture), 1)
            self.assertGreater(self.apart(self.daemon.call("render", plain | {"encoding": {"format": "PNG"}})), 8, "there was noise")
        # What is asked for by name, outputs that are not light, and the box: as they are.
        self.after(field("outputs", "normal"))
        self.page.until(noisy, 60)
        self.after(field("outputs", "beauty"))
        self.page.until(clean, 60)
        self.after("document.getElementById('clean').click()")
        self.page.until(noisy, 60)
        self.assertLessEqual(self.apart(self.daemon.call("render", self.request() | {"encoding": {"format": "PNG"}})), 1)

    def test_an_exposure_that_the_server_would_choose(self):
        self.open()
        self.after(power(-12))
        self.assertIn("was chosen", self.page.run(text("status")))
        picture = self.daemon.call("render", self.request() | {"encoding": {"format": "PNG"}})
        self.assertLessEqual(self.apart(picture), 1)

    def test_a_slow_connection_gets_jpeg(self):
        self.open(frames="auto")
        self.page.run(field("halt.spp", 4))
        self.page.call("Network.emulateNetworkConditions", offline=False, latency=0, downloadThroughput=40000, uploadThroughput=-1)
        try:
            for seed in range(1, 6):  # on a loaded machine half floats may be tried again meanwhile
                self.after(field("seed", seed))
                if self.page.run("document.body.dataset.format") == "JPEG":
                    break
            self.assertEqual(self.page.run("document.body.dataset.format"), "JPEG")
            picture = self.daemon.call("render", self.request() | {"encoding": {"format": "JPEG"}})
            self.assertEqual(self.apart(picture), 0)
        finally:
            self.page.call("Network.emulateNetworkConditions", offline=False, latency=0, downloadThroughput=-1, uploadThroughput=-1)
        # What is not light comes as the server shows it.
        self.after(field("outputs", "normal"))
        self.assertEqual(self.apart(self.daemon.call("render", self.request() | {"encoding": {"format": "JPEG"}})), 0)

    def test_a_and_b_and_their_difference(self):
        self.open()
        first = self.page.run(PIXELS)
        self.page.run("document.getElementById('keep').click()")
        self.page.run(field("tone_map.exposure", 2))
        both, row, edge = self.page.run(PIXELS), H // 2 * W * 4, W // 2
        self.assertEqual(both[row:row + (edge - 2) * 4], first[row:row + (edge - 2) * 4])
        self.assertNotEqual(both[row + (edge + 2) * 4:row + W * 4], first[row + (edge + 2) * 4:row + W * 4])
        for search in ("", "cpu&"):
            self.open(search=search)
            self.page.run("document.getElementById('keep').click(); document.getElementById('difference').click()")
            self.assertEqual(set(self.page.run(PIXELS)), {0, 255}, "black where nothing differs; alpha")
            self.assertTrue(self.page.run(text("compared")).endswith("RMSE of A and B, linear: 0"))
            self.after(field("seed", 3))
            faint = sum(self.page.run(PIXELS))
            self.page.run("(() => { const g = document.getElementById('gain'); g.value = 7; g.dispatchEvent(new Event('input', {bubbles: true})); return true })()")
            self.assertGreater(sum(self.page.run(PIXELS)), faint)

    def test_the_reference_and_the_certificate(self):
        self.open("lights8")
        for path in ("shadows.technique", "lights.key.shadow.technique"):
            self.after(f"(() => {{ const s = document.querySelector('.field[data-path=\"{path}\"] select'); s.value = 'ray_traced'; s.dispatchEvent(new Event('input', {{bubbles: true}})); return true }})()")
        self.page.run("(() => { const s = document.getElementById('reference-spp'); s.value = 16; document.getElementById('reference').click(); return true })()")
        self.page.until(f"{text('compared')}.includes('16 samples') && document.getElementById('reference').textContent === 'Reference as A'", 60)
        wrong = float(re.search(r"linear: ([\d.e-]+)", self.page.run(text("compared")))[1])
        self.assertGreater(wrong, 0)
        # Without the approximations nothing is left.
        self.assertEqual({"ray_traced": {}}, self.request()["shadows"])
        self.after(field("halt.spp", 16))
        self.assertFalse(self.page.run(text("compared")).endswith("linear: 0"))
        for path in ("shadows.technique", "lights.key.shadow.technique"):
            self.after(f"document.querySelector('.field[data-path=\"{path}\"] button').click()")
        self.assertTrue(self.page.run(text("compared")).endswith("linear: 0"))
        # A reference keeps its noise.
        self.after("(() => { const s = document.querySelector('.field[data-path=\"denoise.filter\"] select'); s.value = 'wavelet'; s.dispatchEvent(new Event('input', {bubbles: true})); return true })()")
        self.assertEqual(self.request()["denoise"], {"wavelet": {}})
        self.page.run("document.getElementById('reference').click()")
        self.page.until("document.getElementById('reference').textContent === 'Reference as A'", 60)
        self.assertFalse(self.page.run(text("compared")).endswith("linear: 0"))
        self.after("document.querySelector('.field[data-path=\"denoise.filter\"] button').click()")
        self.assertTrue(self.page.run(text("compared")).endswith("linear: 0"))
        for path, value in (("certificate.spp", 8), ("certificate.min_pixels", 200)):
            self.page.run(field(path, value))
        self.page.until("document.body.dataset.state === 'done'", 60)
        self.page.run("document.getElementById('certify').click()")
        said = self.page.until(f"{text('certified')}.startsWith('RMSE') && {text('certified')}", 60)
        rmse, low, high = (float(v) for v in re.search(r"RMSE ([\d.e-]+), 95 % interval ([\d.e-]+) to ([\d.e-]+);", said).groups())
        self.assertTrue(low <= rmse <= high, said)
        self.assertIn("; 200 pixels", said)
        self.after(field("seed", 2))
        self.assertEqual(self.page.run(text("certified")), "", "it was of another picture")


class Hands(PageCase):
    def test_drag_keys_and_wheel_move_the_camera(self):
        self.open()
        plain = self.page.run(SUM)
        seen = {plain}

        def moved(what, act):
            before = self.frames()
            act()
            self.page.until(DONE.format(before), 60)
            picture = self.page.run(SUM)
            self.assertNotIn(picture, seen, what)
            seen.add(picture)

        x, y, w, h = self.box()
        moved("drag", lambda: self.drag(x + w / 2, y + h / 2, 12, 4))
        moved("wheel", lambda: self.page.call("Input.dispatchMouseEvent", type="mouseWheel", x=x + w / 2, y=y + h / 2, deltaX=0, deltaY=60))
        self.page.run("document.getElementById('picture').focus()")
        for key in ("ArrowLeft", "ArrowUp", "+"):
            moved(key, lambda: self.page.key(key))
        before = self.frames()
        self.page.key("Home")
        self.page.until(DONE.format(before), 60)
        self.assertEqual(self.page.run(SUM), plain, "Home is where it began")

    def test_a_late_answer_about_the_camera_takes_no_drag_back(self):
        self.open("lights8")
        known = "document.body.dataset.camera === 'known'"
        place = "(() => { const r = document.querySelector('.handle[data-light=\"e\"]').getBoundingClientRect(); return [r.x + r.width / 2, r.y + r.height / 2] })()"

        def looks():
            camera = self.request()["camera"]
            way = [camera["look_at"][a] - camera["position"][a] for a in "xyz"]
            return [v / sum(w * w for w in way) ** 0.5 for v in way]

        self.page.run("document.getElementById('picture').focus()")
        self.page.key("ArrowLeft")
        stood = looks()
        self.page.run("window.held = new Promise((go) => { window.letGo = go }); true")
        self.page.run(camera_question("const answer = await own(path, o); await window.held; return answer"))
        self.page.run(field("camera.yfov_deg", 40))
        self.assertFalse(self.page.run(known))
        x, y, w, h = self.box()
        self.drag(x + w / 2, y + h / 2, 60, 0)
        dragged = looks()
        self.assertGreater(max(abs(a - b) for a, b in zip(dragged, stood)), 0.1)
        self.page.run("window.letGo(); true")
        self.page.until(known)
        at = self.page.run(place)
        self.page.run("document.getElementById('picture').focus()")
        before = self.frames()
        self.page.key("+")  # goes on from there
        for a, b in zip(looks(), dragged):
            self.assertAlmostEqual(a, b, places=3)
        self.page.until(DONE.format(before), 60)
        # The handles were where that lens sees them from there: where the server puts them, asked anew.
        self.page.key("-")
        self.page.run(field("camera.yfov_deg", 40))
        self.page.until(known)
        for a, b in zip(self.page.run(place), at):
            self.assertAlmostEqual(a, b, delta=0.5)

    def test_a_click_names_what_is_there(self):
        self.daemon.call("scenes", {"source": "cornell", "name": "mine"})
        self.open("mine")
        info, ids = self.daemon.get("scenes/mine"), []
        for output in ("object_id", "material_id"):
            data = self.daemon.call("render", self.request() | {"outputs": [output], "view_samples": 1, "encoding": {"format": "RAW_FLOAT"}})
            ids.append(memoryview(data).cast("f"))
        x, y, w, h = self.box()
        rng = random.Random(4)  # the seed
        wanted = [i * W + j for i, j in ((rng.randrange(H), rng.randrange(W)) for _ in range(5))]
        lamp = next(p for p in range(W * H) if ids[0][p] >= 0 and info["instance_names"][int(ids[0][p])] == "light")
        background = next(p for p in range(W * H) if ids[0][p] < 0)
        for p in (*wanted, background, lamp):
            self.page.run(text("picked") + " = ''")
            px, py = x + (p % W + 0.5) * w / W, y + (p // W + 0.5) * h / H
            self.page.mouse("mousePressed", px, py)
            self.page.mouse("mouseReleased", px, py)
            said = self.page.until(text("picked"))
            thing = int(ids[0][p])
            self.assertEqual(said, "The background" if thing < 0 else f"Object: {info['instance_names'][thing]}; material: {info['material_names'][int(ids[1][p])]}")
        self.assertTrue(self.page.run("document.querySelector('#light-fields details').open"), "the lamp's controls")
        # The material's control changes the scene.
        before, plain = self.frames(), self.page.run(SUM)
        self.page.run("document.getElementById('picture').focus()")
        self.page.key("Enter")
        self.page.until(f"document.querySelector('#object .field[data-path=\"base_color\"]') !== null && {text('picked')}.startsWith('Object')")
        self.page.run("(() => { const r = document.querySelector('#object .field[data-path=\"base_color\"]'); [...r.querySelectorAll('input')].forEach((i, n) => { i.value = [0.1, 0.2, 0.7][n] }); "
                      "r.querySelector('input').dispatchEvent(new Event('input', {bubbles: true})); return true })()")
        self.page.until(DONE.format(before), 60)
        self.assertNotEqual(self.page.run(SUM), plain)
        self.assertNotEqual(self.daemon.get("scenes/mine")["hash"], info["hash"])

    def test_an_object_is_moved_by_its_handle(self):
        self.daemon.call("scenes", {"source": "cornell", "name": "moving"})
        self.open("moving")
        info = self.daemon.get("scenes/moving")
        ids = memoryview(self.daemon.call("render", self.request() | {"outputs": ["object_id"], "view_samples": 1, "encoding": {"format": "RAW_FLOAT"}})).cast("f")
        thing = info["instance_names"].index("tall")
        own = [p for p in range(W * H) if ids[p] == thing]
        p = own[len(own) // 2]
        x, y, w, h = self.box()
        px, py = x + (p % W + 0.5) * w / W, y + (p // W + 0.5) * h / H
        self.page.mouse("mousePressed", px, py)
        self.page.mouse("mouseReleased", px, py)
        place = "(() => { const h = document.querySelector('.handle.object'); if (!h || h.hidden) return null; const r = h.getBoundingClientRect(); return [r.x + r.width / 2, r.y + r.height / 2] })()"
        hx, hy = self.page.until(place)
        self.assertAlmostEqual(hx, px, delta=w / W)
        self.assertAlmostEqual(hy, py, delta=h / H)
        plain, before = self.page.run(SUM), self.frames()
        self.drag(hx, hy, 30, -20)
        self.page.until(DONE.format(before), 60)
        self.page.until(f"{SUM} !== {plain}")
        moved = lambda: memoryview(self.daemon.call("render", self.request() | {"outputs": ["object_id"], "view_samples": 1, "encoding": {"format": "RAW_FLOAT"}})).cast("f")

        def middle(picture):
            mine = [q for q in range(W * H) if picture[q] == thing]
            return sum(q % W for q in mine) / len(mine), sum(q // W for q in mine) / len(mine)
        (ax, ay), (bx, by) = middle(ids), middle(moved())
        end = time.monotonic() + 60
        while abs(bx - ax - 30 * W / w) > 1.5 and time.monotonic() < end:   # patches that came together go together
            (bx, by) = middle(moved())
        self.assertAlmostEqual(bx - ax, 30 * W / w, delta=1.5)
        self.assertLess(by, ay, "upwards")
        # Keys do the same, and the handle goes with the camera.
        self.page.run("document.querySelector('.handle.object').focus()")
        hash_before, before = self.daemon.get("scenes/moving")["hash"], self.frames()
        self.page.key("ArrowLeft")
        self.page.until(DONE.format(before), 60)
        self.assertNotEqual(self.daemon.get("scenes/moving")["hash"], hash_before)
        was = self.page.run(place)
        self.page.run("document.getElementById('picture').focus()")
        before = self.frames()
        self.page.key("ArrowRight")
        self.page.until(DONE.format(before), 60)
        self.assertNotEqual(self.page.run(place), was)

    def test_handles_stand_where_the_server_sees_them(self):
        # The page's projection against the server's own output `position`, for the scene's camera, one turned here, a lens with a shift and an orthographic one.
        self.open("lights8")
        rng = random.Random(7)  # the seed
        info = self.daemon.get("scenes/lights8")
        bounds = {k: [info[f"bounds_{k}"].get(a, 0) for a in "xyz"] for k in ("min", "max")}
        for camera in ({}, {"focal_x": 100, "focal_y": 80, "center_x": 50, "center_y": 60}, {"orthographic_height": 4}):
            base = {"scene": "lights8", "width": W, "height": H, "view_samples": 1, "halt": {"spp": 1}}
            turned = self.page.run(f"(async () => {{ const {{ cameraMatrices }} = await import('/api.js'); const {{ Orbit, moved }} = await import('/orbit.js'); const own = {json.dumps(base | {'camera': camera})}; "
                                   f"const m = await cameraMatrices(own), o = new Orbit(m.worldToCamera, {json.dumps(bounds)}); o.turn(0.3, 0.1); o.pan(0.05, 0.02); "
                                   "return { plain: m, camera: { ...own.camera, ...o.settings() }, matrices: moved(m, o.matrix()) } })()")
            for matrices, request in ((turned["plain"], base | {"camera": camera}), (turned["matrices"], base | {"camera": turned["camera"]})):
                for _ in range(4):
                    i, j = rng.randrange(H), rng.randrange(W)
                    window = {"x": j, "y": i, "width": 1, "height": 1}
                    raw = lambda output: memoryview(self.daemon.call("render", request | {"window": window, "outputs": [output], "encoding": {"format": "RAW_FLOAT"}})).cast("f")
                    if raw("object_id")[0] < 0:
                        continue
                    p = dict(zip("xyz", raw("position")))
                    script = (f"(async () => {{ const {{ project, shifted }} = await import('/handles.js'); const m = {json.dumps(matrices)}, p = {json.dumps(p)}; const q = shifted(m, p, 0.1, -0.07); "
                              "const depth = (v) => v.x * m.worldToCamera[2] + v.y * m.worldToCamera[6] + v.z * m.worldToCamera[10]; return [project(m, p), project(m, q), depth(q) - depth(p)] })()")
                    at, to, deeper = self.page.run(script)
                    self.assertAlmostEqual(at[0] * W, j + 0.5, delta=0.75, msg=str(request))
                    self.assertAlmostEqual(at[1] * H, i + 0.5, delta=0.75, msg=str(request))
                    self.assertAlmostEqual(to[0] - at[0], 0.1, places=3)
                    self.assertAlmostEqual(to[1] - at[1], -0.07, places=3)
                    self.assertAlmostEqual(deeper, 0, places=3)

    def test_a_light_is_moved_by_its_handle(self):
        self.open("lights8")
        handle = "document.querySelector('.handle[data-light=\"e\"]')"
        place = f"(() => {{ const r = {handle}.getBoundingClientRect(); return [r.x + r.width / 2, r.y + r.height / 2] }})()"
        x, y = self.page.run(place)
        before, plain = self.frames(), self.page.run(SUM)
        self.drag(x, y, -15, -10)
        self.page.until(DONE.format(before), 60)
        self.assertNotEqual(self.page.run(SUM), plain)
        nx, ny = self.page.run(place)
        self.assertAlmostEqual(nx - x, -15, delta=0.5)
        self.assertAlmostEqual(ny - y, -10, delta=0.5)
        position = self.request()["lights"]["e"]["position"]
        self.assertEqual(self.page.run("document.getElementById('light').value"), "e")
        self.assertTrue(self.page.run("document.getElementById('lamp').classList.contains('floating')"))
        shown = self.page.run("[...document.querySelectorAll('.field[data-path=\"lights.e.position\"] input')].map((i) => Number(i.value))")
        self.assertEqual(shown, [position[a] for a in "xyz"])
        self.page.run(f"{handle}.focus()")
        for key in ("ArrowRight", "PageUp"):
            before = self.frames()
            self.page.key(key)
            self.page.until(DONE.format(before), 60)
            self.assertNotEqual(self.request()["lights"]["e"]["position"], position)
        # Colour and power next to it, and a light of one's own.
        self.after("(() => { const c = document.querySelector('#lamp input[type=color]'); c.value = '#ff8000'; c.dispatchEvent(new Event('input', {bubbles: true})); return true })()")
        gain = self.request()["lights"]["e"]["gain"]
        self.assertEqual((gain["x"], gain["z"]), (1, 0))
        self.assertAlmostEqual(gain["y"], ((128 / 255 + 0.055) / 1.055) ** 2.4, places=4)
        # A hand that moves through dim colours: each is what it says, however many were before.
        self.after("(() => { const c = document.querySelector('#lamp input[type=color]'); for (const v of ['#800000', '#7f0000', '#7e0000', '#800000']) "
                   "{ c.value = v; c.dispatchEvent(new Event('input', {bubbles: true})) } return true })()")
        gain = self.request()["lights"]["e"]["gain"]
        self.assertAlmostEqual(gain["x"], ((128 / 255 + 0.055) / 1.055) ** 2.4, places=4)
        for kind in ("POINT", "SPOT", "RECT", "DISK", "SPHERE", "DIRECTIONAL"):
            plain = self.page.run(SUM)
            self.after(f"document.getElementById('new-light').value = '{kind}'; document.getElementById('add-light').click()")
            self.assertEqual(self.page.run(text("error")), "")
            self.assertNotEqual(self.page.run(SUM), plain, kind)
        lit = self.page.run(SUM)
        self.after("document.getElementById('drop-light').click()")
        self.assertNotEqual(self.page.run(SUM), lit)

    def test_the_sky_is_turned(self):
        self.open("spheres")
        plain, before = self.page.run(SUM), self.frames()
        x, y, w, h = self.box()
        self.drag(x + w / 2, y + h / 2, h / 4, 0, modifiers=1)  # Alt
        self.page.until(DONE.format(before), 60)
        self.assertNotEqual(self.page.run(SUM), plain)
        request = self.request()
        self.assertAlmostEqual(request["environment"]["rotation_deg"], 45, delta=8)  # a first step is no drag yet
        self.assertNotIn("camera", request)
        self.page.run("document.getElementById('picture').focus()")
        before = self.frames()
        self.page.call("Input.dispatchKeyEvent", type="keyDown", key="ArrowRight", modifiers=1)
        self.page.until(DONE.format(before), 60)
        self.assertAlmostEqual(self.request()["environment"]["rotation_deg"], request["environment"]["rotation_deg"] + 5, places=3)

    def test_a_sky_that_is_dropped_lights_the_scene(self):
        self.open("spheres")
        plain = self.page.run(SUM)
        sky = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 4\n" + bytes((200, 40, 10, 129)) * 8
        self.after("(() => { const map = new DataTransfer(); const t = atob('" + base64.b64encode(sky).decode() + "'); "
                   "map.items.add(new File([Uint8Array.from(t, (c) => c.charCodeAt(0))], 'evening.hdr')); "
                   "document.getElementById('picture').dispatchEvent(new DragEvent('drop', {bubbles: true, cancelable: true, dataTransfer: map})); return true })()")
        self.assertNotEqual(self.page.run(SUM), plain)
        request = self.request()
        self.assertEqual(request["environment"]["digest"], hashlib.sha256(sky).hexdigest())
        png = self.daemon.call("render", {**request, "encoding": {"format": "PNG"}})
        self.assertLessEqual(self.apart(png), 1, "the picture is the server's under that sky")


class Fields(PageCase):
    def test_every_field_of_the_schema_has_a_control(self):
        self.open()
        schema = self.daemon.get("schema")
        missing = []

        def walk(message, path):
            for f in schema["messages"][message]["fields"]:
                here = ".".join([*path, f["name"]])
                if here == "lights":
                    walk("LightEdit", ["lights", "light"])
                elif "oneof" in f:
                    if not self.page.run(f"[...document.querySelectorAll('.field[data-path=\"{'.'.join([*path, f['oneof']])}\"] option')].some((o) => o.value === '{f['name']}')"):
                        missing.append(here)
                elif f["kind"] == "message" and not f.get("repeated"):
                    walk(f["message"], [*path, f["name"]])
                elif f["name"] != "kind" and not self.page.run(f"document.querySelector('.field[data-path=\"{here}\"] :is(input, select, textarea), select[data-path=\"{here}\"]') !== null"):
                    missing.append(here)

        walk(schema["root"], [])
        self.assertEqual(missing, [])
        self.page.run("(() => { const s = document.getElementById('search'); s.value = 'max_bounces'; s.dispatchEvent(new Event('input')); return true })()")
        self.assertEqual(self.page.run("[...document.querySelectorAll('.field')].filter((r) => r.offsetParent).map((r) => r.dataset.path)"), ["integrator.max_bounces"])
        self.assertTrue(self.page.run("document.getElementById('plan').closest('details').offsetParent !== null"))

    def test_a_value_is_refused_next_to_its_field_and_reset(self):
        self.open()
        plain = self.page.run(SUM)
        row = "document.querySelector('.field[data-path=\"{}\"]')"
        for path, value, said in (("integrator.max_bounces", 900, "integrator.max_bounces = 900: must be at most 64"), ("lights.light.intensity", -1, "lights.light.intensity")):
            self.page.run(field(path, value))
            self.page.until("document.body.dataset.state === 'error'")
            self.assertIn(said, self.page.run(row.format(path) + ".querySelector('.fault').textContent"))
            self.assertTrue(self.page.run(row.format(path) + ".querySelector('.fault').offsetParent !== null"), "its group is open")
            self.assertEqual(self.page.run(row.format(path) + ".querySelector('input[type=number]').getAttribute('aria-invalid')"), "true")
            self.page.complaints()  # the browser says that a call was refused
            self.after(row.format(path) + ".querySelector('button').click()")
            self.assertEqual(self.page.run("document.querySelectorAll('.fault').length"), 0)
        self.assertEqual(self.page.run(SUM), plain)
        self.assertEqual(self.page.run(text("error")), "")
        # Texts, lists and maps.
        self.after(field("curves", '{"lights.light.gain": {"time_s": [0], "value": [0.5, 0.5, 0.5]}}'))
        self.assertEqual(self.request()["curves"], {"lights.light.gain": {"time_s": [0], "value": [0.5, 0.5, 0.5]}})
        self.assertNotEqual(self.page.run(SUM), plain)
        self.page.run("document.getElementById('copied').value = ''; document.getElementById('copy-command').click()")
        self.assertTrue(self.page.until("document.getElementById('copied').value").startswith("gobo render --request - "))

    def test_the_latest_of_many_edits_is_shown(self):
        self.open()
        for i in range(30):
            self.page.run(field("lights.light.intensity", 1 + i))
        self.page.until("document.body.dataset.state === 'done'", 60)
        last = self.page.run(SUM)
        self.page.run("document.getElementById('reset').click()")
        self.assertEqual(self.request(), {"scene": "cornell"})
        self.open()
        self.after(field("lights.light.intensity", 30))
        self.assertEqual(self.page.run(SUM), last)

    def test_fits_a_phone_in_the_dark_and_by_keyboard(self):
        self.page.call("Emulation.setDeviceMetricsOverride", width=400, height=800, deviceScaleFactor=1, mobile=True)
        media = lambda **features: self.page.call("Emulation.setEmulatedMedia", features=[{"name": k.replace("_", "-"), "value": v} for k, v in features.items()])
        try:
            self.open("lights8")
            grounds = set()
            for scheme in ("dark", "light"):
                media(prefers_color_scheme=scheme, prefers_reduced_motion="reduce")
                self.page.run("[...document.querySelectorAll('details')].forEach((d) => { d.open = true })")
                self.assertLessEqual(self.page.run("document.documentElement.scrollWidth"), 400)
                ratio = self.page.run("(() => { const probe = (v) => { const c = new OffscreenCanvas(1, 1).getContext('2d'); c.fillStyle = v; c.fillRect(0, 0, 1, 1); const d = c.getImageData(0, 0, 1, 1).data; "
                                      "return [0.2126, 0.7152, 0.0722].reduce((s, k, i) => s + k * (d[i] / 255) ** 2.2, 0) }; "
                                      f"const ground = '{scheme}' === 'dark' ? '#121212' : '#ffffff'; "
                                      "return ['status', 'error', 'keys'].map((id) => { const a = probe(getComputedStyle(document.getElementById(id)).color), b = probe(ground); return (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05) }) })()")
                self.assertGreater(min(ratio), 4.5, scheme)
                grounds.add(self.page.run("getComputedStyle(document.body).color"))
            self.assertEqual(len(grounds), 2, "dark and light differ")
            self.assertTrue(self.page.run("[...document.querySelectorAll('input, select, button, canvas, textarea, progress')].every((e) => e.ariaLabel || e.labels?.length || e.textContent.trim())"))
            self.assertEqual(self.page.run("document.getAnimations().length"), 0)
            # Every control is reached by Tab: nothing takes itself out.
            self.assertEqual(self.page.run("[...document.querySelectorAll('input, select, button, canvas, textarea')].filter((e) => e.tabIndex < 0).length"), 0)
        finally:
            self.page.call("Emulation.clearDeviceMetricsOverride")
            media()


class Farm(unittest.TestCase):
    """The farm's page, in front of a coordinator with one worker."""

    def test_workers_and_jobs_are_shown_as_they_change(self):
        folder = tempfile.TemporaryDirectory(prefix="gobo-farm-page-")
        self.addCleanup(folder.cleanup)
        with open(f"{folder.name}/coordinator.toml", "w", encoding="utf-8") as file:
            file.write(f'[jobs]\nfolder = "{folder.name}/jobs"\nworkers = 0\n')
        socket = f"unix:{folder.name}/s"
        environment = os.environ | {"GOBO_SERVER": socket}

        def start(*command, **more):
            process = subprocess.Popen([os.environ["GOBO_GOBOD"], *command, "--log", "error", "--threads", "1"], **more)
            self.addCleanup(process.wait)
            self.addCleanup(process.kill)
            return process

        def jobs(*command):
            return subprocess.run([os.environ["GOBO_CLI"], "jobs", *command], check=True, capture_output=True, text=True, env=environment).stdout.strip()

        coordinator = start("--config", f"{folder.name}/coordinator.toml", "--listen", socket, "--web", "127.0.0.1:0", stdout=subprocess.PIPE)
        self.addCleanup(coordinator.stdout.close)
        port = int(re.search(rb"http://127\.0\.0\.1:(\d+)", coordinator.stdout.readline())[1])
        page = Page(1280, 900)
        self.addCleanup(page.close)
        rows = "[...document.querySelectorAll('#{} tbody tr')].map((r) => [...r.cells].map((c) => c.textContent.trim()))"
        page.go(f"http://127.0.0.1:{port}/farm.html")
        page.until("Number(document.body?.dataset.looks) > 0")
        self.assertEqual(page.run(rows.format("workers")), [])
        self.assertIn("No worker attends", page.run(text("no-workers")))
        self.assertEqual(page.run(text("no-jobs")), "No jobs.")
        first = jobs("submit", "cornell", "--size", "16x12", "--spp", "2", "--frames", "1-3", "--name", "<b>first</b>")
        second = jobs("submit", "cornell", "--size", "16x12", "--spp", "2", "--name", "second", "--after", first)
        page.until(f"{rows.format('jobs')}.length === 2")
        shown = page.run(rows.format("jobs"))
        self.assertEqual([r[:3] + r[4:7] for r in shown], [[second, "second", "queued", "0 of 1", "0", first], [first, "<b>first</b>", "queued", "0 of 3", "0", ""]])
        self.assertEqual(page.run("document.querySelectorAll('#jobs b').length"), 0, "texts of clients are texts")
        worker = start("--worker", socket, "--worker-name", "one")
        page.until(f"{rows.format('jobs')}.every((r) => r[2] === 'done')", 60)
        shown = page.run(rows.format("jobs"))
        self.assertEqual([r[2:7] for r in shown], [["done", "100 %", "1 of 1", "0", ""], ["done", "100 %", "3 of 3", "0", ""]])
        page.until(f"{rows.format('workers')}[0]?.[5] === '4'")
        name, state, since, threads, holds, done, failed = page.run(rows.format("workers"))[0]
        self.assertEqual((name, state, threads, holds, done, failed), ("one", "attends", "1", "", "4", "0"))
        long = jobs("submit", "cornell", "--size", "320x240", "--spp", str(1 << 18))
        page.until(f"{rows.format('workers')}[0]?.[4] === '{long}:0'", 30)
        jobs("cancel", long)
        page.until(f"{rows.format('jobs')}[0]?.[2] === 'cancelled' && {rows.format('workers')}[0]?.[4] === ''", 30)
        worker.terminate()
        page.until(f"{rows.format('workers')}[0]?.[1] === 'left'", 30)
        self.assertEqual(page.run(text("error")), "")
        self.assertEqual(page.complaints(), [])


class Ends(PageCase):
    def running(self):
        return self.daemon.get("status").get("running", 0)

    def eventually(self, what):
        end = time.monotonic() + 30
        while not what():
            self.assertLess(time.monotonic(), end)
            time.sleep(0.02)

    def test_stop_escape_and_leaving_free_the_cores(self):
        for clean in (0, 1):
            self.open(clean=clean)
            for end in (lambda: self.page.run("document.getElementById('stop').click()"), lambda: self.page.key("Escape"), lambda: self.page.go("about:blank")):
                self.page.run(field("halt.spp", 1 << 18))
                before = self.frames()
                self.page.run(field("seed", before))
                self.page.until(f"document.body.dataset.state === 'rendering' && Number(document.body.dataset.frames) > {before}")
                self.eventually(lambda: self.running() > 0)
                end()
                self.page.until("document.body?.dataset.state !== 'rendering'")
                self.assertNotEqual(self.page.run("document.body?.dataset.clean"), "asked", "nothing follows")
                self.eventually(lambda: self.running() == 0)

    def test_stop_ends_the_picture_without_noise(self):
        self.open(clean=1)
        self.page.until("document.body.dataset.clean === 'yes'", 60)
        # What is asked for without noise would take minutes.
        self.page.run("(() => { const own = window.fetch; window.asked = []; window.fetch = (path, o) => { window.asked.push(path); "
                      "return own(path, o?.body?.includes('\"denoise\"') ? { ...o, body: o.body.replace(/\"spp\":\\d+/, '\"spp\":262144') } : o) }; return true })()")
        stop = "document.getElementById('stop').click()"
        for seed, end in ((1, lambda: self.page.run(stop)), (2, lambda: self.page.key("Escape"))):
            self.page.run(field("seed", seed))
            self.page.until("document.body.dataset.state === 'done' && document.body.dataset.clean === 'asked'", 60)
            self.eventually(lambda: self.running() > 0)
            self.assertFalse(self.page.run("document.getElementById('stop').disabled"))
            end()
            self.assertEqual(self.page.run("[document.body.dataset.clean, document.getElementById('stop').disabled]"), ["no", True])
            self.eventually(lambda: self.running() == 0)
        # Stopped before a picture came: that request was the last.
        self.page.run(f"window.asked = []; {field('seed', 3)}; {stop}; true")
        self.page.until("document.body.dataset.state === 'done'")
        self.assertEqual(self.page.run("[window.asked, document.body.dataset.clean, document.getElementById('stop').disabled]"), [["/v1/render/stream"], "no", True])

    def test_stop_holds_back_what_waits_for_the_camera(self):
        self.open()
        self.page.run("window.held = new Promise((go) => { window.letGo = go }); window.asked = 0; true")
        self.page.run(camera_question("const answer = await own(path, o); await window.held; return answer"))
        self.page.run("(() => { const own = window.fetch; window.fetch = (path, o) => { window.asked += path.includes('/v1/render/stream'); return own(path, o) }; return true })()")
        self.page.run(field("camera.yfov_deg", 40))
        self.page.key("Escape")
        self.page.run("window.letGo(); true")
        self.page.until("document.body.dataset.camera === 'known'")
        self.page.run("new Promise((go) => setTimeout(go, 50))")
        self.assertEqual(self.page.run("window.asked"), 0)
        self.after(field("seed", 1))
        self.assertEqual(self.page.run("window.asked"), 1)

    def test_a_lost_server_is_said_and_found_again(self):
        self.open()
        self.daemon.kill()
        self.page.run(field("seed", 1))
        self.page.until("document.body.dataset.state === 'offline'")
        self.assertIn("trying again", self.page.run(text("error")))
        before = self.frames()
        self.daemon.start()
        self.page.until(DONE.format(before), 60)
        self.assertEqual(self.page.run(text("error")), "")
        # Lost while the camera was asked for: it can be steered afterwards.
        self.page.run(camera_question("if (!window.lost) { window.lost = true; throw new TypeError('nobody answers') }"))
        self.page.run("(() => { const s = document.getElementById('scene'); s.value = 'lights8'; s.dispatchEvent(new Event('change')); return true })()")
        self.page.until("window.lost && document.body.dataset.camera === 'known'", 60)
        x, y, w, h = self.box()
        self.drag(x + w / 2, y + h / 2, 60, 0)
        self.assertIn("position", self.request().get("camera", {}))
        # Lost while another scene was loaded: that one comes.
        self.page.run("(() => { const own = window.fetch; window.fetch = async (path, o) => { if (String(path).includes('/v1/scenes') && !window.gone) "
                      "{ window.gone = true; throw new TypeError('nobody answers') } return own(path, o) }; return true })()")
        before = self.frames()
        self.page.run("(() => { const s = document.getElementById('scene'); s.value = 'grids'; s.dispatchEvent(new Event('change')); return true })()")
        self.page.until(f"window.gone && {DONE.format(before)}", 60)
        self.assertEqual(self.request()["scene"], "grids")
        # One that is none: the scene that is seen keeps its name.
        self.page.run("(() => { const s = document.getElementById('scene'); s.append(new Option('nosuch')); s.value = 'nosuch'; s.dispatchEvent(new Event('change')); return true })()")
        self.page.until("document.getElementById('scene').value === 'grids'")
        self.assertIn("nosuch", self.page.run(text("error")))
        self.page.complaints()  # the browser says that nobody answered

    def test_gobo_view_a_wrong_token_and_a_reload(self):
        process = subprocess.Popen([os.environ["GOBO_CLI"], "--local", "view", "cornell"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        self.addCleanup(process.stdout.close)
        self.addCleanup(process.wait)
        self.addCleanup(process.kill)
        parts = urllib.parse.urlsplit(process.stdout.readline().decode().strip())
        self.page.go(f"{parts.scheme}://{parts.netloc}/#token=wrong&scene=cornell")
        self.page.until("document.getElementById('token')?.hidden === false")
        self.assertIn("token", self.page.run(text("error")))
        self.assertNotIn("wrong", self.page.run("location.href"))
        token = urllib.parse.parse_qs(parts.fragment)["token"][0]
        self.page.run(f"(() => {{ document.querySelector('#token input').value = '{token}'; document.querySelector('#token button').click(); return true }})()")
        self.page.until("Number(document.body.dataset.frames) > 0")
        self.assertTrue(self.page.run("document.getElementById('token').hidden"))
        self.page.complaints()  # 401
        self.page.call("Page.reload")
        self.page.until(f"document.readyState === 'complete' && Number(document.body?.dataset.frames) > 0 && {text('error')} === ''")


if __name__ == "__main__":
    if not program():
        print("skipped: neither chromium-headless-shell nor chromium is installed (deploy/install-deps)")
        sys.exit(1 if os.environ.get("GOBO_REQUIRE_BROWSER") else 77)
    unittest.main()
