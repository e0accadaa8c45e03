// SPDX-License-Identifier: Apache-2.0
// Files from elsewhere: the converted scenes have the triangle counts of their page, and the whole corpus, damaged files
// included, ends in a sealed scene or in an error that names the file.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>

#include "scene/load.h"

namespace gobo {
namespace {

namespace fs = std::filesystem;
const fs::path kData = "../shared/data";

struct Derived { const char* file; size_t triangles; std::vector<std::string> lights, cameras; };

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

TEST(GltfCorpus, EveryFileLoadsOrIsRefusedWithItsName) {
  if (!fs::exists(kData / "gltf")) GTEST_SKIP() << "../shared/data/gltf is absent";
  std::vector<std::string> files;
  for (const auto& entry : fs::recursive_directory_iterator(kData / "gltf")) {
    const std::string e = entry.path().extension();
    if (entry.is_regular_file() && (e == ".gltf" || e == ".glb")) files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  size_t loaded = 0, refused = 0, warned = 0;
  for (const std::string& file : files) {
    const auto scene = loadGltf(file);
    if (scene.ok()) {
      ++loaded;
      warned += !(*scene)->warnings.empty();
      EXPECT_FALSE((*scene)->hash().isZero());
    } else {
      ++refused;
      EXPECT_EQ(scene.status().location().compare(0, file.size(), file), 0) << scene.status().toString();
      EXPECT_FALSE(scene.status().message().empty());
    }
  }
  EXPECT_GE(loaded, 225u);   // what loads today keeps loading
  EXPECT_GE(refused, 40u);
  std::cout << "corpus: " << files.size() << " files, " << loaded << " loaded (" << warned << " with warnings), " << refused << " refused\n";
}

}  // namespace
}  // namespace gobo
