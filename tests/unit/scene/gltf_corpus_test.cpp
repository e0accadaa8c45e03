// SPDX-License-Identifier: Apache-2.0
// Files from elsewhere: the converted scenes have the triangle counts of their page, and the whole corpus, damaged files
// included, ends in a sealed scene or in an error that names the file.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <iostream>
#include <map>
#include <set>

#include "import/load.h"
#include "support/gltf_verdicts.h"

namespace gobo {
namespace {

namespace fs = std::filesystem;
const fs::path kData = "../shared/data";

struct Derived {
  const char* file;
  size_t triangles;
  std::vector<std::string> lights, cameras;
};

TEST(GltfCorpus, DerivedScenesHaveTheirCounts) {
  if (!fs::exists(kData / "derived")) GTEST_SKIP() << "../shared/data/derived is absent";
  const Derived expected[] = {{"sponza.glb", 66445, {"sun"}, {"atrium", "balcony", "down"}},
                              {"sibenik.glb", 73564, {"lamp0", "lamp1"}, {"nave", "altar"}},
                              {"cornell_dragon.glb", 54488, {"lamp"}, {"front"}},
                              {"teapot_table.glb", 51320, {}, {"main"}},
                              {"bunny_dragon.glb", 91554, {}, {"main"}}};
  for (const Derived& e : expected) {
    const auto scene = loadGltf((kData / "derived" / e.file).string());
    ASSERT_TRUE(scene.ok()) << scene.status().toString();
    const Scene& s = **scene;
    EXPECT_EQ(s.triangleCount(), e.triangles) << e.file;
    EXPECT_EQ(s.lights.size(), e.lights.size()) << e.file;
    for (const std::string& name : e.lights) EXPECT_GE(s.findLight(name), 0) << e.file << " " << name;
    EXPECT_EQ(s.cameras.size(), e.cameras.size()) << e.file;
    for (const std::string& name : e.cameras) EXPECT_GE(s.findCamera(name), 0) << e.file << " " << name;
    EXPECT_TRUE(s.warnings.empty()) << e.file;
  }
}

TEST(GltfCorpus, EveryFileMeetsItsVerdict) {
  if (!fs::exists(kData / "gltf")) GTEST_SKIP() << "../shared/data/gltf is absent";
  // Refused although the validator's report has no error: their buffers have no bytes anywhere, and their meshes use them.
  const std::set<std::string> noBytes{"validator-corpus/root/named_objects.gltf", "validator-corpus/root/unused_objects.gltf"};
  std::map<testing::Verdict, size_t> counts;
  for (const testing::ModelResult& r : testing::judgeFolder(kData / "gltf")) {
    ++counts[r.verdict];
    EXPECT_TRUE(r.verdict != testing::Verdict::TooStrict || noBytes.count(r.file)) << r.file << ": " << r.said;
    for (const testing::ModelFault& f : r.unnamed) ADD_FAILURE() << r.file << ": nothing names " << f.code << " at " << f.pointer;
    EXPECT_TRUE(r.said.empty() || r.said.find(r.file) != std::string::npos) << "an error names its file: " << r.said;
  }
  for (const auto& [verdict, n] : counts) std::cout << testing::verdictName(verdict) << " " << n << "  ";
  std::cout << std::endl;
  EXPECT_GE(counts[testing::Verdict::Loads], 170u);
}

}  // namespace
}  // namespace gobo
