# SPDX-License-Identifier: Apache-2.0
"""Drake's glTF Render API at POST /render (docs/drake.md): every kind of picture against where rays meet boxes, every refusal by its words, scenes that
are not parsed twice, tokens, many callers, clients that hang up."""
import hashlib
import http.client
import json
import os
import re
import shutil
import signal
import socket
import subprocess
import tempfile
import threading
import time
import unittest
import urllib.parse
import urllib.request

from drake_form import TWO_BOXES, boxes_glb, fields, form, meet, post, read_png, read_tiff

INF = float("inf")
SMALL = dict(width=96, height=72, focal_x=86.9, focal_y=86.9, center_x=47.5, center_y=35.5)


def query(request):
    return "/render?request=" + urllib.parse.quote(json.dumps(request))


class Door(unittest.TestCase):
    """A daemon a test."""

    config = ""

    def setUp(self):
        self.begin(self, self.addCleanup)

    @staticmethod
    def begin(self, clean_up):   # of a test, or of a class
        self.folder = tempfile.mkdtemp(prefix="gobo-drake-")
        clean_up(shutil.rmtree, self.folder, ignore_errors=True)
        config = os.path.join(self.folder, "gobod.toml")
        with open(config, "w", encoding="utf-8") as file:
            file.write(f'listen = ["unix:s.sock"]\n[web]\nlisten = "127.0.0.1:0"\n[http]\nlisten = "127.0.0.1:0"\n[limits]\n'
                       f'upload_bytes = "1MiB"\n[engine]\nthreads = 2\n[ingest]\ncache_folder = "{self.folder}/ingest"\n' + self.config)
        with open(os.path.join(self.folder, "log"), "wb") as log:
            self.process = subprocess.Popen([os.environ["GOBO_GOBOD"], "--config", config], stdout=subprocess.PIPE, stderr=log)
        clean_up(self.process.stdout.close)
        clean_up(self.process.wait)
        clean_up(self.process.kill)
        self.metrics_port, self.port = map(int, re.findall(r"http://127\.0\.0\.1:(\d+)", self.process.stdout.readline().decode()))

    def metric(self, name):
        with urllib.request.urlopen(f"http://127.0.0.1:{self.metrics_port}/metrics", timeout=10) as answer:
            found = re.search(rf"^{re.escape(name)} (\S+)$", answer.read().decode(), re.MULTILINE)
        return float(found[1]) if found else 0.0

    def uploads(self):
        return self.metric('gobo_requests_total{method="upload",code="OK"}')

    def eventually(self, what, seconds=10):
        end = time.monotonic() + seconds
        while not what():
            self.assertLess(time.monotonic(), end)
            time.sleep(0.01)

    def picture(self, scene, image_type="color", **change):
        status, kind, body = post(self.port, scene, image_type, **change)
        self.assertEqual(status, 200, body[:300])
        self.assertEqual(kind, "image/tiff" if image_type == "depth" else "image/png")
        return body

    def refused(self, scene, image_type="color", *, status=400, **change):
        got, kind, body = post(self.port, scene, image_type, **change)
        self.assertEqual((got, kind), (status, "text/plain; charset=utf-8"), body[:300])
        return body.decode()

    def each_pixel(self, boxes, values, step=1):
        """(x, y, depth or None, box or None) of the pixels whose ray does not touch an edge."""
        for y in range(0, int(values["height"]), step):
            for x in range(0, int(values["width"]), step):
                seen = meet(boxes, x + 0.5, y + 0.5, values)
                around = {meet(boxes, x + 0.5 + a, y + 0.5 + b, values)[1] for a in (-0.02, 0.02) for b in (-0.02, 0.02)}
                if around == {seen[1]}:
                    yield x, y, *seen

    def check_depth(self, scene, boxes, step=1, **change):
        values = fields(scene, "depth", **change)
        width, height, rows = read_tiff(self.picture(scene, "depth", **change))
        self.assertEqual((width, height), (int(values["width"]), int(values["height"])))
        least, most, kinds = float(values["min_depth"]), float(values["max_depth"]), set()
        for x, y, depth, _ in self.each_pixel(boxes, values, step):
            wanted = INF if depth is None or depth > most else 0.0 if depth < least else depth
            kinds.add("far" if wanted == INF else "near" if wanted == 0 else "seen")
            if depth is not None and min(abs(depth - least), abs(depth - most)) < 1e-5:
                continue
            if wanted in (0.0, INF):
                self.assertEqual(rows[y][x], wanted, (x, y))
            else:
                self.assertAlmostEqual(rows[y][x], wanted, delta=2e-6, msg=(x, y))
        return kinds

    def check_labels(self, scene, boxes, step=1, **change):
        values = fields(scene, "label", **change)
        width, height, channels, rows = read_png(self.picture(scene, "label", **change))
        self.assertEqual((width, height, channels), (int(values["width"]), int(values["height"]), 3))
        codes = [bytes(int(c * 255 + 0.5) for c in colour) for _, _, colour in boxes]
        seen = {row[3 * x:3 * x + 3] for row in rows for x in range(width)}
        self.assertLessEqual(seen, {*codes, b"\xff\xff\xff"}, "no colour between two labels")
        for x, y, _, box in self.each_pixel(boxes, values, step):
            self.assertEqual(rows[y][3 * x:3 * x + 3], b"\xff\xff\xff" if box is None else codes[box], (x, y))
        return seen


class Shared(Door):
    """A daemon for all tests of a class; uploads are counted from the test's beginning."""

    @classmethod
    def setUpClass(cls):
        cls.begin(cls, cls.addClassCleanup)

    def setUp(self):
        self.before = 0
        self.before = self.uploads()

    def uploads(self):
        return super().uploads() - self.before


class Published(Door):
    def test_the_published_scene(self):
        scene = boxes_glb(TWO_BOXES)
        self.assertEqual(self.check_depth(scene, TWO_BOXES, step=5), {"far", "seen"})
        self.assertEqual(self.check_labels(scene, TWO_BOXES, step=5), {b"\x40\xff\x40", b"\xff\x40\x40", b"\xff\xff\xff"})
        self.assertEqual(read_png(self.picture(scene))[:2], (640, 480))
        for image_type in ("color", "depth", "label"):   # asked for again: the same bits
            self.assertEqual(self.picture(scene, image_type), self.picture(scene, image_type), image_type)
        self.assertEqual(self.uploads(), 1)


class Pictures(Shared):
    def test_principal_points_off_centre_and_pixels_that_are_not_square(self):
        scene = boxes_glb(TWO_BOXES)
        for change in (dict(center_x=20.25, center_y=50.75), dict(focal_x=60, focal_y=110), dict(focal_x=130, focal_y=70, center_x=80, center_y=10, width=101, height=67)):
            self.assertIn("seen", self.check_depth(scene, TWO_BOXES, **{**SMALL, **change}))
            self.check_labels(scene, TWO_BOXES, **{**SMALL, **change})

    def test_depths_out_of_the_sensor_s_range(self):
        scene = boxes_glb(TWO_BOXES)
        self.assertEqual(self.check_depth(scene, TWO_BOXES, **SMALL, min_depth="0.33", max_depth="0.36"), {"near", "seen", "far"})
        self.assertEqual(self.check_depth(scene, TWO_BOXES, **SMALL, min_depth="0", max_depth="0.2"), {"far"})
        self.assertEqual(self.check_depth(scene, TWO_BOXES, **SMALL, min_depth="5", max_depth="6"), {"near", "far"})

    def test_planes_that_clip(self):
        scene = boxes_glb(TWO_BOXES)
        self.assertEqual(self.check_depth(scene, TWO_BOXES, **SMALL, near="0.34", far="0.37"), {"far", "seen"})
        self.check_labels(scene, TWO_BOXES, **SMALL, near="0.34", far="0.37")

    def test_labels_are_the_file_s_numbers(self):
        """Drake writes a label's colour as code / 255: each code comes back, black and codes next to each other too, whatever the light."""
        codes = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (11, 0, 0), (127, 128, 129), (255, 254, 253), (17, 200, 91)]
        boxes = [((0, 0.05 * (i - 3), 0), (0.02, 0.02, 0.02), tuple(c / 255 for c in code)) for i, code in enumerate(codes)]
        scene = boxes_glb(boxes)
        seen = self.check_labels(scene, boxes, **SMALL)
        self.assertEqual(seen, {bytes(c) for c in codes} | {b"\xff\xff\xff"})
        lit = query({"environment": {"constant": {"x": 9}}, "tone_map": {"exposure": 3}, "halt": {"spp": 1}, "denoise": {"auto": {}}})
        self.assertEqual(self.picture(scene, "label", path=lit, **SMALL), self.picture(scene, "label", **SMALL))

    def test_colours(self):
        """Unlit materials show their colour; a Lambert plane in the light of a uniform sky of 1 shows its own where nothing else is seen from it."""
        srgb = lambda c: round(255 * (12.92 * c if c <= 0.0031308 else 1.055 * c ** (1 / 2.4) - 0.055))
        plain = {"tone_map": {"curve": "LINEAR"}, "environment": {"constant": {"x": 0.2, "y": 0.3, "z": 0.4}}}
        scene = boxes_glb(TWO_BOXES, unlit=True)
        _, _, channels, rows = read_png(self.picture(scene, path=query(plain), **SMALL))
        counts = [0, 0, 0]
        for x, y, _, box in self.each_pixel(TWO_BOXES, fields(scene, **SMALL)):
            around = {meet(TWO_BOXES, x + 0.5 + a, y + 0.5 + b, fields(scene, **SMALL))[1] for a in (-1.6, 0, 1.6) for b in (-1.6, 0, 1.6)}
            if around == {box}:
                wanted = (0.2, 0.3, 0.4) if box is None else TWO_BOXES[box][2]
                counts[2 if box is None else box] += 1
                for c in range(3):
                    self.assertAlmostEqual(rows[y][channels * x + c], srgb(wanted[c]), delta=1, msg=(x, y))
        self.assertGreater(min(counts), 100)
        dark = {"tone_map": {"curve": "LINEAR"}, "environment": {"constant": {"x": 0.002, "y": 0.002, "z": 0.002}}}   # stays dark: pictures are to compare
        _, _, channels, rows = read_png(self.picture(boxes_glb(TWO_BOXES[:1]), path=query(dark), **SMALL))
        self.assertEqual(rows[2][:3], bytes([srgb(0.002)] * 3))
        one = [((0, 0, 0), (0.05, 0.05, 0.05), (0.5, 0.2, 0.8))]   # convex: it lights nothing
        furnace = {"tone_map": {"curve": "LINEAR"}, "environment": {"constant": {"x": 0.5, "y": 0.5, "z": 0.5}}, "halt": {"spp": 64}}
        scene = boxes_glb(one)
        _, _, channels, rows = read_png(self.picture(scene, path=query(furnace), **SMALL))
        total, n = [0.0] * 3, 0
        for x, y, depth, box in self.each_pixel(one, fields(scene, **SMALL)):
            if {meet(one, x + 0.5 + a, y + 0.5 + b, fields(scene, **SMALL))[1] for a in (-1.6, 1.6) for b in (-1.6, 1.6)} == {0}:
                total = [t + rows[y][channels * x + c] for c, t in enumerate(total)]
                n += 1
        self.assertGreater(n, 100)
        for c in range(3):   # a dielectric of index 1.5 reflects 4 % and more as well: its white furnace is 1, so that colour goes towards white
            low, high = srgb(0.5 * one[0][2][c]), srgb(0.5 * (one[0][2][c] + 0.12 * (1 - one[0][2][c])))
            self.assertGreaterEqual(total[c] / n, low - 3)
            self.assertLessEqual(total[c] / n, high + 3)

    def test_nothing_but_what_the_form_says_comes_from_the_address(self):
        scene = boxes_glb(TWO_BOXES)
        for request, words in (({"outputs": ["depth"]}, "outputs"), ({"width": 7}, "width"), ({"window": {"width": 3, "height": 3}}, "window"), ({"scene": "x"}, "scene"),
                               ({"spp": 3}, "spp"), ({"encoding": {"format": "EXR"}}, "encoding")):
            self.assertIn(words, self.refused(scene, path=query(request), **SMALL))
        self.assertIn("max_bounces = 900", self.refused(scene, path=query({"integrator": {"max_bounces": 900}}), **SMALL))

    def test_an_address_with_anything_else_is_refused(self):
        scene = boxes_glb(TWO_BOXES)
        for address, words in (("/render?requets={}", "'requets' is not known here; did you mean 'request'?"), ("/render?request={}&spp=3", "'spp' is not known"),
                               ("/render?request={}&request={}", "'request' stands in it twice")):
            self.assertIn(words, self.refused(scene, path=address, **SMALL))
        for address in ("/rendr", "/rendr?request={}"):
            status, _, body = post(self.port, scene, path=address, **SMALL)
            self.assertEqual((status, b"nothing to POST to" in body), (404, True))

    def test_where_the_daemon_keeps_a_scene_is_not_said(self):
        for scene in (b'{"asset": {"version": "2.0"}, "meshes": 3}', b'{"asset": {"version": "2.0"}, "buffers": [{"byteLength": 4, "uri": "none.bin"}]}', b"{"):
            self.assertNotIn("gobo-upload-", self.refused(scene, **SMALL))

    def test_a_gltf_with_its_buffers_in_its_text(self):
        import base64
        import struct
        glb = boxes_glb(TWO_BOXES)
        size, = struct.unpack("<I", glb[12:16])
        document = json.loads(glb[20:20 + size])
        document["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64.b64encode(glb[28 + size:]).decode()
        self.assertEqual(self.picture(json.dumps(document).encode(), "label", **SMALL), self.picture(glb, "label", **SMALL))
        del document["buffers"][0]["uri"]
        self.assertIn("/bufferViews/0", self.refused(json.dumps(document).encode(), **SMALL))
        document["buffers"][0]["uri"] = "file:///etc/passwd"
        self.assertIn("/buffers/0", self.refused(json.dumps(document).encode(), **SMALL))


class Refusals(Shared):
    def test_every_field_by_name_and_value(self):
        scene = boxes_glb(TWO_BOXES[::-1])   # which no other test here sends
        whole = fields(scene, "depth", **SMALL)
        for name in whole:
            if name != "submit":
                self.assertTrue(self.refused(scene, values={k: v for k, v in whole.items() if k != name}).startswith(f"{name}: is missing"), name)
        for name in ("min_depth", "max_depth"):   # of other pictures they are not asked
            without = {k: v for k, v in fields(scene, "label", **SMALL).items() if k != name}
            self.assertEqual(post(self.port, scene, values=without)[0], 200)
        wrong = [("width", "0"), ("width", "-3"), ("width", "20000"), ("width", "6.5"), ("width", "12x"), ("width", ""), ("height", "0"), ("height", "1e2"), ("near", "-1"), ("near", "nan"),
                 ("near", "x"), ("far", "0.01"), ("far", "inf"), ("far", "0.005"), ("focal_x", "0"), ("focal_y", "-5"), ("focal_x", "1e99"), ("fov_x", "0"), ("fov_y", "4"), ("fov_y", "a"),
                 ("center_x", "1e30"), ("center_y", "0x10"), ("min_depth", "-1"), ("min_depth", " 1"), ("max_depth", "0.01"), ("max_depth", "1,5"), ("image_type", "rgb"),
                 ("image_type", "COLOR"), ("scene_sha256", "abc"), ("scene_sha256", ""), ("scene_sha256", "0" * 64), ("focal_z", "1")]
        for name, value in wrong:
            self.assertTrue(self.refused(scene, values={**whole, name: value}).startswith(f'{name} = "{value}": '), (name, value))
        self.assertIn("16777216", self.refused(scene, width=16384, height=16384))
        self.assertIn("8388608 pixels in a picture of labels", self.refused(scene, "label", width=4096, height=2049))
        self.assertEqual(self.uploads(), 1)
        self.picture(scene, "depth", **SMALL)   # and it still serves

    def test_digests_in_capitals_and_bodies_in_pieces(self):
        scene = boxes_glb(TWO_BOXES)
        wanted = self.picture(scene, "label", **SMALL, scene_sha256=hashlib.sha256(scene).hexdigest().upper())
        kind, body = form(fields(scene, "label", **SMALL), scene)
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=30)   # in pieces of unannounced length
        self.addCleanup(connection.close)
        connection.request("POST", "/render", iter([body[i:i + 37] for i in range(0, len(body), 37)]), {"Content-Type": kind, "Transfer-Encoding": "chunked"}, encode_chunked=True)
        self.assertEqual(connection.getresponse().read(), wanted)
        for _ in range(2):   # one connection, one request after the other
            connection.request("POST", "/render", body, {"Content-Type": kind})
            self.assertEqual(connection.getresponse().read(), wanted)

    def test_scenes_that_are_none(self):
        scenes = self.metric("gobo_scenes")
        values = fields(b"", **SMALL)
        kind, body = form(values, None)
        self.assertEqual(self.raw(kind, body)[:2], (400, b"scene: is missing in the form, or has no bytes\n"))
        for scene in (b"glTF" + b"\0" * 40, b"{", b'{"asset": {"version": "2.0"}, "meshes": 3}', b"\x89PNG"):
            self.assertTrue(self.refused(scene, **SMALL).startswith("scene: "), scene)
        self.assertEqual(self.metric("gobo_scenes"), scenes)

    def raw(self, kind, body, headers=None):
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=30)
        self.addCleanup(connection.close)
        connection.request("POST", "/render", body, {"Content-Type": kind, **(headers or {})})
        answer = connection.getresponse()
        return answer.status, answer.read(), answer

    @staticmethod
    def pieces(body, size):
        return iter([body[i:i + size] for i in range(0, len(body), size)])

    def test_bodies_that_are_no_forms(self):
        scene = boxes_glb(TWO_BOXES)
        kind, body = form(fields(scene, **SMALL), scene)
        self.assertEqual(self.raw("application/json", b"{}")[0], 400)
        self.assertIn(b"boundary", self.raw("multipart/form-data", body)[1])
        for cut in (10, len(body) // 3, len(body) - 12):
            status, text, _ = self.raw(kind, body[:cut])
            self.assertEqual(status, 400, text)
        self.assertEqual(self.raw(kind, b"")[0], 400)
        twice = fields(scene, **SMALL)
        _, second = form({"width": "7"}, None)
        mark = kind.split("=")[1].encode()
        self.assertIn(b"width: is in the form twice", self.raw(kind, b"--" + mark + b'\r\nContent-Disposition: form-data; name="width"\r\n\r\n7\r\n' + body)[1])
        self.assertIn(b"scene: is in the form twice", self.raw(kind, body[:-len(b"--" + mark + b"--\r\n")] + b"--" + mark
                                                               + b'\r\nContent-Disposition: form-data; name="scene"\r\n\r\nmore\r\n--' + mark + b"--\r\n")[1])
        self.assertEqual(self.raw(kind, form({**twice, "width": "7" * 5000}, scene)[1].replace(b"x", b"x"))[0], 400)
        part = lambda name, value: b"--" + mark + b'\r\nContent-Disposition: form-data; name="' + name + b'"\r\n\r\n' + value + b"\r\n"
        for name, first, second in ((b"submit", b"", b"Render"), (b"submit", b"Render", b""), (b"submit", b"", b""), (b"width", b"", b"96"), (b"scene", b"", scene)):
            rest = form({k: v for k, v in fields(scene, **SMALL).items() if k != name.decode()}, None if name == b"scene" else scene)
            twice = part(name, first) + part(name, second) + rest[1].replace(rest[0].split("=")[1].encode(), mark)
            for pieces in (None, 1, 7, 64):   # in pieces the reader begins fields with no byte
                status, text, _ = self.raw(kind, twice if pieces is None else self.pieces(twice, pieces))
                self.assertEqual((status, text.split(b": ")[1:]), (400, [b"is in the form twice\n"]), (text, first, pieces))
                self.assertIn(name, text.split(b": ")[0].split(b" or ") if pieces else [text.split(b": ")[0]])
        once = part(b"submit", b"\r\n--" + mark[:-1] + b"!") + form({k: v for k, v in fields(scene, "label", **SMALL).items() if k != "submit"}, scene)[1]
        once = re.sub(rb"--[0-9a-f]{32}(?=\r\n|--)", b"--" + mark, once)
        for pieces in (1, 5, 37):
            self.assertEqual(self.raw(kind, self.pieces(once, pieces))[0], 200, pieces)
        many, all_fields = form({f"f{i}": "1" for i in range(80)}, scene)
        self.assertIn(b"more than 64 fields", self.raw(many, all_fields)[1])
        for header in ({"Origin": "http://evil.example"}, {"Host": "evil.example"}):
            self.assertIn(next(iter(header)), self.refused(scene, status=403, headers=header, **SMALL))
        with urllib.request.urlopen(f"http://127.0.0.1:{self.port}/", timeout=10) as page:
            self.assertEqual(page.status, 200)
        with self.assertRaises(urllib.error.HTTPError) as got:
            urllib.request.urlopen(f"http://127.0.0.1:{self.port}/render", timeout=10)
        self.assertEqual(got.exception.code, 404)
        got.exception.close()

    def test_bodies_that_are_too_large(self):
        kind, _ = form({}, None)
        with socket.create_connection(("127.0.0.1", self.port), timeout=10) as s:   # by what the head says, before a byte of the body
            s.sendall(f"POST /render HTTP/1.1\r\nHost: localhost\r\nContent-Type: {kind}\r\nContent-Length: {1 << 30}\r\n\r\n".encode())
            self.assertTrue(s.recv(100).startswith(b"HTTP/1.1 413 "))
        scene = boxes_glb(TWO_BOXES) + b"\0" * ((1 << 20) + 20000)
        self.assertIn("scene: has more than 1048576 bytes (limits.upload_bytes", self.refused(scene, status=413, **SMALL))
        # One empty field again and again: what is said of it stays short, and a body of which nobody said how long it is has an end.
        mark = kind.split("=")[1].encode()
        part = b"--" + mark + b'\r\nContent-Disposition: form-data; name="' + b"\x01" * 80 + b'"\r\n\r\n\r\n'
        for bytes_, status in ((1 << 19, 400), ((1 << 20) + (1 << 17), 413)):
            body = part * (bytes_ // len(part)) + b"--" + mark + b"--\r\n"
            got = self.raw(kind, self.pieces(body, 1 << 16))
            self.assertEqual(got[0], status, got[1][:200])
            self.assertLess(len(got[1]), 3000)
        self.picture(boxes_glb(TWO_BOXES), "label", **SMALL)


class Silence(Door):
    """The door ends clients that are silent for 30 s: not those that wait for a picture. The daemon is stopped while the tests before this one pass the
    time (a clock that was set for the client goes on meanwhile), so that it costs no processor."""

    SECONDS = 31

    @classmethod
    def begin_to_wait(cls):
        cls.begin(cls, unittest.addModuleCleanup)
        cls.got, cls.begun = [], time.monotonic()
        cls.caller = threading.Thread(target=lambda: cls.got.append(post(cls.port, boxes_glb(TWO_BOXES), path=query({"halt": {"time_s": cls.SECONDS}}), timeout=1000, **SMALL)), daemon=True)
        cls.caller.start()
        while not cls.runs():
            if not cls.caller.is_alive() or time.monotonic() > cls.begun + 60:
                raise AssertionError(f"no render runs: {cls.got}")
            time.sleep(0.01)
        cls.silent = socket.create_connection(("127.0.0.1", cls.port), timeout=20)   # less than its patience
        unittest.addModuleCleanup(cls.silent.close)
        cls.silent.sendall(b"POST /render HTTP/1.1\r\nHost: localhost\r\n")
        time.sleep(0.2)   # it is known to the daemon
        cls.process.send_signal(signal.SIGSTOP)
        cls.stopped = time.monotonic()

    @classmethod
    def runs(cls):
        try:
            return cls.metric(cls, 'gobo_renders_running{class="normal"}') == 1
        except OSError:   # a machine that is too busy to answer
            return False

    def setUp(self):
        pass

    def test_a_render_of_longer_than_a_client_may_be_silent(self):
        time.sleep(max(0, self.stopped + self.SECONDS - time.monotonic()))
        self.assertEqual(self.got, [])
        self.process.send_signal(signal.SIGCONT)
        self.assertEqual(self.silent.recv(100), b"", "the clock went on: who was silent is cut off at once")
        self.caller.join(60)
        self.assertGreater(time.monotonic() - self.begun, 30.5)
        (status, kind, body), = self.got
        self.assertEqual((status, kind), (200, "image/png"), body[:300])
        self.assertEqual(read_png(body)[:2], (96, 72))


def setUpModule():
    Silence.begin_to_wait()


class Scenes(Door):
    def test_a_name_that_the_scene_lacks_is_the_request_s_mistake(self):
        scene = boxes_glb(TWO_BOXES)
        self.picture(scene, "depth", **SMALL)
        for request, words in (({"camera": {"name": "none"}}, "no camera 'none'"), ({"variant": "none"}, "no variant"), ({"animation": "none", "time_s": 0}, "no animation"),
                               ({"lights": {"none": {"intensity": 2}}}, "no light 'none'"), ({"environment": {"digest": "0" * 64}}, "request.environment.digest")):
            self.assertIn(words, self.refused(scene, path=query(request), **SMALL))
            self.assertEqual((self.uploads(), self.metric("gobo_scenes")), (1, 1), request)
        other = boxes_glb(TWO_BOXES[:1])
        self.assertIn("no camera", self.refused(other, path=query({"camera": {"name": "none"}}), **SMALL))
        self.assertEqual((self.uploads(), self.metric("gobo_scenes")), (2, 2))

    def test_a_picture_counts_until_it_is_fetched(self):
        scene = boxes_glb(TWO_BOXES)
        kind, body = form(fields(scene, "depth", width=4096, height=4096), scene)
        with socket.socket() as s:
            s.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            s.settimeout(60)
            s.connect(("127.0.0.1", self.port))
            s.sendall(f"POST /render HTTP/1.1\r\nHost: localhost\r\nContent-Type: {kind}\r\nContent-Length: {len(body)}\r\n\r\n".encode() + body)
            self.assertTrue(s.recv(100).startswith(b"HTTP/1.1 200 "))
            time.sleep(0.2)   # whatever else the call held has gone
            self.assertIn("fetched that need the memory", self.refused(scene, "depth", status=429, width=2432, height=2432))
            self.picture(scene, "depth", **SMALL)
        self.eventually(lambda: post(self.port, scene, "depth", width=2432, height=2432)[0] == 200)

    def test_a_scene_is_parsed_once_and_few_stay(self):
        scenes = [boxes_glb([((0, 0.01 * i, 0), (0.02, 0.02, 0.02), (0.5, 0.5, 0.5))]) for i in range(11)]
        for scene in scenes[:8]:
            self.picture(scene, "depth", **SMALL)
            self.picture(scene, "label", **SMALL)
        self.assertEqual((self.uploads(), self.metric("gobo_scenes")), (8, 8))
        for scene in scenes[:8]:
            self.picture(scene, "color", **SMALL)
        self.assertEqual(self.uploads(), 8)
        for scene in scenes[8:]:
            self.picture(scene, "depth", **SMALL)
        self.assertEqual((self.uploads(), self.metric("gobo_scenes")), (11, 8))
        self.picture(scenes[7], "depth", **SMALL)   # the last used ones stayed
        self.assertEqual(self.uploads(), 11)
        self.picture(scenes[0], "depth", **SMALL)
        self.assertEqual((self.uploads(), self.metric("gobo_scenes")), (12, 8))

    def test_a_scene_that_somebody_unloads_comes_back(self):
        scene = boxes_glb(TWO_BOXES)
        first = self.picture(scene, "depth", **SMALL)
        import gobo
        with gobo.connect(f"unix:{self.folder}/s.sock", timeout=30) as client:
            name, = [s.id for s in client.scenes.list()]
            self.assertTrue(name.startswith("render-" + hashlib.sha256(scene).hexdigest()[:16]))
            client.scenes.unload(name)
        self.assertEqual(self.picture(scene, "depth", **SMALL), first)
        self.assertEqual(self.uploads(), 2)

    def test_many_at_once(self):
        scenes = [boxes_glb([((0, 0.01 * i, 0), (0.02, 0.02, 0.02), (i / 255, 0.5, 0.5))]) for i in range(4)]
        alone = {(i, t): self.picture(s, t, **SMALL) for i, s in enumerate(scenes) for t in ("color", "depth", "label")}
        fresh = [boxes_glb([((0, 0.3 + 0.01 * i, 0), (0.02, 0.02, 0.02), (1, 1, 1))]) for i in range(2)]
        got, wrong = {}, []

        def ask(n):
            try:
                for k in range(6):
                    i, t = (n + k) % 4, ("color", "depth", "label")[(n * 5 + k) % 3]
                    got[n, k] = self.picture(scenes[i], t, **SMALL) == alone[i, t]
                self.picture(fresh[n % 2], "depth", **SMALL)   # four callers with the same new file
            except Exception as e:   # pylint: disable=broad-except
                wrong.append(e)

        threads = [threading.Thread(target=ask, args=(n,)) for n in range(8)]
        for t in threads:
            t.start()
        for t in threads:
            t.join()
        self.assertEqual(wrong, [])
        self.assertEqual((len(got), set(got.values())), (48, {True}))
        self.assertEqual(self.uploads(), 6)

    def test_a_client_that_hangs_up_frees_the_cores(self):
        scene = boxes_glb(TWO_BOXES)
        self.picture(scene, "depth", **SMALL)
        kind, body = form(fields(scene), scene)
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=30)
        connection.request("POST", query({"halt": {"spp": 1 << 20}}), body, {"Content-Type": kind})
        self.eventually(lambda: self.metric('gobo_renders_running{class="normal"}') == 1)
        connection.close()
        self.eventually(lambda: self.metric('gobo_renders_running{class="normal"}') == 0, 3)
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=30)   # in the middle of the body
        connection.putrequest("POST", "/render")
        connection.putheader("Content-Type", kind)
        connection.putheader("Content-Length", str(len(body)))
        connection.endheaders(body[:500])
        connection.close()
        self.picture(scene, "depth", **SMALL)
        self.assertEqual(self.uploads(), 1)

    def test_a_daemon_that_drains(self):
        scene = boxes_glb(TWO_BOXES)
        kind, body = form(fields(scene), scene)
        held = http.client.HTTPConnection("127.0.0.1", self.port, timeout=30)
        self.addCleanup(held.close)
        held.request("POST", query({"halt": {"time_s": 2}}), body, {"Content-Type": kind})
        self.eventually(lambda: self.metric('gobo_renders_running{class="normal"}') == 1)
        self.process.terminate()
        self.eventually(lambda: self.metric("gobo_draining") == 1)
        self.assertIn("shutting down", self.refused(scene, status=503, **SMALL))
        answer = held.getresponse()
        self.assertEqual(answer.status, 200)
        self.assertEqual(read_png(answer.read())[:2], (640, 480))


class Tokens(Door):
    config = "".join(f'[[tokens]]\nname = "{n}"\nsha256 = "{hashlib.sha256(n.encode()).hexdigest()}"\n{more}' for n, more in (("alice", ""), ("bob", "upload_bytes = 900\n"),
                                                                                                                          ("carol", "max_pixels = 100\n"), ("dave", "requests_per_s = 0.1\nburst = 1\n")))

    def test_who_may_ask(self):
        scene = boxes_glb(TWO_BOXES)
        ask = lambda who, **more: post(self.port, scene, "label", headers={"Authorization": "Bearer " + who} if who else {}, **{**SMALL, **more})
        for who in ("", "mallory"):
            status, kind, body = ask(who)
            self.assertEqual((status, kind), (401, "text/plain; charset=utf-8"))
            self.assertIn(b"authorization", body)
        self.assertEqual(self.metric("gobo_upload_bytes_total"), 0)
        self.assertEqual(ask("alice")[0], 200)
        self.assertEqual(ask("alice")[0], 200)
        self.assertEqual(self.uploads(), 1)
        status, _, body = ask("bob")   # alice's scene is not his, and his own may not be that large
        self.assertEqual(status, 413, body)
        self.assertIn(b"tokens.upload_bytes", body)
        self.assertEqual(ask("alice")[0], 200)
        self.assertEqual(self.uploads(), 1)   # and hers is still known
        status, _, body = ask("carol")
        self.assertIn(b"max_pixels", body)
        self.assertEqual(ask("carol", width=10, height=10)[0], 200)
        self.assertEqual(self.uploads(), 2)

    def test_who_asks_is_the_token_however_it_is_written(self):
        scene = boxes_glb(TWO_BOXES)
        for word in ("Bearer", "bearer", "BEARER"):
            self.assertEqual(post(self.port, scene, "label", headers={"Authorization": f"{word} alice"}, **SMALL)[0], 200)
        self.assertEqual(self.uploads(), 1)

    def test_a_caller_over_its_rate_is_told_at_once_and_holds_up_nobody(self):
        scene, ask = boxes_glb(TWO_BOXES), lambda who, s: post(self.port, s, "depth", headers={"Authorization": "Bearer " + who}, **SMALL)
        begun = time.monotonic()
        status, _, body = ask("dave", scene)   # one request for the form, none left for the upload
        self.assertEqual(status, 429, body)
        self.assertIn(b"tokens.requests_per_s", body)
        self.assertLess(time.monotonic() - begun, 8)   # 10 s until the next
        self.assertEqual(ask("alice", scene)[0], 200)

    def test_limits_that_are_read_again(self):
        scene = boxes_glb(TWO_BOXES)
        config = os.path.join(self.folder, "gobod.toml")
        with open(config, encoding="utf-8") as file:
            text = file.read()
        with open(config, "w", encoding="utf-8") as file:
            file.write(text.replace("1MiB", "1000"))
        self.process.send_signal(signal.SIGHUP)
        self.eventually(lambda: self.metric('gobo_reloads_total{result="ok"}') == 1)
        status, _, body = post(self.port, scene, "label", headers={"Authorization": "Bearer alice"}, **SMALL)
        self.assertEqual((status, b"scene: has more than 1000 bytes" in body), (413, True), body)


class ManyTokens(Door):
    config = "".join(f'[[tokens]]\nname = "t{i}"\nsha256 = "{hashlib.sha256(b"t%d" % i).hexdigest()}"\n' for i in range(66))

    def test_the_scenes_of_callers_that_are_no_longer_remembered_go(self):
        """64 callers are; the one that asked longest ago goes, whether its last call was an upload or not."""
        scene, small = boxes_glb(TWO_BOXES[:1]), {**SMALL, "width": 4, "height": 4}
        ask = lambda i: self.assertEqual(post(self.port, scene, "label", headers={"Authorization": f"Bearer t{i}"}, **small)[0], 200)
        for i in range(64):
            ask(i)
        ask(0)
        for i in (64, 65):   # 1 and 2 go
            ask(i)
        self.assertEqual((self.uploads(), self.metric("gobo_scenes")), (66, 64))
        ask(0)
        self.assertEqual(self.uploads(), 66)
        ask(1)
        self.assertEqual((self.uploads(), self.metric("gobo_scenes")), (67, 64))


if __name__ == "__main__":
    unittest.main()
