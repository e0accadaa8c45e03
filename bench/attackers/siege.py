# SPDX-License-Identifier: Apache-2.0
"""An attacker's process as seen from outside, and the victim beside it."""
import json
import os
import select
import subprocess
import sys
import threading
import time

import grpc

import scenes
from attacks import ATTACKS
from daemon import HERE, TOKENS, Daemon
from gobo.v1 import jobs_pb2, service_pb2
from wire import Caller, request

PATIENCE_S = 10.0   # of the victim for one picture


class Attacker:
    """Stopped by closing its standard input; it dies with this process as well, which closes it."""

    def __init__(self, letter: str, daemon: Daemon) -> None:
        known = ATTACKS[letter]
        where = {"address": daemon.address, "http": daemon.http, "token": TOKENS[known.get("token", "attacker")], "ca": daemon.ca if daemon.tls else "",
                 "scenes": os.path.join(daemon.folder, "scenes")}
        # Behind the victim in the queue for cores: what is measured is the daemon's justice, not the kernel's.
        self.process = subprocess.Popen(["nice", "-n", "10", sys.executable, "-B", os.path.join(HERE, "attacks.py"), letter, json.dumps(where)],
                                        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
                                        env={**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)})

    def on(self, patience: float = 150.0) -> bool:
        return bool(select.select([self.process.stdout], [], [], patience)[0]) and self.process.stdout.readline() == b"on\n"

    def stop(self) -> dict:
        try:
            out, _ = self.process.communicate(timeout=10)
            return json.loads(out.splitlines()[-1])
        except (subprocess.TimeoutExpired, ValueError, IndexError):
            self.process.kill()
            self.process.wait()
            return {"done": {}, "said": "did not say"}


def percentile(values, p: float) -> float:
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(p * len(ordered)))] if ordered else float("nan")


class Victim:
    """Interactive pictures one after the other, each with a seed of its own. A picture's time runs until it is there, refusals and repetitions
    included; one that is not there after PATIENCE_S counts as that long and as failed."""

    def __init__(self, daemon: Daemon) -> None:
        self.daemon = daemon
        self.caller = Caller(daemon.address, TOKENS["victim"], daemon.ca if daemon.tls else "")
        self.seed = 0
        self.codes = {}

    def picture(self):
        self.seed += 1
        begun = time.monotonic()
        while True:
            left = PATIENCE_S - (time.monotonic() - begun)
            if left <= 0:
                return PATIENCE_S, False
            try:
                self.caller.picture(request(seed=self.seed + 1000000), left)
                return time.monotonic() - begun, True
            except grpc.RpcError as e:
                self.codes[e.code().name] = self.codes.get(e.code().name, 0) + 1
            except ValueError:
                self.codes["CUT_SHORT"] = self.codes.get("CUT_SHORT", 0) + 1
            if self.daemon.process.poll() is not None:
                return PATIENCE_S, False
            time.sleep(0.1)

    def loop(self, seconds: float, pictures: int = 0):
        """Until `seconds` are over, or `pictures` were taken if that is not 0. ([seconds], failed)"""
        times, failed = [], 0
        end = time.monotonic() + seconds
        while time.monotonic() < end and (not pictures or len(times) < pictures):
            took, ok = self.picture()
            times.append(took)
            failed += not ok
            if self.daemon.process.poll() is not None:
                break
        return times, failed


class Errands:
    """What else the victim does, each with 5 s: status, a small upload, a list of its jobs. One durable job of one small frame as well."""

    def __init__(self, daemon: Daemon) -> None:
        self.daemon = daemon
        self.over = threading.Event()
        self.tally = {}
        self.job_s = None
        self.thread = threading.Thread(target=self._run, daemon=True)
        self.thread.start()

    def _run(self) -> None:
        caller = Caller(self.daemon.address, TOKENS["victim"], self.daemon.ca if self.daemon.tls else "")
        small, meta = scenes.small(), caller.metadata
        spec = jobs_pb2.JobSpec(request=request(width=32, height=24, spp=16), key=f"errand{time.time()}")
        job, begun = None, time.monotonic()
        while not self.over.wait(1.0) and self.daemon.process.poll() is None:
            for name, call in (("status", lambda: caller.admin.GetStatus(service_pb2.StatusRequest(), timeout=5, metadata=meta)),
                               ("upload", lambda: caller.upload(small, 5, name="errand")),
                               ("list", lambda: caller.jobs.List(jobs_pb2.ListJobsRequest(client="victim", page_size=10), timeout=5, metadata=meta))):
                entry = self.tally.setdefault(name, [0, 0])
                entry[1] += 1
                try:
                    call()
                    entry[0] += 1
                except grpc.RpcError:
                    pass
            try:
                if job is None:
                    job = caller.jobs.Submit(spec, timeout=5, metadata=meta)
                elif self.job_s is None and caller.jobs.Get(jobs_pb2.GetJobRequest(id=job.id), timeout=5, metadata=meta).state == jobs_pb2.Job.DONE:
                    self.job_s = time.monotonic() - begun
            except grpc.RpcError:
                pass
        caller.close()

    def stop(self) -> dict:
        self.over.set()
        self.thread.join(15)
        return {"job_s": self.job_s, **{k: f"{ok}/{n}" for k, (ok, n) in self.tally.items()}}
