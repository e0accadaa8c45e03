// SPDX-License-Identifier: Apache-2.0
// Every built-in scene seals, has the size and lights that its page promises, and is the same each time it is made.
#include <gtest/gtest.h>

#include <map>
#include <set>

#include "import/load.h"

namespace gobo {
namespace {

struct Expected {
  size_t triangles, lights;
  std::set<std::string> cameras, someLights;
};

class Builtin : public ::testing::TestWithParam<std::string> {};

TEST_P(Builtin, SealsWithFiniteDataAndExpectedCounts) {
  static const std::map<std::string, Expected> expected = {
      {"cornell", {36, 1, {"front"}, {"light"}}},
      {"furnace", {540, 2, {"inside"}, {"box", "ball"}}},
      {"grids", {140, 1, {"front", "receiver"}, {"key"}}},
      {"fence", {626, 2, {"front", "low"}, {"key", "sun"}}},
      {"tentacles", {122498, 1, {"front"}, {"key"}}},
      {"spheres", {72002, 2, {"front"}, {"key", "environment"}}},
      {"trees", {254572, 2, {"front", "under"}, {"sun", "environment"}}},
      {"lamps", {38768, 1000, {"nave"}, {"lamp0000", "lamp0999"}}},
      {"atrium", {425944, 12, {"court", "gallery"}, {"sun", "environment", "spot0", "spot3", "lantern0", "lantern5"}}},
      {"lights8", {7854, 8, {"front"}, {"key", "fill", "rim", "a", "b", "c", "d", "e"}}},
  };
  const auto scene = makeBuiltinScene(GetParam());
  ASSERT_TRUE(scene.ok()) << scene.status().toString();
  const Scene& s = **scene;
  ASSERT_TRUE(expected.count(s.name));
  const Expected& e = expected.at(s.name);
  EXPECT_TRUE(s.warnings.empty());
  EXPECT_EQ(s.triangleCount(), e.triangles);
  EXPECT_EQ(s.lights.size(), e.lights);
  std::set<std::string> cameras;
  for (const Camera& c : s.cameras) cameras.insert(c.name);
  EXPECT_EQ(cameras, e.cameras);
  for (const std::string& name : e.someLights) EXPECT_GE(s.findLight(name), 0) << name;
  // seal() has proved positions finite; normals are unit, triangles have area, texture coordinates are finite.
  for (const MeshPtr& m : s.meshes) {
    for (const Vec3& n : m->normals) ASSERT_NEAR(glm::length(n), 1.0f, 1e-4f) << m->name;
    for (const Vec2& uv : m->uv[0]) ASSERT_TRUE(std::isfinite(uv.x) && std::isfinite(uv.y)) << m->name;
    for (size_t t = 0; t < m->indices.size(); t += 3) {
      const Vec3 a = m->positions[m->indices[t]], n = glm::cross(m->positions[m->indices[t + 1]] - a, m->positions[m->indices[t + 2]] - a);
      ASSERT_GT(glm::length(n), 0.0f) << m->name << " triangle " << t / 3;
      // Front faces are where the normals point: otherwise one-sided emission and shading would disagree.
      if (!m->normals.empty()) {
        Vec3 mean(0.0f);
        for (int k = 0; k < 3; ++k) mean += m->normals[m->indices[t + k]];
        ASSERT_GT(glm::dot(n, mean), 0.0f) << m->name << " triangle " << t / 3;
      }
    }
  }
  const auto again = makeBuiltinScene(GetParam());
  EXPECT_EQ((*again)->hash(), s.hash());
}

INSTANTIATE_TEST_SUITE_P(All, Builtin, ::testing::ValuesIn(builtinSceneNames()), [](const auto& info) { return info.param; });

TEST(LoadScene, UnknownNamesListTheKnown) {
  const auto none = loadScene("no-such-scene");
  EXPECT_EQ(none.status().code(), Code::NotFound);
  for (const std::string& name : builtinSceneNames()) EXPECT_NE(none.status().message().find(name), std::string::npos);
  EXPECT_EQ(loadScene("absent.glb").status().location(), "absent.glb");
}

}  // namespace
}  // namespace gobo
