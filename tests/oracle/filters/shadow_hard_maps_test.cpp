// SPDX-License-Identifier: Apache-2.0
// Hard-edged maps against shadow rays on built-in scenes; bias; cube maps at their seams; what only filtering the test, not the depth, can do.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "base/sobol.h"
#include "filters/shadow_map/light_frame.h"
#include "filters/shadow_map/shadow_map.h"
#include "scene/load.h"
#include "support/shadow_stage.h"
#include "support/thorough.h"
#include "support/tiny_scenes.h"

namespace gobo::test {
namespace {

bool soft(const std::string& name) { return name.find("soft") != std::string::npos; }

ScenePtr withLight(const ScenePtr& scene, const LightShape& shape) {
  auto copy = std::make_shared<Scene>(*scene);
  Light l;
  l.name = "tested";
  l.shape = shape;
  copy->lights.assign(1, l);
  copy->environment = nullptr;
  const Status sealed = copy->seal();
  GOBO_CHECK(sealed.ok());
  return copy;
}

struct Agreement {
  int judged = 0, off = 0;
  double share() const { return double(judged - off) / std::max(judged, 1); }
};
// Pixels that face the light, away from edges of the ray-traced shadow: their neighbours agree on it.
Agreement agreement(const ShadowRun& map, const ShadowRun& truth, const LightShape& light, int width, int height) {
  Agreement a;
  for (int y = 1; y + 1 < height; ++y)
    for (int x = 1; x + 1 < width; ++x) {
      const size_t i = size_t(y) * size_t(width) + size_t(x);
      if (!map.surface(i)) continue;
      const Vec3 to = light.kind == LightKind::Directional ? -light.axis : glm::normalize(light.position - map.at("P", i));
      if (glm::dot(to, map.at("N", i)) < 0.1f || glm::dot(to, map.at("Ng", i)) < 0.1f) continue;
      bool edge = false;
      for (int dy = -1; dy <= 1; ++dy)
        for (int dx = -1; dx <= 1; ++dx) edge |= truth.V()[i + size_t(dy * width + dx)] != truth.V()[i];
      if (edge) continue;
      ++a.judged;
      a.off += std::fabs(map.V()[i] - truth.V()[i]) > 0.1f;
    }
  return a;
}

// 97 %: at 1024 texels a pixel's footprint is a texel or so, and thin pickets and contacts are narrower than the pre-filter.
TEST(HardShadowMaps, AgreeWithShadowRaysOnBuiltInScenes) {
  struct Case {
    const char* scene;
    LightShape light;
  };
  std::vector<Case> cases;
  LightShape sun, point, spot;
  sun.kind = LightKind::Directional;
  sun.axis = -glm::normalize(Vec3(0.75f, 0.9f, -0.8f));
  cases.push_back({"fence", sun});
  point.position = Vec3(0.3f, 1.5f, 0.4f);
  cases.push_back({"cornell", point});
  spot.kind = LightKind::Spot;
  spot.axis = glm::normalize(Vec3(-0.2f, -1, -0.3f));
  spot.cosOuter = std::cos(0.8f);
  spot.position = Vec3(0.3f, 1.8f, 0.5f);
  cases.push_back({"cornell", spot});
  spot.position = Vec3(-2.5f, 5.0f, 2.0f);
  spot.axis = glm::normalize(-spot.position);
  cases.push_back({"spheres", spot});
  point.position = Vec3(0.2f, 2.2f, 0.3f);
  cases.push_back({"lamps", point});
  const ShadowPicture picture{160, 112};
  const std::vector<NamedTechnique> techniques = mapTechniques();
  for (size_t i = 0; i < cases.size(); ++i) {
    const Case& c = cases[i];
    const ScenePtr scene = withLight(*makeBuiltinScene(c.scene), c.light);
    const ShadowRun truth = runShadow(scene, rayTraced(), picture);
    for (size_t k = 0; k < techniques.size(); ++k) {
      const NamedTechnique& t = techniques[k];
      if (soft(t.name)) continue;
      if (!testing::thorough() && i > 0 && (i + k) % 2 == 0) continue;  // every technique under every kind of light: two cases of points and of spots
      const ShadowRun r = runShadow(scene, t.technique, picture);
      ASSERT_TRUE(r.ok()) << t.name << ": " << r.status.toString();
      for (float v : r.V()) ASSERT_TRUE(v >= 0.0f && v <= 1.0f) << t.name;
      const Agreement a = agreement(r, truth, c.light, picture.width, picture.height);
      std::printf("%-8s kind %d %-22s %.2f %% of %d pixels within 0.1 of rays\n", c.scene, int(c.light.kind), t.name.c_str(), 100 * a.share(), a.judged);
      EXPECT_GT(a.judged, 500) << c.scene;
      EXPECT_GT(a.share(), 0.97) << c.scene << " " << t.name;
    }
  }
}

TEST(HardShadowMaps, ThreadsChangeNoBit) {
  LightShape point;
  point.position = Vec3(0.3f, 1.5f, 0.4f);
  const ScenePtr scene = withLight(*makeBuiltinScene("cornell"), point);
  for (NamedTechnique& t : mapTechniques()) {
    if (!findShadowTechnique(t.technique.technique_case())->supports(LightKind::Point)) continue;  // soft ones have tests of their own
    t.technique.mutable_map()->set_resolution(200);
    const ShadowRun one = runShadow(scene, t.technique, {70, 50, 1}), seven = runShadow(scene, t.technique, {70, 50, 7});
    ASSERT_TRUE(one.ok()) << t.name << ": " << one.status.toString();
    EXPECT_EQ(one.terms[size_t(one.visibility)]->content(), seven.terms[size_t(seven.visibility)]->content()) << t.name;
  }
}

// --- bias (digest 3.2) ----------------------------------------------------------------------------------------------------------------------

/// Only a plane, tilted about z, the sun above it: every pixel is lit.
ScenePtr tiltedPlane(float degrees) {
  tests::SceneMaker s;
  const float a = degrees * kPi / 180.0f;
  const Vec3 along(std::cos(a), std::sin(a), 0);
  s.instance(s.mesh(tests::quad(-3.0f * along + Vec3(0, 0, 3), 6.0f * along, Vec3(0, 0, -6)), s.material(Vec3(0.5f))));
  s.instance(s.mesh(tests::quad(Vec3(-3, 3, 3), Vec3(0.01f, 0, 0), Vec3(0, 0, -0.01f)), 0));  // a range of 6 m at every tilt
  s.instance(s.mesh(tests::quad(Vec3(-3, -3, 3), Vec3(0.01f, 0, 0), Vec3(0, 0, -0.01f)), 0));
  LightShape sun;
  sun.kind = LightKind::Directional;
  sun.axis = glm::normalize(Vec3(0.03f, -1, 0.02f));
  s.light(sun);
  s.camera(5.0f * Vec3(-std::sin(a), std::cos(a), 0.2f), Vec3(0.0f), 0.6f);
  return s.finish();
}

TEST(ShadowBias, SlopeBiasRemovesAcneAtEveryTilt) {
  struct Setting {
    const char* name;
    double bias, slope;
  };
  const Setting settings[] = {{"none", 0, 0}, {"constant 0.0005", 0.0005, 0}, {"slope 1", 0, 1}, {"both (default)", 0.0005, 1}};
  for (const char* name : {"shadow_map", "percentage_closer"})
    for (const Setting& s : settings) {
      std::printf("%-18s bias %-16s acne pixels of 3072 at 0, 10 .. 80 deg:", name, s.name);
      int total = 0, steep = 0;
      for (int tilt = 0; tilt <= 80; tilt += 10) {
        v1::ShadowTechnique t = mapTechnique(name);
        t.mutable_map()->set_resolution(256);
        t.mutable_map()->set_bias(s.bias);
        t.mutable_map()->set_slope_bias(s.slope);
        const ShadowRun r = runShadow(tiltedPlane(float(tilt)), t);
        int acne = 0;
        for (size_t i = 0; i < r.size(); ++i) acne += r.surface(i) && r.V()[i] < 0.999f;
        std::printf(" %d", acne);
        total += acne;
        if (tilt >= 60) steep += acne;
      }
      std::printf("\n");
      if (s.slope == 0) { EXPECT_GT(steep, 100) << name << ": without slope bias steep planes shadow themselves, or this test shows nothing"; }
      if (s.slope > 0 && s.bias > 0) { EXPECT_EQ(total, 0) << name; }
    }
}

// A card that stands on the floor: its shadow must begin at its foot. At x behind it the card is x sqrt(2) nearer to the sun, so a bias of b lights
// x < b / sqrt(2); a texel or two more by the depth's own sampling.
TEST(ShadowBias, ContactShadowsBeginAtTheFoot) {
  for (double bias : {0.0005, 0.005, 0.02}) {
    tests::SceneMaker s;
    const int grey = s.material(Vec3(0.5f));
    s.instance(s.mesh(tests::ground(3.0f), grey));
    s.instance(s.mesh(tests::quad(Vec3(0, 0, 0.5f), Vec3(0, 0, -1), Vec3(0, 1, 0)), grey));
    LightShape sun;
    sun.kind = LightKind::Directional;
    sun.axis = glm::normalize(Vec3(1, -1, 0));
    s.light(sun);
    s.camera(Vec3(0.5f, 5, 0.01f), Vec3(0.5f, 0, 0), 0.5f);
    const ScenePtr scene = s.finish();
    v1::ShadowTechnique t = mapTechnique("shadow_map");
    t.mutable_map()->set_resolution(512);
    t.mutable_map()->set_bias(bias);
    const ShadowRun r = runShadow(scene, t, {201, 201});
    Vec3 lo, hi;
    scene->bounds(lo, hi);
    const LightFrame f = *fitLightFrame(scene->lights[0].shape, lo, hi, 512, 1);
    const double range = f.far - f.near, texel = (f.hi.x - f.lo.x) / 512.0;
    double detached = 0;
    for (int x = 0; x < 201; ++x) {
      const size_t i = size_t(100) * 201 + size_t(x);
      const Vec3 p = r.at("P", i);
      if (p.y < 1e-3f && p.x > 1e-3f && p.x < 0.9f && r.V()[i] > 0.5f) detached = std::max(detached, double(p.x));
    }
    const double slopeBias = 0.5 * texel * (1.0 + 1.0);  // the floor's depth changes one for one along the map's axes together
    const double bound = (bias * range + slopeBias) / std::sqrt(2.0) + 2.0 * texel;
    std::printf("bias %.4f of %.2f m: shadow detached %.4f m, bound %.4f m (texel %.4f m)\n", bias, range, detached, bound, texel);
    EXPECT_LE(detached, bound) << bias;
    if (bias > 0.01) { EXPECT_GT(detached, 0.25 * bias * range / std::sqrt(2.0)) << "a large bias does detach: the figure is measured"; }
  }
}

// --- cube maps -------------------------------------------------------------------------------------------------------------------------------

// A room's inner walls around a point light at its middle: rays from the light cross all twelve seams on smooth walls. Nothing shades, so anything below 1 is
// a seam or acne.
TEST(CubeShadowMaps, SmoothWallsShowNoSeam) {
  for (LightKind kind : {LightKind::Point, LightKind::Sphere}) {
    tests::SceneMaker s;
    const int grey = s.material(Vec3(0.5f));
    s.instance(s.mesh(tests::sphere(Vec3(0.0f), 2.0f, 24, false), grey));
    LightShape light;
    light.kind = kind;
    light.radius = 0.05f;
    s.light(light);
    for (const Vec3& to : {Vec3(1, 1, 0), Vec3(-1, 0.9f, 1), Vec3(0.1f, -1, -1), Vec3(1, -1, 1)}) {
      s.camera(-0.4f * to, to, 1.4f);
      const ScenePtr scene = s.finish();
      for (NamedTechnique& t : mapTechniques()) {
        if (soft(t.name)) continue;
        for (int blur : {0, 1, 4}) {
          t.technique.mutable_map()->set_resolution(128);
          t.technique.mutable_map()->set_blur(uint32_t(blur));
          t.technique.mutable_map()->set_bias(0.01);
          const ShadowRun r = runShadow(scene, t.technique, {64, 64});
          ASSERT_TRUE(r.ok()) << t.name << ": " << r.status.toString();
          float least = 1, across = 0;
          for (size_t i = 0; i < r.size(); ++i) {
            if (!r.surface(i)) continue;
            least = std::min(least, r.V()[i]);
            const Vec3 p = r.at("P", i);
            const Vec3 a(std::fabs(p.x), std::fabs(p.y), std::fabs(p.z));
            const float first = std::max({a.x, a.y, a.z}), second = a.x + a.y + a.z - first - std::min({a.x, a.y, a.z});
            across = std::max(across, second / first);
          }
          EXPECT_GT(across, 0.99f) << "no seam in this picture";
          // Bound: the filter's spread of depth on a facetted sphere, at 128 texels of 90 degrees.
          EXPECT_GT(least, 0.95f) << t.name << " blur " << blur << " kind " << int(kind);
        }
      }
    }
  }
}

// A thin wall whose plane is the seam between two faces (x = z): what is behind it is dark on both sides of the seam, what is before it lit.
TEST(CubeShadowMaps, AThinWallOnASeamCastsOneShadow) {
  tests::SceneMaker s;
  const int grey = s.material(Vec3(0.5f));
  s.instance(s.mesh(tests::ground(4.0f), grey));
  const Vec3 across = glm::normalize(Vec3(-1, 0, 1));
  s.instance(s.mesh(tests::quad(Vec3(1, 0, 1) - 0.7f * across, 1.4f * across, Vec3(0, 1.5f, 0)), grey));  // square to the diagonal, centred on the seam
  s.instance(s.mesh(tests::quad(Vec3(-1, 0, -1), Vec3(-1, 0, -1), Vec3(0, 1.5f, 0)), grey));              // along the seam of -x and -z: seen edge on
  LightShape point;
  point.position = Vec3(0, 1, 0);
  s.light(point);
  s.camera(Vec3(0.5f, 9, 0.4f), Vec3(0, 0, 0), 0.9f);
  const ScenePtr scene = s.finish();
  const ShadowPicture picture{120, 120};
  const ShadowRun truth = runShadow(scene, rayTraced(), picture);
  for (NamedTechnique& t : mapTechniques()) {
    if (soft(t.name)) continue;
    t.technique.mutable_map()->set_resolution(512);
    const ShadowRun r = runShadow(scene, t.technique, picture);
    const Agreement a = agreement(r, truth, point, 120, 120);
    int seam = 0, off = 0;
    for (size_t i = 0; i < r.size(); ++i) {  // floor behind the first wall, within two texels of the seam
      const Vec3 p = r.at("P", i);
      if (!r.surface(i) || p.y > 1e-3f || !(p.x > 1.2f && p.z > 1.2f) || std::fabs(p.x - p.z) > 0.08f * p.x) continue;
      ++seam;
      off += r.V()[i] > 0.1f;
    }
    EXPECT_GT(seam, 10);
    EXPECT_EQ(off, 0) << t.name;
    EXPECT_GT(a.share(), 0.97) << t.name;
  }
}

// Taps of any filter that a receiver's own face can be asked for lie inside that face.
TEST(CubeShadowMaps, FiltersNeverMeetASeam) {
  LightShape point;
  point.position = Vec3(0.2f, 0.1f, -0.3f);
  for (int side : {32, 128, 1000})
    for (int rim : {0, 1, 5}) {
      const LightFrames frames = *fitLightFrames(point, Vec3(-2), Vec3(2), side, rim);
      for (const LightFrame& f : frames.face) {
        const double texel = (double(f.hi.x) - f.lo.x) / side;
        if (side <= 4 * (rim + 1)) continue;
        EXPECT_GE((double(f.hi.x) - 1.0) / texel, rim + 1 - 1e-3) << side << " " << rim;  // tangent 1 is the seam
        EXPECT_GE((-1.0 - double(f.lo.x)) / texel, rim + 1 - 1e-3);
      }
    }
}

// --- filtering the test, not the depth (thesis 5.2, digest 3.4) -----------------------------------------------------------------------------------

// A blurred depth map stays a binary shadow whose edge has moved; percentage-closer filtering of the same depth is a ramp.
TEST(BlurredDepth, StaysBinaryWherePercentageCloserDoesNot) {
  constexpr int kSide = 64, kRadius = 4;
  std::vector<float> z(size_t(kSide) * kSide), blurred(z.size());
  for (size_t i = 0; i < z.size(); ++i) z[i] = i % kSide < kSide / 2 ? 0.2f : 1.0f;
  const std::vector<float> w = shadowGaussian(kRadius);
  for (int y = 0; y < kSide; ++y)
    for (int x = 0; x < kSide; ++x) {
      float sum = 0;
      for (int k = -kRadius; k <= kRadius; ++k) sum += w[size_t(k + kRadius)] * z[size_t(y) * kSide + size_t(std::clamp(x + k, 0, kSide - 1))];
      blurred[size_t(y) * kSide + size_t(x)] = sum;
    }
  const auto lookup = [&](const std::vector<float>& depth, bool hard) {
    auto map = std::make_shared<Term>("light_depth_map", Domain::LightTexel, Extent{kSide, kSide, 1});
    std::copy(depth.begin(), depth.end(), map->addPlane<float>("z").begin());
    auto g = std::make_shared<Term>("gbuffer", Domain::ViewSample, Extent{kSide, 1, 1});
    auto P = g->addPlane<float>("P", 3), N = g->addPlane<float>("N", 3), Ng = g->addPlane<float>("Ng", 3);
    g->addPlane<uint32_t>("instance");
    for (int x = 0; x < kSide; ++x) {
      P[3 * size_t(x)] = (float(x) + 0.5f) / kSide;
      P[3 * size_t(x) + 1] = 0.5f;
      P[3 * size_t(x) + 2] = 0.7f;
      N[3 * size_t(x) + 2] = Ng[3 * size_t(x) + 2] = -1.0f;
    }
    PercentageCloserLookup l;
    l.frames.face[0].lo = Vec2(0.0f);
    l.frames.face[0].hi = Vec2(1.0f);
    l.map.resolution = kSide;
    l.map.blur = kRadius;
    l.pattern = v1::PercentageCloserShadow::GAUSSIAN;
    l.hard = hard;
    const TaskArena arena(1);
    RunContext ctx;
    ctx.arena = &arena;
    ctx.inputs = {map};
    const TermPtr bounds = *runNode(*makeDepthBoundsNode(kSide, 1), ctx);
    ctx.inputs = {g, bounds};
    const TermPtr V = *runNode(*makePercentageCloserNode(l), ctx);
    return std::vector<float>(V->floats("V").begin(), V->floats("V").end());
  };
  const auto between = [](const std::vector<float>& V) { return std::count_if(V.begin(), V.end(), [](float v) { return v > 0.0f && v < 1.0f; }); };
  EXPECT_EQ(between(lookup(z, true)), 0);
  EXPECT_EQ(between(lookup(blurred, true)), 0) << "the blurred map's shadow is as hard";
  EXPECT_NE(lookup(blurred, true), lookup(z, true)) << "only its edge has moved";
  EXPECT_GE(between(lookup(z, false)), 2 * kRadius);
}

// --- the occlusion plot (thesis figure 3.2) ---------------------------------------------------------------------------------------------------------

// One row over the penumbra of a half plane at height h under a strip light of width w at height H: visibility is a ramp of width w h / (H - h), so its slope
// says how far the blocker is. The map's hard shadow steps at its middle.
TEST(OcclusionPlot, TheRampsSlopeIsTheBlockersDistance) {
  const float H = 10, w = 0.5f;
  for (float h : {1.0f, 2.5f, 5.0f}) {
    tests::SceneMaker s;
    const int grey = s.material(Vec3(0.5f));
    s.instance(s.mesh(tests::ground(8.0f), grey));
    s.instance(s.mesh(tests::quad(Vec3(0, h, 6), Vec3(6, 0, 0), Vec3(0, 0, -12)), grey));
    LightShape rect;
    rect.kind = LightKind::Rect;
    rect.position = Vec3(0, H, 0);
    rect.axis = Vec3(0, -1, 0);
    rect.u = Vec3(0.5f * w, 0, 0);
    rect.v = Vec3(0, 0, -0.01f);
    s.light(rect);
    s.camera(Vec3(0, 0.5f * h, 0), Vec3(0.0f), 2.0f * std::atan(1.5f * 0.0025f / (0.5f * h)));  // 2.5 mm a pixel
    const ScenePtr scene = s.finish();
    const ShadowPicture picture{801, 3};
    const ShadowRun rays = runShadow(scene, rayTraced(256), picture);
    v1::ShadowTechnique hard = mapTechnique("shadow_map");
    hard.mutable_map()->set_resolution(2048);
    const ShadowRun map = runShadow(scene, hard, picture);
    double x10 = 0, x90 = 0, step = 0;
    for (size_t x = 801; x + 1 < 1602; ++x) {
      const double px = rays.at("P", x).x, next = rays.at("P", x + 1).x;
      if (rays.at("P", x).y > 1e-3f || std::fabs(px) > 2.0) continue;
      const auto crosses = [&](const ShadowRun& r, float level) { return r.V()[x] >= level && r.V()[x + 1] < level; };
      if (crosses(rays, 0.9f)) x90 = 0.5 * (px + next);
      if (crosses(rays, 0.1f)) x10 = 0.5 * (px + next);
      if (crosses(map, 0.5f)) step = 0.5 * (px + next);
    }
    const double ramp = (x10 - x90) / 0.8, expected = w * h / (H - h);
    std::printf("blocker at %.1f m: ramp %.4f m, %.4f by similar triangles; the map's step at %.4f m\n", h, ramp, expected, step);
    EXPECT_NEAR(ramp, expected, 0.05 * expected + 0.003);  // and a pixel of either level
    EXPECT_NEAR(step, 0.0, 0.02);
  }
}

// --- temporal coherence (thesis 6.3, 7.5) ----------------------------------------------------------------------------------------------------------------

// The fence from afar, its map finer than the pixels: 32 sub-pixel jitters of the camera. A comparison flickers; reading by the pixel's footprint does not.
TEST(TemporalCoherence, FootprintLookupsFlickerLessThanComparisons) {
  LightShape sun;
  sun.kind = LightKind::Directional;
  sun.axis = -glm::normalize(Vec3(0.75f, 0.9f, -0.8f));
  auto far = std::make_shared<Scene>(*withLight(*makeBuiltinScene("fence"), sun));
  const Camera camera = far->cameras[0];
  const ShadowPicture picture{40, 28};
  struct Setting {
    const char* name;
    v1::ShadowMapSettings::Lookup lookup;
  };
  const Setting settings[] = {{"shadow_map", v1::ShadowMapSettings::BILINEAR},
                              {"percentage_closer", v1::ShadowMapSettings::BILINEAR},
                              {"variance", v1::ShadowMapSettings::TRILINEAR},
                              {"variance", v1::ShadowMapSettings::ANISOTROPIC},
                              {"convolution", v1::ShadowMapSettings::ANISOTROPIC}};
  std::vector<double> deviations;
  for (const Setting& s : settings) {
    v1::ShadowTechnique t = mapTechnique(s.name);
    t.mutable_map()->set_resolution(512);
    t.mutable_map()->set_lookup(s.lookup);
    if (std::string(s.name) == "convolution") t.mutable_convolution()->set_order(8);
    std::vector<double> sum(size_t(picture.width * picture.height)), squares(sum.size());
    std::vector<int> seen(sum.size());
    for (int k = 0; k < 32; ++k) {
      auto moved = std::make_shared<Scene>(*far);
      moved->cameras[0] = camera;
      moved->cameras[0].centre += Vec2(toUnit(hash32(1, k)) - 0.5f, toUnit(hash32(2, k)) - 0.5f) / float(picture.height);
      const ShadowRun r = runShadow(moved, t, picture);
      for (size_t i = 0; i < r.size(); ++i) {
        if (!r.surface(i) || r.at("P", i).y > 0.01f) continue;  // the ground
        ++seen[i];
        sum[i] += r.V()[i];
        squares[i] += double(r.V()[i]) * r.V()[i];
      }
    }
    double variance = 0;
    int pixels = 0;
    for (size_t i = 0; i < sum.size(); ++i) {
      if (seen[i] < 32) continue;
      ++pixels;
      variance += squares[i] / 32 - (sum[i] / 32) * (sum[i] / 32);
    }
    ASSERT_GT(pixels, 200);
    deviations.push_back(std::sqrt(variance / pixels));
    std::printf("%-18s lookup %d: RMS flicker of visibility %.4f over %d pixels\n", s.name, int(s.lookup), deviations.back(), pixels);
  }
  for (size_t i = 2; i < deviations.size(); ++i) EXPECT_LT(deviations[i], 0.75 * deviations[0]) << settings[i].name;
}

}  // namespace
}  // namespace gobo::test
