#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
# The first picture of a model, with no option given: how bright is it to look at? Renders every valid glTF sample model to PNG and prints the mean display
# value (sRGB code / 255, of what covers the middle half of the picture and of all of it); 0.05 .. 0.85 is neither black nor burnt out.
# --all: every valid file (all forms of a model, the asset generator's positive ones, the two other models), at 48 x 48.
#   first_pictures.py [--all] [--models FOLDER] [--gobo PROGRAM] [--keep FOLDER]
import argparse, json, os, struct, subprocess, tempfile, zlib

import numpy as np


def read_png(path):
    """8-bit RGB or grey without interlace, as gobo writes it; rows x columns x channels in 0..1."""
    data, at, packed = open(path, "rb").read(), 8, b""
    while at < len(data):
        size, kind = struct.unpack(">I4s", data[at:at + 8])
        body = data[at + 8:at + 8 + size]
        at += 12 + size
        if kind == b"IHDR":
            width, height, _, colour = struct.unpack(">IIBB", body[:10])
        elif kind == b"IDAT":
            packed += body
    n = {0: 1, 2: 3, 4: 2, 6: 4}[colour]
    raw = np.frombuffer(zlib.decompress(packed), np.uint8).reshape(height, 1 + width * n)
    rows, above = [], np.zeros((width, n), np.int64)
    for line in raw:
        how, values = int(line[0]), line[1:].reshape(width, n).astype(np.int64)
        if how == 2:
            values = (values + above) & 255
        elif how:
            left, corner = np.zeros(n, np.int64), np.zeros(n, np.int64)
            for x in range(width):
                up = above[x]
                if how == 1:
                    guess = left
                elif how == 3:
                    guess = (left + up) // 2
                else:
                    p = left + up - corner
                    a, b, c = abs(p - left), abs(p - up), abs(p - corner)
                    guess = np.where((a <= b) & (a <= c), left, np.where(b <= c, up, corner))
                values[x] = (values[x] + guess) & 255
                left, corner = values[x], up
        rows.append(values)
        above = values
    return np.stack(rows) / 255.0


def models(folder):
    for name in sorted(os.listdir(folder)):
        found = sorted(os.path.join(path, f) for path, _, files in os.walk(os.path.join(folder, name)) for f in files
                       if f.endswith((".gltf", ".glb")) and not any(w in path for w in ("Draco", "Quantized", "Embedded", "Meshopt", "KTX")))
        if found:
            yield name, found[0]


def every(folder):
    for path, _, files in sorted(os.walk(folder)):
        parts = os.path.relpath(path, folder).split(os.sep)
        if parts[0] in ("invalid", "validator-corpus") or "Negative" in parts:
            continue
        for f in sorted(files):
            if f.endswith((".gltf", ".glb")):
                yield "/".join(parts[1:] + [f]) if len(parts) > 1 else f, os.path.join(path, f)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--models", default="../shared/data/gltf/khronos")
    parser.add_argument("--all", action="store_true", help="--models is then the folder above")
    parser.add_argument("--gobo", default="build/clients/gobo")
    parser.add_argument("--keep", help="pictures go here")
    options = parser.parse_args()
    bad = total = lit = exposed = refused = 0
    with tempfile.TemporaryDirectory() as scratch:
        side = 48 if options.all else 96
        for name, path in every(options.models) if options.all else models(options.models):
            out = os.path.join(options.keep or scratch, name.replace("/", "_") + ".png")
            done = subprocess.run([options.gobo, "--local", "--json", "render", path, "-o", out, "--size", f"{side}x{side}", "--spp", "16"], capture_output=True, text=True)
            if done.returncode:
                refused += 1
                print(f"{name:40} refused: {done.stderr.strip().splitlines()[-1][:100]}")
                continue
            reply = json.loads(done.stdout)
            warnings = " ".join(reply.get("warnings", []))
            pixels = read_png(out)
            whole, middle = pixels.mean(), pixels[side // 4:side * 3 // 4, side // 4:side * 3 // 4].mean()
            wrong = not 0.05 <= whole <= 0.85
            total, bad, lit = total + 1, bad + wrong, lit + ("STUDIO" in warnings)
            exposed += "tone_map.exposure" in warnings
            print(f"{name:40} {whole:5.2f} {middle:5.2f} {'studio' if 'STUDIO' in warnings else '':7} {'exposed' if 'tone_map.exposure' in warnings else '':8}{'<--' if wrong else ''}", flush=True)
    print(f"{total} models, {refused} refused, {lit} lit by the studio, {exposed} with an exposure that was chosen; {bad} with a mean display value outside 0.05 .. 0.85")


if __name__ == "__main__":
    main()
