// SPDX-License-Identifier: Apache-2.0
// Directional albedos of the microfacet models in double precision, by midpoint rules over the square of the visible-normal
// sampler (GGX) or over the hemisphere (sheen). Shared by the program that prints the renderer's tables and by the tests.
#pragma once

#include <algorithm>
#include <cmath>

namespace gobo::tables {

struct V3 {
  double x, y, z;
};
inline double dot(const V3& a, const V3& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline double sq(double x) { return x * x; }
inline constexpr double pi = 3.14159265358979323846;

struct Albedo {
  double all = 0, schlick = 0;
};  ///< of F = 1, of F = (1 - c)^5

/// sqrt(z^2 + ax^2 x^2 + ay^2 y^2): Smith's G1 = 2 z / (z + root).
inline double root(const V3& v, double ax, double ay) { return std::sqrt(v.z * v.z + sq(ax * v.x) + sq(ay * v.y)); }

/// Visible normal (Dupuy & Benyoub 2023).
inline V3 visibleNormal(const V3& o, double ax, double ay, double u, double v) {
  V3 w{ax * o.x, ay * o.y, o.z};
  const double l = std::sqrt(dot(w, w));
  w = {w.x / l, w.y / l, w.z / l};
  const double z = (1 - v) * (1 + w.z) - w.z, r = std::sqrt(std::max(1 - z * z, 0.0)), phi = 2 * pi * u;
  V3 h{ax * (r * std::cos(phi) + w.x), ay * (r * std::sin(phi) + w.y), std::max(z + w.z, 0.0)};
  const double n = std::sqrt(dot(h, h));
  return n > 0 ? V3{h.x / n, h.y / n, h.z / n} : V3{0, 0, 1};
}
/// G2 / G1(o), height-correlated; iz > 0 is |cos|.
inline double shadowing(double oz, double so, double iz, double si) { return (oz + so) / (oz * (si / iz) + so); }

inline V3 direction(double cosine, double phi = 0) {
  const double s = std::sqrt(std::max(1 - cosine * cosine, 0.0));
  return {s * std::cos(phi), s * std::sin(phi), cosine};
}

/// Reflection of single-scattering GGX. n x n points; without `whole` over the half plane y > 0 (for isotropic alpha and o.y = 0).
inline Albedo reflection(const V3& o, double ax, double ay, int n, bool whole = false) {
  Albedo a;
  const double so = root(o, ax, ay);
  for (int j = 0; j < n; ++j)
    for (int k = 0; k < n; ++k) {
      const double t = 1 - (j + 0.5) / n;  // denser at v = 1, where reflections graze
      const V3 h = visibleNormal(o, ax, ay, (k + 0.5) / (whole ? n : 2 * n), 1 - t * t);
      const double c = dot(o, h);
      if (!(c > 0)) continue;
      const V3 i{2 * c * h.x - o.x, 2 * c * h.y - o.y, 2 * c * h.z - o.z};
      if (!(i.z > 0)) continue;
      const double g = 2 * t * shadowing(o.z, so, i.z, root(i, ax, ay));
      a.all += g;
      a.schlick += g * std::pow(std::max(1 - c, 0.0), 5);
    }
  return {a.all / (double(n) * n), a.schlick / (double(n) * n)};
}

inline double fresnel(double c, double eta) {
  const double s2 = (1 - c * c) / (eta * eta);
  if (s2 >= 1) return 1;
  const double t = std::sqrt(1 - s2);
  return 0.5 * (sq((c - eta * t) / (c + eta * t)) + sq((eta * c - t) / (eta * c + t)));
}

/// Reflection plus refraction of a rough dielectric, as flux; eta = far over near index.
inline double dielectric(const V3& o, double alpha, double eta, int n) {
  double sum = 0;
  const double so = root(o, alpha, alpha);
  for (int j = 0; j < n; ++j)
    for (int k = 0; k < n; ++k) {
      const double w = 1 - (j + 0.5) / n;
      const V3 h = visibleNormal(o, alpha, alpha, (k + 0.5) / (2 * n), 1 - w * w);  // the other half mirrors it
      const double c = dot(o, h);
      if (!(c > 0)) continue;
      const double f = fresnel(c, eta);
      const V3 r{2 * c * h.x - o.x, 2 * c * h.y - o.y, 2 * c * h.z - o.z};
      if (r.z > 0) sum += 2 * w * f * shadowing(o.z, so, r.z, root(r, alpha, alpha));
      if (f < 1) {
        const double k2 = c / eta - std::sqrt(std::max(1 - (1 - c * c) / (eta * eta), 0.0));
        const V3 t{-o.x / eta + k2 * h.x, -o.y / eta + k2 * h.y, -o.z / eta + k2 * h.z};
        if (t.z < 0) sum += 2 * w * (1 - f) * shadowing(o.z, so, -t.z, root(t, alpha, alpha));
      }
    }
  return sum / (double(n) * n);
}

/// The same with two alphas.
inline double dielectric(const V3& o, double ax, double ay, double eta, int n) {
  double sum = 0;
  const double so = root(o, ax, ay);
  for (int j = 0; j < n; ++j)
    for (int k = 0; k < n; ++k) {
      const double w = 1 - (j + 0.5) / n;
      const V3 h = visibleNormal(o, ax, ay, (k + (j & 1 ? 0.75 : 0.25)) / n, 1 - w * w);  // staggered rings
      const double c = dot(o, h);
      if (!(c > 0)) continue;
      const double f = fresnel(c, eta);
      const V3 r{2 * c * h.x - o.x, 2 * c * h.y - o.y, 2 * c * h.z - o.z};
      if (r.z > 0) sum += 2 * w * f * shadowing(o.z, so, r.z, root(r, ax, ay));
      if (f < 1) {
        const double k2 = c / eta - std::sqrt(std::max(1 - (1 - c * c) / (eta * eta), 0.0));
        const V3 t{-o.x / eta + k2 * h.x, -o.y / eta + k2 * h.y, -o.z / eta + k2 * h.z};
        if (t.z < 0) sum += 2 * w * (1 - f) * shadowing(o.z, so, -t.z, root(t, ax, ay));
      }
    }
  return sum / (double(n) * n);
}

/// Charlie's lambda (Estevez & Kulla 2017) as KHR_materials_sheen writes it.
inline double sheenLambda(double c, double alpha) {
  const double t = sq(1 - alpha);
  const auto l = [&](double x) {
    const double a = 21.5473 + t * (25.3245 - 21.5473), b = 3.82987 + t * (3.32435 - 3.82987), p = 0.19823 + t * (0.16801 - 0.19823);
    const double d = -1.97760 + t * (-1.27393 + 1.97760), e = -4.32054 + t * (-4.85967 + 4.32054);
    return a / (1 + b * std::pow(x, p)) + d * x + e;
  };
  return c < 0.5 ? std::exp(l(c)) : std::exp(2 * l(0.5) - l(1 - c));
}
inline double sheenF(const V3& o, const V3& i, double alpha) {
  V3 h{o.x + i.x, o.y + i.y, o.z + i.z};
  const double l2 = dot(h, h), s2 = std::max(1 - h.z * h.z / l2, 0.0), inv = 1 / alpha;
  const double d = (2 + inv) * std::pow(s2, 0.5 * inv) / (2 * pi);
  return d / ((1 + sheenLambda(o.z, alpha) + sheenLambda(i.z, alpha)) * 4 * o.z * i.z);
}
/// Directional albedo of white sheen (may exceed 1).
inline double sheen(const V3& o, double alpha, int n) {
  double sum = 0;
  for (int j = 0; j < n; ++j)
    for (int k = 0; k < n; ++k) {
      const double t = (j + 0.5) / n, c = t * t;  // denser near the horizon
      sum += sheenF(o, direction(c, pi * (k + 0.5) / n), alpha) * c * 2 * t;
    }
  return sum * 2 * pi / (double(n) * n);
}

}  // namespace gobo::tables
