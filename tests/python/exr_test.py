# SPDX-License-Identifier: Apache-2.0
"""gobo.exr read by OpenImageIO and by numpy: the same planes and texts, damaged files are refused."""
import os
import pathlib
import struct
import subprocess
import sys
import tempfile
import unittest

import numpy as np

import gobo
from gobo import exr
from support import SMALL, DaemonTest

BACKENDS = ("openimageio", "numpy")


class Files(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.path = os.path.join(folder.name, "a.exr")
        self.addCleanup(exr.use)

    def planes(self, shape, smooth, seed=1):
        rng = np.random.default_rng(seed)
        planes = {n: (np.ones(shape) if smooth else rng.standard_normal(shape)).astype(np.float32) for n in ("R", "G", "albedo.R", "a" * 40)}
        planes["R"].flat[0] = np.inf
        return planes

    def test_round_trips(self):
        files = {}
        for backend in BACKENDS:
            for shape in ((1, 1), (16, 5), (37, 19)):
                for smooth in (False, True):
                    with self.subTest(backend, shape=shape, smooth=smooth):
                        self.assertEqual(exr.use(backend), backend)
                        planes = self.planes(shape, smooth)
                        exr.write(self.path, planes, {"note": "größe", "gobo:request": '{"a": 1}'})
                        data = pathlib.Path(self.path).read_bytes()
                        self.assertEqual(files.setdefault((shape, smooth), data), data, "equal pictures are equal files")
                        got, texts = exr.read(self.path)
                        self.assertEqual((sorted(got), texts), (sorted(planes), {"note": "größe", "gobo:request": '{"a": 1}'}))
                        for name, plane in planes.items():
                            self.assertEqual((got[name].dtype, got[name].flags.c_contiguous), (np.float32, True))
                            np.testing.assert_array_equal(got[name], plane)
                        again, _ = exr.decode(data)
                        np.testing.assert_array_equal(again["G"], planes["G"])
            self.assertLess(os.path.getsize(self.path), 37 * 19 * 16, "constant planes shrink")
            self.assertEqual(os.listdir(os.path.dirname(self.path)), ["a.exr"])
            self.assertEqual(os.stat(self.path).st_mode & 0o600, 0o600)

    def test_refusals(self):
        for backend in BACKENDS:
            with self.subTest(backend):
                exr.use(backend)
                exr.write(self.path, self.planes((37, 19), True))
                data = pathlib.Path(self.path).read_bytes()
                for cut in (0, 4, 60, len(data) // 2, len(data) - 1):
                    with self.assertRaises(gobo.InvalidArgument, msg=cut):
                        exr.decode(data[:cut])
                with self.assertRaisesRegex(gobo.InvalidArgument, "a.exr"):
                    pathlib.Path(self.path).write_bytes(b"\x89PNG" + data)
                    exr.read(self.path)
                for wrong in ({}, {"R": np.ones((2, 2)), "G": np.ones((2, 3))}, {"R": np.ones(3)}):
                    with self.assertRaises(gobo.InvalidArgument):
                        exr.write(self.path, wrong)
                with self.assertRaises(OSError):
                    exr.read(self.path + ".none")
                exr.write(self.path, self.planes((3, 3), True))
                with self.assertRaises(gobo.InvalidArgument):
                    exr.read_image(self.path, "nonesuch")
                with self.assertRaises((gobo.InvalidArgument, OSError)):
                    exr.write(os.path.join(os.path.dirname(self.path), "none", "b.exr"), self.planes((3, 3), True))

    def test_choice(self):
        with self.assertRaises(gobo.InvalidArgument):
            exr.use("cv2")
        script = "import sys, gobo\nassert 'OpenImageIO' not in sys.modules\nprint(gobo.exr.use())"
        for before, env, want in (("", {}, "openimageio"), ("", {"GOBO_EXR": "numpy"}, "numpy"), ("import sys; sys.modules['OpenImageIO'] = None\n", {}, "numpy")):
            code = before + (script if not before else "import gobo\nprint(gobo.exr.use())")
            done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60,
                                  env={**{k: v for k, v in os.environ.items() if k != "GOBO_EXR"}, **env})
            self.assertEqual(done.stdout, want + "\n", done.stderr)
        done = subprocess.run([sys.executable, "-c", "import sys; sys.modules['OpenImageIO'] = None\nimport gobo\ngobo.exr.use('openimageio')"], capture_output=True,
                              text=True, timeout=60)
        self.assertIn("InvalidArgument", done.stderr)

    def test_attributes(self):
        exr.use("numpy")
        exr.write(self.path, {"R": np.ones((2, 3))}, {"note": "x"})
        data = pathlib.Path(self.path).read_bytes()
        matrix = struct.pack("<16f", *range(16))
        data = data[:8] + b"worldToCamera\0m44f\0" + struct.pack("<i", 64) + matrix + data[8:]
        got = exr.attributes(data)
        self.assertEqual((got["note"], got["worldToCamera"], got["pixelAspectRatio"]), ("x", tuple(map(float, range(16))), 1.0))
        for cut in (0, 3, 20, 40):
            with self.assertRaises(gobo.InvalidArgument):
                exr.attributes(data[:cut])


class Server(DaemonTest):
    def test_what_the_server_writes(self):
        self.addCleanup(exr.use)
        outputs = ["beauty", "normal", "depth"]
        want = self.client.render("cornell", outputs=outputs, **SMALL)
        for fields in ({}, {"layers": True}, {"compression": "none"}, {"compression": "rle"}, {"compression": "piz"}, {"compression": "zips"},
                       {"layers": True, "compression": "dwaa"}, {"half": True}):
            r = self.client.render("cornell", outputs=outputs, **SMALL, encoding={"format": "exr", **fields})
            data = next(iter(r.encoded.values()))
            for backend in BACKENDS:
                with self.subTest(fields, backend=backend):
                    exr.use(backend)
                    if backend == "numpy" and fields.get("compression") in ("piz", "dwaa", "rle"):
                        with self.assertRaises(gobo.InvalidArgument):
                            exr.decode_image(data)
                        continue
                    got = exr.decode_image(data)
                    if fields.get("compression") == "dwaa":
                        self.assertLess(float(np.square(got - want.image).mean()) ** 0.5, 0.02)
                        np.testing.assert_array_equal(exr.decode_image(data, layer="normal"), want.outputs["normal"])
                    elif fields.get("half"):
                        np.testing.assert_array_equal(got, want.image.astype(np.float16).astype(np.float32))
                    else:
                        np.testing.assert_array_equal(got, want.image)
                    if fields.get("layers"):
                        np.testing.assert_array_equal(exr.decode_image(data, layer="normal"), want.outputs["normal"])
                    self.assertIn("gobo:request", exr.decode(data)[1])

    def test_saved_by_either(self):
        self.addCleanup(exr.use)
        r = self.client.render("cornell", outputs=["beauty", "normal"], **SMALL)
        for backend in BACKENDS:
            exr.use(backend)
            self.cli("compare", r.save(self.path(backend + ".exr")), self.path(backend + ".exr"))
            np.testing.assert_array_equal(exr.read_image(self.path(backend + ".exr")), r.image)
            np.testing.assert_array_equal(exr.read_image(self.path(backend + ".exr"), "normal"), r.outputs["normal"])


if __name__ == "__main__":
    unittest.main()
