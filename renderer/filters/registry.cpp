// SPDX-License-Identifier: Apache-2.0
// The shadow techniques that a request may name: one line each.
#include "filters/axis_aligned/technique.h"
#include "filters/exponential_shadow_map/technique.h"
#include "filters/ray_traced/technique.h"

namespace gobo {

const std::vector<ShadowTechniqueEntry>& shadowTechniques() {
  static const std::vector<ShadowTechniqueEntry> table{
      rayTracedShadowTechnique(),
      axisAlignedShadowTechnique(),
      {v1::ShadowTechnique::kExponential, "exponential", exponentialShadowSupports, planExponentialShadow},
  };
  return table;
}

const ShadowTechniqueEntry* findShadowTechnique(v1::ShadowTechnique::TechniqueCase key) {
  for (const ShadowTechniqueEntry& e : shadowTechniques())
    if (e.key == key) return &e;
  return nullptr;
}

}  // namespace gobo
