// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/abstraction_cells.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>

#include "filters/stylised/abstraction_kernels.h"
#include "filters/stylised/averaged_distance.h"
#include "terms/scratch.h"

namespace gobo {
inline namespace filters {

namespace {

constexpr float kCellsJoined = 0.995f, kCellsTurn = 0.9976f;  // least cosines between normals of neighbours: 5.7 and 4 degrees
constexpr float kLongestCell = 0.68f;                         // side of a cell, sigmas
constexpr float kWidestCell = 0.56f;                          // root of its area: a level's cells are twice as wide as those of the one before
constexpr float kNarrowestCell = 0.34f;                       // the same by the samples of a side: sums over narrower ones cost what those over samples do
constexpr int kLeastCellSide = 2, kMostCellSide = 256, kLeastCells = 4;
constexpr int kCellRun = 128;
constexpr size_t kCellPlanes = 11;  // those of AbstractionPlanes, the least width of a pixel and what the Gaussian gives

/// Cells of `side` x `side` samples. A last column or row that is not full is there, for sums.
struct CellLevel {
  int side = 0, width = 0, height = 0;
  Scratch<float> planes;
  std::unique_ptr<uint8_t[]> whole, usable, wanted;

  CellLevel(int s, int w, int h) : side(s), width(w), height(h) {
    planes = Scratch<float>(kCellPlanes * count());
    std::fill_n(blurred(), count(), 0.0f);  // rows are interpolated as a whole
    whole = std::make_unique_for_overwrite<uint8_t[]>(count());
    usable = std::make_unique<uint8_t[]>(count());
    wanted = std::make_unique<uint8_t[]>(count());
  }
  size_t count() const { return size_t(width) * size_t(height); }
  float* plane(size_t k) const { return planes.get() + k * count(); }
  float* footprint() const { return plane(9); }
  float* blurred() const { return plane(10); }
  SurfaceRow rowAt(size_t e) const {
    const auto at = [&](size_t k) { return plane(k) + e; };
    return {at(0), at(1), at(2), at(3), at(4), at(5), nullptr, nullptr, nullptr, footprint() + e, at(6), at(7), nullptr};
  }
  AbstractionPlanes view() const { return {plane(0), plane(1), plane(2), plane(3), plane(4), plane(5), plane(6), plane(7), plane(8)}; }
  Vec3 at(size_t e) const { return Vec3(plane(0)[e], plane(1)[e], plane(2)[e]); }
  Vec3 normal(size_t e) const { return Vec3(plane(3)[e], plane(4)[e], plane(5)[e]); }
};

/// Means by area of the parts of a cell.
struct CellSum {
  Vec3 P{0.0f}, N{0.0f};
  float area = 0, d = 0, footprint = HUGE_VALF;
  void add(const Vec3& at, const Vec3& normal, float a, float distance, float width) {
    P += a * at, N += a * normal, d += a * distance, area += a;
    footprint = std::min(footprint, width);
  }
  void store(const CellLevel& level, size_t e, bool whole) const {
    const float inverse = area > 0.0f ? 1.0f / area : 0.0f, n = glm::length(N), unit = n > 0.0f ? 1.0f / n : 0.0f;
    const float value[9] = {P.x * inverse, P.y * inverse, P.z * inverse, N.x * unit, N.y * unit, N.z * unit, std::min(area, kMostAbstractionArea),
                            d * inverse,   1.0f};
    for (size_t k = 0; k < 9; ++k) level.plane(k)[e] = value[k];
    level.footprint()[e] = footprint;
    level.whole[e] = whole;
  }
};

/// Of the samples of a cell those of one surface: that which has most.
void addMostOf(const AbstractionInput& a, int x0, int y0, CellSum& sum) {
  struct Part {
    int x, y;
    size_t e;
  };
  std::array<Part, 4> parts{};
  size_t count = 0, best = 0, most = 0;
  for (int y = y0; y < std::min(y0 + 2, a.in.height); ++y)
    for (int x = x0; x < std::min(x0 + 2, a.in.width); ++x)
      if (const size_t e = size_t(y) * size_t(a.in.width) + size_t(x); a.counts(e)) parts[count++] = {x, y, e};
  const auto alike = [&](size_t k, size_t l) { return k == l || onOneSurface(a.in, parts[k].e, parts[l].e, a.cosine); };
  for (size_t k = 0; k < count; ++k) {
    size_t of = 0;
    for (size_t l = 0; l < count; ++l) of += alike(k, l);
    if (of > most) most = of, best = k;
  }
  const float scale = 1.0f / a.sigma;
  for (size_t l = 0; l < count; ++l) {
    if (!alike(best, l)) continue;
    const auto& [x, y, e] = parts[l];
    const float area = std::clamp(a.areaOf(x, y) * scale * scale, kLeastAbstractionArea, kMostAbstractionArea);
    sum.add(a.in.at(a.in.P, e) * scale, a.in.at(a.in.N, e), area, a.d[e], a.in.footprint[e] * scale);
  }
}

/// Three rows of samples, in units of sigma, and which of them are joined to the next and to the one below.
class SurfaceRows {
 public:
  explicit SurfaceRows(const AbstractionInput& a)
      : a_(a), stride_(size_t(a.in.width) + 1), values_(3 * kFloats * stride_), ids_(3 * stride_), joined_(4 * stride_) {}

  /// Samples y and y + 1 become rows 0 and 1. What lies beyond the picture's border goes on as its last two samples do.
  void read(int y) {
    for (int k = 0; k < 3; ++k) readRow(std::min(y + k, a_.in.height - 1), row(k));
    if (y + 2 == a_.in.height) goOn(row(2), row(0), row(1));
    if (y + 1 == a_.in.height && y > 0) readRow(y - 1, row(1)), goOn(row(1), row(1), row(0));
    const float cosine = std::max(a_.cosine, kCellsJoined);
    const size_t n = size_t(a_.in.width);
    for (int k = 0; k < 2; ++k) {
      joinSamples(row(k), row(k), 1, n, cosine, right(k));
      joinSamples(row(k), row(k + 1), 0, n, cosine, below(k));
      areasOfRow(row(k), row(k + 1), n);
    }
  }
  SurfaceRow row(int k) {
    float* f = &values_[size_t(k) * kFloats * stride_];
    const auto at = [&](size_t plane) { return f + plane * stride_; };
    return {at(0), at(1), at(2), at(3), at(4), at(5), at(6), at(7), at(8), at(9), at(10), at(11), &ids_[size_t(k) * stride_]};
  }
  float* right(int k) { return &joined_[size_t(2 * k) * stride_]; }
  float* below(int k) { return &joined_[size_t(2 * k + 1) * stride_]; }

 private:
  static constexpr size_t kFloats = 12;

  void readRow(int y, const SurfaceRow& r) const {
    const size_t n = size_t(a_.in.width), first = size_t(y) * n;
    const float scale = 1.0f / a_.sigma;
    splitVectors(&a_.in.P[3 * first], n, scale, r.x, r.y, r.z);
    splitVectors(&a_.in.N[3 * first], n, 1.0f, r.nx, r.ny, r.nz);
    splitVectors(&a_.in.Ng[3 * first], n, 1.0f, r.gx, r.gy, r.gz);
    for (size_t k = 0; k < n; ++k) {
      r.width[k] = scale * a_.in.footprint[first + k];
      r.d[k] = a_.d[first + k];
      r.id[k] = std::abs(r.d[k]) < kStyleFar ? a_.in.instance[first + k] : ~0u;
    }
    const size_t last = n - 1, before = n > 1 ? n - 2 : 0;
    for (float* p : {r.nx, r.ny, r.nz, r.gx, r.gy, r.gz, r.width, r.d}) p[n] = p[last];
    for (float* p : {r.x, r.y, r.z}) p[n] = 2.0f * p[last] - p[before];
    r.id[n] = r.id[last];
  }
  /// `r`, which is a copy of `last`: as far beyond it as that is beyond `before`.
  void goOn(const SurfaceRow& r, const SurfaceRow& before, const SurfaceRow& last) const {
    for (size_t k = 0; k < stride_; ++k) {
      r.x[k] = 2.0f * last.x[k] - before.x[k], r.y[k] = 2.0f * last.y[k] - before.y[k], r.z[k] = 2.0f * last.z[k] - before.z[k];
    }
  }

  const AbstractionInput& a_;
  size_t stride_;
  std::vector<float> values_;
  std::vector<uint32_t> ids_;
  std::vector<float> joined_;
};

/// Row j of the cells of 2 x 2 samples.
void firstCellRow(const AbstractionInput& a, const CellLevel& level, SurfaceRows& rows, int j) {
  rows.read(2 * j);
  const size_t row = size_t(j) * size_t(level.width);
  const bool two = 2 * j + 1 < a.in.height;
  const size_t full = two ? size_t(a.in.width / 2) : 0;  // cells of four samples
  wholeCells(rows.right(0), rows.below(0), rows.right(1), rows.below(1), full, &level.whole[row]);
  cellsOfRows(rows.row(0), rows.row(1), full, kLeastAbstractionArea, kMostAbstractionArea, level.rowAt(row));
  std::fill_n(level.plane(8) + row, level.width, 1.0f);
  for (size_t i = 0; i < size_t(level.width); ++i) {
    if (i < full && level.whole[row + i]) continue;
    const size_t x = 2 * i, columns = x + 1 < size_t(a.in.width) ? 2 : 1;
    bool whole = i >= full;  // fewer samples, at the border: all there are
    for (size_t k = x; whole && k < x + columns; ++k) whole = rows.right(0)[k] * rows.below(0)[k] * (two ? rows.right(1)[k] * rows.below(1)[k] : 1.0f) != 0.0f;
    CellSum sum;
    addMostOf(a, int(x), 2 * j, sum);
    sum.store(level, row + i, whole);
  }
}

/// Row j of cells of twice the side of those of `from`.
void nextCellRow(const CellLevel& from, const CellLevel& level, float cosine, int j) {
  for (int i = 0; i < level.width; ++i) {
    size_t part[4], count = 0, most = 0;
    bool whole = true;
    for (int y = 2 * j; y < 2 * j + 2; ++y)
      for (int x = 2 * i; x < 2 * i + 2; ++x) {
        const size_t e = size_t(y) * size_t(from.width) + size_t(x);
        if (x >= from.width || y >= from.height) continue;
        whole = whole && from.whole[e];
        if (from.plane(6)[e] == 0.0f) continue;
        part[count++] = e;
      }
    for (size_t k = 1; k < count; ++k)
      if (from.plane(6)[part[k]] > from.plane(6)[part[most]]) most = k;
    CellSum sum;
    for (size_t k = 0; k < count; ++k) {
      const size_t e = part[k];
      if (!whole && k != most) {
        const Vec3 step = from.at(e) - from.at(part[most]);
        const float off = glm::dot(step, from.normal(part[most]));
        if (glm::dot(from.normal(e), from.normal(part[most])) < cosine || off * off > 0.25f * glm::dot(step, step)) continue;
      }
      sum.add(from.at(e), from.normal(e), from.plane(6)[e], from.plane(7)[e], from.footprint()[e]);
    }
    sum.store(level, size_t(j) * size_t(level.width) + size_t(i), whole);
  }
}

/// Which cells of row j values can be interpolated from, and how much narrower their Gaussians are.
void judgeCellRow(const CellLevel& level, float cosine, int j) {
  const float own = (1.0f - 1.0f / float(level.side * level.side)) / 24.0f;  // of a cell's variance, by the squares of its sides
  for (int i = 0; i < level.width; ++i) {
    const size_t e = size_t(j) * size_t(level.width) + size_t(i);
    const float width = level.footprint()[e] * float(level.side);
    float a2 = width * width, b2 = a2;
    bool usable = level.whole[e];
    const auto step = [&](bool after, size_t next, bool before, size_t last, float& square) {
      const size_t f = after && level.whole[next] ? next : before && level.whole[last] ? last : e;
      if (f == e || !level.whole[e]) {
        usable = false;
        return;
      }
      const Vec3 s = level.at(f) - level.at(e);
      square = glm::dot(s, s);
      usable = usable && square <= kLongestCell * kLongestCell && glm::dot(level.normal(e), level.normal(f)) >= std::max(cosine, kCellsTurn);
    };
    const size_t w = size_t(level.width);
    step(i + 1 < level.width, e + 1, i > 0, e - 1, a2);
    step(j + 1 < level.height, e + w, j > 0, e - w, b2);
    const float area2 = a2 * b2, least = kNarrowestCell / float(level.side), least2 = least * least;
    level.usable[e] = usable && area2 <= kWidestCell * kWidestCell * kWidestCell * kWidestCell && area2 > least2 * least2;
    level.plane(8)[e] = 1.0f / (1.0f - std::min(own * (a2 + b2), 0.5f));
  }
}

/// First of the four cells, of `count`, whose values say what is between cells i and i + 1.
int firstOfWindow(int i, int count) { return std::clamp(i - 1, 0, count - 4); }

/// Whether samples between cells (i, j) and (i + 1, j + 1) are interpolated at this level.
bool isWindowReady(const CellLevel& level, int i, int j) {
  if (i + 1 >= level.width || j + 1 >= level.height) return false;
  const int u0 = firstOfWindow(i, level.width), v0 = firstOfWindow(j, level.height);
  for (int v = v0; v < v0 + 4; ++v)
    for (int u = u0; u < u0 + 4; ++u)
      if (!level.usable[size_t(v) * size_t(level.width) + size_t(u)]) return false;
  return true;
}

void blurCellRow(const CellLevel& level, float cosine, int j) {
  const AbstractionPlanes p = level.view();
  const size_t row = size_t(j) * size_t(level.width);
  float sums[kCellRun], weights[kCellRun];
  for (int begin = 0, end = 0; begin < level.width; begin = end) {
    for (end = begin; end < level.width && !level.wanted[row + size_t(end)];) ++end;
    begin = end;
    float least = HUGE_VALF;
    for (; end < std::min(begin + kCellRun, level.width) && level.wanted[row + size_t(end)]; ++end)
      least = std::min(least, level.footprint()[row + size_t(end)]);
    if (begin == end) break;
    for (int i = begin; i < end; ++i) sums[i - begin] = 0, weights[i - begin] = p.area[row + size_t(i)];
    const float reach = least > 0.0f ? std::min(kAbstractionReach / (least * float(level.side)), 64.0f) : 64.0f;
    addDisc(p, level.width, level.height, j, begin, end, reach, 1, cosine, sums, weights);
    for (int i = begin; i < end; ++i) level.blurred()[row + size_t(i)] = p.d[row + size_t(i)] + sums[i - begin] / weights[i - begin];
  }
}

/// Of the samples of one row or column: the first of four cells, and their shares.
struct CellCubic {
  int window, first;
  float share[4];
};
std::vector<CellCubic> cellCubicsOf(int samples, int side, int cells) {
  std::vector<CellCubic> all(static_cast<size_t>(samples));
  const auto middle = [&](int cell) { return 0.5 * double(cell * side + std::min((cell + 1) * side, samples) - 1); };  // the last may not be full
  for (int x = 0; x < samples; ++x) {
    CellCubic& c = all[size_t(x)];
    c.window = std::clamp((x - side / 2) / side, 0, cells - 2);
    if (x < side / 2) c.window = 0;
    c.first = firstOfWindow(c.window, cells);
    for (int k = 0; k < 4; ++k) {
      double share = 1;
      for (int l = 0; l < 4; ++l)
        if (l != k) share *= (double(x) - middle(c.first + l)) / (middle(c.first + k) - middle(c.first + l));
      c.share[k] = float(share);
    }
  }
  return all;
}

/// Samples of row y whose surroundings are ready.
void interpolateCellRow(const CellLevel& level, const CellCubic& v, const std::vector<CellCubic>& across, const uint8_t* ready, float* out, uint8_t* done,
                        std::vector<float>& line) {
  const size_t w = size_t(level.width);
  const float* from = level.blurred() + size_t(v.first) * w;
  line.resize(w);
  for (size_t i = 0; i < w; ++i) line[i] = v.share[0] * from[i] + v.share[1] * from[w + i] + v.share[2] * from[2 * w + i] + v.share[3] * from[3 * w + i];
  for (size_t x = 0; x < across.size(); ++x) {
    const CellCubic& u = across[x];
    if (!ready[u.window] || done[x]) continue;
    const float* c = &line[size_t(u.first)];
    out[x] = u.share[0] * c[0] + u.share[1] * c[1] + u.share[2] * c[2] + u.share[3] * c[3];
    done[x] = 1;
  }
}

}  // namespace

bool AbstractionInput::counts(size_t e) const { return in.valid(e) && std::abs(d[e]) < kStyleFar; }

float AbstractionInput::areaOf(int x, int y) const {
  const size_t w = size_t(in.width), e = size_t(y) * w + size_t(x);
  const Vec3 P = in.at(in.P, e);
  const auto step = [&](bool after, size_t next, bool before, size_t last) {
    if (after && onOneSurface(in, e, next, cosine)) return in.at(in.P, next) - P;
    if (before && onOneSurface(in, e, last, cosine)) return P - in.at(in.P, last);
    return Vec3(0.0f);
  };
  const float area = glm::length(glm::cross(step(x + 1 < in.width, e + 1, x > 0, e - 1), step(y + 1 < in.height, e + w, y > 0, e - w)));
  return area > 0.0f ? area : in.footprint[e] * in.footprint[e];
}

bool abstractByCells(const AbstractionInput& a, const TaskArena& arena, const StopToken& stop, std::span<float> out, std::span<uint8_t> done) {
  const auto rows = [&](int count, const auto& body) {
    return arena.parallelFor(
        size_t(count), 4,
        [&](size_t begin, size_t end) {
          for (size_t k = begin; k < end; ++k) body(int(k));
        },
        stop);
  };
  float least = HUGE_VALF;
  for (size_t e = 0; e < a.d.size(); ++e)
    if (a.in.valid(e) && a.in.footprint[e] > 0.0f) least = std::min(least, a.in.footprint[e]);
  std::vector<CellLevel> levels;
  for (int side = kLeastCellSide; side <= kMostCellSide && float(side) * least <= kLongestCell * a.sigma; side *= 2) {
    const CellLevel* last = levels.empty() ? nullptr : &levels.back();
    const int width = last ? (last->width + 1) / 2 : (a.in.width + 1) / 2, height = last ? (last->height + 1) / 2 : (a.in.height + 1) / 2;
    if (width < kLeastCells || height < kLeastCells) break;
    CellLevel level(side, width, height);
    if (last && !rows(height, [&](int j) { nextCellRow(*last, level, a.cosine, j); })) return false;
    if (!last && !arena.parallelFor(
                     size_t(height), 16,
                     [&](size_t begin, size_t end) {
                       SurfaceRows samples(a);
                       for (size_t j = begin; j < end; ++j) firstCellRow(a, level, samples, int(j));
                     },
                     stop))
      return false;
    levels.push_back(std::move(level));
  }
  std::vector<uint8_t> ready;
  for (size_t k = levels.size(); k-- > 0;) {
    const CellLevel& level = levels[k];
    const size_t w = size_t(level.width);
    ready.assign(level.count(), 0);
    if (!rows(level.height, [&](int j) { judgeCellRow(level, a.cosine, j); })) return false;
    const auto isDone = [&](int i, int j) {  // windows of the levels before are twice as wide: where all four corners are done, all is
      const int x0 = i == 0 ? 0 : i * level.side + level.side / 2, x1 = std::min((i + 1) * level.side + level.side / 2, a.in.width) - 1;
      const int y0 = j == 0 ? 0 : j * level.side + level.side / 2, y1 = std::min((j + 1) * level.side + level.side / 2, a.in.height) - 1;
      for (const int y : {y0, y1})
        for (const int x : {x0, x1})
          if (!done[size_t(std::min(y, a.in.height - 1)) * size_t(a.in.width) + size_t(std::min(x, a.in.width - 1))]) return false;
      return true;
    };
    if (!rows(level.height, [&](int j) {
          for (int i = 0; i < level.width; ++i) ready[size_t(j) * w + size_t(i)] = isWindowReady(level, i, j) && (k + 1 == levels.size() || !isDone(i, j));
        }))
      return false;
    if (!rows(level.height, [&](int j) {  // a cell is wanted by those windows that it is in: at most three before and three behind, at the border
          for (int v = std::max(j - 3, 0); v <= std::min(j + 3, level.height - 2); ++v) {
            if (j < firstOfWindow(v, level.height) || j >= firstOfWindow(v, level.height) + 4) continue;
            for (int i = 0; i + 1 < level.width; ++i)
              if (ready[size_t(v) * w + size_t(i)]) std::fill_n(&level.wanted[size_t(j) * w + size_t(firstOfWindow(i, level.width))], 4, uint8_t(1));
          }
          blurCellRow(level, a.cosine, j);
        }))
      return false;
    const std::vector<CellCubic> across = cellCubicsOf(a.in.width, level.side, level.width), down = cellCubicsOf(a.in.height, level.side, level.height);
    if (!rows(a.in.height, [&](int y) {
          std::vector<float> line;
          const size_t row = size_t(y) * size_t(a.in.width);
          const CellCubic& v = down[size_t(y)];
          const uint8_t* of = &ready[size_t(v.window) * w];
          if (std::find(of, of + w, 1) != of + w) interpolateCellRow(level, v, across, of, &out[row], &done[row], line);
        }))
      return false;
  }
  return true;
}

size_t abstractionCellBytes(size_t samples) { return samples * (kCellPlanes * sizeof(float) + 4) / 2; }

}  // namespace filters
}  // namespace gobo
