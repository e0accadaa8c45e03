# SPDX-License-Identifier: Apache-2.0
"""What a client of Drake's glTF Render API sends and reads (docs/drake.md), by the standard library alone: scenes of boxes, forms, pictures, and
where the ray of a pixel meets a box. Used by the test and by bench/drake.py."""
import hashlib
import http.client
import json
import struct
import uuid
import zlib

# The pose and the boxes of drake-blender's own test: 10 x 7.5 x 5 cm, 10 cm left and right of the origin, seen from (0.3, 0, 0.2) m.
CAMERA = (0.00079632671073324817, 0.99999968293183461, 0, 0, -0.50484594452922937, 0.00040202243790249793, 0.86320936664887371, 0,
          0.86320909295266346, -0.00068739667561762798, 0.50484610459985757, 0, 0.3, 0, 0.2, 1)
HALF = (0.05, 0.0375, 0.025)
TWO_BOXES = [((0, 0.1, 0), HALF, (0.25, 1.0, 0.25)), ((0, -0.1, 0), HALF, (1.0, 0.25, 0.25))]


def boxes_glb(boxes, camera=CAMERA, unlit=False):
    """A GLB of boxes (centre, half sizes, base colour) and one camera."""
    points, indices = [], []
    for axis in range(3):
        for sign in (-1, 1):
            first = len(points)
            for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
                p = [0, 0, 0]
                p[axis], p[(axis + 1) % 3], p[(axis + 2) % 3] = sign, a * sign, b
                points.append(p)
            indices += [first, first + 1, first + 2, first, first + 2, first + 3]
    data = b"".join(struct.pack("<3f", *p) for p in points) + struct.pack(f"<{len(indices)}H", *indices)
    nodes = [{"mesh": i, "translation": list(centre), "scale": list(half)} for i, (centre, half, _) in enumerate(boxes)]
    materials = [{"pbrMetallicRoughness": {"baseColorFactor": [*colour, 1], "metallicFactor": 0, "roughnessFactor": 1},
                  **({"extensions": {"KHR_materials_unlit": {}}} if unlit else {})} for _, _, colour in boxes]
    document = {
        "asset": {"version": "2.0"}, "scene": 0,
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": i}]} for i in range(len(boxes))],
        "materials": materials,
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 24, "type": "VEC3", "min": [-1, -1, -1], "max": [1, 1, 1]},
                      {"bufferView": 1, "componentType": 5123, "count": 36, "type": "SCALAR"}],
        "bufferViews": [{"buffer": 0, "byteLength": 288}, {"buffer": 0, "byteOffset": 288, "byteLength": 72}],
        "buffers": [{"byteLength": len(data)}],
    }
    if unlit:
        document["extensionsUsed"] = ["KHR_materials_unlit"]
    document["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.7853981, "znear": 0.01, "zfar": 10, "aspectRatio": 4 / 3}}]
    nodes.append({"camera": 0, "matrix": list(camera), "name": "Camera Node"})
    document["nodes"] = nodes
    document["scenes"] = [{"nodes": list(range(len(nodes)))}]
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def fields(scene, image_type="color", **change):
    """The form's text fields as Drake sends them; None leaves one out."""
    out = {"scene_sha256": hashlib.sha256(scene).hexdigest(), "image_type": image_type, "width": "640", "height": "480", "near": "0.010000", "far": "10.000000",
           "focal_x": "579.411255", "focal_y": "579.411255", "fov_x": "1.009200", "fov_y": "0.785398", "center_x": "319.500000", "center_y": "239.500000"}
    if image_type == "depth":
        out.update(min_depth="0.010000", max_depth="10.000000")
    out["submit"] = "Render"
    out.update(change)
    return {k: str(v) for k, v in out.items() if v is not None}


def form(values, scene):
    """(Content-Type, body) of a multipart form; `scene` None: without the file."""
    mark = uuid.uuid4().hex
    parts = [f'--{mark}\r\nContent-Disposition: form-data; name="{k}"\r\n\r\n{v}\r\n'.encode() for k, v in values.items()]
    if scene is not None:
        parts.append(f'--{mark}\r\nContent-Disposition: form-data; name="scene"; filename="scene.gltf"\r\nContent-Type: model/gltf+json\r\n\r\n'.encode() + scene + b"\r\n")
    return f"multipart/form-data; boundary={mark}", b"".join(parts) + f"--{mark}--\r\n".encode()


def post(port, scene, image_type="color", path="/render", headers=None, values=None, timeout=60, **change):
    """(status, Content-Type, body) of one call of the API."""
    kind, body = form(fields(scene, image_type, **change) if values is None else values, scene)
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=timeout)
    try:
        connection.request("POST", path, body, {"Content-Type": kind, **(headers or {})})
        answer = connection.getresponse()
        return answer.status, answer.getheader("Content-Type"), answer.read()
    finally:
        connection.close()


def read_png(data):
    """(width, height, channels, rows) of an 8-bit PNG; a row is its bytes."""
    assert data[:8] == b"\x89PNG\r\n\x1a\n", data[:80]
    at, packed = 8, b""
    while at < len(data):
        size, name = struct.unpack(">I4s", data[at:at + 8])
        chunk = data[at + 8:at + 8 + size]
        if name == b"IHDR":
            width, height, bits, colour = struct.unpack(">IIBB", chunk[:10])
            assert bits == 8 and colour in (2, 6), (bits, colour)
        elif name == b"IDAT":
            packed += chunk
        at += 12 + size
    n = 3 if colour == 2 else 4
    raw, rows, above = zlib.decompress(packed), [], bytearray(width * n)
    for y in range(height):
        start = y * (width * n + 1)
        kind, row = raw[start], bytearray(raw[start + 1:start + 1 + width * n])
        for i in range(len(row)):
            a, b, c = row[i - n] if i >= n else 0, above[i], above[i - n] if i >= n else 0
            if kind == 1:
                row[i] = row[i] + a & 255
            elif kind == 2:
                row[i] = row[i] + b & 255
            elif kind == 3:
                row[i] = row[i] + (a + b) // 2 & 255
            elif kind == 4:
                near = min((abs(b - c), 0, a), (abs(a - c), 1, b), (abs(a + b - 2 * c), 2, c))
                row[i] = row[i] + near[2] & 255
        rows.append(bytes(row))
        above = row
    return width, height, n, rows


def read_tiff(data):
    """(width, height, rows of floats) of an uncompressed TIFF of one strip."""
    assert data[:4] == b"II*\0", data[:80]
    at, = struct.unpack("<I", data[4:8])
    count, = struct.unpack("<H", data[at:at + 2])
    tags = {}
    for i in range(count):
        name, kind, number, value = struct.unpack("<HHII", data[at + 2 + 12 * i:at + 14 + 12 * i])
        assert number == 1 and kind in (3, 4)
        assert kind == 4 or value < 65536
        tags[name] = value
    assert list(tags) == sorted(tags)
    assert (tags[258], tags[259], tags[277], tags[339], tags[278]) == (32, 1, 1, 3, tags[257]), tags
    width, height = tags[256], tags[257]
    assert tags[279] == 4 * width * height == len(data) - tags[273]
    values = struct.unpack(f"<{width * height}f", data[tags[273]:])
    return width, height, [values[y * width:(y + 1) * width] for y in range(height)]


def meet(boxes, u, v, values, camera=CAMERA):
    """(depth along the axis, index of the box) of what the pixel coordinates u, v see between near and far; (None, None): nothing."""
    near, far = float(values["near"]), float(values["far"])
    local = ((u - float(values["center_x"])) / float(values["focal_x"]), -(v - float(values["center_y"])) / float(values["focal_y"]), -1.0)
    ray = [sum(camera[4 * c + r] * local[c] for c in range(3)) for r in range(3)]
    best = (None, None)
    for i, (centre, half, _) in enumerate(boxes):
        enter, leave = -1e30, 1e30
        for k in range(3):
            o, d = camera[12 + k] - centre[k], ray[k]
            if d == 0:
                if abs(o) > half[k]:
                    enter, leave = 1, 0
                continue
            a, b = sorted(((-half[k] - o) / d, (half[k] - o) / d))
            enter, leave = max(enter, a), min(leave, b)
        if enter > leave:
            continue
        for t in (enter, leave):   # the inside of the back, where the near plane cuts the front away
            if near <= t <= far and (best[0] is None or t < best[0]):
                best = (t, i)
    return best
