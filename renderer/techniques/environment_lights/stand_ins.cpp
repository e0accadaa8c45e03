// SPDX-License-Identifier: Apache-2.0
#include "techniques/environment_lights/stand_ins.h"

#include <cmath>

#include "filters/ambient_light.h"
#include "request/environment_map.h"
#include "techniques/environment_lights/light_folds.h"
#include "terms/area_light_list.h"
#include "terms/extract_lights.h"

namespace gobo {
inline namespace techniques {

namespace {

struct FoundLights {
  std::vector<Light> lights;
  std::array<Vec3, 9> ambient{};
};

/// Lights of some direction, as many as there may be: for a bound.
FoundLights placeholders(const v1::EnvironmentSettings& sky, bool squares) {
  FoundLights out;
  const int count = int(squares ? sky.area_lights() : sky.extract_lights());
  for (int i = 0; i < count; ++i) {
    Light light;
    light.name = "environment/" + std::to_string(i);
    light.shape.kind = LightKind::Directional;
    const float angle = 0.5f + float(i);  // apart from each other: equal nodes are one
    light.shape.axis = Vec3(0.6f * std::cos(angle), -0.8f, 0.6f * std::sin(angle));
    light.shape.u = Vec3(-std::sin(angle), 0.0f, std::cos(angle));
    if (squares) light.shape.skyRectangle = Vec2(0.1f);
    out.lights.push_back(light);
  }
  if (squares) out.ambient.fill(Vec3(1.0f));
  return out;
}

Result<FoundLights> findLights(PlanContext& c, bool squares) {
  const v1::EnvironmentSettings& sky = c.request().environment();
  const NodePtr node = squares ? makeAreaLightListNode(int(sky.area_lights()))
                               : makeExtractLightsNode(int(sky.extract_lights()), extractBy(sky), c.scene()->environment->texels.size());
  GOBO_ASSIGN(const TermPtr term, c.expand(c.source(node, {}, {}, squares ? "area_lights" : "extract_lights", c.scene())));
  if (!term) return placeholders(sky, squares);
  const float r = c.scene()->environment->rotation, cosR = std::cos(r), sinR = std::sin(r);
  const auto toWorld = [&](std::span<const float> d, int i) {
    return Vec3(d[3 * i] * cosR + d[3 * i + 2] * sinR, d[3 * i + 1], d[3 * i + 2] * cosR - d[3 * i] * sinR);
  };
  const auto directions = term->floats("direction"), irradiance = term->floats("irradiance");
  FoundLights out;
  const int count = squares ? int(term->plane<uint32_t>("count")[0]) : term->extent().width;
  for (int i = 0; i < count; ++i) {
    Light light;
    light.name = "environment/" + std::to_string(i);
    light.shape.kind = LightKind::Directional;
    light.shape.axis = -toWorld(directions, i);
    if (squares) {
      light.shape.u = toWorld(term->floats("right"), i);
      light.shape.skyRectangle = Vec2(term->floats("angularSize")[2 * i], term->floats("angularSize")[2 * i + 1]);
    }
    light.power = Vec3(irradiance[3 * i], irradiance[3 * i + 1], irradiance[3 * i + 2]);
    out.lights.push_back(light);
  }
  if (squares)
    for (int i = 0; i < 9; ++i)
      for (int k = 0; k < 3; ++k) out.ambient[i][k] = term->floats("remainder")[3 * i + k];
  return out;
}

}  // namespace

Result<StandIns> standInsOf(PlanContext& c) {
  StandIns out;
  out.squares = c.request().environment().area_lights() > 0;
  GOBO_ASSIGN(const FoundLights found, findLights(c, out.squares));
  auto extended = std::make_shared<Scene>(*c.scene());
  out.first = int(extended->lights.size());
  extended->lights.insert(extended->lights.end(), found.lights.begin(), found.lights.end());
  GOBO_TRY(extended->seal());
  out.extended = std::move(extended);
  out.ambient = found.ambient;
  return out;
}

Status bringStandIns(PlanContext& c, int map, const StandIns& lights) {
  const int group = c.groups().groupOf[size_t(map)];
  const Vec3 nominal = c.groups().nominal[size_t(map)];  // scale of the map that gains refer to
  if (lights.count() > 0) GOBO_TRY(foldLights(c, lights.extended, lights.first, nominal, group, lights.squares ? 4 : 1, c.lobes()));
  if (lights.ambient == std::array<Vec3, 9>{}) return {};
  AmbientLightSettings s{lights.ambient, c.scene()->environment->rotation, c.view().width, c.view().height, c.view().viewSamples};
  for (Vec3& coefficient : s.radiance) coefficient *= nominal;
  s.extended = c.kinds().extended;
  s.camera = c.view().camera;
  GraphNode n{makeAmbientLightNode(s), {c.gbuffer(), c.surface()}, {}, "ambient:environment"};
  if (s.extended) n.scene = c.scene();
  n.approximate = "what the area lights leave of the map is not shadowed and reaches the diffuse lobe alone";
  c.add({c.graph().add(std::move(n)), "rgb", c.groupGain(group), front(c.apart().lobes ? LobePart::Diffuse : LobePart::Both), group});
  return {};
}

}  // namespace techniques
}  // namespace gobo
