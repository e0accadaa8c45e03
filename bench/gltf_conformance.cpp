// SPDX-License-Identifier: Apache-2.0
// gltf_conformance [folder] [--all]: loads every glTF model below a folder and prints the tables of docs/gltf.md as Markdown:
// verdicts by folder, then each model where loader and report disagree; --all lists every model.
// gltf_conformance --verdicts LIST: one JSON line {"file", "error" | "warnings"} for each path in the file LIST, which
// bench/gltf_validator/compare.mjs lays beside the Khronos validator's.
// gltf_conformance --rules: docs/gltf_checks.md. gltf_conformance --base FILE: writes the document that the tests' mutants are made of.
#include <cstring>
#include <iostream>
#include <set>

#include "import/gltf/schema.h"
#include "import/load.h"
#include "support/gltf_base.h"
#include "support/gltf_rules.h"
#include "support/gltf_verdicts.h"

namespace {

int printVerdicts(const std::string& list) {
  std::ifstream in(list);
  if (!in) {
    std::cerr << "cannot read " << list << "\n";
    return 2;
  }
  for (std::string file; std::getline(in, file);) {
    if (file.empty()) continue;
    const auto scene = gobo::loadGltf(file);
    nlohmann::json line{{"file", file}};
    if (scene.ok()) line["warnings"] = (*scene)->warnings;
    else line["error"] = scene.status().toString();
    std::cout << line.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace) << "\n";
  }
  return 0;
}

std::string typeOf(const gobo::gltf::Field& f) {
  using gobo::gltf::Kind;
  constexpr const char* names[] = {"object", "objects", "indices by name", "index", "indices", "integer",
                                   "number", "numbers", "true or false",   "text",  "texts"};
  std::string out = names[int(f.kind)];
  char part[64];
  if (f.kind == Kind::Numbers && f.least == f.most) out = std::to_string(f.least) + " " + out;
  if (f.shape) out += ": " + std::string(f.shape->name);
  if (!f.list.empty()) out += " of " + std::string(f.list);
  if (!f.values.empty()) return out + ": " + std::string(f.values);
  const bool top = f.kind == Kind::Integer ? f.hi < gobo::gltf::kLargestSize : f.hi < gobo::gltf::kLargest;
  if (f.lo > -gobo::gltf::kLargest && f.kind != Kind::Index) {
    std::snprintf(part, sizeof part, top ? "%s%g to %g" : "%s%g", f.openLow ? " above " : " from ", f.lo, f.hi);
    out += part;
  }
  if (f.step > 1) out += ", multiple of " + std::to_string(f.step);
  return out;
}

int printRules() {
  using namespace gobo;
  std::cout << "# What a glTF is checked against\n\nPrinted by `gltf_conformance --rules`. Policy and results: [gltf.md](gltf.md).\n\n"
               "## Structure\n\nOne table in `renderer/import/gltf/schema_core.cpp` and `schema_extensions.cpp`; `GltfSchema.EveryRowIsHeld` makes documents "
               "from each row that break it.\n"
               "*Bold*: required. The last column says what becomes of a wrong type, of a value outside, of a missing or forbidden neighbour.\n\n"
               "| object | member | type and range | needs / excludes | answer |\n|---|---|---|---|---|\n";
  std::vector<const gltf::Shape*> shapes{&gltf::rootShape()};
  for (size_t i = 0; i < shapes.size(); ++i)
    for (const gltf::Field& f : shapes[i]->fields)
      if (f.shape && std::find(shapes.begin(), shapes.end(), f.shape) == shapes.end()) shapes.push_back(f.shape);
  for (const auto& row : gltf::extensionRows()) {
    if (std::find(shapes.begin(), shapes.end(), row.shape) == shapes.end()) shapes.push_back(row.shape);
    for (const gltf::Field& f : row.shape->fields)
      if (f.shape && std::find(shapes.begin(), shapes.end(), f.shape) == shapes.end()) shapes.push_back(f.shape);
  }
  for (const gltf::Shape* s : shapes)
    for (const gltf::Field& f : s->fields) {
      const auto word = [](gltf::Answer a) { return a == gltf::Answer::Refuse ? "refused" : "warning"; };
      std::cout << "| " << s->name << " | " << (f.isRequired ? "**" : "") << f.name << (f.isRequired ? "**" : "") << " | " << typeOf(f) << " | " << f.needed
                << (f.excluded.empty() ? "" : "not ") << f.excluded << " | " << word(f.type)
                << (f.value == f.type ? "" : std::string("; value: ") + word(f.value))
                << (f.beside == f.type || (f.needed.empty() && f.excluded.empty()) ? "" : std::string("; neighbour: ") + word(f.beside)) << " |\n";
    }
  std::cout << "\n## Codes of the Khronos validator\n\nEvery code that the validator (2.0.0-dev.3.10) calls an error; `GltfRules.EveryCodeIsAnswered` has a "
               "mutant for each that the table above does not hold.\n\n"
               "| code | answer | note |\n|---|---|---|\n";
  for (const testing::CodeRule& r : testing::kRules) std::cout << "| " << r.code << " | " << testing::heldName(r.held) << " | " << r.note << " |\n";
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  using namespace gobo::testing;
  if (argc == 3 && std::string(argv[1]) == "--verdicts") return printVerdicts(argv[2]);
  if (argc == 2 && std::string(argv[1]) == "--rules") return printRules();
  if (argc == 3 && std::string(argv[1]) == "--base") {
    std::ofstream(argv[2]) << gltfBase().text();
    return 0;
  }
  std::string folder = "../shared/data/gltf";
  bool all = false;
  for (int i = 1; i < argc; ++i)
    if (std::string(argv[i]) == "--all") all = true;
    else folder = argv[i];
  if (!std::filesystem::is_directory(folder)) {
    std::cerr << "no folder " << folder << "\n";
    return 2;
  }
  const std::vector<ModelResult> results = judgeFolder(folder);
  std::map<std::string, std::map<Verdict, int>> table;
  std::map<std::string, double> slowest;
  for (const ModelResult& r : results) {
    const std::string top = r.file.substr(0, r.file.find('/'));
    ++table[top][r.verdict];
    slowest[top] = std::max(slowest[top], r.ms);
  }
  std::cout << "| folder | models | loads | refused | sanitised | missed | too strict | slowest |\n|---|---|---|---|---|---|---|---|\n";
  for (auto& [top, counts] : table) {
    int models = 0;
    for (const auto& [v, n] : counts) models += n;
    std::cout << "| " << top << " | " << models;
    for (Verdict v : {Verdict::Loads, Verdict::Refused, Verdict::Sanitised, Verdict::Missed, Verdict::TooStrict}) std::cout << " | " << counts[v];
    std::cout << " | " << int(slowest[top] + 0.5) << " ms |\n";
  }
  std::cout << "\n| model | verdict | what the report says | what Gobo says |\n|---|---|---|---|\n";
  for (const ModelResult& r : results) {
    if (!all && r.verdict != Verdict::Missed && r.verdict != Verdict::TooStrict) continue;
    std::string codes, said = r.said;
    std::set<std::string> seen;
    for (const ModelFault& f : r.verdict == Verdict::Missed ? r.unnamed : r.faults)
      if (seen.insert(f.code).second) codes += (codes.empty() ? "" : ", ") + f.code + " " + f.pointer;
    for (const std::string& w : r.warnings)
      if (said.size() < 400) said += (said.empty() ? "" : "; ") + w;
    if (r.triangles) said += (said.empty() ? "" : "; ") + std::to_string(r.triangles) + " triangles";
    std::cout << "| " << r.file << " | " << verdictName(r.verdict) << " | " << codes << " | " << said << " |\n";
  }
  return 0;
}
