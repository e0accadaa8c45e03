// SPDX-License-Identifier: Apache-2.0
// gltf_conformance [folder] [--all]: loads every glTF model below a folder and prints the tables of docs/gltf.md as Markdown:
// verdicts by folder, then each model where loader and report disagree; --all lists every model.
// gltf_conformance --verdicts LIST: one JSON line {"file", "error" | "warnings"} for each path in the file LIST, which
// bench/gltf_validator/compare.mjs lays beside the Khronos validator's.
#include <iostream>
#include <set>

#include "support/gltf_verdicts.h"

namespace {

int printVerdicts(const std::string& list) {
  std::ifstream in(list);
  if (!in) { std::cerr << "cannot read " << list << "\n"; return 2; }
  for (std::string file; std::getline(in, file);) {
    if (file.empty()) continue;
    const auto scene = gobo::loadGltf(file);
    nlohmann::json line{{"file", file}};
    if (scene.ok()) line["warnings"] = (*scene)->warnings; else line["error"] = scene.status().toString();
    std::cout << line.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace) << "\n";
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  using namespace gobo::testing;
  if (argc == 3 && std::string(argv[1]) == "--verdicts") return printVerdicts(argv[2]);
  std::string folder = "../shared/data/gltf";
  bool all = false;
  for (int i = 1; i < argc; ++i) if (std::string(argv[i]) == "--all") all = true; else folder = argv[i];
  if (!std::filesystem::is_directory(folder)) { std::cerr << "no folder " << folder << "\n"; return 2; }
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
    for (const ModelFault& f : r.verdict == Verdict::Missed ? r.unnamed : r.faults) if (seen.insert(f.code).second) codes += (codes.empty() ? "" : ", ") + f.code + " " + f.pointer;
    for (const std::string& w : r.warnings) if (said.size() < 400) said += (said.empty() ? "" : "; ") + w;
    if (r.triangles) said += (said.empty() ? "" : "; ") + std::to_string(r.triangles) + " triangles";
    std::cout << "| " << r.file << " | " << verdictName(r.verdict) << " | " << codes << " | " << said << " |\n";
  }
  return 0;
}
