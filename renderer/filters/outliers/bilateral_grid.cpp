// SPDX-License-Identifier: Apache-2.0
#include "filters/outliers/bilateral_grid.h"

#include <algorithm>
#include <cmath>

#include "base/check.h"
#include "base/vec.h"

namespace gobo::outliers {

namespace {

constexpr int kBand = 16;  // rows of cells that are made together
constexpr int kReach = 2;  // of the blur, in cells
// A Gaussian of variance 2/3 cells: splatting and taking, both linear, bring 1/6 each.
constexpr double kBlur[2 * kReach + 1] = {0.0253355, 0.2319912, 0.4853466, 0.2319912, 0.0253355};

struct Cell {
  DVec3 light{0.0};
  double number = 0.0;
  void add(double w, const Cell& other) {
    light += w * other.light;
    number += w * other.number;
  }
};

/// Cell below a coordinate, and how far beyond it.
struct Place {
  int cell;
  double part;
};
Place placeOf(double at) {
  const double below = std::floor(at);
  return {int(below), at - below};
}

class Grid {
 public:
  Grid(const std::vector<float>& rgb, int width, int height, const BilateralGrid& s) : rgb_(rgb), width_(width), height_(height), s_(s) {
    brightness_.resize(size_t(width) * size_t(height));
    double lowest = 0.0, highest = 0.0;
    bool any = false;
    for (size_t p = 0; p < brightness_.size(); ++p) {
      const DVec3 v = valueOf(p);
      if (!(std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z))) {
        brightness_[p] = -1.0;
        continue;
      }
      const double luminance = 0.2126 * v.x + 0.7152 * v.y + 0.0722 * v.z;
      brightness_[p] = std::log1p(std::clamp(luminance / s.white, 0.0, 1e6)) / s.range;
      lowest = any ? std::min(lowest, brightness_[p]) : brightness_[p];
      highest = any ? std::max(highest, brightness_[p]) : brightness_[p];
      any = true;
    }
    for (double& b : brightness_)
      if (b >= 0.0) b = b - lowest + kReach;
    // Room for the blur on both sides, and for the cell above the last place.
    layers_ = int(highest - lowest) + 2 + 2 * kReach;
    columns_ = int(double(width - 1) / s.space) + 2 + 2 * kReach;
    cellRows_ = int(double(height - 1) / s.space) + 1;
  }
  int bands() const { return (cellRows_ + kBand - 1) / kBand; }

  /// The pixels whose cell row is one of the band's.
  void filterBand(int band, std::vector<float>& out) const {
    const int firstRow = band * kBand, rows = std::min(kBand, cellRows_ - firstRow);
    const std::vector<Cell> cells = blurred(firstRow - kReach, rows + 1 + 2 * kReach);
    for (int y = 0; y < height_; ++y) {
      const int row = cellRowOf(y);
      if (row < firstRow || row >= firstRow + rows) continue;
      for (int x = 0; x < width_; ++x) {
        const size_t p = pixelOf(x, y);
        if (brightness_[p] < 0.0) continue;
        Cell sum;
        aroundPixel(x, y, [&](int r, int c, int l, double w) { sum.add(w, cells[at(r - firstRow + kReach, c, l)]); });
        for (int c = 0; c < 3; ++c) out[3 * p + size_t(c)] = float(std::clamp(sum.light[c] / sum.number, -3.4e38, 3.4e38));
      }
    }
  }

 private:
  size_t pixelOf(int x, int y) const { return size_t(y) * size_t(width_) + size_t(x); }
  int cellRowOf(int y) const { return placeOf(double(y) / s_.space).cell; }
  DVec3 valueOf(size_t p) const { return DVec3(double(rgb_[3 * p]), double(rgb_[3 * p + 1]), double(rgb_[3 * p + 2])); }
  size_t at(int row, int column, int layer) const { return (size_t(row) * size_t(columns_) + size_t(column)) * size_t(layers_) + size_t(layer); }

  /// visit(row, column, layer, weight) of the eight cells around a pixel.
  template <class F>
  void aroundPixel(int x, int y, F&& visit) const {
    const Place row = placeOf(double(y) / s_.space), column = placeOf(double(x) / s_.space + kReach), layer = placeOf(brightness_[pixelOf(x, y)]);
    for (int k = 0; k < 8; ++k) {
      const int r = k & 1, c = k >> 1 & 1, l = k >> 2;
      const double w = (r ? row.part : 1 - row.part) * (c ? column.part : 1 - column.part) * (l ? layer.part : 1 - layer.part);
      visit(row.cell + r, column.cell + c, layer.cell + l, w);
    }
  }

  /// Cell rows first .. first + n - 1, blurred but for the outer `kReach` ones at each end.
  std::vector<Cell> blurred(int first, int n) const {
    std::vector<Cell> cells(size_t(n) * size_t(columns_) * size_t(layers_)), line;
    for (int y = 0; y < height_; ++y) {
      const int row = cellRowOf(y);
      if (row + 1 < first || row >= first + n) continue;
      for (int x = 0; x < width_; ++x) {
        if (brightness_[pixelOf(x, y)] < 0.0) continue;
        const Cell own{valueOf(pixelOf(x, y)), 1.0};
        aroundPixel(x, y, [&](int r, int c, int l, double w) {
          if (r >= first && r < first + n) cells[at(r - first, c, l)].add(w, own);  // the next band has the rest
        });
      }
    }
    const auto blurLines = [&](size_t count, int length, const auto& cellAt) {
      line.resize(size_t(length));
      for (size_t i = 0; i < count; ++i) {
        for (int k = 0; k < length; ++k) line[size_t(k)] = cells[cellAt(i, k)];
        for (int k = 0; k < length; ++k) {
          Cell sum;
          for (int d = std::max(-kReach, -k); d <= std::min(kReach, length - 1 - k); ++d) sum.add(kBlur[d + kReach], line[size_t(k + d)]);
          cells[cellAt(i, k)] = sum;
        }
      }
    };
    const size_t rowCells = size_t(columns_) * size_t(layers_);
    blurLines(size_t(n) * size_t(columns_), layers_, [&](size_t i, int k) { return i * size_t(layers_) + size_t(k); });
    blurLines(size_t(n) * size_t(layers_), columns_,
              [&](size_t i, int k) { return i / size_t(layers_) * rowCells + size_t(k) * size_t(layers_) + i % size_t(layers_); });
    blurLines(rowCells, n, [&](size_t i, int k) { return size_t(k) * rowCells + i; });
    return cells;
  }

  const std::vector<float>& rgb_;
  int width_, height_;
  BilateralGrid s_;
  std::vector<double> brightness_;  // in cells; -1: not finite
  int layers_ = 0, columns_ = 0, cellRows_ = 0;
};

}  // namespace

std::vector<float> bilateralGrid(const std::vector<float>& rgb, int width, int height, const BilateralGrid& settings, const Rows& rows) {
  GOBO_CHECK_LE(0.5, settings.space);
  GOBO_CHECK_LE(0.01, settings.range);
  GOBO_CHECK_LT(0.0, settings.white);
  std::vector<float> out = rgb;
  const Grid grid(rgb, width, height, settings);
  const auto some = [&](size_t begin, size_t end) {
    for (size_t b = begin; b < end && !rows.stop.stopRequested(); ++b) grid.filterBand(int(b), out);
  };
  if (rows.arena) rows.arena->parallelFor(size_t(grid.bands()), 1, some, rows.stop);
  else some(0, size_t(grid.bands()));
  return out;
}

}  // namespace gobo::outliers
