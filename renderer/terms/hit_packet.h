// SPDX-License-Identifier: Apache-2.0
// What a G-buffer writes of 16 hits of one instance: hit_place.h a lane each, bit for bit, in loops that vectorise.
#pragma once

#include "terms/hit_place.h"

namespace gobo {
inline namespace terms {

/// Lanes of world positions and unit normals; Ng and N towards the viewer.
struct alignas(64) HitSurface {
  float P[3][RayPacket::kLanes], N[3][RayPacket::kLanes], Ng[3][RayPacket::kLanes], uv[2][RayPacket::kLanes], depth[RayPacket::kLanes];
};

/// Whether all 16 lanes hit, and the same instance.
bool ofOneInstance(const HitPacket& hits);
/// P and depth. All lanes are hits of `g`.
void hitPositions(const InstanceGeometry& g, const RayPacket& rays, const HitPacket& hits, HitSurface& out);
/// N, Ng and uv. `normals` and `uv`: of the mesh's vertices; may be null.
void hitShading(const InstanceGeometry& g, const Vec3* normals, const Vec2* uv, const RayPacket& rays, const HitPacket& hits, HitSurface& out);

}  // namespace terms
}  // namespace gobo
