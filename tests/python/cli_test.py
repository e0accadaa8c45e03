# SPDX-License-Identifier: Apache-2.0
"""The CLI beyond rendering: completion in real shells, the manual page, the progress bar, exit codes."""
import csv
import os
import pty
import re
import select
import shutil
import subprocess
import time
import unittest

from support import CLI, DaemonTest


class Completion(DaemonTest):
    def offers(self, *words):
        return [line.split("\t")[0] for line in self.cli("__complete", *words).stdout.splitlines()]

    def test_commands_and_options(self):
        commands = self.offers("")
        helped = re.search(r"Subcommands:\n(.*?)\n\n", self.cli("--help").stdout, re.S).group(1)
        self.assertEqual(commands, [line.split()[0] for line in helped.splitlines() if re.match(r"  \w", line)])
        for command in (["render"], ["jobs", "submit"]):        # every option that a command's help names is offered
            named = set(re.findall(r"^  (?:-\w,)?(--[\w-]+)", self.cli(*command, "--help").stdout, re.M))
            self.assertGreater(len(named), 10)
            self.assertLessEqual(named, set(self.offers(*command, "--")), command)
        self.assertIn("--server", self.offers("render", "--se"))
        self.assertEqual(self.offers("jobs", "wa"), ["watch"])

    def test_scenes(self):
        self.client.scenes.open("cornell", "loaded-one")
        offered = self.offers("render", "")
        self.assertEqual([n for n in self.client.scenes.builtin() if n not in offered], [])
        self.assertIn("loaded-one", offered)
        self.assertIn(":file", offered)
        self.assertEqual(self.offers("render", "loaded-o"), ["loaded-one", ":file"])
        self.assertEqual(self.offers("unload", "loaded-o"), ["loaded-one"])
        self.assertEqual(self.offers("render", "loaded-one", "--camera", ""), ["front"])
        self.assertEqual(self.offers("render", "loaded-one", "--camera=f"), ["--camera=front"])

    def test_outputs_paths_and_enums(self):
        self.client.scenes.open("cornell", "loaded-two")
        self.assertIn("beauty", self.offers("render", "x", "--outputs", ""))
        self.assertEqual(self.offers("render", "x", "--outputs", "beauty,dep"), ["beauty,depth"])
        self.assertEqual(self.offers("render", "loaded-two", "--outputs", "visibility:"), ["visibility:light"])
        self.assertEqual(self.offers("render", "x", "--set", "integ"), ["integrator."])
        self.assertEqual(self.offers("render", "x", "--set", "integrator.max_b"), ["integrator.max_bounces="])
        self.assertEqual(self.offers("render", "x", "--set", "integrator.light_selection=T"), ["integrator.light_selection=TREE"])
        self.assertEqual(self.offers("render", "loaded-two", "--set", "lights."), ["lights.light."])
        self.assertEqual(self.offers("render", "x", "--set", "lights.any.name.int"), [])
        self.assertEqual(self.offers("render", "x", "--set", "lights.key.shadow.axis_aligned.mea"), ["lights.key.shadow.axis_aligned.mean_samples="])
        self.assertEqual(self.offers("render", "x", "--priority", "B"), ["BATCH"])
        self.assertEqual(self.offers("completion", ""), ["bash", "zsh", "fish"])
        self.assertEqual(self.offers("render", "x", "--out", ""), [":file"])

    def test_without_a_server(self):
        env = {**os.environ, "GOBO_SERVER": "unix:/nonesuch"}
        done = subprocess.run([CLI, "__complete", "render", "corn"], capture_output=True, text=True, env=env, timeout=60)
        self.assertEqual((done.returncode, done.stdout, done.stderr), (0, "cornell\tbuilt-in\n:file\n", ""))

    def bash(self, line):
        script = (f"source <('{CLI}' completion bash); complete -p gobo >/dev/null || exit 9; COMP_LINE={line!r}; COMP_POINT=${{#COMP_LINE}}; "
                  "_gobo; printf '%s\\n' \"${COMPREPLY[@]}\"")
        env = {**os.environ, "PATH": os.path.dirname(CLI) + ":" + os.environ["PATH"], "GOBO_SERVER": self.client.address}
        done = subprocess.run(["bash", "--norc", "-c", script], capture_output=True, text=True, env=env, timeout=60, cwd=self.folder)
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        return done.stdout.split()

    def test_in_bash(self):
        self.assertEqual(self.bash("gobo rend"), ["render"])
        self.assertEqual(self.bash("gobo jobs wat"), ["watch"])
        self.assertEqual(self.bash("gobo render x --set integrator.light_selection=T"), ["TREE"])   # readline has the rest already
        self.assertEqual(self.bash("gobo render x --outputs visib"), ["visibility:"])
        with open(self.path("my scene.glb"), "wb"):
            pass
        self.assertEqual(self.bash("gobo render my"), ["my", "scene.glb"])

    def test_scripts_parse(self):
        for shell in ("bash", "zsh", "fish"):
            path = self.path(shell)
            with open(path, "w", encoding="utf-8") as file:
                file.write(self.cli("completion", shell).stdout)
            with self.subTest(shell=shell):
                if shutil.which(shell) is None:
                    self.skipTest(f"{shell} is not installed")
                done = subprocess.run([shell, "-n", path], capture_output=True, text=True, timeout=60)
                self.assertEqual((done.returncode, done.stderr), (0, ""))
        self.cli("completion", "tcsh", code=2)

    def test_in_fish(self):
        if shutil.which("fish") is None:
            self.skipTest("fish is not installed")
        env = {**os.environ, "PATH": os.path.dirname(CLI) + ":" + os.environ["PATH"], "GOBO_SERVER": self.client.address, "HOME": self.folder}
        script = "gobo completion fish | source; complete -C 'gobo jobs wat'; complete -C 'gobo render x --priority B'"
        done = subprocess.run(["fish", "--no-config", "-c", script], capture_output=True, text=True, env=env, timeout=60)
        self.assertEqual([line.split("\t")[0] for line in done.stdout.splitlines()], ["watch", "BATCH"], done.stderr)


class Occlusion(DaemonTest):
    """`gobo occlusion` on a spot light over spheres: rays, maps, and what the line is made of."""

    ARGS = ("occlusion", "spheres", "--size", "48x32", "--set", "lights.lamp.kind=SPOT", "--set", "lights.lamp.position=0.5,3,1", "--set", "lights.lamp.direction=0,-1,-0.2",
            "--set", "lights.lamp.outer_deg=50", "--set", "lights.lamp.intensity=9", "--set", "shadows.map.resolution=128", "--light", "lamp")

    def table(self, *args):
        shown = self.cli(*self.ARGS, "--csv", "line.csv", *args).stdout
        with open(self.path("line.csv"), newline="", encoding="utf-8") as file:
            rows = list(csv.reader(file))
        return shown, rows[0], rows[1:]

    def test_line(self):
        chosen = "ray_traced.samples=1;shadow_map;exponential.c=80,map.blur=0;variance"
        shown, head, rows = self.table("--row", "20", "--techniques", chosen, "--plot", "line.png")
        self.assertEqual(head, ["pixel", "truth", *chosen.split(";")])
        self.assertEqual([int(float(r[0])) for r in rows], list(range(48)))
        # The line is the row of the output that `gobo render` writes, bit for bit.
        fields = dict(size=(48, 32), outputs=["visibility:lamp", "alpha"],
                      lights={"lamp": {"kind": "spot", "position": (0.5, 3, 1), "direction": (0, -1, -0.2), "outer_deg": 50, "intensity": 9}})
        for column, technique in ((1, {"ray_traced": {"samples": 256}}), (3, {"shadow_map": {}, "map": {"resolution": 128}}),
                                  (4, {"exponential": {"c": 80}, "map": {"resolution": 128, "blur": 0}})):
            result = self.client.render("spheres", shadows=technique, **fields)
            visibility, alpha = (result.outputs[o][20].reshape(48) for o in ("visibility:lamp", "alpha"))
            got = [float(r[column]) if r[column] else None for r in rows]
            self.assertEqual(got, [float(v) if a > 0 else None for v, a in zip(visibility, alpha)], technique)
        truth = [float(r[1]) for r in rows if r[1]]
        self.assertGreater(max(truth) - min(truth), 0.5)                        # there is a shadow on it
        self.assertEqual([r[2] for r in rows], [r[1] for r in rows])            # a spot light needs one ray
        self.assertRegex(shown, r"ray_traced.samples=1 +[\d.]+ +0.0000 +0.0000 +0.0000")
        with open(self.path("line.png"), "rb") as file:
            self.assertEqual(file.read(8), b"\x89PNG\r\n\x1a\n")

    def test_default_is_every_technique_that_does_the_light(self):
        shown, head, rows = self.table("--column", "24")
        self.assertEqual(len(rows), 32)
        for name in ("shadow_map", "percentage_closer", "variance", "convolution", "exponential", "exponential_variance", "moment"):
            self.assertIn(name, head)
            self.assertRegex(shown, rf"(?m)^{name} ")
        for name in ("ray_traced", "auto", "axis_aligned"):                      # the truth, a choice, area lights only
            self.assertNotIn(name, head)

    def test_refusals(self):
        def refused(code, words, *args):
            self.assertIn(words, self.cli(*args, code=code).stderr)
        refused(2, "which one?", "occlusion", "lights8", "--size", "8x8")
        refused(3, "no such light", *self.ARGS[:-1], "nonesuch")
        refused(2, "names no technique", *self.ARGS, "--techniques", "map.blur=2")
        refused(2, "exponental", *self.ARGS, "--techniques", "moment;exponental.c=2")
        refused(2, "no visibility of its own", *self.ARGS, "--techniques", "path_traced")
        refused(2, "does not do the kind of light", *self.ARGS, "--techniques", "axis_aligned")
        refused(2, "--row 32: the picture has 32", *self.ARGS, "--row", "32")
        refused(2, "excludes", *self.ARGS, "--row", "1", "--column", "1")
        refused(2, "must end in .png", *self.ARGS, "--plot", "line.exr")
        refused(2, "exponential.c=90", *self.ARGS, "--techniques", "exponential.c=90,exponential.filtering=LINEAR")

    def test_completion(self):
        offers = lambda *words: [line.split("\t")[0] for line in self.cli("__complete", "occlusion", *words).stdout.splitlines()]
        self.client.scenes.open("lights8", "loaded-three")
        self.assertIn("key", offers("loaded-three", "--light", ""))
        self.assertEqual(offers("x", "--techniques", "moment;exponential.cl"), ["moment;exponential.classification="])
        self.assertEqual(offers("x", "--techniques", "exponential.c=80,map.bl"), ["exponential.c=80,map.blur="])
        self.assertEqual(offers("x", "--techniques", "map.lookup=T"), ["map.lookup=TRILINEAR"])
        self.assertIn("variance", offers("x", "--techniques", "va"))


class Manual(DaemonTest):
    def test_page(self):
        page = self.cli("man").stdout
        plain = page.replace("\\-", "-")
        for text in ("SH NAME", "SH REQUEST FIELDS", "SH EXIT STATUS", "\\fB--outputs\\fR", "jobs submit", "lights.NAME.intensity", "integrator.max_bounces",
                     "default 8; at least 0; at most 64", "GOBO_TOKEN", "shadows.axis_aligned.k"):
            self.assertIn(text, plain)
        self.assertNotIn(f"gobo-{os.getuid()}.sock", plain)
        for code in range(7):
            self.assertIn(f"\n.B {code}\n", page)

    def test_troff_is_clean(self):
        if shutil.which("man") is None:
            self.skipTest("man is not installed")
        with open(self.path("gobo.1"), "w", encoding="utf-8") as file:
            file.write(self.cli("man").stdout)
        done = subprocess.run(["man", "--warnings", "-E", "UTF-8", "-l", self.path("gobo.1")], capture_output=True, text=True, timeout=60,
                              env={**os.environ, "MANWIDTH": "120", "LC_ALL": "C.UTF-8"})
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        self.assertGreater(len(done.stdout), 5000)


class Terminal(DaemonTest):
    def terminal(self):
        try:
            return pty.openpty()
        except OSError as e:   # a bare container has no /dev/pts
            self.skipTest(f"no pseudo terminal: {e}")

    def on_terminal(self, *args):
        master, slave = self.terminal()
        env = {**os.environ, "GOBO_SERVER": self.client.address}
        process = subprocess.Popen([CLI, *args], stdout=subprocess.PIPE, stderr=slave, env=env, cwd=self.folder)
        os.close(slave)
        seen = b""
        end = time.monotonic() + 60
        while time.monotonic() < end:
            ready, _, _ = select.select([master], [], [], 0.1)
            if ready:
                try:
                    piece = os.read(master, 4096)
                except OSError:
                    break
                if not piece:
                    break
                seen += piece
            elif process.poll() is not None:
                break
        out = process.communicate(timeout=60)[0]
        os.close(master)
        return process.returncode, out, seen

    def test_the_bar_is_for_terminals(self):
        work = ["render", "cornell", "--size", "128x96", "--time", "1", "-o", "a.exr"]
        self.client.drop_caches()
        code, out, shown = self.on_terminal(*work)
        self.assertEqual(code, 0)
        self.assertRegex(shown.decode(), r"\r\x1b\[K\[#*\.*\] +\d+ %")
        shares = [int(n) for n in re.findall(r"(\d+) %", shown.decode())]
        self.assertEqual(shares, sorted(shares))                            # of the whole render, not of a pass
        self.assertTrue(shown.endswith(b"\r\x1b[K"), shown[-40:])          # taken back at the end
        self.assertNotIn(b"\x1b", out)
        self.client.drop_caches()
        self.assertEqual(self.cli(*work).stderr, "")
        self.client.drop_caches()
        self.assertEqual(self.on_terminal(*work, "--quiet"), (0, b"", b""))

    def test_lines_are_cut_at_the_terminal(self):
        self.client.drop_caches()
        master, slave = self.terminal()
        import fcntl
        import struct
        import termios
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 30, 0, 0))
        subprocess.run([CLI, "render", "cornell", "--size", "128x96", "--time", "1"], stderr=slave, stdout=subprocess.DEVNULL, timeout=60,
                       env={**os.environ, "GOBO_SERVER": self.client.address}, check=True)
        os.close(slave)
        shown = os.read(master, 1 << 16).decode()
        os.close(master)
        lines = [part for part in shown.split("\r\x1b[K") if part]
        self.assertTrue(lines)
        self.assertLess(max(map(len, lines)), 30)


class ExitCodes(DaemonTest):
    def test_each(self):
        self.cli("scenes", code=0)
        self.cli(code=2)
        self.cli("render", "cornell", "--size", "3", code=2)
        self.cli("render", "cornell", "--set", "width=0", code=2)
        self.cli("nonesuch", code=2)
        self.cli("render", "nonesuch", code=3)
        self.cli("--server", "unix:/nonesuch", "status", code=4)
        self.cli("--timeout", "0.3", "render", "cornell", "--spp", "1000000", code=5)
        self.cli("--token-file", "/nonesuch", "status", code=3)
        self.cli("--cert", "x.pem", "status", code=2)


class Mistakes(DaemonTest):
    """What was probably meant; nothing is written."""

    def refused(self, words, *args, code=2):
        said = self.cli(*args, code=code).stderr
        for w in words:
            self.assertIn(w, said)
        self.assertEqual(os.listdir(self.folder), [])

    def test_names(self):
        self.refused(["no command 'rendr'", "did you mean 'render'?"], "rendr", "cornell")
        self.refused(["no command 'frobnicate'", "gobo --help"], "frobnicate")
        self.refused(["no command 'sumbit'", "did you mean 'submit'?"], "jobs", "sumbit", "cornell")
        self.refused(["no option --siz", "did you mean '--size'?", "gobo render --help"], "render", "cornell", "--siz", "8x8", "-o", "a.exr")
        self.refused(["no option --xyzzy", "gobo render --help"], "render", "cornell", "--xyzzy=3")
        self.refused(["no field 'shadow'", "did you mean 'shadows'?"], "render", "cornell", "--set", "shadow.map.blur=1", "-o", "a.exr")
        self.refused(["did you mean 'max_bounces'?"], "render", "cornell", "--set", "integrator.max_bounce=1", "-o", "a.exr")
        self.refused(["did you mean 'intensity'?"], "render", "cornell", "--set", "lights.light.intensty=1", "-o", "a.exr")
        self.refused(["no scene 'cornel'", "did you mean 'cornell'?"], "render", "cornel", "-o", "a.exr", code=3)

    def test_files(self):
        self.refused(['no such file: "nosuch.gltf"'], "render", "nosuch.gltf", "-o", "a.exr", code=3)
        self.refused(['no such file: "some/where"'], "render", "some/where", "-o", "a.exr", code=3)
        self.refused(["is a folder: name the .gltf or .glb file in it"], "render", self.folder + "/.", "-o", "a.exr", code=3)

    def test_an_id_may_look_like_a_file(self):
        self.client.scenes.open("cornell", "a/b.glb")
        self.cli("render", "a/b.glb", "--size", "8x8", "--spp", "1", "-q", "-o", "ids.png")
        os.remove(self.path("ids.png"))

    def test_techniques_by_name(self):
        plain = self.cli("--json", "plan", "cornell", "--set", "shadows=exponential").stdout
        self.assertEqual(plain, self.cli("--json", "plan", "cornell", "--set", "shadows.exponential=").stdout)
        self.refused(["is a group of fields"], "plan", "cornell", "--set", "shadows=map")
        self.refused(["is a group of fields"], "plan", "cornell", "--set", "integrator=max_bounces")


class Curves(DaemonTest):
    def test_are_what_would_have_been_typed_in(self):
        what = ["cornell", "--size", "8x6", "--spp", "1", "-q"]
        for k, (curve, typed) in enumerate([
                ("lights.light.gain=0:1/1/1,2:3/2/1", "lights.light.gain=1.5,1.25,1"), ("camera.yfov_deg=0:30,1:50;STEP", "camera.yfov_deg=30"),
                ("tone_map.exposure=-1:0,1:2;SMOOTH", "tone_map.exposure=1.5"), ("tone_map.exposure=1e-3:5e-1", "tone_map.exposure=0.5")]):
            self.cli("render", *what, "--curve", curve, "--set", "time_s=0.5", "-o", f"curve{k}.png")
            self.cli("render", *what, "--set", typed, "--set", "time_s=0.5", "-o", f"typed{k}.png")
            with open(self.path(f"curve{k}.png"), "rb") as a, open(self.path(f"typed{k}.png"), "rb") as b:
                self.assertEqual(a.read(), b.read(), curve)
        for bad in ("lights.light.gain", "=0:1", "a=", "a=0", "a=0:", "a=0:1,", "a=0:1;LOUD", "a=0:1x", "a=x:1"):
            self.assertIn("--curve " + bad, self.cli("render", *what, "--curve", bad, "-o", "bad.png", code=2).stderr)
        self.assertIn("request.curves.camera.yfov_deg.value[1]", self.cli("render", *what, "--curve", "camera.yfov_deg=0:30,1:300", "-o", "bad.png", code=2).stderr)
        self.assertFalse(os.path.exists(self.path("bad.png")))


class Pipes(DaemonTest):
    def test_request_from_standard_input_and_picture_to_standard_output(self):
        what = ["--size", "8x6", "--spp", "1", "--set", "encoding.format=PNG"]
        self.cli("render", "cornell", *what, "-q", "-o", "a.png")
        env = {**os.environ, "GOBO_SERVER": self.client.address}
        request = b'{"scene": "cornell", "width": 8, "height": 6, "halt": {"spp": 1}, "encoding": {"format": "PNG"}}'
        done = subprocess.run([CLI, "render", "--request", "-", "-o", "-"], input=request, capture_output=True, env=env, timeout=60, cwd=self.folder)
        self.assertEqual((done.returncode, done.stderr), (0, b""))
        with open(self.path("a.png"), "rb") as file:
            self.assertEqual(done.stdout, file.read())
        self.assertIn("standard input", self.cli("render", "--request", "-", code=2, input="{").stderr)
        for more in (["--progressive"], ["--tile", "32"]):
            self.assertIn("one picture", self.cli("render", "cornell", "-o", "-", *more, code=2).stderr)
        self.assertIn("one picture, not 2", self.cli("render", "cornell", *what, "--outputs", "beauty,depth", "-o", "-", code=2).stderr)


if __name__ == "__main__":
    unittest.main()
