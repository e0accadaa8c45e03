# SPDX-License-Identifier: Apache-2.0
"""The fields of a request as data: kinds, ranges, defaults, units and help, as the server's `GET /v1/schema` has them (docs/live.md)."""
from __future__ import annotations

from typing import Any, Dict, Optional

from google.protobuf.descriptor import Descriptor, FieldDescriptor

from .v1 import options_pb2, render_pb2

_KINDS = {FieldDescriptor.CPPTYPE_STRING: "text", FieldDescriptor.CPPTYPE_BOOL: "bool", FieldDescriptor.CPPTYPE_ENUM: "enum",
          FieldDescriptor.CPPTYPE_FLOAT: "number", FieldDescriptor.CPPTYPE_DOUBLE: "number"}


def _message(f: FieldDescriptor) -> Optional[Descriptor]:
    if f.message_type is None:
        return None
    inner: Descriptor = f.message_type.fields_by_name["value"].message_type if f.message_type.GetOptions().map_entry else f.message_type
    return None if inner.full_name == "gobo.v1.Vector3" else inner


def _field(f: FieldDescriptor) -> Dict[str, Any]:
    options = f.GetOptions().Extensions
    entry = f.message_type is not None and f.message_type.GetOptions().map_entry
    vector = f.message_type is not None and f.message_type.full_name == "gobo.v1.Vector3"
    kind = "map" if entry else "vector" if vector else "message" if f.message_type is not None else _KINDS.get(f.cpp_type, "integer")
    out: Dict[str, Any] = {"name": f.name, "kind": kind}
    if f.label == FieldDescriptor.LABEL_REPEATED and not entry:
        out["repeated"] = True
    number = options[options_pb2.number]
    for key in ("default", "min", "max"):
        if number.HasField(key):
            value = getattr(number, key)
            out[key] = min(int(value), (1 << 64) - 1) if kind == "integer" else value
    if number.exclusive_min:
        out["exclusive_min"] = True
    if kind == "bool":
        out["default"] = options[options_pb2.bool_default]
    for key, extension in (("default", options_pb2.text_default), ("unit", options_pb2.unit), ("help", options_pb2.help)):
        if options[extension]:
            out[key] = options[extension]
    if kind == "enum":
        out["values"] = [v.name for v in f.enum_type.values if v.number]
    if f.containing_oneof is not None and not f.containing_oneof.name.startswith("_"):   # "_NAME": of an optional field
        out["oneof"] = f.containing_oneof.name
    inner = _message(f)
    if inner is not None:
        out["message"] = inner.name
    return out


def schema() -> Dict[str, Any]:
    """{"root": "RenderRequest", "messages": {NAME: {"fields": [...]}}}."""
    messages: Dict[str, Any] = {}

    def collect(d: Descriptor) -> None:
        if d.name in messages:
            return
        messages[d.name] = {"fields": [_field(f) for f in d.fields]}
        for f in d.fields:
            inner = _message(f)
            if inner is not None:
                collect(inner)
    root = render_pb2.RenderRequest.DESCRIPTOR
    collect(root)
    return {"root": root.name, "messages": messages}
