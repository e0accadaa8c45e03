#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Latency of Drake's glTF Render API (docs/drake.md): one box at 640 x 480, median of N calls. Cold: another file each time, which is parsed; warm: the same file.
   drake.py [--gobod build/server/gobod] [--n 15] [--threads 2]      starts a daemon of its own
   drake.py --port P                                                 calls the server that listens there (drake-blender, for one)"""
import argparse
import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.parse

top = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..")
sys.path.insert(0, os.path.join(top, "tests", "python"))
from drake_form import HALF, boxes_glb, post  # noqa: E402

ROWS = [("label", None), ("depth", None), ("color", {"halt": {"spp": 1}}), ("color", {"halt": {"spp": 16}}), ("color", {"halt": {"spp": 64}})]


def resident(pid):
    with open(f"/proc/{pid}/status", encoding="ascii") as file:
        return int(re.search(r"VmRSS:\s+(\d+)", file.read())[1]) / 1024


def main():
    args = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    args.add_argument("--gobod", default=os.path.join(top, "build", "server", "gobod"))
    args.add_argument("--port", type=int)
    args.add_argument("--n", type=int, default=15)
    args.add_argument("--threads", type=int, default=2)
    args = args.parse_args()
    process, port = None, args.port
    folder = tempfile.TemporaryDirectory(prefix="gobo-drake-")
    if not port:
        config = os.path.join(folder.name, "gobod.toml")
        with open(config, "w", encoding="utf-8") as file:
            file.write(f'listen = ["unix:s.sock"]\n[web]\nlisten = "127.0.0.1:0"\n[engine]\nthreads = {args.threads}\n[ingest]\ncache_folder = "{folder.name}/ingest"\n')
        process = subprocess.Popen([args.gobod, "--config", config], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        port = int(re.findall(r"http://127\.0\.0\.1:(\d+)", process.stdout.readline().decode())[-1])
    try:
        print("| picture | cold, ms | warm, ms | bytes |\n|---|---|---|---|")
        serial = 0

        def scene():
            nonlocal serial
            serial += 1
            return boxes_glb([((0, -0.1 + 1e-6 * serial, 0), HALF, (1.0, 0.25, 0.25))])

        for image_type, more in ROWS:
            path = "/render" + ("?request=" + urllib.parse.quote(str(more).replace("'", '"')) if more else "")
            times = {"cold": [], "warm": []}
            for kind in times:
                glb = scene()
                for i in range(args.n + 1):
                    if kind == "cold":
                        glb = scene()
                    begun = time.perf_counter()
                    # A picture that was made is kept: the camera moves a little, as a robot's does.
                    status, _, body = post(port, glb, image_type, path=path, center_x=319.5 + 0.01 * serial + 0.001 * i)
                    took = 1e3 * (time.perf_counter() - begun)
                    if status != 200:
                        sys.exit(f"{image_type}: {status}: {body[:300]}")
                    if i:
                        times[kind].append(took)
            name = image_type + (" " + ", ".join(f"{k} {v}" for k, v in more["halt"].items()) if more else "")
            print(f"| {name} | {statistics.median(times['cold']):.1f} | {statistics.median(times['warm']):.1f} | {len(body)} |", flush=True)
        if process:
            print(f"\nresident: {resident(process.pid):.0f} MiB")
    finally:
        if process:
            process.kill()
            process.wait()
        folder.cleanup()


if __name__ == "__main__":
    main()
