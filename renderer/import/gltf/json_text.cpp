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

/// Builds the document as the parser goes through the text. Not the library's callbacks: with those it looks at all elements of a
/// list after each object in it, hours for a million nodes.
class Builder final : public nlohmann::json_sax<Json> {
 public:
  explicit Builder(Json& root) : root_(root) {}
  /// Set where parsing stopped: what the library says of the text, or the key that stands twice and its place.
  std::string fault, twice, place;

  bool null() override { return value(nullptr); }
  bool boolean(bool v) override { return value(v); }
  bool number_integer(number_integer_t v) override { return value(v); }
  bool number_unsigned(number_unsigned_t v) override { return value(v); }
  bool number_float(number_float_t v, const string_t&) override { return value(v); }
  bool string(string_t& v) override { return value(std::move(v)); }
  bool binary(binary_t& v) override { return value(std::move(v)); }
  bool start_object(size_t) override { return open(Json::value_t::object); }
  bool start_array(size_t) override { return open(Json::value_t::array); }
  bool end_object() override { return close(); }
  bool end_array() override { return close(); }
  bool key(string_t& k) override {
    if (!keys_.add(k)) {
      twice = k;
      place = keys_.pointer();
      return false;
    }
    key_ = std::move(k);
    return true;
  }
  bool parse_error(size_t, const std::string&, const Json::exception& e) override {
    fault = e.what();
    return false;
  }

 private:
  /// Where it stands now. A list that grows moves none that is open: only the innermost does.
  Json& put(Json v) {
    if (open_.empty()) return root_ = std::move(v);
    Json& in = *open_.back();
    if (in.is_object()) {
      Json& place = in[key_];
      place = std::move(v);
      return place;
    }
    in.push_back(std::move(v));
    return in.back();
  }
  bool value(Json v) {
    put(std::move(v));
    keys_.value();
    return true;
  }
  bool open(Json::value_t kind) {
    open_.push_back(&put(Json(kind)));
    keys_.open(kind == Json::value_t::array);
    return true;
  }
  bool close() {
    open_.pop_back();
    keys_.close();
    return true;
  }

  Json& root_;
  std::vector<Json*> open_;  // the containers around the next value
  std::string key_;
  Keys keys_;
};

}  // namespace

Status parseJson(const std::string& path, std::string_view text, Json& out) {
  if (!nestingFits(text)) return invalidArgument("JSON is nested more than " + std::to_string(kMaxNesting) + " deep", path);
  Builder builder(out);
  const bool whole = Json::sax_parse(text.begin(), text.end(), &builder);
  if (!builder.twice.empty() || !builder.place.empty())
    return invalidArgument("\"" + builder.twice + "\" stands twice in one object", path + "#" + builder.place);
  if (!whole) return invalidArgument("JSON cannot be parsed: " + builder.fault, path + "#");
  if (!out.is_object()) return invalidArgument("the document is not a JSON object", path + "#");
  return {};
}

}  // namespace gobo::gltf
