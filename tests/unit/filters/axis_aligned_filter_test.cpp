// SPDX-License-Identifier: Apache-2.0
// The axis-aligned filter as an operator on pictures: invariants, impulse response, noise gain, rejections.
#include "filters/axis_aligned/filter.h"

#include <gtest/gtest.h>

#include <functional>
#include <limits>

#include "unit/filters/synthetic.h"

namespace gobo {
namespace {

using namespace test;

float omegaForBeta(float betaPx, float pixel = 0.1f, float k = 3.0f) { return 1.0f / (k * betaPx * pixel); }
TermPtr constantOmega(const Extent& e, float omega) {
  return floatTerm(e, "Omega", [=](int, int, int) { return omega; });
}
Extent extentOf(const PlaneView& v) { return {v.width, v.height, v.layers}; }

TEST(AxisAlignedFilter, ConstantStaysToTheBit) {
  PlaneView view;
  const auto e = extentOf(view);
  const auto in = floatTerm(e, "V", [](int, int, int) { return 0.3f; });
  const auto omega = floatTerm(e, "Omega", [](int x, int y, int) { return omegaForBeta(1.0f + 0.05f * float(x + y)); });
  const auto out = runFilter(axisAligned(axisAlignedSettings()), {in, planeGBuffer(view), omega});
  for (float v : out->floats("V")) ASSERT_EQ(v, 0.3f);
}

TEST(AxisAlignedFilter, RadiusZeroAndUnfilterablePixelsAreIdentity) {
  PlaneView view;
  view.layers = 2;
  const auto e = extentOf(view);
  const auto noise = noiseTerm(e, "V", 1), g = planeGBuffer(view);
  const auto r0 = runFilter(axisAligned(axisAlignedSettings(0)), {noise, g, constantOmega(e, omegaForBeta(4))});
  const auto skip = runFilter(axisAligned(axisAlignedSettings()), {noise, g, constantOmega(e, 0.0f)});
  for (size_t i = 0; i < e.elements(); ++i) {
    ASSERT_EQ(r0->floats("V")[i], noise->floats("V")[i]);
    ASSERT_EQ(skip->floats("V")[i], noise->floats("V")[i]);
  }
}

TEST(AxisAlignedFilter, ImpulseResponseIsTheSampledGaussian) {
  PlaneView view;
  view.width = view.height = 65;
  const auto e = extentOf(view);
  const auto in = floatTerm(e, "V", [](int x, int y, int) { return x == 32 && y == 32 ? 1.0f : 0.0f; });
  const float beta = 2.997f;  // pixels; radius 9 = ceil(3 beta)
  const auto out = runFilter(axisAligned(axisAlignedSettings()), {in, planeGBuffer(view), constantOmega(e, omegaForBeta(beta))});
  double norm = 0;
  for (int i = -9; i <= 9; ++i) norm += std::exp(-i * i / (2.0 * beta * beta));
  double total = 0;
  for (int y = 0; y < 65; ++y)
    for (int x = 0; x < 65; ++x) {
      const int dx = std::abs(x - 32), dy = std::abs(y - 32);
      const double expected = dx <= 9 && dy <= 9 ? std::exp(-(dx * dx + dy * dy) / (2.0 * beta * beta)) / (norm * norm) : 0.0;
      total += out->floats("V")[y * 65 + x];
      EXPECT_NEAR(out->floats("V")[y * 65 + x], expected, 1e-6) << dx << " " << dy;
      EXPECT_NEAR(out->floats("V")[y * 65 + x], out->floats("V")[x * 65 + y], 1e-7);
    }
  EXPECT_NEAR(total, 1, 1e-5);  // constant beta away from borders: energy is kept
}

TEST(AxisAlignedFilter, NoiseGain) {
  for (float beta : {1.5f, 3.0f, 6.0f, 12.0f}) {
    PlaneView view;
    view.width = view.height = beta > 4 ? 512 : 256;
    const auto e = extentOf(view);
    auto settings = axisAlignedSettings(64);
    const auto out = runFilter(axisAligned(settings), {noiseTerm(e, "V", 5), planeGBuffer(view), constantOmega(e, omegaForBeta(beta))});
    // Variance about the known mean 1/2; pixels near the border have one-sided kernels.
    double sum = 0, count = 0;
    const int margin = int(4 * beta) + 2;
    for (int y = margin; y < view.height - margin; ++y)
      for (int x = margin; x < view.width - margin; ++x, ++count) sum += sqr(out->floats("V")[size_t(y) * view.width + x] - 0.5f);
    const double gain = sum / count * 12, predicted = 1 / (4 * M_PI * beta * beta);
    // Independent output cells: count / (4 pi beta^2); the sample variance then scatters by sqrt(2 / cells).
    const double scatter = std::sqrt(2 / (count * predicted));
    EXPECT_NEAR(gain / predicted, 1, 0.05 + 3 * scatter) << beta << " scatter " << scatter;
    // The kernel's own gain, without scatter: from the impulse response.
    double w = 0, w2 = 0;
    const int r = std::min(64, int(std::ceil(3 * beta)));
    for (int i = -r; i <= r; ++i) {
      const double g = std::exp(-i * i / (2.0 * beta * beta));
      w += g;
      w2 += g * g;
    }
    EXPECT_NEAR(sqr(float(w2 / (w * w))) / predicted, 1, 0.05);
  }
}

TEST(AxisAlignedFilter, SeparableEqualsExact2dWhereBetaIsConstant) {
  PlaneView view;
  const auto e = extentOf(view);
  auto settings = axisAlignedSettings(16);
  const auto noise = noiseTerm(e, "V", 9), g = planeGBuffer(view);
  const auto omega = constantOmega(e, omegaForBeta(2));
  const auto a = runFilter(axisAligned(settings), {noise, g, omega});
  settings.exact2d = true;
  const auto b = runFilter(axisAligned(settings), {noise, g, omega});
  double sum = 0;
  for (size_t i = 0; i < e.elements(); ++i) sum += sqr(a->floats("V")[i] - b->floats("V")[i]);
  EXPECT_LT(std::sqrt(sum / double(e.elements())), 1e-4);
}

TEST(AxisAlignedFilter, SeparableStaysCloseWhereBetaVaries) {
  // A step blurred to a ramp, beta rising by a third across the picture: the two differ, but little.
  PlaneView view;
  const auto e = extentOf(view);
  auto settings = axisAlignedSettings(24);
  const auto in = floatTerm(e, "V", [](int x, int, int) { return clamp01((float(x) - 20) / 24); });
  const auto g = planeGBuffer(view);
  const auto omega = floatTerm(e, "Omega", [](int x, int, int) { return omegaForBeta(3 + float(x) / 64); });
  const auto a = runFilter(axisAligned(settings), {in, g, omega});
  settings.exact2d = true;
  const auto b = runFilter(axisAligned(settings), {in, g, omega});
  double sum = 0;
  for (size_t i = 0; i < e.elements(); ++i) sum += sqr(a->floats("V")[i] - b->floats("V")[i]);
  EXPECT_LT(std::sqrt(sum / double(e.elements())), 5e-3);
}

/// Mean absolute leak of a step input across the middle column, for G-buffer and Omega edits.
double leak(const TermPtr& g, const TermPtr& omega, const AxisAlignedFilterSettings& s) {
  const auto e = g->extent();
  const auto in = floatTerm(e, "V", [](int x, int, int) { return x < 32 ? 0.0f : 1.0f; });
  const auto out = runFilter(axisAligned(s), {in, g, omega});
  double sum = 0;
  for (size_t i = 0; i < e.elements(); ++i) sum += std::fabs(out->floats("V")[i] - in->floats("V")[i]);
  return sum / double(e.elements());
}

TEST(AxisAlignedFilter, RejectsAcrossNormalsBetaDistanceAndBackground) {
  PlaneView view;
  const auto e = extentOf(view);
  const auto omega = constantOmega(e, omegaForBeta(4));
  auto s = axisAlignedSettings();
  EXPECT_GT(leak(planeGBuffer(view), omega, s), 0.02);  // nothing to reject: the step is blurred

  auto bent = planeGBuffer(view);  // normals 30 degrees apart left and right of the step
  auto N = bent->writable<float>("N");
  for (size_t i = 0; i < e.elements(); ++i)
    if (i % 64 >= 32) {
      N[3 * i] = 0.5f;
      N[3 * i + 2] = 0.8660254f;
    }
  EXPECT_EQ(leak(bent, omega, s), 0.0);
  s.angle = 0.7f;
  EXPECT_GT(leak(bent, omega, s), 0.02);
  s = axisAlignedSettings();

  const auto twoBetas = floatTerm(e, "Omega", [](int x, int, int) { return omegaForBeta(x < 32 ? 4.0f : 9.0f); });
  s.betaThreshold = 0.5f;
  EXPECT_EQ(leak(planeGBuffer(view), twoBetas, s), 0.0);
  s.betaThreshold = 0.6f;
  EXPECT_GT(leak(planeGBuffer(view), twoBetas, s), 0.02);
  s = axisAlignedSettings();

  auto step = planeGBuffer(view);  // parallel floors 3 m apart (6 beta = 2.4 m): the light-plane distance alone would not tell
  auto P = step->writable<float>("P");
  for (size_t i = 0; i < e.elements(); ++i)
    if (i % 64 >= 32) P[3 * i + 2] -= 3.0f;
  EXPECT_EQ(leak(step, omega, s), 0.0);

  auto hole = planeGBuffer(view);
  auto id = hole->writable<uint32_t>("instance");
  for (size_t i = 0; i < e.elements(); ++i)
    if (i % 64 >= 32) id[i] = ~0u;
  EXPECT_EQ(leak(hole, omega, s), 0.0);
}

TEST(AxisAlignedFilter, DistancesAreInTheLightPlane) {
  // A receiver tilted by 50 degrees: a pixel step in the light plane is 1.56 steps along the surface. The result must equal
  // that on the flat receiver with the same light-plane positions, whatever their heights.
  PlaneView flat;
  PlaneView tilted = flat;
  tilted.du = Vec3(0.1f, 0, 0.1f * std::tan(0.87266463f));
  tilted.normal = Vec3(-std::sin(0.87266463f), 0, std::cos(0.87266463f));
  const auto e = extentOf(flat);
  const auto noise = noiseTerm(e, "V", 3);
  const auto omega = constantOmega(e, omegaForBeta(2));
  auto s = axisAlignedSettings(12);
  s.light.centre = Vec3(0, 0, 1e4f);  // far: lines to its centre are upright
  const auto a = runFilter(axisAligned(s), {noise, planeGBuffer(flat), omega});
  const auto b = runFilter(axisAligned(s), {noise, planeGBuffer(tilted), omega});
  double worst = 0;
  for (size_t i = 0; i < e.elements(); ++i) worst = std::max(worst, double(std::fabs(a->floats("V")[i] - b->floats("V")[i])));
  EXPECT_LT(worst, 1e-3);  // radius 6 px is 0.93 m on the slope: all taps stay inside the cap of 6 beta = 1.2 m
}

TEST(AxisAlignedFilter, PixelsMoveAlongTheirLineToTheLight) {
  // A floor whose pixels are moved up and down along their lines to the light's centre is the same receiver.
  PlaneView view;
  const auto e = extentOf(view);
  const TermPtr noise = noiseTerm(e, "V", 12), omega = constantOmega(e, omegaForBeta(2));
  auto s = axisAlignedSettings(12);
  s.light.centre = Vec3(9, -4, 10);
  const auto flat = runFilter(axisAligned(s), {noise, planeGBuffer(view), omega});
  auto bumpy = planeGBuffer(view);
  auto P = bumpy->writable<float>("P");
  for (size_t i = 0; i < e.elements(); ++i) {
    const float t = 1 + 0.004f * (toUnit(hash32(77, i)) - 0.5f);
    for (size_t c = 0; c < 3; ++c) P[3 * i + c] = s.light.centre[int(c)] + t * (P[3 * i + c] - s.light.centre[int(c)]);
  }
  const auto moved = runFilter(axisAligned(s), {noise, bumpy, omega});
  double worst = 0;
  for (size_t i = 0; i < e.elements(); ++i) worst = std::max(worst, double(std::fabs(flat->floats("V")[i] - moved->floats("V")[i])));
  EXPECT_LT(worst, 2e-3);  // a step straight up would have been 0.04 m to the side here, a fifth of the filter's width
}

TEST(AxisAlignedFilter, SpheresFaceEveryPixel) {
  // Far away, a sphere's plane is that of a lamp turned to the receiver; and near, what moves along a pixel's line to the centre stays where it is.
  PlaneView view;
  const auto e = extentOf(view);
  const TermPtr noise = noiseTerm(e, "V", 15), omega = constantOmega(e, omegaForBeta(2));
  auto s = axisAlignedSettings(12), sphere = s;
  s.light.centre = sphere.light.centre = Vec3(6e3f, 0, 8e3f);
  s.light.axis = Vec3(-0.6f, 0, -0.8f);
  sphere.light.facing = true;
  sphere.light.axis = Vec3(1, 0, 0);  // says nothing
  const auto a = runFilter(axisAligned(s), {noise, planeGBuffer(view), omega}), b = runFilter(axisAligned(sphere), {noise, planeGBuffer(view), omega});
  double worst = 0;
  for (size_t i = 0; i < e.elements(); ++i) worst = std::max(worst, double(std::fabs(a->floats("V")[i] - b->floats("V")[i])));
  EXPECT_LT(worst, 3e-3);
  sphere.light.centre = Vec3(9, -4, 10);
  auto bumpy = planeGBuffer(view);
  auto P = bumpy->writable<float>("P");
  for (size_t i = 0; i < e.elements(); ++i) {
    const float t = 1 + 0.02f * (toUnit(hash32(78, i)) - 0.5f);
    for (size_t c = 0; c < 3; ++c) P[3 * i + c] = sphere.light.centre[int(c)] + t * (P[3 * i + c] - sphere.light.centre[int(c)]);
  }
  const auto flat = runFilter(axisAligned(sphere), {noise, planeGBuffer(view), omega}), moved = runFilter(axisAligned(sphere), {noise, bumpy, omega});
  worst = 0;
  for (size_t i = 0; i < e.elements(); ++i) worst = std::max(worst, double(std::fabs(flat->floats("V")[i] - moved->floats("V")[i])));
  EXPECT_LT(worst, 0.02);
}

TEST(AxisAlignedFilter, EverySettingIsInTheKey) {
  const auto digest = [](const std::function<void(AxisAlignedFilterSettings&)>& edit) {
    AxisAlignedFilterSettings s = axisAlignedSettings(12);
    edit(s);
    Hasher h;
    axisAligned(s)->hashParameters(h);
    return h.digest();
  };
  const auto base = digest([](auto&) {});
  EXPECT_NE(digest([](auto& s) { s.fourthOrder = true; }), base);
  EXPECT_NE(digest([](auto& s) { s.exact2d = true; }), base);
  EXPECT_NE(digest([](auto& s) { s.light.facing = true; }), base);
  EXPECT_NE(digest([](auto& s) { s.light.distant = true; }), base);
  EXPECT_NE(digest([](auto& s) { s.angle = 0.2f; }), base);
}

TEST(AxisAlignedFilter, DistantLightsAreSeenAlongParallelLines) {
  // A lamp far off along the axis, and pixels that are moved along it: the same picture. Turning the light's axes about it changes nothing either.
  PlaneView view;
  const auto e = extentOf(view);
  const TermPtr noise = noiseTerm(e, "V", 16), omega = constantOmega(e, omegaForBeta(2));
  auto far = axisAlignedSettings(12), sun = far;
  far.light.axis = sun.light.axis = Vec3(-0.6f, 0, -0.8f);
  far.light.centre = Vec3(6e3f, 0, 8e3f);
  sun.light.distant = true;
  sun.light.centre = Vec3(1e6f, -3, 7);  // says nothing
  auto bumpy = planeGBuffer(view);
  auto P = bumpy->writable<float>("P");
  for (size_t i = 0; i < e.elements(); ++i) {
    const float t = 0.05f * (toUnit(hash32(79, i)) - 0.5f);
    for (size_t c = 0; c < 3; ++c) P[3 * i + c] += t * sun.light.axis[int(c)];
  }
  const auto lamp = runFilter(axisAligned(far), {noise, planeGBuffer(view), omega}), flat = runFilter(axisAligned(sun), {noise, planeGBuffer(view), omega});
  const auto moved = runFilter(axisAligned(sun), {noise, bumpy, omega});
  double toLamp = 0, toMoved = 0;
  for (size_t i = 0; i < e.elements(); ++i) {
    toLamp = std::max(toLamp, double(std::fabs(lamp->floats("V")[i] - flat->floats("V")[i])));
    toMoved = std::max(toMoved, double(std::fabs(moved->floats("V")[i] - flat->floats("V")[i])));
  }
  EXPECT_LT(toLamp, 3e-3);
  EXPECT_LT(toMoved, 2e-3);
}

TEST(AxisAlignedFilter, AWallUprightOnTheLightsPlaneIsNoSinglePoint) {
  // Light from the side: a step up the wall moves its shadow by 0.6 of it, as 0.6 of it along a floor would.
  PlaneView floor, wall;
  floor.dv = Vec3(0, 0.06f, 0);
  wall.du = Vec3(0, 0.1f, 0);
  wall.dv = Vec3(0, 0, 0.1f);
  wall.normal = Vec3(1, 0, 0);
  const auto e = extentOf(floor);
  const TermPtr noise = noiseTerm(e, "V", 13), omega = constantOmega(e, omegaForBeta(1.5f));
  auto s = axisAlignedSettings(12);
  s.light.centre = Vec3(0, 0, 1e4f);
  const auto a = runFilter(axisAligned(s), {noise, planeGBuffer(floor), omega});
  s.light.centre = Vec3(6e3f, 0, 1e4f);
  const auto b = runFilter(axisAligned(s), {noise, planeGBuffer(wall), omega});
  double worst = 0;
  for (size_t i = 0; i < e.elements(); ++i) worst = std::max(worst, double(std::fabs(a->floats("V")[i] - b->floats("V")[i])));
  EXPECT_LT(worst, 2e-3);
}

TEST(AxisAlignedFilter, ReceiversInTheLightsOwnPlaneStayFinite) {
  PlaneView view;
  const auto e = extentOf(view);
  const auto noise = noiseTerm(e, "V", 14);
  auto s = axisAlignedSettings(12);
  for (float above : {0.0f, 1e-30f, -1e-12f}) {
    s.light.centre = Vec3(3, 3, above);
    for (bool fourth : {false, true}) {
      s.fourthOrder = fourth;
      const auto out = runFilter(axisAligned(s), {noise, planeGBuffer(view), constantOmega(e, omegaForBeta(2))});
      for (float v : out->floats("V")) ASSERT_TRUE(v >= 0 && v <= 1) << above;
    }
  }
}

TEST(AxisAlignedFilter, LightAxesAndScaleDoNotMatter) {
  PlaneView view;
  const auto e = extentOf(view);
  const auto noise = noiseTerm(e, "V", 4);
  const auto s = axisAlignedSettings();
  const auto a = runFilter(axisAligned(s), {noise, planeGBuffer(view), constantOmega(e, omegaForBeta(2.2f))});
  auto flipped = s;
  flipped.light.axis = -s.light.axis;
  const auto f = runFilter(axisAligned(flipped), {noise, planeGBuffer(view), constantOmega(e, omegaForBeta(2.2f))});
  for (size_t i = 0; i < e.elements(); ++i) ASSERT_EQ(a->floats("V")[i], f->floats("V")[i]);
  for (float scale : {1e-3f, 1e3f}) {
    PlaneView v = view;
    v.du *= scale;
    v.dv *= scale;
    auto t = s;
    t.light.centre *= scale;
    const auto b = runFilter(axisAligned(t), {noise, planeGBuffer(v), constantOmega(e, omegaForBeta(2.2f) / scale)});
    for (size_t i = 0; i < e.elements(); ++i) ASSERT_NEAR(a->floats("V")[i], b->floats("V")[i], 1e-5);
  }
}

TEST(AxisAlignedFilter, FarFromTheOrigin) {
  // 4 km off, a pixel of 0.1 m still has its digits, because positions are kept relative to the light.
  PlaneView view, far;
  far.origin = Vec3(4096, 4096, 4096);
  const auto e = extentOf(view);
  const auto noise = noiseTerm(e, "V", 6);
  auto s = axisAlignedSettings();
  const auto a = runFilter(axisAligned(s), {noise, planeGBuffer(view), constantOmega(e, omegaForBeta(2.2f))});
  s.light.centre += far.origin;
  const auto b = runFilter(axisAligned(s), {noise, planeGBuffer(far), constantOmega(e, omegaForBeta(2.2f))});
  for (size_t i = 0; i < e.elements(); ++i) ASSERT_NEAR(a->floats("V")[i], b->floats("V")[i], 2e-3);
}

TEST(AxisAlignedFilter, ExtremeBetasStayFinite) {
  PlaneView view;
  const auto e = extentOf(view);
  const auto noise = noiseTerm(e, "V", 8);
  for (float omega : {1e-12f, 1e12f, std::numeric_limits<float>::min()}) {
    const auto out = runFilter(axisAligned(axisAlignedSettings()), {noise, planeGBuffer(view), constantOmega(e, omega)});
    for (float v : out->floats("V")) ASSERT_TRUE(v >= 0 && v <= 1) << omega;
  }
}

TEST(AxisAlignedFilter, NonFiniteInputIsAnError) {
  PlaneView view;
  const auto e = extentOf(view);
  auto in = floatTerm(e, "V", [](int x, int, int) { return x == 3 ? std::numeric_limits<float>::quiet_NaN() : 1.0f; });
  TaskArena arena(1);
  RunContext ctx;
  ctx.inputs = {in, planeGBuffer(view), constantOmega(e, 1)};
  ctx.arena = &arena;
  const auto r = runNode(*axisAligned(axisAlignedSettings()), ctx);
  ASSERT_FALSE(r.ok());
  EXPECT_EQ(r.status().code(), Code::Internal);
}

TEST(AxisAlignedFilter, StopsWhenAsked) {
  PlaneView view;
  const auto e = extentOf(view);
  StopSource source;
  source.stop(StopReason::Cancelled);
  TaskArena arena(1);
  RunContext ctx;
  ctx.inputs = {noiseTerm(e, "V", 1), planeGBuffer(view), constantOmega(e, 1)};
  ctx.arena = &arena;
  ctx.stop = source.token();
  const auto r = runNode(*axisAligned(axisAlignedSettings()), ctx);
  ASSERT_FALSE(r.ok());
  EXPECT_EQ(r.status().code(), Code::Cancelled);
}

}  // namespace
}  // namespace gobo
