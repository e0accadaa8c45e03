// SPDX-License-Identifier: Apache-2.0
// Visibility of one light by the shadow technique that the request names for it (filters/shadow_technique.h), and its unoccluded light.
#pragma once

#include <string>

#include "gobo/v1/filters.pb.h"
#include "technique/plan_context.h"

namespace gobo {
inline namespace techniques {

/// The technique for light `light` of `scene`, which requests know as `name`. What cannot do the light or the view falls back, with a warning:
/// one that no visibility technique (path_traced) stays what it is.
v1::ShadowTechnique shadowTechniqueOf(PlanContext& context, int light, const ScenePtr& scene, const std::string& name);

/// Term with plane "V", styled where the technique has a style, by the formulas of the light that requests know as `edited` (empty: by its own name).
/// shadows.auto is chosen here, by a probe that runs while planning.
Result<NodeId> planVisibility(PlanContext& context, int light, const ScenePtr& scene, const v1::ShadowTechnique& technique, const std::string& edited = {});

/// Term with plane "L": what the light sends to the camera by one scattering event if nothing is in the way, at power `nominal`.
NodeId planUnoccluded(PlanContext& context, int light, const ScenePtr& scene, const Vec3& nominal, bool transient = false, LobePart lobe = LobePart::Both);

}  // namespace techniques
}  // namespace gobo
