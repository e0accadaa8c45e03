// SPDX-License-Identifier: Apache-2.0
#include "scene/mipmap.h"

#include <algorithm>
#include <array>
#include <map>
#include <tuple>
#include <vector>

#include "base/check.h"
#include "scene/texture_seal.h"

namespace gobo {
inline namespace scene {
namespace {

/// sRGB encoding of 8 bits by table: 65536 steps put at least 19 of them between any two codes.
struct EncodeTable {
  std::vector<uint8_t> code;
  EncodeTable() : code(65536) {
    for (int i = 0; i < 65536; ++i) {
      const double c = i / 65535.0, e = c <= 0.0031308 ? 12.92 * c : 1.055 * std::pow(c, 1.0 / 2.4) - 0.055;
      code[i] = uint8_t(e * 255.0 + 0.5);
    }
  }
};

uint8_t unorm(float v) { return uint8_t(clamp01(v) * 255.0f + 0.5f); }

/// Which texels of `n` fall on each of `m` <= n: at most 4, with their shares (sum 1).
struct Taps {
  int first = 0, count = 0;
  std::array<float, 4> weight{};
};
std::vector<Taps> tapsOf(int n, int m) {
  std::vector<Taps> taps(m);
  for (int i = 0; i < m; ++i) {
    const double lo = double(i) * n / m, hi = double(i + 1) * n / m;
    Taps& t = taps[i];
    t.first = std::min(int(lo), n - 1);
    for (int k = t.first; k < n && t.count < 4 && double(k) < hi - 1e-9; ++k)
      t.weight[t.count++] = float((std::min(hi, double(k + 1)) - std::max(lo, double(k))) / (hi - lo));
  }
  return taps;
}

template <typename Source>
std::vector<Vec4> halved(int w, int h, int nw, int nh, bool coverage, const StopToken& stop, const Source& source) {
  std::vector<Vec4> out(size_t(nw) * nh);
  const std::vector<Taps> across = tapsOf(w, nw), down = tapsOf(h, nh);
  for (int y = 0; y < nh && !stop.stopRequested(); ++y)
    for (int x = 0; x < nw; ++x) {
      Vec4 sum(0.0f);
      Vec3 covered(0.0f);
      for (int j = 0; j < down[y].count; ++j)
        for (int i = 0; i < across[x].count; ++i) {
          const Vec4 c = source(across[x].first + i, down[y].first + j);
          const float weight = across[x].weight[i] * down[y].weight[j];
          sum += c * weight;
          covered += Vec3(c) * (c.w * weight);
        }
      if (coverage && sum.w > 0.0f) sum = Vec4(covered / sum.w, sum.w);
      out[size_t(y) * nw + x] = sum;
    }
  return out;
}

/// Rows to tiles; what pads the edge tiles stays 0.
template <typename T, typename At>
void store(std::vector<T>& out, size_t first, int w, int h, int tile, const StopToken& stop, const At& at) {
  const int mask = (1 << tile) - 1, tilesAcross = (w + mask) >> tile;
  for (int y = 0; y < h && !stop.stopRequested(); ++y)
    for (int x = 0; x < w; ++x) {
      const size_t block = size_t(y >> tile) * size_t(tilesAcross) + size_t(x >> tile);
      const size_t to = (first + ((block << (2 * tile)) | size_t(((y & mask) << tile) | (x & mask)))) * 4;
      at(x, y, out.data() + to);
    }
}

int levelsOf(int w, int h) {
  int n = 1;
  while (n < kMaxTextureLevels && (w >> n > 0 || h >> n > 0)) ++n;
  return n;
}

}  // namespace

Texture mipmapped(const Texture& t, bool coverage, int drop, int tile, const StopToken& stop) {
  GOBO_CHECK(t.levels == 1 && t.tile == 0);
  static const EncodeTable encode;
  const bool floats = !t.texelsF.empty();
  const int all = levelsOf(t.width, t.height);
  drop = std::clamp(drop, 0, all - 1);
  Texture out = t;
  out.width = std::max(1, t.width >> drop);
  out.height = std::max(1, t.height >> drop);
  out.levels = all - drop;
  out.tile = tile;
  const size_t values = size_t(textureTexels(out.width, out.height, out.levels, tile)) * 4;
  std::vector<uint8_t> texels8(floats ? 0 : values);
  std::vector<float> texelsF(floats ? values : 0);
  if (drop == 0) {
    const uint8_t* from8 = t.texels8.data();
    const float* fromF = t.texelsF.data();
    if (floats) store(texelsF, 0, t.width, t.height, tile, stop, [&](int x, int y, float* to) { std::copy_n(fromF + (size_t(y) * t.width + x) * 4, 4, to); });
    else store(texels8, 0, t.width, t.height, tile, stop, [&](int x, int y, uint8_t* to) { std::copy_n(from8 + (size_t(y) * t.width + x) * 4, 4, to); });
  }
  std::array<float, 256> colour, linear;  // as in texture.cpp
  for (int i = 0; i < 256; ++i) {
    const double c = i / 255.0;
    linear[i] = float(c);
    colour[i] = t.srgb ? float(c <= 0.04045 ? c / 12.92 : std::pow((c + 0.055) / 1.055, 2.4)) : float(c);
  }
  std::vector<Vec4> now;  // the level above, linear; level 0 is read in place: it is four times as big as the rest
  for (int k = 1, w = t.width, h = t.height; k < all; ++k) {
    const int nw = std::max(1, t.width >> k), nh = std::max(1, t.height >> k);
    if (k > 1) now = halved(w, h, nw, nh, coverage, stop, [&](int x, int y) { return now[size_t(y) * w + x]; });
    else if (floats) {
      const float* p = t.texelsF.data();
      now = halved(w, h, nw, nh, coverage, stop, [&](int x, int y) {
        const float* q = p + (size_t(y) * w + x) * 4;
        return Vec4(q[0], q[1], q[2], q[3]);
      });
    } else {
      const uint8_t* p = t.texels8.data();
      now = halved(w, h, nw, nh, coverage, stop, [&](int x, int y) {
        const uint8_t* q = p + (size_t(y) * w + x) * 4;
        return Vec4(colour[q[0]], colour[q[1]], colour[q[2]], linear[q[3]]);
      });
    }
    w = nw;
    h = nh;
    if (k < drop) continue;
    const size_t first = size_t(textureTexels(out.width, out.height, k - drop, tile));
    if (floats)
      store(texelsF, first, w, h, tile, stop, [&](int x, int y, float* to) {
        const Vec4& c = now[size_t(y) * w + x];
        for (int i = 0; i < 4; ++i) to[i] = std::isfinite(c[i]) ? c[i] : 3.0e38f;  // a sum of large finite texels may overflow
      });
    else
      store(texels8, first, w, h, tile, stop, [&](int x, int y, uint8_t* to) {
        const Vec4& c = now[size_t(y) * w + x];
        for (int i = 0; i < 3; ++i) to[i] = t.srgb ? encode.code[size_t(clamp01(c[i]) * 65535.0f + 0.5f)] : unorm(c[i]);
        to[3] = unorm(c.w);
      });
  }
  out.texels8 = std::move(texels8);
  out.texelsF = std::move(texelsF);
  sealTexture(out);
  return out;
}

void finishTextures(Scene& scene, uint64_t maxBytes, const StopToken& stop) {
  const size_t n = scene.textures.size();
  std::vector<char> coverage(n, 0);
  for (const Material& m : scene.materials)
    for (const TextureRef* ref : {&m.coverage.texture, &m.albedo.texture})
      if (m.coverage.mode != AlphaMode::Opaque && ref->valid() && size_t(ref->texture) < n) coverage[ref->texture] = 1;
  // What comes out the same for all textures in it: a group has one set of levels.
  using Source = std::tuple<const void*, size_t, int, int, bool, char>;
  std::map<Source, size_t> groups;
  std::vector<size_t> group(n), first;  // of texture i; of group g
  for (size_t i = 0; i < n; ++i) {
    const Texture& t = *scene.textures[i];
    const bool floats = !t.texelsF.empty();
    const Source source(floats ? static_cast<const void*>(t.texelsF.data()) : t.texels8.data(), floats ? t.texelsF.size() : t.texels8.size(), t.width, t.height,
                        t.srgb, coverage[i]);
    const auto [at, fresh] = groups.try_emplace(source, first.size());
    if (fresh) first.push_back(i);
    group[i] = at->second;
  }
  const auto bytesAt = [&](size_t g, int drop) {
    const Texture& t = *scene.textures[first[g]];
    const int levels = levelsOf(t.width, t.height);
    return textureTexels(std::max(1, t.width >> drop), std::max(1, t.height >> drop), levels - drop, kTextureTile) * (t.texelsF.empty() ? 4u : 16u);
  };
  std::vector<int> drop(first.size(), 0);
  uint64_t total = 0;
  for (size_t g = 0; g < first.size(); ++g) total += bytesAt(g, 0);
  while (total > maxBytes) {
    size_t largest = first.size();
    for (size_t g = 0; g < first.size(); ++g) {
      if (drop[g] + 1 >= levelsOf(scene.textures[first[g]]->width, scene.textures[first[g]]->height)) continue;
      if (largest == first.size() || bytesAt(g, drop[g]) > bytesAt(largest, drop[largest])) largest = g;
    }
    if (largest == first.size()) break;
    total -= bytesAt(largest, drop[largest]);
    total += bytesAt(largest, ++drop[largest]);
  }
  TextureSealer sealer;
  std::vector<std::shared_ptr<const Texture>> levels(first.size());
  for (size_t i = 0; i < n && !stop.stopRequested(); ++i) {
    const size_t g = group[i];
    const std::shared_ptr<const Texture> whole = std::move(scene.textures[i]);
    std::shared_ptr<Texture> made;
    if (!levels[g]) {
      levels[g] = made = std::make_shared<Texture>(mipmapped(*whole, coverage[i], drop[g], kTextureTile, stop));
    } else {
      made = std::make_shared<Texture>(*levels[g]);
      made->name = whole->name;
      made->wrapU = whole->wrapU;
      made->wrapV = whole->wrapV;
      made->nearest = whole->nearest;
      sealer.seal(*made);
    }
    if (drop[g] > 0)
      scene.warnings.push_back("/textures: \"" + whole->name + "\" is kept at " + std::to_string(made->width) + " x " + std::to_string(made->height) + " of " +
                               std::to_string(whole->width) + " x " + std::to_string(whole->height) + ": the scene's textures are bounded by " +
                               std::to_string(maxBytes) + " bytes (ingest.texture_bytes)");
    scene.textures[i] = std::move(made);
  }
}

}  // namespace scene
}  // namespace gobo
