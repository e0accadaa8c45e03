// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/interpolated_sums.h"

#include <algorithm>
#include <cmath>

namespace gobo {
inline namespace filters {

namespace {

constexpr size_t kNodesASide = InterpolatedSum::kSide;
constexpr double kLebesgueOfNodes = 2.4;  // of 8 Chebyshev nodes: at most 2/pi ln 8 + 1

double chebyshevNode(size_t k) {
  static const std::array<double, kNodesASide> nodes = [] {
    std::array<double, kNodesASide> n{};
    for (size_t i = 0; i < kNodesASide; ++i) n[i] = std::cos(M_PI * (double(i) + 0.5) / double(kNodesASide));
    return n;
  }();
  return nodes[k];
}

using NodeMatrix = std::array<std::array<double, kNodesASide>, kNodesASide>;
/// Values at the nodes to coefficients of powers: by the Chebyshev polynomials' own.
const NodeMatrix& powersOfValues() {
  static const NodeMatrix m = [] {
    double chebyshev[kNodesASide][kNodesASide] = {};  // of powers in polynomial n
    chebyshev[0][0] = chebyshev[1][1] = 1;
    for (size_t n = 2; n < kNodesASide; ++n)
      for (size_t i = 0; i < kNodesASide; ++i) chebyshev[n][i] = (i ? 2 * chebyshev[n - 1][i - 1] : 0.0) - chebyshev[n - 2][i];
    NodeMatrix result{};
    for (size_t i = 0; i < kNodesASide; ++i)
      for (size_t k = 0; k < kNodesASide; ++k)
        for (size_t n = 0; n < kNodesASide; ++n)
          result[i][k] += (n ? 2.0 : 1.0) / double(kNodesASide) * std::cos(double(n) * M_PI * (double(k) + 0.5) / double(kNodesASide)) * chebyshev[n][i];
    return result;
  }();
  return m;
}

constexpr int kEllipseAngles = 24;
struct EllipseAngle {
  double cosine, sine;
};
const std::array<EllipseAngle, kEllipseAngles + 1>& ellipseAngles() {
  static const std::array<EllipseAngle, kEllipseAngles + 1> all = [] {
    std::array<EllipseAngle, kEllipseAngles + 1> t{};
    for (int k = 0; k <= kEllipseAngles; ++k) t[size_t(k)] = {std::cos(0.5 * M_PI * k / kEllipseAngles), std::sin(0.5 * M_PI * k / kEllipseAngles)};
    return t;
  }();
  return all;
}

/// Bound of one side's error by a source's least value in a square whose half diagonal is 1, at `d` from its middle.
double interpolationErrorAt(int p, double d) {
  const double half = std::sqrt(0.5);
  double best = HUGE_VAL;
  for (double rho = 1.5; rho < 40; rho *= 1.1) {
    const double a = half * (rho + 1 / rho) / 2, b = half * (rho - 1 / rho) / 2;
    double least = HUGE_VAL;  // of |r^2| on the ellipse
    for (const EllipseAngle& turn : ellipseAngles()) {
      const double x = a * turn.cosine, y = b * turn.sine, w = d - std::sqrt(x * x + 0.5);
      least = std::min(least, w > 0 ? w * w - y * y : 0.0);
    }
    if (least > 0) best = std::min(best, 4 * std::exp(p * (std::log(d + 1) - 0.5 * std::log(least)) - double(kNodesASide - 1) * std::log(rho)) / (rho - 1));
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
  const auto enough = [&](double d) { return (1 + kLebesgueOfNodes) * interpolationErrorAt(p, d) <= error; };
  while (!enough(far)) near = far, far *= 1.5;
  for (int k = 0; k < 8; ++k) (enough(0.5 * (near + far)) ? far : near) = 0.5 * (near + far);
  return far;
}

DVec3 InterpolatedSum::node(const PlaneRectangle& over, size_t k) { return over.at(chebyshevNode(k / kNodesASide), chebyshevNode(k % kNodesASide)); }

void InterpolatedSum::fit(const std::array<double, kNodes>& values) {
  const NodeMatrix& m = powersOfValues();
  double rows[kNodesASide][kNodesASide] = {};
  for (size_t i = 0; i < kNodesASide; ++i)
    for (size_t k = 0; k < kNodesASide; ++k)
      for (size_t l = 0; l < kNodesASide; ++l) rows[i][l] += m[i][k] * values[k * kNodesASide + l];
  for (size_t i = 0; i < kNodesASide; ++i)
    for (size_t j = 0; j < kNodesASide; ++j) {
      double sum = 0;
      for (size_t l = 0; l < kNodesASide; ++l) sum += m[j][l] * rows[i][l];
      share[i * kNodesASide + j] = float(sum);
    }
}

}  // namespace filters
}  // namespace gobo
