// SPDX-License-Identifier: Apache-2.0
// SampleSet: the draws of 16 samples at once, consecutive ones of one sequence or of a few; value for value what SobolSampler (base/sobol.h) gives each
// of them, but with the dimension named and the integer work in vector registers (sample_draws_kernels.cpp). Halton points and independent
// numbers (base/halton.h, base/independent.h) come lane by lane.
#pragma once

#include <span>

#include "base/sampler_kind.h"
#include "base/sobol.h"

namespace gobo {
inline namespace trace {

inline constexpr int kLanes = 16;

/// sample_draws_kernels.cpp: of Sobol points, by lane; `one`: all lanes are of the first sequence. The last writes 6 rows of kLanes.
void sobolLanes1D(const uint64_t* sequences, bool one, const uint32_t* reversed, uint32_t dimension, float* out);
void sobolLanes2D(const uint64_t* sequences, bool one, const uint32_t* reversed, uint32_t dimension, float* x, float* y);
void sobolLanes3x2D(const uint64_t* sequences, bool one, const uint32_t* reversed, uint32_t dimension, float* out);

class SampleSet {
 public:
  /// Samples first .. first + 15 of the sequence `seed`.
  SampleSet(uint64_t seed, uint32_t first, SamplerKind kind = SamplerKind::Sobol) : SampleSet(std::span(&seed, 1), first, kind) {}
  /// Samples first .. first + n - 1 of each of these sequences in turn, n = 16 / how many there are (a power of two).
  SampleSet(std::span<const uint64_t> seeds, uint32_t first, SamplerKind kind = SamplerKind::Sobol) : kind_(kind), one_(seeds.size() == 1) {
    const int each = kLanes / int(seeds.size());
    for (int i = 0; i < kLanes; ++i) {
      seeds_[i] = seeds[size_t(i / each)];
      reversed_[i] = reverseBits(first + uint32_t(i % each));
    }
  }
  void draw1D(uint32_t dimension, float* out) const {
    if (kind_ == SamplerKind::Sobol) sobolLanes1D(seeds_, one_, reversed_, dimension, out);
    else drawOther1D(dimension, out);
  }
  void draw2D(uint32_t dimension, float* x, float* y) const {
    if (kind_ == SamplerKind::Sobol) sobolLanes2D(seeds_, one_, reversed_, dimension, x, y);
    else drawOther2D(dimension, x, y);
  }
  /// x and y of `dimension`, then of the two after it, side by side.
  void draw3x2D(uint32_t dimension, float (&out)[6][kLanes]) const {
    if (kind_ == SamplerKind::Sobol) return sobolLanes3x2D(seeds_, one_, reversed_, dimension, out[0]);
    for (int k = 0; k < 3; ++k) drawOther2D(dimension + uint32_t(k), out[2 * k], out[2 * k + 1]);
  }

  uint64_t seed(int lane) const { return seeds_[lane]; }
  /// What to add to the number of a sample before it takes turns at n things by number % n. 0, but with Halton points: whose digits would be tied to the
  /// turns where a base divides n. n samples in a row still have each turn once if the first one is a multiple of n.
  uint64_t turnShift(int lane, uint64_t sample, uint32_t n) const {
    return kind_ == SamplerKind::Halton ? hash64(hash64(seed(lane), 0x7475726eu), sample / n) % n : 0;
  }

 private:
  // Other points than Sobol's.
  void drawOther1D(uint32_t dimension, float* out) const;
  void drawOther2D(uint32_t dimension, float* x, float* y) const;
  alignas(64) uint64_t seeds_[kLanes];
  alignas(64) uint32_t reversed_[kLanes];
  SamplerKind kind_;
  bool one_;  // sequence
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
