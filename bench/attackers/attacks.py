# SPDX-License-Identifier: Apache-2.0
"""One attacker, in a process of its own: attacks.py NAME '{"address": ..., ...}'. Writes "on" when the attack stands and one JSON line of what it did
when its standard input closes; until then it goes on."""
import itertools
import json
import os
import socket
import sys
import threading
import time
from collections import Counter

import grpc

import http2
import scenes
from gobo.v1 import jobs_pb2, render_pb2, service_pb2
from wire import Caller, request, unknown

ATTACKS = {}


def attack(letter: str, words: str, **more):
    def register(function):
        ATTACKS[letter] = dict(name=function.__name__, words=words, run=function, **more)
        return function
    return register


class Field:
    """Where the daemon is; `over` is set when it is time to leave; `done` counts answers by their code."""

    def __init__(self, where: dict) -> None:
        self.__dict__.update(where)
        self.over = threading.Event()
        self.done = Counter()
        self.lock = threading.Lock()

    def caller(self) -> Caller:
        return Caller(self.address, self.token, self.ca)

    def on(self) -> None:
        print("on", flush=True)

    def count(self, call) -> None:
        """Runs a call and counts its code."""
        try:
            call()
            code = "OK"
        except grpc.RpcError as e:
            code = e.code().name
            self.said = self.said or e.details()
        except ValueError:
            code = "CUT_SHORT"
        with self.lock:
            self.done[code] += 1
        if code in ("RESOURCE_EXHAUSTED", "UNAVAILABLE"):
            self.over.wait(0.02)   # refused at once: not a contest of who refuses faster

    def crowd(self, count: int, work) -> None:
        """`work(k)` again and again in `count` threads."""
        def loop(k):
            while not self.over.is_set():
                self.count(lambda: work(k))
        for k in range(count):
            threading.Thread(target=loop, args=(k,), daemon=True).start()
        self.on()
        self.over.wait()


@attack("a", "renders of 100 000 lights, max_s = 1", token="hurried", prepare=lambda folder: _write(folder, "lights.glb", scenes.lights()))
def lights(field):
    caller = field.caller()
    try:
        info = caller.scenes.Open(service_pb2.OpenSceneRequest(source=os.path.join(field.scenes, "lights.glb")), timeout=120, metadata=caller.metadata)
    except grpc.RpcError as e:
        field.done[f"open: {e.code().name}"] += 1
        field.said = e.details()
        field.on()
        field.over.wait()
        return
    seeds = itertools.count()
    field.crowd(4, lambda k: caller.picture(request(info.id, seed=next(seeds)), 30))


@attack("b", "two opens of sparse files of 300 GB at a time", prepare=scenes.sparse)
def sparse(field):
    callers = [field.caller() for _ in range(2)]
    names = ("sparse.glb", "sparse.gltf")
    field.crowd(2, lambda k: callers[k].scenes.Open(service_pb2.OpenSceneRequest(source=os.path.join(field.scenes, names[k])), timeout=60,
                                                    metadata=callers[k].metadata))


@attack("c", "uploads that fall silent, in every slot")
def silent_uploads(field):
    caller = field.caller()

    def upload(_):
        def pieces():
            yield service_pb2.UploadSceneRequest(extension=".glb", total_bytes=1 << 20, data=b"glTF")
            field.over.wait()
        caller.scenes.Upload(pieces(), metadata=caller.metadata)
    field.crowd(16, upload)


@attack("d", "420 idle watches")
def watches(field):
    callers = [field.caller() for _ in range(7)]
    spec = jobs_pb2.JobSpec(request=request(spp=4096), key="idle")
    job = callers[0].jobs.Submit(spec, timeout=20, metadata=callers[0].metadata)
    callers[0].jobs.Pause(jobs_pb2.PauseJobRequest(id=job.id), timeout=20, metadata=callers[0].metadata)

    def watch(k):
        for _ in callers[k % 7].jobs.Watch(jobs_pb2.WatchJobRequest(id=job.id), metadata=callers[k % 7].metadata):
            pass
    field.crowd(420, watch)


@attack("e", "64 calls in flight, each of a new scheduling.client")
def new_clients(field):
    callers = [field.caller() for _ in range(2)]
    serial = itertools.count()

    def render(k):
        n = next(serial)
        callers[k % 2].picture(request(spp=64, seed=n, client=f"someone{n}"), 60)
    field.crowd(64, render)


@attack("f", "jobs of 100 frames, submitted first", own_job=True)
def many_frames(field):
    caller = field.caller()
    for n in range(10):
        spec = jobs_pb2.JobSpec(request=request(width=320, height=240, spp=64, seed=n), key=f"frames{n}", priority=jobs_pb2.JobSpec.HIGH)
        spec.request.ClearField("scheduling")
        spec.frames.first, spec.frames.last, spec.frames.fps = 1, 100, 24
        field.count(lambda: caller.jobs.Submit(spec, timeout=20, metadata=caller.metadata))
    time.sleep(1)
    field.on()
    field.over.wait()


@attack("g", "requests with 20 and with 15 MB of unknown fields", memory=True)
def unknown_fields(field):
    caller = field.caller()
    call = caller.raw("Render/Render", stream=True)
    seeds = itertools.count()
    waste = [unknown(mb * 1000 * 1000) for mb in (20, 15)]   # beyond and within what one message may have

    def render(k):
        body = request(seed=next(seeds), priority=render_pb2.Scheduling.NORMAL).SerializeToString() + waste[k % 2]
        for _ in call(body, timeout=60, metadata=caller.metadata):
            pass
    field.crowd(6, render)


@attack("h", "job specs of 20 and of 15 MB, and lists of them", memory=True)
def large_specs(field):
    caller = field.caller()
    submit, lists = caller.raw("Jobs/Submit"), caller.raw("Jobs/List")
    waste = [unknown(mb * 1000 * 1000) for mb in (20, 15)]
    everything = jobs_pb2.ListJobsRequest(page_size=1000).SerializeToString()
    serial = itertools.count()

    def work(k):
        if k >= 2:
            lists(everything, timeout=60, metadata=caller.metadata)
            return
        n = next(serial)
        spec = jobs_pb2.JobSpec(request=request(spp=4096, seed=n), key=f"large{n}")
        spec.request.ClearField("scheduling")
        submit(spec.SerializeToString() + waste[n % 2], timeout=60, metadata=caller.metadata)
        with field.lock:
            field.done["submitted"] += 1
    field.crowd(5, work)


@attack("i", "streams of 1 Mpx that nobody reads", memory=True)
def unread(field):
    callers = [field.caller() for _ in range(6)]
    calls = []
    field.on()
    for n in itertools.count():
        if field.over.is_set():
            break
        calls = [c for c in calls if c.is_active()]
        if len(calls) < 300:
            caller = callers[n % 6]
            calls.append(caller.render.Render(request(width=1024, height=1024, spp=1, priority=render_pb2.Scheduling.NORMAL), metadata=caller.metadata))
            field.done["opened"] += 1
        field.over.wait(0.02)


@attack("j", "1100 idle connections from five addresses", plain=True)
def idle_connections(field):
    host, port = field.address.rsplit(":", 1)
    held = []
    told = False
    while not field.over.is_set():
        alive = []
        for s in held:
            try:
                if s.recv(4096):
                    alive.append(s)
                else:
                    s.close()
            except BlockingIOError:
                alive.append(s)
            except OSError:
                s.close()
        field.done["closed by the server"] += len(held) - len(alive)
        held = alive
        until = time.monotonic() + 0.5
        while len(held) < 1100 and not field.over.is_set() and time.monotonic() < until:
            try:
                held.append(socket.create_connection((host, int(port)), 0.2, (f"127.0.0.{2 + len(held) % 5}", 0)))
                if len(held) % 2:
                    held[-1].sendall(http2.PREFACE + http2.frame(http2.SETTINGS, 0, 0))
                held[-1].setblocking(False)
                field.done["connected"] += 1
            except OSError:
                field.done["not connected"] += 1
                break
        if not told and (len(held) >= 1000 or field.done["not connected"]):
            field.on()
            told = True
        field.over.wait(0.1)
    field.done["held"] = len(held)


@attack("k", "HTTP clients that send a byte a second", plain=True)
def slow_http(field):
    held = []
    field.on()
    while not field.over.is_set():
        while len(held) < 64:
            try:
                s = socket.create_connection(("127.0.0.1", field.http), 0.5)
            except OSError:
                field.done["not connected"] += 1
                break
            s.setblocking(False)
            field.done["connected"] += 1
            path = ("/ready", "/metrics")[len(held) % 2]
            held.append((s, iter(f"GET {path} HTTP/1.1\r\nHost: localhost\r\nX-Slow: " + "z" * 10000)))
        alive = []
        for s, text in held:
            try:
                s.sendall(next(text).encode())
                if s.recv(4096) == b"":
                    raise OSError
                alive.append((s, text))
            except BlockingIOError:
                alive.append((s, text))
            except OSError:
                s.close()
                field.done["closed by the server"] += 1
        held = alive
        field.over.wait(1.0)


@attack("l", "uploads of 36 MiB and patches in a loop", memory=True)
def uploads(field):
    callers = [field.caller() for _ in range(2)]
    serial = itertools.count()

    def upload(k):
        n = next(serial)
        info = callers[k].upload(scenes.large(n % 84), 120, name=f"large{n % 84}")
        with field.lock:
            field.done["uploaded"] += 1
        for turn in range(4):
            patch = service_pb2.PatchSceneRequest(scene=info.id)
            patch.instances[info.instance_names[0] if info.instance_names else "0"].matrix.extend(
                [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, turn * 0.01, 0, 0, 1])
            callers[k].scenes.Patch(patch, timeout=60, metadata=callers[k].metadata)
    field.crowd(2, upload)


@attack("m", "rapid reset over TLS", tls=True)
def rapid_reset(field):
    port = int(field.address.rsplit(":", 1)[1])
    resets = [http2.RapidReset("localhost", port, "/gobo.v1.Admin/GetStatus", field.token, field.ca) for _ in range(2)]
    field.on()
    threads = [threading.Thread(target=_until_over, args=(field, r), daemon=True) for r in resets]
    for t in threads:
        t.start()
    field.over.wait()
    field.done.update(streams=sum(r.sent for r in resets), connections=sum(r.connections for r in resets), refused=sum(r.refused for r in resets))


def _until_over(field, reset) -> None:
    while not field.over.is_set():
        reset.run(0.5)


def _write(folder: str, name: str, data: bytes) -> None:
    with open(os.path.join(folder, name), "wb") as file:
        file.write(data)


def main() -> None:
    field = Field({"said": "", **json.loads(sys.argv[2])})

    def wait() -> None:
        sys.stdin.read()
        field.over.set()
        time.sleep(1.0)
        print(json.dumps({"done": dict(field.done), "said": field.said[:200]}), flush=True)
        os._exit(0)   # calls that hang are the point

    threading.Thread(target=wait, daemon=True).start()
    ATTACKS[sys.argv[1]]["run"](field)
    threading.Event().wait()


if __name__ == "__main__":
    main()
