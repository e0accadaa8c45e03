# SPDX-License-Identifier: Apache-2.0
"""gobo precompute: what it says, that later renders under any map trace nothing of it, and what a kill -9 in the middle of it loses."""
import json
import math
import os
import signal
import subprocess
import tempfile
import threading
import time
import unittest

import numpy as np

import gobo
from support import CLI, DaemonTest

SMALL = ["--points", "400", "--bands", "3", "--samples", "128", "--bounces", "2"]
TRANSFER = {"environment.transfer.points": 400, "environment.transfer.bands": 3, "environment.transfer.samples": 128, "environment.transfer.bounces": 2}


def is_transfer(name):
    """What knows neither the map nor the picture."""
    return name in ("transfer points", "transfer:direct", "transfer:albedo") or name.startswith("transfer:bounce ")


class Precompute(DaemonTest):
    def test_later_renders_trace_nothing_of_it(self):
        said = json.loads(self.cli("--json", "precompute", "cornell", *SMALL).stdout)
        self.assertEqual((said["bands"], said["samples"], said["bounces"]), (3, 128, 2))
        self.assertEqual((said["terms"], said["termsMade"], said["termsLost"]), (6, 6, 0))   # points, two blocks, albedo, two bounces
        n = said["points"]
        self.assertTrue(10 < n <= 400, n)
        self.assertEqual(said["rays"], n * (32 + 128 + 2 * 64))
        self.assertAlmostEqual(said["raysPerSecond"], said["rays"] / said["ms"] * 1e3, delta=1e-6 * said["raysPerSecond"])
        self.assertGreater(said["bytes"], n * 4 * (9 * 2 + 2 * 2 * 27))   # two blocks; last and sum of two bounces, in three colours
        for k, sky in enumerate([{"environment.sky.turbidity": 4}, {"environment.constant": [0.2, 0.5, 1]}]):
            result = self.client.render("cornell", size=(24 + 8 * k, 16), spp=1, set={**TRANSFER, **sky})
            rows = [row for row in result.plan if is_transfer(row.node)]
            self.assertEqual(len(rows), 6)
            self.assertEqual([row for row in rows if row.state not in ("reused", "not_needed") or row.rays], [])
        again = json.loads(self.cli("--json", "precompute", "cornell", *SMALL).stdout)
        self.assertEqual((again["termsMade"], again["rays"], again["points"]), (0, 0, n))
        more = json.loads(self.cli("--json", "precompute", "cornell", *SMALL[:-1], "3").stdout)   # one bounce goes on from the others
        self.assertEqual((more["terms"], more["termsMade"], more["rays"]), (7, 1, n * 64))

    def test_what_it_prints(self):
        long = [*SMALL[:4], "--samples", "16384", *SMALL[6:]]   # a second or so: progress is told now and then
        done = self.cli("precompute", "lights8", *long, "--progressive")
        self.assertRegex(done.stdout, r"lights8: transfer of \d+ points in 3 bands, 16384 directions and 2 bounces: [\d.]+ [KM]iB in 260 terms\n"
                                      r"260 of them were made, in [\d.]+ s: \d+ rays, [\d.]+ million a second")
        self.assertRegex(done.stderr, r"(?m)^ *\d+ %  (direct light|bounce) \d of 2  [\d.]+ s")
        self.assertIn("all of it was there", self.cli("precompute", "lights8", *long).stdout)
        self.assertEqual(self.cli("precompute", "lights8", *long, "-q").stdout, "")

    def test_wrong_values(self):
        for bad in (["--bands", "1"], ["--bands", "11"], ["--bounces", "17"], ["--samples", "63"], ["--points", "99"], ["--points", "many"], []):
            what = ["cornell"] if bad else []
            self.cli("precompute", *what, *bad, code=2)
        self.assertIn("nonesuch", self.cli("precompute", "cornell", "--set", "nonesuch=1", code=2).stderr)
        self.cli("precompute", "no such scene", code=3)
        self.assertIn("--cache", self.cli("--local", "precompute", "cornell", *SMALL, code=2).stderr)

    def test_no_bounces(self):
        said = json.loads(self.cli("--json", "precompute", "cornell", *SMALL[:-1], "0").stdout)
        self.assertEqual((said["terms"], said["bounces"]), (3, 0))

    def test_nothing_receives(self):
        path = self.path("empty.gltf")
        with open(path, "w", encoding="utf-8") as file:
            json.dump({"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"camera": 0}],
                       "cameras": [{"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1}}]}, file)
        self.assertIn("nothing in", self.cli("precompute", path, *SMALL, code=2).stderr)

    def test_it_can_be_cut_off(self):
        self.assertIn("deadline", self.cli("precompute", "cornell", "--samples", "16384", "--deadline", "300", code=5).stderr)
        env = {**os.environ, "GOBO_SERVER": self.client.address}
        running = subprocess.Popen([CLI, "precompute", "cornell", "--samples", "16384", "-q"], env=env, stderr=subprocess.PIPE, text=True)
        self.addCleanup(running.stderr.close)
        self.addCleanup(running.kill)
        while self.client.status().running == 0:
            self.assertIsNone(running.poll())
            time.sleep(0.01)
        running.send_signal(signal.SIGINT)
        self.assertEqual(running.wait(30), 5)
        while self.client.status().running:
            time.sleep(0.01)

    def test_local_keeps_on_disk(self):
        what = ["--json", "--local", "--cache", self.path("local"), "precompute", "cornell", "--points", "2000", "--bands", "2", "--samples", "128", "--bounces", "1"]
        first = json.loads(self.cli(*what).stdout)
        self.assertEqual(first["termsMade"], 5)
        second = json.loads(self.cli(*what).stdout)
        self.assertLess(second["rays"], first["rays"] / 2)


def files_of(folder, kind):
    """Term files of one kind of node: the kind stands in their heads (docs/term_file.md)."""
    found = 0
    for at, _, names in os.walk(folder):
        for name in names:
            if not name.endswith(".term"):
                continue
            try:
                with open(os.path.join(at, name), "rb") as file:
                    found += kind.encode() in file.read(512)
            except FileNotFoundError:
                pass
    return found


class Killed(unittest.TestCase):
    """Blocks are on disk before the next begins: a kill -9 loses the one that is being made."""

    BLOCKS = 24
    WHAT = {"points": 12000, "bands": 3, "samples": 64 * BLOCKS, "bounces": 1, "lights": 0}

    def render(self, client, **more):
        fields = {f"environment.transfer.{k}": v for k, v in self.WHAT.items()}
        return client.render("cornell", size=(16, 12), spp=1, outputs=["direct_diffuse", "indirect_diffuse"], timeout=300,
                             set={**fields, "environment.constant": [1, 1, 1]}, **more)

    def test_finished_blocks_are_there_afterwards(self):
        with tempfile.TemporaryDirectory(prefix="gobo-killed-") as folder:
            cache = os.path.join(folder, "cache")
            client = gobo.local(threads=2, cache=cache)
            self.addCleanup(client.close)
            begun = [0]

            def progress(p):
                if p.stage == "transfer:direct":   # goes on from block to block
                    begun[0] = max(begun[0], math.floor(p.fraction * self.BLOCKS + 1e-6))

            def work():
                try:
                    self.render(client, on_progress=progress)
                    failed.append("it came to its end")
                except gobo.Error:
                    pass

            failed = []
            worker = threading.Thread(target=work)
            worker.start()
            while files_of(cache, "direct_transfer") < 4 and worker.is_alive():
                time.sleep(0.002)
            os.kill(client.status().pid, signal.SIGKILL)
            on_disk, finished = files_of(cache, "direct_transfer"), begun[0]
            worker.join(60)
            self.assertEqual(failed, [])
            self.assertGreaterEqual(on_disk, 4)
            self.assertGreaterEqual(on_disk, finished - 1)
            with gobo.local(threads=2, cache=cache) as after:
                result = self.render(after)
            rows = [row for row in result.plan if row.node == "transfer:direct"]
            there = [row for row in rows if row.state in ("reused", "not_needed")]
            self.assertEqual(len(rows), self.BLOCKS)
            self.assertEqual(len(there), on_disk)
            self.assertEqual([row.reason for row in rows if row.state == "reused"], ["disk"])
            self.assertGreaterEqual(len(there), finished - 1)
            with gobo.local(threads=2) as fresh:
                undisturbed = self.render(fresh)
            for name, picture in undisturbed.outputs.items():
                self.assertTrue(np.array_equal(picture, result.outputs[name]), name)


if __name__ == "__main__":
    unittest.main()
