// SPDX-License-Identifier: Apache-2.0
// Gaussian means along the rows or columns of a picture, each pixel with its own width, over pixels of the same surface. Two of them are a filter in both
// directions (Mehta et al. 2012, the separable approximation). Vectorised: about 0.5 ns a tap and pixel for three channels.
#pragma once

#include "filters/denoise/similar_rows.h"

namespace gobo::denoise {

struct LineWindow {
  const float* width = nullptr;  ///< by pixel: standard deviation in widths of a pixel at its surface; 0: it stays as it is; negative: nor does another use it
  int radius = 0;                ///< pixels on either side, at most kMostRadius
  float cosAngle = 0.94f;        ///< least cosine between normals
  float widthThreshold = 0.75f;  ///< largest |width - width'| / max of both
};
inline constexpr int kMostRadius = 64;
/// Widths that the window is cut at: what lies beyond is 4.4 % of a Gaussian's square.
inline constexpr float kReach = 2.5f;

/// out[c] = in[c] + sum w (in'[c] - in[c]) / sum w for row y, over the pixels of that row (or, `columns`, those above and below), w = exp(-t^2 / (2 width^2)),
/// t: distance in the pixel's tangent plane in widths of a pixel. Others have to lie within two widths of a pixel of that plane, more (a quarter
/// of the way) far away. Even light stays as it is to the bit.
void lineMeansRow(const AlikePlanes& k, const LineWindow& window, bool columns, const float* const* in, int channels, int y, float* const* out);

}  // namespace gobo::denoise
