// SPDX-License-Identifier: Apache-2.0
#include "filters/shadow_map/shadow_basis_kernels.h"

#include <algorithm>

#include "formulas/convolution_shadow_map.glsl.h"
#include "formulas/exponential_shadow_map.glsl.h"
#include "formulas/exponential_variance_shadow_map.glsl.h"
#include "formulas/moment_shadow_map.glsl.h"
#include "formulas/variance_shadow_map.glsl.h"

namespace gobo {
inline namespace filters {

using namespace formulas;

void encodeDepth(const float* __restrict z, float* __restrict out, size_t n) {
  for (size_t i = 0; i < n; ++i) out[i] = shadowDepth(z[i]);
}

void encodeExponential(const float* __restrict z, float* __restrict out, size_t n, float c) {
  for (size_t i = 0; i < n; ++i) out[i] = esmEncode(z[i], c);
}

void reconstructExponential(const float* __restrict e, const float* __restrict d, float* __restrict s, size_t n, float c) {
  for (size_t i = 0; i < n; ++i) s[i] = finiteOr(e[i] * esmReceiver(d[i], c), 3.0e38f);
}

void reconstructExponentialDepth(const float* __restrict depth, const float* __restrict d, float* __restrict s, size_t n, float c) {
  for (size_t i = 0; i < n; ++i) s[i] = fastExp(c * (depth[i] - shadowReceiver(d[i])));
}

void encodeVariance(const float* __restrict z, float* __restrict out, size_t n) {
  for (size_t i = 0; i < n; ++i) {
    out[2 * i] = vsmFirst(z[i]);
    out[2 * i + 1] = vsmSecond(z[i]);
  }
}

void reconstructVariance(const float* __restrict v, size_t stride, const float* __restrict d, float* __restrict s, size_t n, float minVariance, float cut) {
  for (size_t i = 0; i < n; ++i) s[i] = shadowStretch(vsmVisibility(v[i], v[stride + i], d[i], minVariance), cut);
}

void encodeExponentialVariance(const float* __restrict z, float* __restrict out, size_t n, float cPositive, float cNegative) {
  for (size_t i = 0; i < n; ++i) {
    const float depth = shadowDepth(z[i]);
    const float p = evsmPositive(depth, cPositive), q = evsmNegative(depth, cNegative);
    out[4 * i] = p;
    out[4 * i + 1] = p * p;
    out[4 * i + 2] = q;
    out[4 * i + 3] = q * q;
  }
}

void reconstructExponentialVariance(const float* __restrict v, size_t stride, const float* __restrict d, float* __restrict s, size_t n, float cPositive,
                                    float cNegative, float minVariance, float cut) {
  for (size_t i = 0; i < n; ++i)
    s[i] = shadowStretch(evsmVisibility(v[i], v[stride + i], v[2 * stride + i], v[3 * stride + i], d[i], cPositive, cNegative, minVariance), cut);
}

void encodeMoments(const float* __restrict z, float* __restrict out, size_t n) {
  for (size_t i = 0; i < n; ++i) {
    const float t = msmCoordinate(shadowDepth(z[i])), t2 = t * t;
    out[4 * i] = t;
    out[4 * i + 1] = t2;
    out[4 * i + 2] = t2 * t;
    out[4 * i + 3] = t2 * t2;
  }
}

void reconstructMoments(const float* __restrict v, size_t stride, const float* __restrict d, float* __restrict s, size_t n, float bias, float cut) {
  for (size_t i = 0; i < n; ++i) s[i] = shadowStretch(msmVisibility(v[i], v[stride + i], v[2 * stride + i], v[3 * stride + i], d[i], bias), cut);
}

namespace {
constexpr size_t kRun = 64;  // values kept in the first-level cache while k runs
}

void encodeConvolution(const float* __restrict z, float* __restrict out, size_t n, int order) {
  const size_t channels = 2 * size_t(order);
  for (size_t first = 0; first < n; first += kRun) {
    const size_t m = std::min(kRun, n - first);
    float s0[kRun], c0[kRun], s1[kRun], c1[kRun], twoCos2[kRun];
    for (size_t i = 0; i < m; ++i) {
      const float a = csmAngle(shadowDepth(z[first + i]), float(order));
      s1[i] = fastSin(a);
      c1[i] = fastCos(a);
      s0[i] = -s1[i];  // angles -a and a are the two before 3 a
      c0[i] = c1[i];
      twoCos2[i] = 2.0f * (c1[i] * c1[i] - s1[i] * s1[i]);
    }
    for (int k = 0; k < order; ++k) {
      float* to = out + first * channels + 2 * size_t(k);
      for (size_t i = 0; i < m; ++i) {
        to[i * channels] = s1[i];
        to[i * channels + 1] = c1[i];
        const float s = csmNext(s1[i], s0[i], twoCos2[i]), c = csmNext(c1[i], c0[i], twoCos2[i]);
        s0[i] = s1[i];
        c0[i] = c1[i];
        s1[i] = s;
        c1[i] = c;
      }
    }
  }
}

void convolutionSeries(const float* __restrict values, size_t stride, const float* __restrict d, float* __restrict sum, size_t n,
                       const ConvolutionParameters& p) {
  float weight[kMaxConvolutionOrder];
  for (int k = 0; k < p.order; ++k) weight[k] = csmWeight(float(k + 1), float(p.order), p.attenuation);
  for (size_t first = 0; first < n; first += kRun) {
    const size_t m = std::min(kRun, n - first);
    float s0[kRun], c0[kRun], s1[kRun], c1[kRun], twoCos2[kRun], total[kRun];
    for (size_t i = 0; i < m; ++i) {
      const float a = csmAngle(shadowReceiver(d[first + i]) - p.offset, float(p.order));
      s1[i] = fastSin(a);
      c1[i] = fastCos(a);
      s0[i] = -s1[i];
      c0[i] = c1[i];
      twoCos2[i] = 2.0f * (c1[i] * c1[i] - s1[i] * s1[i]);
      total[i] = 0.0f;
    }
    for (int k = 0; k < p.order; ++k) {
      const float w = weight[k];
      const float* sine = values + 2 * size_t(k) * stride + first;
      const float* cosine = sine + stride;
      for (size_t i = 0; i < m; ++i) {
        total[i] += csmTerm(w, s1[i], c1[i], sine[i], cosine[i]);
        const float s = csmNext(s1[i], s0[i], twoCos2[i]), c = csmNext(c1[i], c0[i], twoCos2[i]);
        s0[i] = s1[i];
        c0[i] = c1[i];
        s1[i] = s;
        c1[i] = c;
      }
    }
    for (size_t i = 0; i < m; ++i) sum[first + i] = total[i];
  }
}

void reconstructConvolution(const float* values, size_t stride, const float* d, float* __restrict s, size_t n, const ConvolutionParameters& p) {
  convolutionSeries(values, stride, d, s, n, p);
  const float base = p.scaling ? 0.5f * p.scale : 0.5f;
  for (size_t i = 0; i < n; ++i) s[i] = finiteOr(base + p.scale * s[i], 1.0f);
}

}  // namespace filters
}  // namespace gobo
