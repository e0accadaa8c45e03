#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""How soon an edit of a shadow's style is seen over the socket: bench/style_edits.py [--build BUILD] [--size WxH] [--scene SCENE] [--repeats N].

A daemon of its own, one spot in the scene, rays for its shadow, one view sample a pixel, direct light alone, pictures as 16-bit floats (RAW_HALF).
Each edit is one that was not asked for before, nothing else running. Columns: the median time until the picture is here, and the
milliseconds of the style's own nodes in the reply's plan. Reports; decides nothing."""
import argparse
import statistics
import sys
import time

EDITS = {
    "brightness (transfer)": lambda k: {"brightness": 0.01 + 0.01 * k},
    "inflation (transfer)": lambda k: {"inflation": 0.02 + 0.001 * k},
    "softness (transfer)": lambda k: {"softness": 0.1 + 0.01 * k},
    "abstraction (blur, transfer)": lambda k: {"abstraction": 0.03 + 0.001 * k},
    "power (distance, blur, transfer)": lambda k: {"power": 4 + k},
}


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--build", default="build")
    arguments.add_argument("--size", default="1920x1080")
    arguments.add_argument("--scene", default="cornell")
    arguments.add_argument("--repeats", type=int, default=9)
    given = arguments.parse_args()
    sys.path.insert(0, f"{given.build}/clients/python")
    import gobo
    width, height = map(int, given.size.split("x"))
    lamp = {"kind": "SPOT", "position": {"x": 0.2, "y": 1.6, "z": 0.4}, "direction": {"x": 0, "y": -1, "z": -0.2}, "intensity": 3}
    with gobo.local(gobod=f"{given.build}/server/gobod") as client:
        def picture(style):
            begin = time.perf_counter()
            result = client.render(given.scene, width=width, height=height, view_samples=1, lights={"lamp": lamp}, integrator={"max_bounces": 0}, halt={"spp": 1},
                                   shadows={"ray_traced": {"samples": 1}, "style": {"softness": 0.1, "abstraction": 0.02, **style}}, encoding={"format": "RAW_HALF"})
            return 1e3 * (time.perf_counter() - begin), result.reply
        first, reply = picture({})
        nodes = {}
        for node in reply.plan:
            if node.node.startswith("style_") and node.node.endswith(":lamp"):
                nodes[node.node] = node.ms
        print(f"{given.scene} {given.size}: first picture {first:.0f} ms; of it " + ", ".join(f"{name} {ms:.1f}" for name, ms in nodes.items()))
        for name, edit in EDITS.items():
            walls, own = [], {}
            for k in range(given.repeats):
                wall, reply = picture(edit(k))
                walls.append(wall)
                for node in reply.plan:
                    if node.node.startswith("style_") and node.node.endswith(":lamp") and node.ms > 0 and node.state == 1:
                        own.setdefault(node.node, []).append(node.ms)
            print(f"{name}: {statistics.median(walls):.1f} ms to the picture; " + ", ".join(f"{n} {statistics.median(v):.1f} ms" for n, v in own.items()))


if __name__ == "__main__":
    main()
