// SPDX-License-Identifier: Apache-2.0
// JSON text into a document. The library checks syntax and UTF-8; nesting is bounded before it starts, and keys that stand twice
// in one object, of which a parser would keep either, are found on the way.
#include <unordered_set>

#include "import/gltf/container.h"

namespace gobo::gltf {
namespace {

constexpr int kMaxNesting = 64;
constexpr size_t kFew = 16;  // keys that are compared one by one

bool nestingFits(std::string_view text) {
  int depth = 0;
  bool quoted = false;
  for (size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (quoted) {
      if (c == '\\') ++i;
      else if (c == '"') quoted = false;
    } else if (c == '"') quoted = true;
    else if (c == '{' || c == '[') {
      if (++depth > kMaxNesting) return false;
    } else if (c == '}' || c == ']') --depth;
  }
  return true;
}

/// Follows the parser: which object or list it is in, and the keys of that object so far.
class Keys {
 public:
  /// False: the key stands twice.
  bool add(const std::string& key) {
    Frame& f = frames_.back();
    f.step = key;
    if (f.few.size() < kFew) {
      for (const std::string& k : f.few)
        if (k == key) return false;
      f.few.push_back(key);
      return true;
    }
    if (f.many.empty()) f.many.insert(f.few.begin(), f.few.end());
    return f.many.insert(key).second;
  }
  void open(bool list) { frames_.push_back({list, 0, {}, {}, {}}); }
  void close() {
    frames_.pop_back();
    value();
  }
  void value() {
    if (!frames_.empty() && frames_.back().list) ++frames_.back().index;
  }
  std::string pointer() const {
    std::string out;
    for (const Frame& f : frames_) out += "/" + (f.list ? std::to_string(f.index) : escaped(f.step));
    return out;
  }

 private:
  struct Frame {
    bool list;
    size_t index;
    std::string step;
    std::vector<std::string> few;
    std::unordered_set<std::string> many;
  };
  std::vector<Frame> frames_;
};

}  // namespace

Status parseJson(const std::string& path, std::string_view text, Json& out) {
  if (!nestingFits(text)) return invalidArgument("JSON is nested more than " + std::to_string(kMaxNesting) + " deep", path);
  Keys keys;
  std::string twice, place;
  const Json::parser_callback_t follow = [&](int, Json::parse_event_t event, Json& parsed) {
    using E = Json::parse_event_t;
    switch (event) {
      case E::object_start: keys.open(false); break;
      case E::array_start: keys.open(true); break;
      case E::object_end:
      case E::array_end: keys.close(); break;
      case E::value: keys.value(); break;
      case E::key:
        if (!keys.add(parsed.get_ref<const std::string&>()) && twice.empty()) {
          twice = parsed.get<std::string>();
          place = keys.pointer();
        }
        break;
    }
    return true;
  };
  try {
    out = Json::parse(text.begin(), text.end(), follow);
  } catch (const Json::exception& e) { return invalidArgument(std::string("JSON cannot be parsed: ") + e.what(), path + "#"); }
  if (!twice.empty()) return invalidArgument("\"" + twice + "\" stands twice in one object", path + "#" + place);
  if (!out.is_object()) return invalidArgument("the document is not a JSON object", path + "#");
  return {};
}

}  // namespace gobo::gltf
