// SPDX-License-Identifier: Apache-2.0
// SampleSet: the draws of 16 samples at once, consecutive ones of one sequence or of a few; value for value what SobolSampler (base/sobol.h) gives each
// of them, but with the dimension named and the integer work in vector registers (about 6 ns for a 2D draw of all 16). Halton points and independent
// numbers (base/halton.h, base/independent.h) come lane by lane.
#pragma once

#include <algorithm>
#include <span>

#include "base/sampler_kind.h"
#include "base/sobol.h"

namespace gobo {
inline namespace trace {

inline constexpr int kLanes = 16;

class SampleSet {
 public:
  /// Samples first .. first + 15 of the sequence `seed`.
  SampleSet(uint64_t seed, uint32_t first, SamplerKind kind = SamplerKind::Sobol) : SampleSet(std::span(&seed, 1), first, kind) {}
  /// Samples first .. first + n - 1 of each of these sequences in turn, n = 16 / how many there are (a power of two).
  SampleSet(std::span<const uint64_t> seeds, uint32_t first, SamplerKind kind = SamplerKind::Sobol)
      : sequences_(int(seeds.size())), each_(kLanes / int(seeds.size())), kind_(kind), single_(seeds.size() == 1 && kind == SamplerKind::Sobol) {
    std::copy(seeds.begin(), seeds.end(), seeds_);
    for (int i = 0; i < kLanes; ++i) reversed_[i] = reverseBits(first + uint32_t(i) % uint32_t(each_));
  }
  void draw1D(uint32_t dimension, float* __restrict out) const {
    if (!single_) return drawEach1D(dimension, out);
    const uint64_t h = hash64(seeds_[0], dimension);
    const uint32_t a = uint32_t(h >> 32), b = uint32_t(h);
    for (int i = 0; i < kLanes; ++i) out[i] = unit(reverseBits(laineKarras(reverseBits(laineKarras(reversed_[i], a)), b)));
  }
  void draw2D(uint32_t dimension, float* __restrict x, float* __restrict y) const {
    if (!single_) return drawEach2D(dimension, x, y);
    const uint64_t h = hash64(seeds_[0], dimension), g = mix64(h ^ 0x9e3779b97f4a7c15ull);
    const uint32_t a = uint32_t(h >> 32), b = uint32_t(g), c = uint32_t(g >> 32);
    for (int i = 0; i < kLanes; ++i) {
      const uint32_t shuffled = reverseBits(laineKarras(reversed_[i], a));
      x[i] = unit(reverseBits(laineKarras(shuffled, b)));
      y[i] = unit(reverseBits(laineKarras(pascalDigits(shuffled), c)));
    }
  }

  uint64_t seed(int lane) const { return seeds_[lane / each_]; }
  /// What to add to the number of a sample before it takes turns at n things by number % n. 0, but with Halton points: whose digits would be tied to the
  /// turns where a base divides n. n samples in a row still have each turn once if the first one is a multiple of n.
  uint64_t turnShift(int lane, uint64_t sample, uint32_t n) const {
    return kind_ == SamplerKind::Halton ? hash64(hash64(seed(lane), 0x7475726eu), sample / n) % n : 0;
  }

 private:
  // Other points than Sobol's.
  void drawOther1D(uint32_t dimension, float* out) const;
  void drawOther2D(uint32_t dimension, float* x, float* y) const;
  // The same with a scramble a sequence.
  [[gnu::noinline]] void drawEach1D(uint32_t dimension, float* __restrict out) const {
    if (kind_ != SamplerKind::Sobol) return drawOther1D(dimension, out);
    alignas(64) uint32_t a[kLanes], b[kLanes];
    for (int s = 0; s < sequences_; ++s) {
      const uint64_t h = hash64(seeds_[s], dimension);
      for (int i = s * each_; i < (s + 1) * each_; ++i) {
        a[i] = uint32_t(h >> 32);
        b[i] = uint32_t(h);
      }
    }
    for (int i = 0; i < kLanes; ++i) out[i] = unit(reverseBits(laineKarras(reverseBits(laineKarras(reversed_[i], a[i])), b[i])));
  }
  [[gnu::noinline]] void drawEach2D(uint32_t dimension, float* __restrict x, float* __restrict y) const {
    if (kind_ != SamplerKind::Sobol) return drawOther2D(dimension, x, y);
    alignas(64) uint32_t a[kLanes], b[kLanes], c[kLanes];
    for (int s = 0; s < sequences_; ++s) {
      const uint64_t h = hash64(seeds_[s], dimension), g = mix64(h ^ 0x9e3779b97f4a7c15ull);
      for (int i = s * each_; i < (s + 1) * each_; ++i) {
        a[i] = uint32_t(h >> 32);
        b[i] = uint32_t(g);
        c[i] = uint32_t(g >> 32);
      }
    }
    for (int i = 0; i < kLanes; ++i) {
      const uint32_t shuffled = reverseBits(laineKarras(reversed_[i], a[i]));
      x[i] = unit(reverseBits(laineKarras(shuffled, b[i])));
      y[i] = unit(reverseBits(laineKarras(pascalDigits(shuffled), c[i])));
    }
  }
  static float unit(uint32_t bits) { return float(int32_t(bits >> 8)) * 0x1p-24f; }  // toUnit, through the signed conversion that vectorises
  uint64_t seeds_[kLanes];
  int sequences_, each_;
  SamplerKind kind_;
  bool single_;  // one sequence of Sobol points
  alignas(64) uint32_t reversed_[kLanes];
};

/// Cosine-distributed directions about +z from 16 pairs of numbers: radius sqrt(v), angle 2 pi u; sine and cosine by Taylor
/// polynomials of the half angle (error below 1e-6), so that the loop vectorises.
inline void cosineDirections(const float* __restrict u, const float* __restrict v, float* __restrict x, float* __restrict y, float* __restrict z) {
  for (int i = 0; i < kLanes; ++i) {
    const float a = kPi * (u[i] - 0.5f), a2 = a * a;  // half angle in [-pi/2, pi/2)
    const float s = a * (1.0f + a2 * (-1.0f / 6 + a2 * (1.0f / 120 + a2 * (-1.0f / 5040 + a2 * (1.0f / 362880 - a2 * (1.0f / 39916800))))));
    const float c = 1.0f + a2 * (-0.5f + a2 * (1.0f / 24 + a2 * (-1.0f / 720 + a2 * (1.0f / 40320 + a2 * (-1.0f / 3628800 + a2 * (1.0f / 479001600))))));
    const float r = std::sqrt(v[i]);
    x[i] = r * (c * c - s * s);
    y[i] = r * (2.0f * s * c);
    z[i] = std::sqrt(1.0f - v[i]);
  }
}

}  // namespace trace
}  // namespace gobo
