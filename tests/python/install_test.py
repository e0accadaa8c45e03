# SPDX-License-Identifier: Apache-2.0
"""What `cmake --install` puts into an empty folder works there: the programs, what they load, and the renderer as a library that a program of a few lines
finds with find_package(gobo) and renders and relights with."""
import glob
import os
import re
import shutil
import signal
import subprocess
import tempfile
import unittest

from support import SOURCE, gltf

BUILD = os.environ["GOBO_BUILD_FOLDER"]


class Install(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.mkdtemp(prefix="gobo-install-")
        cls.addClassCleanup(shutil.rmtree, cls.folder, ignore_errors=True)
        cls.prefix = os.path.join(cls.folder, "prefix")
        cls.run_(["cmake", "--install", BUILD, "--prefix", cls.prefix])

    @classmethod
    def run_(cls, command, **more):
        # Nothing of the build folder may help.
        env = {k: v for k, v in os.environ.items() if not k.startswith(("GOBO_", "LD_", "PYTHON"))}
        done = subprocess.run(command, capture_output=True, text=True, timeout=300, env={**env, **more}, cwd=cls.folder)
        if done.returncode != 0:
            raise AssertionError(f"{' '.join(command)}\n{done.stdout}{done.stderr}")
        return done.stdout

    def at(self, *names):
        return os.path.join(self.prefix, *names)

    def test_programs(self):
        scene = gltf(self.folder)
        socket = f"unix:{self.folder}/s.sock"
        daemon = subprocess.Popen([self.at("bin", "gobod"), "--listen", socket, "--root", self.folder], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, cwd=self.folder)
        try:
            self.assertTrue(daemon.stdout.readline())
            small = ["--size", "32x16", "--spp", "1"]
            self.run_([self.at("bin", "gobo"), "load", scene, "--name", "tri"], GOBO_SERVER=socket)   # by the installed gobo-ingest
            self.run_([self.at("bin", "gobo"), "render", "tri", "-o", "tri.png", *small], GOBO_SERVER=socket)
            self.run_([self.at("bin", "gobo"), "render", "cornell", "-o", "sky.exr", *small], GOBO_SERVER=socket)
            self.run_([self.at("bin", "gobo"), "render", "tri", "-o", "lit.png", "--env", os.path.join(self.folder, "sky.exr"), *small], GOBO_SERVER=socket)
            self.run_([self.at("bin", "gobo"), "compare", "tri.png", "tri.png"])
        finally:
            daemon.send_signal(signal.SIGTERM)
            daemon.wait(30)
            daemon.stdout.close()

    def test_what_belongs_to_it(self):
        for file in ("share/man/man1/gobo.1", "share/bash-completion/completions/gobo", "lib/systemd/system/gobod.service", "share/gobo/configs/studio.toml",
                     "share/gobo/front/nginx.conf", "share/gobo/proto/gobo/v1/render.proto", "share/doc/gobo/operations.md", "share/doc/gobo/LICENSE",
                     "lib/python3/dist-packages/gobo/__init__.py"):
            self.assertTrue(os.path.isfile(self.at(file)), file)

    @unittest.skipUnless(os.path.isfile(os.path.join(BUILD, "build.ninja")), "not built by ninja")
    def test_make_builds_what_is_installed(self):
        """`make` and then `cmake --install` works: nothing that it installs is left to `ninja all`."""
        with open(os.path.join(SOURCE, "Makefile"), encoding="utf-8") as file:
            line = re.search(r"^build:.*\n(?:\t.*\n)*?\t@ninja -C \S+ -j \S+ (.+)$", file.read(), re.M)
        # Read here, because `ninja -t inputs` leaves out what only names like `gobo` ask for.
        needs = {}
        with open(os.path.join(BUILD, "build.ninja"), encoding="utf-8") as file:
            for statement in file:
                if statement.startswith("build "):
                    outputs, inputs = statement[len("build "):].split(": ", 1)
                    needs.update(dict.fromkeys(outputs.split(), inputs.split()[1:]))
        built, open_ = set(), line[1].split()
        self.assertLessEqual(set(open_), set(needs))
        while open_:
            name = open_.pop()
            if name not in built:
                built.add(name)
                open_ += needs.get(name, [])
        named = set()
        for script in glob.glob(os.path.join(BUILD, "**", "cmake_install.cmake"), recursive=True):
            with open(script, encoding="utf-8") as file:
                named.update(re.findall(rf'"{re.escape(BUILD)}/([^"]+)"', file.read()))
        # What ninja does not make was made when the build was configured; of folders that are installed each file counts.
        wanted = {file for file in needs if any(file == name or file.startswith(name + "/") for name in named)}
        self.assertLessEqual({"docs/gobo.1", "server/gobod", "clients/python/gobo/wire.py"}, wanted)
        self.assertEqual(sorted(wanted - built), [])

    def test_library(self):
        out = os.path.join(self.folder, "out")
        self.run_(["cmake", "-S", os.path.join(SOURCE, "examples", "in_process"), "-B", out, "-G", "Ninja", f"-DCMAKE_PREFIX_PATH={self.prefix}"])
        self.run_(["cmake", "--build", out])
        self.run_([self.at("bin", "gobo"), "--local", "render", "cornell", "-o", "map.exr", "--size", "32x16", "--spp", "1"])
        said = self.run_([os.path.join(out, "in_process"), "width=64", "height=40", "halt.spp=4", f"environment.path={self.folder}/map.exr"])
        with open(os.path.join(SOURCE, "examples", "in_process", "main.cpp"), encoding="utf-8") as source:
            self.assertLessEqual(sum(1 for line in source if line.strip() and not line.startswith("//")), 30)
        self.assertRegex(said, r"sun\.png: [1-9]\d* rays.*\nno_sun\.png: 0 rays")
        for file in ("sun.png", "no_sun.png"):
            self.assertGreater(os.path.getsize(os.path.join(self.folder, file)), 500)


if __name__ == "__main__":
    unittest.main()
