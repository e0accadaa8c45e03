// SPDX-License-Identifier: Apache-2.0
// Oracles: look-ups of the plain layout (bit for bit), means in linear light, and small cases by hand.
#include "scene/mipmap.h"

#include <gtest/gtest.h>

#include "base/sobol.h"

namespace gobo {
namespace {

Texture noise(int w, int h, bool floats, bool srgb, uint32_t seed = 1) {
  Texture t;
  t.name = "noise" + std::to_string(seed);
  t.width = w;
  t.height = h;
  t.srgb = srgb;
  std::vector<uint8_t> a;
  std::vector<float> f;
  for (int i = 0; i < w * h * 4; ++i) floats ? f.push_back(4.0f * toUnit(hash32(seed, i))) : a.push_back(uint8_t(hash32(seed, i)));
  t.texels8 = a;
  t.texelsF = f;
  sealTexture(t);
  return t;
}

TEST(Mipmap, LayoutChangesNoBitOfALookup) {
  for (const auto& [w, h] : {std::pair{1, 1}, {2, 5}, {7, 3}, {16, 16}, {33, 64}, {130, 67}})
    for (const bool floats : {false, true})
      for (const int tile : {0, 1, 2, 3, 4})
        for (const bool nearest : {false, true}) {
          Texture rows = noise(w, h, floats, !floats);
          rows.nearest = nearest;
          rows.wrapU = Wrap::Mirror;
          rows.wrapV = tile & 1 ? Wrap::Clamp : Wrap::Repeat;
          const Texture tiled = mipmapped(rows, false, 0, tile);
          for (int i = 0; i < 400; ++i) {
            const Vec2 uv(4.0f * toUnit(hash32(5, i)) - 2.0f, 4.0f * toUnit(hash32(6, i)) - 2.0f);
            const Vec4 a = rows.sample(uv), b = tiled.sample(uv);
            ASSERT_EQ(a, b) << w << "x" << h << " tile " << tile << " at " << uv.x << " " << uv.y;
          }
        }
}

// Texture::lowest: no look-up of any level is below it, some texel reaches it, and padding of tiles does not count.
TEST(Mipmap, LowestIsTheLeastOfWhatIsLookedUp) {
  for (const auto& [w, h] : {std::pair{1, 1}, {2, 5}, {7, 3}, {16, 16}, {33, 64}})
    for (const bool floats : {false, true})
      for (const int tile : {0, 2, 3}) {
        Texture t = mipmapped(noise(w, h, floats, !floats, uint32_t(w + tile)), false, 0, tile);
        Vec4 least(1e9f), point(1e9f);
        for (int level = 0; level < t.levels; ++level)
          for (int i = 0; i < 400; ++i) least = glm::min(least, t.sampleLevel(Vec2(2.0f * toUnit(hash32(5, i)) - 1.0f, toUnit(hash32(6, i))), level));
        t.nearest = true;
        for (int level = 0; level < t.levels; ++level) {
          const int a = std::max(1, w >> level), b = std::max(1, h >> level);
          for (int i = 0; i < a * b; ++i)
            point = glm::min(point, t.sampleLevel(Vec2((float(i % a) + 0.5f) / float(a), (float(i / a) + 0.5f) / float(b)), level));
        }
        EXPECT_EQ(t.lowest, point) << w << "x" << h << " tile " << tile << " floats " << floats;
        for (int c = 0; c < 4; ++c) EXPECT_GE(least[c], t.lowest[c] * (1.0f - 1e-6f)) << w << "x" << h << " tile " << tile;
      }
}

// 900 x 4194304 texels is no int. The reference: the same place in the first tile.
TEST(Mipmap, AWideTextureIsLookedUpFarFromItsOrigin) {
  constexpr int kWide = 1 << 22;
  Texture t;
  t.width = kWide;
  t.height = 1;
  t.nearest = true;
  std::vector<uint8_t> texels(size_t(kWide) * 4, 9);
  texels[size_t(kWide) / 2 * 4] = 200;
  t.texels8 = texels;
  sealTexture(t);
  for (const Wrap wrap : {Wrap::Repeat, Wrap::Mirror}) {
    t.wrapU = wrap;
    const float bright = t.sampleLevel(Vec2(0.5f, 0.5f), 0).x;
    EXPECT_GT(bright, t.sampleLevel(Vec2(0.25f, 0.5f), 0).x);
    for (const float tiles : {2.0f, 900.0f, -900.0f, 1e6f}) EXPECT_EQ(t.sampleLevel(Vec2(tiles + 0.5f, 0.5f), 0).x, bright) << tiles;
  }
}

/// Mean over a level by point look-ups of its texel centres.
Vec4 meanOf(const Texture& t, int level) {
  Texture p = t;
  p.nearest = true;
  const int w = std::max(1, t.width >> level), h = std::max(1, t.height >> level);
  glm::dvec4 sum(0.0);
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x) sum += glm::dvec4(p.sampleLevel(Vec2((x + 0.5f) / w, (y + 0.5f) / h), level));
  return Vec4(sum / (double(w) * h));
}

TEST(Mipmap, EveryLevelHasTheMeanOfTheFirst) {
  for (const auto& [w, h] : {std::pair{16, 16}, {17, 9}, {31, 7}, {1, 13}, {24, 100}}) {
    const Texture f = mipmapped(noise(w, h, true, false), false), b = mipmapped(noise(w, h, false, true), false);
    const Vec4 f0 = meanOf(f, 0), b0 = meanOf(b, 0);
    int levels = 1;
    for (int n = std::max(w, h); n > 1; n /= 2) ++levels;
    EXPECT_EQ(f.levels, levels);
    for (int k = 1; k < levels; ++k)
      for (int c = 0; c < 4; ++c) {
        EXPECT_NEAR(meanOf(f, k)[c], f0[c], 2e-6f * 4) << w << "x" << h << " level " << k;
        EXPECT_NEAR(meanOf(b, k)[c], b0[c], 0.006f) << w << "x" << h << " level " << k;  // half a code near white is 0.0045
      }
  }
}

TEST(Mipmap, FiltersInLinearLight) {
  Texture t;
  t.width = t.height = 2;
  t.srgb = true;
  t.texels8 = {0, 0, 0, 255, 255, 255, 255, 255, 255, 255, 255, 255, 0, 0, 0, 255};
  sealTexture(t);
  const Texture m = mipmapped(t, false, 0, 0);
  EXPECT_EQ(int(m.texels8[16]), 188);  // sRGB of 0.5; a mean of codes would be 128
  t.srgb = false;
  sealTexture(t);
  EXPECT_EQ(int(mipmapped(t, false, 0, 0).texels8[16]), 128);
}

TEST(Mipmap, CutAwayColourDoesNotBleed) {
  Texture t;
  t.width = 2;
  t.height = 1;
  t.texels8 = {200, 0, 0, 255, 0, 255, 0, 0};
  sealTexture(t);
  const Texture weighted = mipmapped(t, true, 0, 0), plain = mipmapped(t, false, 0, 0);
  EXPECT_EQ(int(weighted.texels8[8]), 200);
  EXPECT_EQ(int(weighted.texels8[9]), 0);
  EXPECT_EQ(int(weighted.texels8[11]), 128);
  EXPECT_EQ(int(plain.texels8[8]), 100);
  EXPECT_EQ(int(plain.texels8[9]), 128);
}

TEST(Mipmap, DroppedLevelsLeaveTheOthersAlone) {
  const Texture t = noise(40, 24, false, true);
  const Texture all = mipmapped(t, false), two = mipmapped(t, false, 2);
  EXPECT_EQ(two.width, 10);
  EXPECT_EQ(two.height, 6);
  EXPECT_EQ(two.levels, all.levels - 2);
  for (int k = 0; k < two.levels; ++k)
    for (int i = 0; i < 50; ++i) {
      const Vec2 uv(toUnit(hash32(1, i)), toUnit(hash32(2, i)));
      ASSERT_EQ(two.sampleLevel(uv, k), all.sampleLevel(uv, k + 2));
    }
  EXPECT_EQ(mipmapped(t, false, 99).width, 1);
}

TEST(Mipmap, MemoryIsBoundedLargestFirst) {
  const auto scene = [] {
    Scene s;
    s.textures = {std::make_shared<Texture>(noise(64, 64, false, true, 1)), std::make_shared<Texture>(noise(128, 128, false, true, 2)),
                  std::make_shared<Texture>(noise(16, 16, true, false, 3))};
    return s;
  };
  const auto bytes = [](const Scene& s) {
    size_t n = 0;
    for (const auto& t : s.textures) n += t->texels8.size() + t->texelsF.size() * 4;
    return n;
  };
  Scene whole = scene();
  finishTextures(whole, 1 << 30);
  EXPECT_TRUE(whole.warnings.empty());
  EXPECT_NEAR(double(bytes(whole)), (64 * 64 + 128 * 128 + 16 * 16 * 4) * 4 * 4 / 3.0, 1500);
  Scene less = scene();
  finishTextures(less, bytes(whole) - 1);
  ASSERT_EQ(less.warnings.size(), 1u);
  EXPECT_NE(less.warnings[0].find("\"noise2\" is kept at 64 x 64 of 128 x 128"), std::string::npos) << less.warnings[0];
  EXPECT_EQ(less.textures[0]->width, 64);
  EXPECT_NE(less.textures[1]->content, whole.textures[1]->content);  // a smaller texture is another one
  Scene tiny = scene();
  finishTextures(tiny, 0);
  EXPECT_EQ(tiny.warnings.size(), 3u);
  for (const auto& t : tiny.textures) EXPECT_EQ(t->width * t->height, 1);
}

}  // namespace
}  // namespace gobo
