// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/skeleton.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <queue>

namespace gobo {
inline namespace filters {

namespace {

constexpr float kMostCosine = -0.5f;   // of anchors: 120 degrees
constexpr float kLeastAnchor = 0.75f;  // widths of a pixel
constexpr float kAsDeep = 1e-3f;       // relative difference of r within which both of two samples are the middle
constexpr size_t kPopsBetweenStops = 4096;

/// Yokoi's number of connections for shadow by eight: that of parts of light by four around it which touch it by a side.
constexpr int connections(uint8_t shadowed) {
  int n = 0;
  const auto light = [&](int k) { return (shadowed >> (k & 7) & 1) == 0 ? 1 : 0; };
  for (int k = 0; k < 8; k += 2) n += light(k) - light(k) * light(k + 1) * light(k + 2);
  return n;
}
constexpr std::array<bool, 256> kSimplePoints = [] {
  std::array<bool, 256> simple{};
  for (int b = 0; b < 256; ++b) simple[size_t(b)] = b != 0 && connections(uint8_t(b)) == 1;
  return simple;
}();

/// The nearest place of the contour for each shadowed sample.
struct NearestContour {
  const ContourInput& in;
  std::span<const float> D;
  std::vector<Vec3> place;
  std::vector<float> square;  ///< of the distance; infinite: none

  NearestContour(const ContourInput& i, std::span<const float> d)
      : in(i), D(d), place(d.size(), Vec3(0.0f)), square(d.size(), std::numeric_limits<float>::infinity()) {}

  bool closer(size_t e, const Vec3& at) {
    const Vec3 step = at - in.at(in.P, e);
    const float d2 = glm::dot(step, step);
    if (!(d2 < square[e])) return false;
    square[e] = d2, place[e] = at;
    return true;
  }
  void begin(const SurfaceLinks& links, size_t e) {
    for (int k = 0; k < 8; k += 2) {
      if (!links.has(e, k)) continue;
      const size_t f = links.neighbour(e, k);
      if (D[f] < 0.0f) continue;
      const Vec3 P = in.at(in.P, e);
      closer(e, P + (D[e] / (D[e] - D[f])) * (in.at(in.P, f) - P));
    }
  }
  bool known(size_t e) const { return square[e] < std::numeric_limits<float>::infinity(); }
};

void findAnchors(const NearestContour& nearest, const SurfaceLinks& links, std::span<const float> r, std::vector<uint8_t>& anchor) {
  const ContourInput& in = nearest.in;
  for (size_t e = 0; e < links.size(); ++e) {
    if (!(r[e] > 0.0f)) continue;
    for (const int k : {kRight, kBelow}) {
      if (!links.has(e, k)) continue;
      const size_t f = links.neighbour(e, k);
      if (!(r[f] > 0.0f) || std::min(r[e], r[f]) < kLeastAnchor * std::min(in.footprint[e], in.footprint[f])) continue;
      const Vec3 middle = 0.5f * (in.at(in.P, e) + in.at(in.P, f)), a = nearest.place[e] - middle, b = nearest.place[f] - middle;
      if (glm::dot(a, b) > kMostCosine * glm::length(a) * glm::length(b)) continue;
      if (r[e] >= (1.0f - kAsDeep) * r[f]) anchor[e] = 1;
      if (r[f] >= (1.0f - kAsDeep) * r[e]) anchor[f] = 1;
    }
  }
}

/// Takes samples away, shallow ones first; r of what goes becomes 0.
bool thinHomotopically(const SurfaceLinks& links, const std::vector<uint8_t>& anchor, std::span<float> r, const StopToken& stop) {
  const std::vector<float> depth(r.begin(), r.end());
  const auto shadowed = [&](size_t e) {
    uint8_t bits = 0;
    for (int k = 0; k < 8; ++k)
      if (links.has(e, k) && r[links.neighbour(e, k)] > 0.0f) bits |= uint8_t(1 << k);
    return bits;
  };
  using Entry = std::pair<float, uint32_t>;
  std::priority_queue<Entry, std::vector<Entry>, std::greater<>> queue;
  std::vector<uint8_t> queued(r.size(), 0);
  const auto add = [&](size_t e) {
    if (queued[e] || anchor[e] || !(r[e] > 0.0f)) return;
    queued[e] = 1;
    queue.emplace(depth[e], uint32_t(e));
  };
  for (size_t e = 0; e < r.size(); ++e)
    if (r[e] > 0.0f && (shadowed(e) & 0x55) != 0x55) add(e);
  for (size_t pops = 1; !queue.empty(); ++pops) {
    if (pops % kPopsBetweenStops == 0 && stop.stopRequested()) return false;
    const size_t e = queue.top().second;
    queue.pop();
    queued[e] = 0;
    const uint8_t around = shadowed(e);
    if (!kSimplePoints[around]) continue;
    r[e] = 0.0f;
    for (int k = 0; k < 8; ++k)
      if (around >> k & 1) add(links.neighbour(e, k));
  }
  return true;
}

}  // namespace

bool isSimplePoint(uint8_t shadowed) { return kSimplePoints[shadowed]; }

Status shadowSkeleton(const ContourInput& in, const SurfaceLinks& links, std::span<const float> D, std::span<float> r, const StopToken& stop) {
  const Status stopped(Code::Cancelled, "skeleton: stopped");
  NearestContour nearest(in, D);
  for (size_t e = 0; e < D.size(); ++e)
    if (D[e] < 0.0f && in.valid(e)) nearest.begin(links, e);
  const auto take = [&](size_t e, size_t f) { return D[e] < 0.0f && D[f] < 0.0f && nearest.known(f) && nearest.closer(e, nearest.place[f]); };
  if (!sweepLinks(links, stop, take)) return stopped;
  for (size_t e = 0; e < D.size(); ++e) r[e] = nearest.known(e) ? std::sqrt(nearest.square[e]) : 0.0f;
  std::vector<uint8_t> anchor(D.size(), 0);
  findAnchors(nearest, links, r, anchor);
  return thinHomotopically(links, anchor, r, stop) ? Status() : stopped;
}

}  // namespace filters
}  // namespace gobo
