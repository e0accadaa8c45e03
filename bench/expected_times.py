#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""What `gobo plan` expects beside what the render then takes: bench/expected_times.py BUILD [--size WxH] [--json FILE] [SCENE...].

For each scene and each of several ways to render it, on a daemon of its own each time: planned by a daemon that has rendered nothing; by one that has rendered
another scene, in all of these ways; and by one that has rendered a quarter of this picture from elsewhere, in this way. The ratio of the larger time to the
lesser one, whichever it is: median and worst of each column, and the rows. Acceleration structures are there (a depth picture is rendered before). Reports;
decides nothing."""
import argparse
import json
import math
import pathlib
import statistics
import sys

ONCE = {"integrator.max_bounces": 1, "integrator.indirect": False}
WAYS = {
    "paths": (16, {}),
    "shadow rays": (16, {**ONCE, "shadows.ray_traced.samples": 4}),
    "soft map": (4, {**ONCE, "shadows.percentage_closer_soft.filter_taps": 32}),
    "hard map": (4, {**ONCE, "shadows.percentage_closer.taps": 3}),
    "filtered": (16, {**ONCE, "shadows.axis_aligned.mean_samples": 8}),
    "denoised": (8, {}),
    "first hits": (1, None),
}


def fields(scene, way, size, moved):
    spp, settings = WAYS[way]
    out = {"size": size, "seed": 7 if moved else 1}
    if settings is None:
        out["outputs"] = ["depth", "normal"]
    else:
        out["set"] = settings
    if way == "denoised":
        out["denoise"] = "auto"
    return {**out, "spp": spp}


def ratio(expected, took):
    return math.exp(abs(math.log(max(expected, 1e-3) / max(took, 1e-3))))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("build")
    parser.add_argument("scenes", nargs="*", default=["atrium", "spheres", "lights8", "fence", "trees"])
    parser.add_argument("--size", default="480x360")
    parser.add_argument("--other", default="cornell", help="the other scene")
    parser.add_argument("--json", type=pathlib.Path)
    options = parser.parse_args()
    sys.path.insert(0, f"{options.build}/clients/python")
    import gobo

    size = tuple(int(n) for n in options.size.split("x"))
    quarter = tuple(max(1, n // 2) for n in size)
    rows = []
    print("scene | way | took ms | expected ms: nothing known | other scene | this scene")
    for scene in options.scenes:
        for way in WAYS:
            expected = []
            for known in ("nothing", "other", "this"):
                with gobo.local(gobod=f"{options.build}/server/gobod") as client:
                    client.render(scene, size=(64, 48), outputs=["depth"])
                    if known == "other":
                        for each in WAYS:
                            client.render(options.other, **fields(options.other, each, size, False))
                    elif known == "this":
                        client.render(scene, **fields(scene, way, quarter, True))
                    expected.append(client.plan(scene, **fields(scene, way, size, False)).ms)
                    if known == "nothing":
                        reply = client.render(scene, **fields(scene, way, size, False)).reply
                        took = reply.total_ms - reply.queue_ms
            rows.append({"scene": scene, "way": way, "took": took, "expected": expected})
            print(f"{scene} | {way} | {took:.0f} | " + " | ".join(f"{e:.0f}" for e in expected), flush=True)
    for i, known in enumerate(("nothing known", "other scene", "this scene")):
        off = sorted(ratio(r["expected"][i], r["took"]) for r in rows)
        print(f"{known}: {statistics.median(off):.2f} times off (median of {len(off)}), {off[int(0.9 * (len(off) - 1))]:.2f} (of nine in ten), {off[-1]:.2f} at worst")
    if options.json:
        options.json.parent.mkdir(parents=True, exist_ok=True)
        options.json.write_text(json.dumps(rows))


if __name__ == "__main__":
    main()
