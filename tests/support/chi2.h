// SPDX-License-Identifier: Apache-2.0
// Chi-squared test of a direction sampler against its density. Bins cover the sphere, or a cone around an axis, in equal
// solid angles (cos theta x phi); the expected count of a bin is the quadrature of the density over it. What the
// sampler refuses, and what falls outside the cone, is one more bin that expects N (1 - integral): a density whose integral
// does not fit the accepted share fails as well. Bins that expect fewer than five are pooled.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "base/sobol.h"
#include "base/vec.h"

namespace gobo::test {

/// Independent uniform numbers; chi-squared and t-tests need independence, which low-discrepancy points lack.
class Rng {
 public:
  explicit Rng(uint64_t seed) : seed_(seed) {}
  float next() { return toUnit(hash32(seed_, counter_++)); }
  Vec2 next2() {
    const float x = next();
    return Vec2(x, next());
  }

 private:
  uint64_t seed_, counter_ = 0;
};

/// Upper regularised incomplete gamma function Q(a, x): series below a + 1, Lentz's continued fraction above.
inline double gammaQ(double a, double x) {
  if (x <= 0) return 1.0;
  const double scale = std::exp(-x + a * std::log(x) - std::lgamma(a));
  if (x < a + 1.0) {
    double term = 1.0 / a, sum = term;
    for (double n = a + 1.0; std::fabs(term) > 1e-15 * sum; n += 1.0) sum += term *= x / n;
    return 1.0 - sum * scale;
  }
  double b = x + 1.0 - a, c = 1e300, d = 1.0 / b, h = d;
  for (int i = 1; i < 10000; ++i) {
    const double an = -i * (i - a);
    b += 2.0;
    d = 1.0 / (an * d + b);
    c = b + an / c;
    h *= c * d;
    if (std::fabs(c * d - 1.0) < 1e-15) break;
  }
  return scale * h;
}

/// Part of the sphere: directions within 1 - cos <= span of the axis.
struct SphereDomain {
  Vec3 axis{0, 0, 1};
  double span = 2.0;
  int rows = 20, columns = 40;
};

/// Direction at s = (1 - cos)/span and phi; double inside, so that cones of a microradian keep their shape. `f`: of the domain's axis. Millions are asked
/// for, and tests are compiled without optimisation: plain numbers.
inline Vec3 domainDirection(const SphereDomain& d, const Frame& f, double s, double phi) {
  const double m = s * d.span, sine = std::sqrt(std::max(m * (2.0 - m), 0.0)), a = sine * std::cos(phi), b = sine * std::sin(phi), c = 1.0 - m;
  const double x = a * double(f.x.x) + b * double(f.y.x) + c * double(f.z.x), y = a * double(f.x.y) + b * double(f.y.y) + c * double(f.z.y),
               z = a * double(f.x.z) + b * double(f.y.z) + c * double(f.z.z), scale = 1.0 / std::sqrt(x * x + y * y + z * z);
  return Vec3(float(x * scale), float(y * scale), float(z * scale));
}
inline Vec3 domainDirection(const SphereDomain& d, double s, double phi) { return domainDirection(d, Frame(d.axis), s, phi); }

/// Integral over [x0,x1] x [y0,y1], 3 x 3 Gauss points, halved in both directions until two levels agree, but at least twice
/// `atLeast` + 1 times (a light's edge may slip between the points of the first levels: the more so the flatter the density beside it).
template <class F>
struct Quadrature2D {
  const F& f;
  int surely;  ///< halved as long as more are left

  double rule(double a, double b, double c, double d) const {
    static constexpr double at[3] = {0.5 - 0.5 * 0.774596669241483377, 0.5, 0.5 + 0.5 * 0.774596669241483377};
    static constexpr double weight[3] = {5.0 / 18, 8.0 / 18, 5.0 / 18};
    double sum = 0;
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) sum += weight[i] * weight[j] * f(a + at[i] * (b - a), c + at[j] * (d - c));
    return sum * (b - a) * (d - c);
  }
  double go(double a, double b, double c, double d, double whole, double tol, int left) const {
    const double xm = 0.5 * (a + b), ym = 0.5 * (c + d);
    const double q[4] = {rule(a, xm, c, ym), rule(xm, b, c, ym), rule(a, xm, ym, d), rule(xm, b, ym, d)};
    const double sum = q[0] + q[1] + q[2] + q[3];
    if (left <= 0 || (left <= surely && std::fabs(sum - whole) <= tol)) return sum;
    return go(a, xm, c, ym, q[0], 0.4 * tol, left - 1) + go(xm, b, c, ym, q[1], 0.4 * tol, left - 1) + go(a, xm, ym, d, q[2], 0.4 * tol, left - 1) +
           go(xm, b, ym, d, q[3], 0.4 * tol, left - 1);
  }
};
template <class F>
double integrate2D(const F& f, double x0, double x1, double y0, double y1, double tolerance, int depth, int atLeast = 1) {
  const Quadrature2D<F> q{f, depth - atLeast};
  return q.go(x0, x1, y0, y1, q.rule(x0, x1, y0, y1), tolerance, depth);
}

/// Integral of f(direction) over the cells of a domain, row-major.
inline std::vector<double> integrateCells(const SphereDomain& d, const std::function<double(const Vec3&)>& f, double tolerance = 2e-6, int depth = 5,
                                          int atLeast = 1) {
  std::vector<double> cells(size_t(d.rows) * d.columns);
  const double dp = 2.0 * 3.14159265358979323846 / d.columns, ds = 1.0 / d.rows;
  const Frame frame(d.axis);
  const auto g = [&](double s, double phi) { return f(domainDirection(d, frame, s, phi)) * d.span; };
  for (int r = 0; r < d.rows; ++r)
    for (int c = 0; c < d.columns; ++c)
      cells[size_t(r) * d.columns + c] = integrate2D(g, r * ds, (r + 1) * ds, c * dp, (c + 1) * dp, tolerance, depth, atLeast);
  return cells;
}
inline double integrateSphere(const SphereDomain& d, const std::function<double(const Vec3&)>& f, double tolerance = 2e-6, int depth = 5) {
  double sum = 0;
  for (double c : integrateCells(d, f, tolerance, depth)) sum += c;
  return sum;
}

struct Chi2Result {
  double p = 0, statistic = 0, integral = 0;  ///< integral of the density over the domain
  int degrees = 0, samples = 0, refused = 0;
};

/// sample(rng, direction) returns false when it refuses. density(direction) over solid angle; `depth`: halvings of a bin, more
/// for densities with edges.
inline Chi2Result chi2Test(const SphereDomain& d, int samples, uint64_t seed, const std::function<bool(Rng&, Vec3&)>& sample,
                           const std::function<double(const Vec3&)>& density, int depth = 5, int atLeast = 1) {
  Chi2Result r;
  r.samples = samples;
  // To a quarter of a count: nothing beside the square root of five, which is the noise of the least bin.
  std::vector<double> expected = integrateCells(d, density, std::max(2e-6, 0.25 / samples), depth, atLeast);
  std::vector<double> observed(expected.size() + 1, 0.0);
  for (double& e : expected) {
    r.integral += e;
    e *= samples;
  }
  expected.push_back(std::max(samples * (1.0 - r.integral), 0.0));
  Rng rng(seed);
  const Frame frame(d.axis);
  for (int i = 0; i < samples; ++i) {
    Vec3 w;
    size_t bin = expected.size() - 1;
    if (!sample(rng, w)) {
      ++r.refused;
    } else {
      // 1 - cos from the chord, which does not cancel for narrow cones.
      const DVec3 chord = DVec3(w) - DVec3(d.axis);
      const double s = 0.5 * glm::dot(chord, chord) / d.span;
      double phi = std::atan2(glm::dot(DVec3(w), DVec3(frame.y)), glm::dot(DVec3(w), DVec3(frame.x))) / (2.0 * 3.14159265358979323846);
      phi -= std::floor(phi);
      const int row = std::min(int(s * d.rows), d.span >= 2.0 ? d.rows - 1 : d.rows);
      if (row < d.rows) bin = size_t(row) * d.columns + std::min(int(phi * d.columns), d.columns - 1);
    }
    observed[bin] += 1.0;
  }
  // Pool the smallest expectations until each pool holds five.
  std::vector<size_t> order(expected.size());
  for (size_t i = 0; i < order.size(); ++i) order[i] = i;
  std::sort(order.begin(), order.end(), [&](size_t a, size_t b) { return expected[a] < expected[b]; });
  double e = 0, o = 0;
  int cells = 0;
  for (size_t i = 0; i < order.size(); ++i) {
    e += expected[order[i]];
    o += observed[order[i]];
    if (e < 5.0 && i + 1 < order.size()) continue;
    if (e < 0.05) {  // nothing expected at all: a few strays are quadrature's, many are a failure
      if (o > 5.0) r.statistic += 1e9;
    } else {
      r.statistic += (o - e) * (o - e) / e;
      ++cells;
    }
    e = o = 0;
  }
  r.degrees = std::max(cells - 1, 1);
  r.p = gammaQ(0.5 * r.degrees, 0.5 * r.statistic);
  return r;
}

/// Significance of one of n tests so that all together have 1 % (Sidak).
inline double sidak(int n, double alpha = 0.01) { return 1.0 - std::pow(1.0 - alpha, 1.0 / n); }

/// Mean and its standard error of independent values.
class Moments {
 public:
  void add(double x) {
    ++n_;
    const double d = x - mean_;
    mean_ += d / n_;
    m2_ += d * (x - mean_);
  }
  double mean() const { return mean_; }
  double deviation() const { return std::sqrt(m2_ / std::max(n_ - 1.0, 1.0)); }
  double error() const { return deviation() / std::sqrt(std::max(n_, 1.0)); }

 private:
  double n_ = 0, mean_ = 0, m2_ = 0;
};

}  // namespace gobo::test
