# SPDX-License-Identifier: Apache-2.0
"""`gobo jobs watch` and `gobo jobs fetch --follow` while the daemon is restarted in order (SIGTERM): the job goes on, and so do they."""
import os
import shutil
import signal
import subprocess
import tempfile
import time
import unittest

import grpc

from gobo.v1 import jobs_pb2
from support import CLI, Liar

GOBOD = os.environ["GOBO_GOBOD"]
HINT_MS = 700


class Restart(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.mkdtemp(prefix="gobo-restart-")
        self.addCleanup(shutil.rmtree, self.folder, ignore_errors=True)
        self.address = f"unix:{self.folder}/s"

    def started(self, command, **more):
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=self.folder, **more)
        self.addCleanup(process.stdout.close)
        self.addCleanup(process.wait)
        self.addCleanup(process.kill)
        return process

    def gobo(self, *words):
        return self.started([CLI, "--server", self.address, *words], stderr=subprocess.STDOUT)

    def gobod(self):
        with open(f"{self.folder}/gobod.toml", "w", encoding="utf-8") as file:
            file.write(f'[jobs]\nfolder = "{self.folder}/jobs"\n')
        daemon = self.started([GOBOD, "--config", "gobod.toml", "--listen", self.address, "--threads", "1"], stderr=subprocess.DEVNULL)
        self.assertTrue(daemon.stdout.readline())
        return daemon

    def test_both_go_on_to_the_end(self):
        daemon = self.gobod()
        job = self.gobo("jobs", "submit", "cornell", "--size", "64x48", "--spp", "512", "--frames", "0-7", "--name", "n").communicate(timeout=60)[0].strip()
        watch = self.gobo("jobs", "watch", job)
        fetch = self.gobo("jobs", "fetch", job, "--follow", "-o", "out")
        first = watch.stdout.readline()
        self.assertTrue(first.startswith("frame 0 done"), first)
        fetch.stdout.readline()
        daemon.send_signal(signal.SIGTERM)
        daemon.wait(60)
        self.assertEqual((watch.poll(), fetch.poll()), (None, None))   # the job was not over
        time.sleep(1)   # longer down than what is waited at first
        self.gobod()
        for process in (watch, fetch):
            said = process.communicate(timeout=120)[0]
            self.assertEqual(process.returncode, 0, said)
            if process is watch:
                self.assertEqual([line.split()[1] for line in said.splitlines() if line.startswith("frame ") and " done in " in line], list("1234567"))
        self.assertEqual(sorted(os.listdir(f"{self.folder}/out")), [f"n.{n:04}.exr" for n in range(8)])

    def serve(self, ends):
        """A job that runs; its streams end as `ends` says, one after the other, then with the job."""
        calls = []
        job = jobs_pb2.Job(id="j-1", state=jobs_pb2.Job.RUNNING, frames_total=1, frames=[jobs_pb2.Frame(frame=0, state=jobs_pb2.Frame.RUNNING)])
        job.spec.request.outputs.append("beauty")

        def stream(first, last):
            def call(_, context):
                calls.append(time.monotonic())
                yield from first
                if len(calls) <= len(ends):
                    code, hint = ends[len(calls) - 1]
                    context.set_trailing_metadata((("retry-after-ms", str(hint)),) if hint else ())
                    context.abort(code, "the server is shutting down")
                yield from last
            return call

        done = jobs_pb2.Job(id="j-1", state=jobs_pb2.Job.DONE, frames_total=1, frames_done=1, progress=1)
        liar = Liar(Get=lambda *_: job, Watch=stream([jobs_pb2.JobEvent(job=job)], [jobs_pb2.JobEvent(job=done)]), Fetch=stream([], []))
        self.addCleanup(liar.__exit__)
        self.address = liar.address
        return calls

    def test_the_hint_is_waited_for_and_a_closing_server_is_not_the_end(self):
        for words in (["watch", "j-1"], ["fetch", "j-1", "--follow"]):
            calls = self.serve([(grpc.StatusCode.UNAVAILABLE, HINT_MS), (grpc.StatusCode.CANCELLED, 0)])
            process = self.gobo("jobs", *words)
            said = process.communicate(timeout=60)[0]
            self.assertEqual((process.returncode, len(calls)), (0, 3), said)
            self.assertGreaterEqual(calls[1] - calls[0], HINT_MS / 1000)

    def test_an_interrupt_ends_them_during_the_wait(self):
        for words in (["watch", "j-1"], ["fetch", "j-1", "--follow"]):
            calls = self.serve([(grpc.StatusCode.UNAVAILABLE, 50000)])
            process = self.gobo("jobs", *words)
            end = time.monotonic() + 20
            while not calls and time.monotonic() < end:
                time.sleep(0.05)
            time.sleep(0.3)   # into the wait; before it, the call is cancelled: the same end
            process.send_signal(signal.SIGINT)
            said = process.communicate(timeout=20)[0]
            self.assertEqual((process.returncode, len(calls)), (5, 1), said)
            self.assertIn("interrupted", said)


if __name__ == "__main__":
    unittest.main()
