// SPDX-License-Identifier: Apache-2.0
// Hard-edged shadow maps as shadow techniques (filters/shadow_technique.h); the manual is in shadow_map.h and docs/shadow_maps.md.
#pragma once

#include "filters/shadow_map/shadow_map.h"
#include "filters/shadow_technique.h"

namespace gobo {
inline namespace filters {

/// Directional, Spot, Point, Rect, Disk, Sphere: area lights cast the hard shadow of their centre.
bool shadowMapSupports(LightKind kind);

/// The depth map of a light as its techniques share it.
struct PlannedShadowMap {
  LightFrames frames;
  ShadowMapSettings map;
  ShadowView view;
  NodeId depth = -1;
};
/// All but the node. `rim`: texels that filters reach beyond a receiver. Errors: InvalidArgument for lights that have no map.
Result<PlannedShadowMap> fitShadowMap(const ShadowInput& input, const v1::ShadowTechnique& technique, int rim, MapWindow window = MapWindow::InFront);
/// The rim of planPercentageCloser.
int percentageCloserRim(const v1::ShadowTechnique& technique);
/// fitShadowMap, and adds light_depth_map. Errors: ResourceExhausted, too, for maps beyond `shadows.map` memory bounds.
Result<PlannedShadowMap> planShadowMap(Graph& graph, const ShadowInput& input, const v1::ShadowTechnique& technique, int rim,
                                       MapWindow window = MapWindow::InFront);
/// Adds depth_bounds over it.
NodeId planDepthBounds(Graph& graph, const ShadowInput& input, const PlannedShadowMap& map);

/// The mosaic of the map that a planned visibility was read from: its basis images, or its depth map. NotFound for techniques without one.
Result<NodeId> planBasisMosaic(Graph& graph, NodeId visibility);
/// Does the technique mark failures (plane "flags")?
bool marksFailures(const v1::ShadowTechnique& technique);

Result<NodeId> planHardShadowMap(Graph& graph, const ShadowInput& input, const v1::ShadowTechnique& technique);
Result<NodeId> planPercentageCloser(Graph& graph, const ShadowInput& input, const v1::ShadowTechnique& technique);
Result<NodeId> planVarianceShadow(Graph& graph, const ShadowInput& input, const v1::ShadowTechnique& technique);
Result<NodeId> planConvolutionShadow(Graph& graph, const ShadowInput& input, const v1::ShadowTechnique& technique);
/// On a device: Unavailable when Vulkan or EGL is asked for and the machine has none; ResourceExhausted for a resolution beyond the device's
/// buffers (llvmpipe, lavapipe: 5792 texels).
Result<NodeId> planExponentialShadow(Graph& graph, const ShadowInput& input, const v1::ShadowTechnique& technique);
Result<NodeId> planExponentialVarianceShadow(Graph& graph, const ShadowInput& input, const v1::ShadowTechnique& technique);
Result<NodeId> planMomentShadow(Graph& graph, const ShadowInput& input, const v1::ShadowTechnique& technique);

}  // namespace filters
}  // namespace gobo
