// SPDX-License-Identifier: Apache-2.0
// Clear panes, tinted glass and slabs of index 1 over a floor with a solid on it: every visibility technique under every kind of light
// gives the solid's shadow times what the closed form says of the glass.
#include <gtest/gtest.h>

#include <cmath>

#include "support/shadow_stage.h"
#include "support/tiny_scenes.h"

namespace gobo::test {
namespace {

using tests::box;
using tests::ground;
using tests::SceneMaker;

const Vec3 kTint(0.9f, 0.6f, 0.3f), kLamp(-0.9f, 2.8f, -0.6f);

struct PaneKind {
  const char* name;
  int count;
  float ior;
  Vec3 colour;
  bool volume;
};
const std::vector<PaneKind> kPanes = {{"clear", 2, 1.0f, Vec3(1.0f), false},
                                      {"tinted", 1, 1.0f, kTint, false},
                                      {"glass", 1, 1.5f, kTint, false},
                                      {"three", 3, 1.5f, kTint, false},
                                      {"slab", 1, 1.0f, kTint, true}};
constexpr double kSlab = 0.2;  // thickness, in attenuation distances

double fresnel(double cosine, double ior) {
  const double sinT = std::sqrt(1 - cosine * cosine) / ior, cosT = std::sqrt(1 - sinT * sinT);
  const double s = (cosine - ior * cosT) / (cosine + ior * cosT), p = (cosT - ior * cosine) / (cosT + ior * cosine);
  return 0.5 * (s * s + p * p);
}
DVec3 left(const PaneKind& pane, double cosine) {
  DVec3 t(1.0);
  for (int c = 0; c < 3; ++c)
    t[c] = pane.volume ? std::pow(double(pane.colour[c]), kSlab / cosine)
                       : std::pow((pane.ior == 1.0f ? 1.0 : 1.0 - fresnel(cosine, pane.ior)) * pane.colour[c], pane.count);
  return t;
}

/// Light kinds that techniques know; the mesh light comes from a material.
ScenePtr stage(LightKind kind, const PaneKind* pane, float angularSize = 0.0f, float half = 0.02f) {
  SceneMaker m;
  m.instance(m.mesh(ground(2.0f), m.material(Vec3(0.6f))));
  m.instance(m.mesh(box(Vec3(-0.5f, 0, -0.5f), Vec3(0.3f, 0.5f, 0.1f)), m.material(Vec3(0.6f))));
  m.instance(m.mesh(box(Vec3(1.9f, 0, 1.9f), Vec3(2, 3, 2)), m.material(Vec3(0.6f))));  // holds the scene's bounds, and a map's frame, in place
  if (pane) {
    const int glass = m.material(pane->volume ? Vec3(1.0f) : pane->colour, [&](Material& x) {
      x.bsdf = {};
      x.bsdf.roughness = 0;
      x.bsdf.transmission = 1;
      x.bsdf.ior = pane->ior;
      if (pane->volume) {
        x.bsdf.thickness = 1;
        x.bsdf.attenuationColor = pane->colour;
        x.bsdf.attenuationDistance = 1;
      }
    });
    for (int i = 0; i < pane->count; ++i)
      m.instance(m.mesh(pane->volume ? box(Vec3(-1.8f, 1.5f, -1.8f), Vec3(1.8f, 1.5f + float(kSlab), 1.8f)) : ground(1.8f, 1.5f + 0.3f * float(i)), glass));
  }
  if (kind == LightKind::Mesh) {
    m.instance(m.mesh(tests::quad(kLamp - Vec3(0.02f, 0, 0.02f), Vec3(0.04f, 0, 0), Vec3(0, 0, 0.04f)),
                      m.material(Vec3(0.0f), [](Material& x) { x.emission.radiance = Vec3(500.0f); })));
  } else {
    LightShape s;
    s.kind = kind;
    s.position = kLamp;
    s.axis = kind == LightKind::Directional ? glm::normalize(Vec3(0.6f, -1, 0.4f)) : Vec3(0, -1, 0);
    s.angularSize = angularSize;
    s.radius = half;
    s.u = Vec3(half, 0, 0);
    s.v = Vec3(0, 0, half);
    s.cosInner = 0.6f;
    s.cosOuter = 0.5f;
    m.light(s, Vec3(1.0f));
  }
  m.camera(Vec3(0.4f, 1.3f, 1.4f), Vec3(0, 0, 0), 0.9f);
  return m.finish();
}

void expectTinted(LightKind kind, const v1::ShadowTechnique& technique, double tolerance, float angularSize = 0.0f) {
  const ShadowPicture picture{20, 16, 1};
  const ScenePtr bareScene = stage(kind, nullptr, angularSize);
  const ShadowRun bare = runShadow(bareScene, technique, picture);
  ASSERT_TRUE(bare.ok()) << bare.status.toString();
  ASSERT_EQ(bare.terms[size_t(bare.visibility)]->channels("V"), 1) << "one channel where no glass is";
  const LightShape& shape = bareScene->lights.at(0).shape;
  for (const PaneKind& pane : kPanes) {
    SCOPED_TRACE(pane.name);
    const ShadowRun with = runShadow(stage(kind, &pane, angularSize), technique, picture);
    ASSERT_TRUE(with.ok()) << with.status.toString();
    ASSERT_EQ(with.terms[size_t(with.visibility)]->channels("V"), 3);
    size_t lit = 0, shadowed = 0;
    for (size_t i = 0; i < bare.size(); ++i) {
      if (!bare.surface(i)) continue;
      const Vec3 p = bare.at("P", i);
      const Vec3 at = kind == LightKind::Mesh ? kLamp : shape.position;
      const Vec3 d = kind == LightKind::Directional ? -shape.axis : glm::normalize(at - p);
      // The light's own cone and the surfaces that it cannot reach have V = 1 by definition.
      if (!(glm::dot(d, bare.at("N", i)) > 0.02f) || (kind == LightKind::Spot && d.y < 0.55f)) continue;
      const Vec3 lowest = p + d * ((1.5f - p.y) / d.y), highest = p + d * ((2.1f - p.y) / d.y);
      if (p.y > 0.6f || maxComponent(glm::max(glm::abs(lowest), glm::abs(highest)) * Vec3(1, 0, 1)) > 1.7f) continue;  // past an edge
      const DVec3 truth = double(bare.V()[i]) * left(pane, d.y);
      for (int c = 0; c < 3; ++c)
        EXPECT_NEAR(with.V()[3 * i + size_t(c)], truth[c], tolerance) << "element " << i << " channel " << c << " solid " << bare.V()[i];
      ++(bare.V()[i] > 0.9f ? lit : shadowed);
    }
    EXPECT_GT(lit, 60u);
    EXPECT_GT(shadowed, 3u);
    if (::testing::Test::HasFailure()) return;
  }
}

bool isPunctual(LightKind k) {
  LightShape s;
  s.kind = k;
  return isDeltaLight(s);
}
std::vector<LightKind> kindsOf(const char* technique) {
  std::vector<LightKind> kinds;
  for (const ShadowTechniqueEntry& e : shadowTechniques())
    if (std::string(e.name) == technique)
      for (const LightKind k :
           {LightKind::Point, LightKind::Spot, LightKind::Directional, LightKind::Sphere, LightKind::Rect, LightKind::Disk, LightKind::Mesh})
        if (e.supports(k)) kinds.push_back(k);
  return kinds;
}

TEST(ClearGlass, RaysSeeThroughPanesUnderEveryLight) {
  EXPECT_EQ(kindsOf("ray_traced").size(), 7u);
  for (const LightKind k : kindsOf("ray_traced")) {
    SCOPED_TRACE(int(k));
    expectTinted(k, rayTraced(8), isPunctual(k) ? 2e-5 : 2e-3);
  }
  expectTinted(LightKind::Directional, rayTraced(8), 2e-3, 0.02f);
}

TEST(ClearGlass, AxisAlignedSeesThroughPanes) {
  v1::ShadowTechnique t;
  t.mutable_axis_aligned()->set_adaptive(false);  // panes are occluders for its sample counts
  t.mutable_axis_aligned()->set_radius_px(0);
  for (const LightKind k : kindsOf("axis_aligned")) {
    SCOPED_TRACE(int(k));
    expectTinted(k, t, 2e-3, k == LightKind::Directional ? 0.02f : 0.0f);
  }
}

TEST(ClearGlass, AxisAlignedFiltersEachChannelByTheSameKernel) {
  for (const auto kernel : {v1::AxisAlignedShadow::GAUSSIAN, v1::AxisAlignedShadow::FOURTH_ORDER}) {
    v1::ShadowTechnique t;
    t.mutable_axis_aligned()->set_kernel(kernel);
    const double tolerance = kernel == v1::AxisAlignedShadow::GAUSSIAN ? 2e-3 : 6e-3;  // the fourth order overshoots: 1 is its limit behind clear glass alone
    const PaneKind tinted = kPanes[1], clear{"clear", 1, 1.0f, Vec3(1.0f), false};
    const ShadowRun a = runShadow(stage(LightKind::Rect, &clear, 0, 0.3f), t, {20, 16, 1}),
                    b = runShadow(stage(LightKind::Rect, &tinted, 0, 0.3f), t, {20, 16, 1});
    ASSERT_TRUE(a.ok() && b.ok());
    size_t between = 0;
    for (size_t i = 0; i < a.size(); ++i) {
      if (!a.surface(i) || a.at("P", i).y > 0.6f || a.at("N", i).y < 0.9f) continue;
      const Vec3 p = a.at("P", i);
      if (std::fabs(p.x) > 1.0f || std::fabs(p.z) > 1.0f) continue;  // under the panes, with its neighbours
      for (size_t c = 0; c < 3; ++c) EXPECT_NEAR(b.V()[3 * i + c], a.V()[3 * i + c] * kTint[int(c)], tolerance);
      between += a.V()[3 * i] > 0.02f && a.V()[3 * i] < 0.98f;
    }
    EXPECT_GT(between, 3u);
  }
}

TEST(ClearGlass, ShadowMapsLeaveThePanesToRays) {
  for (const NamedTechnique& t : mapTechniques()) {
    v1::ShadowTechnique technique = t.technique;
    technique.mutable_map()->set_resolution(64);
    for (const LightKind k : kindsOf(t.name.c_str())) {
      SCOPED_TRACE(t.name + " " + std::to_string(int(k)));
      const bool sun = k == LightKind::Directional && t.name.find("soft") != std::string::npos;
      expectTinted(k, technique, isPunctual(k) && !sun ? 2e-5 : 2e-3, sun ? 0.02f : 0.0f);
      if (HasFailure()) return;
    }
  }
}

TEST(ClearGlass, PanesCastNothingIntoDepthMapsByEitherMethod) {
  for (const PaneKind& pane : kPanes) {
    const ScenePtr with = stage(LightKind::Point, &pane), bare = stage(LightKind::Point, nullptr);
    v1::ShadowTechnique t = mapTechnique("shadow_map");
    t.mutable_map()->set_resolution(32);
    const ShadowRun a = runShadow(bare, t, {4, 4, 1}), b = runShadow(with, t, {4, 4, 1});
    const auto za = a.term("light_depth_map")->floats("z"), zb = b.term("light_depth_map")->floats("z");
    ASSERT_EQ(za.size(), zb.size());
    for (size_t i = 0; i < za.size(); ++i) ASSERT_NEAR(za[i], zb[i], 2e-6) << pane.name << " " << i;
  }
}

}  // namespace
}  // namespace gobo::test
