# SPDX-License-Identifier: Apache-2.0
"""deploy/front/nginx.conf before a gobod with configs/studio.toml's rules: what goes through, what does not, and what stops at the front."""
import hashlib
import os
import re
import resource
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import unittest
import urllib.request
import ssl

import grpc
import numpy as np

import gobo
from gobo.v1 import render_pb2, service_pb2, service_pb2_grpc
from support import SMALL, SOURCE

sys.path.insert(0, os.path.join(SOURCE, "bench", "attackers"))
import http2  # noqa: E402
import scenes  # noqa: E402

FRONT = os.path.join(SOURCE, "deploy", "front")
TOKENS = {"lighting": "token-of-lighting", "limited": "token-of-limited", "ops": "token-of-ops"}
RIGHTS = {"limited": "max_pixels = 100\n", "ops": "admin = true\n"}


def nginx():
    return shutil.which("nginx") or ("/usr/sbin/nginx" if os.access("/usr/sbin/nginx", os.X_OK) else None)


def free_port() -> int:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


def replaced(text: str, *pairs) -> str:
    """Every pattern must be there: the test is of the file that is installed."""
    for pattern, value in pairs:
        text, n = re.subn(pattern, lambda _: value, text)
        if n == 0:
            raise AssertionError(f"deploy/front/nginx.conf or configs/studio.toml: nothing matches {pattern}")
    return text


@unittest.skipUnless(nginx(), "nginx is not installed (deploy/install-deps installs nginx-light)")
class Front(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        if resource.getrlimit(resource.RLIMIT_NOFILE)[0] < 4096:
            resource.setrlimit(resource.RLIMIT_NOFILE, (4096, resource.getrlimit(resource.RLIMIT_NOFILE)[1]))
        cls.folder = tempfile.mkdtemp(prefix="gobo-front-")
        cls.addClassCleanup(shutil.rmtree, cls.folder, ignore_errors=True)
        os.chmod(cls.folder, 0o755)
        cls.port, http = free_port(), free_port()
        certs = cls.certs = os.path.join(cls.folder, "certs")
        subprocess.run([os.path.join(FRONT, "make_certs"), certs, "--host", "localhost", "--client", "lighting"], check=True)
        subprocess.run([os.path.join(FRONT, "make_certs"), os.path.join(cls.folder, "others"), "--host", "localhost", "--client", "lighting"], check=True)
        for sub in ("cache", "tmp", "scenes"):
            os.mkdir(os.path.join(cls.folder, sub))
        with open(os.path.join(SOURCE, "configs", "studio.toml"), encoding="utf-8") as file:
            config = file.read().split("\n[[tokens]]")[0]
        config = replaced(config, (r"unix:/run/gobo/gobo\.sock", f"unix:{cls.folder}/gobo.sock"), (r"127\.0\.0\.1:9464", f"127.0.0.1:{http}"),
                          (r"/var/cache/gobo", f"{cls.folder}/cache"), (r"/srv/scenes", f"{cls.folder}/scenes"), (r"/var/lib/gobo", f"{cls.folder}/tmp"),
                          (r'store_bytes = "24GiB"', 'store_bytes = "256MiB"\nthreads = 2'), (r"drain_s = 60", "drain_s = 2"))
        for name, token in TOKENS.items():
            config += f'\n[[tokens]]\nname = "{name}"\nsha256 = "{hashlib.sha256(token.encode()).hexdigest()}"\n' + RIGHTS.get(name, "")
        cls.gobod_config = os.path.join(cls.folder, "gobod.toml")
        with open(cls.gobod_config, "w", encoding="utf-8") as file:
            file.write(config)
        with open(os.path.join(FRONT, "nginx.conf"), encoding="utf-8") as file:
            front = replaced(file.read(), (r"listen 443 ssl", f"listen 127.0.0.1:{cls.port} ssl"), (r"/run/gobo/gobo\.sock", f"{cls.folder}/gobo.sock"),
                             (r"127\.0\.0\.1:9464", f"127.0.0.1:{http}"), (r"/etc/gobo/front", certs), (r"/run/nginx\.pid", f"{cls.folder}/nginx.pid"),
                             (r"/var/log/nginx", cls.folder), (r"/var/lib/nginx", cls.folder), (r"client_body_timeout 30s", "client_body_timeout 2s"), (r"send_timeout 60s;  ", "send_timeout 3s;  "),
                             (r"user www-data gobo;[^\n]*", "user root;" if os.getuid() == 0 else ""))
        # Temporary folders of modules that the file has no use for.
        front = front.replace("  access_log off;", "".join(f"  {m}_temp_path {cls.folder}/{m};\n" for m in ("fastcgi", "uwsgi", "scgi")) + "  access_log off;")
        cls.nginx_config = os.path.join(cls.folder, "nginx.conf")
        with open(cls.nginx_config, "w", encoding="utf-8") as file:
            file.write(front)
        log = open(os.path.join(cls.folder, "log"), "wb")
        cls.addClassCleanup(log.close)
        cls.gobod = subprocess.Popen([os.environ["GOBO_GOBOD"], "--config", cls.gobod_config], stdout=subprocess.PIPE, stderr=log)
        cls.addClassCleanup(cls.gobod.stdout.close)
        cls.addClassCleanup(cls.stop, cls.gobod, signal.SIGTERM)
        if b"ready" not in cls.gobod.stdout.readline():
            raise AssertionError("gobod does not start: " + cls.said())
        cls.nginx = subprocess.Popen([nginx(), "-c", cls.nginx_config, "-e", os.path.join(cls.folder, "error.log"), "-g", "daemon off;"], stderr=log)
        cls.addClassCleanup(cls.stop, cls.nginx, signal.SIGQUIT)
        for _ in range(200):
            try:
                socket.create_connection(("127.0.0.1", cls.port), 1).close()
                break
            except OSError:
                time.sleep(0.05)
        else:
            raise AssertionError("nginx does not start: " + cls.said())

    @classmethod
    def said(cls):
        with open(os.path.join(cls.folder, "log"), encoding="utf-8", errors="replace") as log:
            return log.read()[-3000:]

    @staticmethod
    def stop(process, how):
        process.send_signal(how)
        try:
            process.wait(15)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()

    def tls(self, folder="certs", cert=True):
        name = lambda n: os.path.join(self.folder, folder, n)
        return gobo.Tls(ca=os.path.join(self.certs, "ca.pem"), cert=name("lighting.pem") if cert else None, key=name("lighting.key") if cert else None)

    def connect(self, token="lighting", tls=None, **more):
        return gobo.connect(f"localhost:{self.port}", token=TOKENS.get(token, token), tls=tls or self.tls(), timeout=60, **more)

    def rss(self) -> int:
        with open(f"/proc/{self.gobod.pid}/status", encoding="ascii") as file:
            return int(re.search(r"VmHWM:\s+(\d+)", file.read())[1]) * 1024

    def get(self, path):
        context = ssl.create_default_context(cafile=os.path.join(self.certs, "ca.pem"))
        context.load_cert_chain(os.path.join(self.certs, "lighting.pem"), os.path.join(self.certs, "lighting.key"))
        return urllib.request.urlopen(f"https://localhost:{self.port}{path}", context=context, timeout=10)

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

    def test_too_many_calls_have_a_hint(self):
        channel, metadata = self.raw()
        with channel:
            stub = service_pb2_grpc.AdminStub(channel)
            calls = [stub.GetStatus.future(service_pb2.StatusRequest(), metadata=metadata, timeout=30) for _ in range(600)]
            refused = [c for c in calls if c.code() == grpc.StatusCode.RESOURCE_EXHAUSTED]
            self.assertGreater(len(calls) - len(refused), 150)
            self.assertGreater(len(refused), 0, "nothing was refused")
            self.assertIn(("retry-after-ms", "500"), [(k, v) for k, v in refused[0].trailing_metadata()])
        time.sleep(3)   # the bucket of this address fills again for the other tests

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

    def test_rapid_reset(self):
        """8 s of requests that are taken back at once, from another address: the daemon does not grow, a victim renders."""
        with self.connect() as client:
            client.render("cornell", **SMALL)
            before, times = self.rss(), []
            attack = http2.RapidReset("127.0.0.1", self.port, "/gobo.v1.Admin/GetStatus", TOKENS["lighting"], os.path.join(self.certs, "ca.pem"),
                                      os.path.join(self.certs, "lighting.pem"), os.path.join(self.certs, "lighting.key"), source="127.0.0.2")
            thread = threading.Thread(target=attack.run, args=(8,))
            thread.start()
            while thread.is_alive():
                begun = time.monotonic()
                client.render("cornell", **SMALL, seed=len(times))
                times.append(time.monotonic() - begun)
            thread.join()
            grown = self.rss() - before
        print(f"rapid reset: {attack.sent} streams over {attack.connections} connections; gobod grew by {grown / 2**20:.0f} MiB; "
              f"{len(times)} pictures beside, the slowest {max(times):.2f} s", file=sys.stderr)
        self.assertGreater(attack.sent, 1000, "there was no attack")
        self.assertLess(grown, 200 << 20)
        self.assertGreater(len(times), 8)
        self.assertLess(max(times), 5)

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

    def raw(self):
        def read(name):
            with open(os.path.join(self.certs, name), "rb") as file:
                return file.read()
        credentials = grpc.ssl_channel_credentials(read("ca.pem"), read("lighting.key"), read("lighting.pem"))
        channel = grpc.secure_channel(f"localhost:{self.port}", credentials, [("grpc.use_local_subchannel_pool", 1), ("grpc.max_send_message_length", -1)])
        return channel, [("authorization", f"Bearer {TOKENS['lighting']}")]


if __name__ == "__main__":
    unittest.main()
