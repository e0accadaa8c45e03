# SPDX-License-Identifier: Apache-2.0
# A small GLB writer and readers of OBJ and PLY, for scenes of other renderers. Standard library only.
import base64, json, math, os, struct


def multiply(a, b):
    return [[sum(a[i][k] * b[k][j] for k in range(4)) for j in range(4)] for i in range(4)]


IDENTITY = [[float(i == j) for j in range(4)] for i in range(4)]


def translation(v):
    return [[1, 0, 0, v[0]], [0, 1, 0, v[1]], [0, 0, 1, v[2]], [0, 0, 0, 1]]


def scaling(v):
    return [[v[0], 0, 0, 0], [0, v[1], 0, 0], [0, 0, v[2], 0], [0, 0, 0, 1]]


def rotation(axis, degrees):
    n = math.sqrt(sum(c * c for c in axis))
    x, y, z = (c / n for c in axis)
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    t = 1 - c
    return [[t * x * x + c, t * x * y - s * z, t * x * z + s * y, 0], [t * x * y + s * z, t * y * y + c, t * y * z - s * x, 0],
            [t * x * z - s * y, t * y * z + s * x, t * z * z + c, 0], [0, 0, 0, 1]]


def look_at(origin, target, up, right_sign):
    """Columns right * right_sign, up, forward, origin: the frame of renderers whose cameras look along +z."""
    sub = lambda a, b: [p - q for p, q in zip(a, b)]
    cross = lambda a, b: [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    unit = lambda a: [c / math.sqrt(sum(d * d for d in a)) for c in a]
    f = unit(sub(target, origin))
    left = unit(cross(up, f))
    u = cross(f, left)
    x = [c * right_sign for c in left]
    return [[x[i], u[i], f[i], origin[i]] for i in range(3)] + [[0, 0, 0, 1]]


class Mesh:
    """Corners as separate vertices: positions, normals or None, uv (v down, as glTF) or None, triangles."""
    def __init__(self, positions, triangles, normals=None, uv=None):
        self.positions, self.triangles, self.normals, self.uv = positions, triangles, normals, uv


def read_obj(path, flat=False):
    v, vt, vn, corners, triangles, known = [], [], [], [], [], {}
    for line in open(path, encoding="latin-1"):
        p = line.split()
        if not p:
            continue
        if p[0] == "v": v.append(tuple(map(float, p[1:4])))
        elif p[0] == "vt": vt.append((float(p[1]), 1.0 - float(p[2])))
        elif p[0] == "vn": vn.append(tuple(map(float, p[1:4])))
        elif p[0] == "f":
            face = []
            for c in p[1:]:
                parts = (c.split("/") + ["", ""])[:3]
                key = tuple((int(x) - 1 if int(x) > 0 else int(x) + n) if x else -1 for x, n in zip(parts, (len(v), len(vt), len(vn))))
                if key not in known:
                    known[key] = len(corners)
                    corners.append(key)
                face.append(known[key])
            triangles += [(face[0], face[i], face[i + 1]) for i in range(1, len(face) - 1)]
    has = lambda k: corners and all(c[k] >= 0 for c in corners)
    return Mesh([v[c[0]] for c in corners], triangles, [vn[c[2]] for c in corners] if has(2) and not flat else None,
                [vt[c[1]] for c in corners] if has(1) else None)


def read_ply(path):
    data = open(path, "rb").read()
    end = data.index(b"end_header") + len(b"end_header")
    header = data[:end].decode().split("\n")
    at = data.index(b"\n", end) + 1
    binary = any(l.startswith("format binary_little_endian") for l in header)
    if not binary and not any(l.startswith("format ascii") for l in header):
        raise SystemExit(f"{path}: only ascii and little-endian PLY")
    kinds = {"float": "f", "float32": "f", "double": "d", "uchar": "B", "uint8": "B", "char": "b", "int": "i", "int32": "i", "uint": "I",
             "uint32": "I", "short": "h", "ushort": "H"}
    elements = []
    for l in header:
        p = l.split()
        if p[:1] == ["element"]: elements.append((p[1], int(p[2]), []))
        elif p[:1] == ["property"]: elements[-1][2].append(p[1:])
    words = None if binary else data[at:].split()
    index = 0

    def take(kind):
        nonlocal at, index
        if binary:
            f = "<" + kinds[kind]
            value = struct.unpack_from(f, data, at)[0]
            at += struct.calcsize(f)
            return value
        index += 1
        return float(words[index - 1])
    positions, normals, uv, triangles = [], [], [], []
    for name, count, properties in elements:
        for _ in range(count):
            row = {}
            for p in properties:
                row[p[-1]] = [take(p[2]) for _ in range(int(take(p[1])))] if p[0] == "list" else take(p[0])
            if name == "vertex":
                positions.append((row["x"], row["y"], row["z"]))
                if "nx" in row: normals.append((row["nx"], row["ny"], row["nz"]))
                for a, b in (("s", "t"), ("u", "v")):
                    if a in row: uv.append((row[a], row[b]))
            elif name == "face":
                f = [int(i) for i in next(v for v in row.values() if isinstance(v, list))]
                triangles += [(f[0], f[i], f[i + 1]) for i in range(1, len(f) - 1)]
    return Mesh(positions, triangles, normals or None, uv or None)


def rectangle():
    # Texture v points down in Mitsuba too (its OBJ reader turns v over), so that pictures stand on their heads here.
    return Mesh([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [(0, 1, 2), (0, 2, 3)], None, [(0, 0), (1, 0), (1, 1), (0, 1)])


def cube():
    mesh = Mesh([], [])
    for axis in range(3):
        for sign in (-1, 1):
            a, b = (axis + 1) % 3, (axis + 2) % 3
            k = len(mesh.positions)
            for s, t in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
                p = [0, 0, 0]
                p[axis], p[a], p[b] = sign, s * sign, t
                mesh.positions.append(tuple(p))
            mesh.triangles += [(k, k + 1, k + 2), (k, k + 2, k + 3)]
    return mesh


class Glb:
    def __init__(self):
        self.blob = bytearray()
        self.doc = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": []}], "nodes": [], "meshes": [], "materials": [], "cameras": [],
                    "bufferViews": [], "accessors": [], "images": [], "textures": [], "samplers": []}
        self.lights, self.extensions = [], set()

    def view(self, data):
        self.doc["bufferViews"].append({"buffer": 0, "byteOffset": len(self.blob), "byteLength": len(data)})
        self.blob += data + b"\0" * (-len(data) % 4)
        return len(self.doc["bufferViews"]) - 1

    def accessor(self, values, kind, component, **extra):
        flat = [c for v in values for c in v] if kind != "SCALAR" else values
        data = struct.pack(f"<{len(flat)}{'f' if component == 5126 else 'I'}", *flat)
        self.doc["accessors"].append({"bufferView": self.view(data), "componentType": component, "count": len(values), "type": kind, **extra})
        return len(self.doc["accessors"]) - 1

    def texture(self, path, wrap="repeat", nearest=False):
        mime = "image/png" if path.lower().endswith("png") else "image/jpeg"
        self.doc["images"].append({"bufferView": self.view(open(path, "rb").read()), "mimeType": mime, "name": os.path.basename(path)})
        mode = {"repeat": 10497, "mirror": 33648, "clamp": 33071}[wrap]
        f = 9728 if nearest else 9729
        self.doc["samplers"].append({"wrapS": mode, "wrapT": mode, "magFilter": f, "minFilter": f})
        self.doc["textures"].append({"source": len(self.doc["images"]) - 1, "sampler": len(self.doc["samplers"]) - 1})
        return len(self.doc["textures"]) - 1

    def material(self, name, colour=(1, 1, 1), texture=None, metallic=0.0, roughness=1.0, emission=None, double_sided=False, specular=0.0,
                 uv_scale=None, uv_offset=None, glass=None):
        m = {"name": name, "doubleSided": double_sided, "pbrMetallicRoughness": {"baseColorFactor": [*colour, 1.0], "metallicFactor": metallic,
             "roughnessFactor": roughness}, "extensions": {"KHR_materials_specular": {"specularFactor": specular}}}
        self.extensions.add("KHR_materials_specular")
        if texture is not None:
            info = {"index": texture}
            if uv_scale:
                info["extensions"] = {"KHR_texture_transform": {"scale": uv_scale, "offset": uv_offset or [0, 0]}}
                self.extensions.add("KHR_texture_transform")
            m["pbrMetallicRoughness"]["baseColorTexture"] = info
        if glass:   # index of refraction of a solid
            m["extensions"].update({"KHR_materials_transmission": {"transmissionFactor": 1.0}, "KHR_materials_ior": {"ior": glass},
                                    "KHR_materials_volume": {"thicknessFactor": 1.0}})
            self.extensions |= {"KHR_materials_transmission", "KHR_materials_ior", "KHR_materials_volume"}
        if emission and max(emission) > 0:
            strength = max(1.0, max(emission))
            m["emissiveFactor"] = [c / strength for c in emission]
            m["extensions"]["KHR_materials_emissive_strength"] = {"emissiveStrength": strength}
            self.extensions.add("KHR_materials_emissive_strength")
        self.doc["materials"].append(m)
        return len(self.doc["materials"]) - 1

    def node(self, matrix, **fields):
        self.doc["nodes"].append({"matrix": [matrix[r][c] for c in range(4) for r in range(4)], **fields})
        self.doc["scenes"][0]["nodes"].append(len(self.doc["nodes"]) - 1)

    def mesh(self, name, mesh, matrix, material):
        lo, hi = ([f(p[i] for p in mesh.positions) for i in range(3)] for f in (min, max))
        a = {"POSITION": self.accessor(mesh.positions, "VEC3", 5126, min=lo, max=hi)}
        if mesh.normals: a["NORMAL"] = self.accessor(mesh.normals, "VEC3", 5126)
        if mesh.uv: a["TEXCOORD_0"] = self.accessor(mesh.uv, "VEC2", 5126)
        indices = self.accessor([i for t in mesh.triangles for i in t], "SCALAR", 5125)
        self.doc["meshes"].append({"name": name, "primitives": [{"attributes": a, "indices": indices, "material": material}]})
        self.node(matrix, name=name, mesh=len(self.doc["meshes"]) - 1)

    def sphere_light(self, name, centre, radius, radiance):
        self.node(translation(centre), name=name, extras={"gobo_light": {"type": "sphere", "radius": radius, "radiance": list(radiance)}})

    def punctual(self, name, kind, matrix, colour, **extra):
        strength = max(colour) or 1.0
        self.lights.append({"type": kind, "name": name, "color": [c / strength for c in colour], "intensity": strength, **extra})
        self.extensions.add("KHR_lights_punctual")
        self.node(matrix, name=name, extensions={"KHR_lights_punctual": {"light": len(self.lights) - 1}})

    def camera(self, matrix, xfov_degrees, width, height):
        """matrix: columns image-right, up, forward; glTF looks along -z."""
        yfov = 2 * math.atan(math.tan(math.radians(xfov_degrees) / 2) * height / width)
        self.doc["cameras"].append({"type": "perspective", "perspective": {"yfov": yfov, "znear": 0.01, "aspectRatio": width / height}})
        self.node(multiply(matrix, scaling((1, 1, -1))), name="camera", camera=len(self.doc["cameras"]) - 1)

    def write(self, path):
        doc = {k: v for k, v in self.doc.items() if v != []}
        if self.lights: doc["extensions"] = {"KHR_lights_punctual": {"lights": self.lights}}
        if self.extensions: doc["extensionsUsed"] = sorted(self.extensions)
        doc["buffers"] = [{"byteLength": len(self.blob)}]
        text = json.dumps(doc).encode()
        text += b" " * (-len(text) % 4)
        with open(path, "wb") as f:
            f.write(struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(text) + 8 + len(self.blob)))
            f.write(struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(self.blob), b"BIN\0") + self.blob)
