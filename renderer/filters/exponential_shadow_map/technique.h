// SPDX-License-Identifier: Apache-2.0
// Exponential shadow maps as a shadow technique (filters/shadow_technique.h); the manual is in exponential_shadow_map.h.
#pragma once

#include "filters/shadow_technique.h"

namespace gobo {

/// Directional, Spot, Rect, Disk. (Point lights and spheres shine all round and need a map of six faces.)
bool exponentialShadowSupports(LightKind kind);

/// Adds light_depth_map -> exponential_shadow_encode -> exponential_shadow_lookup. Depth map and encoded map do not depend on the
/// camera: a moving camera re-runs the lookup alone, a changed bias too. Errors: InvalidArgument naming the field that is out of
/// range; Unimplemented for other lights; Unavailable when Vulkan or EGL is asked for and the machine has none; ResourceExhausted
/// for a resolution beyond the device's buffers (llvmpipe, lavapipe: 5792 texels).
Result<NodeId> planExponentialShadow(Graph& graph, const ShadowInput& input, const v1::ShadowTechnique& technique);

}  // namespace gobo
