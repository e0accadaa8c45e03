#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
# Mitsuba scene (the part of it that glTF can say) to GLB, and the matching request fields on standard output, one path=value a line.
#   mitsuba.py SCENE.xml OUT.glb [--exact] [--size=WxH]
# --exact: surfaces that are only near become magenta too. --size: of the picture, where the reference has another than the file.
# Exact: diffuse surfaces, textures, area, point, directional and spot lights, constant and map environments, perspective cameras.
# Near, and said on standard error: rough conductors (Schlick's Fresnel with the same F0; Beckmann read as GGX), rough plastic (glTF's
# coupling of diffuse and specular light), smooth plastic and conductors. Surfaces that glTF cannot say become magenta and are named
# as left out; any other thing that cannot be said ends the program with its name.
import math, os, sys
import xml.etree.ElementTree as xml

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import glb

near, environment, exact = set(), [], "--exact" in sys.argv


def numbers(text):
    return [float(t) for t in text.replace(",", " ").split()]


class Converter:
    def __init__(self, path):
        self.folder = os.path.dirname(os.path.abspath(path))
        self.paths, self.values, self.bsdfs, self.out = [self.folder], {}, {}, glb.Glb()
        self.width = self.height = 0
        self.depth = -1
        self.read(xml.parse(path).getroot())

    def text(self, s):
        return self.values.get(s[1:], s) if s.startswith("$") else s

    def file(self, name):
        for p in self.paths:
            if os.path.exists(os.path.join(p, name)): return os.path.join(p, name)
        raise SystemExit(f"no file {name}")

    def field(self, node, names, tags=("float", "integer", "string", "rgb", "boolean", "point", "vector", "texture", "spectrum")):
        for child in node:
            if child.tag in tags and child.get("name") in names: return child
        return None

    def number(self, node, names, otherwise):
        f = self.field(node, names)
        return otherwise if f is None else float(self.text(f.get("value")))

    def colour(self, node, names, otherwise):
        f = self.field(node, names)
        if f is None: return otherwise
        if f.tag in ("rgb", "float"):
            v = numbers(self.text(f.get("value")))
            return v * 3 if len(v) == 1 else v
        raise SystemExit(f"a {f.tag} for {names[0]}")

    def matrix(self, node):
        m = glb.IDENTITY
        t = next((c for c in node if c.tag == "transform" and c.get("name") in ("to_world", "toWorld", "to_uv")), None)
        for s in t if t is not None else []:
            xyz = lambda otherwise: numbers(s.get("value")) if s.get("value") else [float(s.get(k, otherwise)) for k in "xyz"]
            if s.tag == "matrix":
                v = numbers(s.get("value"))
                step = [v[4 * i:4 * i + 4] for i in range(4)]
            elif s.tag == "lookat": step = glb.look_at(*(numbers(s.get(k)) for k in ("origin", "target", "up")), 1)
            elif s.tag == "translate": step = glb.translation(xyz(0))
            elif s.tag == "scale":
                v = xyz(1)
                step = glb.scaling(v * 3 if len(v) == 1 else v)
            elif s.tag == "rotate": step = glb.rotation([float(s.get(k, 0)) for k in "xyz"], float(s.get("angle")))
            else: raise SystemExit(f"transform {s.tag}")
            m = glb.multiply(step, m)
        return m

    def read(self, root):
        for node in root:
            name = node.tag
            if name == "default": self.values.setdefault(node.get("name"), node.get("value"))
            elif name == "path": self.paths.append(os.path.normpath(os.path.join(self.folder, node.get("value"))))
            elif name == "include": self.read(xml.parse(self.file(node.get("filename"))).getroot())
            elif name == "integrator": self.integrator(node)
            elif name == "sensor": self.sensor(node)
            elif name == "bsdf": self.bsdfs[node.get("id")] = node
            elif name == "shape": self.shape(node)
            elif name == "emitter": self.emitter(node)
            else: raise SystemExit(f"element {name}")

    def integrator(self, node):
        kind = self.text(node.get("type"))
        for child in node:
            if child.tag == "integrator": return self.integrator(child)
        self.depth = int(self.number(node, ("max_depth", "maxDepth"), 2 if kind == "direct" else -1))

    def sensor(self, node):
        film = next(c for c in node if c.tag == "film")
        self.width, self.height = (int(self.number(film, (k,), 0)) for k in ("width", "height"))
        for a in sys.argv:
            if a.startswith("--size="): self.width, self.height = map(int, a[7:].split("x"))
        # Without an angle: a 50 mm lens before 36 x 24 mm film, counted along the diagonal.
        lens = math.hypot(36, 24) / 100 / math.hypot(1, self.height / self.width)
        fov = self.number(node, ("fov",), math.degrees(2 * math.atan(lens)))
        # Mitsuba's x points to the left of the picture.
        self.out.camera(glb.multiply(self.matrix(node), glb.scaling((-1, 1, 1))), fov, self.width, self.height)

    def conductor(self, node):
        if any(f is not None and f.tag == "spectrum" for f in (self.field(node, (n,)) for n in ("eta", "k"))): return None
        eta, k = (self.colour(node, (n,), None) for n in ("eta", "k"))
        tint = self.colour(node, ("specular_reflectance", "specularReflectance"), [1, 1, 1])
        material = self.field(node, ("material",))
        if eta is None: return tint if material is not None and material.get("value") == "none" else None
        return [t * ((e - 1) ** 2 + q * q) / ((e + 1) ** 2 + q * q) for t, e, q in zip(tint, eta, k)]

    def material(self, shape, emission):
        node = next((c for c in shape if c.tag == "bsdf"), None)
        if node is None:
            ref = next((c for c in shape if c.tag == "ref" and c.get("id") in self.bsdfs), None)
            node = self.bsdfs[ref.get("id")] if ref is not None else xml.fromstring('<bsdf type="diffuse"/>')
        double = node.get("type") == "twosided"
        if double: node = next(c for c in node if c.tag == "bsdf")
        kind = node.get("type")
        fields = dict(emission=emission, double_sided=double and not emission)
        name = f"{kind}{len(self.out.doc['materials'])}"
        if kind != "diffuse" and exact: kind = kind + " (--exact)"
        if kind in ("diffuse", "roughplastic", "plastic"):
            names = ("reflectance", "diffuse_reflectance", "diffuseReflectance")
            texture = self.field(node, names, ("texture",))
            if texture is not None:
                if texture.get("type") != "bitmap": raise SystemExit(f"texture {texture.get('type')}")
                get = lambda keys, o: (lambda f: o if f is None else f.get("value"))(self.field(texture, keys))
                m = self.matrix(texture)
                fields["texture"] = self.out.texture(self.file(get(("filename",), "")), get(("wrap_mode", "wrapMode"), "repeat"),
                                                     get(("filter_type", "filterType"), "bilinear") == "nearest")
                if m != glb.IDENTITY: fields["uv_scale"], fields["uv_offset"] = [m[0][0], m[1][1]], [m[0][3], m[1][3]]
            else: fields["colour"] = self.colour(node, names, [0.5] * 3)
            if kind != "diffuse":
                near.add(kind)
                fields.update(specular=1.0, roughness=math.sqrt(self.number(node, ("alpha",), 0.1)) if kind == "roughplastic" else 0.0)
        elif kind in ("roughconductor", "conductor") and self.conductor(node) and self.field(node, ("alpha_u",)) is None:
            near.add(kind + " with Schlick's Fresnel")
            distribution = self.field(node, ("distribution",))
            if kind == "roughconductor" and (distribution is None or distribution.get("value") != "ggx"): near.add("Beckmann read as GGX")
            fields.update(colour=self.conductor(node), metallic=1.0, roughness=math.sqrt(self.number(node, ("alpha",), 0.1)) if kind == "roughconductor" else 0.0)
        elif kind == "dielectric" and self.field(node, ("int_ior", "intIOR")).tag == "float":
            fields.update(specular=1.0, roughness=0.0, glass=self.number(node, ("int_ior", "intIOR"), 1.5))
        else:
            near.add(f"{kind} left out (magenta)")
            fields["colour"] = [1, 0, 1]
        return self.out.material(name, **fields)

    def shape(self, node):
        kind, m, name = node.get("type"), self.matrix(node), f"shape{len(self.out.doc['nodes'])}"
        emitter = next((c for c in node if c.tag == "emitter"), None)
        emission = self.colour(emitter, ("radiance",), [1, 1, 1]) if emitter is not None else None
        if kind == "sphere":
            if emission is None: raise SystemExit("a sphere that is no light")
            centre, radius = self.field(node, ("center",)), self.number(node, ("radius",), 1)
            return self.out.sphere_light(name, [float(centre.get(k)) for k in "xyz"], radius, emission)
        if kind == "disk":
            n = 256
            points = [(0, 0, 0)] + [(math.cos(2 * math.pi * i / n), math.sin(2 * math.pi * i / n), 0) for i in range(n)]
            mesh = glb.Mesh(points, [(0, 1 + i, 1 + (i + 1) % n) for i in range(n)])
        elif kind in ("obj", "ply"):
            flat = self.field(node, ("face_normals", "faceNormals"))
            path = self.file(self.field(node, ("filename",)).get("value"))
            mesh = glb.read_obj(path, flat is not None and flat.get("value") == "true") if kind == "obj" else glb.read_ply(path)
        elif kind in ("rectangle", "cube"): mesh = getattr(glb, kind)()
        else: raise SystemExit(f"shape {kind}")
        self.out.mesh(name, mesh, m, self.material(node, emission))

    def emitter(self, node):
        kind, name = node.get("type"), f"light{len(self.out.lights)}"
        if kind == "directional":
            d = numbers(self.field(node, ("direction",)).get("value"))
            up = [0, 1, 0] if abs(d[1]) < 0.9 * math.sqrt(sum(c * c for c in d)) else [1, 0, 0]
            m = glb.multiply(glb.look_at([0, 0, 0], d, up, 1), glb.scaling((-1, 1, -1)))
            self.out.punctual(name, "directional", m, self.colour(node, ("irradiance",), [1, 1, 1]))
        elif kind == "point":
            p = self.field(node, ("position",))
            m = glb.translation([float(p.get(k, 0)) for k in "xyz"]) if p is not None else self.matrix(node)
            self.out.punctual(name, "point", m, self.colour(node, ("intensity",), [1, 1, 1]))
        elif kind == "constant":
            environment.append("environment.constant=" + ",".join(f"{c:.9g}" for c in self.colour(node, ("radiance",), [1, 1, 1])))
        elif kind == "envmap":
            environment.append("environment.path=" + self.file(self.field(node, ("filename",)).get("value")))
            environment.append("environment.rotation_deg=-90")
        else: raise SystemExit(f"emitter {kind}")


if __name__ == "__main__":
    c = Converter(sys.argv[1])
    c.out.write(sys.argv[2])
    for line in sorted(near): print("near:", line, file=sys.stderr)
    # Depth counts segments there, scattering events after the first here.
    print(f"width={c.width}\nheight={c.height}\nintegrator.max_bounces={min(64, max(0, c.depth - 2)) if c.depth >= 0 else 64}")
    for line in environment: print(line)
