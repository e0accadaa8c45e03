// SPDX-License-Identifier: Apache-2.0
// What the fields that both subtractive messages of a request have mean: of a map (EnvironmentSettings.Subtractive) and of lights (SubtractiveShadow).
#pragma once

#include <cmath>

#include "techniques/subtractive/light.h"

namespace gobo::subtractive {

template <class Asked>
Form formOf(const Asked& asked) {
  switch (asked.form()) {
    case Asked::BETA: return Form::Beta;
    case Asked::DIFFERENCE: return Form::Difference;
    default: return Form::Ratio;
  }
}

template <class Asked>
Resampling resamplingOf(const Asked& asked) {
  Resampling r;
  r.resolution = int(asked.resolution());
  r.width = float(asked.width());
  r.cosine = std::cos(float(asked.angle_deg()) * kPi / 180.0f);
  r.planeDistance = float(asked.plane_distance());
  return r;
}

}  // namespace gobo::subtractive
