# SPDX-License-Identifier: Apache-2.0
"""The scenes of a server: open, upload, list, inspect, patch, unload."""
from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass, field
from typing import Any, Dict, Iterator, List, Mapping, Optional, Sequence, Tuple, Union

import numpy as np

from . import errors, glb
from .blobs import Blob, Blobs, blob, files_of
from .cancellation import Cancellation, current, scope
from .fields import Builder, Light, utf8
from .v1 import service_pb2, service_pb2_grpc
from .wire import Wire

_PIECE = 1 << 20


@dataclass(frozen=True)
class LightInfo:
    """A light of a scene. `power` is linear RGB in the unit of its kind (W/sr, W/m^2, W/(m^2 sr))."""
    name: str
    kind: str
    power: Tuple[float, float, float]
    position: Tuple[float, float, float]
    direction: Tuple[float, float, float]


@dataclass(frozen=True)
class Scene:
    """What is in a loaded scene. `bounds` is (2, 3): low and high corner in metres. `info` is the message itself."""
    id: str
    source: str
    hash: str
    triangles: int
    instances: List[str]
    materials: List[str]
    cameras: List[str]
    lights: Dict[str, LightInfo]
    bounds: np.ndarray
    bytes: int
    load_ms: float
    warnings: List[str]
    origin: Tuple[float, float, float]
    info: service_pb2.SceneInfo = field(repr=False)


def _triple(v: Any) -> Tuple[float, float, float]:
    return v.x, v.y, v.z


def _scene(i: service_pb2.SceneInfo) -> Scene:
    lights = {n.name: LightInfo(n.name, n.kind, _triple(n.power), _triple(n.position), _triple(n.direction)) for n in i.lights}
    bounds = np.array([_triple(i.bounds_min), _triple(i.bounds_max)], np.float64)
    return Scene(i.id, i.source, i.hash, i.triangles, list(i.instance_names), list(i.material_names), list(i.cameras), lights, bounds, i.bytes,
                 i.load_ms, list(i.warnings), _triple(i.origin), i)


class Scenes:
    """`client.scenes`."""

    def __init__(self, wire: Wire, upload_limit: int, blobs: Optional[Blobs] = None) -> None:
        self._wire = wire
        self._blobs = blobs or Blobs(wire)
        self._stub = service_pb2_grpc.ScenesStub(wire.channel)
        self._limit = upload_limit

    def open(self, source: "str | os.PathLike[str]", name: str = "", *, timeout: Optional[float] = None) -> Scene:
        """Loads a built-in scene by name, or a file. A file that the server cannot open is uploaded (`upload`)."""
        timeout = self._wire.until(timeout)
        text = os.fspath(source)
        file = os.path.isfile(text)
        if not file and text.lower().endswith((".glb", ".gltf")) and not os.path.isabs(text):
            raise errors.NotFound(f'"{text}": no such file')
        try:
            place = utf8(os.path.abspath(text) if file else text, "source")
        except errors.InvalidArgument:
            if not file:
                raise
            return self.upload(text, utf8(name, "name"), timeout=timeout)   # its folder's name fits into no message
        request = service_pb2.OpenSceneRequest(source=place, name=utf8(name, "name"))
        try:
            return _scene(self._wire.unary(self._stub.Open, request, timeout))
        except (errors.PermissionDenied, errors.NotFound):
            if not file:
                raise
        return self.upload(text, name, timeout=timeout)

    def upload(self, source: "str | os.PathLike[str] | bytes", name: str = "", *, extension: str = "", timeout: Optional[float] = None) -> Scene:
        """Sends a .glb or .gltf with the files that it names, or the bytes of a .glb, as far as the server has not got them (`Blobs.put`), and opens it.

        Without a name the id is made from file name and content, so a scene that is loaded is found under it.
        """
        timeout = self._wire.until(timeout)
        try:
            if isinstance(source, (bytes, bytearray, memoryview)):
                own = "scene" + (extension or ".glb")
                files: Dict[str, Blob] = {own: blob(source)}
            else:
                own = utf8(os.path.basename(os.fspath(source)), "source")
                files = files_of(source, self._limit)
            return self._open_files(own, files, name, timeout)
        except errors.Unimplemented:   # a server of before Blobs
            return self._upload_whole(source, name, extension, timeout)

    def _open_files(self, own: str, files: Mapping[str, Blob], name: str, timeout: Optional[float]) -> Scene:
        if not name:
            listed = "".join(f"{n} {files[n].sha256}\n" for n in sorted(files))
            digest = files[own].sha256 if len(files) == 1 else hashlib.sha256(listed.encode()).hexdigest()
            name = f"{os.path.splitext(own)[0]}-{digest[:12]}"
            try:
                return self.inspect(name, timeout=timeout)
            except errors.NotFound:
                pass
        request = service_pb2.OpenSceneRequest(source=own, name=name, files={n: b.sha256 for n, b in files.items()})
        for again in (True, False):
            self._blobs.put(files.values(), timeout=timeout)
            try:
                return _scene(self._wire.unary(self._stub.Open, request, timeout))
            except errors.NotFound as e:   # others needed the room meanwhile, or the disk lost it
                if not again or "open.files" not in e.message:
                    raise
        raise AssertionError

    def _upload_whole(self, source: "str | os.PathLike[str] | bytes", name: str, extension: str, timeout: Optional[float]) -> Scene:
        """By `Scenes.Upload`: the file whole, a .gltf packed into one with the files that it names."""
        if isinstance(source, (bytes, bytearray, memoryview)):
            data, stem, extension = bytes(source), "scene", extension or ".glb"
        else:
            text = os.fspath(source)
            stem, kind = os.path.splitext(os.path.basename(text))
            extension = extension or kind.lower()
            try:
                if extension == ".gltf":
                    data, extension = glb.pack(text, self._limit), ".glb"
                elif os.path.getsize(text) > self._limit:
                    raise errors.InvalidArgument(f"{text}: {os.path.getsize(text) >> 20} MiB are more than the upload limit of {self._limit >> 20} MiB; "
                                                 "give gobod a --root with the scene, or connect(upload_limit=...)")
                else:
                    with open(text, "rb") as file:
                        data = file.read()
            except FileNotFoundError as e:
                raise errors.NotFound(f'"{text}": {e.strerror}') from None
        digest = hashlib.sha256(data).hexdigest()
        if not name:
            name = f"{stem}-{digest[:12]}"
            try:
                return self.inspect(name, timeout=timeout)
            except errors.NotFound:
                pass

        def pieces() -> Iterator[service_pb2.UploadSceneRequest]:
            view = memoryview(data)
            yield service_pb2.UploadSceneRequest(name=name, extension=extension, total_bytes=len(data), sha256=digest, data=bytes(view[:_PIECE]))
            for at in range(_PIECE, len(data), _PIECE):
                yield service_pb2.UploadSceneRequest(data=bytes(view[at:at + _PIECE]))
        return _scene(self._wire.unary(self._stub.Upload, pieces, timeout))

    def resolve(self, scene: "str | os.PathLike[str] | Scene", timeout: Optional[float] = None, cancel: Optional[Cancellation] = None) -> str:
        """The id that a request names `scene` by: files are opened or uploaded, ids and built-in names taken as they are."""
        if isinstance(scene, Scene):
            return scene.id
        text = os.fspath(scene)
        if os.path.isfile(text) or text.lower().endswith((".glb", ".gltf")):
            with scope(current(cancel)):
                return self.open(text, timeout=timeout).id
        return text

    def list(self, *, timeout: Optional[float] = None) -> List[Scene]:
        """Scenes that are loaded."""
        return [_scene(i) for i in self._wire.unary(self._stub.List, service_pb2.ListScenesRequest(), timeout).scenes]

    def builtin(self, *, timeout: Optional[float] = None) -> List[str]:
        """Names of the built-in scenes."""
        return list(self._wire.unary(self._stub.List, service_pb2.ListScenesRequest(), timeout).builtin)

    def inspect(self, scene: Union[str, Scene], *, timeout: Optional[float] = None) -> Scene:
        """Lights, cameras, materials and hashes of a loaded scene."""
        name = scene.id if isinstance(scene, Scene) else scene
        return _scene(self._wire.unary(self._stub.Inspect, service_pb2.InspectSceneRequest(scene=name), timeout))

    def patch(self, scene: Union[str, Scene], *, materials: Optional[Mapping[str, Mapping[str, Any]]] = None,
              instances: Optional[Mapping[str, Union[Sequence[float], np.ndarray, Mapping[str, Any]]]] = None, lights: Optional[Mapping[str, Light]] = None,
              timeout: Optional[float] = None) -> Scene:
        """Changes a scene in place, for every client. An instance takes a 4x4 matrix (numpy, row-major), or 16 numbers, column-major;
        or {"moved_by": (x, y, z)}, metres from where it is."""
        request = service_pb2.PatchSceneRequest(scene=scene.id if isinstance(scene, Scene) else scene)
        builder = Builder(request)
        for path, value in (("materials", materials), ("instances", instances), ("lights", lights)):
            if value is not None:
                builder.put(path, value)
        return _scene(self._wire.unary(self._stub.Patch, request, timeout))

    def unload(self, scene: Union[str, Scene], *, timeout: Optional[float] = None) -> None:
        """Forgets a scene."""
        name = scene.id if isinstance(scene, Scene) else scene
        self._wire.unary(self._stub.Unload, service_pb2.UnloadSceneRequest(scene=name), timeout)
