#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
# How far a picture changes when its whole scene is moved along (1, 1, 1) or scaled: model, camera, floor and lights hang below one node, whose
# translation or scale changes; intensities of point lights grow with the square of the scale. Prints the RMSE against the scene at the origin,
# same seed and samples.
#   far_from_origin.py [MODEL ...] [--models FOLDER] [--gobo PROGRAM]      default: Box Duck MetalRoughSpheresNoTextures
import argparse, base64, json, math, os, shutil, struct, subprocess, tempfile

MOVED, SCALED = (1, 1e3, 1e4, 1e5, 1e6), (1e-3, 1e-2, 1e2, 1e3)
DIRECT = ["--set", "integrator.indirect=false"]
TECHNIQUES = {"path tracer": ["--set", "integrator.max_bounces=4"], "direct, path traced": DIRECT,
              "ray_traced": DIRECT + ["--set", "shadows.ray_traced.samples=4"],
              "variance": DIRECT + ["--set", "shadows.variance=", "--set", "shadows.map.resolution=256"],
              "percentage_closer": DIRECT + ["--set", "shadows.percentage_closer=", "--set", "shadows.map.resolution=256"]}


def model_file(folder, name):
    for path, _, files in sorted(os.walk(os.path.join(folder, name))):
        for f in files:
            if f.endswith(".gltf") and not any(w in path for w in ("Draco", "Quantized", "Embedded")):
                return os.path.join(path, f)
    raise SystemExit(f"no model {name} under {folder}")


def ask(gobo, *words):
    done = subprocess.run([gobo, *words], capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{' '.join(words)}\n{done.stderr}")
    return json.loads(done.stdout)


def turned_down(degrees):
    half = math.radians(degrees) / 2
    return [-math.sin(half), 0, 0, math.cos(half)]


def write(source, folder, out, bounds, move, scale):
    """The model below a node that moves it, with camera, lights and floor of its size."""
    doc = json.load(open(source))
    for item in doc.get("buffers", []) + doc.get("images", []):
        if not item.get("uri", "data:").startswith("data:"):
            shutil.copy(os.path.join(os.path.dirname(source), item["uri"]), folder)
    (x, y, z), r = bounds
    lights = doc.setdefault("extensions", {}).setdefault("KHR_lights_punctual", {}).setdefault("lights", [])
    lights += [{"type": "point", "name": "key", "intensity": 40 * r * r * scale * scale}, {"type": "directional", "name": "sun", "intensity": 2}]
    doc.setdefault("extensionsUsed", []).append("KHR_lights_punctual")
    doc.setdefault("cameras", []).append({"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.01}})
    half = 4 * r
    raw = struct.pack("<12f6H", -half, 0, -half, half, 0, -half, half, 0, half, -half, 0, half, 0, 2, 1, 0, 3, 2)
    doc["buffers"].append({"byteLength": len(raw), "uri": "data:application/octet-stream;base64," + base64.b64encode(raw).decode()})
    buffer, views, accessors = len(doc["buffers"]) - 1, doc["bufferViews"], doc["accessors"]
    views += [{"buffer": buffer, "byteLength": 48}, {"buffer": buffer, "byteOffset": 48, "byteLength": 12}]
    accessors += [{"bufferView": len(views) - 2, "componentType": 5126, "count": 4, "type": "VEC3", "min": [-half, 0, -half], "max": [half, 0, half]},
                  {"bufferView": len(views) - 1, "componentType": 5123, "count": 6, "type": "SCALAR"}]
    doc["meshes"].append({"primitives": [{"attributes": {"POSITION": len(accessors) - 2}, "indices": len(accessors) - 1}]})
    nodes, scene = doc["nodes"], doc["scenes"][doc.get("scene", 0)]
    light = lambda k: {"extensions": {"KHR_lights_punctual": {"light": k}}}
    first = len(nodes)
    nodes += [{"name": "far", "camera": len(doc["cameras"]) - 1, "translation": [x, y, z + 2.6 * r]},
              {"name": "key", "translation": [x + 1.2 * r, y + 1.5 * r, z + 1.6 * r], **light(len(lights) - 2)},
              {"name": "sun", "rotation": turned_down(60), **light(len(lights) - 1)},
              {"name": "floor", "mesh": len(doc["meshes"]) - 1, "translation": [x, y - r, z]},
              {"name": "moved", "translation": [move] * 3, "scale": [scale] * 3, "children": scene["nodes"] + list(range(first, first + 4))}]
    scene["nodes"] = [first + 4]
    json.dump(doc, open(out, "w"))


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("model", nargs="*", default=["Box", "Duck", "MetalRoughSpheresNoTextures"])
    parser.add_argument("--models", default="../shared/data/gltf/khronos")
    parser.add_argument("--gobo", default="build/clients/gobo")
    options = parser.parse_args()
    gobo = os.path.abspath(options.gobo)
    places = [(0, s) for s in SCALED] + [(m, 1) for m in MOVED]
    print("| model | technique | " + " | ".join(f"moved {m:g} m" if m else f"scaled by {s:g}" for m, s in places) + " |")
    print("|---" * (2 + len(places)) + "|")
    for name in options.model:
        source = model_file(options.models, name)
        info = ask(gobo, "inspect", source, "--local", "--json")
        low, high = ([info[k].get(c, 0) for c in "xyz"] for k in ("bounds_min", "bounds_max"))
        bounds = [(a + b) / 2 for a, b in zip(low, high)], max(b - a for a, b in zip(low, high)) / 2
        with tempfile.TemporaryDirectory() as folder:
            def picture(move, scale, technique):
                gltf, out = os.path.join(folder, f"{move:g}_{scale:g}.gltf"), os.path.join(folder, f"{move:g}_{scale:g}_{technique}.exr")
                write(source, folder, gltf, bounds, move, scale)
                ask(gobo, "render", gltf, "-o", out, "--local", "--json", "--size", "96x72", "--spp", "64", "--camera", "far", *TECHNIQUES[technique])
                return out
            for technique in TECHNIQUES:
                origin, row = picture(0, 1, technique), []
                for move, scale in places:
                    got = ask(gobo, "compare", origin, picture(move, scale, technique), "--json")
                    row.append(f"{got['rmse']:.2g}")
                print(f"| {name} | {technique} | " + " | ".join(row) + " |", flush=True)


if __name__ == "__main__":
    main()
