#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
# Writes the plain Cornell box of the race with Cycles as a GLB: 2 m box open to the front, two blocks, exact Lambert
# (specularFactor 0), an area light of 15 W/(m^2 sr) that emits up and down, 2 cm under the ceiling. The light is two quads 1 mm
# apart, back to back, because exporters and importers disagree on whether a double-sided material emits from its back.
#   make_cornell_glb.py OUT.glb
import json, math, struct, sys

WHITE, RED, GREEN = (0.885809, 0.698859, 0.666422), (0.570068, 0.0430135, 0.0443706), (0.105421, 0.37798, 0.076425)

def add(a, b): return tuple(x + y for x, y in zip(a, b))

def quad(origin, u, v):
    return [origin, add(origin, u), add(add(origin, u), v), add(origin, v)], [0, 1, 2, 0, 2, 3]

def box(centre, half, degrees):
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    turn = lambda p: (c * p[0] + s * p[2], p[1], -s * p[0] + c * p[2])
    points, indices = [], []
    for axis in range(3):
        for sign in (-1, 1):
            u, v = [0, 0, 0], [0, 0, 0]
            u[(axis + 1) % 3], v[(axis + 2) % 3] = 1, sign
            n = [0, 0, 0]; n[axis] = sign
            for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
                points.append(add(centre, turn(tuple(half[i] * (n[i] + a * u[i] + b * v[i]) for i in range(3)))))
            k = len(points) - 4
            indices += [k, k + 1, k + 2, k, k + 2, k + 3]
    return points, indices

parts = [
    ("floor", "white", quad((-1, -1, 1), (2, 0, 0), (0, 0, -2))),
    ("ceiling", "white", quad((-1, 1, -1), (2, 0, 0), (0, 0, 2))),
    ("back", "white", quad((-1, -1, -1), (2, 0, 0), (0, 2, 0))),
    ("left", "red", quad((-1, -1, 1), (0, 0, -2), (0, 2, 0))),
    ("right", "green", quad((1, -1, -1), (0, 0, 2), (0, 2, 0))),
    ("short", "white", box((0.335, -0.7, 0.38), (0.3, 0.3, 0.3), -17)),
    ("tall", "white", box((-0.33, -0.4, -0.28), (0.3, 0.6, 0.3), 18.25)),
    ("lamp_down", "lamp", quad((-0.23, 0.98, -0.20), (0.46, 0, 0), (0, 0, 0.38))),
    ("lamp_up", "lamp", quad((-0.23, 0.981, 0.18), (0.46, 0, 0), (0, 0, -0.38))),
]
colours = {"white": WHITE, "red": RED, "green": GREEN, "lamp": (0.0, 0.0, 0.0)}

def main():
    blob, views, accessors, meshes, nodes = b"", [], [], [], []
    names = list(colours)
    for name, material, (points, indices) in parts:
        for data, target, kind, extra in (
                (b"".join(struct.pack("<3f", *p) for p in points), 34962, "VEC3",
                 {"min": [min(p[i] for p in points) for i in range(3)], "max": [max(p[i] for p in points) for i in range(3)]}),
                (struct.pack(f"<{len(indices)}H", *indices), 34963, "SCALAR", {})):
            views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": len(data), "target": target})
            accessors.append({"bufferView": len(views) - 1, "componentType": 5126 if kind == "VEC3" else 5123,
                              "count": len(points) if kind == "VEC3" else len(indices), "type": kind, **extra})
            blob += data + b"\0" * (-len(data) % 4)
        meshes.append({"name": name, "primitives": [{"attributes": {"POSITION": len(accessors) - 2}, "indices": len(accessors) - 1,
                                                     "material": names.index(material)}]})
        nodes.append({"name": name, "mesh": len(meshes) - 1})
    nodes.append({"name": "front", "camera": 0, "translation": [0, 0, 3.9]})
    materials = []
    for name, colour in colours.items():
        m = {"name": name, "doubleSided": name != "lamp", "extensions": {"KHR_materials_specular": {"specularFactor": 0.0}},
             "pbrMetallicRoughness": {"baseColorFactor": [*colour, 1], "metallicFactor": 0}}
        if name == "lamp":
            m["emissiveFactor"] = [1, 1, 1]
            m["extensions"]["KHR_materials_emissive_strength"] = {"emissiveStrength": 15}
        materials.append(m)
    doc = {"asset": {"version": "2.0", "generator": "gobo bench/make_cornell_glb.py"}, "scene": 0, "scenes": [{"nodes": list(range(len(nodes)))}],
           "extensionsUsed": ["KHR_materials_specular", "KHR_materials_emissive_strength"], "nodes": nodes, "meshes": meshes, "materials": materials,
           "cameras": [{"name": "front", "type": "perspective", "perspective": {"yfov": math.radians(39.3077), "znear": 0.01, "zfar": 100}}],
           "buffers": [{"byteLength": len(blob)}], "bufferViews": views, "accessors": accessors}
    text = json.dumps(doc, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    with open(sys.argv[1], "wb") as f:
        f.write(struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(text) + 8 + len(blob)))
        f.write(struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(blob), b"BIN\0") + blob)

main()
