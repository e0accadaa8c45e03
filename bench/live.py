#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""How soon pictures come while one drags (docs/live.md): bench/live.py BUILD [--door http|grpc] [--seconds S] [--sessions N,N] [--rmse N] [--batch N] [SCENE...].

For each scene and size, on a daemon of its own with an empty store but the scene loaded and its ray tracing structure built (by a depth picture):
the time from sending a request until the whole bytes of the first snapshot, of the first whole-size one, and of the first of 16 samples are here. Then a
drag: the camera moves sixty times a second for S seconds in each of N sessions at once; an edit that is shown has waited from when it was made
until the bytes of its first picture were here. "free": how soon no render runs after a connection was closed, 95 % of twenty. What memory grows by is the
store, which may fill (engine.store_bytes). --rmse N: the error of the first whole-size picture, which has one sample a pixel, against N samples at 640x480: RMSE of linear light over its mean. --batch N: a BATCH render of N samples at 640x480, alone and while one
viewer edits the camera ten times a second, each edit a picture of one sample; by how much longer it takes. Reports; decides nothing."""
import argparse
import array
import http.client
import json
import math
import os
import random
import re
import struct
import subprocess
import sys
import tempfile
import threading
import time

HEADERS = {"Content-Type": "application/json"}
HALT = {"spp": 64}


class Daemon:
    def __init__(self, build, roots, config=""):
        self.folder = tempfile.TemporaryDirectory(prefix="gobo-live-")
        with open(f"{self.folder.name}/gobod.toml", "w", encoding="utf-8") as file:
            file.write(config.replace("FOLDER", self.folder.name))
        command = [f"{build}/server/gobod", "--config", f"{self.folder.name}/gobod.toml", "--listen", f"unix:{self.folder.name}/s", "--web", "127.0.0.1:0", "--log", "error"]
        for root in roots:
            command += ["--root", root]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE)
        self.port = int(re.search(rb"http://127\.0\.0\.1:(\d+)", self.process.stdout.readline())[1])

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.kill()
        self.process.wait()
        self.process.stdout.close()
        self.folder.cleanup()

    def post(self, path, body):
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=120)
        connection.request("POST", path, json.dumps(body), HEADERS)
        answer = connection.getresponse()
        if answer.status != 200:
            sys.exit(f"{path}: {answer.read().decode()}")
        return connection, answer

    def json(self, path, body=None):
        if body is not None:
            return json.loads(self.post(path, body)[1].read())
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=120)
        connection.request("GET", path)
        return json.loads(connection.getresponse().read())

    def stream(self, path, body):
        """An answer of pictures; close() ends the call."""
        return HttpStream(*self.post(path, body))

    def resident_mib(self):
        return int(self.json("/v1/status")["rss_bytes"]) / 2**20


class HttpStream:
    def __init__(self, connection, answer):
        self.connection, self.answer = connection, answer

    def pictures(self):
        """(reply, bytes, whether it is the last) of each picture once its bytes are here."""
        while size := self.answer.read(4):
            head = json.loads(self.answer.read(struct.unpack("<I", size)[0]))
            data = self.answer.read(head["bytes"])
            if "error" in head:
                return
            if "reply" in head or "snapshot" in head:
                yield head.get("reply") or head["snapshot"], data, "reply" in head

    def close(self):
        self.connection.close()
        self.answer.close()


class GrpcDaemon(Daemon):
    """The same calls over the socket; what is not rendering goes over HTTP as ever."""

    def __init__(self, build, roots):
        super().__init__(build, roots)
        sys.path.insert(0, f"{build}/clients/python")
        import grpc
        from google.protobuf import json_format
        from gobo.v1 import render_pb2, service_pb2_grpc
        self.channel = grpc.insecure_channel(f"unix:{self.folder.name}/s", options=[("grpc.max_receive_message_length", -1)])
        self.render = service_pb2_grpc.RenderStub(self.channel)
        self.message = lambda body: json_format.ParseDict(body, render_pb2.RenderRequest())
        self.words = lambda reply: json_format.MessageToDict(reply, preserving_proto_field_name=True)

    def __exit__(self, *more):
        self.channel.close()
        super().__exit__(*more)

    def stream(self, path, body):
        return GrpcStream(self, self.render.RenderProgressive(self.message(body)))


class GrpcStream:
    def __init__(self, daemon, call):
        self.daemon, self.call = daemon, call

    def pictures(self):
        import grpc
        reply, left, data, last = None, 0, [], False
        try:
            for event in self.call:
                kind = event.WhichOneof("event")
                if kind in ("snapshot", "reply"):
                    reply, last, data = getattr(event, kind), kind == "reply", []
                    left = sum(image.bytes for image in reply.images)
                elif kind == "chunk":
                    data.append(event.chunk.data)
                    left -= len(event.chunk.data)
                if reply is not None and left <= 0 and kind != "progress":
                    yield self.daemon.words(reply), b"".join(data), last
                    reply = None
        except grpc.RpcError:
            return

    def close(self):
        self.call.cancel()


def request(scene, size, session, **more):
    return {"scene": scene["id"], "width": size[0], "height": size[1], "halt": HALT, "encoding": {"format": "JPEG"}, "scheduling": {"session": session}} | more


def camera(scene, turn):
    lo, hi = ([scene[k].get(a, 0) for a in "xyz"] for k in ("bounds_min", "bounds_max"))
    centre, reach = [(a + b) / 2 for a, b in zip(lo, hi)], 0.2 * math.dist(lo, hi)
    eye = [centre[0] + reach * math.cos(turn), centre[1], centre[2] + reach * math.sin(turn)]
    return {"position": dict(zip("xyz", eye)), "look_at": dict(zip("xyz", centre))}


def first_pictures(daemon, scene, size):
    daemon.json("/v1/status")  # the first one looks for devices
    begun = time.perf_counter()
    answer = daemon.stream("/v1/render/stream", request(scene, size, "first"))
    times = {}
    for reply, _, _ in answer.pictures():
        now = 1e3 * (time.perf_counter() - begun)
        times.setdefault("first", now)
        if reply["images"][0]["width"] == size[0]:
            times.setdefault("whole", now)
            if reply["resolved"]["halt"]["spp"] >= 16:
                times["16 samples"] = now
                break
    answer.close()
    return times


def freed(daemon, scene, size, count=20):
    """Milliseconds until no render runs after a connection was closed at some moment of its pictures: 95 % of `count`."""
    chance, times = random.Random(5), []
    for i in range(count):
        answer = daemon.stream("/v1/render/stream", request(scene, size, "closed", camera=camera(scene, 3 + 0.01 * i)))
        next(answer.pictures(), None)
        time.sleep(0.3 * chance.random())
        closed = time.perf_counter()
        answer.close()
        while daemon.json("/v1/status").get("running"):
            time.sleep(0.001)
        times.append(1e3 * (time.perf_counter() - closed))
    return sorted(times)[math.ceil(0.95 * count) - 1]


def drag(daemon, scene, size, name, seconds, waits):
    """One viewer: sixty edits a second; a new request once the last one's picture is here, always with the latest edit."""
    begun = time.perf_counter()
    while (now := time.perf_counter()) - begun < seconds:
        edit = int((now - begun) * 60)
        made = begun + edit / 60
        answer = daemon.stream("/v1/render/stream", request(scene, size, name, camera=camera(scene, 0.01 * edit + sum(map(ord, name)) % 7)))
        if next(answer.pictures(), None):
            waits.append(1e3 * (time.perf_counter() - made))
        answer.close()
        time.sleep(max(0, begun + (edit + 1) / 60 - time.perf_counter()))


def floats(daemon, scene, samples):
    body = {"scene": scene["id"], "width": 640, "height": 480, "halt": {"spp": samples}, "encoding": {"format": "RAW_FLOAT"}, "scheduling": {"ladder": False}}
    return array.array("f", daemon.post("/v1/render", body)[1].read())


def error_of_one_sample(daemon, scene, samples):
    few, many = floats(daemon, scene, 1), floats(daemon, scene, samples)
    return math.sqrt(sum((a - b) ** 2 for a, b in zip(few, many)) / len(many)) / (sum(many) / len(many))


def batch(daemon, scene, samples, beside, turn):
    """Seconds of a BATCH render; `beside`: while one viewer edits the camera ten times a second, a picture of one sample each."""
    over, waits = threading.Event(), []

    def viewer():
        i = 0
        while not over.is_set():
            begun, i = time.perf_counter(), i + 1
            body = {"scene": scene["id"], "width": 320, "height": 240, "halt": {"spp": 1}, "encoding": {"format": "JPEG"}, "camera": camera(scene, turn + 0.01 * i),
                    "scheduling": {"priority": "INTERACTIVE"}}
            daemon.post("/v1/render", body)[1].read()
            waits.append(1e3 * (time.perf_counter() - begun))
            over.wait(max(0.0, 0.1 - (time.perf_counter() - begun)))

    thread = threading.Thread(target=viewer)
    if beside:
        thread.start()
    begun = time.perf_counter()
    body = {"scene": scene["id"], "width": 640, "height": 480, "halt": {"spp": samples}, "encoding": {"format": "JPEG"}, "scheduling": {"priority": "BATCH"},
            "camera": camera(scene, turn)}
    daemon.post("/v1/render", body)[1].read()
    took = time.perf_counter() - begun
    over.set()
    if beside:
        thread.join()
    return took, sorted(waits)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("build")
    parser.add_argument("scenes", nargs="*", default=["cornell", "atrium"])
    parser.add_argument("--seconds", type=float, default=10)
    parser.add_argument("--sessions", default="1,4,16")
    parser.add_argument("--door", choices=["http", "grpc"], default="http")
    parser.add_argument("--rmse", type=int, metavar="N")
    parser.add_argument("--batch", type=int, metavar="N")
    options = parser.parse_args()
    print(f"{'scene':16} {'size':>9} {'first':>8} {'whole':>8} {'16 spp':>8} {'free':>8}   drag: sessions, pictures/s each, p50, p95 (ms), MiB grown")
    for source in options.scenes:
        path = os.path.abspath(source) if os.path.exists(source) else source
        for size in ((640, 480), (1280, 720)):
            with (GrpcDaemon if options.door == "grpc" else Daemon)(options.build, [os.path.dirname(path)] if path != source or os.path.isabs(source) else []) as daemon:
                scene = daemon.json("/v1/scenes", {"source": path})
                daemon.post("/v1/render", {"scene": scene["id"], "width": 16, "height": 16, "outputs": ["depth"]})[1].read()
                t = first_pictures(daemon, scene, size)
                while daemon.json("/v1/status").get("running"):
                    time.sleep(0.001)
                t["cores free"] = freed(daemon, scene, size)
                line = f"{scene['id'][:16]:16} {size[0]:4}x{size[1]:<4} " + " ".join(f"{t.get(k, float('nan')):8.0f}" for k in ("first", "whole", "16 samples", "cores free"))
                for sessions in map(int, options.sessions.split(",")):
                    before, waits = daemon.resident_mib(), [[] for _ in range(sessions)]
                    threads = [threading.Thread(target=drag, args=(daemon, scene, size, f"viewer {i}", options.seconds, waits[i])) for i in range(sessions)]
                    for t in threads:
                        t.start()
                    for t in threads:
                        t.join()
                    every = sorted(w for one in waits for w in one)
                    p = lambda q: every[min(len(every) - 1, int(q * len(every)))]
                    line += f"   {sessions}: {min(map(len, waits)) / options.seconds:.1f} {p(0.5):.0f} {p(0.95):.0f} {daemon.resident_mib() - before:+.0f}"
                if options.rmse and size[0] == 640:
                    line += f"   RMSE of one sample {error_of_one_sample(daemon, scene, options.rmse):.3f} of the mean"
                if options.batch and size[0] == 640:
                    alone, (beside, waits) = batch(daemon, scene, options.batch, False, 1)[0], batch(daemon, scene, options.batch, True, 2)
                    line += f"   batch {alone:.1f} s, beside a viewer {beside:.1f} s ({100 * (beside / alone - 1):+.0f} %), who waits {waits[len(waits) // 2]:.0f} ms"
                print(line, flush=True)


if __name__ == "__main__":
    main()
