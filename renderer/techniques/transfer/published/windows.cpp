// SPDX-License-Identifier: Apache-2.0
#include "techniques/transfer/published/windows.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "techniques/transfer/harmonics.h"
#include "techniques/transfer/icosphere.h"

namespace gobo::transfer::published {

namespace {

constexpr double kLeastDamping = 1e-9, kMostDamping = 1e9;
constexpr double kZero = 1e-9;  // of a channel's mean: what counts as 0

/// By vertex, band and channel what the band gives there.
class BandValues {
 public:
  BandValues(const std::vector<double>& coefficients, int bands, int level) : bands_(size_t(bands)) {
    const Icosphere& sphere = icosphere(level);
    std::array<double, kMaxHarmonics> Y;
    values_.reserve(sphere.vertices.size() * bands_);
    for (const DVec3& v : sphere.vertices) {
      harmonics(v, bands, Y.data());
      for (size_t l = 0; l < bands_; ++l) {
        DVec3 sum(0.0);
        for (size_t h = l * l; h < (l + 1) * (l + 1); ++h) sum += Y[h] * DVec3(coefficients[3 * h], coefficients[3 * h + 1], coefficients[3 * h + 2]);
        values_.push_back(sum);
      }
    }
  }
  DVec3 at(size_t vertex, const std::vector<double>& factors) const {
    DVec3 sum(0.0);
    for (size_t l = 0; l < bands_; ++l) sum += factors[l] * values_[vertex * bands_ + l];
    return sum;
  }
  size_t vertices() const { return values_.size() / bands_; }
  /// Nowhere below 0, but for rounding.
  bool positive(const std::vector<double>& factors) const {
    for (size_t v = 0; v < vertices(); ++v) {
      const DVec3 value = at(v, factors), mean = values_[v * bands_];
      for (int c = 0; c < 3; ++c)
        if (value[c] < -kZero * std::fabs(mean[c])) return false;
    }
    return true;
  }

 private:
  size_t bands_;
  std::vector<DVec3> values_;
};

}  // namespace

std::vector<double> windowFactors(Window window, int bands, double damping) {
  std::vector<double> w(static_cast<size_t>(bands), 1.0);
  for (int l = 1; l < bands; ++l) {
    const double x = std::numbers::pi * l / bands, laplacian = double(l) * (l + 1);
    if (window == Window::Hann) w[size_t(l)] = 0.5 * (1 + std::cos(x));
    else if (window == Window::Lanczos) w[size_t(l)] = std::sin(x) / x;
    else if (window == Window::Least) w[size_t(l)] = 1 / (1 + damping * laplacian * laplacian);
  }
  return w;
}

std::vector<double> windowed(const std::vector<double>& coefficients, const std::vector<double>& factors) {
  std::vector<double> out = coefficients;
  for (size_t l = 0; l < factors.size(); ++l)
    for (size_t i = 3 * l * l; i < 3 * (l + 1) * (l + 1); ++i) out[i] *= factors[l];
  return out;
}

DVec3 radianceOf(const std::vector<double>& coefficients, int bands, const DVec3& direction) {
  std::array<double, kMaxHarmonics> Y;
  harmonics(direction, bands, Y.data());
  DVec3 sum(0.0);
  for (size_t h = 0; h < size_t(bands * bands); ++h) sum += Y[h] * DVec3(coefficients[3 * h], coefficients[3 * h + 1], coefficients[3 * h + 2]);
  return sum;
}

std::vector<DVec3> radianceAtVertices(const std::vector<double>& coefficients, int bands, int level) {
  std::vector<DVec3> out;
  for (const DVec3& v : icosphere(level).vertices) out.push_back(radianceOf(coefficients, bands, v));
  return out;
}

double leastDamping(const std::vector<double>& coefficients, int bands, int level) {
  const BandValues values(coefficients, bands, level);
  const auto positive = [&](double s) { return values.positive(windowFactors(Window::Least, bands, s)); };
  if (positive(0)) return 0;
  // From below: what is damped more need not be less negative everywhere, so the first that will do is looked for, then closed in on.
  double below = 0, above = kLeastDamping;
  while (above < kMostDamping && !positive(above)) {
    below = above;
    above *= 2;
  }
  if (above >= kMostDamping) return kMostDamping;
  while (above - below > 1e-3 * above) {
    const double middle = 0.5 * (below + above);
    (positive(middle) ? above : below) = middle;
  }
  return above;
}

}  // namespace gobo::transfer::published
