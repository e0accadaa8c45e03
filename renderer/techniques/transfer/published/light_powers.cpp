// SPDX-License-Identifier: Apache-2.0
#include "techniques/transfer/published/light_powers.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "techniques/transfer/harmonics.h"
#include "techniques/transfer/published/windows.h"

namespace gobo::transfer::published {

namespace {

/// P_0 .. P_l at x.
std::array<double, kMaxBands + 2> legendrePolynomials(double x) {
  std::array<double, kMaxBands + 2> p{1, x};
  for (size_t l = 1; l + 1 < p.size(); ++l) p[l + 1] = ((2 * double(l) + 1) * x * p[l] - double(l) * p[l - 1]) / (double(l) + 1);
  return p;
}

/// A x = b, row pivots; A is consumed. Near singular systems give large numbers, which the caller bounds.
std::vector<double> solve(std::vector<double> a, std::vector<double> b) {
  const size_t n = b.size();
  for (size_t i = 0; i < n; ++i) {
    size_t pivot = i;
    for (size_t r = i + 1; r < n; ++r)
      if (std::fabs(a[r * n + i]) > std::fabs(a[pivot * n + i])) pivot = r;
    if (a[pivot * n + i] == 0) continue;
    if (pivot != i) {
      std::swap_ranges(a.begin() + long(i * n), a.begin() + long((i + 1) * n), a.begin() + long(pivot * n));
      std::swap(b[i], b[pivot]);
    }
    for (size_t r = i + 1; r < n; ++r) {
      const double f = a[r * n + i] / a[i * n + i];
      for (size_t c = i; c < n; ++c) a[r * n + c] -= f * a[i * n + c];
      b[r] -= f * b[i];
    }
  }
  for (size_t i = n; i-- > 0;) {
    for (size_t c = i + 1; c < n; ++c) b[i] -= a[i * n + c] * b[c];
    b[i] = a[i * n + i] == 0 ? 0.0 : b[i] / a[i * n + i];
  }
  return b;
}

}  // namespace

size_t elbow(const std::vector<double>& differences, double weber) {
  double sum = 0;
  for (size_t k = 0; k < differences.size(); ++k) {
    sum += differences[k];
    if (!(differences[k] > weber * sum)) return k;
  }
  return differences.size();
}

double diskCoefficient(int l, double radius) {
  if (l == 0) return 4 * std::numbers::pi * std::pow(std::sin(0.5 * radius), 2);
  const auto p = legendrePolynomials(std::cos(radius));
  return 2 * std::numbers::pi * (p[size_t(l - 1)] - p[size_t(l + 1)]) / (2 * l + 1);
}

void givePublishedPower(std::vector<PublishedLight>& lights, const std::vector<double>& harmonics, int bands) {
  for (PublishedLight& light : lights) {
    light.radiance = glm::max(light.seen - radianceOf(harmonics, bands, light.direction), DVec3(0.0));
    light.irradiance = light.solidAngle * light.radiance;
  }
}

std::vector<double> giveResidualPower(std::vector<PublishedLight>& lights, const std::vector<double>& full, const std::vector<double>& window, int bands) {
  // radiance_j + P(j) - sum over i of radiance_i (harmonics of disk i, at j) = seen_j; by the addition theorem these are of the angle between the two alone.
  const size_t n = lights.size();
  std::vector<double> system(n * n);
  for (size_t j = 0; j < n; ++j)
    for (size_t i = 0; i < n; ++i) {
      const auto p = legendrePolynomials(std::clamp(glm::dot(lights[i].direction, lights[j].direction), -1.0, 1.0));
      double shown = 0;
      for (int l = 0; l < bands; ++l) shown += window[size_t(l)] * diskCoefficient(l, lights[i].radius) * (2 * l + 1) / (4 * std::numbers::pi) * p[size_t(l)];
      system[j * n + i] = (i == j ? 1.0 : 0.0) - shown;
    }
  const std::vector<double> shownFull = windowed(full, window);
  for (int c = 0; c < 3; ++c) {
    std::vector<double> missing;
    for (const PublishedLight& light : lights) missing.push_back(light.seen[c] - radianceOf(shownFull, bands, light.direction)[c]);
    const std::vector<double> radiance = solve(system, missing);
    for (size_t j = 0; j < n; ++j) lights[j].radiance[c] = std::clamp(std::isfinite(radiance[j]) ? radiance[j] : 0.0, 0.0, lights[j].seen[c]);
  }
  for (PublishedLight& light : lights) light.irradiance = light.solidAngle * light.radiance;
  std::vector<double> rest = full;
  takeOut(rest, bands, lights);
  return rest;
}

void takeOut(std::vector<double>& harmonicsOf, int bands, const std::vector<PublishedLight>& lights) {
  std::array<double, kMaxHarmonics> Y;
  for (const PublishedLight& light : lights) {
    harmonics(light.direction, bands, Y.data());
    for (int l = 0; l < bands; ++l) {
      const double disk = diskCoefficient(l, light.radius);
      for (int h = l * l; h < (l + 1) * (l + 1); ++h)
        for (int c = 0; c < 3; ++c) harmonicsOf[size_t(3 * h + c)] -= disk * Y[size_t(h)] * light.radiance[c];
    }
  }
}

}  // namespace gobo::transfer::published
