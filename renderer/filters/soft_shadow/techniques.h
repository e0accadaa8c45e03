// SPDX-License-Identifier: Apache-2.0
// Soft shadow maps as shadow techniques (filters/shadow_technique.h); the manual is in soft_shadow.h and docs/shadow_maps.md.
// map.lookup: SUMMED_AREA boxes unless TRILINEAR (convolution_soft only) asks for a mip chain; BILINEAR, the schema's default, means
// SUMMED_AREA here, and ANISOTROPIC is refused. map.blur is not used.
#pragma once

#include "filters/shadow_technique.h"

namespace gobo {
inline namespace filters {

/// Rect, Disk, Sphere and Directional (soft by ShadowInput::angularSize). Point and Spot lights have no width.
bool softShadowSupports(LightKind kind);

/// Errors: InvalidArgument for lights without a map and parameters out of range (location: the field below "shadows"), ResourceExhausted for maps beyond 4 GiB.
Result<NodeId> planPercentageCloserSoft(Graph& graph, const ShadowInput& input, const v1::ShadowTechnique& technique);
/// The same with what it reads of the map (plane "work").
Result<NodeId> planPercentageCloserSoftWork(Graph& graph, const ShadowInput& input, const v1::ShadowTechnique& technique);
Result<NodeId> planConvolutionSoft(Graph& graph, const ShadowInput& input, const v1::ShadowTechnique& technique);
Result<NodeId> planVarianceSoft(Graph& graph, const ShadowInput& input, const v1::ShadowTechnique& technique);
Result<NodeId> planExponentialVarianceSoft(Graph& graph, const ShadowInput& input, const v1::ShadowTechnique& technique);

}  // namespace filters
}  // namespace gobo
