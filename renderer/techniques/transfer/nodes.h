// SPDX-License-Identifier: Apache-2.0
// Precomputed transfer of distant light (Sloan, Kautz, Snyder 2002, "Precomputed Radiance Transfer", diffuse part; digest of the thesis of 2007, chapter 4).
// A transfer point p of normal n keeps, for each harmonic Y_i of the environment, the irradiance that it would give:
//   direct   T_i(p)   = integral of V(p, w) Y_i(w) max(0, n.w) dw                        grey, without any albedo
//   bounced  B_i(p)   = sum over bounces b of integral of T^b_i(hit(p, w)) rho(hit) / pi max(0, n.w) dw, T^0 = T      rgb
// so that the irradiance under a map of coefficients c is the sum of (T_i + B_i) c_i: no ray is traced when the map changes or turns. What receives it
// is not in them: albedo is the pixel's own.
//
//   transfer_points --> direct_transfer (of 64 directions a point, as often as asked: each keeps the running mean) --> bounced_transfer (one a bounce)
//        |                       |                                                                   |
//        |                       +---------------> transferred_light (a point's irradiance) <--------+--- environment_split
//        +--> transfer_places (a view's) --> transferred_surface (a plane of the picture) <--+
//                                        +-> transferred_gloss   (a plane of the picture) <----- gloss_levels <--- environment_split
#pragma once

#include "terms/gbuffer.h"
#include "terms/node.h"

namespace gobo::transfer {

inline constexpr uint32_t kDirections = 64;  ///< of a block, for direct light and for each bounce

struct TransferSettings {
  uint32_t points = 0;  ///< that are asked for (ReceiverMesh)
  uint32_t size = 0;    ///< that there are
  int bands = 0;
  uint64_t seed = 0;
  uint32_t blocks = 0, bounces = 0;  ///< that are asked for, of direct light and in all; in no key: for the progress alone
  int harmonics() const { return bands * bands; }
  Extent extent() const { return {int(size), 1, 1}; }
};

/// Term "transfer_points", domain List: "position" f32x3 | "normal" f32x3 | "cell" f32, the size of what is about it | "instance" u32 that it lies on |
/// "usable" u8: 0 where most rays meet back faces, inside of something.
NodePtr makeTransferPointsNode(const TransferSettings& settings);
/// Term "point_albedo": "rgb" f32x3: what a point reflects of irradiance, all lobes taken for diffuse. Input: points.
NodePtr makePointAlbedoNode(const TransferSettings& settings);
/// Term "direct_transfer": "transfer" f32 x harmonics. Inputs: points; from block 1 on the node of the block before.
NodePtr makeDirectTransferNode(const TransferSettings& settings, uint32_t block);
/// Term "bounced_transfer": "last" and "sum" f32 x 3 harmonics: T^b and the sum up to it. Inputs: points, albedo; the direct transfer or the bounce before.
NodePtr makeBouncedTransferNode(const TransferSettings& settings, uint32_t bounce, uint32_t directions);
/// Term "environment_split", domain Table, in the map's axes (environment_split.h): "radiance" and "rest" f32 x 3 harmonics | "count" u32 of lights |
/// "direction", "irradiance" f32 x 3 lights | "radius" f32 x lights, radians | "left" f32 x cells: what no light took of each cell of the map. Small.
/// The map is a parameter, not the scene's: one that turns is split once.
NodePtr makeEnvironmentSplitNode(EnvironmentPtr map, int bands, int lights, double share);
/// Term "transferred_light": "direct" and "bounced" f32x3, W/m^2 at points, not below 0. Of the direct part without the lights, of the
/// bounced part with them. Inputs: environment, direct transfer; bounced transfer if there is.
NodePtr makeTransferredLightNode(const TransferSettings& settings, float rotation, const Vec3& scale, bool bounced);
/// Term "transfer_places", domain ViewSample: "point" u32x6 | "weight" f32x6 (zero where nothing is hit). Inputs: G-buffer, points.
NodePtr makeTransferPlacesNode(const TransferSettings& settings, const GBufferSettings& view);
/// Term "direct_light", domain Pixel, "rgb": mean over view samples of the diffuse lobe's albedo (below what lies on it) / pi times `part` ("direct" or
/// "bounced") at the place. Inputs: G-buffer, surface, places, transferred light. `extended`: there are materials that the surface term does not hold, which
/// are read again.
NodePtr makeTransferredSurfaceNode(const TransferSettings& settings, const GBufferSettings& view, const char* part, bool extended);
/// Term "gloss_levels", domain Table, in the map's axes: planes of gloss_levels.h. Input: environment split.
NodePtr makeGlossLevelsNode(EnvironmentPtr map);
/// Term "direct_light", domain Pixel, "rgb": mean over view samples of the specular lobes' albedo times the light that they look at. `part`:
///   "direct"   the map without its lights, prefiltered for the roughness, times the openness of the place in the lobe's direction: transfer convolved with a
///              lobe there, by that of an open place
///   "bounced"  mean radiance of what stands around (bounced irradiance by the share of the hemisphere that is closed), times the lobe's closed share
/// Inputs: G-buffer, surface, places, points, direct transfer, transferred light, gloss levels.
NodePtr makeTransferredGlossNode(const TransferSettings& settings, const GBufferSettings& view, const char* part, float rotation, const Vec3& scale);

}  // namespace gobo::transfer
