// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/interpolated_sums.h"

#include <algorithm>
#include <cmath>

namespace gobo {

namespace {

constexpr size_t kNodesAside = InterpolatedSum::kSide;
constexpr double kLebesgue = 2.4;  // of 8 Chebyshev nodes: at most 2/pi ln 8 + 1

double nodeAt(size_t k) {
  static const std::array<double, kNodesAside> nodes = [] {
    std::array<double, kNodesAside> n{};
    for (size_t i = 0; i < kNodesAside; ++i) n[i] = std::cos(M_PI * (double(i) + 0.5) / double(kNodesAside));
    return n;
  }();
  return nodes[k];
}

using Matrix = std::array<std::array<double, kNodesAside>, kNodesAside>;
/// Values at the nodes to coefficients of powers: by the Chebyshev polynomials' own.
const Matrix& powersOfValues() {
  static const Matrix m = [] {
    double chebyshev[kNodesAside][kNodesAside] = {};  // of powers in polynomial n
    chebyshev[0][0] = chebyshev[1][1] = 1;
    for (size_t n = 2; n < kNodesAside; ++n)
      for (size_t i = 0; i < kNodesAside; ++i) chebyshev[n][i] = (i ? 2 * chebyshev[n - 1][i - 1] : 0.0) - chebyshev[n - 2][i];
    Matrix result{};
    for (size_t i = 0; i < kNodesAside; ++i)
      for (size_t k = 0; k < kNodesAside; ++k)
        for (size_t n = 0; n < kNodesAside; ++n)
          result[i][k] += (n ? 2.0 : 1.0) / double(kNodesAside) * std::cos(double(n) * M_PI * (double(k) + 0.5) / double(kNodesAside)) * chebyshev[n][i];
    return result;
  }();
  return m;
}

constexpr int kAngles = 24;
struct Turn {
  double cosine, sine;
};
const std::array<Turn, kAngles + 1>& turns() {
  static const std::array<Turn, kAngles + 1> all = [] {
    std::array<Turn, kAngles + 1> t{};
    for (int k = 0; k <= kAngles; ++k) t[size_t(k)] = {std::cos(0.5 * M_PI * k / kAngles), std::sin(0.5 * M_PI * k / kAngles)};
    return t;
  }();
  return all;
}

/// Bound of one side's error by a source's least value in a square whose half diagonal is 1, at `d` from its middle.
double errorAt(int p, double d) {
  const double half = std::sqrt(0.5);
  double best = HUGE_VAL;
  for (double rho = 1.5; rho < 40; rho *= 1.1) {
    const double a = half * (rho + 1 / rho) / 2, b = half * (rho - 1 / rho) / 2;
    double least = HUGE_VAL;  // of |r^2| on the ellipse
    for (const Turn& turn : turns()) {
      const double x = a * turn.cosine, y = b * turn.sine, w = d - std::sqrt(x * x + 0.5);
      least = std::min(least, w > 0 ? w * w - y * y : 0.0);
    }
    if (least > 0) best = std::min(best, 4 * std::exp(p * (std::log(d + 1) - 0.5 * std::log(least)) - double(kNodesAside - 1) * std::log(rho)) / (rho - 1));
  }
  return best;
}

}  // namespace

double PlaneRectangle::radius() const { return std::hypot(halfS, halfT); }

PlaneRectangle PlaneRectangle::around(const DVec3& s, const DVec3& t, std::span<const DVec3> points) {
  PlaneRectangle r;
  r.s = s, r.t = t;
  const DVec3 from = points[0];
  double low[2] = {0, 0}, high[2] = {0, 0};
  for (const DVec3& p : points) {
    const double at[2] = {glm::dot(p - from, s), glm::dot(p - from, t)};
    for (int k = 0; k < 2; ++k) low[k] = std::min(low[k], at[k]), high[k] = std::max(high[k], at[k]);
  }
  r.centre = from + (0.5 * (low[0] + high[0])) * s + (0.5 * (low[1] + high[1])) * t;
  r.halfS = 0.5 * (high[0] - low[0]), r.halfT = 0.5 * (high[1] - low[1]);
  r.halfS = std::max(r.halfS, 1e-3 * r.halfT), r.halfT = std::max(r.halfT, 1e-3 * r.halfS);
  return r;
}

double interpolationReach(int p, double error) {
  double near = 1.5, far = 3;
  const auto enough = [&](double d) { return (1 + kLebesgue) * errorAt(p, d) <= error; };
  while (!enough(far)) near = far, far *= 1.5;
  for (int k = 0; k < 8; ++k) (enough(0.5 * (near + far)) ? far : near) = 0.5 * (near + far);
  return far;
}

DVec3 InterpolatedSum::node(const PlaneRectangle& over, size_t k) { return over.at(nodeAt(k / kNodesAside), nodeAt(k % kNodesAside)); }

void InterpolatedSum::fit(const std::array<double, kNodes>& values) {
  const Matrix& m = powersOfValues();
  double rows[kNodesAside][kNodesAside] = {};
  for (size_t i = 0; i < kNodesAside; ++i)
    for (size_t k = 0; k < kNodesAside; ++k)
      for (size_t l = 0; l < kNodesAside; ++l) rows[i][l] += m[i][k] * values[k * kNodesAside + l];
  for (size_t i = 0; i < kNodesAside; ++i)
    for (size_t j = 0; j < kNodesAside; ++j) {
      double sum = 0;
      for (size_t l = 0; l < kNodesAside; ++l) sum += m[j][l] * rows[i][l];
      share[i * kNodesAside + j] = float(sum);
    }
}

}  // namespace gobo
