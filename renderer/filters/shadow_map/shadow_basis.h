// SPDX-License-Identifier: Apache-2.0
// ShadowBasis: one way of writing the shadow test as sum_i a_i(d) B_i(z) (Annen 2008, eq. 5.6) or as a bound from moments B_i(z). What
// filters work on; encode and reconstruct are the only two things that differ between convolution, exponential, variance and
// moment maps. Immutable; any thread may use it.
#pragma once

#include <memory>

#include "base/hash.h"
#include "gobo/v1/filters.pb.h"

namespace gobo {
inline namespace filters {

class ShadowBasis {
 public:
  virtual ~ShadowBasis() = default;
  virtual const char* name() const = 0;
  virtual int channels() const = 0;
  /// What encode depends on; and what reconstruct does, beyond that.
  virtual void hashEncode(Hasher& h) const = 0;
  virtual void hashReconstruct(Hasher& h) const = 0;
  /// out[i * channels() + k] = B_k(z[i]). z need not be finite or in range.
  virtual void encode(const float* z, float* out, size_t n) const = 0;
  /// s[i] from filtered values of receiver i at values[k * stride + i] and its depth d[i]; finite; not limited to [0,1] from above where the
  /// basis overshoots (the caller limits it; the exponential's classification wants to see it).
  virtual void reconstruct(const float* values, size_t stride, const float* d, float* s, size_t n) const = 0;
  /// Filters add up ln of sums of e^{c x} instead of x; 0: they add up x.
  virtual float logarithmic() const { return 0.0f; }
  /// The exponent, for devices; 0: not exponential.
  virtual float exponent() const { return 0.0f; }
  /// Compares d with z, so that receivers tilted to the light darken themselves without a slope bias.
  virtual bool comparesDepth() const { return false; }
  /// Values are in [-1, 1] and matter at that scale, so that they can be kept in integers (bytes, summed-area tables).
  virtual bool bounded() const { return false; }
};
using ShadowBasisPtr = std::shared_ptr<const ShadowBasis>;

ShadowBasisPtr makeVarianceBasis(const v1::VarianceShadow& m);
ShadowBasisPtr makeConvolutionBasis(const v1::ConvolutionShadow& m);
/// c <= 80 unless logarithmic.
ShadowBasisPtr makeExponentialBasis(float c, bool logarithmic);
ShadowBasisPtr makeExponentialVarianceBasis(float cPositive, float cNegative, float minVariance, float bleedingReduction);
ShadowBasisPtr makeMomentBasis(const v1::MomentShadow& m);

/// Scale and offset (in depth ranges of P = 1 + 1/M) with which a series of order M is used: s = 1/2 + scale (f(d - offset, z) - 1/2).
struct ConvolutionCorrection {
  double scale = 1, offset = 0;
};
/// OFFSET: the smallest offset with f(d = z) = 1. SCALING: 2 f. SHIFTED_SCALING: the least scale and offset for which ripples lie above 1 or
/// below 0 only (thesis 8.2.3; digest 7.3). Solved in double; errors below 1e-12.
ConvolutionCorrection convolutionCorrection(v1::ConvolutionShadow::Correction correction, int order, double attenuation);

}  // namespace filters
}  // namespace gobo
