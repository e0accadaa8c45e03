// SPDX-License-Identifier: Apache-2.0
// Paths into requests: "lights.key.color". A segment after a map field is the map's key; keys may hold dots if no shorter
// reading exists, so light names need no quoting: the longest known field names win from the right. A segment of a list may end in
// the index of an element: "filters[0].bloom.gain"; the index that is the list's size appends.
#include <google/protobuf/descriptor.h>

#include <cstdlib>
#include <string_view>

#include "base/closest.h"
#include "request/request.h"

namespace gobo {
inline namespace request {

namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;
using google::protobuf::Reflection;

std::vector<std::string> split(const std::string& text, char by) {
  std::vector<std::string> parts;
  size_t begin = 0;
  while (true) {
    const size_t end = text.find(by, begin);
    parts.push_back(text.substr(begin, end == std::string::npos ? end : end - begin));
    if (end == std::string::npos) return parts;
    begin = end + 1;
  }
}

std::string fieldNames(const Message& m) {
  std::string names;
  for (int i = 0; i < m.GetDescriptor()->field_count(); ++i) names += (i ? ", " : "") + m.GetDescriptor()->field(i)->name();
  return names;
}

std::string nearestField(const std::string& name, const Message& m) {
  std::vector<std::string> known;
  for (int i = 0; i < m.GetDescriptor()->field_count(); ++i) known.push_back(m.GetDescriptor()->field(i)->name());
  return didYouMean(name, known);
}

Status unknownField(const std::string& name, const Message& m, const std::string& path) {
  return invalidArgument("no field '" + name + "' in " + m.GetDescriptor()->name() + nearestField(name, m) + " (has: " + fieldNames(m) + ")", path);
}

Message* mapValue(Message& m, const FieldDescriptor* f, const std::string& key, bool create) {
  const Reflection& r = *m.GetReflection();
  const FieldDescriptor* keyField = f->message_type()->FindFieldByName("key");
  const FieldDescriptor* valueField = f->message_type()->FindFieldByName("value");
  for (int k = 0; k < r.FieldSize(m, f); ++k) {
    Message* entry = r.MutableRepeatedMessage(&m, f, k);
    if (entry->GetReflection()->GetString(*entry, keyField) == key) return entry->GetReflection()->MutableMessage(entry, valueField);
  }
  if (!create) return nullptr;
  Message* entry = r.AddMessage(&m, f);
  entry->GetReflection()->SetString(entry, keyField, key);
  return entry->GetReflection()->MutableMessage(entry, valueField);
}

void eraseMapKey(Message& m, const FieldDescriptor* f, const std::string& key) {
  const Reflection& r = *m.GetReflection();
  const FieldDescriptor* keyField = f->message_type()->FindFieldByName("key");
  for (int k = 0; k < r.FieldSize(m, f); ++k) {
    const Message& entry = r.GetRepeatedMessage(m, f, k);
    if (entry.GetReflection()->GetString(entry, keyField) != key) continue;
    r.SwapElements(&m, f, k, r.FieldSize(m, f) - 1);
    r.RemoveLast(&m, f);
    return;
  }
}

/// Where a path ends: a field of a message, or (field null) a whole map entry.
struct Place {
  Message* message = nullptr;
  const FieldDescriptor* field = nullptr;
  std::string mapKey;    ///< set when the path ends on an entry of map `field`
  bool missing = false;  ///< with create = false: an ancestor is absent
  int element = -1;      ///< set when the path ends on an element of the list `field`; it may be the list's size
};

/// What becomes of ancestors that are absent. Choices: those in a oneof that says something else, or nothing, are an error, and so are elements that a list
/// does not have. Fill: of a patch, whose lists get empty elements before the one that is named.
enum class Absent { Report, Make, MakeButChoices, Fill };

/// A field's name, and the index of an element behind it; -1: none.
struct Segment {
  std::string name;
  int index = -1;
};

std::string_view nameOf(std::string_view segment) { return segment.substr(0, segment.find('[')); }

constexpr int kMostElements = 4096;  // of a list that is made by its indices

Result<Segment> segmentOf(const std::string& text, const std::string& path) {
  Segment s{std::string(nameOf(text)), -1};
  if (s.name.size() == text.size()) return s;
  const std::string digits = text.size() > s.name.size() + 2 && text.back() == ']' ? text.substr(s.name.size() + 1, text.size() - s.name.size() - 2) : "";
  if (digits.empty() || digits.find_first_not_of("0123456789") != std::string::npos)
    return invalidArgument("'" + text + "': an index is a number in brackets, as in " + s.name + "[0]", path);
  if (digits.size() > 6 || std::atoi(digits.c_str()) >= kMostElements)
    return invalidArgument("'" + text + "': an index is less than " + std::to_string(kMostElements), path);
  s.index = std::atoi(digits.c_str());
  return s;
}

std::string elementsOf(int size) { return size == 0 ? "it is empty" : size == 1 ? "it has element [0]" : "it has [0] to [" + std::to_string(size - 1) + "]"; }

/// Whether the list has the element, or is to get it: an error if neither.
Result<bool> hasElement(const Message& m, const FieldDescriptor* f, const Segment& s, Absent absent, const std::string& path) {
  if (!f->is_repeated() || f->is_map()) return invalidArgument("'" + s.name + "' is no list: it has no element [" + std::to_string(s.index) + "]", path);
  const int size = m.GetReflection()->FieldSize(m, f);
  if (s.index < size) return true;
  if (absent == Absent::MakeButChoices || (absent == Absent::Make && s.index > size))
    return invalidArgument("'" + s.name + "' has no element [" + std::to_string(s.index) + "]: " + elementsOf(size) +
                               (absent == Absent::Make ? ", and [" + std::to_string(size) + "] appends" : ""),
                           path);
  return false;
}

/// An element of a list of messages that hasElement() let pass, made if it is not there.
Message* elementOf(Message& m, const FieldDescriptor* f, int index) {
  const Reflection& r = *m.GetReflection();
  while (r.FieldSize(m, f) <= index) r.AddMessage(&m, f);
  return r.MutableRepeatedMessage(&m, f, index);
}

Result<Place> walk(Message& root, const std::string& path, Absent absent) {
  const bool create = absent != Absent::Report;
  const std::vector<std::string> parts = split(path, '.');
  Message* m = &root;
  for (size_t i = 0; i < parts.size(); ++i) {
    GOBO_ASSIGN(const Segment segment, segmentOf(parts[i], path));
    const FieldDescriptor* f = m->GetDescriptor()->FindFieldByName(segment.name);
    if (!f) return unknownField(segment.name, *m, path);
    if (segment.index >= 0) {
      GOBO_ASSIGN(const bool there, hasElement(*m, f, segment, absent, path));
      if (i + 1 == parts.size()) return Place{m, f, {}, !there && !create, segment.index};
      if (f->cpp_type() != FieldDescriptor::CPPTYPE_MESSAGE) return invalidArgument("'" + parts[i] + "' has no fields of its own", path);
      if (!there && !create) return Place{m, f, {}, true};
      m = elementOf(*m, f, segment.index);
      continue;
    }
    if (f->is_map()) {
      if (i + 1 == parts.size()) return Place{m, f, {}, false};
      const Message* prototype =
          google::protobuf::MessageFactory::generated_factory()->GetPrototype(f->message_type()->FindFieldByName("value")->message_type());
      // Keys may contain dots: take segments until the next one names a field of the value, or none are left.
      std::string key = parts[i + 1];
      size_t next = i + 2;
      while (next < parts.size() && !prototype->GetDescriptor()->FindFieldByName(std::string(nameOf(parts[next])))) key += "." + parts[next++];
      if (next > i + 2 && next == parts.size()) return unknownField(parts[i + 2], *prototype, path);
      if (next == parts.size()) return Place{m, f, key, false};
      Message* value = mapValue(*m, f, key, create);
      if (!value) return Place{m, f, key, true};
      m = value;
      i = next - 1;
      continue;
    }
    if (i + 1 == parts.size()) return Place{m, f, {}, false};
    if (f->is_repeated() && f->cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE)
      return invalidArgument("'" + parts[i] + "' is a list: name one of its elements, as in " + parts[i] + "[0]." + parts[i + 1], path);
    if (f->cpp_type() != FieldDescriptor::CPPTYPE_MESSAGE || f->is_repeated()) return invalidArgument("'" + parts[i] + "' has no fields of its own", path);
    if (!m->GetReflection()->HasField(*m, f)) {
      if (!create) return Place{m, f, {}, true};
      if (absent == Absent::MakeButChoices && f->real_containing_oneof()) return invalidArgument("'" + parts[i] + "' is not what the request chooses", path);
    }
    m = m->GetReflection()->MutableMessage(m, f);
  }
  return invalidArgument("empty path", path);
}

Result<double> toNumber(const std::string& text, const std::string& path) {
  char* end = nullptr;
  const double v = std::strtod(text.c_str(), &end);
  if (text.empty() || *end) return invalidArgument("'" + text + "' is not a number", path);
  return v;
}

Status setScalar(Message& m, const FieldDescriptor* f, const std::string& text, const std::string& path) {
  const Reflection& r = *m.GetReflection();
  switch (f->cpp_type()) {
    case FieldDescriptor::CPPTYPE_STRING: r.SetString(&m, f, text); return {};
    case FieldDescriptor::CPPTYPE_BOOL:
      if (text != "true" && text != "false" && text != "1" && text != "0") return invalidArgument("'" + text + "' is not true or false", path);
      r.SetBool(&m, f, text == "true" || text == "1");
      return {};
    case FieldDescriptor::CPPTYPE_ENUM: {
      std::string upper = text;
      for (char& c : upper) c = char(std::toupper(static_cast<unsigned char>(c)));
      const auto* value = f->enum_type()->FindValueByName(upper);
      if (!value) {
        std::string names;
        for (int i = 0; i < f->enum_type()->value_count(); ++i) names += (i ? ", " : "") + f->enum_type()->value(i)->name();
        return invalidArgument("'" + text + "' is not one of " + names, path);
      }
      r.SetEnumValue(&m, f, value->number());
      return {};
    }
    default: break;
  }
  const bool integer = f->cpp_type() != FieldDescriptor::CPPTYPE_FLOAT && f->cpp_type() != FieldDescriptor::CPPTYPE_DOUBLE;
  if (integer) {
    const bool isSigned = f->cpp_type() == FieldDescriptor::CPPTYPE_INT32 || f->cpp_type() == FieldDescriptor::CPPTYPE_INT64;
    char* end = nullptr;
    errno = 0;
    const long long s = isSigned ? std::strtoll(text.c_str(), &end, 10) : 0;
    const unsigned long long u = isSigned ? 0 : std::strtoull(text.c_str(), &end, 10);
    const bool small = f->cpp_type() == FieldDescriptor::CPPTYPE_INT32 || f->cpp_type() == FieldDescriptor::CPPTYPE_UINT32;
    if (text.empty() || *end || errno || (!isSigned && text[0] == '-') || (small && isSigned && s != int32_t(s)) || (small && !isSigned && u != uint32_t(u)))
      return invalidArgument("'" + text + "' is not " + (isSigned ? "an integer" : "a non-negative integer") + " in range", path);
    switch (f->cpp_type()) {
      case FieldDescriptor::CPPTYPE_INT32: r.SetInt32(&m, f, int32_t(s)); break;
      case FieldDescriptor::CPPTYPE_INT64: r.SetInt64(&m, f, s); break;
      case FieldDescriptor::CPPTYPE_UINT32: r.SetUInt32(&m, f, uint32_t(u)); break;
      default: r.SetUInt64(&m, f, u); break;
    }
    return {};
  }
  GOBO_ASSIGN(const double v, toNumber(text, path));
  if (f->cpp_type() == FieldDescriptor::CPPTYPE_FLOAT) r.SetFloat(&m, f, float(v));
  else r.SetDouble(&m, f, v);
  return {};
}

void collect(const Message& m, const std::string& prefix, std::vector<std::string>& out) {
  const Reflection& r = *m.GetReflection();
  std::vector<const FieldDescriptor*> fields;
  r.ListFields(m, &fields);
  for (const FieldDescriptor* f : fields) {
    const std::string path = prefix.empty() ? f->name() : prefix + "." + f->name();
    if (f->is_map()) {
      const FieldDescriptor* key = f->message_type()->FindFieldByName("key");
      const FieldDescriptor* value = f->message_type()->FindFieldByName("value");
      for (int k = 0; k < r.FieldSize(m, f); ++k) {
        const Message& entry = r.GetRepeatedMessage(m, f, k);
        collect(entry.GetReflection()->GetMessage(entry, value), path + "." + entry.GetReflection()->GetString(entry, key), out);
      }
    } else if (f->cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE && !f->is_repeated() && f->message_type()->full_name() != "gobo.v1.Vector3" &&
               f->message_type()->field_count() > 0) {
      const Message& inner = r.GetMessage(m, f);
      std::vector<const FieldDescriptor*> set;
      inner.GetReflection()->ListFields(inner, &set);
      if (set.empty()) out.push_back(path);
      else collect(inner, path, out);
    } else {
      out.push_back(path);
    }
  }
}

/// A message from text: a choice by its name, with its defaults, as in shadows=exponential; x,y,z of a vector; nothing: its defaults.
Status setMessage(Message& m, const std::string& text, const std::string& path) {
  const int fields = m.GetDescriptor()->field_count();
  if (fields == 0 || text.empty()) return {};  // e.g. shadows.path_traced=
  if (m.GetDescriptor()->full_name() != "gobo.v1.Vector3") {
    const FieldDescriptor* choice = m.GetDescriptor()->FindFieldByName(text);
    if (!choice || !choice->containing_oneof() || choice->cpp_type() != FieldDescriptor::CPPTYPE_MESSAGE)
      return invalidArgument("is a group of fields; set one of " + fieldNames(m) + (choice ? "" : "; '" + text + "' is none of them" + nearestField(text, m)),
                             path);
    m.GetReflection()->MutableMessage(&m, choice);
    return {};
  }
  std::vector<std::string> parts = split(text, ',');
  if (parts.size() == 1) parts = {parts[0], parts[0], parts[0]};
  if (parts.size() != 3) return invalidArgument("'" + text + "' is not x,y,z", path);
  for (int i = 0; i < 3; ++i) GOBO_TRY(setScalar(m, m.GetDescriptor()->field(i), parts[i], path));
  return {};
}

/// Element `index` of a list of texts or numbers; its size appends.
Status setElement(Message& m, const FieldDescriptor* f, int index, const std::string& text, const std::string& path) {
  const Reflection& r = *m.GetReflection();
  const bool there = index < r.FieldSize(m, f);
  if (!there && index > r.FieldSize(m, f)) return invalidArgument("has no element [" + std::to_string(index) + "]: " + elementsOf(r.FieldSize(m, f)), path);
  if (f->cpp_type() == FieldDescriptor::CPPTYPE_STRING) {
    there ? r.SetRepeatedString(&m, f, index, text) : r.AddString(&m, f, text);
    return {};
  }
  if (f->cpp_type() != FieldDescriptor::CPPTYPE_DOUBLE) return invalidArgument("cannot be set from text", path);
  GOBO_ASSIGN(const double v, toNumber(text, path));
  there ? r.SetRepeatedDouble(&m, f, index, v) : r.AddDouble(&m, f, v);
  return {};
}

Status setPathOf(Message& message, const std::string& assignment, Absent absent) {
  const size_t equals = assignment.find('=');
  if (equals == std::string::npos || equals == 0) return invalidArgument("'" + assignment + "' is not path=value", "--set");
  const std::string path = assignment.substr(0, equals), text = assignment.substr(equals + 1);
  GOBO_ASSIGN(Place place, walk(message, path, absent));
  const FieldDescriptor* f = place.field;
  if (!place.mapKey.empty() || f->is_map()) return invalidArgument("names an entry, not a field of it", path);
  if (place.element >= 0) {
    if (f->cpp_type() != FieldDescriptor::CPPTYPE_MESSAGE) return setElement(*place.message, f, place.element, text, path);
    return setMessage(*elementOf(*place.message, f, place.element), text, path);
  }
  if (f->is_repeated()) {
    const Reflection& r = *place.message->GetReflection();
    if (f->cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE)
      return invalidArgument("is a list: set one of its elements, as in " + path + "[0], or give all in JSON (--request)", path);
    r.ClearField(place.message, f);
    if (f->cpp_type() != FieldDescriptor::CPPTYPE_STRING && f->cpp_type() != FieldDescriptor::CPPTYPE_DOUBLE)
      return invalidArgument("cannot be set from text", path);
    for (const std::string& part : split(text, ',')) {
      if (f->cpp_type() == FieldDescriptor::CPPTYPE_STRING) {
        r.AddString(place.message, f, part);
        continue;
      }
      GOBO_ASSIGN(const double v, toNumber(part, path));
      r.AddDouble(place.message, f, v);
    }
    return {};
  }
  if (f->cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE) return setMessage(*place.message->GetReflection()->MutableMessage(place.message, f), text, path);
  return setScalar(*place.message, f, text, path);
}

/// Takes an element out of a list; the others keep their order.
void eraseElement(Message& m, const FieldDescriptor* f, int index) {
  const Reflection& r = *m.GetReflection();
  for (int k = index; k + 1 < r.FieldSize(m, f); ++k) r.SwapElements(&m, f, k, k + 1);
  if (index < r.FieldSize(m, f)) r.RemoveLast(&m, f);
}

/// An element of one list to its place in another. Texts, numbers and messages.
Status copyElement(const Place& from, const Place& to, const std::string& path) {
  const Reflection& r = *from.message->GetReflection();
  switch (from.field->cpp_type()) {
    case FieldDescriptor::CPPTYPE_MESSAGE:
      elementOf(*to.message, to.field, to.element)->CopyFrom(r.GetRepeatedMessage(*from.message, from.field, from.element));
      return {};
    case FieldDescriptor::CPPTYPE_STRING:
      return setElement(*to.message, to.field, to.element, r.GetRepeatedString(*from.message, from.field, from.element), path);
    case FieldDescriptor::CPPTYPE_DOUBLE: {
      const double v = r.GetRepeatedDouble(*from.message, from.field, from.element);
      const Reflection& rt = *to.message->GetReflection();
      if (to.element < rt.FieldSize(*to.message, to.field)) rt.SetRepeatedDouble(to.message, to.field, to.element, v);
      else rt.AddDouble(to.message, to.field, v);
      return {};
    }
    default: return invalidArgument("cannot be replaced by itself; name the whole list", path);
  }
}

/// Replaces the entry of a map whose key is all that follows the map's name, dots included: "lights.Light.001", which has no reading that ends on a field.
/// False: neither message has such an entry.
bool replaceDottedEntry(Message& base, Message& patch, const std::string& path) {
  const size_t dot = path.find('.');
  const FieldDescriptor* f = dot == std::string::npos ? nullptr : base.GetDescriptor()->FindFieldByName(path.substr(0, dot));
  if (!f || !f->is_map()) return false;
  const std::string key = path.substr(dot + 1);
  const Message* value = mapValue(patch, f, key, false);
  if (!value && !mapValue(base, f, key, false)) return false;
  eraseMapKey(base, f, key);
  if (value) mapValue(base, f, key, true)->CopyFrom(*value);
  return true;
}

}  // namespace

Status setPath(Message& message, const std::string& assignment) { return setPathOf(message, assignment, Absent::Make); }
Status setPatchPath(Message& patch, const std::string& assignment) { return setPathOf(patch, assignment, Absent::Fill); }

Result<NumberField> numberField(Message& message, const std::string& path) {
  GOBO_ASSIGN(const Place place, walk(message, path, Absent::MakeButChoices));
  const FieldDescriptor* f = place.field;
  const bool vector = !f->is_repeated() && f->cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE && f->message_type()->full_name() == "gobo.v1.Vector3";
  if (!place.mapKey.empty() || place.element >= 0 || (!vector && (f->is_repeated() || !isNumeric(f))))
    return invalidArgument("is neither a number nor a vector", path);
  return NumberField{place.message, f, vector ? 3 : 1};
}

Status applyMask(Message& base, const Message& patch, const std::vector<std::string>& mask) {
  std::unique_ptr<Message> source(patch.New());
  source->CopyFrom(patch);
  for (const std::string& path : mask) {
    // Shorter readings win: what can be read otherwise is no key with dots.
    if (!walk(*source, path, Absent::Report).ok() && replaceDottedEntry(base, *source, path)) continue;
    GOBO_ASSIGN(const Place from, walk(*source, path, Absent::Report));
    if (from.missing) {  // absent in the patch: cleared in the base, if it is there
      GOBO_ASSIGN(Place gone, walk(base, path, Absent::Report));
      if (gone.missing || !gone.mapKey.empty()) continue;
      if (gone.element >= 0) eraseElement(*gone.message, gone.field, gone.element);
      else gone.message->GetReflection()->ClearField(gone.message, gone.field);
      continue;
    }
    GOBO_ASSIGN(Place to, walk(base, path, Absent::Make));
    if (to.element >= 0) {
      GOBO_TRY(copyElement(from, to, path));
      continue;
    }
    const Reflection& rf = *from.message->GetReflection();
    const Reflection& rt = *to.message->GetReflection();
    if (!to.mapKey.empty()) {
      Message* value = mapValue(*from.message, from.field, from.mapKey, false);
      eraseMapKey(*to.message, to.field, to.mapKey);
      if (value) mapValue(*to.message, to.field, to.mapKey, true)->CopyFrom(*value);
      continue;
    }
    rt.ClearField(to.message, to.field);
    if (!from.field->is_repeated() && from.field->has_presence() && !rf.HasField(*from.message, from.field)) continue;
    // Copy one field: clear everything else in a clone of the parent, then merge.
    std::unique_ptr<Message> only(from.message->New());
    only->CopyFrom(*from.message);
    std::vector<const FieldDescriptor*> set;
    only->GetReflection()->ListFields(*only, &set);
    for (const FieldDescriptor* f : set)
      if (f != from.field) only->GetReflection()->ClearField(only.get(), f);
    to.message->MergeFrom(*only);
  }
  return {};
}

std::vector<std::string> setPaths(const Message& message) {
  std::vector<std::string> out;
  collect(message, "", out);
  return out;
}

}  // namespace request
}  // namespace gobo
