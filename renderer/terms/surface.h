// SPDX-License-Identifier: Apache-2.0
// Surface parameters at G-buffer samples. Term type "surface", domain ViewSample; input: G-buffer.
// Planes: albedo f32x3 | material f32x5 (metallic, roughness, specular, ior, transmission) | N f32x3 shading normal after the
// normal map, towards the viewer | flags u8. Zero where nothing is hit. Materials with further lobes are flagged, not
// stored: who evaluates them reads them again (terms/surface_reader.h), so scenes pay memory for what every material has.
#pragma once

#include "terms/gbuffer.h"

namespace gobo {
inline namespace terms {

/// Bits of the plane "flags".
inline constexpr uint8_t kSurfaceEntering = 1;  ///< the viewer is outside
inline constexpr uint8_t kSurfaceUnlit = 2;     ///< reflects nothing
inline constexpr uint8_t kSurfaceExtended = 4;  ///< the planes do not hold the whole material

NodePtr makeSurfaceNode(const GBufferSettings& settings);

}  // namespace terms
}  // namespace gobo
