# SPDX-License-Identifier: Apache-2.0
"""Jobs through a real gobod: the bits of a direct render, pause and resume, cancel, failure, a daemon that is killed."""
import hashlib
import os
import signal
import tempfile
import threading
import time
import unittest

import grpc
import numpy as np

import gobo
from gobo.v1 import jobs_pb2, render_pb2, service_pb2_grpc
from support import SMALL, JobsTest, Liar


class Jobs(JobsTest):
    def test_frames_are_the_bits_of_a_render(self):
        job = self.client.jobs.submit("cornell", frames=(3, 4), name="bits", **SMALL, outputs=["beauty", "depth"])
        last = job.wait(timeout=100)
        self.assertEqual((last.state, last.frames_done, [f.frame for f in last.frames], last.progress), ("done", 2, [3, 4], 1))
        want = self.client.render("cornell", **SMALL, outputs=["beauty", "depth"])
        for frame, image in job.images():
            np.testing.assert_array_equal(image, want.image)
        for frame, image in job.images("depth"):
            np.testing.assert_array_equal(image, want.outputs["depth"])
        paths = job.fetch(self.path("out"))
        self.assertEqual(len(paths), 4)
        self.cli("jobs", "fetch", job.id, "-o", "cli", "--outputs", "beauty")
        for name in os.listdir(self.path("cli")):
            with open(self.path("cli", name), "rb") as a, open(self.path("out", name), "rb") as b:
                self.assertEqual(a.read(), b.read())
        self.assertEqual(len(os.listdir(self.path("cli"))), 2)
        said = self.cli("jobs", "fetch", job.id, "-o", "none", "--outputs", "beauty,dephth", code=2).stderr
        self.assertIn(f"--outputs dephth: job {job.id} has no output", said)
        for fetched in (lambda: job.fetch(self.path("none"), outputs=["beauty", "dephth"]), lambda: list(job.images("dephth"))):
            with self.assertRaisesRegex(gobo.InvalidArgument, f"outputs = 'dephth': job {job.id} has no output"):
                fetched()
        self.assertEqual(os.listdir(self.path("none")), [])
        raw = self.client.jobs.submit("cornell", **SMALL, format="raw_float")
        raw.wait(timeout=100)
        np.testing.assert_array_equal(dict(raw.images())[0], want.image)
        layered = self.client.jobs.submit("cornell", **SMALL, outputs=["beauty", "depth"], encoding={"layers": True})
        layered.wait(timeout=100)
        (path,) = layered.fetch(self.path("layered"))
        np.testing.assert_array_equal(gobo.exr.read_image(path, "depth").squeeze(), want.outputs["depth"].squeeze())
        said = self.cli("jobs", "fetch", layered.id, "-o", "none", "--outputs", "beauty", code=2).stderr
        self.assertIn(f"job {layered.id} has no output", said)
        self.cli("jobs", "fetch", layered.id, "-o", "one", "--outputs", "layers")
        self.assertEqual(len(os.listdir(self.path("one"))), 1)
        self.assertIn(job.id, [j.id for j in self.client.jobs.list(states=["done"])])
        self.assertIn("bits", self.cli("jobs", "list").stdout)
        job.delete()
        with self.assertRaises(gobo.NotFound):
            job.state()

    def test_a_relight_by_every_call(self):
        # A reply's `resolved` request, edited, is its relight: by every call that takes a request, with the same bits and from the same terms.
        first = self.client.render("cornell", **SMALL, denoise="auto", outputs=["beauty", "indirect"])
        edits = {"lights": {"light": {"gain": (1, 0.5, 0.25)}}, "exposure": 1}
        want = first.relight(**edits)
        self.assertEqual(want.rays, 0)
        base = first.reply.resolved
        whole = self.client.render(request=base, **edits)
        *_, shown = self.client.render_progressive(request=base, **edits)
        for other in (whole, shown):
            self.assertEqual(other.rays, 0)
            self.assertEqual(other.reply.request_hash, want.reply.request_hash)
            for output in want.outputs:
                np.testing.assert_array_equal(other.outputs[output], want.outputs[output])
        with grpc.insecure_channel(self.client.address) as channel:
            inline = service_pb2_grpc.RenderStub(channel).RenderInline(whole.reply.resolved)
        self.assertEqual(inline.reply.request_hash, want.reply.request_hash)
        job = self.client.jobs.submit(base.scene, request=base, format="raw_float", **edits)
        self.assertEqual(job.wait(timeout=100).state, "done")
        np.testing.assert_array_equal(dict(job.images())[0], want.image)

    def test_curves_are_each_frames_values(self):
        curves = {"lights.light.gain": {"time_s": [0, 1], "value": [1, 1, 1, 3, 2, 1]}, "camera.yfov_deg": {"time_s": [0, 0.5], "value": [30, 50], "interpolation": "SMOOTH"}}
        job = self.client.jobs.submit("cornell", frames=range(0, 6, 2), fps=4, **SMALL, curves=curves)
        self.assertEqual(job.wait(timeout=100).state, "done")
        shown = dict(job.images())
        self.assertEqual(sorted(shown), [0, 2, 4])
        for frame, image in shown.items():
            time_s = frame / 4
            plain = self.client.render("cornell", **SMALL, time_s=time_s, lights={"light": {"gain": (1 + 2 * time_s, 1 + time_s, 1)}}, camera={"yfov_deg": 30 + 20 * min(time_s * 2, 1)})
            np.testing.assert_array_equal(image, plain.image, str(frame))
        job = self.client.jobs.submit("cornell", frames=range(0, 6, 4), fps=4, **SMALL, expressions={"lights.light.intensity": "2 + 3*time"})
        self.assertEqual(job.wait(timeout=100).state, "done")
        for frame, image in dict(job.images()).items():
            plain = self.client.render("cornell", **SMALL, time_s=frame / 4, lights={"light": {"intensity": 2 + 3 * frame / 4}})
            np.testing.assert_array_equal(image, plain.image, str(frame))
        with self.assertRaisesRegex(gobo.InvalidArgument, "request.curves.lights.light.intensity.value"):
            self.client.jobs.submit("cornell", frames=range(3), fps=4, **SMALL, curves={"lights.light.intensity": {"time_s": [0, 1], "value": [1, -1]}})

    def test_one_key_one_job(self):
        a = self.client.jobs.submit("cornell", key="once", **SMALL)
        self.assertEqual(self.client.jobs.submit("cornell", key="once", **SMALL).id, a.id)
        with self.assertRaises(gobo.AlreadyExists):
            self.client.jobs.submit("cornell", key="once", **{**SMALL, "spp": 32})
        a.wait(timeout=100)

    def test_pause_resume_cancel(self):
        job = self.client.jobs.submit("cornell", width=320, height=240, spp=1 << 18)
        self.assertEqual(job.pause().state, "paused")
        self.assertEqual(job.resume().state in ("queued", "running"), True)
        with self.assertRaises(gobo.DeadlineExceeded):
            job.wait(timeout=0.3)
        with self.assertRaises(gobo.FailedPrecondition):
            job.delete()
        self.cli("cancel", job.id)
        with self.assertRaises(gobo.Cancelled):
            job.wait(timeout=60)
        self.assertIn(job.retry().state, ("queued", "running"))
        self.assertEqual(job.prioritize("high").message.spec.priority, 3)
        with self.assertRaisesRegex(gobo.InvalidArgument, "priority"):
            job.prioritize("urgent")
        job.cancel()
        self.assertIn("is queued", self.cli("jobs", "retry", job.id).stdout.replace("running", "queued"))
        self.cli("jobs", "priority", "--to", "low", job.id)
        self.assertEqual(job.state().message.spec.priority, 1)
        job.cancel()
        job.delete()

    def test_errors(self):
        with self.assertRaises(gobo.NotFound):
            self.client.jobs.get("j-999999")
        with self.assertRaises(gobo.InvalidArgument):
            self.client.jobs.submit("cornell", max_seconds=3)
        self.cli("jobs", "show", "j-999999", code=3)

    def test_cli_submits_and_watches(self):
        done = self.cli("jobs", "submit", "cornell", "--frames", "0-1", "--size", "32x24", "--spp", "16", "--name", "shell", "--watch")
        self.assertIn("frame 1 done", done.stdout)
        job = done.stdout.split()[0]
        self.assertIn("2 of 2 frames", self.cli("jobs", "show", job).stdout)
        self.cli("jobs", "delete", job)


def wait_until_gone(pid: int) -> None:
    """As a supervisor does before it starts the next: a killed process that is in the middle of a flush to a busy disk holds its locks until that ends."""
    end = time.monotonic() + 60
    while time.monotonic() < end:
        try:
            with open(f"/proc/{pid}/stat", encoding="ascii") as file:
                state = file.read().rpartition(")")[2].split()[0]
            # A zombie's other threads may be dying still, and hold the lock of the jobs' folder: the next daemon would take it for a living one.
            if state in "ZX" and len(os.listdir(f"/proc/{pid}/task")) == 1:
                return
        except OSError:
            return
        time.sleep(0.01)


class Killed(unittest.TestCase):
    def test_a_watch_survives_a_killed_daemon(self):
        """The daemon dies by kill -9 in the middle; another one on the same address and folder finishes the job."""
        self.restarted(signal.SIGKILL)

    def test_a_watch_survives_an_orderly_restart(self):
        """The stream that is opened again meets a daemon that is shutting down, whose gRPC answers late calls with CANCELLED: not the job's end."""
        self.restarted(signal.SIGTERM)

    def test_cancelled_by_the_server_is_a_broken_stream(self):
        data = b"\0" * 1200
        file = jobs_pb2.FrameFile(output="beauty", name="a.raw", bytes=len(data), sha256=hashlib.sha256(data).hexdigest(),
                                  format=render_pb2.Encoding.RAW_FLOAT, width=10, height=10)
        job = jobs_pb2.Job(id="j-1", state=jobs_pb2.Job.DONE, frames=[jobs_pb2.Frame(state=jobs_pb2.Frame.DONE, files=[file])])
        late = {"watch": 2, "fetch": 2}

        def cancelled(context, what):
            late[what] -= 1
            if late[what] >= 0:
                context.abort(grpc.StatusCode.CANCELLED, "CANCELLED")

        def watch(request, context):
            cancelled(context, "watch")
            yield jobs_pb2.JobEvent(job=job)

        def fetch(request, context):
            yield jobs_pb2.FetchReply(chunk=jobs_pb2.FetchedChunk(offset=request.offset, data=data[request.offset:600 if late["fetch"] > 0 else None]))
            cancelled(context, "fetch")
        with Liar(Watch=watch, Fetch=fetch, Get=lambda r, c: job) as liar, gobo.connect(liar.address) as client:
            self.assertEqual(gobo.Job(client.jobs, "j-1").wait(60).state, "done")
            self.assertEqual([image.sum() for _, image in client.jobs.images("j-1")], [0])
            self.assertTrue(late["watch"] < 0 and late["fetch"] <= 0, late)
            late["watch"] = 1 << 30
            for end, kind in ((lambda watching: watching.cancel(), gobo.Cancelled), (lambda watching: client.close(), gobo.Cancelled)):
                with client.jobs.watch("j-1", timeout=60) as watching:
                    threading.Timer(0.5, end, [watching]).start()
                    begun = time.monotonic()
                    with self.assertRaises(kind):   # the caller's own, which is not tried again
                        next(watching)
                    self.assertLess(time.monotonic() - begun, 30)

    def restarted(self, how):
        with tempfile.TemporaryDirectory() as jobs:
            first = gobo.Daemon(threads=2, jobs=jobs)
            self.addCleanup(first.close)
            # Frames of one job are the same picture here, so those after the first are there at once: what is over and what runs are two jobs.
            before, request = dict(width=64, height=48, spp=16, seed=11), dict(width=64, height=48, spp=2048, seed=12)
            with gobo.connect(first.address) as client:
                over = client.jobs.submit("cornell", frames=(0, 2), **before)
                self.assertEqual(over.wait(60).state, "done")
                job = client.jobs.submit("cornell", frames=(0, 5), **request)
                states = []
                watcher = threading.Thread(target=lambda: states.extend(s.state for s in job.watch(timeout=120)))
                watcher.start()
                end = time.monotonic() + 60
                while job.state().state != "running" and time.monotonic() < end:
                    time.sleep(0.02)
                pid = client.status().pid
                os.kill(pid, how)
                wait_until_gone(pid)
                second = gobo.Daemon(threads=2, jobs=jobs, args=["--listen", first.address])
                self.addCleanup(second.close)
                watcher.join(120)
                self.assertEqual(states[-1], "done")
                for one, frames, spec in ((job, 6, request), (over, 3, before)):
                    images = dict(one.images())
                    self.assertEqual(sorted(images), list(range(frames)))
                    want = client.render("cornell", **spec).image
                    for image in images.values():
                        np.testing.assert_array_equal(image, want)


if __name__ == "__main__":
    unittest.main()
