# SPDX-License-Identifier: Apache-2.0
"""The door (docs/live.md): pages, calls and frames over HTTP, who gets nothing, and what a closed connection ends."""
import hashlib
import http.client
import json
import os
import re
import shutil
import signal
import socket
import ssl
import struct
import subprocess
import tempfile
import threading
import time
import unittest

import grpc
from google.protobuf import json_format

import gobo
from gobo.v1 import render_pb2, service_pb2_grpc
from support import SOURCE

JSON = {"Content-Type": "application/json"}
LONG = {"scene": "cornell", "width": 640, "height": 480, "halt": {"spp": 1 << 18}, "encoding": {"format": "JPEG"}}


def frames(answer):
    """(head, bytes) of each frame of a stream."""
    while size := answer.read(4):
        head = json.loads(answer.read(struct.unpack("<I", size)[0]))
        yield head, answer.read(head["bytes"])


def pair(folder, name):
    """Writes cert.pem and key.pem of that common name, for 127.0.0.1; their paths."""
    cert, key = (os.path.join(folder, file) for file in ("cert.pem", "key.pem"))
    subprocess.run(["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-keyout", key, "-out", cert,
                    "-days", "2", "-subj", f"/CN={name}", "-addext", "subjectAltName=IP:127.0.0.1"], check=True, capture_output=True)
    return cert, key


class Relay:
    """TCP to a port and back. `pause`: None, or (bytes, seconds): after that many bytes of the answers it passes nothing for so long, once."""

    def __init__(self, test, port):
        self.target, self.pause, self.passed, self.open = port, None, 0, []
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.port = self.listener.getsockname()[1]
        test.addCleanup(self.listener.close)
        threading.Thread(target=self.accept, daemon=True).start()

    def accept(self):
        while True:
            try:
                caller = self.listener.accept()[0]
            except OSError:
                return
            server = socket.create_connection(("127.0.0.1", self.target))
            self.open += caller, server
            threading.Thread(target=self.pump, args=(caller, server, False), daemon=True).start()
            threading.Thread(target=self.pump, args=(server, caller, True), daemon=True).start()

    def stop(self):
        for one in self.open:
            try:
                one.shutdown(socket.SHUT_RDWR)
            except OSError:
                pass

    def pump(self, source, to, answers):
        with source:
            try:
                while data := source.recv(16384):
                    if answers and self.pause:
                        self.passed += len(data)
                        if self.passed > self.pause[0]:
                            seconds, self.pause = self.pause[1], None
                            time.sleep(seconds)
                    to.sendall(data)
                to.shutdown(socket.SHUT_WR)
            except OSError:
                pass


class Door(unittest.TestCase):
    config = ""
    request_bytes = "1MiB"

    def setUp(self):
        self.folder = tempfile.mkdtemp(prefix="gobo-web-")
        self.addCleanup(shutil.rmtree, self.folder, ignore_errors=True)
        config = os.path.join(self.folder, "gobod.toml")
        with open(config, "w", encoding="utf-8") as file:
            file.write('listen = ["unix:s.sock"]\n[web]\nlisten = "127.0.0.1:0"\nhosts = ["render.example"]\n[limits]\n'
                       f'request_bytes = "{self.request_bytes}"\n[engine]\nthreads = 2\nroots = ["{SOURCE}/tests/data"]\n' + self.config)
        with open(os.path.join(self.folder, "log"), "wb") as log:
            self.process = subprocess.Popen([os.environ["GOBO_GOBOD"], "--config", config], stdout=subprocess.PIPE, stderr=log)
        self.addCleanup(self.process.stdout.close)
        self.addCleanup(self.process.wait)
        self.addCleanup(self.process.kill)
        self.port = int(re.search(r"http://127\.0\.0\.1:(\d+)", self.process.stdout.readline().decode())[1])
        self.client = gobo.connect(f"unix:{self.folder}/s.sock", timeout=60, retries=0)
        self.addCleanup(self.client.close)

    def open(self, path, body=None, headers=None, method=None):
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        self.addCleanup(connection.close)
        data = body if isinstance(body, (bytes, type(None))) else json.dumps(body).encode()
        connection.request(method or ("GET" if data is None else "POST"), path, data, (JSON if data is not None else {}) if headers is None else headers)
        return connection, connection.getresponse()

    def call(self, *args, **named):
        answer = self.open(*args, **named)[1]
        data = answer.read()
        kind = answer.getheader("Content-Type", "")
        return answer.status, json.loads(data) if kind == "application/json" else data, answer

    def error(self, *args, **named):
        status, body, _ = self.call(*args, **named)
        return status, body["error"]["code"], body["error"]["message"]

    def running(self):
        return self.client.status().running

    def eventually(self, what, seconds=10):
        end = time.monotonic() + seconds
        while not what():
            self.assertLess(time.monotonic(), end)
            time.sleep(0.005)


class Calls(Door):
    def test_the_page_and_what_it_may_load(self):
        status, page, answer = self.call("/")
        self.assertEqual((status, answer.getheader("Content-Type")), (200, "text/html; charset=utf-8"))
        self.assertIn("default-src 'self'", answer.getheader("Content-Security-Policy"))
        self.assertEqual(answer.getheader("X-Content-Type-Options"), "nosniff")
        named = re.findall(r'(?:src|href)="([^":]+)"', page.decode())
        self.assertGreater(len(named), 1)
        for name in named:
            status, text, answer = self.call("/" + name)
            self.assertEqual(status, 200, name)
            with open(f"{SOURCE}/clients/viewer/{name}", "rb") as file:
                self.assertEqual(text, file.read(), name)
        self.assertEqual(self.error("/../server/main.cpp")[0], 404)
        self.assertEqual(self.error("/v1/nothing")[:2], (404, "NOT_FOUND"))
        self.assertEqual(self.call("/", method="DELETE")[0], 405)

    def test_the_schema_is_that_of_requests(self):
        _, schema, _ = self.call("/v1/schema")
        self.assertEqual(schema, gobo.schema.schema(), "the notebook's controls are the page's")
        fields = {f["name"]: f for f in schema["messages"][schema["root"]]["fields"]}
        self.assertEqual(set(fields), {f.name for f in render_pb2.RenderRequest.DESCRIPTOR.fields})
        self.assertEqual((fields["width"]["kind"], fields["width"]["default"], fields["width"]["min"], fields["width"]["max"]), ("integer", 640, 1, 16384))
        self.assertEqual((fields["lights"]["kind"], fields["lights"]["message"]), ("map", "LightEdit"))
        bounces = next(f for f in schema["messages"]["Integrator"]["fields"] if f["name"] == "max_bounces")
        self.assertEqual((bounces["default"], bounces["max"]), (8, 64))
        self.assertIn("help", bounces)
        for message in schema["messages"].values():
            for field in message["fields"]:
                self.assertIn(field.get("message", schema["root"]), schema["messages"])
                self.assertTrue(field["kind"] != "enum" or field["values"])

    def test_a_picture_is_that_of_grpc(self):
        request = {"scene": "cornell", "width": 64, "height": 48, "halt": {"spp": 4}, "encoding": {"format": "PNG"}}
        status, picture, answer = self.call("/v1/render", request)
        self.assertEqual((status, answer.getheader("Content-Type")), (200, "image/png"))
        with grpc.insecure_channel(f"unix:{self.folder}/s.sock") as channel:
            other = service_pb2_grpc.RenderStub(channel).RenderInline(json_format.ParseDict(request, render_pb2.RenderRequest()))
        self.assertEqual(picture, other.images[0])
        self.assertEqual(answer.getheader("Gobo-Request-Hash"), other.reply.request_hash)
        relit = self.call("/v1/relight", {"render_id": answer.getheader("Gobo-Render-Id"), "patch": {"tone_map": {"exposure": 1}}, "mask": ["tone_map.exposure"]})
        self.assertEqual(relit[0], 200)
        self.assertNotEqual(relit[1], picture)

    def test_a_stream_ends_in_the_picture(self):
        request = {"scene": "cornell", "width": 320, "height": 240, "halt": {"spp": 32}, "encoding": {"format": "PNG"}}
        _, answer = self.open("/v1/render/stream", request)
        heads = list(frames(answer))
        pictures = [(h.get("snapshot") or h["reply"], data) for h, data in heads if "snapshot" in h or "reply" in h]
        sizes = [reply["images"][0]["width"] for reply, _ in pictures]
        self.assertEqual((sizes[0], sizes[-1]), (80, 320))
        self.assertIn("reply", heads[-1][0])
        for reply, data in pictures:
            self.assertEqual(len(data), sum(int(image["bytes"]) for image in reply["images"]))
        self.assertEqual(pictures[-1][1], self.call("/v1/render", request)[1])
        relit = list(frames(self.open("/v1/relight/stream", {"render_id": pictures[-1][0]["render_id"], "patch": {"seed": 5}, "mask": ["seed"]})[1]))
        self.assertTrue(any("snapshot" in h for h, _ in relit))
        self.assertIn("reply", relit[-1][0])

    def test_scenes_plans_and_status(self):
        self.assertIn("cornell", self.call("/v1/scenes")[1]["builtin"])
        status, info, _ = self.call("/v1/scenes", {"source": "cornell"})
        self.assertEqual(status, 200)
        self.assertEqual(self.call("/v1/scenes/" + info["id"])[1]["hash"], info["hash"])
        self.assertTrue(self.call("/v1/plan", {"scene": "cornell"})[1]["plan"])
        self.assertEqual(self.call("/v1/scenes", {"source": "cornell", "name": "mine"})[0], 200)
        status, patched, _ = self.call("/v1/scenes/mine/patch", {"materials": {"white": {"base_color": {"x": 0.1, "y": 0.2, "z": 0.7}}}})
        self.assertEqual((status, patched["id"]), (200, "mine"))
        self.assertNotEqual(patched["hash"], info["hash"])
        self.assertIn("none", self.error("/v1/scenes/mine/patch", {"materials": {"none": {"metallic": 1}}})[2])
        self.assertEqual(self.error("/v1/scenes/mine/patch", {"scene": "cornell"})[:2], (400, "INVALID_ARGUMENT"))
        self.assertEqual(self.error("/v1/scenes/nowhere/patch", {})[0], 404)
        self.assertEqual(self.call("/v1/status")[1]["pid"], self.process.pid)

    def test_wrong_input(self):
        self.assertEqual(self.error("/v1/render", {"scene": "nowhere"})[:2], (404, "NOT_FOUND"))
        status, code, message = self.error("/v1/render", {"scene": "cornell", "integrator": {"max_bounces": 900}})
        self.assertEqual((status, code), (400, "INVALID_ARGUMENT"))
        self.assertIn("integrator.max_bounces = 900: must be at most 64", message)
        self.assertEqual(self.error("/v1/render/stream", {"scene": "cornell", "width": 0})[:2], (400, "INVALID_ARGUMENT"))
        for body in (b"", b"{", b'{"scen": 1}', b"\xff\xfe"):
            self.assertEqual(self.error("/v1/render", body, headers=JSON)[:2], (400, "INVALID_ARGUMENT"), body)
        self.assertIn("one picture", self.error("/v1/render", {"scene": "cornell", "outputs": ["beauty", "depth"]})[2])
        self.assertIn("Content-Type", self.error("/v1/render", b"{}", headers={"Content-Type": "text/plain"})[2])
        status, code, message = self.error("/v1/render", b'{"scene": "' + b"a" * (1 << 20) + b'"}')
        self.assertEqual((status, code), (429, "RESOURCE_EXHAUSTED"))
        self.assertIn("limits.request_bytes", message)

    def test_headers_that_no_call_can_carry(self):
        # gRPC ends a process that sends such a value: a token that no token can be is refused, a name for a log is left out.
        picture = {"scene": "cornell", "width": 8, "height": 8, "halt": {"spp": 1}}
        for bad in (b"\xc3\xa9", b"\x01", b"Bearer \xff", b"Bearer a\x7f"):
            for path, body in (("/v1/status", None), ("/v1/render", picture), ("/v1/blobs/" + "0" * 64 + "?bytes=1", b"x"), ("/render", b"x")):
                headers = {} if body is None else JSON if isinstance(body, dict) else {"Content-Type": "application/octet-stream"}
                self.assertEqual(self.open(path, body, headers=headers | {"Authorization": bad})[1].status, 401, (path, bad))
            self.assertEqual(self.call("/v1/status", headers={"X-Request-Id": bad})[0], 200, bad)
            self.assertEqual(self.call("/v1/render", picture, headers=JSON | {"X-Request-Id": bad})[0], 200, bad)

    def test_other_origins_and_names_get_nothing(self):
        body = {"scene": "cornell", "width": 8, "height": 8, "halt": {"spp": 1}}
        own = f"http://127.0.0.1:{self.port}"
        for headers, status in (({"Origin": own}, 200), ({"Origin": "http://evil.example"}, 403), ({"Origin": "null"}, 403), ({"Host": "evil.example"}, 403),
                                ({"Host": f"localhost:{self.port}"}, 200), ({"Host": "render.example", "Origin": "https://render.example"}, 200),
                                ({"Host": f"localhost:{self.port}", "Origin": own}, 403)):
            self.assertEqual(self.open("/v1/render", body, headers=JSON | headers)[1].status, status, headers)
            self.assertEqual(self.open("/v1/scenes", headers=headers)[1].status, status, headers)


class Ends(Door):
    def test_a_closed_connection_frees_the_cores(self):
        for path in ("/v1/render/stream", "/v1/render"):
            connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
            connection.request("POST", path, json.dumps(LONG), JSON)
            if path.endswith("stream"):
                answer = connection.getresponse()
                self.assertIn("snapshot", next(h for h, _ in frames(answer) if "snapshot" in h))
            self.eventually(lambda: self.running() == 1)
            if path.endswith("stream"):
                answer.close()
            connection.close()
            self.eventually(lambda: self.running() == 0, 5)

    def test_the_latest_edit_of_a_session_wins(self):
        ends = {}

        def drag(i):
            request = LONG | {"seed": str(i), "halt": {"spp": 16 if i == 9 else 1 << 18}, "width": 320, "height": 240, "scheduling": {"session": "drag"}}
            answer = self.open("/v1/render/stream", request)[1]
            if answer.status != 200:  # replaced before it had anything to say
                ends[i] = [json.loads(answer.read())["error"]["code"]]
                return
            heads = [h for h, _ in frames(answer) if len(h) > 1 and "progress" not in h]
            ends[i] = [h["error"]["code"] if "error" in h else next(k for k in h if k != "bytes") for h in heads]

        threads = []
        for i in range(10):
            threads.append(threading.Thread(target=drag, args=(i,)))
            threads[-1].start()
            time.sleep(1 if i in (0, 8) else 0.03)  # the first and the last arrive in their order on a loaded machine too
        for t in threads:
            t.join(60)
        self.assertEqual(ends[9][-1], "reply")
        self.assertEqual({ends[i][-1] for i in range(9)}, {"CANCELLED"})
        self.assertIn("snapshot", ends[0], "what runs shows a picture before it gives way")
        self.eventually(lambda: self.running() == 0)

    def test_one_address_has_half_of_the_connections(self):
        def connection():
            made = socket.create_connection(("127.0.0.1", self.port), 10)
            self.addCleanup(made.close)
            return made

        def answered(to):
            """None: still open without an answer; else whether one came."""
            try:
                to.sendall(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
                return bool(to.recv(16))
            except ConnectionError:
                return False

        held = [connection() for _ in range(48)]                     # half of Door::kConnections
        self.assertTrue(all(answered(c) for c in held))              # all are served, and stay open
        self.assertFalse(answered(connection()), "one more of this address is closed")
        held.pop().close()
        self.eventually(lambda: answered(connection()))

    def test_sigterm_with_a_stream_open(self):
        self.assertEqual(self.open("/v1/render/stream", LONG)[1].status, 200)
        self.process.send_signal(signal.SIGTERM)
        time.sleep(0.2)
        self.process.send_signal(signal.SIGTERM)  # at once
        self.process.wait(15)


class Tokens(Door):
    request_bytes = "16MiB"
    config = f'[[tokens]]\nname = "ann"\nsha256 = "{hashlib.sha256(b"ann-token").hexdigest()}"\n'

    def test_calls_need_one_pages_do_not(self):
        self.assertEqual(self.call("/")[0], 200)
        self.assertEqual(self.call("/v1/schema")[0], 200)
        for path, body in (("/v1/scenes", None), ("/v1/scenes/cornell", None), ("/v1/status", None), ("/v1/render", {"scene": "cornell"}),
                           ("/v1/render/stream", {"scene": "cornell"}), ("/v1/plan", {"scene": "cornell"}), ("/v1/scenes", {"source": "cornell"}), ("/v1/scenes/cornell/patch", {}),
                           ("/v1/relight", {"render_id": "r1"}), ("/v1/relight/stream", {"render_id": "r1"})):
            base = {} if body is None else JSON
            self.assertEqual(self.error(path, body, headers=base)[:2], (401, "UNAUTHENTICATED"), path)
            self.assertEqual(self.error(path, body, headers=base | {"Authorization": "Bearer nobodys"})[:2], (401, "UNAUTHENTICATED"), path)
        self.assertEqual(self.call("/v1/scenes", headers={"Authorization": "Bearer ann-token"})[0], 200)
        # Nobody but the door itself may say who calls: a socket's metadata is not looked at.
        self.assertEqual(self.error("/v1/scenes", headers={"x-gobo-http-peer": "unix:"})[0], 401)

    def resident(self):
        with open(f"/proc/{self.process.pid}/status", encoding="ascii") as file:
            return int(re.search(r"VmRSS:\s+(\d+) kB", file.read())[1]) << 10

    def half_sent(self, headers, size, framing=None, source="127.0.0.1"):
        """A connection whose body has come but for its end; that end is to be sent."""
        made = socket.create_connection(("127.0.0.1", self.port), 30, (source, 0))
        self.addCleanup(made.close)
        made.sendall(("POST /v1/plan HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json\r\n" +
                      "".join(f"{k}: {v}\r\n" for k, v in (headers | (framing or {"Content-Length": size + 2})).items()) + "\r\n").encode())
        made.sendall((f"{size + 2:x}\r\n".encode() if framing else b"") + b" " * size)
        return made

    @staticmethod
    def ended(made, end=b"{}"):
        made.sendall(end)
        answer = http.client.HTTPResponse(made)
        answer.begin()
        return answer.status, json.loads(answer.read()), answer.getheader("Retry-After")

    def test_bodies_take_a_bounded_part_of_memory(self):
        ann, size = {"Authorization": "Bearer ann-token"}, 16000000
        plan = {"scene": "cornell", "width": 16, "height": 16}
        self.assertEqual(self.call("/v1/plan", plan, headers=JSON | ann)[0], 200)
        chunked = {"Transfer-Encoding": "chunked", "Content-Length": "10"}
        # Whom nobody knows has nothing kept, whatever he says of its length.
        before = self.resident()
        strangers = [self.half_sent({"Authorization": "Bearer nobodys"} if i % 2 else {}, size, chunked if i % 4 < 2 else None, "127.0.0.2")
                     for i in range(40)]   # an address has half of the connections
        self.assertLess(self.resident() - before, 64 << 20)
        self.assertEqual(self.call("/v1/plan", json.dumps(plan).encode().ljust(size), headers=JSON | ann)[0], 200)
        for i, made in enumerate(strangers[:4]):
            status, body, _ = self.ended(made, b"{}\r\n0\r\n\r\n" if i % 4 < 2 else b"{}")
            self.assertEqual((status, body["error"]["code"]), (401, "UNAUTHENTICATED"))
        for made in strangers:
            made.close()
        # A known caller has half of what all have.
        before = self.resident()
        own = [self.half_sent(ann, size) for _ in range(40)]
        self.assertLess(self.resident() - before, 200 << 20)
        status, body, again = self.ended(own[-1])
        self.assertEqual((status, body["error"]["code"], again), (429, "RESOURCE_EXHAUSTED", "1"))
        self.assertIn("bodies are arriving", body["error"]["message"])
        self.assertEqual(self.call("/v1/plan", plan, headers=JSON | ann)[0], 200, "small ones wait for nobody")
        made = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        self.addCleanup(made.close)
        made.request("POST", "/v1/plan", iter([json.dumps(plan).encode()]), JSON | ann | {"Transfer-Encoding": "chunked"}, encode_chunked=True)
        self.assertEqual(made.getresponse().status, 200, "nor do those of unknown length")
        status, body, _ = self.ended(own[0])
        self.assertNotEqual(status, 429)   # it was kept, and read
        for made in own:
            made.close()
        self.eventually(lambda: self.call("/v1/plan", json.dumps(plan).encode().ljust(size), headers=JSON | ann)[0] == 200)

    def test_a_body_of_a_call_that_takes_none_is_not_kept(self):
        before = self.resident()
        for method, path, status in (("GET", "/v1/schema", 200), ("DELETE", "/v1/scenes", 405)):
            made = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
            self.addCleanup(made.close)
            made.request(method, path, b"x" * (1 << 20))
            self.assertEqual(made.getresponse().status, status)
        self.assertLess(self.resident() - before, 16 << 20)


class Configuration(unittest.TestCase):
    def test_with_certificates_it_is_https(self):
        with tempfile.TemporaryDirectory(prefix="gobo-web-") as folder:
            cert, _ = pair(folder, "localhost")
            config = os.path.join(folder, "gobod.toml")
            with open(config, "w", encoding="utf-8") as file:
                file.write('listen = ["unix:s.sock"]\n[tls]\ncert = "cert.pem"\nkey = "key.pem"\n[web]\nlisten = "127.0.0.1:0"\n')
            with subprocess.Popen([os.environ["GOBO_GOBOD"], "--config", config], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
                try:
                    port = int(re.search(r"https://127\.0\.0\.1:(\d+)", process.stdout.readline().decode())[1])
                    connection = http.client.HTTPSConnection("127.0.0.1", port, timeout=20, context=ssl.create_default_context(cafile=cert))
                    connection.request("GET", "/v1/scenes", headers={"Origin": f"https://127.0.0.1:{port}"})
                    self.assertIn("cornell", json.loads(connection.getresponse().read())["builtin"])
                    connection.close()
                finally:
                    process.kill()

    def test_sighup_renews_the_certificate(self):
        with tempfile.TemporaryDirectory(prefix="gobo-web-") as folder:
            cert, key = pair(folder, "first")
            config = os.path.join(folder, "gobod.toml")
            with open(config, "w", encoding="utf-8") as file:
                file.write('listen = ["unix:s.sock"]\n[tls]\ncert = "cert.pem"\nkey = "key.pem"\n[web]\nlisten = "127.0.0.1:0"\n')
            with subprocess.Popen([os.environ["GOBO_GOBOD"], "--config", config], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
                try:
                    port = int(re.search(r"https://127\.0\.0\.1:(\d+)", process.stdout.readline().decode())[1])

                    def connected():
                        connection = http.client.HTTPSConnection("127.0.0.1", port, timeout=20, context=ssl.create_default_context(cafile=cert))
                        connection.connect()
                        return connection

                    def served():
                        return ssl.get_server_certificate(("127.0.0.1", port), timeout=20)

                    def in_file():
                        with open(cert, encoding="ascii") as file:
                            return file.read()

                    def reloaded():
                        process.send_signal(signal.SIGHUP)
                        return next(line for line in iter(process.stderr.readline, b"") if b"reload" in line)

                    def asked(connection):
                        connection.request("GET", "/v1/schema")
                        answer = connection.getresponse()
                        answer.read()
                        return answer.status, answer.getheader("Connection")

                    def held():
                        return [len(os.listdir(f"/proc/{process.pid}/{kind}")) for kind in ("task", "fd")]

                    self.assertEqual(served(), in_file())
                    before = connected()
                    self.assertEqual(asked(before), (200, None))
                    pair(folder, "second")
                    self.assertIn(b"ok", reloaded())
                    self.assertEqual(served(), in_file())
                    self.assertEqual(asked(before), (200, "close"), "what runs goes on, for one answer")
                    now = connected()
                    self.assertIn(b"ok", reloaded())
                    self.assertEqual(asked(now), (200, None), "nothing new, nothing done")
                    good = in_file()
                    with open(key, "w", encoding="ascii") as file:
                        file.write("no key")
                    self.assertIn(b"failed", reloaded())
                    self.assertEqual(served(), good, "what was refused changes nothing")
                    self.assertEqual(asked(now), (200, None))
                    now.close()
                    counts = held()
                    for i in range(8):
                        pair(folder, f"day {i}")
                        self.assertIn(b"ok", reloaded())
                        self.assertEqual(served(), in_file())
                        time.sleep(0.1)
                    grown = [after - was for after, was in zip(held(), counts)]
                    self.assertLess(grown[0], 4, "listeners that nobody is connected to end")
                    self.assertLess(grown[1], 12)
                    process.terminate()
                    self.assertEqual(process.wait(15), 0)
                finally:
                    process.kill()

    def test_beyond_loopback_it_wants_tls_and_tokens(self):
        with tempfile.TemporaryDirectory(prefix="gobo-web-") as folder:
            for text, said in (('[web]\nlisten = "0.0.0.0:0"\n', "web.listen = \"0.0.0.0:0\": not a loopback address"), ('[web]\nlisten = "unix:x"\n', "must be HOST:PORT"),
                               ('[web]\nlisten = "127.0.0.1"\n', "127.0.0.1"), ('[web]\nhosts = 3\n', "web.hosts")):
                config = os.path.join(folder, "gobod.toml")
                with open(config, "w", encoding="utf-8") as file:
                    file.write(text)
                done = subprocess.run([os.environ["GOBO_GOBOD"], "--config", config, "--check"], capture_output=True, timeout=20, check=False)
                self.assertEqual(done.returncode, 2, text)
                self.assertIn(said, done.stderr.decode())


class View(unittest.TestCase):
    def test_gobo_view_needs_its_own_token(self):
        env = os.environ | {"GOBO_SERVER": ""}
        process = subprocess.Popen([os.environ["GOBO_CLI"], "--local", "view", "cornell"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=env)
        self.addCleanup(process.stdout.close)
        self.addCleanup(process.stderr.close)
        self.addCleanup(process.kill)
        port, token, scene = re.fullmatch(r"http://127\.0\.0\.1:(\d+)/#token=([0-9a-f]{32})&scene=(\w+)\n", process.stdout.readline().decode()).groups()
        self.assertEqual(scene, "cornell")

        def status(token):
            connection = http.client.HTTPConnection("127.0.0.1", int(port), timeout=60)
            self.addCleanup(connection.close)
            connection.request("POST", "/v1/render", json.dumps({"scene": scene, "width": 8, "height": 8, "halt": {"spp": 1}}),
                               JSON | ({"Authorization": "Bearer " + token} if token else {}))
            return connection.getresponse().status

        self.assertEqual([status(token), status(""), status(token[:-1] + "x")], [200, 401, 401])
        process.send_signal(signal.SIGINT)
        self.assertEqual(process.wait(20), 0)

    def test_a_silence_within_a_picture_does_not_change_it(self):
        with tempfile.TemporaryDirectory(prefix="gobo-web-") as folder, open(os.path.join(folder, "log"), "wb") as log:
            env = os.environ | {"GOBO_SERVER": "", "GOBO_CACHE": os.path.join(folder, "cache")}
            daemon = subprocess.Popen([os.environ["GOBO_GOBOD"], "--listen", "127.0.0.1:0", "--threads", "2"], stdout=subprocess.PIPE, stderr=log, env=env)
            self.addCleanup(daemon.stdout.close)
            self.addCleanup(daemon.wait)
            self.addCleanup(daemon.kill)
            relay = Relay(self, int(re.search(r"127\.0\.0\.1:(\d+)", daemon.stdout.readline().decode())[1]))
            view = subprocess.Popen([os.environ["GOBO_CLI"], "--server", f"127.0.0.1:{relay.port}", "view"], stdout=subprocess.PIPE, stderr=log, env=env)
            self.addCleanup(view.stdout.close)
            self.addCleanup(view.wait)
            self.addCleanup(view.kill)
            port, token = re.match(r"http://127\.0\.0\.1:(\d+)/#token=([0-9a-f]{32})", view.stdout.readline().decode()).groups()
            request = {"scene": "cornell", "width": 480, "height": 360, "halt": {"spp": 1}, "encoding": {"format": "RAW_FLOAT"},
                       "scheduling": {"ladder": False}}

            def asked():
                connection = http.client.HTTPConnection("127.0.0.1", int(port), timeout=60)
                self.addCleanup(connection.close)
                connection.request("POST", "/v1/render/stream", json.dumps(request), JSON | {"Authorization": "Bearer " + token})
                return connection.getresponse()

            def picture():
                answer = asked()
                head, data = next((h, d) for h, d in frames(answer) if "reply" in h)
                self.assertEqual(answer.read(), b"")
                self.assertEqual(len(data), head["bytes"])
                return data

            undelayed = picture()
            self.assertEqual(len(undelayed), 480 * 360 * 3 * 4)
            relay.pause = 200 << 10, 6
            begun = time.monotonic()
            self.assertTrue(picture() == undelayed)
            self.assertGreater(time.monotonic() - begun, 6)
            # A way that ends within the picture: its bytes are too few, and nothing comes in their place.
            relay.pause = 400 << 10, 60
            relay.passed = 0
            answer = asked()
            threading.Timer(1, relay.stop).start()
            with self.assertRaises(http.client.IncompleteRead):
                answer.read()
            view.send_signal(signal.SIGINT)
            self.assertEqual(view.wait(20), 0)


class Blobs(Door):
    """Files by their digest: GET says how much is there, POST goes on from there."""
    BYTES = {"Content-Type": "application/octet-stream"}

    def has(self, data, **more):
        connection, answer = self.open(f"/v1/blobs/{hashlib.sha256(data).hexdigest()}?bytes={len(data)}", **more)
        body = json.loads(answer.read())
        connection.close()   # an address may have half of the door's connections
        self.assertEqual(answer.status, 200)
        return int(body.get("received", 0))

    def put(self, data, offset=None, query=None, headers=None):
        address = f"/v1/blobs/{hashlib.sha256(data).hexdigest()}" + (f"?bytes={len(data)}" if query is None else query)
        return self.call(address + ("" if offset is None else f"&offset={offset}"), data[offset or 0:], self.BYTES if headers is None else headers)

    def test_a_file_larger_than_a_message_is_put_and_lights_a_scene(self):
        sky = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 4\n" + bytes([200, 100, 50, 130] * 8)
        large = os.urandom(3 << 20)   # request_bytes is 1 MiB
        for data in (sky, large):
            self.assertEqual(self.has(data), 0)
            status, body, _ = self.put(data)
            self.assertEqual((status, int(body["received"])), (200, len(data)))
            self.assertEqual(self.has(data), len(data))
            self.assertEqual(self.put(data, len(data))[0], 200, "what is there need not be sent")
            self.assertEqual(self.put(data)[0], 200, "but may be")
        picture = {"scene": "cornell", "width": 32, "height": 24, "halt": {"spp": 4}, "encoding": {"format": "RAW_FLOAT"}}
        status, lit, _ = self.call("/v1/render", {**picture, "environment": {"digest": hashlib.sha256(sky).hexdigest()}})
        self.assertEqual(status, 200)
        self.assertNotEqual(lit, self.call("/v1/render", picture)[1])

    def test_a_connection_that_breaks_is_gone_on_with(self):
        data = os.urandom(4 << 20)
        address = f"/v1/blobs/{hashlib.sha256(data).hexdigest()}?bytes={len(data)}"
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        connection.putrequest("POST", address)
        connection.putheader("Content-Type", "application/octet-stream")
        connection.putheader("Content-Length", str(len(data)))
        connection.endheaders()
        connection.send(data[:3 << 20])
        self.eventually(lambda: self.has(data) >= 2 << 20)
        connection.close()
        before = 0

        def settled():
            nonlocal before
            before, was = self.has(data), before
            return before == was and self.put(data, before)[0] == 200
        self.eventually(settled)
        self.assertEqual(self.has(data), len(data))

    @unittest.skipUnless(shutil.which("node"), "node is not installed")
    def test_the_pages_way_to_it_sends_what_is_missing_and_the_second_time_nothing(self):
        for name in ("api.js", "blobs.js"):
            shutil.copy(f"{SOURCE}/clients/viewer/{name}", self.folder)
        with open(os.path.join(self.folder, "package.json"), "w", encoding="utf-8") as file:
            file.write('{"type": "module"}')
        data = os.urandom(300000)
        self.assertEqual(self.put(data, query=f"?bytes={len(data)}", headers=self.BYTES)[0], 200)
        fresh = b"#?RADIANCE" + data
        for name, content in (("there.exr", data), ("fresh.HDR", fresh), ("notes.txt", b"x")):
            with open(os.path.join(self.folder, name), "wb") as file:
                file.write(content)
        script = """
import { readFileSync } from 'node:fs';
import { webcrypto } from 'node:crypto';
globalThis.crypto ??= webcrypto;
globalThis.location = { hash: '', pathname: '/' };
globalThis.sessionStorage = { getItem: () => null };
const real = fetch;
let sent = 0;
globalThis.fetch = (path, options = {}) => { sent += options.body?.byteLength ?? 0; return real('http://127.0.0.1:PORT' + path, options); };
const { acceptMaps } = await import('./blobs.js');
const on = {};
acceptMaps({ addEventListener: (name, f) => { on[name] = f; } }, (digest, name) => console.log(name, digest, sent), (error) => console.log(error.code));
for (const name of ['there.exr', 'fresh.HDR', 'fresh.HDR', 'notes.txt']) {
  const bytes = readFileSync('./' + name);
  const file = { name, arrayBuffer: async () => bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength) };
  sent = 0;
  await on.drop({ dataTransfer: { files: [file] }, preventDefault() {} });
}
""".replace("PORT", str(self.port))
        with open(os.path.join(self.folder, "drop.js"), "w", encoding="utf-8") as file:
            file.write(script)
        done = subprocess.run(["node", "drop.js"], cwd=self.folder, capture_output=True, text=True, timeout=60)
        there, new = hashlib.sha256(data).hexdigest(), hashlib.sha256(fresh).hexdigest()
        self.assertEqual(done.stdout.splitlines(), [f"there.exr {there} 0", f"fresh.HDR {new} {len(fresh)}", f"fresh.HDR {new} 0", "INVALID_ARGUMENT"], done.stderr)

    def test_a_terabyte_is_refused_before_it_is_sent(self):
        with socket.create_connection(("127.0.0.1", self.port), 10) as caller:
            caller.sendall(f"POST /v1/blobs/{'0' * 64}?bytes={1 << 40} HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/octet-stream\r\n"
                           f"Content-Length: {1 << 40}\r\n\r\n".encode())
            answer = http.client.HTTPResponse(caller)
            answer.begin()
            self.assertEqual(answer.status, 429)
            self.assertRegex(json.loads(answer.read())["error"]["message"], r"^bytes = 1099511627776: uploads are limited to \d+ bytes \(limits\.")

    def test_what_is_refused(self):
        data = b"some bytes"
        address = f"/v1/blobs/{hashlib.sha256(data).hexdigest()}?bytes=10"
        self.assertEqual(self.error(address, data, JSON)[:2], (400, "INVALID_ARGUMENT"))
        self.assertEqual(self.error(address, data, {**self.BYTES, "Origin": "http://evil.example"})[:2], (403, "PERMISSION_DENIED"))
        for query, word in (("", "bytes"), ("?bytes=ten", "bytes"), ("?bytes=-1", "bytes"), ("?bytes=10&offset=x", "offset"), ("?bytes=10&offset=5", "put.offset = 5"),
                            ("?bytes=9", "put.blob.bytes = 9"), ("?bytes=0", "put.blob.bytes = 0"), ("?bytes=11", "10 of put.blob.bytes = 11")):
            status, body, _ = self.put(data, query=query)
            self.assertEqual((status, body["error"]["code"] in ("INVALID_ARGUMENT", "OUT_OF_RANGE")), (400, True), query)
            self.assertIn(word, body["error"]["message"], query)
        for query, word in (("?bytes=10&ofset=5", "'ofset' is not known here; did you mean 'offset'?"), ("?bytes=10&bytes=10", "'bytes' stands in it twice")):
            self.assertIn(word, self.put(data, query=query)[1]["error"]["message"])
        for path in ("/v1/render?spp=3", "/v1/plan?x", "/v1/scenes?source=cornell"):
            status, code, message = self.error(path, {"scene": "cornell"})
            self.assertEqual((status, code), (400, "INVALID_ARGUMENT"))
            self.assertIn("is not known here, which takes none", message)
        self.assertEqual(self.error("/v1/blobs/12?bytes=10")[:2], (400, "INVALID_ARGUMENT"))
        self.assertEqual(self.error(address.split("?")[0])[:2], (400, "INVALID_ARGUMENT"))
        status, body, _ = self.call(address, b"Some bytes", self.BYTES)
        self.assertEqual(status, 400)
        self.assertIn("sha256", body["error"]["message"])
        self.assertEqual(self.put(data)[0], 200)


if __name__ == "__main__":
    unittest.main()
