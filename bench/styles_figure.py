#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""One shadow in many styles: the figure of README.md.

    python3 bench/styles_figure.py docs/images/styles.jpg     with GOBO_CLI as the program (build/clients/gobo)

Each picture is `gobo render tentacles --local` under a point light, with the options printed.
"""
import os
import subprocess
import sys
import tempfile

import OpenImageIO as oiio

STYLE = "shadows.style."
STYLES = {
    "the shadow itself": [],
    "softness 0.5": ["softness=0.5"],
    "softness 0.6 distance": ["softness=0.6*distance"],
    "brightness 0.5": ["brightness=0.5"],
    "brightness by distance": ["brightness=0.9*smoothstep(0, 2.5, distance)"],
    "inflation 0.15": ["inflation=0.15"],
    "inflation -0.1": ["inflation=-0.1"],
    "abstraction 0.15": ["abstraction=0.15", "softness=0.05"],
    "power 2": ["power=2", "softness=0.6"],
    "staircase": ["softness=0.8", "transition=STAIRCASE", "steps=3"],
    "a curve of one's own": ["softness=0.8", "transition=CURVE", "curve=0,0.6,0.2,0.9,0.5,1"],
    "elongation 0.6": ["elongation=0.6"],
    "target 1, ellipses": ["target=1"],
    "target 0.8, rectangles": ["target=0.8", "angularity=1"],
    "inflation -0.15, keep 0.5": ["inflation=-0.15", "keep=0.5"],
    "umbra and penumbra": ["layers[0].inflation=0.25", "layers[0].softness=0.3", "layers[0].brightness=0.3", "layers[0].weight=0.7"],
    "bands of the edge": ["inflation=1e9", "brightness=edge > 0.4 ? 1 : 0.6 + 0.4*cos(15*edge)"],
    "hatching": ["softness=0.4", "pattern=HATCHING", "pattern_px=5"],
    "crossed": ["softness=1.2", "inflation=0.2", "pattern=CROSS_HATCHING", "pattern_px=6", "pattern_deg=20"],
    "stippling": ["softness=1.2", "inflation=0.2", "pattern=STIPPLING", "pattern_px=4"],
}
WIDTH, HEIGHT, COLUMNS = 256, 170, 5
SCENE = ["tentacles", "--local", "--size", f"{WIDTH}x{HEIGHT}", "--spp", "16"]
for edit in ("lights.key.enabled=false", "lights.lamp.kind=POINT", "lights.lamp.position=2.5,5,1.5", "lights.lamp.intensity=110", "integrator.max_bounces=1",
             "environment.constant=0.25,0.27,0.32", "shadows.ray_traced.samples=1", "tone_map.exposure=0"):
    SCENE += ["--set", edit]


def option(edit: str) -> list:
    """A number, or a formula where it reads a name."""
    formula = any(name in edit.split("=", 1)[1] for name in ("distance", "edge"))
    return ["--formula" if formula else "--set", STYLE + edit]


def main() -> None:
    sheet = oiio.ImageBuf(oiio.ImageSpec(COLUMNS * WIDTH, -(-len(STYLES) // COLUMNS) * HEIGHT, 3, "uint8"))
    with tempfile.TemporaryDirectory() as folder:
        picture = os.path.join(folder, "one.png")
        for k, (title, edits) in enumerate(STYLES.items()):
            style = sum((option(e) for e in edits), [])
            print(f"{title}: {' '.join(style)}", flush=True)
            subprocess.run([os.environ.get("GOBO_CLI", "build/clients/gobo"), "render", *SCENE, *style, "-q", "-o", picture], check=True)
            oiio.ImageBufAlgo.paste(sheet, k % COLUMNS * WIDTH, k // COLUMNS * HEIGHT, 0, 0, oiio.ImageBuf(picture))
    sheet.specmod().attribute("CompressionQuality", 92)
    if not sheet.write(sys.argv[1]):
        sys.exit(sheet.geterror())


if __name__ == "__main__":
    main()
