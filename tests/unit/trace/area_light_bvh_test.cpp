// SPDX-License-Identifier: Apache-2.0
// The boxes around area lights against asking every light.
#include "trace/area_light_bvh.h"

#include "base/sobol.h"
#include "support/tiny_scenes.h"
#include "trace/area_lights.h"
#include "trace/path_kernel.h"

namespace gobo {
namespace {

using namespace tests;

float random(uint64_t a, uint64_t b) { return toUnit(hash32(a, b)); }
Vec3 randomPoint(uint64_t a, uint64_t i) { return Vec3(random(a, 3 * i), random(a, 3 * i + 1), random(a, 3 * i + 2)) * 2.0f - 1.0f; }

// 1000 lights of the three kinds in a cube of 20 m; every tenth sits exactly on its neighbour, and 20 are one pile.
std::vector<AreaLightBvh::Entry> lights(const Vec3& shift = Vec3(0.0f), float scale = 1.0f) {
  std::vector<AreaLightBvh::Entry> all;
  for (int i = 0; i < 1000; ++i) {
    const uint64_t n = uint64_t(i >= 500 && i < 520 ? 500 : i % 10 == 9 ? i - 1 : i);
    LightShape s;
    s.kind = n % 3 == 0 ? LightKind::Rect : n % 3 == 1 ? LightKind::Disk : LightKind::Sphere;
    s.position = shift + scale * 10.0f * randomPoint(1, n);
    const Frame frame(n % 7 == 0 ? Vec3(0, -1, 0) : glm::normalize(randomPoint(2, n) + Vec3(1e-3f)));
    s.axis = frame.z;
    s.u = frame.x * (scale * (0.1f + random(3, n)));
    s.v = frame.y * (scale * (0.1f + random(4, n)));
    s.radius = scale * (0.05f + random(5, n));
    s.twoSided = n % 2 == 0;
    all.push_back({2 * i + 1, s, i % 4 != 0});  // names are not positions in the list
  }
  return all;
}

Ray ray(uint64_t i, const Vec3& shift, float scale) {
  Vec3 d = randomPoint(12, i);
  if (i % 5 == 0) d = Vec3(i % 3 == 0, i % 3 == 1, i % 3 == 2) * (i % 2 ? 1.0f : -1.0f);  // along an axis: slabs without an end
  return {shift + scale * 14.0f * randomPoint(11, i), glm::normalize(d), i % 4 == 0 ? scale * 2.0f : 0.0f, i % 2 ? scale * 12.0f : 3.0e38f};
}

TEST(AreaLightBvh, CollectsWhatEveryLightAskedInTurnGivesBitForBit) {
  struct {
    Vec3 shift;
    float scale;
  } places[] = {{Vec3(0.0f), 1.0f}, {Vec3(1e4f, -3e3f, 2e4f), 1.0f}, {Vec3(0.0f), 1e-3f}};
  for (const auto& place : places) {
    const auto all = lights(place.shift, place.scale);
    const AreaLightBvh bvh(all);
    size_t found = 0, most = 0;
    std::vector<AreaLightBvh::Hit> hits;
    for (uint64_t i = 0; i < 10000; ++i) {
      const Ray r = ray(i, place.shift, place.scale);
      const bool visibleOnly = i % 3 == 0;
      bvh.collect(r, visibleOnly, hits);
      size_t at = 0;
      for (const auto& e : all) {
        float t;
        Vec3 n;
        if ((visibleOnly && !e.cameraVisible) || !intersectAreaLight(e.shape, r, t, n)) continue;
        ASSERT_LT(at, hits.size()) << "ray " << i << " lost light " << e.light;
        ASSERT_EQ(hits[at].light, e.light) << "ray " << i;
        ASSERT_EQ(hits[at].t, t);
        ASSERT_EQ(hits[at].Ng, n);
        ++at;
      }
      ASSERT_EQ(at, hits.size()) << "ray " << i;
      found += at;
      most = std::max(most, at);
    }
    EXPECT_GT(found, 3000u);
    EXPECT_GE(most, 20u);  // some ray went through the pile
  }
}

// The box of an upright rectangle ends where the light does: at its rim only the slack of the test keeps what rounding would lose.
TEST(AreaLightBvh, RimsOfFlatLightsAreNotLostToRounding) {
  std::vector<AreaLightBvh::Entry> all;
  for (int i = 0; i < 12; ++i) {
    LightShape s;
    s.kind = LightKind::Rect;
    s.position = Vec3(100.0f, 30.0f, -70.0f) + 50.0f * randomPoint(21, uint64_t(i));
    s.axis = Vec3(0, -1, 0);
    s.u = Vec3(0.3f + random(22, uint64_t(i)), 0, 0);
    s.v = Vec3(0, 0, 0.7f);
    s.twoSided = true;
    all.push_back({i, s, true});
  }
  const AreaLightBvh bvh(all);
  std::vector<AreaLightBvh::Hit> hits;
  int rim = 0;
  for (uint64_t i = 0; i < 40000; ++i) {
    const LightShape& s = all[i % 12].shape;
    const Vec3 target = s.position + (i % 2 ? s.u : -s.u) + s.v * (2.0f * random(23, i) - 1.0f);
    const Vec3 from = target + 40.0f * randomPoint(24, i);
    const Ray r{from, glm::normalize(target - from)};
    float t;
    Vec3 n;
    if (!intersectAreaLight(s, r, t, n)) continue;
    ++rim;
    bvh.collect(r, false, hits);
    ASSERT_TRUE(std::any_of(hits.begin(), hits.end(), [&](const auto& h) { return h.light == int(i % 12); })) << "ray " << i;
  }
  EXPECT_GT(rim, 5000);
}

TEST(AreaLightBvh, NearestIsTheFirstOfAllWithTiesToTheLowerIndex) {
  const auto all = lights();
  const AreaLightBvh bvh(all);
  int ties = 0;
  for (uint64_t i = 0; i < 10000; ++i) {
    const Ray r = ray(i, Vec3(0.0f), 1.0f);
    int best = -1;
    float nearest = 0;
    for (const auto& e : all) {
      float t;
      Vec3 n;
      if (!intersectAreaLight(e.shape, r, t, n)) continue;
      if (best >= 0 && t == nearest) ++ties;
      if (best < 0 || t < nearest) {
        best = e.light;
        nearest = t;
      }
    }
    float t = 0;
    Vec3 n;
    ASSERT_EQ(bvh.intersect(r, false, t, n), best) << "ray " << i;
    if (best >= 0) { ASSERT_EQ(t, nearest); }
  }
  EXPECT_GT(ties, 100);
}

TEST(AreaLightBvh, HoldsAnyNumberOfLights) {
  const auto all = lights();
  for (size_t n : {size_t(0), size_t(1), size_t(2), size_t(7), size_t(8), size_t(9), size_t(63), size_t(65), size_t(513)}) {
    const AreaLightBvh bvh(std::vector<AreaLightBvh::Entry>(all.begin(), all.begin() + std::ptrdiff_t(n)));
    EXPECT_EQ(bvh.empty(), n == 0);
    std::vector<AreaLightBvh::Hit> hits(3);
    for (size_t k = 0; k < n; ++k) {  // a ray at every light's face finds it
      const LightShape& s = all[k].shape;
      bvh.collect({s.position + 3.0f * s.axis, -s.axis}, false, hits);
      EXPECT_TRUE(std::any_of(hits.begin(), hits.end(), [&](const auto& h) { return h.light == all[k].light; })) << n << " lights, " << k;
    }
    bvh.collect({Vec3(0.0f, 500.0f, 0.0f), Vec3(0, 1, 0)}, false, hits);
    EXPECT_TRUE(hits.empty());
  }
}

TEST(AreaLightBvh, PathTracerGivesTheSamePictureAsAskingEveryLight) {
  SceneMaker m;
  const int white = m.material(Vec3(0.7f)), shiny = m.material(Vec3(0.6f), [](Material&x) {
    x.bsdf.metallic = 1.0f;
    x.bsdf.roughness = 0.0f;
  });
  m.instance(m.mesh(ground(12.0f, -11.0f), white));
  m.instance(m.mesh(sphere(Vec3(0.0f), 4.0f, 12, true), shiny));
  int k = 0;
  for (const auto& e : lights())
    if (k++ % 4 == 1) m.light(e.shape, Vec3(0.2f + 0.8f * random(6, uint64_t(k)), 0.5f, 1.0f), k % 8 != 2);
  for (const auto& e : {lights()[500], lights()[501]}) m.light(e.shape, Vec3(0.5f));
  m.camera(Vec3(0, 3, 18), Vec3(0, -1, 0), 1.0f);
  Traced t(m.finish(), 16, 12);
  t.settings.split = SplitMode::DirectIndirect;
  t.settings.maxBounces = 4;
  const auto tracer = t.tracer();
  ASSERT_GT(t.scene->lights.size(), 200u);
  const auto picture = [&](size_t from) {
    tracer->impl().areaBvhFrom = from;
    std::vector<double> out(size_t(16 * 12 * 3 * tracer->slots()), 0.0);
    uint64_t rays = 0, dropped = 0;
    for (int i = 0; i < 16 * 12; ++i) tracer->traceBlock(i % 16, i / 16, 0, &out[size_t(i) * 3 * size_t(tracer->slots())], rays, dropped);
    EXPECT_EQ(dropped, 0u);
    return out;
  };
  const auto boxes = picture(0), turn = picture(size_t(-1));
  EXPECT_EQ(boxes, turn);
  EXPECT_GT(std::accumulate(boxes.begin(), boxes.end(), 0.0), 1.0);
}

}  // namespace
}  // namespace gobo
