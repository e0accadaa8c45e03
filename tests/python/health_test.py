# SPDX-License-Identifier: Apache-2.0
"""/ready, /health and the gRPC health service are what docs/operations.md says, from the first line of a daemon until it has gone."""
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
import urllib.error
import urllib.request

import grpc

import gobo
from support import SOURCE

SERVICES = ("", "gobo.v1.Scenes", "gobo.v1.Render", "gobo.v1.Admin", "gobo.v1.Jobs")
SERVING, NOT_SERVING = 1, 2


class Health(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.mkdtemp(prefix="gobo-health-")
        self.addCleanup(shutil.rmtree, self.folder, ignore_errors=True)
        config = os.path.join(self.folder, "gobod.toml")
        with open(config, "w", encoding="utf-8") as file:
            file.write('listen = ["unix:s.sock"]\n[http]\nlisten = "127.0.0.1:0"\n[engine]\nthreads = 2\n[scheduler]\nqueued_normal = 2\ndrain_s = 20\n')
        with open(os.path.join(self.folder, "log"), "wb") as log:
            self.process = subprocess.Popen([os.environ["GOBO_GOBOD"], "--config", config], stdout=subprocess.PIPE, stderr=log)
        self.addCleanup(self.process.stdout.close)
        self.addCleanup(self.process.wait)
        self.addCleanup(self.process.kill)
        line = self.process.stdout.readline().decode()
        self.port = int(re.search(r"http://127\.0\.0\.1:(\d+)", line)[1])
        self.address = f"unix:{self.folder}/s.sock"
        # From that line on everything answers: no pause, no repetition.
        self.assertEqual(self.get("/ready")[:2], (200, "ready\n"))
        self.client = gobo.connect(self.address, timeout=60, retries=0)
        self.addCleanup(self.client.close)

    def get(self, path, timeout=1.0):
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{self.port}{path}", timeout=timeout) as answer:
                return answer.status, answer.read().decode(), answer.headers["Content-Type"]
        except urllib.error.HTTPError as e:
            with e:
                return e.code, e.read().decode(), e.headers["Content-Type"]

    def health(self, service):
        """grpc.health.v1.Health/Check by hand: its messages are in no package that the client needs."""
        name = service.encode()
        with grpc.insecure_channel(self.address) as channel:
            return channel.unary_unary("/grpc.health.v1.Health/Check")(b"\x0a" + bytes([len(name)]) + name if name else b"", timeout=5)[1]

    def long_render(self):
        """A render that runs until it is cancelled; the function that does."""
        snapshots = self.client.render_progressive("cornell", width=320, height=240, spp=1 << 18, seed=time.monotonic_ns() % 1000000, priority="normal")
        next(snapshots)
        return snapshots.close

    def test_what_the_manual_names_is_there(self):
        with open(os.path.join(SOURCE, "docs", "operations.md"), encoding="utf-8") as file:
            said = re.search(r"^- `/health`: JSON with (.*?); 503 while draining\.", file.read(), re.M | re.S)[1]
        named = re.findall(r"`(\w+)`", said)
        self.assertGreater(len(named), 6)
        status, body, kind = self.get("/health")
        report = json.loads(body)
        self.assertEqual((status, kind, report["status"]), (200, "application/json", "serving"))
        for key in named:
            self.assertIn(key, report)
        self.assertEqual((report["ready_workers"], report["total_workers"], len(report["workers"])), (1, 1, 1))
        self.assertEqual(set(report["queues"]), {"interactive", "normal", "batch"})
        self.assertGreater(report["rss_bytes"], 1 << 20)
        for service in SERVICES:
            self.assertEqual(self.health(service), SERVING, service)

    def test_a_busy_daemon_is_ready(self):
        """/ready says whether to send work to this daemon at all, not whether it has some: a full queue is no reason to restart it."""
        stop = self.long_render()
        others = [threading.Thread(target=self._refused_or_late, daemon=True) for _ in range(6)]
        for t in others:
            t.start()
        end = time.monotonic() + 20
        while json.loads(self.get("/health")[1])["queues"]["normal"]["queued"] < 2 and time.monotonic() < end:
            time.sleep(0.02)
        report = json.loads(self.get("/health")[1])
        self.assertEqual(report["queues"]["normal"], {"queued": 2, "running": 1})
        self.assertEqual([w["state"] for w in report["workers"]], ["busy"])
        self.assertEqual(self.get("/ready")[0], 200)
        self.assertEqual(self.health(""), SERVING)
        stop()
        for t in others:
            t.join(30)

    def _refused_or_late(self):
        try:
            with gobo.connect(self.address, retries=0) as client:
                client.render("cornell", width=320, height=240, spp=1 << 18, timeout=3)
        except gobo.Error:
            pass

    def test_a_drain_is_seen_before_anything_stops(self):
        stop = self.long_render()
        self.process.send_signal(signal.SIGTERM)
        end = time.monotonic() + 5
        while self.get("/ready")[0] == 200 and time.monotonic() < end:
            time.sleep(0.01)
        # The render goes on, and so do the answers.
        for _ in range(10):
            self.assertEqual(self.get("/ready")[:2], (503, "draining\n"))
            status, body, _ = self.get("/health")
            report = json.loads(body)
            self.assertEqual((status, report["status"], report["ready_workers"], report["total_workers"]), (503, "draining", 0, 1))
            self.assertEqual(report["queues"]["normal"]["running"], 1)
            for service in SERVICES:
                self.assertEqual(self.health(service), NOT_SERVING, service)
            time.sleep(0.05)
        self.assertIn("\ngobo_draining 1\n", self.get("/metrics")[1])
        with self.assertRaises(gobo.Unavailable) as refused:
            self.client.render("cornell", width=8, height=8, spp=1)
        self.assertIn("retry after", str(refused.exception))
        self.assertIsNone(self.process.poll())
        stop()
        self.assertEqual(self.process.wait(10), 0)
        with self.assertRaises(OSError):
            socket.create_connection(("127.0.0.1", self.port), 1)

    def test_nothing_else_is_there(self):
        self.assertEqual(self.get("/")[0], 404)
        self.assertEqual(self.get("/ready/")[0], 404)
        self.assertEqual(self.get("/../etc/passwd")[0], 404)


if __name__ == "__main__":
    unittest.main()
