// SPDX-License-Identifier: Apache-2.0
// Diffuse light of a sun of some size (direct_unoccluded: closed for Lambert, by a quadrature below an interface) against a fine grid over its disk.
#include <gtest/gtest.h>

#include <cmath>

#include "support/run_node.h"
#include "support/thorough.h"
#include "support/tiny_scenes.h"
#include "terms/direct_unoccluded.h"
#include "terms/gbuffer.h"
#include "terms/surface.h"
#include "trace/bsdf.h"
#include "trace/distant_light.h"

namespace gobo {
namespace {

using namespace tests;

// bsdfDiffuse has the bits of bsdfEval.
TEST(SunDiffuse, TheLobeIsThatOfTheMaterial) {
  for (const float roughness : {0.0f, 0.2f, 0.7f, 1.0f})
    for (const float metallic : {0.0f, 0.4f, 1.0f})
      for (const float ior : {0.0f, 1.2f, 1.5f, 2.4f})
        for (const float specular : {0.0f, 1.0f}) {
          BsdfParams p;
          p.albedo = Vec3(0.8f, 0.4f, 0.1f);
          p.roughness = roughness;
          p.metallic = metallic;
          p.ior = ior;
          p.specular = specular;
          for (const float o : {0.05f, 0.6f, 1.0f}) {
            const Vec3 wo(std::sqrt(1 - o * o), 0, o);
            const float cosines[4] = {0.02f, 0.4f, 1.0f, -0.3f};
            Vec3 out[4];
            bsdfDiffuse(p, wo, cosines, out);
            for (int k = 0; k < 3; ++k) {
              const Vec3 wi(0, std::sqrt(1 - cosines[k] * cosines[k]), cosines[k]);
              EXPECT_EQ(out[k], bsdfEval(p, wo, wi).diffuse) << roughness << " " << metallic << " " << ior << " " << o << " " << cosines[k];
            }
            EXPECT_EQ(out[3], Vec3(0.0f));
          }
        }
}

class SunDiffuse : public ::testing::TestWithParam<std::tuple<float, float, bool>> {};  // roughness, 0: Lambert; size in degrees; smooth normals

TEST_P(SunDiffuse, IsTheIntegralOverItsDisk) {
  const auto [roughness, degrees, smooth] = GetParam();
  const int kSize = 24, kGrid = gobo::testing::thoroughOr(96, 48);
  SceneMaker m;
  m.instance(m.mesh(sphere(Vec3(0.0f), 1.0f, 32, smooth), m.material(Vec3(0.7f, 0.5f, 0.3f), [r = roughness](Material& x) {
    if (r == 0.0f) return;
    x.bsdf = {};
    x.bsdf.roughness = r;
    x.bsdf.metallic = 0.25f;
  })));
  LightShape sun;
  sun.kind = LightKind::Directional;
  sun.axis = glm::normalize(Vec3(-0.7f, -0.5f, -0.4f));
  sun.angularSize = glm::radians(degrees);
  m.light(sun, Vec3(2, 3, 4));
  m.camera(Vec3(0, 0, 3.2f), Vec3(0.0f), 0.75f);
  const Traced t(m.finish(), kSize, kSize);
  DirectUnoccludedSettings s;
  s.view.camera = t.settings.camera;
  s.view.width = s.view.height = kSize;
  s.view.viewSamples = 1;
  s.lobe = LobePart::Diffuse;
  s.samples = 8;
  s.nominal = Vec3(1.0f);
  NodeRunner run(*t.scene, t.arena);
  const TermPtr g = run(makeGBufferNode(s.view), {}, {}), surface = run(makeSurfaceNode(s.view), {g}, {});
  const TermPtr L = run(makeDirectUnoccludedNode(s), {g, surface}, {0});
  const auto instance = g->plane<uint32_t>("instance");
  const auto vectorAt = [](const TermPtr& term, const char* plane, size_t i) {
    const auto v = term->floats(plane);
    return Vec3(v[3 * i], v[3 * i + 1], v[3 * i + 2]);
  };
  const DistantLight light(sun);
  const float sine = std::sin(0.5f * sun.angularSize);
  int whole = 0, dark = 0, cut = 0;
  for (size_t i = 0; i < instance.size(); ++i) {
    if (instance[i] == ~0u) continue;
    const Vec3 n = vectorAt(surface, "N", i), ng = vectorAt(g, "Ng", i), albedo = vectorAt(surface, "albedo", i), found = vectorAt(L, "L", i);
    const auto material = surface->floats("material");
    BsdfParams p;
    p.albedo = albedo;
    p.metallic = material[5 * i];
    p.roughness = material[5 * i + 1];
    p.specular = material[5 * i + 2];
    p.ior = material[5 * i + 3];
    const Frame frame(n);
    const Vec3 wo = frame.toLocal(glm::normalize(Vec3(s.view.camera.toWorld[3]) - vectorAt(g, "P", i)));
    const float above = -glm::dot(ng, sun.axis), up = std::min(-glm::dot(n, sun.axis), above);
    DVec3 sum(0.0);
    double density = 1;
    for (int y = 0; y < kGrid; ++y)
      for (int x = 0; x < kGrid; ++x) {
        const Vec3 wi = light.sample(Vec2((float(x) + 0.5f) / kGrid, (float(y) + 0.5f) / kGrid), density);
        if (glm::dot(wi, ng) > 0 && glm::dot(wi, n) > 0) sum += DVec3(bsdfEval(p, wo, frame.toLocal(wi)).diffuse) / density;
      }
    const DVec3 expected = sum / (double(kGrid) * kGrid * light.irradiance());
    for (int c = 0; c < 3; ++c) {
      if (up >= sine) {
        EXPECT_NEAR(found[c], expected[c], (degrees > 20 ? 4e-3 : 1e-3) * expected[c] + 1e-6) << i << " cosine " << up;
      } else if (up <= -sine) {
        EXPECT_EQ(found[c], 0.0f);
      } else if (n == ng || above >= sine) {  // elsewhere 8 samples
        EXPECT_NEAR(found[c], expected[c], 0.01 * expected[c] + 3e-4) << i << " cosine " << up << " of " << sine;
        ++cut;
      }
    }
    whole += up >= sine;
    dark += up <= -sine;
  }
  EXPECT_GT(whole, 60);
  EXPECT_GT(dark, 5);
  EXPECT_GT(cut, degrees < 1 ? -1 : 2);
}

INSTANTIATE_TEST_SUITE_P(RoughnessAndSize, SunDiffuse,
                         ::testing::Combine(::testing::Values(0.0f, 0.15f, 0.5f, 1.0f), ::testing::Values(0.3f, 5.0f, 18.0f, 54.0f), ::testing::Bool()));

// Balls that the horizon cuts, by a grid over what they cover of the sky.
TEST(SunDiffuse, ABallBehindTheHorizonHasTheFactorOfWhatShows) {
  for (const double degrees : {1.0, 20.0, 45.0, 75.0, 90.0}) {
    const double half = degrees * 3.14159265358979 / 180;
    for (const double lift : {-0.99, -0.6, -0.1, 0.0, 0.5, 0.9, 1.5}) {
      const double theta = 1.5707963267948966 - std::min(lift * half, 1.5707963267948966);  // of its centre to the normal
      double sum = 0;
      constexpr int n = 600;
      for (int y = 0; y < n; ++y)
        for (int x = 0; x < n; ++x) {
          const double c = 1 - (1 - std::cos(half)) * (y + 0.5) / n, s = std::sqrt(1 - c * c), b = 6.283185307179586 * (x + 0.5) / n;
          sum += std::max(c * std::cos(theta) + s * std::cos(b) * std::sin(theta), 0.0);
        }
      const double expected = sum / (double(n) * n) * 2 * (1 - std::cos(half));
      const double size = std::sin(half) * std::sin(half);
      EXPECT_NEAR(capFormFactor(std::cos(theta), std::sin(half)) / size, expected / size, 2e-5) << degrees << " " << lift;
    }
  }
}

}  // namespace
}  // namespace gobo
