// SPDX-License-Identifier: Apache-2.0
// Surface parameters at G-buffer samples. Term type "surface", domain ViewSample; input: G-buffer.
// Planes: albedo f32x3 | material f32x5 (metallic, roughness, specular, ior, transmission) | N f32x3 shading normal after the
// normal map, towards the viewer. Zero where nothing is hit.
#pragma once

#include "terms/gbuffer.h"

namespace gobo {

NodePtr makeSurfaceNode(const GBufferSettings& settings);

}  // namespace gobo
