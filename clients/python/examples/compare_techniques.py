#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Shadow techniques for one area light: what each costs and how far it is from the path-traced truth.

    PYTHONPATH=build/clients/python clients/python/examples/compare_techniques.py grids --local
"""
import argparse

import numpy as np

import gobo

parser = argparse.ArgumentParser(description="compare shadow techniques")
parser.add_argument("scene", nargs="?", default="grids")
parser.add_argument("--size", type=int, nargs=2, default=(160, 120))
parser.add_argument("--reference-spp", type=int, default=512)
parser.add_argument("--local", action="store_true", help="start a private gobod")
args = parser.parse_args()

with gobo.connect(start=args.local) as client:
    scene = client.scenes.open(args.scene)
    common = dict(size=args.size, outputs="direct", integrator={"max_bounces": 0})
    # Two independent halves: their mean is the reference, their difference says how far that may be trusted.
    halves = [client.render(scene, spp=args.reference_spp // 2, seed=seed, shadows="path_traced", **common).image for seed in (1, 2)]
    truth = (halves[0] + halves[1]) / 2
    noise = np.sqrt(np.mean((halves[0] - halves[1]) ** 2)) / 2
    print(f"{'technique':24}{'ms':>10}{'rays':>12}{'RMSE':>10}")
    for name, shadows in {
        "ray traced, 4 rays": {"ray_traced": {"samples": 4}},
        "ray traced, 64 rays": {"ray_traced": {"samples": 64}},
        "axis-aligned filter": {"axis_aligned": {"k": 3}},
        "path traced, 64 spp": "path_traced",
    }.items():
        client.drop_caches()      # so that each pays for everything it needs
        r = client.render(scene, spp=64, shadows=shadows, **common)
        print(f"{name:24}{r.total_ms:10.1f}{r.rays:12d}{np.sqrt(np.mean((r.image - truth) ** 2)):10.4f}")
    print(f"{'(noise of the reference)':46}{noise:10.4f}")
