// SPDX-License-Identifier: Apache-2.0
#include "import/gltf/document.h"

#include <cmath>

namespace gobo::gltf {

std::string escaped(std::string_view key) {
  std::string out;
  for (const char c : key) out += c == '~' ? "~0" : c == '/' ? "~1" : std::string(1, c);
  return out;
}

std::string shown(const Json& j) {
  std::string text = j.is_structured() ? j.type_name() : j.dump(-1, ' ', false, Json::error_handler_t::replace);
  return text.size() > 60 ? text.substr(0, 57) + "..." : text;
}

void Cursor::fail(const std::string& message) const {
  if (document->status.ok()) document->status = invalidArgument(message, document->path + "#" + pointer);
}

Cursor Cursor::operator[](const char* key) const {
  Cursor child{document, nullptr, pointer + "/" + escaped(key)};
  if (!exists()) return child;
  if (!json->is_object()) {
    fail("is not an object");
    return child;
  }
  const auto it = json->find(key);
  if (it != json->end()) child.json = &*it;
  return child;
}

Cursor Cursor::at(size_t i) const {
  Cursor child{document, nullptr, pointer + "/" + std::to_string(i)};
  if (exists() && json->is_array() && i < json->size()) child.json = &(*json)[i];
  return child;
}

size_t Cursor::size() const {
  if (!exists()) return 0;
  if (!json->is_array()) {
    fail("is not an array");
    return 0;
  }
  return json->size();
}

double Cursor::number(double otherwise, double lo, double hi) const {
  if (!exists()) return otherwise;
  if (!json->is_number()) {
    fail(shown(*json) + " is not a number");
    return otherwise;
  }
  const double v = json->get<double>();
  if (!(v >= lo && v <= hi)) {
    fail(shown(*json) + " is out of range");
    return otherwise;
  }
  return v;
}

int64_t Cursor::integer(int64_t otherwise, int64_t lo, int64_t hi) const {
  if (!exists()) return otherwise;
  if (const double v = json->is_number_float() ? json->get<double>() : 0.5; v == std::floor(v) && v >= double(lo) && v <= double(hi) && std::fabs(v) < 9e15)
    return int64_t(v);  // JSON has one kind of number: 1.0 is 1
  if (!json->is_number_integer()) {
    fail(shown(*json) + " is not an integer");
    return otherwise;
  }
  const bool huge = json->is_number_unsigned() && json->get<uint64_t>() > uint64_t(std::numeric_limits<int64_t>::max());
  const int64_t v = huge ? 0 : json->get<int64_t>();
  if (huge || v < lo || v > hi) {
    fail(shown(*json) + " is out of range " + std::to_string(lo) + ".." + std::to_string(hi));
    return otherwise;
  }
  return v;
}

bool Cursor::boolean(bool otherwise) const {
  if (!exists()) return otherwise;
  if (!json->is_boolean()) {
    fail(shown(*json) + " is not true or false");
    return otherwise;
  }
  return json->get<bool>();
}

std::string Cursor::text(const std::string& otherwise) const {
  if (!exists()) return otherwise;
  if (!json->is_string()) {
    fail(shown(*json) + " is not a string");
    return otherwise;
  }
  return json->get<std::string>();
}

int Cursor::index(const char* list) const { return indexInto(document->list(list)); }

int Cursor::indexInto(const Cursor& list) const {
  if (!exists()) return -1;
  const size_t n = list.size();
  if (const double v = json->is_number_float() ? json->get<double>() : 0.5; v == std::floor(v) && v >= 0.0 && v < double(n)) return int(v);
  if (!json->is_number_integer()) {
    fail(shown(*json) + " is not an index");
    return -1;
  }
  const bool below = json->is_number_unsigned() ? json->get<uint64_t>() < n : json->get<int64_t>() >= 0 && uint64_t(json->get<int64_t>()) < n;
  if (!below) {
    fail("index " + shown(*json) + " is out of range: " + list.pointer + " has " + std::to_string(n));
    return -1;
  }
  return json->get<int>();
}

bool Document::account(uint64_t bytes, const Cursor& where) {
  if (bytes <= options.maxBytes && bytesUsed <= options.maxBytes - bytes) {
    bytesUsed += bytes;
    return true;
  }
  if (status.ok())
    status = Status(Code::ResourceExhausted, "the scene needs more than " + std::to_string(options.maxBytes) + " bytes", path + "#" + where.pointer);
  return false;
}

Cursor goboLight(const Cursor& at) {
  const Cursor extras = at["extras"];
  return extras.json && extras.json->is_object() ? extras["gobo_light"] : Cursor{at.document, nullptr, extras.pointer + "/gobo_light"};
}

}  // namespace gobo::gltf
