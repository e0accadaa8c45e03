# SPDX-License-Identifier: Apache-2.0
"""Rendering through a real gobod: the same bits as the CLI's files, relights, snapshots, cancellation, deadlines, threads."""
import json
import os
import subprocess
import sys
import threading
import time
import unittest

import numpy as np

import gobo
from support import SMALL, DaemonTest

CLI_SMALL = ["--size", "32x24", "--spp", "16", "--set", "integrator.max_bounces=2"]


class Render(DaemonTest):
    def test_plan_says_what_a_render_does(self):
        fields = dict(size=(40, 24), spp=16, set={"integrator.max_bounces": 1})
        before = self.client.plan("cornell", **fields)
        self.assertTrue(before.rays > 0 and before.ms > 0 and before.pinned_bytes > 0)
        self.assertEqual(before.resolved.halt.spp, 16)
        done = self.client.render("cornell", **fields)
        self.assertEqual([n.node for n in before.plan], [n.node for n in done.plan])
        self.assertEqual(self.client.plan("cornell", **fields).rays, 0, "all of it is there now")

    def test_same_bits_as_the_files_of_the_cli(self):
        r = self.client.render("cornell", outputs=["beauty", "depth"], **SMALL)
        self.assertEqual((r.image.dtype, r.image.shape, r.image.flags.c_contiguous), (np.float32, (24, 32, 3), True))
        self.assertEqual(list(r.outputs), ["beauty", "depth"])
        self.assertGreater(r.image.mean(), 0.01)
        self.cli("render", "cornell", *CLI_SMALL, "-o", "a.raw")
        with open(self.path("a.raw"), "rb") as file:
            self.assertEqual(file.read(), r.image.tobytes())
        self.cli("render", "cornell", *CLI_SMALL, "-o", "a.exr")
        np.testing.assert_array_equal(gobo.exr.read_image(self.path("a.exr")), r.image)

    def test_formulas_and_style_sheets(self):
        typed = self.client.render("cornell", **SMALL, lights={"light": {"intensity": 3.5}}, time_s=0.5)
        for said in ({"lights.light.intensity": "2 + 3*time"}, {"lights.light.intensity": {"formula": "7*time"}}, {"lights.light.intensity": 3.5}):
            r = self.client.render("cornell", **SMALL, expressions=said, time_s=0.5)
            self.assertEqual((r.request_hash, r.image.tobytes()), (typed.request_hash, typed.image.tobytes()), said)
        sheet = self.path("style.json")
        with open(sheet, "w") as f:
            f.write('{"shadows": {"style": {"softness": 0.2, "pattern": "stippling"}}, "expressions": {"shadows.style.brightness": "0.1*distance"}}')
        a = self.client.render("cornell", **SMALL, style=sheet)
        b = self.client.render("cornell", **SMALL, shadows={"style": {"softness": 0.2, "pattern": "stippling"}}, set={"expressions.shadows.style.brightness": "0.1*distance"})
        self.assertEqual(a.request_hash, b.request_hash)
        self.assertTrue(any(n.node == "style_pattern:light" for n in a.plan))
        again = self.client.relight(a, shadows={"style": {"softness": 0.3}})
        self.assertNotEqual(again.image.tobytes(), a.image.tobytes())
        with open(sheet, "w") as f:
            f.write('{"lights": {"light": {"gain": 2}}}')
        for bad in (sheet, self.path("nosuch.json")):
            with self.assertRaises(gobo.InvalidArgument):
                self.client.render("cornell", **SMALL, style=bad)
        with self.assertRaisesRegex(gobo.InvalidArgument, "did you mean 'distance'"):
            self.client.render("cornell", **SMALL, expressions={"shadows.style.softness": "distanc"})

    def test_every_way_to_write_a_request_is_the_same_request(self):
        want = self.client.render("cornell", **SMALL, shadows={"axis_aligned": {"k": 2}}, lights={"light": {"gain": (2, 2, 2)}}).request_hash
        message = gobo.RenderRequest(scene="cornell", width=32, height=24)
        message.halt.spp = 16
        message.integrator.max_bounces = 2
        message.shadows.axis_aligned.k = 2
        message.lights["light"].gain.x = message.lights["light"].gain.y = message.lights["light"].gain.z = 2
        ways = [
            dict(size=(32, 24), spp=16, integrator__max_bounces=2, shadows__axis_aligned__k=2, lights={"light": 2}),
            dict(set={"width": 32, "height": 24, "halt.spp": 16, "integrator.max_bounces": 2, "shadows.axis_aligned.k": 2.0, "lights.light.gain": 2}),
            dict(request={"width": 32, "height": 24, "halt": {"spp": 16}, "integrator": {"maxBounces": 2}, "shadows": {"axisAligned": {"k": 2}},
                          "lights": {"light": {"gain": {"x": 2, "y": 2, "z": 2}}}}),
            dict(request=message),
            dict(request=dict(width=1, height=24, seed="0"), width=np.int64(32), spp=np.float64(16), integrator={"max_bounces": 2},
                 shadows={"axis_aligned": {"k": 2}}, lights={"light": np.array([2, 2, 2])}),
        ]
        for way in ways:
            with self.subTest(way=way):
                self.assertEqual(self.client.render("cornell", **way).request_hash, want)

    def test_the_resolved_request_gives_the_same_bits_and_is_json(self):
        r = self.client.render("cornell", **SMALL)
        again = json.loads(json.dumps(r.resolved_dict()))
        np.testing.assert_array_equal(self.client.render(request=again).image, r.image)
        np.testing.assert_array_equal(self.client.render(request=r.resolved).image, r.image)

    def test_relight_scales_what_it_should_and_traces_nothing(self):
        r = self.client.render("cornell", **SMALL)
        double = r.relight(lights={"light": {"gain": 2}})
        self.assertEqual(double.rays, 0)
        np.testing.assert_allclose(double.image, 2 * r.image, rtol=1e-6)
        np.testing.assert_array_equal(double.relight(lights={"light": None}).image, r.image)
        np.testing.assert_array_equal(r.relight(lights={"light": False}).image, np.zeros_like(r.image))
        cold = self.client.render("cornell", **SMALL, lights={"light": {"gain": 2}})
        np.testing.assert_array_equal(cold.image, double.image)
        for fields in ({"encoding": {"format": "png"}}, {"encoding__format": "png"}, {"format": "png"}, {"request": {"encoding": {"format": "PNG"}}}):
            self.assertTrue(r.relight(**fields).encoded["beauty"].startswith(b"\x89PNG"), fields)
        half = r.relight(encoding={"half": False})   # whatever else is said of it, an array comes
        np.testing.assert_array_equal(half.image, r.image)

    def test_relight_replaces_the_environment_as_a_whole(self):
        r = self.client.render("spheres", **SMALL, env={"constant": 0.5, "gain": 3})
        plain = r.relight(env=0.5)
        np.testing.assert_array_equal(plain.image, self.client.render("spheres", **SMALL, env=(0.5, 0.5, 0.5)).image)
        self.assertFalse(np.array_equal(plain.image, r.image))
        turned = r.relight(set={"environment.rotation_deg": 90})
        self.assertEqual(turned.resolved.environment.gain.x, 3)

    def test_snapshots_refine_and_end_in_the_picture(self):
        want = self.client.render("cornell", **{**SMALL, "spp": 128, "seed": 5}).image
        self.client.drop_caches()
        seen = list(self.client.render_progressive("cornell", **{**SMALL, "spp": 128, "seed": 5}))
        self.assertEqual([s.final for s in seen], [False] * (len(seen) - 1) + [True])
        self.assertEqual([s.samples for s in seen], sorted({s.samples for s in seen}))
        self.assertEqual(seen[-1].samples, 128)
        np.testing.assert_array_equal(seen[-1].image, want)
        if len(seen) > 1:
            first = self.client.render("cornell", **{**SMALL, "spp": seen[0].samples, "seed": 5}).image
            np.testing.assert_array_equal(seen[0].image, first)

    def test_progress_is_reported(self):
        news = []
        r = self.client.render("cornell", on_progress=news.append, width=128, height=96, spp=256, seed=9)
        self.assertTrue(news)
        self.assertTrue(all(0 <= p.fraction <= 1 for p in news))
        np.testing.assert_array_equal(r.image, self.client.render("cornell", width=128, height=96, spp=256, seed=9).image)

    def idle(self, seconds=5.0):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            status = self.client.status()
            if status.running == 0 and status.queued == 0:
                return True
            time.sleep(0.02)
        return False

    def test_leaving_the_loop_stops_the_render(self):
        forever = dict(width=320, height=240, spp=1 << 20)
        with self.client.render_progressive("cornell", **forever) as snapshots:
            self.assertFalse(next(snapshots).final)
            self.assertEqual(self.client.status().running, 1)
        self.assertTrue(self.idle())
        for snapshot in self.client.render_progressive("cornell", **forever, seed=1):
            break
        del snapshot
        self.assertTrue(self.idle())

    def test_an_interrupt_stops_the_render(self):
        code = ("import gobo, os, signal, threading, sys\n"
                "c = gobo.connect(sys.argv[1])\n"
                "threading.Timer(0.7, lambda: os.kill(os.getpid(), signal.SIGINT)).start()\n"
                "try:\n    c.render('cornell', width=320, height=240, spp=1 << 20, seed=3)\n"
                "except KeyboardInterrupt:\n    print('interrupted'); sys.exit(9)\n")
        done = subprocess.run([sys.executable, "-c", code, self.client.address], capture_output=True, text=True, timeout=60)
        self.assertEqual((done.returncode, done.stdout), (9, "interrupted\n"), done.stderr)
        self.assertTrue(self.idle())

    def test_the_deadline_counts(self):
        begun = time.monotonic()
        with self.assertRaises(gobo.DeadlineExceeded) as caught:
            self.client.render("cornell", width=320, height=240, spp=1 << 20, seed=4, timeout=0.4)
        self.assertLess(time.monotonic() - begun, 10)
        self.assertIsInstance(caught.exception, TimeoutError)
        self.assertTrue(self.idle())

    def test_threads_share_a_client(self):
        want = [self.client.render("cornell", **SMALL, seed=s).image for s in range(6)]
        self.client.drop_caches()
        got = [None] * 6

        def work(seed):
            got[seed] = self.client.render("cornell", **SMALL, seed=seed).image
        threads = [threading.Thread(target=work, args=(s,)) for s in range(6)]
        for t in threads:
            t.start()
        for t in threads:
            t.join()
        for a, b in zip(got, want):
            np.testing.assert_array_equal(a, b)

    def test_certificate_and_plan(self):
        r = self.client.render("cornell", **SMALL, certificate=0.1)
        self.assertTrue(0 <= r.certificate.rmse_low <= r.certificate.rmse <= r.certificate.rmse_high)
        self.assertGreater(r.certificate.pixels, 0)
        self.assertIsNone(self.client.render("cornell", **SMALL).certificate)
        self.assertIn("beauty", [n.node for n in r.plan])
        self.assertEqual(self.client.render("cornell", **SMALL).ran(), [])

    def test_save(self):
        r = self.client.render("cornell", outputs=["beauty", "normal", "depth"], **SMALL)
        planes, header = gobo.exr.read(r.save(self.path("all.exr")))
        np.testing.assert_array_equal(np.stack([planes[c] for c in "RGB"], 2), r.image)
        np.testing.assert_array_equal(gobo.exr.read_image(self.path("all.exr"), "normal").ravel().sum(), r.outputs["normal"].ravel().sum())
        self.assertEqual(json.loads(header["gobo:request"])["scene"], "cornell")
        np.testing.assert_array_equal(np.load(r.save(self.path("b.npy"), "depth")), r.outputs["depth"])
        np.testing.assert_array_equal(np.load(r.save(self.path("b.npz")))["normal"], r.outputs["normal"])
        self.cli("render", "cornell", *CLI_SMALL, "-o", "c.png")
        with open(r.save(self.path("d.png")), "rb") as mine, open(self.path("c.png"), "rb") as theirs:
            self.assertEqual(mine.read(), theirs.read())
        for name in ("g.npy", "g.exr", "g.png"):
            with self.assertRaises(FileNotFoundError) as caught:
                r.save(self.path("none", name), "depth" if name == "g.npy" else "beauty")
            self.assertEqual(caught.exception.filename, self.path("none", name))
        with self.assertRaises(gobo.InvalidArgument):
            r.save(self.path("e.tiff"))
        with self.assertRaises(gobo.InvalidArgument):
            r.save(self.path("e.exr"), "albedo")
        np.testing.assert_array_equal(np.load(r.save(self.path("B.NPY"), "depth")), r.outputs["depth"])
        np.testing.assert_array_equal(np.load(r.save(self.path("B.NPZ")))["normal"], r.outputs["normal"])
        self.assertNotIn("B.NPY.npy", os.listdir(self.folder))
        # In a file format: the bytes as they are, under no other's name.
        for form, fitting, others in (("png", ("f.png", "F.PNG"), ("f.exr", "f.jpg", "f.npz", "f")), ("jpeg", ("f.jpg", "f.jpeg"), ("f.png",)),
                                      ("exr", ("f.exr",), ("f.png", "f.raw"))):
            two = self.client.render("cornell", **SMALL, outputs="beauty,albedo", format=form)
            for name in fitting:
                with open(two.save(self.path(name), "albedo"), "rb") as file:
                    self.assertEqual(file.read(), two.encoded["albedo"])
                with self.assertRaisesRegex(gobo.InvalidArgument, "beauty, albedo is a file of its own.*output="):
                    two.save(self.path(name))
            for name in others:
                with self.assertRaisesRegex(gobo.InvalidArgument, f"{name}: beauty was asked for as {form.upper()}"):
                    two.save(self.path("none", name), "beauty")
        layered = self.client.render("cornell", **SMALL, outputs="beauty,albedo", format="exr", encoding={"layers": True})
        planes, _ = gobo.exr.read(layered.save(self.path("layers.exr")))
        self.assertTrue({"R", "albedo.R"} <= set(planes), "one file can hold all")
        self.assertEqual([n for n in os.listdir(self.folder) if n.startswith(".gobo")], [])

    def test_the_exr_is_read_by_others(self):
        r = self.client.render("cornell", **SMALL)
        r.save(self.path("mine.exr"))
        self.cli("render", "cornell", *CLI_SMALL, "-o", "theirs.exr")
        report = json.loads(self.cli("compare", "mine.exr", "theirs.exr", "--json").stdout)
        self.assertEqual(report["rmse"], 0)

    def test_encoded_formats(self):
        r = self.client.render("cornell", **SMALL, format="png")
        self.assertTrue(r.encoded["beauty"].startswith(b"\x89PNG"))
        with self.assertRaises(gobo.FailedPrecondition):
            r.image
        half = self.client.render("cornell", **SMALL, format="raw_half").image
        full = self.client.render("cornell", **SMALL).image
        np.testing.assert_array_equal(half, full.astype(np.float16).astype(np.float32))


class Life(unittest.TestCase):
    def test_a_private_daemon_ends_with_its_client(self):
        client = gobo.local(threads=1)
        pid, folder = client.status().pid, os.path.dirname(client.address[len("unix:"):])
        self.assertEqual(os.stat(client.address[len("unix:"):]).st_mode & 0o777, 0o600)
        client.close()
        client.close()
        self.assertFalse(os.path.exists(folder))
        with self.assertRaises(ProcessLookupError):
            os.kill(pid, 0)
        with self.assertRaises(gobo.Cancelled):
            client.render("cornell")

    def test_a_private_daemon_ends_with_a_killed_process(self):
        code = "import gobo, os, signal\nc = gobo.local(threads=1)\nprint(c.status().pid, flush=True)\nos.kill(os.getpid(), signal.SIGKILL)\n"
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
        pid = int(done.stdout)
        end = time.monotonic() + 20
        while time.monotonic() < end and os.path.exists(f"/proc/{pid}"):
            with open(f"/proc/{pid}/stat", encoding="ascii") as stat:
                if stat.read().split()[2] == "Z":   # nobody reaps orphans in this container
                    break
            time.sleep(0.05)
        else:
            self.assertFalse(os.path.exists(f"/proc/{pid}"))

    def test_a_forked_child_leaves_the_daemon_alone(self):
        code = ("import gobo, os, sys, time\n"
                "c = gobo.local(threads=1)\n"
                "folder = c._daemon.folder\n"
                "c.status()\n"
                "child = os.fork()\n"
                "if child == 0:\n    sys.exit(0)\n"
                "os.waitpid(child, 0)\n"
                "assert os.path.exists(folder)\n"
                "gobo.connect(c.address, timeout=20).close()\n"
                "child = os.fork()\n"   # holds the guard's pipe, too
                "if child == 0:\n    time.sleep(120)\n    os._exit(0)\n"
                "begun = time.monotonic()\n"
                "c.close()\n"
                "assert time.monotonic() - begun < 30 and not os.path.exists(folder)\n"
                "os.kill(child, 9)\n")
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=110)
        self.assertEqual(done.returncode, 0, done.stderr)

    def test_a_daemon_that_cannot_start_says_why(self):
        with self.assertRaisesRegex(gobo.Unavailable, "nonesuch.toml"):
            gobo.local(config="/nonesuch.toml")
        with self.assertRaises(gobo.NotFound):
            os.environ["GOBO_GOBOD"] = "/nonesuch"
            gobo.local()

    def setUp(self):
        self.addCleanup(os.environ.__setitem__, "GOBO_GOBOD", os.environ["GOBO_GOBOD"])


if __name__ == "__main__":
    unittest.main()
