// SPDX-License-Identifier: Apache-2.0
#include "filters/path_density/neighbour_search.h"

#include <algorithm>

namespace gobo::pathdensity {

namespace {

constexpr float kUnseenNever = std::numeric_limits<float>::infinity();

/// Rings that are looked at one by one; further out a quarter of the radius at a time, since every look goes over all distances.
int nextRing(int ring) { return ring + std::max(1, ring / 4); }

}  // namespace

NeighbourSearch::NeighbourSearch(const SampleBins& bins, const MetricPoints& points, float filmScale)
    : bins_(bins), points_(points), perPixel_(1.0f / filmScale) {
  // Rings that hold k samples where they are spread evenly: fewer are not worth a look.
  const double ofCell = double(points.size()) / std::max(1.0, double(bins.cellsX) * double(bins.cellsY));
  for (int ring = 0; firstRings_.size() < 257 && ring < 9; ++ring) {
    const size_t holds = size_t(ofCell * (2 * ring + 1) * (2 * ring + 1));
    while (firstRings_.size() <= std::min(holds, size_t(256))) firstRings_.push_back(uint8_t(ring));
  }
}

/// Runs of samples at a Chebyshev distance of `ring` cells.
template <class Visit>
void NeighbourSearch::visitRing(int cx, int cy, int ring, Visit&& visit) const {
  const int x0 = std::max(cx - ring, 0), x1 = std::min(cx + ring, bins_.cellsX - 1);
  const auto run = [&](int from, int to, int y) {
    const size_t begin = bins_.cellsBegin(from, y), end = bins_.cellsEnd(to, y);
    if (begin < end) visit(begin, end);
  };
  for (int y = std::max(cy - ring, 0); y <= std::min(cy + ring, bins_.cellsY - 1); ++y) {
    if (y == cy - ring || y == cy + ring) {
      run(x0, x1, y);
      continue;
    }
    if (cx - ring >= 0) run(cx - ring, cx - ring, y);
    if (ring > 0 && cx + ring < bins_.cellsX) run(cx + ring, cx + ring, y);
  }
}

/// Nothing outside of the rings up to `ring` is nearer. (Rounding keeps the order: an edge is at most as far as what lies behind it.)
float NeighbourSearch::unseen(const MetricPoint& q, int cx, int cy, int ring) const {
  const auto edge = [&](int cell) { return float(cell * bins_.cell) * perPixel_; };
  float r = kUnseenNever;
  if (cx - ring > 0) r = std::min(r, q.x - edge(cx - ring));
  if (cy - ring > 0) r = std::min(r, q.y - edge(cy - ring));
  if (cx + ring < bins_.cellsX - 1) r = std::min(r, edge(cx + ring + 1) - q.x);
  if (cy + ring < bins_.cellsY - 1) r = std::min(r, edge(cy + ring + 1) - q.y);
  return std::max(r, 0.0f);
}

float NeighbourSearch::meanDistance(size_t i, int k, const OutcomeBounds& bounds, Scratch& s) const {
  const MetricPoint q = pointAt(points_, i);
  const float perCell = 1.0f / (float(bins_.cell) * perPixel_);
  const int cx = std::clamp(int(q.x * perCell), 0, bins_.cellsX - 1), cy = std::clamp(int(q.y * perCell), 0, bins_.cellsY - 1);
  const size_t wanted = std::min(size_t(k), points_.size() - 1);
  if (wanted == 0) return 0.0f;
  size_t known = 0, accepted = 0;
  for (int ring = 0, upTo = firstRings_[std::min(wanted, firstRings_.size() - 1)];; upTo = nextRing(upTo)) {
    for (; ring <= upTo && accepted < wanted; ++ring)
      visitRing(cx, cy, ring, [&](size_t begin, size_t end) {
        if (s.distances.size() < known + (end - begin)) s.distances.resize(2 * (known + (end - begin)));
        distancesTo(q, points_, begin, end - begin, s.distances.data() + known);
        if (i >= begin && i < end) s.distances[known + (i - begin)] = kUnseenNever;  // itself
        if (bounds.accept >= 0) accepted += countNearer(s.distances.data() + known, end - begin, bounds.accept);
        known += end - begin;
      });
    if (accepted >= wanted) return bounds.accept;
    const float r = unseen(q, cx, cy, upTo);
    const Nearer nearer = nearerThan(s.distances.data(), known, r);
    if (nearer.count >= wanted) {
      if (s.nearer.size() < known) s.nearer.resize(2 * known);
      const size_t kept = keepNearer(s.distances.data(), known, r, s.nearer.data());
      std::nth_element(s.nearer.begin(), s.nearer.begin() + ptrdiff_t(wanted) - 1, s.nearer.begin() + ptrdiff_t(kept));
      double sum = 0;
      for (size_t j = 0; j < wanted; ++j) sum += double(s.nearer[j]);
      return float(sum / double(wanted));
    }
    const double least = (nearer.sum + double(wanted - nearer.count) * double(r)) / double(wanted);
    if (least >= double(bounds.reject) * (1 + 1e-6)) return float(least);  // beyond what the sum may err by
  }
}

void NeighbourSearch::nearest(size_t i, int k, std::vector<Neighbour>& out, Scratch& s) const {
  const MetricPoint q = pointAt(points_, i);
  const float perCell = 1.0f / (float(bins_.cell) * perPixel_);
  const int cx = std::clamp(int(q.x * perCell), 0, bins_.cellsX - 1), cy = std::clamp(int(q.y * perCell), 0, bins_.cellsY - 1);
  out.clear();
  for (int ring = 0, upTo = 0;; upTo = nextRing(upTo)) {
    for (; ring <= upTo; ++ring)
      visitRing(cx, cy, ring, [&](size_t begin, size_t end) {
        if (s.distances.size() < end - begin) s.distances.resize(end - begin);
        distancesTo(q, points_, begin, end - begin, s.distances.data());
        for (size_t j = begin; j < end; ++j)
          if (j != i) out.push_back({s.distances[j - begin], uint32_t(j)});
      });
    const float r = unseen(q, cx, cy, upTo);
    const auto nearer = std::count_if(out.begin(), out.end(), [r](const Neighbour& n) { return n.distance < r; });
    if (nearer < k && r < kUnseenNever) continue;
    const auto end = out.begin() + std::min(ptrdiff_t(k), ptrdiff_t(out.size()));
    std::partial_sort(out.begin(), end, out.end());
    out.erase(end, out.end());
    return;
  }
}

}  // namespace gobo::pathdensity
