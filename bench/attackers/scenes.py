# SPDX-License-Identifier: Apache-2.0
"""Scenes that cost a server more than their sender."""
import json
import os
import struct


def _glb(document, binary: bytes) -> bytes:
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    binary += b"\0" * (-len(binary) % 4)
    return (struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(binary)) + struct.pack("<I4s", len(text), b"JSON") + text
            + struct.pack("<I4s", len(binary), b"BIN\0") + binary)


def _document(vertices: int, indices: int, bounds, lights) -> dict:
    nodes = [{"mesh": 0}, {"camera": 0, "translation": [0, 0, 3]}]
    nodes += [{"name": f"l{k}", "translation": position, "extensions": {"KHR_lights_punctual": {"light": k}}} for k, position in enumerate(lights)]
    return {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": list(range(len(nodes)))}], "nodes": nodes,
        "extensionsUsed": ["KHR_lights_punctual"],
        "extensions": {"KHR_lights_punctual": {"lights": [{"type": "point", "name": f"l{k}", "intensity": 1} for k in range(len(lights))]}},
        "cameras": [{"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1, "aspectRatio": 1.3333}}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": vertices, "type": "VEC3", "min": bounds[0], "max": bounds[1]},
                      {"bufferView": 1, "componentType": 5125, "count": indices, "type": "SCALAR"}],
        "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": 12 * vertices}, {"buffer": 0, "byteOffset": 12 * vertices, "byteLength": 4 * indices}],
        "buffers": [{"byteLength": 12 * vertices + 4 * indices}]}


TRIANGLE = struct.pack("<9f", -1, -1, 0, 1, -1, 0, 0, 1, 0) + struct.pack("<3I", 0, 1, 2)


def lights(count: int = 100000) -> bytes:
    """One triangle and `count` point lights of their own."""
    where = [[(k % 317) * 0.01 - 1.5, (k // 317) * 0.01 - 1.5, 1 + (k % 7) * 0.1] for k in range(count)]
    return _glb(_document(3, 3, ([-1, -1, 0], [1, 1, 0]), where), TRIANGLE)


def small() -> bytes:
    return lights(1)


def large(salt: int, mib: int = 36) -> bytes:
    """A strip of points and triangles of `mib` MiB; another scene for another salt."""
    vertices = mib * (1 << 20) // 16   # a point and an index each
    row = struct.pack("<6f", -1 + salt * 1e-4, -1, 0, 1, -1, 0.001)
    points = (row * (vertices // 2 + 1))[:12 * vertices]
    indices = struct.pack("<3I", 0, 1, 2) * (vertices // 3)
    return _glb(_document(vertices, vertices // 3 * 3, ([-1 + salt * 1e-4, -1, 0], [1, -1, 0.001]), [[0, 0, 1]]), points + indices)


def sparse(folder: str, size: int = 300 * 10**9) -> None:
    """`sparse.glb`, and `sparse.gltf` with a side file: headers of honest files of 300 GB that take no room on the disk."""
    with open(os.path.join(folder, "sparse.glb"), "wb") as file:
        file.write(struct.pack("<4sII", b"glTF", 2, 0xFFFFFFFF))
        file.truncate(size)
    document = _document(3, 3, ([-1, -1, 0], [1, 1, 0]), [[0, 0, 1]])
    document["buffers"] = [{"byteLength": size, "uri": "sparse.bin"}]
    with open(os.path.join(folder, "sparse.gltf"), "w", encoding="utf-8") as file:
        json.dump(document, file)
    with open(os.path.join(folder, "sparse.bin"), "wb") as file:
        file.truncate(size)
