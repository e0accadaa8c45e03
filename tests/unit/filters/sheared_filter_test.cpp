// SPDX-License-Identifier: Apache-2.0
// The sheared filter as an operator on samples: invariants, what it may share, passes against the whole sum, choice of the shear.
#include "filters/sheared/filter.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "filters/sheared/gather_kernels.h"
#include "filters/sheared/shear.h"
#include "unit/filters/synthetic.h"

namespace gobo {
namespace {

using namespace test;

constexpr float kPixel = 0.05f, kHeight = 10.0f;

LightRectangle lampAbove() {
  LightRectangle r;
  r.centre = Vec3(0, 0, kHeight);
  r.axis = Vec3(0, 0, -1);
  r.u = Vec3(1, 0, 0);
  r.v = Vec3(0, 1, 0);
  r.halfU = 1.0f;
  r.halfV = 0.8f;
  return r;
}
PlaneView receiver(int width = 48, int height = 40) {
  PlaneView v;
  v.width = width;
  v.height = height;
  v.origin = Vec3(-0.5f * kPixel * float(width - 1), -0.5f * kPixel * float(height - 1), 0);
  v.du = Vec3(kPixel, 0, 0);
  v.dv = Vec3(0, kPixel, 0);
  return v;
}

struct Samples {
  TermPtr samples, count;
};
/// n jittered points of every pixel; visible(x, y, u, v) in metres.
Samples samplesOf(const PlaneView& view, uint32_t n, uint64_t seed, const std::function<bool(Vec2 receiver, Vec2 light)>& visible) {
  const Extent e{view.width, view.height, 1};
  const size_t K = (n + 3) / 4 * 4;
  const LightRectangle lamp = lampAbove();
  auto s = std::make_shared<Term>("light_samples", Domain::ViewSample, e), c = std::make_shared<Term>("count", Domain::ViewSample, e);
  auto V = s->addPlane<float>("V"), point = s->addPlane<float>("point", int(4 * K));
  auto count = c->addPlane<uint32_t>("n");
  for (size_t p = 0; p < e.elements(); ++p) {
    const Vec3 at = view.origin + float(p % size_t(e.width)) * view.du + float(p / size_t(e.width)) * view.dv;
    count[p] = n;
    for (uint32_t i = 0; i < n; ++i) {
      const Vec2 u = SobolSampler(hash64(seed, p), i).next2D();
      float* to = &point[4 * K * p + i];
      to[0] = 2 * u.x - 1;
      to[K] = 2 * u.y - 1;
      to[2 * K] = 1;
      to[3 * K] = visible(Vec2(at), Vec2(to[0] * lamp.halfU, to[K] * lamp.halfV)) ? 1.0f : 0.0f;
      V[p] += to[3 * K] / float(n);
    }
  }
  return {s, c};
}
TermPtr shearTerm(const PlaneView& view, const std::function<float(int x, int y)>& shear, float widthPx) {
  const Extent e{view.width, view.height, 1};
  auto t = std::make_shared<Term>("shadow_shear", Domain::ViewSample, e);
  auto s = t->addPlane<float>("shear"), w = t->addPlane<float>("width");
  for (int y = 0, i = 0; y < e.height; ++y)
    for (int x = 0; x < e.width; ++x, ++i) {
      s[i] = shear(x, y);
      w[i] = s[i] > 0 ? widthPx * kPixel : 0.0f;
    }
  return t;
}
ShearedFilterSettings settings(ShearedFilterSettings::Passes passes = ShearedFilterSettings::Passes::Never) {
  ShearedFilterSettings s;
  s.light = lampAbove();
  s.passes = passes;
  return s;
}
TermPtr sheared(const ShearedFilterSettings& s, const PlaneView& view, const Samples& in, const TermPtr& shear, int threads = 2) {
  return runFilter(makeShearedFilter(s), {in.samples, planeGBuffer(view), in.samples, shear, in.count}, threads);
}
using Passes = ShearedFilterSettings::Passes;

TEST(ShearedFilter, AllSeenIsOneAndNoneIsZero) {
  const PlaneView view = receiver();
  for (const bool lit : {false, true})
    for (const Passes passes : {Passes::Never, Passes::Where}) {
      const Samples in = samplesOf(view, 4, 1, [&](Vec2, Vec2) { return lit; });
      const auto out = sheared(settings(passes), view, in,
                               shearTerm(
                                   view, [](int, int) { return 1.0f; }, 6));
      for (float v : out->floats("V")) ASSERT_EQ(v, lit ? 1.0f : 0.0f);
    }
}

TEST(ShearedFilter, NothingToShareIsInputZero) {
  const PlaneView view = receiver();
  const Samples in = samplesOf(view, 4, 2, [](Vec2 x, Vec2 y) { return x.x + y.x > 0; });
  const auto V = in.samples->floats("V");
  auto same = [&](const TermPtr& out) {
    for (size_t p = 0; p < V.size(); ++p) ASSERT_EQ(out->floats("V")[p], V[p]);
  };
  same(sheared(settings(), view, in,
               shearTerm(
                   view, [](int, int) { return 0.0f; }, 6)));
  same(sheared(settings(), view, in,
               shearTerm(
                   view, [](int, int) { return 1.0f; }, 0.9f)));  // a tent of one pixel
  ShearedFilterSettings narrow = settings();
  narrow.radiusPx = 0;
  same(sheared(narrow, view, in,
               shearTerm(
                   view, [](int, int) { return 1.0f; }, 6)));
  // Every pixel its own object.
  auto g = planeGBuffer(view);
  auto instance = g->writable<uint32_t>("instance");
  for (size_t p = 0; p < instance.size(); ++p) instance[p] = uint32_t(p);
  same(runFilter(makeShearedFilter(settings()), {in.samples, g, in.samples,
                                                 shearTerm(
                                                     view, [](int, int) { return 1.0f; }, 6),
                                                 in.count}));
}

TEST(ShearedFilter, PictureBorderAndOtherObjectsKeepInputZero) {
  // A kernel that misses a part would weigh the light's ends by a density that is not there.
  const PlaneView view = receiver(64, 64);
  const Samples in = samplesOf(view, 4, 3, [](Vec2 x, Vec2 y) { return x.x + y.x > 0; });
  auto g = planeGBuffer(view);
  auto instance = g->writable<uint32_t>("instance");
  for (int y = 0; y < 64; ++y)
    for (int x = 32; x < 64; ++x) instance[y * 64 + x] = 1;
  const auto out = runFilter(makeShearedFilter(settings()), {in.samples, g, in.samples,
                                                             shearTerm(
                                                                 view, [](int, int) { return 1.0f; }, 8),
                                                             in.count});
  const auto V = in.samples->floats("V"), W = out->floats("V");
  for (int y = 0; y < 64; ++y)
    for (const int x : {0, 1, 28, 31, 32, 35, 62, 63}) ASSERT_EQ(W[y * 64 + x], V[y * 64 + x]) << x << " " << y;
  int changed = 0;
  for (int y = 16; y < 48; ++y) changed += W[y * 64 + 16] != V[y * 64 + 16];
  EXPECT_GT(changed, 16);
}

TEST(ShearedFilter, PassesAreTheWholeSumWhereRowsRunAlongTheLight) {
  const PlaneView view = receiver(64, 56);
  const float s = 1.5f;
  const Samples in = samplesOf(view, 8, 4, [&](Vec2 x, Vec2 y) { return std::sin(4 * (x.x + s * y.x)) + std::sin(3 * (x.y + s * y.y)) > 0; });
  const auto shear = shearTerm(
      view, [&](int, int) { return 1 / s; }, 8);
  ShearedFilterSettings fine = settings(Passes::Where);
  fine.bins = 64;
  const auto a = sheared(settings(), view, in, shear), b = sheared(fine, view, in, shear);
  double sum = 0, apart = 0;
  size_t count = 0;
  const auto V = in.samples->floats("V");
  for (size_t p = 0; p < V.size(); ++p) {
    if (a->floats("V")[p] == V[p] || b->floats("V")[p] == V[p]) continue;
    sum += sqr(a->floats("V")[p] - b->floats("V")[p]);
    apart += sqr(a->floats("V")[p] - V[p]);
    ++count;
  }
  ASSERT_GT(count, 1000u);
  EXPECT_LT(std::sqrt(sum / double(count)), 6e-3);  // 64 parts of the light instead of its points
  EXPECT_GT(std::sqrt(apart / double(count)), 3e-2);
}

TEST(ShearedFilter, PassesAreNotTakenAcrossTheLight) {
  // The same picture turned by 30 degrees under the lamp: a step along a row moves samples along both edges.
  PlaneView view = receiver();
  const float c = std::cos(0.5f), d = std::sin(0.5f);
  view.du = Vec3(c, d, 0) * kPixel;
  view.dv = Vec3(-d, c, 0) * kPixel;
  const Samples in = samplesOf(view, 4, 5, [](Vec2 x, Vec2 y) { return x.x + y.x > 0.3f; });
  const auto shear = shearTerm(
      view, [](int, int) { return 1.0f; }, 6);
  const auto a = sheared(settings(Passes::Never), view, in, shear), b = sheared(settings(Passes::Where), view, in, shear);
  int changed = 0;
  for (size_t p = 0; p < a->floats("V").size(); ++p) {
    ASSERT_EQ(a->floats("V")[p], b->floats("V")[p]);
    changed += a->floats("V")[p] != in.samples->floats("V")[p];
  }
  EXPECT_GT(changed, 200);
}

TEST(ShearedFilter, AnyNumberOfThreadsGivesTheSameBits) {
  const PlaneView view = receiver();
  const Samples in = samplesOf(view, 4, 6, [](Vec2 x, Vec2 y) { return x.x + y.x > 0; });
  const auto shear = shearTerm(
      view, [](int x, int) { return 0.8f + 0.005f * float(x); }, 5);
  for (const Passes passes : {Passes::Never, Passes::Where}) {
    const auto a = sheared(settings(passes), view, in, shear, 1), b = sheared(settings(passes), view, in, shear, 4);
    for (size_t p = 0; p < a->floats("V").size(); ++p) ASSERT_EQ(a->floats("V")[p], b->floats("V")[p]);
  }
}

TEST(ShearedFilter, ExtremeShearsStayFiniteAndWithinWhatVisibilityIs) {
  const PlaneView view = receiver();
  const Samples in = samplesOf(view, 4, 7, [](Vec2 x, Vec2 y) { return x.x + y.x > 0; });
  for (const float a : {1.0e-30f, 1.0e-4f, 1.0e4f, 1.0e30f})
    for (const Passes passes : {Passes::Never, Passes::Where}) {
      const auto out = sheared(settings(passes), view, in,
                               shearTerm(
                                   view, [&](int, int) { return a; }, 6));
      for (float v : out->floats("V")) {
        ASSERT_TRUE(std::isfinite(v)) << a;
        ASSERT_GE(v, 0.0f);
        ASSERT_LE(v, 1.0f);
      }
    }
}

TEST(ShearedFilter, NotANumberIsRefused) {
  const PlaneView view = receiver();
  const Samples in = samplesOf(view, 4, 8, [](Vec2, Vec2) { return true; });
  const Extent e{view.width, view.height, 1};
  const auto bad = floatTerm(e, "V", [](int x, int y, int) { return x == 3 && y == 3 ? std::numeric_limits<float>::quiet_NaN() : 1.0f; });
  TaskArena arena(1);
  RunContext ctx;
  ctx.inputs = {bad, planeGBuffer(view), in.samples,
                shearTerm(
                    view, [](int, int) { return 1.0f; }, 6),
                in.count};
  ctx.arena = &arena;
  EXPECT_EQ(runNode(*makeShearedFilter(settings()), ctx).status().code(), Code::Internal);
}

TEST(ShearedFilter, StopsWhenAsked) {
  const PlaneView view = receiver();
  const Samples in = samplesOf(view, 4, 9, [](Vec2, Vec2) { return true; });
  TaskArena arena(1);
  StopSource stop;
  stop.stop(StopReason::Cancelled);
  RunContext ctx;
  ctx.inputs = {in.samples, planeGBuffer(view), in.samples,
                shearTerm(
                    view, [](int, int) { return 1.0f; }, 6),
                in.count};
  ctx.arena = &arena;
  ctx.stop = stop.token();
  EXPECT_EQ(runNode(*makeShearedFilter(settings()), ctx).status().code(), Code::Cancelled);
}

// --- which shear -------------------------------------------------------------------------------------------------------------------

ShearChoice choice(std::initializer_list<double> z, float n, float half = 1.732f) {
  double m[4] = {};
  for (double v : z)
    for (int k = 0; k < 4; ++k) m[k] += std::pow(v, k + 1) / double(z.size());
  ShadowShearSettings s;
  s.half = half;  // of a square of standard deviation 1
  return chooseShear(m, float(1 / std::sqrt(std::sqrt(m[3]))), n, s);
}

TEST(ShadowShear, OneSlopeIsShearedByItAndTwoThatDifferAreNot) {
  const ShearChoice one = choice({0.1}, 4);
  EXPECT_NEAR(one.shear, 0.1f, 1e-6);
  EXPECT_GT(one.width, 4.0f);
  const ShearChoice near = choice({0.1, 0.103}, 4), far = choice({0.05, 0.2}, 4);
  EXPECT_NEAR(near.shear, 0.1015f, 1e-6);
  EXPECT_LE(near.width, one.width);
  EXPECT_EQ(far.shear, 0.0f);
}

TEST(ShadowShear, WidthKeepsToTheLight) {
  // Beyond half a half edge of shear few samples of neighbours land on the light.
  const ShearChoice wide = choice({0.1}, 4), small = choice({0.1}, 4, 0.9f);
  EXPECT_LE(wide.shear * wide.width, 0.5f * 1.732f + 1e-5f);
  EXPECT_TRUE(small.shear == 0.0f || small.shear * small.width <= 0.45f + 1e-5f);
}

TEST(ShadowShear, NoPilotNoShear) {
  const double none[4] = {0, 0, 0, 0}, nan[4] = {std::nan(""), 1, 1, 1};
  EXPECT_EQ(chooseShear(none, 1.0f, 4, {}).shear, 0.0f);
  EXPECT_EQ(chooseShear(nan, 1.0f, 4, {}).shear, 0.0f);
}

TEST(ShadowShear, NodeTakesTheMeanOfPilotsOfItsObject) {
  const PlaneView view = receiver();
  const Extent e{view.width, view.height, 1};
  auto slopes = std::make_shared<Term>("shadow_slopes", Domain::ViewSample, e), count = std::make_shared<Term>("count", Domain::ViewSample, e);
  auto sMin = slopes->addPlane<float>("sMin");
  auto occluded = slopes->addPlane<uint8_t>("occluded");
  for (uint32_t& n : count->addPlane<uint32_t>("n")) n = 4;
  auto g = planeGBuffer(view);
  auto instance = g->writable<uint32_t>("instance");
  for (int y = 0; y < e.height; ++y)
    for (int x = 0; x < e.width; ++x) {
      const size_t p = size_t(y) * size_t(e.width) + size_t(x);
      instance[p] = x >= 24;
      occluded[p] = y % 2 == 0;
      sMin[p] = occluded[p] ? (x < 24 ? 1.0f : 0.5f) : 0.0f;
    }
  const auto penumbra = floatTerm(e, "size", [&](int x, int, int) { return (x < 24 ? 1.0f : 0.5f) / kPixel; });
  ShadowShearSettings s;
  s.half = 1.732f;
  s.radiusPx = 4;
  const auto out = runFilter(makeShadowShear(s, e), {slopes, g, penumbra, count});
  for (int x = 0; x < e.width; ++x) {
    EXPECT_NEAR(out->floats("shear")[20 * 48 + x], x < 24 ? 1.0f : 2.0f, 1e-4) << x;
    EXPECT_GT(out->floats("width")[20 * 48 + x], 4 * kPixel) << x;
  }
}

}  // namespace
}  // namespace gobo
