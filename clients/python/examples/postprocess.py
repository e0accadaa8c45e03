#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Pictures are numpy arrays: fog from the depth, a glow around what is bright, a change of white balance without rendering.

    PYTHONPATH=build/clients/python clients/python/examples/postprocess.py cornell --local -o out/post.exr
"""
import argparse

import numpy as np

import gobo

parser = argparse.ArgumentParser(description="numpy post-processing")
parser.add_argument("scene", nargs="?", default="cornell")
parser.add_argument("-o", "--out", default="post.exr")
parser.add_argument("--size", type=int, nargs=2, default=(320, 240))
parser.add_argument("--spp", type=int, default=64)
parser.add_argument("--local", action="store_true", help="start a private gobod")
args = parser.parse_args()


def blur(image: np.ndarray, sigma: float) -> np.ndarray:
    """Separable Gaussian; the edge is repeated."""
    radius = int(3 * sigma)
    weights = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma) ** 2)
    weights /= weights.sum()
    for axis in (0, 1):
        padded = np.pad(image, [(radius, radius) if a == axis else (0, 0) for a in range(3)], mode="edge")
        image = sum(w * np.take(padded, range(i, i + image.shape[axis]), axis) for i, w in enumerate(weights))
    return image


with gobo.connect(start=args.local) as client:
    r = client.render(args.scene, size=args.size, spp=args.spp, outputs=["beauty", "depth", "albedo"])

beauty, depth = r.image, r.outputs["depth"]
seen = np.isfinite(depth) & (depth > 0)
reach = np.percentile(depth[seen], 90)
clear = np.where(seen, np.exp(-depth / (4 * reach)), 0)          # Beer-Lambert
foggy = beauty * clear + np.float32((0.5, 0.6, 0.7)) * 0.2 * (1 - clear)
glow = blur(np.maximum(foggy - 1, 0), args.size[1] / 60)
warm = (foggy + 0.3 * glow) * np.float32((1.1, 1.0, 0.85))
gobo.exr.write(args.out, {c: warm[:, :, i] for i, c in enumerate("RGB")}, {"gobo:request": str(r.request_hash)})
print(f"{args.out}: mean {beauty.mean():.4f} -> {warm.mean():.4f}, {seen.mean():.0%} of the pixels hold a surface")
