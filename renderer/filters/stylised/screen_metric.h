// SPDX-License-Identifier: Apache-2.0
// The picture as a surface: what distances, contours and Gaussians are measured on where a style's metric is SCREEN (figure 3.4 of DeCoro's thesis compares it
// with the world's).
//
// Computes     Sample (x, y) lies at (x + 1/2, y + 1/2) pixels of width `pixel`, all of one surface that faces the eye: no normal guards, no instance or
//              depth cuts. What hits nothing is lit and part of it, so that a shadow that ends at a silhouette has its contour there, as it has in the picture;
//              its distance is that to the contour, too.
// Units        1 is the height of the picture (without a guard band): `pixel` is 1 / height.
// Cost         36 bytes a sample and one pass.
#pragma once

#include <vector>

#include "filters/stylised/contour.h"

namespace gobo {
inline namespace filters {

class PictureSurface {
 public:
  PictureSurface(int width, int height, float pixel);
  PictureSurface(const PictureSurface&) = delete;
  PictureSurface& operator=(const PictureSurface&) = delete;

  /// No V. It and the next one's are spans of this one.
  const ContourInput& input() const { return input_; }
  /// With that layer's V of a visibility term; `gbuffer` (instance) says what hits nothing. Levels as of contourInput.
  const ContourInput& visible(const Term& visibility, const Term& gbuffer, size_t layer, int level, int levels);
  static size_t bytesPerSample() { return 9 * sizeof(float); }

 private:
  std::vector<float> P_, N_, footprint_, V_;
  std::vector<uint32_t> instance_;
  ContourInput input_;
};

}  // namespace filters
}  // namespace gobo
