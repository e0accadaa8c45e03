# SPDX-License-Identifier: Apache-2.0
"""Jobs through a connection that breaks and a server that lies: streams are opened again, files are checked, names from outside
do not leave the folder. Both clients."""
import hashlib
import json
import os
import subprocess
import tempfile
import time
import unittest

import grpc
import numpy as np

import gobo
from gobo.v1 import jobs_pb2, render_pb2
from support import CLI, Liar

DATA = bytes(range(200)) * 3


def file_of(data, name="a.0000.raw", **change):
    return jobs_pb2.FrameFile(**{**dict(output="beauty", name=name, bytes=len(data), sha256=hashlib.sha256(data).hexdigest(),
                                        format=render_pb2.Encoding.RAW_FLOAT, width=10, height=5), **change})


class Store:
    """One job of two frames; `broken` calls of Watch and Fetch end in UNAVAILABLE after their first part."""

    def __init__(self, files=None, broken=0, state=jobs_pb2.Job.DONE, error=None, pause=0.0):
        self.pause = pause   # before each part of a file
        self.broken, self.fetches, self.specs, self.acts = broken, [], [], []
        self.files = files or [(0, file_of(DATA), DATA), (1, file_of(DATA[::-1], "a.0001.raw"), DATA[::-1])]
        frames = [jobs_pb2.Frame(frame=n, state=jobs_pb2.Frame.DONE, progress=1, files=[f]) for n, f, _ in self.files]
        self.job = jobs_pb2.Job(id="j-1", state=state, frames=frames, frames_total=len(frames), frames_done=len(frames), progress=1, error=error)

    def breaks(self, context):
        if self.broken > 0:
            self.broken -= 1
            context.abort(grpc.StatusCode.UNAVAILABLE, "the server is shutting down")

    def handlers(self):
        return {"Get": self.get, "List": self.list, "Submit": self.submit, "Watch": self.watch, "Fetch": self.fetch, "Cancel": self.act, "Pause": self.act,
                "Resume": self.act, "Delete": lambda r, c: jobs_pb2.DeleteJobReply()}

    def get(self, request, context):
        if request.id != "j-1":
            context.abort(grpc.StatusCode.NOT_FOUND, f"no job '{request.id}'")
        return self.job

    def list(self, request, context):
        first = not request.page_token
        return jobs_pb2.ListJobsReply(jobs=[self.job], next_page_token="more" if first else "")

    def submit(self, request, context):
        self.specs.append(request)
        self.breaks(context)
        return self.job

    def act(self, request, context):
        self.acts.append(type(request).__name__)
        return self.get(request, context)

    def watch(self, request, context):
        self.get(request, context)
        running = jobs_pb2.Job()
        running.CopyFrom(self.job)
        running.state, running.progress = jobs_pb2.Job.RUNNING, 0.5
        del running.frames[:]
        yield jobs_pb2.JobEvent(job=running)
        self.breaks(context)
        yield jobs_pb2.JobEvent(job=running, frame=self.job.frames[0])
        running.state = self.job.state
        yield jobs_pb2.JobEvent(job=running)

    def fetch(self, request, context):
        self.fetches.append(request)
        offset = request.offset
        for frame, file, data in self.files:
            if request.frames and frame not in request.frames:
                continue
            yield jobs_pb2.FetchReply(file=jobs_pb2.FetchedFile(frame=frame, file=file, offset=offset))
            for at in range(offset, len(data), 100):
                time.sleep(self.pause)
                yield jobs_pb2.FetchReply(chunk=jobs_pb2.FetchedChunk(offset=at, data=data[at:at + 100]))
                self.breaks(context)
            offset = 0


class Base(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = folder.name

    def serve(self, store, **options):
        liar = Liar(**store.handlers())
        self.addCleanup(liar.__exit__)
        self.address = liar.address
        client = gobo.connect(liar.address, **options)
        self.addCleanup(client.close)
        return client

    def read(self, name):
        with open(os.path.join(self.folder, name), "rb") as file:
            return file.read()

    def cli(self, *args, code=0):
        done = subprocess.run([CLI, "--server", self.address, *args], capture_output=True, text=True, timeout=60, cwd=self.folder)
        self.assertEqual(done.returncode, code, done.stdout + done.stderr)
        return done


class Python(Base):
    def test_fetch_goes_on_where_it_was_cut(self):
        store = Store(broken=3)
        client = self.serve(store)
        paths = client.jobs.fetch("j-1", self.folder)
        self.assertEqual([os.path.basename(p) for p in paths], ["a.0000.raw", "a.0001.raw"])
        self.assertEqual((self.read("a.0000.raw"), self.read("a.0001.raw")), (DATA, DATA[::-1]))
        self.assertEqual([f.offset for f in store.fetches], [0, 100, 200, 300, 0])
        self.assertEqual(sorted(os.listdir(self.folder)), ["a.0000.raw", "a.0001.raw"])
        client.jobs.fetch("j-1", self.folder)
        self.assertEqual(len(store.fetches), 5)     # what is there is not fetched again

    def test_the_clients_timeout_is_of_each_part(self):
        store = Store(pause=0.3)                    # 1.8 s a file
        client = self.serve(store, timeout=1)
        client.jobs.fetch("j-1", self.folder)
        self.assertEqual((self.read("a.0000.raw"), self.read("a.0001.raw")), (DATA, DATA[::-1]))
        self.assertEqual(len(dict(client.jobs.images("j-1"))), 2)
        store.pause = 3                             # it stands still
        for seconds, work in ((1, lambda: list(client.jobs.images("j-1"))), (0.5, lambda: client.jobs.fetch("j-1", self.folder + "/other", timeout=0.5))):
            begun = time.monotonic()
            with self.assertRaises(gobo.DeadlineExceeded):
                work()
            self.assertTrue(seconds - 0.1 < time.monotonic() - begun < seconds + 1.5)
        store.pause = 0.3
        with self.assertRaises(gobo.DeadlineExceeded):   # the caller's is of all files together
            client.jobs.fetch("j-1", self.folder + "/other", timeout=1)

    def test_fetch_refuses_other_bytes_and_names_outside(self):
        self.assert_lost([(0, file_of(DATA), DATA[::-1])], "digest")
        self.assert_lost([(0, file_of(DATA), DATA[:300])], "300 of 600")
        self.assert_lost([(0, file_of(DATA, ".."), DATA)], "name")
        client = self.serve(Store([(0, file_of(DATA, "../../evil.raw"), DATA)]))
        self.assertEqual(client.jobs.fetch("j-1", self.folder), [os.path.join(self.folder, "evil.raw")])

    def assert_lost(self, files, what):
        with self.assertRaisesRegex(gobo.DataLoss, what):
            self.serve(Store(files)).jobs.fetch("j-1", self.folder)
        self.assertEqual([n for n in os.listdir(self.folder) if not n.endswith(".part")], [])

    def test_images(self):
        client = self.serve(Store())
        frames = dict(client.jobs.images("j-1"))
        np.testing.assert_array_equal(frames[0], np.frombuffer(DATA, "<f4").reshape(5, 10, 3))
        with self.assertRaises(gobo.InvalidArgument):
            client.jobs.fetch("j-1", self.folder, frames=[7])

    def test_watch_is_opened_again(self):
        client = self.serve(Store(broken=2))
        states = list(client.jobs.watch("j-1"))
        self.assertEqual((states[-1].state, sum(s.changed is not None for s in states)), ("done", 1))
        self.assertTrue(states[-1].ended)

    def test_wait_raises_the_error_of_the_job(self):
        store = Store(state=jobs_pb2.Job.FAILED, error=jobs_pb2.JobError(code=5, message="no scene 'x'"))
        client = self.serve(store)
        with self.assertRaisesRegex(gobo.NotFound, "no scene 'x'"):
            client.jobs.submit("x").wait()
        store.job.state = jobs_pb2.Job.CANCELLED
        with self.assertRaises(gobo.Cancelled):
            client.jobs.submit("x").wait()

    def test_submit_repeats_itself_under_one_key(self):
        store = Store(broken=2)
        client = self.serve(store)
        job = client.jobs.submit("cornell", frames=range(0, 10, 5), fps=24, name="n", job_priority="high", deadline=5, max_attempts=2, spp=8)
        self.assertEqual(job.id, "j-1")
        self.assertEqual((len(store.specs), len({s.key for s in store.specs})), (3, 1))
        spec = store.specs[-1]
        self.assertEqual((spec.frames.first, spec.frames.last, spec.frames.step, spec.frames.fps, spec.priority, spec.max_attempts, spec.request.halt.spp),
                         (0, 5, 5, 24, 3, 2, 8))
        client.jobs.submit("cornell")
        self.assertNotEqual(store.specs[-1].key, spec.key)

    def test_acts_and_pages(self):
        store = Store()
        client = self.serve(store)
        self.assertEqual(len(client.jobs.list(states=["done"])), 2)
        for act in (client.jobs.cancel, client.jobs.pause, client.jobs.resume):
            self.assertEqual(act("j-1").id, "j-1")
        client.jobs.delete("j-1")
        self.assertEqual(store.acts, ["CancelJobRequest", "PauseJobRequest", "ResumeJobRequest"])
        with self.assertRaises(gobo.NotFound):
            client.jobs.get("j-2")


class Cli(Base):
    def test_fetch(self):
        store = Store(broken=1)
        self.serve(store)
        self.cli("jobs", "fetch", "j-1", "-o", "out")
        self.assertEqual((self.read("out/a.0000.raw"), self.read("out/a.0001.raw")), (DATA, DATA[::-1]))
        self.assertEqual(sorted(os.listdir(os.path.join(self.folder, "out"))), ["a.0000.raw", "a.0001.raw"])
        calls = len(store.fetches)
        self.cli("jobs", "fetch", "j-1", "-o", "out")
        self.assertEqual(len(store.fetches), calls)

    def test_fetch_refuses(self):
        for files in ([(0, file_of(DATA), DATA[::-1])], [(0, file_of(DATA), DATA[:300])], [(0, file_of(DATA, ".."), DATA)]):
            self.serve(Store(files))
            self.cli("jobs", "fetch", "j-1", code=1)
            self.assertEqual(os.listdir(self.folder), [])

    def test_watch(self):
        self.serve(Store(broken=2))
        done = self.cli("jobs", "watch", "j-1")
        self.assertIn("frame 0 done", done.stdout)
        self.assertEqual(done.stderr, "")            # no bar where there is no terminal
        events = [json.loads(line) for line in self.cli("jobs", "watch", "j-1", "--json").stdout.splitlines()]
        self.assertEqual(events[-1]["job"]["state"], "DONE")

    def test_exit_codes(self):
        store = Store(state=jobs_pb2.Job.FAILED, error=jobs_pb2.JobError(code=13, message="broke"))
        self.serve(store)
        self.assertIn("broke", self.cli("jobs", "watch", "j-1", code=1).stderr)
        store.job.state = jobs_pb2.Job.CANCELLED
        self.cli("jobs", "watch", "j-1", code=5)
        self.cli("jobs", "show", "j-2", code=3)
        self.cli("jobs", code=2)
        self.cli("jobs", "submit", "cornell", "--frames", "3-1", code=2)
        self.cli("--local", "jobs", "list", code=2)

    def test_acts(self):
        store = Store()
        self.serve(store)
        self.assertEqual(self.cli("jobs", "submit", "cornell", "--frames", "0-8:4", "--fps", "25", "--job-priority", "LOW", "--key", "k").stdout, "j-1\n")
        spec = store.specs[-1]
        self.assertEqual((spec.frames.first, spec.frames.last, spec.frames.step, spec.frames.fps, spec.priority, spec.key), (0, 8, 4, 25, 1, "k"))
        self.cli("jobs", "pause", "j-1")
        self.cli("jobs", "resume", "j-1")
        self.cli("cancel", "j-1", "j-1")
        self.cli("jobs", "delete", "j-1")
        self.assertEqual(store.acts, ["PauseJobRequest", "ResumeJobRequest", "CancelJobRequest", "CancelJobRequest"])
        self.assertEqual(self.cli("jobs", "list").stdout.count("j-1"), 2)
        self.cli("cancel", "j-9", "j-1", code=3)


if __name__ == "__main__":
    unittest.main()
