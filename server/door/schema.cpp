// SPDX-License-Identifier: Apache-2.0
#include "server/door/schema.h"

#include <nlohmann/json.hpp>

#include "gobo/v1/options.pb.h"
#include "gobo/v1/render.pb.h"

namespace gobo {
inline namespace door {

namespace {

using google::protobuf::Descriptor;
using google::protobuf::FieldDescriptor;
using Json = nlohmann::ordered_json;

bool isVector(const Descriptor* d) { return d == v1::Vector3::descriptor(); }

const char* kindOf(const FieldDescriptor& f) {
  if (f.is_map()) return "map";
  switch (f.cpp_type()) {
    case FieldDescriptor::CPPTYPE_STRING: return "text";
    case FieldDescriptor::CPPTYPE_BOOL: return "bool";
    case FieldDescriptor::CPPTYPE_ENUM: return "enum";
    case FieldDescriptor::CPPTYPE_FLOAT:
    case FieldDescriptor::CPPTYPE_DOUBLE: return "number";
    case FieldDescriptor::CPPTYPE_MESSAGE: return isVector(f.message_type()) ? "vector" : "message";
    default: return "integer";
  }
}

Json fieldJson(const FieldDescriptor& f, const Descriptor*& inner) {
  Json out = {{"name", f.name()}, {"kind", kindOf(f)}};
  const auto& options = f.options();
  if (f.is_repeated() && !f.is_map()) out["repeated"] = true;
  const v1::Number n = options.GetExtension(v1::number);
  const auto bound = [&](const char* key, double value) {
    if (f.cpp_type() == FieldDescriptor::CPPTYPE_DOUBLE || f.cpp_type() == FieldDescriptor::CPPTYPE_FLOAT) out[key] = value;
    else if (value >= 0) out[key] = value >= 18446744073709551615.0 ? UINT64_MAX : uint64_t(value);
    else out[key] = int64_t(value);
  };
  if (n.has_default_()) bound("default", n.default_());
  if (n.has_min()) bound("min", n.min());
  if (n.has_max()) bound("max", n.max());
  if (n.exclusive_min()) out["exclusive_min"] = true;
  if (f.cpp_type() == FieldDescriptor::CPPTYPE_BOOL) out["default"] = options.GetExtension(v1::bool_default);
  if (const std::string& text = options.GetExtension(v1::text_default); !text.empty()) out["default"] = text;
  if (const std::string& unit = options.GetExtension(v1::unit); !unit.empty()) out["unit"] = unit;
  if (const std::string& help = options.GetExtension(v1::help); !help.empty()) out["help"] = help;
  if (f.cpp_type() == FieldDescriptor::CPPTYPE_ENUM) {
    Json values = Json::array();  // without the one that means "not given"
    for (int i = 0; i < f.enum_type()->value_count(); ++i)
      if (f.enum_type()->value(i)->number() != 0) values.push_back(f.enum_type()->value(i)->name());
    out["values"] = values;
  }
  if (const auto* choice = f.real_containing_oneof()) out["oneof"] = choice->name();
  inner = f.is_map()                                         ? f.message_type()->FindFieldByName("value")->message_type()
          : f.cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE ? f.message_type()
                                                             : nullptr;
  if (inner && isVector(inner)) inner = nullptr;
  if (inner) out["message"] = inner->name();
  return out;
}

void collect(const Descriptor& d, Json& messages) {
  if (messages.contains(d.name())) return;
  messages[d.name()] = {{"fields", Json::array()}};
  for (int i = 0; i < d.field_count(); ++i) {
    const Descriptor* inner = nullptr;
    Json field = fieldJson(*d.field(i), inner);
    messages[d.name()]["fields"].push_back(std::move(field));
    if (inner) collect(*inner, messages);
  }
}

}  // namespace

std::string schemaJson(const google::protobuf::Descriptor& root) {
  Json messages = Json::object();
  collect(root, messages);
  return Json{{"root", root.name()}, {"messages", messages}}.dump();
}

}  // namespace door
}  // namespace gobo
