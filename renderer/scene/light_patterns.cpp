// SPDX-License-Identifier: Apache-2.0
// The built-in pictures for spots. Values are multiples of 1/255: no machine's rounding is in their digests.
#include <array>
#include <functional>

#include "base/check.h"
#include "base/sobol.h"
#include "scene/light_profile.h"

namespace gobo {
inline namespace scene {
namespace {

constexpr int kSide = 256, kSteps = 4;  // steps: sub-samples a texel and axis, as edges of slats are seldom sharp

/// Share of a texel that `open` leaves open, (x, y) in [0,1)^2 from the top left corner.
LightProfilePtr painted(const char* name, const std::function<bool(float x, float y)>& open) {
  auto p = std::make_shared<LightProfile>();
  p->name = name;
  p->width = p->height = kSide;
  std::vector<Vec3> values(size_t(kSide) * kSide);
  for (int y = 0; y < kSide; ++y)
    for (int x = 0; x < kSide; ++x) {
      int n = 0;
      for (int k = 0; k < kSteps * kSteps; ++k)
        n += open((float(x) + (float(k % kSteps) + 0.5f) / kSteps) / kSide, (float(y) + (float(k / kSteps) + 0.5f) / kSteps) / kSide);
      values[size_t(y) * kSide + size_t(x)] = Vec3(float(n * 255 / (kSteps * kSteps)) / 255.0f);
    }
  p->values = std::move(values);
  GOBO_CHECK(sealProfile(*p).ok());
  return p;
}

bool blinds(float x, float y) {
  const float slat = y * 12.0f - std::floor(y * 12.0f), cord = std::fabs(std::fabs(x - 0.5f) - 0.22f);
  return slat > 0.45f && cord > 0.006f;
}

/// Six panes within the circle that the cone cuts.
bool window(float x, float y) {
  const float u = (x - 0.22f) / 0.56f, v = (y - 0.16f) / 0.68f;
  if (u < 0.0f || u > 1.0f || v < 0.0f || v > 1.0f) return false;
  const float across = u * 2.0f - std::floor(u * 2.0f), down = v * 3.0f - std::floor(v * 3.0f);
  return across > 0.06f && across < 0.94f && down > 0.06f && down < 0.94f;
}

/// Ellipses that grow out of a grid, each turned its own way; what they leave is light.
struct Leaves {
  struct Leaf {
    float x, y, c, s, length;
  };
  static constexpr int kGrid = 9;
  std::array<Leaf, kGrid * kGrid> leaves;
  Leaves() {
    for (int i = 0; i < kGrid * kGrid; ++i) {
      const auto u = [&](uint64_t k) { return float(hash64(uint64_t(i), k) >> 40) / float(1 << 24); };
      const float turn = 6.2831853f * u(1);
      leaves[size_t(i)] = {(float(i % kGrid) + 1.3f * u(2) - 0.15f) / kGrid, (float(i / kGrid) + 1.3f * u(3) - 0.15f) / kGrid, std::cos(turn), std::sin(turn),
                           0.045f + 0.04f * u(4)};
    }
  }
  bool operator()(float x, float y) const {
    for (const Leaf& l : leaves) {
      const float dx = x - l.x, dy = y - l.y, along = (l.c * dx + l.s * dy) / l.length, across = (l.c * dy - l.s * dx) / (0.45f * l.length);
      if (along * along + across * across < 1.0f) return false;
    }
    return true;
  }
};

}  // namespace

LightProfilePtr patternProfile(LightPattern pattern) {
  static const LightProfilePtr made[] = {painted("blinds", blinds), painted("window", window), painted("leaves", Leaves())};
  return made[size_t(pattern)];
}

}  // namespace scene
}  // namespace gobo
