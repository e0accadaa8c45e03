// SPDX-License-Identifier: Apache-2.0
#include "terms/environment_cells.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <memory>
#include <mutex>
#include <numbers>

#include "base/to_index.h"
#include "scene/environment_tents.h"

namespace gobo {
inline namespace terms {

namespace {
/// NaN, Inf and negative channels count as black, before neighbours are interpolated with them.
bool valid(const Vec3& c) { return isFinite(c) && c.x >= 0.0f && c.y >= 0.0f && c.z >= 0.0f; }
}  // namespace

int EnvironmentCells::faceOf(const DVec3& d) {
  const DVec3 a = glm::abs(d);
  if (a.x >= a.y && a.x >= a.z) return d.x < 0;
  if (a.y >= a.z) return 2 + (d.y < 0);
  return 4 + (d.z < 0);
}

bool EnvironmentCells::project(int face, const DVec3& d, double& x, double& y) {
  const int axis = face / 2;
  const double along = face % 2 ? -d[axis] : d[axis];
  if (!(along > 0)) return false;
  x = d[(axis + 1) % 3] / along;
  y = d[(axis + 2) % 3] / along;
  return true;
}

DVec3 EnvironmentCells::direction(int face, double x, double y) {
  const int axis = face / 2;
  DVec3 d(0.0);
  d[axis] = face % 2 ? -1.0 : 1.0;
  d[(axis + 1) % 3] = x;
  d[(axis + 2) % 3] = y;
  return glm::normalize(d);
}

DVec3 EnvironmentCells::cellDirection(size_t cell) {
  const int face = int(cell / (kSide * kSide)), j = int(cell / kSide) % kSide, i = int(cell % kSide);
  return direction(face, (2.0 * i + 1.0) / kSide - 1.0, (2.0 * j + 1.0) / kSide - 1.0);
}

namespace {

/// Directions of a grid that is even in azimuth: rows by sine and cosine of a polar angle.
struct Grid {
  int width = 0, height = 0;
  std::vector<double> sine, cosine;            // of the rows' polar angles
  std::vector<double> azimuthCos, azimuthSin;  // of the columns
  Grid(int columns, int rows) : width(columns), height(rows), sine(size_t(rows)), cosine(size_t(rows)) {
    azimuthCos.resize(size_t(width));
    azimuthSin.resize(size_t(width));
    const double dPhi = 2.0 * std::numbers::pi / width;
    for (int x = 0; x < width; ++x) {
      const double phi = (x + 0.5) * dPhi - std::numbers::pi;
      azimuthCos[size_t(x)] = std::cos(phi);
      azimuthSin[size_t(x)] = std::sin(phi);
    }
  }
  DVec3 direction(int x, int y) const {
    const double s = sine[size_t(y)];
    return {s * azimuthCos[size_t(x)], cosine[size_t(y)], s * azimuthSin[size_t(x)]};
  }
};

/// Which cell each direction of some rows of a grid falls into, and where the cells of each part of the cube (a quarter of a face) lie in the grid: sums over
/// parts run side by side, and each cell still gets what it gets row by row.
struct Layout {
  struct Span {
    int y, from, to;
  };
  static constexpr size_t kParts = 24;
  int width, height, first;  // rows first .. first + height - 1 of the grid
  std::vector<uint16_t> cell;
  std::vector<Span> spans[kParts];  // ordered by row, then column

  Layout(const Grid& grid, int firstRow, int rowCount, const TaskArena* arena, const StopToken& stop)
      : width(grid.width), height(rowCount), first(firstRow), cell(size_t(width) * size_t(height)) {
    constexpr int n = EnvironmentCells::kSide;
    std::vector<std::vector<std::pair<size_t, Span>>> found(static_cast<size_t>(height));
    const auto rows = [&](size_t begin, size_t end) {
      for (size_t y = begin; y < end && !stop.stopRequested(); ++y) {
        for (int x = 0; x < width; ++x) {
          const DVec3 d = grid.direction(x, first + int(y));
          const int face = EnvironmentCells::faceOf(d);
          double u = 0, v = 0;
          EnvironmentCells::project(face, d, u, v);
          const int i = toIndex((u + 1.0) * 0.5 * n, n), j = toIndex((v + 1.0) * 0.5 * n, n);
          cell[y * size_t(width) + size_t(x)] = uint16_t((size_t(face) * n + size_t(j)) * n + size_t(i));
          const size_t part = size_t(face) * 4 + size_t(j >= n / 2) * 2 + size_t(i >= n / 2);
          auto& row = found[y];
          if (row.empty() || row.back().first != part) row.push_back({part, {first + int(y), x, x}});
          ++row.back().second.to;
        }
      }
    };
    if (arena) arena->parallelFor(size_t(height), 16, rows, stop);
    else rows(0, size_t(height));
    for (const auto& row : found)
      for (const auto& [part, span] : row) spans[part].push_back(span);
  }
};

constexpr size_t kMostKept = size_t(1) << 21;  // directions of a layout: 4 MB

/// The layout of a whole grid is kept until that of another size comes: maps that follow each other are of one size. `kind` tells grids of a size apart.
std::shared_ptr<const Layout> keptLayout(const Grid& grid, int kind, const TaskArena* arena, const StopToken& stop) {
  static std::mutex mutex;
  static std::shared_ptr<const Layout> last;
  static int lastKind = 0;
  {
    const std::lock_guard hold(mutex);
    if (last && last->width == grid.width && last->height == grid.height && lastKind == kind) return last;
  }
  auto made = std::make_shared<const Layout>(grid, 0, grid.height, arena, stop);
  if (stop.stopRequested()) return made;
  const std::lock_guard hold(mutex);
  last = made;
  lastKind = kind;
  return made;
}

/// NaN, Inf or a negative channel somewhere.
bool anyInvalid(const Environment& map, const TaskArena* arena) {
  std::atomic<bool> found{false};
  const auto look = [&](size_t begin, size_t end) {
    const float* v = &map.texels.data()[0].x;
    bool good = true;
    for (size_t i = 3 * begin; i < 3 * end; ++i) good &= v[i] >= 0.0f && v[i] <= std::numeric_limits<float>::max();
    if (!good) found = true;
  };
  if (arena) arena->parallelFor(map.texels.size(), 65536, look);
  else look(0, map.texels.size());
  return found;
}

/// Adds what `radiance(x, y)` says for every direction of the grid; solidAngle and own by row. Each cell is summed in the order of rows, then columns,
/// in registers while neighbours fall into one cell.
template <typename Radiance>
void gather(std::vector<EnvironmentCell>& cells, const Grid& grid, int kind, const std::vector<double>& solidAngle, const std::vector<double>& own,
            const Radiance& radiance, const TaskArena* arena, const StopToken& stop) {
  const auto add = [&](const Layout& layout) {
    const auto parts = [&](size_t begin, size_t end) {
      for (size_t part = begin; part < end; ++part) {
        size_t polled = 0;
        for (const Layout::Span& span : layout.spans[part]) {
          if (++polled % 16 == 0 && stop.stopRequested()) return;
          const size_t y = size_t(span.y);
          const double s = grid.sine[y], c = grid.cosine[y], omega = solidAngle[y], spread = own[y];
          const uint16_t* index = layout.cell.data() + (y - size_t(layout.first)) * size_t(grid.width);
          for (int x = span.from; x < span.to;) {
            const uint16_t at = index[x];
            EnvironmentCell sum = cells[at];
            for (; x < span.to && index[x] == at; ++x) {
              const DVec3 d(s * grid.azimuthCos[size_t(x)], c, s * grid.azimuthSin[size_t(x)]);
              const DVec3 flux = DVec3(radiance(x, span.y)) * omega;
              const double w = 0.2126 * flux.x + 0.7152 * flux.y + 0.0722 * flux.z;
              sum.solidAngle += omega;
              sum.flux += flux;
              sum.weight += w;
              sum.moment += w * d;
              sum.extent += w * spread;
            }
            cells[at] = sum;
          }
        }
      }
    };
    if (arena) arena->parallelFor(Layout::kParts, 1, parts, stop);
    else parts(0, Layout::kParts);
  };
  const int rows = int(std::max<size_t>(1, kMostKept / size_t(grid.width)));
  if (rows >= grid.height) return add(*keptLayout(grid, kind, arena, stop));
  for (int y = 0; y < grid.height && !stop.stopRequested(); y += rows) add(Layout(grid, y, std::min(rows, grid.height - y), arena, stop));
}

}  // namespace

EnvironmentCells::EnvironmentCells(const Environment& map, const StopToken& stop, const TaskArena* arena) : cells(size_t(6) * kSide * kSide) {
  const double step = 0.5 * (0.5 * std::numbers::pi / kSide);  // half a cell
  Environment repaired;
  const Environment* clean = &map;
  if (anyInvalid(map, arena)) {
    repaired = map;
    for (Vec3& c : repaired.texels)
      for (int k = 0; k < 3; ++k) c[k] = valid(Vec3(c[k])) ? c[k] : 0.0f;
    clean = &repaired;
  }
  if (2.0 * std::numbers::pi / map.width <= step && std::numbers::pi / map.height <= step) addTexels(*clean, stop, arena);
  else addPieces(*clean, stop, arena);
  for (const EnvironmentCell& cell : cells) {
    flux += cell.flux;
    weight += cell.weight;
  }
}

void EnvironmentCells::addTexels(const Environment& map, const StopToken& stop, const TaskArena* arena) {
  const EnvironmentTents tents(map.width, map.height);
  const double dPhi = 2.0 * std::numbers::pi / map.width, dTheta = std::numbers::pi / map.height;
  Grid grid(map.width, map.height);
  const size_t rows = size_t(map.height);
  std::vector<double> omega(rows), own(rows);
  for (int y = 0; y < map.height; ++y) {
    const double theta = (y + 0.5) * dTheta, s = std::sin(theta);
    grid.sine[size_t(y)] = s;
    grid.cosine[size_t(y)] = std::cos(theta);
    omega[size_t(y)] = tents.weight(y);
    own[size_t(y)] = (dTheta * dTheta + s * s * dPhi * dPhi) / 6.0;  // a tent's variance is a sixth of its texel's width squared
  }
  gather(
      cells, grid, 1, omega, own, [&](int x, int y) -> const Vec3& { return map.texels.data()[size_t(y) * size_t(map.width) + size_t(x)]; }, arena, stop);
}

void EnvironmentCells::addPieces(const Environment& map, const StopToken& stop, const TaskArena* arena) {
  const double step = 0.5 * (0.5 * std::numbers::pi / kSide);
  // An even number of pieces a texel: none spans a texel's centre, so that radiance is linear along both axes of each.
  const int cutX = 2 * std::max(1, int(std::ceil(std::numbers::pi / map.width / step))),
            cutY = 2 * std::max(1, int(std::ceil(0.5 * std::numbers::pi / map.height / step)));
  const int columns = map.width * cutX, rows = map.height * cutY;
  const double dPhi = 2.0 * std::numbers::pi / columns, dTheta = std::numbers::pi / rows;
  Grid grid(columns, rows);
  std::vector<double> omega(grid.sine.size()), own(omega.size()), across(omega.size());
  for (int y = 0; y < rows; ++y) {
    const double middle = (y + 0.5) * dTheta, half = 0.5 * dTheta;
    omega[size_t(y)] = dPhi * 2.0 * std::sin(middle) * std::sin(half);  // cos(middle - half) - cos(middle + half) without cancellation
    // Looked up at the mean of the polar angle by solid angle, a linear function gives its own mean: fluxes are exact.
    const double theta = middle + std::cos(middle) / std::sin(middle) * (1.0 - half * std::cos(half) / std::sin(half)), s = std::sin(theta);
    grid.sine[size_t(y)] = s;
    grid.cosine[size_t(y)] = std::cos(theta);
    own[size_t(y)] = (dTheta * dTheta + s * s * dPhi * dPhi) / 12.0;
    across[size_t(y)] = theta / std::numbers::pi * map.height;
  }
  gather(
      cells, grid, 2, omega, own, [&](int x, int y) { return interpolateTexels(map, (x + 0.5) / cutX, across[size_t(y)]); }, arena, stop);
}

}  // namespace terms
}  // namespace gobo
