# SPDX-License-Identifier: Apache-2.0
"""A gobod of the bench's own: a configuration with every bound stated, a folder that goes away, a guard on its memory."""
import hashlib
import os
import re
import resource
import shutil
import signal
import socket
import subprocess
import tempfile
import threading
import time

HERE = os.path.dirname(os.path.abspath(__file__))
SOURCE = os.path.realpath(os.path.join(HERE, "..", ".."))
MIB = 1 << 20
TOKENS = {name: hashlib.sha256(f"attackers:{name}".encode()).hexdigest() for name in ("victim", "attacker", "hurried")}
DRAIN_S = 5
# Bounds of the memory that the configuration below gives to kinds of data; what a daemon needs before the first call comes on top.
BOUNDS_MIB = {"store": 256, "scenes": 512, "environments": 64, "ray tracing structures": 256, "renders": 16, "running renders": 512, "replies": 128,
              "rpc": 256}

CONFIG = """listen = ["127.0.0.1:0", "unix:gobo.sock"]
{tls}[http]
listen = "127.0.0.1:0"
[log]
level = "info"
[engine]
threads = 2
memory_bytes = "768MiB"
store_bytes = "256MiB"
scene_bytes = "512MiB"
environment_bytes = "64MiB"
accel_bytes = "256MiB"
keep_renders_bytes = "16MiB"
cache_folder = "cache"
disk_bytes = "256MiB"
roots = ["scenes"]
[limits]
client_idle_s = 5
request_bytes = "16MiB"
reply_bytes = "128MiB"
connections_per_peer = 256
rpc_memory_bytes = "256MiB"
upload_bytes = "64MiB"
uploads_at_once = 4
tmp_folder = "tmp"
[ingest]
memory_bytes = "512MiB"
blob_bytes = "256MiB"
texture_bytes = "256MiB"
input_bytes = "256MiB"
cache_bytes = "512MiB"
cpu_s = 60
wall_s = 60
[scheduler]
pinned_bytes = "512MiB"
drain_s = {drain}
[jobs]
folder = "jobs"
keep_bytes = "256MiB"
"""


def gobod() -> str:
    return os.environ.get("GOBOD") or os.path.join(SOURCE, os.environ.get("BUILD", "build"), "server", "gobod")


class Daemon:
    """`address`, `http`, `pid`; `peak` after samples. The kernel's choice when memory is short, killed beyond `guard_mib` by this process."""

    def __init__(self, tls: bool = False, guard_mib: int = 5120, files: int = 1024, extra: str = "", prepare=None) -> None:
        self.folder = tempfile.mkdtemp(prefix="gobo-attackers-")
        for sub in ("scenes", "cache", "tmp", "jobs"):
            os.mkdir(os.path.join(self.folder, sub))
        if prepare:
            prepare(os.path.join(self.folder, "scenes"))
        self.tls = tls
        keys = ""
        if tls:
            certs = os.path.join(self.folder, "certs")
            subprocess.run([os.path.join(SOURCE, "deploy", "front", "make_certs"), certs, "--host", "localhost", "--client", "client"], check=True)
            self.ca = os.path.join(certs, "ca.pem")
            keys = '[tls]\ncert = "certs/server.pem"\nkey = "certs/server.key"\n'
        text = CONFIG.format(tls=keys, drain=DRAIN_S) + extra
        for name, token in TOKENS.items():
            text += f'[[tokens]]\nname = "{name}"\nsha256 = "{hashlib.sha256(token.encode()).hexdigest()}"\n' + ("max_s = 1\n" if name == "hurried" else "")
        config = os.path.join(self.folder, "gobod.toml")
        with open(config, "w", encoding="utf-8") as file:
            file.write(text)
        self.guard = guard_mib * MIB
        self.killed_at = 0
        self.peak = {"rss": 0, "fds": 0, "threads": 0}
        self.log = os.path.join(self.folder, "log")

        def limits() -> None:
            resource.setrlimit(resource.RLIMIT_NOFILE, (files, files))
            with open("/proc/self/oom_score_adj", "w", encoding="ascii") as file:
                file.write("1000")

        with open(self.log, "wb") as log:
            self.process = subprocess.Popen([gobod(), "--config", config], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=log,
                                            preexec_fn=limits, start_new_session=True)
        line = self.process.stdout.readline().decode()
        found = re.search(r"127\.0\.0\.1:(\d+).*http://127\.0\.0\.1:(\d+)", line)
        if not found:
            self.process.kill()
            with open(self.log, encoding="utf-8", errors="replace") as log:
                said = log.read()[-1500:]
            shutil.rmtree(self.folder, ignore_errors=True)
            raise RuntimeError(f"{gobod()} did not start: {line}{said}")
        self.port, self.http = int(found[1]), int(found[2])
        self.address = f"{'localhost' if tls else '127.0.0.1'}:{self.port}"
        self.pid = self.process.pid
        self.over = threading.Event()
        self.ready = [0, 0]     # answered within a second, asked
        self.worst_ready = 0.0
        self.threads = [threading.Thread(target=f, daemon=True) for f in (self._watch, self._ask)]
        for thread in self.threads:
            thread.start()

    def _status(self, *keys):
        with open(f"/proc/{self.pid}/status", encoding="ascii") as file:
            text = file.read()
        return [int(m[1]) if (m := re.search(rf"^{k}:\s+(\d+)", text, re.M)) else 0 for k in keys]

    def rss(self) -> int:
        try:
            return self._status("VmRSS")[0] * 1024
        except OSError:
            return 0

    def _watch(self) -> None:
        while not self.over.wait(0.05):
            try:
                rss, most, threads = self._status("VmRSS", "VmHWM", "Threads")
                fds = len(os.listdir(f"/proc/{self.pid}/fd"))
            except OSError:
                return
            for key, value in (("rss", max(rss, most) * 1024), ("fds", fds), ("threads", threads)):
                self.peak[key] = max(self.peak[key], value)
            if rss * 1024 > self.guard:
                self.killed_at = rss * 1024
                self.process.kill()
                return

    def ask(self, path: str = "/ready", timeout: float = 1.0) -> bytes:
        """The whole answer over a connection of its own; raises OSError when it is not there in time."""
        end = time.monotonic() + timeout
        with socket.create_connection(("127.0.0.1", self.http), timeout) as s:
            s.sendall(f"GET {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n".encode())
            answer = b""
            while True:
                s.settimeout(max(0.001, end - time.monotonic()))
                piece = s.recv(65536)
                if not piece:
                    return answer
                answer += piece

    def _ask(self) -> None:
        while not self.over.wait(1.0) and self.process.poll() is None:
            begun = time.monotonic()
            try:
                answered = self.ask().startswith(b"HTTP/1.1 200")
            except OSError:
                answered = False
            self.ready[0] += answered
            self.ready[1] += 1
            self.worst_ready = max(self.worst_ready, time.monotonic() - begun)

    def forget(self) -> None:
        """From here on the figures are of the attack."""
        self.ready[:] = [0, 0]
        self.worst_ready = 0.0

    def terminate(self, patience: float = 30.0) -> float:
        """SIGTERM; seconds until the process was gone, `patience` when it had to be killed."""
        self.over.set()
        begun = time.monotonic()
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
        try:
            self.process.wait(patience)
            return time.monotonic() - begun
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            return patience

    def close(self) -> None:
        self.over.set()
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        for thread in self.threads:
            thread.join(2)
        self.process.stdout.close()
        shutil.rmtree(self.folder, ignore_errors=True)
