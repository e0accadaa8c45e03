# SPDX-License-Identifier: Apache-2.0
"""What a render answers: pictures as arrays, the plan, the certificate, the resolved request."""
from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any, Dict, List, Optional, Sequence, TYPE_CHECKING, Unpack

import numpy as np
from google.protobuf import json_format

from . import exr
from .cancellation import Cancellation
from .errors import FailedPrecondition, InvalidArgument
from .image import Image, png, shown
from .pictures import Assembly, as_array
from .v1 import render_pb2

if TYPE_CHECKING:
    from .client import Client, Progressive, ProgressCallback
    from .fields import RequestFields


_EXTENSIONS = {render_pb2.Encoding.EXR: (".exr",), render_pb2.Encoding.PNG: (".png",), render_pb2.Encoding.JPEG: (".jpg", ".jpeg")}


@dataclass(frozen=True)
class Node:
    """One row of the plan."""
    node: str
    state: str               # "run", "reused", "pruned", "not_needed"
    reason: str
    ms: float
    rays: int
    bytes: int
    samples: int             # realised, of nodes that can be extended; else 0
    count: int               # nodes that this row stands for
    device: str
    key: str
    approximate: bool


@dataclass(frozen=True)
class Certificate:
    """How far the beauty is from the path-traced truth, with 95 % intervals (docs/certificate.md)."""
    rmse: float
    rmse_low: float
    rmse_high: float
    rel_mse: float
    rel_mse_low: float
    rel_mse_high: float
    standard_error: float
    pixels: int
    spp: int
    unseen_area: float
    not_covered: List[str]
    rays: int
    ms: float
    rmse_high_trimmed: float = 0.0   # without the worst unseen_area of the picture
    certain_pixels: int = 0          # of `pixels`: looked at because the picture says that errors may be there


def _node(n: render_pb2.NodeReport) -> Node:
    return Node(n.node, render_pb2.NodeReport.State.Name(n.state).lower(), n.reason, n.ms, n.rays, n.bytes, n.samples, max(n.count, 1), n.device,
                n.key, n.approximate)


def _certificate(c: render_pb2.Certificate) -> Certificate:
    return Certificate(c.rmse, c.rmse_low, c.rmse_high, c.rel_mse, c.rel_mse_low, c.rel_mse_high, c.standard_error, c.pixels, c.spp,
                       c.unseen_area, list(c.not_covered), c.rays, c.ms, c.rmse_high_trimmed, c.certain_pixels)


class Result:
    """A finished picture, or (`final` is False) a snapshot on the way to it.

    Attributes:
        image: float32 (height, width, channels), scene-linear, top row first: the first output.
        outputs: every output by name.
        channels: names of the channels of each output, such as ["R", "G", "B"].
        encoded: bytes of outputs that were asked for in a file format (`format="png"`); these have no array.
        plan: list of `Node`: what ran, what was reused and why.
        certificate: `Certificate`, or None when it was not asked for.
        resolved: the request with every default filled in; sent again it gives the same bits.
        render_id: handle for relights.
        edit: which edit of a `Session` it shows.
        reply: the message itself, with everything else.
    """

    def __init__(self, client: "Client", assembly: Assembly, final: bool) -> None:
        self._client = client
        self.final = final
        self.edit = 0
        reply = self.reply = assembly.reply
        self.outputs: Dict[str, Image] = {}
        self.encoded: Dict[str, bytes] = {}
        self.channels: Dict[str, List[str]] = {}
        for image, data in zip(reply.images, assembly.encoded()):
            self.channels[image.output] = list(image.channels)
            array = as_array(image, data)
            if array is None:
                self.encoded[image.output] = data.tobytes()
            else:
                self.outputs[image.output] = array
        self.render_id: str = reply.render_id
        self.request_hash: str = reply.request_hash
        self.resolved: render_pb2.RenderRequest = reply.resolved
        self.plan: List[Node] = [_node(n) for n in reply.plan]
        self.certificate: Optional[Certificate] = _certificate(reply.certificate) if reply.HasField("certificate") else None
        self.total_ms: float = reply.total_ms
        self.queue_ms: float = reply.queue_ms
        self.rays: int = reply.rays
        self.seed: int = reply.seed
        self.build: str = reply.build
        self.warnings: List[str] = list(reply.warnings)
        self.path_classes_missing: List[str] = list(reply.path_classes_missing)

    @property
    def image(self) -> Image:
        for array in self.outputs.values():
            return array
        raise FailedPrecondition("the pictures were asked for in a file format: their bytes are in .encoded", field="encoding.format")

    def png(self, output: Optional[str] = None) -> bytes:
        """A PNG file of one output (the first unless named) for looking at, made here: exposure, curve and transfer function as the request has
        them, so that light looks as in `save("x.png")`; normals, depths and the like from their least to their largest value."""
        name = output if output is not None else next(iter(self.channels))
        if name in self.outputs:
            return png(self.shown(name))
        data = self.encoded.get(name)
        if data is None or not data.startswith(b"\x89PNG"):
            raise InvalidArgument(f"output = {name}: not an array or PNG of this result (has: {', '.join(self.channels)})", field="output")
        return data

    def shown(self, output: str) -> np.ndarray:
        """uint8 (height, width, channels): what `png` shows of an output that has an array."""
        tone, transfer = self.resolved.tone_map, render_pb2.Encoding.Transfer.Name(self.resolved.encoding.transfer).lower()
        return shown(self.outputs[output], output, tone, transfer if transfer in ("srgb", "rec709", "linear") else "srgb")

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> Dict[str, Any]:
        """What a notebook shows: the first output that it can."""
        bundle: Dict[str, Any] = {"text/plain": repr(self)}
        for name, data in self.encoded.items():
            for kind, start in (("image/png", b"\x89PNG"), ("image/jpeg", b"\xff\xd8")):
                if data.startswith(start) and len(bundle) == 1:
                    bundle[kind] = data
        if len(bundle) == 1 and self.outputs:
            bundle["image/png"] = self.png(next(iter(self.outputs)))
        return bundle

    def _repr_png_(self) -> Optional[bytes]:
        data: Optional[bytes] = self._repr_mimebundle_().get("image/png")
        return data

    def _repr_jpeg_(self) -> Optional[bytes]:
        data: Optional[bytes] = self._repr_mimebundle_().get("image/jpeg")
        return data

    @property
    def samples(self) -> int:
        """Samples per pixel that the most refined node has."""
        return max((n.samples for n in self.plan), default=0)

    def ran(self) -> List[str]:
        """Names of the nodes that were computed for this picture; empty: everything was reused."""
        return [n.node for n in self.plan if n.state == "run"]

    def resolved_dict(self) -> Dict[str, Any]:
        """The resolved request in protobuf's JSON mapping: what `gobo render --request` and `request=` take."""
        return json_format.MessageToDict(self.resolved, preserving_proto_field_name=True)

    def relight(self, *, timeout: Optional[float] = None, on_progress: "Optional[ProgressCallback]" = None, cancel: Optional[Cancellation] = None,
                **fields: "Unpack[RequestFields]") -> "Result":
        """Renders again with changes: see `Client.relight`."""
        return self._client.relight(self.render_id, timeout=timeout, on_progress=on_progress, cancel=cancel, **fields)

    def relight_progressive(self, *, timeout: Optional[float] = None, on_progress: "Optional[ProgressCallback]" = None,
                            cancel: Optional[Cancellation] = None, **fields: "Unpack[RequestFields]") -> "Progressive":
        """Renders again with changes and shows pictures on the way: see `Client.relight_progressive`."""
        return self._client.relight_progressive(self.render_id, timeout=timeout, on_progress=on_progress, cancel=cancel, **fields)

    def save(self, path: "str | os.PathLike[str]", output: Optional[str] = None) -> str:
        """Writes one output (the first unless named) or, to .exr and .npz, all of them; returns the path.

        .exr: float, ZIP, channels "R" of the first output and "albedo.R" of others, with the resolved request in the header.
        .npy, .npz, .raw: the floats. .png, .jpg: tone mapped by the server (`exposure`), which must still know the render.
        Of a result that was asked for in a file format, its bytes as they are: one output, under an extension of that format.
        The file appears by rename: one that is there is whole.
        """
        path = os.fspath(path)
        kind = os.path.splitext(path)[1].lower()
        chosen = [output] if output is not None else list(self.outputs) or list(self.encoded)
        unknown = [n for n in chosen if n not in self.outputs and n not in self.encoded]
        if unknown:
            raise InvalidArgument(f"output = {unknown[0]}: not in this result (has: {', '.join(self.channels)})", field="output")
        if chosen[0] in self.encoded:
            self._check_encoded(path, kind, chosen)
            exr.write_atomic(path, self.encoded[chosen[0]])
        elif kind == ".exr":
            exr.write(path, self._planes(chosen), self._header(chosen))
        elif kind == ".npz":
            with exr.whole(path) as file:   # by a name numpy would add the extension that it knows
                np.savez(file, **{n.replace(":", "_"): self.outputs[n] for n in chosen})
        elif kind == ".npy":
            with exr.whole(path) as file:
                np.save(file, self.outputs[chosen[0]])
        elif kind == ".raw":
            exr.write_atomic(path, self.outputs[chosen[0]].astype("<f4").tobytes())
        elif kind in (".png", ".jpg", ".jpeg"):
            form = "png" if kind == ".png" else "jpeg"
            picture = self._client.relight(self.render_id, outputs=[chosen[0]], format=form, certificate=False)
            exr.write_atomic(path, picture.encoded[chosen[0]])
        else:
            raise InvalidArgument(f"path = {path}: the extension must be .exr, .png, .jpg, .raw, .npy or .npz", field="path")
        return path

    def _check_encoded(self, path: str, kind: str, chosen: Sequence[str]) -> None:
        if len(chosen) > 1:
            raise InvalidArgument(f"path = {path}: each of {', '.join(chosen)} is a file of its own (format=): choose one with output=", field="output")
        form = next(image.format for image in self.reply.images if image.output == chosen[0])
        fitting = _EXTENSIONS.get(form, (kind,))   # of a format of later versions any will do
        if kind not in fitting:
            raise InvalidArgument(f"path = {path}: {chosen[0]} was asked for as {render_pb2.Encoding.Format.Name(form)} (format=), the extension must be "
                                  f"{' or '.join(fitting)}", field="path")

    def _planes(self, names: Sequence[str]) -> Dict[str, np.ndarray]:
        planes: Dict[str, np.ndarray] = {}
        for i, name in enumerate(names):
            # EXR separates layers by dots, so one inside a light's name would split it.
            prefix = "" if i == 0 else name.replace(".", "_") + "."
            for c, channel in enumerate(self.channels[name]):
                planes[prefix + channel] = self.outputs[name][:, :, c]
        return planes

    def _header(self, names: Sequence[str]) -> Dict[str, str]:
        text = json_format.MessageToJson(self.resolved, preserving_proto_field_name=True, indent=None)
        return {"gobo:request": text, "gobo:request_hash": self.request_hash, "gobo:output": ",".join(names), "gobo:seed": str(self.seed),
                "gobo:build": self.build}

    def __repr__(self) -> str:
        shapes = ", ".join(f"{n} {'x'.join(map(str, a.shape))}" for n, a in self.outputs.items()) or ", ".join(self.encoded)
        error = f", RMSE {self.certificate.rmse:.3g}" if self.certificate else ""
        return f"<gobo.Result {self.render_id}{'' if self.final else ' (snapshot)'}: {shapes}; {self.total_ms:.1f} ms, {self.rays} rays{error}>"
