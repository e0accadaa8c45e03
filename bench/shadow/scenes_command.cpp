// SPDX-License-Identifier: Apache-2.0
// The scenes, and the ray-traced truth against closed forms.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "measure/report.h"
#include "shadow/options.h"
#include "terms/surface_samples.h"

namespace gobo::shadowbench {
namespace {

/// Mean visibility over the light at every surface sample from the closed form: a grid of n x n points of a rectangle, or the direction.
struct Closed {
  double rmse = 0, worst = 0;
};
Closed compareClosed(Runner& r, const Truth& truth, const std::string& scene) {
  const auto visible = closedForm(scene);
  const LightShape& light = r.scene()->lights[size_t(r.light())].shape;
  const bool directional = light.kind == LightKind::Directional;
  const int n = directional ? 1 : 64;
  const TermPtr g = r.gbuffer(r.camera());
  const SurfaceSamples s(*g);
  std::vector<double> square(r.pixels(), -1.0);
  r.arena().parallelFor(r.pixels(), 256, [&](size_t from, size_t to) {
    for (size_t e = from; e < to; ++e) {
      if (!truth.mask[e]) continue;
      const DVec3 N(s.geometricNormal(e)), p = DVec3(s.position(e)) + N * 1e-5;
      double seen = 0, sum = 0;
      for (int j = 0; j < n; ++j)
        for (int i = 0; i < n; ++i) {
          DVec3 q = -DVec3(light.axis);
          double w = 1;
          if (!directional) {
            q = DVec3(light.position) + DVec3(light.u) * ((2 * i + 1.0) / n - 1) + DVec3(light.v) * ((2 * j + 1.0) / n - 1);
            const DVec3 d = q - p;
            const double l2 = glm::dot(d, d);
            w = std::max(0.0, glm::dot(N, d)) * std::max(0.0, -glm::dot(DVec3(light.axis), d)) / (l2 * l2);
          }
          sum += w;
          if (w > 0 && visible(p, q, directional)) seen += w;
        }
      if (sum > 0) square[e] = seen / sum;
    }
  });
  Closed c;
  double total = 0, count = 0;
  for (size_t e = 0; e < square.size(); ++e) {
    if (square[e] < 0) continue;
    const double d = truth.centre.V(e) - square[e];
    total += d * d;
    ++count;
    c.worst = std::max(c.worst, std::fabs(d));
  }
  c.rmse = count > 0 ? std::sqrt(total / count) : 0;
  return c;
}

}  // namespace

int scenes(Options o) {
  if (o.list) {
    for (const SceneEntry& e : sceneEntries()) std::printf("%s %s %s %s\n", e.scene.c_str(), e.hard.c_str(), e.soft.c_str(), e.camera.c_str());
    return 0;
  }
  Table table("shadow_scenes", {"scene", "triangles", "hard light", "soft light", "camera", "closed form hard", "closed form soft", "what"});
  table.note("closed form", "RMSE of ray-traced truth at pixel centres (128 x 96, 1024 rays) against slab tests and 64 x 64 points of the light");
  for (const SceneEntry& e : sceneEntries()) {
    const auto scene = benchScene(e.scene);
    if (!scene.ok()) {
      std::fprintf(stderr, "%s\n", scene.status().toString().c_str());
      return 1;
    }
    double closed[2] = {NAN, NAN};
    for (int soft = 0; soft < 2 && closedForm(e.scene); ++soft) {
      Options p = o;
      p.scene = e.scene;
      p.light = soft ? e.soft : e.hard;
      p.camera = e.camera;
      p.width = 128;
      p.height = 96;
      auto runner = makeRunner(p, soft != 0);
      if (!runner.ok()) {
        std::fprintf(stderr, "%s\n", runner.status().toString().c_str());
        return 1;
      }
      const auto truth = makeTruth(**runner, baseName(p), 1024, "");
      if (!truth.ok()) {
        std::fprintf(stderr, "%s\n", truth.status().toString().c_str());
        return 1;
      }
      closed[soft] = compareClosed(**runner, *truth, e.scene).rmse;
    }
    table.add({e.scene, double((*scene)->triangleCount()), e.hard, e.soft, e.camera, closed[0], closed[1], e.note});
  }
  std::fputs(table.text().c_str(), stdout);
  return 0;
}

}  // namespace gobo::shadowbench
