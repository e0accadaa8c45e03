# SPDX-License-Identifier: Apache-2.0
"""Sessions: the latest edit wins, every picture shows one edit whole, wrong edits do no harm, and nothing runs on after the end."""
import random
import threading
import time
import unittest

import grpc
import numpy as np

import gobo
from gobo.v1 import render_pb2
from support import SMALL, DaemonTest, Liar, events

FOREVER = dict(width=320, height=240, spp=1 << 20)


class Gate:
    """A RenderProgressive whose pictures come when a test lets them; remembers requests in order, and which calls ended early."""

    def __init__(self):
        self.requests, self.ended = [], []
        self.let = threading.Semaphore(0)
        self.came = threading.Semaphore(0)

    def __call__(self, request, context):
        number = len(self.requests)
        self.requests.append(request)
        context.add_callback(lambda: self.ended.append(number))
        self.came.release()
        picture = list(events(values=[float(request.seed)] * 6))
        for final in (False, True):
            while not self.let.acquire(timeout=0.02):
                if not context.is_active():
                    return
            yield picture[0] if final else render_pb2.RenderEvent(snapshot=picture[0].reply)
            yield from picture[1:]


class Order(unittest.TestCase):
    def setUp(self):
        self.gate = Gate()
        self.liar = Liar(RenderProgressive=self.gate)
        self.addCleanup(self.liar.__exit__)
        self.client = gobo.connect(self.liar.address)
        self.addCleanup(self.client.close)

    def came(self):
        self.assertTrue(self.gate.came.acquire(timeout=30))

    def test_the_latest_wins(self):
        with self.client.session("x") as s:
            self.came()
            for seed in (1, 2, 3):
                s.edit(seed=seed)   # none of them ends the first, which has shown nothing
            self.assertFalse(self.gate.came.acquire(timeout=0.3), "nor does another begin")
            self.assertEqual(self.gate.ended, [])
            self.gate.let.release()   # its small picture
            self.came()               # and the next one begins
            self.assertEqual([r.seed for r in self.gate.requests], [0, 3])
            self.gate.let.release(20)
            last = s.wait(30)
            self.assertEqual((last.edit, last.final, last.image[0, 0, 0]), (3, True, 3))
        names = {r.scheduling.session for r in self.gate.requests}
        self.assertEqual(names, {s.id})

    def test_an_edit_ends_what_has_shown_a_picture(self):
        with self.client.session("x") as s:
            self.came()
            self.gate.let.release()
            self.assertEqual(next(s.pictures(30)).edit, 0)
            s.edit(seed=5)
            self.came()
            self.assertEqual([r.seed for r in self.gate.requests], [0, 5])

    def test_close_ends_what_runs(self):
        s = self.client.session("x")
        self.came()
        pictures = s.pictures(30)
        done = []
        thread = threading.Thread(target=lambda: done.append(list(pictures)), daemon=True)
        thread.start()
        s.close()
        s.close()
        thread.join(30)
        self.assertEqual(done, [[]])
        for call in (lambda: s.edit(seed=1), lambda: s.wait(1)):
            with self.assertRaises(gobo.Cancelled):
                call()
        self.assertNotIn("gobo-session", [t.name for t in threading.enumerate()])

    def test_a_callback_may_edit_and_close(self):
        seen = []

        def show(picture):
            seen.append((picture.edit, picture.final))
            if picture.edit == 0:
                s.edit(seed=9)
            elif picture.final:
                s.close()
        with self.client.session("x", on_picture=show) as s:
            self.gate.let.release(20)   # a call that is being ended may take some
            for _ in s.pictures(60):
                pass
        self.assertEqual(seen, [(0, False), (1, False), (1, True)])

    def test_a_callback_that_fails_does_not_end_it(self):
        with self.assertLogs("gobo", "ERROR"), self.client.session("x", on_picture=lambda p: 1 / 0) as s:
            self.gate.let.release(4)
            self.assertTrue(s.wait(30).final)
            s.edit(seed=2)
            self.assertEqual(s.wait(30).edit, 1)

    def test_time_out_and_names(self):
        with self.client.session("x", scheduling={"session": "mine", "priority": "normal"}) as s:
            self.came()
            for call in (lambda: s.wait(0.02), lambda: next(s.pictures(0.02))):
                with self.assertRaises(gobo.DeadlineExceeded):
                    call()
            self.assertEqual((self.gate.requests[0].scheduling.session, self.gate.requests[0].scheduling.priority), ("mine", render_pb2.Scheduling.NORMAL))
            s.edit(request={"scheduling": {"session": "other"}})
            self.assertEqual(s.request.scheduling.session, "mine")

    def test_edits_add_up_and_replace(self):
        with self.client.session("x", lights={"a": {"gain": 2}}, camera={"position": (0, 0, 1)}, env=3) as s:
            s.edit(lights={"b": False})
            s.edit(lights={"a": {"intensity": 4}}, camera={"yfov_deg": 30})
            r = s.request
            self.assertEqual((r.lights["a"].gain.x, r.lights["a"].intensity, r.lights["b"].enabled), (2, 4, False))
            self.assertEqual((r.camera.HasField("position"), r.camera.yfov_deg), (False, 30))   # camera= as a whole
            s.edit(set={"camera.position": (0, 1, 1)}, lights={"a": None})
            r = s.request
            self.assertEqual((sorted(r.lights), r.camera.yfov_deg, r.camera.position.y), (["b"], 30, 1))
            self.assertEqual(r.environment.constant.x, 3)
            s.reset(seed=4)
            r = s.request
            self.assertEqual((sorted(r.lights), r.lights["a"].gain.x, r.camera.position.z, r.seed), (["a"], 2, 1, 4))
            before = s.request
            with self.assertRaises(gobo.InvalidArgument):
                s.edit(lights={"a": {"gian": 2}}, seed=77)
            self.assertEqual(s.request, before, "a wrong edit changes nothing")


class Errors(unittest.TestCase):
    def test_an_edit_that_the_server_refuses(self):
        def answer(request, context):
            if request.seed == 13:
                context.abort(grpc.StatusCode.INVALID_ARGUMENT, "seed = 13: must be lucky")
            yield from events(values=[float(request.seed)] * 6)
        said = []
        with Liar(RenderProgressive=answer) as liar, gobo.connect(liar.address) as client, client.session("x", on_error=said.append) as s:
            self.assertEqual(s.wait(30).edit, 0)
            pictures = s.pictures(30)
            next(pictures)
            s.edit(seed=13)
            with self.assertRaises(gobo.InvalidArgument):
                next(pictures)
            with self.assertRaises(gobo.InvalidArgument) as caught:
                s.wait(30)
            self.assertEqual((caught.exception.field, [e.field for e in said]), ("seed", ["seed"]))
            self.assertEqual(s.latest.edit, 0)
            s.edit(seed=14)
            self.assertEqual((next(pictures).image[0, 0, 0], s.wait(30).edit), (14, 2))


class Server(DaemonTest):
    def until(self, what):
        end = time.monotonic() + 60
        while not what():
            self.assertLess(time.monotonic(), end)
            time.sleep(0.005)

    def test_pictures_are_those_of_their_edits(self):
        random_ = random.Random(20241)
        with self.client.session("cornell", **SMALL) as s:
            wanted = {0: 1.0}
            shown = {}
            for _ in range(40):
                gain = random_.uniform(0.5, 2.0)
                wanted[s.edit(lights={"light": {"gain": gain}})] = gain
                if random_.random() < 0.5:
                    p = next(s.pictures(60))
                    shown[p.edit] = p
                time.sleep(random_.uniform(0, 0.01))
            last = s.wait(60)
        self.assertEqual(last.edit, 40)
        shown[40] = last
        for number, picture in shown.items():
            self.assertEqual(np.float32(picture.resolved.lights["light"].gain.x) if number else 1, np.float32(wanted[number]))
        plain = self.client.render("cornell", **SMALL, lights={"light": {"gain": wanted[40]}})
        np.testing.assert_array_equal(last.image, plain.image)
        self.assertGreater(len(shown), 1)

    def test_a_slider_over_a_render_without_end(self):
        with self.client.session("cornell", **FOREVER) as s:
            for step in range(5):
                self.assertEqual(next(iter(s.pictures(60))).final, False)
                s.edit(lights={"light": {"gain": 1 + step}})
            self.until(lambda: s.latest.edit == 5)
            self.assertLessEqual(self.client.status().running, 1)
        self.until(lambda: self.client.status().running == 0 and self.client.status().queued == 0)


if __name__ == "__main__":
    unittest.main()
