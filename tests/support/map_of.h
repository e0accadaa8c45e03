// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "scene/environment.h"

namespace gobo::tests {

/// An environment map of what texel(x, y) gives.
template <class Texel>
EnvironmentPtr mapOf(int width, int height, const Texel& texel) {
  Image image(width, height, 3);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const Vec3 c = texel(x, y);
      for (size_t k = 0; k < 3; ++k) image.data[3 * size_t(y * width + x) + k] = c[int(k)];
    }
  return makeEnvironment("map", std::move(image));
}

}  // namespace gobo::tests
