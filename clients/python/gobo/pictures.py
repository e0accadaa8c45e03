# SPDX-License-Identifier: Apache-2.0
"""Pictures as they arrive: a head message and its chunks, put together, checked, and seen as numpy arrays."""
from __future__ import annotations

from typing import Any, Dict, List, Optional

import numpy as np

from .errors import DataLoss
from .image import Image
from .v1 import render_pb2

try:   # the digest is xxh3-128; without python3-xxhash sizes and offsets are still checked
    from xxhash import xxh3_128_hexdigest as _digest
except ImportError:
    _digest = None  # type: ignore[assignment]

_RAW: "Dict[int, np.dtype[Any]]" = {render_pb2.Encoding.RAW_FLOAT: np.dtype("<f4"), render_pb2.Encoding.RAW_HALF: np.dtype("<f2")}
_LARGEST = 1 << 36


def _lost(what: str) -> DataLoss:
    return DataLoss(f"the server's answer is damaged: {what}")


class Assembly:
    """Bytes of the pictures of one reply or snapshot."""

    def __init__(self, reply: render_pb2.RenderReply) -> None:
        self.reply = reply
        self._bytes: List[np.ndarray] = []
        self._filled: List[int] = []
        for image in reply.images:
            kind = _RAW.get(image.format)
            if image.bytes > _LARGEST or (kind and image.bytes != image.width * image.height * len(image.channels) * kind.itemsize):
                raise _lost(f"{image.output} of {image.width} x {image.height} x {len(image.channels)} in {image.bytes} bytes")
            self._bytes.append(np.empty(image.bytes, np.uint8))
            self._filled.append(0)

    def add(self, chunk: render_pb2.ImageChunk) -> None:
        if chunk.image >= len(self._bytes):
            raise _lost(f"a chunk of image {chunk.image}")
        target, at, data = self._bytes[chunk.image], self._filled[chunk.image], chunk.data
        if chunk.offset != at or len(data) > target.size - at:
            raise _lost(f"a chunk at offset {chunk.offset} where {at} was due")
        target[at:at + len(data)] = np.frombuffer(data, np.uint8)
        self._filled[chunk.image] = at + len(data)

    @property
    def complete(self) -> bool:
        return all(n == b.size for n, b in zip(self._filled, self._bytes))

    def encoded(self) -> List[np.ndarray]:
        """The checked bytes of every picture. Errors: DataLoss."""
        if not self.complete:
            raise _lost("pictures are incomplete")
        if _digest is not None:
            for image, data in zip(self.reply.images, self._bytes):
                if image.digest and _digest(data) != image.digest:
                    raise _lost(f"digest of {image.output}")
        return self._bytes


def as_array(image: render_pb2.ImageDescriptor, data: np.ndarray) -> Optional[Image]:
    """float32 (height, width, channels) of a raw picture; None for encoded ones."""
    kind = _RAW.get(image.format)
    if kind is None:
        return None
    pixels = data.view(kind).reshape(image.height, image.width, len(image.channels))
    return np.ascontiguousarray(pixels, np.float32).view(Image)
