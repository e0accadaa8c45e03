// SPDX-License-Identifier: Apache-2.0
#include "request/background.h"

#include <cmath>
#include <string>

#include "request/environment_map.h"
#include "scene/environment_blur.h"

namespace gobo {
inline namespace request {

namespace {

/// The scene with another map around it, which the camera sees.
Status surround(const ScenePtr& scene, EnvironmentPtr map, Background& out) {
  auto around = std::make_shared<Scene>(*scene);
  around->environment = std::move(map);
  const int before = environmentLight(*around);
  if (before >= 0) around->lights[size_t(before)].cameraVisible = true;
  GOBO_TRY(around->seal());
  out.light = environmentLight(*around);
  out.scene = around;
  return {};
}

}  // namespace

Result<Background> makeBackground(const ScenePtr& scene, const std::vector<Vec3>& gains, const v1::EnvironmentSettings& settings, const StopToken& stop) {
  Background out;
  const auto kind = settings.background();
  if (!v1::EnvironmentSettings::Background_IsValid(kind))
    return invalidArgument("request.environment.background = " + std::to_string(int(kind)) + " is not known", "request.environment.background");
  const Vec3 colour(settings.background_color().x(), settings.background_color().y(), settings.background_color().z());
  if (!isFinite(colour) || colour.x < 0 || colour.y < 0 || colour.z < 0)
    return invalidArgument("request.environment.background_color = (" + std::to_string(colour.x) + ", " + std::to_string(colour.y) + ", " +
                               std::to_string(colour.z) + "): must be finite and not negative",
                           "request.environment.background_color");
  if (kind == v1::EnvironmentSettings::BACKGROUND_UNSPECIFIED || kind == v1::EnvironmentSettings::MAP) return out;
  const int map = environmentLight(*scene);
  const bool seen = map >= 0 && scene->lights[size_t(map)].cameraVisible;
  if (seen) out.hidden = map;
  switch (kind) {
    case v1::EnvironmentSettings::BLURRED: {
      if (!seen) return out;  // nothing, as without blur
      const EnvironmentPtr blurred = blurredEnvironment(*scene->environment, settings.background_blur_deg() * (M_PI / 180.0), stop);
      if (!blurred) return Status(Code::Cancelled, "stopped");
      GOBO_TRY(surround(scene, blurred, out));
      out.weight = gains[size_t(map)] * nominalScalar(scene->lights[size_t(map)]);
      out.ofMap = true;
      return out;
    }
    case v1::EnvironmentSettings::TRANSPARENT: out.transparent = true; break;
    default: out.weight = colour; break;
  }
  if (out.transparent || colour != Vec3(0.0f)) GOBO_TRY(surround(scene, constantEnvironment(Vec3(1.0f)), out));
  return out;
}

}  // namespace request
}  // namespace gobo
