#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
# Writes the scene of the race with Filament as a GLB: a slab, 48 blocks and 12 thin posts (61 boxes, 732 triangles), exact Lambert (metallic 0,
# roughness 1, specularFactor 0 for readers of KHR_materials_specular), one directional light "sun", one camera "eye". Always the same boxes.
#   make_boxes_glb.py OUT.glb [--sun X,Y,Z]     direction that the light travels in; default -0.45,-0.8,-0.35
import json, math, random, struct, sys

def box(centre, half, degrees):
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    turn = lambda p: (c * p[0] + s * p[2], p[1], -s * p[0] + c * p[2])
    points, normals, indices = [], [], []
    for axis in range(3):
        for sign in (-1, 1):
            u, v, n = [0, 0, 0], [0, 0, 0], [0, 0, 0]
            u[(axis + 1) % 3], v[(axis + 2) % 3], n[axis] = 1, sign, sign
            for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
                p = turn(tuple(half[i] * (n[i] + a * u[i] + b * v[i]) for i in range(3)))
                points.append(tuple(x + y for x, y in zip(centre, p)))
                normals.append(turn(tuple(n)))
            k = len(points) - 4
            indices += [k, k + 1, k + 2, k, k + 2, k + 3]
    return points, normals, indices

def boxes():
    rng = random.Random(61)
    yield box((0, -0.25, 0), (12, 0.25, 12), 0)
    for k in range(60):
        x, z = -8.4 + 1.68 * (k % 10) + rng.uniform(-0.5, 0.5) + 0.84, -6 + 2.4 * (k // 10) + rng.uniform(-0.7, 0.7)
        if k % 5 == 4:                                     # a post
            h = rng.uniform(1.2, 2.4); yield box((x, h, z), (0.06, h, 0.06), rng.uniform(0, 90))
        else:
            h = rng.uniform(0.2, 1.0); yield box((x, h, z), (rng.uniform(0.2, 0.55), h, rng.uniform(0.2, 0.55)), rng.uniform(0, 90))

def rotation(forward, up=(0, 1, 0)):
    """Quaternion that turns -Z to `forward`."""
    norm = lambda a: tuple(x / math.sqrt(sum(y * y for y in a)) for x in a)
    cross = lambda a, b: (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
    back = norm(tuple(-x for x in forward)); right = norm(cross(up, back)); top = cross(back, right)
    m = (right, top, back)                                 # columns
    w = math.sqrt(max(0, 1 + m[0][0] + m[1][1] + m[2][2])) / 2
    x = math.copysign(math.sqrt(max(0, 1 + m[0][0] - m[1][1] - m[2][2])) / 2, m[1][2] - m[2][1])
    y = math.copysign(math.sqrt(max(0, 1 - m[0][0] + m[1][1] - m[2][2])) / 2, m[2][0] - m[0][2])
    z = math.copysign(math.sqrt(max(0, 1 - m[0][0] - m[1][1] + m[2][2])) / 2, m[0][1] - m[1][0])
    return [x, y, z, w]

def main():
    sun = (-0.45, -0.8, -0.35)
    if "--sun" in sys.argv: sun = tuple(float(v) for v in sys.argv[sys.argv.index("--sun") + 1].split(","))
    blob, views, accessors, meshes, nodes = b"", [], [], [], []
    def put(data, target, component, count, kind, extra):
        nonlocal blob
        views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": len(data), "target": target})
        accessors.append({"bufferView": len(views) - 1, "componentType": component, "count": count, "type": kind, **extra})
        blob += data + b"\0" * (-len(data) % 4)
        return len(accessors) - 1
    for i, (points, normals, indices) in enumerate(boxes()):
        bounds = {"min": [min(p[k] for p in points) for k in range(3)], "max": [max(p[k] for p in points) for k in range(3)]}
        p = put(b"".join(struct.pack("<3f", *v) for v in points), 34962, 5126, len(points), "VEC3", bounds)
        n = put(b"".join(struct.pack("<3f", *v) for v in normals), 34962, 5126, len(normals), "VEC3", {})
        t = put(struct.pack(f"<{len(indices)}H", *indices), 34963, 5123, len(indices), "SCALAR", {})
        meshes.append({"name": f"box{i}", "primitives": [{"attributes": {"POSITION": p, "NORMAL": n}, "indices": t, "material": 0}]})
        nodes.append({"name": f"box{i}", "mesh": i})
    eye, target = (2.5, 6.5, 11.5), (0.0, 0.0, 0.0)
    nodes.append({"name": "eye", "camera": 0, "translation": list(eye), "rotation": rotation(tuple(b - a for a, b in zip(eye, target)))})
    nodes.append({"name": "sun", "rotation": rotation(sun), "extensions": {"KHR_lights_punctual": {"light": 0}}})
    document = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": list(range(len(nodes)))}], "nodes": nodes, "meshes": meshes,
        "cameras": [{"type": "perspective", "perspective": {"yfov": math.radians(45), "aspectRatio": 16 / 9, "znear": 0.5, "zfar": 60}}],
        "materials": [{"name": "white", "pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.8, 0.8, 1], "metallicFactor": 0, "roughnessFactor": 1},
                       "extensions": {"KHR_materials_specular": {"specularFactor": 0}}}],
        "extensions": {"KHR_lights_punctual": {"lights": [{"name": "sun", "type": "directional", "color": [1, 1, 1], "intensity": 100000}]}},
        "extensionsUsed": ["KHR_lights_punctual", "KHR_materials_specular"],
        "accessors": accessors, "bufferViews": views, "buffers": [{"byteLength": len(blob)}]}
    text = json.dumps(document, separators=(",", ":")).encode(); text += b" " * (-len(text) % 4)
    with open(sys.argv[1], "wb") as f:
        f.write(struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(blob)) + struct.pack("<I4s", len(text), b"JSON") + text)
        f.write(struct.pack("<I4s", len(blob), b"BIN\0") + blob)

if __name__ == "__main__":
    main()
