// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/target_shape.h"

#include <algorithm>
#include <cmath>

#include "base/check.h"

namespace gobo {
inline namespace filters {

namespace {

constexpr double kSquareCorner = 1.0 - 1e-9;  // angularity from which the rounding of corners is below double's
constexpr int kFalsiSteps = 8;

}  // namespace

TargetShape::TargetShape(double A, double B, double angularity) : A_(A), B_(B), p_(2.0 / (1.0 + angularity)), rectangle_(angularity > kSquareCorner) {
  GOBO_CHECK(A > 0 && B > 0 && angularity >= 0 && angularity <= 1);
  for (int k = 0; k <= kEach; ++k) phi_[size_t(k)] = float(0.5 * M_PI * k / kEach);
  for (int k = 0; k < kEach; ++k) {
    const double psi = 0.5 * M_PI * (k + 0.5) / kEach;
    phi_[size_t(kEach + 1 + k)] = float(std::atan2(A * std::sin(psi), B * std::cos(psi)));
  }
  std::sort(phi_.begin(), phi_.end());
  for (size_t k = 0; k < phi_.size(); ++k) {
    const double c = std::max(std::cos(double(phi_[k])), 0.0), s = std::sin(double(phi_[k]));
    cos_[k] = float(c), sin_[k] = float(s), h_[k] = float(support(c, s) / std::max(A, B));
  }
}

double TargetShape::areaOf(double A, double B, double angularity) {
  const double inverse = 0.5 * (1.0 - angularity);
  return 4 * A * B * std::exp(2 * std::lgamma(1 + inverse) - std::lgamma(1 + 2 * inverse));
}

TargetShape TargetShape::ofArea(double area, double alongU, double alongV, double angularity) {
  const double unit = std::sqrt(area / areaOf(1, 1, angularity)), ratio = std::sqrt(alongU / alongV);
  return TargetShape(unit * ratio, unit / ratio, angularity);
}

double TargetShape::reach() const { return std::hypot(A_, B_); }

double TargetShape::support(double c, double s) const {
  const double a = A_ * c, b = B_ * s;
  if (p_ == 2.0) return std::hypot(a, b);
  const double most = std::max(a, b), least = std::min(a, b);
  return most * std::pow(1.0 + std::pow(least / most, p_), 1.0 / p_);
}

double TargetShape::slope(double c, double s) const {
  const double a = A_ * c, b = B_ * s, h = support(c, s);
  if (p_ == 2.0) return (b * B_ * c - a * A_ * s) / h;
  return std::pow(b / h, p_ - 1.0) * B_ * c - std::pow(a / h, p_ - 1.0) * A_ * s;
}

double TargetShape::distance(double u, double v) const {
  u = std::abs(u), v = std::abs(v);
  if (rectangle_) return std::hypot(std::max(u - A_, 0.0), std::max(v - B_, 0.0)) + std::min(std::max(u - A_, v - B_), 0.0);
  size_t at = 0;
  const float x = float(u / std::max(A_, B_)), y = float(v / std::max(A_, B_));
  float best = -HUGE_VALF;
  for (size_t k = 0; k < phi_.size(); ++k)
    if (const float g = x * cos_[k] + y * sin_[k] - h_[k]; g > best) best = g, at = k;
  const auto height = [&](double phi) {
    const double c = std::max(std::cos(phi), 0.0), s = std::sin(phi);
    return u * c + v * s - support(c, s);
  };
  double most = std::max({height(double(phi_[at])), u - A_, v - B_});
  // Where the slope changes its sign about the best direction the maximum is between.
  double low = double(phi_[at > 0 ? at - 1 : 0]), high = double(phi_[std::min(at + 1, phi_.size() - 1)]);
  const auto rise = [&](double phi) {
    const double c = std::max(std::cos(phi), 0.0), s = std::sin(phi);
    return v * c - u * s - slope(c, s);
  };
  double before = rise(low), after = rise(high);
  if (!(before > 0 && after < 0)) return most;
  int last = 0;  // the side that moved: one that stays counts half (Illinois)
  for (int k = 0; k < kFalsiSteps; ++k) {
    const double phi = (low * after - high * before) / (after - before), here = rise(phi);
    most = std::max(most, height(phi));
    if (here == 0) break;
    if (here > 0) {
      low = phi, before = here;
      if (last > 0) after *= 0.5;
      last = 1;
    } else {
      high = phi, after = here;
      if (last < 0) before *= 0.5;
      last = -1;
    }
  }
  return most;
}

}  // namespace filters
}  // namespace gobo
