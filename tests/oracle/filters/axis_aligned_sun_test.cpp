// SPDX-License-Identifier: Apache-2.0
// Axis-aligned filtering of lights at infinity. Oracle: behind a straight edge the visible part of a sun is a circular segment, of a rectangle in the sky a
// ramp, each as wide as 2 tan(half angle) times the distance from receiver to edge along the light's axis.
#include <gtest/gtest.h>

#include <bit>
#include <cmath>

#include "filters/axis_aligned/filter.h"
#include "support/shadow_stage.h"
#include "support/sun_edge.h"
#include "support/thorough.h"
#include "support/tiny_scenes.h"

namespace gobo::test {
namespace {

/// A floor at y = 0 and things above it, everything times `scale`, turned about y by `turn`; the camera looks straight down on `aim`, from below 1.
struct SunStage {
  double degrees = 4, tilt = 0, azimuth = 0;  ///< of the sun: full angle, from the zenith, about y
  double turn = 0;                            ///< of the things that cast, degrees
  float scale = 1, pixel = 0.01f;
  Vec3 aim{0.0f}, moved{0.0f};  ///< moved: the whole scene
  bool rectangle = false;       ///< in the sky, `degrees` wide and half as high
  std::vector<std::pair<Vec3, Vec3>> boxes;

  Vec3 axis() const {
    return Vec3(
        DVec3(std::sin(tilt * kDegree) * std::cos(azimuth * kDegree), -std::cos(tilt * kDegree), std::sin(tilt * kDegree) * std::sin(azimuth * kDegree)));
  }
  Vec3 turned(const Vec3& p) const {
    const float c = float(std::cos(turn * kDegree)), s = float(std::sin(turn * kDegree));
    return Vec3(c * p.x - s * p.z, p.y, s * p.x + c * p.z);
  }
  ScenePtr scene(const ShadowPicture& picture) const {
    tests::SceneMaker m;
    const int grey = m.material(Vec3(0.5f));
    const auto placed = [&](Mesh mesh, bool turns) {
      for (Vec3& p : mesh.positions) p = scale * ((turns ? turned(p) : p) + moved);
      m.instance(m.mesh(std::move(mesh), grey));
    };
    placed(tests::ground(30.0f), false);
    for (const auto& [lo, hi] : boxes) placed(tests::box(lo, hi), true);
    LightShape light;
    light.kind = LightKind::Directional;
    light.axis = glm::normalize(axis());
    const float side = 2.0f * float(std::tan(0.5 * degrees * kDegree));
    if (rectangle) light.skyRectangle = Vec2(side, 0.5f * side), light.u = glm::normalize(glm::cross(light.axis, Vec3(0, 0, 1)));
    else light.angularSize = float(degrees * kDegree);
    m.light(light);
    Camera c;
    c.perspective = false;
    c.yheight = scale * pixel * float(picture.height);
    c.toWorld = Mat4(Vec4(1, 0, 0, 0), Vec4(0, 0, -1, 0), Vec4(0, 1, 0, 0), Vec4(scale * (aim + moved + Vec3(0, 1, 0)), 1));
    m.scene.cameras.assign(1, c);
    return m.finish();
  }
};
constexpr float kRoof = 2.0f;
/// Half a roof over x < 0, before it is turned; the camera sees 2.4 penumbras of its edge.
SunStage edge(double degrees, double tilt = 0, double azimuth = 0, double turn = 0) {
  SunStage s{degrees, tilt, azimuth, turn};
  s.boxes = {{Vec3(-25, kRoof, -25), Vec3(0, kRoof, 25)}};  // of no thickness: one edge
  s.aim = Vec3(DVec3(s.axis()) * (kRoof / std::cos(tilt * kDegree))) + Vec3(0, kRoof, 0);
  s.pixel = float(2.4 * kRoof * std::tan(0.5 * degrees * kDegree) / (96 * std::pow(std::cos(tilt * kDegree), 2)));
  return s;
}
/// Of a receiver: sine of the angle between the sun's axis and the plane through the roof's edge over that of the half angle, above 0 where it is seen.
double place(const SunStage& s, const Vec3& p) {
  const DVec3 along(s.turned(Vec3(0, 0, 1))), to = DVec3(s.turned(Vec3(0, kRoof, 0))) - DVec3(p) / double(s.scale) + DVec3(s.moved);
  const DVec3 n = glm::normalize(glm::cross(to, along));
  return -glm::dot(n, glm::normalize(DVec3(s.axis()))) / std::sin(0.5 * s.degrees * kDegree);
}

v1::ShadowTechnique filtered(double samples = 0) {
  v1::ShadowTechnique t;
  t.mutable_axis_aligned();
  if (samples > 0) t.mutable_axis_aligned()->set_mean_samples(samples);
  return t;
}
v1::ShadowTechnique published() {
  v1::ShadowTechnique t = filtered();
  auto& m = *t.mutable_axis_aligned();
  m.set_pilot(9);
  m.set_rate(v1::AxisAlignedShadow::EQUATION);
  m.set_width(v1::AxisAlignedShadow::BAND_LIMIT);
  m.set_kernel(v1::AxisAlignedShadow::GAUSSIAN);
  return t;
}
double rms(std::span<const float> a, const std::function<double(size_t)>& truth) {
  double sum = 0;
  for (size_t i = 0; i < a.size(); ++i) sum += sqr(a[i] - truth(i));
  return std::sqrt(sum / double(a.size()));
}
const ShadowPicture kPicture{96, 48, 2};

TEST(AxisAlignedSun, PilotMeasuresDistancesAlongTheAxis) {
  // Two lids at 2 and 3 m: straight down 2 and 3 whatever the ray; at a slant as far along the axis as the ray's own slant takes it there.
  for (const double tilt : {0.0, 35.0}) {
    SunStage s{6, tilt, 20};
    s.boxes = {{Vec3(-20, 2, -20), Vec3(20, 2.0f, 20)}, {Vec3(-20, 3, -20), Vec3(20, 3.0f, 20)}};
    const ShadowRun r = runShadow(s.scene({6, 4}), published(), {6, 4});
    ASSERT_TRUE(r.ok()) << r.status.toString();
    const TermPtr slopes = r.term("shadow_slopes");
    const double c = std::cos(tilt * kDegree), spread = 1 + std::tan(3 * kDegree) * std::tan(tilt * kDegree) * 1.05;
    for (size_t i = 0; i < r.size(); ++i) {
      EXPECT_LE(slopes->floats("sMin")[i], 2 / c * (1 + 1e-4));
      EXPECT_GE(slopes->floats("sMin")[i], 2 / c / spread * (1 - 1e-4));
      EXPECT_GE(slopes->floats("sMax")[i], 3 / c * (1 - 1e-4));
      EXPECT_LE(slopes->floats("sMax")[i], 3 / c * spread * (1 + 1e-4));
    }
    EXPECT_EQ(r.raysOf("shadow_slopes"), 24u * 18u);  // forward and back
  }
}

TEST(AxisAlignedSun, SigmaIsThatOfTheProfile) {
  // The mean square of a cap's tangents along one axis by quadrature, and of a rectangle's.
  for (const double degrees : {1e-3, 0.53, 10.0, 90.0}) {
    LightShape l;
    l.kind = LightKind::Directional;
    l.angularSize = float(degrees * kDegree);
    double sum = 0, weight = 0;
    const int n = 20000;
    for (int i = 0; i < n; ++i) {
      const double theta = 0.5 * degrees * kDegree * (i + 0.5) / n;
      sum += std::sin(theta) * sqr(std::tan(theta)) / 2;
      weight += std::sin(theta);
    }
    const ShadowLightFrame f = shadowLightFrame(l);
    EXPECT_TRUE(f.distant);
    EXPECT_NEAR(f.sigma / std::sqrt(sum / weight), 1, 1e-5) << degrees;
    l.angularSize = 0;
    l.skyRectangle = Vec2(0.3f, 0.1f);
    EXPECT_NEAR(shadowLightFrame(l).sigma, std::sqrt(0.03 / 12), 1e-6);
  }
}

TEST(AxisAlignedSun, PublishedWidthIsSigmaTimesTheDistance) {
  // beta = (1/k) max(sigma_theta z, d): in the penumbra of an edge 2 m above, and d where the sun is a point for the pixel.
  for (const double degrees : {4.0, 0.01}) {
    SunStage s = edge(4);
    s.degrees = degrees;
    const ShadowRun r = runShadow(s.scene(kPicture), published(), kPicture);
    ASSERT_TRUE(r.ok());
    const TermPtr width = r.term("shadow_sample_count");
    const auto footprint = r.view().floats("footprint");
    size_t filteredPixels = 0;
    for (size_t i = 0; i < r.size(); ++i) {
      const float omega = width->floats("Omega")[i];
      if (omega == 0.0f) continue;
      const double beta = 1 / (3 * double(omega)), sigma = 0.5 * std::tan(0.5 * degrees * kDegree);
      EXPECT_NEAR(beta / (std::max(sigma * kRoof, double(footprint[i])) / 3), 1, 2e-3);
      ++filteredPixels;
    }
    EXPECT_GT(filteredPixels, 500u) << degrees;
  }
}

TEST(AxisAlignedSun, EdgeGivesTheSegmentOfADisk) {
  for (const double degrees : {0.53, 4.0}) {
    const SunStage s = edge(degrees);
    const ScenePtr scene = s.scene(kPicture);
    const auto error = [&](const v1::ShadowTechnique& t) {
      const ShadowRun r = runShadow(scene, t, kPicture);
      EXPECT_TRUE(r.ok()) << r.status.toString();
      return rms(r.V(), [&](size_t i) { return segment(place(s, r.at("P", i))); });
    };
    const double sixteen = error(filtered(16)), plain = error(rayTraced(16)), many = error(filtered(256)), old = error(published());
    std::printf("%.2f degrees: filtered, 16 rays %.4f; plain %.4f; filtered, 256 rays %.4f; published %.4f\n", degrees, sixteen, plain, many, old);
    EXPECT_LT(sixteen, 0.3 * plain);
    EXPECT_LT(many, 0.6 * sixteen);
    EXPECT_LT(many, 0.002);
    EXPECT_LT(old, 0.013);  // its bias: 5.4 % of the penumbra's width
  }
}

TEST(AxisAlignedSun, ARectangleInTheSkyGivesARamp) {
  SunStage s = edge(6);
  s.rectangle = true;
  const ShadowRun r = runShadow(s.scene(kPicture), filtered(64), kPicture);
  ASSERT_TRUE(r.ok()) << r.status.toString();
  // Its wider side across the edge or along it: which, says mapFrame.
  const double across = rms(r.V(), [&](size_t i) { return clamp01(float(0.5 + double(r.at("P", i).x) / (2 * kRoof * std::tan(3 * kDegree)))); });
  const double along = rms(r.V(), [&](size_t i) { return clamp01(float(0.5 + double(r.at("P", i).x) / (kRoof * std::tan(3 * kDegree)))); });
  std::printf("ramp across %.4f, along %.4f\n", across, along);
  EXPECT_LT(std::min(across, along), 0.006);
  EXPECT_GT(std::max(across, along), 0.05);
}

TEST(AxisAlignedSun, TurningTheSunAboutTheSceneOnlyTurnsTheShadow) {
  // Edges that the sun meets square on, at a slant and along its own way: each has the error of the others.
  for (const double azimuth : {0.0, 75.0, 140.0, 220.0, 301.0})
    for (const double turn : {0.0, 33.0}) {
      const SunStage s = edge(4, 40, azimuth, turn);
      const ScenePtr scene = s.scene(kPicture);
      const ShadowRun r = runShadow(scene, filtered(16), kPicture), plain = runShadow(scene, rayTraced(16), kPicture);
      ASSERT_TRUE(r.ok());
      size_t between = 0;
      for (const float v : r.V()) between += v > 0.05f && v < 0.95f;
      const auto truth = [&](size_t i) { return segment(place(s, r.at("P", i))); };
      const double error = rms(r.V(), truth), noise = rms(plain.V(), truth);
      std::printf("sun from %.0f, edge turned by %.0f: %.4f, plain %.4f, %zu pixels of penumbra\n", azimuth, turn, error, noise, between);
      EXPECT_GT(between, 800u) << azimuth << " " << turn;
      EXPECT_LT(error, 0.015) << azimuth << " " << turn;  // cosines at the receiver differ by 6 % over this sun: 0.004 of it
      EXPECT_LT(error, 0.6 * noise) << azimuth << " " << turn;
    }
}

/// Two scenes whose shadows lie on each other: slats over a beam, and boxes that stand on the floor.
std::vector<SunStage> crowded() {
  SunStage slats{5, 30, 70, 20}, boxes{8, 45, 200, 0};
  slats.pixel = boxes.pixel = 0.015f;
  for (int i = -12; i < 12; ++i) slats.boxes.push_back({Vec3(0.4f * float(i), 1.6f, -8), Vec3(0.4f * float(i) + 0.15f, 1.65f, 8)});
  slats.boxes.push_back({Vec3(-8, 3, -0.2f), Vec3(8, 3.2f, 0.2f)});
  for (int i = 0; i < 5; ++i)
    boxes.boxes.push_back(
        {Vec3(0.7f * float(i) - 2, 0, 0.3f * float(i % 2)), Vec3(0.7f * float(i) - 1.7f, 0.3f + 0.15f * float(i), 0.3f + 0.3f * float(i % 2))});
  return {slats, boxes};
}

TEST(AxisAlignedSun, ErrorFallsBelowThatOfAsManyPlainRays) {
  // As many as the filter's pixels got in the mean, rounded up.
  int k = 0;
  for (const SunStage& s : crowded()) {
    const ScenePtr scene = s.scene(kPicture);
    const ShadowRun truth = runShadow(scene, rayTraced(testing::thoroughOr(4096u, 2048u)), kPicture);
    const auto errorOf = [&](const ShadowRun& r) { return rms(r.V(), [&](size_t i) { return double(truth.V()[i]); }); };
    double last = 1;
    for (const int n : {4, 16, 64}) {
      const ShadowRun f = runShadow(scene, filtered(n), kPicture);
      const double mean = double(f.raysOf("shadow_slopes") + f.raysOf("shadow_adaptive")) / double(f.size());
      const double filter = errorOf(f), plain = errorOf(runShadow(scene, rayTraced(uint32_t(std::ceil(mean))), kPicture));
      std::printf("scene %d, %d rays, %.1f in the mean: filtered %.4f, plain %.4f\n", k, n, mean, filter, plain);
      EXPECT_LT(filter, (n < 64 ? 0.6 : 0.8) * plain) << k << " " << n;  // boxes touch the floor: errors of single pixels
      EXPECT_LT(filter, 0.75 * last) << k << " " << n;
      last = filter;
    }
    ++k;
  }
}

TEST(AxisAlignedSun, SceneScaleChangesNothing) {
  for (const v1::ShadowTechnique& t : {filtered(16), published()}) {
    SunStage s = crowded()[0];
    const ShadowRun one = runShadow(s.scene(kPicture), t, kPicture);
    for (const float scale : {1.0f / 1024, 1024.0f}) {  // powers of two: the same digits
      s.scale = scale;
      const ShadowRun r = runShadow(s.scene(kPicture), t, kPicture);
      double worst = 0;
      for (size_t i = 0; i < r.size(); ++i) worst = std::max(worst, double(std::fabs(r.V()[i] - one.V()[i])));
      EXPECT_LT(worst, 1e-5) << scale;
    }
    for (const float scale : {1e-3f, 1e3f}) {  // rays of other digits: a hit at an edge may turn
      s.scale = scale;
      const ShadowRun r = runShadow(s.scene(kPicture), t, kPicture);
      EXPECT_LT(rms(r.V(), [&](size_t i) { return double(one.V()[i]); }), 2e-3) << scale;
    }
  }
}

TEST(AxisAlignedSun, FarFromTheOrigin) {
  // 4 km off a float has 0.5 mm, a thirtieth of a pixel; rays leave the floor by more there, so the truth is that place's own.
  SunStage s = crowded()[0];
  s.moved = Vec3(4096, 0, 4096);
  const ScenePtr scene = s.scene(kPicture);
  const ShadowRun truth = runShadow(scene, rayTraced(1024), kPicture);
  const auto error = [&](const v1::ShadowTechnique& t) { return rms(runShadow(scene, t, kPicture).V(), [&](size_t i) { return double(truth.V()[i]); }); };
  const double filter = error(filtered(16)), plain = error(rayTraced(16));
  std::printf("far from the origin: filtered %.4f, plain %.4f\n", filter, plain);
  EXPECT_LT(filter, 0.6 * plain);
}

TEST(AxisAlignedSun, UnshadowedIsExactlyOneAndUmbraExactlyZero) {
  for (const v1::ShadowTechnique& t : {filtered(), published()}) {
    SunStage s{4, 30, 50};
    const ShadowRun open = runShadow(s.scene({24, 16}), t, {24, 16});
    for (const float v : open.V()) ASSERT_EQ(v, 1.0f);
    s.boxes = {{Vec3(-20, 2, -20), Vec3(20, 2.01f, 20)}};
    const ShadowRun shut = runShadow(s.scene({24, 16}), t, {24, 16});
    for (const float v : shut.V()) ASSERT_EQ(v, 0.0f);
  }
}

TEST(AxisAlignedSun, ContactStaysFiniteAndBitsAreThoseOfAnyNumberOfThreads) {
  for (const v1::ShadowTechnique& t : {filtered(), published()}) {
    SunStage s{1, 60, 10};
    s.boxes = {{Vec3(-20, 0, -20), Vec3(0, 1e-6f, 20)}, {Vec3(-20, 1e-3f, -20), Vec3(-0.2f, 0.1f, 20)}};
    s.pixel = 0.02f;
    ShadowPicture picture{40, 24, 1};
    const ScenePtr scene = s.scene(picture);
    const ShadowRun one = runShadow(scene, t, picture);
    for (const TermPtr& term : one.terms)
      for (const Plane& plane : term->planes())
        if (plane.format == Format::F32) {
          for (const float v : term->floats(plane.name)) ASSERT_TRUE(std::isfinite(v)) << term->type() << "." << plane.name;
        }
    picture.threads = 7;
    EXPECT_EQ(one.terms[size_t(one.visibility)]->content(), runShadow(scene, t, picture).terms[size_t(one.visibility)]->content());
  }
}

TEST(AxisAlignedSun, ASunWithoutSizeIsRefusedByName) {
  tests::SceneMaker m;
  m.instance(m.mesh(tests::ground(3.0f), m.material(Vec3(0.5f))));
  LightShape l;
  l.kind = LightKind::Directional;
  m.light(l);
  m.camera(Vec3(0, 3, 1), Vec3(0));
  const ShadowRun r = runShadow(m.finish(), filtered(), {8, 8});
  ASSERT_FALSE(r.ok());
  EXPECT_EQ(r.status.code(), Code::InvalidArgument);
  EXPECT_NE(r.status.toString().find("l0"), std::string::npos) << r.status.toString();
}

}  // namespace
}  // namespace gobo::test
