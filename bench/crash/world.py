# SPDX-License-Identifier: Apache-2.0
"""A folder in which daemons live and die: what is asked of them, what the right answers are, and what the dead must have left."""
import hashlib
import os
import re
import shutil
import signal
import sqlite3
import subprocess
import tempfile

from gobo.v1 import jobs_pb2, service_pb2
from scenes import lights
from wire import Caller, request

CONFIG = """listen = ["unix:s.sock"]
[log]
level = "info"
[engine]
threads = 2
store_bytes = "4MiB"
cache_folder = "cache"
disk_bytes = "4MiB"
roots = ["scenes"]
[limits]
tmp_folder = "tmp"
[ingest]
cache_bytes = "2MiB"
verify = "always"
[scheduler]
drain_s = 2
[jobs]
folder = "jobs"
workers = 2
lease_s = 5
checkpoint_s = 0.1
"""
SIDE = 24
PATIENCE_S = 300   # where nothing is killed: other work may have the machine
DONE = 3   # state of a task in the store (docs/job_store.md, jobs.proto)


def interactive(folder: str):
    """Small pictures that between them use every kind of kept thing: path traced terms, G-buffers, visibility, scene blobs."""
    out = []
    for k in range(24):
        scene = ("cornell", "fence", os.path.join(folder, "scenes", "a.glb"), os.path.join(folder, "scenes", "b.glb"))[k % 4]
        r = request(scene, SIDE, SIDE, (16, 32, 256)[k % 3], seed=k)
        r.integrator.max_bounces = 2
        r.outputs.extend([["beauty"], ["beauty", "depth"], ["beauty", "normal", "alpha"], ["direct", "indirect"]][k // 4 % 4])
        r.tone_map.exposure = k % 5
        out.append(r)
    return out


def spec(folder: str, n: int) -> jobs_pb2.JobSpec:
    r = request(("cornell", os.path.join(folder, "scenes", "a.glb"))[n % 2], SIDE, SIDE, (256, 768, 1536)[n % 3], seed=1000 + n % 12)
    r.integrator.max_bounces = 2
    r.ClearField("scheduling")
    s = jobs_pb2.JobSpec(request=r, key=f"job{n}")
    s.frames.first, s.frames.last = 1, 1 + n % 3
    return s


class World:
    """`start`, `kill`, `caller`; `where` is the folder, given for a file system of its own."""

    def __init__(self, program: str, where: str = "") -> None:
        self.program = program
        self.folder = where or tempfile.mkdtemp(prefix="gobo-crash-")
        for sub in ("scenes", "cache", "tmp", "jobs"):
            os.mkdir(os.path.join(self.folder, sub))
        for name, count in (("a", 3), ("b", 5)):
            with open(os.path.join(self.folder, "scenes", f"{name}.glb"), "wb") as file:
                file.write(lights(count))
        with open(os.path.join(self.folder, "gobod.toml"), "w", encoding="utf-8") as file:
            file.write(CONFIG)
        # The log may not fill the file system that is meant to be full.
        self.aside = tempfile.mkdtemp(prefix="gobo-crash-aside-")
        self.log = os.path.join(self.aside, "log")
        self.process = None
        self.environment = {}           # beside this process's own
        self.faults = []                # what a mode saw that must not be

    def spawn(self) -> None:
        with open(self.log, "ab") as log:
            self.process = subprocess.Popen([self.program, "--config", os.path.join(self.folder, "gobod.toml")], stdin=subprocess.DEVNULL,
                                            stdout=subprocess.PIPE, stderr=log, start_new_session=True,
                                            env={**os.environ, **self.environment})

    def start(self) -> bool:
        self.spawn()
        return b"ready" in self.process.stdout.readline()

    def end(self, how: int = signal.SIGKILL, patience: float = 60) -> int:
        """The exit status; a daemon that does not leave is killed."""
        self.process.send_signal(how)
        try:
            code = self.process.wait(patience)
        except subprocess.TimeoutExpired:
            self.process.kill()
            code = self.process.wait()
        self.process.stdout.close()
        return code

    def caller(self) -> Caller:
        return Caller(f"unix:{self.folder}/s.sock", "")

    @staticmethod
    def open_scene(caller: Caller, path: str, timeout: float = 20) -> None:
        """From the file, or its blob: once in a life, and then it is there."""
        caller.scenes.Open(service_pb2.OpenSceneRequest(source=path, name=path), timeout=timeout)

    def remove(self) -> None:
        if self.process and self.process.poll() is None:
            self.end()
        shutil.rmtree(self.folder, ignore_errors=True)
        shutil.rmtree(self.aside, ignore_errors=True)


def reference(program: str, specs: int = 36):
    """(pictures of interactive(), pictures of spec(n % specs)): by a daemon that keeps nothing and is left in peace."""
    world = World(program)
    try:
        with open(os.path.join(world.folder, "gobod.toml"), "w", encoding="utf-8") as file:
            file.write('listen = ["unix:s.sock"]\n[engine]\nthreads = 2\nroots = ["scenes"]\n')
        if not world.start():
            raise RuntimeError(f"{program} does not start")
        caller = world.caller()
        for name in ("a", "b"):
            world.open_scene(caller, os.path.join(world.folder, "scenes", f"{name}.glb"), PATIENCE_S)

        def picture(r):
            caller.admin.DropCaches(service_pb2.DropCachesRequest(), timeout=PATIENCE_S)
            return caller.picture(r, PATIENCE_S)
        pictures = [picture(r) for r in interactive(world.folder)]
        jobs = [hashlib.sha256(picture(spec(world.folder, n).request)).hexdigest() for n in range(specs)]
        caller.close()
        world.end(signal.SIGTERM)
        return pictures, jobs
    finally:
        world.remove()


class Ledger:
    """What was promised so far, held against the store after each death."""

    def __init__(self, world: World, jobs) -> None:
        self.world, self.jobs = world, jobs
        self.acknowledged = {}          # key -> job id
        self.done = {}                  # (job id, frame) -> sha256
        self.lost = self.twice = self.wrong = self.broken = 0
        self.first = ""
        self.said = 0                   # of the log, bytes read
        self.completed = set()

    def blame(self, kind: str, what: str) -> None:
        setattr(self, kind, getattr(self, kind) + 1)
        self.first = self.first or f"{kind}: {what}"

    def acknowledge(self, key: str, id: str) -> None:
        known = self.acknowledged.setdefault(key, id)
        if known != id:
            self.blame("twice", f"{key} is {known} and {id}")

    def read(self) -> None:
        """Of a copy: the next daemon shall find what the last one left."""
        copy = tempfile.mkdtemp(prefix="gobo-crash-store-")
        try:
            for name in ("jobs.sqlite", "jobs.sqlite-wal"):
                path = os.path.join(self.world.folder, "jobs", name)
                if os.path.exists(path):
                    shutil.copy(path, copy)
            if not os.path.exists(os.path.join(copy, "jobs.sqlite")):
                if self.acknowledged:
                    self.blame("lost", "the store is not there")
                return
            base = sqlite3.connect(os.path.join(copy, "jobs.sqlite"))
            try:
                self._hold(base)
            except sqlite3.DatabaseError as e:
                if self.acknowledged or "no such table" not in str(e):   # killed before the first commit
                    self.blame("broken", str(e))
            finally:
                base.close()
        finally:
            shutil.rmtree(copy, ignore_errors=True)
        self._log()

    def _hold(self, base) -> None:
        integrity = base.execute("PRAGMA integrity_check").fetchone()[0]
        if integrity != "ok":
            self.blame("broken", integrity)
        keys, named = {}, {}
        for id, key, frames in base.execute("SELECT id, key, frames FROM job"):
            if key in keys:
                self.blame("twice", f"{key} is two jobs")
            keys[key] = id
            named[id] = key
            tasks = base.execute("SELECT count(*), count(DISTINCT frame) FROM task WHERE job = ?", (id,)).fetchone()
            if tasks != (frames, frames):
                self.blame("lost", f"{key}: {tasks} rows and frames of {frames}")
        for key, id in self.acknowledged.items():
            if keys.get(key) != int(id[2:]):
                self.blame("lost", f"{key} was acknowledged as {id}")
        now = {}
        for job, frame, sha, outputs in base.execute("SELECT task.job, task.frame, min(file.sha256), count(file.sha256) FROM task LEFT JOIN file "
                                                     "ON file.job = task.job AND file.idx = task.idx WHERE task.state = ? GROUP BY task.job, task.idx", (DONE,)):
            if outputs != 1:
                self.blame("lost" if outputs == 0 else "twice", f"{named[job]} frame {frame}: {outputs} files")
                continue
            now[job, frame] = sha
            path = os.path.join(self.world.folder, "jobs", "results", str(job), sha)
            if (job, frame) in self.done:
                if not os.path.exists(path):   # swept though nobody asked for it, long before jobs.keep_days
                    self.blame("lost", f"{named[job]} frame {frame}: {path} is not there any more")
                continue
            try:
                with open(path, "rb") as file:
                    held = hashlib.sha256(file.read()).hexdigest()
            except OSError as e:
                self.blame("lost", f"{named[job]} frame {frame}: {e}")
                continue
            if held != self.jobs[int(named[job][3:]) % len(self.jobs)]:
                self.blame("wrong", f"{named[job]} frame {frame}: {path}")
        for which, sha in self.done.items():
            if now.get(which) != sha:
                self.blame("lost", f"job {which[0]} frame {which[1]} was done")
        self.done = now

    def _log(self) -> None:
        """A frame that the daemons say they finished twice was recorded twice, whatever the rows say."""
        with open(self.world.log, "rb") as file:
            file.seek(self.said)
            text = file.read()
        whole = text[:text.rfind(b"\n") + 1]
        self.said += len(whole)
        for name in re.findall(rb"job (j-\d+ frame -?\d+) done seconds=", whole):
            if name in self.completed:
                self.blame("twice", name.decode() + " was finished twice")
            self.completed.add(name)
