# SPDX-License-Identifier: Apache-2.0
"""Calls that another thread ends: renders, snapshots, relights, watches of jobs, waits between tries; and what ends on the server with them."""
import random
import threading
import time
import unittest

import grpc

import gobo
from gobo.v1 import jobs_pb2, render_pb2
from support import JobsTest, Liar, events

FOREVER = dict(width=320, height=240, spp=1 << 20)


class Ended(threading.Thread):
    """Runs `work` in a thread; `end` waits for it and returns what it raised, or None."""

    def __init__(self, work):
        super().__init__(daemon=True)
        self.work, self.error, self.value = work, None, None
        self.start()

    def run(self):
        try:
            self.value = self.work()
        except BaseException as e:
            self.error = e

    def end(self):
        self.join(30)
        assert not self.is_alive(), "still waits"
        return self.error


class Server(JobsTest):
    def until(self, what):
        end = time.monotonic() + 30
        while not what():
            self.assertLess(time.monotonic(), end)
            time.sleep(0.005)

    def running(self):
        return self.client.status().running

    def idle(self):
        self.until(lambda: self.running() == 0 and self.client.status().queued == 0)

    def test_render_and_relight(self):
        small = self.client.render("cornell", width=16, height=12, spp=16)
        for n, call in enumerate((lambda stop: self.client.render("cornell", **FOREVER, seed=1, cancel=stop),
                                  lambda stop: self.client.render("cornell", **FOREVER, seed=2, cancel=stop, on_progress=lambda p: None),
                                  lambda stop: small.relight(**FOREVER, seed=3, cancel=stop),
                                  lambda stop: self.client.relight(small.render_id, **FOREVER, seed=4, cancel=stop, on_progress=lambda p: None))):
            with self.subTest(n):
                stop = gobo.Cancellation()
                thread = Ended(lambda: call(stop))
                self.until(self.running)
                stop.cancel()
                self.assertIsInstance(thread.end(), gobo.Cancelled)
                self.idle()
                with self.assertRaises(gobo.Cancelled):   # and what begins later does not begin
                    call(stop)
                self.assertEqual(self.running(), 0)

    def test_snapshots(self):
        small = self.client.render("cornell", width=16, height=12, spp=16)
        for n, make in enumerate((lambda: self.client.render_progressive("cornell", **FOREVER, seed=5), lambda: small.relight_progressive(**FOREVER, seed=6))):
            for how, want in (("cancel", gobo.Cancelled), ("close", type(None))):
                with self.subTest(n, how=how):
                    stream = make()
                    self.assertFalse(next(stream).final)
                    thread = Ended(lambda: list(stream))
                    time.sleep(0.05)
                    getattr(stream, how)()
                    self.assertIsInstance(thread.end(), want)
                    self.idle()
                    self.assertEqual(list(stream), [])

    def test_relight_shows_pictures_on_the_way(self):
        small = self.client.render("cornell", width=16, height=12, spp=16)
        fields = dict(width=64, height=48, spp=64, seed=7, integrator={"max_bounces": 2})
        seen = list(small.relight_progressive(**fields))
        self.assertEqual([s.final for s in seen], [False] * (len(seen) - 1) + [True])
        self.assertGreater(len(seen), 1)
        self.assertEqual(seen[-1].image.tobytes(), small.relight(**fields).image.tobytes())
        news = []
        self.assertTrue(small.relight(width=128, height=96, spp=256, seed=8, on_progress=news.append).final)
        self.assertTrue(news)

    def test_an_end_has_nothing_to_end(self):
        stop = gobo.Cancellation()
        stream = self.client.render_progressive("cornell", width=16, height=12, spp=16, cancel=stop)
        last = list(stream)[-1]
        stream.cancel()
        stop.cancel()
        self.assertTrue(last.final)
        self.assertEqual(list(stream), [])
        self.assertEqual(stop._callbacks, {}, "nothing is kept of calls that have ended")

    def test_one_cancellation_ends_many(self):
        stop = gobo.Cancellation()
        threads = [Ended(lambda seed=seed: self.client.render("cornell", **FOREVER, seed=seed, cancel=stop)) for seed in (11, 12, 13)]
        self.until(lambda: self.running() + self.client.status().queued == 3)
        stop.cancel()
        for thread in threads:
            self.assertIsInstance(thread.end(), gobo.Cancelled)
        self.idle()

    def test_any_time_will_do(self):
        """Ends at random moments, before the call, within it and after; each call gives its picture or Cancelled, and nothing stays behind."""
        random_ = random.Random(77)
        before = threading.active_count()
        got = []
        for round_ in range(40):
            stop = gobo.Cancellation()
            fields = dict(width=random_.choice((16, 64)), height=24, spp=random_.choice((16, 64)), seed=1000 + round_ // 2, cancel=stop)
            if round_ % 2:
                thread = Ended(lambda: list(self.client.render_progressive("cornell", **fields))[-1])
            else:
                thread = Ended(lambda: self.client.render("cornell", **fields))
            time.sleep(random_.choice((0, 0.001, 0.01, 0.05)) * random_.random())
            stop.cancel()
            error = thread.end()
            self.assertIsInstance(error, (gobo.Cancelled, type(None)))
            if error is None:
                self.assertTrue(thread.value.final)
            got.append(error is None)
            self.assertEqual(stop._callbacks, {})
        self.assertIn(False, got)
        self.idle()
        self.until(lambda: threading.active_count() <= before)

    def test_watching_ends_and_the_job_does_not(self):
        job = self.client.jobs.submit("cornell", **FOREVER)
        for how, want in (("cancel", gobo.Cancelled), ("close", type(None))):
            watch = job.watch()
            self.assertEqual(next(watch).id, job.id)
            thread = Ended(lambda: list(watch))
            time.sleep(0.05)
            getattr(watch, how)()
            self.assertIsInstance(thread.end(), want)
        stop = gobo.Cancellation()
        thread = Ended(lambda: job.wait(cancel=stop))
        time.sleep(0.05)
        stop.cancel()
        self.assertIsInstance(thread.end(), gobo.Cancelled)
        self.assertFalse(job.state().ended)
        job.cancel()


class Lies(unittest.TestCase):
    def test_a_wait_between_tries_ends(self):
        def busy(request, context):
            context.set_trailing_metadata((("retry-after-ms", "60000"),))
            context.abort(grpc.StatusCode.RESOURCE_EXHAUSTED, "busy")
        with Liar(Render=busy, Plan=busy) as liar, gobo.connect(liar.address) as client:
            for call in (client.render, client.plan):
                stop = gobo.Cancellation()
                thread = Ended(lambda: call("x", cancel=stop))
                time.sleep(0.2)
                stop.cancel()
                self.assertIsInstance(thread.end(), gobo.Cancelled)

    def test_a_unary_call_ends(self):
        ended = threading.Event()

        def slow(request, context):
            context.add_callback(ended.set)
            ended.wait(30)
            raise RuntimeError("nobody waits")
        with Liar(Plan=slow) as liar, gobo.connect(liar.address) as client:
            stop = gobo.Cancellation()
            thread = Ended(lambda: client.plan("x", cancel=stop))
            time.sleep(0.1)
            stop.cancel()
            self.assertIsInstance(thread.end(), gobo.Cancelled)
            self.assertTrue(ended.wait(10), "the server was told")

    def test_the_same_answers_and_errors_with_one(self):
        def render(request, context):
            yield from events()

        def refuse(request, context):
            context.abort(grpc.StatusCode.INVALID_ARGUMENT, "width = 0: must be from 1 to 16384")
        with Liar(Render=render, Plan=refuse) as liar, gobo.connect(liar.address) as client:
            self.assertEqual(client.render("x", cancel=gobo.Cancellation()).image.shape, (1, 2, 3))
            with self.assertRaises(gobo.InvalidArgument) as caught:
                client.plan("x", cancel=gobo.Cancellation())
            self.assertEqual(caught.exception.field, "width")

    def test_what_had_arrived_is_not_shown_after(self):
        def two(request, context):
            picture = list(events())
            snapshot = render_pb2.RenderEvent(snapshot=picture[0].reply)
            yield from [snapshot, *picture[1:], *picture]
        with Liar(RenderProgressive=two) as liar, gobo.connect(liar.address) as client:
            stream = client.render_progressive("x")
            self.assertFalse(next(stream).final)
            time.sleep(0.1)   # the rest is here by now
            stream.cancel()
            with self.assertRaises(gobo.Cancelled):
                next(stream)

    def test_a_watch_that_waits_to_open_again_ends(self):
        def gone(request, context):
            context.abort(grpc.StatusCode.UNAVAILABLE, "gone")
        with Liar(Watch=gone) as liar, gobo.connect(liar.address) as client:
            watch = client.jobs.watch("j")
            thread = Ended(lambda: list(watch))
            time.sleep(1.0)   # by now it waits for seconds
            watch.cancel()
            self.assertIsInstance(thread.end(), gobo.Cancelled)

    def test_a_job_that_ends_while_it_is_watched(self):
        def watch(request, context):
            yield jobs_pb2.JobEvent(job=jobs_pb2.Job(id="j", state=jobs_pb2.Job.DONE))
        with Liar(Watch=watch) as liar, gobo.connect(liar.address) as client:
            with client.jobs.watch("j") as states:
                self.assertEqual([s.state for s in states], ["done"])

    def test_callbacks_run_once_and_late_ones_at_once(self):
        seen = []
        parent = gobo.Cancellation()
        child = gobo.Cancellation(parent)
        child._add(lambda: seen.append(1))
        child._add(lambda: seen.append(2))()   # taken away again
        parent.cancel()
        parent.cancel()
        child._add(lambda: seen.append(3))
        self.assertEqual(seen, [1, 3])
        self.assertTrue(child.cancelled)
        other = gobo.Cancellation(gobo.Cancellation())
        other.cancel()
        self.assertTrue(other.cancelled)


if __name__ == "__main__":
    unittest.main()
