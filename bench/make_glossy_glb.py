#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Knots of one glossy material over a dull floor, for bench/subtractive_bench: make_glossy_glb.py OUT SHININESS (Phong's; GGX of alpha^2 = 2 / (s + 2); 0: dull)."""
import json
import math
import struct
import sys


def tube(centre, scale, around=24, along=192, radius=0.13):
    """A trefoil knot: positions, normals, triangles."""
    def path(t):
        return [scale * (math.sin(t) + 2 * math.sin(2 * t)) / 3, scale * -math.sin(3 * t) / 3, scale * (math.cos(t) - 2 * math.cos(2 * t)) / 3]

    positions, normals, triangles = [], [], []
    for i in range(along):
        t, e = 2 * math.pi * i / along, 1e-3
        p, a, b = path(t), path(t - e), path(t + e)
        d = [b[k] - a[k] for k in range(3)]
        n = math.sqrt(sum(x * x for x in d))
        d = [x / n for x in d]
        u = [d[2], 0.0, -d[0]]
        n = math.sqrt(sum(x * x for x in u))
        u = [x / n for x in u]
        v = [d[1] * u[2] - d[2] * u[1], d[2] * u[0] - d[0] * u[2], d[0] * u[1] - d[1] * u[0]]
        for j in range(around):
            w = 2 * math.pi * j / around
            n = [math.cos(w) * u[k] + math.sin(w) * v[k] for k in range(3)]
            positions.append([centre[k] + p[k] + radius * n[k] for k in range(3)])
            normals.append(n)
            i1, j1 = (i + 1) % along, (j + 1) % around
            a, b, c, d4 = i * around + j, i1 * around + j, i1 * around + j1, i * around + j1
            triangles += [a, c, b, a, d4, c]
    return positions, normals, triangles


def main():
    shininess = float(sys.argv[2])
    knots = [tube([x, 0.75, z], 0.7) for x, z in ((-1.1, 0.0), (1.1, -0.4), (0.1, 1.2), (0.0, -1.6))]
    floor = ([[-40, 0, 40], [40, 0, 40], [40, 0, -40], [-40, 0, -40]], [[0, 1, 0]] * 4, [0, 1, 2, 0, 2, 3])
    binary, views, accessors, meshes = b"", [], [], []

    def accessor(data, form, kind, target):
        nonlocal binary
        flat = [x for row in data for x in (row if isinstance(row, list) else [row])]
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": 4 * len(flat), "target": target})
        binary += struct.pack("<%d%s" % (len(flat), form), *flat)
        out = {"bufferView": len(views) - 1, "componentType": 5126 if form == "f" else 5125, "count": len(data), "type": kind}
        if kind == "VEC3":
            out["min"], out["max"] = [[f(row[k] for row in data) for k in range(3)] for f in (min, max)]
            binary_min = struct.unpack("<6f", struct.pack("<6f", *out["min"], *out["max"]))
            out["min"], out["max"] = list(binary_min[:3]), list(binary_min[3:])
        accessors.append(out)
        return len(accessors) - 1

    for k, (positions, normals, triangles) in enumerate(knots + [floor]):
        meshes.append({"primitives": [{"attributes": {"POSITION": accessor(positions, "f", "VEC3", 34962), "NORMAL": accessor(normals, "f", "VEC3", 34962)},
                                       "indices": accessor(triangles, "I", "SCALAR", 34963), "material": 1 if k == len(knots) else 0}]})
    dull = {"extensions": {"KHR_materials_specular": {"specularFactor": 0}}}
    alpha = math.sqrt(2 / (shininess + 2))
    knot = {"pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.6, 0.35, 1], "metallicFactor": 1 if shininess else 0, "roughnessFactor": math.sqrt(alpha) if shininess else 1}}
    if not shininess:
        knot.update(dull)
    up, back = [0.0, 0.93, -0.37], [0.0, 0.37, 0.93]
    document = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": list(range(len(meshes) + 1))}], "extensionsUsed": ["KHR_materials_specular"],
                "nodes": [{"mesh": k} for k in range(len(meshes))] + [{"camera": 0, "matrix": [1, 0, 0, 0, *up, 0, *back, 0, 0, 2.9, 6.2, 1]}],
                "cameras": [{"type": "perspective", "perspective": {"yfov": 0.6, "znear": 0.1}}], "meshes": meshes, "accessors": accessors, "bufferViews": views,
                "materials": [knot, {"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.5, 0.5, 1], "metallicFactor": 0}, **dull}], "buffers": [{"byteLength": len(binary)}]}
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    with open(sys.argv[1], "wb") as out:
        out.write(struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(binary)) + struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary)


main()
