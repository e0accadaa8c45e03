// SPDX-License-Identifier: Apache-2.0
// What the camera sees where it sees nothing else, in place of the environment that lights the scene (EnvironmentSettings.background).
#pragma once

#include "base/status.h"
#include "base/stop.h"
#include "gobo/v1/render.pb.h"
#include "scene/scene.h"

namespace gobo {
inline namespace request {

struct Background {
  /// The environment's light in the effective scene where the camera does not see it, but `scene`'s; -1: the map is what is seen.
  int hidden = -1;
  /// The scene with what is seen for its environment, whose light is `light`: a white one (colours, transparency), or the blurred map. Null: nothing is.
  ScenePtr scene;
  int light = -1;
  Vec3 weight{0.0f};         ///< of `light`, whose radiance is the map's
  bool transparent = false;  ///< the beauty has alpha
  bool ofMap = false;        ///< it is the environment's light that is seen, not a colour of its own
  bool replaces() const { return hidden >= 0 || scene; }
};

/// `scene` is sealed; `gains` as EffectiveScene has them. Errors name the field; Cancelled after `stop`.
Result<Background> makeBackground(const ScenePtr& scene, const std::vector<Vec3>& gains, const v1::EnvironmentSettings& settings, const StopToken& stop = {});

}  // namespace request
}  // namespace gobo
