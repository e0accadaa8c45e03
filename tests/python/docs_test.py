# SPDX-License-Identifier: Apache-2.0
"""What README.md and docs/python.md tell people to type works as written.

Run are: every python block of docs/python.md, and elsewhere every fenced sh or python block with a line `<!-- run -->` before it;
`<!-- no run: reason -->` leaves one out. A page's sh blocks run in order, then its python blocks, in one folder that looks like the
top of the repository (links to build, configs, clients, docs, proto) and holds scene.glb (a light "key", a camera "eye"), studio.hdr and
x.hdr. Python blocks share their names, sh blocks what they export. gobo and gobod are in the PATH, GOBO_SERVER names a daemon.
"""
import importlib.util
import os
import pathlib
import re
import signal
import subprocess
import tempfile
import unittest

import gobo
from gobo import glb
from gobo.v1 import options_pb2, render_pb2
from support import CLI, SOURCE, gltf

FENCE = re.compile(r"^(?P<mark>(?:[ \t]*<!--.*?-->[ \t]*\n)?)```(?P<language>\w+)[^\n]*\n(?P<code>.*?)^```[ \t]*$", re.MULTILINE | re.DOTALL)


def blocks(text, always=()):
    """(line number, language, code) of the blocks to run."""
    for found in FENCE.finditer(text):
        mark, language = found["mark"].strip(), found["language"]
        run = mark == "<!-- run -->" or (language in always and not mark.startswith("<!-- no run:"))
        if run and language in ("sh", "bash", "python"):
            yield text.count("\n", 0, found.start("code")) + 1, language, found["code"]


def write_hdr(path):
    """8 x 4 Radiance pixels, flat scan lines: grey with a bright spot."""
    pixels = [(128, 128, 128, 127)] * 32
    pixels[10] = (255, 240, 200, 133)
    path.write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\n" + b"".join(map(bytes, pixels)))


class Pages(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="gobo-docs-")
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        build = pathlib.Path(CLI).parent.parent
        for name, target in [("build", build)] + [(n, pathlib.Path(SOURCE) / n) for n in ("configs", "clients", "docs", "proto", "deploy", "examples")]:
            (self.folder / name).symlink_to(target)
        original = gltf(folder.name)
        text = pathlib.Path(original).read_text(encoding="utf-8").replace('"lamp"', '"key"')
        pathlib.Path(original).write_text(text, encoding="utf-8")
        (self.folder / "scene.glb").write_bytes(glb.pack(original))
        for name in ("studio.hdr", "x.hdr"):
            write_hdr(self.folder / name)
        client = gobo.local(threads=2, jobs=self.folder / "jobs")
        self.addCleanup(client.close)
        self.env = {**os.environ, "GOBO_SERVER": client.address, "PATH": f"{build}/clients:{build}/server:" + os.environ["PATH"]}
        self.groups = []
        self.addCleanup(self.stop_background)

    def stop_background(self):
        for group in self.groups:
            try:
                os.killpg(group, signal.SIGTERM)
            except ProcessLookupError:
                pass

    def shell(self, page, line, code):
        after = self.folder / ".env"
        script = f"set -eo pipefail\n{code}\nenv -0 > {after}\n"
        with open(self.folder / ".log", "w+", encoding="utf-8") as log:   # a file: a daemon in the background may hold it open
            process = subprocess.Popen(["bash", "-c", script], cwd=self.folder, env=self.env, stdout=log, stderr=log, stdin=subprocess.DEVNULL, start_new_session=True)
            self.groups.append(process.pid)
            status = process.wait(300)
            log.seek(0)
            self.assertEqual(status, 0, f"{page}:{line}:\n{code}\n{log.read()}")
        self.env = dict(item.split("=", 1) for item in after.read_text().split("\0") if "=" in item)

    def run_page(self, name, always=()):
        text = (pathlib.Path(SOURCE) / name).read_text(encoding="utf-8")
        found = list(blocks(text, always))
        python = []
        for line, language, code in found:
            if language != "python":
                self.shell(name, line, code)
            else:
                python.append((line, code))
        if python:   # one process with the names of all; line numbers in tracebacks are the page's
            last = python[-1][0] + python[-1][1].count("\n")
            lines = [""] * last
            for line, code in python:
                for i, text_line in enumerate(code.splitlines()):
                    lines[line - 1 + i] = text_line
            script = self.folder / os.path.basename(name).replace(".md", "_md.py")
            script.write_text("\n".join(lines) + "\n", encoding="utf-8")
            done = subprocess.run(["/usr/bin/python3", str(script)], cwd=self.folder, env=self.env, capture_output=True, text=True, timeout=300)
            self.assertEqual(done.returncode, 0, f"{name}:\n{done.stdout}{done.stderr}")
        return len(found)

    def test_python_page(self):
        self.assertGreaterEqual(self.run_page("docs/python.md", always=("python",)), 15)
        self.assertTrue((self.folder / "picture.exr").exists())
        self.assertEqual(len(list((self.folder / "frames").iterdir())), 4)

    def test_live_page(self):
        self.assertEqual(self.run_page("docs/live.md"), 1)
        self.assertTrue((self.folder / "live.png").read_bytes().startswith(b"\x89PNG"))

    def test_drake_page(self):
        self.assertEqual(self.run_page("docs/drake.md"), 2)
        for name, magic in (("color.png", b"\x89PNG"), ("depth.tiff", b"II*\0"), ("label.png", b"\x89PNG")):
            self.assertTrue((self.folder / name).read_bytes().startswith(magic), name)

    def test_color_page(self):
        self.assertEqual(self.run_page("docs/color.md"), 1)
        soft, warm = ((self.folder / name).read_bytes() for name in ("soft.png", "warm.png"))
        self.assertTrue(soft.startswith(b"\x89PNG") and warm.startswith(b"\x89PNG"))
        self.assertFalse((self.folder / "x.png").exists(), "a view that the config does not have")

    def test_cryptomatte_page(self):
        self.assertEqual(self.run_page("docs/cryptomatte.md"), 2)
        self.assertTrue((self.folder / "preview.png").read_bytes().startswith(b"\x89PNG"))

    def test_regression_page(self):
        self.assertEqual(self.run_page("docs/regression.md"), 1)
        self.assertIn("data:image/png;base64,", (self.folder / "nightly.out/report.html").read_text(encoding="utf-8"))
        self.assertEqual(len((self.folder / "references/accepted.jsonl").read_text(encoding="utf-8").splitlines()), 2)

    def test_farm_page(self):
        self.assertEqual(self.run_page("docs/farm.md"), 1)
        self.assertEqual(sorted(f.name for f in (self.folder / "shots").iterdir()), ["poster.0000.exr", *(f"zoom.{n:04}.exr" for n in range(1, 9))])

    @unittest.skipIf(importlib.util.find_spec("matplotlib") is None, "matplotlib is missing: apt install python3-matplotlib (deploy/install-deps does)")
    def test_measuring_page(self):
        self.assertEqual(self.run_page("docs/measuring.md"), 1)
        self.assertIn("data:image/svg+xml;base64,", (self.folder / "figures/grids.html").read_text(encoding="utf-8"))

    def test_readme(self):
        if self.run_page("README.md") == 0:
            self.skipTest("README.md has no block marked <!-- run -->")

    def test_protocol_page_has_every_field_with_its_help(self):
        done = subprocess.run(["/usr/bin/python3", f"{SOURCE}/docs/api/fields.py"], capture_output=True, text=True, timeout=60, check=True)
        rows = set(done.stdout.splitlines())
        request = render_pb2.RenderRequest.DESCRIPTOR
        self.assertIn("## RenderRequest {#gobo-v1-renderrequest}", rows)
        for field in request.fields:
            row = next((r for r in rows if r.startswith(f"| `{field.name}` |") and field.GetOptions().Extensions[options_pb2.help] in r), None)
            self.assertIsNotNone(row, f"{field.name} of RenderRequest")
        self.assertIn("| `view_samples` | uint32 | 4 | from 1 to 16 | view samples per pixel of G-buffer based terms |", rows)
        self.assertIn("| Relight | [RelightRequest](#gobo-v1-relightrequest) | [RenderEvent](#gobo-v1-renderevent) |", rows)

    def test_files_that_pages_name_exist(self):
        top, named = pathlib.Path(SOURCE), 0
        path = re.compile(r"(?<![\w/.-])(?:renderer|tests|server|clients|bench|docs|configs|deploy|fuzz|ingest|proto|examples)/[\w/-]+"
                          r"\.(?:cpp|h|py|md|proto|toml|txt)\b")
        for page in [*top.glob("*.md"), *top.glob("docs/*.md")]:
            for name in path.findall(page.read_text(encoding="utf-8")):
                named += 1
                if "/my_" not in name:   # what the reader will write
                    self.assertTrue((top / name).exists(), f"{page.name} names {name}")
        self.assertGreater(named, 50)

    def test_tests_that_pages_name_exist(self):
        """`Suite.Name`, `Suite.*`, `.Name` (of a suite that stands before it) in pages: a promise whose test was renamed has none."""
        top, tests, services = pathlib.Path(SOURCE), {}, set()
        for source in [*top.glob("tests/**/*.cpp"), *top.glob("tests/**/*.h")]:
            text = source.read_text(encoding="utf-8")
            for suite, name in re.findall(r"\bTEST(?:_F|_P)?\((\w+),\s*(\w+)\)", text):
                tests.setdefault(suite, set()).add(name.removeprefix("DISABLED_"))
            for prefix, suite in re.findall(r"INSTANTIATE_TEST_SUITE_P\((\w+),\s*(\w+)", text):
                tests.setdefault(prefix, set()).add(suite)
        for proto in top.glob("proto/gobo/v1/*.proto"):
            services.update(re.findall(r"^service (\w+)", proto.read_text(encoding="utf-8"), re.MULTILINE))
        of_any, named = set().union(*tests.values()), 0
        for page in [*top.glob("*.md"), *top.glob("docs/*.md")]:
            for quoted in re.findall(r"`([^`\n]+)`", page.read_text(encoding="utf-8")):
                for word in re.split(r"[ ,()]+", quoted):
                    found = re.fullmatch(r"([A-Z]\w+)?\.(\*|[A-Z]\w*\*?)", word)
                    if not found or found[1] in services:
                        continue
                    named += 1
                    of, name = tests.get(found[1], set()) if found[1] else of_any, found[2]
                    self.assertTrue(name in of or (name.endswith("*") and any(t.startswith(name[:-1]) for t in of)), f"{page.name} names {word}")
        self.assertGreater(named, 250)

    def test_the_test_can_fail(self):
        self.shell("here", 1, "export SEEN=yes; test -f scene.glb; gobo render scene.glb --size 16x16 --spp 16 --env studio.hdr -q -o a.png")
        self.shell("here", 2, "test $SEEN = yes; test -s a.png; build/clients/gobo status > /dev/null")
        with self.assertRaises(AssertionError):
            self.shell("here", 3, "false\ntrue")
        page = "a\n<!-- run -->\n```sh\nx\n```\n```sh\ny\n```\n```python\nz\n```\n<!-- no run: why -->\n```python\nw\n```\n"
        self.assertEqual(list(blocks(page)), [(4, "sh", "x\n")])
        self.assertEqual(list(blocks(page, ("python",))), [(4, "sh", "x\n"), (10, "python", "z\n")])


class Fields(unittest.TestCase):
    ASSIGNMENT = re.compile(r"(?<![\w.])(?:request\.)?([a-z_]+(?:\.[A-Za-z_0-9]+(?:\[\w*\])?)+)=")

    @staticmethod
    def is_field(path):
        descriptor, parts = render_pb2.RenderRequest.DESCRIPTOR, path.split(".")
        while parts:
            if descriptor is None or re.sub(r"\[\w*\]$", "", parts[0]) not in descriptor.fields_by_name:
                return False
            descriptor = descriptor.fields_by_name[re.sub(r"\[\w*\]$", "", parts.pop(0))].message_type
            if descriptor is not None and descriptor.GetOptions().map_entry:
                descriptor = descriptor.fields_by_name["value"].message_type
                del parts[:1]
        return True

    def test_what_documents_set_is_a_field(self):
        self.assertTrue(self.is_field("tone_map.curve") and self.is_field("lights.key.shadow.style.softness") and self.is_field("filters[0].bloom.gain"))
        self.assertFalse(self.is_field("encoding.tone_map.curve") or self.is_field("tone_map.curve.x"))
        roots, found = set(render_pb2.RenderRequest.DESCRIPTOR.fields_by_name), 0
        for page in [pathlib.Path(SOURCE) / "README.md", *sorted((pathlib.Path(SOURCE) / "docs").glob("*.md"))]:
            for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), 1):
                for path in self.ASSIGNMENT.findall(line):
                    if path.split(".")[0] in roots and "my_" not in path:
                        self.assertTrue(self.is_field(path), f"{page.name}:{number}: {path}")
                        found += 1
        self.assertGreater(found, 100)


if __name__ == "__main__":
    unittest.main()
