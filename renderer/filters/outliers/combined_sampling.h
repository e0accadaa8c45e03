// SPDX-License-Identifier: Apache-2.0
// Combined correlated and importance sampling (Szecsi, Sbert & Szirmay-Kalos 2004, "Combined correlated and importance sampling in direct light source
// computation and environment mapping"): an integral of f that comes with a main part g whose integral C is known, as a lamp's light on a surface with and
// without what stands before it. Both are estimated by the same n samples, f_i and g_i:
//   additive (importance sampling)       mean f_i
//   subtractive (correlated sampling)    C + mean (f_i - g_i)
//   combined                             mean f_i - beta mean (g_i - C)
//   ratio (Heitz, Hill & McGuire 2018)   C sum f_i / sum g_i
// With f = g V, V = 1 with probability v and independent of g, and c^2 the variance of g over C^2, n times their variances over C^2 are
//   v (1 - v) + v c^2,    v (1 - v) + (1 - v) c^2,    v (1 - v) (1 + c^2) for the last two (beta = v, the best one),
// so that the additive one is better in shadow, the subtractive one in light, and the combined one is never worse than either, but for the noise of beta.
// beta is estimated from the samples: for each from the others, of its own pixel and, as a share of C, of those around it (in few samples of its own there is
// more noise than beta); which leaves the estimate without bias, as samples are independent. The ratio has a bias of the order of 1 / n. Where there is no
// shadow, or nothing but, all but the additive one are exact in light (the combined one from three samples on), all but the subtractive one in shadow. It is
// not for path samples as such: they have no main part of known integral (indirect light, glossy surfaces, textures of lamps).
#pragma once

#include <span>

namespace gobo::outliers {

enum class Combination { Additive, Subtractive, Combined, Ratio };

/// Sums of f / C and g / C - 1, of other pixels. Those with C = 0 say nothing.
struct PairSums {
  double n = 0, f = 0, g = 0, fg = 0, gg = 0;
  void add(double fi, double gi, double known);
  PairSums operator+(const PairSums& o) const { return {n + o.n, f + o.f, g + o.g, fg + o.fg, gg + o.gg}; }
};

/// Combined, with what is known around. The samples of `around` must be others.
double combinedWith(std::span<const double> f, std::span<const double> g, double known, const PairSums& around);

/// Of n values f_i and g_i, one by one; 0 of none. `known`: C. Values are finite.
double combinedEstimate(std::span<const double> f, std::span<const double> g, double known, Combination how);

}  // namespace gobo::outliers
