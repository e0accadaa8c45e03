// SPDX-License-Identifier: Apache-2.0
#include "techniques/environment_lights/technique.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "filters/ambient_light.h"
#include "request/environment_map.h"
#include "techniques/environment_lights/light_folds.h"
#include "techniques/path_traced/trace_paths.h"
#include "terms/area_light_list.h"
#include "terms/extract_lights.h"

namespace gobo {
inline namespace techniques {

namespace {

struct FoundLights {
  std::vector<Light> lights;
  std::array<Vec3, 9> ambient{};
};

bool squares(const PlanContext& c) { return c.request().environment().area_lights() > 0; }
const char* kindOf(const PlanContext& c) { return squares(c) ? "area lights" : "extracted lights"; }

/// Lights of some direction, as many as there may be: for a bound.
FoundLights placeholders(const PlanContext& c) {
  FoundLights out;
  const int count = int(squares(c) ? c.request().environment().area_lights() : c.request().environment().extract_lights());
  for (int i = 0; i < count; ++i) {
    Light light;
    light.name = "environment/" + std::to_string(i);
    light.shape.kind = LightKind::Directional;
    const float angle = 0.5f + float(i);  // apart from each other: equal nodes are one
    light.shape.axis = Vec3(0.6f * std::cos(angle), -0.8f, 0.6f * std::sin(angle));
    light.shape.u = Vec3(-std::sin(angle), 0.0f, std::cos(angle));
    if (squares(c)) light.shape.skyRectangle = Vec2(0.1f);
    out.lights.push_back(light);
  }
  if (squares(c)) out.ambient.fill(Vec3(1.0f));
  return out;
}

Result<FoundLights> findLights(PlanContext& c) {
  const v1::EnvironmentSettings& sky = c.request().environment();
  const NodePtr node = squares(c) ? makeAreaLightListNode(int(sky.area_lights()))
                                  : makeExtractLightsNode(int(sky.extract_lights()), extractBy(sky), c.scene()->environment->texels.size());
  GOBO_ASSIGN(const TermPtr term, c.expand(c.source(node, {}, {}, squares(c) ? "area_lights" : "extract_lights", c.scene())));
  if (!term) return placeholders(c);
  const float r = c.scene()->environment->rotation, cosR = std::cos(r), sinR = std::sin(r);
  const auto toWorld = [&](std::span<const float> d, int i) {
    return Vec3(d[3 * i] * cosR + d[3 * i + 2] * sinR, d[3 * i + 1], d[3 * i + 2] * cosR - d[3 * i] * sinR);
  };
  const auto directions = term->floats("direction"), irradiance = term->floats("irradiance");
  FoundLights out;
  const int count = squares(c) ? int(term->plane<uint32_t>("count")[0]) : term->extent().width;
  for (int i = 0; i < count; ++i) {
    Light light;
    light.name = "environment/" + std::to_string(i);
    light.shape.kind = LightKind::Directional;
    light.shape.axis = -toWorld(directions, i);
    if (squares(c)) {
      light.shape.u = toWorld(term->floats("right"), i);
      light.shape.skyRectangle = Vec2(term->floats("angularSize")[2 * i], term->floats("angularSize")[2 * i + 1]);
    }
    light.power = Vec3(irradiance[3 * i], irradiance[3 * i + 1], irradiance[3 * i + 2]);
    out.lights.push_back(light);
  }
  if (squares(c))
    for (int i = 0; i < 9; ++i)
      for (int k = 0; k < 3; ++k) out.ambient[i][k] = term->floats("remainder")[3 * i + k];
  return out;
}

class EnvironmentLights final : public Technique {
 public:
  const char* name() const override { return "environment_lights"; }

  Status claim(PlanContext& c) const override {
    const v1::EnvironmentSettings& sky = c.request().environment();
    if (sky.area_lights() > 0 && sky.extract_lights() > 0 && !c.scene()->lights.empty())
      return invalidArgument("request.environment.area_lights: " + std::to_string(sky.area_lights()) + " and extract_lights " +
                                 std::to_string(sky.extract_lights()) + " both stand for the map: ask for one",
                             "request.environment.area_lights");
    const int map = environmentLight(*c.scene());
    if (map < 0 || !c.scene()->environment || (sky.area_lights() == 0 && sky.extract_lights() == 0)) return {};
    return c.cover().claim(map, PathSet::Direct, name());
  }

  Status plan(PlanContext& c) const override {
    const int map = environmentLight(*c.scene());
    if (map < 0 || c.cover().claimedBy(map, name()) == PathSet::None) return {};
    const int group = c.groups().groupOf[size_t(map)];
    GOBO_TRY(c.cover().bring(map, PathSet::Front, name()));
    GOBO_ASSIGN(const FoundLights found, findLights(c));
    auto extended = std::make_shared<Scene>(*c.scene());
    const int first = int(extended->lights.size());
    extended->lights.insert(extended->lights.end(), found.lights.begin(), found.lights.end());
    GOBO_TRY(extended->seal());
    const Vec3 nominal = c.groups().nominal[size_t(map)];  // scale of the map that gains refer to
    c.prune("direct:environment map", "replaced by " + std::to_string(found.lights.size()) + " " + kindOf(c), true);
    if (!found.lights.empty()) GOBO_TRY(foldLights(c, extended, first, nominal, group, squares(c) ? 4 : 1, c.lobes()));
    if (found.ambient != std::array<Vec3, 9>{}) {
      AmbientLightSettings s{found.ambient, c.scene()->environment->rotation, c.view().width, c.view().height, c.view().viewSamples};
      for (Vec3& coefficient : s.radiance) coefficient *= nominal;
      GraphNode n{makeAmbientLightNode(s), {c.gbuffer(), c.surface()}, {}, "ambient:environment"};
      n.approximate = "what the area lights leave of the map is not shadowed and reaches the diffuse lobe alone";
      c.add({c.graph().add(std::move(n)), "rgb", c.groupGain(group), front(c.apart().lobes ? LobePart::Diffuse : LobePart::Both), group});
    }
    if (c.kinds().translucent) return tracePaths(c, name(), {map}, PathSet::Behind, "through:environment");
    return c.cover().bring(map, PathSet::Behind, name());
  }
};

}  // namespace

const Technique& environmentLights() {
  static const EnvironmentLights technique;
  return technique;
}

}  // namespace techniques
}  // namespace gobo
