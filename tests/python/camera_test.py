# SPDX-License-Identifier: Apache-2.0
"""gobo.camera: matrices to requests and back, against each other, against closed forms, and against what the server renders."""
import math
import unittest

import numpy as np

import gobo
from gobo import camera
from gobo.fields import fill
from gobo.v1 import render_pb2
from support import SMALL, DaemonTest, gltf

SIZE = (64, 48)


def rotation(random):
    q, r = np.linalg.qr(random.normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else -q


def pose(random):
    m = np.eye(4)
    m[:3, :3], m[:3, 3] = rotation(random), random.uniform(-5, 5, 3)
    return m


class Matrices(unittest.TestCase):
    lenses = ({"yfov_deg": 37.0}, {"K": [[70, 0, 30], [0, 75, 21], [0, 0, 1]]}, {"orthographic_height": 3.0})

    def test_look_at(self):
        c = camera.look_at((0, 0, 5), (0, 0, 0), yfov_deg=90)
        np.testing.assert_allclose(c.camera_to_world, [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 5], [0, 0, 0, 1]], atol=1e-15)
        np.testing.assert_allclose(c.project((0, 0, 0), SIZE), [32, 24, 5])
        np.testing.assert_allclose(c.project([(5, 0, 0), (0, 5, 0)], SIZE), [[32 + 24, 24, 5], [32, 0, 5]], atol=1e-12)   # 45 degrees off are half a height
        np.testing.assert_allclose(c.forward, (0, 0, -1), atol=1e-15)

    def test_conventions(self):
        random = np.random.default_rng(7)
        for _ in range(20):
            m = pose(random)
            c = camera.from_matrix(m, yfov_deg=40)
            np.testing.assert_allclose(c.to_world(), m, atol=1e-12)
            np.testing.assert_allclose(c.world_to_camera() @ m, np.eye(4), atol=1e-12)
            cv = c.to_world("opencv")
            np.testing.assert_allclose(camera.from_matrix(cv, convention="opencv", yfov_deg=40).camera_to_world, m, atol=1e-12)
            np.testing.assert_allclose(c.world_to_camera("opencv") @ cv, np.eye(4), atol=1e-12)
            p = m[:3, 3] + 2 * c.forward + 0.1 * m[:3, 1]   # above the view's middle: y is up, or down
            np.testing.assert_allclose((c.world_to_camera("opencv") @ [*p, 1])[:3], (0, -0.1, 2), atol=1e-12)
            np.testing.assert_allclose((c.world_to_camera() @ [*p, 1])[:3], (0, 0.1, -2), atol=1e-12)

    def test_projection_is_that_of_opencv(self):
        random = np.random.default_rng(8)
        k = np.array([[70, 0, 30.25], [0, 75, 21], [0, 0, 1.0]])
        for middle, shift in (("half", 0.0), ("whole", 0.5)):
            c = camera.from_matrix(pose(random), K=k, pixel_middle=middle)
            p = c.position + 3 * c.forward + random.uniform(-1, 1, (50, 3))
            x = (c.world_to_camera("opencv") @ np.concatenate([p, np.ones((50, 1))], 1).T)[:3]
            want = (k @ x / x[2])[:2].T + shift
            np.testing.assert_allclose(c.project(p, SIZE)[:, :2], want, rtol=1e-9)

    def test_rays_meet_their_points(self):
        random = np.random.default_rng(9)
        for lens in self.lenses:
            c = camera.from_matrix(pose(random), **lens)
            p = c.position + 4 * c.forward + random.uniform(-1, 1, (6, 5, 3))
            q = c.project(p, SIZE)
            origin, direction = c.rays(q[..., :2], SIZE)
            np.testing.assert_allclose(np.linalg.norm(direction, axis=-1), 1, rtol=1e-12)
            t = ((p - origin) * direction).sum(-1, keepdims=True)
            np.testing.assert_allclose(origin + t * direction, p, atol=1e-9)
            np.testing.assert_allclose(((p - c.position) @ c.forward), q[..., 2], atol=1e-12)

    def test_what_is_behind_has_no_pixel(self):
        c = camera.look_at((0, 0, 5), (0, 0, 0), yfov_deg=40)
        self.assertTrue(np.isnan(c.project((0, 0, 6), SIZE)[:2]).all())
        self.assertEqual(c.project((0, 0, 6), SIZE)[2], -1)

    def test_fields_are_the_same_camera(self):
        random = np.random.default_rng(10)
        for lens in self.lenses:
            for far in (1.0, 1e4):
                m = pose(random)
                m[:3, 3] *= far
                c = camera.from_matrix(m, **lens)
                request = render_pb2.RenderRequest()
                fill(request, {"camera": c})   # through the message's 32 bits
                f = request.camera
                vector = lambda v: (v.x, v.y, v.z)
                back = camera.look_at(vector(f.position), vector(f.look_at), vector(f.up))
                self.assertLess(np.abs(back.camera_to_world[:3, :3] - m[:3, :3]).max(), 2e-6)
                if "K" in lens:
                    self.assertEqual((f.focal_x, f.focal_y, f.center_x, f.center_y, f.HasField("yfov_deg")), (70, 75, 30, 21, False))
                else:
                    name = next(iter(lens))
                    self.assertEqual((getattr(f, name), f.HasField("focal_x")), (lens[name], False))

    def test_k_of_an_angle(self):
        c = camera.look_at((0, 0, 5), (0, 0, 0), yfov_deg=50)
        k = c.K(SIZE)
        np.testing.assert_allclose(2 * math.degrees(math.atan(24 / k[1, 1])), 50)
        np.testing.assert_allclose(camera.from_matrix(c.camera_to_world, K=k).world_to_ndc(SIZE), c.world_to_ndc(SIZE), atol=1e-12)
        with self.assertRaises(gobo.InvalidArgument):
            camera.from_matrix(np.eye(4)).K(SIZE)

    def test_refusals(self):
        eye = np.eye(4)
        k = np.array([[70, 0, 30], [0, 75, 21], [0, 0, 1.0]])
        nan = eye.copy()
        nan[0, 3] = np.nan
        for field, call in (("target", lambda: camera.look_at((1, 2, 3), (1, 2, 3))), ("up", lambda: camera.look_at((0, 0, 0), (0, 1, 0))),
                            ("up", lambda: camera.look_at((0, 0, 0), (1, 0, 0), (0, 0, 0))), ("position", lambda: camera.look_at((0, 0), (1, 0, 0))),
                            ("camera_to_world", lambda: camera.from_matrix(2 * eye)), ("camera_to_world", lambda: camera.from_matrix(np.diag([1, 1, -1, 1]))),
                            ("camera_to_world", lambda: camera.from_matrix(nan)), ("camera_to_world", lambda: camera.from_matrix(np.eye(3))),
                            ("convention", lambda: camera.from_matrix(eye, convention="blender")),
                            ("K", lambda: camera.from_matrix(eye, K=k + [[0, 1, 0], [0, 0, 0], [0, 0, 0]])), ("K", lambda: camera.from_matrix(eye, K=-k)),
                            ("K", lambda: camera.from_matrix(eye, K=k * 2)), ("pixel_middle", lambda: camera.from_matrix(eye, K=k, pixel_middle="third")),
                            ("camera", lambda: camera.from_matrix(eye, K=k, yfov_deg=40)), ("yfov_deg", lambda: camera.from_matrix(eye, yfov_deg=180)),
                            ("orthographic_height", lambda: camera.from_matrix(eye, orthographic_height=0))):
            with self.assertRaises(gobo.InvalidArgument) as caught:
                call()
            self.assertEqual(caught.exception.field, field, str(caught.exception))


class Server(DaemonTest):
    """What the position output says of each pixel must be where the camera says that it is."""

    def positions(self, scene="cornell", **fields):
        r = self.client.render(scene, outputs=["position", "depth"], size=SIZE, spp=1, view_samples=1, **fields)
        seen = r.outputs["depth"][:, :, 0] > 0
        return r, r.outputs["position"][seen][:, :3].astype(np.float64), np.argwhere(seen)[:, ::-1]

    def check(self, c, scene="cornell", **fields):
        r, points, pixels = self.positions(scene, **fields)
        self.assertGreater(len(points), 100)
        q = c.project(points, SIZE)
        off = np.abs(q[:, :2] - (pixels + 0.5)).max()
        self.assertLess(off, 0.51, "the view sample is within its pixel")
        return r

    def test_of_the_scene(self):
        r, _, _ = self.positions()
        c = camera.of(r)
        self.check(c)
        other = camera.of(self.client.render("spheres", size=SIZE, spp=1))
        self.check(other, "spheres")
        path = gltf(self.folder)
        self.check(camera.of(self.client.render(path, size=SIZE, spp=1)), path)

    def test_of_a_shutter_it_is_the_slice_in_the_middle(self):
        curve = {"camera.position": {"time_s": [0, 1], "value": [-1, 1, 3.4, 1, 1, 3.4]}}
        for slices, spp, middle in ((4, 16, 0.2 + 2.5 / 4 * 0.4), (64, 3, 0.2 + 1.5 / 3 * 0.4)):
            r = self.client.render("cornell", size=SIZE, spp=spp, time_s=0.2, curves=curve, camera={"look_at": (0, 1, 0), "shutter_s": 0.4, "shutter_slices": slices})
            np.testing.assert_allclose(camera.of(r).camera_to_world[:3, 3], (-1 + 2 * middle, 1, 3.4), atol=1e-4)

    def test_there_and_back(self):
        random = np.random.default_rng(11)
        for lens in ({"yfov_deg": 33.0}, {"orthographic_height": 1.7}):
            for _ in range(3):
                m = np.eye(4)
                m[:3, :3] = camera.look_at(random.uniform((-0.5, 0.5, 3), (0.5, 1.5, 4)), (0, 1, 0), random.normal(size=3)).camera_to_world[:3, :3]
                m[:3, 3] = np.array([0, 1, 0]) + 3 * m[:3, 2]
                c = camera.from_matrix(m, **lens)
                r = self.check(c, camera=c)
                back = camera.of(r)
                np.testing.assert_allclose(back.camera_to_world, m, atol=2e-5)
                np.testing.assert_allclose(back.world_to_ndc(SIZE), c.world_to_ndc(SIZE), atol=1e-4)
                if "yfov_deg" in lens:
                    np.testing.assert_allclose(back.K(SIZE), c.K(SIZE), rtol=1e-5, atol=1e-4)

    def test_intrinsics(self):
        k = np.array([[60, 0, 29.5], [0, 66, 26], [0, 0, 1.0]])
        c = camera.look_at((0, 1, 3.2), (0, 1, 0), K=k)
        r = self.client.render("cornell", size=SIZE, spp=1, outputs=["depth"], camera=c)
        if np.allclose(camera.of(r).K(SIZE), camera.of(self.client.render("cornell", size=SIZE, spp=1, outputs=["depth"])).K(SIZE)):
            self.skipTest("this server does not know camera.focal_x")
        r = self.check(c, camera=c)
        np.testing.assert_allclose(camera.of(r).K(SIZE), k, rtol=1e-5, atol=1e-3)

    def test_a_moving_camera_and_a_long_render(self):
        r = self.client.render("cornell", size=SIZE, max_seconds=5, max_error=1.0, certificate=True, shadows={"axis_aligned": {"mean_samples": 8}},
                               set={"camera.yfov_deg": 30}, curves={"camera.yfov_deg": {"time_s": [0, 1], "value": [30, 50]}}, time_s=1)
        self.assertAlmostEqual(np.degrees(2 * np.arctan(24 / camera.of(r).K(SIZE)[1, 1])), 50, 3)
        asked = gobo.RenderRequest(scene="cornell", width=64, height=48, time_s=0.5)   # not resolved yet
        fill(asked, {"curves": {"camera.yfov_deg": {"time_s": [0, 1], "value": [30, 50]}, "lights.light.intensity": {"time_s": [0], "value": [2]}}})
        _, ndc = camera.file_matrices(self.client, asked)
        still = camera.file_matrices(self.client, gobo.RenderRequest(scene="cornell", width=64, height=48))[1]
        self.assertFalse(np.allclose(ndc, still))


if __name__ == "__main__":
    unittest.main()
