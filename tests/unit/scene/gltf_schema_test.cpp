// SPDX-License-Identifier: Apache-2.0
// From each row of the structural table a document that breaks it: refused at that place with its value, or loaded with a warning
// there, as the row says. The document that they are made from loads.
#include "import/gltf/schema.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <iostream>
#include <map>

#include "import/load.h"
#include "support/gltf_base.h"

namespace gobo {
namespace {

using gltf::Answer;
using gltf::Field;
using gltf::Kind;
using gltf::Shape;
using testing::Json;

struct Violation {
  std::string what, object, member, pointer;
  Json doc;
  Answer answer;
};

/// Where instances of each shape stand in the document.
void collect(const Json& j, const Shape& shape, const std::string& pointer, std::map<const Shape*, std::vector<std::string>>& out) {
  if (!j.is_object()) return;
  out[&shape].push_back(pointer);
  for (const Field& f : shape.fields) {
    const std::string name(f.name);
    if (!f.shape || !j.contains(name)) continue;
    if (f.kind == Kind::Object) collect(j[name], *f.shape, pointer + "/" + name, out);
    else
      for (size_t i = 0; i < j[name].size(); ++i) collect(j[name][i], *f.shape, pointer + "/" + name + "/" + std::to_string(i), out);
  }
  if (!j.contains("extensions")) return;
  for (const auto& row : gltf::extensionRows()) {
    const std::string name(row.extension);
    if ((row.place == &shape || (gltf::isTextureInfo(*row.place) && gltf::isTextureInfo(shape))) && j["extensions"].contains(name))
      collect(j["extensions"][name], *row.shape, pointer + "/extensions/" + name, out);
  }
}

class Maker {
 public:
  Maker(const Json& base, const Shape& shape, const std::vector<std::string>& instances, std::vector<Violation>& out)
      : base_(base), shape_(shape), instances_(instances), out_(out) {}

  void field(const Field& f) {
    field_ = &f;
    name_ = std::string(f.name);
    choose();
    const bool structured = f.kind == Kind::Object || f.kind == Kind::Objects || f.kind == Kind::IndexMap || f.kind == Kind::Indices ||
                            f.kind == Kind::Numbers || f.kind == Kind::Texts;
    const bool text = f.kind == Kind::Text;
    const Answer type = f.kind == Kind::Index ? f.value : f.type;
    set("of a wrong type", structured || text ? Json(7) : Json("x"), type);
    set("null", Json(), type);
    if (f.isRequired)
      change(
          "absent", [&](Json& o) { o.erase(name_); }, "", f.type);
    switch (f.kind) {
      case Kind::Index:
        set("past the end", 1000000, f.value);
        set("negative", -1, f.value);
        set("a fraction", 0.5, f.value);
        break;
      case Kind::Integer:
        set("a fraction", 8.5, f.type);
        numeric();
        break;
      case Kind::Number:
        numeric();
        set("beyond a float", 1e39, Answer::Refuse);
        break;
      case Kind::Text:
        if (!f.values.empty()) set("unknown", "BOGUS", f.value);
        break;
      case Kind::Objects:
        set("empty", Json::array(), Answer::Warn);
        set("a list of numbers", Json{1}, Answer::Refuse, "/0");
        break;
      case Kind::IndexMap:
        set("empty", Json::object(), Answer::Warn);
        set("past the end", {{"POSITION", f.list.empty() ? -1 : 1000000}}, Answer::Refuse, "/POSITION");
        break;
      case Kind::Indices:
        set("empty", Json::array(), f.none);
        set("past the end", Json{1000000}, Answer::Refuse, "/0");
        repeated();
        break;
      case Kind::Texts:
        set("empty", Json::array(), Answer::Warn);
        set("a list of numbers", Json{1}, Answer::Refuse, "/0");
        repeated();
        break;
      case Kind::Numbers: numbers(); break;
      default: break;
    }
    company();
  }

 private:
  /// The instance that has the member, or the first.
  void choose() {
    pointer_ = instances_[0];
    for (const std::string& p : instances_)
      if (base_[Json::json_pointer(p)].contains(name_)) {
        pointer_ = p;
        return;
      }
  }
  template <typename F>
  void change(const std::string& what, F&& f, const std::string& below, Answer answer) {
    Json doc = base_;
    f(doc[Json::json_pointer(pointer_)]);
    out_.push_back({what, std::string(shape_.name), name_, pointer_ + "/" + name_ + below, std::move(doc), answer});
  }
  void set(const std::string& what, const Json& value, Answer answer, const std::string& below = "") {
    change(
        what, [&](Json& o) { o[name_] = value; }, below, answer);
  }

  void numeric() {
    const Field& f = *field_;
    if (!f.values.empty()) {
      set("unknown", 99999, f.value);
      return;
    }
    if (f.lo > -gltf::kLargest) set("too small", f.openLow ? f.lo : f.lo - 1, f.value);
    if (f.hi < gltf::kLargestSize) set("too large", f.hi + 4, f.value);
    if (f.step > 1) set("no multiple", f.lo + 1, f.value);
  }
  Json filled(size_t n) const {
    const double v = std::clamp(0.0, field_->lo, field_->hi);
    return Json(std::vector<double>(n, v));
  }
  void numbers() {
    const Field& f = *field_;
    const size_t n = f.least;
    if (f.most == n) {
      set("one too many", filled(n + 1), f.type);
      set("one too few", filled(n - 1), f.type);
    } else set("empty", Json::array(), Answer::Warn);
    if (f.most != SIZE_MAX && f.most != n) set("too many", filled(f.most + 1), f.type);
    Json j = filled(n);
    j[0] = "x";
    set("with a word", j, f.type, "/0");
    if (f.lo > -gltf::kLargest) {
      j[0] = f.lo - 1;
      set("too small", j, f.value, "/0");
    }
    if (f.hi < gltf::kLargestSize) {
      j[0] = f.hi + 1;
      set("too large", j, f.value, "/0");
    }
    j[0] = 1e39;
    if (f.type == Answer::Refuse) set("beyond a float", j, Answer::Refuse, "/0");
  }
  void repeated() {
    const Json list = base_[Json::json_pointer(pointer_)].value(name_, Json{0});
    Json twice = list;
    twice.push_back(list[0]);
    set("with one twice", twice, field_->value, "/" + std::to_string(list.size()));
  }
  void company() {
    const Field& f = *field_;
    if (!f.needed.empty()) {
      EXPECT_TRUE(base_[Json::json_pointer(pointer_)].contains(name_)) << shape_.name << "." << name_ << " is nowhere in the base";
      change(
          "alone", [&](Json& o) { o.erase(std::string(f.needed)); }, "", f.beside);
    }
    static const std::map<std::string, Json> sample{
        {"bufferView", 0}, {"translation", {0, 0, 0}}, {"rotation", {0, 0, 0, 1}}, {"scale", {1, 1, 1}}, {"perspective", {{"yfov", 1}, {"znear", 1}}}};
    for (size_t at = 0; at < f.excluded.size();) {
      const size_t end = std::min(f.excluded.find(' ', at), f.excluded.size());
      const std::string other(f.excluded.substr(at, end - at));
      EXPECT_TRUE(base_[Json::json_pointer(pointer_)].contains(name_)) << shape_.name << "." << name_ << " is nowhere in the base";
      change(
          "beside " + other, [&](Json& o) { o[other] = sample.at(other); }, "", f.beside);
      at = end + 1;
    }
  }

  const Json& base_;
  const Shape& shape_;
  const std::vector<std::string>& instances_;
  std::vector<Violation>& out_;
  const Field* field_ = nullptr;
  std::string name_, pointer_;
};

Result<ScenePtr> loadText(const std::string& text) {
  testing::MemoryFile file(text);
  LoadOptions options;
  options.files = &file;
  return loadGltf("base.gltf", options);
}

TEST(GltfSchema, EveryRowIsHeld) {
  testing::GltfBase base = testing::gltfBase();
  const auto good = loadText(base.text());
  ASSERT_TRUE(good.ok()) << good.status().toString();
  for (const std::string& w : (*good)->warnings)  // what is not of the format's making
    EXPECT_TRUE(w.find("KHR_materials_pbrSpecularGlossiness is shown") != std::string::npos || w.find("KHR_texture_basisu") != std::string::npos) << w;

  std::map<const Shape*, std::vector<std::string>> instances;
  collect(base.doc, gltf::rootShape(), "", instances);
  for (const auto& row : gltf::extensionRows()) EXPECT_FALSE(instances[row.shape].empty()) << "no " << row.shape->name << " in the base";
  std::vector<Violation> all;
  for (const auto& [shape, places] : instances)
    for (const Field& f : shape->fields)
      if (!places.empty()) Maker(base.doc, *shape, places, all).field(f);
  EXPECT_GT(all.size(), 700u);

  size_t refused = 0, warned = 0;
  for (const Violation& v : all) {
    testing::GltfBase mutant{v.doc, base.bytes};
    const auto scene = loadText(mutant.text());
    const std::string what = v.object + "." + v.member + " " + v.what;
    if (v.answer == Answer::Refuse) {
      ++refused;
      ASSERT_FALSE(scene.ok()) << what << " loads";
      EXPECT_EQ(scene.status().code(), Code::InvalidArgument) << what;
      EXPECT_EQ(scene.status().location(), "base.gltf#" + v.pointer) << what << ": " << scene.status().toString();
      EXPECT_FALSE(scene.status().message().empty());
      continue;
    }
    ++warned;
    if (!scene.ok() && v.what == "empty" && scene.status().message().find(v.pointer + " has 0") != std::string::npos) continue;  // others point into it
    if (!scene.ok()) {
      ADD_FAILURE() << what << ": " << scene.status().toString();
      continue;
    }
    const auto& w = (*scene)->warnings;
    EXPECT_TRUE(std::any_of(w.begin(), w.end(), [&](const std::string& s) { return s.compare(0, v.pointer.size() + 2, v.pointer + ": ") == 0; }))
        << what << ": no warning at " << v.pointer;
  }
  std::cout << "  " << instances.size() << " objects, " << all.size() << " violations: " << refused << " refused, " << warned << " warned of\n";
}

}  // namespace
}  // namespace gobo
