#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A picture larger than memory: direct light of one light, rendered in tiles into one tiled EXR by a daemon of little memory.

    bench/tiled_picture.py [--build build] [--size 16384] [--tile 1024] [--memory 1GiB] [--scene cornell] [-o FILE]

Prints seconds, the peak of both programs' memory (VmHWM) and the file's size. The file goes unless -o keeps it. That tiles have the bits of the whole is
tested elsewhere (tests/render/plan/window_test.cpp, tests/python/tiles_test.py).
"""
import argparse
import os
import pathlib
import re
import subprocess
import tempfile
import time

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--build", default=os.environ.get("BUILD", "build"))
parser.add_argument("--size", type=int, default=16384)
parser.add_argument("--tile", type=int, default=1024)
parser.add_argument("--memory", default="1GiB", help="memory_bytes of the daemon; its store has 256 MiB, results being used 512 MiB, replies 256 MiB")
parser.add_argument("--scene", default="fence", help="its light key is switched off")
parser.add_argument("-o", "--out")
options = parser.parse_args()
build = pathlib.Path(options.build).resolve()
DIRECT = ["--spp", "1", "--set", "lights.key.enabled=false", "--set", "integrator.indirect=false", "--set", "shadows.ray_traced.samples=1", "--set", "view_samples=1", "--half", "-q"]


def peak(pid):
    return int(re.search(r"VmHWM:\s+(\d+)", pathlib.Path(f"/proc/{pid}/status").read_text())[1]) / 1024


with tempfile.TemporaryDirectory(prefix="gobo-tiled-") as folder:
    here = pathlib.Path(folder)
    (here / "gobod.toml").write_text(f'[engine]\nmemory_bytes = "{options.memory}"\nstore_bytes = "256MiB"\nkeep_renders_bytes = "16MiB"\n'
                                     '[limits]\nreply_bytes = "256MiB"\n[scheduler]\npinned_bytes = "512MiB"\n')
    out = options.out or here / "big.exr"
    daemon = subprocess.Popen([build / "server/gobod", "--config", here / "gobod.toml", "--listen", f"unix:{here}/socket"], stdout=subprocess.PIPE,
                              stderr=subprocess.STDOUT, text=True)
    try:
        for line in daemon.stdout:
            if " ready on " in line:
                break
        else:
            raise SystemExit("gobod ended before it was ready")
        environment = {**os.environ, "GOBO_SERVER": f"unix:{here}/socket"}
        size = ["--size", f"{options.size}x{options.size}"]
        begun = time.monotonic()
        client = subprocess.Popen([build / "clients/gobo", "render", options.scene, *size, *DIRECT, "--tile", str(options.tile), "-o", str(out)], env=environment)
        most = 0.0
        while client.poll() is None:
            try:
                most = max(most, peak(client.pid))
            except (OSError, TypeError):
                pass  # it has just ended
            time.sleep(0.05)
        if client.returncode:
            raise SystemExit(f"gobo render ended with {client.returncode}")
        wall = time.monotonic() - begun
        pixels = options.size**2
        print(f"{options.scene}, {options.size} x {options.size}, tiles of {options.tile}, daemon of {options.memory}: {wall:.1f} s, {1e9 * wall / pixels:.0f} ns a pixel; "
              f"peak {peak(daemon.pid):.0f} MB daemon, {most:.0f} MB client; file {os.path.getsize(out) / 2**20:.0f} MiB; float RGB whole: {12 * pixels / 2**20:.0f} MiB")
    finally:
        daemon.terminate()
        daemon.communicate()
