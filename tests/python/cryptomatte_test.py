# SPDX-License-Identifier: Apache-2.0
"""Cryptomatte files as other programs read them: by OpenImageIO where it is installed and by numpy, with a hash of their own here; whole, in tiles, of a job."""
import json
import os
import unittest

import numpy as np

import gobo
from gobo import exr, image
from drake_form import read_png
from support import JobsTest


def murmur3(data):
    """MurmurHash3_x86_32, seed 0."""
    def mixed(block):
        block = block * 0xcc9e2d51 & 0xffffffff
        return (block << 15 | block >> 17) * 0x1b873593 & 0xffffffff
    h, whole = 0, len(data) & ~3
    for at in range(0, whole, 4):
        h ^= mixed(int.from_bytes(data[at:at + 4], "little"))
        h = ((h << 13 | h >> 19) * 5 + 0xe6546b64) & 0xffffffff
    if len(data) > whole:
        h ^= mixed(int.from_bytes(data[whole:], "little"))
    h ^= len(data)
    h = (h ^ h >> 16) * 0x85ebca6b & 0xffffffff
    h = (h ^ h >> 13) * 0xc2b2ae35 & 0xffffffff
    return h ^ h >> 16


def id_of(name):
    """As the specification's example code: the exponent clamped to 1 .. 254."""
    h = murmur3(name.encode())
    return h & 0x807fffff | min(max(h >> 23 & 255, 1), 254) << 23


def manifest(header, layer):
    key = f"cryptomatte/{murmur3(layer.encode()):08x}"[:len("cryptomatte/") + 7]
    assert header[key + "/name"] == layer and header[key + "/hash"] == "MurmurHash3_32" and header[key + "/conversion"] == "uint32_to_float32", header
    return json.loads(header[key + "/manifest"])


def matte(planes, layer, name):
    out = 0
    for rank in range(6):
        ids, coverage = (planes[f"{layer}{rank // 2:02d}.{c}"] for c in ("RG", "BA")[rank % 2])
        out = out + np.where(np.ascontiguousarray(ids).view(np.uint32) == id_of(name), coverage, 0)
    return out


class Cryptomatte(JobsTest):
    what = ("render", "spheres", "--size", "80x60", "--spp", "64", "-q")

    def test_the_hash_here_is_right(self):
        self.assertEqual(murmur3(b"bunny"), 0x13851a76)
        self.assertEqual(id_of("flowerA.flowerA_petal1.:1065"), 0x7f0e5296)

    def test_mattes_are_shares_of_object_ids(self):
        self.cli(*self.what, "--layers", "--outputs", "beauty,cryptomatte_object,cryptomatte_material,object_id", "--set", "view_samples=1", "-o", "all.exr")
        fine = self.client.render("spheres", width=80 * 16, height=60 * 16, spp=1, view_samples=1, outputs=["object_id", "material_id"]).outputs
        info = json.loads(self.cli("--json", "inspect", "spheres").stdout)
        readers = ["numpy"]
        try:
            import OpenImageIO  # noqa: F401
            readers.append("openimageio")
        except ImportError:
            pass
        self.addCleanup(exr.use)
        for reader in readers:
            exr.use(reader)
            planes, header = exr.read(self.path("all.exr"))
            names = manifest(header, "crypto_object")
            self.assertEqual(set(names), set(info["instance_names"]))
            for name, text in names.items():
                self.assertEqual(text, f"{id_of(name):08x}")
                index = list(info["instance_names"]).index(name)
                truth = (fine["object_id"][:, :, 0] == index).reshape(60, 16, 80, 16).mean((1, 3))
                found = matte(planes, "crypto_object", name)
                bound = 5 * np.sqrt(truth * (1 - truth) / 64) + 2 / 64
                self.assertTrue((np.abs(found - truth) <= bound).all(), f"{reader} {name}: {np.abs(found - truth).max()}")
                self.assertLess(abs(float(found.mean() - truth.mean())), 2e-3, name)
                whole = found == 1
                self.assertTrue((planes["object_id.X"][whole] == index).all(), name)
                self.assertGreater(int(whole.sum()), 5, name)
            everything = sum(matte(planes, "crypto_material", m) for m in manifest(header, "crypto_material"))
            nothing = (fine["object_id"][:, :, 0] < 0).reshape(60, 16, 80, 16).mean((1, 3))
            self.assertLess(float(np.abs(everything - 1 + nothing).mean()), 5e-3)

    def test_one_file_an_output_and_halves(self):
        self.cli(*self.what, "--half", "--outputs", "beauty,cryptomatte_material", "-o", "apart.exr")
        planes, header = exr.read(self.path("apart.cryptomatte_material.exr"))
        self.assertEqual(len(planes), 12)
        names = manifest(header, "crypto_material")
        self.assertGreater(max(float(matte(planes, "crypto_material", n).max()) for n in names), 0.99)
        self.assertFalse([k for k in exr.read(self.path("apart.beauty.exr"))[1] if k.startswith("cryptomatte/")])

    def test_tiles_are_one_cryptomatte_file(self):
        more = ("--outputs", "cryptomatte_object,beauty", "--layers")
        self.cli(*self.what, *more, "-o", "whole.exr")
        self.cli(*self.what, *more, "--tile", 32, "-o", "tiled.exr")
        (a, one), (b, other) = exr.read(self.path("whole.exr")), exr.read(self.path("tiled.exr"))
        self.assertEqual(manifest(one, "crypto_object"), manifest(other, "crypto_object"))
        self.assertEqual(set(a), set(b))
        for name in a:
            self.assertTrue((np.ascontiguousarray(a[name]).view(np.uint32) == np.ascontiguousarray(b[name]).view(np.uint32)).all(), name)

    def test_frames_of_a_job_have_it(self):
        job = self.cli("jobs", "submit", "spheres", "--frames", "1", "--size", "80x60", "--spp", "64", "--outputs", "cryptomatte_object").stdout.strip()
        self.cli("jobs", "watch", job)
        self.cli("jobs", "fetch", job, "-o", "frames")
        files = [os.path.join(at, f) for at, _, names in os.walk(self.path("frames")) for f in names if f.endswith(".exr")]
        self.assertEqual(len(files), 1, files)
        planes, header = exr.read(files[0])
        self.cli(*self.what, "--outputs", "cryptomatte_object", "-o", "alone.exr")
        self.assertEqual(manifest(header, "crypto_object"), manifest(exr.read(self.path("alone.exr"))[1], "crypto_object"))
        self.assertEqual(len(planes), 12)

    def test_arrays_pictures_and_refusals(self):
        r = self.client.render("spheres", width=80, height=60, spp=64, outputs=["cryptomatte_object"])
        ranks = r.outputs["cryptomatte_object"]
        self.assertEqual(ranks.shape, (60, 80, 12))
        self.assertEqual(r.channels["cryptomatte_object"][4], "crypto_object01.R")
        self.cli(*self.what, "--outputs", "cryptomatte_object", "-o", "shown.png")
        shown = image.shown(ranks, "cryptomatte_object").astype(int)
        with open(self.path("shown.png"), "rb") as file:
            width, height, channels, rows = read_png(file.read())
        server = np.frombuffer(b"".join(rows), np.uint8).reshape(height, width, channels).astype(int)
        self.assertLessEqual(int(np.abs(shown - server).max()), 1)
        self.assertGreater(len({tuple(c) for c in shown.reshape(-1, 3)}), 5)
        with self.assertRaises(gobo.InvalidArgument) as refused:
            self.client.render("spheres", width=8, height=6, outputs=["cryptomatte_material"], encoding={"format": "RAW_HALF"})
        self.assertIn("16 bits do not hold the ids of 'cryptomatte_material'", str(refused.exception))


if __name__ == "__main__":
    unittest.main()
