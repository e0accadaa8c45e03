// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/unfolded_links.h"

#include <cmath>

namespace gobo {
inline namespace filters {

namespace {

constexpr double kCreaseSine = 0.2;  // of the angle from which on a bend counts as a crease: what is shorter straight through a smaller one is half a percent

/// Calls visit(sample, x, y) for all, rows in parallel; false when stopped.
template <class F>
bool overSamples(const ContourInput& in, const TaskArena& arena, const StopToken& stop, F&& visit) {
  return arena.parallelFor(
      size_t(in.height), 8,
      [&](size_t begin, size_t end) {
        for (size_t y = begin; y < end; ++y)
          for (int x = 0; x < in.width; ++x) visit(y * size_t(in.width) + size_t(x), x, int(y));
      },
      stop);
}

}  // namespace

bool onOneStretch(const ContourInput& in, size_t e, size_t f, float cosine) {
  if (!in.valid(e) || !in.valid(f)) return false;
  const Vec3 step = in.at(in.P, f) - in.at(in.P, e);
  const float width = std::max(in.footprint[e], in.footprint[f]);
  const float beyond = glm::dot(step, in.at(in.Ng, e)), before = -glm::dot(step, in.at(in.Ng, f));
  const bool plane = std::abs(beyond) <= width && std::abs(before) <= width;
  if (plane && glm::dot(in.at(in.N, e), in.at(in.N, f)) >= cosine) return true;
  const float reach = kCreaseReach * width;
  return (plane || (beyond > 0) == (before > 0)) && glm::dot(step, step) <= reach * reach;
}

double surfaceStep(const ContourInput& in, size_t e, size_t f) {
  const DVec3 step = DVec3(in.at(in.P, f)) - DVec3(in.at(in.P, e)), ne(in.at(in.Ng, e)), nf(in.at(in.Ng, f)), crease = glm::cross(ne, nf);
  const double sine2 = glm::dot(crease, crease);
  if (sine2 < kCreaseSine * kCreaseSine) return glm::length(step);
  const double across = (std::abs(glm::dot(step, ne)) + std::abs(glm::dot(step, nf))) / std::sqrt(sine2), along = glm::dot(step, crease);
  return std::sqrt(across * across + along * along / sine2);
}

Result<std::vector<uint8_t>> surfaceLinks(const ContourInput& in, float cosine, const TaskArena& arena, const StopToken& stop) {
  std::vector<uint8_t> sides(size_t(in.width) * size_t(in.height)), links(sides.size());
  const auto at = [&](int x, int y) { return size_t(y) * size_t(in.width) + size_t(x); };
  const auto inside = [&](int x, int y) { return x >= 0 && y >= 0 && x < in.width && y < in.height; };
  const bool sided = overSamples(in, arena, stop, [&](size_t e, int x, int y) {
    for (size_t k = 0; k < 8; k += 2) {
      const int u = x + kAround[k].x, v = y + kAround[k].y;
      if (inside(u, v) && onOneStretch(in, e, at(u, v), cosine)) sides[e] |= uint8_t(1u << k);
    }
  });
  const bool linked = sided && overSamples(in, arena, stop, [&](size_t e, int x, int y) {
                        links[e] = sides[e];
                        for (size_t k = 1; k < 8; k += 2) {
                          const int u = x + kAround[k].x, v = y + kAround[k].y;
                          if (!inside(u, v)) continue;
                          const size_t f = at(u, v), before = k - 1, after = (k + 1) % 8;
                          // Side `before` of e, then `after` of what is there; or the other way round.
                          const auto by = [&](size_t first, size_t second) {
                            const size_t m = at(x + kAround[first].x, y + kAround[first].y);
                            return (sides[e] >> first & 1) && (sides[m] >> second & 1);
                          };
                          if ((by(before, after) || by(after, before)) && onOneStretch(in, e, f, cosine)) links[e] |= uint8_t(1u << k);
                        }
                      });
  if (!linked) return Status(Code::Cancelled, "surface links: stopped");
  return links;
}

}  // namespace filters
}  // namespace gobo
