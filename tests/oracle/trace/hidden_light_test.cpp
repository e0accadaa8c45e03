// SPDX-License-Identifier: Apache-2.0
// Lights with cameraVisible = false: hidden from camera rays and what goes on from them straight; seen by everything else. And
// a certificate that says so: its reference has their light wherever the picture should have it.
#include <gtest/gtest.h>

#include "plan/certify_picture.h"
#include "support/tiny_scenes.h"

namespace gobo {
namespace {

using namespace tests;

std::function<void(Material&)> clear(float ior, float thickness, float sigma = 0.0f, float scatter = 0.0f) {
  return [=](Material& x) {
    x.bsdf = {};
    x.bsdf.transmission = 1;
    x.bsdf.ior = ior;
    x.bsdf.roughness = 0;
    x.bsdf.thickness = thickness;
    x.bsdf.attenuationColor = Vec3(std::exp(-sigma));
    x.bsdf.attenuationDistance = sigma > 0.0f ? 1.0f : 0.0f;
    x.bsdf.scatterAlbedo = Vec3(scatter);
  };
}
LightShape lamp(LightKind kind, const Vec3& at, const Vec3& axis, float size) {
  LightShape s;
  s.kind = kind;
  s.position = at;
  s.axis = axis;
  const Frame f(axis);
  s.u = f.x * size;
  s.v = f.y * size;
  s.radius = size;
  return s;
}

/// Mean radiance of a camera at the origin that looks along -z at a lamp at z = -4, past `add`.
double seen(LightKind kind, bool visible, const std::function<void(SceneMaker&)>& add, bool many = false, int bounces = 8) {
  SceneMaker m;
  add(m);
  m.light(lamp(kind, Vec3(0, 0, -4), Vec3(0, 0, 1), 1.0f), Vec3(1.0f), visible);
  if (many)
    for (int k = 0; k < 12; ++k)
      m.light(lamp(kind, Vec3(float(3 * k), 50, 0), Vec3(0, 0, -1), 0.5f), Vec3(1.0f), visible);  // as many as the boxes are asked for
  m.camera(Vec3(0.0f), Vec3(0, 0, -4), 0.2f);
  Traced t(m.finish());
  t.settings.maxBounces = bounces;
  return estimate(t, 8)[0].mean.x;
}

constexpr LightKind kArea[] = {LightKind::Rect, LightKind::Disk, LightKind::Sphere};

TEST(HiddenLight, StraightWaysHideItAndBentOnesShowIt) {
  const auto nothing = [](SceneMaker&) {};
  const auto pane = [](SceneMaker& m) { m.instance(m.mesh(quad(Vec3(-2, -2, -2), Vec3(4, 0, 0), Vec3(0, 4, 0)), m.material(Vec3(0.8f), clear(1.5f, 0)))); };
  const auto air = [](SceneMaker& m) { m.instance(m.mesh(box(Vec3(-2, -2, -2), Vec3(2, 2, -1)), m.material(Vec3(1.0f), clear(1.0f, 1, 0.7f)))); };
  const auto glass = [](SceneMaker& m) { m.instance(m.mesh(box(Vec3(-2, -2, -2), Vec3(2, 2, -1)), m.material(Vec3(1.0f), clear(1.5f, 1)))); };
  for (const LightKind kind : kArea)
    for (const bool many : {false, true}) {
      SCOPED_TRACE(int(kind) * 10 + many);
      EXPECT_NEAR(seen(kind, true, nothing, many), 1.0, 1e-5);
      EXPECT_EQ(seen(kind, false, nothing, many), 0.0);
      EXPECT_NEAR(seen(kind, true, pane, many), 0.8 * 0.92, 0.05);  // two faces of 4 % each, or what the thin model makes of them
      EXPECT_EQ(seen(kind, false, pane, many), 0.0);
      EXPECT_NEAR(seen(kind, true, air, many), std::exp(-0.7), 0.01);
      EXPECT_EQ(seen(kind, false, air, many), 0.0);
      EXPECT_NEAR(seen(kind, true, glass, many), 0.96 * 0.96 / (1 - 0.04 * 0.04), 0.02);
      EXPECT_EQ(seen(kind, false, glass, many), seen(kind, true, glass, many)) << "refraction is an event like any other";
    }
}

// A camera that looks away from the lamp, into a mirror.
TEST(HiddenLight, MirrorsShowIt) {
  for (const LightKind kind : kArea)
    for (const bool visible : {false, true}) {
      SceneMaker m;
      m.instance(m.mesh(quad(Vec3(-3, -3, -2), Vec3(6, 0, 0), Vec3(0, 6, 0)), m.material(Vec3(0.5f), [](Material& x) {
        x.bsdf.metallic = 1;
        x.bsdf.roughness = 0;
        x.bsdf.specular = 1;
      })));
      m.light(lamp(kind, Vec3(0, 0, 3), Vec3(0, 0, -1), 1.0f), Vec3(1.0f), visible);
      m.camera(Vec3(0.0f), Vec3(0, 0, -4), 0.1f);
      Traced t(m.finish());
      EXPECT_NEAR(estimate(t, 4)[0].mean.x, 0.5, 0.01) << int(kind);
    }
}

// Through a scattering slab a visible lamp shows itself, weaker by the slab, and its scattered light; a hidden one the latter alone.
TEST(HiddenLight, FogShowsItsScatteredLight) {
  const double sigma = 1.2;
  const auto fog = [&](SceneMaker& m) {
    m.instance(m.mesh(box(Vec3(-2, -2, -2), Vec3(2, 2, -1)), m.material(Vec3(1.0f), clear(1.0f, 1, float(sigma), 0.8f))));
  };
  for (const LightKind kind : kArea) {
    const double hidden = seen(kind, false, fog), visible = seen(kind, true, fog);
    EXPECT_GT(hidden, 0.02);
    EXPECT_NEAR(visible - hidden, std::exp(-sigma), 0.02) << int(kind);
  }
}

/// What a certificate says of a black picture: the size of the true one.
double certifiedOfBlack(const ScenePtr& scene, std::vector<std::string>& missing) {
  EffectiveScene e;
  e.scene = scene;
  e.gains.assign(scene->lights.size(), Vec3(1.0f));
  for (const Light& l : scene->lights) e.gains[size_t(&l - scene->lights.data())] = l.power / nominalScalar(l);
  e.gainChanges.assign(scene->lights.size(), Vec3(0.0f));
  e.camera = scene->cameras[0];
  v1::RenderRequest request;
  request.mutable_integrator()->set_max_bounces(8);
  request.mutable_integrator()->set_russian_roulette_start(3);
  request.mutable_certificate()->set_spp(128);
  request.mutable_certificate()->set_pixel_fraction(1.0);
  AccelCache accels;
  const TaskArena arena(2);
  const auto certificate = certifyPicture(Image(16, 16, 3), e, request, accels, arena, {});
  EXPECT_TRUE(certificate.ok()) << certificate.status().toString();
  missing.assign(certificate->not_covered().begin(), certificate->not_covered().end());
  return certificate->rmse();
}
double rootMeanSquare(const ScenePtr& scene) {
  Traced t(scene, 16, 16);
  double sum = 0;
  const auto tracer = t.tracer();
  for (int y = 0; y < 16; ++y)
    for (int x = 0; x < 16; ++x) {
      double out[3] = {};
      uint64_t rays = 0, dropped = 0;
      for (uint32_t b = 0; b < 8; ++b) tracer->traceBlock(x, y, b, out, rays, dropped);
      for (double v : out) sum += v / (8.0 * t.settings.blockSize) * v / (8.0 * t.settings.blockSize);
    }
  return std::sqrt(sum / (3 * 256));
}

// Two scenes of which a certificate once said 0.0000 and nothing missing while their pictures were black.
TEST(HiddenLight, CertificatesKnowWhatItLights) {
  for (const bool pane : {false, true}) {
    SCOPED_TRACE(pane ? "a rectangle above a clear pane" : "a lamp behind a scattering sphere");
    ScenePtr scenes[2];
    for (const bool visible : {false, true}) {
      SceneMaker m;
      if (pane) {
        m.instance(m.mesh(ground(2.0f), m.material(Vec3(0.7f))));
        m.instance(m.mesh(quad(Vec3(-4, 1, 4), Vec3(8, 0, 0), Vec3(0, 0, -8)), m.material(Vec3(1.0f), clear(1.5f, 0))));
        m.light(lamp(LightKind::Rect, Vec3(0, 2, 0), Vec3(0, -1, 0), 1.0f), Vec3(3.0f), visible);
        m.camera(Vec3(0, 0.8f, 0.5f), Vec3(0.0f), 1.0f);
      } else {
        m.instance(m.mesh(sphere(Vec3(0.0f), 1.0f, 12, false), m.material(Vec3(1.0f), clear(1.3f, 1, 2.0f, 0.9f))));
        m.light(lamp(LightKind::Sphere, Vec3(0, 3, 3), Vec3(0, -1, 0), 1.0f), Vec3(3.0f), visible);
        m.camera(Vec3(0, 0, 4), Vec3(0.0f), 0.4f);  // the lamp is out of the picture
      }
      scenes[visible] = m.finish();
    }
    std::vector<std::string> missing;
    const double certified = certifiedOfBlack(scenes[0], missing), truth = rootMeanSquare(scenes[1]);
    EXPECT_GT(truth, 0.01);
    EXPECT_NEAR(certified, truth, 0.15 * truth);
    EXPECT_TRUE(missing.empty()) << missing[0];
  }
}

}  // namespace
}  // namespace gobo
