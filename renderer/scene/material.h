// SPDX-License-Identifier: Apache-2.0
// Materials, split by facet, and textures. glTF metallic-roughness plus smooth/rough dielectric transmission.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "base/hash.h"
#include "base/vec.h"

namespace gobo {

enum class Wrap : uint8_t { Repeat, Clamp, Mirror };

/// Linear float texels would quadruple memory, so 8-bit sources stay 8-bit; HDR sources are float.
struct Texture {
  std::string name;
  int width = 0, height = 0, channels = 4;   ///< RGBA always (missing channels filled: grey -> rgb, alpha 1)
  bool srgb = false;                         ///< 8-bit texels are sRGB-encoded colour (base colour, emission)
  Wrap wrapU = Wrap::Repeat, wrapV = Wrap::Repeat;
  bool nearest = false;                      ///< point sampling; otherwise bilinear
  std::vector<uint8_t> texels8;              ///< either this ...
  std::vector<float> texelsF;                ///< ... or this is filled; width*height*4
  Hash128 content;                           ///< digest of size, flags and texels

  /// Linear RGBA at (u, v), glTF convention (v down, texel centres at half integers). Defined in texture.cpp.
  Vec4 sample(Vec2 uv) const;
};

/// Fills `content`; call once, when the texels are final. CHECKs that exactly one texel array has width*height*4 values.
void sealTexture(Texture& texture);

struct TextureRef {
  int texture = -1;                          ///< -1: none
  int texcoord = 0;                          ///< UV set 0 or 1
  Vec2 offset{0.0f}, scale{1.0f};            ///< KHR_texture_transform
  float rotation = 0.0f;
  bool valid() const { return texture >= 0; }
};

enum class AlphaMode : uint8_t { Opaque, Mask, Blend };

struct Coverage { AlphaMode mode = AlphaMode::Opaque; float cutoff = 0.5f; float factor = 1.0f; TextureRef texture; bool doubleSided = true; };
struct Albedo { Vec3 factor{1.0f}; TextureRef texture; };
struct Bsdf {
  float metallic = 0.0f, roughness = 1.0f;   ///< perceptual roughness; GGX alpha = roughness^2
  TextureRef metallicRoughness;              ///< B = metallic, G = roughness
  float specular = 1.0f;                     ///< KHR_materials_specular factor; 0 makes an exact Lambert surface
  float ior = 1.5f;
  float transmission = 0.0f;                 ///< KHR_materials_transmission: 1 = dielectric with refraction
  TextureRef normal; float normalScale = 1.0f;
};
struct Emission { Vec3 radiance{0.0f}; TextureRef texture; };   ///< factor x KHR_materials_emissive_strength

struct Material {
  std::string name;
  Coverage coverage;
  Albedo albedo;
  Bsdf bsdf;
  Emission emission;
  bool emits() const { return maxComponent(emission.radiance) > 0.0f; }
};

}  // namespace gobo
