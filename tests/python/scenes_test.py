# SPDX-License-Identifier: Apache-2.0
"""Scenes: open, upload, pack, list, inspect, patch, unload, against a gobod that may open nothing by itself."""
import os
import unittest

import numpy as np

import gobo
from gobo import glb
from support import SMALL, DaemonTest, gltf


class Scenes(DaemonTest):
    options = {"roots": ()}   # every file has to be uploaded

    def test_a_gltf_with_a_side_file_is_sent_once(self):
        path = gltf(self.folder)
        r = self.client.render(path, **SMALL)
        self.assertGreater(r.image.max(), 0)
        scene = self.client.scenes.open(path)
        self.assertTrue(scene.id.startswith("tri-"))
        self.assertTrue(scene.source.startswith("blobs:"))
        self.assertEqual([s.id for s in self.client.scenes.list() if s.id.startswith("tri-")], [scene.id])
        with gobo.local(threads=2) as free:      # opens the .gltf itself
            own = free.render(path, **SMALL)
            self.assertTrue(free.scenes.list()[0].source.endswith("tri.gltf"))
        np.testing.assert_array_equal(own.image, r.image)

    def test_glb_bytes_and_files(self):
        data = glb.pack(gltf(self.folder))
        with open(self.path("b.glb"), "wb") as file:
            file.write(data)
        by_file, by_bytes = self.client.scenes.open(self.path("b.glb")), self.client.scenes.upload(data, "mine")
        self.assertEqual((by_file.hash, by_bytes.id), (by_bytes.hash, "mine"))
        with self.assertRaises(gobo.InvalidArgument):
            self.client.scenes.upload(data[:-8], "cut")
        self.cli("render", "b.glb", "--size", "32x24", "--spp", "16", "--set", "integrator.max_bounces=2", "-o", "b.raw")
        with open(self.path("b.raw"), "rb") as file:
            self.assertEqual(file.read(), self.client.render(by_file, **SMALL).image.tobytes())

    def test_among_many_scenes_one_that_is_not_there_is_not_found(self):
        names = [f"a-project-of-a-name/shot-{k:05d}" for k in range(260)]
        for name in names:
            self.client.scenes.open("cornell", name)
        with self.assertRaisesRegex(gobo.NotFound, "no scene 'nonesuch'.*, \\.\\.\\."):
            self.client.render("nonesuch", **SMALL)
        self.cli("inspect", "nonesuch", code=3)
        self.client.render(gltf(self.folder), **SMALL)
        for long in ("\u00fc" * 2000, "%" * 3000, "x" * 20000):
            with self.assertRaises(gobo.NotFound) as refused:
                self.client.render("cornell", **SMALL, camera=long)
            self.assertEqual(refused.exception.field, "camera.name")
        for name in names:
            self.client.scenes.unload(name)

    def test_a_folder_whose_name_is_not_utf8(self):
        folder = os.path.join(os.fsencode(self.folder), b"d\xff")
        os.mkdir(folder)
        data = glb.pack(gltf(self.folder))
        for name in (b"s.glb", b"n\xff.glb"):
            with open(os.path.join(folder, name), "wb") as file:
                file.write(data)
        self.assertEqual(self.client.scenes.open(os.fsdecode(os.path.join(folder, b"s.glb"))).triangles, 1)
        with self.assertRaisesRegex(gobo.InvalidArgument, "source = .*is not UTF-8"):
            self.client.scenes.open(os.fsdecode(os.path.join(folder, b"n\xff.glb")))
        with self.assertRaisesRegex(gobo.InvalidArgument, "is not UTF-8"):
            self.client.scenes.open("cornell", "a\udcff")

    def test_inspect(self):
        scene = self.client.scenes.open(gltf(self.folder), "named")
        self.assertEqual((scene.triangles, scene.cameras, list(scene.lights)), (1, ["eye"], ["lamp"]))
        self.assertEqual(scene.lights["lamp"].position, (1, 1, 2))
        np.testing.assert_array_equal(scene.bounds, [[-1, -1, 0], [1, 1, 0]])
        self.assertIn("cornell", self.client.scenes.builtin())

    def test_patch_and_unload(self):
        scene = self.client.scenes.open(gltf(self.folder), "patched")
        before = self.client.render(scene, **SMALL, outputs="depth").image
        matrix = np.eye(4)
        matrix[2, 3] = 1                            # one metre nearer to the camera at z = 3
        name = scene.instances[0]
        self.client.scenes.patch(scene, instances={name: matrix})
        after = self.client.render(scene, **SMALL, outputs="depth").image
        self.assertAlmostEqual(before[12, 16, 0] - after[12, 16, 0], 1, places=3)
        moved = self.client.scenes.patch(scene, lights={"lamp": {"position": (0, 0, 2)}})
        self.assertEqual(moved.lights["lamp"].position, (0, 0, 2))
        self.client.scenes.unload(scene)
        with self.assertRaises(gobo.NotFound):
            self.client.scenes.inspect("patched")

    def test_errors_of_files(self):
        with self.assertRaises(gobo.NotFound):
            self.client.scenes.open("nonesuch.glb")
        with self.assertRaises(gobo.NotFound):
            self.client.scenes.upload("nonesuch.glb")
        with open(self.path("bad.glb"), "wb") as file:
            file.write(b"glTF\2\0\0\0\x10\0\0\0zzzz")
        with self.assertRaises(gobo.InvalidArgument):
            self.client.render(self.path("bad.glb"))
        with gobo.connect(self.client.address, upload_limit=10) as small, self.assertRaisesRegex(gobo.InvalidArgument, "upload limit"):
            small.scenes.open(self.path("bad.glb"))


if __name__ == "__main__":
    unittest.main()
