// SPDX-License-Identifier: Apache-2.0
// Materials, split by facet, and textures: glTF 2.0 metallic-roughness with the KHR_materials_* extensions. Fields are listed
// once more in scene/fields.h, from which digests, checks and the scene blob are made.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "base/array.h"
#include "base/hash.h"
#include "base/vec.h"

namespace gobo {
inline namespace scene {

inline constexpr int kUvSets = 4;  ///< TEXCOORD_n that a mesh keeps

enum class Wrap : uint8_t { Repeat, Clamp, Mirror };

/// Linear float texels would quadruple memory, so 8-bit sources stay 8-bit; HDR sources are float. All mip levels are in one
/// array, finest first, each stored in square tiles of 2^tile texels a side (rows of tiles, rows in a tile; edge tiles are
/// padded). tile = 0 is plain rows. Level k is max(1, width >> k) x max(1, height >> k).
struct Texture {
  std::string name;
  int width = 0, height = 0, channels = 4;  ///< RGBA always (missing channels filled: grey -> rgb, alpha 1)
  bool srgb = false;                        ///< 8-bit texels are sRGB-encoded colour (base colour, emission)
  Wrap wrapU = Wrap::Repeat, wrapV = Wrap::Repeat;
  bool nearest = false;      ///< point sampling; otherwise bilinear
  int levels = 1, tile = 0;  ///< mip levels kept; log2 of the tile side
  Array<uint8_t> texels8;    ///< either this ...
  Array<float> texelsF;      ///< ... or this is filled; textureTexels() * 4 values
  Hash128 content;           ///< digest of size, flags, layout and texels of all levels
  Vec4 lowest{0.0f};         ///< by channel, of all levels' texels as sample() decodes them: no look-up is below it

  /// Linear RGBA at (u, v), glTF convention (v down, texel centres at half integers), of the finest level. The layout does
  /// not change a bit of it. Defined in texture.cpp.
  Vec4 sample(Vec2 uv) const { return sampleLevel(uv, 0); }
  Vec4 sampleLevel(Vec2 uv, int level) const;  ///< level in 0 .. levels - 1
  void prefetch(Vec2 uv) const;                ///< nearly always what sample(uv) will read first; any uv
};

inline constexpr int kMaxTextureLevels = 16, kMaxTextureTile = 4;
/// Texels that levels 0 .. levels - 1 take up, padding included. Sizes positive; fits 64 bits for sizes up to 2^24.
uint64_t textureTexels(int width, int height, int levels, int tile);

/// Fills `content` and `lowest`; call once, when the texels are final. CHECKs that exactly one texel array has textureTexels() * 4 values.
void sealTexture(Texture& texture);

struct TextureRef {
  int texture = -1;                ///< -1: none
  int texcoord = 0;                ///< UV set, 0 .. kUvSets - 1
  Vec2 offset{0.0f}, scale{1.0f};  ///< KHR_texture_transform
  float rotation = 0.0f;
  bool valid() const { return texture >= 0; }
};

enum class AlphaMode : uint8_t { Opaque, Mask, Blend };

struct Coverage {
  AlphaMode mode = AlphaMode::Opaque;
  float cutoff = 0.5f;
  float factor = 1.0f;
  TextureRef texture;
  bool doubleSided = true;
};
struct Albedo {
  Vec3 factor{1.0f};
  TextureRef texture;
};
/// Lobes from the base up. Names and meanings are those of the glTF extensions; every factor is multiplied with its texture.
struct Bsdf {
  float metallic = 0.0f, roughness = 1.0f;  ///< perceptual roughness; GGX alpha = roughness^2
  TextureRef metallicRoughness;             ///< B = metallic, G = roughness
  TextureRef normal;
  float normalScale = 1.0f;
  float ior = 1.5f;    ///< > 0; 1e6 for the infinite index that glTF writes as 0
  bool unlit = false;  ///< KHR_materials_unlit: shows the base colour as it is
  // KHR_materials_specular
  float specular = 1.0f;            ///< 0 makes an exact Lambert surface
  TextureRef specularTexture;       ///< A
  Vec3 specularColor{1.0f};         ///< scales F0 of the dielectric
  TextureRef specularColorTexture;  ///< RGB, sRGB
  // KHR_materials_transmission, KHR_materials_volume, KHR_materials_dispersion, KHR_materials_volume_scatter
  float transmission = 0.0f;       ///< 1: dielectric with refraction (thin-walled where thickness = 0)
  TextureRef transmissionTexture;  ///< R
  float thickness = 0.0f;          ///< > 0: the mesh bounds a volume, whose true shape is traced; 0: thin-walled
  Vec3 attenuationColor{1.0f};
  float attenuationDistance = 0.0f;  ///< metres at which white light has become attenuationColor; 0: no absorption
  float dispersion = 0.0f;           ///< 20 / Abbe number
  Vec3 scatterAlbedo{0.0f};          ///< multiple-scattering albedo of the interior; 0: no scattering
  float scatterAnisotropy = 0.0f;    ///< Henyey-Greenstein g, -1..1
  // KHR_materials_diffuse_transmission
  float diffuseTransmission = 0.0f;
  TextureRef diffuseTransmissionTexture;  ///< A
  Vec3 diffuseTransmissionColor{1.0f};
  TextureRef diffuseTransmissionColorTexture;  ///< RGB, sRGB
  // KHR_materials_clearcoat
  float clearcoat = 0.0f, clearcoatRoughness = 0.0f;
  TextureRef clearcoatTexture;           ///< R
  TextureRef clearcoatRoughnessTexture;  ///< G
  TextureRef clearcoatNormal;
  float clearcoatNormalScale = 1.0f;
  // KHR_materials_sheen
  Vec3 sheenColor{0.0f};
  float sheenRoughness = 0.0f;
  TextureRef sheenColorTexture;      ///< RGB, sRGB
  TextureRef sheenRoughnessTexture;  ///< A
  // KHR_materials_anisotropy
  float anisotropy = 0.0f, anisotropyRotation = 0.0f;  ///< strength 0..1; radians, counter-clockwise from the tangent
  TextureRef anisotropyTexture;                        ///< RG = direction, B = strength
  // KHR_materials_iridescence
  float iridescence = 0.0f, iridescenceIor = 1.3f;
  float iridescenceThicknessMin = 100.0f, iridescenceThicknessMax = 400.0f;  ///< nanometres
  TextureRef iridescenceTexture;                                             ///< R
  TextureRef iridescenceThicknessTexture;                                    ///< G
};
struct Emission {
  Vec3 radiance{0.0f};
  TextureRef texture;
};  ///< factor x KHR_materials_emissive_strength

struct Material {
  std::string name;
  Coverage coverage;
  Albedo albedo;
  Bsdf bsdf;
  Emission emission;
  bool emits() const { return maxComponent(emission.radiance) > 0.0f; }
};

}  // namespace scene
}  // namespace gobo
