# SPDX-License-Identifier: Apache-2.0
"""Files for a gobod that may open nothing: scenes with side files and environments are sent once, by both clients."""
import json
import os
import tempfile
import threading
import unittest
from concurrent import futures
from unittest import mock

import grpc
import numpy as np

import gobo
from gobo.v1 import service_pb2, service_pb2_grpc
from support import SMALL, DaemonTest, gltf


def sky(seed=1):
    """A lat-long map that is bright above."""
    random = np.random.default_rng(seed)
    return (random.random((8, 16, 3)) * np.linspace(3, 0.1, 8)[:, None, None]).astype(np.float32)


class Opened(DaemonTest):
    """A gobod that may open what its client names, from another working folder."""

    def test_a_relative_path_is_of_the_clients_folder(self):
        radiance = sky(5)
        gobo.exr.write(self.path("near.exr"), {c: radiance[:, :, i] for i, c in enumerate("RGB")})
        what = ["render", "cornell", "--size", "32x24", "--spp", "16", "--set", "integrator.max_bounces=2", "-q"]
        self.assertNotIn("sending", self.cli(*what, "--set", "environment.path=near.exr", "-o", "set.raw").stderr)
        self.cli(*what, "--env", "near.exr", "-o", "env.raw")
        with open(self.path("set.raw"), "rb") as a, open(self.path("env.raw"), "rb") as b:
            self.assertEqual(a.read(), b.read())


class Blobs(DaemonTest):
    options = {"roots": ()}

    def test_an_array_is_the_file_and_a_path_that_the_server_cannot_open_too(self):
        radiance = sky()
        gobo.exr.write(self.path("sky.exr"), {c: radiance[:, :, i] for i, c in enumerate("RGB")})
        by_array = self.client.render("cornell", env=radiance, **SMALL)
        by_path = self.client.render("cornell", env=self.path("sky.exr"), **SMALL)
        with gobo.local(threads=2) as free:
            on_disk = free.render("cornell", env=self.path("sky.exr"), **SMALL)
            self.assertTrue(on_disk.resolved.environment.path)
        self.assertTrue(by_path.resolved.environment.digest)
        np.testing.assert_array_equal(by_array.image, on_disk.image)
        np.testing.assert_array_equal(by_path.image, on_disk.image)
        self.assertGreater(np.abs(by_array.image - self.client.render("cornell", **SMALL).image).max(), 0)
        self.assertTrue(self.client.plan("cornell", env=self.path("sky.exr"), **SMALL).resolved.environment.digest)
        # Relights: as a whole, and the path alone.
        first = self.client.render("cornell", **SMALL)
        np.testing.assert_array_equal(first.relight(env=radiance).image, on_disk.image)
        np.testing.assert_array_equal(first.relight(set={"environment.path": self.path("sky.exr")}).image, on_disk.image)
        last = list(self.client.render_progressive("cornell", env=self.path("sky.exr"), **SMALL))[-1]
        np.testing.assert_array_equal(last.image, on_disk.image)

    def test_threads_that_need_the_same_file(self):
        got = {n: [] for n in range(12)}

        def work():
            for n in got:
                got[n].append(self.client.render("cornell", env=sky(100 + n), width=8, height=6, spp=16).image)
        threads = [threading.Thread(target=work) for _ in range(3)]
        for t in threads:
            t.start()
        for t in threads:
            t.join()
        for images in got.values():
            self.assertEqual(len(images), 3, "none of the threads failed")
            np.testing.assert_array_equal(images[0], images[1])
            np.testing.assert_array_equal(images[0], images[2])

    def test_environments_of_sessions(self):
        first, second = sky(2), sky(3)
        gobo.exr.write(self.path("second.exr"), {c: second[:, :, i] for i, c in enumerate("RGB")})
        with self.client.session("cornell", env=first, **SMALL) as s:
            np.testing.assert_array_equal(s.wait(60).image, self.client.render("cornell", env=first, **SMALL).image)
            s.edit(env=self.path("second.exr"))
            want = self.client.render("cornell", env=second, **SMALL).image
            np.testing.assert_array_equal(s.wait(60).image, want)
            s.edit(env=first)
            s.edit(env=second, seed=0)
            np.testing.assert_array_equal(s.wait(60).image, want)
            with self.assertRaises(gobo.InvalidArgument):
                s.edit(env=np.zeros((4, 8, 4)))
        for mapped in (first, self.path("second.exr")):
            stop = gobo.Cancellation()
            stop.cancel()
            with self.assertRaises(gobo.Cancelled):
                self.client.render("cornell", env=mapped, **SMALL, cancel=stop)

    def test_arrays_that_are_no_map_are_refused_here(self):
        for bad in (np.zeros((4, 8)), np.zeros((4, 8, 4)), np.zeros((0, 8, 3)), np.full((4, 8, 3), np.nan), np.full((4, 8, 3), 1e39), np.zeros((4, 8, 3), complex)):
            with self.assertRaises(gobo.InvalidArgument) as caught:
                self.client.render("cornell", env=bad, **SMALL)
            self.assertEqual(caught.exception.field, "env")

    def test_a_second_load_sends_no_bytes(self):
        path = gltf(self.folder)
        files = gobo.blobs.files_of(path, 1 << 30)
        self.assertEqual(set(files), {"tri.gltf", "tri data.bin"})
        first = self.client.scenes.open(path, "one")
        self.assertTrue(first.source.startswith("blobs:"))
        self.assertEqual(self.client.blobs.put(files.values()), 0)
        self.client.scenes.unload("one")
        self.assertEqual(self.client.blobs.put(files.values()), 0, "also once the scene is unloaded")
        self.assertEqual(self.client.scenes.open(path, "two").hash, first.hash)
        with gobo.local(threads=2) as free:
            self.assertEqual(free.scenes.open(path).hash, first.hash)

    def test_the_command_line_does_the_same(self):
        path = gltf(self.folder)
        radiance = sky(77)
        gobo.exr.write(self.path("cli.exr"), {c: radiance[:, :, i] for i, c in enumerate("RGB")})
        flags = ["--size", "32x24", "--spp", "16", "--set", "integrator.max_bounces=2", "--env", "cli.exr"]
        one = self.cli("render", "tri.gltf", "-o", "one.raw", *flags)
        self.assertIn("sending", one.stderr)
        two = self.cli("render", "tri.gltf", "-o", "two.raw", *flags)
        self.assertNotIn("sending", two.stderr)
        want = self.client.render(path, env=radiance, **SMALL).image.tobytes()
        for name in ("one.raw", "two.raw"):
            with open(self.path(name), "rb") as file:
                self.assertEqual(file.read(), want)
        self.cli("render", "tri.gltf", "--env", "nonesuch.exr", code=3)

    def test_bytes_that_break_off_go_on(self):
        data = os.urandom(3 << 20)
        blob = gobo.blob(data)
        with self.assertRaises(gobo.InvalidArgument):   # half of it
            self.client.blobs._one(gobo.Blob(blob.sha256, blob.bytes, data[:2 << 20]), 0, None)
        self.assertEqual(self.client.blobs.put([blob]), 1 << 20)
        self.assertEqual(self.client.blobs.put([blob]), 0)

    def test_a_question_that_breaks_is_asked_again(self):
        blobs, broken = self.client.blobs, []
        ask = blobs._stub.Missing

        class Broken(grpc.RpcError):
            code, details, trailing_metadata = (lambda _: grpc.StatusCode.UNAVAILABLE), (lambda _: "it restarts"), (lambda _: ())

        def missing(*args, **more):
            if len(broken) < 2:
                broken.append(1)
                raise Broken
            return ask(*args, **more)
        with mock.patch.object(blobs._stub, "Missing", missing):
            self.assertEqual(blobs.put([gobo.blob(os.urandom(100))]), 100)
        self.assertEqual(len(broken), 2)

    def test_another_threads_upload_is_not_waited_for_beyond_the_deadline(self):
        with self.client.blobs._one_at_a_time, self.assertRaises(gobo.DeadlineExceeded):
            self.client.blobs.put([gobo.blob(b"x")], timeout=0.2)
        self.assertEqual(self.client.blobs.put([gobo.blob(os.urandom(100))], timeout=60), 100)

    def test_a_damaged_first_half_is_sent_again(self):
        data = os.urandom(1000)
        blob = gobo.blob(data)
        with self.assertRaises(gobo.InvalidArgument):
            self.client.blobs._one(gobo.Blob(blob.sha256, 1000, b"?" * 500), 0, None)
        self.assertEqual(self.client.blobs.put([blob]), 500 + 1000)
        self.assertEqual(self.client.blobs.put([blob]), 0)


class Empty(DaemonTest):
    options = {"roots": ()}

    def test_a_file_without_bytes_is_named(self):
        for name in ("empty.glb", "empty.hdr"):
            with open(self.path(name), "wb"):
                pass
        glb, hdr = self.path("empty.glb"), self.path("empty.hdr")
        for words in (("load", glb), ("render", glb, "-o", "x.png"), ("render", "cornell", "--env", hdr, "-o", "x.png")):
            said = self.cli(*words, code=2).stderr
            self.assertIn("the file is empty", said)
            self.assertIn(glb if glb in words else hdr, said)
        for ask in (lambda: self.client.render(glb), lambda: self.client.render("cornell", env=hdr)):
            with self.assertRaisesRegex(gobo.InvalidArgument, "empty\\.(glb|hdr).*the file is empty"):
                ask()


class SmallStore(DaemonTest):
    """A gobod that keeps 1 MiB of what its clients put, half of it for one."""

    @classmethod
    def setUpClass(cls):
        file = tempfile.NamedTemporaryFile("w", suffix=".toml")
        cls.addClassCleanup(file.close)
        file.write('[blobs]\nbytes = "1MiB"\n')
        file.flush()
        cls.options = {"config": file.name}
        super().setUpClass()

    def scene(self, files, size):
        """The triangle, and further buffers that nothing reads."""
        path = gltf(self.folder, f"with{files}.gltf")
        with open(path, encoding="utf-8") as file:
            document = json.load(file)
        for i in range(files):
            name = f"{files}-{i}.bin"
            with open(self.path(name), "wb") as file:
                file.write(os.urandom(size))
            document["buffers"].append({"byteLength": size, "uri": name})
        with open(path, "w", encoding="utf-8") as file:
            json.dump(document, file)
        return path

    def test_a_scene_whose_files_cannot_be_there_at_once_is_refused_before_any_is_sent(self):
        done = self.cli("load", self.scene(3, 200 << 10), code=2, timeout=60)
        self.assertIn("blobs.bytes = 1048576", done.stderr)
        self.assertNotIn("sending", done.stderr)
        with self.assertRaises(gobo.Error) as caught:
            self.client.scenes.open(self.path("with3.gltf"))
        self.assertIn("blobs.bytes", str(caught.exception))
        self.cli("load", self.scene(2, 150 << 10), timeout=60)

    def test_a_server_that_keeps_nothing_is_not_sent_to_for_ever(self):
        puts = []

        class Forgetful(service_pb2_grpc.BlobsServicer):
            def Missing(self, request, context):
                return service_pb2.MissingBlobsReply(missing=[service_pb2.MissingBlob(blob=b) for b in request.blobs])

            def Put(self, request_iterator, context):
                first = next(request_iterator)
                puts.append(first.blob.sha256)
                return service_pb2.PutBlobReply(received=len(first.data) + sum(len(m.data) for m in request_iterator))

        class Blind(service_pb2_grpc.ScenesServicer):
            def Open(self, request, context):
                context.abort(grpc.StatusCode.PERMISSION_DENIED, "is not under a folder that may be read")
        done = self.load_by(Forgetful(), Blind(), self.scene(1, 1000), code=2)
        self.assertIn("does not keep", done.stderr)
        self.assertEqual(len(puts), 3 * 3, "each of the three files three times")

    def load_by(self, blobs, scenes, path, code=0):
        """What the command line says of a server of these two services."""
        server = grpc.server(futures.ThreadPoolExecutor(4), options=[("grpc.so_reuseport", 0)])
        service_pb2_grpc.add_BlobsServicer_to_server(blobs, server)
        service_pb2_grpc.add_ScenesServicer_to_server(scenes, server)
        port = server.add_insecure_port("127.0.0.1:0")
        server.start()
        try:
            return self.cli("--server", f"127.0.0.1:{port}", "load", path, code=code, timeout=60)
        finally:
            server.stop(None).wait()

    def test_the_command_line_asks_again_where_the_question_breaks(self):
        asked = []

        class Restarting(service_pb2_grpc.BlobsServicer):
            def Missing(self, request, context):
                asked.append(len(request.blobs))
                if len(asked) == 1:
                    context.abort(grpc.StatusCode.UNAVAILABLE, "it restarts")
                if len(asked) == 2:
                    context.abort(grpc.StatusCode.RESOURCE_EXHAUSTED, "too many calls; retry after 100 ms")
                return service_pb2.MissingBlobsReply()

        class Opening(service_pb2_grpc.ScenesServicer):
            def Open(self, request, context):
                if not request.files:
                    context.abort(grpc.StatusCode.PERMISSION_DENIED, "is not under a folder that may be read")
                return service_pb2.SceneInfo(id="opened")
        self.assertIn("opened", self.load_by(Restarting(), Opening(), self.scene(1, 1000)).stdout)
        self.assertEqual(asked, [3, 3, 3])


if __name__ == "__main__":
    unittest.main()
