// SPDX-License-Identifier: Apache-2.0
#include "scene/environment_tents.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/small_angle.h"
#include "base/to_index.h"

namespace gobo {
inline namespace scene {
namespace {

constexpr double kOver[] = {0.0, 1.0, 1.0 / 2, 1.0 / 3, 1.0 / 4, 1.0 / 5, 1.0 / 6, 1.0 / 7, 1.0 / 8, 1.0 / 9, 1.0 / 10, 1.0 / 11, 1.0 / 12, 1.0 / 13};

}  // namespace
Vec3 interpolateTexels(const Environment& map, double x, double y) {
  const int w = map.width, h = map.height;
  const double fx = x - 0.5, fy = std::clamp(y - 0.5, 0.0, double(h - 1));
  const double cx = std::floor(fx);
  const int x0 = ((toInteger(cx, -(1 << 30), 1 << 30) % w) + w) % w, x1 = x0 + 1 < w ? x0 + 1 : 0, y0 = toIndex(fy, h), y1 = std::min(y0 + 1, h - 1);
  const float a = float(fx - cx), b = float(fy - double(y0));
  const Vec3 *upper = map.texels.begin() + size_t(y0) * w, *lower = map.texels.begin() + size_t(y1) * w;
  // Weighted sums, not differences: texels of 0 and of 1e38 side by side stay finite and non-negative.
  return (upper[x0] * (1.0f - a) + upper[x1] * a) * (1.0f - b) + (lower[x0] * (1.0f - a) + lower[x1] * a) * b;
}

/// Integrals over t from 0 to tau of (1 - t) cos(t step) and (1 - t) sin(t step): the falling half of a tent against the sine of
/// (centre + t step) is sin(centre) * cosine + cos(centre) * sine. With them what else depends on x = tau step.
struct EnvironmentTents::Ramp {
  double cosine, sine;
  SmallAngle x;
};

EnvironmentTents::Ramp EnvironmentTents::ramp(double tau) const {
  const SmallAngle x(tau * step_);
  if (terms_ == 0) {
    const double s = std::sin(tau * step_), half = std::sin(0.5 * tau * step_), versine = 2.0 * half * half;
    return {(1.0 - tau) * s / step_ + versine / (step_ * step_), (versine + tau * (1.0 - versine)) / step_ - s / (step_ * step_), x};
  }
  // Term by term; closed forms cancel where rows are narrow.
  double cosine = 0.0, sine = 0.0, power = tau;
  for (int k = 0; k < terms_; ++k) {
    cosine += cosineTerms_[k] * power * (kOver[2 * k + 1] - tau * kOver[2 * k + 2]);
    power *= tau;
    sine += sineTerms_[k] * power * (kOver[2 * k + 2] - tau * kOver[2 * k + 3]);
    power *= tau;
  }
  return {cosine, sine, x};
}

EnvironmentTents::EnvironmentTents(int width, int height)
    : height_(height), step_(std::numbers::pi / height), azimuthStep_(2.0 * std::numbers::pi / width), above_(size_t(height)), rows_(size_t(height)) {
  const Ramp whole = ramp(1.0);  // closed: weights are in terms of many nodes
  if (step_ < SmallAngle::kMost)
    for (double size = 1.0; terms_ < 6 && std::fabs(size) > 1e-17; ++terms_) {
      cosineTerms_[terms_] = size;
      size *= step_ / (2 * terms_ + 1);
      sineTerms_[terms_] = size;
      size *= -step_ / (2 * terms_ + 2);
    }
  const double quarter = std::sin(0.25 * step_);
  above_[0] = 2.0 * quarter * quarter;  // the cap above the first row's centres, where the look-up is constant in the polar angle
  for (int y = 0; y < height; ++y) {
    // Angles from the nearer pole: the sine keeps its digits.
    const double near = (std::min(y, height - 1 - y) + 0.5) * step_, side = 2 * y < height ? 1.0 : -1.0;
    rows_[size_t(y)] = {(y + 0.5) * step_, std::sin(near), side * std::cos(near)};
    if (y > 0) above_[size_t(y)] = step_ * (rows_[size_t(y)].sine * whole.cosine - rows_[size_t(y)].cosine * whole.sine);
  }
}

EnvironmentTents::Polar EnvironmentTents::polar(int y, double u) const {
  const double target = u * (above(y) + below(y)) - above(y);
  const bool up = target < 0.0;
  const int row = up ? y : height_ - 1 - y;  // as seen from the pole that the sample lies towards
  const double all = above(row), part = std::min(std::fabs(target), all);
  Polar from;  // that pole
  if (row == 0) {
    const double versine = std::max(all - part, 0.0), half = std::sqrt(0.5 * versine);
    from = {2.0 * std::asin(half), 2.0 * half * std::sqrt(1.0 - 0.5 * versine), 1.0 - versine};
  } else {
    // The share of the ramp, in q = (1 - tau)^2, is nearly linear: Newton's steps meet nothing flat.
    const Row& r = rows_[size_t(row)];
    const double share = part / step_;
    double q = 1.0 - part / all;
    for (int k = 0; k < 12; ++k) {
      const Ramp at = ramp(1.0 - std::sqrt(q));
      const double change = 2.0 * (r.sine * at.cosine - r.cosine * at.sine - share) / (r.sine * at.x.cosine - r.cosine * at.x.sine);
      q = std::clamp(q + change, 0.0, 1.0);
      if (std::fabs(change) < 1e-7) break;  // what is left is of the order of its square
    }
    const double tau = 1.0 - std::sqrt(q);
    const SmallAngle x(tau * step_);
    from = {r.centre - tau * step_, r.sine * x.cosine - r.cosine * x.sine, r.cosine * x.cosine + r.sine * x.sine};
  }
  return up ? from : Polar{std::numbers::pi - from.angle, from.sine, -from.cosine};
}

double EnvironmentTents::across(double u) { return u < 0.5 ? std::sqrt(2.0 * u) - 1.0 : 1.0 - std::sqrt(std::max(2.0 - 2.0 * u, 0.0)); }

double environmentFlux(const Environment* map, const StopToken& stop) {
  if (!map || map->texels.empty()) return 0.0;
  const EnvironmentTents tents(map->width, map->height);
  double sum = 0;
  for (int y = 0; y < map->height && !stop.stopRequested(); ++y) {
    double row = 0;
    for (int x = 0; x < map->width; ++x) {
      const Vec3& c = map->texels[size_t(y) * map->width + x];
      row += 0.2126 * c.x + 0.7152 * c.y + 0.0722 * c.z;
    }
    sum += row * tents.weight(y);
  }
  return sum;
}

}  // namespace scene
}  // namespace gobo
