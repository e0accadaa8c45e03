# SPDX-License-Identifier: Apache-2.0
"""Numbers, sizes, names and files on the command line, and output that cannot be written: nothing is taken for another thing, and nothing is lost unsaid."""
import os
import resource
import signal
import subprocess
import unittest

import gobo
from support import CLI, JobsTest, gltf

GOBOD = os.environ["GOBO_GOBOD"]


class Words(JobsTest):
    def test_numbers_are_finite_and_within_their_range(self):
        numbers = (("--time", ("render", "cornell", "-o", "x.exr"), True), ("--error", ("render", "cornell", "-o", "x.exr"), True),
                   ("--deadline", ("render", "cornell", "-o", "x.exr"), True), ("--fps", ("jobs", "submit", "cornell", "--frames", "1-2"), True),
                   ("--job-deadline", ("jobs", "submit", "cornell"), True), ("--light-share", ("environment", "x.hdr"), True),
                   ("--max-rmse", ("compare", "a.exr", "b.exr"), False))
        for option, words, above in numbers:
            for value in ("nan", "-nan", "inf", "-1", "1e999") + (("0",) if above else ()):
                said = self.cli(*words, f"{option}={value}", code=2).stderr
                self.assertIn(f"{option}: {value} must be a finite number", said)
                self.assertLess(len(said), 200)
        self.cli("--timeout=nan", "status", code=2)
        self.assertFalse(os.path.exists(self.path("x.exr")))

    def test_sizes_do_not_wrap(self):
        for size in ("4294967328x24", "24x4294967328", "99999999999999999999x4", "32x-4", "-32x4", "+32x4", "32x4x", "32x", "x4", "32 x4"):
            self.assertIn(f"--size {size}: must be WIDTHxHEIGHT", self.cli("render", "cornell", "-o", "x.exr", f"--size={size}", code=2).stderr)

    def test_a_value_that_is_none_of_its_field_is_named(self):
        for words in (("plan", "cornell"), ("relight", "nosuch")):
            for value in ("shadows=percentage_closr", "integrator.sampler=lattice", "width=many", "filters[0]=blom"):
                said = self.cli(*words, "--set", value, code=2).stderr
                self.assertIn(f"--set {value}: ", said)
        self.assertIn("percentage_closer", self.cli("plan", "cornell", "--set", "shadows=percentage_closr", code=2).stderr)

    def test_a_scene_to_view_that_there_is_none_of(self):
        for place in ((), ("--local",)):
            for name in ("cornel", "no/such", "nosuch.glb"):
                done = self.cli(*place, "view", name, code=3, timeout=60)
                self.assertIn(name, done.stderr)
                self.assertEqual(done.stdout, "")

    def test_a_file_without_certificates_is_named(self):
        with open(self.path("no.pem"), "w", encoding="utf-8") as file:
            file.write("-----BEGIN CERTIFICATE-----\nbm9uZQ==\n-----END CERTIFICATE-----\n")
        with open(self.path("none.pem"), "w", encoding="utf-8"):
            pass
        for name in ("no.pem", "none.pem"):
            said = self.cli("--server", "localhost:9", "--ca", name, "status", code=2).stderr
            self.assertEqual(said, f"gobo: INVALID_ARGUMENT: --ca {name}: holds no PEM certificate\n")
        self.assertIn("--cert no.pem: holds no PEM certificate", self.cli("--server", "localhost:9", "--cert", "no.pem", "--key", "no.pem", "status", code=2).stderr)

    def test_a_difference_is_a_png(self):
        for name in ("x.jpg", "x.exr", "x"):
            self.assertIn(f"--diff {name}: must end in .png", self.cli("compare", "nosuch.exr", "other.exr", "--diff", name, code=2).stderr)
            self.assertFalse(os.path.exists(self.path(name)))

    def test_output_that_cannot_be_written_is_a_failure(self):
        env = {**os.environ, "GOBO_SERVER": self.client.address}
        for words in (["man"], ["scenes"], ["--json", "status"], ["--version"], ["--help"], ["completion", "bash"], ["__complete", "ren"]):
            with open("/dev/full", "w", encoding="utf-8") as full:
                done = subprocess.run([CLI, *words], stdout=full, stderr=subprocess.PIPE, text=True, timeout=60, env=env)
            self.assertEqual((words, done.returncode), (words, 1))
            self.assertIn("cannot write to standard output: No space left on device", done.stderr)
        for word in ("--version", "--help", "--check"):
            with open("/dev/full", "w", encoding="utf-8") as full:
                done = subprocess.run([GOBOD, word], stdout=full, stderr=subprocess.PIPE, text=True, timeout=60)
            self.assertEqual((word, done.returncode), (word, 1))
            self.assertIn("gobod: cannot write to standard output", done.stderr)

    def test_names_that_are_not_utf8(self):
        folder = os.fsencode(self.path("d")) + b"\xff"
        os.mkdir(folder)
        with open(os.path.join(folder, b"s.glb"), "wb") as file:
            file.write(gobo.glb.pack(gltf(self.folder)))
        os.symlink(os.path.join(folder, b"s.glb"), os.path.join(folder, b"n\xff.glb"))
        env = {**os.environ, "GOBO_SERVER": self.client.address}
        picture = [b"--size", b"8x8", b"--spp", b"1", b"-q", b"-o"]

        def ran(*words):
            return subprocess.run([os.fsencode(CLI), *words], cwd=folder, capture_output=True, timeout=60, env=env, check=False)

        for place in ((), (b"--local",)):
            done = ran(*place, b"render", b"s.glb", *picture, b"a\xff.exr")
            self.assertEqual((done.returncode, b"UTF-8" in done.stderr), (0, False), done.stderr)
            os.remove(os.path.join(folder, b"a\xff.exr"))
            for words in ((b"render", b"n\xff.glb"), (b"render", b"cornell", b"--camera", b"\xff"), (b"render", b"cornell", b"--set", b"lights.\xff.gain=1"),
                          (b"render", b"cornell", b"--env", b"n\xff.glb"), (b"load", b"n\xff.glb"), (b"inspect", b"\xff"), (b"load", b"s.glb", b"--name", b"\xff")):
                done = ran(*place, *words, *(picture + [b"b.exr"] if words[0] == b"render" else []))
                self.assertEqual((words, done.returncode), (words, 2), done.stderr)
                self.assertIn(b"UTF-8", done.stderr)
                self.assertIn(b"\\xff", done.stderr)
                self.assertNotIn(b"libprotobuf", done.stderr)
        self.assertEqual(ran(b"render", b"none\xff.glb", *picture, b"b.exr").returncode, 3)
        self.assertFalse(os.path.exists(os.path.join(folder, b"b.exr")))

    def test_a_picture_that_does_not_fit_is_one_failure_in_parts_or_whole(self):
        def little():
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))

        for more in ((), ("--tile", "32")):
            done = subprocess.run([CLI, "render", "cornell", "--size", "96x64", "--spp", "1", *more, "-o", self.path("fits_not.exr")], capture_output=True, text=True,
                                  timeout=60, preexec_fn=little, env={**os.environ, "GOBO_SERVER": self.client.address}, check=False)
            self.assertEqual((more, done.returncode), (more, 2), done.stderr)
            self.assertIn("cannot write file: File too large", done.stderr)
            done = self.cli("render", "cornell", "--size", "96x64", "--spp", "1", *more, "-o", "no/such/folder.exr", code=3)
            self.assertIn("no such folder", done.stderr)
        self.assertEqual([name for name in os.listdir(self.folder) if "fits_not" in name], [])

    def test_a_fetched_file_that_does_not_fit_is_named(self):
        job = self.client.jobs.submit("cornell", width=64, height=48, spp=1)
        job.wait(timeout=100)
        self.assertIn("scene cornell, ", self.cli("jobs", "watch", job.id).stdout)

        def little():
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))

        done = subprocess.run([CLI, "jobs", "fetch", job.id, "-o", self.path("out")], capture_output=True, text=True,
                              timeout=60, preexec_fn=little,
                              env={**os.environ, "GOBO_SERVER": self.client.address})
        self.assertEqual(done.returncode, 2, done.stderr)
        self.assertIn("cannot write file: File too large", done.stderr)
        self.assertIn(self.path("out"), done.stderr)
        self.assertEqual(os.listdir(self.path("out")), [])


if __name__ == "__main__":
    unittest.main()
