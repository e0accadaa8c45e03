// SPDX-License-Identifier: Apache-2.0
#include "base/check.h"
#include "filters/shadow_map/shadow_basis_kernels.h"

namespace gobo {
inline namespace filters {
namespace {

class ExponentialBasis final : public ShadowBasis {
 public:
  ExponentialBasis(float c, bool logarithmic) : c_(c), logarithmic_(logarithmic) {
    GOBO_CHECK(c >= 1.0f && (logarithmic || c <= 80.0f));  // above 80 the far end leaves float (exponential_shadow_map.glsl.h)
  }
  const char* name() const override { return logarithmic_ ? "exponential_logarithmic" : "exponential"; }
  int channels() const override { return 1; }
  void hashEncode(Hasher& h) const override { h.add(c_); }
  void hashReconstruct(Hasher&) const override {}
  float logarithmic() const override { return logarithmic_ ? c_ : 0.0f; }
  float exponent() const override { return c_; }
  void encode(const float* z, float* out, size_t n) const override {
    if (logarithmic_) encodeDepth(z, out, n);
    else encodeExponential(z, out, n, c_);
  }
  void reconstruct(const float* values, size_t, const float* d, float* s, size_t n) const override {
    if (logarithmic_) reconstructExponentialDepth(values, d, s, n, c_);
    else reconstructExponential(values, d, s, n, c_);
  }

 private:
  float c_;
  bool logarithmic_;
};

}  // namespace

ShadowBasisPtr makeExponentialBasis(float c, bool logarithmic) { return std::make_shared<ExponentialBasis>(c, logarithmic); }

}  // namespace filters
}  // namespace gobo
