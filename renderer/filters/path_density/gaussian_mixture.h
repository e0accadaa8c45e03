// SPDX-License-Identifier: Apache-2.0
// Mixtures of Gaussians over the five coordinates of the metric (metric.h), fitted by expectation maximisation (Dempster, Laird & Rubin 1977) in double:
//   p(x) = sum_j w_j N(x; m_j, S_j);   r_ij = w_j N(x_i; m_j, S_j) / p(x_i);   w_j = mean_i r_ij, m_j and S_j the moments under r_ij
// and stepwise (Cappe & Moulines 2009), where the moments of a pass are blended with those so far and no sample is kept.
// Covariances are at least `floor` in every direction: the best ones under that bound have the moments' axes with smaller variances raised to it, so that an
// iteration never makes the samples less likely. Logarithms throughout: no density is too small. A component without samples keeps its place and has no weight.
// The first components are a hard assignment to seeds drawn as greedy k-means++ does (Arthur & Vassilvitskii 2007), distances counting up to 3 so that
// outliers do not take them all. The same bits for the same points in the same order.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace gobo::pathdensity {

inline constexpr size_t kAxes = 5, kTriangle = kAxes * (kAxes + 1) / 2;
using AxisPoint = std::array<double, kAxes>;
using Triangle = std::array<double, kTriangle>;  ///< lower, row by row

/// Lower triangle L with L L^T = m. False: m is not positive definite.
bool choleskyOf(const Triangle& m, Triangle& lower);
/// |L^-1 d|^2.
double squaredBy(const Triangle& lower, const AxisPoint& d);
/// m with eigenvalues below `least` raised to it (Jacobi's rotations).
Triangle withEigenvaluesOf(const Triangle& m, double least);

struct Gaussian {
  double weight = 0;
  AxisPoint mean{};
  Triangle covariance{};
};

/// Of many Gaussians at once: what densities need.
class Mixture {
 public:
  explicit Mixture(std::vector<Gaussian> components = {});
  const std::vector<Gaussian>& components() const { return components_; }
  /// log p(x); responsibilities to `r` if it is not empty. -infinity without components.
  double logDensity(const AxisPoint& x, std::span<double> r = {}) const;

 private:
  std::vector<Gaussian> components_;
  std::vector<Triangle> lower_;
  std::vector<double> logScale_;  // log w_j - log sqrt |2 pi S_j|
};

struct MixtureFit {
  int components = 8;
  int iterations = 12;
  double floor = 0.01;   ///< variance, > 0
  double enough = 1e-4;  ///< ends where the mean log density grows by less
  uint64_t seed = 1;     ///< of the first components
};

class MixtureLearner {
 public:
  MixtureLearner(std::span<const AxisPoint> first, const MixtureFit& fit);  ///< the first components
  const Mixture& mixture() const { return mixture_; }
  /// One iteration; returns the mean log density before it.
  double step(std::span<const AxisPoint> points);
  /// Blends the moments of these points, by `rate` in (0, 1], with those so far.
  void online(std::span<const AxisPoint> points, double rate);

 private:
  struct Moments {
    double mass = 0;
    AxisPoint sum{};
    Triangle product{};
    void add(const AxisPoint& d, double w);
  };
  double expect(std::span<const AxisPoint> points, std::vector<Moments>& moments) const;
  void maximise(const std::vector<Moments>& moments);

  MixtureFit fit_;
  AxisPoint origin_{};  // the first points' mean: moments are about it
  Mixture mixture_;
  std::vector<Moments> moments_;  // of mass 1 together
};

/// Up to fit.iterations of them.
Mixture fitMixture(std::span<const AxisPoint> points, const MixtureFit& fit);

}  // namespace gobo::pathdensity
