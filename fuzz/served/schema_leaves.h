// SPDX-License-Identifier: Apache-2.0
// Every scalar that a message can hold, found by reflection, and values for each that its schema allows. A field that is added is among them without
// a word here; one of a kind that nothing here makes values for is said so. Pure; any thread.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include <google/protobuf/message.h>

#include "fuzz/served/message_edits.h"

namespace gobo::fuzz {

struct SchemaLeaf {
  std::string path;  ///< "lights.*.shadow.moment.moment_bias"
  std::vector<const google::protobuf::FieldDescriptor*> way;
};

/// In the order of the schema. A list of scalars is one leaf; messages in a list or a map, one of each kind.
std::vector<SchemaLeaf> schemaLeaves(const google::protobuf::Descriptor& type);

using Random = std::function<uint32_t()>;

/// Sets the leaf to a value within the range that the schema says. Keys of maps and texts come from `texts`. False: no values are known for its kind.
bool drawLeaf(google::protobuf::Message& message, const SchemaLeaf& leaf, const Random& random, const Texts& texts);

}  // namespace gobo::fuzz
