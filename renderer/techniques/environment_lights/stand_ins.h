// SPDX-License-Identifier: Apache-2.0
// Lights found in an environment that stand for it: which, and what they bring.
#pragma once

#include <array>
#include <string>

#include "technique/plan_context.h"

namespace gobo {
inline namespace techniques {

struct StandIns {
  ScenePtr extended;              ///< the scene with them behind its own lights
  int first = 0;                  ///< of them, there
  bool squares = false;           ///< area_lights; else extract_lights
  std::array<Vec3, 9> ambient{};  ///< what squares leave over: radiance in spherical harmonics, map axes

  int count() const { return int(extended->lights.size()) - first; }
  std::string words() const { return std::to_string(count()) + (squares ? " area lights" : " extracted lights"); }
};

/// The lights that environment.area_lights or extract_lights asks for; while bounding, as many as there may be, of some direction.
Result<StandIns> standInsOf(PlanContext& context);

/// The front of the map's direct light (light `map`) by them, as contributions of `context`, which need not be the one that they were found by. Claims nothing.
Status bringStandIns(PlanContext& context, int map, const StandIns& lights);

}  // namespace techniques
}  // namespace gobo
