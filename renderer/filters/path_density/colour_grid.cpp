// SPDX-License-Identifier: Apache-2.0
#include "filters/path_density/colour_grid.h"

#include <algorithm>
#include <cmath>

#include "base/check.h"

namespace gobo::pathdensity {

namespace {

constexpr float kUnitsOfColour = 64;  // of h_c
constexpr int kFinestBits = 5;        // of a bin of h_c / 2, in units
constexpr float kMostUnits = 524287;  // 2^19 - 1: squares of three, 2^23 of them, are less than 2^63
constexpr uint32_t kMostOfCell = 1 << 23;

}  // namespace

GridColour gridColourOf(float l, float a, float b) {
  const auto units = [](float v) { return int32_t(std::lround(std::clamp(v * kUnitsOfColour, -kMostUnits, kMostUnits))); };
  return {units(l), units(a), units(b)};
}

ColourGrid::ColourGrid(int width, int height, int cell, int bins)
    : width_(width), height_(height), cell_(cell), cellsX_((width + cell - 1) / cell), cellsY_((height + cell - 1) / cell), most_(bins) {
  GOBO_CHECK(bins >= kFewestBins && bins < 65536 && cell >= 1);
  const size_t cells = size_t(cellsX_) * size_t(cellsY_);
  bins_.resize(cells * size_t(bins));
  used_.assign(cells, 0);
  level_.assign(cells, 0);
  held_.assign(cells, 0);
}

size_t ColourGrid::bytes() const {
  return bins_.capacity() * sizeof(Bin) + used_.capacity() * sizeof(uint16_t) + level_.capacity() + held_.capacity() * sizeof(uint32_t);
}

GridColour ColourGrid::keyOf(const GridColour& c, size_t cell) const {
  const int bits = kFinestBits + level_[cell];
  return {c[0] >> bits, c[1] >> bits, c[2] >> bits};
}

double ColourGrid::binWidth(int x, int y) const { return std::ldexp(1.0, kFinestBits + level_[cellAt(x, y)]) / double(kUnitsOfColour); }

/// Bins twice as wide.
void ColourGrid::coarsen(size_t cell) {
  Bin* const bins = &bins_[cell * size_t(most_)];
  ++level_[cell];
  int kept = 0;
  for (int i = 0; i < used_[cell]; ++i) {
    Bin from = bins[i];
    for (int32_t& k : from.key) k >>= 1;
    Bin* const same = std::find_if(bins, bins + kept, [&](const Bin& b) { return b.key == from.key; });
    if (same == bins + kept) {
      bins[kept++] = from;
      continue;
    }
    same->count += from.count;
    for (size_t c = 0; c < 3; ++c) same->sum[c] += from.sum[c];
    same->squares += from.squares;
  }
  used_[cell] = uint16_t(kept);
}

bool ColourGrid::add(int x, int y, const GridColour& colour) {
  const size_t cell = cellAt(x, y);
  if (held_[cell] >= kMostOfCell) return false;  // by the cell: bins are merged
  Bin* const bins = &bins_[cell * size_t(most_)];
  for (;; coarsen(cell)) {
    const GridColour key = keyOf(colour, cell);
    Bin* const end = bins + used_[cell];
    Bin* const bin = std::find_if(bins, end, [&](const Bin& b) { return b.key == key; });
    if (bin == end && used_[cell] == most_) continue;
    if (bin == end) {
      *bin = {key, 0, {}, 0};
      ++used_[cell];
    }
    ++held_[cell];
    ++bin->count;
    for (size_t c = 0; c < 3; ++c) {
      bin->sum[c] += colour[c];
      bin->squares += int64_t(colour[c]) * colour[c];
    }
    return true;
  }
}

void ColourGrid::settle(const TaskArena& arena) {
  arena.parallelFor(used_.size(), 1 << 10, [&](size_t begin, size_t end) {
    for (size_t cell = begin; cell < end; ++cell) {
      Bin* const bins = &bins_[cell * size_t(most_)];
      std::sort(bins, bins + used_[cell], [](const Bin& a, const Bin& b) { return a.key < b.key; });
    }
  });
}

/// The bins of a cell, by distance from a sample; without the sample itself where the cell is its `own`.
void ColourGrid::gather(int cx, int cy, float x, float y, const GridColour& colour, bool own, float perPixel, Scratch& s) const {
  const size_t cell = size_t(cy) * size_t(cellsX_) + size_t(cx);
  const Bin* const bins = &bins_[cell * size_t(most_)];
  if (used_[cell] == 0) return;
  const double side = double(cell_), dx = double(x) - (cx + 0.5) * side, dy = double(y) - (cy + 0.5) * side;
  // The mean distance to what varies by v along each axis is about d + v / 2d in the plane, d + 2 v / 2d in space: by what lies across. Of a square v is
  // side^2 / 12.
  const double film = std::sqrt(dx * dx + dy * dy + side * side / 12) * double(perPixel);
  const GridColour key = own ? keyOf(colour, cell) : GridColour{};
  for (int i = 0; i < used_[cell]; ++i) {
    const Bin& b = bins[i];
    const bool self = own && b.key == key;
    const int64_t count = int64_t(b.count) - (self ? 1 : 0);
    if (count <= 0) continue;
    const double per = 1.0 / double(count);
    double squares = double(b.squares), fromMean = 0, mean2 = 0;
    for (size_t c = 0; c < 3; ++c) {
      const double at = double(colour[c]), sum = double(b.sum[c] - (self ? colour[c] : 0)), mean = sum * per;
      if (self) squares -= at * at;
      fromMean += (at - mean) * (at - mean);
      mean2 += mean * mean;
    }
    const double spread = std::max(0.0, squares * per - mean2);
    s.found.emplace_back(float(film + std::sqrt(fromMean + 2.0 / 3.0 * spread) / double(kUnitsOfColour)), uint32_t(count));
  }
}

float ColourGrid::meanDistance(float x, float y, const GridColour& colour, int k, float filmScale, const OutcomeBounds& bounds, Scratch& s) const {
  const int px = std::clamp(int(x), 0, width_ - 1), py = std::clamp(int(y), 0, height_ - 1), cx = px / cell_, cy = py / cell_;
  const float perPixel = 1.0f / filmScale;
  s.found.clear();
  for (int ring = 0;; ++ring) {
    for (int v = std::max(cy - ring, 0); v <= std::min(cy + ring, cellsY_ - 1); ++v) {
      const bool edge = v == cy - ring || v == cy + ring;
      for (int u = cx - ring; u <= cx + ring; u += edge || ring == 0 ? 1 : 2 * ring)
        if (u >= 0 && u < cellsX_) gather(u, v, x, y, colour, u == cx && v == cy, perPixel, s);
    }
    // Nothing outside of the rings up to here is nearer on the film than `unseen`.
    const bool all = cx - ring <= 0 && cy - ring <= 0 && cx + ring >= cellsX_ - 1 && cy + ring >= cellsY_ - 1;
    float unseen = std::numeric_limits<float>::infinity();
    if (cx - ring > 0) unseen = std::min(unseen, x - float((cx - ring) * cell_));
    if (cy - ring > 0) unseen = std::min(unseen, y - float((cy - ring) * cell_));
    if (cx + ring < cellsX_ - 1) unseen = std::min(unseen, float((cx + ring + 1) * cell_) - x);
    if (cy + ring < cellsY_ - 1) unseen = std::min(unseen, float((cy + ring + 1) * cell_) - y);
    unseen = std::max(unseen, 0.0f) * perPixel;
    double near = 0, sum = 0, accepted = 0;
    for (const auto& [distance, count] : s.found) {
      if (distance < unseen) near += count, sum += double(distance) * count;
      if (distance <= bounds.accept) accepted += count;
    }
    if (accepted >= k) return bounds.accept;
    if (near < k && !all) {
      const double least = (sum + (k - near) * double(unseen)) / k;
      if (least >= double(bounds.reject) * (1 + 1e-6)) return float(least);
      continue;
    }
    std::sort(s.found.begin(), s.found.end());
    double left = k, total = 0;
    for (const auto& [distance, count] : s.found) {
      const double take = std::min(left, double(count));
      total += take * double(distance);
      left -= take;
      if (left <= 0) break;
    }
    return left < k ? float(total / (k - left)) : 0.0f;
  }
}

}  // namespace gobo::pathdensity
