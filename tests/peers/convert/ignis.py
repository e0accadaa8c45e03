#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
# Ignis evaluation scene (the part of it that glTF can say) to GLB, and the matching request fields on standard output.
#   ignis.py SCENE.json OUT.glb
import json, math, os, sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import glb


def load(path):
    scene = json.load(open(path))
    for e in scene.pop("externals", []):
        base = load(os.path.join(os.path.dirname(path), e["filename"]))
        for k, v in base.items():
            scene[k] = v + scene.get(k, []) if isinstance(v, list) else scene.get(k, v)
    return scene


def matrix(t):
    if t is None: return glb.IDENTITY
    if isinstance(t, dict): t = [t]
    if isinstance(t[0], (int, float)):
        if len(t) == 9: return [[*t[0:3], 0], [*t[3:6], 0], [*t[6:9], 0], [0, 0, 0, 1]]
        return [t[4 * i:4 * i + 4] for i in range(4)]
    m = glb.IDENTITY
    for s in t:
        (kind, v), = s.items()
        if kind == "lookat":
            target = v["target"] if "target" in v else [a + b for a, b in zip(v["origin"], v["direction"])]
            step = glb.look_at(v["origin"], target, v["up"], 1)
        elif kind == "translate": step = glb.translation(v)
        elif kind == "scale": step = glb.scaling(v if isinstance(v, list) else [v] * 3)
        else: raise SystemExit(f"transform {kind}")
        m = glb.multiply(m, step)
    return m


def main(path, out_path):
    scene, folder, out, lines = load(path), os.path.dirname(os.path.abspath(path)), glb.Glb(), []
    width, height = (int(v) for v in scene["film"]["size"])
    camera = scene["camera"]
    # Ignis looks along +z with x to the right of the picture.
    out.camera(glb.multiply(matrix(camera.get("transform")), glb.scaling((-1, 1, 1))), camera["fov"], width, height)
    shapes = {s["name"]: s for s in scene["shapes"]}
    bsdfs = {b["name"]: b for b in scene["bsdfs"]}
    area = {l["entity"]: l["radiance"] for l in scene["lights"] if l["type"] == "area"}
    triple = lambda v: [v] * 3 if isinstance(v, (int, float)) else v[:3]
    for e in scene["entities"]:
        shape, bsdf = shapes[e["shape"]], bsdfs[e["bsdf"]]
        if bsdf["type"] != "diffuse" or isinstance(bsdf["reflectance"], str): raise SystemExit(f"bsdf {bsdf['type']}")
        if shape["type"] in ("sphere", "icosphere", "uvsphere") and e["name"] in area:
            m = glb.multiply(matrix(e.get("transform")), matrix(shape.get("transform")))
            centre = [sum(m[r][c] * (*shape.get("center", [0, 0, 0]), 1)[c] for c in range(4)) for r in range(3)]
            out.sphere_light(e["name"], centre, shape.get("radius", 1) * math.hypot(*(m[r][0] for r in range(3))), triple(area[e["name"]]))
            continue
        file = os.path.join(folder, shape.get("filename", ""))
        if shape["type"] not in ("obj", "ply"): raise SystemExit(f"shape {shape['type']}")
        mesh = glb.read_obj(file) if shape["type"] == "obj" else glb.read_ply(file)
        emission = triple(area[e["name"]]) if e["name"] in area else None
        material = out.material(bsdf["name"], triple(bsdf["reflectance"]), emission=emission, double_sided=not emission)
        out.mesh(e["name"], mesh, glb.multiply(matrix(e.get("transform")), matrix(shape.get("transform"))), material)
    for l in scene["lights"]:
        if l["type"] == "point": out.punctual(l["name"], "point", glb.translation(l["position"]), triple(l["intensity"]))
        elif l["type"] == "env" and l.get("radiance") == "env":
            texture = next(t for t in scene["textures"] if t["name"] == "env")
            lines.append("environment.path=" + os.path.normpath(os.path.join(folder, texture["filename"])))
            lines.append("environment.gain=" + ",".join([str(l.get("scale", 1))] * 3))
        elif l["type"] == "constant": lines.append("environment.constant=" + ",".join(f"{c:.9g}" for c in triple(l["radiance"])))
        elif l["type"] != "area": raise SystemExit(f"light {l['type']}")
    out.write(out_path)
    print(f"width={width}\nheight={height}\nintegrator.max_bounces={max(0, scene['technique']['max_depth'] - 2)}")
    for l in lines: print(l)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
