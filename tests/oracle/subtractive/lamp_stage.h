// SPDX-License-Identifier: Apache-2.0
// A stage under lamps, and the nodes of subtractive shadows of lights run by hand on it.
#pragma once

#include "subtractive_stage.h"
#include "techniques/subtractive/scene_lights.h"
#include "terms/direct_unoccluded.h"
#include "terms/visibility.h"

namespace gobo::subtractive_test {

inline Light lamp(LightKind kind, const Vec3& position, const Vec3& power, const Vec3& towards = Vec3(0, -1, 0)) {
  Light l;
  l.shape.kind = kind;
  l.shape.position = position;
  l.shape.axis = glm::normalize(towards);
  const Frame f(l.shape.axis);
  l.shape.u = f.x * 0.4f;
  l.shape.v = f.y * 0.3f;
  l.shape.radius = 0.3f;
  l.shape.cosInner = 0.9f;
  l.shape.cosOuter = 0.5f;
  l.power = power;
  return l;
}

inline ScenePtr withLamps(const ScenePtr& scene, std::vector<Light> lamps) {
  auto out = std::make_shared<Scene>(*scene);
  for (Light& l : lamps) {
    l.name = "lamp" + std::to_string(out->lights.size());
    out->lights.push_back(l);
  }
  EXPECT_TRUE(out->seal().ok());
  return out;
}

/// Points, spots and directions over the stage, none alike.
inline std::vector<Light> manyLamps(int n) {
  std::vector<Light> out;
  for (int i = 0; i < n; ++i) {
    const float phi = 2.4f * float(i), away = 0.3f + 3.0f * float(i % 7) / 7.0f;
    const Vec3 at(away * std::cos(phi), 1.2f + 0.25f * float(i % 5), away * std::sin(phi));
    const Vec3 power = Vec3(0.5f + float(i % 3), 1.0f, 2.0f - 0.25f * float(i % 7)) * (3.0f / float(n));
    const LightKind kinds[] = {LightKind::Point, LightKind::Spot, LightKind::Directional};
    out.push_back(lamp(kinds[i % 3], at, power * (i % 3 == 2 ? 0.3f : 1.0f), Vec3(-at.x, -2.0f * at.y, -at.z)));
  }
  return out;
}

inline std::vector<Light> lampsOfSize() {
  return {lamp(LightKind::Rect, Vec3(0.4f, 2.6f, 0.3f), Vec3(3, 2, 1), Vec3(0.1f, -1, 0)), lamp(LightKind::Disk, Vec3(-1.2f, 1.8f, 1.0f), Vec3(1, 2, 3)),
          lamp(LightKind::Sphere, Vec3(1.4f, 1.9f, -0.6f), Vec3(2, 2, 1)),
          lamp(LightKind::Sphere, Vec3(1.4f, 1.9f, -0.6f), Vec3(1, 2, 2))};  // two in one place
}

struct LampStage : Stage {
  LampStage(const ScenePtr& bare, const std::vector<Light>& lamps, int width, int height, int viewSamples = 2, ViewPlace place = {}, int threads = 2)
      : Stage(withLamps(bare, lamps), width, height, viewSamples, place), own(threads), by(*scene, own) {
    from.view = view;
    from.seed = 5;
    for (size_t l = bare->lights.size(); l < scene->lights.size(); ++l) {
      subset.push_back(int(l));
      from.lights.push_back({int(l), scene->lights[l].power});
    }
  }
  TermPtr full() { return by(subtractive::makeUnshadowedLightsNode(from), {g, surface}, subset); }
  TermPtr traced(int r, int most) { return by(subtractive::makeLightSamplesNode({from, resampling(r), most}), {g, surface}, subset); }
  TermPtr picture(Form form, int r, int most) { return light(form, traced(r, most), full(), std::min(most, int(subset.size())), r); }

  /// One light's shadows by the house's node, one ray.
  TermPtr shadows(int l) {
    VisibilitySettings v;
    v.samples = 1;
    v.seed = from.seed;
    v.extent = view.extent();
    v.place = view.place;
    return by(makeVisibilityNode(v), {g}, {l});
  }
  /// Both lobes of the house's nodes, summed over the lamps, means over view samples; each with one shadow ray, or without shadows. `samples`: of lights of
  /// some size; 0: as many as the settings have.
  std::vector<double> additive(bool shadowed, int samples = 0) {
    std::vector<double> out(3 * pixels(), 0.0);
    for (const int l : subset) {
      DirectUnoccludedSettings d;
      d.view = view;
      d.light = l;
      d.nominal = scene->lights[size_t(l)].power;
      d.samples = samples > 0 ? samples : from.samples;
      d.seed = from.seed;
      const TermPtr V = shadowed ? shadows(l) : nullptr;
      for (const LobePart lobe : {LobePart::Diffuse, LobePart::Specular}) {
        d.lobe = lobe;
        const TermPtr L = by(makeDirectUnoccludedNode(d), {g, surface}, {l});
        for (size_t e = 0; e < L->floats("L").size() / 3; ++e)
          for (size_t c = 0; c < 3; ++c)
            out[3 * (e % pixels()) + c] += double(L->floats("L")[3 * e + c]) * (V ? double(V->floats("V")[e]) : 1.0) / view.viewSamples;
      }
    }
    return out;
  }
  /// Both lobes of a term of view samples, means over them.
  std::vector<double> meanOfSamples(const TermPtr& c) const {
    std::vector<double> out(3 * pixels(), 0.0);
    for (size_t e = 0; e < size_t(view.viewSamples) * pixels(); ++e)
      for (const char* lobe : {"diffuse", "specular"})
        for (size_t i = 0; i < 3; ++i) out[3 * (e % pixels()) + i] += double(c->floats(lobe)[3 * e + i]) / view.viewSamples;
    return out;
  }

  TaskArena own;
  tests::NodeRunner by;
  subtractive::SceneLightsSettings from;
  std::vector<int> subset;
};

inline double meanOf(const std::vector<double>& v) {
  double mean = 0;
  for (const double x : v) mean += x / double(v.size());
  return mean;
}

}  // namespace gobo::subtractive_test
