// SPDX-License-Identifier: Apache-2.0
// What an area light is to its receivers: when a point may stand for it (the five-times rule), and what is lost when visibility is taken
// out of the integral over it (Annen 2008, 2.3.3 and eq. 2.25).
#include <gtest/gtest.h>

#include <cmath>

#include "base/sobol.h"
#include "terms/direct_unoccluded.h"
#include "terms/light_points.h"

namespace {

using namespace gobo;

ScenePtr squareAbove(float width, float height) {
  auto scene = std::make_shared<Scene>();
  Light light;
  light.name = "key";
  light.shape.kind = LightKind::Rect;
  light.shape.position = Vec3(0, height, 0);
  light.shape.axis = Vec3(0, -1, 0);
  light.shape.u = Vec3(0.5f * width, 0, 0);
  light.shape.v = Vec3(0, 0, 0.5f * width);
  scene->lights = {light};
  scene->materials.emplace_back();
  const Status sealed = scene->seal();
  EXPECT_TRUE(sealed.ok()) << sealed.toString();
  return scene;
}

/// Irradiance / pi of a floor point at (x, 0, 0) from unit radiance.
double formFactor(float width, float height, double x) {
  return rectFormFactor(DVec3(x, 0, 0), DVec3(0, 1, 0), DVec3(-0.5 * width, height, -0.5 * width), DVec3(width, 0, 0), DVec3(0, 0, width));
}
double pointFormFactor(float width, float height, double x) {
  const double r2 = x * x + double(height) * height;
  return double(width) * width * height * height / (M_PI * r2 * r2);
}

TEST(AreaLight, FiveTimesItsExtentAwayItLightsLikeAPointButDoesNotShadowLikeOne) {
  for (const double x : {0.0, 1.0, 3.0}) EXPECT_NEAR(formFactor(1, 5, x) / pointFormFactor(1, 5, x), 1.0, 0.015) << x;
  EXPECT_GT(std::fabs(formFactor(1, 1, 0) / pointFormFactor(1, 1, 0) - 1), 0.2);  // at its own width the rule does not hold
  // A half plane halfway up blocks x > 0. The point's shadow is a step at x = 0; the square's is a ramp over its whole width.
  const ScenePtr scene = squareAbove(1, 5);
  const std::vector<int> lights{0};
  const SceneView view(*scene, Facet::LightShape | Facet::Topology | Facet::Pose | Facet::Coverage, lights);
  const LightPoints points(view, 0);
  for (const double x : {-0.375, -0.125, 0.125, 0.375}) {
    double seen = 0, sum = 0;
    for (uint32_t i = 0; i < 4096; ++i) {
      LightPoint p;
      if (!points.sample(Vec3(float(x), 0, 0), Vec3(0, 1, 0), Vec3(0, 1, 0), SobolSampler(7, i).next2D(), p)) continue;
      sum += p.weight;
      const double atHalf = x + double(p.direction.x) * (2.5 / double(p.direction.y));
      if (atHalf < 0) seen += p.weight;
    }
    EXPECT_NEAR(seen / sum, 0.5 - x, 0.01) << x;  // the point says 1 or 0
  }
}

// Share of irradiance that arrives when x > edge of the light is blocked: exactly, by the weighted visibility that ray-traced terms have, and by the
// unweighted share of the light that a shadow map's percentage-closer kernel counts.
struct Factored {
  double exact, weighted, unweighted;
};
Factored factored(float width, float height, float x, float edge) {
  const ScenePtr scene = squareAbove(width, height);
  const std::vector<int> lights{0};
  const SceneView view(*scene, Facet::LightShape | Facet::Topology | Facet::Pose | Facet::Coverage, lights);
  const LightPoints points(view, 0);
  double seen = 0, sum = 0, count = 0, open = 0;
  for (uint32_t i = 0; i < 16384; ++i) {
    LightPoint p;
    if (!points.sample(Vec3(x, 0, 0), Vec3(0, 1, 0), Vec3(0, 1, 0), SobolSampler(11, i).next2D(), p)) continue;
    const bool visible = x + p.direction.x * (height / p.direction.y) < edge;
    sum += p.weight;
    ++count;
    if (visible) {
      seen += p.weight;
      ++open;
    }
  }
  const double half = 0.5 * width, all = formFactor(width, height, x);
  const double part = rectFormFactor(DVec3(x, 0, 0), DVec3(0, 1, 0), DVec3(-half, height, -half), DVec3(edge + half, 0, 0), DVec3(0, 0, width));
  return {part / all, seen / sum, open / count};
}

TEST(AreaLight, FactoringVisibilityOutIsExactOnlyWhereTheLightIsEvenOverItself) {
  const Factored far = factored(1, 20, 3, 0.1f), close = factored(4, 1, 1.5f, 0.5f);
  EXPECT_NEAR(far.weighted, far.exact, 2e-3);
  EXPECT_NEAR(far.unweighted, far.exact, 0.01);
  EXPECT_NEAR(close.weighted, close.exact, 5e-3);             // weights follow the light: no gap
  EXPECT_GT(std::fabs(close.unweighted - close.exact), 0.2);  // what no filter of an unweighted map can remove
}

}  // namespace
