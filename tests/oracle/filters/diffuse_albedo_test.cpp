// SPDX-License-Identifier: Apache-2.0
// What diffuse lobes reflect of uniform light, of any material: against sums over the hemisphere; and ambient light over such materials.
#include "filters/diffuse_albedo.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <vector>

#include "filters/ambient_light.h"
#include "support/run_node.h"
#include "support/tiny_scenes.h"
#include "terms/gbuffer.h"
#include "terms/surface.h"

namespace gobo {
namespace {

using namespace tests;

/// f.diffuse over the hemisphere, by equal shares of the cosine.
Vec3 summed(const BsdfParams& b, const Vec3& wo) {
  constexpr int kSamples = 8192;
  DVec3 sum(0.0);
  for (int i = 0; i < kSamples; ++i) {
    const double x = (i + 0.5) / kSamples, phi = 2.39996322972865332 * i, r = std::sqrt(x), z = std::sqrt(1 - x);
    sum += DVec3(bsdfEval(b, wo, Vec3(float(r * std::cos(phi)), float(r * std::sin(phi)), float(z))).diffuse) * (M_PI / z / kSamples);
  }
  return Vec3(sum);
}

TEST(DiffuseAlbedo, IsTheSumOverTheHemisphere) {
  struct Case {
    const char* name;
    double bound;
    std::function<void(BsdfParams&)> change;
  };
  const std::vector<Case> cases{
      {"Lambert", 1e-3, [](BsdfParams& b) { b.specular = 0; }},
      {"plastic", 2e-3, [](BsdfParams& b) { b.roughness = 0.3f; }},
      {"diffuse transmission", 2e-3, [](BsdfParams& b) { b.diffuseTransmission = 0.5f, b.diffuseTransmissionColor = Vec3(1, 0, 0); }},
      {"clearcoat", 2e-3, [](BsdfParams& b) { b.specular = 0, b.clearcoat = 1; }},
      {"rough clearcoat", 2e-3, [](BsdfParams& b) { b.roughness = 0.5f, b.clearcoat = 1, b.clearcoatRoughness = 0.4f; }},
      {"sheen", 5e-3, [](BsdfParams& b) { b.sheenColor = Vec3(1.0f), b.sheenRoughness = 0.3f; }},
      {"specular colour", 2e-3, [](BsdfParams& b) { b.roughness = 0.5f, b.specularColor = Vec3(0.5f); }},
      {"film", 3e-3, [](BsdfParams& b) { b.roughness = 0.3f, b.iridescence = 1, b.iridescenceThickness = 500; }},
      {"brushed", 0.01, [](BsdfParams& b) { b.roughness = 0.3f, b.anisotropy = 0.8f; }},
      {"tilted coat", 0.06, [](BsdfParams& b) { b.clearcoat = 1, b.clearcoatNormal = glm::normalize(Vec3(0.3f, 0, 1)); }},
      {"glass and metal in part", 2e-3,
       [](BsdfParams& b) { b.roughness = 0.4f, b.metallic = 0.2f, b.transmission = 0.3f, b.thin = true, b.diffuseTransmission = 0.3f, b.clearcoat = 0.5f; }},
  };
  for (const Case& k : cases)
    for (const float mu : {0.05f, 0.3f, 0.7f, 1.0f})
      for (const float phi : {0.0f, 1.0f, 2.0f}) {
        BsdfParams b;
        b.albedo = Vec3(0.8f, 0.5f, 0.2f);
        k.change(b);
        const float s = std::sqrt(1 - mu * mu);
        const Vec3 wo(s * std::cos(phi), s * std::sin(phi), mu), made = diffuseAlbedo(b, wo), truth = summed(b, wo);
        for (int c = 0; c < 3; ++c) EXPECT_NEAR(made[c], truth[c], k.bound * double(truth[c]) + 1e-6) << k.name << " " << mu << " " << phi;
      }
  EXPECT_EQ(diffuseAlbedo(BsdfParams(), Vec3(0, 0, -1)), Vec3(0.0f)) << "seen from below";
}

// A uniform map of radiance 2 over a floor: what reaches the diffuse lobe below what lies on it.
TEST(DiffuseAlbedo, IsWhatAmbientLightTakes) {
  const std::vector<std::pair<const char*, std::function<void(Bsdf&)>>> kinds{{"diffuse transmission", [](Bsdf& b) { b.diffuseTransmission = 0.25f; }},
                                                                              {"clearcoat", [](Bsdf& b) { b.clearcoat = 1; }},
                                                                              {"sheen", [](Bsdf& b) { b.sheenColor = Vec3(1.0f), b.sheenRoughness = 0.5f; }}};
  for (const auto& [name, change] : kinds) {
    const std::function<void(Bsdf&)>& extend = change;
    SceneMaker m;
    m.instance(m.mesh(ground(3.0f), m.material(Vec3(0.8f, 0.5f, 0.2f), [&](Material& x) { extend(x.bsdf); })));
    m.camera(Vec3(0, 1, 1), Vec3(0.0f), 0.4f);
    const ScenePtr scene = m.finish();
    GBufferSettings view;
    view.camera = scene->cameras[0];
    view.width = view.height = 6;
    const TaskArena arena(2);
    NodeRunner run(*scene, arena);
    const TermPtr g = run(makeGBufferNode(view), {}), surface = run(makeSurfaceNode(view), {g});
    AmbientLightSettings s;
    s.width = s.height = 6;
    s.radiance[0] = Vec3(2.0f / 0.28209479f);
    s.extended = true;
    s.camera = view.camera;
    const TermPtr light = run(makeAmbientLightNode(s), {g, surface});
    const auto P = g->floats("P"), rgb = light->floats("rgb");
    for (size_t p = 0; p < 36; ++p) {
      BsdfParams b;
      b.albedo = Vec3(0.8f, 0.5f, 0.2f);
      b.specular = 0;
      const Bsdf& asked = scene->materials[0].bsdf;
      b.diffuseTransmission = asked.diffuseTransmission;
      b.clearcoat = asked.clearcoat;
      b.sheenColor = asked.sheenColor;
      b.sheenRoughness = asked.sheenRoughness;
      const Vec3 out = glm::normalize(Vec3(0, 1, 1) - Vec3(P[3 * p], P[3 * p + 1], P[3 * p + 2]));
      const Vec3 expected = 2.0f * summed(b, Vec3(std::sqrt(1 - out.y * out.y), 0, out.y));
      for (size_t c = 0; c < 3; ++c) EXPECT_NEAR(rgb[3 * p + c], expected[int(c)], 4e-3f * expected[int(c)]) << name << " " << p;
    }
  }
}

}  // namespace
}  // namespace gobo
