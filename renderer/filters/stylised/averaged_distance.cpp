// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/averaged_distance.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace gobo {
inline namespace filters {

namespace {

constexpr double kNode[2] = {0.33998104358485626, 0.86113631159405258}, kWeight[2] = {0.65214515486254614, 0.34785484513745386};

/// Largest half length by distance of which the rule's relative error, 1.44e-7 p (p+1) ... (p+7) q^8, is 1e-10.
double reachOf(int p) {
  static const std::array<double, 65> table = [] {
    std::array<double, 65> reach{};
    for (size_t n = 0; n < reach.size(); ++n) {
      double product = 1.4397e-7;
      for (size_t k = 0; k < 8; ++k) product *= double(n + k);
      reach[n] = n ? std::pow(1e-10 / product, 0.125) : 0.0;
    }
    return reach;
  }();
  return table[size_t(p)];
}

double inversePower(double r2, int p) {
  const double even = 1.0 / r2;
  double power = p % 2 ? std::sqrt(even) : 1.0, square = even;
  for (int n = p / 2; n > 0; n /= 2) {
    if (n % 2) power *= square;
    square *= square;
  }
  return power;
}

struct Line {
  double h2;  // square of the distance from the line, in units
  int p;
  double reach;

  double over(double from, double to) const {
    const double nearest = from > 0 ? from : to < 0 ? -to : 0.0;
    const double half = 0.5 * (to - from), mid = 0.5 * (to + from);
    if (half * half > reach * reach * (h2 + nearest * nearest) && mid > from && mid < to) return over(from, mid) + over(mid, to);
    double sum = 0;
    for (int k = 0; k < 2; ++k)
      for (const double side : {-1.0, 1.0}) {
        const double t = mid + side * kNode[k] * half;
        sum += kWeight[k] * inversePower(h2 + t * t, p);
      }
    return sum * half;
  }
};

}  // namespace

double straightLineConstant(int p) { return std::exp(0.5 * std::log(M_PI) + std::lgamma(0.5 * (p - 1)) - std::lgamma(0.5 * p)); }

double squaredDistanceToSegment(const DVec3& x, const DVec3& a, const DVec3& b) {
  const DVec3 along = b - a, to = x - a;
  const double length2 = glm::dot(along, along);
  const double t = length2 > 0 ? std::clamp(glm::dot(to, along) / length2, 0.0, 1.0) : 0.0;
  const DVec3 rest = to - t * along;
  return glm::dot(rest, rest);
}

double inversePowerIntegral(const DVec3& x, const DVec3& a, const DVec3& b, int p, double unit2) {
  const double length = glm::length(b - a), unit = std::sqrt(unit2);
  if (!(length > 0)) return 0;
  const DVec3 u = (b - a) / length, to = a - x;
  const double from = glm::dot(to, u);
  const DVec3 across = to - from * u;
  // A point on the segment's line, but not on the segment, is at no distance from the line.
  const Line line{std::max(glm::dot(across, across) / unit2, 1e-300), p, reachOf(p)};
  return unit * line.over(from / unit, (from + length) / unit);
}

double averagedDistance(double sum, double length, double unit2, int p, StyleNorm norm) {
  const double unit = std::sqrt(unit2);
  if (norm == StyleNorm::Published) return unit * std::pow(sum / length, -1.0 / p);
  return unit * std::pow(sum / (straightLineConstant(p) * unit), -1.0 / (p - 1));
}

double averagedDistanceTo(std::span<const ContourSegment> contour, const Vec3& x, const Vec3& n, int p, StyleNorm norm, float cosine) {
  const DVec3 at(x);
  double unit2 = -1, length = 0, sum = 0;
  for (const ContourSegment& s : contour)
    if (glm::dot(s.normal, n) >= cosine) {
      const double d2 = squaredDistanceToSegment(at, DVec3(s.a), DVec3(s.b));
      unit2 = unit2 < 0 ? d2 : std::min(unit2, d2);
    }
  if (unit2 <= 0) return unit2 < 0 ? double(kStyleFar) : 0.0;
  for (const ContourSegment& s : contour)
    if (glm::dot(s.normal, n) >= cosine) {
      sum += inversePowerIntegral(at, DVec3(s.a), DVec3(s.b), p, unit2);
      length += glm::length(DVec3(s.b) - DVec3(s.a));
    }
  return averagedDistance(sum, length, unit2, p, norm);
}

}  // namespace filters
}  // namespace gobo
