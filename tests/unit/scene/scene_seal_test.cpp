// SPDX-License-Identifier: Apache-2.0
// What seal() makes, and each fault that it refuses: a good scene with one thing wrong.
#include <gtest/gtest.h>

#include <functional>
#include <limits>

#include "scene/edit.h"
#include "support/sealable_scene.h"

namespace gobo {
namespace {

std::shared_ptr<Scene> good() { return tests::sealableScene(); }

void replaceMesh(Scene& s, const std::function<void(Mesh&)>& edit) {
  auto m = std::make_shared<Mesh>(*s.meshes[0]);
  edit(*m);
  sealMesh(*m);
  s.meshes[0] = m;
}

TEST(Seal, MakesLightsAndACameraThatSeesEverything) {
  auto s = good();
  s->materials[0].emission.radiance = Vec3(1, 2, 3);
  s->environment = constantEnvironment(Vec3(1.0f));
  ASSERT_TRUE(s->seal().ok());
  const int lamp = s->findLight("a"), sky = s->findLight("environment");
  ASSERT_GE(lamp, 0);
  ASSERT_GE(sky, 0);
  EXPECT_EQ(s->lights[lamp].shape.kind, LightKind::Mesh);
  EXPECT_EQ(s->lights[lamp].power, Vec3(1, 2, 3));
  EXPECT_EQ(s->lights[sky].power, Vec3(1.0f));
  ASSERT_EQ(s->cameras.size(), 1u);
  Vec3 lo, hi;
  s->bounds(lo, hi);
  EXPECT_EQ(lo, Vec3(-1, 0, 0));
  EXPECT_EQ(hi, Vec3(3, 2, 0));
  const Camera& c = s->cameras[0];
  for (const Vec3& p : s->meshes[0]->positions) {
    const Vec3 local = glm::transpose(Mat3(c.toWorld)) * (p - Vec3(c.toWorld[3]));
    EXPECT_LT(local.z, 0.0f);
    EXPECT_LE(std::fabs(local.y), -local.z * std::tan(0.5f * c.yfov));
  }
  const size_t lights = s->lights.size();
  ASSERT_TRUE(s->seal().ok());
  EXPECT_EQ(s->lights.size(), lights);  // sealing again makes nothing twice
}

TEST(Seal, CameraRaysFollowTheConvention) {
  Camera c;
  const Ray centre = cameraRay(c, 200, 100, 100, 50), corner = cameraRay(c, 200, 100, 0, 0);
  EXPECT_EQ(centre.direction, Vec3(0, 0, -1));
  EXPECT_NEAR(corner.direction.y / -corner.direction.z, std::tan(0.4f), 1e-6f);
  EXPECT_NEAR(corner.direction.x / -corner.direction.z, -2 * std::tan(0.4f), 1e-6f);
  EXPECT_NEAR(pixelFootprint(c, 100, 5.0f), 2 * 5 * std::tan(0.4f) / 100, 1e-7f);
  c.perspective = false;
  c.yheight = 4;
  EXPECT_LT(glm::length(cameraRay(c, 100, 100, 100, 0).origin - Vec3(2, 2, 0)), 1e-6f);
}

TEST(Seal, EachFaultIsRefusedWithItsPlace) {
  const float nan = std::numeric_limits<float>::quiet_NaN(), inf = std::numeric_limits<float>::infinity();
  struct Fault {
    std::function<void(Scene&)> make;
    const char* location;
    const char* word;
  };
  const Fault faults[] = {
      {[](Scene& s) { replaceMesh(s, [](Mesh& m) { m.indices[1] = 3; }); }, "s#/meshes/0/indices/1", "index 3 of 3"},
      {[](Scene& s) { replaceMesh(s, [](Mesh& m) { m.indices.pop_back(); }); }, "s#/meshes/0/indices", "not whole"},
      {[=](Scene& s) { replaceMesh(s, [=](Mesh& m) { m.positions[2].y = nan; }); }, "s#/meshes/0/positions/2", "finite"},
      {[](Scene& s) { replaceMesh(s, [](Mesh& m) { m.normals.resize(2); }); }, "s#/meshes/0", "different lengths"},
      {[](Scene& s) { replaceMesh(s, [](Mesh& m) { m.material = 1; }); }, "s#/meshes/0/material", "material 1 of 1"},
      {[](Scene& s) { s.instances[0].mesh = -1; }, "s#/instances/0/mesh", "out of range"},
      {[=](Scene& s) { s.instances[0].toWorld[0][0] = inf; }, "s#/instances/0/toWorld", "finite"},
      {[](Scene& s) { s.instances.push_back(s.instances[0]); }, "s#/instances/1/name", "duplicate"},
      {[](Scene& s) { s.lights.push_back(s.lights[0]); }, "s#/lights/1/name", "duplicate"},
      {[](Scene& s) { s.materials[0].albedo.texture.texture = 0; }, "s#/materials/0/albedo/texture", "texture 0 of 0"},
      {[=](Scene& s) { s.materials[0].bsdf.roughness = nan; }, "s#/materials/0/bsdf/roughness", "finite"},
      {[](Scene& s) { s.materials[0].bsdf.ior = 0; }, "s#/materials/0/bsdf/ior", "positive"},
      {[](Scene& s) { s.lights[0].power.y = -1; }, "s#/lights/0/power", ">= 0"},
      {[=](Scene& s) { s.lights[0].shape.position.x = nan; }, "s#/lights/0/shape/position", "finite"},
      {[](Scene& s) {
         s.lights[0].shape.kind = LightKind::Sphere;
         s.lights[0].shape.radius = 0;
       },
       "s#/lights/0/shape/radius", "positive"},
      {[](Scene& s) {
         s.lights[0].shape.kind = LightKind::Directional;
         s.lights[0].shape.axis = Vec3(0, 2, 0);
       },
       "s#/lights/0/shape/axis", "unit"},
      {[](Scene& s) {
         s.lights[0].shape.kind = LightKind::Rect;
         s.lights[0].shape.v = Vec3(1, 0, 1);
       },
       "s#/lights/0/shape/v", "perpendicular"},
      {[](Scene& s) {
         s.lights[0].shape.kind = LightKind::Rect;
         s.lights[0].shape.axis = Vec3(1, 0, 0);
       },
       "s#/lights/0/shape/axis", "cross"},
      {[](Scene& s) {
         s.lights[0].shape.kind = LightKind::Rect;
         s.lights[0].shape.v = Vec3(0);
       },
       "s#/lights/0/shape/u", "no area"},
      {[](Scene& s) {
         s.lights[0].shape.kind = LightKind::Mesh;
         s.lights[0].shape.instance = 1;
       },
       "s#/lights/0/shape/instance", "instance 1 of 1"},
      {[](Scene& s) { s.lights[0].shape.kind = LightKind::Environment; }, "s#/lights/0", "without a map"},
      {[](Scene& s) {
         s.cameras.resize(1);
         s.cameras[0].yfov = 0;
       },
       "s#/cameras/0/yfov", "window"},
      {[](Scene& s) {
         s.cameras.resize(1);
         s.cameras[0].yheight = NAN;
       },
       "s#/cameras/0/yheight", "not finite"},
      {[](Scene& s) {
         s.cameras.resize(1);
         s.cameras[0].perspective = false;
         s.cameras[0].yfov = INFINITY;
       },
       "s#/cameras/0/yfov", "not finite"},
      {[](Scene& s) { s.cameras.resize(2); }, "s#/cameras/1/name", "duplicate"},
  };
  ASSERT_TRUE(good()->seal().ok());
  for (const Fault& f : faults) {
    auto s = good();
    f.make(*s);
    const Status status = s->seal();
    EXPECT_EQ(status.code(), Code::InvalidArgument) << f.location << " " << f.word;
    EXPECT_EQ(status.location(), f.location) << status.toString();
    EXPECT_NE(status.message().find(f.word), std::string::npos) << status.toString();
  }
}

// The shortcut for meshes already walked must not hide a new mesh in an old place.
TEST(Seal, EditedMeshesAreWalkedAgain) {
  auto s = good();
  ASSERT_TRUE(s->seal().ok());
  const auto bad = editScene(*s, [](Scene& e) -> Status {
    replaceMesh(e, [](Mesh& m) { m.indices[0] = 99; });
    return {};
  });
  EXPECT_FALSE(bad.ok());
  const auto moved = editScene(*s, [](Scene& e) -> Status {
    replaceMesh(e, [](Mesh& m) { m.positions[1].x = 9; });
    return {};
  });
  Vec3 lo, hi;
  (*moved)->bounds(lo, hi);
  EXPECT_EQ(hi.x, 9.0f);
}

TEST(Texture, SamplesByConvention) {
  Texture t;
  t.width = 2;
  t.height = 1;
  t.texelsF = {0, 0, 0, 1, 1, 2, 4, 0};
  sealTexture(t);
  EXPECT_EQ(t.sample(Vec2(0.25f, 0.5f)), Vec4(0, 0, 0, 1));
  EXPECT_EQ(t.sample(Vec2(0.75f, 0.5f)), Vec4(1, 2, 4, 0));
  EXPECT_EQ(t.sample(Vec2(0.5f, 0.5f)), Vec4(0.5f, 1, 2, 0.5f));
  EXPECT_EQ(t.sample(Vec2(0.0f, 0.5f)), Vec4(0.5f, 1, 2, 0.5f));  // repeat: half of each side
  EXPECT_EQ(t.sample(Vec2(-3.25f, 0.5f)), Vec4(1, 2, 4, 0));
  t.wrapU = Wrap::Clamp;
  EXPECT_EQ(t.sample(Vec2(-5.0f, 0.5f)), Vec4(0, 0, 0, 1));
  t.wrapU = Wrap::Mirror;
  EXPECT_EQ(t.sample(Vec2(1.25f, 0.5f)), Vec4(1, 2, 4, 0));
  EXPECT_EQ(t.sample(Vec2(-0.25f, 0.5f)), Vec4(0, 0, 0, 1));
  t.nearest = true;
  EXPECT_EQ(t.sample(Vec2(0.499f, 0.5f)), Vec4(0, 0, 0, 1));
  for (float wild : {1e30f, -1e30f, 1e10f, std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()})
    for (Wrap w : {Wrap::Repeat, Wrap::Clamp, Wrap::Mirror}) {
      t.wrapU = w;
      EXPECT_TRUE(std::isfinite(t.sample(Vec2(wild, wild)).x));
    }
  Texture c;
  c.width = c.height = 1;
  c.srgb = true;
  c.texels8 = {188, 0, 255, 128};
  sealTexture(c);
  EXPECT_NEAR(c.sample(Vec2(0)).x, 0.5029f, 1e-4f);
  EXPECT_NEAR(c.sample(Vec2(0)).w, 128 / 255.0f, 1e-6f);
}

}  // namespace
}  // namespace gobo
