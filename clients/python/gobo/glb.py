# SPDX-License-Identifier: Apache-2.0
"""A .gltf with its side files as one GLB, for servers that cannot open the folder. Buffers become one binary chunk, images buffer
views; nothing else of the JSON is touched. Only files inside the .gltf's folder are read."""
from __future__ import annotations

import base64
import binascii
import json
import os
import struct
import urllib.parse
from typing import Any, Dict, List

from .errors import InvalidArgument, NotFound

_MIME = {".png": "image/png", ".jpg": "image/jpeg", ".jpeg": "image/jpeg", ".webp": "image/webp", ".ktx2": "image/ktx2", ".dds": "image/vnd-ms.dds"}
_JSON, _BIN = 0x4E4F534A, 0x004E4942


def _fetch(uri: str, folder: str, pointer: str, file: str, room: int) -> bytes:
    if uri.startswith("data:"):
        head, _, body = uri.partition(",")
        try:
            return base64.b64decode(body, validate=True) if head.endswith(";base64") else urllib.parse.unquote_to_bytes(body)
        except (binascii.Error, ValueError) as e:
            raise InvalidArgument(f"{file}: {pointer}: not base64: {e}", place=f"{file}: {pointer}") from None
    if urllib.parse.urlsplit(uri).scheme:
        raise InvalidArgument(f"{file}: {pointer} = \"{uri[:200]}\": only files beside the .gltf are packed", place=f"{file}: {pointer}")
    path = os.path.realpath(os.path.join(folder, urllib.parse.unquote(uri)))
    if os.path.commonpath([path, folder]) != folder:
        raise InvalidArgument(f"{file}: {pointer} = \"{uri[:200]}\": is outside the file's folder", place=f"{file}: {pointer}")
    try:
        if os.path.getsize(path) > room:
            raise InvalidArgument(f"{file}: {pointer} = \"{uri[:200]}\": larger than the upload limit; give gobod a --root with the scene",
                                  place=f"{file}: {pointer}")
        with open(path, "rb") as data:
            return data.read()
    except OSError as e:
        raise NotFound(f"{file}: {pointer} = \"{uri[:200]}\": {e.strerror}", place=f"{file}: {pointer}") from None


def _list(document: Dict[str, Any], name: str, file: str) -> List[Dict[str, Any]]:
    value = document.get(name, [])
    if not isinstance(value, list) or not all(isinstance(v, dict) for v in value):
        raise InvalidArgument(f"{file}: /{name}: must be an array of objects", place=f"{file}: /{name}")
    return value


def pack(path: str, limit: int = 512 << 20) -> bytes:
    """The bytes of a GLB that holds the .gltf at `path` and every file that it names.

    Errors: InvalidArgument or NotFound naming file and JSON pointer; InvalidArgument above `limit` bytes.
    """
    file = os.path.basename(path)
    folder = os.path.realpath(os.path.dirname(os.path.abspath(path)))
    if os.path.getsize(path) > limit:
        raise InvalidArgument(f"{file}: larger than the upload limit of {limit >> 20} MiB; give gobod a --root with the scene")
    with open(path, "rb") as source:
        try:
            document = json.load(source)
        except (ValueError, RecursionError) as e:
            raise InvalidArgument(f"{file}: not JSON: {e}", place=file) from None
    if not isinstance(document, dict):
        raise InvalidArgument(f"{file}: must be a JSON object", place=file)
    buffers, views, images = (_list(document, n, file) for n in ("buffers", "bufferViews", "images"))
    if any("EXT_meshopt_compression" in b.get("extensions", {}) for b in [*buffers, *views]):
        raise InvalidArgument(f"{file}: EXT_meshopt_compression: side files are not packed; make a .glb, or give gobod a --root with the scene",
                              place=f"{file}: /buffers")
    binary = bytearray()
    starts: List[int] = []

    def append(data: bytes) -> int:
        binary.extend(b"\0" * (-len(binary) % 4))
        if len(binary) + len(data) > limit:
            raise InvalidArgument(f"{file}: packed it is larger than the upload limit of {limit >> 20} MiB; give gobod a --root with the scene")
        start = len(binary)
        binary.extend(data)
        return start

    for i, buffer in enumerate(buffers):
        if not isinstance(buffer.get("uri"), str):
            raise InvalidArgument(f"{file}: /buffers/{i}/uri: is missing", place=f"{file}: /buffers/{i}/uri")
        starts.append(append(_fetch(buffer["uri"], folder, f"/buffers/{i}/uri", file, limit)))
    for i, view in enumerate(views):
        which = view.get("buffer")
        if not isinstance(which, int) or not 0 <= which < len(starts):
            raise InvalidArgument(f"{file}: /bufferViews/{i}/buffer = {which}: no such buffer", place=f"{file}: /bufferViews/{i}/buffer")
        view["byteOffset"] = int(view.get("byteOffset", 0)) + starts[which]
        view["buffer"] = 0
    for i, image in enumerate(images):
        if "uri" not in image:
            continue
        uri = str(image.pop("uri"))
        data = _fetch(uri, folder, f"/images/{i}/uri", file, limit)
        mime = uri[5:].split(";")[0].split(",")[0] if uri.startswith("data:") else _MIME.get(os.path.splitext(uri)[1].lower(), "")
        image.setdefault("mimeType", mime or "image/png")
        image["bufferView"] = len(views)
        views.append({"buffer": 0, "byteOffset": append(data), "byteLength": len(data)})
    if binary:
        document["buffers"], document["bufferViews"] = [{"byteLength": len(binary)}], views
    head = json.dumps(document, separators=(",", ":")).encode()
    head += b" " * (-len(head) % 4)
    binary.extend(b"\0" * (-len(binary) % 4))
    chunks = struct.pack("<II", len(head), _JSON) + head
    if binary:
        chunks += struct.pack("<II", len(binary), _BIN) + binary
    return struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks
