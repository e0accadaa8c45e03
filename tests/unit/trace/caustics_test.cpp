// SPDX-License-Identifier: Apache-2.0
// Caustics of punctual lights against closed forms (mirrored light, slab, pool, prism), against the path tracer with a small
// area light, and for energy, determinism and emptiness where there is no specular chain.
#include <gtest/gtest.h>

#include <cstring>

#include "base/sobol.h"
#include "support/tiny_scenes.h"
#include "trace/photon_emission.h"
#include "trace/photon_tracer.h"

namespace gobo::tests {
namespace {

LightShape pointLight(const Vec3& p) {
  LightShape s;
  s.kind = LightKind::Point;
  s.position = p;
  return s;
}
LightShape sunLight(const Vec3& axis) {
  LightShape s;
  s.kind = LightKind::Directional;
  s.axis = glm::normalize(axis);
  return s;
}
void mirror(Material& m) {
  m.bsdf.metallic = 1.0f;
  m.bsdf.roughness = 0.0f;
  m.bsdf.specular = 1.0f;
}
void glass(Material& m) {
  m.bsdf.transmission = 1.0f;
  m.bsdf.roughness = 0.0f;
  m.bsdf.specular = 1.0f;
  m.bsdf.ior = 1.5f;
  m.bsdf.thickness = 1.0f;
}

struct Caustics : Traced {
  static constexpr uint32_t kSamples = 4;  // a pixel and pass
  CausticSettings caustics;
  Caustics(ScenePtr s, uint32_t photons, float radius, int bounces = 8, int width = 4, int height = 4) : Traced(std::move(s), width, height) {
    settings.maxBounces = bounces;
    caustics.photons = photons;
    caustics.radius = radius;
  }
  std::shared_ptr<const CausticTracer> make() {
    caustics.path = settings;
    return CausticTracer::create(view(), accel, caustics);
  }
  std::shared_ptr<const PhotonMap> photons(uint32_t pass = 0) {
    uint64_t rays = 0;
    return make()->emitPass(pass, arena, rays);
  }
  /// Sum over passes by pixel and channel, divided by the samples.
  std::vector<double> picture(int passes, int threads = 2) {
    const TaskArena mine(threads);
    const auto tracer = make();
    const int w = settings.width, h = settings.height;
    std::vector<double> sum(size_t(w) * h * 3, 0.0);
    for (int pass = 0; pass < passes; ++pass) {
      uint64_t rays = 0;
      const auto map = tracer->emitPass(uint32_t(pass), mine, rays);
      mine.parallelFor(size_t(h), 1, [&](size_t begin, size_t end) {
        uint64_t count = 0, dropped = 0;
        for (size_t y = begin; y < end; ++y)
          for (int x = 0; x < w; ++x)
            tracer->traceSamples(x, int(y), {0, uint32_t(pass) * kSamples, kSamples}, *map, &sum[(y * w + size_t(x)) * 3], count, dropped);
        EXPECT_EQ(dropped, 0u);
      });
    }
    for (double& v : sum) v /= double(passes) * kSamples;
    return sum;
  }
  DVec3 mean(int passes) {
    DVec3 m(0.0);
    const auto p = picture(passes);
    for (size_t i = 0; i < p.size(); ++i) m[int(i % 3)] += p[i] * 3.0 / double(p.size());
    return m;
  }
};

void expectWithin(const DVec3& value, const DVec3& truth, double relative) {
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(value[c], truth[c], relative * truth[c]) << "channel " << c;
}

double fresnel(double cosine, double n) {  // unpolarised, from index 1 into n
  const double sine = std::sqrt(1 - cosine * cosine) / n, inner = std::sqrt(1 - sine * sine);
  const double s = (cosine - n * inner) / (cosine + n * inner), p = (n * cosine - inner) / (n * cosine + inner);
  return 0.5 * (s * s + p * p);
}

/// Light at height `above` over a layer of index n and thickness `layer` with `below` of air under it: where the ray that lands at
/// distance rho started, and the irradiance there for intensity 1, without Fresnel and absorption.
struct Layered {
  double theta = 0, inner = 0, spread = 0;
  Layered(double air, double layer, double n, double rho) {
    double lo = 0, hi = 1.5;
    const auto land = [&](double t) { return air * std::tan(t) + layer * std::tan(std::asin(std::sin(t) / n)); };
    for (int i = 0; i < 100; ++i) (land(0.5 * (lo + hi)) < rho ? lo : hi) = 0.5 * (lo + hi);
    theta = 0.5 * (lo + hi);
    inner = std::asin(std::sin(theta) / n);
    const double slope = air / std::pow(std::cos(theta), 2) + layer / std::pow(std::cos(inner), 2) * std::cos(theta) / (n * std::cos(inner));
    spread = std::sin(theta) / (rho * slope);
  }
};

TEST(Caustics, PlaneMirrorIsAMirroredLight) {
  SceneMaker m;
  const Vec3 tint(0.9f, 0.7f, 0.5f), albedo(0.6f, 0.5f, 0.4f), at(0.2f, 0.0f, 0.1f);
  m.instance(m.mesh(ground(3.0f), m.material(albedo)));
  m.instance(m.mesh(quad(Vec3(0.8f, 0.1f, 0.4f), Vec3(0, 0, -0.8f), Vec3(0, 0.8f, 0)), m.material(tint, mirror)));
  m.light(pointLight(Vec3(0, 1, 0)), Vec3(5.0f));
  m.camera(Vec3(0.2f, 2.0f, 0.1f), at, 0.01f);
  const DVec3 virtualLight(1.6, 1, 0), d = virtualLight - DVec3(at);
  const double d2 = glm::dot(d, d), c = d.x / std::sqrt(d2);
  const DVec3 f = DVec3(tint) + (1.0 - DVec3(tint)) * std::pow(1 - c, 5);
  const DVec3 truth = DVec3(albedo) / M_PI * f * (5.0 * d.y / std::sqrt(d2) / d2);
  expectWithin(Caustics(m.finish(), 40000, 0.08f, 2).mean(12), truth, 0.02);
}

TEST(Caustics, AbsorbingSlab) {
  SceneMaker m;
  const double n = 1.5, thick = 0.6, rho = 0.5;
  const Vec3 left(0.5f, 0.8f, 0.3f);
  m.instance(m.mesh(ground(3.0f), m.material(Vec3(0.5f))));
  m.instance(m.mesh(box(Vec3(-0.4f, 0.7f, -0.4f), Vec3(0.4f, 1.3f, 0.4f)), m.material(Vec3(1.0f), [&](Material& g) {
    glass(g);
    g.bsdf.attenuationColor = left;
    g.bsdf.attenuationDistance = float(thick);
  })));
  m.light(pointLight(Vec3(0, 2, 0)), Vec3(4.0f));
  m.camera(Vec3(0.5f, 0.3f, 0.02f), Vec3(0.5f, 0, 0), 0.05f);
  const Layered l(2.0 - thick, thick, n, rho);
  const double t = 1 - fresnel(std::cos(l.theta), n);
  DVec3 truth(0.5 / M_PI * 4.0 * l.spread * t * t);
  for (int c = 0; c < 3; ++c) truth[c] *= std::pow(double(left[c]), 1 / std::cos(l.inner));
  expectWithin(Caustics(m.finish(), 50000, 0.1f, 2).mean(12), truth, 0.02);  // 2 refractions and the floor: no inner reflections
}

// The receiver lies inside the refracting volume: flux and radiance weights differ by n^2 here, and the picture sees both.
TEST(Caustics, PoolFloorSeenFromAbove) {
  SceneMaker m;
  const double n = 1.33, depth = 1.0, rho = 0.4;
  m.instance(m.mesh(box(Vec3(-0.6f, -1.5f, -0.6f), Vec3(0.6f, 0, 0.6f)), m.material(Vec3(1.0f), [&](Material& g) {
    glass(g);
    g.bsdf.ior = float(n);
  })));
  m.instance(m.mesh(ground(0.55f, -1.0f), m.material(Vec3(0.5f))));
  m.light(pointLight(Vec3(0, 1, 0)), Vec3(4.0f));
  m.camera(Vec3(0.4f, 2.0f, 0), Vec3(0.4f, 0, 0), 0.01f);
  const Layered l(1.0, depth, n, rho);
  const double seen = (1 - fresnel(1.0, n)) / (n * n);
  expectWithin(Caustics(m.finish(), 50000, 0.1f, 2).mean(12), DVec3(0.5 / M_PI * 4.0 * l.spread * (1 - fresnel(std::cos(l.theta), n)) * seen), 0.02);
}

TEST(Caustics, PrismFollowsSnell) {
  for (const float dispersion : {0.0f, 2.0f}) {
    SceneMaker m;
    m.instance(m.mesh(ground(8.0f), m.material(Vec3(0.5f))));
    Mesh prism = box(Vec3(-0.3f, 1.0f, -0.3f), Vec3(0.3f, 1.3f, 0.3f));
    for (Vec3& p : prism.positions)
      if (p.y > 1.1f) p.y += 0.25f * p.x;  // upper face tilted by atan(1/4)
    m.instance(m.mesh(std::move(prism), m.material(Vec3(1.0f), [&](Material& g) {
      glass(g);
      g.bsdf.dispersion = dispersion;
    })));
    m.light(sunLight(Vec3(0, -1, 0)), Vec3(2.0f));
    m.camera(Vec3(0, 5, 0.1f), Vec3(0));
    const auto map = Caustics(m.finish(), 8192, 0.02f, 2).photons();
    ASSERT_GT(map->size(), 3000u);
    DVec3 total(0.0);
    for (const Photon& ph : map->photons()) {
      ASSERT_EQ(ph.events, 2);
      const int hero = ph.flux.x > 0 ? 0 : ph.flux.y > 0 ? 1 : 2;
      const double n = dispersion > 0 ? 1.5 + (hero - 1) * 0.5 * 0.025 * dispersion : 1.5;
      const double tilt = std::atan(0.25), in = tilt - std::asin(std::sin(tilt) / n), out = std::asin(n * std::sin(in));
      // The upper face's normal leans to -x: light is bent to +x, at both faces.
      EXPECT_NEAR(ph.toLight.x, -std::sin(out), 2e-5);
      EXPECT_NEAR(ph.toLight.y, std::cos(out), 2e-5);
      EXPECT_NEAR(ph.toLight.z, 0.0, 2e-5);
      const double below = ph.p.x - std::tan(out);  // left the lower face here, 1 m above
      EXPECT_GT(below, -0.3 + 0.225 * std::tan(in) - 1e-4);
      EXPECT_LT(below, 0.3 + 1e-4);
      total += DVec3(ph.flux);
      if (dispersion > 0) { EXPECT_EQ((ph.flux.x > 0) + (ph.flux.y > 0) + (ph.flux.z > 0), 1); }
    }
    const double tilt = std::atan(0.25), in = tilt - std::asin(std::sin(tilt) / 1.5);
    const double through = (1 - fresnel(std::cos(tilt), 1.5)) * (1 - fresnel(std::cos(std::asin(1.5 * std::sin(in))), 1.5));
    const double last = (0.3 - 0.3 * std::tan(in)) / (1 + 0.25 * std::tan(in));  // beyond, light meets the side and is reflected there
    expectWithin(total, DVec3(2.0 * 0.6 * (0.3 + last) * through), dispersion > 0 ? 0.06 : 0.01);
  }
}

// All light that meets the glass leaves it again and lands on the box around.
TEST(Caustics, FluxThroughGlassArrives) {
  for (const bool smooth : {false, true}) {
    for (const float flat : {1.0f, 0.35f}) {  // ball and lens
      SceneMaker m;
      m.instance(m.mesh(box(Vec3(-2), Vec3(2), true), m.material(Vec3(0.5f))));
      const int ball = m.instance(m.mesh(sphere(Vec3(0), 0.5f, 24, smooth), m.material(Vec3(1.0f), glass)), scaling(Vec3(1, flat, 1)));
      m.light(pointLight(Vec3(0.2f, 1.5f, 0)), Vec3(3.0f));
      m.camera(Vec3(0, 0.1f, 1.9f), Vec3(0));
      Caustics c(m.finish(), 60000, 0.02f, 40);
      DVec3 landed(0.0);
      const auto map = c.photons();
      for (const Photon& ph : map->photons()) landed += DVec3(ph.flux);
      double met = 0;  // solid angle of the glass, by directions of its own
      const int rays = 200000;
      for (int i = 0; i < rays; ++i) {
        SobolSampler u(3, uint32_t(i));
        const Vec2 v = u.next2D();
        const float z = 1 - 0.2f * v.x, r = std::sqrt(1 - z * z), phi = 2 * kPi * v.y;
        const Vec3 axis = glm::normalize(Vec3(-0.2f, -1.5f, 0));
        Ray ray;
        ray.origin = Vec3(0.2f, 1.5f, 0);
        ray.direction = Frame(axis).toWorld(Vec3(r * std::cos(phi), r * std::sin(phi), z));
        Hit hit;
        met += c.accel->intersect(ray, hit) && hit.instance == uint32_t(ball);
      }
      expectWithin(landed, DVec3(3.0 * 2 * M_PI * 0.2 * met / rays), smooth ? 0.03 : 0.01);
    }
  }
}

// A small sphere light that the path tracer sees through the glass casts the same energy as the point light.
TEST(Caustics, PathTracerAgreesWithASmallLight) {
  const auto scene = [](bool point) {
    SceneMaker m;
    m.instance(m.mesh(ground(2.0f), m.material(Vec3(0.05f))));  // dark: light that left the floor before is no caustic
    m.instance(m.mesh(sphere(Vec3(0, 0.42f, 0), 0.3f, 16, true), m.material(Vec3(1.0f), glass)));
    const float r = 0.15f;  // its size adds 5 % (r / distance to the glass)^2 / 0.06 of energy
    LightShape s = pointLight(Vec3(0, 2.0f, 0));
    if (!point) {
      s.kind = LightKind::Sphere;
      s.radius = r;
    }
    m.light(s, point ? Vec3(kPi * r * r) : Vec3(1.0f));
    Camera c;
    c.perspective = false;
    c.yheight = 0.5f;
    c.toWorld = Mat4(Vec4(1, 0, 0, 0), Vec4(0, 0, -1, 0), Vec4(0, 1, 0, 0), Vec4(0, 0.06f, 0, 1));  // between glass and floor, downwards
    m.scene.cameras.assign(1, c);
    return m.finish();
  };
  Caustics point(scene(true), 40000, 0.02f, 2, 16, 16);
  Traced area(scene(false), 16, 16);
  area.settings.maxBounces = 2;
  area.settings.rouletteStart = 64;
  area.settings.cover = PathClass::Indirect;
  const Measured truth = estimate(area, 160);
  const DVec3 got = point.mean(8);
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(got[c], truth[0].mean[c], 0.02 * truth[0].mean[c] + 3 * truth[0].error[c]) << "error " << truth[0].error[c];
  EXPECT_LT(truth[0].error.x, 0.015 * truth[0].mean.x);
}

// Interpolated normals are seen by camera paths and by photons alike: a mirror whose normals lean by 25 degrees throws 1.56 times the
// light that photons without the adjoint factor would bring.
TEST(Caustics, LeaningNormalsAreAdjoint) {
  const auto scene = [](bool point) {
    SceneMaker m;
    m.instance(m.mesh(ground(2.0f), m.material(Vec3(0.05f))));
    Mesh plate = quad(Vec3(-0.5f, 1.2f, -0.5f), Vec3(1, 0, 0), Vec3(0, 0, 1));
    plate.normals.assign(4, Vec3(std::sin(0.436f), -std::cos(0.436f), 0));
    m.instance(m.mesh(std::move(plate), m.material(Vec3(1.0f), mirror)));
    const float r = 0.1f;
    LightShape s = pointLight(Vec3(0.5f, 0.78f, 0));
    if (!point) {
      s.kind = LightKind::Sphere;
      s.radius = r;
    }
    m.light(s, point ? Vec3(kPi * r * r) : Vec3(1.0f));
    Camera c;
    c.perspective = false;
    c.yheight = 0.3f;
    c.toWorld = Mat4(Vec4(1, 0, 0, 0), Vec4(0, 0, -1, 0), Vec4(0, 1, 0, 0), Vec4(0, 0.06f, 0, 1));
    m.scene.cameras.assign(1, c);
    return m.finish();
  };
  Caustics point(scene(true), 20000, 0.03f, 1, 8, 8);
  Traced area(scene(false), 8, 8);
  area.settings.maxBounces = 1;
  area.settings.rouletteStart = 64;
  area.settings.cover = PathClass::Indirect;
  const Measured truth = estimate(area, 120);
  EXPECT_NEAR(point.mean(6).x, truth[0].mean.x, 0.03 * truth[0].mean.x + 3 * truth[0].error.x) << "error " << truth[0].error.x;
  EXPECT_LT(truth[0].error.x, 0.06 * truth[0].mean.x);
}

// Light that fell through the glass once and then bounced: the second floor sees the caustic of the first as indirect light.
TEST(Caustics, GatheringAtLaterVertices) {
  SceneMaker m;
  m.instance(m.mesh(ground(0.5f), m.material(Vec3(0.8f))));
  m.instance(m.mesh(quad(Vec3(1.0f, 0.2f, 0.2f), Vec3(0, 0, -0.4f), Vec3(0, 0.4f, 0)), m.material(Vec3(0.5f))));
  const float half = 0.4f * 0.8f / 1.8f;
  m.instance(m.mesh(quad(Vec3(-half, 1, -half), Vec3(2 * half, 0, 0), Vec3(0, 0, 2 * half)), m.material(Vec3(1.0f), mirror)));
  m.light(pointLight(Vec3(0, 0.2f, 0)), Vec3(6.0f));
  m.camera(Vec3(0.6f, 0.4f, 0), Vec3(1.0f, 0.4f, 0), 0.05f);
  // The lamp's image 0.8 m above the mirror lights the square |x|, |z| < 0.4 of the floor.
  double truth = 0;
  const int n = 200;
  const DVec3 at(1.0, 0.4, 0);
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) {
      const DVec3 q(-0.4 + 0.8 * (i + 0.5) / n, 0, -0.4 + 0.8 * (j + 0.5) / n), l = DVec3(0, 1.8, 0) - q, d = at - q;
      const double l2 = glm::dot(l, l), d2 = glm::dot(d, d), cosine = l.y / std::sqrt(l2);
      truth += 6.0 * cosine / l2 * 0.8 / M_PI * (d.y / std::sqrt(d2)) * (d.x / std::sqrt(d2)) / d2 * 0.64 / (n * n);
    }
  Caustics c(m.finish(), 20000, 0.02f, 3, 16, 16);
  expectWithin(c.mean(8), DVec3(truth * 0.5 / M_PI), 0.03);
  c.settings.maxBounces = 1;  // mirror, floor, wall: three events
  expectWithin(c.mean(2) + 1.0, DVec3(1.0), 1e-12);
}

TEST(Caustics, LightThatComesStraightOnIsNoCaustic) {
  // Two panes: their shadow rays see through both, so only light that is reflected between them lands as photons, (1-F)^2 F^2 of it.
  const auto landed = [](float ior) {
    SceneMaker m;
    m.instance(m.mesh(ground(50.0f), m.material(Vec3(0.5f))));
    const int pane = m.material(Vec3(1.0f), [ior](Material& g) {
      glass(g);
      g.bsdf.ior = ior;
      g.bsdf.thickness = 0;
    });
    for (float y : {1.0f, 2.0f}) m.instance(m.mesh(quad(Vec3(-0.5f, y, -0.5f), Vec3(1, 0, 0), Vec3(0, 0, 1)), pane));
    LightShape sun;
    sun.kind = LightKind::Directional;
    sun.axis = Vec3(0, -1, 0);
    m.light(sun, Vec3(1.0f));
    m.camera(Vec3(0, 0.5f, 0), Vec3(0.1f, 0, 0));
    Caustics c(m.finish(), 200000, 0.3f, 3);
    double flux = 0;
    const auto map = c.photons();
    map->around(Vec3(0.0f), [&](const Photon& p) { flux += p.flux.x; });
    return flux / (M_PI * map->radius() * map->radius());
  };
  EXPECT_EQ(landed(1.0f), 0.0);
  EXPECT_NEAR(landed(3.0f), 0.75 * 0.75 * 0.25 * 0.25, 0.003);  // index 3: F = 1/4
}

TEST(Caustics, NothingWithoutASpecularChain) {
  SceneMaker m;
  m.instance(m.mesh(ground(2.0f), m.material(Vec3(0.5f))));
  m.instance(m.mesh(box(Vec3(-0.3f, 0.2f, -0.3f), Vec3(0.3f, 0.5f, 0.3f)), m.material(Vec3(0.8f), [](Material& g) {
    mirror(g);
    g.bsdf.roughness = 0.2f;
  })));
  m.light(pointLight(Vec3(0, 1, 0)));
  m.camera(Vec3(0, 1, 3), Vec3(0), 0.8f);
  Caustics none(m.finish(), 5000, 0.05f);
  EXPECT_EQ(none.photons()->size(), 0u);
  for (double v : none.picture(1)) EXPECT_EQ(v, 0.0);
  // Specular surfaces, but only a light that the path tracer can reach.
  m.instance(m.mesh(sphere(Vec3(0, 0.5f, 1), 0.3f, 8, true), m.material(Vec3(1.0f), glass)));
  LightShape area;
  area.kind = LightKind::Sphere;
  area.position = Vec3(1, 1, 0);
  m.scene.lights.clear();
  m.light(area);
  Caustics rough(m.finish(), 5000, 0.05f);
  for (double v : rough.picture(1)) EXPECT_EQ(v, 0.0);
}

TEST(Caustics, SameBitsForAnyThreads) {
  SceneMaker m;
  m.instance(m.mesh(ground(2.0f), m.material(Vec3(0.5f))));
  m.instance(m.mesh(sphere(Vec3(0, 0.5f, 0), 0.3f, 12, true), m.material(Vec3(1.0f), glass)));
  m.instance(m.mesh(box(Vec3(0.5f, 0, -0.3f), Vec3(0.8f, 0.5f, 0.3f)), m.material(Vec3(0.8f), mirror)));
  m.light(pointLight(Vec3(0, 1.5f, 0)));
  m.light(sunLight(Vec3(0.3f, -1, 0)));
  m.camera(Vec3(0, 1, 3), Vec3(0), 0.8f);
  Caustics c(m.finish(), 20000, 0.05f, 5, 12, 8);
  const auto one = c.picture(2, 1), two = c.picture(2, 2), seven = c.picture(2, 7);
  EXPECT_GT(*std::max_element(one.begin(), one.end()), 0.0);
  EXPECT_EQ(std::memcmp(one.data(), two.data(), one.size() * sizeof(double)), 0);
  EXPECT_EQ(std::memcmp(one.data(), seven.data(), one.size() * sizeof(double)), 0);
}

TEST(Caustics, RadiusFollowsKnausAndZwicker) {
  EXPECT_FLOAT_EQ(causticRadius(0.5f, 0), 0.5f);
  EXPECT_NEAR(causticRadius(0.5f, 1), 0.5 * std::sqrt((1 + 2.0 / 3) / 2), 1e-7);
  EXPECT_NEAR(causticRadius(1.0f, 999) / causticRadius(1.0f, 124), std::pow(8.0, -1.0 / 6), 1e-3);  // r^2 ~ pass^(alpha - 1)
}

TEST(PhotonMap, FindsWhatASearchFinds) {
  std::vector<Photon> all(3000);
  for (size_t i = 0; i < all.size(); ++i) {
    SobolSampler u(5, uint32_t(i));
    const Vec2 a = u.next2D();
    all[i].p = Vec3(a.x * 2 - 1, a.y * 3, u.next1D() * 0.5f - 4);
    all[i].toLight = Vec3(0, 1, 0);
    all[i].flux = Vec3(1.0f);
    all[i].slot = int(i);
  }
  all[7].flux.x = NAN;
  const PhotonMap map(all, 0.11f);
  EXPECT_EQ(map.size(), all.size() - 1);
  for (int q = 0; q < 200; ++q) {
    SobolSampler u(6, uint32_t(q));
    const Vec2 a = u.next2D();
    const Vec3 p(a.x * 2.4f - 1.2f, a.y * 3.4f - 0.2f, u.next1D() * 0.7f - 4.1f);
    std::vector<int> found, truth;
    map.around(p, [&](const Photon& ph) { found.push_back(ph.slot); });
    for (const Photon& ph : all)
      if (isFinite(ph.flux) && glm::dot(ph.p - p, ph.p - p) <= 0.11f * 0.11f) truth.push_back(ph.slot);
    std::sort(found.begin(), found.end());
    EXPECT_EQ(found, truth);
  }
  int none = 0;
  PhotonMap().around(Vec3(0), [&](const Photon&) { ++none; });
  EXPECT_EQ(none, 0);
}

// The mixture of cones and discs is a density: the mean of 1 / density over what it covers is the covered measure.
TEST(PhotonEmission, OverlappingTargets) {
  const std::vector<Sphere> targets{{Vec3(0, 0, 0), 0.5f}, {Vec3(0.3f, 0, 0), 0.5f}, {Vec3(3, 0, 0), 0.01f}};
  const Sphere scene{Vec3(0), 4.0f};
  for (const LightShape& light : {pointLight(Vec3(0, 2, 0)), sunLight(Vec3(0, -1, 0))}) {
    const PhotonEmitter e(light, targets, scene);
    double sum = 0;
    const int n = 1 << 16;
    for (int i = 0; i < n; ++i) {
      SobolSampler u(9, uint32_t(i));
      const float t = u.next1D();
      PhotonStart s;
      ASSERT_TRUE(e.emit(t, u.next2D(), s));
      EXPECT_NEAR(glm::length(s.direction), 1.0, 1e-5);
      if (light.kind == LightKind::Directional) { EXPECT_GT(glm::length(s.origin), 4.0f); }
      sum += double(s.power) / n;
    }
    double truth = 0;
    const int cells = 2000;  // quadrature of the union
    for (int i = 0; i < cells; ++i)
      for (int j = 0; j < cells; ++j) {
        const double x = -2 + 6.0 * (i + 0.5) / cells, z = -1.5 + 3.0 * (j + 0.5) / cells;
        bool inside = false;
        const bool sun = light.kind == LightKind::Directional;
        const DVec3 d = sun ? DVec3(0, -1, 0) : glm::normalize(DVec3(x, -2, z));
        const DVec3 o = sun ? DVec3(x, 2, z) : DVec3(0, 2, 0);
        for (const Sphere& s : targets) {
          const DVec3 to = DVec3(s.centre) - o, across = to - d * glm::dot(to, d);
          inside = inside || glm::dot(across, across) <= double(s.radius) * s.radius;
        }
        if (inside) truth += (sun ? 1.0 : std::pow(-d.y, 3) / 4.0) * 18.0 / (double(cells) * cells);
      }
    EXPECT_NEAR(sum, truth, 0.004 * truth);
  }
}

TEST(PhotonEmission, NarrowSpotIsSampledByItsCone) {
  LightShape s;
  s.kind = LightKind::Spot;
  s.position = Vec3(0, 2, 0);
  s.axis = Vec3(0, -1, 0);
  s.cosInner = 0.999f;
  s.cosOuter = 0.99f;
  const PhotonEmitter e(s, {{Vec3(0), 1.0f}}, {Vec3(0), 3.0f});
  double sum = 0;
  int used = 0;
  const int n = 1 << 14;
  for (int i = 0; i < n; ++i) {
    SobolSampler u(9, uint32_t(i));
    PhotonStart start;
    if (!e.emit(u.next1D(), u.next2D(), start)) continue;
    ++used;
    sum += double(start.power) / n;
  }
  EXPECT_GT(used, n * 95 / 100);
  // 2 pi times the integral of the squared ramp over the cosine.
  EXPECT_NEAR(sum, 2 * M_PI * (0.001 + 0.009 / 3), 1e-4);
  EXPECT_EQ(e.window(100.0f), 1.0f);
  s.range = 2.0f;
  const PhotonEmitter ranged(s, {{Vec3(0), 1.0f}}, {Vec3(0), 3.0f});
  EXPECT_FLOAT_EQ(ranged.window(1.0f), 1.0f - 1.0f / 16);
  EXPECT_EQ(ranged.window(2.5f), 0.0f);
}

}  // namespace
}  // namespace gobo::tests
