# SPDX-License-Identifier: Apache-2.0
"""Render requests from Python values, by reflection over the schema: a new field of the protocol needs no code here.

Names are checked here, with a suggestion for a misspelt one; ranges and defaults are the server's (it has the schema too).
"""
from __future__ import annotations

import difflib
import json
import numbers
import os
import re
from typing import Any, Dict, Iterable, List, Mapping, Optional, Sequence, Tuple, TypedDict, Union

from google.protobuf.descriptor import Descriptor, FieldDescriptor
from google.protobuf.message import Message

from .camera import Camera
from .errors import InvalidArgument
from .v1 import render_pb2

Vector = Union[float, Sequence[float], Mapping[str, float]]
#: One light of `lights`: fields of LightEdit, a number or RGB triple (gain), True or False (on, off), or None (undo the edit; relight).
Light = Union[Mapping[str, Any], float, Sequence[float], bool, None]
#: A file, "none", a uniform radiance, a lat-long map as an array (height, width, 3), or the fields of EnvironmentSettings.
Environment = Union[str, "os.PathLike[str]", float, Sequence[float], "np.ndarray", Mapping[str, Any], None]


class RequestFields(TypedDict, total=False):
    """What `render`, `render_progressive`, `relight` and `jobs.submit` take by keyword. Later entries of this list win."""
    request: Union[Mapping[str, Any], render_pb2.RenderRequest]  # a whole request to start from: JSON-like or message
    outputs: Union[str, Sequence[str]]      # "beauty", "albedo", "visibility:LIGHT", ...
    width: int
    height: int
    size: Tuple[int, int]                   # (width, height)
    spp: int                                # halt.spp
    max_seconds: float                      # halt.time_s: stop after this time
    max_error: float                        # halt.error: stop when the certificate says so
    seed: int
    camera: Union[str, Mapping[str, Any], Camera]   # a name, fields of CameraSettings, or a gobo.Camera
    lights: Mapping[str, Light]
    env: Environment
    exposure: float                         # tone_map.exposure, stops
    certificate: Union[bool, float, Mapping[str, Any]]  # True, a share of the pixels, or fields
    priority: str                           # "interactive", "normal", "batch"
    display: str                            # encoding.display, with format "png" or "jpeg": of the server's OpenColorIO config (docs/color.md)
    view: str                               # encoding.view
    look: str                               # encoding.look
    format: str                             # transport: "raw_float" (default), "raw_half", "exr", "png", "jpeg"
    halt: Mapping[str, Any]
    view_samples: int
    integrator: Mapping[str, Any]
    environment: Mapping[str, Any]
    shadows: Union[str, Mapping[str, Any]]  # "axis_aligned", or {"axis_aligned": {"k": 2}}
    denoise: Union[str, Mapping[str, Any]]  # "auto", {"wavelet": {"levels": 4}}, {"outliers": {"path_density": {}}}
    tone_map: Mapping[str, Any]
    encoding: Mapping[str, Any]
    scheduling: Mapping[str, Any]
    scene_hash: str
    time_s: float                           # of the animation
    animation: str
    variant: str                            # of the materials
    window: Mapping[str, int]               # x, y, width, height: this part of the picture alone
    motion_step_s: float
    photometric: bool
    curves: Mapping[str, Mapping[str, Any]]  # by path: {"lights.key.intensity": {"time_s": [0, 1], "value": [1, 9], "interpolation": "SMOOTH"}}
    expressions: Mapping[str, Union[str, Mapping[str, Any]]]  # by path: {"shadows.style.softness": "0.02 + 0.3*distance"} (docs/expressions.md)
    style: Union[str, "os.PathLike[str]"]   # a style sheet's file: shadows.style, lights.NAME.shadow.style and expressions of these alone (docs/intent.md)
    filters: Sequence[Mapping[str, Any]]    # [{"bloom": {"gain": 0.3}}, {"term": "indirect", "gaussian": {"sigma_px": 4}}] (docs/picture_filters.md)
    meshes: Mapping[str, Mapping[str, Any]]  # by object, or "*": {"ball": {"inflate": 0.05}, "*": {"cluster": 0.1, "smooth": 10}}
    set: Mapping[str, Any]                  # by path: {"integrator.max_bounces": 2}


#: Keywords that are short for a path.
SHORT = {"spp": "halt.spp", "max_seconds": "halt.time_s", "max_error": "halt.error", "exposure": "tone_map.exposure", "priority": "scheduling.priority",
         "format": "encoding.format", "display": "encoding.display", "view": "encoding.view", "look": "encoding.look", "env": "environment"}
_SCALAR_VECTORS = {"gain", "color", "constant"}   # vectors that one number may stand for


def _suggest(name: str, known: Iterable[str]) -> str:
    names = list(known)
    near = difflib.get_close_matches(name, names, 1)
    return f"did you mean '{near[0]}'?" if near else "has: " + ", ".join(sorted(names))


def _fail(where: str, value: Any, must: str) -> InvalidArgument:
    text = repr(value)
    return InvalidArgument(f"{where} = {text[:80]}: {must}", field=where, value=text)


def _field(descriptor: Descriptor, name: str, where: str) -> FieldDescriptor:
    field = descriptor.fields_by_name.get(name) or descriptor.fields_by_camelcase_name.get(name)
    if field is None:
        known = list(descriptor.fields_by_name)
        if descriptor.full_name == "gobo.v1.RenderRequest":
            known += [k for k in RequestFields.__annotations__ if k not in known]
        raise InvalidArgument(f"no field '{name}' in {descriptor.name}: {_suggest(name, known)}", field=where)
    return field


def _is_map(field: FieldDescriptor) -> bool:
    return field.message_type is not None and field.message_type.GetOptions().map_entry


def _is_number(value: Any) -> bool:
    return isinstance(value, numbers.Number) and not isinstance(value, (bool, complex))


class Builder:
    """Fills one message and remembers which paths were set or cleared (the mask of a relight)."""

    def __init__(self, message: Message) -> None:
        self.message = message
        self.cleared: List[str] = []

    def put(self, path: str, value: Any) -> None:
        """Sets a dotted path. Keys of maps (light names) may hold dots: the shortest reading that fits wins."""
        message: Message = self.message
        parts = path.split(".")
        at = 0
        while True:
            field = _field(message.DESCRIPTOR, parts[at], path)
            rest = parts[at + 1:]
            if not rest:
                return self._assign(message, field, value, path)
            if _is_map(field):
                inner = field.message_type.fields_by_name["value"].message_type
                known = inner.fields_by_name
                cut = next((i for i in range(1, len(rest)) if rest[i] in known), len(rest))
                key = ".".join(rest[:cut])
                if cut == len(rest):
                    return self._assign(message, field, {key: value}, ".".join(parts[:at + 1]))
                message = getattr(message, field.name)[key]
                at += 1 + cut
                continue
            if field.message_type is None or field.label == FieldDescriptor.LABEL_REPEATED:
                raise InvalidArgument(f"'{parts[at]}' in '{path}' has no fields of its own", field=path)
            message = getattr(message, field.name)
            at += 1

    def merge(self, message: Message, values: Mapping[str, Any], where: str) -> None:
        for name, value in values.items():
            path = f"{where}.{name}" if where else name
            self._assign(message, _field(message.DESCRIPTOR, name, path), value, path)

    def _assign(self, message: Message, field: FieldDescriptor, value: Any, where: str) -> None:
        if value is None:
            message.ClearField(field.name)
            self.cleared.append(where)
        elif _is_map(field):
            self._assign_map(message, field, value, where)
        elif field.label == FieldDescriptor.LABEL_REPEATED:
            self._assign_list(message, field, value, where)
        elif field.message_type is not None:
            self._assign_message(message, field, value, where)
        else:
            setattr(message, field.name, _scalar(field, value, where))

    def _assign_map(self, message: Message, field: FieldDescriptor, value: Any, where: str) -> None:
        if not isinstance(value, Mapping):
            raise _fail(where, value, "must be a mapping by name")
        entries = getattr(message, field.name)
        for key, entry in value.items():
            path = f"{where}.{utf8(key, where) if isinstance(key, str) else key}"
            if entry is None:
                entries.pop(key, None)
                self.cleared.append(path)
                continue
            target = entries[key]
            if isinstance(entry, Message):
                target.CopyFrom(entry)
            elif isinstance(entry, Mapping):
                self.merge(target, entry, path)
            elif target.DESCRIPTOR.name == "LightEdit":
                self.merge(target, {"enabled": entry} if isinstance(entry, bool) else {"gain": entry}, path)
            elif target.DESCRIPTOR.name == "Expression" and (isinstance(entry, str) or _is_number(entry)):
                self.merge(target, {"formula": str(entry)}, path)
            elif target.DESCRIPTOR.name == "InstancePatch":
                self.merge(target, {"matrix": entry}, path)
            else:
                raise _fail(path, entry, "must be a mapping of " + ", ".join(target.DESCRIPTOR.fields_by_name))

    def _assign_list(self, message: Message, field: FieldDescriptor, value: Any, where: str) -> None:
        if isinstance(value, str):
            value = value.split(",")
        elif hasattr(value, "tolist"):
            if getattr(value, "ndim", 1) == 2:   # a 4x4 matrix is column-major; of others a row is what belongs together: a curve's vector
                value = (value.T if field.name == "matrix" else value).ravel()
            value = value.tolist()
        message.ClearField(field.name)
        target = getattr(message, field.name)
        try:
            items = list(value)
        except TypeError:
            raise _fail(where, value, "must be a list") from None
        for i, item in enumerate(items):
            if field.message_type is None:
                target.append(_scalar(field, item, f"{where}[{i}]"))
            elif isinstance(item, Message):
                target.add().CopyFrom(item)
            else:
                self.merge(target.add(), item, f"{where}[{i}]")

    def _assign_message(self, message: Message, field: FieldDescriptor, value: Any, where: str) -> None:
        target = getattr(message, field.name)
        if isinstance(value, Message):
            if value.DESCRIPTOR is not target.DESCRIPTOR:
                raise _fail(where, value, f"must be a {target.DESCRIPTOR.name}")
            target.CopyFrom(value)
            target.SetInParent()
            return
        if target.DESCRIPTOR.full_name == "gobo.v1.Vector3":
            target.x, target.y, target.z = _vector(field, value, where)
            target.SetInParent()
            return
        if isinstance(value, Mapping):
            target.SetInParent()
            self.merge(target, value, where)
            return
        short = _short(target, value)
        if short is None:
            raise _fail(where, value, "must be a mapping of " + ", ".join(target.DESCRIPTOR.fields_by_name))
        target.SetInParent()
        self.merge(target, short, where)

    def mask(self, whole: Sequence[str] = ()) -> List[str]:
        """Paths of everything set or cleared; `whole` ones stand for all below them."""
        paths: List[str] = []
        _leaves(self.message, "", paths)
        paths += [p for p in self.cleared if p not in paths]
        return [p for p in paths if not any(p == w or p.startswith(w + ".") for w in whole)] + list(whole)


def _short(target: Message, value: Any) -> Optional[Dict[str, Any]]:
    """What a bare value means where a message is due."""
    name = target.DESCRIPTOR.name
    if name == "CameraSettings" and isinstance(value, str):
        return {"name": value}
    if name == "CameraSettings" and isinstance(value, Camera):
        return value.fields()
    if name == "CertificateSettings" and (_is_number(value) or value is True):
        return {} if value is True else {"pixel_fraction": value}
    if name == "EnvironmentSettings":
        if isinstance(value, (str, os.PathLike)):
            text = os.fspath(value)
            return {"path": os.path.abspath(text) if os.path.isfile(text) else text}
        return {"constant": value}
    if isinstance(value, str) and target.DESCRIPTOR.oneofs and value in target.DESCRIPTOR.fields_by_name:
        return {value: {}}   # shadows="axis_aligned": with its defaults
    return None


def _vector(field: FieldDescriptor, value: Any, where: str) -> Tuple[float, float, float]:
    if isinstance(value, Mapping):
        unknown = [k for k in value if k not in ("x", "y", "z")]
        if unknown:
            raise InvalidArgument(f"no field '{unknown[0]}' in Vector3: has x, y, z", field=where)
        value = [value.get(k, 0.0) for k in "xyz"]
    if _is_number(value) and field.name in _SCALAR_VECTORS:
        value = [value] * 3
    try:
        x, y, z = (float(v) for v in value)
    except (TypeError, ValueError):
        raise _fail(where, value, "must be three numbers") from None
    return x, y, z


def utf8(text: str, where: str) -> str:
    """The text, if a message can hold it: names of files that are not UTF-8 come with surrogates."""
    try:
        text.encode()
    except UnicodeEncodeError:
        raise InvalidArgument(f"{where} = {text!r}: is not UTF-8", field=where, value=ascii(text)) from None
    return text


def _scalar(field: FieldDescriptor, value: Any, where: str) -> Any:
    kind = field.cpp_type
    if kind == FieldDescriptor.CPPTYPE_ENUM:
        if isinstance(value, str):
            entry = field.enum_type.values_by_name.get(value.upper())
            if entry is None:
                names = ", ".join(v.name.lower() for v in field.enum_type.values if v.number)
                raise _fail(where, value, f"must be one of {names}")
            return entry.number
        if _is_number(value):
            return int(value)
        raise _fail(where, value, "must be a name")
    if kind == FieldDescriptor.CPPTYPE_STRING:
        if field.type == FieldDescriptor.TYPE_BYTES:
            return bytes(value)
        if isinstance(value, (str, os.PathLike)):
            return utf8(os.fspath(value), where)
        raise _fail(where, value, "must be text")
    if kind == FieldDescriptor.CPPTYPE_BOOL:
        if isinstance(value, bool) or type(value).__name__ == "bool_":
            return bool(value)
        raise _fail(where, value, "must be True or False")
    if isinstance(value, bool) or not _is_number(value):
        text = value.strip() if isinstance(value, str) else ""
        if not text.isdigit():   # 64-bit integers are strings in protobuf's JSON
            raise _fail(where, value, "must be a number")
        value = int(text)
    if kind in (FieldDescriptor.CPPTYPE_FLOAT, FieldDescriptor.CPPTYPE_DOUBLE):
        return float(value)
    if int(value) != value:
        raise _fail(where, value, "must be a whole number")
    signed = kind in (FieldDescriptor.CPPTYPE_INT32, FieldDescriptor.CPPTYPE_INT64)
    bits = 32 if kind in (FieldDescriptor.CPPTYPE_INT32, FieldDescriptor.CPPTYPE_UINT32) else 64
    low, high = (-(1 << bits - 1), (1 << bits - 1) - 1) if signed else (0, (1 << bits) - 1)
    if not low <= int(value) <= high:
        raise _fail(where, value, f"must be from {low} to {high}")
    return int(value)


def _leaves(message: Message, prefix: str, out: List[str]) -> None:
    for field, value in message.ListFields():
        path = f"{prefix}.{field.name}" if prefix else field.name
        if _is_map(field):
            for key in value:
                _leaves(value[key], f"{path}.{key}", out)
        elif field.message_type is not None and field.label != FieldDescriptor.LABEL_REPEATED and field.message_type.full_name != "gobo.v1.Vector3":
            if value.ListFields():
                _leaves(value, path, out)
            else:
                out.append(path)
        else:
            out.append(path)


def fill(request: render_pb2.RenderRequest, fields: Mapping[str, Any]) -> Builder:
    """Puts keywords (RequestFields, or PATH with "__" for ".") into `request`."""
    fields = dict(fields)
    base = fields.pop("request", None)
    by_path = fields.pop("set", None) or {}
    builder = Builder(request)
    if isinstance(base, render_pb2.RenderRequest):
        request.MergeFrom(base)
    elif base is not None:
        builder.merge(request, base, "")
    sheet = fields.pop("style", None)
    if sheet is not None:
        builder.merge(request, _style_sheet(sheet), "")
    size = fields.pop("size", None)
    if size is not None:
        try:
            fields["width"], fields["height"] = size
        except (TypeError, ValueError):
            raise _fail("size", size, "must be (width, height)") from None
    for name, value in fields.items():
        path = SHORT.get(name, name.replace("__", "."))
        if name == "certificate" and value is False:
            value = None
        builder.put(path, value)
    for path, value in by_path.items():
        builder.put(path, value)
    return builder


_OF_STYLE = re.compile(r"(expressions\.)?(shadows|lights\..+\.shadow)\.style(\.|$)")


def _style_sheet(path: Union[str, "os.PathLike[str]"]) -> Dict[str, Any]:
    """What a style sheet says. Raises InvalidArgument where it says more than styles."""
    try:
        with open(path, encoding="utf-8") as file:
            sheet = json.load(file)
    except (OSError, ValueError) as e:
        raise InvalidArgument(f"style = {os.fspath(path)!r}: {e}", field="style") from None
    said = Builder(render_pb2.RenderRequest())
    said.merge(said.message, sheet if isinstance(sheet, Mapping) else {"": sheet}, "")
    for field in said.mask():
        if not _OF_STYLE.match(field):
            raise InvalidArgument(f"{os.fspath(path)}: {field} is no field of a style: a style sheet has shadows.style, lights.NAME.shadow.style and expressions of these",
                                  field=field)
    return sheet


def whole_of(fields: Mapping[str, Any]) -> List[str]:
    """Fields that keywords replace as a whole where they change a request that is there: environment, camera, shadows and denoise."""
    return [p for p in ("environment", "camera", "shadows", "denoise") if p in fields or (p == "environment" and "env" in fields)]
