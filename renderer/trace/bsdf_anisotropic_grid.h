// SPDX-License-Identifier: Apache-2.0
// Where the tables of two alphas have their nodes: shared by the look-up (float) and by the program that fills them (double,
// bench/bsdf_anisotropic_tables.cpp), so that both interpolate alike. Axes, all 0..1 over the nodes:
//   roughness, anisotropy   as the material has them: alphaY = roughness^2, alphaX = mix(alphaY, 1, anisotropy^2)
//   cosine                  t^2 = mu (1+s)/(mu+s) as in bsdf_albedo.h; s = 2 alpha of the view's own azimuth (reflection), 2 alphaX (glass)
//   azimuth                 x = (1 - (sin phi / b)^2)^(1/4): dense where the view turns across the brushed direction. b = 1, but inside glass
//                           b = sin of the azimuth from where on even facets along x only reflect totally, 1/(n sin theta): the albedo has its
//                           edge there, and a second piece of nodes, from b to across, lies beyond it (dense at both ends).
//   ior                     ((n-1)/(n+1) / 0.5)^(1/1.8)
#pragma once

#include <algorithm>
#include <cmath>

namespace gobo::anisotropic {

inline constexpr int kR = 12, kS = 10, kPhi = 6, kMu = 12;  // reflection
inline constexpr int kGlassR = 8, kGlassS = 6, kGlassMu = 10, kGlassIor = 8;
inline constexpr int kGlassPhi[2] = {6, 9}, kFirstPiece[2] = {6, 5};  // outside, inside
inline constexpr int kFine = 2;                                       // nodes of the means a cell of roughness, anisotropy, ior
inline constexpr int fine(int n) { return kFine * (n - 1) + 1; }
inline constexpr double kLeastAlpha = 1e-3, kIorLargest = 0.5, kIorPower = 1.8;

template <class T>
struct Cell {
  int k = 0;
  T f = 0;
};
template <class T>
Cell<T> cell(T x, int n) {
  const T p = std::min(std::max(x, T(0)), T(1)) * T(n - 1);
  const int k = p < T(n - 2) ? int(p) : n - 2;
  return {k, p - T(k)};
}
/// Two nodes of the azimuth axis and how far between them; the axis' second piece starts at its first node.
template <class T>
struct Pair {
  int a = 0, b = 0;
  T f = 0;
};

template <class T>
T alphaY(T roughness) {
  return std::max(roughness * roughness, T(kLeastAlpha));
}
template <class T>
T alphaX(T roughness, T anisotropy) {
  const T a = roughness * roughness;
  return std::max(a + (T(1) - a) * anisotropy * anisotropy, alphaY(roughness));
}
template <class T>
T cosineAxis(T mu, T s) {
  return std::sqrt(mu * (T(1) + s) / (mu + s));
}
template <class T>
T cosineAt(T t, T s) {
  return std::max(s * t * t / (T(1) + s - t * t), T(1e-6));
}

/// Of a unit direction: sin^2 theta and cos^2 phi (1 along the normal, where the azimuth means nothing).
template <class T>
void azimuth(T x, T y, T& sin2, T& cos2Phi) {
  sin2 = x * x + y * y;
  cos2Phi = sin2 > T(1e-10) ? std::min(x * x / sin2, T(1)) : T(1);
}
template <class T>
T reflectionScale(T ax, T ay, T cos2Phi) {
  return T(2) * std::sqrt(ax * ax * cos2Phi + ay * ay * (T(1) - cos2Phi));
}

/// b^2 of the azimuth axis.
template <class T>
T edge2(bool inside, T n, T sin2) {
  return inside && n * n * sin2 > T(1) ? T(1) / (n * n * sin2) : T(1);
}
template <class T>
Pair<T> azimuthPair(T cos2Phi, T b2, int first, int all) {
  const T sin2Phi = std::max(T(1) - cos2Phi, T(0));
  if (first == all || sin2Phi <= b2) {
    const Cell<T> c = cell(std::sqrt(std::sqrt(std::max(T(1) - sin2Phi / b2, T(0)))), first);
    return {c.k, c.k + 1, c.f};
  }
  const T z = std::min(std::cbrt(cos2Phi / (T(1) - b2)), T(1));
  const Cell<T> c = cell(std::acos(T(2) * z - T(1)) / T(3.14159265358979323846), all - first + 1);
  return {c.k == 0 ? 0 : first - 1 + c.k, first + c.k, c.f};
}
/// cos^2 phi of node k.
template <class T>
T azimuthAt(int k, T b2, int first, int all) {
  if (k < first) {
    const T x = T(k) / T(first - 1);
    return T(1) - b2 * (T(1) - x * x * x * x);
  }
  const T z = T(0.5) * (T(1) + std::cos(T(3.14159265358979323846) * T(k - first + 1) / T(all - first)));
  return (T(1) - b2) * z * z * z;
}

template <class T>
T iorAxis(T n) {
  return std::pow(std::max(n - T(1), T(0)) / (n + T(1)) / T(kIorLargest), T(1.0 / kIorPower));
}
template <class T>
T iorAt(T x) {
  const T v = T(kIorLargest) * std::pow(x, T(kIorPower));
  return std::max((T(1) + v) / (T(1) - v), T(1.0002));
}

inline constexpr int reflectionIndex(int r, int s, int phi, int mu) { return ((r * kS + s) * kPhi + phi) * kMu + mu; }
inline constexpr int glassIndex(int side, int ior, int r, int s, int phi, int mu) {
  return (((ior * kGlassR + r) * kGlassS + s) * kGlassPhi[side] + phi) * kGlassMu + mu;
}

}  // namespace gobo::anisotropic
