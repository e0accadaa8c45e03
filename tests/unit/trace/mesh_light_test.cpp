// SPDX-License-Identifier: Apache-2.0
// Oracles: quadrature over brute-force intersections, form factors, the analytic rectangle, moments of positions.
#include "trace/mesh_light.h"

#include <gtest/gtest.h>

#include <algorithm>

#include <glm/gtc/matrix_transform.hpp>

#include "support/chi2.h"
#include "support/lit_scene.h"
#include "trace/plain_mesh_light.h"

namespace gobo::mesh_light_test {
namespace {

using namespace test;

struct MeshHit {
  uint32_t primitive;
  float t, u, v;
};

/// Every triangle of instance 0 that the ray crosses (Moeller & Trumbore 1997), in double.
std::vector<MeshHit> crossings(const Scene& scene, const Vec3& origin, const Vec3& direction) {
  std::vector<MeshHit> hits;
  const Mesh& mesh = *scene.meshes[0];
  for (uint32_t k = 0; k < mesh.triangles(); ++k) {
    DVec3 p[3];
    for (int c = 0; c < 3; ++c) p[c] = DVec3(scene.instances[0].toWorld * Vec4(mesh.positions[mesh.indices[3 * k + c]], 1.0f));
    const DVec3 e1 = p[1] - p[0], e2 = p[2] - p[0], d(direction), h = glm::cross(d, e2), s = DVec3(origin) - p[0], q = glm::cross(s, e1);
    const double a = glm::dot(e1, h);
    if (a == 0) continue;
    const double u = glm::dot(s, h) / a, v = glm::dot(d, q) / a, t = glm::dot(e2, q) / a;
    if (u >= 0 && v >= 0 && u + v <= 1 && t > 0) hits.push_back({k, float(t), float(u), float(v)});
  }
  return hits;
}

const std::vector<Vec3> kSquare = {{-1, 0, -1}, {1, 0, -1}, {1, 0, 1}, {-1, 0, -1}, {1, 0, 1}, {-1, 0, 1}};  // winding: normal -y
const std::vector<Vec3> kTent = {{-1, 0, -1}, {1, 0, -1}, {0, 1, 0}, {1, 0, -1},   {1, 0, 1},       {0, 1, 0},
                                 {1, 0, 1},   {-1, 0, 1}, {0, 1, 0}, {0, 0.2f, 0}, {0.3f, 0.2f, 0}, {0, 0.2f, 0.1f}};

std::shared_ptr<const Texture> stripes(bool onlyOneTexel) {
  auto t = std::make_shared<Texture>();
  t->name = "stripes";
  t->width = 8;
  t->height = 8;
  t->nearest = true;
  for (int y = 0; y < 8; ++y)
    for (int x = 0; x < 8; ++x) {
      const float l = onlyOneTexel ? (x == 5 && y == 2 ? 1.0f : 0.0f) : (x < 4 ? 0.05f : 1.0f);
      for (float c : {l, l, l, 1.0f}) t->texelsF.push_back(c);
    }
  sealTexture(*t);
  return t;
}

double meshPdf(const LitScene& s, const Vec3& p, const Vec3& w) {
  double sum = 0;
  for (const MeshHit& h : crossings(*s.scene, p, w)) {
    if (maxComponent(s.sampler->emitted(0, w, h.primitive, h.u, h.v, Vec3(0))) > 0.0f) sum += s.sampler->pdf(0, p, w, h.t, h.primitive);
  }
  return sum;
}

TEST(MeshLight, ChiSquaredOfSamplesAgainstDensity) {
  const Mat4 place = glm::rotate(glm::translate(Mat4(1.0f), Vec3(0.2f, 2, 0)), 0.4f, glm::normalize(Vec3(1, 2, 3)));
  const Mat4 mirrored = glm::scale(place, Vec3(-1.5f, 0.7f, 1));
  struct Case {
    const char* name;
    const std::vector<Vec3>& corners;
    Mat4 m;
    bool doubleSided;
    int texture;
    Vec3 p;
  };
  const Case cases[] = {{"square", kSquare, place, false, 0, Vec3(0)},       {"tent", kTent, place, true, 0, Vec3(0, 0, 0.5f)},
                        {"tent one-sided", kTent, place, false, 0, Vec3(0)}, {"mirrored tent", kTent, mirrored, true, 0, Vec3(0)},
                        {"stripes", kSquare, place, true, 1, Vec3(0, 5, 0)}, {"one texel", kSquare, place, true, 2, Vec3(0)}};
  double lowest = 1, highest = 0;
  uint64_t seed = 70;
  for (const Case& c : cases) {
    LitScene s;
    addEmissiveMesh(*s.scene, c.corners, c.m, c.doubleSided, c.texture ? stripes(c.texture == 2) : nullptr);
    s.build();
    const Vec3 axis = glm::normalize(Vec3(0.2f, 2.2f, 0) - c.p);
    const auto r = chi2Test(
        {axis, 0.5, 10, 16}, 60000, seed++,
        [&](Rng& rng, Vec3& w) {
          LightSample out;
          if (!s.sampler->sample(0, c.p, rng.next2(), out)) return false;
          w = out.direction;
          return true;
        },
        [&](const Vec3& w) { return meshPdf(s, c.p, w); }, 6, 3);  // densities jump at edges of near triangles
    EXPECT_GT(r.p, sidak(6)) << c.name << " chi2 " << r.statistic << "/" << r.degrees << " integral " << r.integral << " refused " << r.refused;
    EXPECT_LT(r.refused, 60000);
    lowest = std::min(lowest, r.p);
    highest = std::max(highest, r.p);
  }
  std::printf("  chi2 p-values of 6 mesh lights: %.4f .. %.4f\n", lowest, highest);
}

TEST(MeshLight, EqualsTheAnalyticRectangle) {
  LitScene s;
  addEmissiveMesh(*s.scene, kSquare, glm::translate(Mat4(1.0f), Vec3(0, 1.5f, 0)), false);
  s.build();
  LitScene r;
  r.add(rectLight(Vec3(0, 1.5f, 0), Vec3(1, 0, 0), Vec3(0, 0, 1)));
  r.build();
  for (const Vec3& p : {Vec3(0), Vec3(1, -1, 0.5f), Vec3(3, 1, 0)}) {
    const double truth = irradiance(*r.sampler, 0, p, Vec3(0, 1, 0)).mean;
    EXPECT_NEAR(irradiance(*s.sampler, 0, p, Vec3(0, 1, 0), 16384).mean, truth, 4e-3 * truth);
  }
  LightSample out;
  EXPECT_FALSE(s.sampler->sample(0, Vec3(0, 3, 0), Vec2(0.4f), out));  // behind a one-sided light
}

/// The 12 triangles of a box, fronts outwards.
std::vector<Vec3> box(const Vec3& half) {
  std::vector<Vec3> corners;
  for (int axis = 0; axis < 3; ++axis)
    for (float sign : {-1.0f, 1.0f}) {
      Vec3 n(0.0f), u(0.0f), v(0.0f);
      n[axis] = sign * half[axis];
      u[(axis + 1) % 3] = half[(axis + 1) % 3];
      v[(axis + 2) % 3] = sign * half[(axis + 2) % 3];
      for (const Vec2& c : {Vec2(-1, -1), Vec2(1, -1), Vec2(1, 1), Vec2(-1, -1), Vec2(1, 1), Vec2(-1, 1)}) corners.push_back(n + u * c.x + v * c.y);
    }
  return corners;
}

/// Most of a thin closed lamp never faces a receiver: nothing is spent there, and the density says so (its integral is the chi-squared
/// test's, which has the mean of the samples too).
TEST(MeshLight, NothingIsSpentOnTrianglesThatFaceAway) {
  const std::vector<Vec3> corners = box(Vec3(0.5f, 0.1f, 0.5f));
  LitScene s;
  addEmissiveMesh(*s.scene, corners, glm::translate(Mat4(1.0f), Vec3(0, 2, 0)), false);
  s.build();
  uint64_t seed = 80;
  struct Seen {
    Vec3 p;
    float span;
  };  // with the cone that the lamp fills
  for (const auto& [p, span] : {Seen{Vec3(0, 2.4f, 0), 1.0f}, Seen{Vec3(3, 1, 0), 0.05f}, Seen{Vec3(-2, 0.5f, 1), 0.06f}}) {
    Rng rng(seed++);
    int refused = 0;
    for (int k = 0; k < 4000; ++k) {
      LightSample out;
      refused += !s.sampler->sample(0, p, rng.next2(), out);
    }
    EXPECT_LE(refused, 4) << p.x << " " << p.y;  // edge-on within rounding
    const auto r = chi2Test(
        {glm::normalize(Vec3(0, 2, 0) - p + Vec3(1e-3f, 0, 0)), span, 10, 16}, 40000, seed++,
        [&](Rng& g, Vec3& w) {
          LightSample out;
          if (!s.sampler->sample(0, p, g.next2(), out)) return false;
          w = out.direction;
          return true;
        },
        [&](const Vec3& w) { return meshPdf(s, p, w); }, 6, 3);
    EXPECT_GT(r.p, sidak(3)) << p.x << " " << p.y << " chi2 " << r.statistic << "/" << r.degrees << " integral " << r.integral;
  }
  // Within the box no front is seen.
  LightSample out;
  EXPECT_FALSE(s.sampler->sample(0, Vec3(0, 2, 0), Vec2(0.3f, 0.6f), out));
}

/// Draws of the vector code are weighed against the densities of this: both decide alike whether only triangles that face the receiver are drawn from,
/// whatever triangles without area a mesh has besides (strips are joined by them, the poles of spheres are made of them).
TEST(MeshLight, PlainLightsDrawByTheSameDensity) {
  const Vec3 p(10, 2, 0), towards(-1, 0, 0);  // sees one face of the box, straight
  for (const int empty : {0, 3, 6, 40}) {
    std::vector<Vec3> corners = box(Vec3(0.5f, 0.1f, 0.5f));
    for (int k = 0; k < empty; ++k) corners.insert(corners.end(), {Vec3(0.5f, 0.1f, 0.5f), Vec3(0.5f, 0.1f, -0.5f), Vec3(0.5f, 0.1f, 0.5f)});
    LitScene s;
    addEmissiveMesh(*s.scene, corners, glm::translate(Mat4(1.0f), Vec3(0, 2, 0)), false);
    s.build();
    PlainMeshLight plain;
    ASSERT_TRUE(plain.build(SceneView(*s.scene, kLightFacets, s.subset), s.scene->lights[0].shape));
    float visible = 0;
    plain.pick(0.3f, p, visible);
    const auto hits = crossings(*s.scene, p + Vec3(0, 0.03f, 0.07f), towards);
    ASSERT_FALSE(hits.empty());
    const MeshHit first = *std::min_element(hits.begin(), hits.end(), [](const MeshHit& a, const MeshHit& b) { return a.t < b.t; });
    const double density = double(s.sampler->pdf(0, p, towards, first.t, first.primitive)) / (double(first.t) * first.t);
    EXPECT_NEAR(1.0 / density, visible, 1e-4 * visible) << empty;
  }
}

/// A receiver close to a large triangle: weights of samples by solid angle are the cosine alone, and so within 1 of each other, where by area
/// they would go with d^2 / cos over four orders of magnitude.
TEST(MeshLight, NearTrianglesAreSampledBySolidAngle) {
  LitScene s;
  addEmissiveMesh(*s.scene, {{-1, 0, -1}, {1, 0, -1}, {1, 0, 1}}, glm::translate(Mat4(1.0f), Vec3(0, 0.02f, 0)), true);
  s.build();
  for (const Vec3& p : {Vec3(0.3f, 0, 0), Vec3(0.9f, 0, -0.95f), Vec3(0.3f, 0.0199f, 0), Vec3(-0.5f, -0.4f, 0.6f)}) {
    Rng rng(11);
    double low = 1e30, high = 0;
    for (int k = 0; k < 2000; ++k) {
      LightSample out;
      ASSERT_TRUE(s.sampler->sample(0, p, rng.next2(), out));
      low = std::min(low, double(out.pdf));
      high = std::max(high, double(out.pdf));
      const Vec3 q = p + out.direction * out.distance;  // on the lamp
      ASSERT_NEAR(q.y, 0.02f, 1e-5f);
      ASSERT_TRUE(q.x >= -1 - 1e-4f && q.x <= 1 + 1e-4f && q.z >= -1 - 1e-4f && q.z <= q.x + 1e-4f) << q.x << " " << q.z;
    }
    EXPECT_LT(high, low * (1 + 1e-6)) << p.x << " " << p.y;
  }
  // The edge, the plane, the corner: finite, by area.
  for (const Vec3& p : {Vec3(0, 0.02f, -1), Vec3(5, 0.02f, 0), Vec3(-1, 0.02f, -1), Vec3(0.3f, 0.02f, 0)}) {
    LightSample out;
    if (s.sampler->sample(0, p, Vec2(0.4f, 0.3f), out)) { EXPECT_TRUE(std::isfinite(out.pdf) && isFinite(out.direction)); }
  }
}

/// The unit square's stripes: half at 1, half at 0.05; far away irradiance is radiance x area / d^2.
TEST(MeshLight, TextureIsSampledInProportionAndStrengthIsNotApplied) {
  for (bool oneTexel : {false, true}) {
    LitScene s;
    const std::vector<Vec3> unit = {{0, 0, 0}, {1, 0, 0}, {1, 0, 1}, {0, 0, 0}, {1, 0, 1}, {0, 0, 1}};
    addEmissiveMesh(*s.scene, unit, glm::translate(Mat4(1.0f), Vec3(0, 100, 0)), true, stripes(oneTexel));
    s.build();
    const double truth = (oneTexel ? 1.0 / 64 : 0.525) / 1e4;
    EXPECT_NEAR(irradiance(*s.sampler, 0, Vec3(0), Vec3(0, 1, 0), 65536).mean, truth, 0.01 * truth);
  }
}

TEST(MeshLight, MaskedTexelsSendNothingAndBlendedOnesTheirAlpha) {
  for (AlphaMode mode : {AlphaMode::Mask, AlphaMode::Blend}) {
    LitScene s;
    addEmissiveMesh(*s.scene, kSquare, glm::translate(Mat4(1.0f), Vec3(0, 50, 0)), true);
    auto alpha = std::make_shared<Texture>();
    alpha->name = "alpha";
    alpha->width = 2;
    alpha->height = 1;
    alpha->nearest = true;
    alpha->texelsF = {1, 1, 1, 0.25f, 1, 1, 1, 0.75f};
    sealTexture(*alpha);
    s.scene->textures.push_back(alpha);
    s.scene->materials[0].coverage.mode = mode;
    s.scene->materials[0].coverage.texture.texture = 0;
    s.build();
    EXPECT_NEAR(irradiance(*s.sampler, 0, Vec3(0), Vec3(0, 1, 0), 16384).mean * 2500.0 / 4.0, 0.5, 5e-3);
  }
}

/// Many triangles eat the number that chooses them; positions inside must stay uniform all the same.
TEST(MeshLight, PositionsStayUniformWithManyTriangles) {
  std::vector<Vec3> corners;
  const int n = 1 << 17;
  for (int i = 0; i < n; ++i) corners.insert(corners.end(), {Vec3(0, 0, 0), Vec3(1, 0, 0), Vec3(0, 0, 1)});
  LitScene s;
  addEmissiveMesh(*s.scene, corners, glm::translate(Mat4(1.0f), Vec3(0, 4, 0)), true);  // far: sampled by area
  s.build();
  Rng rng(3);
  const int samples = 40000, bins = 100;
  std::vector<int> count(bins, 0);
  for (int i = 0; i < samples; ++i) {
    LightSample out;
    ASSERT_TRUE(s.sampler->sample(0, Vec3(0), rng.next2(), out));
    const Vec3 q = out.direction * out.distance;
    const float x = 1.0f - sqr(1.0f - q.x);  // cumulative distribution of x over the triangle
    ++count[std::min(int(x * bins), bins - 1)];
  }
  double chi2 = 0;
  for (int c : count) chi2 += sqr(float(c) - float(samples) / bins) / (double(samples) / bins);
  EXPECT_GT(gammaQ(0.5 * (bins - 1), 0.5 * chi2), 0.01);
}

/// Probes may see black where a texel shines between them: every triangle must stay reachable.
TEST(MeshLight, TrianglesThatLookBlackKeepAChance) {
  for (float right : {1.0f, 0.0f}) {
    auto t = std::make_shared<Texture>();
    t->name = "half";
    t->width = 2;
    t->height = 1;
    t->nearest = true;
    t->texelsF = {0, 0, 0, 1, right, right, right, 1};
    sealTexture(*t);
    LitScene s;
    addEmissiveMesh(*s.scene, {{0, 0, 0}, {0.4f, 0, 0}, {0, 0, 1}, {0.6f, 0, 0}, {0.9f, 0, 0}, {0.6f, 0, 1}}, Mat4(1.0f), true, t);
    s.build();
    for (uint32_t k : {0u, 1u}) EXPECT_GT(s.sampler->pdf(0, Vec3(0, -1, 0), Vec3(0, 1, 0), 1.0f, k), 0.05f) << k;
  }
}

TEST(MeshLight, DegenerateTrianglesAndNearReceiversStayFinite) {
  LitScene s;
  std::vector<Vec3> corners = kSquare;
  corners.insert(corners.end(), {Vec3(0), Vec3(0), Vec3(1, 0, 0), Vec3(0), Vec3(1, 0, 0), Vec3(2, 0, 0)});
  addEmissiveMesh(*s.scene, corners, Mat4(1.0f), true);
  s.build();
  Rng rng(6);
  for (const Vec3& p : {Vec3(0), Vec3(0.3f, 1e-6f, 0.2f), Vec3(0.3f, -1e-12f, 0.2f), Vec3(5, 0, 0), Vec3(1e6f, 1, 0)})
    for (int i = 0; i < 500; ++i) {
      LightSample out;
      if (!s.sampler->sample(0, p, rng.next2(), out)) continue;
      EXPECT_TRUE(isFinite(out.direction) && isFinite(out.radiance / out.pdf) && std::isfinite(out.pdf) && out.pdf > 0);
    }
  for (uint32_t k = 2; k < 4; ++k) EXPECT_EQ(s.sampler->pdf(0, Vec3(0), Vec3(0, 0, 1), 1.0f, k), 0.0f);
  LitScene empty;
  addEmissiveMesh(*empty.scene, {Vec3(0), Vec3(0), Vec3(0)}, Mat4(1.0f), true);
  empty.build();
  LightSample out;
  EXPECT_FALSE(empty.sampler->sample(0, Vec3(1), Vec2(0.5f), out));
}

}  // namespace
}  // namespace gobo::mesh_light_test
