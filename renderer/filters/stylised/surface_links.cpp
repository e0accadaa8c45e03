// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/surface_links.h"

namespace gobo {
inline namespace filters {

Result<SurfaceLinks> SurfaceLinks::of(const ContourInput& in, float cosine, const TaskArena& arena, const StopToken& stop) {
  SurfaceLinks links;
  links.width_ = in.width;
  links.height_ = in.height;
  links.bits_.resize(in.instance.size());
  const bool complete = arena.parallelFor(
      size_t(in.height), 8,
      [&](size_t begin, size_t end) {
        for (size_t y = begin; y < end; ++y)
          for (int x = 0; x < in.width; ++x) {
            const size_t e = y * size_t(in.width) + size_t(x);
            uint8_t bits = 0;
            for (int k = 0; k < 8 && in.valid(e); ++k) {
              const int u = x + kAround[k].x, v = int(y) + kAround[k].y;
              if (u >= 0 && v >= 0 && u < in.width && v < in.height && onOneSurface(in, e, links.neighbour(e, k), cosine)) bits |= uint8_t(1 << k);
            }
            links.bits_[e] = bits;
          }
      },
      stop);
  if (!complete) return Status(Code::Cancelled, "surface links: stopped");
  return links;
}

}  // namespace filters
}  // namespace gobo
