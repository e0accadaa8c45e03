// SPDX-License-Identifier: Apache-2.0
// Reading an optional parameter with the default that its schema states (proto/gobo/v1/options.proto): the schema is the only place
// that holds defaults. CHECKs that the field exists and has the type.
#pragma once

#include <google/protobuf/message.h>

#include "base/check.h"
#include "gobo/v1/options.pb.h"

namespace gobo {
inline namespace filters {

inline double numberParameter(const google::protobuf::Message& m, const char* name) {
  using Field = google::protobuf::FieldDescriptor;
  const Field* f = m.GetDescriptor()->FindFieldByName(name);
  GOBO_CHECK(f != nullptr);
  const auto* r = m.GetReflection();
  if (!r->HasField(m, f)) return f->options().GetExtension(v1::number).default_();
  switch (f->cpp_type()) {
    case Field::CPPTYPE_DOUBLE: return r->GetDouble(m, f);
    case Field::CPPTYPE_UINT32: return r->GetUInt32(m, f);
    case Field::CPPTYPE_INT32: return r->GetInt32(m, f);
    default: GOBO_CHECK(!"a numeric parameter"); return 0;
  }
}

inline bool boolParameter(const google::protobuf::Message& m, const char* name) {
  const auto* f = m.GetDescriptor()->FindFieldByName(name);
  GOBO_CHECK(f != nullptr);
  return m.GetReflection()->HasField(m, f) ? m.GetReflection()->GetBool(m, f) : f->options().GetExtension(v1::bool_default);
}

/// The number of an enumerator; where it is unspecified, of the one that text_default names.
inline int choiceParameter(const google::protobuf::Message& m, const char* name) {
  const auto* f = m.GetDescriptor()->FindFieldByName(name);
  GOBO_CHECK(f != nullptr && f->enum_type() != nullptr);
  if (const int set = m.GetReflection()->GetEnumValue(m, f); set != 0) return set;
  const auto* value = f->enum_type()->FindValueByName(f->options().GetExtension(v1::text_default));
  GOBO_CHECK(value != nullptr);
  return value->number();
}

}  // namespace filters
}  // namespace gobo
