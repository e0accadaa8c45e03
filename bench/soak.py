#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""What callers that behave badly over HTTP leave behind (docs/live.md): bench/soak.py BUILD [--quick].

On one daemon: readers that take a kilobyte a second, readers that never read, a thousand connections closed at any moment of a request or its answer, pages of
another origin, a file of 2 GB put by its digest, a thousand files that break off. Beside each a viewer asks for a small picture ten times a second.
A line each: what callers were told, the viewer's wait (median, 95 %, worst), and the daemon's memory (beside the term store, which may fill), descriptors, threads and running renders once they
are gone, the second time that they came (the first fills pools that stay). Exit code 1 where something was left behind: a descriptor, a thread, a running render, more than 64 MiB. Reports times; decides nothing by them."""
import argparse
import collections
import hashlib
import json
import os
import random
import socket
import sys
import threading
import time

import live

CROWD = 40  # of the 48 connections that one address may have
STREAM = {"width": 640, "height": 480, "halt": {"spp": 4096}, "encoding": {"format": "RAW_FLOAT"}}


def head(path, size, more=""):
    return f"POST {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json\r\nContent-Length: {size}\r\n{more}\r\n".encode()


def request(path, body, more=""):
    text = json.dumps(body).encode()
    return head(path, len(text), more) + text


class Caller:
    """A socket to the daemon; `told` counts the first lines of its answers."""

    def __init__(self, daemon, told, buffer=None):
        self.told = told
        self.socket = socket.socket()
        if buffer:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer)
        self.socket.settimeout(60)
        self.socket.connect(("127.0.0.1", daemon.port))

    def send(self, data):
        try:
            self.socket.sendall(data)
        except OSError:
            self.told["closed while it sent"] += 1

    def answer(self):
        try:
            line = self.socket.recv(4096).split(b"\r\n")[0].decode(errors="replace")
        except OSError:
            line = ""
        self.told[line or "closed"] += 1

    def close(self):
        self.socket.close()


class Viewer(threading.Thread):
    def __init__(self, daemon, scene):
        super().__init__()
        self.daemon_, self.scene, self.over, self.waits, self.failed = daemon, scene, threading.Event(), [], 0

    def run(self):
        turn = 0.0
        while not self.over.is_set():
            begun, turn = time.perf_counter(), turn + 0.01
            body = {"scene": self.scene["id"], "width": 160, "height": 120, "halt": {"spp": 1}, "encoding": {"format": "JPEG"}, "camera": live.camera(self.scene, turn),
                    "scheduling": {"priority": "INTERACTIVE"}}
            try:
                connection, answer = self.daemon_.post("/v1/render", body)
                answer.read()
                connection.close()
                self.waits.append(1e3 * (time.perf_counter() - begun))
            except (OSError, SystemExit):
                self.failed += 1
            self.over.wait(max(0.0, 0.1 - (time.perf_counter() - begun)))


def slow_readers(daemon, scene, told, quick):
    callers = [Caller(daemon, told, 4096) for _ in range(CROWD)]
    for c in callers:
        c.send(request("/v1/render/stream", {"scene": scene["id"], **STREAM}))
    end = time.monotonic() + (3 if quick else 30)
    while time.monotonic() < end:
        for c in callers:
            try:
                c.socket.recv(1024)
            except OSError:
                told["closed"] += 1
        time.sleep(1)
    for c in callers:
        c.close()


def readers_that_never_read(daemon, scene, told, quick):
    callers = [Caller(daemon, told, 4096) for _ in range(CROWD)]
    for c in callers:
        c.send(request("/v1/render/stream", {"scene": scene["id"], **STREAM}))
    time.sleep(3 if quick else 30)
    for c in callers:
        c.close()


def closed_connections(daemon, scene, told, quick):
    chance = random.Random(7)
    text = request("/v1/render/stream", {"scene": scene["id"], **STREAM})
    for i in range(100 if quick else 1000):
        c = Caller(daemon, told)
        if i % 4 == 0:
            c.send(text[:chance.randrange(len(text))])                 # in the middle of the request
        elif i % 4 == 1:
            c.send(text)                                               # before the answer
        else:
            c.send(text)
            c.answer()                                                 # while pictures come
            if i % 4 == 3:
                time.sleep(chance.random() * 0.05)
        c.close()


def other_origins(daemon, scene, told, quick):
    for i in range(50 if quick else 500):
        c = Caller(daemon, told)
        more = ("Origin: http://evil.example\r\n", "Origin: null\r\n")[i % 2]
        c.send(request("/v1/render", {"scene": scene["id"], "width": 16, "height": 16}, more))
        c.answer()
        c.close()


def a_large_file(daemon, scene, told, quick):
    size, piece = (200_000_000 if quick else 2_000_000_000), bytes(1 << 20)
    sha, left = hashlib.sha256(), size
    while left:
        n = min(left, len(piece))
        sha.update(piece[:n])
        left -= n
    for bytes_, said in ((size, "whole"), (1 << 40, "a terabyte")):
        c = Caller(daemon, told)
        c.send(f"POST /v1/blobs/{sha.hexdigest()}?bytes={bytes_} HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/octet-stream\r\nContent-Length: {bytes_}\r\n\r\n".encode())
        left = bytes_ if said == "whole" else len(piece)
        while left:
            n = min(left, len(piece))
            try:
                c.socket.sendall(piece[:n])
            except OSError:
                break
            left -= n
        c.answer()
        c.close()


def files_that_break_off(daemon, scene, told, quick):
    chance = random.Random(11)
    for i in range(100 if quick else 1000):
        data = chance.randbytes(chance.randrange(2, 20000))
        c = Caller(daemon, told)
        c.send(f"POST /v1/blobs/{hashlib.sha256(data).hexdigest()}?bytes={len(data)} HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/octet-stream\r\n"
               f"Content-Length: {len(data)}\r\n\r\n".encode() + data[:chance.randrange(len(data))])
        if i % 2:
            c.socket.shutdown(socket.SHUT_WR)
            c.answer()
        c.close()


def held(daemon):
    pid, status = daemon.process.pid, daemon.json("/v1/status")
    return {"MiB": (int(status["rss_bytes"]) - int(status.get("store_bytes", 0))) / 2**20, "descriptors": len(os.listdir(f"/proc/{pid}/fd")),
            "threads": len(os.listdir(f"/proc/{pid}/task")), "running": status.get("running", 0)}


def settled(daemon, before):
    """What is held once the daemon had a while to let go."""
    end = time.monotonic() + (20 if before else 3)
    while time.monotonic() < end:
        now = held(daemon)
        if before and all(now[k] <= before[k] + (64 if k == "MiB" else 0) for k in now):
            break
        time.sleep(0.5)
    return now


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("build")
    parser.add_argument("--quick", action="store_true", help="a tenth of each")
    parser.add_argument("--only", help="one of them, by its name")
    options = parser.parse_args()
    left = 0
    with live.Daemon(options.build, [], '[limits]\nupload_bytes = "4GiB"\n[blobs]\nfolder = "FOLDER/blobs"\nbytes = "8GiB"\n') as daemon:
        scene = daemon.json("/v1/scenes", {"source": "cornell"})

        def siege(attack):
            viewer, told = Viewer(daemon, scene), collections.Counter()
            viewer.start()
            attack(daemon, scene, told, options.quick)
            viewer.over.set()
            viewer.join()
            return sorted(viewer.waits), viewer.failed, told

        def nothing(*_):
            time.sleep(3 if options.quick else 10)

        print("callers | told | viewer: ms (median, 95 %, worst), refused | MiB, descriptors, threads, running: before, after")
        for attack in (nothing, slow_readers, readers_that_never_read, closed_connections, other_origins, a_large_file, files_that_break_off):
            if options.only and options.only != attack.__name__.replace("_", " "):
                continue
            siege(attack)
            before = settled(daemon, {})
            waits, failed, told = siege(attack)
            after = settled(daemon, before)
            grown = [k for k in after if after[k] > before[k] + (64 if k == "MiB" else 0)]
            left += bool(grown)
            p = lambda q: waits[min(len(waits) - 1, int(q * len(waits)))] if waits else float("nan")
            print(f"{attack.__name__.replace('_', ' ')} | " + ", ".join(f"{n} x {line}" for line, n in told.most_common(4)) +
                  f" | {p(0.5):.0f}, {p(0.95):.0f}, {p(1):.0f}, {failed} | " + "; ".join(f"{before[k]:.0f}, {after[k]:.0f}" for k in after) +
                  (f" LEFT: {', '.join(grown)}" if grown else ""), flush=True)
    sys.exit(left > 0)


if __name__ == "__main__":
    main()
