// SPDX-License-Identifier: Apache-2.0
// What a message may hold, as JSON for programs that build forms: {"root": NAME, "messages": {NAME: {"fields": [...]}}}. A field has name, kind
// (number, integer, bool, enum, text, vector, message, map), and where they apply repeated, default, min, max, exclusive_min, unit, help, values,
// message (of a message, or of a map's values; keys are texts), oneof. From the schema's own options: a new field needs no code here.
#pragma once

#include <string>

#include <google/protobuf/descriptor.h>

namespace gobo {
inline namespace door {

std::string schemaJson(const google::protobuf::Descriptor& root);

}  // namespace door
}  // namespace gobo
