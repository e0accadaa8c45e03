# SPDX-License-Identifier: Apache-2.0
"""A private gobod: started on a socket in a folder of its own, stopped when it is closed or when this process ends in any way."""
from __future__ import annotations

import json
import os
import shutil
import subprocess
import tempfile
import threading
import weakref
from typing import IO, List, Optional, Sequence

from .errors import InvalidArgument, NotFound, Unavailable

# The shell outlives neither side: it stops gobod when its standard input closes, which the kernel does even after kill -9.
_GUARD = '"$@" </dev/null & p=$!; exec >/dev/null; read -r _; kill -TERM $p 2>/dev/null; wait $p'


def find_gobod() -> str:
    """$GOBO_GOBOD, the build folder that this package lies in, or the PATH. Errors: NotFound."""
    named = os.environ.get("GOBO_GOBOD")
    here = os.path.dirname(os.path.abspath(__file__))
    built = os.path.join(here, "..", "..", "..", "server", "gobod")
    for candidate in ([named] if named else [built, shutil.which("gobod") or ""]):
        if candidate and os.access(candidate, os.X_OK) and os.path.isfile(candidate):
            return os.path.realpath(candidate)
    raise NotFound(f"no gobod {'at $GOBO_GOBOD = ' + named if named else 'in the PATH; name it with GOBO_GOBOD'}")


def _stop(process: "subprocess.Popen[bytes]", folder: str, patience: float, owner: int) -> None:
    if os.getpid() != owner:   # a forked child that ends: the daemon is its parent's
        return
    if process.stdin and not process.stdin.closed:
        try:
            process.stdin.write(b"\n")   # the guard reads on where a forked child has this pipe, too
            process.stdin.close()
        except OSError:
            pass   # the guard has gone, and its daemon with it
    try:
        process.wait(patience)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    for stream in (process.stdout, process.stderr):
        if stream:
            stream.close()
    shutil.rmtree(folder, ignore_errors=True)


class Daemon:
    """A running gobod with `address`. Use as a context manager, or call `close`."""

    def __init__(self, *, roots: Sequence["str | os.PathLike[str]"] = ("/",), threads: int = 0, cache: "str | os.PathLike[str] | None" = None,
                 jobs: "str | os.PathLike[str] | None" = None, config: "str | os.PathLike[str] | None" = None, gobod: Optional[str] = None,
                 args: Sequence[str] = (), wait: float = 30.0) -> None:
        if jobs is not None and config is not None:
            raise InvalidArgument("jobs: name the folder in the config file, or leave config out", field="jobs")
        self.folder = tempfile.mkdtemp(prefix="gobo-py-")
        self.address = f"unix:{self.folder}/gobo.sock"
        command: List[str] = [gobod or find_gobod(), "--listen", self.address, "--threads", str(threads), "--log", "warn"]
        for root in roots:
            command += ["--root", os.fspath(root)]
        if cache is not None:
            command += ["--cache", os.fspath(cache)]
        if jobs is not None:
            config = os.path.join(self.folder, "gobod.toml")
            with open(config, "w", encoding="utf-8") as file:
                file.write(f"[jobs]\nfolder = {json.dumps(os.path.abspath(jobs))}\n")   # a JSON string is a TOML string
        if config is not None:
            command += ["--config", os.fspath(config)]
        self.log = os.path.join(self.folder, "gobod.log")
        try:
            with open(self.log, "wb") as log:
                process = subprocess.Popen(["/bin/sh", "-c", _GUARD, "sh", *command, *args], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                           stderr=log, start_new_session=True)
        except BaseException:
            shutil.rmtree(self.folder, ignore_errors=True)
            raise
        # A session of its own: Ctrl-C in the terminal reaches this process only, which then cancels its call.
        self._finalize = weakref.finalize(self, _stop, process, self.folder, 40.0, os.getpid())
        assert process.stdout is not None
        line = _first_line(process.stdout, wait)
        if b"ready" not in line:
            with open(self.log, "rb") as log:
                said = log.read()[-2000:].decode(errors="replace").strip()
            self._finalize()
            raise Unavailable(f"gobod did not start: {said or ('no answer within %g s' % wait)}")

    def close(self) -> None:
        """Drains and stops the daemon and removes its folder. Calling it again does nothing."""
        self._finalize()

    def __enter__(self) -> "Daemon":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _first_line(stream: IO[bytes], wait: float) -> bytes:
    lines: List[bytes] = []
    reader = threading.Thread(target=lambda: lines.append(stream.readline()), daemon=True)
    reader.start()
    reader.join(wait)
    return lines[0] if lines else b""
