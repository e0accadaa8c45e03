// SPDX-License-Identifier: Apache-2.0
// Volumes, dispersion and unlit surfaces in the path tracer, against closed forms.
#include <cmath>
#include <vector>

#include "support/thorough.h"
#include "support/tiny_scenes.h"
#include "trace/camera_media.h"
#include "trace/interior.h"
#include "trace/path_kernel.h"

namespace gobo {
namespace {

using namespace tests;

/// Clear dielectric that fills its mesh.
std::function<void(Material&)> glass(float ior, const Vec3& colour = Vec3(1.0f), float distance = 0.0f, const std::function<void(Bsdf&)>& change = {}) {
  return [=](Material& x) {
    x.bsdf = {};
    x.bsdf.roughness = 0;
    x.bsdf.transmission = 1;
    x.bsdf.thickness = 1;
    x.bsdf.ior = ior;
    x.bsdf.attenuationColor = colour;
    x.bsdf.attenuationDistance = distance;
    if (change) change(x.bsdf);
  };
}
int lamp(SceneMaker& m, const Vec3& radiance = Vec3(1.0f)) {
  return m.material(Vec3(0.0f), [=](Material& x) { x.emission.radiance = radiance; });
}
DVec3 power(const Vec3& colour, double t) { return DVec3(std::pow(double(colour.x), t), std::pow(double(colour.y), t), std::pow(double(colour.z), t)); }
double fresnel(double cosI, double n1, double n2) {
  const double sinT = n1 / n2 * std::sqrt(1 - cosI * cosI), cosT = std::sqrt(1 - sinT * sinT);
  const double s = (n1 * cosI - n2 * cosT) / (n1 * cosI + n2 * cosT), p = (n1 * cosT - n2 * cosI) / (n1 * cosT + n2 * cosI);
  return 0.5 * (s * s + p * p);
}

TEST(PathMedia, AbsorbingGlassSlabIsTheSeriesOfItsReflections) {
  const Vec3 colour(0.8f, 0.5f, 0.1f);
  const double d = 0.7;  // in attenuation distances
  SceneMaker m;
  m.instance(m.mesh(box(Vec3(-50, 0, -50), Vec3(50, float(d), 50)), m.material(Vec3(1.0f), glass(1.5f, colour, 1.0f))));
  m.instance(m.mesh(quad(Vec3(-50, -1, 50), Vec3(100, 0, 0), Vec3(0, 0, -100)), lamp(m)));
  m.camera(Vec3(0, 5, 0), Vec3(0.0f), 1e-4f);
  Traced t(m.finish());
  t.settings.maxBounces = 40;
  t.settings.rouletteStart = 100;
  const double F = 0.04;
  const DVec3 tau = power(colour, d);
  const DVec3 truth = (1 - F) * (1 - F) * tau / (DVec3(1.0) - F * F * tau * tau);
  const Measured e = estimate(t, 64);
  expectNear(e[0], truth, 2e-4);
  EXPECT_EQ(e.dropped, 0u);
}

TEST(PathMedia, ClosedClearGlassOfAnyKindVanishesInAWhiteRoom) {
  for (const float dispersion : {0.0f, 2.0f})
    for (const float ior : {1.0f, 1.33f, 1.8f}) {
      SceneMaker m;
      m.instance(m.mesh(sphere(Vec3(0.0f), 1.0f, 32, true), m.material(Vec3(1.0f), glass(ior, Vec3(1.0f), 1.0f, [&](Bsdf& b) { b.dispersion = dispersion; }))));
      m.environment(constantEnvironment(Vec3(1.0f)));
      m.camera(Vec3(0, 0, 4), Vec3(0.0f), 0.3f);
      Traced t(m.finish());
      t.settings.maxBounces = 64;
      expectNear(estimate(t, 16)[0], DVec3(1.0), 3e-3);  // smooth normals of a mesh cut a little at grazing angles
    }
}

TEST(PathMedia, VolumesThatOverlapOrAreNested) {
  const Vec3 a(0.5f, 0.9f, 0.7f), b(0.9f, 0.4f, 0.6f);
  const auto through = [&](float aLow, float aHigh, float bLow, float bHigh) {
    SceneMaker m;  // index 1: boundaries are passed straight on, so nothing is random
    m.instance(m.mesh(box(Vec3(-5, aLow, -5), Vec3(5, aHigh, 5)), m.material(Vec3(1.0f), glass(1.0f, a, 1.0f))));
    m.instance(m.mesh(box(Vec3(-6, bLow, -6), Vec3(6, bHigh, 6)), m.material(Vec3(1.0f), glass(1.0f, b, 1.0f))));
    m.instance(m.mesh(quad(Vec3(-5, -9, 5), Vec3(10, 0, 0), Vec3(0, 0, -10)), lamp(m)));
    m.camera(Vec3(0, 9, 0), Vec3(0.0f), 1e-4f);
    Traced t(m.finish());
    t.settings.maxBounces = 12;
    t.settings.rouletteStart = 100;
    return estimate(t, 2)[0];
  };
  expectNear(through(1, 4, -4, -1), power(a, 3) * power(b, 3), 1e-5);  // apart
  expectNear(through(-3, 3, -1, 1), power(a, 4) * power(b, 2), 1e-5);  // B inside A
  expectNear(through(0, 3, -2, 1), power(a, 2) * power(b, 3), 1e-5);   // from above: A, then B inside it, which counts to its end
  expectNear(through(-3, 1, 0, 4), power(b, 3) * power(a, 4), 1e-5);   // A entered inside B: A counts to its end
}

TEST(PathMedia, LiquidInGlassHasNoBoundaryOfItsOwnWhereTheIndexIsTheSame) {
  SceneMaker m;  // 1.5 inside 1.5: one slab
  m.instance(m.mesh(box(Vec3(-50, -1, -50), Vec3(50, 1, 50)), m.material(Vec3(1.0f), glass(1.5f))));
  m.instance(m.mesh(box(Vec3(-40, -0.5f, -40), Vec3(40, 0.5f, 40)), m.material(Vec3(1.0f), glass(1.5f))));
  m.instance(m.mesh(quad(Vec3(-50, -3, 50), Vec3(100, 0, 0), Vec3(0, 0, -100)), lamp(m)));
  m.camera(Vec3(0, 5, 0), Vec3(0.0f), 1e-4f);
  Traced t(m.finish());
  t.settings.maxBounces = 60;
  t.settings.rouletteStart = 200;
  const double F = 0.04;
  expectNear(estimate(t, 64)[0], DVec3((1 - F) * (1 - F) / (1 - F * F)), 2e-4);
}

TEST(PathMedia, CameraAndLampInsideAMedium) {
  const Vec3 colour(0.7f, 0.5f, 0.3f);
  SceneMaker m;
  m.instance(m.mesh(box(Vec3(-9.0f), Vec3(9.0f)), m.material(Vec3(1.0f), glass(1.33f, colour, 2.0f))));
  m.instance(m.mesh(ground(5.0f), m.material(Vec3(0.5f))));
  LightShape point;
  point.position = Vec3(0, 4, 0);
  m.light(point, Vec3(10.0f));
  m.camera(Vec3(0, 3, 0), Vec3(0.0f), 1e-5f);
  const ScenePtr scene = m.finish();
  EXPECT_EQ(volumesAround(SceneView(*scene, kPathTracerFacets, {}), Vec3(0, 3, 0)), std::vector<int>{0});
  EXPECT_TRUE(volumesAround(SceneView(*scene, kPathTracerFacets, {}), Vec3(0, 10, 0)).empty());
  Traced t(scene);
  t.settings.cover = PathClass::Direct;
  expectNear(estimate(t, 4)[0], 0.5 / M_PI * 10.0 / 16.0 * power(colour, 7.0 / 2.0), 1e-4);  // 4 m from the lamp, 3 m to the camera
}

TEST(PathMedia, PrismSendsEachChannelItsOwnWay) {
  const double ior = 1.5, apex = M_PI / 6, dispersion = 1.0;
  for (int lit = 0; lit < 3; ++lit) {
    SceneMaker m;
    // Rays along +x enter a face across them and leave through one that is tilted by the apex angle, towards -y.
    Mesh prism;
    const float z = 5, far = 5;
    const auto corner = [&](float x, float y, float zz) { prism.positions.push_back(Vec3(x, y, zz)); };
    const float tilt = float(std::tan(apex));
    corner(-4, -far, -z);
    corner(-4, far, -z);
    corner(-far * tilt, far, -z);
    corner(far * tilt, -far, -z);
    corner(-4, -far, z);
    corner(-4, far, z);
    corner(-far * tilt, far, z);
    corner(far * tilt, -far, z);
    prism.indices = {0, 1, 2, 0, 2, 3, 4, 6, 5, 4, 7, 6, 0, 4, 5, 0, 5, 1, 3, 2, 6, 3, 6, 7, 1, 5, 6, 1, 6, 2, 0, 3, 7, 0, 7, 4};
    m.instance(m.mesh(prism, m.material(Vec3(1.0f), glass(float(ior), Vec3(1.0f), 0.0f, [&](Bsdf& b) { b.dispersion = float(dispersion); }))));
    // The exit normal is (cos a, sin a); a ray along x meets it at a and leaves at asin(n sin a) from it, on the other side.
    double index[3], angle[3];
    for (int c = 0; c < 3; ++c) {
      index[c] = ior + (c - 1) * 0.5 * (ior - 1) * dispersion / 20.0;  // n_F - n_C = (n_d - 1) / Abbe number
      angle[c] = apex - std::asin(index[c] * std::sin(apex));
    }
    const Vec3 along(float(std::cos(angle[lit])), float(std::sin(angle[lit])), 0), across(-along.y, along.x, 0), at = along * 200.0f;
    m.instance(m.mesh(quad(at - across * 0.4f - Vec3(0, 0, 50), Vec3(0, 0, 100), across * 0.8f), lamp(m)));
    m.camera(Vec3(-20, 0, 0), Vec3(0.0f), 1e-5f);
    Traced t(m.finish());
    t.settings.maxBounces = 2;  // no reflection inside
    t.settings.rouletteStart = 100;
    DVec3 truth(0.0);
    truth[lit] = (1 - fresnel(1.0, 1.0, index[lit])) * (1 - fresnel(std::cos(apex), index[lit], 1.0));
    const Measured e = estimate(t, 64);
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(e[0].mean[c], truth[c], 4.5 * e[0].error[c] + 1e-3) << "lamp " << lit << " channel " << c;
  }
}

TEST(Interior, AlbedoOfOneEventGivesTheAlbedoOfTheSlab) {
  for (const float g : {0.0f, 0.7f, -0.4f})
    for (float multiple = 0.05f; multiple < 1.0f; multiple += 0.05f) {
      const double a = singleScatteringAlbedo(multiple, g), s = std::sqrt((1 - a) / (1 - a * double(g)));
      EXPECT_NEAR((1 - s) * (1 - 0.139 * s) / (1 + 1.17 * s), multiple, 4e-3) << g;  // van de Hulst's formula itself
    }
  EXPECT_EQ(singleScatteringAlbedo(0.0f, 0.3f), 0.0f);
  Bsdf absorbing;
  absorbing.thickness = 1;
  absorbing.attenuationColor = Vec3(0.5f);
  absorbing.attenuationDistance = 1;
  EXPECT_FALSE(makeInterior(absorbing).scatters);
  EXPECT_EQ(singleScatteringAlbedo(1.0f, 0.3f), 1.0f);
  EXPECT_EQ(singleScatteringAlbedo(0.0f, 0.3f), 0.0f);
}

// Tinted glass absorbs by Beer's law, a factor, with no random walk: the fit's 6e-6 for black once made a noisy one of every such glass.
TEST(Interior, GlassThatOnlyAbsorbsIsNotScattering) {
  for (const float g : {-0.5f, 0.0f, 0.5f}) {
    Bsdf b;
    b.transmission = b.thickness = 1;
    b.attenuationColor = Vec3(0.8f, 0.5f, 0.1f);
    b.attenuationDistance = 1;
    b.scatterAnisotropy = g;
    EXPECT_TRUE(makeInterior(b).absorbs);
    EXPECT_FALSE(makeInterior(b).scatters);
    b.scatterAlbedo = Vec3(0.01f);
    EXPECT_TRUE(makeInterior(b).scatters);
  }
}

TEST(Interior, PhaseFunctionIsSampledByItsDensity) {
  for (const float g : {-0.8f, 0.0f, 0.5f, 0.95f}) {
    const int n = 20000, bins = 16;
    std::vector<double> count(bins, 0.0);
    double mean = 0;
    const Vec3 d = glm::normalize(Vec3(0.3f, -0.8f, 0.5f));
    for (int i = 0; i < n; ++i) {
      const Vec3 w = sampleHenyeyGreenstein(d, g, Vec2((float(i) + 0.5f) / float(n), float(i % 97) / 97.0f));
      EXPECT_NEAR(glm::dot(w, w), 1.0f, 1e-5);
      const double c = glm::dot(w, d);
      mean += c / n;
      count[size_t(std::min(bins - 1, int((c + 1) * 0.5 * bins)))] += 1;
    }
    EXPECT_NEAR(mean, g, 2e-3);
    for (int b = 0; b < bins; ++b) {
      double density = 0;
      for (int k = 0; k < 4000; ++k) density += 2 * M_PI * henyeyGreenstein(float(-1 + 2.0 * (b + (k + 0.5) / 4000) / bins), g) * 2.0 / bins / 4000;
      EXPECT_NEAR(count[size_t(b)] / n, density, 2e-3) << g << " bin " << b;
    }
  }
}

/// Chandrasekhar's H function for isotropic scattering at mu = 1, by iteration of 1/H = sqrt(1-a) + a/2 int mu' H / (mu + mu').
double chandrasekharH(double a) {
  const int n = 800;
  std::vector<double> h(size_t(n) + 1, 1.0);
  const auto mu = [&](int i) { return i == n ? 1.0 : (i + 0.5) / n; };
  for (int pass = 0; pass < 200; ++pass)
    for (int i = 0; i <= n; ++i) {
      double sum = 0;
      for (int k = 0; k < n; ++k) sum += mu(k) * h[size_t(k)] / (mu(i) + mu(k)) / n;
      h[size_t(i)] = 1.0 / (std::sqrt(1 - a) + 0.5 * a * sum);
    }
  return h[size_t(n)];
}

// White sky over a half space: what comes back along the normal is the share of light that a beam along the normal gets back
// (reciprocity), 1 - H(1) sqrt(1 - a). Three different channels at once, so the spectral weights count.
TEST(PathMedia, ScatteringHalfSpaceHasTheAlbedoOfTheHFunction) {
  SceneMaker m;
  const Vec3 multiple(0.8f, 0.5f, 0.3f);
  m.instance(m.mesh(box(Vec3(-60, -60, -60), Vec3(60, 0, 60)),
                    m.material(Vec3(1.0f), glass(1.0f, Vec3(0.4f, 0.1f, 0.01f), 1.0f, [&](Bsdf& b) { b.scatterAlbedo = multiple; }))));
  m.environment(constantEnvironment(Vec3(1.0f)));
  m.camera(Vec3(0, 5, 0), Vec3(0.0f), 1e-4f);
  Traced t(m.finish());
  t.settings.maxBounces = 4;
  const Measured e = estimate(t, testing::thoroughOr(32, 16));
  DVec3 truth;
  for (int c = 0; c < 3; ++c) {
    const double a = singleScatteringAlbedo(multiple[c], 0.0f);
    truth[c] = 1 - chandrasekharH(a) * std::sqrt(1 - a);
  }
  expectNear(e[0], truth, 1e-3);
  EXPECT_LT(e[0].error.x, testing::thoroughOr(0.01, 0.014));  // of half of the blocks: root 2 times as much
  EXPECT_EQ(e.dropped, 0u);
}

TEST(PathMedia, WhiteScatteringLosesNothing) {
  struct Kind {
    float ior, g, distance;
  };
  for (const Kind k : {Kind{1.0f, 0.0f, 0.3f}, Kind{1.0f, 0.8f, 0.1f}, Kind{1.4f, 0.0f, 0.3f}, Kind{1.4f, -0.5f, 1.0f}}) {
    SceneMaker m;
    m.instance(m.mesh(box(Vec3(-1.0f), Vec3(1.0f)), m.material(Vec3(1.0f), glass(k.ior, Vec3(0.5f, 0.3f, 0.1f), k.distance, [&](Bsdf& b) {
                                                                 b.scatterAlbedo = Vec3(1.0f);
                                                                 b.scatterAnisotropy = k.g;
                                                               }))));
    m.environment(constantEnvironment(Vec3(1.0f)));
    m.camera(Vec3(1, 1.5f, 4), Vec3(0.0f), 0.3f);
    Traced t(m.finish(), 4, 4);
    t.settings.maxBounces = 8;
    const Measured e = estimate(t, 32);
    expectNear(e[0], DVec3(1.0), 2e-3);
    EXPECT_LT(e[0].error.x, 0.02);
  }
}

// A thin haze lit by the sun: single scattering has a closed form, sigma_s p(angle) E int exp(-sigma (depth + way to the sun)).
TEST(PathMedia, HazeScattersPunctualLightTowardsTheCamera) {
  const double sigma = 0.02, height = 1.0;
  for (const bool inside : {false, true})
    for (const float g : {0.0f, 0.6f}) {
      SceneMaker m;
      m.instance(
          m.mesh(box(Vec3(-40, 0, -40), Vec3(40, float(height), 40)), m.material(Vec3(1.0f), glass(1.0f, Vec3(float(std::exp(-sigma))), 1.0f, [&](Bsdf& b) {
                                                                                   b.scatterAlbedo = Vec3(0.2f);
                                                                                   b.scatterAnisotropy = g;
                                                                                 }))));
      LightShape sun;
      sun.kind = LightKind::Directional;
      sun.axis = glm::normalize(Vec3(0.5f, -1, 0));
      m.light(sun, Vec3(3.0f));
      m.camera(Vec3(0, inside ? 0.999f : 5.0f, 0), Vec3(0, -1, 0), 1e-4f);
      Traced t(m.finish());
      t.settings.split = SplitMode::DirectIndirect;
      t.settings.maxBounces = 6;
      const Measured e = estimate(t, 96);
      const double cosine = -double(sun.axis.y), a = singleScatteringAlbedo(0.2f, g), c = -cosine;  // sun travels down at `axis`, towards the camera is up
      const double phase = (1 - double(g) * g) / (4 * M_PI * std::pow(1 + double(g) * g - 2 * double(g) * c, 1.5));
      const double k = sigma * (1 + 1 / cosine);
      const double single = 3.0 * a * sigma * phase * (1 - std::exp(-k * height)) / k;
      expectNear(e[0], DVec3(0.0));
      expectNear(e[1], DVec3(0.0));
      for (int ch = 0; ch < 3; ++ch) {  // twice scattered light adds to it: less than 8 a sigma
        EXPECT_GT(e[2].mean[ch], single - 4.5 * e[2].error[ch]);
        EXPECT_LT(e[2].mean[ch], single * (1 + 8 * a * sigma) + 4.5 * e[2].error[ch]);
        EXPECT_LT(e[2].error[ch], 0.04 * single);
      }
    }
}

/// Haze in a box of side 4 around the origin.
int haze(SceneMaker& m, float ior, float sigma, float g, const Vec3& albedo = Vec3(0.9f, 0.6f, 0.3f)) {
  return m.instance(
      m.mesh(box(Vec3(-2.0f), Vec3(2.0f)), m.material(Vec3(1.0f), glass(ior, glm::exp(Vec3(-sigma, -0.8f * sigma, -0.6f * sigma)), 1.0f, [=](Bsdf& b) {
                                                        b.scatterAlbedo = albedo;
                                                        b.scatterAnisotropy = g;
                                                      }))));
}
/// The same picture (one slot) with every light at scattering events found by rays alone.
Estimate hitOnly(const Traced& t, int blocks) {
  const auto tracer = t.tracer();
  for (char& c : tracer->impl().mediaLights) c = 0;
  const size_t pixels = size_t(t.settings.width) * size_t(t.settings.height);
  std::vector<DVec3> mean(pixels, DVec3(0.0)), square(pixels, DVec3(0.0));
  t.arena.parallelFor(pixels, 4, [&](size_t begin, size_t end) {
    for (size_t p = begin; p < end; ++p)
      for (int b = 0; b < blocks; ++b) {
        DVec3 out(0.0);
        uint64_t rays = 0, dropped = 0;
        tracer->traceBlock(int(p) % t.settings.width, int(p) / t.settings.width, uint32_t(b) * kBlocksPerStream, &out.x, rays, dropped);
        out /= double(t.settings.blockSize);
        mean[p] += out / double(blocks);
        square[p] += out * out / double(blocks);
      }
  });
  Estimate e;
  for (size_t p = 0; p < pixels; ++p) {
    e.mean += mean[p] / double(pixels);
    e.error += glm::max(square[p] - mean[p] * mean[p], DVec3(0.0)) / double(blocks - 1);
  }
  e.error = glm::sqrt(e.error) / double(pixels);
  return e;
}
/// A light of each kind that a ray can hit, inside the box or above it.
void addLight(SceneMaker& m, const std::string& kind, bool inside) {
  LightShape s;
  s.position = Vec3(0.4f, inside ? 0.9f : 3.0f, 0.2f);
  const float size = inside ? 0.4f : 1.0f;
  if (kind == "sphere") {
    s.kind = LightKind::Sphere;
    s.radius = size;
    m.light(s, Vec3(3, 4, 5));
  }
  if (kind == "disk") {
    s.kind = LightKind::Disk;
    s.axis = glm::normalize(Vec3(0.2f, -1, 0));
    s.radius = size;
    m.light(s, Vec3(3, 4, 5));
  }
  if (kind == "rect") {
    s.kind = LightKind::Rect;
    s.u = Vec3(size, 0, 0);
    s.v = Vec3(0, 0, size);
    s.axis = glm::normalize(glm::cross(s.u, s.v));
    s.twoSided = true;
    m.light(s, Vec3(3, 4, 5));
  }
  if (kind == "mesh") m.instance(m.mesh(quad(s.position, Vec3(size, 0, 0), Vec3(0, 0, size)), lamp(m, Vec3(3, 4, 5))));
  if (kind == "environment") {
    Image sky(8, 4, 3);
    for (size_t i = 0; i < sky.data.size(); ++i) sky.data[i] = float((i * 37) % 11) / 5 + (i == 12 ? 40.0f : 0.0f);
    m.environment(makeEnvironment("sky", sky), 0.5f);
  }
}

// What lights of every kind send into volumes does not depend on which strategy finds them, and less of it is noise when both do.
TEST(PathMedia, SampledLightsInVolumesAgreeWithWhatRaysHit) {
  const struct {
    const char* kind;
    bool inside;
    float ior, g;
  } cases[] = {{"sphere", true, 1.0f, 0.0f}, {"sphere", true, 1.4f, 0.6f}, {"disk", true, 1.0f, -0.5f},        {"rect", true, 1.4f, 0.0f},
               {"mesh", true, 1.0f, 0.8f},   {"mesh", true, 1.4f, 0.0f},   {"sphere", false, 1.0f, 0.6f},      {"rect", false, 1.0f, 0.0f},
               {"mesh", false, 1.0f, 0.3f},  {"disk", false, 1.0f, 0.0f},  {"environment", false, 1.0f, 0.0f}, {"environment", false, 1.0f, 0.7f},
               {"sphere", false, 1.4f, 0.0f}};
  for (const auto& c : cases) {
    SceneMaker m;
    haze(m, c.ior, 0.7f, c.g);
    m.instance(m.mesh(ground(1.0f, -1.0f), m.material(Vec3(0.5f))));  // inside, so that surfaces and events share the light
    addLight(m, c.kind, c.inside);
    m.camera(Vec3(0, 0.5f, 6), Vec3(0.0f), 0.5f);
    Traced t(m.finish(), 8, 8);
    t.settings.maxBounces = 6;
    const Measured sampled = estimate(t, 16);
    t.settings.seed = 99;
    const Estimate hit = hitOnly(t, 24);
    SCOPED_TRACE(std::string(c.kind) + (c.inside ? " inside" : " outside") + " index " + std::to_string(c.ior));
    EXPECT_GT(sampled[0].mean.x, 1e-3);
    expectSame(sampled[0], hit);
    EXPECT_EQ(sampled.dropped, 0u);
  }
}

// A small lamp in haze is nearly a point lamp: so is its noise.
TEST(PathMedia, ASmallLampInHazeIsAsQuietAsAPoint) {
  for (const float radius : {0.01f, 0.1f}) {
    DVec3 mean[2], error[2];
    for (const bool point : {true, false}) {
      SceneMaker m;
      haze(m, 1.0f, 0.5f, 0.3f);
      LightShape s;
      s.position = Vec3(0.5f, 1.0f, 0.5f);
      s.kind = point ? LightKind::Point : LightKind::Sphere;
      s.radius = radius;
      m.light(s, Vec3(point ? 1.0f : float(1.0 / (M_PI * radius * radius))));
      m.camera(Vec3(0, 0, 6), Vec3(0.0f), 0.3f);
      Traced t(m.finish(), 8, 8);
      t.settings.cover = PathClass::Indirect;
      t.settings.maxBounces = 4;
      const Measured e = estimate(t, 24);
      mean[point] = e[0].mean;
      error[point] = e[0].error;
      if (point) continue;
      const Estimate hit = hitOnly(t, 24);
      std::printf("  lamp of radius %.2f in haze: noise by the point's %.2f, where only rays find it %.1f\n", radius, error[0].y / error[1].y,
                  hit.error.y / error[1].y);
      EXPECT_LT(error[0].y, 1.5 * error[1].y) << radius;
    }
    EXPECT_NEAR(mean[0].y / mean[1].y, 1.0, 0.03 + 4.5 * (error[0].y + error[1].y) / mean[1].y);
  }
}

// A furnace with a scattering box of index 1 in it: every event weighs the environment against the phase function's own samples.
TEST(PathMedia, HazeInAWhiteRoomIsInvisible) {
  for (const float g : {-0.6f, 0.0f, 0.9f}) {
    SceneMaker m;
    haze(m, 1.0f, 2.0f, g, Vec3(1.0f));
    m.environment(constantEnvironment(Vec3(1.0f)));
    m.camera(Vec3(0, 1, 6), Vec3(0.0f), 0.5f);
    Traced t(m.finish(), 4, 4);
    const Measured e = estimate(t, 24);
    expectNear(e[0], DVec3(1.0), 1e-3);
    EXPECT_LT(e[0].error.x, 0.02);
  }
}

// Wax: light enters and leaves by diffuse transmission.
TEST(PathMedia, WhiteWaxLosesNothing) {
  SceneMaker m;
  m.instance(m.mesh(box(Vec3(-1.0f), Vec3(1.0f)), m.material(Vec3(1.0f), [](Material& x) {
    x.bsdf = {};
    x.bsdf.specular = 0;
    x.bsdf.diffuseTransmission = 1;
    x.bsdf.thickness = 1;
    x.bsdf.attenuationColor = Vec3(0.5f, 0.3f, 0.1f);
    x.bsdf.attenuationDistance = 0.3f;
    x.bsdf.scatterAlbedo = Vec3(1.0f);
  })));
  m.environment(constantEnvironment(Vec3(1.0f)));
  m.camera(Vec3(1, 1.5f, 4), Vec3(0.0f), 0.3f);
  Traced t(m.finish(), 4, 4);
  const Measured e = estimate(t, 16);
  expectNear(e[0], DVec3(1.0), 2e-3);
  EXPECT_LT(e[0].error.x, 0.02);
}

// A leaf between the sun and the camera: colour / pi times the irradiance of its back, and all of it direct light.
TEST(PathMedia, ThinLeafPassesLightFromBehind) {
  for (const bool behindOnly : {false, true}) {
    SceneMaker m;
    m.instance(m.mesh(ground(5.0f), m.material(Vec3(0.3f, 0.6f, 0.2f), [](Material& x) {
      x.bsdf = {};
      x.bsdf.specular = 0;
      x.bsdf.diffuseTransmission = 0.4f;
      x.bsdf.diffuseTransmissionColor = Vec3(0.8f, 0.9f, 0.1f);
    })));
    LightShape sun;
    sun.kind = LightKind::Directional;
    sun.axis = glm::normalize(Vec3(0.3f, 1, 0));  // from below
    m.light(sun, Vec3(2.0f));
    m.camera(Vec3(0, 3, 0), Vec3(0.0f), 1e-4f);
    Traced t(m.finish());
    t.settings.cover = PathClass::Direct;
    t.settings.behindOnly = behindOnly;
    expectNear(estimate(t, 4)[0], DVec3(0.8f, 0.9f, 0.1f) * (0.4 * 2.0 / M_PI * double(sun.axis.y)), 1e-4);
  }
}

TEST(PathMedia, SplitsAddUpInVolumes) {
  SceneMaker m;
  m.instance(m.mesh(box(Vec3(-1.0f), Vec3(1.0f)), m.material(Vec3(0.9f), glass(1.3f, Vec3(0.5f, 0.3f, 0.1f), 0.5f, [&](Bsdf& b) {
                                                               b.scatterAlbedo = Vec3(0.9f);
                                                               b.roughness = 0.4f;
                                                               b.dispersion = 1;
                                                             }))));
  m.instance(m.mesh(ground(4.0f, -1.5f), m.material(Vec3(0.5f))));
  m.environment(constantEnvironment(Vec3(0.5f)));
  LightShape ball;
  ball.kind = LightKind::Sphere;
  ball.position = Vec3(0, 3, 1);
  ball.radius = 0.3f;
  m.light(ball, Vec3(5.0f));
  for (const Vec3& eye : {Vec3(0, 2, 4), Vec3(0.2f, 0.1f, 0.3f)}) {  // from outside, and from inside the scattering box
    m.camera(eye, Vec3(0, 0, -0.2f), 0.6f);
    Traced t(m.finish());
    t.settings.groups = 2;
    t.settings.groupOf = {0, 1};
    DVec3 total[4];
    const SplitMode modes[] = {SplitMode::Combined, SplitMode::DirectIndirect, SplitMode::ByLobe, SplitMode::ByBounce};
    for (int k = 0; k < 4; ++k) {
      t.settings.split = modes[k];
      const Measured e = estimate(t, 4);
      total[k] = DVec3(0.0);
      for (const Estimate& s : e.slots) total[k] += s.mean;
      for (int c = 0; c < 3; ++c) EXPECT_NEAR(total[k][c], total[0][c], 1e-6 * total[0][c]) << k;
    }
    EXPECT_GT(total[0].x, 0.05);
    t.settings.split = SplitMode::Combined;
    for (Vec3& n : t.settings.nominal) n *= 2.0f;
    const Measured twice = estimate(t, 4);
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(twice[0].mean[c] + twice[1].mean[c], 2 * total[0][c], 1e-5 * total[0][c]);
  }
}

/// A camera in a box of index `ior` that scatters a little, over a floor in it with a lamp above.
void cameraInside(SceneMaker& m, float ior, LightKind kind, const Vec3& at) {
  m.instance(
      m.mesh(box(Vec3(-1.0f), Vec3(1.0f)), m.material(Vec3(0.9f), glass(ior, Vec3(0.8f, 0.7f, 0.6f), 2.0f, [&](Bsdf& b) { b.scatterAlbedo = Vec3(0.8f); }))));
  m.instance(m.mesh(ground(0.99f, -0.8f), m.material(Vec3(0.5f))));
  LightShape s;
  s.kind = kind;
  s.position = at;
  if (kind == LightKind::Sphere) s.radius = 0.1f;
  m.light(s, Vec3(3.0f));
}

// The boundary that such a camera sees first is an event when it reflects, too: light beyond is not direct.
TEST(PathMedia, TheBoundaryAroundACameraIsItsFirstEvent) {
  SceneMaker m;
  cameraInside(m, 1.33f, LightKind::Point, Vec3(0.5f, -0.4f, 0.2f));
  m.camera(Vec3(0.1f, -0.2f, 0.2f), Vec3(0.5f, 0.9f, 0.3f), 0.8f);  // upwards: the floor is in the mirror of the boundary
  Traced t(m.finish(), 4, 4);
  t.settings.maxBounces = 8;
  t.settings.split = SplitMode::DirectIndirect;
  const Measured all = estimate(t, 64);
  EXPECT_EQ(all[1].mean, DVec3(0.0));
  EXPECT_GT(all[2].mean.x, 1e-4);
  t.settings.split = SplitMode::Combined;
  DVec3 apart(0.0);
  for (const PathClass cover : {PathClass::Emission, PathClass::Direct, PathClass::Indirect}) {
    t.settings.cover = cover;
    apart += estimate(t, 64)[0].mean;
  }
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(apart[c], all[0].mean[c] + all[1].mean[c] + all[2].mean[c], 1e-5 * apart[c]);
}

// Paths that scatter before they meet a surface ask for lamps there, though it is the first surface and direct light is not wanted.
TEST(PathMedia, IndirectLightAloneIsWholeAroundACameraInHaze) {
  for (const LightKind kind : {LightKind::Point, LightKind::Sphere}) {
    SceneMaker m;
    cameraInside(m, 1.0f, kind, Vec3(0.3f, 0.4f, 0.1f));
    m.camera(Vec3(0.1f, 0.1f, 0.6f), Vec3(0, -0.8f, 0), 0.8f);
    Traced t(m.finish(), 4, 4);
    t.settings.maxBounces = 8;
    t.settings.split = SplitMode::DirectIndirect;
    const Measured all = estimate(t, 16);
    t.settings.split = SplitMode::Combined;
    t.settings.cover = PathClass::Indirect;
    const Measured alone = estimate(t, 16);
    EXPECT_GT(all[2].mean.x, 0.001);
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(alone[0].mean[c], all[2].mean[c], 1e-5 * all[2].mean[c]) << int(kind);
  }
}

TEST(MediumStack, ManyMaterialsHaveVolumes) {
  MediumStack stack;
  stack.clear();
  for (const int volume : {7, 40000, 70000}) stack.enter(volume);
  EXPECT_EQ(stack.top(), 70000);
  EXPECT_TRUE(stack.holds(40000));
  EXPECT_TRUE(stack.passes(70000, true));
  stack.leave(70000);
  EXPECT_EQ(stack.top(), 40000);
}

TEST(PathMedia, UnlitShowsToTheCameraAndInMirrorsButLightsNothing) {
  SceneMaker m;
  const Vec3 paint(0.9f, 0.3f, 0.1f);
  const int unlit = m.material(paint, [](Material& x) {
    x.bsdf.unlit = true;
    x.bsdf.specular = 1;
  });
  m.instance(m.mesh(ground(5.0f), m.material(Vec3(1.0f), [](Material& x) {
    x.bsdf = {};
    x.bsdf.metallic = 1;
    x.bsdf.roughness = 0;
  })));
  m.instance(m.mesh(quad(Vec3(-50, -50, -8), Vec3(100, 0, 0), Vec3(0, 100, 0)), unlit));
  m.instance(m.mesh(ground(1.0f, 0.5f), m.material(Vec3(0.8f))));
  const auto look = [&](const Vec3& to, bool show) {
    m.camera(Vec3(0, 3, 4), to, 1e-4f);
    Traced t(m.finish());
    t.settings.split = SplitMode::DirectIndirect;
    t.settings.unlit = show;
    return estimate(t, 4);
  };
  const DVec3 p(paint);
  const Measured straight = look(Vec3(0, 3, -8), true), mirrored = look(Vec3(0, 0, 2), true), lambert = look(Vec3(0, 0.5f, 0), true),
                 hidden = look(Vec3(0, 3, -8), false);
  expectNear(straight[0], p);
  expectNear(straight[1], DVec3(0.0));
  expectNear(straight[2], DVec3(0.0));
  expectNear(mirrored[0], DVec3(0.0));
  expectNear(mirrored[2], p);
  for (int k = 0; k < 3; ++k) {
    expectNear(lambert[k], DVec3(0.0));
    expectNear(hidden[k], DVec3(0.0));
  }
}

}  // namespace
}  // namespace gobo
