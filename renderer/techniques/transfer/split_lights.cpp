// SPDX-License-Identifier: Apache-2.0
#include "techniques/transfer/split_lights.h"

#include <cmath>
#include <cstdio>

#include "techniques/environment_lights/light_folds.h"
#include "techniques/transfer/environment_split.h"

namespace gobo::transfer {

std::string apartText(const Term& split) {
  const auto luminous = [&](const char* plane) {  // of Y_0, which is flux but for a constant
    const auto v = split.floats(plane);
    return luminanceOf(DVec3(v[0], v[1], v[2]));
  };
  const uint32_t count = split.plane<uint32_t>("count")[0];
  const double all = luminous("radiance");
  char text[96];
  std::snprintf(text, sizeof text, "; lights of it with shadows of their own: %u, of %.1f %% of its luminous flux", count,
                all > 0 ? 100.0 * (1.0 - luminous("rest") / all) : 0.0);
  return text;
}

Status planSplitLights(PlanContext& c, const TermPtr& split, int map, int most, const std::vector<LobePart>& lobes) {
  if (most == 0) return {};
  auto extended = std::make_shared<Scene>(*c.scene());
  const int first = int(extended->lights.size()), count = split ? int(split->plane<uint32_t>("count")[0]) : most;
  const float r = c.scene()->environment->rotation, cosR = std::cos(r), sinR = std::sin(r);
  for (int i = 0; i < count; ++i) {
    Light light;
    light.name = "environment/" + std::to_string(i);
    light.shape.kind = LightKind::Directional;
    light.shape.axis = Vec3(0.6f * std::cos(float(i)), -0.8f, 0.6f * std::sin(float(i)));  // any, for a bound; apart: equal nodes are one
    light.shape.angularSize = 0.1f;
    if (split) {
      const float* d = split->floats("direction").data() + 3 * i;
      const float* e = split->floats("irradiance").data() + 3 * i;
      light.shape.axis = -glm::normalize(Vec3(d[0] * cosR + d[2] * sinR, d[1], d[2] * cosR - d[0] * sinR));
      light.shape.angularSize = 2.0f * split->floats("radius")[size_t(i)];
      light.power = Vec3(e[0], e[1], e[2]);
    }
    extended->lights.push_back(light);
  }
  if (count == 0) return {};
  GOBO_TRY(extended->seal());
  const int group = c.groups().groupOf[size_t(map)];
  return foldLights(c, extended, first, c.groups().nominal[size_t(map)], group, 4, lobes);
}

}  // namespace gobo::transfer
