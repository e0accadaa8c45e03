# SPDX-License-Identifier: Apache-2.0
"""Pictures as notebooks show them: PNG and the display transform against the server's own, and the widget against a stand-in for anywidget and in Node."""
import io
import json
import os
import pathlib
import shutil
import struct
import subprocess
import sys
import threading
import types
import unittest
import zlib
from unittest import mock

import numpy as np

import gobo
from gobo import image, schema
from support import SMALL, DaemonTest

NODE = shutil.which("node")


def read_png(data):
    """uint8 (height, width, channels) of an 8-bit PNG."""
    assert data.startswith(b"\x89PNG\r\n\x1a\n")
    at, packed = 8, b""
    while at < len(data):
        size, kind = struct.unpack_from(">I4s", data, at)
        body = data[at + 8:at + 8 + size]
        assert struct.unpack_from(">I", data, at + 8 + size)[0] == zlib.crc32(kind + body)
        if kind == b"IHDR":
            width, height, depth, colour = struct.unpack_from(">IIBB", body)
            channels = {0: 1, 2: 3, 4: 2, 6: 4}[colour]
            assert depth == 8
        elif kind == b"IDAT":
            packed += body
        at += 12 + size
    rows = np.frombuffer(zlib.decompress(packed), np.uint8).reshape(height, 1 + width * channels)
    out = np.zeros((height, width * channels), np.uint8)
    for y in range(height):
        above = out[y - 1].astype(int) if y else np.zeros(width * channels, int)
        kind, line = rows[y, 0], rows[y, 1:].astype(int)
        for x in range(width * channels):
            left = int(out[y, x - channels]) if x >= channels else 0
            up = above[x]
            corner = above[x - channels] if x >= channels else 0
            p = left + up - corner
            paeth = min((left, up, corner), key=lambda v: abs(p - v))
            out[y, x] = (line[x] + (0, left, up, (left + up) // 2, paeth)[kind]) & 255
    return out.reshape(height, width, channels)


class Png(unittest.TestCase):
    def test_round_trip(self):
        random = np.random.default_rng(3)
        for channels in (1, 2, 3, 4):
            for shape in ((1, 1), (5, 7), (16, 3)):
                pixels = random.integers(0, 256, (*shape, channels), np.uint8)
                np.testing.assert_array_equal(read_png(image.png(pixels)), pixels)
        np.testing.assert_array_equal(read_png(image.png(pixels[:, :, 0]))[:, :, 0], pixels[:, :, 0])
        for bad in (np.zeros((2, 2, 5), np.uint8), np.zeros((2, 2, 3)), np.zeros((0, 2, 3), np.uint8), np.zeros(3, np.uint8)):
            with self.assertRaises(gobo.InvalidArgument):
                image.png(bad)

    def test_numbers_that_are_none(self):
        got = image.tone_mapped(np.array([[[np.nan, -1, np.inf], [-np.inf, 0, 1e30]]], np.float32))
        np.testing.assert_array_equal(got, [[[0, 0, 255], [0, 0, 255]]])
        for curve in image.CURVES:
            self.assertEqual(image.tone_mapped(np.zeros((1, 1)), curve=curve).ravel().tolist(), [0])
            greys = image.tone_mapped(np.geomspace(1e-4, 1e4, 500)[None, :], curve=curve).ravel().astype(int)
            self.assertTrue((np.diff(greys) >= 0).all(), curve)
        for name in ("curve", "transfer"):
            with self.assertRaises(gobo.InvalidArgument):
                image.tone_mapped(np.zeros((1, 1)), **{name: "none"})

    def test_arrays(self):
        picture = np.ones((4, 6, 3), np.float32).view(gobo.Image)
        self.assertEqual(read_png(picture._repr_png_()).shape, (4, 6, 3))
        self.assertEqual(read_png(picture[:, :, 0]._repr_png_()).shape, (4, 6, 1))
        self.assertEqual(read_png((picture > 0.5)._repr_png_()).shape, (4, 6, 3))
        for other in (picture[0, 0], picture[:0], picture[..., :2], picture.reshape(2, 2, 6, 3)):
            self.assertIsNone(other._repr_png_())
        for number in (picture.mean(), picture.sum(), picture.max(), np.add.reduce(picture, None), picture[0, 0, 0]):
            self.assertNotIsInstance(number, np.ndarray)
        self.assertIsInstance(picture.mean(axis=2), gobo.Image)
        self.assertIsInstance(2 * picture, gobo.Image)


class Server(DaemonTest):
    def near(self, mine, theirs):
        self.assertEqual(mine.shape, theirs.shape)
        self.assertLessEqual(int(np.abs(mine.astype(int) - theirs.astype(int)).max()), 1)
        self.assertLess(float((mine != theirs).mean()), 0.01)

    def test_looks_as_the_server_has_it(self):
        cases = [{"curve": c, "exposure": e} for c in image.CURVES for e in (0.0, 2.5)] + [{"transfer": t} for t in ("rec709", "linear")]
        for fields in cases:
            more = dict(tone_map={k: fields[k] for k in ("curve", "exposure") if k in fields}, encoding={"transfer": fields.get("transfer", "srgb")})
            with self.subTest(fields):
                r = self.client.render("cornell", **SMALL, **more)
                server = self.client.render("cornell", **SMALL, **more, format="png").encoded["beauty"]
                self.near(read_png(r._repr_png_()), read_png(server))

    def test_an_exposure_is_chosen_as_the_server_does(self):
        for gain in (1e-5, 1e5, 1.0):
            fields = dict(SMALL, lights={"light": {"gain": gain}})
            r = self.client.render("cornell", **fields)
            server = self.client.render("cornell", **fields, format="png")
            self.assertEqual(image.chosen_exposure(r.image), server.resolved.tone_map.exposure)
            self.near(read_png(r._repr_png_()), read_png(server.encoded["beauty"]))
            self.near(read_png(r.image._repr_png_()), read_png(server.encoded["beauty"]))

    def test_what_a_notebook_gets(self):
        r = self.client.render("cornell", **SMALL, outputs=["normal", "depth", "albedo", "object_id", "motion", "alpha"])
        for name in r.outputs:
            with self.subTest(name):
                shown = read_png(r.png(name))
                self.assertEqual(shown.shape[:2], (24, 32))
                self.assertLessEqual(shown.shape[2], 3)
                if name in ("normal", "depth"):
                    self.assertEqual((shown.min(), shown.max()), (0, 255))
        self.assertEqual(r._repr_png_(), r.png("normal"))
        self.assertIsNone(r._repr_jpeg_())
        self.assertEqual(set(r._repr_mimebundle_()), {"text/plain", "image/png"})
        with self.assertRaises(gobo.InvalidArgument):
            r.png("beauty")
        for form, kind in (("png", "image/png"), ("jpeg", "image/jpeg")):
            r = self.client.render("cornell", **SMALL, format=form)
            self.assertEqual(r._repr_mimebundle_()[kind], r.encoded["beauty"])
        self.assertEqual(set(self.client.render("cornell", **SMALL, format="exr")._repr_mimebundle_()), {"text/plain"})
        for snapshot in self.client.render_progressive("cornell", width=64, height=48, spp=32, seed=2):
            self.assertTrue(snapshot._repr_png_().startswith(b"\x89PNG"))


class FakeWidget:
    """What gobo.widget uses of anywidget.AnyWidget: messages with buffers both ways."""

    def __init__(self, **_):
        self.sent, self.news, self.closed, self._callbacks = [], threading.Condition(), False, []

    def send(self, content, buffers=None):
        content = json.loads(json.dumps(content))   # what does not fit into JSON does not go through a kernel
        with self.news:
            self.sent.append((content, [bytes(b) for b in buffers or []]))
            self.news.notify_all()

    def on_msg(self, callback):
        self._callbacks.append(callback)

    def close(self):
        self.closed = True

    # What a browser does.
    def say(self, **content):
        for callback in self._callbacks:
            callback(self, content, [])

    def until(self, what):
        """The first message, of those to come or not looked at yet, that `what` is true of."""
        with self.news:
            while True:
                while self.sent:
                    content, buffers = self.sent.pop(0)
                    if what(content):
                        return content, buffers
                assert self.news.wait(60), "no message"


class Widget(DaemonTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        fake = types.ModuleType("anywidget")
        fake.AnyWidget = FakeWidget
        with mock.patch.dict(sys.modules, {"anywidget": fake}):
            sys.modules.pop("gobo.widget", None)
            cls.widget = gobo.widget
        cls.addClassCleanup(sys.modules.pop, "gobo.widget", None)

    def viewer(self, scene="cornell", **fields):
        v = self.widget.Viewer(scene, client=self.client, **{**SMALL, **fields})
        self.addCleanup(v.close)
        return v

    @staticmethod
    def final(edit):
        return lambda m: m["type"] == "picture" and m["final"] and m["edit"] == edit

    def test_pictures_follow_edits_of_code_and_page(self):
        v = self.viewer()
        message, buffers = v.until(self.final(0))
        plain = self.client.render("cornell", **SMALL, format="jpeg")
        self.assertEqual(buffers, [plain.encoded["beauty"]])
        self.assertEqual((message["width"], message["height"]), (32, 24))
        self.assertIn("16 samples", message["text"])

        v.say(type="hello", view="a")
        start, _ = v.until(lambda m: m["type"] == "start")
        self.assertEqual((start["to"], start["lights"], start["schema"]), ("a", ["light"], json.loads(json.dumps(schema.schema()))))
        self.assertEqual((len(start["matrix"]), start["bounds"]["min"], v.until(lambda m: m["type"] == "picture")[0]["to"]), (16, list(v._info.bounds[0]), "a"))

        v.say(type="edit", view="a", edits={"lights": {"light": {"intensity": 5}}, "width": 640}, camera={"position": {"x": 0, "y": 1, "z": 3}, "look_at": {"y": 1}})
        _, buffers = v.until(self.final(1))
        fields = dict(SMALL, lights={"light": {"intensity": 5}}, camera={"position": (0, 1, 3), "look_at": (0, 1, 0)})
        self.assertEqual(buffers, [self.client.render("cornell", **fields, format="jpeg").encoded["beauty"]])

        v.edit(lights={"light": {"gain": 0.5}}, seed=3)
        _, buffers = v.until(self.final(2))
        fields.update(lights={"light": {"intensity": 5, "gain": 0.5}}, seed=3)
        self.assertEqual(buffers, [self.client.render("cornell", **fields, format="jpeg").encoded["beauty"]])
        self.assertEqual((v.request.seed, v.request.width, v.result.edit), (3, 32, 2))

        v.say(type="edit", view="a", edits={}, camera=None)   # the page's reset leaves what code has edited
        v.until(self.final(3))
        self.assertEqual((v.request.lights["light"].HasField("intensity"), v.request.lights["light"].gain.x, v.request.HasField("camera")), (False, 0.5, False))
        v.reset()
        v.until(self.final(4))
        self.assertEqual((v.request.seed, len(v.request.lights)), (0, 0))
        v.close()
        self.assertTrue(v.closed)
        self.assertEqual(self.client.status().running, 0)

    def test_wrong_edits_are_told_and_do_nothing(self):
        v = self.viewer()
        v.until(self.final(0))
        for edits in ({"nonesuch": 1}, {"seed": "x"}, {"lights": 3}):
            v.say(type="edit", view="a", edits=edits, camera=None)
            self.assertEqual(v.until(lambda m: m["type"] == "error")[0]["to"], "a")
        v.say(type="edit", view="a", edits=None, camera={"yfov_deg": []})
        v.until(lambda m: m["type"] == "error")
        v.say(type="nonesuch")
        v.say(nonesuch=1)
        v.say(type="edit", view="a", edits={"integrator": {"max_bounces": 900}}, camera=None)   # the server's to refuse
        self.assertIn("max_bounces", v.until(lambda m: m["type"] == "error")[0]["message"])
        v.say(type="edit", view="a", edits={"seed": 2}, camera=None)
        v.until(lambda m: m["type"] == "picture" and m["final"])
        self.assertEqual(v.result.resolved.seed, 2)

    def test_a_browser_that_is_slow_gets_fewer_and_the_last(self):
        v = self.viewer()
        v.until(self.final(0))
        v.session.close()   # from here on, pictures are this test's
        v.sent.clear()
        offer = lambda n, final=False: v._offer({"type": "picture", "n": n, "final": final}, b"x")
        numbers = lambda: [m["n"] for m, _ in v.sent if m["type"] == "picture"]
        with mock.patch.object(self.widget, "_PATIENCE", 1e9):
            v.say(type="shown", view="a")
            for n in (1, 2, 3):
                offer(n)
            self.assertEqual(numbers(), [1])
            v.say(type="shown", view="a")
            self.assertEqual(numbers(), [1, 3], "the newest of those that were held back")
            offer(4)
            offer(5, final=True)
            self.assertEqual(numbers(), [1, 3, 5], "the last one goes at once, and nothing older after it")
            v.say(type="shown", view="a")
            self.assertEqual(numbers(), [1, 3, 5])
        with mock.patch.object(self.widget, "_PATIENCE", 0.0):
            offer(6)
            offer(7)
            self.assertEqual(numbers(), [1, 3, 5, 6, 7], "a kernel that is busy hears nothing, and shows pictures all the same")

    def test_without_anywidget(self):
        code = "import sys; sys.modules['anywidget'] = None\nimport gobo\nfrom gobo import *\ntry: gobo.widget.Viewer('cornell')\nexcept ImportError as e: print(e)"
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
        self.assertIn("pip install anywidget", done.stdout, done.stderr)

    @unittest.skipUnless(NODE, "node is not installed")
    def test_the_module_in_node(self):
        v = self.viewer()
        v.until(self.final(0))
        v.say(type="hello", view="a")
        start, _ = v.until(lambda m: m["type"] == "start")
        pathlib.Path(self.path("viewer.mjs")).write_text(v._esm, encoding="utf-8")
        pathlib.Path(self.path("start.json")).write_text(json.dumps(start), encoding="utf-8")
        here = pathlib.Path(__file__).parent / "widget_check.mjs"
        done = subprocess.run([NODE, str(here), self.path("viewer.mjs"), self.path("start.json")], capture_output=True, text=True, timeout=60)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        said = json.loads(done.stdout)
        self.assertEqual([m["type"] for m in said[:2]], ["hello", "edit"])
        self.assertIn("shown", [m["type"] for m in said])
        for message in said:   # what the page says is a request
            v.say(**message)
        camera = v.request.camera
        self.assertTrue(camera.HasField("position") and camera.HasField("look_at"))
        self.assertEqual(v.request.lights["light"].intensity, 7.0)

    def test_modules_that_cannot_be_joined(self):
        folder = pathlib.Path(self.path("modules"))
        folder.mkdir()
        (folder / "a.js").write_text("import { x as y } from './b.js';\nexport function render() { return y + K; }\n")
        (folder / "b.js").write_text("import { z } from './c.js';\nexport const x = z;\n")
        (folder / "c.js").write_text("export let z = 1;\n")
        (folder / "d.js").write_text("import x from './b.js';\n")
        with mock.patch.object(self.widget, "_FOLDER", str(folder)):
            text = self.widget.bundle("a.js", {"K": "</k>\n"})
            self.assertEqual(text.count("$c_js = "), 1)
            self.assertNotRegex(text, r"(?m)^import")
            for name in ("d.js", "none.js"):
                with self.assertRaises(ImportError):
                    self.widget.bundle(name, {})


if __name__ == "__main__":
    unittest.main()
