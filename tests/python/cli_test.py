# SPDX-License-Identifier: Apache-2.0
"""The CLI beyond rendering: completion in real shells, the manual page, the progress bar, exit codes."""
import csv
import json
import math
import os
import pty
import re
import select
import shutil
import subprocess
import tempfile
import time
import unittest

import numpy as np

import gobo
from gobo.v1 import filters_pb2
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
        styles = self.cli("render", "--help").stdout.split("Styles of shadows", 1)[1]
        for field in filters_pb2.ShadowStyle.DESCRIPTOR.fields:      # each with what it does
            if field.message_type is None:
                self.assertRegex(styles, rf"\n  {field.name} \(.*\): \w+")
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


class Environment(DaemonTest):
    """`gobo environment`: a map of 64 x 32 texels of one grey with a lamp in it, whose light is known."""

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        pixels = [(128, 128, 128, 129)] * (64 * 32)                                  # (128 / 256) 2^(129 - 128) = 1
        pixels[8 * 64 + 40] = (192, 192, 192, 137)                                   # 0.75 * 2^9
        with open(os.path.join(cls.folder, "lamp.hdr"), "wb") as file:
            file.write(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 32 +X 64\n" + b"".join(map(bytes, pixels)))
        same = np.ones((32, 64), np.float32)                                         # needs no codec, whose libraries take 0.4 s to load
        same[8, 40] = 384
        gobo.exr.write(os.path.join(cls.folder, "lamp.exr"), {c: same for c in "RGB"})

    def test_numbers(self):
        told = json.loads(self.cli("environment", "lamp.hdr", "--bands", "3", "--json", "--csv", "c.csv", "-o", "map.png").stdout)
        self.assertEqual((told["width"], told["height"], len(told["whole"]["coefficients"])), (64, 32, 9))
        theta, phi = 8.5 / 32 * math.pi, 40.5 / 64 * 2 * math.pi - math.pi
        texel = math.sin(theta) * (math.pi / 32) ** 2                                # of its tent, nearly
        self.assertEqual(len(told["lights"]), 1)
        lamp = told["lights"][0]
        self.assertAlmostEqual(lamp["irradiance"][0] / (383 * texel), 1, delta=0.02)
        for found, true in zip(lamp["direction"], (math.sin(theta) * math.cos(phi), math.cos(theta), math.sin(theta) * math.sin(phi))):
            self.assertAlmostEqual(found, true, delta=2e-3)
        self.assertAlmostEqual(told["mean"][0] / (1 + 383 * texel / (4 * math.pi)), 1, delta=1e-3)
        self.assertAlmostEqual(told["lightShare"] / (383 * texel / (4 * math.pi + 383 * texel)), 1, delta=0.02)
        self.assertGreater(told["whole"]["error"], 0.9)
        self.assertLess(told["rest"]["error"], 0.2)
        self.assertLess(told["whole"]["least"], told["rest"]["least"])
        with open(self.path("c.csv"), newline="", encoding="utf-8") as file:
            rows = list(csv.reader(file))
        self.assertEqual(rows[0], ["band", "order", "R", "G", "B", "rest R", "rest G", "rest B"])
        self.assertEqual([tuple(map(float, r[:2])) for r in rows[1:]], [(l, m) for l in range(3) for m in range(-l, l + 1)])
        self.assertAlmostEqual(float(rows[1][2]), told["whole"]["coefficients"][0][0], delta=1e-5)
        with open(self.path("map.png"), "rb") as file:
            self.assertEqual(file.read(24)[16:], (1024).to_bytes(4, "big") + (512).to_bytes(4, "big"))
        same = json.loads(self.cli("environment", "lamp.exr", "--bands", "3", "--json").stdout)
        self.assertEqual(same, told)
        said = self.cli("environment", "lamp.exr", "-o", "map.exr").stdout
        self.assertRegex(said, r"1 lights hold \d")
        self.assertIn("size, deg", said)
        self.assertEqual(self.cli("compare", "map.exr:harmonics", "map.exr:harmonics", "--max-rmse", "0").returncode, 0)
        self.assertNotIn("size, deg", self.cli("environment", "lamp.exr", "--lights", "0").stdout)

    def test_published(self):
        """The thesis's method: the lamp counts twice, but not by what is left of it, and all of JSON is there."""
        tell = lambda *args: json.loads(self.cli("environment", "lamp.exr", "--method", "published", "--json", *args).stdout)
        theta = 8.5 / 32 * math.pi
        lamp = 383 * math.sin(theta) * (math.pi / 32) ** 2
        published, residual = tell(), tell("--power", "residual", "--window", "least", "--radius", "curvature", "--refine", "quadric", "--bands", "3")
        flux = 4 * math.pi + lamp
        self.assertAlmostEqual(published["flux"][0] / flux, 1, delta=1e-3)
        self.assertEqual((len(published["lights"]), len(published["maximum"]), len(published["used"]["coefficients"])), (1, 2, 25))
        self.assertGreater(published["given"][0] / flux - 1, 0.5 * lamp / flux)
        self.assertAlmostEqual(residual["given"][0] / residual["flux"][0], 1, delta=1e-5)
        self.assertEqual(len(residual["window"]["factors"]), 3)
        self.assertGreaterEqual(residual["used"]["least"], -1e-3)
        self.assertLess(published["used"]["least"], 0.5)  # it rings: the sky is 1
        self.assertEqual(tell("--radius-deg", "3")["lights"][0]["angularSizeDeg"], 6)
        self.assertEqual(tell("--lights", "0")["lights"], [])
        least, positive = tell("--fit", "l2"), tell("--fit", "nnls")
        self.assertLess(least["missed"], published["missed"])
        self.assertAlmostEqual(positive["missed"], least["missed"], delta=1e-6)
        haar = tell("--fit", "haar", "--terms", "40", "--csv", "haar.csv")
        self.assertEqual(len(haar["terms"]), 40)
        errors = [e["error"] for e in haar["errors"]]
        self.assertEqual(errors, sorted(errors, reverse=True))
        self.assertLess(errors[-1], 1e-9)
        self.assertLess(next(e["error"] for e in haar["errors"] if e["terms"] == 40), haar["harmonicsError"])
        with open(self.path("haar.csv"), newline="", encoding="utf-8") as file:
            self.assertEqual(len(list(csv.reader(file))), 6 * 64 * 64 + 2)
        said = self.cli("environment", "lamp.exr", "--method", "published", "-o", "p.exr", "--csv", "p.csv").stdout
        self.assertRegex(said, r"1 lights of \d+ maxima give \+\d")
        self.assertIn("difference", said)
        self.assertEqual(self.cli("compare", "p.exr:rest", "p.exr:rest", "--max-rmse", "0").returncode, 0)
        with open(self.path("p.csv"), newline="", encoding="utf-8") as file:
            self.assertEqual(next(csv.reader(file))[-3:], ["used R", "used G", "used B"])
        self.assertIn("40 Haar wavelets miss", self.cli("environment", "lamp.exr", "--method", "published", "--fit", "haar", "--terms", "40").stdout)
        for words, args in (("--window: of --method published alone", ("--window", "hann")), ("--weber: of --method published alone", ("--method", "moments", "--weber", "0.1")),
                            ("--terms: of --method published alone", ("--terms", "3")), ("must be moments or published", ("--method", "median")),
                            ("--light-share", ("--method", "published", "--light-share", "0.1")), ("--terms: of --fit haar alone", ("--method", "published", "--terms", "3")),
                            ("--radius-deg: of --radius fixed alone", ("--method", "published", "--radius", "best", "--radius-deg", "3")),
                            ("--power: of --fit greedy alone", ("--method", "published", "--fit", "l2", "--power", "residual")),
                            ("--window: of --fit greedy alone", ("--method", "published", "--fit", "nnls", "--window", "hann")),
                            ("--window blackman: must be one of none, hann", ("--method", "published", "--window", "blackman")),
                            ("--fit lasso: must be one of greedy", ("--method", "published", "--fit", "lasso")),
                            ("--refine: not of --fit haar", ("--method", "published", "--fit", "haar", "--refine", "log")),
                            ("--out: --fit haar has no picture", ("--method", "published", "--fit", "haar", "-o", "h.png"))):
            with self.subTest(words=words):
                self.assertIn(words, self.cli("environment", "lamp.exr", *args, code=2).stderr)

    def test_refusals(self):
        for code, words, args in ((3, "nosuch.hdr", ("nosuch.hdr",)), (2, "must end in .png or .exr", ("lamp.exr", "-o", "a.jpg")), (2, "--bands", ("lamp.exr", "--bands", "11")),
                                  (3, "no such folder", ("lamp.exr", "--csv", "no/a.csv"))):
            with self.subTest(words=words):
                self.assertIn(words, self.cli("environment", *args, code=code).stderr)
        with open(self.path("broken.hdr"), "wb") as file:
            file.write(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 32 +X 64\n")
        self.assertIn("broken.hdr", self.cli("environment", "broken.hdr", "-o", "b.png", code=2).stderr)
        self.assertFalse(os.path.exists(self.path("b.png")))


class Measure(DaemonTest):
    def test_reference_has_no_approximation(self):
        """Light that transfer leaves out is an error of it, not of the reference too."""
        rows = "measure cornell --size 24x18 --reference-spp 64 --csv m.csv --sweep environment.transfer.bounces=0,3 --set environment.constant=1,1,1 " \
               "--set environment.transfer.bounces=0 --set environment.transfer.points=800 --set environment.transfer.samples=256 --set lights.light.enabled=false --spp 16"
        self.cli(*rows.split())
        with open(self.path("m.csv"), newline="", encoding="utf-8") as file:
            found = list(csv.DictReader(file))
        error = {float(r["value"]): float(r["rmse"]) for r in found}
        self.assertGreater(error[0], 2 * error[3])

    def test_reference_has_its_noise(self):
        """Denoising errs: of the reference too it would hide what it does."""
        rows = "measure cornell --size 24x18 --csv m.csv --sweep denoise.joint_bilateral.radius_px=0,32 --set denoise.joint_bilateral.radius_px=32 " \
               "--spp 256 --reference-spp 256"
        self.cli(*rows.split())
        with open(self.path("m.csv"), newline="", encoding="utf-8") as file:
            found = list(csv.DictReader(file))
        error = {float(r["value"]): float(r["rmse"]) for r in found}
        self.assertLess(error[0], 0.7 * error[32])


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
    options = {"threads": 1}   # its renders end by time: a second thread would only do more

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


class Kernels(DaemonTest):
    def test_of_the_environment(self):
        for isa, code in (("avx2", 0), ("", 0), ("sse9", 2)):
            done = subprocess.run([CLI, "--local", "render", "cornell", "--size", "16x12", "--spp", "1", "-o", self.path("a.png")], capture_output=True, text=True,
                                  timeout=120, env={**os.environ, "GOBO_EMBREE_ISA": isa})
            self.assertEqual(done.returncode, code, done.stderr)
        self.assertIn("GOBO_EMBREE_ISA='sse9': must be avx2", done.stderr)


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

    def test_paths_of_every_kind(self):
        for local in ([], ["--local"]):
            self.refused(['no such file: "nosuch.glb"'], *local, "load", "nosuch.glb", code=3)
            self.refused(['no such file: "nosuch.hdr"'], *local, "render", "cornell", "--env", "nosuch.hdr", "-o", "a.exr", code=3)
            self.refused(['no such file: "/no/such.exr"'], *local, "plan", "cornell", "--set", "environment.path=/no/such.exr", code=3)
            self.refused(['no such file: "nosuch.json"'], *local, "render", "cornell", "--request", "nosuch.json", "-o", "a.exr", code=3)
            self.refused(['no such folder: "no/where"'], *local, "render", "cornell", "-o", "no/where/a.exr", code=3)
            self.refused(['--csv no/a.csv: no such folder: "no"'], *local, "measure", "cornell", "--sweep", "halt.spp=1", "--csv", "no/a.csv", code=3)
            self.refused(['--plot no/a.png: no such folder: "no"'], *local, "occlusion", "cornell", "--plot", "no/a.png", code=3)
        self.refused(['no such file: "nosuch.exr"'], "compare", "nosuch.exr", "other.exr", code=3)
        self.refused(['--diff no/d.png: no such folder: "no"'], "compare", "nosuch.exr", "other.exr", "--diff", "no/d.png", code=3)
        here = os.path.join(tempfile.gettempdir(), ".")
        self.refused(["is a folder"], "compare", "nosuch.exr", "other.exr", "--diff", here)
        self.refused(['no such file: "nosuch.json"'], "render", "nosuch.glb", "--request", "nosuch.json", code=3)   # before a scene is loaded or sent

    def test_an_id_may_look_like_a_file(self):
        self.client.scenes.open("cornell", "a/b.glb")
        self.cli("render", "a/b.glb", "--size", "8x8", "--spp", "1", "-q", "-o", "ids.png")
        os.remove(self.path("ids.png"))

    def test_techniques_by_name(self):
        plain = self.cli("--json", "plan", "cornell", "--set", "shadows=exponential").stdout
        self.assertEqual(plain, self.cli("--json", "plan", "cornell", "--set", "shadows.exponential=").stdout)
        self.refused(["is a group of fields"], "plan", "cornell", "--set", "shadows=map")
        self.refused(["is a group of fields"], "plan", "cornell", "--set", "integrator=max_bounces")
        self.refused(["'exponental' is none of them; did you mean 'exponential'?"], "plan", "cornell", "--set", "shadows=exponental")


class Frames(DaemonTest):
    """--frames: numbers and ranges, in the order in which they are written."""

    terminal, on_terminal = Terminal.terminal, Terminal.on_terminal

    @classmethod
    def setUpClass(cls):
        jobs = tempfile.mkdtemp(prefix="gobo-test-jobs-")
        cls.addClassCleanup(shutil.rmtree, jobs, ignore_errors=True)
        cls.options = {"jobs": jobs}
        super().setUpClass()

    def spec(self, frames, *more):
        made = json.loads(self.cli("--json", "jobs", "submit", "cornell", "--size", "8x8", "--spp", "1", "--frames", frames, *more).stdout)
        return made["spec"]["frames"], made["frames_total"]

    def test_one_range_stays_one_and_others_are_numbers(self):
        for text, first, last, step, count in (("7", 7, 7, 1, 1), ("3-5", 3, 5, 1, 3), ("0-9:4", 0, 8, 4, 3), ("-5--1:2", -5, -1, 2, 3), ("1,2,3", 1, 3, 1, 3)):
            frames, total = self.spec(text)
            self.assertEqual((int(frames["first"]), int(frames["last"]), frames["step"], int(total)), (first, last, step, count), text)
            self.assertNotIn("numbers", frames)
        for text, numbers in (("1,5,9-20:2", [1, 5, 9, 11, 13, 15, 17, 19]), ("4,2,9", [4, 2, 9]), ("-2,0-1", [-2, 0, 1])):
            frames, total = self.spec(text)
            self.assertEqual(([int(n) for n in frames["numbers"]], int(total)), (numbers, len(numbers)), text)
            self.assertEqual(set(frames) - {"fps"}, {"numbers"})

    def test_frames_are_rendered_and_fetched_by_their_numbers(self):
        job = self.cli("jobs", "submit", "cornell", "--size", "8x8", "--spp", "1", "--name", "n", "--frames", "5,2,9-12:3", "--watch").stdout.split()[0]
        shown = json.loads(self.cli("--json", "jobs", "show", job).stdout)
        self.assertEqual([int(f["frame"]) for f in shown["frames"]], [5, 2, 9, 12])
        self.cli("jobs", "fetch", job, "-o", "some", "--frames", "2,9-20")
        self.assertEqual(sorted(os.listdir(self.path("some"))), ["n.0002.exr", "n.0009.exr", "n.0012.exr"])
        self.assertIn("has none of them", self.cli("jobs", "fetch", job, "-o", "none", "--frames", "3,6", code=3).stderr)

    def test_a_watched_job_says_what_is_left(self):
        for seed, spp in enumerate((1024, 4096, 16384)):   # a busy machine starts the watcher late: more to watch then
            job = self.cli("jobs", "submit", "cornell", "--size", "64x48", "--spp", str(spp), "--set", f"seed={seed}", "--frames", "0-7").stdout.strip()
            code, _, shown = self.on_terminal("jobs", "watch", job)
            self.assertEqual(code, 0)
            if re.search(r"running  \d+ of 8 frames  [\d.]+ s left", shown.decode()):
                return
        self.fail(shown.decode())

    def test_what_is_wrong_is_said(self):
        for text, words in (("1,x", '"x" must be'), ("1,,2", '"" must be'), ("1,", '"" must be'), ("3-", '"3-" must be'), ("1-4:0", '"1-4:0" must be'),
                            ("1-4:-1", '"1-4:-1" must be'), (" 1", '" 1" must be'), ("+1", '"+1" must be'), ("9-2", '"9-2" descends'),
                            ("1,3-5,4", '"4" names frame 4 again'), ("7,7", '"7" names frame 7 again'), ("0-200000", "more than 100000 frames"),
                            ("99999999999999999999", "must be"), ("2000000000", "within 1000000000")):
            for command in (["jobs", "submit", "cornell"], ["jobs", "fetch", "j-1"]):
                said = self.cli(*command, "--frames=" + text, code=2).stderr
                self.assertIn("--frames " + text, said)
                self.assertIn(words, said)

    def test_the_server_holds_numbers_to_the_same(self):
        for frames, words in (({"numbers": [1, 2, 1]}, "1 is there twice"), ({"numbers": [1], "first": 0}, "in place of first, last and step"),
                              ({"numbers": [2 * 10**9]}, "job.frames.numbers = 2000000000")):
            with self.assertRaises(gobo.InvalidArgument) as caught:
                self.client.jobs.submit("cornell", frames=frames, width=8, height=8, spp=1)
            self.assertIn(words, str(caught.exception))


class Relights(DaemonTest):
    """`gobo relight` takes what `gobo render` takes; the picture is that of a render of the whole request."""

    WHAT = ["cornell", "--size", "24x18", "--spp", "16"]

    def render(self, *more):
        return json.loads(self.cli("--json", "render", *self.WHAT, *more).stdout)["render_id"]

    def same(self, relit, rendered):
        with open(self.path(relit), "rb") as a, open(self.path(rendered), "rb") as b:
            self.assertEqual(a.read(), b.read())

    def test_what_render_takes(self):
        known = self.render()
        with open(self.path("patch.json"), "w", encoding="utf-8") as file:
            json.dump({"integrator": {"max_bounces": 1}}, file)
        for k, (said, rendered) in enumerate([
                (["--spp", "32"], ["--spp", "32"]), (["--size", "16x12"], ["--size", "16x12"]),
                (["--set", "lights.light.gain=2,1,1"],) * 2, (["--env", "none"],) * 2, (["--request", "patch.json"], ["--set", "integrator.max_bounces=1"]),
                (["--outputs", "beauty,depth"],) * 2, (["--layers", "--outputs", "beauty,albedo"],) * 2,
                (["--curve", "lights.light.gain=0:3/2/1"],) * 2, (["--half"],) * 2]):
            what = [w for w in self.WHAT]
            for option in ("--spp", "--size"):
                if option in rendered:
                    at = what.index(option)
                    del what[at:at + 2]
            self.cli("relight", known, *said, "-q", "-o", f"relit{k}.raw" if "--layers" not in said else f"relit{k}.exr")
            self.cli("render", *what, *rendered, "-q", "-o", f"whole{k}.raw" if "--layers" not in said else f"whole{k}.exr")
            if "--layers" in said:
                self.assertIn("rmse", self.cli("--json", "compare", f"relit{k}.exr:albedo", f"whole{k}.exr:albedo", "--max-rmse", "0").stdout)
                continue
            names = ["relit%d.raw", "whole%d.raw"] if "depth" not in said[-1] else ["relit%d.depth.raw", "whole%d.depth.raw"]
            self.same(names[0] % k, names[1] % k)

    def test_layers_of_the_render_do_not_hinder_one_picture(self):
        known = self.render("--layers", "--outputs", "beauty,albedo", "-o", "layers.exr")
        self.cli("relight", known, "--outputs", "beauty", "-q", "-o", "one.png")
        self.cli("relight", known, "--spp", "32", "-q")

    def test_certificate_progress_and_snapshots(self):
        known = self.render()
        self.client.drop_caches()
        done = self.cli("relight", known, "--spp", "64", "--size", "160x120", "--certificate", "--progressive", "-o", "p.exr")
        self.assertIn("certificate: RMSE", done.stdout)
        self.assertIn("snapshot at", done.stderr)

    def test_one_end_replaces_another(self):
        known = self.render()
        reply = json.loads(self.cli("--json", "relight", known, "--time", "0.2", "-o", "t.exr").stdout)
        self.assertGreaterEqual(reply["resolved"]["halt"]["spp"], 16)

    def test_an_environment_is_of_one_kind(self):
        known = self.render("--set", "environment.constant=1", "--set", "environment.gain=3,3,3")
        self.cli("relight", known, "--set", "environment.sky.turbidity=4", "-q", "-o", "sky.raw")
        self.cli("render", *self.WHAT, "--set", "environment.sky.turbidity=4", "--set", "environment.gain=3,3,3", "-q", "-o", "sky2.raw")
        self.same("sky.raw", "sky2.raw")

    def test_the_scene_is_the_renders(self):
        known = self.render()
        self.assertIn("leave out", self.cli("relight", known, "--request", "-", code=2, input='{"scene": "grids"}').stderr)
        self.cli("relight", "nonesuch", "--spp", "4", code=3)
        self.assertIn("one picture", self.cli("relight", known, "--progressive", "-o", "-", code=2).stderr)


class Plans(DaemonTest):
    """Rows of one kind are one; their sums, and every row, are there too."""

    def rows(self, *args):
        lines = self.cli(*args).stdout.splitlines()
        end = next(i for i, line in enumerate(lines) if line.startswith(("expected", "total")) or "rows are shown as" in line)
        return lines, [re.split(r"  +", line.strip()) for line in lines[1:end]]

    def test_kinds_are_folded(self):
        what = ["plan", "lights8", "--size", "32x24", "--set", "shadows=ray_traced"]
        lines, folded = self.rows(*what)
        each, every = self.rows(*what, "--plan-all")
        self.assertGreater(len(every), len(folded))
        self.assertRegex("\n".join(lines), rf"{len(every)} rows are shown as {len(folded)}; --plan-all shows each")
        self.assertNotIn("--plan-all", "\n".join(each))
        kinds = {}
        for row in every:
            kinds.setdefault((row[0].split(":")[0], row[1]), []).append(row)
        several = [k for k, v in kinds.items() if len(v) > 1 and ":" in v[0][0] and v[0][0].count(":") == 1]
        self.assertTrue(several)
        for name, state in several:
            rows = kinds[name, state]
            found = [r for r in folded if r[0].startswith(name + " x") and r[1] == state]
            self.assertEqual(len(found), 1, (name, state, folded))
            self.assertEqual(int(found[0][0].split(" x")[1]), sum(int(r[0].split(" x")[1]) if " x" in r[0] else 1 for r in rows))
            self.assertEqual(int(found[0][3]), sum(int(r[3]) for r in rows))
        # What a program reads is as it was.
        self.assertEqual(self.cli("--json", *what).stdout, self.cli("--json", *what, "--plan-all").stdout)
        self.assertEqual(len(json.loads(self.cli("--json", *what).stdout)["plan"]), len(every))

    def test_the_error_to_expect(self):
        picture = ["fence", "--size", "24x16"]  # of no other test here: nothing is known of it
        said = lambda *more: [line for line in self.cli("plan", *picture, *more).stdout.splitlines() if line.startswith("expected error")]
        self.assertRegex(said("--spp", "8")[0], "not known")
        with tempfile.TemporaryDirectory() as folder:
            self.cli("render", *picture, "--spp", "32", "--progressive", "-o", os.path.join(folder, "a.exr"))
            self.assertRegex(said("--spp", "8")[0], r"^expected error: noise [0-9.e-]+; from snapshots of this picture, 32 samples$")
            self.cli("render", *picture, "--spp", "16", "--certificate", "-o", os.path.join(folder, "b.exr"))
        self.assertRegex(said("--spp", "8")[0], r"^expected error: RMSE [0-9.e-]+.*; from certificates of this picture, 16 samples$")

    def test_replies_too(self):
        what = ["render", "lights8", "--size", "16x12", "--spp", "1", "--set", "shadows=ray_traced", "--outputs", "direct"]
        self.assertIn("rows are shown as", self.cli(*what).stdout)
        self.assertNotIn("rows are shown as", self.cli(*what, "--plan-all").stdout)


class Cache(DaemonTest):
    """gobo cache against what renders left behind."""

    @classmethod
    def setUpClass(cls):
        cls.cache = tempfile.mkdtemp(prefix="gobo-cache-")
        cls.addClassCleanup(shutil.rmtree, cls.cache, ignore_errors=True)
        cls.options = {"cache": cls.cache}
        super().setUpClass()

    def setUp(self):
        self.client.drop_caches(True, pinned=True)
        self.render("cornell")

    def render(self, scene, client=None):
        what = {"environment.constant": [1, 1, 1], "environment.transfer.points": 5000, "environment.transfer.bands": 2, "environment.transfer.samples": 128,
                "environment.transfer.bounces": 1}
        return (client or self.client).render(scene, size=(16, 12), spp=1, set=what)

    def listed(self, *more, command="list"):
        return json.loads(self.cli("--json", "cache", command, *more).stdout)

    def test_list_and_size(self):
        terms = self.listed()["terms"]
        self.assertEqual({t["scene"] for t in terms}, {"cornell"})
        by_type = {}
        for t in terms:
            self.assertRegex(t["key"], "^[0-9a-f]{32}$")
            self.assertLess(abs(time.time() - t["used_s" if "used_s" in t else "usedS"]), 600)
            by_type.setdefault(t["type"], []).append(t)
        self.assertEqual(len(by_type["direct_transfer"]), 2)
        self.assertEqual({t["label"] for t in by_type["direct_transfer"]}, {"transfer:direct"})
        self.assertTrue(any(int(t.get("disk_bytes", t.get("diskBytes", 0))) > 0 for t in by_type["direct_transfer"]), "the end of the chain is on disk")
        size = self.listed(command="size")
        self.assertNotIn("terms", size)
        totals = {t["type"]: t for t in size["totals"]}
        self.assertEqual({k: len(v) for k, v in by_type.items()}, {k: int(t["terms"]) for k, t in totals.items()})
        self.assertEqual(sum(int(t.get("bytes", 0)) for t in totals.values()), self.client.status().store_bytes)
        text = self.cli("cache", "list", "--type", "*transfer*", "--sort", "bytes").stdout
        self.assertRegex(text, r"digest +type +scene +memory +disk +used +ms +pinned +label\n")
        self.assertRegex(text, r"(?m)^[0-9a-f]{12}  bounced_transfer +cornell +[\d.]+ .iB .*transfer:bounce 1$")
        self.assertNotIn("gbuffer", text)
        self.assertRegex(self.cli("cache", "list", "--limit", "3").stdout, r"3 of \d+ terms are shown")
        self.assertRegex(self.cli("cache", "size").stdout, r"(?m)^all +\d+ +[\d.]+ .iB")
        self.assertIn("no term is like that", self.cli("cache", "list", "--scene", "nonesuch").stdout)

    def test_evict(self):
        all_of_them = len(self.listed()["terms"])
        self.assertIn("evicted 1 terms", self.cli("cache", "evict", "--type", "bounced_transfer").stdout)
        self.assertEqual(len(self.listed()["terms"]), all_of_them - 1)
        key = self.listed("--type", "transfer_points")["terms"][0]["key"]
        self.assertIn("evicted 1 terms", self.cli("cache", "evict", key[:8]).stdout)
        self.assertIn("evicted 0 terms", self.cli("cache", "evict", key).stdout)
        rerun = {n.node: n.state for n in self.render("cornell").plan if n.node.startswith("transfer")}
        self.assertIn(rerun["transfer:bounce 1"], ("run", "not_needed"))
        for bad, says in ([[], "which terms"], [["xyz"], "6 to 32 hex digits"], [["--type", "x" * 1001], "at most 1000"]):
            self.assertIn(says, self.cli("cache", "evict", *bad, code=2).stderr)
        self.assertIn("evicted", self.cli("cache", "evict", "--scene", "cornell").stdout)
        self.assertEqual(self.listed().get("terms", []), [])

    def test_pin(self):
        said = self.cli("cache", "pin", "--type", "*transfer*").stdout
        self.assertRegex(said, r"pinned [4-9] terms, ")
        pinned = self.listed("--pinned")["terms"]
        self.assertTrue(all("transfer" in t["type"] and t["pinned"] for t in pinned))
        self.client.drop_caches(True)
        self.assertEqual([t["key"] for t in self.listed()["terms"]], [t["key"] for t in pinned])
        self.assertIn("pinned ones stay", self.cli("cache", "evict", "--type", "direct_transfer").stdout)
        self.assertIn("unpinned", self.cli("cache", "unpin", "--type", "direct_transfer").stdout)
        self.assertIn("evicted", self.cli("cache", "evict", "--type", "direct_transfer").stdout)
        self.assertEqual(self.listed("--type", "direct_transfer").get("terms", []), [])
        self.assertIn("which terms", self.cli("cache", "pin", code=2).stderr)

    def test_pins_are_bounded_and_outlive_the_daemon(self):
        with tempfile.TemporaryDirectory(prefix="gobo-pins-") as folder:
            config = os.path.join(folder, "gobod.toml")
            with open(config, "w", encoding="utf-8") as file:
                file.write('[engine]\nstore_bytes = "1MiB"\n')
            options = {"cache": os.path.join(folder, "cache"), "config": config, "args": ["--root", "/"]}
            with gobo.local(threads=2, **options) as client:
                self.render("cornell", client)
                keys = [t.key for t in client.list_terms().terms if t.disk_bytes > 0][:1]
                self.assertEqual(len(keys), 1)
                reply = client.pin_terms(keys=keys)
                self.assertEqual((reply.terms, reply.memory_only), (1, 0))
                in_memory = [t.key for t in client.list_terms().terms if t.disk_bytes == 0 and not t.pinned]
                held = sum(t.bytes for t in client.list_terms(keys=in_memory).terms)
                if held > 1 << 19:
                    with self.assertRaisesRegex(gobo.FailedPrecondition, "engine.store_bytes"):
                        client.pin_terms(keys=in_memory)
            with gobo.local(threads=2, **options) as client:
                self.assertEqual([t.key for t in client.list_terms(pinned=True).terms], keys)
                client.drop_caches(True)
                self.assertEqual([t.key for t in client.list_terms().terms], keys)
                self.assertEqual(client.pin_terms(keys=keys, unpin=True).terms, 1)
                client.drop_caches(True)
                self.assertEqual(list(client.list_terms().terms), [])


class Waits(DaemonTest):
    options = {"threads": 1}   # those before it have no end

    def test_place_and_rest_are_shown(self):
        """One that waits behind two: its lines say so, then what is expected of the rest."""
        env = {**os.environ, "GOBO_SERVER": self.client.address}
        endless = [CLI, "render", "cornell", "--size", "160x120", "--spp", "1000000", "--priority", "INTERACTIVE", "-q"]
        others = []
        for n in range(2):
            others.append(subprocess.Popen(endless, env=env, stderr=subprocess.DEVNULL))
            self.addCleanup(others[-1].wait)
            self.addCleanup(others[-1].kill)
            while self.client.status().running + self.client.status().queued <= n:
                time.sleep(0.01)
        last = subprocess.Popen([CLI, "render", "cornell", "--size", "128x96", "--time", "1", "--progressive", "-o", "a.exr"], env=env, cwd=self.folder,
                                stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
        self.addCleanup(last.stderr.close)
        first = last.stderr.readline()
        self.assertRegex(first, r"queued, 1 before it  [\d.]+ s")
        others[0].kill()
        line = last.stderr.readline()
        while "1 before it" in line:
            line = last.stderr.readline()
        self.assertRegex(line, r"queued, next  [\d.]+ s")
        others[1].kill()
        rest = last.stderr.read()
        self.assertEqual(last.wait(60), 0)
        self.assertRegex(rest, r"\d+ %  .* spp  [\d.]+ s  [\d.]+ s left")


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


class Formulas(DaemonTest):
    def test_are_what_would_have_been_typed_in_and_styles_vary(self):
        what = ["cornell", "--size", "8x6", "--spp", "1", "-q"]
        self.cli("render", *what, "--formula", "lights.light.intensity=2 + 3*time", "--set", "time_s=0.5", "-o", "formula.png")
        self.cli("render", *what, "--set", "lights.light.intensity=3.5", "--set", "time_s=0.5", "-o", "number.png")
        with open(self.path("formula.png"), "rb") as a, open(self.path("number.png"), "rb") as b:
            self.assertEqual(a.read(), b.read())
        plan = self.cli("render", *what[:-1], "--formula", "shadows.style.softness=0.02 + 0.3*distance", "--plan-all", "-o", "styled.png").stdout
        self.assertIn("style_occluder:light", plan)
        for bad, words in (("shadows.style.softness", "is not PATH=FORMULA"), ("=1", "is not PATH=FORMULA"), ("shadows.style.softness=dist", "names: time, distance"),
                           ("shadows.style.softness=1/0", "finite"), ("width=3", "only numbers of camera")):
            self.assertIn(words, self.cli("render", *what, "--formula", bad, "-o", "bad.png", code=2).stderr)
        self.assertFalse(os.path.exists(self.path("bad.png")))

    def test_a_style_sheet_is_shared_by_requests(self):
        sheet, wrong = self.path("style.json"), self.path("wrong.json")
        with open(sheet, "w") as f:
            f.write('{"shadows": {"style": {"softness": 0.2, "layers": [{"inflation": 0.1, "brightness": 0.5}], "pattern": "HATCHING"}}, '
                    '"expressions": {"shadows.style.inflation": {"formula": "0.1*distance"}}}')
        with open(wrong, "w") as f:
            f.write('{"width": 9}')
        typed = ["--set", "shadows.style.softness=0.2", "--set", "shadows.style.layers[0].inflation=0.1", "--set", "shadows.style.layers[0].brightness=0.5",
                 "--set", "shadows.style.pattern=HATCHING", "--formula", "shadows.style.inflation=0.1*distance"]
        for name in ("cornell", "fence"):
            what = [name, "--size", "24x16", "--spp", "1", "-q"]
            self.cli("render", *what, "--style", sheet, "-o", "sheet.png")
            self.cli("render", *what, *typed, "-o", "typed.png")
            with open(self.path("sheet.png"), "rb") as a, open(self.path("typed.png"), "rb") as b:
                self.assertEqual(a.read(), b.read(), name)
        self.assertIn("width is no field of a style", self.cli("render", "cornell", "--style", wrong, "-o", "bad.png", code=2).stderr)
        self.assertIn("nosuch.json", self.cli("render", "cornell", "--style", self.path("nosuch.json"), "-o", "bad.png", code=3).stderr)


class Comparisons(DaemonTest):
    def test_a_folder_is_no_picture(self):
        os.mkdir(self.path("folder.exr"))
        self.assertIn("-o folder.exr: is a folder", self.cli("render", "cornell", "-o", "folder.exr", code=2).stderr)
        self.assertIn("--diff folder.exr: is a folder", self.cli("compare", "nosuch.exr", "other.exr", "--diff", "folder.exr", code=2).stderr)

    def write(self, name, values, channels="RGB", layer=""):
        gobo.exr.write(self.path(name), {layer + c: np.full((4, 4), v, np.float32) if np.isscalar(v) else v for c, v in zip(channels, values)})

    def test_what_is_not_finite_in_one_alone_fails(self):
        holed = np.full((4, 4), 0.5, np.float32)
        holed[1, 2] = np.nan
        endless = np.full((4, 4), np.inf, np.float32)
        self.write("ok.exr", (0.5, 0.5, 0.5))
        self.write("holed.exr", (0.5, holed, 0.5))
        self.write("endless.exr", (endless,), "Z")
        said = self.cli("compare", "holed.exr", "ok.exr", "--max-rmse", "1e9", code=1)
        self.assertIn("1 pixels are not finite", said.stderr)
        self.assertEqual(json.loads(self.cli("--json", "compare", "ok.exr", "holed.exr").stdout)["nonFiniteApart"], 1)
        for name in ("holed.exr", "endless.exr"):   # a depth is infinite where nothing is: the same in both
            self.cli("compare", name, name, "--max-rmse", "0")

    def test_two_channels_are_refused(self):
        self.write("motion.exr", (0.5, 0.25), "XY", "motion.")
        self.assertIn("two channels", self.cli("compare", "motion.exr:motion", "motion.exr:motion", "--max-rmse", "0", code=2).stderr)

    def test_code_values_are_decoded(self):
        what = ("render", "cornell", "--size", "24x24", "--spp", "16", "--set", "tone_map.curve=LINEAR", "--set", "tone_map.exposure=-2", "-q")
        self.cli(*what, "-o", "scene.exr")
        shown = np.clip(gobo.exr.read_image(self.path("scene.exr")) / 4, 0, 1)   # by its exposure
        self.write("truth.exr", [shown[..., c] for c in range(3)])
        for name, more in (("srgb", ()), ("linear", ("--set", "encoding.transfer=LINEAR"))):
            self.cli(*what, *more, "--set", "encoding.png_bits=16", "-o", name + ".png")
            found = json.loads(self.cli("--json", "compare", name + ".png", "truth.exr").stdout)
            self.assertLess(found["rmse"], 1e-3, name)
            self.assertLess(found["flip"], 1e-2, name)

    def test_a_scale_beyond_numbers(self):
        self.write("ok.exr", (0.5, 0.5, 0.5))
        self.assertIn("--scale", self.cli("compare", "ok.exr", "ok.exr", "--diff", "d.png", "--scale", "1e-50", code=2).stderr)


class Precedence(DaemonTest):
    def resolved(self, request, *more):
        with open(self.path("r.json"), "w", encoding="utf-8") as file:
            json.dump(request | {"scene": "cornell", "width": 8, "height": 8}, file)
        return json.loads(self.cli("--json", "render", "--request", "r.json", *more, "-o", "a.exr").stdout)["resolved"]

    def test_options_replace_what_the_file_says_otherwise(self):
        self.assertEqual(self.resolved({"halt": {"time_s": 0.001}}, "--spp", "32")["halt"], {"spp": 32})
        self.assertNotIn("constant", self.resolved({"environment": {"constant": {"x": 1, "y": 1, "z": 1}}}, "--env", "none", "--spp", "1")["environment"])


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
