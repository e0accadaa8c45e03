// SPDX-License-Identifier: Apache-2.0
// Variance, exponential variance and moment bases: bounds from moments.
#include "filters/parameter.h"
#include "filters/shadow_map/shadow_basis_kernels.h"

namespace gobo {
inline namespace filters {
namespace {

class VarianceBasis final : public ShadowBasis {
 public:
  explicit VarianceBasis(const v1::VarianceShadow& m)
      : minVariance_(float(numberParameter(m, "min_variance"))), cut_(float(numberParameter(m, "bleeding_reduction"))) {}
  const char* name() const override { return "variance"; }
  int channels() const override { return 2; }
  void hashEncode(Hasher&) const override {}
  void hashReconstruct(Hasher& h) const override { h.add(minVariance_).add(cut_); }
  bool bounded() const override { return true; }
  void encode(const float* z, float* out, size_t n) const override { encodeVariance(z, out, n); }
  void reconstruct(const float* v, size_t stride, const float* d, float* s, size_t n) const override {
    reconstructVariance(v, stride, d, s, n, minVariance_, cut_);
  }

 private:
  float minVariance_, cut_;
};

class ExponentialVarianceBasis final : public ShadowBasis {
 public:
  ExponentialVarianceBasis(float p, float n, float v, float cut) : p_(p), n_(n), minVariance_(v), cut_(cut) {}
  const char* name() const override { return "exponential_variance"; }
  int channels() const override { return 4; }
  void hashEncode(Hasher& h) const override { h.add(p_).add(n_); }
  void hashReconstruct(Hasher& h) const override { h.add(minVariance_).add(cut_); }
  void encode(const float* z, float* out, size_t n) const override { encodeExponentialVariance(z, out, n, p_, n_); }
  void reconstruct(const float* v, size_t stride, const float* d, float* s, size_t n) const override {
    reconstructExponentialVariance(v, stride, d, s, n, p_, n_, minVariance_, cut_);
  }

 private:
  float p_, n_, minVariance_, cut_;
};

class MomentBasis final : public ShadowBasis {
 public:
  explicit MomentBasis(const v1::MomentShadow& m) : bias_(float(numberParameter(m, "moment_bias"))), cut_(float(numberParameter(m, "bleeding_reduction"))) {}
  const char* name() const override { return "moment"; }
  int channels() const override { return 4; }
  void hashEncode(Hasher&) const override {}
  void hashReconstruct(Hasher& h) const override { h.add(bias_).add(cut_); }
  bool bounded() const override { return true; }
  void encode(const float* z, float* out, size_t n) const override { encodeMoments(z, out, n); }
  void reconstruct(const float* v, size_t stride, const float* d, float* s, size_t n) const override { reconstructMoments(v, stride, d, s, n, bias_, cut_); }

 private:
  float bias_, cut_;
};

}  // namespace

ShadowBasisPtr makeVarianceBasis(const v1::VarianceShadow& m) { return std::make_shared<VarianceBasis>(m); }
ShadowBasisPtr makeExponentialVarianceBasis(float p, float n, float v, float cut) { return std::make_shared<ExponentialVarianceBasis>(p, n, v, cut); }
ShadowBasisPtr makeMomentBasis(const v1::MomentShadow& m) { return std::make_shared<MomentBasis>(m); }

}  // namespace filters
}  // namespace gobo
