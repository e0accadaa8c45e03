// SPDX-License-Identifier: Apache-2.0
// Per-pixel estimators of squared error from K independent, identically made parts of the truth (measure/halves.h is the case
// of two). Pure; any thread.
#pragma once

#include <algorithm>
#include <array>

#include "measure/halves.h"

namespace gobo {
inline namespace measure {

inline constexpr int kParts = 4;  ///< jackknifing a product of two needs three
using TruthParts = std::array<Vec3, kParts>;

struct PartsEstimate {
  double value = 0;   ///< sum over channels of w (truth - p)^2 / 3, without bias for weights w that do not depend on the parts
  double noise = 0;   ///< variance of `value` by jackknife, which is too large on the average (Efron & Stein, Annals of Statistics 9, 1981)
  double spread = 0;  ///< variance of the parts' mean, w-weighted mean over channels
};

/// value = mean over pairs j != k of w (x_j - p)(x_k - p): E = w (truth - p)^2 however noisy the parts are.
inline PartsEstimate squaredErrorOfParts(const Vec3& p, const TruthParts& parts, const DVec3& w = DVec3(1.0)) {
  DVec3 sum(0.0), squares(0.0);
  for (const Vec3& x : parts) {
    const DVec3 d = DVec3(x) - DVec3(p);
    sum += d, squares += d * d;
  }
  const auto pairs = [&](const DVec3& s, const DVec3& q, int k) { return glm::dot(w, s * s - q) / (3.0 * k * (k - 1)); };
  PartsEstimate out;
  out.value = pairs(sum, squares, kParts);
  std::array<double, kParts> without;
  double mean = 0;
  for (int k = 0; k < kParts; ++k) {
    const DVec3 d = DVec3(parts[k]) - DVec3(p);
    mean += without[k] = pairs(sum - d, squares - d * d, kParts - 1);
  }
  mean /= kParts;
  for (double v : without) out.noise += (v - mean) * (v - mean) * (kParts - 1) / kParts;
  out.spread = std::max(0.0, glm::dot(w, squares - sum * sum / double(kParts)) / (3.0 * kParts * (kParts - 1)));
  return out;
}

/// Mean over channels of (truth - p)^2 / (truth^2 + epsilon): no function of noisy parts estimates it without bias.
struct RelativePartsEstimate {
  PartsEstimate leaning;  ///< squaredErrorOfParts with w = 1 / (q^2 + epsilon), q as in RelativeError::leaning
  double jackknife = 0;   ///< K g(M) - (K - 1) mean of g(M without k), g(x) = (x - p)^2 / (x^2 + epsilon) (Quenouille 1956)
};
inline RelativePartsEstimate relativeErrorOfParts(const Vec3& p, const TruthParts& parts) {
  const DVec3 pd(p);
  DVec3 sum(0.0), squares(0.0);
  for (const Vec3& x : parts) sum += DVec3(x), squares += (DVec3(x) - pd) * (DVec3(x) - pd);
  const DVec3 middle = sum / double(kParts), m = middle - pd;
  const double distance = glm::dot(m, m);
  const double noise = std::max(0.0, (squares.x + squares.y + squares.z - kParts * distance) / (kParts * (kParts - 1)));
  const double lean = distance > 0 ? distance / (distance + 4 * noise) : 1;
  const DVec3 q = pd + lean * m;
  RelativePartsEstimate out;
  out.leaning = squaredErrorOfParts(p, parts, DVec3(1.0) / (q * q + kRelMseEpsilon));
  const auto g = [&](const DVec3& x) {
    const DVec3 r = (x - pd) * (x - pd) / (x * x + kRelMseEpsilon);
    return (r.x + r.y + r.z) / 3;
  };
  out.jackknife = kParts * g(middle);
  for (const Vec3& x : parts) out.jackknife -= (kParts - 1.0) / kParts * g((sum - DVec3(x)) / double(kParts - 1));
  return out;
}

}  // namespace measure
}  // namespace gobo
