# SPDX-License-Identifier: Apache-2.0
"""The package in the build folder becomes a wheel without a network, and what is installed from it renders, knows its types and has the viewer."""
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest
import zipfile

import gobo
from support import DaemonTest

PACKAGE = pathlib.Path(gobo.__file__).parent.parent


class Wheel(DaemonTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        source = shutil.copytree(PACKAGE, os.path.join(cls.folder, "source"), ignore=shutil.ignore_patterns("__pycache__"))   # setuptools writes beside its sources
        cls.env = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "PIP_"))}
        cls.pip("wheel", "--no-build-isolation", "-w", cls.folder, source)
        cls.wheel, = pathlib.Path(cls.folder).glob("*.whl")

    @classmethod
    def pip(cls, command, *args):
        done = subprocess.run([sys.executable, "-m", "pip", "--isolated", "--disable-pip-version-check", command, "--no-deps", "--no-index", "-q", *map(str, args)],
                              capture_output=True, text=True, timeout=300, env=cls.env, cwd=cls.folder)
        if done.returncode:
            raise AssertionError(done.stdout + done.stderr)

    def test_its_name_is_nobodys(self):
        # "gobo" on PyPI is another's package: pip must never take that one for ours.
        self.assertRegex(self.wheel.name, r"^gobo_client-\d+\.\d+\.\d+-py3-none-any\.whl$")

    def test_everything_is_in_it(self):
        with zipfile.ZipFile(self.wheel) as archive:
            inside = {n for n in archive.namelist() if n.startswith("gobo/")}
        there = {str(p.relative_to(PACKAGE)) for p in (PACKAGE / "gobo").rglob("*") if p.is_file() and "__pycache__" not in p.parts}
        self.assertEqual(inside, there)
        for name in ("gobo/py.typed", "gobo/aio.py", "gobo/widget.py", "gobo/viewer/orbit.js", "gobo/viewer/widget.js", "gobo/v1/render_pb2.pyi"):
            self.assertIn(name, inside)

    def test_what_is_installed_renders(self):
        with tempfile.TemporaryDirectory() as target:
            self.pip("install", "--target", target, self.wheel)
            code = ("import sys, gobo, importlib.metadata as m\n"
                    "assert gobo.__file__.startswith(sys.argv[2]), gobo.__file__\n"
                    "r = gobo.connect(sys.argv[1]).render('cornell', size=(16, 12), spp=16)\n"
                    "print(r.image.shape, m.version('gobo-client'), len(gobo.widget.Viewer._esm) > 1000, sorted(m.requires('gobo-client')))")
            done = subprocess.run([sys.executable, "-c", code, self.client.address, target], capture_output=True, text=True, timeout=60,
                                  env={**self.env, "PYTHONPATH": target}, cwd=target)
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertRegex(done.stdout, r"^\(12, 16, 3\) \d+\.\d+\.\d+ True .*'grpcio[ (>=]+1\.51")


if __name__ == "__main__":
    unittest.main()
