# SPDX-License-Identifier: Apache-2.0
"""What happens to a daemon besides being killed. Each mode says what it lacks here (`missing`), sets its world up (`prepare`), does its harm
while a daemon works (`harm`), heals it (`heal`) and spoils the folder between two lives (`between`)."""
import glob
import os
import re
import shutil
import subprocess
import tempfile
import time


def mounted(size: str) -> str:
    """A small file system of its own, or "" where mounting is not permitted."""
    folder = tempfile.mkdtemp(prefix="gobo-crash-fs-")
    if subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size},mode=0700", "none", folder], capture_output=True, check=False).returncode == 0:
        return folder
    os.rmdir(folder)
    return ""


def unmount(folder: str) -> None:
    subprocess.run(["umount", "-l", folder], check=False)
    os.rmdir(folder)


class Kill:
    """kill -9 at random moments."""
    words = "kill -9"
    mount = ""

    def missing(self) -> str:
        return ""

    def prepare(self, world) -> None: ...
    def harm(self, world, dice) -> None: ...
    def heal(self, world) -> None: ...
    def between(self, world, dice) -> None: ...


class Full(Kill):
    """The disk is full for a while; there is room again before the next start."""
    words = "disk full, then kill -9"
    mount = "24m"

    def harm(self, world, dice) -> None:
        left = dice.choice((0, 0, 4096, 65536))   # sometimes a little room
        try:
            with open(os.path.join(world.folder, "filler"), "wb") as file:
                while True:
                    free = os.statvfs(world.folder)
                    bytes_free = free.f_bavail * free.f_frsize - left
                    if bytes_free <= 0:
                        break
                    file.write(b"f" * min(bytes_free, 1 << 20))
                    file.flush()
        except OSError:
            pass

    def heal(self, world) -> None:
        if os.path.exists(os.path.join(world.folder, "filler")):
            os.unlink(os.path.join(world.folder, "filler"))


class ReadOnly(Kill):
    """Paths lead to a read-only file system for a while, as after a fault of the disk; files that are open go on taking what is written. (A
    file system with writers cannot be made read-only from outside, so one that is read-only is mounted over it.)"""
    words = "read-only, then kill -9"
    mount = "64m"
    over = False

    def harm(self, world, dice) -> None:
        for options in (["--bind", world.folder], ["-o", "remount,bind,ro"]):
            subprocess.run(["mount", *options, world.folder], capture_output=True, check=True)
            self.over = True

    def heal(self, world) -> None:
        if self.over:
            subprocess.run(["umount", "-l", world.folder], check=True)
            self.over = False


class Deleted(Kill):
    """Somebody removes the cache folder, or parts of it, under the daemon."""
    words = "cache folder removed, then kill -9"

    def harm(self, world, dice) -> None:
        cache = os.path.join(world.folder, "cache")
        inside = sorted(os.listdir(cache)) if os.path.isdir(cache) else []
        part = dice.choice([cache] + [os.path.join(cache, n) for n in inside])
        shutil.rmtree(part, ignore_errors=True) if os.path.isdir(part) else os.path.exists(part) and os.unlink(part)


def _files(folder: str):
    return sorted(os.path.join(at, name) for at, _, names in os.walk(folder) for name in names
                  if name.endswith(".term") or "ingest" in at and "sqlite" not in name and name != "lock")


class Traded(Kill):
    """Files of the caches trade names between two lives, so that each is whole but not what its name says."""
    words = "cache files trade names after kill -9"

    def between(self, world, dice) -> None:
        by_size = {}
        for path in _files(os.path.join(world.folder, "cache")):
            by_size.setdefault(os.path.getsize(path), []).append(path)
        for paths in by_size.values():       # of one size: those that a reader could take for one another
            dice.shuffle(paths)
            for a, b in zip(paths[::2], paths[1::2]):
                os.rename(a, a + "~")
                os.rename(b, a)
                os.rename(a + "~", b)


class Torn(Kill):
    """Cache files are cut short or have a bit turned between two lives."""
    words = "cache files damaged after kill -9"

    def between(self, world, dice) -> None:
        for path in _files(os.path.join(world.folder, "cache")):
            size = os.path.getsize(path)
            if size and dice.random() < 0.5:
                with open(path, "r+b") as file:
                    if dice.random() < 0.5:
                        file.truncate(dice.randrange(size))
                    else:
                        at = dice.randrange(size)
                        file.seek(at)
                        bits = file.read(1)[0]
                        file.seek(at)
                        file.write(bytes([bits ^ 1 << dice.randrange(8)]))


class Clock(Kill):
    """The wall clock of the daemon jumps by minutes to years, forwards and backwards, while it works and between lives. The machine's own is left
    alone: libfaketime gives what a file says. Monotonic clocks go on as they are, and files keep the times that the kernel gives them."""
    words = "wall clock jumps, then kill -9"
    library = "/usr/lib/*/faketime/libfaketime.so.1"
    jumps = (-400 * 86400, -40 * 86400, -86400, -3600, -60, 60, 3600, 86400, 40 * 86400, 400 * 86400)

    def __init__(self) -> None:
        self.offset = self.lives = 0

    def missing(self) -> str:
        return "" if glob.glob(self.library) else "libfaketime is not installed (deploy/install-deps --bench)"

    def prepare(self, world) -> None:
        self.file = os.path.join(world.aside, "clock")
        self._set(0)
        world.environment = {"LD_PRELOAD": glob.glob(self.library)[0], "FAKETIME_TIMESTAMP_FILE": self.file, "FAKETIME_NO_CACHE": "1",
                             "FAKETIME_DONT_FAKE_MONOTONIC": "1", "NO_FAKE_STAT": "1"}

    def _set(self, offset: int) -> None:
        self.offset = offset
        with open(self.file + "~", "w", encoding="ascii") as file:
            file.write(f"{offset:+d}\n")
        os.rename(self.file + "~", self.file)

    def _jump(self, dice) -> None:
        jump = dice.choice(self.jumps)
        self._set(self.offset + (jump if abs(self.offset + jump) < 10 * 365 * 86400 else -jump))

    def harm(self, world, dice) -> None:
        for _ in range(dice.randrange(1, 4)):
            self._jump(dice)
            time.sleep(dice.uniform(0.02, 0.3))

    def heal(self, world) -> None:
        if world.process and world.process.poll() is not None:   # what the library leaves when its process is killed
            for name in (f"faketime_shm_{world.process.pid}", f"sem.faketime_sem_{world.process.pid}"):
                if os.path.exists(os.path.join("/dev/shm", name)):
                    os.unlink(os.path.join("/dev/shm", name))

    def between(self, world, dice) -> None:
        self.lives += 1
        if self.lives == 10:
            with open(world.log, "rb") as file:
                if len(set(re.findall(rb"(?m)^(\d{4}-\d\d-\d\d)T", file.read()))) < 3:
                    world.faults.append("the clock of the daemon did not jump")
        if dice.random() < 0.5:
            self._jump(dice)


class Unlinked(Kill):
    """The job database loses its name under the daemon, as when somebody removes or moves it, and is put back before the next start. A daemon
    that is started without it must refuse, or it would sweep the results that no row names."""
    words = "job database moved away, then kill -9"
    names = ("jobs.sqlite", "jobs.sqlite-wal", "jobs.sqlite-shm")
    away = False

    def harm(self, world, dice) -> None:
        self._move(world, "jobs", "away")
        self.away = True

    def heal(self, world) -> None:
        if not self.away:
            return
        if not (world.process and world.process.poll() is None):   # the daemon is dead
            if world.start():
                world.faults.append("started without its job database")
            world.end()
        if os.path.exists(os.path.join(world.folder, "jobs", "jobs.sqlite")):
            world.faults.append("made another job database")
        self._move(world, "away", "jobs")
        self.away = False

    def _move(self, world, source: str, target: str) -> None:
        os.makedirs(os.path.join(world.folder, target), exist_ok=True)
        for name in self.names:
            path = os.path.join(world.folder, source, name)
            if os.path.exists(path):
                os.rename(path, os.path.join(world.folder, target, name))


MODES = {"kill": Kill, "full": Full, "readonly": ReadOnly, "deleted": Deleted, "traded": Traded, "torn": Torn, "clock": Clock, "unlinked": Unlinked}
