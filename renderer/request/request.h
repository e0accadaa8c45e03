// SPDX-License-Identifier: Apache-2.0
// Requests as values: defaults and ranges from the schema's options, JSON, paths ("lights.key.color=1,0.5,0"), masks, hash.
// All by protobuf reflection, so a new field needs no code here.
#pragma once

#include <string>
#include <vector>

#include <google/protobuf/message.h>

#include "base/hash.h"
#include "base/status.h"
#include "gobo/v1/render.pb.h"

namespace gobo {
inline namespace request {

/// Fills in the defaults named in the schema, recursively in sub-messages that are present, and checks ranges.
/// Errors: InvalidArgument naming the field path and the value, e.g. "integrator.max_bounces = 900: must be at most 64".
Status resolveDefaults(google::protobuf::Message& message, const std::string& path = "request");
/// Order-independent digest of the fields that can change the picture (maps by sorted key; not_in_hash fields left out).
Hash128 messageHash(const google::protobuf::Message& message);
/// RenderReply.request_hash of a resolved request: its fields and the scene that it was rendered from.
std::string requestHash(const v1::RenderRequest& resolved);

/// Parses JSON (protobuf mapping, snake_case or camelCase names). Unknown fields are errors that name them.
Status messageFromJson(const std::string& json, google::protobuf::Message& message, const std::string& source);
std::string messageToJson(const google::protobuf::Message& message, bool pretty);

/// "halt.spp=128", "lights.key.color=1,0.9,0.8", "shadows.axis_aligned.mu=2", "outputs=beauty,depth", "filters[0].bloom.gain=0.3". Vector3 takes x,y,z. The
/// index that is a list's size appends to it. Errors: InvalidArgument: no such field or element, a value that is none of the field's.
Status setPath(google::protobuf::Message& message, const std::string& assignment);
/// The same in the patch of a relight, where a list may be given from its second element on: those before it are made empty, and the mask names what counts.
Status setPatchPath(google::protobuf::Message& patch, const std::string& assignment);
/// An integer or a floating-point number, or a list of them.
bool isNumeric(const google::protobuf::FieldDescriptor* field);
/// A number (width 1) or Vector3 (3) of a message.
struct NumberField {
  google::protobuf::Message* message;
  const google::protobuf::FieldDescriptor* field;
  int width;
};
/// The field that a path names, its ancestors made where they are absent. Errors: InvalidArgument: no such field, another kind of field, or one of a
/// choice (a technique) that the message has not made.
Result<NumberField> numberField(google::protobuf::Message& message, const std::string& path);
/// Errors: InvalidArgument at `place`: not finite, or out of the field's range.
Status checkNumberField(const NumberField& field, const double* values, const std::string& place);
/// Integers are rounded. The values have been checked.
void setNumberField(const NumberField& field, const double* values);
/// Replaces in `base` the fields that `mask` names by those of `patch` (absent in patch: cleared). "filters[1]" is that element of either,
/// "filters[1].bloom.gain" a field of it; an element that the patch does not have leaves the base's list.
Status applyMask(google::protobuf::Message& base, const google::protobuf::Message& patch, const std::vector<std::string>& mask);
/// The paths of all leaf fields set in a message: what `gobo relight --set` puts into the mask.
std::vector<std::string> setPaths(const google::protobuf::Message& message);

}  // namespace request
}  // namespace gobo
