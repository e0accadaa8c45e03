# SPDX-License-Identifier: Apache-2.0
"""Jobs that wait for others, their log, and files that the daemon writes: by the Python client and by the command line."""
import json
import os
import shutil
import subprocess
import tempfile
import unittest

import gobo
from support import CLI, SMALL, DaemonTest

FOREVER = dict(width=320, height=240, spp=1 << 18)


class JobsOrder(DaemonTest):
    @classmethod
    def setUpClass(cls):
        cls.jobs = tempfile.mkdtemp(prefix="gobo-test-jobs-")
        cls.addClassCleanup(shutil.rmtree, cls.jobs, ignore_errors=True)
        cls.shots = os.path.join(cls.jobs, "shots")
        os.mkdir(cls.shots)
        config = os.path.join(cls.jobs, "gobod.toml")
        with open(config, "w", encoding="utf-8") as file:
            file.write(f"[jobs]\nfolder = {json.dumps(os.path.join(cls.jobs, 'jobs'))}\nout_folder = {json.dumps(cls.shots)}\n")
        cls.options = {"config": config}
        super().setUpClass()

    def test_a_job_waits(self):
        first = self.client.jobs.submit("cornell", **FOREVER)
        second = self.client.jobs.submit("cornell", **SMALL, after=[first.id])
        self.assertEqual(second.state().waits_for, [first.id])
        third = self.cli("jobs", "submit", "cornell", "--size", "8x8", "--spp", "1", "--after", f"{first.id},{second.id}").stdout.strip()
        self.assertIn(f"waits for {first.id}, {second.id}", self.cli("jobs", "show", third).stdout)
        listed = self.cli("jobs", "list").stdout
        self.assertIn(f"queued, waits for {first.id}, {second.id}", listed)
        self.assertIn(f"{third} waits for {second.id}", self.cli("jobs", "depend", third, "--after", second.id).stdout)
        said = self.cli("jobs", "depend", first.id, "--after", third, code=2).stderr
        self.assertIn(f"{first.id} -> {third} -> {second.id} -> {first.id}", said)
        with self.assertRaisesRegex(gobo.InvalidArgument, f"{first.id} -> {second.id} -> {first.id}"):
            first.depend([second.id])
        with self.assertRaisesRegex(gobo.NotFound, r"after\[0\]"):
            second.depend(["j-999"])
        self.assertIn("--after JOB,... or --none", self.cli("jobs", "depend", third, code=2).stderr)
        first.cancel()
        with self.assertRaisesRegex(gobo.FailedPrecondition, f"waited for by {second.id}"):
            first.delete()
        self.assertIn("waits for nothing", self.cli("jobs", "depend", second.id, "--none").stdout)
        second.wait(timeout=100)
        gobo.jobs.Job(self.client.jobs, third).wait(timeout=100)
        first.delete()

    def test_the_log(self):
        job = self.client.jobs.submit("cornell", frames=(0, 1), **SMALL)
        follow = subprocess.Popen([CLI, "jobs", "log", job.id, "--follow"], stdout=subprocess.PIPE, text=True,
                                  env=os.environ | {"GOBO_SERVER": self.client.address})
        job.wait(timeout=100)
        entries = job.log()
        self.assertEqual([e.kind for e in entries], ["submitted", "claimed", "done", "claimed", "done", "ended"])
        self.assertEqual([e.frame for e in entries], [None, 0, 0, 1, 1, None])
        self.assertEqual(entries[1].holder, job.state().frames[0].holder)
        self.assertEqual([e.kind for e in job.log(frames=[1])], ["claimed", "done"])
        self.assertEqual([e.kind for e in job.log(after=entries[3].sequence)], ["done", "ended"])
        self.assertEqual([e.kind for e in job.log(most=1)], ["ended"])
        with self.assertRaisesRegex(gobo.InvalidArgument, "no frame 7"):
            job.log(frames=[7])
        followed, _ = follow.communicate(timeout=60)   # ends with the job
        self.assertEqual(follow.returncode, 0)
        lines = self.cli("jobs", "log", job.id).stdout
        self.assertEqual(followed, lines)
        self.assertEqual(len(lines.splitlines()), 6)
        self.assertRegex(lines.splitlines()[1], r"claimed +frame 0 by \d+-\d+/0$")
        one = [json.loads(line) for line in self.cli("--json", "jobs", "log", job.id, "--frame", "1").stdout.splitlines()]
        self.assertEqual([(e["kind"], int(e["frame"])) for e in one], [("CLAIMED", 1), ("DONE", 1)])

    def test_files_are_written_where_the_job_says(self):
        job = self.client.jobs.submit("cornell", frames=(8, 9), name="turn", **SMALL, out="py/{name}.{frame:04}.{ext}")
        job.wait(timeout=100)
        self.assertEqual(sorted(os.listdir(os.path.join(self.shots, "py"))), ["turn.0008.exr", "turn.0009.exr"])
        for path in job.fetch(self.path("fetched")):
            with open(path, "rb") as a, open(os.path.join(self.shots, "py", os.path.basename(path)), "rb") as b:
                self.assertEqual(a.read(), b.read())
        self.cli("jobs", "submit", "cornell", "--size", "8x8", "--spp", "1", "--format", "PNG", "--out", "cli/{job}.{ext}", "--watch")
        self.assertRegex(os.listdir(os.path.join(self.shots, "cli"))[0], r"^j-\d+\.png$")
        self.assertIn("ends in .exr, but encoding.format is PNG",
                      self.cli("jobs", "submit", "cornell", "--size", "8x8", "--format", "PNG", "--out", "x.exr", code=2).stderr)


if __name__ == "__main__":
    unittest.main()
