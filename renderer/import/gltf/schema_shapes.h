// SPDX-License-Identifier: Apache-2.0
// Objects of the format that extensions attach to (schema_core.cpp).
#pragma once

#include "import/gltf/schema.h"

namespace gobo::gltf::shapes {

extern const Shape kAsset, kAccessor, kChannel, kAnimation, kBuffer, kBufferView, kCamera, kImage, kTextureInfo, kNormalInfo, kMaterial, kMorphTarget,
    kPrimitive, kMesh, kNode, kTexture, kRoot;

}  // namespace gobo::gltf::shapes
