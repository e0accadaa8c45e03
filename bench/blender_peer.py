# SPDX-License-Identifier: Apache-2.0
"""What a render server over Blender does for a request, without its sockets. It runs inside Blender:
  blender -b --factory-startup -P bench/blender_peer.py      one JSON object a line in, one line "peer {...}" out

In: scene (a GLB), out (a PNG), width, height, spp, seed, camera (16 numbers, camera to world by columns, glTF's axes), yfov (radians), world (r, g, b), keep.
Out: seconds: of everything, or with `keep` of the render alone, of the scene that is there already.
Settings are Blender's own but for the samples; denoising is off (Debian's Blender has no denoiser), pixels stop early as Cycles does by default."""
import json
import os
import sys
import time

import numpy as np

for name in ("bool", "object", "int", "float"):   # Blender 3.4's importer is older than numpy 1.24
    if not hasattr(np, name):
        setattr(np, name, {"bool": bool, "object": object, "int": int, "float": float}[name])
import bpy  # noqa: E402
from mathutils import Matrix  # noqa: E402


def load(asked):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=asked["scene"])
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.use_persistent_data = bool(asked.get("keep"))
    scene.cycles.device = "CPU"
    scene.cycles.use_denoising = False
    scene.render.threads_mode, scene.render.threads = "FIXED", os.cpu_count()
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = asked["width"], asked["height"], 100
    scene.render.image_settings.file_format = "PNG"
    scene.view_settings.view_transform = "Standard"
    camera = bpy.data.objects.new("asked", bpy.data.cameras.new("asked"))
    columns = Matrix([asked["camera"][4 * k:4 * k + 4] for k in range(4)]).transposed()
    camera.matrix_world = Matrix.Rotation(np.pi / 2, 4, "X") @ columns   # Blender's z is up
    camera.data.sensor_fit, camera.data.angle, camera.data.clip_start = "VERTICAL", asked["yfov"], 0.001
    scene.collection.objects.link(camera)
    scene.camera = camera
    world = bpy.data.worlds.new("world")
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs[0].default_value = (*asked["world"], 1)
    scene.world = world


there = None
for line in sys.stdin:
    asked = json.loads(line)
    begun = time.perf_counter()
    if not (asked.get("keep") and there == asked["scene"]):
        load(asked)
        there = asked["scene"] if asked.get("keep") else None
    scene = bpy.context.scene
    scene.cycles.samples, scene.cycles.seed, scene.render.filepath = asked["spp"], asked["seed"], asked["out"]
    bpy.ops.render.render(write_still=True)
    print("peer " + json.dumps({"seconds": time.perf_counter() - begun}), flush=True)
