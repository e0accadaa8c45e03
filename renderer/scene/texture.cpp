// SPDX-License-Identifier: Apache-2.0
// Texture look-up. 8-bit texels are decoded through tables, so a bilinear sample is 16 loads and no transcendental.
#include <immintrin.h>

#include <algorithm>
#include <array>

#include "base/check.h"
#include "base/transfer.h"
#include "scene/material.h"

namespace gobo {
inline namespace scene {
namespace {

struct DecodeTables {
  std::array<float, 256> srgb, linear;
  DecodeTables() {
    for (int i = 0; i < 256; ++i) {
      const double c = i / 255.0;
      linear[i] = float(c);
      srgb[i] = float(decodeTransfer(Transfer::Srgb, c));
    }
  }
};
const DecodeTables kTables;

/// Texel index of integer coordinate `i` under a wrap mode. `i` is bounded by the caller to what an int holds.
inline int wrapIndex(int i, int n, Wrap mode) {
  switch (mode) {
    case Wrap::Repeat: i %= n; return i < 0 ? i + n : i;
    case Wrap::Mirror: {
      const int period = 2 * n;
      i %= period;
      if (i < 0) i += period;
      return i < n ? i : period - 1 - i;
    }
    case Wrap::Clamp: break;
  }
  return i < 0 ? 0 : i >= n ? n - 1 : i;
}

/// One level: where it starts, its size, and its tiles a row.
struct Level {
  size_t first;
  int width, height, tilesAcross;
};

Level levelOf(const Texture& t, int level) {
  const int w = std::max(1, t.width >> level), h = std::max(1, t.height >> level);
  return {level == 0 ? 0 : size_t(textureTexels(t.width, t.height, level, t.tile)), w, h, (w + (1 << t.tile) - 1) >> t.tile};
}

/// tile = 0 reduces to y * width + x: one formula for every layout, no branch.
inline size_t texelIndex(const Level& l, int tile, int x, int y) {
  const int mask = (1 << tile) - 1;
  const size_t at = size_t(y >> tile) * size_t(l.tilesAcross) + size_t(x >> tile);
  return l.first + ((at << (2 * tile)) | size_t(((y & mask) << tile) | (x & mask)));
}

/// Four channels; plain arithmetic of each, so that bits are those of scalar code.
using Texel = __m128;

inline Texel texel(const float* texels, const float*, size_t at) { return _mm_loadu_ps(texels + 4 * at); }
inline Texel texel(const uint8_t* texels, const float* colour, size_t at) {
  const uint8_t* p = texels + 4 * at;
  return _mm_setr_ps(colour[p[0]], colour[p[1]], colour[p[2]], kTables.linear[p[3]]);  // alpha is never sRGB-encoded
}

inline Vec4 vec4(Texel t) {
  Vec4 v;
  _mm_storeu_ps(&v.x, t);
  return v;
}

/// Where neighbours i and i + 1 are; nearly always both lie inside, and nothing has to be divided.
struct Neighbours {
  int first, second;
  Neighbours(int i, int n, Wrap mode) {
    if (i >= 0 && i < n - 1) {
      first = i;
      second = i + 1;
      return;
    }
    first = wrapIndex(i, n, mode);
    if (mode == Wrap::Repeat) second = first + 1 < n ? first + 1 : 0;
    else second = wrapIndex(i + 1, n, mode);
  }
};

template <typename T>
Vec4 sampleTexels(const Texture& t, const T* texels, const float* colour, const Level& l, float x, float y) {
  if (t.nearest) {
    const int at = wrapIndex(int(std::floor(x)), l.width, t.wrapU), row = wrapIndex(int(std::floor(y)), l.height, t.wrapV);
    return vec4(texel(texels, colour, texelIndex(l, t.tile, at, row)));
  }
  const float fx = std::floor(x - 0.5f), fy = std::floor(y - 0.5f);
  const float ax = x - 0.5f - fx, ay = y - 0.5f - fy;
  const Neighbours column(int(fx), l.width, t.wrapU), row(int(fy), l.height, t.wrapV);
  const Texel right = _mm_set1_ps(ax), left = _mm_set1_ps(1.0f - ax), below = _mm_set1_ps(ay), above = _mm_set1_ps(1.0f - ay);
  const auto across = [&](int y) {
    const Texel a = texel(texels, colour, texelIndex(l, t.tile, column.first, y)), b = texel(texels, colour, texelIndex(l, t.tile, column.second, y));
    return _mm_add_ps(_mm_mul_ps(a, left), _mm_mul_ps(b, right));
  };
  const Texel top = across(row.first), bottom = across(row.second);
  return vec4(_mm_add_ps(_mm_mul_ps(top, above), _mm_mul_ps(bottom, below)));
}

/// The lowest texel of each channel over all levels; padding does not count.
template <typename T>
void lowestTexel(const Texture& t, const Array<T>& texels, T (&least)[4]) {
  std::copy_n(texels.data(), 4, least);
  const auto take = [&](const T* p) {
    for (int c = 0; c < 4; ++c) least[c] = std::min(least[c], p[c]);
  };
  for (int k = 0; k < t.levels; ++k) {
    const Level l = levelOf(t, k);
    const int mask = (1 << t.tile) - 1;
    if (((l.width | l.height) & mask) == 0) {  // nothing padded: as they lie
      const size_t count = size_t(l.width) * size_t(l.height);
      for (size_t i = 0; i < count; ++i) take(texels.data() + (l.first + i) * 4);
    } else {
      for (int y = 0; y < l.height; ++y)
        for (int x = 0; x < l.width; ++x) take(texels.data() + texelIndex(l, t.tile, x, y) * 4);
    }
  }
}

/// Brings a coordinate into a range where int texel arithmetic over `size` texels is exact; NaN becomes 0. Repeat and Mirror are periodic in 2.
inline float tame(float c, Wrap mode, int size) {
  if (!std::isfinite(c)) return 0.0f;
  if (mode == Wrap::Clamp) return std::fmin(std::fmax(c, -1.0f), 2.0f);
  return std::fabs(c) < 1024.0f && std::fabs(c) * float(size) < 0x1p30f ? c : c - 2.0f * std::floor(c * 0.5f);
}

constexpr size_t kCached = 1 << 16;  // bytes of texels that stay near whatever is read beside them

}  // namespace

uint64_t textureTexels(int width, int height, int levels, int tile) {
  uint64_t total = 0;
  const uint64_t mask = (uint64_t(1) << tile) - 1;
  for (int k = 0; k < levels; ++k) {
    const uint64_t w = uint64_t(std::max(1, width >> k)), h = uint64_t(std::max(1, height >> k));
    total += ((w + mask) & ~mask) * ((h + mask) & ~mask);
  }
  return total;
}

void sealTexture(Texture& t) {
  GOBO_CHECK_GT(t.width, 0);
  GOBO_CHECK_GT(t.height, 0);
  GOBO_CHECK(t.levels >= 1 && t.levels <= kMaxTextureLevels && t.tile >= 0 && t.tile <= kMaxTextureTile);
  GOBO_CHECK_EQ(t.texels8.size() + t.texelsF.size(), size_t(textureTexels(t.width, t.height, t.levels, t.tile)) * 4);
  t.channels = 4;
  Hasher h("texture");
  h.add(t.width).add(t.height).add(t.srgb).add(t.wrapU).add(t.wrapV).add(t.nearest).add(t.levels).add(t.tile);
  h.addArray(t.texels8).addArray(t.texelsF);
  t.content = h.digest();
  if (!t.texelsF.empty()) {
    float least[4];
    lowestTexel(t, t.texelsF, least);
    t.lowest = Vec4(least[0], least[1], least[2], least[3]);
  } else {
    uint8_t least[4];
    lowestTexel(t, t.texels8, least);
    const auto& colour = t.srgb ? kTables.srgb : kTables.linear;
    t.lowest = Vec4(colour[least[0]], colour[least[1]], colour[least[2]], kTables.linear[least[3]]);
  }
}

void Texture::prefetch(Vec2 uv) const {
  const size_t bytes = texelsF.empty() ? 4 : 16;
  if (bytes * size_t(width) * size_t(height) < kCached || wrapU == Wrap::Mirror || wrapV == Wrap::Mirror) return;
  const auto inside = [](float c, Wrap mode) { return mode == Wrap::Repeat ? c - std::floor(c) : c; };
  const float u = inside(uv.x, wrapU), v = inside(uv.y, wrapV);
  if (!(u >= 0.0f && u < 1.0f && v >= 0.0f && v < 1.0f)) return;  // the rim, NaN
  const Level l = levelOf(*this, 0);
  const int x = std::max(int(u * float(width) - 0.5f), 0), y = std::max(int(v * float(height) - 0.5f), 0);
  const char* const texels = texelsF.empty() ? reinterpret_cast<const char*>(texels8.data()) : reinterpret_cast<const char*>(texelsF.data());
  __builtin_prefetch(texels + bytes * texelIndex(l, tile, x, y));
  __builtin_prefetch(texels + bytes * texelIndex(l, tile, x, std::min(y + 1, height - 1)));
}

Vec4 Texture::sampleLevel(Vec2 uv, int level) const {
  const Level l = levelOf(*this, level);
  const float x = tame(uv.x, wrapU, l.width) * float(l.width), y = tame(uv.y, wrapV, l.height) * float(l.height);
  if (!texelsF.empty()) return sampleTexels(*this, texelsF.data(), nullptr, l, x, y);
  return sampleTexels(*this, texels8.data(), srgb ? kTables.srgb.data() : kTables.linear.data(), l, x, y);
}

}  // namespace scene
}  // namespace gobo
