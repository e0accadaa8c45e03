// SPDX-License-Identifier: Apache-2.0
// Weights of pixels by how alike the patches around them are in a guide picture: the rows of non_local_means.h, for it and whoever regresses by them.
#pragma once

#include <vector>

#include "filters/denoise/denoiser.h"

namespace gobo::denoise {

/// A picture and its variance as planes with a margin at the left and right that repeats the border.
struct GuidePlanes {
  int width = 0, height = 0, margin = 0;
  const float* value[3] = {};  ///< pixel (x, y) at y * stride() + margin + x
  const float* variance[3] = {};
  int stride() const { return width + 2 * margin; }
};

struct PatchSettings {
  int patch = 3;        ///< half width
  float damping = 0.5;  ///< k
};

struct PixelRange {
  int x0 = 0, y0 = 0, x1 = 0, y1 = 0;  ///< ends not included
  int width() const { return x1 - x0; }
  int height() const { return y1 - y0; }
};

/// w[(y - y0) * width + x - x0] = weight of the pixel at (x + dx, y + dy) for (x, y) of the range by the guide; unspecified where that lies outside.
/// margin >= |dx| + patch. `scratch` grows as needed.
void patchWeights(const GuidePlanes& g, const PatchSettings& s, int dx, int dy, const PixelRange& range, float* w, std::vector<float>& scratch);

/// The halves of a picture as guides, b only where there are halves: each with its own variance. `values`: of guideFloats() floats, which they look at.
size_t guideFloats(const NoisyPicture& p, int margin);
bool makeGuides(const NoisyPicture& p, int margin, float* values, GuidePlanes (&guides)[2], const TaskArena& arena, const StopToken& stop);

}  // namespace gobo::denoise
