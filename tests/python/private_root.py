# SPDX-License-Identifier: Apache-2.0
"""Roots of their own for the tests of packages and of the image: what is installed there, and whether they may be left out here."""
import os
import subprocess
import tempfile
import unittest

BUILD = os.environ["GOBO_BUILD_FOLDER"]
FINISHED = ("server/gobod", "clients/gobo", "ingest/gobo-ingest", "renderer/libgobo_image_codec.so", "renderer/libgobo_color.so", "docs/gobo.1", "clients/python/gobo/v1/render_pb2.py", "CPackConfig.cmake")


def clean_environment(**more):
    """Nothing of the build folder may help."""
    return {**{k: v for k, v in os.environ.items() if not k.startswith(("GOBO_", "LD_", "PYTHON"))}, **more}


def run(command, code=0, **more):
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True, timeout=300, env=more.pop("env", clean_environment()), **more)
    if done.returncode != code:
        raise AssertionError(f"{' '.join(map(str, command))}: exit code {done.returncode}\n{done.stdout}{done.stderr}")
    return done.stdout


def need_build():
    missing = [f for f in FINISHED if not os.path.exists(os.path.join(BUILD, f))]
    if missing:
        raise unittest.SkipTest(f"the build folder is not finished: {missing[0]}")


def missing_here(why):
    """Skips, but not where CI says that this must be tried."""
    if os.environ.get("GOBO_REQUIRE_CONTAINER"):
        raise AssertionError(f"GOBO_REQUIRE_CONTAINER is set, but {why}")
    raise unittest.SkipTest(why)


def folder(case):
    """For a test class: temporary, and open to other users, whose processes read in it."""
    path = tempfile.TemporaryDirectory(prefix="gobo-root-")
    case.addClassCleanup(path.cleanup)
    os.chmod(path.name, 0o755)
    return path.name


def radiance(path):
    """A white map in a format that only the module of picture formats reads (renderer/base/image_codec.h)."""
    with open(path, "wb") as file:
        file.write(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 4\n" + bytes((128, 128, 128, 129)) * 8)
    return path
