#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A coordinator and workers on this machine that are killed with -9 while they render, and frozen for longer than their leases; in the end every
frame must be there once, with the bits of a render by one daemon. Then the time that 1, 2, 4, 8 workers take for the same frames without any of that.

    bench/farm_kill.py [--build build] [--kills 200] [--workers 4] [--seed 1] [--postgres URI]
"""
import argparse
import hashlib
import json
import os
import pathlib
import random
import re
import signal
import subprocess
import sys
import tempfile
import time


class Farm:
    def __init__(self, build, folder, store=""):
        self.build, self.folder = pathlib.Path(build).resolve(), pathlib.Path(folder)
        self.address = f"unix:{self.folder}/c.sock"
        text = f'listen = ["{self.address}"]\n[engine]\nthreads = 1\n[jobs]\nfolder = "jobs"\nworkers = 0\nlease_s = 2\ncheckpoint_s = 0.2\n'
        if store:
            text += f'store = "{store}"\n'
        (self.folder / "gobod.toml").write_text(text)
        self.coordinator, self.workers = None, {}

    def spawn(self, name, *words):
        log = open(self.folder / f"{name}.log", "ab")
        return subprocess.Popen([str(self.build / "server/gobod"), *words], stdout=log, stderr=log, stdin=subprocess.DEVNULL)

    def start(self):
        self.coordinator = self.spawn("coordinator", "--config", str(self.folder / "gobod.toml"))
        for _ in range(600):
            if self.gobo("status", check=False).returncode == 0:
                return
            if self.coordinator.poll() is not None:
                break
            time.sleep(0.05)
        sys.exit(f"the coordinator does not start: {(self.folder / 'coordinator.log').read_text(errors='replace')[-1000:]}")

    def hire(self, number):
        self.workers[number] = self.spawn(f"w{number}", "--worker", self.address, "--worker-name", f"w{number}", "--threads", "1", "--tmp", str(self.folder))

    def gobo(self, *words, check=True):
        for _ in range(50):
            said = subprocess.run([str(self.build / "clients/gobo"), "--server", self.address, *words], capture_output=True, text=True)
            if said.returncode == 0 or not check:
                return said
            time.sleep(0.2)      # the coordinator was killed a moment ago
        sys.exit(f"gobo {' '.join(words)}: {said.stderr}")

    def submit(self, key, frames, spp, size="48x36", more=()):
        return json.loads(self.gobo("--json", "jobs", "submit", "cornell", "--frames", f"1-{frames}", "--size", size, "--spp", str(spp), "--key", key, *more,
                                    "--set", f"seed={sum(map(ord, key))}", "--set", "encoding.format=RAW_FLOAT").stdout)["id"]

    def job(self, name):
        return json.loads(self.gobo("--json", "jobs", "show", name).stdout)

    def end(self):
        for process in [*self.workers.values(), self.coordinator]:
            process.send_signal(signal.SIGCONT)
            process.terminate()
        for process in [*self.workers.values(), self.coordinator]:
            process.wait(60)


def verdict(farm, jobs, begun):
    """Waits for the jobs. In words how many frames were lost, completed twice, or have other bits than a render by one process alone; and their number."""
    for name in jobs:
        while farm.job(name)["state"] not in ("DONE", "FAILED", "CANCELLED"):
            time.sleep(0.2)
    took = time.monotonic() - begun
    lost = other = frames = parts = 0
    for name in jobs:
        job = farm.job(name)
        request = job["spec"]["request"]
        alone = farm.folder / "alone.raw"
        subprocess.run([str(farm.build / "clients/gobo"), "--local", "render", "cornell", "--size", f"{request['width']}x{request['height']}", "--spp",
                        str(request["halt"]["spp"]), "--set", f"seed={request['seed']}", "--set", "encoding.format=RAW_FLOAT", "-o", str(alone)],
                       check=True, capture_output=True)
        expected = hashlib.sha256(alone.read_bytes()).hexdigest()
        for frame in job["frames"]:
            frames += 1
            parts += frame.get("parts", 0)
            files = frame.get("files", [])
            lost += frame["state"] != "DONE" or len(files) != 1
            other += any(f["sha256"] != expected for f in files)
    completed = {}
    for log in farm.folder.glob("w*.log"):
        for line in log.read_text(errors="replace").splitlines():
            if found := re.search(r"job (j-\d+ frame -?\d+(?: part \d+)?) done ", line):
                completed[found[1]] = completed.get(found[1], 0) + 1
    twice = sum(count > 1 for count in completed.values())
    return (f"{len(jobs)} jobs of {frames} frames ({parts} parts), {took:.0f} s: lost {lost}, completed twice {twice} of {len(completed)}, other bits {other}",
            lost + twice + other)


def kills(args, random_):
    with tempfile.TemporaryDirectory(prefix="gobo-farm-") as folder:
        farm = Farm(args.build, folder, args.postgres)
        farm.start()
        for n in range(args.workers):
            farm.hire(n)
        jobs, begun, done, coordinators, frozen = [], time.monotonic(), 0, 0, 0
        while done < args.kills:
            if done % 10 == 0:
                whole = len(jobs) % 2 == 0
                jobs.append(farm.submit(f"shot-{len(jobs)}", 6, random_.choice([256, 512, 1024]), more=() if whole else ("--tile-px", "16")))
            time.sleep(random_.uniform(0.02, 0.5))
            if random_.random() < 0.1:
                farm.coordinator.kill()
                farm.coordinator.wait()
                farm.start()
                coordinators += 1
            elif random_.random() < 0.1:
                victim = random_.choice(list(farm.workers.values()))
                victim.send_signal(signal.SIGSTOP)
                time.sleep(random_.uniform(0.5, 3))
                victim.send_signal(signal.SIGCONT)
                frozen += 1
                continue
            else:
                number = random_.choice(list(farm.workers))
                farm.workers[number].kill()
                farm.workers[number].wait()
                farm.hire(number)
            done += 1
        told, bad = verdict(farm, jobs, begun)
        farm.end()
    print(f"{args.workers} workers, {args.kills} kill -9 ({coordinators} of them of the coordinator), {frozen} frozen, {told}")
    return bad


def throughput(args):
    for workers in (1, 2, 4, 8):
        with tempfile.TemporaryDirectory(prefix="gobo-farm-") as folder:
            farm = Farm(args.build, folder, args.postgres)
            farm.start()
            for n in range(workers):
                farm.hire(n)
            while sum(w["attending"] for w in json.loads(farm.gobo("--json", "workers").stdout).get("workers", [])) < workers:
                time.sleep(0.1)
            begun = time.monotonic()
            # Frames that differ, or what one left in a worker's store would serve the next.
            name = json.loads(farm.gobo("--json", "jobs", "submit", "cornell", "--frames", "1-32", "--fps", "24", "--size", "160x120", "--spp", "64",
                                        "--formula", "camera.yfov_deg=40 + 4*time", "--key", "speed").stdout)["id"]
            farm.gobo("jobs", "watch", name)
            took = time.monotonic() - begun
            print(f"{workers} workers: 32 frames in {took:.2f} s, {32 / took:.1f} frames/s on {os.cpu_count()} cores")
            farm.end()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", default="build")
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--workers", type=int, default=4)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--postgres", default="", help="URI of jobs.store; SQLite without")
    args = parser.parse_args()
    bad = kills(args, random.Random(args.seed)) if args.kills else 0
    throughput(args)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
