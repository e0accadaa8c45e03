// SPDX-License-Identifier: Apache-2.0
// Camera fit: what the camera sees is covered, what shadows it is kept, a drag re-keys rarely, light leaks scale with the range.
#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "base/sobol.h"
#include "filters/shadow_map/camera_fit.h"
#include "scene/load.h"
#include "support/shadow_stage.h"
#include "support/tiny_scenes.h"

namespace gobo::test {
namespace {

LightShape lightFor(const Vec3& lo, const Vec3& hi, LightKind kind) {
  LightShape l;
  l.kind = kind;
  l.axis = glm::normalize(Vec3(0.4f, -1.0f, 0.2f));
  const bool inside = kind == LightKind::Point || kind == LightKind::Rect;
  l.position = 0.5f * (lo + hi) - l.axis * (inside ? 0.15f : 1.1f) * glm::length(hi - lo);
  l.cosOuter = std::cos(0.9f);
  return l;
}
Camera lookAt(const Vec3& from, const Vec3& to, float yfov = 0.7f, bool perspective = true) {
  tests::SceneMaker s;
  s.camera(from, to, yfov);
  Camera c = s.scene.cameras[0];
  c.perspective = perspective;
  c.yheight = 1.5f;
  return c;
}
constexpr LightKind kKinds[] = {LightKind::Directional, LightKind::Spot, LightKind::Rect, LightKind::Point};

TEST(CameraFit, SizesAndIntervals) {
  for (int i = 0; i < 2000; ++i) {
    const double v = std::exp2(20.0 * toUnit(hash32(1, i)) - 10.0), s = snappedSize(v);
    EXPECT_GE(s, v);
    EXPECT_LE(s, v * 9.0 / 8.0 * (1 + 1e-12));
    const double eighths = s / std::exp2(std::ilogb(s)) * 8.0;
    EXPECT_EQ(eighths, std::round(eighths)) << v;
    const double a = 100.0 * (toUnit(hash32(2, i)) - 0.5), b = a + v;
    const Interval in = snappedInterval(a, b);
    EXPECT_LE(in.lo, a);
    EXPECT_GE(in.hi, b - 1e-12 * (std::fabs(b) + v));
    EXPECT_LE(in.hi - in.lo, 81.0 / 56.0 * v * (1 + 1e-9));  // 9/8 of 8/7... of the ladder's worst step
  }
}

struct Placed {
  double u, v, d, w;
};
Placed place(const LightFrame& f, const Vec3& p) {
  const LightFrame::Rows r = f.rows();
  const Vec4 q(p - f.origin, 1.0f);
  const double w = glm::dot(r.w, q);
  return {glm::dot(r.u, q) / w, glm::dot(r.v, q) / w, glm::dot(r.d, q), w};
}

// Everything that the camera sees and the scene's map covers lies in the fitted map, off its rim, and in [0,1] of its range; the fitted one is never
// wider or deeper.
TEST(CameraFit, CoversAllThatIsSeen) {
  constexpr int kSide = 256, kRim = 3;
  const TaskArena arena(2);
  int narrower = 0, points = 0;
  for (const char* name : {"cornell", "fence", "lamps"}) {
    const ScenePtr scene = *makeBuiltinScene(name);
    const std::vector<int> none;
    const AccelPtr accel = Accel::build(SceneView(*scene, Facet::Topology | Facet::Pose | Facet::Coverage, none), arena);
    Vec3 lo, hi;
    scene->bounds(lo, hi);
    const Vec3 centre = 0.5f * (lo + hi), half = 0.5f * (hi - lo);
    std::vector<Camera> cameras{
        scene->cameras[0], lookAt(centre + 0.3f * half, centre - 0.8f * half), lookAt(centre + 3.0f * half, centre + Vec3(0.3f, 0, 0) * half, 0.1f),
        lookAt(centre + Vec3(0, 0.9f, 0) * half, centre - Vec3(0, 1, 0.1f) * half, 0.3f), lookAt(centre, centre + Vec3(1, -0.4f, 0.3f) * half, 0.7f, false)};
    cameras.back().centre = Vec2(0.2f, -0.1f);
    for (const Camera& camera : cameras)
      for (LightKind kind : kKinds)
        for (bool pancake : {true, false}) {
          const LightShape light = lightFor(lo, hi, kind);
          const LightFrames all = *fitLightFrames(light, lo, hi, kSide, kRim);
          LightFrames fitted = all;
          CameraFit fit;
          fit.camera = camera;
          fit.aspect = 1.5f;
          fit.pancake = pancake;
          fitToCamera(fitted, fit, lo, hi, kSide, kRim);
          for (int f = 0; f < all.count; ++f) {
            const LightFrame &a = all.face[size_t(f)], &b = fitted.face[size_t(f)];
            EXPECT_LE(b.hi.x - b.lo.x, (a.hi.x - a.lo.x) * 1.00001f);
            EXPECT_GE(b.near, a.near);
            EXPECT_LE(b.far, a.far);
            EXPECT_LT(b.near, b.far);
            EXPECT_EQ(b.start, a.start) << "rays begin before every caster";
            narrower += b.sees && b.hi.x - b.lo.x < 0.9f * (a.hi.x - a.lo.x);
          }
          for (int i = 0; i < 600; ++i) {
            const Ray ray = cameraRay(camera, 600, 400, 600.0f * toUnit(hash32(1, i)), 400.0f * toUnit(hash32(2, i)));
            Hit hit;
            if (!accel->intersect(ray, hit)) continue;
            const Vec3 p = ray.origin + ray.direction * hit.t;
            const int face = all.count > 1 ? cubeFace(p - light.position) : 0;
            const Placed before = place(all.face[size_t(face)], p), after = place(fitted.face[size_t(face)], p);
            const double rim = double(kRim) / kSide;
            if (!(before.w > 0) || before.u < rim || before.u > 1 - rim || before.v < rim || before.v > 1 - rim) continue;  // beyond the light's own map
            ++points;
            const auto where = [&] { return std::string(name) + " camera " + std::to_string(&camera - cameras.data()) + " kind " + std::to_string(int(kind)); };
            ASSERT_TRUE(fitted.face[size_t(face)].sees) << where();
            ASSERT_GE(std::min(after.u, after.v), rim - 1e-4) << where();
            ASSERT_LE(std::max(after.u, after.v), 1 - rim + 1e-4) << where();
            ASSERT_GE(after.d, -1e-5) << where();
            ASSERT_LE(after.d, 1 + 1e-5) << where();
          }
        }
  }
  EXPECT_GT(points, 20000);
  EXPECT_GT(narrower, 30);
}

// Hundred steps of a drag over two thirds of what is seen: each of two window axes and the range moves by eighths of its size (at most 6 steps each), and
// its size passes a few rungs. A fit that followed the camera would re-key 100 times, the scene's never.
TEST(CameraFit, ADragRekeysRarely) {
  const Vec3 lo(-20, 0, -20), hi(20, 2, 20);
  for (LightKind kind : kKinds)
    for (int motion = 0; motion < 3; ++motion) {
      LightShape light = lightFor(lo, hi, kind);
      if (kind == LightKind::Point || kind == LightKind::Rect) light.position = Vec3(0, 12, 0);
      std::set<std::string> keys;
      int changes = 0;
      std::string last;
      for (int i = 0; i <= 100; ++i) {
        const float t = float(i) * 0.01f;
        CameraFit fit;
        const Vec3 at = motion == 0 ? Vec3(2 * t, 0, 0) : Vec3(0.0f);                             // sideways
        const Vec3 eye = motion == 1   ? Vec3(4 * std::sin(0.5f * t), 3, 4 * std::cos(0.5f * t))  // around
                         : motion == 2 ? Vec3(0, 3, 4) * (1.0f + 0.4f * t)
                                       : Vec3(0, 3, 4);  // away
        fit.camera = lookAt(at + eye, at, 0.5f);
        LightFrames frames = *fitLightFrames(light, lo, hi, 512, 3);
        fitToCamera(frames, fit, lo, hi, 512, 3);
        Hasher h;
        frames.hash(h);
        const std::string key = h.digest().hex();
        changes += i > 0 && key != last;
        keys.insert(key);
        last = key;
      }
      std::printf("light kind %d, drag %d: %d changes of 100 steps, %zu keys\n", int(kind), motion, changes, keys.size());
      EXPECT_LE(changes, 20) << int(kind) << " " << motion;
    }
}

// A camera that sees the whole scene has the scene's map: the same key.
TEST(CameraFit, SeeingEverythingIsTheScenesMap) {
  const Vec3 lo(-1, 0, -1), hi(1, 1, 1);
  for (LightKind kind : kKinds) {
    const LightFrames all = *fitLightFrames(lightFor(lo, hi, kind), lo, hi, 128, 2);
    LightFrames fitted = all;
    CameraFit fit;
    fit.camera = lookAt(Vec3(0, 4, 30), Vec3(0, 0.5f, 0), 0.7f);
    fitToCamera(fitted, fit, lo, hi, 128, 2);
    Hasher a, b;
    all.hash(a);
    fitted.hash(b);
    EXPECT_EQ(a.digest().hex(), b.digest().hex()) << int(kind);
  }
}

TEST(CameraFit, ACameraThatSeesNothingNeedsNoRay) {
  const Vec3 lo(-1, 0, -1), hi(1, 1, 1);
  for (LightKind kind : kKinds) {
    LightFrames frames = *fitLightFrames(lightFor(lo, hi, kind), lo, hi, 128, 2);
    CameraFit fit;
    fit.camera = lookAt(Vec3(0, 4, 30), Vec3(0, 4, 60));
    fitToCamera(frames, fit, lo, hi, 128, 2);
    for (int f = 0; f < frames.count; ++f) EXPECT_FALSE(frames.face[size_t(f)].sees) << int(kind);
  }
}

/// A long floor under a sun, a card near it and one far above it, both over the place that the camera looks at.
ScenePtr pancakeScene(LightKind kind) {
  tests::SceneMaker s;
  const int grey = s.material(Vec3(0.5f));
  s.instance(s.mesh(tests::ground(30.0f), grey));
  s.instance(s.mesh(tests::quad(Vec3(-0.4f, 25.0f, 0.4f), Vec3(0.8f, 0, 0), Vec3(0, 0, -0.8f)), grey));
  s.instance(s.mesh(tests::quad(Vec3(0.6f, 0.3f, 0.2f), Vec3(0.4f, 0, 0), Vec3(0, 0, -0.4f)), grey));
  LightShape l;
  l.kind = kind;
  l.position = Vec3(0, 60, 0);
  l.axis = Vec3(0, -1, 0);
  l.cosOuter = std::cos(0.6f);
  l.cosInner = std::cos(0.5f);
  s.light(l);
  s.camera(Vec3(0, 2.5f, 3), Vec3(0.2f, 0, 0), 0.8f);
  return s.finish();
}

double disagreement(const ShadowRun& map, const ShadowRun& truth) {
  size_t wrong = 0, judged = 0;
  for (size_t i = 0; i < map.size(); ++i) {
    if (!map.surface(i)) continue;
    ++judged;
    wrong += std::fabs(map.V()[i] - truth.V()[i]) > 0.1f;
  }
  return double(wrong) / double(std::max<size_t>(judged, 1));
}

// A caster far in front of all that is seen still shades ("pancaking"), and the narrow window resolves what the scene's cannot.
TEST(CameraFit, CastersInFrontOfTheRangeStillShade) {
  for (LightKind kind : {LightKind::Directional, LightKind::Spot}) {
    const ScenePtr scene = pancakeScene(kind);
    const ShadowPicture picture{96, 64};
    const ShadowRun truth = runShadow(scene, rayTraced(), picture);
    for (const char* name : {"shadow_map", "percentage_closer", "exponential", "variance", "moment", "exponential_variance", "convolution"}) {
      v1::ShadowTechnique t = mapTechnique(name);
      t.mutable_map()->set_resolution(256);
      const double whole = disagreement(runShadow(scene, t, picture), truth);
      t.mutable_map()->set_fit(v1::ShadowMapSettings::CAMERA);
      const ShadowRun fitted = runShadow(scene, t, picture);
      const double narrow = disagreement(fitted, truth);
      std::printf("%-22s kind %d: %.1f %% of pixels off with the scene's map, %.1f %% with the camera's\n", name, int(kind), 100 * whole, 100 * narrow);
      EXPECT_LT(narrow, 0.03) << name << " " << int(kind);
      if (std::string(name) != "shadow_map") { EXPECT_LT(narrow, whole) << name << " " << int(kind); }  // unfiltered edges fall on either side by chance
      const auto z = fitted.term("light_depth_map");
      int clamped = 0;
      for (float v : z->floats("z")) clamped += v == 0.0f;
      EXPECT_GT(clamped, 20) << "the far card lies on the near plane";
    }
  }
}

// A flat floor square to a light a kilometre away: what float can tell apart bounds the range from below, or the floor shades itself.
TEST(CameraFit, FlatReceiversFarFromTheLightStayLit) {
  tests::SceneMaker s;
  s.instance(s.mesh(tests::ground(3.0f), s.material(Vec3(0.5f))));
  LightShape l;
  l.kind = LightKind::Spot;
  l.position = Vec3(0.3f, 1000, 0.1f);
  l.axis = glm::normalize(Vec3(0.001f, -1, 0.0007f));
  s.light(l);
  s.camera(Vec3(0, 1.0f, 1.3f), Vec3(0.0f), 0.3f);
  v1::ShadowTechnique t = mapTechnique("percentage_closer");
  t.mutable_map()->set_fit(v1::ShadowMapSettings::CAMERA);
  const ShadowRun r = runShadow(s.finish(), t);
  for (size_t i = 0; i < r.size(); ++i) ASSERT_EQ(r.V()[i], 1.0f) << i;
}

// Soft techniques keep metric depth: the range holds the nearest caster of the window, and the window all that the light's extent can reach.
TEST(CameraFit, SoftRangesHoldTheirCasters) {
  const Vec3 lo(-30, 0, -30), hi(30, 25, 30);
  LightShape l;
  l.kind = LightKind::Rect;
  l.position = Vec3(0, 60, 0);
  l.axis = Vec3(0, -1, 0);
  const LightFrames all = *fitLightFrames(l, lo, hi, 256, 2);
  CameraFit fit;
  fit.camera = lookAt(Vec3(0, 2.5f, 3), Vec3(0.2f, 0, 0), 0.6f);
  fit.lightHalf = Vec2(0.5f);
  LightFrames hard = all, soft = all;
  fitToCamera(hard, fit, lo, hi, 256, 2);
  fit.pancake = false;
  fitToCamera(soft, fit, lo, hi, 256, 2);
  EXPECT_LE(soft.face[0].near, 35.0f);
  EXPECT_GE(hard.face[0].near, 34.9f);
  // Floor points that the camera sees, every point of the light, every height between: inside the map.
  for (int i = 0; i < 3000; ++i) {
    const Ray ray = cameraRay(fit.camera, 100, 100, 100.0f * toUnit(hash32(1, i)), 100.0f * toUnit(hash32(2, i)));
    if (!(ray.direction.y < -1e-3f)) continue;
    const Vec3 p = ray.origin - ray.direction * (ray.origin.y / ray.direction.y);
    if (std::max(std::fabs(p.x), std::fabs(p.z)) > 29.0f) continue;
    const Vec3 from = l.position + Vec3(toUnit(hash32(3, i)) - 0.5f, 0, toUnit(hash32(4, i)) - 0.5f);
    const Vec3 caster = p + (from - p) * (25.0f / 60.0f * toUnit(hash32(5, i)));
    const Placed at = place(soft.face[0], caster);
    ASSERT_TRUE(at.u >= 0 && at.u <= 1 && at.v >= 0 && at.v <= 1 && at.d >= 0 && at.d <= 1) << at.u << " " << at.v << " " << at.d;
  }
}

// Digest 3.3: an exponential map lets e^{-c h / (f - n)} of the light through a caster h above its receiver. V = 1/2 at h = ln 2 (f - n) / c:
// the distance that light leaks is a share of the range. The range is set by a speck far above; a camera that does not see it gets the short one.
TEST(CameraFit, LeaksScaleWithTheRange) {
  const auto leak = [](float range, bool camera, double& whole) {
    double lo = 0.0, hi = 1.0;
    for (int step = 0; step < 12; ++step) {
      const double h = 0.5 * (lo + hi);
      tests::SceneMaker s;
      const int grey = s.material(Vec3(0.5f));
      s.instance(s.mesh(tests::ground(2.0f), grey));
      s.instance(s.mesh(tests::quad(Vec3(-1.5f, float(h), 1.5f), Vec3(3, 0, 0), Vec3(0, 0, -3)), grey));
      s.instance(s.mesh(tests::quad(Vec3(-2.0f, range, 2.0f), Vec3(0.02f, 0, 0), Vec3(0, 0, -0.02f)), grey));
      LightShape l;
      l.kind = LightKind::Directional;
      l.axis = Vec3(0, -1, 0);
      s.light(l);
      s.camera(Vec3(0, 0.5f * float(h), 1.0f), Vec3(0, 0.0f, 0), 0.05f);  // from the side, below the card
      v1::ShadowTechnique t;
      t.mutable_exponential()->set_c(20);
      t.mutable_map()->set_resolution(64);
      t.mutable_map()->set_bias(0);
      if (camera) t.mutable_map()->set_fit(v1::ShadowMapSettings::CAMERA);
      const ShadowRun r = runShadow(s.finish(), t, {9, 9});
      (r.V()[40] > 0.5f ? lo : hi) = h;
      whole = 1.002 * range;
    }
    return 0.5 * (lo + hi);
  };
  double range = 0, first = 0;
  for (float scale : {1.0f, 2.0f, 4.0f, 8.0f}) {
    const double h = leak(2.0f * scale, false, range);
    std::printf("range %.2f m: light leaks %.3f m, %.3f m by ln 2 (f - n) / c\n", range, h, std::log(2.0) * range / 20);
    EXPECT_NEAR(h, std::log(2.0) * range / 20, 0.02 * h + 1e-3);
    if (scale == 1.0f) first = h;
    EXPECT_NEAR(h / first, scale, 0.03 * scale);
  }
  const double narrow = leak(16.0f, true, range);
  std::printf("camera fit: %.3f m\n", narrow);
  EXPECT_LT(narrow, 0.5 * std::log(2.0) * range / 20);
}

}  // namespace
}  // namespace gobo::test
