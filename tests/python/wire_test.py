# SPDX-License-Identifier: Apache-2.0
"""The client against servers that are busy, wrong, picky about tokens, or not there."""
import os
import pathlib
import subprocess
import tempfile
import threading
import time
import unittest
from unittest import mock

import grpc
import numpy as np

import gobo
from gobo import errors, wire
from gobo.v1 import render_pb2, service_pb2
from support import CLI, DaemonTest, Liar, events


def render(request, context):
    yield from events()


class Tokens(unittest.TestCase):
    def test_header(self):
        with Liar(Render=render) as liar:
            for token, env, want in (("s3cret", None, "Bearer s3cret"), (None, "fromenv", "Bearer fromenv"), ("arg", "env", "Bearer arg"), (None, None, None)):
                liar.metadata.clear()
                with mock.patch.dict(os.environ, {"GOBO_TOKEN": env} if env else {}):
                    if not env:
                        os.environ.pop("GOBO_TOKEN", None)
                    with gobo.connect(liar.address, token=token) as client:
                        client.render("x")
                self.assertEqual([m.get("authorization") for m in liar.metadata], [want, want])

    def test_header_of_the_cli(self):
        with Liar(Render=render) as liar, tempfile.NamedTemporaryFile("w") as file:
            file.write("from-file\nsecond line\n")
            file.flush()
            for args, env, want in (([], {"GOBO_TOKEN": "abc"}, "Bearer abc"), (["--token-file", file.name], {"GOBO_TOKEN": "abc"}, "Bearer from-file"),
                                    ([], {}, None)):
                liar.metadata.clear()
                clean = {k: v for k, v in os.environ.items() if k != "GOBO_TOKEN"}
                subprocess.run([CLI, "--server", liar.address, "status", *args], env={**clean, **env}, check=True, capture_output=True, timeout=60)
                self.assertEqual([m.get("authorization") for m in liar.metadata], [want])

    def test_never_in_the_clear_over_a_network(self):
        with self.assertRaisesRegex(gobo.InvalidArgument, "unencrypted"):
            gobo.connect("render.example.com:50551", token="s")
        for named in ("127.evil.example:50051", "127.0.0.1.nip.io:1", "127.0.0.1.:1", "[::2]:1", "localhost.example:1"):   # names of anybody
            with self.assertRaisesRegex(gobo.InvalidArgument, "unencrypted", msg=named):
                gobo.connect(named, token="s")
        for local in ("127.0.0.1:1", "127.8.9.10:1", "[::1]:1", "localhost:1", "unix:/nonesuch"):
            wire.Wire(local, "s", None, None, 0).close()
        with self.assertRaises(gobo.InvalidArgument):
            gobo.connect("127.0.0.1:1", token="two words")
        done = subprocess.run([CLI, "--server", "render.example.com:50551", "status"], env={**os.environ, "GOBO_TOKEN": "s"}, capture_output=True, text=True, timeout=60)
        self.assertEqual(done.returncode, 2)
        self.assertIn("unencrypted", done.stderr)

    def test_unauthenticated(self):
        def refuse(request, context):
            context.abort(grpc.StatusCode.UNAUTHENTICATED, "no token")
        with Liar(GetStatus=refuse) as liar, self.assertRaises(gobo.Unauthenticated):
            gobo.connect(liar.address)


class Tls(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.cert, cls.key = os.path.join(folder.name, "c.pem"), os.path.join(folder.name, "k.pem")
        subprocess.run(["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-keyout", cls.key, "-out", cls.cert,
                        "-days", "2", "-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost"], check=True, capture_output=True)
        cls.pems = [pathlib.Path(p).read_bytes() for p in (cls.key, cls.cert)]

    def test_trusted_and_not(self):
        with Liar(grpc.ssl_server_credentials([tuple(self.pems)]), Render=render) as liar:
            with gobo.connect(liar.address, token="t", tls=self.cert) as client:
                client.render("x")
            self.assertEqual(liar.metadata[-1]["authorization"], "Bearer t")
            with self.assertRaises(gobo.Unavailable):
                gobo.connect(liar.address, tls=True, timeout=5)
            done = subprocess.run([CLI, "--server", liar.address, "--ca", self.cert, "status"], capture_output=True, text=True, timeout=60)
            self.assertEqual(done.returncode, 0, done.stderr)

    def test_mutual(self):
        credentials = grpc.ssl_server_credentials([tuple(self.pems)], self.pems[1], True)
        with Liar(credentials, Render=render) as liar:
            with gobo.connect(liar.address, tls=gobo.Tls(ca=self.cert, cert=self.cert, key=self.key)) as client:
                client.render("x")
            with self.assertRaises(gobo.Unavailable):
                gobo.connect(liar.address, tls=self.cert, timeout=5)
            args = [CLI, "--server", liar.address, "--ca", self.cert, "--timeout", "5", "status"]
            self.assertEqual(subprocess.run([*args, "--cert", self.cert, "--key", self.key], capture_output=True, timeout=60).returncode, 0)
            self.assertEqual(subprocess.run(args, capture_output=True, timeout=60).returncode, 4)
        with self.assertRaises(gobo.InvalidArgument):
            gobo.connect("localhost:1", tls=gobo.Tls(cert=self.cert))


class Busy(unittest.TestCase):
    def busy(self, times, hint="30"):
        calls = []

        def answer(request, context):
            calls.append(time.monotonic())
            if len(calls) <= times:
                if hint:
                    context.set_trailing_metadata((("retry-after-ms", hint),))
                context.abort(grpc.StatusCode.RESOURCE_EXHAUSTED, f"queue is full; retry after {hint} ms" if hint else "larger than a limit")
            yield from events()
        return calls, answer

    def test_tries_again_no_earlier_than_asked(self):
        calls, answer = self.busy(2)
        with Liar(Render=answer) as liar, gobo.connect(liar.address) as client:
            np.testing.assert_array_equal(client.render("x").image, [[[1, 2, 3], [4, 5, 6]]])
        self.assertEqual(len(calls), 3)
        self.assertTrue(all(b - a >= 0.029 for a, b in zip(calls, calls[1:])))

    def test_gives_up(self):
        calls, answer = self.busy(100, "1")
        with Liar(Render=answer) as liar, gobo.connect(liar.address, retries=3) as client, self.assertRaises(gobo.ResourceExhausted) as caught:
            client.render("x")
        self.assertEqual((len(calls), caught.exception.retry_after_ms), (4, 1))

    def test_a_limit_is_not_tried_again(self):
        calls, answer = self.busy(100, "")
        with Liar(Render=answer) as liar, gobo.connect(liar.address) as client, self.assertRaises(gobo.ResourceExhausted):
            client.render("x")
        self.assertEqual(len(calls), 1)

    def test_not_beyond_the_deadline(self):
        calls, answer = self.busy(100, "60000")
        with Liar(Render=answer) as liar, gobo.connect(liar.address) as client, self.assertRaises(gobo.ResourceExhausted):
            client.render("x", timeout=2)
        self.assertEqual(len(calls), 1)

    def test_one_deadline_for_all_calls_of_one_piece_of_work(self):
        left = []

        def refuse(request, context):
            left.append(context.time_remaining())
            time.sleep(0.5)
            context.abort(grpc.StatusCode.PERMISSION_DENIED, "outside of the roots")

        def found(request, context):
            left.append(context.time_remaining())
            return service_pb2.SceneInfo(id="s")

        def timed(request, context):
            left.append(context.time_remaining())
            yield from events()

        def slow(request, context):
            time.sleep(0.5)
            return found(request, context)
        with tempfile.NamedTemporaryFile(suffix=".glb") as file:
            file.write(b"glTF")   # one without bytes is refused here
            file.flush()
            with Liar(Open=refuse, Inspect=found, Render=timed, RenderProgressive=timed) as liar, gobo.connect(liar.address, timeout=8) as client:
                # Times of ten seconds and more would be told in a coarser unit.
                for seconds, work in ((9, lambda: client.render(file.name, timeout=9)), (8, lambda: client.render(file.name)),
                                      (9, lambda: list(client.render_progressive(file.name, timeout=9)))):
                    left.clear()
                    work()
                    self.assertEqual(len(left), 3)
                    self.assertTrue(seconds + 0.1 > left[0] and left[0] - 0.4 > left[1] and left[1] + 0.1 > left[2], left)
                self.assertIsNone(gobo.Client(wire.Wire(liar.address, None, None, None, 0))._wire.until(None))
                until = client._wire.until(None)
                self.assertEqual((until, client._wire.until(until) is until), (8, True))
            calls = []
            with Liar(Open=refuse, Inspect=slow, Render=lambda r, c: calls.append(1) or events()) as liar, gobo.connect(liar.address) as client:
                begun = time.monotonic()
                with self.assertRaises(gobo.DeadlineExceeded):
                    client.render(file.name, timeout=0.8)   # enough for each call alone
                self.assertLess(time.monotonic() - begun, 5)
                self.assertEqual(calls, [])

    def test_no_time_at_all_is_no_time(self):
        stop = threading.Event()
        with Liar(Inspect=lambda r, c: stop.wait(20)) as liar, gobo.connect(liar.address) as client:
            try:
                with self.assertRaises(gobo.DeadlineExceeded):
                    client.scenes.inspect("s", timeout=0)
            finally:
                stop.set()

    def test_deadlines_hold_where_nobody_is_there_any_more(self):
        with Liar() as liar:
            client = gobo.connect(liar.address)
        with client:
            begun = time.monotonic()
            with self.assertRaises((gobo.Unavailable, gobo.DeadlineExceeded)):
                client.jobs.submit("cornell", timeout=0.3)
            with self.assertRaisesRegex(gobo.DeadlineExceeded, "j-1: the time is over"):
                gobo.Job(client.jobs, "j-1").wait(0.5)
            with self.assertRaises((gobo.Unavailable, gobo.DeadlineExceeded)):
                client.blobs.put([gobo.blob(b"x")], timeout=0.3)
            self.assertLess(time.monotonic() - begun, 5)
            pauses = []
            with mock.patch("gobo.jobs.pause", lambda seconds, cancel: pauses.append(seconds)), self.assertRaises(gobo.Unavailable):
                client.jobs.submit("cornell")
            self.assertEqual(pauses, [0.2, 0.4, 0.8], "and none after the last try")

    def test_unary_calls_too(self):
        calls = []

        def answer(request, context):
            calls.append(1)
            if len(calls) == 1:
                context.set_trailing_metadata((("retry-after-ms", "5"),))
                context.abort(grpc.StatusCode.RESOURCE_EXHAUSTED, "busy")
            return service_pb2.SceneInfo(id="s")
        with Liar(Inspect=answer) as liar, gobo.connect(liar.address) as client:
            self.assertEqual(client.scenes.inspect("s").id, "s")


class Damage(unittest.TestCase):
    def check(self, make, what):
        with Liar(Render=lambda request, context: iter(make())) as liar, gobo.connect(liar.address) as client:
            with self.assertRaisesRegex(gobo.DataLoss, what):
                client.render("x")

    def test_honest(self):
        with Liar(Render=render) as liar, gobo.connect(liar.address) as client:
            r = client.render("x")
        self.assertEqual((r.channels, r.render_id), ({"beauty": ["R", "G", "B"]}, "r1"))

    def test_cut_short(self):
        self.check(lambda: list(events())[:2], "incomplete")
        self.check(lambda: [], "without a reply")

    def test_a_gap(self):
        self.check(lambda: [list(events())[i] for i in (0, 2)], "offset 8 where 0")

    def test_twice(self):
        self.check(lambda: [*events(), list(events())[2]], "offset 8 where 24")

    def test_chunks_before_a_head_or_of_no_image(self):
        self.check(lambda: list(events())[1:], "before any picture")
        self.check(lambda: [list(events())[0], render_pb2.RenderEvent(chunk=render_pb2.ImageChunk(image=7))], "image 7")

    def test_sizes_that_do_not_fit(self):
        self.check(lambda: events(width=3), "3 x 1 x 3")
        self.check(lambda: events(bytes=1 << 40), "bytes")

    def test_events_of_later_versions_are_passed_over(self):
        with Liar(Render=lambda request, context: iter([render_pb2.RenderEvent(), *events()])) as liar, gobo.connect(liar.address) as client:
            self.assertEqual(client.render("x").image.shape, (1, 2, 3))


class Errors(DaemonTest):
    def fails(self, kind, field, **request):
        with self.assertRaises(kind) as caught:
            self.client.render(request.pop("scene", "cornell"), **request)
        self.assertEqual(caught.exception.field, field, str(caught.exception))
        return caught.exception

    def test_names_the_field(self):
        self.fails(gobo.InvalidArgument, "width", width=0)
        self.fails(gobo.InvalidArgument, "integrator.max_bounces", integrator={"max_bounces": 900})
        self.assertEqual(self.fails(gobo.InvalidArgument, "lights.light.intensity", lights={"light": {"intensity": -1}}).value, "-1")
        self.fails(gobo.InvalidArgument, "outputs", outputs="nonesuch")
        self.fails(gobo.NotFound, "lights.nope", lights={"nope": 2})
        self.fails(gobo.NotFound, "scene", scene="nonesuch")
        self.fails(gobo.FailedPrecondition, "scene_hash", scene_hash="0" * 32)

    def test_builtin_parents(self):
        with self.assertRaises(ValueError):
            self.client.render("cornell", width=0)
        with self.assertRaises(LookupError):
            self.client.render("nonesuch")
        with self.assertRaises(gobo.NotFound):
            self.client.relight("r0", lights={"light": 2})
        with self.assertRaises(gobo.NotFound):
            self.client.render("no/such/file.glb")

    def test_nobody_there(self):
        with self.assertRaisesRegex(gobo.Unavailable, "cannot reach gobod at unix:/nonesuch"):
            gobo.connect("unix:/nonesuch", timeout=5)
        with self.assertRaises(ConnectionError):
            gobo.connect("127.0.0.1:1", timeout=5)

    def test_texts(self):
        e = errors.make("INVALID_ARGUMENT", "request.lights.a b.gain = nan: must be finite (at request.lights.a b.gain)")
        self.assertEqual(e.place, "request.lights.a b.gain")
        e = errors.make("INVALID_ARGUMENT", "componentType = 77: is not a type (at scene.gltf: /accessors/3)")
        self.assertEqual((e.field, e.value, e.place), ("componentType", "77", "scene.gltf: /accessors/3"))
        e = errors.make("SOMETHING_NEW", "text")
        self.assertEqual((type(e), e.code, str(e)), (gobo.Error, "SOMETHING_NEW", "SOMETHING_NEW: text"))


if __name__ == "__main__":
    unittest.main()
