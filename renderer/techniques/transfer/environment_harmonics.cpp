// SPDX-License-Identifier: Apache-2.0
#include "techniques/transfer/environment_harmonics.h"

#include <array>
#include <cmath>
#include <numbers>

#include "techniques/transfer/environment_harmonics_kernels.h"
#include "techniques/transfer/harmonics.h"

namespace gobo::transfer {

namespace {

constexpr int kGauss = 4;
constexpr double kNode[kGauss] = {-0.8611363115940526, -0.3399810435848563, 0.3399810435848563, 0.8611363115940526};
constexpr double kWeight[kGauss] = {0.3478548451374538, 0.6521451548625461, 0.6521451548625461, 0.3478548451374538};

/// Integral over the polar angle of a row's tent times the sine times the part of each harmonic that depends on it: index l (l + 1) + m, m >= 0, of what
/// multiplies cos(m azimuth).
class PolarParts {
 public:
  PolarParts(int row, int rows, int bands) : bands_(bands) {
    const double step = std::numbers::pi / rows, centre = (row + 0.5) * step;
    const double from = row == 0 ? 0.0 : centre - step, to = row == rows - 1 ? std::numbers::pi : centre + step;
    add(from, centre, row == 0 ? 0.0 : 1.0 / step, centre);
    add(centre, to, row == rows - 1 ? 0.0 : 1.0 / step, centre);
  }
  double operator()(int l, int m) const { return part_[size_t(l * (l + 1) + m)]; }

 private:
  void add(double from, double to, double slope, double centre) {
    const int pieces = std::max(1, int(std::ceil((to - from) / 0.05)));
    std::array<double, kMaxHarmonics> Y;
    for (int p = 0; p < pieces; ++p) {
      const double half = 0.5 * (to - from) / pieces, middle = from + (2 * p + 1) * half;
      for (int g = 0; g < kGauss; ++g) {
        const double theta = middle + half * kNode[g], s = std::sin(theta);
        harmonics(DVec3(s, std::cos(theta), 0.0), bands_, Y.data());  // azimuth 0: cosines are 1
        const double w = half * kWeight[g] * s * (1.0 - slope * std::fabs(theta - centre));
        for (int l = 0; l < bands_; ++l)
          for (int m = 0; m <= l; ++m) part_[size_t(l * (l + 1) + m)] += w * Y[size_t(l * (l + 1) + m)];
      }
    }
  }
  int bands_;
  std::array<double, kMaxHarmonics> part_{};
};

}  // namespace

std::vector<double> environmentHarmonics(const Environment& map, int bands, const TaskArena& arena, const StopToken& stop) {
  const int width = map.width, height = map.height;
  const double step = 2 * std::numbers::pi / width;
  // By column and order: cos and sin of m times the azimuth of the column's centre, times what a tent takes off and the column's width.
  const size_t orders = size_t(2 * bands - 1);
  std::vector<float> wave(orders * size_t(width));
  for (int m = 0; m < bands; ++m) {
    const double half = 0.5 * m * step, sinc = m == 0 ? 1.0 : width == 1 ? 0.0 : std::sin(half) / half;
    for (int x = 0; x < width; ++x) {
      const double a = m * ((x + 0.5) * step - std::numbers::pi);
      wave[size_t(m == 0 ? 0 : 2 * m - 1) * size_t(width) + size_t(x)] = float(sinc * sinc * std::cos(a));
      if (m > 0) wave[size_t(2 * m) * size_t(width) + size_t(x)] = float(sinc * sinc * std::sin(a));
    }
  }
  std::vector<double> rows(size_t(height) * orders * 3), parts(size_t(height) * size_t(bands * bands));
  const bool complete = arena.parallelFor(
      size_t(height), 4,
      [&](size_t begin, size_t end) {
        for (size_t y = begin; y < end; ++y) {
          addRow(&map.texels.data()[y * size_t(width)].x, size_t(width), wave.data(), orders, rows.data() + y * orders * 3);
          const PolarParts part(int(y), height, bands);
          for (int l = 0; l < bands; ++l)
            for (int m = 0; m <= l; ++m) parts[y * size_t(bands * bands) + size_t(l * (l + 1) + m)] = part(l, m);
        }
      },
      stop);
  if (!complete) return {};
  std::vector<double> out(size_t(bands * bands) * 3);
  for (int y = 0; y < height; ++y) {
    const double* part = parts.data() + size_t(y) * size_t(bands * bands);
    const double* row = rows.data() + size_t(y) * orders * 3;
    for (int l = 0; l < bands; ++l)
      for (int m = 0; m <= l; ++m)
        for (int c = 0; c < 3; ++c) {
          out[size_t(l * (l + 1) + m) * 3 + size_t(c)] += step * part[l * (l + 1) + m] * row[(m == 0 ? 0 : 2 * m - 1) * 3 + c];
          if (m > 0) out[size_t(l * (l + 1) - m) * 3 + size_t(c)] += step * part[l * (l + 1) + m] * row[(2 * m) * 3 + c];
        }
  }
  return out;
}

}  // namespace gobo::transfer
