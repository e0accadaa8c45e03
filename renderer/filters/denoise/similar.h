// SPDX-License-Identifier: Apache-2.0
// How alike the surfaces of two pixels are, from what the camera sees without noise.
#pragma once

#include <algorithm>
#include <cmath>
#include <span>

#include "terms/term_shape.h"

namespace gobo::denoise {

/// Planes of the term "denoise_features" (features.h).
struct Features {
  std::span<const float> albedo, normal, position, depth, footprint, coverage;
};
inline Features featuresOf(const Term& t) {
  return {t.floats("albedo"), t.floats("normal"), t.floats("position"), t.floats("depth"), t.floats("footprint"), t.floats("coverage")};
}
inline void readFeatures(Wiring& w, size_t input, const Extent& extent) {
  w.over(input, extent).reads<float>(input, "albedo", {3}).reads<float>(input, "normal", {3}).reads<float>(input, "position", {3});
  w.reads<float>(input, "depth").reads<float>(input, "footprint").reads<float>(input, "coverage");
}

/// Exponents: -1/2 (difference / standard deviation)^2 each; 0 leaves a feature out.
struct Alike {
  float perAlbedo = 0;  ///< 1 / (2 sigma^2)
  float perNormal = 0;  ///< of 2 (1 - cosine), the square of a small angle
  float perPlane = 0;   ///< of the distance from the tangent plane in pixel widths
};
/// Same surface, roughly: normals within 20 degrees or so, planes within 3 pixels.
inline constexpr Alike kLoosely{0.0f, 4.0f, 0.06f};

/// In [0, 1], symmetric. 1 where neither pixel shows a surface, 0 where one does.
inline float similarity(const Features& f, size_t p, size_t q, const Alike& by) {
  const bool hitP = f.coverage[p] > 0, hitQ = f.coverage[q] > 0;
  if (!hitP || !hitQ) return hitP == hitQ ? 1.0f : 0.0f;
  const float *n = &f.normal[3 * p], *m = &f.normal[3 * q], *x = &f.position[3 * p], *y = &f.position[3 * q];
  float albedo = 0, dot = 0, nn = 0, mm = 0, alongP = 0, alongQ = 0;
  for (int c = 0; c < 3; ++c) {
    const float d = f.albedo[3 * p + size_t(c)] - f.albedo[3 * q + size_t(c)];
    albedo += d * d;
    dot += n[c] * m[c];
    nn += n[c] * n[c];
    mm += m[c] * m[c];
    alongP += n[c] * (y[c] - x[c]);
    alongQ += m[c] * (y[c] - x[c]);
  }
  const float lengths = std::sqrt(nn * mm), turned = lengths > 1e-12f ? std::max(1.0f - dot / lengths, 0.0f) : 0.0f;
  // The farther of both planes, in widths of the wider pixel.
  const float width = std::max(f.footprint[p], f.footprint[q]) * std::sqrt(std::max(std::min(nn, mm), 1e-12f));
  const float apart = width > 0 ? std::min(std::max(std::abs(alongP), std::abs(alongQ)) / width, 1e9f) : 0.0f;
  return std::exp(-by.perAlbedo * albedo - by.perNormal * 2.0f * turned - by.perPlane * apart * apart);
}

}  // namespace gobo::denoise
