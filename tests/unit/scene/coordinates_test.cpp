// SPDX-License-Identifier: Apache-2.0
// The bound of coordinates at the door of every scene: each number that says where something is, at the bound and one step beyond it.
#include "scene/coordinates.h"

#include <gtest/gtest.h>

#include <functional>
#include <limits>

#include "support/sealable_scene.h"

namespace gobo::coordinates_test {
namespace {

struct Place {
  std::string location;
  std::function<void(Scene&, float)> put;
};

std::shared_ptr<Scene> good() {
  auto s = tests::sealableScene();
  s->cameras.resize(1);
  return s;
}

std::vector<Place> places() {
  std::vector<Place> all;
  for (int k = 0; k < 3; ++k) {
    all.push_back({"#/meshes/0/positions/1", [k](Scene& s, float x) {
                     auto mesh = std::make_shared<Mesh>(*s.meshes[0]);
                     std::vector<Vec3> p(mesh->positions.begin(), mesh->positions.end());
                     p[1][k] = x;
                     mesh->positions = std::move(p);
                     sealMesh(*mesh);
                     s.meshes[0] = mesh;
                   }});
    all.push_back({"#/lights/0/shape/position", [k](Scene& s, float x) { s.lights[0].shape.position[k] = x; }});
    all.push_back({"#/cameras/0", [k](Scene& s, float x) { s.cameras[0].toWorld[3][k] = x; }});
    all.push_back({"#/instances/0/toWorld", [k](Scene& s, float x) { s.instances[0].toWorld[3][k] = x; }});
  }
  all.push_back({"#/lights/0/shape", [](Scene& s, float x) {
                   s.lights[0].shape.kind = LightKind::Sphere;
                   s.lights[0].shape.radius = x;
                 }});
  all.push_back({"#/cameras/0/yheight", [](Scene& s, float x) { s.cameras[0].yheight = x; }});
  return all;
}

TEST(Coordinates, AtTheBoundAndBeyondIt) {
  const float beyond = std::nextafter(kLargestCoordinate, 2e9f);
  for (const Place& p : places())
    for (const float sign : {1.0f, -1.0f}) {
      if (sign < 0 && (p.location.ends_with("shape") || p.location.ends_with("yheight"))) continue;  // sizes are positive
      if (!p.location.ends_with("toWorld")) {                                                        // what an instance moves has a size of its own
        auto s = good();
        p.put(*s, sign * kLargestCoordinate);
        EXPECT_TRUE(s->seal().ok()) << p.location << ": " << s->seal().toString();
      }
      for (const float x : {beyond, 1e18f, 1e20f, 2e38f, std::numeric_limits<float>::infinity(), std::numeric_limits<float>::quiet_NaN()}) {
        auto s = good();
        p.put(*s, sign * x);
        const Status status = s->seal();
        EXPECT_EQ(status.code(), Code::InvalidArgument) << p.location << " " << x;
        EXPECT_TRUE(status.location().ends_with(p.location)) << status.toString();
      }
    }
}

TEST(Coordinates, WhatInstancesMakeOfThem) {
  auto s = good();
  Mat4& m = s->instances[0].toWorld;
  m[0][0] = 1e9f, m[3][0] = 1e8f;  // each within the bound, their sum is not
  const Status status = s->seal();
  EXPECT_EQ(status.code(), Code::InvalidArgument);
  EXPECT_NE(status.message().find("beyond 1e9"), std::string::npos) << status.toString();
}

// A scene as large as allowed gets a camera that is allowed too.
TEST(Coordinates, TheOwnCameraStaysInside) {
  auto s = good();
  for (int k = 0; k < 3; ++k) s->instances[0].toWorld[k][k] = 0.33f * kLargestCoordinate;  // the triangle is 4 wide, from -1 to 3
  s->cameras.clear();
  ASSERT_TRUE(s->seal().ok()) << s->seal().toString();
  EXPECT_TRUE(isCoordinate(s->cameras[0].toWorld));
}

}  // namespace
}  // namespace gobo::coordinates_test
