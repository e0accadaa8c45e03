// SPDX-License-Identifier: Apache-2.0
#include "filters/automatic/probe_pixels.h"

#include <algorithm>
#include <cmath>

#include "base/check.h"
#include "base/sobol.h"

namespace gobo {
inline namespace filters {
namespace {

constexpr int kLeastCut = 4;  // pixels across a cell that is cut

/// Pixels x0 .. x1 - 1, y0 .. y1 - 1, which stand for `weight` times as many of their kind.
struct ProbeCell {
  int x0 = 0, y0 = 0, x1 = 0, y1 = 0;
  double weight = 1;
  double area() const { return double(x1 - x0) * double(y1 - y0); }
  bool divisible() const { return std::min(x1 - x0, y1 - y0) >= kLeastCut; }
};
using ProbeCells = std::vector<ProbeCell>;

PixelPlace pixelOf(const ProbeCell& c, uint64_t seed, uint64_t draw) {
  const uint64_t h = hash64(seed, draw);
  return {c.x0 + int((h >> 32) % uint64_t(c.x1 - c.x0)), c.y0 + int((h & 0xffffffffu) % uint64_t(c.y1 - c.y0))};
}

/// Place i of `count` evenly spread ones among `among`, from a random start: each of them has count / among of them in the mean.
size_t evenly(int i, int count, size_t among, uint64_t seed) {
  const double start = double(hash64(seed, 0x57a7) >> 11) * 0x1p-53;
  return std::min(size_t((double(i) + start) * double(among) / double(count)), among - 1);
}

ProbeCells gridOf(const ProbeDesign& d, int& across, int& down) {
  const double wanted = std::max(1.0, std::min(double(d.cells), double(d.width) * d.height / 4.0));
  across = std::clamp(int(std::lround(std::sqrt(wanted * d.width / d.height))), 1, d.width);
  down = std::clamp(int(std::lround(wanted / across)), 1, d.height);
  ProbeCells cells;
  cells.reserve(size_t(across) * size_t(down));
  for (int j = 0; j < down; ++j)
    for (int i = 0; i < across; ++i)
      cells.push_back({int(int64_t(i) * d.width / across), int(int64_t(j) * d.height / down), int(int64_t(i + 1) * d.width / across),
                       int(int64_t(j + 1) * d.height / down), 1.0});
  return cells;
}

std::vector<char> edgesOfGrid(const std::vector<ProbeSeen>& seen, int across, int down) {
  std::vector<char> edge(seen.size(), 0);
  for (int j = 0; j < down; ++j)
    for (int i = 0; i < across; ++i) {
      const size_t c = size_t(j) * size_t(across) + size_t(i);
      if (seen[c] == ProbeSeen::Both) edge[c] = 1;
      for (int dj = -1; dj <= 1; ++dj)
        for (int di = -1; di <= 1; ++di) {
          const int x = i + di, y = j + dj;
          if (x >= 0 && x < across && y >= 0 && y < down && seen[size_t(y) * size_t(across) + size_t(x)] != seen[c]) edge[c] = 1;
        }
    }
  return edge;
}

std::vector<char> edgesOfQuarters(const std::vector<ProbeSeen>& seen) {
  std::vector<char> edge(seen.size(), 0);
  for (size_t c = 0; c < seen.size(); ++c) {
    edge[c] = seen[c] == ProbeSeen::Both;
    for (size_t k = c / 4 * 4; k < c / 4 * 4 + 4; ++k) edge[c] |= seen[k] != seen[c];
  }
  return edge;
}

void sortCells(const ProbeCells& cells, const std::vector<char>& edge, ProbeCells& withEdge, ProbeCells& even) {
  withEdge.clear();
  even.clear();
  for (size_t c = 0; c < cells.size(); ++c) (edge[c] ? withEdge : even).push_back(cells[c]);
}

bool lookAt(const ProbeCells& cells, uint64_t seed, const ProbeLook& look, std::vector<ProbeSeen>& seen) {
  std::vector<PixelPlace> places(cells.size());
  for (size_t c = 0; c < cells.size(); ++c) places[c] = pixelOf(cells[c], seed, c);
  seen.assign(cells.size(), ProbeSeen::Nothing);
  return look(places, seen);
}

/// Some of the cells in four pieces each.
ProbeCells quarters(const ProbeCells& cells, int most, uint64_t seed) {
  const int count = std::min(int(cells.size()), most);
  ProbeCells out;
  out.reserve(size_t(count) * 4);
  for (int i = 0; i < count; ++i) {
    ProbeCell c = cells[evenly(i, count, cells.size(), seed)];
    c.weight *= double(cells.size()) / count;
    const int x = (c.x0 + c.x1) / 2, y = (c.y0 + c.y1) / 2;
    out.push_back({c.x0, c.y0, x, y, c.weight});
    out.push_back({x, c.y0, c.x1, y, c.weight});
    out.push_back({c.x0, y, x, c.y1, c.weight});
    out.push_back({x, y, c.x1, c.y1, c.weight});
  }
  return out;
}

}  // namespace

Result<ProbePixels> chooseProbePixels(const ProbeDesign& d, const ProbeLook& look) {
  GOBO_CHECK(d.width > 0 && d.height > 0 && d.judged >= 2 * (d.levels + 2));
  const auto stopped = [] { return Status(Code::Cancelled, "shadow_probe stopped"); };
  const double pixels = double(d.width) * double(d.height);
  ProbePixels out;
  int across = 0, down = 0;
  ProbeCells cells = gridOf(d, across, down);
  std::vector<ProbeSeen> seen;
  if (!lookAt(cells, hash64(d.seed, 0), look, seen)) return stopped();
  for (size_t c = 0; c < cells.size(); ++c)
    if (seen[c] != ProbeSeen::Nothing) out.receivers += cells[c].area() / pixels;
  std::vector<ProbeCells> strata(2);
  sortCells(cells, edgesOfGrid(seen, across, down), strata[0], strata[1]);
  for (const ProbeCell& c : strata[0]) out.edges += c.area() / pixels;
  for (int level = 1; level <= d.levels; ++level) {
    if (strata[0].empty() || !std::all_of(strata[0].begin(), strata[0].end(), [](const ProbeCell& c) { return c.divisible(); })) break;
    cells = quarters(strata[0], d.split, hash64(d.seed, 100 + uint64_t(level)));
    if (!lookAt(cells, hash64(d.seed, uint64_t(level)), look, seen)) return stopped();
    strata.emplace_back();
    sortCells(cells, edgesOfQuarters(seen), strata[0], strata.back());
  }
  std::erase_if(strata, [](const ProbeCells& s) { return s.empty(); });
  // Half for the first stratum, that of edges, if there is one with others; the rest for the others in equal parts.
  const int kinds = int(strata.size());
  int left = d.judged;
  for (int s = 0; s < kinds; ++s) {
    const int count = s == kinds - 1 ? left : s == 0 ? std::min(d.judged / 2, d.judged - 2 * (kinds - 1)) : left / (kinds - s);
    left -= count;
    const uint64_t seed = hash64(d.seed, 200 + uint64_t(s));
    for (int i = 0; i < count; ++i) {
      const ProbeCell& c = strata[size_t(s)][evenly(i, count, strata[size_t(s)].size(), seed)];
      out.judged.push_back({pixelOf(c, seed, uint64_t(i)), uint32_t(s), c.weight * double(strata[size_t(s)].size()) / count * c.area() / pixels});
    }
  }
  return out;
}

double StratifiedSum::partVariance() const { return count_ > 1 ? count_ / (count_ - 1) * squares_ : part_ * part_; }

void StratifiedSum::add(const ProbePixel& pixel, double value) {
  if (pixel.stratum != stratum_) {
    sum_ += part_;
    variance_ += partVariance();
    part_ = mean_ = squares_ = count_ = 0;
    stratum_ = pixel.stratum;
  }
  const double z = pixel.weight * value, before = z - mean_;
  part_ += z;
  count_ += 1;
  mean_ += before / count_;
  squares_ += before * (z - mean_);
}

}  // namespace filters
}  // namespace gobo
