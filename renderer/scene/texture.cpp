// SPDX-License-Identifier: Apache-2.0
// Texture look-up. 8-bit texels are decoded through tables, so a bilinear sample is 16 loads and no transcendental.
#include <array>

#include "base/check.h"
#include "base/transfer.h"
#include "scene/material.h"

namespace gobo {
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

inline Vec4 texel(const Texture& t, int x, int y) {
  const size_t at = (size_t(y) * t.width + x) * 4;
  if (!t.texelsF.empty()) return Vec4(t.texelsF[at], t.texelsF[at + 1], t.texelsF[at + 2], t.texelsF[at + 3]);
  const uint8_t* p = t.texels8.data() + at;
  const auto& colour = t.srgb ? kTables.srgb : kTables.linear;
  return Vec4(colour[p[0]], colour[p[1]], colour[p[2]], kTables.linear[p[3]]);  // alpha is never sRGB-encoded
}

/// Brings a coordinate into a range where int texel arithmetic is exact; NaN becomes 0. Repeat and Mirror are periodic in 2.
inline float tame(float c, Wrap mode) {
  if (!std::isfinite(c)) return 0.0f;
  if (mode == Wrap::Clamp) return std::fmin(std::fmax(c, -1.0f), 2.0f);
  return std::fabs(c) < 1024.0f ? c : c - 2.0f * std::floor(c * 0.5f);
}

}  // namespace

void sealTexture(Texture& t) {
  GOBO_CHECK_GT(t.width, 0);
  GOBO_CHECK_GT(t.height, 0);
  GOBO_CHECK_EQ(t.texels8.size() + t.texelsF.size(), size_t(t.width) * t.height * 4);
  t.channels = 4;
  Hasher h("texture");
  h.add(t.width).add(t.height).add(t.srgb).add(t.wrapU).add(t.wrapV).add(t.nearest).addArray(t.texels8).addArray(t.texelsF);
  t.content = h.digest();
}

Vec4 Texture::sample(Vec2 uv) const {
  const float x = tame(uv.x, wrapU) * float(width), y = tame(uv.y, wrapV) * float(height);
  if (nearest) return texel(*this, wrapIndex(int(std::floor(x)), width, wrapU), wrapIndex(int(std::floor(y)), height, wrapV));
  const float fx = std::floor(x - 0.5f), fy = std::floor(y - 0.5f);
  const float ax = x - 0.5f - fx, ay = y - 0.5f - fy;
  const int x0 = wrapIndex(int(fx), width, wrapU), x1 = wrapIndex(int(fx) + 1, width, wrapU);
  const int y0 = wrapIndex(int(fy), height, wrapV), y1 = wrapIndex(int(fy) + 1, height, wrapV);
  const Vec4 top = texel(*this, x0, y0) * (1.0f - ax) + texel(*this, x1, y0) * ax;
  const Vec4 bottom = texel(*this, x0, y1) * (1.0f - ax) + texel(*this, x1, y1) * ax;
  return top * (1.0f - ay) + bottom * ay;
}

}  // namespace gobo
