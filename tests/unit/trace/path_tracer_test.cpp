// SPDX-License-Identifier: Apache-2.0
// The path tracer against closed forms: what it converges to.
#include "trace/path_tracer.h"

#include "base/sobol.h"
#include "support/tiny_scenes.h"
#include "trace/bsdf.h"
#include "trace/view_samples.h"

namespace gobo {
namespace {

using namespace tests;

ScenePtr furnace(float albedo, float emission, float scale = 1.0f, const Vec3& shift = Vec3(0.0f), bool invert = false) {
  SceneMaker m;
  const int wall = m.material(Vec3(albedo), [&](Material& x) { x.emission.radiance = Vec3(emission); });
  const Mesh cube = box(Vec3(-1.0f) * scale, Vec3(1.0f) * scale);
  Mesh walls;  // corners apart, so that each wall may have normals of its own
  for (size_t i = 0; i < cube.indices.size(); ++i) {
    const size_t t = i / 3 * 3;
    const Vec3 a = cube.positions[cube.indices[t]], b = cube.positions[cube.indices[t + 1]], c = cube.positions[cube.indices[t + 2]];
    walls.indices.push_back(uint32_t(i));
    walls.positions.push_back(cube.positions[cube.indices[i]]);
    walls.normals.push_back(glm::normalize(glm::cross(b - a, c - a)) * (invert ? -1.0f : 1.0f));
  }
  m.instance(m.mesh(walls, wall), translate(shift));
  m.camera(shift + Vec3(0.1f, 0.05f, 0.2f) * scale, shift + Vec3(1.0f, 0.3f, -0.2f) * scale, 1.2f);
  return m.finish();
}
double geometric(double a, int terms) {
  double s = 0, p = 1;
  for (int i = 0; i < terms; ++i) {
    s += p;
    p *= a;
  }
  return s;
}

TEST(PathTracer, FurnaceTotalIsTheGeometricSeries) {
  for (const float albedo : {0.0f, 0.5f, 0.9f}) {
    Traced t(furnace(albedo, 2.0f));
    t.settings.maxBounces = 12;
    const Measured m = estimate(t, 16);
    expectNear(m[0], DVec3(2.0 * geometric(albedo, 14)));
    EXPECT_EQ(m.dropped, 0u);
  }
}

TEST(PathTracer, FurnaceByBounceGivesEachPowerOfTheAlbedo) {
  Traced t(furnace(0.7f, 1.0f));
  t.settings.split = SplitMode::ByBounce;
  t.settings.maxBounces = 5;
  const Measured m = estimate(t, 32);
  ASSERT_EQ(m.slots.size(), 7u);
  for (int k = 0; k < 7; ++k) expectNear(m[k], DVec3(std::pow(double(0.7f), k)));
}

TEST(PathTracer, FurnaceHoldsAtEveryScaleFarAwayAndWithInvertedNormals) {
  const double truth = geometric(0.8f, 10);
  for (const ScenePtr& scene : {furnace(0.8f, 1.0f, 1e-4f), furnace(0.8f, 1.0f, 1e4f), furnace(0.8f, 1.0f, 64.0f, Vec3(1e5f, -1e5f, 3e4f)),
                                furnace(0.8f, 1.0f, 1.0f, Vec3(0.0f), true)}) {
    Traced t(scene);
    const Measured m = estimate(t, 8);
    expectNear(m[0], DVec3(truth), 1e-3);  // far away the walls are 1/8000 of a coordinate thick: tenths of a percent of light is cut
    EXPECT_EQ(m.dropped, 0u);
  }
}

TEST(PathTracer, ScaledScenesGiveTheSamePictureAndMovedOnesNearlySo) {
  const auto scene = [](float s, const Vec3& shift) {
    SceneMaker m;
    const int white = m.material(Vec3(0.7f)), lamp = m.material(Vec3(0.0f), [](Material&x) { x.emission.radiance = Vec3(5.0f); });
    const Mat4 move = translate(shift) * scaling(Vec3(s));
    m.instance(m.mesh(ground(2.0f), white), move);
    m.instance(m.mesh(box(Vec3(-0.3f, 0.0f, -0.3f), Vec3(0.2f, 0.5f, 0.4f)), white), move);
    m.instance(m.mesh(quad(Vec3(-0.4f, 1.5f, -0.4f), Vec3(0.8f, 0, 0), Vec3(0, 0, 0.8f)), lamp), move);
    m.camera(shift + s * Vec3(0, 1, 3), shift + s * Vec3(0, 0.3f, 0), 0.7f);
    return m.finish();
  };
  const auto picture = [](const ScenePtr& s) {
    Traced t(s, 12, 12);
    const auto tracer = t.tracer();
    std::vector<double> all(12 * 12 * 3, 0.0);
    uint64_t rays = 0, dropped = 0;
    for (int i = 0; i < 144; ++i)
      for (uint32_t b = 0; b < 8; ++b) tracer->traceBlock(i % 12, i / 12, b, &all[size_t(i) * 3], rays, dropped);
    return all;
  };
  const auto difference = [](const std::vector<double>& a, const std::vector<double>& b) {
    double d = 0, s = 0;
    for (size_t i = 0; i < a.size(); ++i) {
      d += std::fabs(a[i] - b[i]);
      s += std::fabs(a[i]);
    }
    return d / s;
  };
  const auto one = picture(scene(1.0f, Vec3(0.0f)));
  EXPECT_LT(difference(one, picture(scene(0x1p-13f, Vec3(0.0f)))), 1e-6);  // powers of two: nearly the same floats
  EXPECT_LT(difference(one, picture(scene(1e-4f, Vec3(0.0f)))), 1e-4);
  EXPECT_LT(difference(one, picture(scene(1e4f, Vec3(0.0f)))), 1e-4);
  const auto far = picture(scene(1000.0f, Vec3(1e5f, 0, -1e5f)));  // 1e5 units from the origin: coordinates 1/128 apart
  EXPECT_LT(difference(one, far), 5e-3);
}

// Radiance of a Lambert floor at the origin, camera straight above.
Measured floorUnder(const std::function<void(SceneMaker&)>& lights, float albedo = 0.6f, int blocks = 32) {
  SceneMaker m;
  m.instance(m.mesh(ground(50.0f), m.material(Vec3(albedo))));
  lights(m);
  m.camera(Vec3(0.3f, 3, 0.1f), Vec3(0.0f), 1e-5f);
  Traced t(m.finish());
  return estimate(t, blocks);
}

TEST(PathTracer, FloorUnderDeltaLights) {
  const double albedo = 0.6f;
  LightShape point;
  point.position = Vec3(1, 2, 0);
  const double point2 = 5.0;
  expectNear(floorUnder([&](SceneMaker& m) { m.light(point, Vec3(10, 5, 1)); })[0], DVec3(10, 5, 1) * (albedo / M_PI * 2 / std::sqrt(5.0) / point2), 1e-4);
  LightShape sun;
  sun.kind = LightKind::Directional;
  sun.axis = glm::normalize(Vec3(0, -1, 1));
  expectNear(floorUnder([&](SceneMaker& m) { m.light(sun, Vec3(4.0f)); })[0], DVec3(4.0 * albedo / M_PI * std::sqrt(0.5)), 1e-4);
}

TEST(PathTracer, FloorUnderAreaLights) {
  const double albedo = 0.6f;
  LightShape ball;
  ball.kind = LightKind::Sphere;
  ball.position = Vec3(0, 2, 0);
  ball.radius = 0.7f;  // above the horizon: E = pi L sin^2
  expectNear(floorUnder([&](SceneMaker& m) { m.light(ball, Vec3(3.0f), false); })[0], DVec3(3.0 * albedo * 0.35 * 0.35), 1e-4);
  LightShape disk;
  disk.kind = LightKind::Disk;
  disk.position = Vec3(0, 1, 0);
  disk.radius = 0.8f;  // E = pi L r^2 / (r^2 + h^2)
  expectNear(floorUnder([&](SceneMaker& m) { m.light(disk, Vec3(3.0f)); })[0], DVec3(3.0 * albedo * 0.64 / 1.64), 1e-4);
  LightShape rect;  // four corner rectangles a x b at height c
  rect.kind = LightKind::Rect;
  rect.position = Vec3(0, 1, 0);
  rect.u = Vec3(0.5f, 0, 0);
  rect.v = Vec3(0, 0, 0.9f);
  const double a = 0.5, b = 0.9, c = 1.0, ra = std::hypot(a, c), rb = std::hypot(b, c);
  const double form = 4 * (a / ra * std::atan(b / ra) + b / rb * std::atan(a / rb)) / (2 * M_PI);
  const Measured lit = floorUnder([&](SceneMaker& m) { m.light(rect, Vec3(3.0f)); });
  expectNear(lit[0], DVec3(3.0 * albedo * form), 1e-4);
  const Measured mesh = floorUnder([&](SceneMaker& m) {  // the same, as an emissive mesh
    m.instance(
        m.mesh(quad(Vec3(-0.5f, 1, -0.9f), Vec3(1, 0, 0), Vec3(0, 0, 1.8f)), m.material(Vec3(0.0f), [](Material& x) { x.emission.radiance = Vec3(3.0f); })),
        translate(Vec3(0.0f)));
    m.scene.cameras.clear();
  });
  // The camera looks from above the lamp; the lamp hides the floor, so its own radiance is seen instead.
  expectNear(mesh[0], DVec3(3.0));
}

TEST(PathTracer, EmissiveMeshLightsTheFloorLikeTheRectangle) {
  SceneMaker m;
  m.instance(m.mesh(ground(50.0f), m.material(Vec3(0.6f))));
  m.instance(
      m.mesh(quad(Vec3(-0.5f, 1, -0.9f), Vec3(1, 0, 0), Vec3(0, 0, 1.8f)), m.material(Vec3(0.0f), [](Material& x) { x.emission.radiance = Vec3(3.0f); })));
  m.camera(Vec3(3, 0.5f, 0.1f), Vec3(0.0f), 1e-5f);
  const double a = 0.5, b = 0.9, c = 1.0, ra = std::hypot(a, c), rb = std::hypot(b, c);
  const double form = 4 * (a / ra * std::atan(b / ra) + b / rb * std::atan(a / rb)) / (2 * M_PI);
  Traced t(m.finish());
  expectNear(estimate(t, 32)[0], DVec3(3.0 * double(0.6f) * form), 1e-4);
}

/// A closed thin lamp: only its lower side lights what is below, by the kernel's lanes (opaque) and by the sampler of any lamp (masked).
TEST(PathTracer, OfAClosedLampTheFacingSideLightsTheFloor) {
  for (const bool masked : {false, true}) {
    SceneMaker m;
    m.instance(m.mesh(ground(50.0f), m.material(Vec3(0.6f))));
    Mesh lamp = quad(Vec3(-0.5f, 1, -0.9f), Vec3(1, 0, 0), Vec3(0, 0, 1.8f));
    const auto join = [&](const Mesh& other) {
      std::vector<Vec3> positions(lamp.positions.begin(), lamp.positions.end());
      std::vector<uint32_t> indices(lamp.indices.begin(), lamp.indices.end());
      for (const uint32_t i : other.indices) indices.push_back(i + uint32_t(positions.size()));
      positions.insert(positions.end(), other.positions.begin(), other.positions.end());
      lamp.positions = std::move(positions);
      lamp.indices = std::move(indices);
      lamp.normals = {};
      lamp.tangents = {};
      lamp.uv = {};
    };
    join(quad(Vec3(-0.5f, 1.01f, -0.9f), Vec3(0, 0, 1.8f), Vec3(1, 0, 0)));
    join(quad(Vec3(-0.5f, 1, -0.9f), Vec3(0, 0, 1.8f), Vec3(0, 0.01f, 0)));
    join(quad(Vec3(0.5f, 1, -0.9f), Vec3(0, 0.01f, 0), Vec3(0, 0, 1.8f)));
    m.instance(m.mesh(lamp, m.material(Vec3(0.0f), [&](Material& x) {
      x.emission.radiance = Vec3(3.0f);
      if (masked) x.coverage.mode = AlphaMode::Mask;
    })));
    m.camera(Vec3(3, 0.5f, 0.1f), Vec3(0.0f), 1e-5f);
    const double a = 0.5, b = 0.9, c = 1.0, ra = std::hypot(a, c), rb = std::hypot(b, c);
    const double form = 4 * (a / ra * std::atan(b / ra) + b / rb * std::atan(a / rb)) / (2 * M_PI);
    Traced t(m.finish());
    expectNear(estimate(t, 32)[0], DVec3(3.0 * double(0.6f) * form), 1e-4);
  }
}

/// A lamp's back is black, although rounding puts some of its points in front of its own plane.
TEST(PathTracer, ALampsFrontDoesNotLightItsBack) {
  for (const bool masked : {false, true}) {
    SceneMaker m;
    m.instance(m.mesh(quad(Vec3(-0.51f, 0.73f, -0.9f), Vec3(1, 0.21f, 0.1f), Vec3(0.13f, 0.05f, 1.8f)), m.material(Vec3(0.8f), [&](Material& x) {
      x.emission.radiance = Vec3(3.0f);
      x.coverage.doubleSided = false;
      if (masked) x.coverage.mode = AlphaMode::Mask;
    })));
    m.camera(Vec3(0.1f, 4, 0.1f), Vec3(0.1f, 0.8f, 0.0f), 0.2f);
    Traced t(m.finish());
    const Measured e = estimate(t, 16);
    EXPECT_LT(e[0].mean.x, 1e-5) << masked;
  }
}

TEST(PathTracer, WhiteSurfacesUnderAWhiteSkyAreWhite) {
  for (const bool ball : {false, true}) {
    SceneMaker m;
    const int white = m.material(Vec3(1.0f));
    m.instance(m.mesh(ball ? sphere(Vec3(0.0f), 1.0f, 24, false) : ground(1.0f), white));
    m.environment(constantEnvironment(Vec3(1.0f)), 2.0f);
    m.camera(Vec3(0, 2, 3), Vec3(0.0f), 1.0f);
    Traced t(m.finish());
    const Measured e = estimate(t, 16);
    expectNear(e[0], DVec3(2.0), 1e-5);  // convex: every escaping path ends in the sky, weight 1
  }
}

TEST(PathTracer, MisAgreesWithLightSamplingAlone) {
  // A lamp that no ray can hit (point lights in a grid) against the same irradiance has no MIS partner; here the partner is
  // measured: by-bounce slot 1 with MIS against the analytic rectangle from many points of view is covered above, so compare
  // a glossy floor, where BSDF sampling matters, with a fine brute force: tiny lamps by BSDF rays and by NEE agree.
  const auto scene = [](float roughness, bool visibleSky) {
    SceneMaker m;
    m.instance(m.mesh(ground(5.0f), m.material(Vec3(0.8f), [&](Material& x) {
      x.bsdf.specular = 1.0f;
      x.bsdf.roughness = roughness;
      x.bsdf.metallic = 0.5f;
    })));
    LightShape rect;
    rect.kind = LightKind::Rect;
    rect.position = Vec3(0, 1.5f, -1);
    rect.u = Vec3(0.6f, 0, 0);
    rect.v = Vec3(0, 0, 0.4f);
    m.light(rect, Vec3(4.0f));
    if (visibleSky) m.environment(constantEnvironment(Vec3(0.3f)));
    m.camera(Vec3(0, 1, 2), Vec3(0, 0, -0.3f), 0.3f);
    return m.finish();
  };
  for (const float roughness : {0.2f, 0.6f}) {
    Traced t(scene(roughness, true));
    const Measured mis = estimate(t, 64);
    // BSDF sampling alone, by a hand-made integrator over the same public parts.
    const auto sampler = LightSampler::build(t.view());
    const Camera camera = t.settings.camera;
    std::vector<double> values;
    uint64_t seed = 99;
    BsdfParams params;
    params.albedo = Vec3(0.8f);
    params.metallic = 0.5f;
    params.roughness = roughness;
    double sum = 0, squares = 0;
    const int n = 400'000;
    for (int i = 0; i < n; ++i) {
      SobolSampler s(hash64(seed, uint64_t(i)), 0);
      const Vec2 film = s.next2D();
      const Ray r = cameraRay(camera, 8, 8, film.x * 8, film.y * 8);
      const Vec3 p = r.origin - r.direction * (r.origin.y / r.direction.y);
      double value = 0;
      BsdfSample bs;
      const Frame f(Vec3(0, 1, 0));
      if (bsdfSample(params, f.toLocal(-r.direction), s.next1D(), s.next2D(), bs)) {
        const Vec3 wi = f.toWorld(bs.wi);
        float hit;
        Vec3 ng;
        if (sampler->intersectAreaLights({p + Vec3(0, 1e-5f, 0), wi}, hit, ng) >= 0) value += 4.0 * bs.weight.x;
        value += 0.3 * bs.weight.x;
      }
      sum += value;
      squares += value * value;
    }
    Estimate brute;
    brute.mean = DVec3(sum / n);
    brute.error = DVec3(std::sqrt((squares / n - sum / n * sum / n) / n));
    expectSame(mis[0], brute, 1e-4);
    EXPECT_LT(mis[0].error.x, 0.02 * mis[0].mean.x);
  }
}

ScenePtr manyLamps() {
  SceneMaker m;
  const int grey = m.material(Vec3(0.6f));
  m.instance(m.mesh(ground(4.0f), grey));
  m.instance(m.mesh(box(Vec3(-0.5f, 0, -0.5f), Vec3(0.5f, 1, 0.5f)), m.material(Vec3(0.5f), [](Material& x) {
    x.bsdf.specular = 1.0f;
    x.bsdf.roughness = 0.4f;
  })));
  for (int i = 0; i < 6; ++i) {
    LightShape s;
    s.position = Vec3(-2.5f + float(i), 1.2f + 0.2f * float(i % 3), 1.0f - 0.5f * float(i));
    s.kind = i % 3 == 0 ? LightKind::Point : i % 3 == 1 ? LightKind::Sphere : LightKind::Rect;
    s.radius = 0.15f;
    s.u = Vec3(0.2f, 0, 0);
    s.v = Vec3(0, 0, 0.3f);
    s.twoSided = i == 5;
    m.light(s, Vec3(1.0f + float(i)));
  }
  LightShape sun;
  sun.kind = LightKind::Directional;
  sun.axis = glm::normalize(Vec3(0.3f, -1, 0.2f));
  m.light(sun, Vec3(0.5f));
  m.instance(
      m.mesh(quad(Vec3(1, 1.5f, 1), Vec3(0.4f, 0, 0), Vec3(0, 0.3f, 0.3f)), m.material(Vec3(0.3f), [](Material& x) { x.emission.radiance = Vec3(2.0f); })));
  m.environment(constantEnvironment(Vec3(0.2f)));
  m.camera(Vec3(0, 2, 5), Vec3(0, 0.3f, 0), 0.7f);
  return m.finish();
}

TEST(PathTracer, EveryLightSelectionHasTheSameMean) {
  Traced t(manyLamps());
  t.settings.maxBounces = 3;
  Measured m[3];
  for (int i = 0; i < 3; ++i) {
    t.settings.selection = LightSelection(i);
    t.settings.seed = uint64_t(100 + i);
    m[i] = estimate(t, 200);
  }
  expectSame(m[0][0], m[2][0]);
  expectSame(m[1][0], m[2][0]);
  EXPECT_NEAR(m[0][0].mean.x / m[2][0].mean.x, 1.0, 0.03);
  EXPECT_NEAR(m[1][0].mean.x / m[2][0].mean.x, 1.0, 0.03);
}

TEST(PathTracer, SplitsSumToTheCombinedValueBySample) {
  Traced t(manyLamps());
  t.settings.groups = 3;
  for (size_t k = 0; k < t.settings.groupOf.size(); ++k) t.settings.groupOf[k] = int(k % 3);
  std::vector<double> combined;
  for (const SplitMode split : {SplitMode::Combined, SplitMode::DirectIndirect, SplitMode::ByLobe, SplitMode::ByBounce}) {
    t.settings.split = split;
    const auto tracer = t.tracer();
    const int per = slotsPerGroup(split, t.settings.maxBounces);
    std::vector<double> sums(8 * 8 * 9, 0.0);
    uint64_t rays = 0, dropped = 0;
    for (int i = 0; i < 64; ++i) {
      std::vector<double> out(size_t(tracer->slots()) * 3, 0.0);
      for (uint32_t b = 0; b < 4; ++b) tracer->traceBlock(i % 8, i / 8, b, out.data(), rays, dropped);
      for (int g = 0; g < 3; ++g)
        for (int s = 0; s < per; ++s)
          for (int c = 0; c < 3; ++c) sums[size_t(i * 9 + g * 3 + c)] += out[size_t((g * per + s) * 3 + c)];
    }
    if (combined.empty()) {
      combined = sums;
      continue;
    }
    for (size_t i = 0; i < sums.size(); ++i) EXPECT_NEAR(sums[i], combined[i], 1e-6 * std::fabs(combined[i]) + 1e-12) << i;  // f32 lobes: a - b + b
  }
}

TEST(PathTracer, CoverClassesAddUp) {
  Traced t(manyLamps());
  const auto run = [&](PathClass cover) {
    t.settings.cover = cover;
    const auto tracer = t.tracer();
    std::vector<double> out(64 * 3, 0.0);
    uint64_t rays = 0, dropped = 0;
    for (int i = 0; i < 64; ++i)
      for (uint32_t b = 0; b < 4; ++b) tracer->traceBlock(i % 8, i / 8, b, &out[size_t(i) * 3], rays, dropped);
    return std::pair(out, rays);
  };
  const auto all = run(PathClass::All), emission = run(PathClass::Emission), direct = run(PathClass::Direct), indirect = run(PathClass::Indirect);
  for (size_t i = 0; i < all.first.size(); ++i)
    EXPECT_NEAR(emission.first[i] + direct.first[i] + indirect.first[i], all.first[i], 1e-9 + 1e-9 * all.first[i]);  // same draws, same paths
  EXPECT_LT(direct.second, all.second);                                                                              // work that cannot contribute is skipped
  EXPECT_EQ(emission.second, 64u * 4 * 16);
  EXPECT_LT(indirect.second, all.second);
}

// 8 blocks in a row are one Sobol sequence of 128 samples: their mean errs less than that of 8 independent blocks, while streams know
// nothing of each other (the halves of a certificate rest on that).
TEST(PathTracer, BlocksContinueOneSequenceAndStreamsAreIndependent) {
  SceneMaker m;
  m.instance(m.mesh(ground(2.0f), m.material(Vec3(0.7f))));
  LightShape rect;
  rect.kind = LightKind::Rect;
  rect.position = Vec3(0, 1.5f, 0);
  rect.u = Vec3(0.4f, 0, 0);
  rect.v = Vec3(0, 0, 0.4f);
  m.light(rect, Vec3(5.0f));
  m.camera(Vec3(0, 1, 1), Vec3(0.0f), 0.3f);
  Traced t(m.finish(), 8, 8);
  t.settings.maxBounces = 0;
  const auto tracer = t.tracer();
  constexpr int kStreams = 24, kBlocks = 8;
  double one = 0, eight = 0, across = 0, crossed = 0;
  uint64_t rays = 0, dropped = 0;
  for (int pixel = 0; pixel < 64; ++pixel) {
    std::vector<double> first(kStreams), mean(kStreams, 0.0);
    for (int s = 0; s < kStreams; ++s)
      for (int b = 0; b < kBlocks; ++b) {
        double out[3] = {};
        tracer->traceBlock(pixel % 8, pixel / 8, uint32_t(s) * kBlocksPerStream + uint32_t(b), out, rays, dropped);
        if (b == 0) first[s] = out[0];
        mean[s] += out[0] / kBlocks;
      }
    double f = 0, e = 0;
    for (int s = 0; s < kStreams; ++s) {
      f += first[s] / kStreams;
      e += mean[s] / kStreams;
    }
    for (int s = 0; s < kStreams; ++s) {
      one += (first[s] - f) * (first[s] - f);
      eight += (mean[s] - e) * (mean[s] - e);
    }
    for (int s = 0; s < kStreams; s += 2) {
      across += (first[s] - f) * (first[s + 1] - f);
      ++crossed;
    }
  }
  EXPECT_LT(eight, 0.7 * one / kBlocks);  // 0.53; independent blocks: 1 +- 0.06
  EXPECT_LT(std::fabs(across / crossed), 5 / std::sqrt(crossed) * one / (64 * kStreams) + one / (64 * kStreams) / kStreams);
}

TEST(PathTracer, BlocksDoNotDependOnOrder) {
  Traced t(manyLamps());
  t.settings.split = SplitMode::ByBounce;
  const auto a = t.tracer(), b = t.tracer();
  const size_t n = size_t(a->slots()) * 3;
  std::vector<std::vector<double>> first(256, std::vector<double>(n, 0.0)), second = first;
  uint64_t rays = 0, dropped = 0;
  for (int i = 0; i < 256; ++i) a->traceBlock(i % 8, i / 8 % 8, uint32_t(i / 64), first[i].data(), rays, dropped);
  std::vector<uint64_t> r(256), d(256);
  t.arena.parallelFor(256, 1, [&](size_t begin, size_t) {
    const int i = 255 - int(begin);
    b->traceBlock(i % 8, i / 8 % 8, uint32_t(i / 64), second[i].data(), r[i], d[i]);
  });
  EXPECT_EQ(first, second);
}

TEST(PathTracer, LinearInTheNominalPowersOfAGroup) {
  Traced t(manyLamps());
  t.settings.selection = LightSelection::Uniform;  // importance follows the nominal powers; Uniform keeps the paths the same
  const Measured one = estimate(t, 4);
  for (Vec3& n : t.settings.nominal) n *= 4.0f;
  const Measured four = estimate(t, 4);
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(four[0].mean[c], 4 * one[0].mean[c], 1e-6 * four[0].mean[c]);
}

TEST(PathTracer, ViewSamplesSitWhereTheTermsExpectThem) {
  SceneMaker m;  // environment with a gradient: radiance tells the direction of the ray
  Image image(64, 32, 3);
  for (int y = 0; y < 32; ++y)
    for (int x = 0; x < 64; ++x)
      for (int c = 0; c < 3; ++c) image.at(x, y)[c] = float(c == 0 ? x : c == 1 ? y : 1);
  m.environment(makeEnvironment("gradient", image));
  m.camera(Vec3(0.0f), Vec3(0.3f, 0.2f, -1), 2.0f);
  Traced t(m.finish(), 4, 4);
  for (const int S : {1, 3, 16}) {
    t.settings.viewSamples = S;
    const auto tracer = t.tracer();
    for (int pixel = 0; pixel < 16; ++pixel) {
      double out[3] = {0, 0, 0}, expected[3] = {0, 0, 0};
      uint64_t rays = 0, dropped = 0;
      for (uint32_t b = 0; b < 3; ++b) tracer->traceBlock(pixel % 4, pixel / 4, b, out, rays, dropped);
      for (int i = 0; i < 48; ++i) {
        const Vec2 o = viewSamplePosition(i % S, S);
        const Vec3 e = t.scene->environment->eval(cameraRay(t.settings.camera, 4, 4, float(pixel % 4) + o.x, float(pixel / 4) + o.y).direction);
        for (int c = 0; c < 3; ++c) expected[c] += e[c];
      }
      for (int c = 0; c < 3; ++c) EXPECT_NEAR(out[c], expected[c], 1.5);  // one step of the gradient, should a ray land on a texel's border
    }
  }
  EXPECT_EQ(viewSamplePosition(0, 1), Vec2(0.5f));
}

}  // namespace
}  // namespace gobo
