// SPDX-License-Identifier: Apache-2.0
// Walks a document by the table of schema.h. Depth is bounded by the shapes, work by the document.
#include <algorithm>
#include <cmath>

#include "import/gltf/document.h"
#include "import/gltf/schema.h"

namespace gobo::gltf {
namespace {

constexpr size_t kMostNamed = 20;  // places of one undeclared extension that are named

/// Where the walk is: pointers become text only when something is wrong there.
struct Place {
  const Place* up = nullptr;
  Json* json = nullptr;
  std::string_view key = {};  // of an object, else
  size_t index = 0;           // of a list

  std::string pointer() const {
    if (!up) return {};
    return up->pointer() + "/" + (key.data() ? escaped(key) : std::to_string(index));
  }
};

bool listed(std::string_view words, std::string_view word) {
  for (size_t at = 0; at < words.size();) {
    const size_t end = std::min(words.find(' ', at), words.size());
    if (words.substr(at, end - at) == word) return true;
    at = end + 1;
  }
  return false;
}

/// JSON has one kind of number: 1.0 is an integer.
bool isInteger(const Json& j) { return j.is_number_integer() || (j.is_number_float() && std::floor(j.get<double>()) == j.get<double>()); }

std::string plain(double v) {
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", v);
  return text;
}

std::string rangeOf(const Field& f) {
  const std::string low = plain(f.lo), high = plain(f.hi);
  const bool noHigh = f.hi >= kLargest || (f.kind == Kind::Integer && f.hi >= kLargestSize);
  if (f.lo <= -kLargest && noHigh) return "of a float";
  if (noHigh) return (f.openLow ? "above " : "from ") + low + " on";
  return (f.openLow ? "above " + low + " to " : low + "..") + high;
}

class Checker {
 public:
  explicit Checker(Document& d) : d_(d) {}

  void run() {
    readUsed();
    Place root{nullptr, &d_.json};
    // Lists before what points into them: a list that is none is the fault, not the index.
    for (const Field& f : rootShape().fields) {
      const auto list = d_.json.find(std::string(f.name));
      if (f.kind == Kind::Objects && list != d_.json.end() && d_.ok()) isListOfObjects({&root, &*list, f.name}, f);
    }
    if (d_.ok()) check(root, rootShape());
    for (const auto& [name, n] : undeclared_)
      if (n > kMostNamed) d_.warn("/extensionsUsed", name + " is used at " + std::to_string(n - kMostNamed) + " more places");
  }

 private:
  void readUsed() {
    const auto used = d_.json.find("extensionsUsed");
    if (used == d_.json.end() || !used->is_array()) return;
    for (const Json& name : *used)
      if (name.is_string()) used_.insert(name.get<std::string>());
  }

  static std::string absent(Answer answer, const Field& f) { return answer == Answer::Warn && !f.isRequired ? "; it counts as absent" : ""; }
  void say(Answer answer, const std::string& pointer, const std::string& message) {
    if (answer == Answer::Warn) d_.warn(pointer, message);
    else if (d_.status.ok()) d_.status = invalidArgument(message, d_.path + "#" + pointer);
  }
  std::string at(const Place& object, std::string_view member) const { return object.pointer() + "/" + escaped(member); }

  void check(const Place& object, const Shape& shape) {
    std::vector<std::string> removed;
    if (!object.up) extensions(object, shape);  // lights and variants before what points into them
    for (const Field& f : shape.fields) {
      if (!d_.ok()) return;
      const auto found = object.json->find(std::string(f.name));
      if (found == object.json->end()) {
        if (f.isRequired) say(f.type, at(object, f.name), std::string(f.name) + " is missing");
        continue;
      }
      const Place member{&object, &*found, f.name};
      if (!value(member, f) && !f.isRequired) removed.emplace_back(f.name);
      if (!f.needed.empty() && !object.json->contains(std::string(f.needed)))
        say(f.beside, at(object, f.name), "needs " + std::string(f.needed) + " beside it");
      if (f.excluded.empty()) continue;
      for (const auto& [other, ignored] : object.json->items())
        if (listed(f.excluded, other)) say(f.beside, at(object, f.name), "may not stand beside " + other);
    }
    if (&shape == &morphTargetShape()) {
      if (object.json->empty()) d_.warn(object.pointer(), "is empty");
      indexMap(object, "accessors");
    }
    if (object.up) extensions(object, shape);
    for (const std::string& name : removed) object.json->erase(name);  // a warning has answered it: readers find the default
  }

  bool isListOfObjects(const Place& m, const Field& f) {
    if (!m.json->is_array()) {
      say(f.type, m.pointer(), shown(*m.json) + " is not an array of objects" + absent(f.type, f));
      return false;
    }
    for (size_t i = 0; i < m.json->size(); ++i)
      if (const Json& e = (*m.json)[i]; !e.is_object()) {
        say(Answer::Refuse, Place{&m, nullptr, {}, i}.pointer(), shown(e) + " is not an object");
        return false;
      }
    return true;
  }

  /// False: answered by a warning after which the member counts as absent.
  bool value(const Place& m, const Field& f) {
    const Json& j = *m.json;
    const auto wrong = [&](const std::string& what) {
      say(f.type, m.pointer(), shown(j) + " is not " + what + absent(f.type, f));
      return false;
    };
    switch (f.kind) {
      case Kind::Object:
        if (!j.is_object()) return wrong("an object");
        check(m, *f.shape);
        return true;
      case Kind::Objects:
        if (!isListOfObjects(m, f)) return false;
        if (j.empty()) {
          d_.warn(m.pointer(), "is empty");
          return false;
        }
        for (size_t i = 0; i < j.size() && d_.ok(); ++i) check({&m, &(*m.json)[i], {}, i}, *f.shape);
        return true;
      case Kind::IndexMap:
        if (!j.is_object()) return wrong("an object of indices");
        if (j.empty()) d_.warn(m.pointer(), "is empty");
        indexMap(m, f.list);
        return true;
      case Kind::Index: return indexInto(m, f.list, f.value);
      case Kind::Indices:
      case Kind::Numbers:
      case Kind::Texts: return list(m, f);
      case Kind::Integer:
      case Kind::Number: return numeric(m, f);
      case Kind::Boolean: return j.is_boolean() || wrong("true or false");
      case Kind::Text:
        if (!j.is_string()) return wrong("a string");
        if (f.values.empty() || listed(f.values, j.get_ref<const std::string&>())) return true;
        say(f.value, m.pointer(), shown(j) + " is not one of " + std::string(f.values) + absent(f.value, f));
        return false;
    }
    return true;
  }

  bool numeric(const Place& m, const Field& f) {
    const Json& j = *m.json;
    if (!j.is_number() || (f.kind == Kind::Integer && !isInteger(j))) {
      say(f.type, m.pointer(), shown(j) + (f.kind == Kind::Integer ? " is not an integer" : " is not a number"));
      return false;
    }
    const double v = j.get<double>();
    if (!f.values.empty()) {
      if (listed(f.values, plain(v))) return true;
      say(f.value, m.pointer(), shown(j) + " is not one of " + std::string(f.values) + absent(f.value, f));
      return false;
    }
    if (!inRange(v, f)) {
      say(std::fabs(v) > kLargest ? Answer::Refuse : f.value, m.pointer(), outside(j, f));
      return true;
    }  // its reader clamps it
    if (f.step > 1 && std::fmod(v, f.step) != 0) {
      say(f.value, m.pointer(), shown(j) + " is no multiple of " + std::to_string(f.step));
      return true;
    }
    return true;
  }
  static bool inRange(double v, const Field& f) { return (f.openLow ? v > f.lo : v >= f.lo) && v <= f.hi && std::fabs(v) <= kLargest; }
  static std::string outside(const Json& j, const Field& f) {
    return shown(j) + " is out of range: " + rangeOf(f) + (f.value == Answer::Warn ? "; it is clamped" : "");
  }

  bool list(const Place& m, const Field& f) {
    const Json& j = *m.json;
    const char* what = f.kind == Kind::Numbers ? " numbers" : f.kind == Kind::Indices ? " indices" : " strings";
    if (!j.is_array()) {
      say(f.type, m.pointer(), "is not an array of" + std::string(f.least == f.most ? " " + std::to_string(f.least) : "") + what);
      return false;
    }
    if (f.least == f.most && j.size() != f.least) {
      say(f.type, m.pointer(), "has " + std::to_string(j.size()) + " elements and is not an array of " + std::to_string(f.least) + what);
      return false;
    }
    if (j.size() < f.least) {
      say(f.none, m.pointer(), "is empty");
      return false;
    }
    if (j.size() > f.most) {
      say(f.type, m.pointer(), "has more than " + std::to_string(f.most) + " elements");
      return false;
    }
    std::set<int64_t> indices;
    std::set<std::string> words;
    for (size_t i = 0; i < j.size() && d_.ok(); ++i) {
      const Place e{&m, &(*m.json)[i], {}, i};
      bool fresh = true;
      if (f.kind == Kind::Numbers) {
        if (!e.json->is_number()) {
          say(f.type, e.pointer(), shown(*e.json) + " is not a number");
          return false;
        }
        if (const double v = e.json->get<double>(); !inRange(v, f)) say(std::fabs(v) > kLargest ? Answer::Refuse : f.value, e.pointer(), outside(*e.json, f));
      } else if (f.kind == Kind::Indices) {
        if (!indexInto(e, f.list, Answer::Refuse)) return true;
        fresh = indices.insert(e.json->get<int64_t>()).second;
      } else {
        if (!e.json->is_string()) {
          say(f.type, e.pointer(), shown(*e.json) + " is not a string");
          return false;
        }
        fresh = words.insert(e.json->get<std::string>()).second;
      }
      if (!fresh && f.isDistinct) say(f.value, e.pointer(), shown(*e.json) + " is listed twice");
    }
    return true;
  }

  void indexMap(const Place& map, std::string_view list) {
    for (auto it = map.json->begin(); it != map.json->end() && d_.ok(); ++it) {
      const std::string key = it.key();
      if (key == "extras" || key == "extensions") continue;
      indexInto({&map, &it.value(), key}, list, Answer::Refuse);
    }
  }

  bool indexInto(const Place& m, std::string_view list, Answer answer) {
    const Json& j = *m.json;
    if (!j.is_number() || !isInteger(j)) {
      say(answer, m.pointer(), shown(j) + " is not an index");
      return false;
    }
    const double v = j.get<double>();
    std::string pointer;
    const size_t n = list.empty() ? (1u << 30) : sizeOf(m, list, pointer);
    if (v >= 0 && v < double(n)) return true;
    say(answer, m.pointer(), "index " + shown(j) + " is out of range" + (list.empty() ? "" : ": " + pointer + " has " + std::to_string(n)));
    return false;
  }

  /// Number of elements of a list: at a pointer from the root, or by name in the nearest object around.
  size_t sizeOf(const Place& from, std::string_view list, std::string& pointer) {
    if (list[0] == '/') {
      pointer = list;
      const Json::json_pointer p{std::string(list)};
      if (!d_.json.contains(p)) return 0;
      const Json& j = d_.json[p];
      return j.is_array() ? j.size() : 0;
    }
    for (const Place* p = from.up; p; p = p->up) {
      if (!p->json->is_object() || (p->up && !enclosing(*p, list))) continue;
      pointer = p->pointer() + "/" + std::string(list);
      const auto found = p->json->find(std::string(list));
      return found != p->json->end() && found->is_array() ? found->size() : 0;
    }
    return 0;
  }
  /// Animations have samplers of their own; every other list is the root's.
  static bool enclosing(const Place& p, std::string_view list) { return list == "samplers" && p.up && p.up->key == "animations"; }

  void extensions(const Place& object, const Shape& shape) {
    const auto found = object.json->find("extensions");
    if (found == object.json->end() || !d_.ok()) return;
    const Place all{&object, &*found, "extensions"};
    if (!found->is_object()) {
      say(Answer::Refuse, all.pointer(), shown(*found) + " is not an object");
      return;
    }
    for (auto it = found->begin(); it != found->end() && d_.ok(); ++it) {
      const std::string name = it.key();
      const Place place{&all, &it.value(), name};
      const bool known = supported(name) || name == "KHR_texture_basisu";
      if (!used_.count(name) && ++undeclared_[name] <= kMostNamed)
        d_.warn(place.pointer(), "extension " + name + " is not declared in extensionsUsed; it " + (known ? "counts all the same" : "is ignored"));
      const ExtensionRow* row = nullptr;
      bool elsewhere = false;
      for (const ExtensionRow& r : extensionRows()) {
        if (r.extension != name) continue;
        elsewhere = true;
        if (r.place == &shape || (isTextureInfo(*r.place) && isTextureInfo(shape))) row = &r;
      }
      if (!row && elsewhere) {
        d_.warn(place.pointer(), "extension " + name + " has no meaning here and is ignored");
        continue;
      }
      if (!it.value().is_object()) {
        say(row ? Answer::Refuse : Answer::Warn, place.pointer(), shown(it.value()) + " is not an object");
        continue;
      }
      if (row) check(place, *row->shape);
    }
  }

  Document& d_;
  std::set<std::string> used_;
  std::map<std::string, size_t> undeclared_;
};

}  // namespace

void checkSchema(Document& d) { Checker(d).run(); }

}  // namespace gobo::gltf
