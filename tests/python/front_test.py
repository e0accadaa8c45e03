# SPDX-License-Identifier: Apache-2.0
"""What goes through the front (front.py), what does not, and what stops there. Floods: front_flood_test.py."""
import os
import socket
import signal
import threading
import time
import unittest

import grpc
import numpy as np

import gobo
from gobo.v1 import render_pb2, service_pb2, service_pb2_grpc
from front import FrontTest, TOKENS, http2, scenes
from support import SMALL


class Front(FrontTest):
    # What goes through.

    def test_status_and_render(self):
        with self.connect() as client:
            self.assertEqual(client.status().pid, self.gobod.pid)
            picture = client.render("cornell", **SMALL)
            with gobo.connect(f"unix:{self.folder}/gobo.sock", token=TOKENS["lighting"]) as direct:
                np.testing.assert_array_equal(direct.render("cornell", **SMALL).image, picture.image)

    def test_large_upload_streams(self):
        """68 MB are more than one message may have, and than client_max_body_size of other methods."""
        with self.connect() as client:
            scene = client.scenes.upload(scenes.large(3, 68), "large")
            self.assertGreater(scene.triangles, 900000)
            client.scenes.unload("large")

    def test_progressive_comes_as_it_is_made(self):
        with self.connect() as client:
            begun, first, count = time.monotonic(), None, 0
            with client.render_progressive("cornell", width=160, height=120, spp=512, seed=time.time_ns() % 1000000) as snapshots:
                for snapshot in snapshots:
                    first = first or time.monotonic() - begun
                    count += 1
            whole = time.monotonic() - begun
            self.assertTrue(snapshot.final)
            self.assertGreater(count, 2)
            self.assertLess(first, 0.5 * whole, "the front held pictures back")

    def test_cancel_frees_the_cores(self):
        with self.connect() as client:
            with client.render_progressive("cornell", width=640, height=480, spp=1 << 16) as snapshots:
                next(snapshots)
                self.assertGreaterEqual(client.status().running, 1)
            end = time.monotonic() + 3
            while client.status().running and time.monotonic() < end:
                time.sleep(0.05)
            self.assertEqual(client.status().running, 0, "the render goes on without its client")

    def test_ready(self):
        with self.get("/ready") as answer:
            self.assertEqual((answer.status, answer.read()), (200, b"ready\n"))
        with self.get("/metrics") as answer:   # 404, as gRPC has it
            self.assertEqual((answer.headers["grpc-status"], answer.read()), ("12", b""))

    # What does not.

    def test_without_a_certificate(self):
        for tls in (self.tls(cert=False), self.tls("others")):   # none; one of another authority
            with self.assertRaisesRegex(gobo.Unauthenticated, "client certificate"):
                self.connect(tls=tls)

    def test_the_daemon_asks_for_the_token_behind_the_certificate(self):
        for token in ("", "wrong"):
            channel, _ = self.raw()
            with channel, self.assertRaises(grpc.RpcError) as caught:
                service_pb2_grpc.AdminStub(channel).GetStatus(service_pb2.StatusRequest(), timeout=20,
                                                              metadata=[("authorization", f"Bearer {token}")] if token else None)
            self.assertEqual(caught.exception.code(), grpc.StatusCode.UNAUTHENTICATED)
            self.assertNotIn("certificate", caught.exception.details())

    def test_codes_of_the_daemon_come_through(self):
        with self.connect("limited") as client:
            with self.assertRaisesRegex(gobo.InvalidArgument, "tokens.max_pixels"):
                client.render("cornell", **SMALL)
            with self.assertRaises(gobo.NotFound):
                client.relight("no such render")

    def test_shutdown_is_for_the_host(self):
        with self.connect("ops") as client:
            for call in (client.shutdown, client.drop_caches, client.list_terms, lambda: client.pin_terms(type="*")):
                with self.assertRaisesRegex(gobo.PermissionDenied, "beyond the host"):
                    call()
        self.assertIsNone(self.gobod.poll())

    def test_too_large_for_a_message(self):
        channel, metadata = self.raw()
        with channel, self.assertRaises(grpc.RpcError) as caught:
            channel.unary_unary("/gobo.v1.Render/RenderInline")(bytes(18 << 20), metadata=metadata, timeout=60)
        self.assertEqual(caught.exception.code(), grpc.StatusCode.RESOURCE_EXHAUSTED)

    def test_no_daemon_behind(self):
        path = os.path.join(self.folder, "gobo.sock")
        os.rename(path, path + ".away")
        try:
            self.nginx.send_signal(signal.SIGHUP)   # connections that it keeps to the daemon go
            time.sleep(1)
            channel, metadata = self.raw()
            with channel, self.assertRaises(grpc.RpcError) as caught:
                service_pb2_grpc.AdminStub(channel).GetStatus(service_pb2.StatusRequest(), metadata=metadata, timeout=20)
        finally:
            os.rename(path + ".away", path)
        self.assertEqual((caught.exception.code(), caught.exception.details()),
                         (grpc.StatusCode.UNAVAILABLE, "the daemon behind the front does not answer"))
        self.assertIn(("retry-after-ms", "1000"), [(k, v) for k, v in caught.exception.trailing_metadata()])

    # What stops at the front.

    def test_a_silent_upload_ends(self):
        channel, metadata = self.raw()
        over = threading.Event()

        def pieces():
            yield service_pb2.UploadSceneRequest(extension=".glb", total_bytes=1 << 20, data=b"glTF")
            over.wait(30)
        begun = time.monotonic()
        with channel, self.assertRaises(grpc.RpcError):
            service_pb2_grpc.ScenesStub(channel).Upload(pieces(), metadata=metadata, timeout=30)
        over.set()
        self.assertLess(time.monotonic() - begun, 10)
        with self.connect() as client:
            end = time.monotonic() + 5
            while client.status().loads and time.monotonic() < end:
                time.sleep(0.05)
            self.assertEqual(client.status().loads, 0, "the daemon still waits for it")

    def test_a_connection_ends_after_its_requests(self):
        """keepalive_requests: the bound that makes rapid reset pay for a handshake again and again."""
        path = "/gobo.v1.Nothing/Nothing"
        block = http2.headers(path, f"localhost:{self.port}", "", "https")
        name = lambda n: os.path.join(self.certs, n)
        with http2.connect("127.0.0.1", self.port, name("ca.pem"), name("lighting.pem"), name("lighting.key"), source="127.0.0.3") as connection:
            opened, answered, last = 0, 0, None
            while last is None and opened < 1500:
                while opened - answered < 16:
                    connection.sendall(http2.frame(http2.HEADERS, http2.END_HEADERS | http2.END_STREAM, 2 * opened + 1, block))
                    opened += 1
                kind, _, _ = http2.read(connection)
                answered += kind == http2.HEADERS
                if kind == http2.GOAWAY:
                    last = answered
        self.assertIsNotNone(last, "1500 requests over one connection")
        self.assertGreater(last, 900)
        self.assertLessEqual(last, 1000)

    def test_a_picture_that_nobody_reads(self):
        """12 MB that stay where they are: the stream ends, and the daemon holds neither call nor picture."""
        request = render_pb2.RenderRequest(scene="cornell", width=1024, height=1024, outputs=["depth", "normal", "position"], view_samples=1)
        request.halt.spp = 1
        request.encoding.format = render_pb2.Encoding.RAW_FLOAT
        channel, metadata = self.raw()
        with channel:
            call = service_pb2_grpc.RenderStub(channel).Render(request, metadata=metadata, timeout=60)
            ended = threading.Event()
            call.add_callback(ended.set)
            self.assertTrue(ended.wait(40), "the stream still waits for its reader")
            self.assertNotEqual(call.code(), grpc.StatusCode.OK)
            self.assertNotEqual(call.code(), grpc.StatusCode.DEADLINE_EXCEEDED)

    def test_idle_connections_of_one_address(self):
        held = []
        try:
            for n in range(1100):
                held.append(socket.create_connection(("127.0.0.1", self.port), 5, ("127.0.0.2", 0)))
                held[-1].setblocking(False)
            descriptors = len(os.listdir(f"/proc/{self.gobod.pid}/fd"))
            with self.connect() as client:
                begun = time.monotonic()
                client.render("cornell", **SMALL, seed=77)
                self.assertLess(time.monotonic() - begun, 5)
            self.assertLess(descriptors, 200, "idle connections reach the daemon")
            # They do not stay: client_header_timeout.
            end = time.monotonic() + 20
            gone = 0
            while gone < len(held) and time.monotonic() < end:
                gone = 0
                for s in held:
                    try:
                        gone += s.recv(1) == b""
                    except BlockingIOError:
                        pass
                    except OSError:
                        gone += 1
                time.sleep(0.5)
            self.assertEqual(gone, len(held))
        finally:
            for s in held:
                s.close()


if __name__ == "__main__":
    unittest.main()
