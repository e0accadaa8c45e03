// SPDX-License-Identifier: Apache-2.0
// The Fourier basis of convolution shadow maps and what makes its truncated step usable: attenuation, offset, scaling.
#include <algorithm>
#include <cmath>

#include "base/check.h"
#include "filters/parameter.h"
#include "filters/shadow_map/shadow_basis_kernels.h"

namespace gobo {
inline namespace filters {
namespace {

// The series in t = (z - d) / P, double.
double series(double t, int order, double attenuation) {
  double s = 0.5;
  for (int k = 1; k <= order; ++k) {
    const double r = double(k) / order, c = M_PI * (2 * k - 1);
    s += 2 * std::exp(-attenuation * r * r) * std::sin(c * t) / c;
  }
  return s;
}

double bisect(double lo, double hi, const std::function<double(double)>& f) {  // f(lo) < 0 <= f(hi)
  for (int i = 0; i < 200; ++i) {
    const double middle = 0.5 * (lo + hi);
    (f(middle) < 0 ? lo : hi) = middle;
  }
  return hi;
}

}  // namespace

/// Where f is smallest in [lo, hi], which holds one minimum: golden section.
template <typename F>
double minimum(double lo, double hi, const F& f) {
  const double golden = 0.5 * (std::sqrt(5.0) - 1.0);
  double a = hi - golden * (hi - lo), b = lo + golden * (hi - lo), fa = f(a), fb = f(b);
  for (int i = 0; i < 100; ++i) {
    if (fa < fb) {
      hi = b;
      b = a;
      fb = fa;
      a = hi - golden * (hi - lo);
      fa = f(a);
    } else {
      lo = a;
      a = b;
      fa = fb;
      b = lo + golden * (hi - lo);
      fb = f(b);
    }
  }
  return 0.5 * (lo + hi);
}

ConvolutionCorrection convolutionCorrection(v1::ConvolutionShadow::Correction correction, int order, double attenuation) {
  ConvolutionCorrection result;
  // First peak of the series, found on a grid and refined by golden section.
  const int steps = 64 * order;
  int best = 0;
  double peak = 0;
  for (int i = 0; i <= steps / 2; ++i) {
    const double f = series(double(i) / steps, order, attenuation);
    if (f > peak + 1e-12) {
      peak = f;
      best = i;
    } else if (f < peak - 1e-6) break;  // behind the first peak
  }
  // An extremum on the grid lies within one step of the true one; the series is symmetric about 1/2.
  const auto refined = [&](int at, double sign) {
    return minimum(double(at - 1) / steps, double(at + 1) / steps, [&](double t) { return sign * series(t, order, attenuation); });
  };
  const double top = refined(best, -1.0);
  peak = series(top, order, attenuation);
  const auto crossing = [&](double level) { return bisect(0, top, [&](double t) { return series(t, order, attenuation) - level; }); };
  switch (correction) {
    case v1::ConvolutionShadow::SCALING:
      result.scale = 2;  // s = 2 f limited to [0,1]
      break;
    case v1::ConvolutionShadow::SHIFTED_SCALING: {
      // Lowest ripple behind the first peak: scaled up to 1, so that all of them lie above.
      int least = best;
      for (int i = best; i <= steps / 2; ++i)
        if (series(double(i) / steps, order, attenuation) < series(double(least) / steps, order, attenuation)) least = i;
      const double lowest = least == best ? peak : series(refined(least, 1.0), order, attenuation);
      result.scale = 0.5 / (lowest - 0.5);
      result.offset = crossing(0.5 + 0.5 / result.scale);
      break;
    }
    case v1::ConvolutionShadow::NONE: break;
    default:
      if (peak >= 1) result.offset = crossing(1);
      else {
        result.scale = 0.5 / (peak - 0.5);
        result.offset = top;
      }  // attenuated below 1: to the peak
      break;
  }
  return result;
}

namespace {

class ConvolutionBasis final : public ShadowBasis {
 public:
  explicit ConvolutionBasis(const v1::ConvolutionShadow& m) : order_(int(numberParameter(m, "order"))) {
    GOBO_CHECK(order_ >= 1 && order_ <= kMaxConvolutionOrder);
    attenuation_ = float(numberParameter(m, "attenuation"));
    scaling_ = m.correction() == v1::ConvolutionShadow::SCALING;
    const ConvolutionCorrection c = convolutionCorrection(m.correction(), order_, attenuation_);
    scale_ = float(c.scale);
    offset_ = float(c.offset * (1.0 + 1.0 / order_));
  }
  const char* name() const override { return "convolution"; }
  int channels() const override { return 2 * order_; }
  void hashEncode(Hasher& h) const override { h.add(order_); }
  void hashReconstruct(Hasher& h) const override { h.add(attenuation_).add(scale_).add(offset_).add(scaling_); }
  bool comparesDepth() const override { return true; }
  bool bounded() const override { return true; }
  void encode(const float* z, float* out, size_t n) const override { encodeConvolution(z, out, n, order_); }
  void reconstruct(const float* v, size_t stride, const float* d, float* s, size_t n) const override {
    reconstructConvolution(v, stride, d, s, n, {order_, attenuation_, scale_, offset_, scaling_});
  }

 private:
  int order_;
  float attenuation_, scale_, offset_;
  bool scaling_;
};

}  // namespace

ShadowBasisPtr makeConvolutionBasis(const v1::ConvolutionShadow& m) { return std::make_shared<ConvolutionBasis>(m); }

}  // namespace filters
}  // namespace gobo
