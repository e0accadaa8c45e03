# SPDX-License-Identifier: Apache-2.0
"""Files for a server that cannot open them: known by their SHA-256, sent once, in parts that go on where they broke off."""
from __future__ import annotations

import hashlib
import io
import json
import os
import posixpath
import struct
import threading
import time
import urllib.parse
from dataclasses import dataclass
from typing import Any, BinaryIO, Dict, Iterable, Iterator, Mapping, Optional, Union

import numpy as np

from . import errors, exr
from .cancellation import current, pause
from .v1 import render_pb2, service_pb2, service_pb2_grpc
from .wire import Until, Wire

_PIECE = 1 << 19   # with its frame below any limits.request_bytes
_TRIES = 8   # of connections that break one after the other


@dataclass(frozen=True)
class Blob:
    """The bytes of one file: `source` is its path, or they themselves."""
    sha256: str
    bytes: int
    source: Union[str, bytes]

    def open(self) -> BinaryIO:
        return open(self.source, "rb") if isinstance(self.source, str) else io.BytesIO(self.source)


def blob(source: "str | os.PathLike[str] | bytes") -> Blob:
    """Of a file, or of bytes. Errors: NotFound; InvalidArgument for a file without any."""
    if isinstance(source, (bytes, bytearray, memoryview)):
        data = bytes(source)
        return Blob(hashlib.sha256(data).hexdigest(), len(data), data)
    path = os.fspath(source)
    digest, size = hashlib.sha256(), 0
    try:
        with open(path, "rb") as file:
            for piece in iter(lambda: file.read(_PIECE), b""):
                digest.update(piece)
                size += len(piece)
    except FileNotFoundError as e:
        raise errors.NotFound(f'"{path}": {e.strerror}') from None
    if size == 0:
        raise errors.InvalidArgument(f'"{path}": the file is empty')
    return Blob(digest.hexdigest(), size, path)


def _uris(value: Any) -> Iterator[str]:
    if isinstance(value, dict):
        for key, inner in value.items():
            if key == "uri" and isinstance(inner, str):
                yield inner
            else:
                yield from _uris(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from _uris(inner)


def _document(path: str) -> Any:
    with open(path, "rb") as file:
        head = file.read(20)
        if head[:4] == b"glTF" and len(head) == 20:
            text = file.read(struct.unpack_from("<I", head, 12)[0])
        elif path.lower().endswith(".gltf"):
            text = head + file.read()
        else:
            return None
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return None   # the server says what is wrong with it


def files_of(path: "str | os.PathLike[str]", limit: int) -> Dict[str, Blob]:
    """A .gltf or .glb and the files that it names, by their names relative to its folder; its own comes first.

    Only what lies below the file's folder is taken, and nothing that is not there: the server judges that as it would on its own disk.

    Errors: NotFound; InvalidArgument above `limit` bytes together.
    """
    text = os.path.abspath(os.fspath(path))
    folder, own = os.path.realpath(os.path.dirname(text)), os.path.basename(text)
    try:
        document = _document(text)
        paths = {own: text}
        for uri in _uris(document):
            if uri.startswith("data:") or urllib.parse.urlsplit(uri).scheme:
                continue
            name = posixpath.normpath(urllib.parse.unquote(uri))
            real = os.path.realpath(os.path.join(folder, name)) if "\0" not in name else ""
            if not posixpath.isabs(name) and real.startswith(folder.rstrip("/") + "/") and os.path.isfile(real) and os.path.getsize(real) > 0:
                paths.setdefault(name, real)
        total = sum(os.path.getsize(p) for p in paths.values())
    except FileNotFoundError as e:
        raise errors.NotFound(f'"{os.fspath(path)}": {e.strerror}') from None
    if total > limit:
        raise errors.InvalidArgument(f"{own}: {total >> 20} MiB are more than the upload limit of {limit >> 20} MiB; give gobod a --root with the scene, "
                                     "or connect(upload_limit=...)")
    return {name: blob(p) for name, p in paths.items()}


def environment(radiance: np.ndarray) -> Blob:
    """A lat-long map (height, width, 3) of linear radiance, top row first, as an EXR of 32-bit floats. Errors: InvalidArgument."""
    values = np.asarray(radiance)
    if values.ndim != 3 or values.shape[2] != 3 or 0 in values.shape or values.dtype.kind not in "fiu":
        raise errors.InvalidArgument(f"env: an array must be (height, width, 3) numbers, not {values.shape} of {values.dtype}", field="env")
    with np.errstate(over="ignore"):
        values = values.astype(np.float32)
    if not np.isfinite(values).all():
        raise errors.InvalidArgument("env: the array must be finite as 32-bit floats", field="env")
    return blob(exr.encode({name: values[:, :, i] for i, name in enumerate("RGB")}))


class Blobs:
    """`client.blobs`."""

    def __init__(self, wire: Wire) -> None:
        self._wire = wire
        self._stub = service_pb2_grpc.BlobsStub(wire.channel)
        self._one_at_a_time = threading.Lock()   # threads that need the same file: one sends it, the others find it sent

    def put(self, blobs: Iterable[Blob], *, timeout: Optional[float] = None) -> int:
        """Sends what the server has not got of this caller's yet; returns the bytes that were sent. A connection that breaks is gone on with."""
        until = self._wire.until(timeout)
        cancel = current(None)
        while not self._one_at_a_time.acquire(timeout=0.1 if until is None else min(0.1, max(until.end - time.monotonic(), 0.0))):
            if cancel is not None:
                cancel.check()
            if until is not None and until.passes_in(0):
                raise errors.DeadlineExceeded("another thread of this client was sending files all the time")
        try:
            return self._put({b.sha256: b for b in blobs}, until)
        finally:
            self._one_at_a_time.release()

    def _put(self, wanted: Dict[str, Blob], until: Optional[Until]) -> int:
        sent = broken = 0
        while True:
            request = service_pb2.MissingBlobsRequest(blobs=[service_pb2.BlobDigest(sha256=b.sha256, bytes=b.bytes) for b in wanted.values()])
            try:
                missing = list(self._wire.unary(self._stub.Missing, request, until).missing)
                if not missing:
                    return sent
                for m in missing:
                    sent += self._one(wanted[m.blob.sha256], m.received, until)
                wanted = {m.blob.sha256: wanted[m.blob.sha256] for m in missing if m.received}   # what may have been dropped: it is asked for again
                if not wanted:
                    return sent
            except (errors.Unavailable, errors.Aborted):   # Aborted: another client of the same name sends the same file
                broken += 1
                seconds = min(0.1 * 2 ** broken, 3.0)
                if broken >= _TRIES or (until is not None and until.passes_in(seconds)):
                    raise
                pause(seconds, current(None))

    def _one(self, blob: Blob, offset: int, timeout: Optional[float]) -> int:
        def pieces() -> Iterator[service_pb2.PutBlobRequest]:
            message = service_pb2.PutBlobRequest(blob=service_pb2.BlobDigest(sha256=blob.sha256, bytes=blob.bytes), offset=offset)
            with blob.open() as file:
                file.seek(offset)
                while True:
                    message.data = file.read(_PIECE)
                    yield message
                    if len(message.data) < _PIECE:
                        return
                    message = service_pb2.PutBlobRequest()
        try:
            self._wire.unary(self._stub.Put, pieces, timeout)
        except errors.InvalidArgument as e:
            if offset == 0 or "put it from 0" not in e.message:
                raise   # else what was there is dropped, and asked for again
        return blob.bytes - offset


class Environments:
    """What `env=` of the calls means on a server that is elsewhere."""

    def __init__(self, blobs: Blobs) -> None:
        self._blobs = blobs

    def put_arrays(self, fields: Mapping[str, Any], timeout: Optional[float]) -> Dict[str, Any]:
        """`fields` with arrays of radiance put, and their digests in their place."""
        out = dict(fields)
        for name in ("env", "environment"):
            value = out.get(name)
            if isinstance(value, np.ndarray) and value.ndim > 1:
                made = environment(value)
                self._blobs.put([made], timeout=timeout)
                out[name] = {"digest": made.sha256}
        return out

    def mend(self, settings: render_pb2.EnvironmentSettings, error: errors.Error, timeout: Optional[float]) -> bool:
        """Puts the file here that the server could not open, and names it by its digest. False: that is not what the error is about."""
        path = settings.path
        if "environment.path" not in error.message or not path.lower().endswith((".hdr", ".exr")) or not os.path.isfile(path):
            return False
        made = blob(path)
        try:
            self._blobs.put([made], timeout=timeout)
        except errors.Unimplemented:   # a server of before Blobs
            return False
        settings.ClearField("path")
        settings.digest = made.sha256
        return True
