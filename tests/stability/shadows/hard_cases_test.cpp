// SPDX-License-Identifier: Apache-2.0
// Hard cases of shadow maps, each over every technique of the registry that reads one: finite, in [0,1], lit where nothing blocks, dark behind a closed
// blocker, and the bound that the case has.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <set>

#include "base/sobol.h"
#include "filters/shadow_map/shadow_map.h"
#include "support/engines.h"
#include "support/shadow_stage.h"
#include "support/thorough.h"
#include "support/tiny_scenes.h"

namespace gobo::test {
namespace {

using tests::SceneMaker;

bool soft(const std::string& name) { return name.find("soft") != std::string::npos; }

LightShape lightOf(LightKind kind, const Vec3& position = Vec3(0, 6, 0), const Vec3& axis = Vec3(0, -1, 0)) {
  LightShape l;
  l.kind = kind;
  l.position = position;
  l.axis = glm::normalize(axis);
  l.cosOuter = std::cos(0.9f);
  l.cosInner = std::cos(0.8f);
  l.radius = 0.05f;
  const Frame f(l.axis);
  l.u = 0.05f * f.x;
  l.v = 0.05f * f.y;
  return l;
}
/// As a technique wants it: soft ones a sun of some size.
LightShape lightFor(const std::string& technique, LightKind kind, const Vec3& position = Vec3(0, 6, 0), const Vec3& axis = Vec3(0, -1, 0)) {
  LightShape l = lightOf(kind, position, axis);
  if (soft(technique) && kind == LightKind::Directional) l.angularSize = 0.02f;
  return l;
}

/// Techniques and the light kinds that they are tried on: soft ones on area lights, the others on all of them.
struct Try {
  std::string name;
  v1::ShadowTechnique technique;
  LightKind kind;
};
/// `resolution` of the maps; 0: what they are by themselves.
std::vector<Try> tries(uint32_t resolution = 0) {
  std::vector<Try> all;
  for (const NamedTechnique& t : mapTechniques())
    for (LightKind kind : {LightKind::Directional, LightKind::Spot, LightKind::Point, LightKind::Rect, LightKind::Sphere}) {
      if (soft(t.name) && isDeltaLight(lightFor(t.name, kind))) continue;
      if (!findShadowTechnique(t.technique.technique_case())->supports(kind)) continue;
      all.push_back({t.name, t.technique, kind});
      if (resolution > 0) all.back().technique.mutable_map()->set_resolution(resolution);
    }
  return all;
}
/// Which of them a case tries: all, or each technique, each kind of light and a share of the others.
class Share {
 public:
  bool has(const Try& t) {
    const bool technique = techniques_.insert(t.name).second, kind = kinds_.insert(t.kind).second, drawn = testing::inSweep(k_++, 4);
    return technique || kind || drawn;
  }

 private:
  std::set<std::string> techniques_;
  std::set<LightKind> kinds_;
  size_t k_ = 0;
};
std::string label(const Try& t) { return t.name + " on light kind " + std::to_string(int(t.kind)); }

void expectInRange(const ShadowRun& r, const std::string& what) {
  ASSERT_TRUE(r.ok()) << what << ": " << r.status.toString();
  for (float v : r.V()) ASSERT_TRUE(v >= 0.0f && v <= 1.0f) << what << ": " << v;
  for (size_t i = 0; i < r.size(); ++i)
    if (!r.surface(i)) { ASSERT_EQ(r.V()[i], 1.0f) << what << ": no surface"; }
}

/// Smallest and largest V over surfaces that `inside` accepts.
struct Span {
  float lo = 2, hi = -1;
  int count = 0;
};
Span over(const ShadowRun& r, const std::function<bool(const Vec3&)>& inside) {
  Span s;
  for (size_t i = 0; i < r.size(); ++i) {
    if (!r.surface(i) || !inside(r.at("P", i))) continue;
    s.lo = std::min(s.lo, r.V()[i]);
    s.hi = std::max(s.hi, r.V()[i]);
    ++s.count;
  }
  return s;
}
bool everywhere(const Vec3&) { return true; }

/// A floor seen from above at a slant.
SceneMaker floorScene(float half = 2.0f) {
  SceneMaker s;
  s.instance(s.mesh(tests::ground(half), s.material(Vec3(0.5f))));
  s.camera(Vec3(0.2f, 1.2f * half, 1.1f * half), Vec3(0.0f), 0.8f);
  return s;
}

TEST(ShadowHardCases, NothingBlocksAndALidBlocksAll) {
  for (const Try& t : tries(256)) {
    SceneMaker bare = floorScene();
    bare.light(lightFor(t.name, t.kind));
    const ShadowRun lit = runShadow(bare.finish(), t.technique);
    expectInRange(lit, label(t));
    EXPECT_GE(over(lit, everywhere).lo, 0.95f) << label(t);
    SceneMaker closed = floorScene();
    closed.instance(closed.mesh(tests::ground(9.0f, 4.0f), 0));  // above the camera too
    closed.light(lightFor(t.name, t.kind));
    const ShadowRun dark = runShadow(closed.finish(), t.technique);
    expectInRange(dark, label(t));
    EXPECT_LE(over(dark, everywhere).hi, 0.05f) << label(t);
  }
}

TEST(ShadowHardCases, OneTexelMaps) {
  for (Try t : tries()) {
    t.technique.mutable_map()->set_resolution(1);
    for (int blur : {0, 1, 64}) {
      t.technique.mutable_map()->set_blur(uint32_t(blur));
      SceneMaker closed = floorScene(0.5f);
      closed.instance(closed.mesh(tests::ground(9.0f, 4.0f), 0));
      closed.light(lightFor(t.name, t.kind));
      const ShadowRun dark = runShadow(closed.finish(), t.technique);
      expectInRange(dark, label(t));
      if (t.kind == LightKind::Directional || t.kind == LightKind::Spot) { EXPECT_LE(over(dark, everywhere).hi, 0.05f) << label(t) << " blur " << blur; }
      SceneMaker bare = floorScene(0.5f);
      bare.light(lightFor(t.name, t.kind));
      const ShadowRun lit = runShadow(bare.finish(), t.technique);
      expectInRange(lit, label(t));
      EXPECT_GE(over(lit, everywhere).lo, 0.95f) << label(t) << " blur " << blur;
    }
  }
}

TEST(ShadowHardCases, EmptySceneAndLightsThatSeeNothing) {
  for (const Try& t : tries(256)) {
    SceneMaker empty;
    empty.light(lightFor(t.name, t.kind));
    empty.camera(Vec3(0, 2, 3), Vec3(0.0f), 0.8f);
    const ShadowRun none = runShadow(empty.finish(), t.technique);
    expectInRange(none, label(t));
    EXPECT_EQ(none.raysOf("light_depth_map"), 0u) << label(t);
    if (t.kind == LightKind::Directional || t.kind == LightKind::Point || t.kind == LightKind::Sphere) continue;  // they look everywhere
    SceneMaker away = floorScene();
    away.light(lightFor(t.name, t.kind, Vec3(0, 6, 0), Vec3(0.1f, 1, 0)));
    const ShadowRun r = runShadow(away.finish(), t.technique);
    expectInRange(r, label(t));
    EXPECT_EQ(over(r, everywhere).lo, 1.0f) << label(t);
  }
}

// A spot's cone of 12 degrees on a wide floor, a lid everywhere under the light: receivers beyond the frustum have nothing said about them: lit.
TEST(ShadowHardCases, ReceiversOutsideTheFrustum) {
  for (const Try& t : tries()) {
    if (t.kind != LightKind::Spot) continue;
    SceneMaker s = floorScene(4.0f);
    s.instance(s.mesh(tests::quad(Vec3(-3, 5, 3), Vec3(6, 0, 0), Vec3(0, 0, -6)), 0));
    LightShape light = lightOf(LightKind::Spot);
    light.cosOuter = std::cos(0.2f);
    light.cosInner = std::cos(0.1f);
    s.light(light);
    const ShadowRun r = runShadow(s.finish(), t.technique);
    expectInRange(r, label(t));
    const auto radius = [](const Vec3& p) { return std::hypot(p.x, p.z); };
    const Span in = over(r, [&](const Vec3&p) { return p.y < 0.1f && radius(p) < 0.9f; }),
               out = over(r, [&](const Vec3&p) { return p.y < 0.1f && radius(p) > 2.0f; });
    ASSERT_GT(in.count, 5);
    ASSERT_GT(out.count, 5);
    EXPECT_LE(in.hi, 0.05f) << label(t);
    EXPECT_EQ(out.lo, 1.0f) << label(t);
  }
}

// 1 : 1e6 between the nearest caster and the farthest receiver: a chip 0.1 mm below the light shades 10 m of a floor 100 m below.
TEST(ShadowHardCases, DepthRangesOfAMillion) {
  Share share;
  for (Try t : tries()) {
    if (t.kind == LightKind::Directional || soft(t.name) || !share.has(t)) continue;
    SceneMaker s;
    const int grey = s.material(Vec3(0.5f));
    s.instance(s.mesh(tests::ground(60.0f, -100.0f), grey));
    s.instance(s.mesh(tests::quad(Vec3(-5e-6f, -1e-4f, 5e-6f), Vec3(1e-5f, 0, 0), Vec3(0, 0, -1e-5f)), grey));
    LightShape light = lightFor(t.name, t.kind, Vec3(0.0f));
    s.light(light);
    s.camera(Vec3(0, -60, 30), Vec3(0, -100, 0), 0.9f);
    const ShadowRun r = runShadow(s.finish(), t.technique);
    expectInRange(r, label(t));
    const auto reach = [](const Vec3& p) { return std::max(std::fabs(p.x), std::fabs(p.z)); };
    const Span in = over(r, [&](const Vec3&p) { return reach(p) < 3.5f; }), out = over(r, [&](const Vec3&p) { return reach(p) > 7.0f && reach(p) < 40.0f; });
    ASSERT_GT(in.count, 5);
    ASSERT_GT(out.count, 50);
    EXPECT_LE(in.hi, 0.05f) << label(t);
    EXPECT_GE(out.lo, 0.95f) << label(t);
  }
}

// The light sits in a closed box: nothing outside sees it.
TEST(ShadowHardCases, LightInsideGeometry) {
  Share share;
  for (const Try& t : tries()) {
    if (t.kind == LightKind::Directional || !share.has(t)) continue;
    SceneMaker s = floorScene();
    s.instance(s.mesh(tests::box(Vec3(-0.2f, 2.8f, -0.2f), Vec3(0.2f, 3.2f, 0.2f)), 0));
    LightShape light = lightFor(t.name, t.kind, Vec3(0, 3, 0));
    s.light(light);
    const ShadowRun r = runShadow(s.finish(), t.technique);
    expectInRange(r, label(t));
    // What the map covers of the floor is dark (a rectangle's reaches to 75 degrees, a spot's to its cone).
    EXPECT_LE(over(r, [](const Vec3& p) { return p.y < 1e-3f && std::hypot(p.x, p.z) < 1.9f; }).hi, 0.05f) << label(t);
  }
}

// filament#7480: what a pre-filter reads beyond the map's edge must not darken what lies there. A card in the middle, wide kernels; and a wall at one end of
// the floor, which no wrap-around may bring to the other.
TEST(ShadowHardCases, BlurAcrossTheMapsEdge) {
  for (Try t : tries()) {
    if (t.kind != LightKind::Directional) continue;
    for (int resolution : {32, 128, 256})
      for (int blur : {2, 16, 64}) {
        SceneMaker s = floorScene();
        s.instance(s.mesh(tests::quad(Vec3(-2, 0, 2), Vec3(0.05f, 0, 0), Vec3(0, 1.0f, 0)), 0));
        s.instance(s.mesh(tests::quad(Vec3(-2, 1, 2), Vec3(0.3f, 0, 0), Vec3(0, 0, -4)), 0));  // over the left end
        s.light(lightFor(t.name, LightKind::Directional));
        t.technique.mutable_map()->set_resolution(uint32_t(resolution));
        t.technique.mutable_map()->set_blur(uint32_t(blur));
        const ShadowRun r = runShadow(s.finish(), t.technique);
        const std::string what = label(t) + " " + std::to_string(resolution) + " texels, blur " + std::to_string(blur);
        expectInRange(r, what);
        const float kernel = 4.4f * float(blur + 2) / float(resolution);  // metres either way
        if (kernel > 2.0f) continue;                                      // it reaches the left end from anywhere
        const Span right = over(r, [&](const Vec3& p) { return p.y < 1e-3f && p.x > std::max(1.7f, -1.6f + kernel); });
        ASSERT_GT(right.count, 5);
        EXPECT_GE(right.lo, 0.99f) << what;
      }
  }
}

// Kernels wider than the whole map: a floor square to the sun has one depth, whatever is averaged.
TEST(ShadowHardCases, KernelsWiderThanTheMap) {
  for (Try t : tries()) {
    if (t.kind != LightKind::Directional) continue;
    for (int resolution : {1, 2, 8, 33}) {
      SceneMaker s = floorScene();
      s.light(lightFor(t.name, LightKind::Directional));
      t.technique.mutable_map()->set_resolution(uint32_t(resolution));
      t.technique.mutable_map()->set_blur(64);
      const ShadowRun r = runShadow(s.finish(), t.technique);
      expectInRange(r, label(t));
      EXPECT_GE(over(r, everywhere).lo, 0.98f) << label(t) << " " << resolution;
    }
  }
}

// playcanvas/engine#7480: a depth that is no number, or out of range, enters a warp. It counts as "nothing hit" or as its limit, and reaches no further
// than the filter's radius: every other texel keeps its bits.
TEST(ShadowHardCases, BadDepthsDoNotSpread) {
  constexpr int kSide = 24, kBlur = 3, kX = 11, kY = 9;
  const float inf = std::numeric_limits<float>::infinity(), nan = std::numeric_limits<float>::quiet_NaN();
  const v1::ConvolutionShadow convolution;
  const std::vector<ShadowBasisPtr> bases{makeExponentialBasis(80, false),
                                          makeExponentialBasis(500, true),
                                          makeVarianceBasis(v1::VarianceShadow()),
                                          makeConvolutionBasis(convolution),
                                          makeExponentialVarianceBasis(40, 10, 1e-6f, 0.1f),
                                          makeMomentBasis(v1::MomentShadow())};
  const auto encoded = [&](const ShadowBasisPtr& basis, float bad) {
    auto depth = std::make_shared<Term>("light_depth_map", Domain::LightTexel, Extent{kSide, kSide, 1});
    auto z = depth->addPlane<float>("z");
    for (size_t i = 0; i < z.size(); ++i) z[i] = 0.1f + 0.8f * toUnit(hash32(7, i));
    z[size_t(kY) * kSide + kX] = bad;
    const TaskArena arena(2);
    RunContext ctx;
    ctx.arena = &arena;
    ctx.inputs = {depth};
    const auto map = runNode(*makeShadowEncodeNode(basis, kBlur, kSide, 1, false), ctx);
    GOBO_CHECK(map.ok());
    return std::vector<float>((*map)->floats("B").begin(), (*map)->floats("B").end());
  };
  for (const ShadowBasisPtr& basis : bases) {
    const auto clean = encoded(basis, 0.5f), far = encoded(basis, 1.0f), near = encoded(basis, 0.0f);
    const size_t channels = size_t(basis->channels());
    for (float bad : {nan, inf, -inf, 3.0f, -2.0f, 3.0e38f}) {
      const auto B = encoded(basis, bad);
      for (size_t i = 0; i < B.size(); ++i) {
        ASSERT_TRUE(std::isfinite(B[i])) << basis->name() << " " << bad;
        const int x = int(i / channels) % kSide, y = int(i / channels) / kSide;
        if (std::max(std::abs(x - kX), std::abs(y - kY)) > kBlur) {
          ASSERT_EQ(B[i], clean[i]) << basis->name() << " " << bad << " spread to " << x << "," << y;
        }
        ASSERT_EQ(B[i], (bad < 0 && !std::isinf(bad) ? near : far)[i]) << basis->name() << " " << bad;
      }
    }
  }
}

// Masked cards: light falls through the holes of their texture.
TEST(ShadowHardCases, AlphaTestedCasters) {
  for (Try t : tries()) {
    if (t.kind != LightKind::Directional && t.kind != LightKind::Spot && t.kind != LightKind::Point) continue;
    SceneMaker s = floorScene();
    auto holes = std::make_shared<Texture>();
    holes->width = holes->height = 4;
    holes->nearest = true;
    std::vector<uint8_t> texels;
    for (int i = 0; i < 16; ++i) texels.insert(texels.end(), {255, 255, 255, uint8_t((i % 4 + i / 4) % 2 ? 255 : 0)});
    holes->texels8 = texels;
    sealTexture(*holes);
    s.scene.textures.push_back(holes);
    const int lace = s.material(Vec3(0.5f), [](Material& m) {
      m.coverage.mode = AlphaMode::Mask;
      m.coverage.texture.texture = 0;
    });
    s.instance(s.mesh(tests::quad(Vec3(-1, 1, 1), Vec3(2, 0, 0), Vec3(0, 0, -2)), lace));
    s.light(lightFor(t.name, t.kind, Vec3(0.1f, 6, 0.2f), Vec3(0.05f, -1, 0.03f)));
    s.camera(Vec3(0.2f, 0.7f, 2.6f), Vec3(0, 0, 0.2f), 0.8f);
    const ScenePtr scene = s.finish();
    const ShadowRun truth = runShadow(scene, rayTraced(), {96, 64}), r = runShadow(scene, t.technique, {96, 64});
    expectInRange(r, label(t));
    int lit = 0, dark = 0, off = 0;
    for (int y = 1; y + 1 < 64; ++y)
      for (int x = 1; x + 1 < 96; ++x) {
        const size_t i = size_t(y) * 96 + size_t(x);
        const Vec3 p = r.surface(i) ? r.at("P", i) : Vec3(9.0f);
        if (p.y > 1e-3f || std::max(std::fabs(p.x), std::fabs(p.z)) > 0.9f) continue;  // floor below the card
        bool edge = false;
        for (int k = 0; k < 9; ++k) edge |= truth.V()[i + size_t((k / 3 - 1) * 96 + k % 3 - 1)] != truth.V()[i];
        if (edge) continue;
        (truth.V()[i] > 0.5f ? lit : dark) += 1;
        off += std::fabs(truth.V()[i] - r.V()[i]) > 0.1f;
      }
    EXPECT_GT(lit, 50) << label(t);
    EXPECT_GT(dark, 50) << label(t);
    EXPECT_LE(off, (lit + dark) / 20) << label(t);
  }
}

// d < z: kernels on a slanted receiver reach behind it on one side and before it on the other. Nothing exceeds 1, and what a filter loses on a bare plane stays
// within the bound (measured over tilts of 0 to 80 degrees; the thesis names it as the exponential's violation, 7.2).
TEST(ShadowHardCases, SlantedReceivers) {
  for (Try t : tries()) {
    if (t.kind != LightKind::Directional) continue;
    float least = 1;
    for (int tilt = 0; tilt <= 80; tilt += testing::thoroughOr(10, 40)) {
      SceneMaker s;
      const float a = float(tilt) * kPi / 180.0f;
      const Vec3 along(std::cos(a), std::sin(a), 0);
      s.instance(s.mesh(tests::quad(-3.0f * along + Vec3(0, 0, 3), 6.0f * along, Vec3(0, 0, -6)), s.material(Vec3(0.5f))));
      s.light(lightFor(t.name, LightKind::Directional, Vec3(0.0f), Vec3(0.01f, -1, 0.02f)));
      s.camera(5.0f * Vec3(-std::sin(a), std::cos(a), 0.2f), Vec3(0.0f), 0.6f);
      const ShadowRun r = runShadow(s.finish(), t.technique);
      expectInRange(r, label(t));
      least = std::min(least, over(r, everywhere).lo);
    }
    std::printf("%-24s smallest visibility of a bare plane at 0 .. 80 degrees: %.3f\n", t.name.c_str(), least);
    EXPECT_GE(least, 0.75f) << t.name;
  }
}

// The whole engine on a scene that only punctual lights light: no environment, no emissive surface, nothing for light sampling to find by chance.
TEST(ShadowHardCases, PunctualLightsOnly) {
  using namespace gobo::testing;
  for (const NamedTechnique& t : mapTechniques()) {
    if (soft(t.name)) continue;
    const auto engine = makeEngine();
    v1::RenderRequest r = smallRequest("fence", 24, 16, 4);
    for (const char* e :
         {"lights.key.enabled=false", "lights.spot.kind=SPOT", "lights.spot.position=-2,3,3", "lights.spot.direction=0.5,-0.8,-0.6", "lights.spot.outer_deg=40",
          "lights.spot.intensity=40", "lights.bulb.kind=POINT", "lights.bulb.position=1,1.5,1.5", "lights.bulb.intensity=4", "outputs=beauty"})
      set(r, e);
    *r.mutable_shadows() = t.technique;
    r.mutable_shadows()->mutable_map()->set_resolution(128);
    const RenderResult got = mustRender(*engine, r);
    ASSERT_EQ(got.images.size(), 1u) << t.name;
    double sum = 0;
    for (float v : got.images[0].image().data) {
      ASSERT_TRUE(std::isfinite(v) && v >= 0.0f) << t.name;
      sum += v;
    }
    EXPECT_GT(sum, 1.0) << t.name;
  }
}

}  // namespace
}  // namespace gobo::test
