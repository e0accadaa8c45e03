// SPDX-License-Identifier: Apache-2.0
// glTF conformance: every model of a folder is loaded and compared with the verdict that comes with it: the reports of the
// Khronos validator (X.report.json, ValidatorResults/X.json), or a list here for files that have none.
#pragma once

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "import/load.h"

namespace gobo::testing {

enum class Verdict { Loads, Refused, Sanitised, Missed, TooStrict };
inline const char* verdictName(Verdict v) {
  constexpr const char* names[] = {"loads", "refused", "sanitised", "MISSED", "TOO STRICT"};
  return names[int(v)];
}

struct ModelFault {
  std::string code, pointer;
};
struct ModelResult {
  std::string file;                // below the folder
  bool report = false;             // a verdict came with it
  std::vector<ModelFault> faults;  // what the report calls errors
  Verdict verdict = Verdict::Loads;
  std::string said;  // the loader's error
  std::vector<std::string> warnings;
  std::vector<ModelFault> unnamed;  // faults that neither the error nor a warning names
  size_t triangles = 0, animations = 0, variants = 0;
  double ms = 0;
};

/// Files without a report that must not load, and why.
inline const std::map<std::string, const char*>& refusedWithoutReport() {
  static const std::map<std::string, const char*> table{
      {"invalid/assimp/IndexOutOfRange/AllIndicesOutOfRange.gltf", "index out of range"},
      {"invalid/assimp/IndexOutOfRange/IndexOutOfRange.gltf", "index out of range"},
      {"invalid/assimp/MissingBin/BoxTextured.gltf", "buffer file is absent"},
      {"invalid/assimp/wrongTypes/badArray.gltf", "wrong JSON type"},
      {"invalid/assimp/wrongTypes/badExtension.gltf", "wrong JSON type"},
      {"invalid/assimp/wrongTypes/badNumber.gltf", "wrong JSON type"},
      {"invalid/assimp/wrongTypes/badObject.gltf", "wrong JSON type"},
      {"invalid/assimp/wrongTypes/badUint.gltf", "wrong JSON type"},
      {"invalid/tinygltf/tests/issue-416.gltf", "no version"},
      {"invalid/tinygltf/models/BoundsChecking/integer-out-of-bounds.gltf", "number out of range"},
      {"invalid/tinygltf/models/BoundsChecking/invalid-buffer-index.gltf", "index out of range"},
      {"invalid/tinygltf/models/BoundsChecking/invalid-buffer-view-index.gltf", "index out of range"},
      {"invalid/tinygltf/models/BoundsChecking/invalid-primitive-indices.gltf", "index out of range"},
  };
  return table;
}

/// Files without a report that are shown with a warning at a place.
inline const std::map<std::string, ModelFault>& sanitisedWithoutReport() {
  static const std::map<std::string, ModelFault> table{
      {"invalid/assimp/IncorrectVertexArrays/Cube.gltf", {"corners are not whole triangles", "/meshes/1/primitives/0"}},
      {"invalid/assimp/wrongTypes/badString.gltf", {"a name is a number", "/scenes/0/name"}},
  };
  return table;
}
/// Refusing is right although the report has no error: a required extension that exists nowhere, a later version of the
/// format, a file outside the folder.
inline bool refusedRightly(const std::string& file, const std::string& said) {
  return said.find("required extension FAKE_") != std::string::npos || said.find("the file needs glTF 2.1") != std::string::npos ||
         file == "validator-corpus/buffer/non_relative_uri.gltf";
}

/// One of the places lies inside the other.
inline bool related(const std::string& a, const std::string& b) {
  const std::string& s = a.size() < b.size() ? a : b;
  const std::string& l = a.size() < b.size() ? b : a;
  return l.compare(0, s.size(), s) == 0 && (l.size() == s.size() || l[s.size()] == '/' || s.empty());
}

inline ModelResult judge(const std::filesystem::path& root, const std::filesystem::path& file) {
  namespace fs = std::filesystem;
  ModelResult r;
  r.file = fs::relative(file, root).string();
  const fs::path beside = file.string() + ".report.json", results = file.parent_path() / "ValidatorResults" / (file.stem().string() + ".json");
  for (const fs::path& p : {beside, results}) {
    if (!fs::exists(p)) continue;
    r.report = true;
    std::ifstream in(p);
    const auto report = nlohmann::json::parse(in, nullptr, false);
    if (report.is_discarded()) continue;
    for (const auto& m : report["issues"].value("messages", nlohmann::json::array()))
      if (m.value("severity", 3) == 0) r.faults.push_back({m.value("code", ""), m.value("pointer", "")});
  }
  const auto listed = refusedWithoutReport().find(r.file);
  if (listed != refusedWithoutReport().end()) r.faults.push_back({listed->second, ""});
  const auto sanitised = sanitisedWithoutReport().find(r.file);
  if (sanitised != sanitisedWithoutReport().end()) r.faults.push_back(sanitised->second);
  const auto start = std::chrono::steady_clock::now();
  const auto scene = loadGltf(file.string());
  r.ms = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
  if (!scene.ok()) {
    r.said = scene.status().toString();
    r.verdict = r.faults.empty() && !refusedRightly(r.file, r.said) ? Verdict::TooStrict : Verdict::Refused;
    return r;
  }
  const Scene& s = **scene;
  r.warnings = s.warnings;
  r.triangles = s.triangleCount();
  r.animations = s.rig ? s.rig->animations.size() : 0;
  r.variants = s.variants.names.size();
  for (const ModelFault& f : r.faults) {
    const bool named = std::any_of(s.warnings.begin(), s.warnings.end(), [&](const std::string& w) {
      const std::string place = w.substr(0, w.find(": "));
      return f.pointer.empty() ? place == "(file)" : place != "(file)" && related(place, f.pointer);
    });
    if (!named) r.unnamed.push_back(f);
  }
  r.verdict = r.faults.empty() ? Verdict::Loads : r.unnamed.empty() ? Verdict::Sanitised : Verdict::Missed;
  return r;
}

inline std::vector<ModelResult> judgeFolder(const std::filesystem::path& root) {
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(root)) {
    const std::string e = entry.path().extension();
    if (entry.is_regular_file() && (e == ".gltf" || e == ".glb")) files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  std::vector<ModelResult> out;
  for (const auto& f : files) out.push_back(judge(root, f));
  return out;
}

}  // namespace gobo::testing
