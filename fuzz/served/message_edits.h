// SPDX-License-Identifier: Apache-2.0
// Messages out of bytes: each edit walks the schema by reflection and sets one field, so a field that is added is reached without a word
// here. Numbers go to the ends that the schema says, beyond them and between them. Pure; any thread.
#pragma once

#include <functional>
#include <string>

#include <google/protobuf/message.h>

#include "fuzz/properties.h"

namespace gobo::fuzz {

/// Bytes of one edit: five steps of the way to the field, how its value is made, and four bytes that it is made of.
constexpr size_t kEditBytes = 10;

/// The text of a field (a map's key too), chosen by `value` among those that mean something there.
using Texts = std::function<std::string(const google::protobuf::FieldDescriptor& field, uint32_t value)>;

/// As many edits as the bytes hold; what is left over says nothing.
void editMessage(google::protobuf::Message& message, Bytes bytes, const Texts& texts);

}  // namespace gobo::fuzz
