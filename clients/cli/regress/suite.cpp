// SPDX-License-Identifier: Apache-2.0
#include "regress/suite.h"

#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <sstream>

#include <toml++/toml.h>

#include "base/closest.h"
#include "measure/change.h"
#include "request/request.h"
#include "server/log.h"
#include "words.h"

namespace gobo::cli {
namespace {

namespace fs = std::filesystem;

std::string shown(const toml::node& node) {
  std::ostringstream out;
  node.visit([&](const auto& n) { out << n; });
  std::string text = escaped(out.str());
  return text.size() > 80 ? text.substr(0, 77) + "..." : text;
}

/// One table of the file: every key is asked for by name, and what nobody asked for is an error.
class Reader {
 public:
  Reader(const toml::table& table, std::string file, std::string what) : table_(table), file_(std::move(file)), what_(std::move(what)) {}

  int line() const { return int(table_.source().begin.line); }
  std::string place(const std::string& key) const {
    const toml::node* node = table_.get(key);
    return file_ + ":" + std::to_string(node ? int(node->source().begin.line) : line()) + ": " + what_ + (key.empty() ? "" : " " + key);
  }
  Status refuse(const std::string& key, const std::string& why) const {
    const toml::node* node = table_.get(key);
    return invalidArgument(place(key) + (node ? " = " + shown(*node) : "") + ": " + why);
  }
  bool has(const std::string& key) const { return table_.contains(key); }

  Status text(const std::string& key, std::string& to) {
    const toml::node* node = find(key);
    if (!node) return {};
    const auto v = node->value_exact<std::string>();
    if (!v) return refuse(key, "must be a string");
    if (v->empty()) return refuse(key, "must not be empty");
    to = *v;
    return {};
  }
  Status required(const std::string& key, std::string& to) {
    if (!has(key)) return invalidArgument(place("") + ": " + key + " is missing");
    return text(key, to);
  }
  Status texts(const std::string& key, std::vector<std::string>& to) {
    const toml::node* node = find(key);
    if (!node) return {};
    const toml::array* array = node->as_array();
    if (!array) return refuse(key, "must be an array of strings");
    for (const toml::node& item : *array) {
      const auto v = item.value_exact<std::string>();
      if (!v) return refuse(key, "must be an array of strings");
      to.push_back(*v);
    }
    return {};
  }
  template <typename T>
  Status integer(const std::string& key, T& to, int64_t low, int64_t high) {
    const toml::node* node = find(key);
    if (!node) return {};
    const auto v = node->value_exact<int64_t>();
    if (!v) return refuse(key, "must be an integer");
    if (*v < low || *v > high) return refuse(key, "must be in " + std::to_string(low) + ".." + std::to_string(high));
    to = T(*v);
    return {};
  }
  Status number(const std::string& key, double& to, double low, double high) {
    const toml::node* node = find(key);
    if (!node) return {};
    if (!node->is_number()) return refuse(key, "must be a number");
    const double v = *node->value<double>();
    if (!(v >= low && v <= high)) return refuse(key, strf("must be in %g..%g", low, high));
    to = v;
    return {};
  }
  /// Call last.
  Status others() const {
    for (const auto& [key, node] : table_) {
      const std::string name(key.str());
      if (known_.count(name)) continue;
      return invalidArgument(file_ + ":" + std::to_string(int(key.source().begin.line)) + ": " + what_ + ": unknown key \"" + escaped(name) +
                             "\" = " + shown(node) + didYouMean(name, {known_.begin(), known_.end()}));
    }
    return {};
  }
  void knows(const std::string& key) { known_.insert(key); }

 private:
  const toml::node* find(const std::string& key) {
    known_.insert(key);
    return table_.get(key);
  }
  const toml::table& table_;
  const std::string file_, what_;
  std::set<std::string> known_;
};

/// What is compared at once: some 60 bytes each.
constexpr uint32_t kMostPartPixels = 1u << 26;

/// Letters, digits and a few more: a name of files and of JUnit tests.
bool plain(const std::string& name) {
  if (name.empty() || name.size() > 100 || name[0] == '.') return false;
  for (const char c : name)
    if (!std::isalnum(static_cast<unsigned char>(c)) && c != '-' && c != '_' && c != '.') return false;
  return true;
}

std::string beside(const fs::path& folder, const std::string& path) {
  return fs::path(path).is_absolute() ? path : (folder / path).lexically_normal().string();
}

Status readCase(Reader& r, const fs::path& folder, RegressCase& c) {
  c.line = r.line();
  GOBO_TRY(r.required("name", c.name));
  if (!plain(c.name)) return r.refuse("name", "must be of letters, digits, '-', '_' and '.', at most 100, and name a file");
  GOBO_TRY(r.required("scene", c.scene));
  const std::string extension = fs::path(c.scene).extension().string();
  if (c.scene.find('/') != std::string::npos || extension == ".glb" || extension == ".gltf") {
    const std::string path = beside(folder, c.scene);
    std::error_code error;
    if (!fs::is_regular_file(path, error)) return r.refuse("scene", "no such file: \"" + path + "\"");
    c.scene = path;
  }
  std::string size = "320x240", output = "beauty";
  GOBO_TRY(r.text("size", size));
  const auto [width, height] = pictureSize(size).value_or(std::pair{0u, 0u});
  if (width < 1 || height < 1 || width > 16384 || height > 16384) return r.refuse("size", "must be WIDTHxHEIGHT, such as 320x240, at most 16384 a side");
  c.request.set_width(width);
  c.request.set_height(height);
  GOBO_TRY(r.text("output", output));
  uint32_t spp = 16;
  GOBO_TRY(r.integer("spp", spp, 1, 1048576));
  c.request.mutable_halt()->set_spp(spp);
  GOBO_TRY(r.integer("seed", c.seed, 0, 1ll << 56));
  GOBO_TRY(r.integer("parts", c.parts, 1, kMostParts));
  if (c.parts > 1 && int(c.parts) < kFewestParts) return r.refuse("parts", strf("must be 1 (a picture without noise) or %d to %d", kFewestParts, kMostParts));
  if (uint64_t(width) * height * c.parts > kMostPartPixels)
    return r.refuse("size", strf("times %u parts must be at most %u pixels: that many are compared at once", c.parts, kMostPartPixels));
  GOBO_TRY(r.number("tolerance", c.tolerance, 0, 1));
  GOBO_TRY(r.number("max_time", c.maxTime, 0, 1e6));
  GOBO_TRY(r.number("max_rays", c.maxRays, 0, 1e6));
  std::vector<std::string> sets;
  GOBO_TRY(r.texts("set", sets));
  for (const std::string& set : sets) {
    for (const char* fixed : {"scene", "width", "height", "outputs", "halt", "seed", "encoding", "window"}) {
      const std::string path = fixed;
      if (set.rfind(path, 0) == 0 && set.size() > path.size() && (set[path.size()] == '=' || set[path.size()] == '.'))
        return r.refuse("set", "\"" + set + "\": " + path + " is the case's own (scene, size, spp, seed, output)");
    }
    if (const Status status = setPath(c.request, set); !status.ok()) return r.refuse("set", "\"" + set + "\": " + status.message());
  }
  // The request keeps what the suite says: records of runs are the same wherever it lies.
  if (const std::string& map = c.request.environment().path(); !map.empty() && map != "none" && !fs::path(map).is_absolute()) {
    const std::string path = beside(folder, map);
    std::error_code error;
    if (!fs::is_regular_file(path, error)) return r.refuse("set", "environment.path: no such file: \"" + path + "\"");
    c.environment = path;
  }
  c.request.clear_outputs();
  c.request.add_outputs(output);
  return r.others();
}

}  // namespace

Result<Suite> readSuite(const std::string& file) {
  std::error_code error;
  if (!fs::is_regular_file(file, error)) return notFound("no such file: \"" + file + "\"");
  std::ifstream in(file, std::ios::binary);
  if (!in) return notFound("cannot read \"" + file + "\"");
  std::ostringstream content;
  content << in.rdbuf();
  Suite suite;
  suite.file = file;
  const fs::path folder = fs::absolute(file).parent_path();
  suite.name = fs::path(file).stem().string();
  suite.references = (folder / "references").string();
  try {
    const toml::table root = toml::parse(content.str(), file);
    Reader top(root, file, "suite");
    top.knows("suite"), top.knows("case");
    GOBO_TRY(top.others());
    if (const toml::node* node = root.get("suite")) {
      if (!node->is_table()) return top.refuse("suite", "must be a table, [suite]");
      Reader r(*node->as_table(), file, "[suite]");
      GOBO_TRY(r.text("name", suite.name));
      std::string references = "references";
      GOBO_TRY(r.text("references", references));
      suite.references = beside(folder, references);
      GOBO_TRY(r.others());
    }
    const toml::node* node = root.get("case");
    if (!node) return invalidArgument(file + ": names nothing to render: it has no [[case]]");
    if (!node->is_array_of_tables()) return top.refuse("case", "must be tables, [[case]]");
    std::map<std::string, int> lines;
    for (const toml::node& item : *node->as_array()) {
      Reader r(*item.as_table(), file, "[[case]]");
      RegressCase c;
      GOBO_TRY(readCase(r, folder, c));
      const auto [it, fresh] = lines.emplace(c.name, c.line);
      if (!fresh) return r.refuse("name", "the case of line " + std::to_string(it->second) + " has this name");
      suite.cases.push_back(std::move(c));
    }
  } catch (const toml::parse_error& e) {
    return invalidArgument(file + ":" + std::to_string(e.source().begin.line) + ": " + std::string(e.description()));
  } catch (const std::exception& e) { return invalidArgument(file + ": " + e.what()); }
  return suite;
}

}  // namespace gobo::cli
