// SPDX-License-Identifier: Apache-2.0
// Rows of a level of the edge-avoiding wavelets (wavelet.h). Structure of arrays; vectorised.
#pragma once

#include <cstddef>

namespace gobo::denoise {

/// A level: planes of width * height.
struct WaveletLevel {
  int width = 0, height = 0, spacing = 1;
  float power = 0;              ///< of the cosine
  const float* facing[4] = {};  ///< unit normal, and 1 where nothing is hit (the normal is 0 there): the product of two is the cosine, or whether neither is
  const float* place[3] = {};   ///< position, 0 where nothing is hit
  const float* perPlane = nullptr;  ///< 1 / (distance from the plane that counts, for a pixel of distance)
  const float* perSigma = nullptr;  ///< 1 / (difference of the guide that counts)
  int channels = 0;                 ///< filtered; the last one is the guide
  const float* in[7] = {};
  float* out[7] = {};
  const float* variance = nullptr;  ///< of the guide
  float correlated = 0;             ///< share of the variance that taps have in common (wavelet.h)
  float* varianceOut = nullptr;
};

/// Row y of `out` and `varianceOut`.
void waveletRow(const WaveletLevel& k, int y);

/// Row y of 1 / (scale * standard deviation): variance through the taps 1 2 1, of pixels that hit, or do not, like the middle.
void perSigmaRow(const float* nothing, const float* variance, int width, int height, int y, float scale, float* perSigma);

}  // namespace gobo::denoise
