# SPDX-License-Identifier: Apache-2.0
"""`gobo render --tile`: the picture of the whole, in one file that is there whole or not at all; what does not go in tiles is refused by name."""
import json
import os
import signal
import subprocess
import time
import unittest

from support import CLI, DaemonTest


class Tiles(DaemonTest):
    what = ("render", "lights8", "--size", "75x41", "--spp", "2", "-q")

    def compare(self, a, b, layer=""):
        suffix = f":{layer}" if layer else ""
        return json.loads(self.cli("--json", "compare", a + suffix, b + suffix).stdout)

    def test_is_the_whole_picture(self):
        for name, more in {"paths": (), "filtered": ("--set", "shadows.axis_aligned.radius_px=2", "--half"), "piz": ("--set", "encoding.compression=PIZ")}.items():
            self.cli(*self.what, *more, "-o", f"{name}.exr")
            self.cli(*self.what, *more, "--tile", 32, "-o", f"{name}_tiled.exr")
            found = self.compare(f"{name}.exr", f"{name}_tiled.exr")
            self.assertEqual((found["differingPixels"], found["pixels"], found["maxAbs"]), (0, 75 * 41, 0), name)
            with open(self.path(f"{name}_tiled.exr"), "rb") as file:
                self.assertNotIn(b'"window"', file.read(65536))  # its request is the whole picture's

    def test_layers(self):
        more = ("--outputs", "beauty,normal,object_id", "--layers")
        self.cli(*self.what, *more, "-o", "layers.exr")
        said = self.cli("--json", *self.what, *more, "--tile", 40, "-o", "layers_tiled.exr").stdout
        for layer in ("", "normal", "object_id"):
            found = self.compare("layers.exr", "layers_tiled.exr", layer)
            self.assertEqual((found["differingPixels"], found["pixels"]), (0, 75 * 41), layer)
        reply = json.loads(said)
        whole = json.loads(self.cli("--json", *self.what, *more, "-o", "again.exr").stdout)
        self.assertEqual(reply["request_hash"], whole["request_hash"])
        self.assertEqual((reply["images"][0]["width"], reply["images"][0]["height"]), (75, 41))
        self.assertEqual(int(reply["images"][0]["bytes"]), os.path.getsize(self.path("layers_tiled.exr")))

    def test_a_window_lies_in_its_picture(self):
        self.cli(*self.what, "--set", "window.x=10", "--set", "window.y=5", "--set", "window.width=20", "--set", "window.height=30", "-o", "part.exr")
        with open(self.path("part.exr"), "rb") as file:
            head = file.read(65536)

        def box(name):
            at = head.index(name + b"\0box2i\0") + len(name) + 7 + 4
            return [int.from_bytes(head[at + 4 * i:at + 4 * i + 4], "little") for i in range(4)]

        self.assertEqual(box(b"dataWindow"), [10, 5, 29, 34])
        self.assertEqual(box(b"displayWindow"), [0, 0, 74, 40])

    def tiled(self, name, *more):
        """A render of many tiles that has begun to write its file."""
        env = {**os.environ, "GOBO_SERVER": self.client.address}
        run = subprocess.Popen([CLI, "render", "lamps", "--size", "640x480", "--spp", "16", "-q", "--tile", "32", *more, "-o", self.path(name)], env=env,
                               stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=self.folder)
        self.addCleanup(run.kill)
        begun = time.monotonic()
        while not any(f.startswith(name.split(".")[0]) for f in os.listdir(self.folder)):
            self.assertIsNone(run.poll(), "it ended before it wrote")
            self.assertLess(time.monotonic() - begun, 60)
            time.sleep(0.01)
        return run

    def test_a_scene_that_changes_between_tiles_is_an_error(self):
        run = self.tiled("changed.exr")
        self.client.scenes.patch("lamps", materials={"floor": {"roughness": 0.77}})
        said = run.communicate(timeout=60)[1]
        self.assertEqual(run.returncode, 2, said)
        self.assertIn("scene_hash", said)
        self.assertEqual([f for f in os.listdir(self.folder) if f.startswith("changed")], [])

    def test_a_stopped_render_leaves_nothing(self):
        run = self.tiled("stopped.exr")
        run.send_signal(signal.SIGINT)
        said = run.communicate(timeout=60)[1]
        self.assertEqual(run.returncode, 5, said)
        self.assertEqual([f for f in os.listdir(self.folder) if f.startswith("stopped")], [])

    def test_warnings_of_all_tiles_are_told(self):
        bright = ("render", "cornell", "--size", "64x16", "--spp", "1", "--half", "--set", "lights.light.gain=8000", "-q")
        said = [json.loads(self.cli("--json", *bright, *more, "-o", "w.exr").stdout)["warnings"] for more in ((), ("--tile", "16"))]
        self.assertRegex(" ".join(said[0]), "65504")
        self.assertRegex(" ".join(said[1]), r"65504.*[1-4] of 4 tiles\)")
        self.assertEqual(len(said[1]), len(said[0]))

    def test_a_deadline_is_of_the_whole(self):
        long = ("render", "cornell", "--size", "1024x16", "--spp", "32768", "--tile", "16", "--deadline", "700", "-q", "-o", "late.exr")
        begun = time.monotonic()
        self.cli(*long, code=5)
        self.assertLess(time.monotonic() - begun, 20)
        self.assertEqual([f for f in os.listdir(self.folder) if f.startswith("late.exr")], [])

    def test_refusals(self):
        def refused(words, *args):
            self.assertIn(words, self.cli(*self.what, *args, code=2).stderr)

        refused("must end in .exr", "--tile", 32, "-o", "a.png")
        refused("name it with -o", "--tile", 32)
        refused("--tile", "--tile", 8, "-o", "a.exr")
        refused("one of them", "--tile", 32, "-o", "a.exr", "--progressive")
        refused("one of them", "--tile", 32, "-o", "a.exr", "--set", "window.width=3")
        refused("DWA", "--tile", 32, "-o", "a.exr", "--set", "encoding.compression=DWAA")
        refused("request.certificate", "--tile", 32, "-o", "a.exr", "--certificate")
        refused("reads a whole picture", "--tile", 32, "-o", "a.exr", "--set", "shadows.axis_aligned.mean_samples=12", "--set", "shadows.axis_aligned.rate=EQUATION")
        unbounded = [a for a in self.what if a not in ("--spp", "2")]
        self.assertIn("halt.time_s", self.cli(*unbounded, "--time", 1, "--tile", 32, "-o", "a.exr", code=2).stderr)
        self.assertEqual([f for f in os.listdir(self.folder) if f.startswith("a.")], [])


if __name__ == "__main__":
    unittest.main()
