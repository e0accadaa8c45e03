# SPDX-License-Identifier: Apache-2.0
"""OpenEXR files. Where OpenImageIO's Python binding can be imported (Debian: python3-openimageio) it reads them: every compression, tiles, files of
several parts. Elsewhere a page of numpy does: single-part scan lines, no or ZIP compression, which is what Gobo writes by default. $GOBO_EXR or `use`
names one: "openimageio", "numpy". What is written is float, ZIP, by numpy, so that equal pictures are equal files: OpenImageIO adds the time of day."""
from __future__ import annotations

import contextlib
import importlib
import os
import struct
import tempfile
import threading
import zlib
from typing import Any, BinaryIO, Callable, Dict, Iterator, List, Mapping, Optional, Sequence, Tuple, TypeVar

import numpy as np

from .errors import InvalidArgument

T = TypeVar("T")
_MAGIC = 20000630
_TYPES: "Dict[int, np.dtype[Any]]" = {1: np.dtype("<f2"), 2: np.dtype("<f4")}
_LINES = {0: 1, 2: 1, 3: 16}   # compression -> lines of a block
_BACKENDS = ("openimageio", "numpy")
_chosen: "Optional[Tuple[str, Any]]" = None
_choosing = threading.Lock()


def use(name: Optional[str] = None) -> str:
    """Chooses who reads, "openimageio" or "numpy", and returns the name; None: $GOBO_EXR, else the first that can be imported.

    Raises: gobo.InvalidArgument: no such name, or it cannot be imported.
    """
    global _chosen
    wanted = name or os.environ.get("GOBO_EXR") or None
    if wanted not in (None, *_BACKENDS):
        raise InvalidArgument(f"exr = {wanted}: must be one of {', '.join(_BACKENDS)}", field="exr", value=wanted)
    library: Any = None
    if wanted != "numpy":
        try:
            library = importlib.import_module("OpenImageIO")
        except ImportError as e:
            if wanted is not None:
                raise InvalidArgument(f"exr = {wanted}: {e}", field="exr", value=wanted) from None
    with _choosing:
        _chosen = ("numpy" if library is None else "openimageio", library)
        return _chosen[0]


def _library() -> Any:
    """OpenImageIO's module, imported at the first need (it takes a second), or None."""
    if _chosen is None:
        use()
    assert _chosen is not None
    return _chosen[1]


@contextlib.contextmanager
def whole(path: str) -> Iterator[BinaryIO]:
    """A file to write that is there once it is whole: beside its place first, then renamed. OSErrors name `path`."""
    temporary = None
    try:
        handle, temporary = tempfile.mkstemp(prefix=".gobo-", dir=os.path.dirname(os.path.abspath(path)))
        with os.fdopen(handle, "wb") as file:
            yield file
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(temporary, 0o666 & ~mask)
        os.replace(temporary, path)
    except BaseException as error:
        if temporary is not None:
            os.unlink(temporary)
        if isinstance(error, OSError) and error.errno:
            error.filename, error.filename2 = path, None   # a full disk names none
        raise


def write_atomic(path: str, data: bytes) -> None:
    """`whole` of the bytes."""
    with whole(path) as file:
        file.write(data)


def _squeeze(raw: bytes) -> bytes:
    data = np.frombuffer(raw, np.uint8)
    mixed = np.concatenate([data[0::2], data[1::2]]).astype(np.int16)
    mixed[1:] = (mixed[1:] - mixed[:-1] + 384) & 255   # 384 = 128 + 256: the predictor's offset, kept positive
    packed = zlib.compress(mixed.astype(np.uint8).tobytes(), 4)
    return packed if len(packed) < len(raw) else raw


def _expand(packed: bytes, size: int) -> bytes:
    if len(packed) == size:
        return packed
    unzip = zlib.decompressobj()
    mixed = np.frombuffer(unzip.decompress(packed, size), np.uint8)
    if mixed.size != size:
        raise InvalidArgument("EXR: a block does not have its size")
    steps = mixed.astype(np.int64)
    steps[1:] -= 128
    plain = (np.cumsum(steps) & 255).astype(np.uint8)
    half = (size + 1) // 2
    out = np.empty(size, np.uint8)
    out[0::2], out[1::2] = plain[:half], plain[half:]
    return out.tobytes()


def write(path: str, channels: Mapping[str, np.ndarray], attributes: Optional[Mapping[str, str]] = None) -> None:
    """Writes `encode` of the same."""
    write_atomic(path, encode(channels, attributes))


def encode(channels: Mapping[str, np.ndarray], attributes: Optional[Mapping[str, str]] = None) -> bytes:
    """An EXR file of 2-D planes by channel name ("R", "albedo.R") as 32-bit float, ZIP, with text attributes.

    Errors: InvalidArgument when there is no channel or sizes differ.
    """
    planes = {name: np.ascontiguousarray(plane, "<f4") for name, plane in channels.items()}
    if not planes:
        raise InvalidArgument("EXR: no channel")
    shapes = {p.shape for p in planes.values()}
    if len(shapes) != 1 or len(next(iter(shapes))) != 2:
        raise InvalidArgument(f"EXR: channels must be planes of one size, not {sorted(shapes)}")
    height, width = next(iter(shapes))
    names = sorted(planes, key=lambda n: n.encode())

    def attribute(name: str, kind: str, value: bytes) -> bytes:
        return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(value)) + value
    listed = b"".join(n.encode() + b"\0" + struct.pack("<iBxxxii", 2, 0, 1, 1) for n in names) + b"\0"
    window = struct.pack("<iiii", 0, 0, width - 1, height - 1)
    head = struct.pack("<iI", _MAGIC, 2 | (0x400 if any(len(n) > 31 for n in [*names, *(attributes or {})]) else 0))
    head += attribute("channels", "chlist", listed) + attribute("compression", "compression", b"\3")
    head += attribute("dataWindow", "box2i", window) + attribute("displayWindow", "box2i", window)
    head += attribute("lineOrder", "lineOrder", b"\0") + attribute("pixelAspectRatio", "float", struct.pack("<f", 1))
    head += attribute("screenWindowCenter", "v2f", struct.pack("<ff", 0, 0)) + attribute("screenWindowWidth", "float", struct.pack("<f", 1))
    for name, text in (attributes or {}).items():
        head += attribute(name, "string", text.encode())
    head += b"\0"
    stacked = np.stack([planes[n] for n in names], axis=1)   # line, channel, column: the order of a block
    blocks = []
    for y in range(0, height, 16):
        packed = _squeeze(stacked[y:y + 16].tobytes())
        blocks.append(struct.pack("<ii", y, len(packed)) + packed)
    at = len(head) + 8 * len(blocks)
    offsets = []
    for block in blocks:
        offsets.append(at)
        at += len(block)
    return head + struct.pack(f"<{len(offsets)}Q", *offsets) + b"".join(blocks)


def _text(data: bytes, at: int) -> Tuple[str, int]:
    end = data.index(b"\0", at)
    return data[at:end].decode(), end + 1


def _header(data: bytes) -> Tuple[Dict[str, Tuple[str, bytes]], int]:
    attributes: Dict[str, Tuple[str, bytes]] = {}
    at = 8
    while data[at]:
        name, at = _text(data, at)
        kind, at = _text(data, at)
        size = struct.unpack_from("<i", data, at)[0]
        attributes[name] = (kind, data[at + 4:at + 4 + size])
        at += 4 + size
    return attributes, at + 1


def _channels(data: bytes) -> "Iterator[Tuple[str, np.dtype[Any]]]":
    at = 0
    while data[at]:
        name, at = _text(data, at)
        kind, xs, ys = struct.unpack_from("<i4xii", data, at)
        if kind not in _TYPES or (xs, ys) != (1, 1):
            raise InvalidArgument(f"EXR: channel {name}: only whole-resolution half and float are read")
        at += 16
        yield name, _TYPES[kind]


def read(path: "str | os.PathLike[str]") -> Tuple[Dict[str, np.ndarray], Dict[str, str]]:
    """Planes by channel name (float32) and the text attributes. Errors: InvalidArgument for files of other kinds."""
    with open(path, "rb") as file:
        data = file.read()
    return _guarded(lambda: _read(data) if _library() is None else _read_library(_library(), os.fspath(path), data), os.fspath(path))


def decode(data: bytes, name: str = "picture") -> Tuple[Dict[str, np.ndarray], Dict[str, str]]:
    """`read` of bytes; `name` is what errors call them."""
    def work() -> Tuple[Dict[str, np.ndarray], Dict[str, str]]:
        if _library() is None:
            return _read(data)
        with tempfile.NamedTemporaryFile(prefix="gobo-", suffix=".exr") as file:
            file.write(data)
            file.flush()
            return _read_library(_library(), file.name, data)
    return _guarded(work, name)


def attributes(data: bytes, name: str = "picture") -> Dict[str, Any]:
    """What the header of an EXR file says that is text (str), a number (int, float), or a matrix or vector of floats (tuple, as the file has it)."""
    def work() -> Dict[str, Any]:
        magic, _ = struct.unpack_from("<iI", data, 0)
        if magic != _MAGIC:
            raise InvalidArgument("not an EXR file")
        out: Dict[str, Any] = {}
        for key, (kind, value) in _header(data)[0].items():
            if kind == "string":
                out[key] = value.decode(errors="replace")
            elif kind in ("int", "float"):
                out[key] = struct.unpack("<i" if kind == "int" else "<f", value)[0]
            elif kind in ("v2f", "v3f", "m33f", "m44f"):
                out[key] = struct.unpack(f"<{len(value) // 4}f", value)
        return out
    return _guarded(work, name)


def _guarded(work: Callable[[], T], name: str) -> T:
    try:
        return work()
    except InvalidArgument as e:
        raise InvalidArgument(f"{name}: {e.message}") from None
    except (IndexError, ValueError, KeyError, struct.error, zlib.error, MemoryError) as e:
        raise InvalidArgument(f"{name}: not an EXR file that can be read here: {e}") from None


def _read_library(library: Any, path: str, data: bytes) -> Tuple[Dict[str, np.ndarray], Dict[str, str]]:
    magic = struct.unpack_from("<i", data, 0)[0]
    if magic != _MAGIC:
        raise InvalidArgument("EXR: not an EXR file")
    source = library.ImageInput.open(path)
    if source is None:
        raise InvalidArgument(f"EXR: {library.geterror()}")
    planes: Dict[str, np.ndarray] = {}
    try:
        part = 0
        while source.seek_subimage(part, 0):
            names = source.spec().channelnames
            pixels = source.read_image(part, 0, 0, len(names), "float")
            if pixels is None:
                raise InvalidArgument(f"EXR: {source.geterror()}")
            for c, name in enumerate(names):
                planes.setdefault(name, np.ascontiguousarray(pixels[:, :, c]))
            part += 1
    finally:
        source.close()
    texts = {name: value.decode(errors="replace") for name, (kind, value) in _header(data)[0].items() if kind == "string"}
    return planes, texts


def _read(data: bytes) -> Tuple[Dict[str, np.ndarray], Dict[str, str]]:
    magic, version = struct.unpack_from("<iI", data, 0)
    if magic != _MAGIC or version & 0x1a00:
        raise InvalidArgument("EXR: not a single-part file of scan lines")
    attributes, at = _header(data)
    compression = attributes["compression"][1][0]
    if compression not in _LINES:
        raise InvalidArgument("EXR: only ZIP and uncompressed files are read")
    x0, y0, x1, y1 = struct.unpack("<iiii", attributes["dataWindow"][1])
    width, height = x1 - x0 + 1, y1 - y0 + 1
    kinds = list(_channels(attributes["channels"][1]))
    planes = {name: np.empty((height, width), np.float32) for name, _ in kinds}
    line = sum(kind.itemsize for _, kind in kinds) * width
    lines = _LINES[compression]
    for offset in struct.unpack_from(f"<{(height + lines - 1) // lines}Q", data, at):
        y, size = struct.unpack_from("<ii", data, offset)
        rows = min(lines, height - (y - y0))
        packed = data[offset + 8:offset + 8 + size]
        if y < y0 or rows < 1 or len(packed) != size:
            raise InvalidArgument("EXR: a block is cut off or out of place")
        raw = _expand(packed, line * rows) if compression else packed
        position = 0
        for row in range(y - y0, y - y0 + rows):
            for name, kind in kinds:
                planes[name][row] = np.frombuffer(raw, kind, width, position)
                position += width * kind.itemsize
    texts = {name: value.decode(errors="replace") for name, (kind, value) in attributes.items() if kind == "string"}
    return planes, texts


def read_image(path: "str | os.PathLike[str]", layer: str = "") -> np.ndarray:
    """One layer as (height, width, channels): R, G, B, A in that order, else by name."""
    with open(path, "rb") as file:
        return decode_image(file.read(), os.fspath(path), layer)


def decode_image(data: bytes, name: str = "picture", layer: str = "") -> np.ndarray:
    """`read_image` of bytes."""
    planes, _ = decode(data, name)
    prefix = layer + "." if layer else ""
    mine = {n[len(prefix):]: p for n, p in planes.items() if n.startswith(prefix) and "." not in n[len(prefix):]}
    if not mine:
        raise InvalidArgument(f"{name}: no layer '{layer}' (channels: {', '.join(planes)})")
    order: Sequence[str] = [c for c in ("R", "G", "B", "A") if c in mine]
    rest: List[str] = sorted(c for c in mine if c not in order)
    return np.stack([mine[c] for c in [*order, *rest]], axis=2)
