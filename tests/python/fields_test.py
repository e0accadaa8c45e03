# SPDX-License-Identifier: Apache-2.0
"""Requests, masks and GLB packing without a server."""
import json
import os
import struct
import tempfile
import unittest

import numpy as np

import gobo
from gobo import glb
from gobo.fields import Builder, RequestFields, fill
from gobo.jobs import _range
from gobo.v1 import render_pb2, service_pb2
from support import gltf


def build(**fields):
    request = render_pb2.RenderRequest()
    builder = fill(request, fields)
    return request, builder


class Fields(unittest.TestCase):
    def refuses(self, text, **fields):
        with self.assertRaises(gobo.InvalidArgument) as caught:
            build(**fields)
        self.assertIn(text, caught.exception.message)
        return caught.exception.field

    def test_type_hints_have_every_field(self):
        self.assertEqual({f.name for f in render_pb2.RenderRequest.DESCRIPTOR.fields} - set(RequestFields.__annotations__), {"scene"})   # which is the first argument

    def test_names(self):
        self.assertEqual(self.refuses("did you mean 'width'?", widht=3), "widht")
        self.assertEqual(self.refuses("did you mean 'max_bounces'?", integrator={"max_bounce": 3}), "integrator.max_bounce")
        self.refuses("did you mean 'intensity'?", lights={"key": {"intensty": 3}})
        self.refuses("no fields of its own", set={"width.x": 3})
        self.refuses("no field 'w' in Vector3", lights={"key": {"gain": {"w": 1}}})
        self.assertEqual(self.refuses("is not UTF-8", camera="a\udcff"), "camera.name")
        self.assertEqual(self.refuses("is not UTF-8", env="a\udcff.hdr"), "environment.path")
        self.assertEqual(self.refuses("is not UTF-8", lights={"a\udcff": 2}), "lights")

    def test_values(self):
        self.assertEqual(self.refuses("whole number", width=1.5), "width")
        self.refuses("must be a number", width="x")
        self.refuses("from 0 to 4294967295", width=-1)
        self.refuses("from 0 to 4294967295", width=1 << 32)
        self.refuses("must be a number", width=True)
        self.refuses("True or False", integrator={"indirect": 1})
        self.refuses("must be one of tree, power, uniform", integrator={"light_selection": "tre"})
        self.refuses("must be one of sobol, halton, independent", integrator={"sampler": "halto"})
        self.refuses("three numbers", lights={"key": {"position": 2}})
        self.refuses("three numbers", lights={"key": {"gain": (1, 2)}})
        self.refuses("must be a mapping", lights=3)
        self.refuses("must be (width, height)", size=3)
        self.refuses("must be text", scene_hash=3)
        self.refuses("must be a mapping of ray_traced", shadows="nonesuch")

    def test_meshes(self):
        request, builder = build(meshes={"my ball.001": {"inflate": 0.1, "smoothing": "laplacian"}, "*": {"cluster": 0.2}}, set={"meshes.my ball.001.smooth": 3})
        self.assertEqual(request.meshes["my ball.001"], render_pb2.MeshEdit(inflate=0.1, smoothing="LAPLACIAN", smooth=3))
        self.assertEqual(request.meshes["*"], render_pb2.MeshEdit(cluster=0.2))
        self.assertEqual(self.refuses("did you mean 'inflate'?", meshes={"ball": {"inflat": 1}}), "meshes.ball.inflat")

    def test_short_forms(self):
        request, _ = build(lights={"a": 2, "b": (1, 2, 3), "c": False, "d": {"enabled": True}}, env=(1, 2, 3), camera="front", certificate=True,
                           shadows="axis_aligned", denoise="auto", exposure=1, priority="batch", format="raw_half", max_seconds=2, outputs="beauty,depth")
        gains = {k: (v.gain.x, v.gain.y, v.gain.z) for k, v in request.lights.items()}
        self.assertEqual((gains["a"], gains["b"], request.lights["c"].enabled, request.lights["c"].HasField("gain")), ((2, 2, 2), (1, 2, 3), False, False))
        self.assertEqual((request.environment.constant.z, request.camera.name, request.HasField("certificate")), (3, "front", True))
        self.assertEqual((request.shadows.WhichOneof("technique"), request.denoise.WhichOneof("filter")), ("axis_aligned", "auto"))
        both = build(denoise={"outliers": {"path_density": {"neighbours": 12}}, "auto": {}})[0].denoise
        self.assertEqual((both.outliers.path_density.neighbours, both.WhichOneof("filter")), (12, "auto"))
        self.assertEqual(build(denoise={"outliers": "trimmed"})[0].denoise.outliers.WhichOneof("method"), "trimmed")
        self.assertEqual(build(denoise="wavelet", denoise__outliers="reweighting")[0].denoise.outliers.WhichOneof("method"), "reweighting")
        self.assertEqual((request.tone_map.exposure, request.scheduling.priority, request.encoding.format, request.halt.time_s), (1, 3, 5, 2))
        self.assertEqual(list(request.outputs), ["beauty", "depth"])
        self.assertFalse(build(certificate=False)[0].HasField("certificate"))
        with tempfile.TemporaryDirectory() as folder:
            name = os.path.join(folder, "e.hdr")
            open(name, "wb").close()
            self.assertEqual(build(env=os.path.relpath(name))[0].environment.path, os.path.abspath(name))
        self.assertEqual(build(env="none")[0].environment.path, "none")

    def test_light_names_with_dots(self):
        request, builder = build(set={"lights.lamp.001.gain": 2, "lights.lamp.002": 3})
        self.assertEqual(sorted(request.lights), ["lamp.001", "lamp.002"])
        self.assertEqual(sorted(builder.mask()), ["lights.lamp.001.gain", "lights.lamp.002.gain"])

    def test_masks(self):
        _, builder = build(lights={"a": {"gain": 2, "intensity": 3}, "b": None}, exposure=0, shadows={"path_traced": {}}, outputs=["x"], width=None)
        self.assertEqual(sorted(builder.mask()), ["lights.a.gain", "lights.a.intensity", "lights.b", "outputs", "shadows.path_traced", "tone_map.exposure", "width"])
        _, builder = build(env={"constant": 1, "rotation_deg": 3}, exposure=1)
        self.assertEqual(sorted(builder.mask(["environment"])), ["environment", "tone_map.exposure"])

    def test_curves_are_rows(self):
        request = build(curves={"lights.light.gain": {"time_s": [0, 1], "value": np.array([[1, 1, 1], [3, 2, 1]])}})[0]
        self.assertEqual(list(request.curves["lights.light.gain"].value), [1, 1, 1, 3, 2, 1])

    def test_instances_are_column_major(self):
        request = service_pb2.PatchSceneRequest()
        matrix = np.eye(4)
        matrix[:3, 3] = (1, 2, 3)
        Builder(request).put("instances", {"box": matrix})
        self.assertEqual(list(request.instances["box"].matrix)[12:15], [1, 2, 3])
        Builder(request).put("instances", {"lid": {"moved_by": (1, 2, 3)}})
        self.assertEqual((request.instances["lid"].moved_by.y, len(request.instances["lid"].matrix)), (2, 0))

    def test_frames(self):
        self.assertEqual(_range(range(0, 10, 3)), {"first": 0, "last": 9, "step": 3})
        self.assertEqual((_range(4), _range((1, 3)), _range(None)), ({"first": 4, "last": 4}, {"first": 1, "last": 3}, None))
        for bad in (range(3, 3), range(5, 0, -1), (1, 2, 3), 1.5):
            with self.assertRaises(gobo.InvalidArgument):
                _range(bad)


class Glb(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = folder.name

    def change(self, edit):
        path = gltf(self.folder)
        with open(path, encoding="utf-8") as file:
            document = json.load(file)
        edit(document)
        with open(path, "w", encoding="utf-8") as file:
            json.dump(document, file)
        return path

    def refuses(self, kind, text, edit):
        with self.assertRaises(kind) as caught:
            glb.pack(self.change(edit))
        self.assertIn(text, caught.exception.message)

    def test_parts(self):
        def images(d):
            d["images"] = [{"uri": "a.png"}, {"uri": "data:image/jpeg;base64,AAEC"}]
            d["buffers"].append({"byteLength": 3, "uri": "data:application/octet-stream;base64,AwQF"})
            d["bufferViews"].append({"buffer": 1, "byteLength": 3})
        with open(os.path.join(self.folder, "a.png"), "wb") as file:
            file.write(b"\x89PNG!")
        data = glb.pack(self.change(images))
        magic, version, total, head, kind = struct.unpack_from("<IIIII", data)
        self.assertEqual((magic, version, total, kind, len(data) % 4), (0x46546C67, 2, len(data), 0x4E4F534A, 0))
        document = json.loads(data[20:20 + head])
        length, kind = struct.unpack_from("<II", data, 20 + head)
        binary = data[28 + head:]
        self.assertEqual((kind, length, len(document["buffers"])), (0x004E4942, len(binary), 1))
        views = [binary[v.get("byteOffset", 0):][:v["byteLength"]] for v in document["bufferViews"]]
        self.assertEqual(views[0], struct.pack("<9f", -1, -1, 0, 1, -1, 0, 0, 1, 0))
        self.assertEqual(views[2], b"\3\4\5")
        self.assertEqual([views[i["bufferView"]] for i in document["images"]], [b"\x89PNG!", b"\0\1\2"])
        self.assertEqual([i["mimeType"] for i in document["images"]], ["image/png", "image/jpeg"])

    def test_refusals(self):
        uri = lambda text: lambda d: d["buffers"][0].__setitem__("uri", text)
        self.refuses(gobo.InvalidArgument, "only files beside", uri("http://example.com/a.bin"))
        self.refuses(gobo.InvalidArgument, "only files beside", uri("file:///etc/passwd"))
        self.refuses(gobo.InvalidArgument, "outside the file's folder", uri("../../etc/passwd"))
        self.refuses(gobo.InvalidArgument, "outside the file's folder", uri("/etc/passwd"))
        self.refuses(gobo.InvalidArgument, "outside the file's folder", uri("%2e%2e/x"))
        self.refuses(gobo.NotFound, "/buffers/0/uri", uri("nonesuch.bin"))
        self.refuses(gobo.InvalidArgument, "not base64", uri("data:;base64,@@@"))
        self.refuses(gobo.InvalidArgument, "no such buffer", lambda d: d["bufferViews"][0].__setitem__("buffer", 9))
        self.refuses(gobo.InvalidArgument, "array of objects", lambda d: d.__setitem__("buffers", 3))
        os.symlink("/etc/passwd", os.path.join(self.folder, "link.bin"))
        self.refuses(gobo.InvalidArgument, "outside the file's folder", uri("link.bin"))
        with self.assertRaisesRegex(gobo.InvalidArgument, "upload limit"):
            glb.pack(gltf(self.folder), limit=16)
        with open(os.path.join(self.folder, "bad.gltf"), "w", encoding="utf-8") as file:
            file.write("{")
        with self.assertRaisesRegex(gobo.InvalidArgument, "not JSON"):
            glb.pack(os.path.join(self.folder, "bad.gltf"))


if __name__ == "__main__":
    unittest.main()
