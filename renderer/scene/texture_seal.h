// SPDX-License-Identifier: Apache-2.0
// Textures that share their texels (several samplers of one picture): each array is read once, however many textures look at it.
#pragma once

#include <map>
#include <set>
#include <tuple>
#include <utility>

#include "scene/material.h"

namespace gobo {
inline namespace scene {

/// Bytes of texels, those that textures share counted once.
class TexelBytes {
 public:
  uint64_t add(const Texture& t) {  ///< what `t` adds
    const uint64_t bytes = t.texels8.size() + t.texelsF.size() * sizeof(float);
    return seen_.insert({t.texelsF.empty() ? static_cast<const void*>(t.texels8.data()) : t.texelsF.data(), bytes}).second ? bytes : 0;
  }

 private:
  std::set<std::pair<const void*, uint64_t>> seen_;
};

/// sealTexture for many: what an array gave under the same flags is taken over. Holds the arrays it has seen, so that an address
/// stands for one array while this lives.
class TextureSealer {
 public:
  /// True when the texels were read, false when they are those of an earlier call.
  bool seal(Texture& t) {
    const void* texels = t.texelsF.empty() ? static_cast<const void*>(std::as_const(t.texels8).data()) : std::as_const(t.texelsF).data();
    const auto [known, fresh] =
        sealed_.try_emplace(Key{texels, t.texels8.size(), t.texelsF.size(), t.width, t.height, t.levels, t.tile, t.srgb, t.wrapU, t.wrapV, t.nearest});
    if (fresh) {
      sealTexture(t);
      known->second = t;
    }
    t.channels = known->second.channels;
    t.content = known->second.content;
    t.lowest = known->second.lowest;
    return fresh;
  }

 private:
  using Key = std::tuple<const void*, size_t, size_t, int, int, int, int, bool, Wrap, Wrap, bool>;
  std::map<Key, Texture> sealed_;
};

}  // namespace scene
}  // namespace gobo
