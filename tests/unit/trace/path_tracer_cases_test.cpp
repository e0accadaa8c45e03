// SPDX-License-Identifier: Apache-2.0
// The path tracer's hard cases: what must not go wrong.
#include <algorithm>
#include <limits>
#include <random>

#include <glm/gtc/matrix_transform.hpp>

#include "base/sobol.h"
#include "support/tiny_scenes.h"
#include "trace/sample_set.h"

namespace gobo {
namespace {

using namespace tests;

TEST(SampleSet, EqualsTheScalarSamplerBitForBit) {
  for (const uint32_t first : {0u, 16u, 1024u}) {
    const SampleSet set(0x1234567890abcdefull, first);
    float x[kLanes], y[kLanes], z[kLanes];
    set.draw2D(0, x, y);
    set.draw1D(1, z);
    for (int i = 0; i < kLanes; ++i) {
      SobolSampler s(0x1234567890abcdefull, first + uint32_t(i));
      const Vec2 a = s.next2D();
      EXPECT_EQ(a, Vec2(x[i], y[i]));
      EXPECT_EQ(s.next1D(), z[i]);
    }
  }
}

TEST(SampleSet, CosineDirectionsAreUnitAndCosineDistributed) {
  double mean = 0, squares = 0, across = 0;
  const int n = 4096;
  for (int b = 0; b < n / kLanes; ++b) {
    const SampleSet set(5, uint32_t(b * kLanes));
    float u[kLanes], v[kLanes], x[kLanes], y[kLanes], z[kLanes];
    set.draw2D(0, u, v);
    cosineDirections(u, v, x, y, z);
    for (int i = 0; i < kLanes; ++i) {
      EXPECT_NEAR(x[i] * x[i] + y[i] * y[i] + z[i] * z[i], 1.0, 2e-6);
      const double phi = 2 * M_PI * (double(u[i]) - 0.5);
      EXPECT_NEAR(x[i], std::sqrt(double(v[i])) * std::cos(phi), 2e-6);
      EXPECT_NEAR(y[i], std::sqrt(double(v[i])) * std::sin(phi), 2e-6);
      mean += z[i] / double(n);
      squares += double(z[i]) * z[i] / n;
      across += double(x[i]) * y[i] / n;
    }
  }
  EXPECT_NEAR(mean, 2.0 / 3, 2e-3);
  EXPECT_NEAR(squares, 0.5, 2e-3);
  EXPECT_NEAR(across, 0.0, 2e-3);
}

std::shared_ptr<Texture> halfClear() {
  auto t = std::make_shared<Texture>();
  t->name = "alpha";
  t->width = 2;
  t->height = 1;
  t->nearest = true;
  t->texels8 = {255, 255, 255, 0, 255, 255, 255, 255};
  sealTexture(*t);
  return t;
}

TEST(PathTracerCases, MaskedTexelsLetCameraAndShadowRaysThrough) {
  for (const bool clear : {true, false}) {
    SceneMaker m;
    m.scene.textures.push_back(halfClear());
    const int leaf = m.material(Vec3(0.0f), [](Material& x) {
      x.coverage.mode = AlphaMode::Mask;
      x.coverage.texture.texture = 0;
    });
    m.instance(m.mesh(ground(20.0f), m.material(Vec3(0.5f))));
    m.instance(m.mesh(quad(Vec3(-1, 1, 1), Vec3(2, 0, 0), Vec3(0, 0, -2)), leaf));  // clear for x < 0
    LightShape sun;
    sun.kind = LightKind::Directional;
    m.light(sun, Vec3(2.0f));
    m.camera(Vec3(clear ? -0.5f : 0.5f, 3, 0), Vec3(clear ? -0.5f : 0.5f, 0, 0), 1e-4f);
    Traced t(m.finish());
    expectNear(estimate(t, 4)[0], DVec3(clear ? 2.0 * 0.5 / M_PI : 0.0), 1e-5);
  }
}

TEST(PathTracerCases, BlendedSheetsPassTheirShareOfLight) {
  SceneMaker m;
  m.instance(m.mesh(ground(20.0f), m.material(Vec3(0.5f))));
  m.instance(m.mesh(quad(Vec3(-9, 1, 9), Vec3(18, 0, 0), Vec3(0, 0, -18)), m.material(Vec3(0.0f), [](Material& x) {
    x.coverage.mode = AlphaMode::Blend;
    x.coverage.factor = 0.25f;
  })));
  LightShape sun;
  sun.kind = LightKind::Directional;
  sun.axis = glm::normalize(Vec3(0.2f, -1, 0));
  m.light(sun, Vec3(2.0f));
  m.camera(Vec3(0, 3, 0), Vec3(0.0f), 0.5f);
  Traced t(m.finish());
  const double cosine = -double(glm::normalize(Vec3(0.2f, -1, 0)).y);
  expectNear(estimate(t, 128)[0], DVec3(0.75 * 0.75 * 2.0 * 0.5 / M_PI * cosine), 1e-3);  // once for the camera ray, once for the shadow ray
}

TEST(PathTracerCases, WhiteGlassAndMirrorSpheresVanishInAWhiteRoom) {
  struct Kind {
    float roughness, metallic, transmission, ior;
  };
  for (const Kind k : {Kind{0, 0, 1, 1.5f}, Kind{0, 1, 0, 1.5f}, Kind{0, 0, 1, 1.0f}, Kind{1, 0, 1, 1.0f}}) {
    SceneMaker m;
    m.instance(m.mesh(sphere(Vec3(0.0f), 1.0f, 40, true), m.material(Vec3(1.0f), [&](Material& x) {
      x.bsdf = {};
      x.bsdf.roughness = k.roughness;
      x.bsdf.metallic = k.metallic;
      x.bsdf.transmission = k.transmission;
      x.bsdf.ior = k.ior;
      x.bsdf.specular = 1;
    })));
    m.environment(constantEnvironment(Vec3(1.0f)));
    m.camera(Vec3(0, 0, 4), Vec3(0.0f), 0.3f);
    Traced t(m.finish());
    t.settings.maxBounces = 64;
    const Measured e = estimate(t, 16);
    expectNear(e[0], DVec3(1.0), 2e-3);  // smooth normals of a mesh cut a little at grazing angles
    EXPECT_EQ(e.dropped, 0u);
  }
}

TEST(PathTracerCases, RoughMetalNeverMakesEnergy) {
  for (const float roughness : {0.0f, 0.02f, 0.3f, 1.0f}) {
    SceneMaker m;
    m.instance(m.mesh(sphere(Vec3(0.0f), 1.0f, 40, true), m.material(Vec3(1.0f), [&](Material& x) {
      x.bsdf = {};
      x.bsdf.roughness = roughness;
      x.bsdf.metallic = 1;
    })));
    m.environment(constantEnvironment(Vec3(1.0f)));
    m.camera(Vec3(0, 0, 4), Vec3(0.0f), 0.3f);
    Traced t(m.finish());
    const Measured e = estimate(t, 32);
    EXPECT_LT(e[0].mean.x, 1.0 + 4.5 * e[0].error.x + 1e-4) << roughness;
    EXPECT_GT(e[0].mean.x, 0.985) << roughness;
  }
  SceneMaker m;  // alpha 1, seen along the normal: one bounce leaves 1 - ln 2, the later ones bring the rest back
  m.instance(m.mesh(ground(1.0f), m.material(Vec3(1.0f), [&](Material& x) {
    x.bsdf = {};
    x.bsdf.roughness = 1;
    x.bsdf.metallic = 1;
  })));
  m.environment(constantEnvironment(Vec3(1.0f)));
  m.camera(Vec3(0, 4, 0), Vec3(0.0f), 1e-3f);
  Traced t(m.finish());
  expectNear(estimate(t, 64)[0], DVec3(1.0), 5e-3);
}

TEST(PathTracerCases, ADeltaFirstEventIsIndirect) {
  SceneMaker m;  // mirror floor shows the sky: emission straight, indirect by the mirror, direct nowhere
  m.instance(m.mesh(ground(50.0f), m.material(Vec3(1.0f), [](Material& x) {
    x.bsdf = {};
    x.bsdf.metallic = 1;
    x.bsdf.roughness = 0;
  })));
  m.environment(constantEnvironment(Vec3(1.0f)));
  m.camera(Vec3(0, 3, 3), Vec3(0.0f), 0.1f);
  Traced t(m.finish());
  t.settings.split = SplitMode::DirectIndirect;
  Measured e = estimate(t, 4);
  expectNear(e[0], DVec3(0.0));
  expectNear(e[1], DVec3(0.0));
  expectNear(e[2], DVec3(1.0));
  t.settings.split = SplitMode::ByLobe;
  e = estimate(t, 4);
  expectNear(e[3], DVec3(0.0));
  expectNear(e[4], DVec3(1.0));
  t.settings.split = SplitMode::Combined;
  t.settings.cover = PathClass::Direct;
  expectNear(estimate(t, 4)[0], DVec3(0.0));
}

TEST(PathTracerCases, LobesOfTheFirstEventSeparateDiffuseFromSpecular) {
  const auto scene = [](float specular, float albedo) {
    SceneMaker m;
    m.instance(m.mesh(ground(50.0f), m.material(Vec3(albedo), [&](Material& x) {
      x.bsdf = {};
      x.bsdf.roughness = 0.5f;
      x.bsdf.specular = specular;
    })));
    LightShape s;
    s.kind = LightKind::Sphere;
    s.position = Vec3(0, 2, -2);
    s.radius = 0.5f;
    m.light(s, Vec3(3.0f));
    m.camera(Vec3(0, 2, 2), Vec3(0.0f), 0.1f);
    return m.finish();
  };
  Traced both(scene(1.0f, 0.5f)), gloss(scene(1.0f, 0.0f));
  both.settings.split = gloss.settings.split = SplitMode::ByLobe;
  const Measured a = estimate(both, 64), b = estimate(gloss, 64);
  expectSame(a[2], b[2], 1e-4);  // the specular lobe of a dielectric does not know the albedo
  EXPECT_GT(a[1].mean.x, 0.01);
  expectNear(b[1], DVec3(0.0));
}

TEST(PathTracerCases, SingleSidedEmittersShineFromTheirFrontOnlyAlsoWhenMirrored) {
  for (const bool mirrored : {false, true})
    for (const bool above : {false, true}) {
      SceneMaker m;
      const int lamp = m.material(Vec3(0.3f), [](Material& x) {
        x.emission.radiance = Vec3(2.0f);
        x.coverage.doubleSided = false;
      });
      m.instance(m.mesh(ground(5.0f), lamp), mirrored ? scaling(Vec3(-1, 1, 1)) : Mat4(1.0f));
      m.camera(Vec3(0, above ? 3.0f : -3.0f, 0.5f), Vec3(0.0f), 0.2f);
      Traced t(m.finish());
      expectNear(estimate(t, 2)[0], DVec3(above ? 2.0 : 0.0));
    }
}

TEST(PathTracerCases, LightsThatTheCameraMayNotSeeStillLight) {
  for (const bool visible : {true, false}) {
    SceneMaker m;
    m.instance(m.mesh(ground(50.0f), m.material(Vec3(0.5f))));
    LightShape ball;
    ball.kind = LightKind::Sphere;
    ball.position = Vec3(0, 2, 0);
    ball.radius = 0.5f;
    m.light(ball, Vec3(3.0f), visible);
    m.camera(Vec3(0, 5, 0), Vec3(0.0f), 1e-4f);
    Traced t(m.finish());
    t.settings.split = SplitMode::DirectIndirect;
    const Measured e = estimate(t, 16);
    expectNear(e[0], DVec3(visible ? 3.0 : 0.0));
    expectNear(e[1], DVec3(0.5 * 3.0 * 0.25 / 4.0), 1e-4);
  }
}

TEST(PathTracerCases, NoLightLeaksIntoAClosedBoxAtAnyScale) {
  for (const float s : {1e-4f, 1.0f, 1e4f}) {
    SceneMaker m;  // thin double wall, blazing sky outside
    const int wall = m.material(Vec3(0.9f));
    m.instance(m.mesh(sphere(Vec3(0.3f, 0.2f, 0.1f) * s, s, 12, true), wall));
    m.environment(constantEnvironment(Vec3(1e6f)));
    m.camera(Vec3(0.3f, 0.2f, 0.1f) * s, Vec3(1, 0.4f, 0.2f) * s, 2.0f);
    Traced t(m.finish());
    EXPECT_EQ(estimate(t, 32)[0].mean, DVec3(0.0)) << s;
  }
}

TEST(PathTracerCases, NeedlesOfAspectAMillion) {
  SceneMaker m;  // a floor of strips 20 m x 20 um, under the same lamp as a plain floor
  Mesh floor;
  const int n = 4000;
  for (int i = 0; i < n; ++i) {
    const Mesh q = quad(Vec3(-10, 0, -0.04f + 2e-5f * float(i)), Vec3(0, 0, 2e-5f), Vec3(20, 0, 0));
    const uint32_t base = uint32_t(floor.positions.size());
    floor.positions.insert(floor.positions.end(), q.positions.begin(), q.positions.end());
    for (uint32_t k : q.indices) floor.indices.push_back(base + k);
  }
  m.instance(m.mesh(floor, m.material(Vec3(0.6f))));
  LightShape sun;
  sun.kind = LightKind::Directional;
  sun.axis = glm::normalize(Vec3(0.3f, -1, 0.3f));
  m.light(sun, Vec3(2.0f));
  m.camera(Vec3(0, 3, 0), Vec3(0.0f), 0.005f);
  Traced t(m.finish());
  const double cosine = -double(sun.axis.y);
  const Measured e = estimate(t, 8);
  expectNear(e[0], DVec3(2.0 * double(0.6f) / M_PI * cosine), 1e-3);
  EXPECT_EQ(e.dropped, 0u);
}

TEST(PathTracerCases, CoincidentSurfacesRenderTheSameTwice) {
  SceneMaker m;
  m.instance(m.mesh(ground(3.0f), m.material(Vec3(0.2f))));
  m.instance(m.mesh(ground(3.0f), m.material(Vec3(0.9f))));
  m.environment(constantEnvironment(Vec3(1.0f)));
  m.camera(Vec3(0, 2, 3), Vec3(0.0f), 0.6f);
  const ScenePtr scene = m.finish();
  Traced a(scene), b(scene);
  const Measured x = estimate(a, 4), y = estimate(b, 4);
  EXPECT_EQ(x[0].mean, y[0].mean);
}

TEST(PathTracerCases, NonFiniteSamplesAreDroppedAndCounted) {
  SceneMaker m;
  m.instance(m.mesh(ground(50.0f), m.material(Vec3(0.5f))));
  LightShape point;
  point.position = Vec3(0, 1, 0);
  m.light(point);
  m.camera(Vec3(1, 2, 0), Vec3(1, 0, 0), 1e-4f);
  Traced t(m.finish());
  for (const float bad : {std::numeric_limits<float>::infinity(), 3e38f}) {
    t.settings.nominal[0] = Vec3(bad, 1, 1);
    t.settings.nominal.resize(1);
    const auto tracer = t.tracer();
    double out[3] = {0, 0, 0};
    uint64_t rays = 0, dropped = 0;
    tracer->traceBlock(0, 0, 0, out, rays, dropped);
    for (double v : out) EXPECT_TRUE(std::isfinite(v));
    if (std::isinf(bad)) {
      EXPECT_EQ(dropped, 16u);
      EXPECT_EQ(out[1], 0.0);  // the whole sample goes, not only its bad channel
    }
  }
}

TEST(PathTracerCases, BlockSizesThatAreNotSixteen) {
  SceneMaker m;
  m.instance(m.mesh(ground(5.0f), m.material(Vec3(0.5f))));
  m.environment(constantEnvironment(Vec3(1.0f)));
  m.camera(Vec3(0, 2, 3), Vec3(0.0f), 0.3f);
  for (const int size : {1, 5, 16, 40}) {
    Traced t(m.finish());
    t.settings.blockSize = size;
    const Measured e = estimate(t, 64);
    expectNear(e[0], DVec3(0.5), 1e-4);
  }
}

// The same room three ways: all in vector code; surfaces through the general look-up (white vertex colours, normals); the lamp
// through LightSampler (a white emission texture).
TEST(PathTracerCases, VectorAndScalarCodeAgree) {
  const auto room = [](bool general, bool textured, bool doubleSided) {
    SceneMaker m;
    auto white = std::make_shared<Texture>();
    white->name = "white";
    white->width = white->height = 1;
    white->texels8 = {255, 255, 255, 255};
    sealTexture(*white);
    m.scene.textures.push_back(white);
    const auto dress = [&](Mesh mesh) {
      if (general) mesh.colours.assign(mesh.positions.size(), Vec4(1.0f));
      return mesh;
    };
    m.instance(m.mesh(dress(box(Vec3(-1.0f), Vec3(1.0f), true)), m.material(Vec3(0.7f, 0.5f, 0.3f))));
    m.instance(m.mesh(dress(box(Vec3(-0.4f, -1, -0.5f), Vec3(0.2f, 0.1f, 0.3f))), m.material(Vec3(0.6f))));
    m.instance(m.mesh(quad(Vec3(-0.4f, 0.9f, -0.3f), Vec3(0.8f, 0, 0), Vec3(0, 0.05f, 0.6f)), m.material(Vec3(0.2f), [&](Material& x) {
      x.emission.radiance = Vec3(8, 6, 4);
      x.coverage.doubleSided = doubleSided;
      if (textured) x.emission.texture.texture = 0;
    })));
    m.camera(Vec3(0, 0, 0.95f), Vec3(0, -0.2f, -1), 1.2f);
    return m.finish();
  };
  for (const bool doubleSided : {true, false}) {
    Traced plain(room(false, false, doubleSided)), general(room(true, false, doubleSided)), sampled(room(false, true, doubleSided));
    for (Traced* t : {&plain, &general, &sampled}) t->settings.split = SplitMode::ByBounce;
    const Measured a = estimate(plain, 48), b = estimate(general, 48), c = estimate(sampled, 48);
    for (size_t k = 0; k < a.slots.size(); ++k) {
      for (int ch = 0; ch < 3; ++ch) EXPECT_NEAR(a[k].mean[ch], b[k].mean[ch], 2e-3 * a[k].mean[ch] + 1e-9) << k;  // same draws; a ray or two round an edge
      expectSame(a[k], c[k], 1e-4);
    }
    EXPECT_GT(a[1].mean.x, 0.01);
  }
}

// Vertex normals of any length and side, in vector code and by the general look-up (vertex colours that are white up to rounding).
TEST(PathTracerCases, VectorAndScalarCodeAgreeOnVertexNormals) {
  const auto room = [](bool general, int kind) {
    SceneMaker m;
    const auto dress = [&](Mesh mesh) {
      std::vector<Vec3> normals(mesh.positions.size());
      for (size_t i = 0; i < normals.size(); ++i) {
        const Vec3 out = glm::normalize(Vec3(mesh.positions[i]) - Vec3(0.1f, 0.2f, 0.3f));
        switch (kind) {
          case 0: normals[i] = out; break;
          case 1: normals[i] = -out; break;                            // turned over
          case 2: normals[i] = Vec3(0.0f); break;                      // none
          case 3: normals[i] = out * (i % 2 ? 1e-13f : 1e13f); break;  // beyond what is normalised
          case 4: normals[i] = glm::normalize(out + 3.0f * Vec3(std::sin(7.0f * float(i)), std::cos(5.0f * float(i)), 0.3f)); break;  // away from the viewer
          case 7: normals[i] = 1e-13f * out; break;
          case 5: normals[i] = i % 3 ? Vec3(0, 1, 0) : Vec3(0, -1, 0); break;  // zeros of either sign
          default: normals[i] = 3.0f * out; break;
        }
      }
      mesh.normals = normals;
      if (general) mesh.colours.assign(mesh.positions.size(), Vec4(1.0f));
      return mesh;
    };
    const int clay = m.material(Vec3(0.7f, 0.5f, 0.3f));
    m.instance(m.mesh(dress(sphere(Vec3(0.0f), 1.0f, 12, true)), clay));
    m.instance(m.mesh(dress(box(Vec3(-0.4f), Vec3(0.3f))), clay),
               glm::scale(Mat4(1.0f), Vec3(0.5f, 2.0f, 1.0f)) * glm::rotate(Mat4(1.0f), 0.5f, Vec3(0, 0, 1)));
    m.instance(m.mesh(ground(5.0f), clay));
    m.environment(constantEnvironment(Vec3(1.0f)));
    m.camera(Vec3(0, 2, 3), Vec3(0.0f), 0.8f);
    return m.finish();
  };
  for (int kind = 0; kind < 8; ++kind) {
    Traced plain(room(false, kind)), general(room(true, kind));
    const Measured a = estimate(plain, 48), b = estimate(general, 48);
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(a[0].mean[c], b[0].mean[c], 1e-8) << kind;
    EXPECT_GT(a[0].mean.x, 0.01) << kind;
    EXPECT_EQ(a.dropped, 0u) << kind;
  }
}

// Roulette must not be paid for dearly in noise: in a room whose walls keep 60 %, against the same paths carried to their end.
TEST(PathTracerCases, RouletteAddsLittleNoise) {
  SceneMaker m;
  m.instance(m.mesh(box(Vec3(-1.0f), Vec3(1.0f), true), m.material(Vec3(0.6f))));
  LightShape lamp;
  lamp.kind = LightKind::Disk;
  lamp.position = Vec3(0, 0.9f, 0);
  lamp.axis = Vec3(0, -1, 0);
  lamp.radius = 0.3f;
  m.light(lamp, Vec3(5.0f));
  m.camera(Vec3(0.2f, 0, 0.95f), Vec3(0, -0.3f, -1), 0.8f);
  Traced t(m.finish(), 12, 12);
  const Measured with = estimate(t, 32);
  t.settings.rouletteStart = 100;
  const Measured without = estimate(t, 32);
  expectSame(with[0], without[0]);
  const double noise = with[0].error.y / without[0].error.y, work = double(with.rays) / double(without.rays);
  std::printf("  roulette: noise by that of whole paths %.3f, rays %.3f\n", noise, work);
  EXPECT_LT(noise, 2.0);                 // 1.80; by the throughput itself 2.25
  EXPECT_LT(noise * noise * work, 1.6);  // variance by rays: 1.38; 1.91
}

TEST(PathTracerCases, SettingsHashSeesEveryField) {
  PathTracerSettings s;
  s.width = s.height = 4;
  s.groupOf = {0};
  s.nominal = {Vec3(1.0f)};
  const auto digest = [&](auto&& change) {
    PathTracerSettings c = s;
    change(c);
    Hasher h;
    c.hash(h);
    return h.digest();
  };
  std::vector<Hash128> all = {digest([](auto&) {}),
                              digest([](auto& c) { c.width = 5; }),
                              digest([](auto& c) { c.height = 5; }),
                              digest([](auto& c) { c.viewSamples = 2; }),
                              digest([](auto& c) { c.maxBounces = 2; }),
                              digest([](auto& c) { c.rouletteStart = 9; }),
                              digest([](auto& c) { c.blockSize = 8; }),
                              digest([](auto& c) { c.seed = 3; }),
                              digest([](auto& c) { c.unlit = true; }),
                              digest([](auto& c) { c.behindOnly = true; }),
                              digest([](auto& c) { c.cover = PathClass::Direct; }),
                              digest([](auto& c) { c.split = SplitMode::ByLobe; }),
                              digest([](auto& c) { c.selection = LightSelection::Power; }),
                              digest([](auto& c) { c.groups = 2; }),
                              digest([](auto& c) { c.groupOf = {1}; }),
                              digest([](auto& c) { c.nominal = {Vec3(2.0f)}; }),
                              digest([](auto& c) { c.camera.yfov = 0.5f; }),
                              digest([](auto& c) { c.camera.toWorld[3][0] = 1; }),
                              digest([](auto& c) { c.camera.perspective = false; }),
                              digest([](auto& c) { c.camera.centre.x = 1; }),
                              digest([](auto& c) { c.camera.yheight = 1; })};
  std::sort(all.begin(), all.end());
  EXPECT_EQ(std::adjacent_find(all.begin(), all.end()), all.end());
}

}  // namespace
}  // namespace gobo
