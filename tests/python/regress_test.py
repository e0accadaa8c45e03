# SPDX-License-Identifier: Apache-2.0
"""gobo regress from the first run to the report: exit codes, what is written, what is refused."""
import json
import os
import pathlib
import re
import signal
import subprocess
import tempfile
import time
import unittest
import xml.etree.ElementTree

from support import CLI

BOX = '[[case]]\nname = "box"\nscene = "cornell"\nsize = "48x36"\nspp = 4\n'


class Regress(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="gobo-regress-")
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def suite(self, text):
        (self.folder / "s.toml").write_text(text, encoding="utf-8")

    def gobo(self, act, *words, expect=0, local=True):
        done = subprocess.run([CLI, *(["--local"] if local else []), "regress", act, "s.toml", *words], capture_output=True, text=True, timeout=300, cwd=self.folder,
                              env={**os.environ, "GOBO_SERVER": "unix:/nonesuch"})
        self.assertEqual(done.returncode, expect, done.stdout + done.stderr)
        return done

    def accept(self, *cases, why="because"):
        return self.gobo("accept", *cases, "--by", "Ada", "--why", why)

    def statuses(self):
        run = json.loads((self.folder / "s.out/run.json").read_text())
        return {c["case"]: c["status"] for c in run["cases"]}

    def log(self):
        return [json.loads(line) for line in (self.folder / "references/accepted.jsonl").read_text().splitlines()]

    def test_from_the_first_run_to_a_change_that_is_accepted(self):
        self.suite(BOX)
        self.assertIn("nothing is accepted yet", self.gobo("run", expect=3).stdout)
        self.assertEqual(self.statuses(), {"box": "missing"})
        self.assertIn("accepted box", self.accept(why="first <pictures>").stdout)
        self.gobo("run")
        self.assertEqual(self.statuses(), {"box": "same"})
        self.suite(BOX + "seed = 5\n")                                     # another seed: other bits, no change
        self.gobo("run")
        self.assertEqual(self.statuses(), {"box": "noise"})
        self.suite(BOX + 'set = ["lights.light.gain=1.02,1,1"]\n')        # the lamp 2 % redder
        said = self.gobo("run", expect=1).stdout
        self.assertEqual(self.statuses(), {"box": "changed"})
        self.assertIn("red - green", said)
        self.gobo("report", expect=1)
        self.assertIn("accepted box", self.accept("box", why="redder on purpose").stdout)
        self.gobo("run")
        self.assertEqual([(e["case"], e["by"], e["why"]) for e in self.log()], [("box", "Ada", "first <pictures>"), ("box", "Ada", "redder on purpose")])
        self.assertIn("nothing to accept", self.accept().stdout)
        objects = [p.name for p in (self.folder / "references/objects").rglob("*.exr")]
        self.assertEqual(sorted(objects), sorted(e["digest"] + ".exr" for e in self.log()))

    def test_what_a_run_writes(self):
        self.suite(BOX)
        self.gobo("run", expect=3)
        self.accept(why="<b>first</b>")
        self.suite(BOX + 'set = ["lights.light.gain=1.2,1,1"]\n')
        self.gobo("run", expect=1)
        out = self.folder / "s.out"
        page = (out / "report.html").read_text(encoding="utf-8")
        self.assertEqual(len(re.findall(r'src="data:image/png;base64,[A-Za-z0-9+/=]+"', page)), 3)
        self.assertEqual(re.findall(r'(?:src|href)="(?!data:|#)[^"]*"', page), [])        # one file: nothing is fetched
        self.assertIn("&lt;b&gt;first", page)
        self.assertIn("<polyline", page)
        tree = xml.etree.ElementTree.parse(out / "junit.xml").getroot()
        self.assertEqual((tree.get("tests"), tree.get("failures"), tree.get("errors")), ("1", "1", "0"))
        self.assertIn("standard deviations above noise", tree.find("testcase/failure").get("message"))
        self.assertEqual(len((out / "history.jsonl").read_text().splitlines()), 2)
        for kind in ("now", "reference", "evidence"):
            self.assertTrue((out / f"box.{kind}.png").read_bytes().startswith(b"\x89PNG"), kind)
        (out / "report.html").unlink()
        self.gobo("report", expect=1)
        self.assertEqual((out / "report.html").read_text(encoding="utf-8"), page)

    def test_plan_and_rays(self):
        self.suite(BOX)
        self.gobo("run", expect=3)
        self.accept()
        self.suite(BOX + 'max_rays = 0.5\n')
        self.assertIn("max_rays = 0.5", self.gobo("run", expect=1).stdout)
        self.assertEqual(self.statuses(), {"box": "slower"})
        self.suite(BOX + 'max_time = 1e-6\n')
        self.assertIn("max_time = 1e-06", self.gobo("run", expect=1).stdout)
        self.assertEqual(self.statuses(), {"box": "slower"})
        self.suite(BOX + 'set = ["denoise=wavelet"]\n')
        self.gobo("run", expect=1)
        run = json.loads((self.folder / "s.out/run.json").read_text())
        self.assertIn("+ beauty by wavelet", run["cases"][0]["plan_difference"])

    def test_only_named_cases(self):
        self.suite(BOX + BOX.replace('"box"', '"other"'))
        self.gobo("run", "other", expect=3)
        self.assertEqual(self.statuses(), {"other": "missing"})
        self.assertIn("not in the last run", self.gobo("accept", "box", "--by", "A", "--why", "b", expect=3).stderr)
        self.accept("other")
        self.gobo("run", "other")
        self.assertIn('no case "nobody"', self.gobo("run", "nobody", expect=3).stderr)

    def test_refusals(self):
        self.assertIn("no such file", self.gobo("run", expect=3).stderr)
        self.suite("")
        self.assertIn("s.toml: names nothing to render", self.gobo("run", expect=2).stderr)
        self.suite(BOX.replace("spp", "ssp"))
        self.assertIn('s.toml:5: [[case]]: unknown key "ssp" = 4', self.gobo("run", expect=2).stderr)
        self.suite(BOX)
        self.assertIn("no run:", self.gobo("report", expect=3).stderr)
        self.assertIn("--why", self.gobo("accept", "--by", "Ada", expect=2).stderr)
        self.assertIn("--by", self.gobo("accept", "--by", "", "--why", "x", expect=2).stderr)
        self.gobo("run", expect=3)
        self.accept()
        self.suite(BOX.replace("48x36", "48x37"))
        said = self.gobo("run", expect=2)
        self.assertIn('case "box": size = 48x37, but the reference, accepted by Ada', said.stderr)
        self.assertEqual(self.statuses(), {"box": "failed"})
        self.suite(BOX.replace("spp = 4", "spp = 5"))
        self.assertIn("spp = 5", self.gobo("run", expect=2).stderr)
        self.suite(BOX + "parts = 9\n")
        self.assertIn("parts = 9, but the reference", self.gobo("run", expect=2).stderr)
        self.suite(BOX + 'output = "direct"\n')
        self.assertIn("output = direct, but the reference", self.gobo("run", expect=2).stderr)
        self.suite(BOX.replace("cornell", "nonesuch") + BOX.replace('"box"', '"good"'))     # one bad case does not hide the others
        self.gobo("run", expect=3)
        self.assertEqual(self.statuses(), {"box": "failed", "good": "missing"})
        self.assertIn("cannot reach", self.gobo("run", expect=4, local=False).stderr)

    def test_what_was_not_looked_at_is_not_accepted(self):
        self.suite(BOX)
        self.gobo("run", expect=3)
        parts = self.folder / "s.out/box.parts.exr"
        parts.write_bytes(parts.read_bytes() + b"x")
        self.assertIn("is not what the last run wrote", self.gobo("accept", "--by", "A", "--why", "b", expect=2).stderr)
        self.assertFalse((self.folder / "references/accepted.jsonl").exists())

    def test_a_damaged_reference_is_no_pass(self):
        self.suite(BOX)
        self.gobo("run", expect=3)
        self.accept()
        reference = next((self.folder / "references/objects").rglob("*.exr"))
        data = bytearray(reference.read_bytes())
        data[-3] ^= 1
        reference.write_bytes(data)
        self.assertIn("other bytes than its name says", self.gobo("run", expect=1).stderr)
        self.assertEqual(self.statuses(), {"box": "failed"})
        self.assertIn("nothing to accept", self.accept().stdout)                            # unasked, what failed is not taken
        self.accept("box", why="mended")
        self.gobo("run")
        self.assertEqual(self.statuses(), {"box": "same"})

    def section(self, case):
        page = (self.folder / "s.out/report.html").read_text(encoding="utf-8")
        return re.search(rf'<section class="case" id="{case}">.*?</section>', page, re.DOTALL).group()

    def test_pictures_are_of_this_run(self):
        other = BOX.replace('"box"', '"other"')
        self.suite(BOX + other)
        self.gobo("run", expect=3)
        self.assertIn("Nothing is accepted yet: this run.", self.section("box"))
        self.accept()
        for fails in ('output = "nonesuch"\n', 'parts = 1\noutput = "motion"\n'):      # no render, and one that cannot be held against anything
            self.suite(BOX + other)
            self.gobo("run")
            self.assertEqual(self.section("box").count("<img"), 3)
            self.suite(BOX + fails + other)
            self.gobo("run", expect=2)
            self.assertEqual(self.statuses(), {"box": "failed", "other": "same"})
            self.assertNotIn("<img", self.section("box"))
            self.assertEqual(self.section("other").count("<img"), 3)
            self.assertEqual([p.name for p in (self.folder / "s.out").glob("box.*")], [])
            self.gobo("report", expect=2)
            self.assertNotIn("<img", self.section("box"))
        self.suite(BOX.replace("spp = 4", "spp = 5") + other)
        self.gobo("run", expect=2)
        self.assertEqual(self.section("box").count("<img"), 1)
        self.assertIn("<p>This run.</p>", self.section("box"))
        self.assertNotIn("Nothing is accepted yet", self.section("box"))
        # A server that is away makes no run: the last one keeps its pictures.
        self.gobo("run", expect=4, local=False)
        self.gobo("report", expect=2)
        self.assertEqual((self.section("box").count("<img"), self.section("other").count("<img")), (1, 3))

    def test_interrupted_it_leaves_the_last_run(self):
        self.suite(BOX)
        self.gobo("run", expect=3)
        out = self.folder / "s.out"
        before = {p.name: p.read_bytes() for p in out.iterdir()}
        self.suite(BOX.replace("spp = 4", "spp = 100000"))
        process = subprocess.Popen([CLI, "--local", "regress", "run", "s.toml"], cwd=self.folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        time.sleep(1)
        process.send_signal(signal.SIGTERM)
        _, said = process.communicate(timeout=60)
        self.assertEqual(process.returncode, 5, said)
        self.assertEqual({p.name: p.read_bytes() for p in out.iterdir()}, before)

    def test_channels(self):
        self.suite(BOX.replace("spp = 4", 'spp = 4\nparts = 1\noutput = "motion"'))
        self.assertIn('output = "motion" has two channels', self.gobo("run", expect=2).stderr)

    def test_the_hint_names_the_folder(self):
        self.suite(BOX)
        self.assertIn("--out there", self.gobo("run", "--out", "there", expect=3).stdout)


if __name__ == "__main__":
    unittest.main()
