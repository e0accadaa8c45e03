// SPDX-License-Identifier: Apache-2.0
// Ids against rays cast one by one; motion against closed-form projection, and against the matrices that files carry.
#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "scene/edit.h"
#include "support/tiny_scenes.h"
#include "terms/ids.h"
#include "terms/motion.h"

namespace gobo {
namespace {

using namespace tests;

constexpr int kW = 40, kH = 30;

TermPtr runNode(const NodePtr& node, const ScenePtr& scene, std::vector<TermPtr> inputs) {
  static const TaskArena arena(2);
  static AccelCache accels;
  const std::vector<int> lights;
  const SceneView view(*scene, node->traits().facets, lights);
  RunCounters counters;
  RunContext ctx;
  ctx.scene = node->traits().facets == Facet::None ? nullptr : &view;
  ctx.inputs = std::move(inputs);
  ctx.arena = &arena;
  ctx.accels = &accels;
  ctx.counters = &counters;
  const auto term = runNode(*node, ctx);
  EXPECT_TRUE(term.ok()) << term.status().toString();
  return *term;
}

struct Shot {
  ScenePtr scene;
  Camera camera;
};
GBufferSettings viewOf(const Camera& camera, int samples) { return {camera, kW, kH, samples}; }

TermPtr motionBetween(const Shot& earlier, const Shot& now, int samples = 1) {
  const GBufferSettings view = viewOf(now.camera, samples);
  return runNode(makeMotionNode({view, earlier.scene, earlier.camera}), now.scene, {runNode(makeGBufferNode(view), now.scene, {})});
}

/// A wall at z = 0 of half size `half`, turned to a camera at z = 4, moved by `shift`; a small box in front.
ScenePtr wall(const Vec3& shift, float half = 20.0f, float stretch = 1.0f) {
  SceneMaker m;
  Mesh q = quad(Vec3(-half, -half, 0), Vec3(2 * half, 0, 0), Vec3(0, 2 * half, 0));
  for (Vec3& p : q.positions) p.x *= stretch;
  m.instance(m.mesh(std::move(q), m.material(Vec3(0.5f))), translate(shift));
  m.camera(Vec3(0, 0, 4), Vec3(0.0f), 0.8f);
  return m.finish();
}

TEST(Ids, AgreeWithARayThroughViewSampleZero) {
  SceneMaker m;
  const int a = m.material(Vec3(0.5f)), b = m.material(Vec3(0.2f)), c = m.material(Vec3(0.8f));
  m.instance(m.mesh(quad(Vec3(-1, -0.4f, -1), Vec3(2, 0, 0), Vec3(0, 0, -2)), b));
  const int ball = m.mesh(sphere(Vec3(0.0f), 0.4f, 12, true), c);
  m.instance(ball, translate(Vec3(-0.5f, 0, -1.5f)));
  m.instance(ball, translate(Vec3(0.6f, 0.1f, -1.2f)));
  m.instance(m.mesh(box(Vec3(-0.1f, -0.4f, -1.1f), Vec3(0.1f, 0.3f, -0.9f)), a));
  m.camera(Vec3(0, 0.3f, 2), Vec3(0, 0, -1), 0.7f);
  const ScenePtr scene = m.finish();
  const TaskArena arena(2);
  const std::vector<int> none;
  const auto accel = Accel::build(SceneView(*scene, Facet::Topology | Facet::Pose | Facet::Coverage, none), arena);
  std::set<float> objects, materials;
  for (const int samples : {1, 4}) {
    const TermPtr g = runNode(makeGBufferNode(viewOf(scene->cameras[0], samples)), scene, {});
    const TermPtr object = runNode(makeIdNode(IdKind::Object, kW, kH), scene, {g}), material = runNode(makeIdNode(IdKind::Material, kW, kH), scene, {g});
    const Vec2 at = viewSamplePosition(0, samples);
    for (int y = 0; y < kH; ++y)
      for (int x = 0; x < kW; ++x) {
        Hit hit;
        const bool any = accel->intersect(cameraRay(scene->cameras[0], kW, kH, float(x) + at.x, float(y) + at.y), hit);
        const float o = object->floats("id")[size_t(y) * kW + x], k = material->floats("id")[size_t(y) * kW + x];
        ASSERT_EQ(o, any ? float(hit.instance) : -1.0f) << x << "," << y;
        ASSERT_EQ(k, any ? float(scene->meshes[scene->instances[hit.instance].mesh]->material) : -1.0f) << x << "," << y;
        objects.insert(o);
        materials.insert(k);
      }
  }
  EXPECT_EQ(objects.size(), 5u) << "background and every instance must be in view for the test to say anything";
  EXPECT_EQ(materials.size(), 4u);
}

TEST(Motion, NothingMovesNothing) {
  const ScenePtr scene = wall(Vec3(0.1f, 0.2f, 0), 1.0f);
  for (const int samples : {1, 4}) {
    const TermPtr still = motionBetween({scene, scene->cameras[0]}, {scene, scene->cameras[0]}, samples);
    for (const float v : still->floats("motion")) ASSERT_EQ(v, 0.0f);
  }
}

TEST(Motion, OfAWallThatSlides) {
  const ScenePtr before = wall(Vec3(0.0f)), now = wall(Vec3(0.1f, 0.05f, 0));
  const double perMetre = kH / (2.0 * 4.0 * std::tan(0.4));
  const TermPtr m = motionBetween({before, before->cameras[0]}, {now, now->cameras[0]});
  for (size_t p = 0; p < size_t(kW) * kH; ++p) {
    ASSERT_NEAR(m->floats("motion")[2 * p], 0.1 * perMetre, 1e-4);
    ASSERT_NEAR(m->floats("motion")[2 * p + 1], -0.05 * perMetre, 1e-4) << "up is towards smaller rows";
  }
}

// A mesh that was simplified in another pose has other triangles: what is known is how its object moved. Before, the wall has its triangles in another
// order, or more of them; numbers of triangles say nothing of other places.
TEST(Motion, OfAMeshWithOtherTrianglesIsItsObjects) {
  const ScenePtr now = wall(Vec3(0.1f, 0.05f, 0));
  const double perMetre = kH / (2.0 * 4.0 * std::tan(0.4));
  for (const bool more : {false, true}) {
    const ScenePtr before = *editScene(*wall(Vec3(0.0f)), [&](Scene& s) -> Status {
      auto mesh = std::make_shared<Mesh>(*s.meshes[0]);
      std::vector<uint32_t> indices(mesh->indices.begin(), mesh->indices.end());
      std::rotate(indices.begin(), indices.begin() + 3, indices.end());
      if (more) indices.insert(indices.end(), {indices[0], indices[0], indices[1]});
      mesh->indices = Array<uint32_t>(std::move(indices));
      sealMesh(*mesh);
      s.meshes[0] = std::move(mesh);
      return {};
    });
    const TermPtr m = motionBetween({before, before->cameras[0]}, {now, now->cameras[0]});
    for (size_t p = 0; p < size_t(kW) * kH; ++p) {
      ASSERT_NEAR(m->floats("motion")[2 * p], 0.1 * perMetre, 1e-4) << more;
      ASSERT_NEAR(m->floats("motion")[2 * p + 1], -0.05 * perMetre, 1e-4) << more;
    }
  }
}

TEST(Motion, OfAnOrthographicCamera) {
  Shot before{wall(Vec3(0.0f)), {}}, now{wall(Vec3(0.3f, 0, 0.5f)), {}};
  Camera c = now.scene->cameras[0];
  c.perspective = false;
  c.yheight = 2.0f;
  before.camera = now.camera = c;
  const TermPtr m = motionBetween(before, now);
  for (size_t p = 0; p < size_t(kW) * kH; ++p) {
    ASSERT_NEAR(m->floats("motion")[2 * p], 0.3 * kH / 2.0, 1e-4);  // depth does not count
    ASSERT_NEAR(m->floats("motion")[2 * p + 1], 0.0, 1e-4);
  }
}

// Vertices that move inside their mesh (skins, morph targets): stretching by s moves the point seen at x from x / s.
TEST(Motion, OfVertices) {
  const ScenePtr before = wall(Vec3(0.0f), 4.0f, 1.0f), now = wall(Vec3(0.0f), 4.0f, 1.25f);
  const TermPtr m = motionBetween({before, before->cameras[0]}, {now, now->cameras[0]});
  for (int y = 0; y < kH; ++y)
    for (int x = 0; x < kW; ++x) {
      const double fromCentre = x + 0.5 - 0.5 * kW;
      ASSERT_NEAR(m->floats("motion")[2 * (size_t(y) * kW + x)], fromCentre * (1 - 1 / 1.25), 2e-4);
    }
}

TEST(Motion, OfACameraAgreesWithTheMatricesOfFiles) {
  const ScenePtr scene = wall(Vec3(0.0f), 0.9f);
  Camera before = scene->cameras[0], now = before;
  const float a = 0.07f;
  now.toWorld = translate(Vec3(0.2f, -0.1f, 0.3f)) * before.toWorld *
                Mat4(Vec4(std::cos(a), 0, -std::sin(a), 0), Vec4(0, 1, 0, 0), Vec4(std::sin(a), 0, std::cos(a), 0), Vec4(0, 0, 0, 1));
  now.yfov = 0.7f;
  now.centre = Vec2(0.05f, -0.08f);
  const TermPtr g = runNode(makeGBufferNode(viewOf(now, 1)), scene, {});
  const TermPtr m = motionBetween({scene, before}, {scene, now});
  const auto film = [](const Camera& c, const Vec4& p) {
    const Vec4 n = worldToNdc(c, kW, kH) * p;
    return Vec2(n.x / n.w * kW, n.y / n.w * kH);
  };
  int hits = 0, misses = 0;
  for (int y = 0; y < kH; ++y)
    for (int x = 0; x < kW; ++x) {
      const size_t p = size_t(y) * kW + x;
      const bool hit = g->plane<uint32_t>("instance")[p] != kNoHit;
      const auto P = g->floats("P");
      const Vec4 point = hit ? Vec4(P[3 * p], P[3 * p + 1], P[3 * p + 2], 1) : Vec4(cameraRay(now, kW, kH, x + 0.5f, y + 0.5f).direction, 0);
      ++(hit ? hits : misses);
      const Vec2 here = film(now, point);
      ASSERT_NEAR(here.x, x + 0.5f, 1e-3f) << "worldToNDC says where the pixel is";
      ASSERT_NEAR(here.y, y + 0.5f, 1e-3f);
      const Vec2 moved = here - film(before, point);
      ASSERT_NEAR(m->floats("motion")[2 * p], moved.x, 2e-3f) << x << "," << y << " " << hit;
      ASSERT_NEAR(m->floats("motion")[2 * p + 1], moved.y, 2e-3f) << x << "," << y << " " << hit;
    }
  EXPECT_GT(hits, 100);
  EXPECT_GT(misses, 100);
}

TEST(Motion, WhatWasBehindTheCameraOrNotThereIsAtRest) {
  const ScenePtr scene = wall(Vec3(0.0f));
  Camera away = scene->cameras[0];
  away.toWorld[0] *= -1.0f;
  away.toWorld[2] *= -1.0f;  // looks the other way
  const TermPtr rest = motionBetween({scene, away}, {scene, scene->cameras[0]});
  for (const float v : rest->floats("motion")) ASSERT_EQ(v, 0.0f);
  SceneMaker m;  // another name, another triangle count: no past
  m.instances = 7;
  m.instance(m.mesh(box(Vec3(-1.0f), Vec3(1.0f)), m.material(Vec3(0.5f))));
  m.camera(Vec3(0, 0, 4), Vec3(0.0f), 0.8f);
  const ScenePtr other = m.finish();
  const TermPtr fresh = motionBetween({other, other->cameras[0]}, {scene, scene->cameras[0]});
  for (const float v : fresh->floats("motion")) ASSERT_EQ(v, 0.0f);
}

TEST(Motion, KeyHoldsTheEarlierMoment) {
  const ScenePtr a = wall(Vec3(0.0f)), b = wall(Vec3(0.1f, 0, 0));
  const auto key = [&](const ScenePtr& earlier, const Camera& camera) {
    Hasher h;
    makeMotionNode({viewOf(a->cameras[0], 1), earlier, camera})->hashParameters(h);
    return h.digest();
  };
  Camera turned = a->cameras[0];
  turned.yfov = 0.5f;
  EXPECT_NE(key(a, a->cameras[0]), key(b, a->cameras[0]));
  EXPECT_NE(key(a, a->cameras[0]), key(a, turned));
  EXPECT_EQ(key(a, a->cameras[0]), key(wall(Vec3(0.0f)), a->cameras[0]));
}

}  // namespace
}  // namespace gobo
