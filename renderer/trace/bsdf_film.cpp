// SPDX-License-Identifier: Apache-2.0
#include "trace/bsdf_film.h"

namespace gobo {
inline namespace trace {
namespace {

constexpr int kOrders = 4;

/// Fourier transform of the colour matching functions at an optical path difference: out[m-1] = linear Rec.709 response to
/// cos(2 pi m path / wavelength), 1 for path 0. The Gaussians' m-th harmonics follow from the first by powers and Chebyshev.
void harmonics(float path, Vec3 (&out)[kOrders]) {
  struct Gaussian {
    float weight, position, variance;
  };
  static constexpr Gaussian g[4] = {
      {5.4856e-13f, 1.6810e6f, 4.3278e9f}, {4.4201e-13f, 1.7953e6f, 9.3046e9f}, {5.2481e-13f, 2.2084e6f, 6.6121e9f}, {9.7470e-14f, 2.2399e6f, 4.5282e9f}};
  static constexpr float area[4] = {164901.1f, 241790.3f, 203826.0f, 168675.8f};  // sqrt(2 pi variance)
  const float phase = 2.0f * kPi * path * 1e-9f;
  float value[kOrders][4];
  for (int k = 0; k < 4; ++k) {
    const float a = g[k].weight * area[k] / 1.0685e-7f;
    const float e1 = std::exp(-phase * phase * g[k].variance), e2 = e1 * e1, e4 = e2 * e2, e8 = e4 * e4;
    const float c1 = std::cos(g[k].position * phase), c2 = 2.0f * c1 * c1 - 1.0f, c3 = 2.0f * c1 * c2 - c1, c4 = 2.0f * c2 * c2 - 1.0f;
    value[0][k] = a * e1 * c1;
    value[1][k] = a * e4 * c2;
    value[2][k] = a * e8 * e1 * c3;
    value[3][k] = a * e8 * e8 * c4;
  }
  // XYZ to Rec.709, rows divided by their response to path 0.
  for (int m = 0; m < kOrders; ++m) {
    const float x = value[m][0] + value[m][3], y = value[m][1], z = value[m][2];
    out[m] = Vec3(2.6883509f * x - 1.2752434f * y - 0.4135924f * z, -1.0220880f * x + 1.9782476f * y + 0.0438207f * z,
                  0.0611459f * x - 0.2242019f * y + 1.1617736f * z);
  }
}

/// One polarisation and channel: 1 - T12 T23 / (1 - p^2) (1 + 2 sum (-p)^m cos m phi), p = r12 r23 (Airy's sum as a Fourier series).
float series(float r12, float r23, const Vec3 (&s)[kOrders], int channel) {
  const float p = r12 * r23;
  float sum = 1.0f, power = 1.0f;
  for (int m = 0; m < kOrders; ++m) sum += 2.0f * (power *= -p) * s[m][channel];
  return 1.0f - (1.0f - r12 * r12) * (1.0f - r23 * r23) / (1.0f - p * p) * sum;
}

}  // namespace

Vec3 filmReflectance(float c, float filmIor, float thickness, const Vec3& baseF0) {
  c = minOf(maxOf(c, 1e-4f), 1.0f);
  const float n = minOf(maxOf(filmIor, 1.0f), 10.0f);
  const float sin2 = 1.0f - c * c, c2 = std::sqrt(1.0f - sin2 / (n * n));
  Vec3 s[kOrders];
  harmonics(2.0f * n * minOf(maxOf(thickness, 0.0f), 1e5f) * c2, s);
  const float r12s = (c - n * c2) / (c + n * c2), r12p = (n * c - c2) / (n * c + c2);
  Vec3 out;
  for (int k = 0; k < 3; ++k) {
    const float root = std::sqrt(minOf(clamp01(baseF0[k]), 0.9999f)), base = (1.0f + root) / (1.0f - root);
    const float c3 = std::sqrt(1.0f - sin2 / (base * base));
    const float r23s = (n * c2 - base * c3) / (n * c2 + base * c3), r23p = (base * c2 - n * c3) / (base * c2 + n * c3);
    out[k] = clamp01(0.5f * (series(r12s, r23s, s, k) + series(r12p, r23p, s, k)));
  }
  return out;
}

}  // namespace trace
}  // namespace gobo
