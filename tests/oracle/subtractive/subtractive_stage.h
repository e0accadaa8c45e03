// SPDX-License-Identifier: Apache-2.0
// The nodes of subtractive shadows run by hand on a small scene.
#pragma once

#include <algorithm>
#include <cstring>

#include "support/run_node.h"
#include "support/tiny_scenes.h"
#include "techniques/subtractive/light.h"
#include "techniques/subtractive/samples.h"

namespace gobo::subtractive_test {

using subtractive::DistantLightSample;
using subtractive::Form;
using tests::SceneMaker;

inline constexpr Form kForms[] = {Form::Ratio, Form::Beta, Form::Difference};

/// The result of one form.
struct Lit {
  TermPtr samples, light;
};

struct Stage {
  Stage(ScenePtr s, int width, int height, int viewSamples = 2, ViewPlace place = {}) : scene(std::move(s)), arena(2), run(*scene, arena) {
    view.camera = scene->cameras[0];
    view.width = width;
    view.height = height;
    view.viewSamples = viewSamples;
    view.place = place;
    g = run(makeGBufferNode(view), {});
    surface = run(makeSurfaceNode(view), {g});
  }
  subtractive::Resampling resampling(int r) const {
    subtractive::Resampling out;
    out.resolution = r;
    return out;
  }
  TermPtr samples(const std::vector<DistantLightSample>& lights, int r) {
    return run(subtractive::makeSamplesNode({view, resampling(r), lights}), {g, surface});
  }
  TermPtr light(Form form, const TermPtr& from, const TermPtr& c, int lights, int r) {
    return run(subtractive::makeLightNode({view, resampling(r), form, lights}), {g, surface, from, c});
  }
  /// Unshadowed light by f(sample, lobe, channel), where something reflects.
  template <class F>
  TermPtr unshadowed(F&& f) {
    auto out = std::make_shared<Term>("unshadowed_map", Domain::ViewSample, view.extent());
    const std::span<float> to[2] = {out->addPlane<float>("diffuse", 3), out->addPlane<float>("specular", 3)};
    const auto instance = g->plane<uint32_t>("instance");
    for (size_t e = 0; e < instance.size(); ++e)
      for (size_t k = 0; k < 2; ++k)
        for (size_t c = 0; c < 3; ++c) to[k][3 * e + c] = instance[e] == ~0u ? 0.0f : f(e, k, c);
    return out;
  }
  /// The lights' own unshadowed light: of samples that are all traced.
  TermPtr ownLight(const TermPtr& all) {
    const subtractive::Receivers in(*g, *surface, view);
    const auto u = all->floats("unshadowed");
    return unshadowed([&](size_t e, size_t k, size_t c) {
      if (!in.lit(e)) return 0.0f;
      const LobeAlbedos by = in.divisors(e, in.bsdf(e));
      return (k == 0 ? by.diffuse : by.specular)[int(c)] * u[6 * e + 3 * k + c];
    });
  }
  size_t pixels() const { return size_t(view.width) * size_t(view.height); }

  ScenePtr scene;
  TaskArena arena;
  tests::NodeRunner run;
  GBufferSettings view;
  TermPtr g, surface;
};

/// Lights over the upper hemisphere, none alike.
inline std::vector<DistantLightSample> skyOf(int n) {
  std::vector<DistantLightSample> out;
  for (int i = 0; i < n; ++i) {
    const float y = (float(i) + 0.5f) / float(n), phi = 2.4f * float(i), s = std::sqrt(1.0f - y * y);
    out.push_back({Vec3(s * std::cos(phi), y, s * std::sin(phi)), Vec3(0.5f + float(i % 3), 1.0f, 2.0f - 0.1f * float(i % 7)) * (1.0f / float(n))});
  }
  return out;
}

/// A dull floor, a shining ball and a metal box on it.
inline ScenePtr stageScene() {
  SceneMaker m;
  const int grey = m.material(Vec3(0.6f, 0.5f, 0.4f)), shining = m.material(Vec3(0.8f, 0.3f, 0.2f), [](Material&x) {
    x.bsdf.specular = 1.0f;
    x.bsdf.roughness = 0.4f;
  });
  const int metal = m.material(Vec3(0.9f, 0.7f, 0.3f), [](Material& x) {
    x.bsdf = {};
    x.bsdf.metallic = 1.0f;
    x.bsdf.roughness = 0.6f;
  });
  m.instance(m.mesh(tests::ground(4.0f), grey));
  m.instance(m.mesh(tests::sphere(Vec3(0.8f, 0.6f, 0.5f), 0.6f, 24, true), shining));
  m.instance(m.mesh(tests::box(Vec3(-1, 0, -1), Vec3(0, 1.5f, 0)), metal));
  m.camera(Vec3(2.5f, 2.5f, 4.0f), Vec3(0, 0.5f, 0), 0.8f);
  return m.finish();
}

/// A floor from above, with what `add` puts over it.
template <class F>
ScenePtr floorScene(F&& add, const Vec3& albedo = Vec3(1.0f)) {
  SceneMaker m;
  const int white = m.material(albedo);
  m.instance(m.mesh(tests::ground(50.0f), white));
  add(m, white);
  m.camera(Vec3(0, 6, 0.001f), Vec3(0, 0, 0), 0.7f);
  return m.finish();
}

}  // namespace gobo::subtractive_test
