// SPDX-License-Identifier: Apache-2.0
// Published shadows blended by an occlusion factor: closed forms of the factor, and what a view is given between a hard shadow and none.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstring>
#include <numbers>

#include "support/run_node.h"
#include "support/tiny_scenes.h"
#include "techniques/transfer/harmonics.h"
#include "techniques/transfer/nodes.h"
#include "techniques/transfer/published/occlusion_factor.h"
#include "techniques/transfer/receiver_mesh.h"
#include "terms/surface.h"

namespace gobo::transfer::published::occlusion_test {
namespace {

using gobo::tests::SceneMaker;

const double kOpen = std::numbers::pi / std::sqrt(4 * std::numbers::pi);

std::vector<float> openTransfer(const DVec3& normal, int bands) {
  std::vector<double> Y(size_t(bands * bands));
  harmonics(normal, bands, Y.data());
  std::vector<float> out;
  for (int l = 0; l < bands; ++l)
    for (int k = l * l; k < (l + 1) * (l + 1); ++k) out.push_back(float(cosineCoefficient(l) * Y[size_t(k)]));
  return out;
}

TEST(OcclusionFactor, IsWhatAnOpenPlaceHasMore) {
  EXPECT_NEAR(occlusionFactor(kOpen), 0.0, 1e-15);
  EXPECT_EQ(occlusionFactor(0.0), 1.0);
  EXPECT_NEAR(occlusionFactor(0.5 * kOpen), 0.5, 1e-15);
  EXPECT_EQ(occlusionFactor(1.1 * kOpen), 0.0);  // estimates may be beyond both
  EXPECT_EQ(occlusionFactor(-0.1), 1.0);
  double last = 1;
  for (double t = 0; t < 1.2; t += 0.01) {
    EXPECT_LE(occlusionFactor(t * kOpen), last);
    last = occlusionFactor(t * kOpen);
  }
}

TEST(OcclusionFactor, TowardsADirectionIsZeroInTheOpenAndOneWhereNothingIsSeen) {
  const DVec3 normal = glm::normalize(DVec3(0.3, 0.8, -0.5));
  for (const int bands : {2, 5, 8}) {
    std::vector<float> transfer = openTransfer(normal, bands);
    const std::vector<float> none(transfer.size(), 0.0f);
    for (uint32_t k = 0; k < 60; ++k) {
      const double y = 1 - 2 * (k + 0.5) / 60, r = std::sqrt(1 - y * y), a = 2.399963 * k;
      const DVec3 d(r * std::cos(a), y, r * std::sin(a));
      EXPECT_NEAR(occlusionTowards(transfer, bands, normal, d), 0.0, 1e-5);
      EXPECT_EQ(occlusionTowards(none, bands, normal, d), 1.0);
      std::vector<float> quarter = transfer;
      for (float& t : quarter) t *= 0.25f;
      EXPECT_NEAR(occlusionTowards(quarter, bands, normal, d), 0.75, 1e-5);
    }
  }
  // A hemisphere whose half is hidden: near 0 in the other half's middle, near 1 in its own.
  const int bands = 8;
  std::vector<float> half(64, 0.0f);
  std::vector<double> Y(64);
  constexpr int n = 200;
  for (int v = 0; v < n / 2; ++v)
    for (int u = 0; u < 2 * n; ++u) {
      const double theta = (v + 0.5) * std::numbers::pi / n, phi = (u + 0.5) * std::numbers::pi / n;
      const DVec3 d(std::sin(theta) * std::cos(phi), std::cos(theta), std::sin(theta) * std::sin(phi));
      if (d.x < 0) continue;
      harmonics(d, bands, Y.data());
      for (size_t h = 0; h < 64; ++h) half[h] += float(Y[h] * d.y * std::sin(theta) * std::pow(std::numbers::pi / n, 2));
    }
  const DVec3 up(0, 1, 0), open = glm::normalize(DVec3(1, 1, 0)), closed = glm::normalize(DVec3(-1, 1, 0));
  EXPECT_NEAR(occlusionFactor(double(half[0])), 0.5, 1e-3);
  EXPECT_LT(occlusionTowards(half, bands, up, open), 0.1);
  EXPECT_GT(occlusionTowards(half, bands, up, closed), 0.9);
  EXPECT_NEAR(occlusionTowards(half, bands, up, up), 0.5, 1e-3);
  EXPECT_NEAR(occlusionTowards(half, bands, up, DVec3(1, 0, 0)), 0.5, 1e-3);   // grazing: the hemisphere's
  EXPECT_NEAR(occlusionTowards(half, bands, up, DVec3(0, -1, 0)), 0.5, 1e-3);  // below
  // Just above the horizon too, where the cut lobe has less than a twentieth of its top left.
  for (const double side : {-1.0, 1.0}) EXPECT_EQ(occlusionTowards(half, bands, up, glm::normalize(DVec3(side, 0.002, 0))), occlusionFactor(double(half[0])));
}

TEST(OcclusionFactor, BlendsFromNoShadowToAllOfIt) {
  for (const double v : {0.0, 0.3, 1.0}) {
    EXPECT_EQ(blendedVisibility(v, 0.0), 1.0);
    EXPECT_NEAR(blendedVisibility(v, 1.0), v, 1e-15);
    double last = 2;
    for (double o = 0; o <= 1.0; o += 0.125) {
      const double seen = blendedVisibility(v, o);
      EXPECT_LE(seen, last);
      EXPECT_GE(seen, v - 1e-15);
      EXPECT_LE(seen, 1.0);
      last = seen;
    }
  }
  EXPECT_EQ(blendedVisibility(0.0, 0.25), 0.75);
}

/// A box on a floor before a wall without end, from above.
struct Yard {
  static constexpr int kWidth = 40, kHeight = 28, kBands = 4;
  ScenePtr scene;
  TaskArena arena{2};
  TermPtr g, surface, places, direct;
  AccelPtr accel;

  Yard() {
    SceneMaker m;
    const int grey = m.material(Vec3(0.5f));
    m.instance(m.mesh(gobo::tests::ground(4.0f), grey));
    m.instance(m.mesh(gobo::tests::quad(Vec3(-400, 0, -2), Vec3(800, 0, 0), Vec3(0, 400, 0)), grey));
    m.instance(m.mesh(gobo::tests::box(Vec3(-0.5f, 0.0f, -0.5f), Vec3(0.5f, 1.0f, 0.5f)), grey));
    m.camera(Vec3(0.0f, 6.0f, 4.0f), Vec3(0, 0, -0.3f), 0.9f);
    scene = m.finish();
    gobo::tests::NodeRunner run(*scene, arena);
    GBufferSettings view;
    view.camera = scene->cameras[0];
    view.width = kWidth;
    view.height = kHeight;
    view.viewSamples = 1;
    g = run(makeGBufferNode(view), {});
    surface = run(makeSurfaceNode(view), {g});
    const std::vector<int> none;
    TransferSettings s;
    s.points = 6000;
    s.bands = kBands;
    s.size = uint32_t(receiverMesh(SceneView(*scene, ReceiverMesh::kFacets, none), s.points)->size());
    const TermPtr points = run(makeTransferPointsNode(s), {});
    for (uint32_t b = 0; b < 4; ++b) direct = run(makeDirectTransferNode(s, b), b == 0 ? std::vector{points} : std::vector{points, direct});
    places = run(makeTransferPlacesNode(s, view), {g, points});
    accel = Accel::build(SceneView(*scene, kAccelFacets, none), arena);
  }
  std::vector<DVec3> irradiance(const std::vector<double>& harmonics, const std::vector<PublishedLight>& lights, ShadowBlend blend, int threads = 2,
                                const StopToken& stop = {}) const {
    return publishedIrradiance(harmonics, lights, {*g, *surface, *places, *direct, kBands}, *accel, blend, TaskArena(threads), stop);
  }
};
PublishedLight lightFrom(const DVec3& direction, const DVec3& irradiance) {
  PublishedLight light;
  light.direction = glm::normalize(direction);
  light.irradiance = irradiance;
  return light;
}

TEST(OcclusionFactor, AViewIsLitBetweenItsHardShadowAndNone) {
  const Yard yard;
  const std::vector<double> dark(3 * 16, 0.0);
  const std::vector<PublishedLight> lights{lightFrom(DVec3(1, 1, 0.2), DVec3(3, 2, 1)), lightFrom(DVec3(-0.4, 1, 0.6), DVec3(1, 1, 1))};
  const auto hard = yard.irradiance(dark, lights, ShadowBlend::Hard), hemisphere = yard.irradiance(dark, lights, ShadowBlend::Hemisphere),
             towards = yard.irradiance(dark, lights, ShadowBlend::Towards);
  const auto instance = yard.g->plane<uint32_t>("instance");
  const auto N = yard.surface->floats("N"), P = yard.g->floats("P");
  ASSERT_EQ(hard.size(), instance.size());
  int shadowed = 0, foot = 0, open = 0;
  for (size_t i = 0; i < hard.size(); ++i) {
    if (instance[i] == kNoHit) {
      EXPECT_EQ(hard[i], DVec3(0.0));
      continue;
    }
    DVec3 whole(0.0);
    for (const PublishedLight& light : lights)
      whole += std::max(glm::dot(DVec3(N[3 * i], N[3 * i + 1], N[3 * i + 2]), light.direction), 0.0) * light.irradiance;
    for (const auto* soft : {&hemisphere, &towards}) {
      EXPECT_GE((*soft)[i].x, hard[i].x - 1e-12);
      EXPECT_LE((*soft)[i].x, whole.x + 1e-12);
    }
    const bool floor = N[3 * i + 1] > 0.9f && P[3 * i + 1] < 0.01f;
    shadowed += hard[i].x < whole.x - 0.5;
    if (floor && P[3 * i + 2] < -1.85f && std::fabs(P[3 * i]) > 1.5f) {  // at the wall half of the sky is seen
      ++foot;
      const DVec3 missing = whole - hard[i], given = hemisphere[i] - hard[i];
      if (missing.x > 0.1) { EXPECT_NEAR(given.x / missing.x, 0.5, 0.06); }
    }
    if (floor && P[3 * i + 2] > 2.0f) {  // far from both
      ++open;
      EXPECT_NEAR(hemisphere[i].x, whole.x, 1e-9);
    }
  }
  EXPECT_GT(shadowed, 10);
  EXPECT_GT(foot, 0);
  EXPECT_GT(open, 10);
}

// A light behind the wall: at its foot half of the sky is seen, so half of the light is given.
TEST(OcclusionFactor, AtTheFootOfAWallHalfOfItsShadowIsDrawn) {
  const Yard yard;
  const std::vector<double> dark(3 * 16, 0.0);
  const std::vector<PublishedLight> lights{lightFrom(DVec3(0, 1, -1), DVec3(2, 2, 2))};
  const auto hard = yard.irradiance(dark, lights, ShadowBlend::Hard), hemisphere = yard.irradiance(dark, lights, ShadowBlend::Hemisphere);
  const auto instance = yard.g->plane<uint32_t>("instance");
  const auto N = yard.surface->floats("N"), P = yard.g->floats("P");
  int foot = 0;
  for (size_t i = 0; i < hard.size(); ++i) {
    if (instance[i] == kNoHit || !(N[3 * i + 1] > 0.9f && P[3 * i + 1] < 0.01f && P[3 * i + 2] < -1.85f && std::fabs(P[3 * i]) > 1.5f)) continue;
    ++foot;
    EXPECT_EQ(hard[i], DVec3(0.0));
    EXPECT_NEAR(hemisphere[i].x / (2 * std::sqrt(0.5)), 0.5, 0.06);
  }
  EXPECT_GT(foot, 3);
}

// Harmonics are added before anything is cut off, and what is left below 0 is dark.
TEST(OcclusionFactor, NoLightIsNegative) {
  const Yard yard;
  std::vector<double> sky(3 * 16, 0.0);
  sky[0] = sky[1] = std::sqrt(4 * std::numbers::pi);  // red 1, green 1
  sky[1] *= -0.5;
  const std::vector<PublishedLight> lights{lightFrom(DVec3(0, 1, 0.4), DVec3(1, 1, 0))};
  const auto lit = yard.irradiance(sky, lights, ShadowBlend::Towards), harmonicsAlone = yard.irradiance(sky, {}, ShadowBlend::Hard);
  int dark = 0;
  double brightest = 0;
  for (size_t i = 0; i < lit.size(); ++i) {
    for (int c = 0; c < 3; ++c) EXPECT_TRUE(std::isfinite(lit[i][c]) && lit[i][c] >= 0);
    EXPECT_EQ(harmonicsAlone[i].y, 0.0);
    brightest = std::max(brightest, harmonicsAlone[i].x);
    dark += lit[i].y == 0 && lit[i].x > 0;
  }
  EXPECT_NEAR(brightest, std::numbers::pi, 0.05);  // the open floor
  EXPECT_GT(dark, 5);                              // -pi / 2 under a light of 1
}

TEST(OcclusionFactor, HasTheSameBitsForAnyNumberOfThreadsAndStops) {
  const Yard yard;
  const std::vector<double> dark(3 * 16, 0.1);
  const std::vector<PublishedLight> lights{lightFrom(DVec3(1, 1, 0.2), DVec3(3, 2, 1))};
  const auto one = yard.irradiance(dark, lights, ShadowBlend::Towards, 1), two = yard.irradiance(dark, lights, ShadowBlend::Towards, 2);
  ASSERT_EQ(one.size(), two.size());
  EXPECT_EQ(std::memcmp(one.data(), two.data(), one.size() * sizeof(DVec3)), 0);
  StopSource source;
  source.stop(StopReason::Cancelled);
  EXPECT_TRUE(yard.irradiance(dark, lights, ShadowBlend::Hard, 2, source.token()).empty());
}

}  // namespace
}  // namespace gobo::transfer::published::occlusion_test
