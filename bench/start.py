#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What starting costs, as who starts it sees it: from exec until the daemon says that it is ready, and `--version`.

    bench/start.py [--build build] [--runs 9]

Processor time is that of all threads (schedstat), memory the resident peak (VmHWM). Medians. Linux.
"""
import argparse
import os
import pathlib
import re
import resource
import statistics
import subprocess
import tempfile
import time


def ready(gobod, folder):
    """(wall ms, processor ms, peak MB)"""
    start = time.monotonic()
    daemon = subprocess.Popen([gobod, "--listen", f"unix:{folder}/socket"], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        for line in daemon.stdout:
            if " ready on " in line:
                break
        else:
            raise SystemExit(f"{gobod} ended before it was ready")
        wall = time.monotonic() - start
        tasks = pathlib.Path(f"/proc/{daemon.pid}/task")
        processor = sum(int((task / "schedstat").read_text().split()[0]) for task in tasks.iterdir())
        peak = int(re.search(r"VmHWM:\s+(\d+)", pathlib.Path(f"/proc/{daemon.pid}/status").read_text())[1])
        return 1e3 * wall, processor * 1e-6, peak / 1024
    finally:
        daemon.terminate()
        daemon.communicate()


def version(program):
    """(wall ms, processor ms)"""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    subprocess.run([program, "--version"], check=True, stdout=subprocess.DEVNULL)
    wall, after = time.monotonic() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    return 1e3 * wall, 1e3 * (after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)


def medians(rows):
    return [statistics.median(column) for column in zip(*rows)]


parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--build", default=os.environ.get("BUILD", "build"))
parser.add_argument("--runs", type=int, default=9)
options = parser.parse_args()
build = pathlib.Path(options.build)
with tempfile.TemporaryDirectory(prefix="gobo-start-") as folder:
    wall, processor, peak = medians([ready(build / "server/gobod", folder) for _ in range(options.runs)])
    print(f"gobod, exec to ready: {wall:.0f} ms, {processor:.0f} ms of processor, {peak:.0f} MB")
for program in ("server/gobod", "clients/gobo"):
    wall, processor = medians([version(build / program) for _ in range(options.runs)])
    print(f"{program} --version: {wall:.0f} ms, {processor:.0f} ms of processor")
