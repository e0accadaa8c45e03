# SPDX-License-Identifier: Apache-2.0
"""Pictures for looking at: the server's display transform in numpy (renderer/formulas/tone_map.glsl.h), PNG, and arrays that a notebook shows."""
from __future__ import annotations

import math
import struct
import zlib
from typing import Any, Optional

import numpy as np

from .errors import InvalidArgument

CURVES = ("linear", "reinhard", "filmic", "aces", "pbr_neutral")
_ACES_IN = np.array([[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]])
_ACES_OUT = np.array([[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]])
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
#: Outputs that are not light; they are shown without exposure or curve, those of any range from their least to their largest value.
_NOT_LIGHT = ("albedo", "normal", "position", "depth", "alpha", "object_id", "material_id", "cryptomatte_object", "cryptomatte_material", "motion", "sample_count", "variance", "visibility",
              "shadow_distance", "shadow_flags", "shadow_rays", "shadow_width", "shadow_basis")


class Image(np.ndarray):
    """float32 (height, width, channels), scene-linear, top row first: a numpy array that a notebook shows as a picture."""

    def __array_wrap__(self, array: Any, *context: Any) -> Any:
        return array[()] if array.ndim == 0 else np.ndarray.__array_wrap__(self, array, *context)   # a mean is a number

    def _repr_png_(self) -> Optional[bytes]:
        if self.ndim not in (2, 3) or 0 in self.shape or (self.ndim == 3 and self.shape[2] not in (1, 3, 4)) or self.dtype.kind not in "fiub":
            return None   # a part or a product that is no picture: shown as numbers
        return png(tone_mapped(self, auto_exposure=True))


def chosen_exposure(image: np.ndarray) -> float:
    """Stops that the server chooses for a PNG or JPEG that would be nearly black or nearly white; 0 for others."""
    step = -(-(image.shape[0] * image.shape[1]) // 65536) | 1
    pixels = image.reshape(image.shape[0] * image.shape[1], -1)[::step].astype(np.float64)
    y = pixels[:, :3] @ _LUMINANCE if pixels.shape[1] >= 3 else pixels[:, 0]
    y = y[(y > 0) & np.isfinite(y)]
    mean = float(np.log2(y).mean()) if y.size else -2.0
    if -7 <= mean <= 1:
        return 0.0
    return min(max(math.floor((math.log2(0.18) - mean) * 4 + 0.5) / 4, -32.0), 32.0)


def tone_mapped(image: np.ndarray, exposure: float = 0.0, curve: str = "filmic", transfer: str = "srgb", auto_exposure: bool = False) -> np.ndarray:
    """uint8 (height, width, channels) as the server's PNG has it (to a code value); a fourth channel is alpha.

    Args:
        image: float (height, width) or (height, width, 1, 3 or 4), linear.
        exposure: stops.
        curve: "linear", "reinhard", "filmic", "aces", "pbr_neutral".
        transfer: "srgb", "rec709" or "linear" code values.
        auto_exposure: chooses an exposure on top where the picture would be nearly black or white.
    """
    if curve not in CURVES:
        raise InvalidArgument(f"curve = {curve!r}: must be one of {', '.join(CURVES)}", field="curve", value=repr(curve))
    if transfer not in ("srgb", "rec709", "linear"):
        raise InvalidArgument(f'transfer = {transfer!r}: must be "srgb", "rec709" or "linear"', field="transfer", value=repr(transfer))
    pixels = np.asarray(image, np.float64)
    if pixels.ndim == 2:
        pixels = pixels[:, :, None]
    alpha = pixels[:, :, 3:4] if pixels.shape[2] == 4 else None
    x = pixels[:, :, :3]
    if auto_exposure:
        exposure += chosen_exposure(pixels)
    x = x * 2.0 ** exposure
    x = np.minimum(np.where(x > 0, x, 0.0), 1e9)   # NaN and negative values: 0
    y = _encoded(_curve(x, curve), transfer)
    if alpha is not None:
        y = np.concatenate([y, np.clip(np.nan_to_num(alpha), 0, 1)], 2)
    out: np.ndarray = np.floor(y * 255 + 0.5).astype(np.uint8)
    return out


def _curve(x: np.ndarray, curve: str) -> np.ndarray:
    if curve == "linear":
        return np.minimum(x, 1.0)
    if curve == "reinhard":
        return x / (1 + x)
    if curve == "filmic":
        return np.minimum(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), 1.0)
    c = np.broadcast_to(x, (*x.shape[:2], 3))   # a grey is a colour with three equal parts
    if curve == "aces":
        v = c @ _ACES_IN.T
        c = np.clip(((v * (v + 0.0245786) - 0.000090537) / (v * (0.983729 * v + 0.4329510) + 0.238081)) @ _ACES_OUT.T, 0, 1)
    else:
        low, high = c.min(2, keepdims=True), c.max(2, keepdims=True)
        offset = np.where(low < 0.08, low - 6.25 * low * low, 0.04)
        peak = high - offset
        safe = np.maximum(peak, 0.76)
        compressed = 1 - 0.0576 / (safe + (0.24 - 0.76))
        grey = 1 - 1 / (0.15 * (safe - compressed) + 1)
        scaled = (c - offset) * (compressed / safe)
        c = np.clip(np.where(peak < 0.76, c - offset, scaled + (compressed - scaled) * grey), 0, 1)
    return c[:, :, :x.shape[2]]


def _encoded(x: np.ndarray, transfer: str) -> np.ndarray:
    if transfer == "srgb":
        return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 1e-9) ** (1 / 2.4) - 0.055)
    if transfer == "rec709":
        return np.where(x < 0.018053968510807, 4.5 * x, 1.09929682680944 * np.maximum(x, 1e-9) ** 0.45 - 0.09929682680944)
    return x


def shown(image: np.ndarray, output: str, settings: Any = None, transfer: str = "srgb") -> np.ndarray:
    """uint8 picture of an output by its name; `settings`: ToneMap of the request."""
    kind = output.split(":")[0]
    if kind not in _NOT_LIGHT:
        if settings is None:
            return tone_mapped(image, auto_exposure=True)
        curve = CURVES[max(settings.curve - 1, 0)] if settings.curve else "filmic"
        return tone_mapped(image, settings.exposure, curve, transfer, settings.auto_exposure and settings.exposure == 0)
    if kind in ("cryptomatte_object", "cryptomatte_material"):
        return _matte_colours(image)
    pixels = np.asarray(image, np.float64)
    if kind not in ("albedo", "alpha", "visibility"):
        fine = pixels[np.isfinite(pixels)]
        low, high = (float(fine.min()), float(fine.max())) if fine.size else (0.0, 1.0)
        pixels = (pixels - low) / ((high - low) or 1.0)
    return tone_mapped(pixels[:, :, :1] if pixels.shape[2] == 2 else pixels[:, :, :3], curve="linear", transfer="srgb" if kind == "albedo" else "linear")


def _matte_colours(ranks: np.ndarray) -> np.ndarray:
    """uint8 of pairs (id, coverage): the mean of the ids' colours, as the server's PNG has it (to a code value)."""
    pairs = np.ascontiguousarray(ranks, np.float32)
    h = np.ascontiguousarray(pairs[:, :, 0::2]).view(np.uint32).astype(np.uint64)
    h ^= h >> np.uint64(30)
    h *= np.uint64(0xbf58476d1ce4e5b9)
    h ^= h >> np.uint64(27)
    h *= np.uint64(0x94d049bb133111eb)
    h ^= h >> np.uint64(31)
    colours = np.stack([56 + (h >> np.uint64(16 * c) & np.uint64(0xffff)) * (199 / 65535) for c in range(3)], axis=3)
    out: np.ndarray = np.floor(np.minimum((colours * np.maximum(pairs[:, :, 1::2, None], 0)).sum(2), 255) + 0.5).astype(np.uint8)
    return out


def png(pixels: np.ndarray) -> bytes:
    """A PNG file of uint8 (height, width) or (height, width, channels); 1 to 4 channels: grey, grey and alpha, RGB, RGBA."""
    if pixels.ndim == 2:
        pixels = pixels[:, :, None]
    if pixels.dtype != np.uint8 or pixels.ndim != 3 or not 1 <= pixels.shape[2] <= 4 or 0 in pixels.shape:
        raise InvalidArgument(f"png: must be uint8 of 1 to 4 channels, not {pixels.dtype} {pixels.shape}", field="pixels")
    height, width, channels = pixels.shape
    rows = np.zeros((height, 1 + width * channels), np.uint8)   # in front of each row its filter: 2, the difference to the row above
    flat = np.ascontiguousarray(pixels).reshape(height, width * channels)
    rows[:, 1:] = flat
    rows[1:, 0] = 2
    rows[1:, 1:] -= flat[:-1]

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    head = struct.pack(">IIBBBBB", width, height, 8, (0, 4, 2, 6)[channels - 1], 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows.tobytes(), 6)) + chunk(b"IEND", b"")
