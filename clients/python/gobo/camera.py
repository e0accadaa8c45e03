# SPDX-License-Identifier: Apache-2.0
"""Cameras as numpy matrices, both ways: to requests (`camera=`), and from results (world to camera, world to picture, points to pixels).

Matrices are 4x4 (or 3x3) for column vectors: `m @ [x, y, z, 1]`. Convention "opengl" (glTF, Blender, NeRF files; the default): the camera looks along -z, y is
up. "opencv" (COLMAP, OpenCV): it looks along +z, y is down. Pixels are counted from the picture's top left corner: the middle of the first pixel is at
(0.5, 0.5). Lengths are metres.
"""
from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Dict, Optional, Sequence, Tuple, TYPE_CHECKING, Union

import numpy as np

from . import exr
from .errors import FailedPrecondition, InvalidArgument
from .v1 import render_pb2

if TYPE_CHECKING:
    from .client import Client
    from .result import Result

Points = Union[Sequence[float], Sequence[Sequence[float]], np.ndarray]
_FLIP = np.diag([1.0, -1.0, -1.0, 1.0])   # between the conventions: y and z change sign


def _axes(convention: str) -> np.ndarray:
    if convention not in ("opengl", "opencv"):
        raise InvalidArgument(f'convention = {convention!r}: must be "opengl" or "opencv"', field="convention", value=repr(convention))
    return np.eye(4) if convention == "opengl" else _FLIP


def _array(value: Any, shape: Tuple[int, ...], name: str) -> np.ndarray:
    try:
        array = np.asarray(value, np.float64)
    except (TypeError, ValueError):
        raise InvalidArgument(f"{name} = {str(value)[:80]}: must be numbers", field=name) from None
    if array.shape != shape:
        raise InvalidArgument(f"{name}: must have the shape {shape}, not {array.shape}", field=name)
    if not np.isfinite(array).all():
        raise InvalidArgument(f"{name} = {array.tolist()}: must be finite", field=name)
    return array


def _points(value: Points, count: int, name: str) -> np.ndarray:
    array = np.asarray(value, np.float64)
    if array.ndim < 1 or array.shape[-1] != count:
        raise InvalidArgument(f"{name}: must have the shape (..., {count}), not {array.shape}", field=name)
    return array


@dataclass(frozen=True)
class Camera:
    """A place to look from, for `camera=` of any request. Make it with `look_at`, `from_matrix` or `of`.

    Attributes:
        camera_to_world: (4, 4), convention "opengl", a rotation and a translation.
        yfov_deg: full vertical angle of view, or None.
        intrinsics: (3, 3) matrix of focal lengths and principal point in pixels, or None.
        orthographic_height: metres that the picture is high, or None.

    With none of the last three, a request leaves the lens to the scene's camera, and what needs one raises gobo.InvalidArgument.
    """
    camera_to_world: np.ndarray
    yfov_deg: Optional[float] = None
    intrinsics: Optional[np.ndarray] = None
    orthographic_height: Optional[float] = None

    @property
    def position(self) -> np.ndarray:
        """(3,), metres."""
        position: np.ndarray = self.camera_to_world[:3, 3].copy()
        return position

    @property
    def forward(self) -> np.ndarray:
        """(3,), unit length."""
        forward: np.ndarray = -self.camera_to_world[:3, 2]
        return forward

    def to_world(self, convention: str = "opengl") -> np.ndarray:
        """`camera_to_world` in either convention."""
        matrix: np.ndarray = self.camera_to_world @ _axes(convention)
        return matrix

    def world_to_camera(self, convention: str = "opengl") -> np.ndarray:
        """(4, 4): the other way ("opencv": the extrinsics [R | t] of a measured camera)."""
        rotation = self.camera_to_world[:3, :3].T
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = rotation, -rotation @ self.camera_to_world[:3, 3]
        matrix = _axes(convention) @ matrix
        return matrix

    def K(self, size: Tuple[int, int]) -> np.ndarray:
        """(3, 3): focal lengths and principal point in pixels of a picture of `size` (width, height)."""
        if self.intrinsics is not None:
            return self.intrinsics.copy()
        if self.yfov_deg is None:
            raise InvalidArgument("camera: it has neither yfov_deg nor intrinsics", field="camera")
        width, height = size
        focal = 0.5 * height / math.tan(math.radians(0.5 * self.yfov_deg))
        return np.array([[focal, 0, 0.5 * width], [0, focal, 0.5 * height], [0, 0, 1.0]])

    def world_to_ndc(self, size: Tuple[int, int]) -> np.ndarray:
        """(4, 4): divided by w, x and y go from 0 to 1 from the picture's top left corner (worldToNDC of an EXR file); w is the depth along
        the view, or 1 for an orthographic camera."""
        width, height = size
        film = np.zeros((4, 4))   # from x right, y up, z forward
        if self.orthographic_height is not None:
            film[0, 0], film[0, 3] = height / (width * self.orthographic_height), 0.5
            film[1, 1], film[1, 3] = -1 / self.orthographic_height, 0.5
            film[2, 2] = film[3, 3] = 1
        else:
            k = self.K(size)
            film[0, 0], film[0, 2] = k[0, 0] / width, k[0, 2] / width
            film[1, 1], film[1, 2] = -k[1, 1] / height, k[1, 2] / height
            film[2, 3] = film[3, 2] = 1
        matrix: np.ndarray = film @ np.diag([1.0, 1.0, -1.0, 1.0]) @ self.world_to_camera()
        return matrix

    def project(self, points: Points, size: Tuple[int, int]) -> np.ndarray:
        """(..., 3): where `points` (..., 3) of the world are in a picture of `size`: x and y in pixels, and metres along the view. NaN for x and y of
        points that are not in front of a perspective camera."""
        return project(self.world_to_ndc(size), points, size, self.world_to_camera())

    def rays(self, pixels: Points, size: Tuple[int, int]) -> Tuple[np.ndarray, np.ndarray]:
        """Origins and unit directions, (..., 3) each, of the rays through `pixels` (..., 2)."""
        p = _points(pixels, 2, "pixels")
        turn = self.camera_to_world[:3, :3]
        if self.orthographic_height is not None:
            scale = self.orthographic_height / size[1]
            offset = np.stack([(p[..., 0] - 0.5 * size[0]) * scale, (0.5 * size[1] - p[..., 1]) * scale, np.zeros(p.shape[:-1])], -1)
            return self.position + offset @ turn.T, np.broadcast_to(self.forward, offset.shape).copy()
        k = self.K(size)
        d = np.stack([(p[..., 0] - k[0, 2]) / k[0, 0], (k[1, 2] - p[..., 1]) / k[1, 1], -np.ones(p.shape[:-1])], -1) @ turn.T
        return np.broadcast_to(self.position, d.shape).copy(), d / np.linalg.norm(d, axis=-1, keepdims=True)

    def fields(self) -> Dict[str, Any]:
        """Fields of CameraSettings; `camera=` does this by itself."""
        # A point to look at so far away that rounding it to 32 bits turns the camera by no more than it rounds directions.
        away = 2.0 ** math.ceil(math.log2(max(1.0, float(np.abs(self.position).max()))))
        out: Dict[str, Any] = {"position": self.position.tolist(), "look_at": (self.position + away * self.forward).tolist(),
                               "up": self.camera_to_world[:3, 1].tolist()}
        if self.intrinsics is not None:
            k = self.intrinsics
            out.update(focal_x=float(k[0, 0]), focal_y=float(k[1, 1]), center_x=float(k[0, 2]), center_y=float(k[1, 2]))
        elif self.orthographic_height is not None:
            out["orthographic_height"] = float(self.orthographic_height)
        elif self.yfov_deg is not None:
            out["yfov_deg"] = float(self.yfov_deg)
        return out


def _lens(yfov_deg: Optional[float], k: Any, orthographic_height: Optional[float], middle: str) -> Dict[str, Any]:
    if sum(x is not None for x in (yfov_deg, k, orthographic_height)) > 1:
        raise InvalidArgument("camera: give one of yfov_deg, K and orthographic_height", field="camera")
    if yfov_deg is not None and not 0 < yfov_deg < 180:
        raise InvalidArgument(f"yfov_deg = {yfov_deg}: must be between 0 and 180", field="yfov_deg", value=str(yfov_deg))
    if orthographic_height is not None and not 0 < orthographic_height < math.inf:
        raise InvalidArgument(f"orthographic_height = {orthographic_height}: must be above 0", field="orthographic_height", value=str(orthographic_height))
    if k is not None:
        k = _array(k, (3, 3), "K").copy()
        if not (k[0, 0] > 0 and k[1, 1] > 0) or np.abs(k[2] - [0, 0, 1]).max() > 1e-9 or k[1, 0] != 0:
            raise InvalidArgument("K: must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] with focal lengths above 0", field="K")
        if abs(k[0, 1]) > 1e-9 * k[0, 0]:
            raise InvalidArgument(f"K[0][1] = {k[0, 1]}: a lens with skew cannot be rendered", field="K", value=str(k[0, 1]))
        if middle not in ("half", "whole"):
            raise InvalidArgument(f'pixel_middle = {middle!r}: must be "half" or "whole"', field="pixel_middle", value=repr(middle))
        k[0, 1] = 0.0
        if middle == "whole":
            k[:2, 2] += 0.5
    return {"yfov_deg": yfov_deg, "intrinsics": k, "orthographic_height": orthographic_height}


def look_at(position: Sequence[float], target: Sequence[float], up: Sequence[float] = (0, 1, 0), *, yfov_deg: Optional[float] = None,
            K: "Optional[Sequence[Sequence[float]] | np.ndarray]" = None, orthographic_height: Optional[float] = None,
            pixel_middle: str = "half") -> Camera:
    """A camera at `position` that has `target` in the middle and `up` upwards. The lens: see `from_matrix`.

    Raises: gobo.InvalidArgument: target at the position, or `up` along the view.
    """
    eye, to, upwards = _array(position, (3,), "position"), _array(target, (3,), "target"), _array(up, (3,), "up")
    forward = to - eye
    if not np.linalg.norm(forward) > 0:
        raise InvalidArgument(f"target = {to.tolist()}: must not be the position", field="target")
    forward /= np.linalg.norm(forward)
    length = np.linalg.norm(upwards)
    right = np.cross(forward, upwards / length) if length > 0 else np.zeros(3)
    if not np.linalg.norm(right) > 1e-9:
        raise InvalidArgument(f"up = {upwards.tolist()}: must not be zero or along the view", field="up")
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1], matrix[:3, 2], matrix[:3, 3] = right, np.cross(right, forward), -forward, eye
    return Camera(matrix, **_lens(yfov_deg, K, orthographic_height, pixel_middle))


def from_matrix(camera_to_world: "Sequence[Sequence[float]] | np.ndarray", *, convention: str = "opengl", yfov_deg: Optional[float] = None,
                K: "Optional[Sequence[Sequence[float]] | np.ndarray]" = None, orthographic_height: Optional[float] = None,
                pixel_middle: str = "half") -> Camera:
    """A camera from its (4, 4) matrix to the world; the other way round, give `numpy.linalg.inv` of it.

    Args:
        convention: of the camera's axes, see above.
        K: (3, 3) [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels of the picture that is rendered.
        pixel_middle: "whole" if K has the middle of the first pixel at (0, 0), as OpenCV; "half": at (0.5, 0.5), as COLMAP.

    Raises: gobo.InvalidArgument: not a rotation and a translation (1e-4 of scale and angle are put right), or a lens that is none.
    """
    axes = _axes(convention)
    matrix = _array(camera_to_world, (4, 4), "camera_to_world") @ axes
    turn = matrix[:3, :3]
    if np.abs(matrix[3] - [0, 0, 0, 1]).max() > 1e-9 or np.abs(turn.T @ turn - np.eye(3)).max() > 1e-4 or np.linalg.det(turn) < 0:
        raise InvalidArgument("camera_to_world: must be a rotation and a translation, without scale or mirroring", field="camera_to_world")
    u, _, v = np.linalg.svd(turn)
    matrix[:3, :3], matrix[3] = u @ v, [0, 0, 0, 1]
    return Camera(matrix, **_lens(yfov_deg, K, orthographic_height, pixel_middle))


def project(world_to_ndc: np.ndarray, points: Points, size: Tuple[int, int], world_to_camera: np.ndarray) -> np.ndarray:
    """`Camera.project` with matrices of one's own; `world_to_camera` in convention "opengl"."""
    p = _points(points, 3, "points")
    p = np.concatenate([p, np.ones((*p.shape[:-1], 1))], -1)
    q = p @ np.asarray(world_to_ndc, np.float64).T
    depth = -(p @ np.asarray(world_to_camera, np.float64).T)[..., 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        xy = np.where(q[..., 3:] > 0, q[..., :2] / q[..., 3:], np.nan) * np.asarray(size, np.float64)
    return np.concatenate([xy, depth[..., None]], -1)


def of(result: "Result", *, timeout: Optional[float] = None) -> Camera:
    """The camera that `result` was seen with, the scene's own if the request moved nothing: asks the server for one pixel more, whose EXR file says.

    Raises: gobo.FailedPrecondition: the file has no matrices (a panorama), or its lens is off-centre orthographic.
    """
    r = result.resolved
    view_file, ndc_file = file_matrices(result._client, r, timeout)
    # Files have them for row vectors and x right, y up, z forward.
    view = np.diag([1.0, 1.0, -1.0, 1.0]) @ view_file.T
    ndc = ndc_file.T
    u, _, v = np.linalg.svd(view[:3, :3])
    turn = u @ v
    world = np.eye(4)
    world[:3, :3], world[:3, 3] = turn.T, -turn.T @ view[:3, 3]
    film = ndc @ world @ np.diag([1.0, 1.0, -1.0, 1.0])
    if abs(film[3, 2]) > abs(film[3, 3]):
        k = np.array([[film[0, 0] * r.width, 0, film[0, 2] * r.width], [0, -film[1, 1] * r.height, film[1, 2] * r.height], [0, 0, 1.0]]) / film[3, 2]
        k[2, 2] = 1.0
        return Camera(world, intrinsics=k)
    if np.abs(film[:2, 3] - 0.5).max() > 1e-4:
        raise FailedPrecondition("an orthographic camera whose middle is not the picture's", field="camera")
    return Camera(world, orthographic_height=float(-1 / film[1, 1]))


def file_matrices(client: "Client", r: render_pb2.RenderRequest, timeout: Optional[float] = None) -> Tuple[np.ndarray, np.ndarray]:
    """worldToCamera and worldToNDC, (4, 4) each, as an EXR file of the request `r` has them: for row vectors, x right, y up, z forward. With a shutter those of
    the slice in the middle.

    Raises: gobo.FailedPrecondition: it has none (a panorama).
    """
    request = render_pb2.RenderRequest(scene=r.scene, camera=r.camera, outputs=["depth"], view_samples=1)
    for name in ("width", "height", "scene_hash", "time_s", "animation"):
        if r.HasField(name):
            setattr(request, name, getattr(r, name))
    if r.camera.shutter_s > 0:
        slices = r.camera.shutter_slices or 16
        if r.halt.HasField("spp"):
            slices = max(1, min(slices, r.halt.spp))
        request.time_s = r.time_s + (slices // 2 + 0.5) / slices * r.camera.shutter_s
        request.camera.ClearField("shutter_s")
        request.camera.ClearField("shutter_slices")
    for path, curve in r.curves.items():
        if path.startswith("camera."):
            request.curves[path].CopyFrom(curve)
    for path, expression in r.expressions.items():
        if path.startswith("camera."):
            request.expressions[path].CopyFrom(expression)
    one = client.render(request=request, spp=1, format="exr", window={"x": 0, "y": 0, "width": 1, "height": 1}, timeout=timeout)
    attributes = exr.attributes(one.encoded["depth"], "depth")
    if "worldToCamera" not in attributes or "worldToNDC" not in attributes:
        raise FailedPrecondition("the picture has no matrix from the world to its pixels", field="camera.panorama")
    return (np.asarray(attributes["worldToCamera"], np.float64).reshape(4, 4), np.asarray(attributes["worldToNDC"], np.float64).reshape(4, 4))
