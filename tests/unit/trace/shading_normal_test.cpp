// SPDX-License-Identifier: Apache-2.0
// Shading normals that differ from the triangle's: what specular lobes send to the wrong side comes back (bsdf.h), so nothing is lost in
// a white furnace whatever the tilt; densities stay densities; Lambert's loss has its stated bound.
#include <gtest/gtest.h>

#include "support/furnace.h"
#include "support/tiny_scenes.h"
#include "trace/surface.h"

namespace gobo::shading_normal_test {
namespace {

using namespace tests;
using test::localDirection;

struct Model {
  const char* name;
  float metallic, transmission;
  bool entering, thin;
};
const Model kModels[] = {
    {"metal", 1, 0, true, false}, {"glass from outside", 0, 1, true, false}, {"glass from inside", 0, 1, false, false}, {"thin glass", 0, 1, true, true}};

BsdfParams white(const Model& m, float roughness) {
  BsdfParams p;
  p.albedo = Vec3(1.0f);
  p.metallic = m.metallic;
  p.transmission = m.transmission;
  p.entering = m.entering;
  p.thin = m.thin;
  p.roughness = roughness;
  return p;
}
/// The triangle's normal in the frame of a normal that is tilted by `degrees` towards azimuth phi.
Vec3 tiltedFacing(double degrees, double phi) { return localDirection(std::cos(degrees * M_PI / 180), phi); }

/// As test::furnace, but of light that leaves on its lobe's side of the triangle: the tracer drops the rest.
test::Furnace arriving(const BsdfParams& p, const Vec3& wo, uint32_t seed) {
  BsdfParams upright = p;
  upright.facing = Vec3(0, 0, 1);
  const double eta = p.thin ? 1.0 : p.entering ? p.ior : 1.0 / p.ior;
  test::Moments m;
  for (uint32_t set = 0; set < 8; ++set) {
    double sum = 0;
    for (uint32_t i = 0; i < 1024; ++i) {
      SobolSampler u(seed * 64 + set, i);
      const float lobe = u.next1D();
      BsdfSample s;
      if (!bsdfSample(p, wo, lobe, u.next2D(), s) || (glm::dot(s.wi, p.facing) < 0.0f) != s.transmitted) continue;
      sum += double(maxComponent(s.weight)) * (s.transmitted && p.transmission > 0 && !p.thin ? eta * eta : 1.0);
    }
    m.add(sum / 1024);
  }
  return {m.mean(), m.error()};
}

TEST(ShadingNormal, TiltedSpecularLobesLoseNothingAndGainNothing) {
  uint32_t seed = 0;
  for (const Model& m : kModels) {
    double lowest = 2, highest = 0;
    int cases = 0;
    for (float roughness : {0.0f, 0.2f, 0.5f, 1.0f})
      for (double tilt : {5.0, 25.0, 50.0, 75.0})
        for (double phi : {0.0, 1.3, 3.14})
          for (double c : {0.05, 0.4, 0.9}) {
            BsdfParams p = white(m, roughness);
            p.facing = tiltedFacing(tilt, phi);
            const Vec3 wo = localDirection(c, 0.3);
            if (!(glm::dot(wo, p.facing) > 0.01f)) continue;  // the viewer does not see this side of the triangle
            const test::Furnace f = arriving(p, wo, ++seed);
            EXPECT_GT(f.mean + 4.0 * f.error, 0.99) << m.name << " roughness " << roughness << " tilt " << tilt << " phi " << phi << " cos " << c;
            EXPECT_LT(f.mean - 4.0 * f.error, 1.001) << m.name << " roughness " << roughness << " tilt " << tilt << " phi " << phi << " cos " << c;
            lowest = std::min(lowest, f.mean);
            highest = std::max(highest, f.mean);
            ++cases;
          }
    EXPECT_GT(cases, 60);
    std::printf("  %-20s %3d tilted cases: %.4f .. %.4f\n", m.name, cases, lowest, highest);
  }
}

/// Folded light is drawn with the density that bsdfPdf states; f over it is the weight; diffuse lobes beside it are not folded.
TEST(ShadingNormal, TiltedDensitiesAreDensities) {
  struct Case {
    BsdfParams p;
    double tilt, cosine;
  };
  std::vector<Case> cases;
  for (double tilt : {20.0, 60.0})
    for (const Model& m : kModels) cases.push_back({white(m, 0.6f), tilt, 0.4});
  BsdfParams plastic, layered;
  plastic.roughness = 0.5f;
  layered.roughness = 0.4f;
  layered.clearcoat = 1;
  layered.clearcoatRoughness = 0.6f;
  layered.sheenColor = Vec3(0.5f);
  layered.sheenRoughness = 0.5f;
  cases.push_back({plastic, 40.0, 0.5});
  cases.push_back({layered, 40.0, 0.5});
  for (size_t k = 0; k < cases.size(); ++k) {
    BsdfParams p = cases[k].p;
    p.facing = tiltedFacing(cases[k].tilt, 0.9);
    const Vec3 wo = localDirection(cases[k].cosine, 0.7);
    ASSERT_GT(glm::dot(wo, p.facing), 0.0f);
    const auto draw = [&](test::Rng& rng, Vec3& w) {
      BsdfSample s;
      const float lobe = rng.next();
      if (!bsdfSample(p, wo, lobe, rng.next2(), s)) return false;
      EXPECT_EQ(glm::dot(s.wi, p.facing) < 0.0f, s.transmitted);
      const Vec3 f = bsdfEval(p, wo, s.wi).sum();
      EXPECT_NEAR(s.weight.x, f.x / s.pdf, 1e-3f * (s.weight.x + 1e-3f));
      w = s.wi;
      return true;
    };
    const auto r = test::chi2Test({}, 30000, 40 + k, draw, [&](const Vec3& w) { return double(bsdfPdf(p, wo, w)); });
    EXPECT_GT(r.p, test::sidak(int(cases.size()))) << k << " chi2 " << r.statistic << "/" << r.degrees << " integral " << r.integral << " refused "
                                                   << r.refused;
  }
}

/// A specular lobe is continuous where it is folded: no seam at the triangle's horizon.
TEST(ShadingNormal, FoldedLightFadesInAtTheHorizon) {
  BsdfParams p = white(kModels[0], 0.5f);
  p.facing = tiltedFacing(40, 0);
  const Vec3 wo = localDirection(0.5, 0.4), along = glm::normalize(glm::cross(p.facing, Vec3(0, 1, 0)));
  const Vec3 horizon = along.z > 0 ? along : -along;
  BsdfParams upright = p;
  upright.facing = Vec3(0, 0, 1);
  const float at = bsdfEval(upright, wo, horizon).sum().x, above = bsdfEval(p, wo, glm::normalize(horizon + 1e-4f * p.facing)).sum().x;
  ASSERT_GT(at, 0.01f);
  EXPECT_NEAR(above, 2.0f * at, 2e-3f * at);
  EXPECT_EQ(bsdfEval(p, wo, glm::normalize(horizon - 1e-4f * p.facing)).sum().x, 0.0f);
}

/// Bumps of up to 50 degrees.
int bumps(SceneMaker& m) {
  auto t = std::make_shared<Texture>();
  t->name = "bumps";
  t->width = t->height = 16;
  t->srgb = false;
  for (int y = 0; y < 16; ++y)
    for (int x = 0; x < 16; ++x) {
      const Vec3 n = glm::normalize(Vec3(1.2f * float(std::sin(0.9 * x)), 1.2f * float(std::cos(1.3 * y + 0.4 * x)), 1.0f));
      for (int c = 0; c < 3; ++c) t->texels8.push_back(uint8_t(std::lround(127.5f * (n[c] + 1.0f))));
      t->texels8.push_back(255);
    }
  sealTexture(*t);
  m.scene.textures.push_back(t);
  return int(m.scene.textures.size()) - 1;
}

struct Pixels {
  double mean = 0, error = 0, low = 0, high = 0;
};  ///< low: 1st percentile

/// A sphere of 12 x 6 faces under a white sky.
Pixels sphereInFurnace(bool smooth, bool mapped, const std::function<void(Material&)>& change) {
  SceneMaker m;
  Mesh mesh = tests::sphere(Vec3(0.0f), 1.0f, 6, smooth);
  for (size_t i = 0; i < mesh.positions.size(); ++i) mesh.uv[0].push_back(Vec2(float(i % 12) / 3.0f, float(i / 12) / 2.0f));
  const int map = mapped ? bumps(m) : -1;
  m.instance(m.mesh(mesh, m.material(Vec3(1.0f), [&](Material& x) {
    change(x);
    x.bsdf.normal.texture = map;
  })));
  m.environment(constantEnvironment(Vec3(1.0f)));
  m.camera(Vec3(0.6f, 1.0f, 3.4f), Vec3(0.0f), 0.55f);
  const int n = 20, blocks = 12;
  Traced t(m.finish(), n, n);
  const auto tracer = t.tracer();
  std::vector<double> values(size_t(n * n));
  t.arena.parallelFor(size_t(n), 1, [&](size_t begin, size_t end) {
    for (size_t y = begin; y < end; ++y)
      for (int x = 0; x < n; ++x) {
        double out[3] = {0, 0, 0};
        uint64_t rays = 0, dropped = 0;
        for (int b = 0; b < blocks; ++b) tracer->traceBlock(x, int(y), uint32_t(b), out, rays, dropped);
        values[y * size_t(n) + size_t(x)] = out[0] / (blocks * t.settings.blockSize);
      }
  });
  std::sort(values.begin(), values.end());
  Pixels p;
  test::Moments all;
  for (double v : values) all.add(v);
  p.mean = all.mean();
  p.error = all.error();
  p.low = values[values.size() / 100];
  p.high = values.back();
  return p;
}

TEST(ShadingNormal, MetalSpheresStayWhiteInAWhiteFurnace) {
  struct Case {
    const char* name;
    bool smooth, mapped;
  };
  for (const Case& c : {Case{"interpolated", true, false}, Case{"mapped", false, true}, Case{"both", true, true}})
    for (float roughness : {0.0f, 0.3f, 0.8f}) {
      const Pixels p = sphereInFurnace(c.smooth, c.mapped, [&](Material& x) {
        x.bsdf.metallic = 1;
        x.bsdf.roughness = roughness;
      });
      std::printf("  %-12s metal, roughness %.1f: mean %.4f +- %.4f, 1st percentile %.4f, highest %.4f\n", c.name, roughness, p.mean, p.error, p.low, p.high);
      EXPECT_GT(p.mean + 4 * p.error, roughness > 0 ? 0.99 : 0.9999) << c.name << roughness;
      EXPECT_LT(p.mean - 4 * p.error, 1.0001) << c.name << roughness;
      EXPECT_GT(p.low, roughness > 0 ? 0.9 : 0.9999) << c.name << roughness;  // of 192 samples each: their noise is up to 0.025
      if (roughness == 0) { EXPECT_LT(p.high, 1.0001) << c.name; }
    }
}

/// Lambert keeps (1 + cos tilt) / 2 of what bounces on: the lune below the triangle is lost, nothing more. Direct light is untouched.
TEST(ShadingNormal, LambertLosesTheLuneBelowTheTriangle) {
  for (double tilt : {15.0, 45.0}) {
    SceneMaker m;
    Mesh mesh = ground(4.0f);
    const Vec3 n(float(std::sin(tilt * M_PI / 180)), float(std::cos(tilt * M_PI / 180)), 0);
    mesh.normals.assign(mesh.positions.size(), n);
    m.instance(m.mesh(mesh, m.material(Vec3(1.0f))));
    m.environment(constantEnvironment(Vec3(1.0f)));
    m.camera(Vec3(0.1f, 3.0f, 0.2f), Vec3(0.0f));
    Traced t(m.finish());
    expectNear(estimate(t, 64)[0], DVec3(0.5 * (1.0 + std::cos(tilt * M_PI / 180))), 1e-3);
  }
}

TEST(ShadingNormal, FlatSurfacesAreNotTouched) {
  SceneMaker m;
  m.instance(m.mesh(tests::sphere(Vec3(0.0f), 1.0f, 4, false), m.material(Vec3(0.8f), [](Material& x) {
    x.bsdf.metallic = 1;
    x.bsdf.roughness = 0.4f;
  })));
  m.camera(Vec3(0, 0, 3), Vec3(0.0f));
  const ScenePtr scene = m.finish();
  const TaskArena arena(1);
  const std::vector<int> none;
  const SceneView view(*scene, Facet::All, none);
  const AccelPtr accel = Accel::build(view, arena);
  SurfaceTable table;
  table.build(view, *accel);
  for (uint32_t k = 0; k < 20; ++k) {
    Surface s;
    table.interact(0, k, 0.2f, 0.3f, glm::normalize(Vec3(0.3f, 0.2f, float(k) - 7.5f)), Vec3(0, 0.6f, -0.8f), s);
    EXPECT_EQ(s.bsdf.facing, Vec3(0, 0, 1));
  }
}

}  // namespace
}  // namespace gobo::shading_normal_test
