// SPDX-License-Identifier: Apache-2.0
// The techniques, in the order that their planes are summed in: one line each.
#include <array>

#include "technique/technique.h"
#include "techniques/background/technique.h"
#include "techniques/caustics/technique.h"
#include "techniques/direct_visibility/technique.h"
#include "techniques/environment_lights/technique.h"
#include "techniques/path_traced/technique.h"
#include "techniques/subtractive/technique.h"
#include "techniques/transfer/technique.h"

namespace gobo {
inline namespace technique {  // that which technique.h declares

std::span<const Technique* const> registeredTechniques() {
  static const std::array all{
      &pathTraced(), &directVisibility(),    &environmentLights(),  &clusterDifferences(), &causticPhotons(),
      &background(), &environmentTransfer(), &subtractiveShadows(), &subtractiveLights(),
  };
  return all;
}

}  // namespace technique
}  // namespace gobo
