// SPDX-License-Identifier: Apache-2.0
// Emission profiles of point and spot lights. Oracles: interpolation by hand, the projected picture on a plane, quadrature of the profile over the
// sphere, integrals in closed form, the light without a profile.
#include <gtest/gtest.h>

#include <numbers>

#include "scene/light_axes.h"
#include "support/chi2.h"
#include "support/lit_scene.h"
#include "support/thorough.h"
#include "trace/emission_profile.h"
#include "trace/light_selector.h"
#include "trace/photon_emission.h"

namespace gobo {
namespace light_profile_test {

constexpr double kDegree = std::numbers::pi / 180;

LightProfilePtr picture(int width, int height, const std::vector<Vec3>& values) {
  auto p = std::make_shared<LightProfile>();
  p->width = width;
  p->height = height;
  p->values = values;
  EXPECT_TRUE(sealProfile(*p).ok());
  return p;
}
/// Values by vertical angle, then horizontal; angles in degrees.
LightProfilePtr photometry(const std::vector<double>& vertical, const std::vector<double>& horizontal, const std::vector<double>& values) {
  auto p = std::make_shared<LightProfile>();
  p->kind = ProfileKind::Photometry;
  p->width = int(horizontal.size());
  p->height = int(vertical.size());
  std::vector<float> down, round;
  for (const double v : vertical) down.push_back(float(v * kDegree));
  for (const double h : horizontal) round.push_back(float(h * kDegree));
  std::vector<Vec3> all;
  for (const double v : values) all.emplace_back(float(v));
  p->vertical = down;
  p->horizontal = round;
  p->values = all;
  const Status sealed = sealProfile(*p);
  EXPECT_TRUE(sealed.ok()) << sealed.toString();
  return p;
}
LightShape spot(double outerDegrees, const Vec3& axis = Vec3(0, -1, 0), double innerDegrees = -1) {
  LightShape s;
  s.kind = LightKind::Spot;
  s.axis = glm::normalize(axis);
  s.cosOuter = float(std::cos(outerDegrees * kDegree));
  s.cosInner = float(std::cos((innerDegrees < 0 ? 0.98 * outerDegrees : innerDegrees) * kDegree));
  s.profile = 0;
  return s;
}
LightShape point() {
  LightShape s;
  s.profile = 0;
  return s;
}
/// Every kind of content there is.
struct ProfileCase {
  const char* name;
  LightShape shape;
  LightProfilePtr profile;
};
std::vector<ProfileCase> profileCases() {
  std::vector<Vec3> noise;
  for (int i = 0; i < 12 * 7; ++i) noise.emplace_back(float(i * 7919 % 13) / 12.0f, float(i % 5) / 5.0f, i % 3 == 0 ? 0.0f : 0.3f);
  std::vector<Vec3> dot(20 * 20, Vec3(0.0f));
  dot[20 * 6 + 13] = Vec3(1.0f);
  const Vec3 slant(0.4f, -1, 0.3f);
  LightShape turned = spot(35, slant);
  turned.profileRotation = 0.7f;
  std::vector<double> lobes;
  for (int v = 0; v < 4; ++v)
    for (int h = 0; h < 5; ++h) lobes.push_back(h == 1 ? 0.0 : 1.0 / (1 + v) + 0.2 * (h % 4));
  LightShape off = point();
  off.axis = glm::normalize(Vec3(1, 1, -0.2f));
  return {{"noise", turned, picture(12, 7, noise)},
          {"one texel of many", spot(50, slant), picture(20, 20, dot)},
          {"1 x 1", spot(20, slant), picture(1, 1, {Vec3(0.5f, 1, 0)})},
          {"1 degree", spot(1, slant), picture(12, 7, noise)},
          {"inner cone at 0", spot(60, slant, 0), picture(12, 7, noise)},
          {"blinds", spot(30), patternProfile(LightPattern::Blinds)},
          {"leaves", spot(30), patternProfile(LightPattern::Leaves)},
          {"downlight", point(), photometry({0, 30, 60, 90}, {0}, {1, 0.8, 0.3, 0})},
          {"narrow beam", off, photometry({0, 0.5, 1, 90}, {0}, {1, 0.5, 0, 0})},
          {"uplight", off, photometry({90, 120, 180}, {0}, {0, 1, 0.5})},
          {"lobes", off, photometry({0, 20, 45, 180}, {0, 90, 180, 270, 360}, lobes)},
          {"lobes through a cone", spot(40, slant, 10), photometry({0, 20, 45, 180}, {0, 90, 180, 270, 360}, lobes)}};
}

/// Luminance times falloff, by the definition of both.
double intensity(const ProfileCase& c, const Vec3& d) {
  double falloff = 1;
  if (c.shape.kind == LightKind::Spot) {
    const double ramp =
        std::clamp((double(glm::dot(d, c.shape.axis)) - c.shape.cosOuter) / std::max(1e-3, double(c.shape.cosInner) - c.shape.cosOuter), 0.0, 1.0);
    falloff = ramp * ramp;
  }
  return falloff * double(luminance(EmissionProfile(c.shape, c.profile).at(d)));
}
/// Integral of f over the sphere: rings around the light's axis, finer near it.
template <typename F>
double overSphere(const LightShape& s, F&& f) {
  const Frame frame = profileFrame(s);
  double sum = 0;
  constexpr int kRings = 360, kSteps = 120;
  for (int i = 0; i < kRings; ++i) {
    const double x0 = double(i) / kRings, x1 = (i + 1.0) / kRings, t0 = M_PI * x0 * x0, t1 = M_PI * x1 * x1, t = 0.5 * (t0 + t1);
    double ring = 0;
    for (int k = 0; k < kSteps; ++k) {
      const double phi = 2 * M_PI * (k + 0.5) / kSteps;
      ring += f(frame.toWorld(Vec3(float(std::sin(t) * std::cos(phi)), float(std::sin(t) * std::sin(phi)), float(std::cos(t)))));
    }
    sum += ring / kSteps * 2 * M_PI * (std::cos(t0) - std::cos(t1));
  }
  return sum;
}

TEST(LightProfile, PicturesAreBilinearBetweenTexelCentres) {
  const auto p = picture(2, 2, {Vec3(0), Vec3(1), Vec3(2), Vec3(4)});
  EXPECT_EQ(pictureAt(*p, Vec2(0.25f, 0.25f)), Vec3(0.0f));
  EXPECT_EQ(pictureAt(*p, Vec2(0.5f, 0.25f)), Vec3(0.5f));
  EXPECT_EQ(pictureAt(*p, Vec2(0.5f, 0.5f)), Vec3(1.75f));
  EXPECT_EQ(pictureAt(*p, Vec2(1.0f, 1.0f)), Vec3(4.0f)) << "the border's texel goes on to the border";
  EXPECT_EQ(pictureAt(*p, Vec2(1.01f, 0.5f)), Vec3(0.0f)) << "black outside";
  EXPECT_EQ(pictureAt(*p, Vec2(NAN, 0.5f)), Vec3(0.0f));
}

TEST(LightProfile, TablesAreBilinearInBothAngles) {
  const auto p = photometry({0, 90}, {0, 90, 360}, {1, 1, 1, 0, 1, 0});
  EXPECT_NEAR(photometryAt(*p, 0, 1.0).x, 1.0, 1e-6);
  EXPECT_NEAR(photometryAt(*p, 45 * kDegree, 0).x, 0.5, 1e-6);
  EXPECT_NEAR(photometryAt(*p, 90 * kDegree, 45 * kDegree).x, 0.5, 1e-6);
  EXPECT_NEAR(photometryAt(*p, 90 * kDegree, -135 * kDegree).x, 0.5, 1e-6) << "225 degrees: half way between 90 and 360";
  EXPECT_NEAR(photometryAt(*p, 90 * kDegree, (225 + 720) * kDegree).x, 0.5, 1e-6);
  EXPECT_EQ(photometryAt(*p, 90.1 * kDegree, 90 * kDegree), Vec3(0.0f)) << "0 to 90: nothing goes up";
}

TEST(LightProfile, TheConeTouchesTheShorterSidesAndTheFrameIsTheLamps) {
  // A node at rest looks along -Z, its right +X, its up +Y. Wide picture: red left, green right.
  LightShape s = spot(45, Vec3(0, 0, -1));
  const auto wide = picture(4, 2, {Vec3(1, 0, 0), Vec3(0.5f, 0, 0), Vec3(0, 0.5f, 0), Vec3(0, 1, 0), Vec3(0), Vec3(0), Vec3(0), Vec3(0)});
  const auto at = [&](double x, double y) { return EmissionProfile(s, wide).at(glm::normalize(Vec3(float(x), float(y), -1))); };
  EXPECT_NEAR(at(-1.5, 0.5).x, 1.0, 1e-5) << "left in the picture is left of the lamp, top is up; twice as wide as the cone";
  EXPECT_NEAR(at(1.5, 0.5).y, 1.0, 1e-5);
  EXPECT_NEAR(at(0.5, 0.5).y, 0.5, 1e-5);
  EXPECT_EQ(at(0.5, -0.6), Vec3(0.0f));
  EXPECT_EQ(at(0, 1.01), Vec3(0.0f));
  EXPECT_EQ(EmissionProfile(s, wide).at(Vec3(0, 0, 1)), Vec3(0.0f));
  s.profileRotation = float(0.5 * M_PI);  // counter-clockwise as the lamp sees it: what was right is now up
  EXPECT_NEAR(at(-0.5, 1.5).y, 1.0, 1e-4);
  // Horizontal angles of tables go from right to up.
  LightShape t = point();
  t.axis = Vec3(0, 0, -1);
  const EmissionProfile up(t, photometry({0, 180}, {0, 90, 180, 270, 360}, {0, 1, 0, 0.2, 0, 0, 1, 0, 0.2, 0}));
  EXPECT_NEAR(up.at(Vec3(0, 1, 0)).x, 1.0, 1e-5);
  EXPECT_NEAR(up.at(Vec3(0, -1, 0)).x, 0.2, 1e-5);
  EXPECT_NEAR(up.at(Vec3(1, 0, 0)).x, 0.0, 1e-5);
}

// Straight down, straight up and everywhere between: a lamp that turns a little turns its picture a little.
TEST(LightProfile, TheFrameTurnsWithTheLamp) {
  LightShape s = spot(30);
  Frame last = profileFrame(s);
  Vec3 right = last.x, axis = s.axis;
  double most = 0;
  for (int i = 1; i <= 3600; ++i) {
    const double t = i * 0.1 * kDegree;
    const Vec3 next = glm::normalize(Vec3(float(std::sin(t) * std::cos(0.3)), float(-std::cos(t)), float(std::sin(t) * std::sin(0.3))));
    right = carried(right, axis, next);
    axis = next;
    s.axis = next;
    s.u = right;
    const Frame f = profileFrame(s);
    most = std::max({most, double(glm::length(f.x - last.x)), double(glm::length(f.y - last.y))});
    EXPECT_NEAR(glm::dot(f.x, f.z), 0.0f, 1e-5f);
    last = f;
  }
  EXPECT_LT(most, 0.1 * kDegree * 1.1);
  EXPECT_NEAR(glm::length(last.x - profileFrame(spot(30)).x), 0.0, 2e-3) << "once round a great circle";
}

TEST(LightProfile, SamplesCarryIntensityTimesProfile) {
  for (const ProfileCase& c : profileCases()) {
    test::LitScene lit;
    lit.scene->profiles = {c.profile};
    lit.add(c.shape);
    LightShape plain = c.shape;
    plain.profile = -1;
    lit.add(plain);
    const LightSampler& sampler = lit.build();
    const Frame frame = profileFrame(c.shape);
    test::Rng rng(5);
    for (int i = 0; i < 2000; ++i) {
      const Vec2 u = rng.next2();
      const float gap = c.shape.kind == LightKind::Spot ? 1 - c.shape.cosOuter : 2.0f, z = 1 - gap * u.x, r = std::sqrt(1 - z * z);
      const Vec3 d = frame.toWorld(Vec3(r * std::cos(6.2831853f * u.y), r * std::sin(6.2831853f * u.y), z));
      LightSample with, without;
      const bool lights = sampler.sample(0, 3.0f * d, Vec2(0.5f), with), lit2 = sampler.sample(1, 3.0f * d, Vec2(0.5f), without);
      const Vec3 truth = (lit2 ? without.radiance : Vec3(0.0f)) * EmissionProfile(c.shape, c.profile).at(-without.direction);
      EXPECT_EQ(lights, maxComponent(truth) > 0.0f) << c.name;
      if (lights) { EXPECT_EQ(with.radiance, truth) << c.name; }
    }
  }
}

TEST(LightProfile, FluxIsTheIntegral) {
  for (const ProfileCase& c : profileCases()) {
    const double truth = overSphere(c.shape, [&](const Vec3&d) { return intensity(c, d); }), flux = profileFlux(c.shape, *c.profile);
    EXPECT_NEAR(flux, truth, 0.02 * truth) << c.name;
    const double cells = ProfileDistribution(c.shape, c.profile).flux();
    EXPECT_NEAR(cells, truth, 0.4 * truth) << c.name << ": cells take the falloff where it is largest";
  }
  // Closed forms: cos(t) down to 90 degrees has pi; as a table by 10 degrees it is below its arc. A constant has the solid angle of its cap.
  EXPECT_NEAR(profileFlux(point(), *photometry({0, 180}, {0}, {1, 1})), 4 * M_PI, 1e-5);
  EXPECT_NEAR(profileFlux(point(), *photometry({0, 60}, {0, 360}, {0.5, 0.5, 0.5, 0.5})), M_PI / 2, 1e-5);
  EXPECT_NEAR(profileFlux(point(), *photometry({0, 90}, {0}, {1, 0})), 2 * M_PI * (1 - 2 / M_PI), 1e-5) << "1 - 2 t / pi";
  EXPECT_NEAR(profileFlux(spot(30, Vec3(0, -1, 0), 30), *picture(1, 1, {Vec3(1)})), 2 * M_PI * (1 - std::cos(30 * kDegree)), 0.01);
}

TEST(LightProfile, ChiSquaredOfDirectionsAgainstDensity) {
  const int samples = testing::thoroughOr(60000, 20000);
  const auto cases = profileCases();
  for (const ProfileCase& c : cases) {
    const ProfileDistribution d(c.shape, c.profile);
    const bool whole = c.shape.kind == LightKind::Point;
    const double reach = whole ? 180 : 1.5 * std::acos(double(c.shape.cosOuter)) / kDegree;  // the corners of the picture
    const double span = std::string(c.name) == "narrow beam" ? 2 * sqr(std::sin(0.6 * kDegree)) : 2 * sqr(std::sin(0.5 * std::min(reach, 180.0) * kDegree));
    int astray = 0;  // of single precision, at borders of cells
    const test::Chi2Result r = test::chi2Test(
        {c.shape.axis, span, 24, 24}, samples, uint64_t(&c - cases.data()) + 1,
        [&](test::Rng& rng, Vec3& w) {
          double density = 0;
          const float pick = rng.next();
          if (!d.sample(pick, rng.next2(), w, density)) return false;
          astray += std::fabs(d.density(w) - density) > 1e-3 * density;
          return true;
        },
        [&](const Vec3& w) { return d.density(w); }, 9);
    EXPECT_LE(astray, testing::thoroughOr(6, 4)) << c.name;
    EXPECT_GT(r.p, test::sidak(int(cases.size()))) << c.name << " chi2 " << r.statistic << "/" << r.degrees << " integral " << r.integral;
  }
}

// Unbiased: the mean of photon powers is the flux, by channel; and no direction that shines is left out.
TEST(LightProfile, PhotonsAddUpToTheFlux) {
  for (const ProfileCase& c : profileCases()) {
    DVec3 truth(0.0);
    for (int k = 0; k < 3; ++k)
      truth[k] = overSphere(c.shape, [&](const Vec3& d) {
        const Vec3 v = EmissionProfile(c.shape, c.profile).at(d);
        ProfileCase bare = c;
        bare.profile = picture(1, 1, {Vec3(1)});
        if (c.shape.kind == LightKind::Point) return double(v[k]);
        return double(v[k]) * intensity(bare, d);
      });
    const PhotonEmitter e(c.shape, {{Vec3(0), 1.0f}}, {Vec3(0), 3.0f}, c.profile);  // the target surrounds the lamp: every direction counts
    const int n = 1 << 15;
    DVec3 sum(0.0);
    double square = 0;
    for (int i = 0; i < n; ++i) {
      SobolSampler u(9, uint32_t(i));
      const float pick = u.next1D();
      PhotonStart s;
      if (!e.emit(pick, u.next2D(), s)) continue;
      ASSERT_TRUE(std::isfinite(s.power) && isFinite(s.tint) && isFinite(s.direction)) << c.name;
      sum += DVec3(s.tint) * double(s.power) / double(n);
      square += sqr(double(s.power) * double(luminance(s.tint))) / n;
    }
    const double scale = std::max({truth.x, truth.y, truth.z}), mean = glm::dot(sum, DVec3(0.2126, 0.7152, 0.0722));
    for (int k = 0; k < 3; ++k) EXPECT_NEAR(sum[k], truth[k], 0.02 * scale) << c.name << " channel " << k;
    std::printf("%-22s relative deviation of a photon's power %.2f\n", c.name, std::sqrt(std::max(square / sqr(mean) - 1, 0.0)));
    EXPECT_LT(square / sqr(mean), 4.0) << c.name << ": photons are not sent by the profile";
  }
}

// Towards targets narrower than the profile photons go as they did, and carry what the profile leaves them.
TEST(LightProfile, NarrowTargetsGetTheirShare) {
  LightShape s = spot(40);
  const auto half = picture(1, 1, {Vec3(0.5f, 0.25f, 1)});
  const std::vector<Sphere> targets{{Vec3(0.2f, -2, 0), 0.1f}};
  const PhotonEmitter with(s, targets, {Vec3(0), 3.0f}, half);
  s.profile = -1;
  const PhotonEmitter without(s, targets, {Vec3(0), 3.0f});
  for (int i = 0; i < 500; ++i) {
    SobolSampler u(3, uint32_t(i));
    const float pick = u.next1D();
    const Vec2 at = u.next2D();
    PhotonStart a, b;
    ASSERT_TRUE(with.emit(pick, at, a));
    ASSERT_TRUE(without.emit(pick, at, b));
    EXPECT_EQ(a.direction, b.direction);
    EXPECT_EQ(a.power, b.power);
    EXPECT_EQ(a.tint, Vec3(0.5f, 0.25f, 1));
    EXPECT_EQ(b.tint, Vec3(1.0f));
  }
}

TEST(LightProfile, BlackPicturesShineNowhere) {
  const LightShape s = spot(30);
  const auto black = picture(3, 3, std::vector<Vec3>(9, Vec3(0.0f)));
  test::LitScene lit;
  lit.scene->profiles = {black};
  lit.add(s);
  LightSample out;
  EXPECT_FALSE(lit.build().sample(0, Vec3(0, -1, 0), Vec2(0.5f), out));
  EXPECT_EQ(profileFlux(s, *black), 0.0);
  PhotonStart start;
  const PhotonEmitter e(s, {{Vec3(0, -2, 0), 0.1f}}, {Vec3(0), 3.0f}, black);
  for (int i = 0; i < 100; ++i) EXPECT_FALSE(e.emit(float(i) / 100, Vec2(0.3f, 0.7f), start));
}

TEST(LightProfile, BadProfilesAreNamed) {
  const auto refused = [](const std::function<void(LightProfile&)>& change, const char* what) {
    LightProfile p = *photometry({0, 90}, {0, 90, 360}, {1, 1, 1, 0, 1, 0});
    change(p);
    const Status s = sealProfile(p);
    EXPECT_FALSE(s.ok()) << what;
    EXPECT_NE(s.toString().find(what), std::string::npos) << s.toString();
  };
  refused([](LightProfile& p) { p.values[2].y = NAN; }, "values/2: nan");
  refused([](LightProfile& p) { p.values[3].x = -1; }, "values/3: -1");
  refused([](LightProfile& p) { p.values[0].x = 2e6f; }, "values/0: 2000000");
  refused([](LightProfile& p) { p.vertical[1] = -0.1f; }, "vertical/1: angle -0.1");
  refused([](LightProfile& p) { p.vertical[0] = 2.0f; }, "vertical/1");
  refused([](LightProfile& p) { p.horizontal[2] = 5.0f; }, "0 to 2 pi");
  refused([](LightProfile& p) { p.horizontal[1] = 0.0f; }, "horizontal/1");
  refused([](LightProfile& p) { p.width = 5000; }, "5000 x 2");
  refused([](LightProfile& p) { p.values.pop_back(); }, "5 for 3 x 2");
  Scene scene;
  scene.profiles = {picture(1, 1, {Vec3(1)})};
  Light l;
  l.name = "lamp";
  l.shape = point();
  scene.lights = {l};
  EXPECT_NE(scene.seal().toString().find("cone of a spot"), std::string::npos);
  scene.lights[0].shape = spot(20);
  EXPECT_TRUE(scene.seal().ok());
  scene.lights[0].shape.profile = 1;
  EXPECT_NE(scene.seal().toString().find("profile 1 of 1 is out of range"), std::string::npos);
}

}  // namespace light_profile_test
}  // namespace gobo
