// SPDX-License-Identifier: Apache-2.0
#include "scene/environment_tents.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/to_index.h"

namespace gobo {
inline namespace scene {
namespace {

/// Integrals over t from 0 to tau of (1 - t) cos(t step) and (1 - t) sin(t step): the falling half of a tent against the sine of
/// (centre + t step) is sin(centre) * cosine + cos(centre) * sine.
struct Ramp {
  double cosine, sine;
  Ramp(double tau, double step) {
    const double x = tau * step, s = std::sin(x), half = std::sin(0.5 * x), versine = 2.0 * half * half;
    cosine = (1.0 - tau) * s / step + versine / (step * step);
    sine = (versine + tau * (1.0 - versine)) / step - s / (step * step);
  }
};

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

EnvironmentTents::EnvironmentTents(int width, int height)
    : height_(height), step_(std::numbers::pi / height), azimuthStep_(2.0 * std::numbers::pi / width), above_(size_t(height)) {
  const Ramp whole(1.0, step_);
  const double quarter = std::sin(0.25 * step_);
  above_[0] = 2.0 * quarter * quarter;  // the cap above the first row's centres, where the look-up is constant in the polar angle
  for (int y = 1; y < height; ++y) {
    // Angles from the nearer pole: the sine keeps its digits.
    const double centre = (std::min(y, height - 1 - y) + 0.5) * step_, side = 2 * y < height ? 1.0 : -1.0;
    above_[size_t(y)] = step_ * (std::sin(centre) * whole.cosine - side * std::cos(centre) * whole.sine);
  }
}

double EnvironmentTents::polar(int y, double u) const {
  const double target = u * (above(y) + below(y)) - above(y);
  const bool up = target < 0.0;
  const int row = up ? y : height_ - 1 - y;  // as seen from the pole that the sample lies towards
  const double all = above(row), part = std::min(std::fabs(target), all), centre = (row + 0.5) * step_;
  double angle;  // from that pole
  if (row == 0) {
    angle = 2.0 * std::asin(std::sqrt(std::max(0.5 * (all - part), 0.0)));
  } else {
    // The share of the ramp, in q = (1 - tau)^2, is nearly linear: Newton's steps meet nothing flat.
    const double s = std::sin(centre), c = std::cos(centre), share = part / step_;
    double q = 1.0 - part / all, tau = 0.0;
    for (int k = 0; k < 12; ++k) {
      tau = 1.0 - std::sqrt(q);
      const Ramp ramp(tau, step_);
      const double change = 2.0 * (s * ramp.cosine - c * ramp.sine - share) / std::sin(centre - tau * step_);
      q = std::clamp(q + change, 0.0, 1.0);
      if (std::fabs(change) < 1e-13) break;
    }
    angle = centre - (1.0 - std::sqrt(q)) * step_;
  }
  return up ? angle : std::numbers::pi - angle;
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
