// SPDX-License-Identifier: Apache-2.0
// What radiance caches are made of: a material as a sum of kernels, a map's means over pieces of the sphere, means of lobes by normal.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "scene/environment_tents.h"
#include "support/map_of.h"
#include "support/thorough.h"
#include "techniques/prefilter/lobe_cache.h"
#include "trace/bsdf_albedo.h"
#include "trace/bsdf_ggx.h"
#include "trace/bsdf_lobe_terms.h"

namespace gobo::prefilter {
namespace lobe_cache_test {

std::vector<BsdfParams> materials() {
  std::vector<BsdfParams> out(6);
  out[0].albedo = Vec3(0.9f, 0.4f, 0.1f), out[0].metallic = 1, out[0].roughness = 0.4f;
  out[1].albedo = Vec3(0.2f, 0.7f, 0.9f), out[1].roughness = 0.3f;
  out[2].albedo = Vec3(0.5f), out[2].metallic = 0.4f, out[2].roughness = 0.9f, out[2].ior = 2.4f, out[2].specular = 0.6f;
  out[3].albedo = Vec3(0.8f), out[3].specular = 0;
  out[4].albedo = Vec3(0.8f, 0.1f, 0.3f), out[4].roughness = 0;  // smooth: its highlight is no kernel's
  out[5].albedo = Vec3(0.3f), out[5].roughness = 1, out[5].ior = 0;
  return out;
}
/// Some radiance over the hemisphere.
double radianceOf(const Vec3& w) { return 1.5 + std::sin(5.0 * double(w.x)) + 0.4 * std::cos(7.0 * double(w.y)); }

// Integrals of several functions by midpoints in the cosine's square and the azimuth.
template <size_t K, class F>
std::array<double, K> overHemisphere(F&& f) {
  constexpr int N = 360;
  std::array<double, K> sum{};
  for (int j = 0; j < N; ++j)
    for (int i = 0; i < 2 * N; ++i) {
      const double z = (j + 0.5) / N, r = std::sqrt(1 - z * z), phi = (i + 0.5) * std::numbers::pi / N;
      const std::array<double, K> value = f(Vec3(float(r * std::cos(phi)), float(r * std::sin(phi)), float(z)));
      for (size_t k = 0; k < K; ++k) sum[k] += value[k];
    }
  for (double& s : sum) s *= std::numbers::pi / (double(N) * N);
  return sum;
}

TEST(LobeTerms, AreTheLobesAlbedosUnderUniformLight) {
  for (const BsdfParams& p : materials())
    for (const float mu : {1.0f, 0.7f, 0.2f, 0.02f}) {
      const LobeTerms t = bsdfLobeTerms(p, mu);
      const LobeAlbedos by = bsdfLobeAlbedos(p, mu);
      EXPECT_NEAR(t.open + t.deficit + t.schlick, 1.0f, 1e-6f);
      for (int c = 0; c < 3; ++c) {
        EXPECT_NEAR(t.diffuse[c], by.diffuse[c], 1e-6f);
        const bool mirror = sqr(p.roughness) < kDeltaAlpha;
        EXPECT_NEAR(t.microfacets[c] + t.grazing[c] + t.bounced[c], mirror ? 0.0f : by.specular[c], 1e-6f) << c << " " << mu;
      }
    }
  EXPECT_EQ(bsdfLobeTerms(materials()[0], 0.0f).microfacets, Vec3(0.0f));
  EXPECT_EQ(bsdfLobeTerms(materials()[0], -0.3f).microfacets, Vec3(0.0f));
}

// The material's own integral by its terms and the kernels' means.
TEST(LobeTerms, AreTheMaterialUnderAnyLight) {
  for (const BsdfParams& p : materials())
    for (const float mu : {0.9f, 0.35f}) {
      const Vec3 o(std::sqrt(1 - mu * mu), 0, mu);
      const float alpha = maxOf(sqr(p.roughness), kDeltaAlpha);
      const Ggx ggx(alpha);
      const bool smooth = sqr(p.roughness) < kDeltaAlpha;
      const ReflectionAlbedo table(alpha, std::sqrt(alpha));
      const auto lost = [&](const Vec3& w) { return smooth ? ReflectionAlbedo::Value{0.0f, schlickWeight(w.z)} : table.at(w.z); };
      // Five kernels, the same under the light, and the material's two lobes: all of them in one pass, which is what takes the time.
      const auto sums = overHemisphere<16>([&](const Vec3& w) {
        float f = 0, density, c = 0;
        const bool reflects = !smooth && ggxReflection(ggx, o, w, f, density, c);
        const ReflectionAlbedo::Value v = lost(w);
        const double micro = reflects ? double(f) : 0.0, grazing = reflects ? double(f) * double(schlickWeight(c)) : 0.0;
        const double kernels[5] = {micro, grazing, double(v.deficit) * double(w.z), double(v.schlick) * double(w.z), double(w.z)};
        const double radiance = radianceOf(w);
        const BsdfValue b = bsdfEval(p, o, w);
        std::array<double, 16> out;
        for (size_t k = 0; k < 5; ++k) out[k] = kernels[k], out[5 + k] = kernels[k] * radiance;
        for (size_t k = 0; k < 3; ++k) out[10 + k] = double(b.diffuse[int(k)]) * radiance, out[13 + k] = double(b.specular[int(k)]) * radiance;
        return out;
      });
      const auto mean = [&](size_t k) { return sums[k] > 0 ? float(sums[5 + k] / sums[k]) : 0.0f; };
      const float M = mean(0), S = mean(1), B = mean(2), G = mean(3), E = mean(4);
      const LobeTerms t = bsdfLobeTerms(p, mu);
      for (int c = 0; c < 3; ++c) {
        EXPECT_NEAR(t.diffuse[c] * (t.open * E + t.deficit * B + t.schlick * G), sums[10 + size_t(c)], 0.003) << mu << " " << c;
        EXPECT_NEAR(t.microfacets[c] * M + t.grazing[c] * S + t.bounced[c] * B, sums[13 + size_t(c)], 0.006) << mu << " " << c;
      }
    }
}

EnvironmentPtr smoothMap() {
  return tests::mapOf(256, 128, [](int x, int y) {
    const double theta = (y + 0.5) * std::numbers::pi / 128, phi = ((x + 0.5) / 256 * 2 - 1) * std::numbers::pi;
    const double u = std::sin(theta) * std::cos(phi), v = std::cos(theta), w = std::sin(theta) * std::sin(phi);
    return Vec3(float(1.5 + std::sin(4 * u + v)), float(1.2 + std::cos(3 * v - 2 * w)), float(1.1 + std::sin(5 * w) * u));
  });
}
Vec3 someDirection(int i) {
  const float y = 1.0f - (2.0f * float(i) + 1.0f) / 500.0f, phi = 2.39996f * float(i), s = std::sqrt(1.0f - y * y);
  return Vec3(s * std::cos(phi), y, s * std::sin(phi));
}

TEST(EnvironmentPyramid, LevelsHaveTheFluxOfTheMapAndOfUniformOnesTheRadiance) {
  for (const auto& [map, flux] :
       std::vector<std::pair<EnvironmentPtr, DVec3>>{{constantEnvironment(Vec3(2, 1, 0.5f)), 4 * std::numbers::pi * DVec3(2, 1, 0.5)},
                                                     {tests::mapOf(64, 32, [](int x, int y) { return Vec3(x == 5 && y == 9 ? 100.0f : 0.0f, 1.0f, 0.0f); }),
                                                      DVec3(100 * EnvironmentTents(64, 32).weight(9), 4 * std::numbers::pi, 0)}}) {
    const EnvironmentPyramid pyramid(*map);
    for (int k = 0; k < EnvironmentPyramid::kLevels; ++k)
      for (int c = 0; c < 3; ++c) EXPECT_NEAR(pyramid.flux(k)[c], flux[c], 2e-4 * (flux[c] + 1e-3)) << k << " " << c;
  }
  const EnvironmentPyramid uniform(*constantEnvironment(Vec3(2, 1, 0.5f)));
  for (int i = 0; i < 500; ++i)
    for (const float angle : {1e-7f, 1e-3f, 0.1f, 5.0f, 100.0f}) EXPECT_LT(glm::length(uniform.mean(someDirection(i), angle) - Vec3(2, 1, 0.5f)), 1e-5f);
}

// Also across the seams of the square, y = 0, and where its four corners meet.
TEST(EnvironmentPyramid, SmallPiecesAreTheMapAndNothingJumps) {
  const EnvironmentPtr map = smoothMap();
  const EnvironmentPyramid pyramid(*map);
  std::vector<Vec3> directions{Vec3(0, -1, 0), Vec3(0, 1, 0), Vec3(1, 0, 0), Vec3(0, 0, -1)};
  for (int i = 0; i < 500; ++i) directions.push_back(someDirection(i));
  for (const Vec3& d : directions) EXPECT_LT(glm::length(pyramid.mean(d, 1e-6f) - map->eval(d)), 0.03f) << d.x << " " << d.y << " " << d.z;
  for (int i = 0; i < 200; ++i) {
    const float phi = 0.0314f * float(i), y = 1e-4f;
    for (const float angle : {1e-6f, 1e-3f, 0.05f})
      for (const auto& [a, b] : {std::pair(Vec3(std::cos(phi), y, std::sin(phi)), Vec3(std::cos(phi), -y, std::sin(phi))),  // seams of the halves
                                 std::pair(Vec3(y, -0.6f, 0.8f), Vec3(-y, -0.6f, 0.8f)), std::pair(Vec3(0.8f, -0.6f, y), Vec3(0.8f, -0.6f, -y)),  // edges
                                 std::pair(Vec3(y, -1, y), Vec3(-y, -1, -y))})
        EXPECT_LT(glm::length(pyramid.mean(glm::normalize(a), angle) - pyramid.mean(glm::normalize(b), angle)), 0.005f) << phi << " " << angle;
  }
}

// From one level to the next too.
TEST(EnvironmentPyramid, AGrowingPieceBlursWithoutAStep) {
  uint32_t state = 7;
  const EnvironmentPyramid pyramid(*tests::mapOf(256, 128, [&](int, int) { return Vec3(float((state = state * 1664525u + 1013904223u) >> 24) / 255.0f); }));
  for (int i = 0; i < 40; ++i) {
    const Vec3 d = someDirection(12 * i + 3);
    for (float angle = 1e-5f; angle < 2.0f; angle *= 1.03f) ASSERT_NEAR(pyramid.mean(d, angle).x, pyramid.mean(d, 1.03f * angle).x, 0.03f) << i << " " << angle;
  }
}

TEST(EnvironmentPyramid, WidePiecesAreMeans) {
  const EnvironmentPtr map = tests::mapOf(256, 128, [](int, int y) { return Vec3(y < 64 ? 2.0f : 0.0f); });
  const EnvironmentPyramid pyramid(*map);
  for (const float phi : {0.3f, 1.9f, 4.0f}) {
    const Vec3 side(std::cos(phi), 0, std::sin(phi));
    for (const float angle : {1e-2f, 0.3f, 2.0f}) EXPECT_NEAR(pyramid.mean(side, angle).x, 1.0f, 0.1f) << angle;
    EXPECT_NEAR(pyramid.mean(glm::normalize(side + Vec3(0, 0.1f, 0)), 1e-4f).x, 2.0f, 1e-4f);
    EXPECT_LT(pyramid.mean(glm::normalize(side + Vec3(0, 0.1f, 0)), 0.2f).x, 1.9f);
  }
  StopSource stop;
  stop.stop(StopReason::Cancelled);
  EXPECT_TRUE(EnvironmentPyramid(*map, stop.token()).empty());
}

struct Means {
  NormalPicture picture;
  std::vector<float> lobe;
  Means(const EnvironmentPyramid& map, int side, float roughness, int samples, const DVec3& towards, const TaskArena& arena)
      : picture(side, towards), lobe(12 * picture.texels()) {
    EXPECT_TRUE(lobeMeans(picture, map, {}, roughness, samples, arena, {}, lobe));
  }
  DVec3 at(const DVec3& n) const {
    return picture.at(n).blend([&](size_t t) { return DVec3(lobe[12 * t], lobe[12 * t + 1], lobe[12 * t + 2]); });
  }
};

TEST(LobeCache, FinerPicturesAreNearer) {
  const TaskArena arena(2);
  const EnvironmentPyramid map(*smoothMap());
  const DVec3 towards = glm::normalize(DVec3(0.3, 0.2, 1));
  const Means truth(map, testing::thoroughOr(1024, 512), 0.3f, 16, towards, arena);
  double before = 1;
  for (const int side : {64, 128, 256}) {
    const Means means(map, side, 0.3f, 16, towards, arena);
    double wrong = 0, all = 0;
    for (int i = 0; i < 500; ++i) {
      const DVec3 n(someDirection(i));
      if (glm::dot(n, towards) < 0.05) continue;
      wrong += glm::dot(means.at(n) - truth.at(n), means.at(n) - truth.at(n)), all += glm::dot(truth.at(n), truth.at(n));
    }
    const double error = std::sqrt(wrong / all);
    std::printf("lobes by %d x %d normals: RMS error %.6f\n", side, side, error);
    EXPECT_LT(error, before / 2);
    before = error;
  }
  EXPECT_LT(before, 1e-3);
}

TEST(LobeCache, IsTheSameForAnyThreadsAndStops) {
  const TaskArena one(1), three(3);
  const EnvironmentPyramid map(*smoothMap());
  const MapLight light{DVec3(0.6, 0.8, 0), DVec3(1, 2, 3)};
  const NormalPicture picture(16, DVec3(0, 1, 0.2));
  std::vector<float> a(12 * picture.texels()), b(a), c(3 * picture.texels()), d(c);
  ASSERT_TRUE(lobeMeans(picture, map, {&light, 1}, 0.5f, 64, one, {}, a) && lobeMeans(picture, map, {&light, 1}, 0.5f, 64, three, {}, b));
  ASSERT_TRUE(cosineMeans(picture, {&light, 1}, one, {}, c) && cosineMeans(picture, {&light, 1}, three, {}, d));
  EXPECT_EQ(a, b);
  EXPECT_EQ(c, d);
  StopSource stop;
  stop.stop(StopReason::Cancelled);
  EXPECT_FALSE(lobeMeans(picture, map, {&light, 1}, 0.5f, 64, one, stop.token(), a));
  EXPECT_FALSE(cosineMeans(picture, {&light, 1}, one, stop.token(), c));
}

// One light: the cosine, and what the tables lose of it.
TEST(LobeCache, OneLightsMeansAreItsKernels) {
  const TaskArena arena(1);
  const EnvironmentPyramid map(*constantEnvironment(Vec3(0.0f)));
  const MapLight light{DVec3(0.6, 0.8, 0), DVec3(1, 2, 3)};
  const NormalPicture picture(32, DVec3(0.1, 0.2, 1));
  const float roughness = 0.6f;
  const ReflectionAlbedo table(sqr(roughness), roughness);
  std::vector<float> lobe(12 * picture.texels()), cosine(3 * picture.texels());
  ASSERT_TRUE(lobeMeans(picture, map, {&light, 1}, roughness, 16, arena, {}, lobe) && cosineMeans(picture, {&light, 1}, arena, {}, cosine));
  for (int y = 0; y < 32; ++y)
    for (int x = 0; x < 32; ++x) {
      const size_t t = size_t(32 * y + x);
      const double along = std::max(glm::dot(picture.normal(x, y), light.direction), 0.0);
      const ReflectionAlbedo::Value v = along > 0 ? table.at(float(along)) : ReflectionAlbedo::Value{};
      for (int c = 0; c < 3; ++c) {
        EXPECT_NEAR(cosine[3 * t + size_t(c)], along * light.flux[c] / std::numbers::pi, 1e-6);
        EXPECT_NEAR(lobe[12 * t + 6 + size_t(c)], along * double(v.deficit) * light.flux[c] / (std::numbers::pi * double(table.deficitMean)), 1e-4);
        EXPECT_NEAR(lobe[12 * t + 9 + size_t(c)], along * double(v.schlick) * light.flux[c] / (std::numbers::pi * double(table.schlickMean)), 1e-4);
        EXPECT_EQ(lobe[12 * t + size_t(c)], 0.0f);
      }
    }
}

// Facing away from the eye, which a table of one direction has no light for, normals have that of the horizon, and numbers.
TEST(LobeCache, NormalsThatFaceAwayHaveLight) {
  const TaskArena arena(2);
  const EnvironmentPyramid map(*smoothMap());
  const Means means(map, 64, 0.4f, 64, DVec3(0, 0, 1), arena);
  for (int i = 0; i < 500; ++i) {
    const DVec3 v = means.at(DVec3(someDirection(i)));
    for (int c = 0; c < 3; ++c) EXPECT_TRUE(v[c] > 0.05 && v[c] < 3.0) << i << " " << v[c];
  }
  for (const double z : {-0.05, 0.0, 0.05}) {  // no step where they begin to
    const DVec3 a(std::sqrt(1 - z * z), 0, z), b(std::sqrt(1 - (z + 0.02) * (z + 0.02)), 0, z + 0.02);
    EXPECT_LT(glm::length(means.at(a) - means.at(b)), 0.1) << z;
  }
}

}  // namespace lobe_cache_test
}  // namespace gobo::prefilter
