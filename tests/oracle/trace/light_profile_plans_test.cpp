// SPDX-License-Identifier: Apache-2.0
// A plane under a spot with a picture, by the path tracer and by every technique that shadows spots. Oracle: the picture at the projected point times
// intensity, falloff, cosine and inverse square, in closed form, averaged over each pixel. The lamp slants and its picture is turned.
#include <gtest/gtest.h>

#include "filters/shadow_technique.h"
#include "support/engines.h"
#include "support/tiny_scenes.h"

namespace gobo::testing {
namespace light_profile_plans {

constexpr int kPixels = 24;
constexpr float kHalf = 1.2f;  // of the window, metres
constexpr double kAlbedo = 0.5, kIntensity = 10;

struct Lamp {
  double height = 2, slant = 0, rotation = 0, outer = 30;  ///< degrees
  bool measured = false;                                   ///< a table by angle instead of a picture
};

std::vector<Vec3> texels() {
  std::vector<Vec3> out;
  for (int i = 0; i < 25; ++i) out.emplace_back(float(i * 7 % 11) / 10.0f, float(i % 5) / 4.0f, 0.2f + float(i / 5) / 8.0f);
  return out;
}

ScenePtr stage(const Lamp& lamp) {
  tests::SceneMaker m;
  m.instance(m.mesh(tests::ground(4.0f), m.material(Vec3(float(kAlbedo)))));
  auto p = std::make_shared<LightProfile>();
  if (lamp.measured) {
    p->kind = ProfileKind::Photometry;
    p->width = 5;
    p->height = 3;
    for (const Vec3& v : texels())
      if (p->values.size() < 15) p->values.push_back(Vec3(v.z));
    p->vertical = {0.0f, 0.3f, 1.2f};
    p->horizontal = {0.0f, 1.0f, 2.0f, 4.0f, 2.0f * kPi};
    for (int row = 0; row < 3; ++row) p->values[size_t(row) * 5 + 4] = Vec3(std::as_const(*p).values[size_t(row) * 5]);
  } else {
    p->width = p->height = 5;
    p->values = texels();
  }
  EXPECT_TRUE(sealProfile(*p).ok());
  m.scene.profiles = {p};
  LightShape s;
  s.kind = LightKind::Spot;
  s.position = Vec3(0, float(lamp.height), 0);
  s.axis = glm::normalize(Vec3(float(std::tan(lamp.slant * M_PI / 180)), -1, 0));
  s.u = Vec3(1, 0, 0);
  s.cosOuter = float(std::cos(lamp.outer * M_PI / 180));
  s.cosInner = float(std::cos(0.9 * lamp.outer * M_PI / 180));
  s.profile = 0;
  s.profileRotation = float(lamp.rotation * M_PI / 180);
  m.light(s, Vec3(float(kIntensity)));
  Camera c;
  c.perspective = false;
  c.yheight = 2 * kHalf;
  c.toWorld = Mat4(Vec4(1, 0, 0, 0), Vec4(0, 0, -1, 0), Vec4(0, 1, 0, 0), Vec4(0, 1, 0, 1));  // x right, -z up in the picture
  m.scene.cameras.assign(1, c);
  return m.finish();
}

/// Radiance of the floor at (x, z): only numbers of the stage, none of the renderer's functions.
DVec3 radiance(const Lamp& lamp, double x, double z) {
  const double slant = lamp.slant * M_PI / 180, turn = lamp.rotation * M_PI / 180;
  const DVec3 axis(std::sin(slant), -std::cos(slant), 0), right0(std::cos(slant), std::sin(slant), 0), down0 = glm::cross(axis, right0);
  const DVec3 right = std::cos(turn) * right0 - std::sin(turn) * down0, down = std::sin(turn) * right0 + std::cos(turn) * down0;
  const DVec3 to = DVec3(x, -lamp.height, z);
  const double d2 = glm::dot(to, to), d = std::sqrt(d2), along = glm::dot(to, axis), a = glm::dot(to, right), b = glm::dot(to, down);
  const double cosOuter = std::cos(lamp.outer * M_PI / 180), cosInner = std::cos(0.9 * lamp.outer * M_PI / 180);
  const double ramp = std::clamp((along / d - cosOuter) / (cosInner - cosOuter), 0.0, 1.0);
  DVec3 value(0.0);
  const std::vector<Vec3> t = texels();
  if (along > 0 && lamp.measured) {
    const double vertical[] = {0, 0.3, 1.2}, horizontal[] = {0, 1, 2, 4, 2 * M_PI};
    const double theta = std::atan2(std::hypot(a, b), along);
    double phi = std::atan2(-b, a);
    if (phi < 0) phi += 2 * M_PI;
    for (int v = 0; v < 2; ++v)
      for (int h = 0; h < 4; ++h) {
        if (theta < vertical[v] || theta > vertical[v + 1] || phi < horizontal[h] || phi >= horizontal[h + 1]) continue;
        const double s = (phi - horizontal[h]) / (horizontal[h + 1] - horizontal[h]), r = (theta - vertical[v]) / (vertical[v + 1] - vertical[v]);
        const auto at = [&](int row, int column) { return double(t[size_t(row * 5 + column % 4)].z); };
        value = DVec3((at(v, h) * (1 - s) + at(v, h + 1) * s) * (1 - r) + (at(v + 1, h) * (1 - s) + at(v + 1, h + 1) * s) * r);
      }
  } else if (along > 0) {
    const double tangent = std::tan(lamp.outer * M_PI / 180), u = (0.5 + 0.5 * a / along / tangent) * 5 - 0.5, v = (0.5 + 0.5 * b / along / tangent) * 5 - 0.5;
    const auto at = [&](double i, double k) { return DVec3(t[size_t(std::clamp(k, 0.0, 4.0)) * 5 + size_t(std::clamp(i, 0.0, 4.0))]); };
    const double fu = std::floor(u), fv = std::floor(v), s = u - fu, r = v - fv;
    value = (at(fu, fv) * (1 - s) + at(fu + 1, fv) * s) * (1 - r) + (at(fu, fv + 1) * (1 - s) + at(fu + 1, fv + 1) * s) * r;
  }
  return value * (kAlbedo / M_PI * kIntensity * ramp * ramp * (lamp.height / d) / d2);
}

const std::vector<Lamp> kLamps{{2, 0, 0, 30}, {2, 0, 90, 30}, {2, 20, 33, 30}, {1.5, -15, 200, 45}, {2, 10, 40, 35, true}};

/// Largest difference over pixels, as a share of the brightest.
double worst(const Image& image, const Lamp& lamp, int sub) {
  double most = 0, off = 0;
  for (int y = 0; y < kPixels; ++y)
    for (int x = 0; x < kPixels; ++x) {
      DVec3 truth(0.0);
      for (int k = 0; k < sub * sub; ++k)
        truth += radiance(lamp, (2 * (x + (k % sub + 0.5) / sub) / kPixels - 1) * kHalf, (2 * (y + (k / sub + 0.5) / sub) / kPixels - 1) * kHalf) /
                 double(sub * sub);
      for (int c = 0; c < 3; ++c) {
        EXPECT_TRUE(std::isfinite(image.at(x, y)[c]));
        off = std::max(off, std::fabs(double(image.at(x, y)[c]) - truth[c]));
        most = std::max(most, truth[c]);
      }
    }
  EXPECT_GT(most, 0.1);
  return off / most;
}

v1::RenderRequest stageRequest(int spp, int viewSamples) {
  v1::RenderRequest r = smallRequest("stage", kPixels, kPixels, spp);
  r.set_view_samples(uint32_t(viewSamples));
  r.mutable_integrator()->set_max_bounces(0);
  return r;
}

TEST(LightProfilePlans, ThePathTracerProjectsThePicture) {
  for (const Lamp& lamp : kLamps) {
    const auto engine = makeEngine();
    RenderControl control;
    control.scene = stage(lamp);
    v1::RenderRequest r = stageRequest(256, 1);
    set(r, "shadows.path_traced=");
    const auto result = engine->render(r, control);
    ASSERT_TRUE(result.ok()) << result.status().toString();
    const double off = worst(result->images.at(0).image(), lamp, 8);
    std::printf("path_traced, slant %.0f rotation %.0f%s: largest error %.4f\n", lamp.slant, lamp.rotation, lamp.measured ? " table" : "", off);
    EXPECT_LT(off, 0.02);  // the filter of pixels is not a box; the picture's slope over it
  }
}

TEST(LightProfilePlans, EveryTechniqueProjectsThePicture) {
  for (const ShadowTechniqueEntry& t : shadowTechniques()) {
    if (!t.supports(LightKind::Spot)) continue;
    for (const Lamp& lamp : kLamps) {
      const auto engine = makeEngine();
      RenderControl control;
      control.scene = stage(lamp);
      v1::RenderRequest r = stageRequest(4, 16);
      v1::ShadowTechnique& technique = *r.mutable_shadows();
      technique.GetReflection()->MutableMessage(&technique, technique.GetDescriptor()->FindFieldByNumber(t.key));
      if (t.usesMap) technique.mutable_map()->set_resolution(256);
      const auto result = engine->render(r, control);
      ASSERT_TRUE(result.ok()) << t.name << ": " << result.status().toString();
      const double off = worst(result->images.at(0).image(), lamp, 4);
      std::printf("%-22s slant %.0f rotation %.0f%s: largest error %.4f\n", t.name, lamp.slant, lamp.rotation, lamp.measured ? " table" : "", off);
      EXPECT_LT(off, 0.05) << t.name;  // maps lose some at the cone's rim
    }
  }
}

}  // namespace light_profile_plans
}  // namespace gobo::testing
