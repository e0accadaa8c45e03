# SPDX-License-Identifier: Apache-2.0
"""What the tests of the clients share: one private gobod a test program, the CLI, a server of lies, a small glTF file."""
import json
import os
import shutil
import struct
import subprocess
import tempfile
import time
import unittest
from concurrent import futures

import grpc

import gobo
from gobo.v1 import jobs_pb2_grpc, render_pb2, service_pb2, service_pb2_grpc

CLI = os.environ["GOBO_CLI"]
SOURCE = os.path.realpath(os.path.join(os.path.dirname(__file__), "..", ".."))
SMALL = dict(width=32, height=24, spp=16, integrator={"max_bounces": 2})


class DaemonTest(unittest.TestCase):
    """Has `client`, `folder` (temporary) and `cli`."""

    options: dict = {}

    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.mkdtemp(prefix="gobo-test-")
        cls.addClassCleanup(shutil.rmtree, cls.folder, ignore_errors=True)
        cls.client = gobo.local(**{"threads": 2, "timeout": 120, **cls.options})
        cls.addClassCleanup(cls.client.close)

    def path(self, *names):
        return os.path.join(self.folder, *names)

    def cli(self, *args, code=0, timeout=120, **more):
        env = {k: v for k, v in os.environ.items() if k not in ("GOBO_TOKEN",)}
        env["GOBO_SERVER"] = self.client.address
        done = subprocess.run([CLI, *map(str, args)], capture_output=True, text=True, timeout=timeout, env=env, cwd=self.folder, **more)
        self.assertEqual(done.returncode, code, f"gobo {' '.join(map(str, args))}\n{done.stdout}{done.stderr}")
        return done


class JobsTest(DaemonTest):
    """Its daemon has jobs."""

    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory(prefix="gobo-test-jobs-", ignore_cleanup_errors=True)
        cls.addClassCleanup(folder.cleanup)
        cls.options = {**cls.options, "jobs": folder.name}
        super().setUpClass()


def eventually(condition, seconds=20):
    """What the condition gives once it is true, or at the end."""
    end = time.monotonic() + seconds
    while not (found := condition()) and time.monotonic() < end:
        time.sleep(0.05)
    return found


def gltf(folder, name="tri.gltf", embed=False):
    """A lit triangle with its buffer in a side file (or in the .gltf); returns the path."""
    data = struct.pack("<9f", -1, -1, 0, 1, -1, 0, 0, 1, 0) + struct.pack("<3H", 0, 1, 2)
    document = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1, 2]}],
        "extensionsUsed": ["KHR_lights_punctual"],
        "extensions": {"KHR_lights_punctual": {"lights": [{"type": "point", "name": "lamp", "intensity": 30}]}},
        "nodes": [{"mesh": 0, "name": "tri"}, {"camera": 0, "name": "eye", "translation": [0, 0, 3]},
                  {"translation": [1, 1, 2], "name": "lamp", "extensions": {"KHR_lights_punctual": {"light": 0}}}],
        "cameras": [{"type": "perspective", "name": "eye", "perspective": {"yfov": 0.8, "znear": 0.1, "aspectRatio": 1.0}}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [-1, -1, 0], "max": [1, 1, 0]},
                      {"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"}],
        "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 6}],
        "buffers": [{"byteLength": len(data), "uri": "tri data.bin".replace(" ", "%20")}],
    }
    with open(os.path.join(folder, "tri data.bin"), "wb") as file:
        file.write(data)
    path = os.path.join(folder, name)
    with open(path, "w", encoding="utf-8") as file:
        json.dump(document, file)
    return path


class Liar:
    """A gRPC server whose Render, Scenes, Admin and Jobs services are whatever a test sets; remembers metadata of every call."""

    def __init__(self, credentials=None, **handlers):
        self.handlers = handlers
        self.metadata = []
        self.server = grpc.server(futures.ThreadPoolExecutor(8), options=[("grpc.so_reuseport", 0)])   # a port of its own
        for base, add in ((service_pb2_grpc.RenderServicer, service_pb2_grpc.add_RenderServicer_to_server),
                          (service_pb2_grpc.ScenesServicer, service_pb2_grpc.add_ScenesServicer_to_server),
                          (service_pb2_grpc.AdminServicer, service_pb2_grpc.add_AdminServicer_to_server),
                          (jobs_pb2_grpc.JobsServicer, jobs_pb2_grpc.add_JobsServicer_to_server)):
            servicer = base()
            for name in [n for n in dir(base) if n[0].isupper()]:
                setattr(servicer, name, self._method(name))
            add(servicer, self.server)
        address = "localhost:0"
        port = self.server.add_secure_port(address, credentials) if credentials else self.server.add_insecure_port("127.0.0.1:0")
        self.address = f"{'localhost' if credentials else '127.0.0.1'}:{port}"
        self.server.start()

    def _method(self, name):
        def call(request, context):
            self.metadata.append(dict(context.invocation_metadata()))
            handler = self.handlers.get(name)
            if handler is None and name == "GetStatus":
                return service_pb2.StatusReply(build="liar")
            if handler is None:
                context.abort(grpc.StatusCode.UNIMPLEMENTED, "")
            return handler(request, context)
        return call

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.server.stop(None).wait()


def events(width=2, height=1, values=(1.0, 2.0, 3.0, 4.0, 5.0, 6.0), **change):
    """An honest stream of one raw picture; `change` spoils a field of the descriptor."""
    import struct as s
    data = s.pack(f"<{len(values)}f", *values)
    image = render_pb2.ImageDescriptor(output="beauty", width=width, height=height, channels=["R", "G", "B"],
                                       format=render_pb2.Encoding.RAW_FLOAT, bytes=len(data))
    for key, value in change.items():
        setattr(image, key, value)
    yield render_pb2.RenderEvent(reply=render_pb2.RenderReply(render_id="r1", images=[image]))
    yield render_pb2.RenderEvent(chunk=render_pb2.ImageChunk(image=0, offset=0, data=data[:8]))
    yield render_pb2.RenderEvent(chunk=render_pb2.ImageChunk(image=0, offset=8, data=data[8:]))
