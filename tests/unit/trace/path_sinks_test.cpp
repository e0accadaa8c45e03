// SPDX-License-Identifier: Apache-2.0
// Sinks of the path kernel: whatever they keep, they are told of the same paths.
#include <cmath>
#include <limits>
#include <map>

#include "support/tiny_scenes.h"
#include "trace/first_hit_sink.h"
#include "trace/path_sample_sink.h"

namespace gobo {
namespace {
namespace path_sinks_test {

using namespace tests;

constexpr SplitMode kSplits[] = {SplitMode::Combined, SplitMode::DirectIndirect, SplitMode::ByLobe, SplitMode::ByBounce};

int floorAndWalls(SceneMaker& m) { return m.instance(m.mesh(box(Vec3(-2, 0, -2), Vec3(2, 3, 2), true), m.material(Vec3(0.7f, 0.5f, 0.3f)))); }
void ceilingLamp(SceneMaker& m) {
  LightShape s;
  s.kind = LightKind::Rect;
  s.position = Vec3(0, 2.9f, 0);
  s.u = Vec3(0.5f, 0, 0);
  s.v = Vec3(0, 0, 0.5f);
  s.axis = Vec3(0, -1, 0);
  m.light(s, Vec3(4.0f, 3.0f, 2.0f));
}
std::function<void(Material&)> metal(float roughness) {
  return [=](Material& x) {
    x.bsdf = {};
    x.bsdf.metallic = 1;
    x.bsdf.roughness = roughness;
  };
}

struct Case {
  const char* name;
  std::function<void(SceneMaker&)> make;
  int groups = 1;
};
std::vector<Case> cases() {
  return {
      {"Lambert room",
       [](SceneMaker& m) {
         floorAndWalls(m);
         ceilingLamp(m);
       }},
      {"metal, mirror, glass",
       [](SceneMaker& m) {
         floorAndWalls(m);
         ceilingLamp(m);
         m.instance(m.mesh(sphere(Vec3(-0.6f, 0.6f, 0), 0.5f, 12, true), m.material(Vec3(0.9f, 0.8f, 0.6f), metal(0.3f))));
         m.instance(m.mesh(sphere(Vec3(0.6f, 0.6f, 0), 0.5f, 12, false), m.material(Vec3(0.9f), metal(0.0f))));
         m.instance(m.mesh(box(Vec3(-0.3f, 0.1f, 0.7f), Vec3(0.3f, 0.7f, 0.9f)), m.material(Vec3(1.0f), [](Material& x) {
           x.bsdf = {};
           x.bsdf.roughness = 0.2f;
           x.bsdf.transmission = 1;
           x.bsdf.thickness = 1;
           x.bsdf.dispersion = 1;
         })));
       }},
      {"media",
       [](SceneMaker& m) {
         floorAndWalls(m);
         ceilingLamp(m);
         for (const float ior : {1.0f, 1.4f})
           m.instance(m.mesh(box(Vec3(ior - 1.9f, 0.1f, -0.4f), Vec3(ior - 1.0f, 1.0f, 0.5f)), m.material(Vec3(1.0f), [=](Material& x) {
             x.bsdf = {};
             x.bsdf.roughness = 0;
             x.bsdf.transmission = 1;
             x.bsdf.thickness = 1;
             x.bsdf.ior = ior;
             x.bsdf.attenuationColor = Vec3(0.9f, 0.6f, 0.4f);
             x.bsdf.attenuationDistance = 0.5f;
             x.bsdf.scatterAlbedo = Vec3(0.7f, 0.8f, 0.9f);
           })));
       }},
      {"clear panes",
       [](SceneMaker& m) {
         floorAndWalls(m);
         ceilingLamp(m);
         for (const float z : {0.6f, 1.1f})
           m.instance(m.mesh(quad(Vec3(-2, 0, z), Vec3(4, 0, 0), Vec3(0, 3, 0)), m.material(Vec3(0.8f, 0.9f, 1.0f), [](Material& x) {
             x.bsdf = {};
             x.bsdf.roughness = 0;
             x.bsdf.transmission = 1;
           })));
       }},
      {"many lights",
       [](SceneMaker& m) {
         floorAndWalls(m);
         m.environment(constantEnvironment(Vec3(0.3f)));
         for (int k = 0; k < 24; ++k) {
           LightShape s;
           s.kind = k % 3 == 0 ? LightKind::Point : k % 3 == 1 ? LightKind::Sphere : LightKind::Disk;
           s.position = Vec3(-1.5f + 0.13f * float(k), 1.2f + 0.1f * float(k % 7), -1.0f + 0.3f * float(k % 5));
           s.radius = s.kind == LightKind::Point ? 0.0f : 0.05f;
           s.axis = Vec3(0, -1, 0);
           m.light(s, Vec3(0.5f, 0.4f, 0.3f));
         }
       },
       3},
  };
}

std::unique_ptr<Traced> sceneOf(const Case& c, SplitMode split) {
  SceneMaker m;
  c.make(m);
  m.camera(Vec3(0.1f, 1.3f, 1.8f), Vec3(0, 1.0f, 0), 1.1f);
  auto traced = std::make_unique<Traced>(m.finish(), 5, 5);
  Traced& t = *traced;
  t.settings.split = split;
  t.settings.seed = 20;
  t.settings.maxBounces = 5;
  t.settings.blockSize = 24;  // a whole chunk and half of one
  t.settings.groups = c.groups;
  for (size_t k = 0; k < t.settings.groupOf.size(); ++k) t.settings.groupOf[k] = int(k) % c.groups;
  return traced;
}

/// The sums that the contributions make, in the pictures' order of additions: with one slot by sample, then samples by chunk.
std::vector<double> summed(const PathSampleSink& paths, const PathTracer& tracer, const PathTracerSettings& settings) {
  std::vector<double> out(size_t(tracer.slots()) * 3, 0.0);
  std::vector<DVec3> bySample(paths.samples().size(), DVec3(0.0));
  for (const auto& c : paths.contributions())
    forEachSlot(settings.split, c, [&](int slot, const Vec3& v) {
      if (tracer.slots() == 1) bySample[c.sample] += DVec3(v);
      else
        for (int k = 0; k < 3; ++k) out[size_t(slot * 3 + k)] += double(v[k]);
    });
  if (tracer.slots() == 1) {
    std::map<uint64_t, DVec3> chunks;
    const uint64_t size = uint64_t(settings.blockSize);
    for (size_t i = 0; i < bySample.size(); ++i) chunks.try_emplace(paths.samples()[i].sample % size / 16, 0.0).first->second += bySample[i];
    for (const auto& [chunk, sum] : chunks)
      for (int k = 0; k < 3; ++k) out[size_t(k)] += sum[k];
  }
  return out;
}

TEST(PathSinks, ContributionsOfPathSamplesMakeThePicturesBitForBit) {
  for (const Case& c : cases())
    for (const SplitMode split : kSplits) {
      SCOPED_TRACE(std::string(c.name) + ", split " + std::to_string(int(split)));
      const auto traced = sceneOf(c, split);
      const Traced& t = *traced;
      const auto tracer = t.tracer();
      double light = 0;
      size_t vertices = 0;
      for (int y = 0; y < 5; ++y)
        for (int x = 0; x < 5; ++x) {
          std::vector<double> sums(size_t(tracer->slots()) * 3, 0.0);
          uint64_t rays = 0, dropped = 0, sinkRays = 0, sinkDropped = 0;
          tracer->traceBlock(x, y, 3, sums.data(), rays, dropped);
          PathSampleSink paths;
          tracer->traceInto(x, y, 3, paths, sinkRays, sinkDropped);
          EXPECT_EQ(sums, summed(paths, *tracer, t.settings));
          EXPECT_EQ(rays, sinkRays);
          EXPECT_EQ(dropped, sinkDropped);
          EXPECT_EQ(paths.lost(), 0u);
          for (const double v : sums) light += v;
          for (const auto& s : paths.samples()) {
            vertices += s.vertices;
            EXPECT_GE(s.film.x, float(x));
            EXPECT_LE(s.film.x, float(x + 1));
          }
        }
      EXPECT_GT(light, 0.0);
      EXPECT_GT(vertices, 25u * 24u);
    }
}

TEST(PathSinks, FirstHitsHoldTheIndirectLightByLobe) {
  for (const Case& c : cases()) {
    SCOPED_TRACE(c.name);
    const auto traced = sceneOf(c, SplitMode::ByLobe);
    const Traced& t = *traced;
    const auto tracer = t.tracer();
    double total = 0;
    for (int y = 0; y < 5; ++y)
      for (int x = 0; x < 5; ++x) {
        std::vector<double> sums(size_t(tracer->slots()) * 3, 0.0);
        uint64_t rays = 0, dropped = 0;
        tracer->traceBlock(x, y, 1, sums.data(), rays, dropped);
        FirstHitSink first;
        tracer->traceInto(x, y, 1, first, rays, dropped);
        DVec3 indirect[2] = {DVec3(0.0), DVec3(0.0)}, modulated[2] = {DVec3(0.0), DVec3(0.0)}, truth[2] = {DVec3(0.0), DVec3(0.0)};
        for (const FirstHitSample& s : first.samples()) {
          indirect[0] += DVec3(s.indirectDiffuse);
          indirect[1] += DVec3(s.indirectSpecular);
          modulated[0] += DVec3(s.diffuseWeight * s.demodulated());
          modulated[1] += DVec3(s.specularWeight * s.demodulated());
        }
        for (int g = 0; g < t.settings.groups; ++g)
          for (int lobe = 0; lobe < 2; ++lobe)
            for (int k = 0; k < 3; ++k) truth[lobe][k] += sums[size_t((g * 5 + 3 + lobe) * 3 + k)];
        for (int lobe = 0; lobe < 2; ++lobe)
          for (int k = 0; k < 3; ++k) {
            const double scale = truth[0][k] + truth[1][k];
            EXPECT_NEAR(indirect[lobe][k], truth[lobe][k], 1e-5 * scale);
            EXPECT_NEAR(modulated[lobe][k], truth[lobe][k], 2e-5 * scale);
            total += truth[lobe][k];
          }
      }
    EXPECT_GT(total, 0.0);
  }
}

TEST(PathSinks, DistancesBetweenParallelPlanesAreTheirGapOverTheCosine) {
  SceneMaker m;
  m.instance(m.mesh(ground(1000.0f), m.material(Vec3(0.5f))));
  m.instance(m.mesh(quad(Vec3(-1000, 2, -1000), Vec3(2000, 0, 0), Vec3(0, 0, 2000)), m.material(Vec3(0.5f))));
  m.environment(constantEnvironment(Vec3(1.0f)));
  m.camera(Vec3(0, 1.5f, 0), Vec3(0, 0, 0), 0.5f);
  const Traced t(m.finish(), 4, 4);
  const auto tracer = t.tracer();
  uint64_t rays = 0, dropped = 0;
  FirstHitSink first;
  for (int b = 0; b < 16; ++b) tracer->traceInto(b % 4, b / 4, 0, first, rays, dropped);
  ASSERT_EQ(first.samples().size(), 256u);
  double mean = 0;
  for (const FirstHitSample& s : first.samples()) {
    ASSERT_GT(s.direction.y, 0.0f);
    EXPECT_NEAR(s.distance * s.direction.y, 2.0f, 4e-4f);  // rays start 3e-7 of the triangle's reach (1000) off its plane
    EXPECT_NEAR(s.pdf, s.direction.y / kPi, 1e-6f);
    EXPECT_EQ(s.diffuseWeight, Vec3(0.5f));
    EXPECT_EQ(s.specularWeight, Vec3(0.0f));
    mean += double(s.direction.y) / 256;
  }
  EXPECT_NEAR(mean, 2.0 / 3, 0.02);  // cosine-distributed
}

TEST(PathSinks, RaysThatLeaveTheSceneAreInfiniteAndPathsWithoutARayHaveNone) {
  SceneMaker m;
  m.instance(m.mesh(ground(1.0f), m.material(Vec3(0.5f))));
  m.environment(constantEnvironment(Vec3(1.0f)));
  m.camera(Vec3(0, 2, 0), Vec3(0, 0, 0), 0.1f);
  Traced t(m.finish(), 1, 1);
  for (const bool away : {false, true}) {
    if (away) t.settings.camera.toWorld[2] = -t.settings.camera.toWorld[2];
    const auto tracer = t.tracer();
    uint64_t rays = 0, dropped = 0;
    FirstHitSink first;
    tracer->traceInto(0, 0, 0, first, rays, dropped);
    for (const FirstHitSample& s : first.samples()) EXPECT_EQ(s.distance, away ? FirstHitSample::kNone : std::numeric_limits<float>::infinity());
  }
}

TEST(PathSinks, WhatArrivesDoesNotDependOnTheFirstSurfacesAlbedo) {
  const auto arriving = [](const Vec3& albedo) {
    SceneMaker m;  // light on the floor by way of the ceiling only, one bounce: the floor's albedo is a factor of everything
    m.instance(m.mesh(ground(5.0f), m.material(albedo)));
    m.instance(m.mesh(quad(Vec3(-5, 2, -5), Vec3(10, 0, 0), Vec3(0, 0, 10)), m.material(Vec3(0.6f))));
    LightShape s;
    s.kind = LightKind::Point;
    s.position = Vec3(0.3f, 1, 0.2f);
    m.light(s, Vec3(3.0f));
    m.camera(Vec3(0, 1.5f, 0), Vec3(0, 0, 0), 0.8f);
    Traced t(m.finish(), 2, 2);
    t.settings.maxBounces = 1;
    FirstHitSink first;
    uint64_t rays = 0, dropped = 0;
    t.tracer()->traceInto(1, 0, 0, first, rays, dropped);
    return first.samples();
  };
  const auto a = arriving(Vec3(0.8f, 0.5f, 0.25f)), b = arriving(Vec3(0.1f, 0.9f, 0.3f));
  ASSERT_EQ(a.size(), b.size());
  double sum = 0;
  for (size_t i = 0; i < a.size(); ++i) {
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(a[i].demodulated()[c], b[i].demodulated()[c], 1e-5f * a[i].demodulated()[c] + 1e-9f);
    EXPECT_EQ(a[i].distance, b[i].distance);
    sum += a[i].demodulated().x;
  }
  EXPECT_GT(sum, 0.0);
}

TEST(PathSinks, SamplesWithANonFinitePartVanishFromAllOfThem) {
  for (const SplitMode split : kSplits) {
    SceneMaker m;
    floorAndWalls(m);
    ceilingLamp(m);
    LightShape s;  // its light overflows float close by
    s.kind = LightKind::Point;
    s.position = Vec3(0.0f, 0.15f, 0.2f);
    m.light(s, Vec3(3.0e38f));
    m.camera(Vec3(0.1f, 1.3f, 1.8f), Vec3(0, 1.0f, 0), 1.1f);
    Traced t(m.finish(), 4, 4);
    t.settings.split = split;
    const auto tracer = t.tracer();
    uint64_t lostOfAll = 0, kept = 0;
    for (int p = 0; p < 16; ++p) {
      std::vector<double> sums(size_t(tracer->slots()) * 3, 0.0);
      uint64_t rays = 0, lost[3] = {0, 0, 0};
      PathSampleSink paths;
      FirstHitSink first;
      tracer->traceBlock(p % 4, p / 4, 0, sums.data(), rays, lost[0]);
      tracer->traceInto(p % 4, p / 4, 0, paths, rays, lost[1]);
      tracer->traceInto(p % 4, p / 4, 0, first, rays, lost[2]);
      EXPECT_EQ(lost[0], lost[1]);
      EXPECT_EQ(lost[0], lost[2]);
      EXPECT_EQ(paths.samples().size(), 16 - lost[0]);
      EXPECT_EQ(first.samples().size(), 16 - lost[0]);
      for (size_t i = 0; i < std::min(paths.samples().size(), first.samples().size()); ++i) EXPECT_EQ(paths.samples()[i].sample, first.samples()[i].sample);
      EXPECT_EQ(sums, summed(paths, *tracer, t.settings));
      lostOfAll += lost[0];
      kept += 16 - lost[0];
    }
    EXPECT_GT(lostOfAll, 0u);
    EXPECT_GT(kept, 0u);
  }
}

TEST(PathSinks, RecordsDoNotDependOnThreads) {
  for (const Case& c : cases()) {
    SCOPED_TRACE(c.name);
    const auto traced = sceneOf(c, SplitMode::DirectIndirect);
    const Traced& t = *traced;
    const auto tracer = t.tracer();
    const auto digests = [&](int threads) {
      TaskArena arena(threads);
      std::vector<Hash128> digest(25);
      arena.parallelFor(25, 1, [&](size_t begin, size_t end) {
        PathSampleSink paths;  // one for all pixels of a thread, as nodes have it
        FirstHitSink first;
        for (size_t p = begin; p < end; ++p) {
          paths.clear();
          first.clear();
          uint64_t rays = 0, dropped = 0;
          tracer->traceInto(int(p % 5), int(p / 5), 0, paths, rays, dropped);
          tracer->traceInto(int(p % 5), int(p / 5), 0, first, rays, dropped);
          Hasher h;
          for (const auto& s : paths.samples())
            for (const auto& v : paths.verticesOf(s)) h.add(v.at.position.x).add(v.at.position.y).add(v.at.normal.z).add(v.pdf).add(v.at.event).add(v.passed);
          for (const auto& k : paths.contributions()) h.add(k.sample).add(k.vertices).add(k.slot).add(k.value.x).add(k.specular.y);
          for (const auto& s : first.samples()) h.add(s.distance).add(s.pdf).add(s.indirectDiffuse.x).add(s.specularWeight.y);
          digest[p] = h.digest();
        }
      });
      return digest;
    };
    const auto one = digests(1);
    EXPECT_TRUE(one == digests(2));
    EXPECT_TRUE(one == digests(7));
  }
}

TEST(PathSinks, VerticesFollowTheRaysAndDensitiesTheSurfaces) {
  const auto traced = sceneOf(cases()[0], SplitMode::Combined);
  const Traced& t = *traced;  // inside a Lambert box: every vertex is on a wall
  const auto tracer = t.tracer();
  PathSampleSink paths;
  uint64_t rays = 0, dropped = 0;
  for (int p = 0; p < 25; ++p) tracer->traceInto(p % 5, p / 5, 0, paths, rays, dropped);
  size_t pairs = 0;
  for (const auto& s : paths.samples()) {
    const auto path = paths.verticesOf(s);
    for (size_t k = 0; k < path.size(); ++k) {
      EXPECT_EQ(path[k].at.event, int(k) + 1);
      const Vec3 p = path[k].at.position;
      EXPECT_NEAR(std::min({std::fabs(std::fabs(p.x) - 2), std::fabs(p.y), std::fabs(p.y - 3), std::fabs(std::fabs(p.z) - 2)}), 0.0f, 1e-5f);
      if (k == 0) {
        EXPECT_EQ(path[k].pdf, 0.0f);
        continue;
      }
      const Vec3 along = p - path[k - 1].at.position, way = glm::normalize(along);
      EXPECT_NEAR(path[k].pdf, glm::dot(way, path[k - 1].at.normal) / kPi, 1e-5f + 1e-5f / glm::length(along));  // rays start a few 1e-6 off the wall
      ++pairs;
    }
  }
  EXPECT_GT(pairs, 1000u);
  for (const auto& c : paths.contributions()) {
    const uint32_t n = paths.samples()[c.sample].vertices;
    EXPECT_LE(c.vertices, n);
    EXPECT_EQ(int(c.vertices), c.events);  // asked for from the last of them, or found by the ray that left it
  }
}

TEST(PathSinks, LimitsBoundWhatIsKeptAndSaySo) {
  const auto traced = sceneOf(cases()[0], SplitMode::Combined);
  const Traced& t = *traced;
  const auto tracer = t.tracer();
  uint64_t rays = 0, dropped = 0;
  PathSampleSink all, few({2, 10});
  tracer->traceInto(2, 2, 0, all, rays, dropped);
  tracer->traceInto(2, 2, 0, few, rays, dropped);
  EXPECT_EQ(few.contributions().size(), 10u);
  EXPECT_EQ(few.lost(), all.contributions().size() - 10);
  ASSERT_EQ(few.samples().size(), all.samples().size());
  for (size_t i = 0; i < all.samples().size(); ++i) {
    EXPECT_EQ(few.samples()[i].vertices, std::min(2u, all.samples()[i].vertices));
    EXPECT_EQ(few.samples()[i].vertices + few.samples()[i].cut, all.samples()[i].vertices);
  }
}

}  // namespace path_sinks_test
}  // namespace
}  // namespace gobo
