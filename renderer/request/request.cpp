// SPDX-License-Identifier: Apache-2.0
// Defaults, ranges and digests of requests: see request.h. Paths and masks are in request_paths.cpp.
#include "request/request.h"

#include <google/protobuf/descriptor.h>
#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/io/zero_copy_stream_impl_lite.h>
#include <google/protobuf/util/json_util.h>
#include <google/protobuf/util/type_resolver.h>
#include <google/protobuf/util/type_resolver_util.h>

#include <algorithm>
#include <cmath>
#include <sstream>

#include "base/utf8.h"
#include "gobo/v1/options.pb.h"

namespace gobo {
inline namespace request {

namespace {

using google::protobuf::Descriptor;
using google::protobuf::FieldDescriptor;
using google::protobuf::Message;
using google::protobuf::Reflection;

std::string number(double v) {
  std::ostringstream text;
  text.precision(12);
  text << v;
  return text.str();
}

double getNumber(const Message& m, const Reflection& r, const FieldDescriptor* f) {
  switch (f->cpp_type()) {
    case FieldDescriptor::CPPTYPE_INT32: return r.GetInt32(m, f);
    case FieldDescriptor::CPPTYPE_INT64: return double(r.GetInt64(m, f));
    case FieldDescriptor::CPPTYPE_UINT32: return r.GetUInt32(m, f);
    case FieldDescriptor::CPPTYPE_UINT64: return double(r.GetUInt64(m, f));
    case FieldDescriptor::CPPTYPE_FLOAT: return r.GetFloat(m, f);
    case FieldDescriptor::CPPTYPE_DOUBLE: return r.GetDouble(m, f);
    default: return 0;
  }
}

double getElement(const Message& m, const Reflection& r, const FieldDescriptor* f, int k) {
  switch (f->cpp_type()) {
    case FieldDescriptor::CPPTYPE_INT32: return r.GetRepeatedInt32(m, f, k);
    case FieldDescriptor::CPPTYPE_INT64: return double(r.GetRepeatedInt64(m, f, k));
    case FieldDescriptor::CPPTYPE_UINT32: return r.GetRepeatedUInt32(m, f, k);
    case FieldDescriptor::CPPTYPE_UINT64: return double(r.GetRepeatedUInt64(m, f, k));
    case FieldDescriptor::CPPTYPE_FLOAT: return r.GetRepeatedFloat(m, f, k);
    case FieldDescriptor::CPPTYPE_DOUBLE: return r.GetRepeatedDouble(m, f, k);
    default: return 0;
  }
}

void setNumber(Message& m, const Reflection& r, const FieldDescriptor* f, double v) {
  switch (f->cpp_type()) {
    case FieldDescriptor::CPPTYPE_INT32: r.SetInt32(&m, f, int32_t(v)); break;
    case FieldDescriptor::CPPTYPE_INT64: r.SetInt64(&m, f, int64_t(v)); break;
    case FieldDescriptor::CPPTYPE_UINT32: r.SetUInt32(&m, f, uint32_t(v)); break;
    case FieldDescriptor::CPPTYPE_UINT64: r.SetUInt64(&m, f, uint64_t(v)); break;
    case FieldDescriptor::CPPTYPE_FLOAT: r.SetFloat(&m, f, float(v)); break;
    case FieldDescriptor::CPPTYPE_DOUBLE: r.SetDouble(&m, f, v); break;
    default: break;
  }
}

Status checkRange(const v1::Number& range, double v, const std::string& path) {
  if (!std::isfinite(v)) return invalidArgument(path + " = " + number(v) + ": must be a finite number", path);
  if (range.has_min() && (range.exclusive_min() ? v <= range.min() : v < range.min()))
    return invalidArgument(path + " = " + number(v) + ": must be " + (range.exclusive_min() ? "greater than " : "at least ") + number(range.min()), path);
  if (range.has_max() && v > range.max()) return invalidArgument(path + " = " + number(v) + ": must be at most " + number(range.max()), path);
  return {};
}

Status resolveScalar(Message& m, const FieldDescriptor* f, const std::string& path) {
  const Reflection& r = *m.GetReflection();
  const auto& options = f->options();
  if (f->is_repeated()) {
    for (int k = 0; k < r.FieldSize(m, f); ++k) {  // adding it to a negative zero makes it positive, and changes nothing else
      if (f->cpp_type() == FieldDescriptor::CPPTYPE_FLOAT) r.SetRepeatedFloat(&m, f, k, r.GetRepeatedFloat(m, f, k) + 0.0f);
      if (f->cpp_type() == FieldDescriptor::CPPTYPE_DOUBLE) r.SetRepeatedDouble(&m, f, k, r.GetRepeatedDouble(m, f, k) + 0.0);
      if (isNumeric(f) && options.HasExtension(v1::number))
        GOBO_TRY(checkRange(options.GetExtension(v1::number), getElement(m, r, f, k), path + "[" + std::to_string(k) + "]"));
    }
    return {};
  }
  if (isNumeric(f)) {
    const v1::Number range = options.GetExtension(v1::number);
    if (f->has_presence() && !r.HasField(m, f)) {
      if (!range.has_default_()) return {};
      setNumber(m, r, f, range.default_());
      return {};
    }
    const double v = getNumber(m, r, f);
    GOBO_TRY(checkRange(range, v, path));
    // JSON's readers make "-0" an integer, which has one zero: a request and its JSON must be the same request.
    if (v == 0 && std::signbit(v)) setNumber(m, r, f, 0.0);
    return {};
  }
  if (f->cpp_type() == FieldDescriptor::CPPTYPE_ENUM) {
    const std::string& name = options.GetExtension(v1::text_default);
    const int current = r.GetEnumValue(m, f);
    if (!f->enum_type()->FindValueByNumber(current))
      return invalidArgument(path + " = " + std::to_string(current) + ": is not a value of " + f->enum_type()->name(), path);
    if (!name.empty() && current == 0) r.SetEnumValue(&m, f, f->enum_type()->FindValueByName(name)->number());
    return {};
  }
  if (f->cpp_type() == FieldDescriptor::CPPTYPE_BOOL && f->has_presence() && !r.HasField(m, f)) r.SetBool(&m, f, options.GetExtension(v1::bool_default));
  return {};
}

}  // namespace

bool isNumeric(const FieldDescriptor* f) {
  switch (f->cpp_type()) {
    case FieldDescriptor::CPPTYPE_INT32:
    case FieldDescriptor::CPPTYPE_INT64:
    case FieldDescriptor::CPPTYPE_UINT32:
    case FieldDescriptor::CPPTYPE_UINT64:
    case FieldDescriptor::CPPTYPE_FLOAT:
    case FieldDescriptor::CPPTYPE_DOUBLE: return true;
    default: return false;
  }
}

Status checkNumberField(const NumberField& field, const double* values, const std::string& place) {
  if (field.width == 1) return checkRange(field.field->options().GetExtension(v1::number), values[0], place);
  constexpr double kMost = 3.4028234663852886e38;  // of the floats of a vector
  for (int c = 0; c < field.width; ++c)
    if (!(std::fabs(values[c]) <= kMost)) return invalidArgument(place + " = " + number(values[c]) + ": must be a finite number", place);
  return {};
}

void setNumberField(const NumberField& field, const double* values) {
  Message& m = *field.message;
  const Reflection& r = *m.GetReflection();
  if (field.width == 1) {
    const auto kind = field.field->cpp_type();
    const bool integer = kind != FieldDescriptor::CPPTYPE_FLOAT && kind != FieldDescriptor::CPPTYPE_DOUBLE;
    return setNumber(m, r, field.field, integer ? std::round(values[0]) : values[0]);
  }
  Message& vector = *r.MutableMessage(&m, field.field);
  for (int c = 0; c < field.width; ++c) setNumber(vector, *vector.GetReflection(), vector.GetDescriptor()->field(c), values[c]);
}

Status resolveDefaults(Message& m, const std::string& path) {
  const Reflection& r = *m.GetReflection();
  const Descriptor* d = m.GetDescriptor();
  for (int i = 0; i < d->field_count(); ++i) {
    const FieldDescriptor* f = d->field(i);
    const std::string fieldPath = path + "." + f->name();
    if (f->cpp_type() != FieldDescriptor::CPPTYPE_MESSAGE) {
      GOBO_TRY(resolveScalar(m, f, fieldPath));
      continue;
    }
    if (f->is_map()) {
      const FieldDescriptor* key = f->message_type()->FindFieldByName("key");
      for (int k = 0; k < r.FieldSize(m, f); ++k) {
        Message* entry = r.MutableRepeatedMessage(&m, f, k);
        const std::string name = entry->GetReflection()->GetString(*entry, key);
        const FieldDescriptor* value = f->message_type()->FindFieldByName("value");
        GOBO_TRY(resolveDefaults(*entry->GetReflection()->MutableMessage(entry, value), fieldPath + "." + name));
      }
    } else if (f->is_repeated()) {
      for (int k = 0; k < r.FieldSize(m, f); ++k) GOBO_TRY(resolveDefaults(*r.MutableRepeatedMessage(&m, f, k), fieldPath + "[" + std::to_string(k) + "]"));
    } else if (r.HasField(m, f)) {
      GOBO_TRY(resolveDefaults(*r.MutableMessage(&m, f), fieldPath));
    }
  }
  return {};
}

namespace {

void hashMessage(Hasher& h, const Message& m);

void hashValue(Hasher& h, const Message& m, const FieldDescriptor* f, int k) {
  const Reflection& r = *m.GetReflection();
  const bool rep = k >= 0;
  switch (f->cpp_type()) {
    case FieldDescriptor::CPPTYPE_INT32: h.add(rep ? r.GetRepeatedInt32(m, f, k) : r.GetInt32(m, f)); break;
    case FieldDescriptor::CPPTYPE_INT64: h.add(rep ? r.GetRepeatedInt64(m, f, k) : r.GetInt64(m, f)); break;
    case FieldDescriptor::CPPTYPE_UINT32: h.add(rep ? r.GetRepeatedUInt32(m, f, k) : r.GetUInt32(m, f)); break;
    case FieldDescriptor::CPPTYPE_UINT64: h.add(rep ? r.GetRepeatedUInt64(m, f, k) : r.GetUInt64(m, f)); break;
    case FieldDescriptor::CPPTYPE_FLOAT: h.add(rep ? r.GetRepeatedFloat(m, f, k) : r.GetFloat(m, f)); break;
    case FieldDescriptor::CPPTYPE_DOUBLE: h.add(rep ? r.GetRepeatedDouble(m, f, k) : r.GetDouble(m, f)); break;
    case FieldDescriptor::CPPTYPE_BOOL: h.add(rep ? r.GetRepeatedBool(m, f, k) : r.GetBool(m, f)); break;
    case FieldDescriptor::CPPTYPE_ENUM: h.add(rep ? r.GetRepeatedEnumValue(m, f, k) : r.GetEnumValue(m, f)); break;
    case FieldDescriptor::CPPTYPE_STRING: h.add(std::string_view(rep ? r.GetRepeatedString(m, f, k) : r.GetString(m, f))); break;
    case FieldDescriptor::CPPTYPE_MESSAGE: hashMessage(h, rep ? r.GetRepeatedMessage(m, f, k) : r.GetMessage(m, f)); break;
  }
}

void hashMessage(Hasher& h, const Message& m) {
  const Reflection& r = *m.GetReflection();
  std::vector<const FieldDescriptor*> fields;
  r.ListFields(m, &fields);  // set fields in number order
  for (const FieldDescriptor* f : fields) {
    if (f->options().GetExtension(v1::not_in_hash)) continue;
    h.add(f->number());
    if (f->is_map()) {
      std::vector<std::pair<std::string, Hash128>> entries;
      const FieldDescriptor* key = f->message_type()->FindFieldByName("key");
      for (int k = 0; k < r.FieldSize(m, f); ++k) {
        const Message& entry = r.GetRepeatedMessage(m, f, k);
        Hasher inner;
        hashMessage(inner, entry);
        entries.emplace_back(entry.GetReflection()->GetString(entry, key), inner.digest());
      }
      std::sort(entries.begin(), entries.end());
      h.add(uint64_t(entries.size()));
      for (const auto& [name, digest] : entries) h.add(name).add(digest);
    } else if (f->is_repeated()) {
      const int n = r.FieldSize(m, f);
      h.add(n);
      for (int k = 0; k < n; ++k) hashValue(h, m, f, k);
    } else {
      hashValue(h, m, f, -1);
    }
  }
  h.add(-1);
}

}  // namespace

Hash128 messageHash(const Message& m) {
  Hasher h(m.GetDescriptor()->full_name());
  hashMessage(h, m);
  return h.digest();
}

Status messageFromJson(const std::string& json, Message& message, const std::string& source) {
  google::protobuf::util::JsonParseOptions options;
  options.ignore_unknown_fields = false;
  const auto status = google::protobuf::util::JsonStringToMessage(json, &message, options);
  if (!status.ok()) return cleanUtf8(invalidArgument("JSON: " + std::string(status.message()), source));  // it quotes the text
  return {};
}

std::string messageToJson(const Message& message, bool pretty) {
  google::protobuf::util::JsonPrintOptions options;
  options.add_whitespace = pretty;
  options.preserve_proto_field_names = true;
  // Maps by sorted key: the text goes into file headers, and equal messages must give equal bytes.
  std::string wire, out;
  {
    google::protobuf::io::StringOutputStream stream(&wire);
    google::protobuf::io::CodedOutputStream coded(&stream);
    coded.SetSerializationDeterministic(true);
    message.SerializeToCodedStream(&coded);
  }
  static const std::unique_ptr<google::protobuf::util::TypeResolver> types(
      google::protobuf::util::NewTypeResolverForDescriptorPool("gobo", google::protobuf::DescriptorPool::generated_pool()));
  (void)google::protobuf::util::BinaryToJsonString(types.get(), "gobo/" + message.GetDescriptor()->full_name(), wire, &out, options);
  return out;
}

std::string requestHash(const v1::RenderRequest& resolved) { return Hasher("request").add(messageHash(resolved)).add(resolved.scene_hash()).digest().hex(); }

}  // namespace request
}  // namespace gobo
