#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""A durable job of several frames: submit, watch, fetch. Stop this program or the daemon in between and run it again with the
same --key: it finds its job and goes on.

    PYTHONPATH=build/clients/python clients/python/examples/batch_job.py cornell --frames 0 4 --key tonight -o out/job
"""
import argparse
import tempfile

import gobo

parser = argparse.ArgumentParser(description="batch job with progress")
parser.add_argument("scene", nargs="?", default="cornell")
parser.add_argument("-o", "--out", default="out/job")
parser.add_argument("--frames", type=int, nargs=2, default=(0, 3))
parser.add_argument("--size", type=int, nargs=2, default=(320, 240))
parser.add_argument("--spp", type=int, default=64)
parser.add_argument("--key", default=None)
parser.add_argument("--local", action="store_true", help="start a private gobod; its jobs end with it")
args = parser.parse_args()

jobs_folder = tempfile.TemporaryDirectory(prefix="gobo-jobs-")
with gobo.local(jobs=jobs_folder.name) if args.local else gobo.connect() as client:
    job = client.jobs.submit(args.scene, frames=tuple(args.frames), name="example", key=args.key, size=args.size, spp=args.spp)
    print(f"job {job.id}")
    for state in job.watch():
        if state.changed is None or state.changed.state == "done":
            print(f"{state.progress:4.0%}  {state.state}  {state.frames_done} of {state.frames_total} frames")
    job.wait()                    # raises if it failed
    for path in job.fetch(args.out):
        print(path)
    for frame, image in job.images():
        print(f"frame {frame}: mean {image.mean():.4f}")
