// SPDX-License-Identifier: Apache-2.0
#include "fuzz/served/schema_leaves.h"

#include <algorithm>
#include <cmath>

#include "gobo/v1/options.pb.h"

namespace gobo::fuzz::schema_leaves {
namespace {

using google::protobuf::Descriptor;
using google::protobuf::FieldDescriptor;
using google::protobuf::Message;

void collect(const Descriptor& type, SchemaLeaf& at, std::vector<SchemaLeaf>& out) {
  for (int i = 0; i < type.field_count(); ++i) {
    const FieldDescriptor& f = *type.field(i);
    const std::string before = at.path;
    at.path += (before.empty() ? "" : ".") + f.name() + (f.is_map() ? ".*" : "");
    at.way.push_back(&f);
    const Descriptor* below = f.is_map() ? f.message_type()->map_value()->message_type() : f.message_type();
    if (below) collect(*below, at, out);
    else out.push_back(at);
    at.way.pop_back();
    at.path = before;
  }
}

double uniform(const Random& random, double low, double high) { return low + (high - low) * (double(random()) / 4294967296.0); }

/// Of a range that spans magnitudes, mostly what people write.
double number(const FieldDescriptor& f, const Random& random) {
  const v1::Number range = f.options().GetExtension(v1::number);
  const double low = range.has_min() ? range.min() : -2, high = range.has_max() ? range.max() : 2;
  const double usual = range.has_default_() ? range.default_() : 1;
  double v = usual;
  switch (random() % 8) {
    case 0: v = low; break;
    case 1: v = high; break;
    case 2: break;
    case 3: v = uniform(random, low, high); break;
    default: v = std::clamp(uniform(random, std::max(low, -2.0), std::max(low, -2.0) + 3.0 + 2.0 * std::abs(usual)), low, high); break;
  }
  return range.exclusive_min() && v <= low ? low + std::min(1e-3, 0.5 * (high - low)) : v;
}

template <typename T>
T integer(double v) {
  if (!(v > double(std::numeric_limits<T>::min()))) return std::numeric_limits<T>::min();
  return v < double(std::numeric_limits<T>::max()) ? T(v) : std::numeric_limits<T>::max();
}

int enumerator(const FieldDescriptor& f, const Random& random) {
  return f.enum_type()->value(int(random() % uint32_t(f.enum_type()->value_count())))->number();
}

bool drawList(Message& m, const FieldDescriptor& f, const Random& random, const Texts& texts) {
  const auto& r = *m.GetReflection();
  r.ClearField(&m, &f);
  switch (f.cpp_type()) {
    case FieldDescriptor::CPPTYPE_STRING:
      for (uint32_t k = 0; k < 1 + random() % 3; ++k) r.AddString(&m, &f, texts(f, random()));
      return true;
    case FieldDescriptor::CPPTYPE_FLOAT:  // the only list of floats is a matrix: about the unit one
      for (int k = 0; k < 16; ++k) r.AddFloat(&m, &f, (k % 5 == 0 ? 1.0f : 0.0f) + (k >= 12 && k < 15 ? float(uniform(random, -0.1, 0.1)) : 0.0f));
      return true;
    case FieldDescriptor::CPPTYPE_DOUBLE:  // keys of a curve
      for (uint32_t k = 0, n = 1 + random() % 3; k < n; ++k) r.AddDouble(&m, &f, uniform(random, 0.0, 2.0) + k);
      return true;
    default: return false;
  }
}

bool drawScalar(Message& m, const FieldDescriptor& f, const Random& random, const Texts& texts) {
  const auto& r = *m.GetReflection();
  switch (f.cpp_type()) {
    case FieldDescriptor::CPPTYPE_STRING: return r.SetString(&m, &f, texts(f, random())), true;
    case FieldDescriptor::CPPTYPE_ENUM: return r.SetEnumValue(&m, &f, enumerator(f, random)), true;
    case FieldDescriptor::CPPTYPE_DOUBLE: return r.SetDouble(&m, &f, number(f, random)), true;
    case FieldDescriptor::CPPTYPE_FLOAT: return r.SetFloat(&m, &f, float(number(f, random))), true;
    case FieldDescriptor::CPPTYPE_BOOL: return r.SetBool(&m, &f, random() % 2 != 0), true;
    case FieldDescriptor::CPPTYPE_UINT32: return r.SetUInt32(&m, &f, integer<uint32_t>(number(f, random))), true;
    case FieldDescriptor::CPPTYPE_UINT64: return r.SetUInt64(&m, &f, integer<uint64_t>(number(f, random))), true;
    case FieldDescriptor::CPPTYPE_INT32: return r.SetInt32(&m, &f, integer<int32_t>(number(f, random))), true;
    default: return false;
  }
}

Message* valueOf(Message& m, const FieldDescriptor& map, const std::string& name) {
  const auto& r = *m.GetReflection();
  const FieldDescriptor &key = *map.message_type()->map_key(), &value = *map.message_type()->map_value();
  if (key.cpp_type() != FieldDescriptor::CPPTYPE_STRING || value.cpp_type() != FieldDescriptor::CPPTYPE_MESSAGE) return nullptr;
  for (int i = 0; i < r.FieldSize(m, &map); ++i) {
    Message* const held = r.MutableRepeatedMessage(&m, &map, i);
    if (held->GetReflection()->GetString(*held, &key) == name) return held->GetReflection()->MutableMessage(held, &value);
  }
  Message* const entry = r.AddMessage(&m, &map);
  entry->GetReflection()->SetString(entry, &key, name);
  return entry->GetReflection()->MutableMessage(entry, &value);
}

}  // namespace
}  // namespace gobo::fuzz::schema_leaves

namespace gobo::fuzz {

std::vector<SchemaLeaf> schemaLeaves(const google::protobuf::Descriptor& type) {
  std::vector<SchemaLeaf> out;
  SchemaLeaf root;
  schema_leaves::collect(type, root, out);
  return out;
}

bool drawLeaf(google::protobuf::Message& message, const SchemaLeaf& leaf, const Random& random, const Texts& texts) {
  google::protobuf::Message* m = &message;
  for (size_t k = 0; k + 1 < leaf.way.size(); ++k) {
    const google::protobuf::FieldDescriptor& f = *leaf.way[k];
    const auto& r = *m->GetReflection();
    if (f.is_map()) m = schema_leaves::valueOf(*m, f, texts(f, random()));
    else m = f.is_repeated() ? r.FieldSize(*m, &f) ? r.MutableRepeatedMessage(m, &f, 0) : r.AddMessage(m, &f) : r.MutableMessage(m, &f);
    if (!m) return false;
  }
  const google::protobuf::FieldDescriptor& f = *leaf.way.back();
  return f.is_repeated() ? schema_leaves::drawList(*m, f, random, texts) : schema_leaves::drawScalar(*m, f, random, texts);
}

}  // namespace gobo::fuzz
