// SPDX-License-Identifier: Apache-2.0
// Noisy pictures of known truth, for tests of denoisers that look at neighbours.
#pragma once

#include <cmath>
#include <functional>
#include <vector>

#include "base/sobol.h"
#include "filters/denoise/denoiser.h"

namespace gobo::denoisespatial {

inline float noise01(uint64_t seed, uint64_t i) { return toUnit(hash32(seed, i)); }

/// A plane that faces the camera, a pixel 1 cm wide, with light 1; all may be changed.
struct SpatialPicture {
  int width, height;
  std::vector<float> mean, a, b, variance, albedo, normal, position, depth, footprint, coverage, even, curvature, alpha, blur;  // the last two may be empty
  bool halves = true;
  SpatialPicture(int w, int h) : width(w), height(h) {
    const size_t n = size_t(w) * size_t(h);
    mean.assign(3 * n, 1.0f);
    a = b = mean;
    variance.assign(3 * n, 0.0f);
    albedo.assign(3 * n, 0.5f);
    normal.assign(3 * n, 0.0f);
    position.assign(3 * n, 0.0f);
    depth.assign(n, 1.0f);
    footprint.assign(n, 0.01f);
    coverage.assign(n, 1.0f);
    even.assign(n, 1.0f);
    curvature.assign(n, 1e-3f);
    for (size_t i = 0; i < n; ++i) {
      normal[3 * i + 2] = 1.0f;
      position[3 * i] = 0.01f * float(i % size_t(w));
      position[3 * i + 1] = 0.01f * float(i / size_t(w));
    }
  }
  size_t pixels() const { return size_t(width) * size_t(height); }
  size_t at(int x, int y) const { return size_t(y) * size_t(width) + size_t(x); }
  /// Halves with noise of `sigma` (standard deviation of the mean, relative to `truth`), uniform, apart in channels; `variance` is the true one.
  void light(uint64_t seed, float sigma, const std::function<float(int x, int y, int c)>& truth) {
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x)
        for (int c = 0; c < 3; ++c) {
          const size_t i = 3 * at(x, y) + size_t(c);
          const float t = truth(x, y, c), s = std::fabs(t) * sigma * std::sqrt(2.0f) * std::sqrt(12.0f);  // of a half, by that of a uniform number
          // All channels of a pixel err alike, as those of paths do.
          a[i] = t + s * (noise01(seed, 2 * at(x, y)) - 0.5f);
          b[i] = t + s * (noise01(seed, 2 * at(x, y) + 1) - 0.5f);
          mean[i] = 0.5f * (a[i] + b[i]);
          variance[i] = t * t * sigma * sigma;
        }
  }
  denoise::NoisyPicture view() const {
    return {width,  height,   mean,  halves ? a : mean, halves ? b : mean, variance, halves,    0.5f,  albedo,
            normal, position, depth, footprint,         coverage,          even,     curvature, alpha, blur};
  }
  /// Columns x0 .. x1 and rows y0 .. y1, ends not included.
  SpatialPicture part(int x0, int y0, int x1, int y1) const {
    SpatialPicture p(x1 - x0, y1 - y0);
    p.halves = halves;
    const auto cut = [&](const std::vector<float>& from, std::vector<float>& to, size_t channels) {
      for (int y = y0; y < y1; ++y)
        for (int x = x0; x < x1; ++x)
          for (size_t c = 0; c < channels; ++c) to[channels * p.at(x - x0, y - y0) + c] = from[channels * at(x, y) + c];
    };
    cut(mean, p.mean, 3), cut(a, p.a, 3), cut(b, p.b, 3), cut(variance, p.variance, 3), cut(albedo, p.albedo, 3), cut(normal, p.normal, 3);
    cut(position, p.position, 3), cut(depth, p.depth, 1), cut(footprint, p.footprint, 1), cut(coverage, p.coverage, 1);
    cut(even, p.even, 1), cut(curvature, p.curvature, 1);
    if (!alpha.empty()) p.alpha.assign(p.coverage.size(), 0.0f), cut(alpha, p.alpha, 1);
    if (!blur.empty()) p.blur.assign(p.coverage.size(), 0.0f), cut(blur, p.blur, 1);
    return p;
  }
};

/// Facets with normals, offsets, albedos and light of their own, on all of them slight unevenness; holes without coverage; some normals that cancel out.
inline SpatialPicture facets(int width, int height, uint64_t seed) {
  SpatialPicture p(width, height);
  const auto facet = [](int x, int y) { return uint64_t(x / 9 + 100 * (y / 7)); };
  p.light(seed, 0.3f, [&](int x, int y, int c) { return 0.2f + 3 * noise01(seed + 1, 3 * facet(x, y) + uint64_t(c)); });
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const size_t i = p.at(x, y);
      const uint64_t f = facet(x, y);
      const float tilt = noise01(seed + 2, f) - 0.5f, lean = noise01(seed + 3, f) - 0.5f, length = 0.6f + 0.4f * noise01(seed + 4, i);
      const float rough = 0.05f * (noise01(seed + 5, i) - 0.5f), norm = std::sqrt(1 + tilt * tilt + (lean + rough) * (lean + rough));
      p.normal[3 * i] = length * tilt / norm;
      p.normal[3 * i + 1] = length * (lean + rough) / norm;
      p.normal[3 * i + 2] = length / norm;
      p.position[3 * i + 2] = 0.04f * noise01(seed + 6, f) + 0.01f * (noise01(seed + 7, i) - 0.5f);
      p.footprint[i] = 0.01f * (0.8f + 0.4f * noise01(seed + 8, i));
      for (size_t c = 0; c < 3; ++c) p.albedo[3 * i + c] = 0.2f + 0.2f * noise01(seed + 9, 3 * f + c);
      if (noise01(seed + 10, f) < 0.15f) p.coverage[i] = 0;  // what else is known of it must not matter
      if (noise01(seed + 11, i) < 0.02f) p.normal[3 * i] = p.normal[3 * i + 1] = p.normal[3 * i + 2] = 0;
      if (noise01(seed + 12, i) < 0.02f) p.footprint[i] = 0;
      if (noise01(seed + 13, i) < 0.1f) p.even[i] = 0;
      p.curvature[i] = 0.02f * noise01(seed + 14, f) * noise01(seed + 15, i);
    }
  return p;
}

struct Denoised {
  std::vector<float> a, b;
};
inline Denoised denoised(const denoise::Denoiser& filter, const SpatialPicture& p, int threads = 2) {
  const float unset = -12345.0f;
  Denoised out{std::vector<float>(p.mean.size(), unset), std::vector<float>(p.mean.size(), unset)};
  const TaskArena arena(threads);
  if (!filter.run(p.view(), out.a, out.b, arena, StopToken())) out = {};
  return out;
}

}  // namespace gobo::denoisespatial
