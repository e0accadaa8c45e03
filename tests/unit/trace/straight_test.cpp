// SPDX-License-Identifier: Apache-2.0
// Light that goes straight on through clear panes, boundaries of index 1 and tinted glass: closed forms under every light, and the
// path tracer against a path tracer without shadow rays.
#include <cmath>
#include <vector>

#include "base/sobol.h"
#include "support/tiny_scenes.h"
#include "trace/straight.h"

namespace gobo {
namespace {

using namespace tests;

const float kHigh = 20.0f;
enum class Kind { Point, Spot, Directional, Sphere, Rect, Disk, Mesh, Environment };
const std::vector<Kind> kStraightKinds = {Kind::Point, Kind::Spot, Kind::Directional, Kind::Sphere, Kind::Rect, Kind::Disk, Kind::Mesh, Kind::Environment};

/// Thin-walled and smooth.
std::function<void(Material&)> pane(float ior, const std::function<void(Bsdf&)>& change = {}) {
  return [=](Material& x) {
    x.bsdf = {};
    x.bsdf.roughness = 0;
    x.bsdf.transmission = 1;
    x.bsdf.ior = ior;
    if (change) change(x.bsdf);
  };
}
std::function<void(Material&)> volume(float ior, const Vec3& colour, float distance) {
  return pane(ior, [=](Bsdf& b) {
    b.thickness = 1;
    b.attenuationColor = colour;
    b.attenuationDistance = distance;
  });
}
double fresnelOutside(double cosine, double ior) {  // exact Fresnel reflectance from outside
  const double sinT = std::sqrt(1 - cosine * cosine) / ior, cosT = std::sqrt(1 - sinT * sinT);
  const double s = (cosine - ior * cosT) / (cosine + ior * cosT), p = (cosT - ior * cosine) / (cosT + ior * cosine);
  return 0.5 * (s * s + p * p);
}

/// One light high over the origin that sees it, small enough that all of it is at one angle (but for the sky).
void light(SceneMaker& m, Kind kind) {
  LightShape s;
  s.position = Vec3(0, kHigh, 0);
  s.axis = Vec3(0, -1, 0);
  switch (kind) {
    case Kind::Point:
      s.kind = LightKind::Point;
      m.light(s, Vec3(400.0f));
      return;
    case Kind::Spot:
      s.kind = LightKind::Spot;
      s.cosInner = 0.95f;
      s.cosOuter = 0.8f;
      m.light(s, Vec3(400.0f));
      return;
    case Kind::Directional:
      s.kind = LightKind::Directional;
      m.light(s, Vec3(1.0f));
      return;
    case Kind::Sphere:
      s.kind = LightKind::Sphere;
      s.radius = 0.3f;
      m.light(s, Vec3(1000.0f));
      return;
    case Kind::Rect:
      s.kind = LightKind::Rect;
      s.u = Vec3(0.3f, 0, 0);
      s.v = Vec3(0, 0, 0.3f);
      m.light(s, Vec3(1000.0f));
      return;
    case Kind::Disk:
      s.kind = LightKind::Disk;
      s.radius = 0.3f;
      m.light(s, Vec3(1000.0f));
      return;
    case Kind::Mesh: {
      const int lamp = m.material(Vec3(0.0f), [](Material& x) { x.emission.radiance = Vec3(1000.0f); });
      const int i = m.instance(m.mesh(quad(Vec3(-0.3f, kHigh, -0.3f), Vec3(0.6f, 0, 0), Vec3(0, 0, 0.6f)), lamp));
      (void)i;  // seal() makes its light
      return;
    }
    case Kind::Environment: m.environment(constantEnvironment(Vec3(1.0f))); return;
  }
}

/// A floor, a light, and what `between` puts there; the camera looks at the floor from below it.
ScenePtr floorScene(Kind kind, const std::function<void(SceneMaker&)>& between) {
  SceneMaker m;
  m.instance(m.mesh(ground(100.0f), m.material(Vec3(0.6f))));
  if (between) between(m);
  light(m, kind);
  m.camera(Vec3(0.3f, 1, 0.2f), Vec3(0, 0, 0), 1e-3f);
  return m.finish();
}
struct FloorUnder : Traced {
  explicit FloorUnder(Kind kind, const std::function<void(SceneMaker&)>& between) : Traced(floorScene(kind, between), 2, 2) {
    settings.cover = PathClass::Direct;
  }
};
void panes(SceneMaker& m, int count, const Vec3& tint, const std::function<void(Material&)>& change) {
  const int glass = m.material(tint, change);
  for (int i = 0; i < count; ++i) m.instance(m.mesh(ground(300.0f, 2.0f + 0.5f * float(i)), glass));
}

TEST(Straight, PanesOfIndexOneCastTheirTintUnderEveryLight) {
  const Vec3 tint(0.9f, 0.6f, 0.3f);
  for (const Kind kind : kStraightKinds) {
    SCOPED_TRACE(int(kind));
    const int blocks = kind == Kind::Environment ? 256 : 64;
    const Measured bare = estimate(FloorUnder(kind, {}), blocks);
    ASSERT_GT(bare[0].mean.x, 0.1);
    for (const int count : {1, 2, 3})
      for (const Vec3& colour : {Vec3(1.0f), tint}) {
        const Measured e = estimate(FloorUnder(kind, [&](SceneMaker& m) { panes(m, count, colour, pane(1.0f)); }), blocks);
        Estimate want = bare[0];
        for (int c = 0; c < 3; ++c) {
          want.mean[c] *= std::pow(double(colour[c]), count);
          want.error[c] *= std::pow(double(colour[c]), count);
        }
        expectSame(e[0], want, 1e-4);
      }
  }
}

TEST(Straight, PanesOfGlassLeaveWhatFresnelLeaves) {
  const Vec3 tint(0.9f, 0.6f, 0.3f);
  for (const Kind kind : {Kind::Point, Kind::Spot, Kind::Directional, Kind::Sphere, Kind::Rect, Kind::Disk, Kind::Mesh}) {
    SCOPED_TRACE(int(kind));
    const Measured bare = estimate(FloorUnder(kind, {}), 64);
    for (const int count : {1, 2, 3}) {
      const Measured e = estimate(FloorUnder(kind, [&](SceneMaker& m) { panes(m, count, tint, pane(1.5f)); }), 64);
      Estimate want = bare[0];
      for (int c = 0; c < 3; ++c) {
        want.mean[c] *= std::pow(0.96 * tint[c], count);
        want.error[c] *= std::pow(0.96 * tint[c], count);
      }
      expectSame(e[0], want, 2e-4);
    }
  }
}

TEST(Straight, ASlantedSunPassesByItsAngle) {
  const double slant = 1.1;  // radians from the normal
  SceneMaker m;
  m.instance(m.mesh(ground(100.0f), m.material(Vec3(0.6f))));
  panes(m, 3, Vec3(0.8f, 1.0f, 0.5f), pane(1.7f));
  LightShape s;
  s.kind = LightKind::Directional;
  s.axis = Vec3(float(std::sin(slant)), -float(std::cos(slant)), 0);
  m.light(s, Vec3(2.0f));
  m.camera(Vec3(0.3f, 1, 0.2f), Vec3(0, 0, 0), 1e-3f);
  Traced t(m.finish(), 2, 2);
  t.settings.cover = PathClass::Direct;
  const double T = 1 - fresnelOutside(std::cos(slant), 1.7);
  const DVec3 truth = 0.6 / M_PI * 2.0 * std::cos(slant) * std::pow(T, 3) * DVec3(std::pow(0.8, 3), 1.0, std::pow(0.5, 3));
  expectNear(estimate(t, 4)[0], truth, 1e-4);
}

TEST(Straight, VolumesOfIndexOneDimByTheirDepthUnderEveryLight) {
  const Vec3 colour(0.8f, 0.5f, 0.2f);
  for (const Kind kind : kStraightKinds) {
    if (kind == Kind::Environment) continue;  // at all angles: the room below has it
    SCOPED_TRACE(int(kind));
    const Measured bare = estimate(FloorUnder(kind, {}), 64);
    // Two slabs apart, and one of another kind inside the upper: it counts where it is.
    const Measured e = estimate(
        FloorUnder(kind,
                   [&](SceneMaker& m) {
                     m.instance(m.mesh(box(Vec3(-60, 2, -60), Vec3(60, 2.5f, 60)), m.material(Vec3(1.0f), volume(1.0f, colour, 1.0f))));
                     m.instance(m.mesh(box(Vec3(-60, 4, -60), Vec3(60, 5.5f, 60)), m.material(Vec3(1.0f), volume(1.0f, colour, 2.0f))));
                     m.instance(m.mesh(box(Vec3(-50, 4.5f, -50), Vec3(50, 5, 50)), m.material(Vec3(1.0f), volume(1.0f, Vec3(0.5f, 1.0f, 1.0f), 1.0f))));
                   }),
        64);
    Estimate want = bare[0];
    for (int c = 0; c < 3; ++c) {
      const double left = std::pow(double(colour[c]), 0.5 + 0.5) * (c == 0 ? std::pow(0.5, 0.5) : 1.0);
      want.mean[c] *= left;
      want.error[c] *= left;
    }
    expectSame(e[0], want, 3e-4);
  }
}

TEST(Straight, WhatBendsOrScattersLightStaysOpaqueToShadowRays) {
  const std::vector<std::function<void(Material&)>> opaque = {pane(1.5f, [](Bsdf& b) { b.roughness = 0.3f; }), volume(1.5f, Vec3(1.0f), 0.0f),
                                                              pane(1.5f, [](Bsdf& b) { b.metallic = 1; }), pane(1.5f, [](Bsdf& b) { b.transmission = 0; }),
                                                              pane(1.0f, [](Bsdf& b) { b.unlit = true; })};
  for (size_t k = 0; k < opaque.size(); ++k) {
    FloorUnder t(Kind::Directional, [&](SceneMaker& m) {
      m.instance(m.mesh(box(Vec3(-60, 2, -60), Vec3(60, 3, 60)), m.material(Vec3(1.0f), opaque[k])));
      m.instance(m.mesh(quad(Vec3(500, 0, 0), Vec3(1, 0, 0), Vec3(0, 0, -1)), m.material(Vec3(1.0f), pane(1.0f))));  // so that somebody asks
    });
    EXPECT_EQ(estimate(t, 2)[0].mean, DVec3(0.0)) << k;
  }
}

TEST(Straight, PartOfAPaneTransmits) {
  // Transmission 0.25 over a black diffuse base; a coat above it takes its share both ways.
  FloorUnder t(Kind::Directional, [&](SceneMaker& m) {
    panes(m, 1, Vec3(1.0f), pane(1.5f, [](Bsdf& b) {
            b.transmission = 0.25f;
            b.clearcoat = 1;
          }));
  });
  expectNear(estimate(t, 2)[0], DVec3(0.6 / M_PI * 0.25 * 0.96 * 0.96), 1e-4);
}

TEST(Straight, ShadowRaysSeeWhatSamplesOfTheBsdfDo) {
  // straightThrough is the mean weight of the samples that go straight on.
  for (const float ior : {1.0f, 1.3f, 2.0f})
    for (const float metallic : {0.0f, 0.4f})
      for (const float coat : {0.0f, 0.7f})
        for (const float cosine : {0.1f, 0.5f, 0.95f}) {
          BsdfParams p;
          p.albedo = Vec3(0.9f, 0.5f, 0.2f);
          p.roughness = 0;
          p.transmission = 0.8f;
          p.thin = true;
          p.ior = ior;
          p.metallic = metallic;
          p.clearcoat = coat;
          p.sheenColor = Vec3(0.2f);
          p.sheenRoughness = 0.5f;
          p.iridescence = 0.5f;
          p.iridescenceThickness = 300;
          const Vec3 wo(std::sqrt(1 - cosine * cosine), 0, cosine);
          const int n = 4096;
          DVec3 sum(0.0), square(0.0);
          for (int i = 0; i < n; ++i) {
            SobolSampler u(11, uint32_t(i));
            BsdfSample s;
            const float lobe = u.next1D();
            if (!bsdfSample(p, wo, lobe, u.next2D(), s) || !s.straight) continue;
            EXPECT_TRUE(s.delta && s.transmitted && s.wi == -wo);
            sum += DVec3(s.weight);
            square += DVec3(s.weight) * DVec3(s.weight);
          }
          const Vec3 want = bsdfStraight(p, wo);
          EXPECT_GT(want.x, 0.01f);
          for (int c = 0; c < 3; ++c)
            EXPECT_NEAR(sum[c] / n, want[c], 3 * std::sqrt(square[c]) / n + 1e-3) << ior << " " << metallic << " " << coat << " " << cosine;
        }
}

/// Radiance along the camera's centre by paths that only ever find light by hitting it. Knows surfaces and volumes that absorb.
Estimate withoutShadowRays(const Traced& t, int samples) {
  SurfaceTable surfaces;
  const SceneView view = t.view();
  surfaces.build(view, *t.accel);
  const Mat4& c = t.scene->cameras[0].toWorld;
  std::vector<DVec3> batch(32, DVec3(0.0));
  t.arena.parallelFor(batch.size(), 1, [&](size_t begin, size_t end) {
    for (size_t b = begin; b < end; ++b)
      for (int i = 0; i < samples; ++i) {
        uint64_t state = hash64(b * 1000003 + 17, uint64_t(i));
        const auto draw = [&] {
          state = hash64(state, 1);
          return toUnit(uint32_t(state >> 32));
        };
        Ray ray{Vec3(c[3]), -Vec3(c[2])};
        Vec3 beta(1.0f);
        MediumStack around;
        around.clear();
        for (int step = 0; step < 400; ++step) {
          Hit hit;
          const bool met = t.accel->intersect(ray, hit);
          const int top = around.top();
          if (top >= 0 && met) beta *= surfaces.interiors()[size_t(top)].transmittance(hit.t);
          if (!met) {
            if (t.scene->environment) batch[b] += DVec3(beta * t.scene->environment->eval(ray.direction));
            break;
          }
          const Material& material = t.scene->materials[size_t(t.scene->meshes[size_t(t.scene->instances[hit.instance].mesh)]->material)];
          Surface s;
          surfaces.interact(hit.instance, hit.primitive, hit.u, hit.v, hit.Ng, ray.direction, s);
          if (material.coverage.doubleSided || s.front) batch[b] += DVec3(beta * material.emission.radiance);
          const int inside = s.material->interior;
          if (inside >= 0) s.bsdf.ior = around.relativeIor(surfaces.interiors(), inside, s.bsdf.ior, s.front);
          BsdfSample bs;
          const Frame frame = s.frame();
          const float lobe = draw(), x = draw(), y = draw();
          if (!bsdfSample(s.bsdf, frame.toLocal(-ray.direction), lobe, Vec2(x, y), bs)) break;
          if (bs.transmitted && inside >= 0) {
            if (s.front) around.enter(inside);
            else around.leave(inside);
          }
          beta *= bs.weight;
          const float survive = std::min(1.0f, maxComponent(beta));
          if (step > 8) {
            if (!(draw() < survive)) break;
            beta /= survive;
          }
          ray.direction = glm::normalize(frame.toWorld(bs.wi));
          ray.origin = s.origin(bs.transmitted ? -s.facing() : s.facing());
        }
      }
  });
  Estimate e;
  for (DVec3& b : batch) {
    b /= double(samples);
    e.mean += b / double(batch.size());
  }
  for (const DVec3& b : batch) e.error += (b - e.mean) * (b - e.mean);
  e.error = glm::sqrt(e.error / double(batch.size() * (batch.size() - 1)));
  return e;
}

ScenePtr glazedScene(int size, const std::function<void(Material&)>& window, const Vec3& tint) {
  SceneMaker m;
  m.instance(m.mesh(ground(4.0f, -2.0f), m.material(Vec3(0.7f))));
  m.instance(m.mesh(quad(Vec3(-4, 2, -4), Vec3(8, 0, 0), Vec3(0, 0, 8)), m.material(Vec3(0.7f))));
  m.instance(m.mesh(quad(Vec3(-4, -2, -4), Vec3(8, 0, 0), Vec3(0, 4, 0)), m.material(Vec3(0.3f, 0.6f, 0.7f))));
  m.instance(m.mesh(quad(Vec3(-4, -2, 4), Vec3(0, 0, -8), Vec3(0, 4, 0)), m.material(Vec3(0.6f))));
  m.instance(m.mesh(quad(Vec3(4, -2, 4), Vec3(-8, 0, 0), Vec3(0, 4, 0)), m.material(Vec3(0.6f))));
  m.instance(m.mesh(quad(Vec3(4, -2, -4), Vec3(0, 0, 8), Vec3(0, 4, 0)), m.material(tint, window)));  // a wall of glass
  auto sky = std::make_shared<Environment>(*constantEnvironment(Vec3(0.5f)));
  m.environment(sky);
  m.camera(Vec3(-3, 0, 3), Vec3(0, -2, -1), size > 2 ? 1.0f : 1e-3f);
  return m.finish();
}
struct GlazedRoom : Traced {
  GlazedRoom(int size, const std::function<void(Material&)>& window, const Vec3& tint = Vec3(1.0f)) : Traced(glazedScene(size, window, tint), size, size) {
    settings.maxBounces = 60;
    settings.rouletteStart = 6;
  }
};

TEST(Straight, GlazedRoomsHoldTheEnergyThatPathsWithoutShadowRaysFind) {
  for (const float ior : {1.0f, 1.5f}) {
    GlazedRoom t(1, pane(ior), Vec3(0.9f, 0.8f, 0.4f));
    const Measured e = estimate(t, 256);
    const Estimate want = withoutShadowRays(t, 4000);
    EXPECT_LT(want.error.x, 0.02 * want.mean.x);
    expectSame(e[0], want, 1e-3);
    EXPECT_LT(e[0].error.x, 0.02 * want.mean.x);
  }
}

TEST(Straight, LampsInBulbsAndBehindSlabsHoldTheirEnergy) {
  for (int kind = 0; kind < 3; ++kind) {
    SCOPED_TRACE(kind);
    SceneMaker m;
    m.instance(m.mesh(box(Vec3(-3.0f), Vec3(3.0f), true), m.material(Vec3(0.5f, 0.6f, 0.7f))));
    const int lamp = m.material(Vec3(0.0f), [](Material& x) { x.emission.radiance = Vec3(20.0f); });
    m.instance(m.mesh(sphere(Vec3(0, 1, 0), 0.4f, 6, false), lamp));
    if (kind == 0) m.instance(m.mesh(sphere(Vec3(0, 1, 0), 0.9f, 12, true), m.material(Vec3(0.9f, 0.7f, 0.5f), pane(1.5f))));
    if (kind == 1) m.instance(m.mesh(box(Vec3(-2.9f, -1, -2.9f), Vec3(2.9f, -0.2f, 2.9f)), m.material(Vec3(1.0f), volume(1.0f, Vec3(0.7f, 0.4f, 0.2f), 1.0f))));
    if (kind == 2) {  // glass in fog of index 1: a boundary that bends, behind one that does not
      m.instance(m.mesh(box(Vec3(-2.9f, -1.5f, -2.9f), Vec3(2.9f, 0.2f, 2.9f)), m.material(Vec3(1.0f), volume(1.0f, Vec3(0.9f, 0.7f, 0.6f), 1.0f))));
      m.instance(m.mesh(sphere(Vec3(0, -0.7f, 0), 0.6f, 8, true), m.material(Vec3(1.0f), volume(1.5f, Vec3(0.5f), 1.0f))));
    }
    m.camera(Vec3(-2, -2, 2), Vec3(1, -3, -0.5f), 1e-3f);
    Traced t(m.finish(), 1, 1);
    t.settings.maxBounces = 60;
    t.settings.rouletteStart = 6;
    const Measured e = estimate(t, 512);
    const Estimate want = withoutShadowRays(t, 3000);
    EXPECT_LT(want.error.x, 0.03 * want.mean.x);
    expectSame(e[0], want, 1e-3);
  }
}

TEST(Straight, GlazedRoomsHaveNoFireflies) {
  GlazedRoom t(12, pane(1.5f));
  t.settings.blockSize = 4;
  const auto tracer = t.tracer();
  double sum = 0, most = 0;
  uint64_t rays = 0, dropped = 0;
  for (int y = 0; y < 12; ++y)
    for (int x = 0; x < 12; ++x)
      for (uint32_t b = 0; b < 8; ++b) {
        double out[3] = {0, 0, 0};
        tracer->traceBlock(x, y, b, out, rays, dropped);
        sum += out[1];
        most = std::max(most, out[1]);
      }
  EXPECT_EQ(dropped, 0u);
  EXPECT_LT(most, 12 * sum / (12 * 12 * 8));  // of blocks of four samples
}

TEST(Straight, WhiteFurnaceWithPanesGivesWhatItGets) {
  for (const float ior : {1.0f, 1.5f}) {
    SceneMaker m;
    m.instance(m.mesh(ground(3.0f), m.material(Vec3(1.0f))));
    m.instance(m.mesh(box(Vec3(-2, 0.5f, -2), Vec3(2, 2, 2)), m.material(Vec3(1.0f), pane(ior))));
    m.environment(constantEnvironment(Vec3(1.0f)));
    m.camera(Vec3(0.2f, 0.3f, 0.1f), Vec3(0, 0, 0), 0.5f);
    Traced t(m.finish(), 4, 4);
    t.settings.maxBounces = 60;
    t.settings.rouletteStart = 200;
    expectNear(estimate(t, 16)[0], DVec3(1.0), 2e-3);
  }
}

TEST(Straight, ClassesOfPathsAgreeBehindPanes) {
  // The same sum however it is split, and what a shadow ray brings through a pane is direct light, one event.
  for (const SplitMode split : {SplitMode::DirectIndirect, SplitMode::ByBounce, SplitMode::ByLobe}) {
    GlazedRoom t(2, pane(1.5f));
    t.settings.maxBounces = 4;
    const Measured whole = estimate(t, 64);
    t.settings.split = split;
    const Measured parts = estimate(t, 64);
    Estimate sum;
    for (const Estimate& e : parts.slots) {
      sum.mean += e.mean;
      sum.error += e.error;
    }
    expectSame(whole[0], sum);
    t.settings.split = SplitMode::Combined;
    t.settings.cover = PathClass::Direct;
    const Measured direct = estimate(t, 64);
    EXPECT_GT(direct[0].mean.x, 0.01);
    if (split != SplitMode::ByLobe) expectSame(direct[0], parts[1]);
  }
}

// A pane that is half paint has light of lamps at an event of its own, whichever way the path goes on: straight through, which is no event, too.
TEST(Straight, LightAtHalfClearPanesIsOfTheirOwnEvent) {
  SceneMaker m;
  m.instance(m.mesh(ground(4.0f), m.material(Vec3(0.6f))));
  m.instance(m.mesh(ground(4.0f, 1.0f), m.material(Vec3(0.7f), pane(1.5f, [](Bsdf& b) { b.transmission = 0.5f; }))));
  LightShape s;
  s.kind = LightKind::Point;
  s.position = Vec3(0.4f, 0.6f, 0.1f);
  m.light(s, Vec3(2.0f));
  m.camera(Vec3(0, 0.9f, 0.5f), Vec3(0, 0, -0.2f), 0.8f);  // below the pane: only after the floor is it met
  Traced t(m.finish(), 3, 3);
  const auto traced = [&](PathClass cover, SplitMode split, int bounces) {
    t.settings.cover = cover;
    t.settings.split = split;
    t.settings.maxBounces = bounces;
    return estimate(t, 16).slots;
  };
  const auto direct = traced(PathClass::Direct, SplitMode::Combined, 0);
  EXPECT_GT(direct[0].mean.x, 0.01);
  for (const SplitMode split : {SplitMode::DirectIndirect, SplitMode::ByBounce}) {
    const auto all = traced(PathClass::All, split, 8);
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(all[1].mean[c], direct[0].mean[c], 1e-6 * direct[0].mean[c]) << int(split);
    EXPECT_GT(all[2].mean.x, 0.01);
  }
  const auto indirect = traced(PathClass::Indirect, SplitMode::ByLobe, 8), whole = traced(PathClass::All, SplitMode::Combined, 8);
  EXPECT_EQ(indirect[1].mean, DVec3(0.0));
  EXPECT_EQ(indirect[2].mean, DVec3(0.0));
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(indirect[3].mean[c] + indirect[4].mean[c] + direct[0].mean[c], whole[0].mean[c], 1e-5 * whole[0].mean[c]);
}

TEST(Straight, SceneAndTableAgreeOnWhoAsks) {
  const auto asked = [](const std::function<void(Material&)>& change) {
    SceneMaker m;
    m.instance(m.mesh(ground(1.0f), m.material(Vec3(0.5f))));
    m.instance(m.mesh(ground(1.0f, 1.0f), m.material(Vec3(0.5f), change)));
    m.material(Vec3(1.0f), pane(1.0f));  // used by nobody
    m.camera(Vec3(0, 2, 0), Vec3(0.0f));
    Traced t(m.finish());
    SurfaceTable surfaces;
    const SceneView view = t.view();
    surfaces.build(view, *t.accel);
    EXPECT_EQ(surfaces.anyStraight(), lightGoesStraight(*t.scene));
    return surfaces.anyStraight();
  };
  EXPECT_TRUE(asked(pane(1.5f)));
  EXPECT_TRUE(asked(pane(1.0f, [](Bsdf& b) { b.roughness = 1; })));
  EXPECT_TRUE(asked(volume(1.0f, Vec3(0.5f), 1.0f)));
  EXPECT_FALSE(asked(volume(1.5f, Vec3(0.5f), 1.0f)));
  EXPECT_FALSE(asked(pane(1.5f, [](Bsdf& b) { b.roughness = 0.5f; })));
  EXPECT_FALSE(asked(pane(1.5f, [](Bsdf& b) { b.transmission = 0; })));
}

}  // namespace
}  // namespace gobo
