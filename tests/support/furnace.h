// SPDX-License-Identifier: Apache-2.0
// White furnace by sampling: mean weight (as flux) of a BSDF over independently scrambled Sobol sets; the error is theirs.
#pragma once

#include "base/sobol.h"
#include "support/chi2.h"
#include "trace/bsdf.h"

namespace gobo::test {

inline Vec3 localDirection(double cosine, double phi = 0.0) {
  const double s = std::sqrt(std::max(1.0 - cosine * cosine, 0.0));
  return Vec3(float(s * std::cos(phi)), float(s * std::sin(phi)), float(cosine));
}

struct Furnace {
  double mean = 0, error = 0;
};

/// Largest channel's mean weight; transmitted radiance is turned back into flux by eta^2.
inline Furnace furnace(const BsdfParams& p, const Vec3& wo, uint32_t seed, int sets = 8, int samples = 1024) {
  const double ior = std::fmin(std::fmax(p.ior, 1.0f / 3.0f), 3.0f), eta = p.thin ? 1.0 : p.entering ? ior : 1.0 / ior;
  const bool bends = p.transmission > 0.0f && !p.thin;
  Moments channels[3];
  for (int set = 0; set < sets; ++set) {
    DVec3 sum(0.0);
    for (int i = 0; i < samples; ++i) {
      SobolSampler u(seed * 64 + uint32_t(set), uint32_t(i));
      const float lobe = u.next1D();
      BsdfSample s;
      if (bsdfSample(p, wo, lobe, u.next2D(), s)) sum += DVec3(s.weight) * (s.transmitted && bends ? eta * eta : 1.0);
    }
    for (int c = 0; c < 3; ++c) channels[c].add(sum[c] / samples);
  }
  int most = 0;
  for (int c = 1; c < 3; ++c)
    if (channels[c].mean() > channels[most].mean()) most = c;
  return {channels[most].mean(), channels[most].error()};
}

/// True if the reflectance is above 1 by more than three sigma, twice: of many cases a few are by chance.
inline bool gains(const BsdfParams& p, const Vec3& wo, uint32_t seed, Furnace& f) {
  f = furnace(p, wo, seed);
  if (f.mean <= 1.0 + 3.0 * f.error + 1e-5) return false;
  f = furnace(p, wo, seed + 100003, 32, 4096);
  return f.mean > 1.0 + 3.0 * f.error + 1e-5;
}

}  // namespace gobo::test
