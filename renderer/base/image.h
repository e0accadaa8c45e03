// SPDX-License-Identifier: Apache-2.0
// Image: a named-channel float picture on the host, the value that image files and metrics deal in.
// Row-major, pixel (0,0) top left, channels interleaved, linear values. A plain value; no thread-safety of its own.
#pragma once

#include <string>
#include <vector>

#include "base/vec.h"

namespace gobo {
inline namespace base {

struct Image {
  int width = 0, height = 0, channels = 0;
  std::vector<std::string> names;  ///< one per channel, e.g. {"R","G","B"}; may be empty (then R,G,B,A by position)
  std::vector<float> data;         ///< width * height * channels

  Image() = default;
  Image(int w, int h, int c) : width(w), height(h), channels(c), data(size_t(w) * h * c, 0.0f) {}
  size_t pixels() const { return size_t(width) * height; }
  float* at(int x, int y) { return data.data() + (size_t(y) * width + x) * channels; }
  const float* at(int x, int y) const { return data.data() + (size_t(y) * width + x) * channels; }
  Vec3 rgb(int x, int y) const {
    const float* p = at(x, y);
    return channels >= 3 ? Vec3(p[0], p[1], p[2]) : Vec3(p[0]);
  }
};

}  // namespace base
}  // namespace gobo
