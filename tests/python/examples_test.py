# SPDX-License-Identifier: Apache-2.0
"""Every program in clients/python/examples runs, with small pictures, and prints what it promises."""
import glob
import os
import re
import subprocess
import unittest

import gobo
from support import SOURCE, DaemonTest

EXAMPLES = os.path.join(SOURCE, "clients", "python", "examples")


class Examples(DaemonTest):
    def example(self, name, *args, local=False):
        env = dict(os.environ) if local else {**os.environ, "GOBO_SERVER": self.client.address}
        done = subprocess.run(["/usr/bin/python3", os.path.join(EXAMPLES, name), *args, *(["--local"] if local else [])], cwd=self.folder, env=env,
                              capture_output=True, text=True, timeout=300)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        return done.stdout

    def test_relight_turntable(self):
        out = self.example("relight_turntable.py", "--frames", "3", "--size", "32", "24", "--spp", "16", "-o", "turn")
        self.assertEqual(sorted(os.listdir(self.path("turn"))), ["000.png", "001.png", "002.png"])
        self.assertEqual(len(out.splitlines()), 3)
        self.assertNotEqual(*[open_bytes(self.path("turn", f)) for f in ("000.png", "001.png")])

    def test_compare_techniques(self):
        out = self.example("compare_techniques.py", "--size", "48", "36", "--reference-spp", "128")
        errors = {line[:24].strip(): float(line.split()[-1]) for line in out.splitlines()[1:]}
        self.assertEqual(len(errors), 5)
        self.assertLess(errors["ray traced, 64 rays"], errors["ray traced, 4 rays"])

    def test_batch_job(self):
        out = self.example("batch_job.py", "--frames", "0", "1", "--size", "32", "24", "--spp", "16", "-o", "job", local=True)
        self.assertIn("100%  done  2 of 2 frames", out)
        self.assertEqual(len(os.listdir(self.path("job"))), 2)

    def test_postprocess(self):
        out = self.example("postprocess.py", "--size", "48", "36", "--spp", "16", "-o", "post.exr", local=True)
        self.assertRegex(out, r"mean 0\.\d+ -> 0\.\d+")
        self.assertEqual(gobo.exr.read_image(self.path("post.exr")).shape, (36, 48, 3))

    def test_none_is_forgotten(self):
        tested = set(re.findall(r'"(\w+\.py)"', open_bytes(__file__).decode()))
        self.assertEqual({os.path.basename(p) for p in glob.glob(os.path.join(EXAMPLES, "*.py"))}, tested)


def open_bytes(path):
    with open(path, "rb") as file:
        return file.read()


if __name__ == "__main__":
    unittest.main()
