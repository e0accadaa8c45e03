// SPDX-License-Identifier: Apache-2.0
// Where a pixel's surface was seen in the frame before, and whether it was.
#pragma once

#include <cstddef>
#include <span>

#include "scene/camera.h"

namespace gobo::denoise {

/// What a camera sees; planes as in NoisyPicture (denoiser.h). `object`: index of what is hit; may be empty.
struct SeenSurfaces {
  int width = 0, height = 0;
  std::span<const float> position, normal, coverage, footprint, object;
};

/// How far two pixels may differ and still show one surface.
struct SameSurface {
  float planePixels = 2.0f;  ///< either's distance from the other's tangent plane, in widths of the wider pixel
  float cosAngle = 0.9f;     ///< of their normals
};

/// Pixel p of a and q of b. Symmetric; true where neither hits anything; false where a number is not finite.
bool sameSurface(const SeenSurfaces& a, size_t p, const SeenSurfaces& b, size_t q, const SameSurface& by);

/// The pixels around a place of the earlier frame that show the same surface, with the weights of bilinear interpolation; those of others are missing in
/// the sum.
struct EarlierPixels {
  size_t at[4];
  float weight[4];
  int count = 0;
};

/// Both frames are of one size. A pixel is looked for at its own centre and the way that its world position went on the film from one camera to the other, so
/// that with a camera that rests it is the pixel itself to the bit, wherever in it the view samples lie. What is not hit is infinitely far.
/// The film of a panorama ends at its seam. Things that move by themselves are not followed: they fail the test of position.
class Reprojection {
 public:
  Reprojection(const Camera& now, const SeenSurfaces& seen, const Camera& before, const SeenSurfaces& seenBefore, const SameSurface& by);
  EarlierPixels of(size_t pixel) const;

 private:
  bool moved(size_t pixel, glm::dvec2& way) const;

  Camera now_, before_;
  SeenSurfaces seen_, seenBefore_;
  SameSurface by_;
  bool rests_;
};

}  // namespace gobo::denoise
