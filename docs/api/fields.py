#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes the protocol as a page: every service, method, message, field and enum of gobo.v1, with ranges, defaults, units and help from the schema.

    PYTHONPATH=build/clients/python docs/api/fields.py > fields.md
"""
from google.protobuf import descriptor_pool
from google.protobuf.descriptor import FieldDescriptor

from gobo.v1 import farm_pb2, filters_pb2, jobs_pb2, options_pb2, render_pb2, service_pb2

FILES = (service_pb2, render_pb2, filters_pb2, jobs_pb2, farm_pb2)
SCALARS = {getattr(FieldDescriptor, name): name[5:].lower() for name in dir(FieldDescriptor) if name.startswith("TYPE_")}


def type_of(field):
    entry = field.message_type if field.message_type and field.message_type.GetOptions().map_entry else None
    if entry:
        return f"map of {type_of(entry.fields_by_name['key'])} to {type_of(entry.fields_by_name['value'])}"
    named = field.message_type or field.enum_type
    text = f"[{named.name}](#{named.full_name.replace('.', '-').lower()})" if named else SCALARS[field.type]
    return f"list of {text}" if field.label == FieldDescriptor.LABEL_REPEATED else text


def number(value):
    return f"{value:.10g}"


def facts(field):
    """(default, range, help) as texts."""
    options = field.GetOptions().Extensions
    limits, default = options[options_pb2.number], options[options_pb2.text_default]
    if limits.HasField("default"):
        default = number(limits.default)
    elif options[options_pb2.bool_default]:
        default = "true"
    low = ("> " if limits.exclusive_min else "from ") + number(limits.min) if limits.HasField("min") else ""
    high = "to " + number(limits.max) if limits.HasField("max") else ""
    words = [options[options_pb2.help]]
    if field.containing_oneof and len(field.containing_oneof.fields) > 1:
        words.append(f"(one of {field.containing_oneof.name})")
    if options[options_pb2.not_in_hash]:
        words.append("(not in the request hash)")
    return default, " ".join(filter(None, (low, high, options[options_pb2.unit]))), " ".join(filter(None, words))


def messages(parent):
    for message in parent:
        if not message.GetOptions().map_entry:
            yield message
            yield from messages(message.nested_types)


def page():
    out = ["# The protocol, field by field", "", "Made from `proto/gobo/v1` by `docs/api/fields.py`. How to use it: docs/protocol.md.", ""]
    for module in FILES:
        for service in module.DESCRIPTOR.services_by_name.values():
            out += [f"## Service {service.name}", "", "| method | asks | answers |", "|---|---|---|"]
            for method in service.methods:
                out.append(f"| {method.name} | [{method.input_type.name}](#{method.input_type.full_name.replace('.', '-').lower()}) | "
                           f"[{method.output_type.name}](#{method.output_type.full_name.replace('.', '-').lower()}) |")
            out.append("")
    for module in FILES:
        for message in messages(module.DESCRIPTOR.message_types_by_name.values()):
            out += [f"## {message.full_name.removeprefix('gobo.v1.')} {{#{message.full_name.replace('.', '-').lower()}}}", ""]
            if message.fields:
                out += ["| field | type | default | range | |", "|---|---|---|---|---|"]
            for field in message.fields:
                default, limits, words = facts(field)
                out.append(f"| `{field.name}` | {type_of(field)} | {default} | {limits} | {words} |")
            out.append("")
        enums = list(module.DESCRIPTOR.enum_types_by_name.values())
        for message in messages(module.DESCRIPTOR.message_types_by_name.values()):
            enums += message.enum_types
        for enum in enums:
            out += [f"## {enum.full_name.removeprefix('gobo.v1.')} {{#{enum.full_name.replace('.', '-').lower()}}}", "",
                    ", ".join(f"`{value.name}`" for value in enum.values), ""]
    return "\n".join(out)


if __name__ == "__main__":
    assert descriptor_pool.Default().FindMessageTypeByName("gobo.v1.RenderRequest")
    print(page())
