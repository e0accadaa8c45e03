// SPDX-License-Identifier: Apache-2.0
// BSDFs against closed forms and independent computations: Fresnel at normal incidence, smooth limits, thin films against transfer
// matrices, albedo tables against quadrature over directions with the textbook formulas, Charlie sheen.
#include <gtest/gtest.h>

#include <complex>

#include "support/furnace.h"
#include "trace/bsdf_albedo.h"
#include "trace/bsdf_film.h"
#include "trace/bsdf_ggx.h"

namespace gobo {
namespace {

using test::localDirection;
constexpr double pi = 3.14159265358979323846;

TEST(BsdfOracle, FresnelAtNormalIncidenceAndBrewster) {
  for (double n : {1.1, 1.33, 1.5, 2.4}) {
    const double f0 = (n - 1) * (n - 1) / ((n + 1) * (n + 1));
    EXPECT_NEAR(fresnelDielectric(1.0f, float(n)), f0, 1e-6);
    EXPECT_NEAR(fresnelDielectric(1.0f, float(1 / n)), f0, 1e-6);
    // At Brewster's angle the parallel part vanishes: half of the perpendicular one, ((1 - n^2)/(1 + n^2))^2, is left.
    const double s = (1 - n * n) / (1 + n * n);
    EXPECT_NEAR(fresnelDielectric(float(1 / std::sqrt(1 + n * n)), float(n)), 0.5 * s * s, 1e-6);
    EXPECT_EQ(fresnelDielectric(float(0.99 * std::sqrt(1 - 1 / (n * n))), float(1 / n)), 1.0f);
  }
}

/// Roughness to 0: the rough lobe reflects what the mirror reflects.
TEST(BsdfOracle, SmoothLimitOfRoughLobes) {
  for (double c : {0.95, 0.5}) {
    const Vec3 wo = localDirection(c, 0.3);
    for (int kind = 0; kind < 3; ++kind) {
      BsdfParams smooth;
      smooth.albedo = Vec3(0.6f);
      if (kind == 0) smooth.metallic = 1;
      if (kind == 1) smooth.transmission = 1;
      if (kind == 2) {
        smooth.metallic = 1;
        smooth.iridescence = 1;
        smooth.iridescenceThickness = 300;
      }
      smooth.roughness = 0;
      BsdfParams rough = smooth;
      rough.roughness = 0.05f;
      EXPECT_NEAR(test::furnace(smooth, wo, 1).mean, test::furnace(rough, wo, 2).mean, 0.01) << kind;
    }
  }
}

/// Reflectance of a film by the characteristic matrix (Born & Wolf 1.6), one wavelength, both polarisations.
double transferMatrix(double c, double n, double d, double base, double wavelength) {
  using C = std::complex<double>;
  const double s = std::sqrt(1 - c * c), c2 = std::sqrt(1 - s * s / (n * n)), c3 = std::sqrt(1 - s * s / (base * base));
  double sum = 0;
  for (bool parallel : {false, true}) {
    const double q1 = parallel ? 1 / c : c, q2 = parallel ? n / c2 : n * c2, q3 = parallel ? base / c3 : base * c3;
    const double delta = 2 * pi * n * d * c2 / wavelength;
    const C i(0, 1), m11 = std::cos(delta), m12 = -i / q2 * std::sin(delta), m21 = -i * q2 * std::sin(delta), m22 = m11;
    const C b = m11 + m12 * q3, a = m21 + m22 * q3, r = (q1 * b - a) / (q1 * b + a);
    sum += 0.5 * std::norm(r);
  }
  return sum;
}

/// The extension's Gaussian colour matching functions over frequency, integrated numerically.
Vec3 filmByQuadrature(double c, double n, double d, double base) {
  const double weight[4] = {5.4856e-13, 4.4201e-13, 5.2481e-13, 9.7470e-14}, position[4] = {1.6810e6, 1.7953e6, 2.2084e6, 2.2399e6},
               variance[4] = {4.3278e9, 9.3046e9, 6.6121e9, 4.5282e9};
  double xyz[4] = {0, 0, 0, 0}, white[4] = {0, 0, 0, 0};
  for (int k = 0; k < 4; ++k)
    for (int j = -400; j <= 400; ++j) {
      // cos(position phase) exp(-variance phase^2), phase = 2 pi path: a Gaussian over wave numbers around `position` with deviation sqrt(2
      // variance).
      const double x = 6.0 * j / 400, wave = position[k] + std::sqrt(2 * variance[k]) * x,
                   g = std::exp(-0.5 * x * x) * weight[k] * std::sqrt(2 * pi * variance[k]);
      xyz[k] += g * transferMatrix(c, n, d * 1e-9, base, 1.0 / wave);
      white[k] += g;
    }
  const auto rgb = [](const double* v, double out[3]) {
    const double x = v[0] + v[3], y = v[1], z = v[2];
    out[0] = 3.2404542 * x - 1.5371385 * y - 0.4985314 * z;
    out[1] = -0.9692660 * x + 1.8760108 * y + 0.0415560 * z;
    out[2] = 0.0556434 * x - 0.2040259 * y + 1.0572252 * z;
  };
  double a[3], b[3];
  rgb(xyz, a);
  rgb(white, b);
  return Vec3(float(a[0] / b[0]), float(a[1] / b[1]), float(a[2] / b[2]));
}

TEST(BsdfOracle, ThinFilmIsTheTransferMatrixIntegratedOverWavelengths) {
  double worst = 0;
  for (double base : {1.33, 1.5, 2.0})
    for (double n : {1.2, 1.38, 1.8, 2.3})
      for (double d : {0.0, 100.0, 250.0, 400.0, 900.0})
        for (double c : {1.0, 0.7, 0.35, 0.1}) {
          const double f0 = std::pow((base - 1) / (base + 1), 2);
          const Vec3 model = filmReflectance(float(c), float(n), float(d), Vec3(float(f0)));
          const Vec3 truth = glm::clamp(filmByQuadrature(c, n, d, base), Vec3(0.0f), Vec3(1.0f));
          for (int k = 0; k < 3; ++k) {
            EXPECT_NEAR(model[k], truth[k], 4e-3) << "base " << base << " film " << n << " d " << d << " cos " << c << " channel " << k;
            worst = std::max(worst, double(std::fabs(model[k] - truth[k])));
          }
        }
  std::printf("  thin film, 240 cases: largest difference to the transfer matrix %.5f\n", worst);
}

TEST(BsdfOracle, NoFilmIsTheBareBase) {
  for (float c : {1.0f, 0.5f, 0.2f})
    for (float n : {1.0f, 1.3f, 2.0f})
      for (float base : {1.2f, 1.5f, 2.5f}) {
        const float f0 = sqr((base - 1) / (base + 1));
        const Vec3 bare = Vec3(fresnelDielectric(c, base)), film = filmReflectance(c, n, 0.0f, Vec3(f0));
        for (int k = 0; k < 3; ++k) EXPECT_NEAR(film[k], bare[k], 3e-3f) << c << " " << n << " " << base;
      }
}

/// Walter's D, Heitz's G2 from lambdas, in double, over directions around the mirror lobe: nothing shared with the tables' quadrature.
double albedoByDirections(double mu, double a, bool schlick) {
  const int n = 500;
  double sum = 0;
  const double ox = std::sqrt(1 - mu * mu), lo = 0.5 * (std::sqrt(1 + a * a * ox * ox / (mu * mu)) - 1);
  for (int j = 0; j < n; ++j)
    for (int k = 0; k < n; ++k) {
      const double z = (j + 0.5) / n, phi = pi * (k + 0.5) / n, s = std::sqrt(1 - z * z), x = s * std::cos(phi), y = s * std::sin(phi);
      double hx = ox + x, hy = y, hz = mu + z;
      const double l = std::sqrt(hx * hx + hy * hy + hz * hz);
      hz /= l;
      const double c = (ox * hx + mu * hz * l) / l, t2 = (1 - hz * hz) / (hz * hz);
      const double d = 1 / (pi * a * a * std::pow(hz, 4) * std::pow(1 + t2 / (a * a), 2));
      const double li = 0.5 * (std::sqrt(1 + a * a * s * s / (z * z)) - 1);
      sum += d / ((1 + lo + li) * 4 * mu) * (schlick ? std::pow(1 - c, 5) : 1.0);
    }
  return sum * 2 * pi / (double(n) * n);
}

TEST(BsdfOracle, AlbedoTablesAgainstQuadratureOverDirections) {
  double low = 0, high = 0;
  for (float a : {0.15f, 0.33f, 0.6f, 1.0f}) {
    const ReflectionAlbedo table(a, std::sqrt(a));
    for (float mu : {0.03f, 0.11f, 0.37f, 0.62f, 0.93f}) {
      const ReflectionAlbedo::Value v = table.at(mu);
      const double e = albedoByDirections(mu, a, false) + v.deficit - 1.0, s = v.schlick - albedoByDirections(mu, a, true);
      EXPECT_GT(e, -0.003) << a << " " << mu;
      EXPECT_LT(e, 0.0005) << a << " " << mu;
      EXPECT_NEAR(s, 0.001, 0.003) << a << " " << mu;
      low = std::min(low, e);
      high = std::max(high, e);
    }
  }
  std::printf("  GGX albedo + deficit - 1: %.5f .. %.5f\n", low, high);
}

/// Alpha 1 seen along the normal: D = 1 / pi and G2 = 2 o i / (o + i) leave 1 - ln 2.
TEST(BsdfOracle, AlbedoOfAlphaOneAlongTheNormal) {
  EXPECT_NEAR(ReflectionAlbedo(1.0f, 1.0f).at(1.0f).deficit, std::log(2.0) - 0.001, 1e-4);  // the table's margin
}

TEST(BsdfOracle, KernelOfBouncedLightReturnsTheDeficit) {
  for (float a : {0.002f, 0.05f, 0.4f, 1.0f}) {
    const ReflectionAlbedo table(a, std::sqrt(a));
    double mean = 0;
    const int n = 200000;
    for (int k = 0; k < n; ++k) {
      const double mu = (k + 0.5) / n;
      mean += 2 * mu * table.at(float(mu)).deficit / n;
    }
    EXPECT_NEAR(table.deficitMean / mean, 1.0, 0.05) << a;
  }
}

/// Glass by an independent route: the mean of the sampler's own single-scattering weights over the visible normals.
TEST(BsdfOracle, GlassTableIsBelowTheTruthByLittle) {
  for (float ior : {1.15f, 1.5f, 2.2f})
    for (float roughness : {0.3f, 0.7f, 1.0f})
      for (bool inside : {false, true})
        for (float mu : {0.06f, 0.4f, 0.9f}) {
          const float eta = inside ? 1 / ior : ior, a = roughness * roughness;
          const Ggx g(a);
          const Vec3 o = localDirection(mu);
          double sum = 0;
          const int n = 20000;
          for (int k = 0; k < n; ++k) {
            SobolSampler u(9, uint32_t(k));
            const Vec3 h = g.sample(o, u.next2D());
            const float c = glm::dot(o, h), f = fresnelDielectric(c, eta), so = g.root(o);
            const Vec3 r = 2.0f * c * h - o;
            Vec3 t;
            const auto passes = [&](float z, const Vec3& i) { return (o.z + so) * 0.5f * smithG2OverViewCosine(o.z, so, z, g.root(i)); };
            if (r.z > 0) sum += f * passes(r.z, r);
            if (refract(o, h, eta, t) && t.z < 0) sum += (1 - f) * passes(-t.z, t);
          }
          const double lost = 1 - sum / n, table = GlassAlbedo(a, ior).deficit(mu, inside);
          EXPECT_LT(table, lost + 0.002) << ior << " " << roughness << " " << mu << " inside " << inside;
          EXPECT_GT(table, lost - 0.012) << ior << " " << roughness << " " << mu << " inside " << inside;
        }
}

/// Charlie (Estevez & Kulla 2017): integral of D cos over the hemisphere is 1; the model's value from the printed formulas.
TEST(BsdfOracle, SheenIsCharlie) {
  BsdfParams p;
  p.albedo = Vec3(0.0f);
  p.specular = 0;
  p.sheenColor = Vec3(1.0f);
  p.sheenRoughness = 0.6f;
  const double alpha = 0.36, t = (1 - alpha) * (1 - alpha);
  const auto lambda = [&](double c) {
    const auto l = [&](double x) {
      return std::lerp(21.5473, 25.3245, t) / (1 + std::lerp(3.82987, 3.32435, t) * std::pow(x, std::lerp(0.19823, 0.16801, t))) +
             std::lerp(-1.97760, -1.27393, t) * x + std::lerp(-4.32054, -4.85967, t);
    };
    return c < 0.5 ? std::exp(l(c)) : std::exp(2 * l(0.5) - l(1 - c));
  };
  for (double co : {0.9, 0.3})
    for (double ci : {0.7, 0.2}) {
      const Vec3 o = localDirection(co, 0), i = localDirection(ci, 2), h = glm::normalize(o + i);
      const double d = (2 + 1 / alpha) * std::pow(1 - double(h.z) * h.z, 0.5 / alpha) / (2 * pi);
      EXPECT_NEAR(bsdfEval(p, o, i).sum().x, d / ((1 + lambda(co) + lambda(ci)) * 4 * co), 1e-4);
    }
  double e = 0;
  for (int k = 0; k < 20000; ++k) {
    const double z = (k + 0.5) / 20000;
    e += (2 + 1 / alpha) * std::pow(1 - z * z, 0.5 / alpha) * z / 20000;
  }
  EXPECT_NEAR(e, 1.0, 1e-4);
  for (double c : {0.05, 0.3, 0.8}) EXPECT_NEAR(test::furnace(p, localDirection(c), 3).mean, sheenAlbedo(float(c), 0.6f), 0.012) << c;
}

}  // namespace
}  // namespace gobo
