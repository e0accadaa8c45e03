# SPDX-License-Identifier: Apache-2.0
"""What happens to a daemon besides being killed. Each mode has the folder made (`place`), does its harm while a daemon works (`harm`), heals it
(`heal`) and spoils the folder between two lives (`between`)."""
import os
import shutil
import subprocess
import tempfile


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


MODES = {"kill": Kill, "full": Full, "readonly": ReadOnly, "deleted": Deleted, "traded": Traded, "torn": Torn}
