# SPDX-License-Identifier: Apache-2.0
"""gobo regress bisect in a small repository whose build writes a program that is the built gobo with another lamp: the answer, how many builds it takes, that it goes on
where it was interrupted, and what is refused."""
import json
import math
import os
import pathlib
import signal
import subprocess
import tempfile
import time
import unittest

import numpy as np

import gobo
from support import CLI, gltf

SUITE = '[[case]]\nname = "box"\nscene = "cornell"\nsize = "32x24"\nspp = 2\n\n[[case]]\nname = "depth"\nscene = "cornell"\nsize = "32x24"\noutput = "depth"\nparts = 1\n'
# What a commit is: `lamp`, a gain (or "crash", "fails", "late"); `depth`, a line of that case; `build`, what its build says. The program puts them into the suite
# that it is given.
BUILD = r'''
echo built >> "$COUNT"
[ ! -e "$COUNT.broken" ] || { echo "no compiler today"; exit 2; }
[ "$(cat build)" = ok ] || { echo "cannot build this"; exit 2; }
mkdir -p out
cat > out/gobo <<'END'
#!/bin/sh
lamp=$(cat "$(dirname "$0")/../lamp")
[ "$lamp" = crash ] && kill -SEGV $$
[ "$lamp" = fails ] && exit 2
[ "$lamp" = late ] && { lamp=1,1,1; [ -e "$COUNT.deaf" ] && trap "" TERM; [ -e "$COUNT.go" ] || { echo $$ > "$COUNT.late"; sleep 60; }; }
[ "$1" = --local ] && [ "$2" = regress ] && [ "$3" = run ] || exit 64
suite=$4.$$.toml
sed "s/^spp = 2/&\nset = [\"lights.light.gain=$lamp\"]/; s/^parts = 1/&\n$(cat "$(dirname "$0")/../depth")/" "$4" > "$suite"
shift 4
"$CLI" --local --threads 1 regress run "$suite" "$@"
code=$?
rm "$suite"
exit $code
END
chmod +x out/gobo
'''


class Bisect(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="gobo-bisect-")
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        self.repo, self.work, self.count = self.folder / "repo", self.folder / "work", self.folder / "count"
        self.env = {**os.environ, "GIT_CONFIG_GLOBAL": "/dev/null", "HOME": str(self.folder), "COUNT": str(self.count), "CLI": CLI, "GOBO_SERVER": "unix:/nonesuch"}
        self.suite = self.folder / "s.toml"
        self.suite.write_text(SUITE, encoding="utf-8")
        self.repo.mkdir()
        self.git("init", "-q", "-b", "main")
        self.commits = []

    def git(self, *words):
        return subprocess.run(["git", "-C", self.repo, "-c", "user.name=T", "-c", "user.email=t@localhost", *words], check=True, capture_output=True, text=True, env=self.env).stdout

    def commit(self, subject, lamp="1,1,1", build="ok", depth=""):
        for name, text in (("lamp", lamp), ("build", build), ("depth", depth), ("build.sh", BUILD), (".gitignore", "out/\n"), ("notes", subject)):
            (self.repo / name).write_text(text, encoding="utf-8")
        self.git("add", "-A")
        self.git("commit", "-q", "-m", subject)
        self.commits.append(self.git("rev-parse", "HEAD").strip())
        return self.commits[-1]

    def accept(self):
        self.gobo("run", "s.toml", expect=3)
        self.gobo("accept", "s.toml", "--by", "Ada", "--why", "first")

    def gobo(self, *words, expect=0):
        done = subprocess.run([CLI, "--local", "regress", *map(str, words)], capture_output=True, text=True, timeout=300, cwd=self.folder, env=self.env, check=False)
        self.assertEqual(done.returncode, expect, done.stdout + done.stderr)
        return done

    def words(self, good, bad, *more):
        return ["bisect", "s.toml", *more, "--good", good, "--bad", bad, "--repo", self.repo, "--work", self.work, "--build", "sh build.sh", "--program", "out/gobo"]

    def bisect(self, good, bad, *more, expect=0):
        return self.gobo(*self.words(good, bad, *more), expect=expect)

    def answer(self, good, bad, *more, expect=0):
        done = subprocess.run([CLI, "--json", "regress", *map(str, self.words(good, bad, *more))], capture_output=True, text=True, timeout=300, cwd=self.folder, env=self.env, check=False)
        self.assertEqual(done.returncode, expect, done.stdout + done.stderr)
        return json.loads(done.stdout)

    def builds(self):
        return len(self.count.read_text().splitlines()) if self.count.exists() else 0

    def test_the_commit_its_figures_and_what_is_kept(self):
        self.accept()
        good = self.commit("first")
        for i in range(4):
            self.commit(f"irrelevant {i}")
        self.commit("does not build", build="no")
        culprit = self.commit("redder lamp", lamp="1.2,1,1")
        for i in range(3):
            self.commit(f"later {i}", lamp="1.2,1,1")
        (self.repo / "lamp").write_text("edited", encoding="utf-8")   # the user's worktree is at work
        (self.repo / "mine").write_text("untracked", encoding="utf-8")
        before = self.git("status", "--porcelain"), self.git("for-each-ref"), self.git("worktree", "list"), self.git("config", "--list", "--local"), self.git("reflog")
        said = self.bisect(good[:10], "HEAD", expect=1)   # the answer is next to one that does not build
        self.assertEqual(before, (self.git("status", "--porcelain"), self.git("for-each-ref"), self.git("worktree", "list"), self.git("config", "--list", "--local"), self.git("reflog")))
        self.assertEqual((self.repo / "lamp").read_text(), "edited")
        skips = said.stderr.count("  skip")
        self.assertLessEqual(self.builds(), 2 + math.ceil(math.log2(len(self.commits) - 1)) + skips)
        self.assertEqual(self.builds(), len(said.stderr.splitlines()))
        self.assertIn(f"the first bad commit is one of these 2: all but the last cannot be told\n{self.commits[5]}\n    does not build\n{culprit}\n    redder lamp\n", said.stdout)

    def test_exact_answer(self):
        self.accept()
        good = self.commit("first")
        for i in range(5):
            self.commit(f"irrelevant {i}")
        culprit = self.commit("redder \x1b[31mlamp", lamp="1.2,1,1")
        for i in range(6):
            self.commit(f"later {i}", lamp="1.2,1,1")
        said = self.bisect(good, "main")
        self.assertIn(f"first bad commit: {culprit}\n    redder \\x1b[31mlamp\n", said.stdout)
        self.assertLessEqual(self.builds(), 2 + math.ceil(math.log2(len(self.commits) - 1)))
        self.assertRegex(said.stdout, rf"box +{self.commits[5][:12]} +same .*\nbox +{culprit[:12]} +changed .*red.*\ndepth +{self.commits[5][:12]} +same .*\ndepth +{culprit[:12]} +same ")
        # Asked again nothing is built; another question is.
        built = self.builds()
        found = self.answer(good, "main")
        self.assertEqual((found["first_bad"], found["builds"], self.builds()), ({"commit": culprit, "subject": "redder \x1b[31mlamp"}, 0, built))
        box = next(c for c in found["cases"] if c["case"] == "box")
        self.assertEqual((box["before"]["status"], box["before"]["excess"], box["after"]["status"]), ("same", 0, "changed"))
        self.assertGreater(box["after"]["excess"], 6)
        self.assertGreater(box["after"]["mean_now"], box["before"]["mean_now"])
        self.assertEqual(found["before"]["commit"], self.commits[5])
        said = self.bisect(good, "main", "depth", expect=2)
        self.assertIn(f'--bad = "main" ({self.commits[-1][:12]}): passes: every case passes', said.stderr)
        self.assertEqual(self.builds(), built + 2)

    def test_commits_that_cannot_be_told_leave_several(self):
        self.accept()
        good = self.commit("first")
        self.commit("second")
        broken = [self.commit("does not build", build="no"), self.commit("crashes", lamp="crash"), self.commit("fails", lamp="fails")]
        last = self.commit("redder", lamp="1.2,1,1")
        for i in range(2):
            self.commit(f"later {i}", lamp="1.2,1,1")
        found = self.answer(good, "HEAD", expect=1)
        self.assertIsNone(found["first_bad"])
        self.assertEqual([c["commit"] for c in found["suspects"]], broken + [last])
        self.assertLessEqual(found["builds"], 2 + math.ceil(math.log2(7)) + 3)
        said = self.bisect(good, "HEAD", expect=1)
        self.assertIn("one of these 4: all but the last cannot be told", said.stdout)
        self.assertRegex(said.stderr, r"skip\* does not build \(its build left with exit code 2: .*build\.log\)")
        self.assertRegex(said.stderr, r"skip\* crashes \(its program was ended by signal 11: .*run\.log\)")
        self.assertRegex(said.stderr, r"skip\* fails \(its program left with exit code 2 without a record of the run: .*run\.log\)")
        self.assertIn("cannot build this", (self.work / "commits" / broken[0] / "build.log").read_text())

    def test_head_is_the_worktrees_own(self):
        self.accept()
        good = self.commit("first")
        self.git("worktree", "add", "-q", "-b", "side", self.folder / "linked")
        self.commit("later on main")
        linked, self.repo = self.repo, self.folder / "linked"
        culprit = self.commit("redder on the side", lamp="1.2,1,1")
        self.assertEqual(self.answer(good, "HEAD")["first_bad"]["commit"], culprit)
        self.assertEqual(self.answer("HEAD~1", "HEAD")["first_bad"]["commit"], culprit)
        self.repo = linked
        self.assertIn("passes", self.bisect(good, "HEAD", expect=2).stderr)

    def test_files_of_the_cases_are_part_of_the_question(self):
        sky = np.linspace(0.1, 3, 8)[:, None] * np.ones((8, 16))

        def write(gain):
            gobo.exr.write(str(self.folder / "sky.exr"), {c: (gain * sky).astype(np.float32) for c in "RGB"})
        write(1)
        gltf(self.folder)
        self.suite.write_text(SUITE + '\n[[case]]\nname = "sky"\nscene = "tri.gltf"\nsize = "32x24"\nspp = 4\nset = ["environment.path=sky.exr"]\n', encoding="utf-8")
        self.accept()
        good = self.commit("first")
        bad = self.commit("redder", lamp="1.2,1,1")
        self.assertEqual((self.answer(good, bad)["first_bad"]["commit"], self.builds()), (bad, 2))
        self.assertEqual((self.answer(good, bad)["first_bad"]["commit"], self.builds()), (bad, 2))
        for count, name in ((4, "tri data.bin"), (6, "sky.exr")):        # a buffer beside the .gltf, the map
            os.utime(self.folder / name, (1e9, 1e9))
            self.assertEqual((self.answer(good, bad)["first_bad"]["commit"], self.builds()), (bad, count), name)
        write(2)
        self.assertIn('fails already: case "sky" is changed', self.bisect(good, bad, expect=2).stderr)
        # A map that is named by an absolute path is one too.
        write(1)
        self.suite.write_text(self.suite.read_text().replace("=sky.exr", f"={self.folder}/sky.exr"), encoding="utf-8")
        self.answer(good, bad)
        write(2)
        self.assertIn('fails already: case "sky" is changed', self.bisect(good, bad, expect=2).stderr)

    def test_ends_that_could_not_be_told_are_tried_again(self):
        self.accept()
        good = self.commit("first")
        skipped = self.commit("does not build", build="no")
        bad = self.commit("redder", lamp="1.2,1,1")
        broken = pathlib.Path(str(self.count) + ".broken")
        broken.touch()
        for tries in (1, 2):
            self.assertIn(f'--good = "{good}" ({good[:12]}): cannot be told: its build left with exit code 2', self.bisect(good, bad, expect=2).stderr)
            self.assertEqual(self.builds(), tries)
        broken.unlink()
        found = self.answer(good, bad, expect=1)
        self.assertEqual(([c["commit"] for c in found["suspects"]], found["builds"]), ([skipped, bad], 3))
        self.assertEqual(self.answer(good, bad, expect=1)["builds"], 0)     # a skip between the ends is kept

    def test_two_changes_and_a_merge(self):
        self.accept()
        good = self.commit("first")
        self.git("checkout", "-q", "-b", "side")
        self.commit("redder", lamp="1.2,1,1")
        self.git("checkout", "-q", "main")
        self.git("merge", "-q", "--no-ff", "-m", "merge of side", "side")
        merge = self.git("rev-parse", "HEAD").strip()
        nearer = self.commit("nearer", lamp="1.2,1,1", depth='set = ["camera.yfov_deg=20"]')
        said = self.bisect(good, "main")
        self.assertIn(f"first bad commit: {merge}\n    merge of side\nIt is a merge: ", said.stdout)
        self.assertIn(f'Case "depth" changed later: gobo regress bisect s.toml depth --good {merge[:12]} --bad main\n', said.stdout)
        self.assertEqual(self.answer(merge, "main", "depth")["first_bad"]["commit"], nearer)

    def start(self, good, bad):
        """A bisection that has come to the commit that sleeps."""
        late = pathlib.Path(str(self.count) + ".late")
        late.unlink(missing_ok=True)
        process = subprocess.Popen([CLI, "--local", "regress", *map(str, self.words(good, bad))], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, cwd=self.folder, env=self.env)
        deadline = time.monotonic() + 120
        while not (late.exists() and late.read_text().endswith("\n")) and time.monotonic() < deadline:
            time.sleep(0.02)
        return process, int(late.read_text())

    def living(self, group):
        """Processes of a group that have not ended; those that nobody has waited for yet have. Signals take a moment to arrive."""
        deadline = time.monotonic() + 20
        while True:
            left = []
            for stat in pathlib.Path("/proc").glob("[0-9]*/stat"):
                try:
                    state, _, its_group = stat.read_text().rpartition(")")[2].split()[:3]
                except (FileNotFoundError, ProcessLookupError):
                    continue
                if int(its_group) == group and state not in "ZX":
                    left.append(stat.parent.name)
            if not left or time.monotonic() > deadline:
                return left
            time.sleep(0.05)

    def test_interrupted_it_goes_on(self):
        self.accept()
        good = self.commit("first")
        self.commit("late", lamp="late")
        bad = self.commit("redder", lamp="1.2,1,1")
        process, child = self.start(good, bad)
        self.assertIn("another bisection is at work there", self.bisect(good, bad, expect=2).stderr)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=30)
        self.assertEqual(process.returncode, 5, said)
        self.assertEqual(self.living(child), [])                     # all that it has started has ended
        self.assertEqual(self.builds(), 3)
        process, child = self.start(good, bad)                       # the ends are known; kill -9 leaves what it leaves
        process.kill()
        process.communicate()
        os.killpg(child, signal.SIGKILL)
        self.assertEqual(self.builds(), 4)
        (self.work / "tree" / ".git" / "index.lock").touch()
        pathlib.Path(str(self.count) + ".go").touch()
        found = self.answer(good, bad)
        self.assertEqual((found["first_bad"]["commit"], found["builds"]), (bad, 1))
        # A verdict that is damaged, and a clone that is, are made again; a repository around the clone is not taken for it.
        (self.work / "commits" / good / "verdict.json").write_text("{", encoding="utf-8")
        (self.work / "tree" / ".git" / "HEAD").unlink()
        self.git("-C", self.work, "init", "-q")
        self.assertEqual(self.answer(good, bad)["builds"], 1)
        self.assertTrue((self.work / "lock").exists())

    def test_interrupted_twice_it_leaves_nothing_behind(self):
        self.accept()
        good = self.commit("first")
        self.commit("late", lamp="late")
        bad = self.commit("redder", lamp="1.2,1,1")
        pathlib.Path(str(self.count) + ".deaf").touch()              # so that it waits for the child when it is asked again
        process, child = self.start(good, bad)
        process.send_signal(signal.SIGINT)
        time.sleep(0.5)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=30)
        self.assertEqual(process.returncode, 5, said)
        self.assertEqual(self.living(child), [])

    def test_what_ends_the_child_as_well_is_no_verdict(self):
        self.accept()
        good = self.commit("first")
        late = self.commit("late", lamp="late")
        bad = self.commit("redder", lamp="1.2,1,1")
        process, child = self.start(good, bad)
        process.send_signal(signal.SIGTERM)                          # as a service's stop: every process of it
        try:
            os.killpg(child, signal.SIGTERM)
        except ProcessLookupError:
            pass                                                     # the bisection was faster
        _, said = process.communicate(timeout=30)
        self.assertEqual(process.returncode, 5, said)
        self.assertFalse((self.work / "commits" / late / "verdict.json").exists())
        pathlib.Path(str(self.count) + ".go").touch()
        self.assertEqual(self.answer(good, bad)["first_bad"]["commit"], bad)

    def test_refusals(self):
        self.accept()
        good = self.commit("first")
        bad = self.commit("redder", lamp="1.2,1,1")
        other = self.commit("other")
        for words, expect, told in (
                ((["nonesuch", bad]), 2, '--good = "nonesuch": git knows no such commit'),
                ((["--all", bad]), 2, "--good"),
                (([good, "main~9"]), 2, '--bad = "main~9": git knows no such commit'),
                (([bad, good]), 2, f"--good = {bad[:12]}, --bad = {good[:12]}: good must be an ancestor of bad: it is the other way round"),
                (([good, good]), 2, "are the same commit"),
                (([bad, other]), 2, f'--good = "{bad}" ({bad[:12]}): fails already: case "box" is changed'),
                (([good, other]), 2, f'--bad = "{other}" ({other[:12]}): passes'),
                (([good, bad, "nobody"]), 3, 'no case "nobody"'),
                (([good, bad, "--repo", "/nonesuch"]), 2, '--repo = "/nonesuch": is no folder'),
                (([good, bad, "--repo", "/"]), 2, '--repo = "/": fatal: not a git repository'),
                (([good, bad, "--build", ""]), 2, '--build = ""'),
                (([good, bad, "--program", "/bin/true"]), 2, '--program = "/bin/true": must be a path below'),
                (([good, bad, "--program", "nonesuch"]), 2, f'--good = "{good}" ({good[:12]}): cannot be told: its build makes no program "nonesuch" (--program)'),
                (([good, bad, "--limit", "0.0001"]), 2, f'--good = "{good}" ({good[:12]}): cannot be told: its build took longer than allowed'),
                (([good, bad, "--work", "/proc/nonesuch"]), 2, '--work = "/proc/nonesuch": cannot be written to')):
            words, more = words[:2], words[2:]
            command = self.words(*words)
            for i in range(0, len(more), 2):
                if more[i].startswith("--"):
                    if more[i] in command:
                        at = command.index(more[i])
                        del command[at:at + 2]
                    command += more[i:i + 2]
                else:
                    command.insert(2, more[i])
            with self.subTest(words=words, more=more):
                self.assertIn(told, self.gobo(*command, expect=expect).stderr)
        self.git("checkout", "-q", "-b", "side", good)
        side = self.commit("on the side")
        self.git("checkout", "-q", "main")
        self.assertRegex(self.bisect(side, bad, expect=2).stderr, r"good must be an ancestor of bad \(at|good must be an ancestor of bad\n")
        self.git("merge", "-q", "--no-ff", "-X", "ours", "-m", "merge", "side")
        self.assertIn("not along first parents", self.bisect(side, "main", expect=2).stderr)
        self.suite.write_text(SUITE.replace('"depth"\nscene', '"new"\nscene'), encoding="utf-8")
        self.assertIn('case "new": nothing is accepted for it', self.bisect(good, bad, expect=3).stderr)


if __name__ == "__main__":
    unittest.main()
