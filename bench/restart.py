#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Why interactive renders are not in a process of their own: what a crash costs while they are in the daemon, and what a second process would cost every picture.

    bench/restart.py [--build build] [--scene SCENE] [--runs 9]

A crash: a daemon with a cache folder is killed with -9 while it renders and started again at once, as its unit does (Restart=on-failure); from the kill until a client that repeats its request
has the picture that it had before (the disk cache keeps what was dear to make, which a path-traced picture of few samples is not); and until it has one of another seed. A second process: what the picture takes over the daemon's socket as it is, and
the bytes of a picture through one more Unix socket pair (a front that passes on what a renderer sends), the least that any split would add without shared memory. Medians; times are reported, nothing is decided by them.
"""
import argparse
import os
import pathlib
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time


def start(gobod, folder):
    return subprocess.Popen([gobod, "--listen", f"unix:{folder}/socket", "--cache", f"{folder}/cache"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def until(ask):
    """Milliseconds until `ask` succeeds, repeated as a client does."""
    begun = time.monotonic()
    while True:
        try:
            ask()
            return 1e3 * (time.monotonic() - begun)
        except Exception as e:  # noqa: BLE001: whatever the daemon's absence looks like
            if time.monotonic() - begun > 60:
                raise e
            time.sleep(0.005)


def hop(size):
    """Milliseconds that `size` bytes take through one more pair of sockets and the process behind it."""
    outer, front = socket.socketpair()
    back, renderer = socket.socketpair()
    child = os.fork()
    if child == 0:
        buffer = memoryview(bytearray(1 << 20))
        outer.close(), renderer.close()
        while n := back.recv_into(buffer):
            front.sendall(buffer[:n])
        os._exit(0)
    front.close(), back.close()
    data, got, times = bytes(size), memoryview(bytearray(size)), []
    for _ in range(20):
        begun = time.monotonic()
        sender = threading.Thread(target=renderer.sendall, args=(data,))
        sender.start()
        at = 0
        while at < size:
            at += outer.recv_into(got[at:])
        sender.join()
        times.append(1e3 * (time.monotonic() - begun))
    outer.close(), renderer.close()
    os.waitpid(child, 0)
    return statistics.median(times)


parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--build", default=os.environ.get("BUILD", "build"))
parser.add_argument("--scene", default="atrium")
parser.add_argument("--runs", type=int, default=9)
options = parser.parse_args()
build = pathlib.Path(options.build).resolve()
sys.path.insert(0, str(build / "clients/python"))
import gobo  # noqa: E402

picture = dict(size=(640, 480), spp=4, format="RAW_FLOAT")
with tempfile.TemporaryDirectory(prefix="gobo-restart-") as folder:
    daemon = start(str(build / "server/gobod"), folder)
    address = f"unix:{folder}/socket"

    def ask(**more):
        with gobo.connect(address) as client:
            return client.render(options.scene, **picture, **more).image

    until(ask)
    ready, same, other, warm = [], [], [], []
    for run in range(options.runs):
        with gobo.connect(address) as client:
            client.render(options.scene, **picture)
            begun = time.monotonic()
            client.render(options.scene, **picture)
            warm.append(1e3 * (time.monotonic() - begun))
        victim = threading.Thread(target=lambda: subprocess.run([build / "clients/gobo", "--server", address, "render", options.scene, "--spp", "4096", "-o", f"{folder}/x.exr"],
                                                                check=False, capture_output=True))
        victim.start()
        time.sleep(0.3)
        daemon.send_signal(signal.SIGKILL)
        begun = time.monotonic()
        daemon.wait()
        daemon = start(str(build / "server/gobod"), folder)
        until(lambda: gobo.connect(address).status())
        ready.append(1e3 * (time.monotonic() - begun))
        until(ask)
        same.append(1e3 * (time.monotonic() - begun))
        until(lambda: ask(seed=run + 1))
        other.append(1e3 * (time.monotonic() - begun))
        victim.join()
    daemon.terminate()
    daemon.wait()
m = statistics.median
print(f"{options.scene}, 640 x 480, 4 spp; from kill -9 of the daemon: answers after {m(ready):.0f} ms, the picture of before after {m(same):.0f} ms, one of another seed after {m(other):.0f} ms")
for width, height in ((640, 480), (1920, 1080)):
    size = width * height * 12
    print(f"{width} x {height}, raw float: {hop(size):.1f} ms through one more process" + (f"; {m(warm):.1f} ms over the socket as it is, all of it" if width == 640 else ""))
