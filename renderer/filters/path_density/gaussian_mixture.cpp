// SPDX-License-Identifier: Apache-2.0
#include "filters/path_density/gaussian_mixture.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/sobol.h"

namespace gobo::pathdensity {

namespace {

constexpr double kMostSeedDistance = 3;  // of a seed's choice
constexpr uint64_t kSeedDraws = 4;
constexpr double kNoMass = 1e-12;  // of all points: less is rounding

constexpr size_t triangleAt(size_t i, size_t j) { return i * (i + 1) / 2 + j; }  // j <= i

double squaredApart(const AxisPoint& a, const AxisPoint& b) {
  double sum = 0;
  for (size_t i = 0; i < kAxes; ++i) sum += (a[i] - b[i]) * (a[i] - b[i]);
  return sum;
}

/// The point at `target` of the sum of `away`.
size_t drawn(const std::vector<double>& away, double target) {
  size_t chosen = 0;
  for (size_t i = 0; i < away.size(); ++i) {
    if (away[i] <= 0) continue;
    chosen = i;  // rounding may leave the last one
    target -= away[i];
    if (target < 0) break;
  }
  return chosen;
}

/// Seeds: any point, then by the squared distance to those that are there, capped, of several draws the one that leaves the least of it; fewer where points
/// are no more.
std::vector<AxisPoint> seedsOf(std::span<const AxisPoint> points, const MixtureFit& fit) {
  std::vector<AxisPoint> seeds;
  if (points.empty()) return seeds;
  std::vector<double> away(points.size(), kMostSeedDistance * kMostSeedDistance), then, best;
  const auto with = [&](const AxisPoint& seed, std::vector<double>& out) {
    double all = 0;
    out.resize(points.size());
    for (size_t i = 0; i < points.size(); ++i) {
      out[i] = std::min(away[i], squaredApart(points[i], seed));
      all += out[i];
    }
    return all;
  };
  seeds.push_back(points[size_t(hash64(fit.seed, 0) % points.size())]);
  double all = with(seeds[0], best);
  away.swap(best);
  while (seeds.size() < size_t(std::max(fit.components, 1)) && all > 0) {
    double least = std::numeric_limits<double>::infinity();
    size_t chosen = 0;
    for (uint64_t draw = 0; draw < kSeedDraws; ++draw) {
      const size_t at = drawn(away, double(hash64(fit.seed, kSeedDraws * seeds.size() + draw) >> 11) * 0x1p-53 * all);
      const double left = with(points[at], then);
      if (left >= least) continue;
      least = left;
      chosen = at;
      best.swap(then);
    }
    seeds.push_back(points[chosen]);
    away.swap(best);
    all = least;
  }
  return seeds;
}

}  // namespace

bool choleskyOf(const Triangle& m, Triangle& lower) {
  for (size_t i = 0; i < kAxes; ++i)
    for (size_t j = 0; j <= i; ++j) {
      double v = m[triangleAt(i, j)];
      for (size_t k = 0; k < j; ++k) v -= lower[triangleAt(i, k)] * lower[triangleAt(j, k)];
      if (i == j && !(v > 0)) return false;
      lower[triangleAt(i, j)] = i == j ? std::sqrt(v) : v / lower[triangleAt(j, j)];
    }
  return true;
}

double squaredBy(const Triangle& lower, const AxisPoint& d) {
  AxisPoint z{};
  double sum = 0;
  for (size_t i = 0; i < kAxes; ++i) {
    double v = d[i];
    for (size_t k = 0; k < i; ++k) v -= lower[triangleAt(i, k)] * z[k];
    z[i] = v / lower[triangleAt(i, i)];
    sum += z[i] * z[i];
  }
  return sum;
}

Triangle withEigenvaluesOf(const Triangle& m, double least) {
  double a[kAxes][kAxes], v[kAxes][kAxes] = {};
  for (size_t i = 0; i < kAxes; ++i) {
    v[i][i] = 1;
    for (size_t j = 0; j < kAxes; ++j) a[i][j] = m[triangleAt(std::max(i, j), std::min(i, j))];
  }
  for (int sweep = 0; sweep < 30; ++sweep) {
    double off = 0, diagonal = 0;
    for (size_t i = 0; i < kAxes; ++i)
      for (size_t j = 0; j < kAxes; ++j) (i == j ? diagonal : off) += a[i][j] * a[i][j];
    if (off <= 1e-30 * diagonal) break;
    for (size_t p = 0; p + 1 < kAxes; ++p)
      for (size_t q = p + 1; q < kAxes; ++q) {
        if (a[p][q] == 0) continue;
        const double theta = (a[q][q] - a[p][p]) / (2 * a[p][q]);
        const double t = (theta >= 0 ? 1.0 : -1.0) / (std::abs(theta) + std::sqrt(theta * theta + 1)), c = 1 / std::sqrt(t * t + 1), s = t * c;
        for (size_t k = 0; k < kAxes; ++k) {
          const double kp = a[k][p], kq = a[k][q];
          a[k][p] = c * kp - s * kq;
          a[k][q] = s * kp + c * kq;
        }
        for (size_t k = 0; k < kAxes; ++k) {
          const double pk = a[p][k], qk = a[q][k], vp = v[k][p], vq = v[k][q];
          a[p][k] = c * pk - s * qk;
          a[q][k] = s * pk + c * qk;
          v[k][p] = c * vp - s * vq;
          v[k][q] = s * vp + c * vq;
        }
      }
  }
  Triangle out{};
  for (size_t i = 0; i < kAxes; ++i)
    for (size_t j = 0; j <= i; ++j)
      for (size_t k = 0; k < kAxes; ++k) out[triangleAt(i, j)] += std::max(a[k][k], least) * v[i][k] * v[j][k];
  return out;
}

Mixture::Mixture(std::vector<Gaussian> components) : components_(std::move(components)) {
  for (const Gaussian& g : components_) {
    Triangle lower{};
    double scale = -std::numeric_limits<double>::infinity();
    if (g.weight > 0 && choleskyOf(g.covariance, lower)) {
      scale = std::log(g.weight) - 0.5 * double(kAxes) * std::log(2 * M_PI);
      for (size_t i = 0; i < kAxes; ++i) scale -= std::log(lower[triangleAt(i, i)]);
    }
    lower_.push_back(lower);
    logScale_.push_back(scale);
  }
}

double Mixture::logDensity(const AxisPoint& x, std::span<double> r) const {
  constexpr double kNever = -std::numeric_limits<double>::infinity();
  constexpr size_t kOnStack = 64;
  double small[kOnStack];
  std::vector<double> large(components_.size() > kOnStack ? components_.size() : 0);
  double* const logs = large.empty() ? small : large.data();
  double most = kNever;
  for (size_t j = 0; j < components_.size(); ++j) {
    logs[j] = logScale_[j];
    if (logs[j] == kNever) continue;
    AxisPoint d;
    for (size_t i = 0; i < kAxes; ++i) d[i] = x[i] - components_[j].mean[i];
    logs[j] -= 0.5 * squaredBy(lower_[j], d);
    most = std::max(most, logs[j]);
  }
  std::fill(r.begin(), r.end(), 0.0);
  if (most == kNever) return kNever;
  double sum = 0;
  for (size_t j = 0; j < components_.size(); ++j) {
    const double part = logs[j] - most < -700 ? 0.0 : std::exp(logs[j] - most);
    sum += part;
    if (!r.empty()) r[j] = part;
  }
  for (double& v : r) v /= sum;
  return most + std::log(std::max(sum, 1.0));  // the most likely one counts 1
}

void MixtureLearner::Moments::add(const AxisPoint& d, double w) {
  mass += w;
  for (size_t i = 0; i < kAxes; ++i) {
    const double wd = w * d[i];
    sum[i] += wd;
    for (size_t j = 0; j <= i; ++j) product[triangleAt(i, j)] += wd * d[j];
  }
}

MixtureLearner::MixtureLearner(std::span<const AxisPoint> first, const MixtureFit& fit) : fit_(fit) {
  const auto seeds = seedsOf(first, fit);
  if (seeds.empty()) return;
  for (const AxisPoint& p : first)
    for (size_t i = 0; i < kAxes; ++i) origin_[i] += p[i] / double(first.size());
  moments_.resize(seeds.size());
  for (const AxisPoint& p : first) {
    size_t nearest = 0;
    for (size_t j = 1; j < seeds.size(); ++j)
      if (squaredApart(p, seeds[j]) < squaredApart(p, seeds[nearest])) nearest = j;
    AxisPoint d;
    for (size_t i = 0; i < kAxes; ++i) d[i] = p[i] - origin_[i];
    moments_[nearest].add(d, 1.0 / double(first.size()));
  }
  mixture_ = Mixture(std::vector<Gaussian>(seeds.size()));
  maximise(moments_);
}

/// Moments of mass 1 together; the mean log density.
double MixtureLearner::expect(std::span<const AxisPoint> points, std::vector<Moments>& moments) const {
  moments.assign(mixture_.components().size(), {});
  std::vector<double> r(moments.size());
  double sum = 0;
  for (const AxisPoint& p : points) {
    sum += mixture_.logDensity(p, r);
    AxisPoint d;
    for (size_t i = 0; i < kAxes; ++i) d[i] = p[i] - origin_[i];
    for (size_t j = 0; j < r.size(); ++j)
      if (r[j] > 0) moments[j].add(d, r[j] / double(points.size()));
  }
  return points.empty() ? 0.0 : sum / double(points.size());
}

void MixtureLearner::maximise(const std::vector<Moments>& moments) {
  std::vector<Gaussian> next = mixture_.components();
  double all = 0;
  for (const Moments& m : moments) all += m.mass;
  for (size_t j = 0; j < next.size(); ++j) {
    const Moments& m = moments[j];
    Gaussian& g = next[j];
    g.weight = m.mass > kNoMass * all ? m.mass / all : 0.0;
    if (g.weight <= 0) continue;
    AxisPoint mean;
    for (size_t i = 0; i < kAxes; ++i) {
      mean[i] = m.sum[i] / m.mass;
      g.mean[i] = origin_[i] + mean[i];
    }
    Triangle beyond, lower;
    for (size_t i = 0; i < kAxes; ++i)
      for (size_t k = 0; k <= i; ++k) {
        g.covariance[triangleAt(i, k)] = m.product[triangleAt(i, k)] / m.mass - mean[i] * mean[k];
        beyond[triangleAt(i, k)] = g.covariance[triangleAt(i, k)] - (i == k ? fit_.floor : 0.0);
      }
    if (!choleskyOf(beyond, lower)) g.covariance = withEigenvaluesOf(g.covariance, fit_.floor);
  }
  mixture_ = Mixture(std::move(next));
}

double MixtureLearner::step(std::span<const AxisPoint> points) {
  if (points.empty() || mixture_.components().empty()) return 0.0;
  const double before = expect(points, moments_);
  maximise(moments_);
  return before;
}

void MixtureLearner::online(std::span<const AxisPoint> points, double rate) {
  if (points.empty() || mixture_.components().empty()) return;
  std::vector<Moments> fresh;
  expect(points, fresh);
  for (size_t j = 0; j < fresh.size(); ++j) {
    Moments& m = moments_[j];
    m.mass += rate * (fresh[j].mass - m.mass);
    for (size_t i = 0; i < kAxes; ++i) m.sum[i] += rate * (fresh[j].sum[i] - m.sum[i]);
    for (size_t i = 0; i < kTriangle; ++i) m.product[i] += rate * (fresh[j].product[i] - m.product[i]);
  }
  maximise(moments_);
}

Mixture fitMixture(std::span<const AxisPoint> points, const MixtureFit& fit) {
  MixtureLearner learner(points, fit);
  double last = -std::numeric_limits<double>::infinity();
  for (int i = 0; i < fit.iterations; ++i) {
    const double now = learner.step(points);
    if (now - last < fit.enough) break;
    last = now;
  }
  return learner.mixture();
}

}  // namespace gobo::pathdensity
