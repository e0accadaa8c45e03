// SPDX-License-Identifier: Apache-2.0
#include "techniques/environment_lights/technique.h"

#include "request/environment_map.h"
#include "techniques/environment_lights/stand_ins.h"
#include "techniques/environment_lights/worth.h"
#include "techniques/path_traced/trace_paths.h"

namespace gobo {
inline namespace techniques {

namespace {

class EnvironmentLights final : public Technique {
 public:
  const char* name() const override { return "environment_lights"; }

  Status claim(PlanContext& c) const override {
    const v1::EnvironmentSettings& sky = c.request().environment();
    if (sky.area_lights() > 0 && sky.extract_lights() > 0 && !c.scene()->lights.empty())
      return invalidArgument("request.environment.area_lights: " + std::to_string(sky.area_lights()) + " and extract_lights " +
                                 std::to_string(sky.extract_lights()) + " both stand for the map: ask for one",
                             "request.environment.area_lights");
    if (sky.area_lights_if_worth() && sky.area_lights() == 0)
      c.warn("request.environment.area_lights_if_worth: changes nothing, for request.environment.area_lights asks for none");
    const int map = environmentLight(*c.scene());
    if (map < 0 || !c.scene()->environment || (sky.area_lights() == 0 && sky.extract_lights() == 0)) return {};
    if (c.cameraInVolume()) {
      const std::string field = sky.area_lights() > 0 ? "area_lights" : "extract_lights";
      c.warn("environment." + field + ": the camera is inside a volume: the map is path traced");
      return {};
    }
    if (sky.area_lights() > 0 && sky.area_lights_if_worth()) {
      GOBO_ASSIGN(const LightsWorth worth, worthOfAreaLights(c, map));
      c.prune(worth.lights ? "path tracing of the environment map" : "area lights of the environment map", worth.why);
      if (!worth.lights) return {};
    }
    return c.cover().claim(map, PathSet::Direct, name());
  }

  Status plan(PlanContext& c) const override {
    const int map = environmentLight(*c.scene());
    if (map < 0 || c.cover().claimedBy(map, name()) == PathSet::None) return {};
    GOBO_TRY(c.cover().bring(map, PathSet::Front, name()));
    GOBO_ASSIGN(const StandIns lights, standInsOf(c));
    c.prune("direct:environment map", "replaced by " + lights.words(), true);
    GOBO_TRY(bringStandIns(c, map, lights));
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
