// SPDX-License-Identifier: Apache-2.0
#include "techniques/transfer/harmonics.h"

#include <cmath>
#include <numbers>

#include "base/check.h"

namespace gobo::transfer {

namespace {

/// N_lm = sqrt((2 l + 1) / (4 pi) (l - m)! / (l + m)!), times sqrt(2) for m > 0.
struct Norms {
  double n[kMaxBands][kMaxBands] = {};
  Norms() {
    for (int l = 0; l < kMaxBands; ++l)
      for (int m = 0; m <= l; ++m) {
        double ratio = 1;
        for (int k = l - m + 1; k <= l + m; ++k) ratio /= k;
        n[l][m] = std::sqrt((2 * l + 1) / (4 * std::numbers::pi) * ratio * (m > 0 ? 2.0 : 1.0));
      }
  }
};
const Norms& norms() {
  static const Norms all;
  return all;
}

/// Lanes of T. With s = sin(polar angle): x = s cos(azimuth), z = s sin(azimuth); the powers of s of the Legendre functions go with the azimuth's.
template <typename T, int lanes>
void evaluate(const T* x, const T* y, const T* z, int bands, T* out) {
  GOBO_CHECK(bands >= 1 && bands <= kMaxBands);
  const Norms& norm = norms();
  T cosine[lanes], sine[lanes];  // s^m cos(m azimuth), s^m sin(m azimuth)
  for (int k = 0; k < lanes; ++k) {
    cosine[k] = 1;
    sine[k] = 0;
  }
  T diagonal = 1;  // (2 m - 1)!!
  for (int m = 0; m < bands; ++m) {
    T last[lanes], now[lanes];  // P_l^m / s^m for l - 1 and l
    for (int k = 0; k < lanes; ++k) {
      last[k] = 0;
      now[k] = diagonal;
    }
    for (int l = m; l < bands; ++l) {
      const T n = T(norm.n[l][m]);
      T* c = out + size_t(l * (l + 1) + m) * lanes;
      for (int k = 0; k < lanes; ++k) c[k] = n * now[k] * cosine[k];
      if (m > 0) {
        T* s = out + size_t(l * (l + 1) - m) * lanes;
        for (int k = 0; k < lanes; ++k) s[k] = n * now[k] * sine[k];
      }
      const T a = T(2 * l + 1) / T(l - m + 1), b = T(l + m) / T(l - m + 1);
      for (int k = 0; k < lanes; ++k) {
        const T next = a * y[k] * now[k] - b * last[k];
        last[k] = now[k];
        now[k] = next;
      }
    }
    for (int k = 0; k < lanes; ++k) {
      const T c = cosine[k] * x[k] - sine[k] * z[k];
      sine[k] = cosine[k] * z[k] + sine[k] * x[k];
      cosine[k] = c;
    }
    diagonal *= T(2 * m + 1);
  }
}

}  // namespace

void harmonics(const DVec3& d, int bands, double* out) { evaluate<double, 1>(&d.x, &d.y, &d.z, bands, out); }

void harmonics16(const float* x, const float* y, const float* z, int bands, float* out) { evaluate<float, kLanes>(x, y, z, bands, out); }

double cosineCoefficient(int l) {
  const double pi = std::numbers::pi;
  if (l == 0) return pi;
  if (l == 1) return 2 * pi / 3;
  if (l % 2) return 0;
  double ratio = 1;  // l! / (2^l (l/2)!^2)
  for (int k = 1; k <= l / 2; ++k) ratio *= double(l / 2 + k) / (4.0 * k);
  return 2 * pi * ((l / 2) % 2 ? 1.0 : -1.0) / ((l + 2.0) * (l - 1.0)) * ratio;
}

void turn(std::span<const float> map, int bands, int channels, double rotation, std::span<double> world) {
  GOBO_CHECK(map.size() == world.size() && map.size() == size_t(bands * bands * channels));
  for (int l = 0; l < bands; ++l)
    for (int m = 0; m <= l; ++m) {
      const double c = std::cos(m * rotation), s = std::sin(m * rotation);
      for (int k = 0; k < channels; ++k) {
        const size_t plus = size_t((l * (l + 1) + m) * channels + k), minus = size_t((l * (l + 1) - m) * channels + k);
        if (m == 0) world[plus] = map[plus];
        else {
          // A direction of azimuth a in the world has a + rotation in the map.
          const double p = map[plus], q = map[minus];
          world[plus] = p * c + q * s;
          world[minus] = q * c - p * s;
        }
      }
    }
}

}  // namespace gobo::transfer
