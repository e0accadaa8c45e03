#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""A lamp that goes round a scene: each frame is a relight of the first one, so what does not depend on the lamp is kept.

    PYTHONPATH=build/clients/python clients/python/examples/relight_turntable.py cornell --local -o out/turntable
"""
import argparse
import math
import os

import gobo

parser = argparse.ArgumentParser(description="relight turntable")
parser.add_argument("scene", nargs="?", default="cornell")
parser.add_argument("-o", "--out", default="out/turntable")
parser.add_argument("--frames", type=int, default=24)
parser.add_argument("--size", type=int, nargs=2, default=(320, 240))
parser.add_argument("--spp", type=int, default=32)
parser.add_argument("--local", action="store_true", help="start a private gobod")
args = parser.parse_args()
os.makedirs(args.out, exist_ok=True)

with gobo.connect(start=args.local) as client:
    scene = client.scenes.open(args.scene)
    low, high = scene.bounds
    middle, half = (low + high) / 2, (high - low) / 2

    def lamp(turn):
        angle = 2 * math.pi * turn
        at = middle + half * (0.6 * math.cos(angle), 0.7, 0.6 * math.sin(angle))
        return {"lamp": {"kind": "sphere", "radius": 0.05 * half.min(), "intensity": 40, "position": at, "color": (1, 0.8, 0.6)}}

    first = client.render(scene, size=args.size, spp=args.spp, lights=lamp(0), integrator={"max_bounces": 2})
    for frame in range(args.frames):
        picture = first if frame == 0 else first.relight(lights=lamp(frame / args.frames))
        path = picture.save(os.path.join(args.out, f"{frame:03d}.png"))
        print(f"{path}: {picture.total_ms:.1f} ms, ran {', '.join(picture.ran())}")
