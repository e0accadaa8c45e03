// SPDX-License-Identifier: Apache-2.0
// Pictures that also say how their indirect light bends: the light is that of ByLobe to the bit, the bending that of what each path's first ray met.
#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "support/tiny_scenes.h"
#include "trace/curvature_sums.h"
#include "trace/first_hit_sink.h"
#include "trace/path_tracer.h"

namespace gobo {
namespace curvature_sums_test {

using namespace tests;

/// A rough floor, a glossy ball, a pane that light goes straight through, a mirror and a lamp without a mesh.
ScenePtr room(bool parallel) {
  SceneMaker m;
  m.instance(m.mesh(ground(6.0f), m.material(Vec3(0.7f))));
  m.instance(m.mesh(sphere(Vec3(-0.8f, 0.8f, 0.0f), 0.7f, 12, true), m.material(Vec3(0.8f), [](Material& x) {
    x.bsdf = {};
    x.bsdf.metallic = 0.5f;
    x.bsdf.roughness = 0.4f;
  })));
  m.instance(m.mesh(sphere(Vec3(0.9f, 0.9f, 0.0f), 0.8f, 12, true), m.material(Vec3(0.9f), [](Material& x) {
    x.bsdf = {};
    x.bsdf.roughness = 0.0f;
    x.bsdf.metallic = 1.0f;
  })));
  LightShape lamp;
  lamp.kind = LightKind::Disk;
  lamp.position = Vec3(0, 4, 1);
  lamp.axis = Vec3(0, -1, 0);
  lamp.radius = 0.6f;
  m.light(lamp, Vec3(6.0f));
  m.camera(Vec3(0, 1.5f, 4), Vec3(0, 0.7f, 0), 0.8f);
  auto scene = m.finish();
  if (!parallel) return scene;
  auto changed = std::make_shared<Scene>(*scene);
  changed->cameras[0].perspective = false;
  changed->cameras[0].yheight = 3.0f;
  return changed;
}

constexpr int kWide = 12, kTall = 8;

TEST(CurvatureSums, LightIsThatOfTheLobesAndBendsByTheWayToWhatItComesFrom) {
  for (const bool parallel : {false, true}) {
    Traced t(room(parallel), kWide, kTall);
    t.settings.blockSize = 16;
    t.settings.maxBounces = 4;
    t.settings.split = SplitMode::ByLobe;
    const auto plain = t.tracer();
    t.settings.split = SplitMode::ByLobeAndCurvature;
    const auto tracer = t.tracer();
    ASSERT_EQ(tracer->slots(), 7);
    const Camera& camera = t.settings.camera;
    double bent[2] = {};
    for (int i = 0; i < kWide * kTall; ++i) {
      const int x = i % kWide, y = i / kWide;
      double light[15] = {}, sums[21] = {};
      double *toLight = light, *toSums = sums;
      uint64_t rays = 0, dropped[1] = {};
      plain->traceGroup(x, y, {0, 0, 16}, {&toLight, 1}, rays, dropped);
      tracer->traceGroup(x, y, {0, 0, 16}, {&toSums, 1}, rays, dropped);
      for (int k = 0; k < 15; ++k) ASSERT_EQ(sums[k], light[k]) << "slot " << k / 3;
      FirstHitSink hits;
      uint64_t lost = 0;
      tracer->traceInto(x, y, 0, hits, rays, lost);
      // The first vertex is where the ray through the sample's place on the film ends: its distance is that of the direction times the way.
      double expected[6] = {};
      for (const FirstHitSample& s : hits.samples()) {
        if (!(s.distance >= 0) || std::isinf(s.distance)) continue;
        const Ray ray = FilmRays(camera, kWide, kTall).at(s.film.x, s.film.y);
        Hit hit;
        ASSERT_TRUE(t.accel->intersect(ray, hit));
        const double width = pixelFootprint(camera, kTall, hit.t), ratio = std::min(s.distance > 0 ? width / double(s.distance) : 2.0, 2.0);
        for (int c = 0; c < 3; ++c) {
          expected[c] += double(s.indirectDiffuse[c]) * ratio * ratio;
          expected[3 + c] += double(s.indirectSpecular[c]) * ratio * ratio;
        }
      }
      for (int k = 0; k < 6; ++k) {
        EXPECT_NEAR(sums[15 + k], expected[k], 2e-3 * expected[k] + 1e-9) << "pixel " << i << (parallel ? " parallel" : "");
        bent[k / 3] += expected[k];
      }
    }
    EXPECT_GT(bent[0], 1e-3);
    EXPECT_GT(bent[1], 1e-4);
  }
}

// By the sink itself: vertices as the kernel tells them.
TEST(CurvatureSums, KnowsWhatIsNear) {
  PathTracerSettings s;
  s.camera = Camera{};
  s.camera.perspective = false;
  s.camera.yheight = 1.0f;
  s.height = 10;  // a pixel is 0.1 wide
  const auto sum = [&](auto&& events, uint32_t dropped = 0) {
    double out[21] = {};
    double* to = out;
    CurvatureSums sink(s, {&to, 1});
    sink.start(0, 1);
    events(sink);
    sink.finish(dropped);
    return std::array<double, 3>{out[3 * 3], out[3 * kCurvatureSlot], out[3 * (kCurvatureSlot + 1)]};
  };
  const auto at = [](float z, VertexKind kind = VertexKind::Surface) { return PathVertex{kind, 1, Vec3(0, 0, z), Vec3(0.0f)}; };
  const PathScatter goes{Vec3(0, 0, 1), Vec3(1.0f), Vec3(0.0f), 1.0f, false, false}, passes{Vec3(0, 0, 1), Vec3(1.0f), Vec3(0.0f), 0.0f, true, true};
  const PathContribution light{0, 2, PathClass::Indirect, Vec3(3.0f), Vec3(1.0f)};
  using Sums = std::array<double, 3>;
  const auto expect = [](const Sums& got, double diffuse, double bentDiffuse, double bentSpecular) {
    EXPECT_NEAR(got[0], diffuse, 1e-12);
    EXPECT_NEAR(got[1], bentDiffuse, 1e-7);
    EXPECT_NEAR(got[2], bentSpecular, 1e-7);
  };
  const auto path = [&](const PathVertex& second) {
    return [&, second](CurvatureSums& k) { k.vertex(0, at(0)), k.scatter(0, goes), k.vertex(0, second), k.contribute(0, light); };
  };
  expect(sum(path(at(0.5f))), 2, 2 * 0.04, 0.04);
  expect(sum(path(at(0.05f))), 2, 2 * 4, 4);  // nearer than half a pixel
  expect(sum(path(at(0.0f))), 2, 2 * 4, 4);   // no way at all
  expect(sum(path(at(1.0f, VertexKind::Escape))), 2, 0, 0);
  expect(sum(path(at(0.5f)), 1u), 0, 0, 0);  // dropped
  // Light that arrives before the ray has met a surface bends as what it meets then; behind what it passed straight on as what is behind that.
  expect(sum([&](CurvatureSums& k) { k.vertex(0, at(0)), k.scatter(0, goes), k.contribute(0, light), k.vertex(0, at(0.5f)); }), 2, 2 * 0.04, 0.04);
  expect(sum([&](CurvatureSums& k) {
           k.vertex(0, at(0)), k.scatter(0, goes), k.vertex(0, at(0.2f)), k.scatter(0, passes), k.vertex(0, at(0.5f)), k.contribute(0, light);
         }),
         2, 2 * 0.04, 0.04);
  // Later vertices do not matter.
  expect(sum([&](CurvatureSums& k) {
           k.vertex(0, at(0)), k.scatter(0, goes), k.vertex(0, at(0.5f)), k.scatter(0, goes), k.vertex(0, at(0.6f)), k.contribute(0, light);
         }),
         2, 2 * 0.04, 0.04);
  // Direct light bends as nothing here.
  expect(sum([&](CurvatureSums& k) {
           k.vertex(0, at(0)), k.scatter(0, goes), k.vertex(0, at(0.5f)), k.contribute(0, {0, 1, PathClass::Direct, Vec3(3.0f), Vec3(1.0f)});
         }),
         0, 0, 0);
}

}  // namespace curvature_sums_test
}  // namespace gobo
