// SPDX-License-Identifier: Apache-2.0
// Pictures have what adds to the background (premultiplied alpha), PNG has straight alpha: a curve or a view is of the colour by itself. Light without a
// surface in front of nothing (a lamp that is seen, its bloom) gets as much alpha as it needs to be shown, and so does the rim of a surface beside it; where
// there is none beside it a pixel's alpha is what surfaces cover of it, however bright they are.
#pragma once

#include <algorithm>
#include <vector>

#include "base/image.h"

namespace gobo {
inline namespace plan {

struct StraightAlpha {
  Image colour;              ///< 3 channels, divided by alpha; black where there is none
  std::vector<float> alpha;  ///< 0..1
};

/// `linear`: 4 channels. `scale`: of the exposure, which decides how much light is shown.
inline StraightAlpha straightAlpha(const Image& linear, float scale) {
  StraightAlpha out{Image(linear.width, linear.height, 3), std::vector<float>(linear.pixels())};
  const auto needed = [&](const float* v) { return std::clamp(std::max({v[0], v[1], v[2]}) * scale, 0.0f, 1.0f); };
  for (int y = 0; y < linear.height; ++y)
    for (int x = 0; x < linear.width; ++x) {
      const size_t p = size_t(y) * size_t(linear.width) + size_t(x);
      const float* v = linear.data.data() + 4 * p;
      float beside = 0.0f;  // what light without any surface needs in one of the 3 x 3 pixels
      for (int j = std::max(y - 1, 0); j <= std::min(y + 1, linear.height - 1); ++j)
        for (int i = std::max(x - 1, 0); i <= std::min(x + 1, linear.width - 1); ++i) {
          const float* other = linear.data.data() + 4 * (size_t(j) * size_t(linear.width) + size_t(i));
          if (!(other[3] > 0.0f)) beside = std::max(beside, needed(other));
        }
      const float alpha = out.alpha[p] = std::clamp(std::max(v[3], std::min(needed(v), beside)), 0.0f, 1.0f);
      for (size_t c = 0; c < 3; ++c) out.colour.data[3 * p + c] = alpha > 0.0f ? v[c] / alpha : 0.0f;
    }
  return out;
}

/// Four channels again, of a colour that has been changed.
inline Image withAlpha(const Image& colour, const std::vector<float>& alpha, const std::vector<std::string>& names) {
  Image out(colour.width, colour.height, 4);
  out.names = names;
  for (size_t p = 0; p < alpha.size(); ++p) {
    for (size_t c = 0; c < 3; ++c) out.data[4 * p + c] = colour.data[3 * p + c];
    out.data[4 * p + 3] = alpha[p];
  }
  return out;
}

}  // namespace plan
}  // namespace gobo
