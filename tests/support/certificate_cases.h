// SPDX-License-Identifier: Apache-2.0
// Synthetic pictures with a known truth, and cheap noisy parts of it at any pixel: what the certificate's coverage is
// measured on, by the unit test (some hundred seeds) and by bench/certificate_bench.cpp (a thousand and more).
#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>
#include <string>
#include <vector>

#include "base/sobol.h"
#include "base/vec.h"
#include "measure/certificate.h"
#include "measure/certificate_pixels.h"

namespace gobo::testing {

/// A stream of pseudo-random numbers, all determined by the seed.
class Stream {
 public:
  explicit Stream(uint64_t seed) : state_(mix64(seed + 0x1234567)) {}
  double uniform() { return (double(mix64(state_ += 0x9e3779b97f4a7c15ull) >> 11) + 0.5) * 0x1p-53; }
  double normal() { return std::sqrt(-2 * std::log(uniform())) * std::cos(2 * 3.141592653589793 * uniform()); }
  double exponential() { return -std::log(uniform()); }
  /// Mean 1, log-deviation s.
  double logNormal(double s) { return std::exp(s * normal() - 0.5 * s * s); }
  /// Pareto of tail index a, minus its mean, unit scale: variance a / ((a-1)^2 (a-2)).
  double pareto(double a) { return std::pow(uniform(), -1 / a) - a / (a - 1); }

 private:
  uint64_t state_;
};

enum class Tail { Gauss, LogNormal, Firefly };

/// Noise of half the parts together: standard deviation (relative to `sigma` per pixel) `level`.
struct HalfNoise {
  double level;
  Tail tail;
};

/// Hidden: an error on so few pixels that only the trimmed figures are promised.
enum class Kind { Noisy, Biased, Mixed, Hidden, Exact };
inline const char* kindName(Kind k) {
  const char* names[] = {"noisy", "biased", "mixed", "hidden", "exact"};
  return names[int(k)];
}

struct CertificateCase {
  std::string name;
  Kind kind;
  HalfNoise noise;
  int size = 0;
  std::vector<Vec3> truth, picture;
  std::vector<double> sigma;                      ///< per pixel, the scale of Monte Carlo noise
  bool widthPromised = false;                     ///< at most 25 % of half-width at 1 % of 512 x 512 pixels; the others are
                                                  ///< stress: halves several times noisier than the error, very heavy tails, or too few pixels in error
  double rmse = 0, relMse = 0;                    ///< of the whole picture
  std::vector<double> squaredSums, relativeSums;  ///< descending prefix: [k] = mean over the picture without its k largest

  Vec3 part(size_t pixel, Stream& random) const {
    const Vec3 t = truth[pixel];
    const double s = noise.level * sigma[pixel] * std::sqrt(0.5 * kParts);
    if (s == 0) return t;
    double grey = 0;  // channels of a path share their noise for the most part
    if (noise.tail == Tail::Gauss) grey = s * random.normal();
    if (noise.tail == Tail::LogNormal) {
      const double shape = 1.2, deviation = std::sqrt(std::exp(shape * shape) - 1);
      grey = s * (random.logNormal(shape) - 1) / deviation;
    }
    if (noise.tail == Tail::Firefly) {  // two thirds of the variance from one sample in 200
      const double rate = 0.005, size = std::sqrt(2.0 / 3 / rate / 2);
      grey = s * (std::sqrt(1.0 / 3) * random.normal() + (random.uniform() < rate ? size * random.exponential() : 0.0) - rate * size);
    }
    Vec3 out;
    for (int c = 0; c < 3; ++c) out[c] = float(t[c] + grey * (0.8 + 0.2 * c) + 0.3 * s * random.normal());
    return out;
  }

  /// Chances of the pixels when a share of them is drawn.
  std::vector<float> chances(double fraction) const {
    std::vector<float> rgb;
    for (const Vec3& p : picture) rgb.insert(rgb.end(), {p.x, p.y, p.z});
    return drawingChances(forecastError(rgb, size, size), std::round(fraction * double(picture.size())));
  }
  std::vector<PixelEvidence> evidence(const std::vector<float>& chances, uint64_t seed) const {
    Stream random(hash64(seed, 77));
    std::vector<PixelEvidence> out;
    for (uint32_t p : drawPixels(size, size, chances, seed)) {
      PixelEvidence e{picture[p], {}, double(chances[p])};
      for (Vec3& v : e.parts) v = part(p, random);
      out.push_back(e);
    }
    return out;
  }
  CertificateFigures run(const std::vector<float>& chances, uint64_t seed) const { return certify(evidence(chances, seed), picture.size()); }

  /// Smallest share of the pixels that holds half of the squared error (0 for an exact picture).
  double halfErrorArea() const {
    size_t k = 0;
    while (squaredSums[k] > 0.5 * squaredSums[0]) ++k;
    return double(k) / double(truth.size());
  }
  double rmseWithout(double area) const { return std::sqrt(squaredSums[size_t(area * double(truth.size()))]); }
  double relMseWithout(double area) const { return relativeSums[size_t(area * double(truth.size()))]; }
};

/// The signed error of the pixel at (x, y) in [0,1]^2, given its true value and noise scale.
using ErrorOf = std::function<double(double x, double y, double truth, double sigma, Stream& random)>;

inline CertificateCase makeCase(const std::string& name, Kind kind, HalfNoise noise, int size, const ErrorOf& error, uint64_t seed = 1) {
  CertificateCase out{name, kind, noise, size, {}, {}, {}, false, 0, 0, {}, {}};
  const size_t n = size_t(size) * size;
  std::vector<double> squared(n), relative(n);
  Stream random(hash64(seed, std::hash<std::string>{}(name)));
  for (size_t i = 0; i < n; ++i) {
    const double x = (double(i % size) + 0.5) / size, y = (double(i / size) + 0.5) / size;
    const bool dark = (int(x * 6) + int(y * 6)) % 2;  // textures, a gradient, a bright window
    const double base = (dark ? 0.08 : 0.6) * (0.4 + y) + (x > 0.8 && y < 0.2 ? 3.0 : 0.0);
    const double sigma = 0.02 + 0.25 * base * (0.2 + std::pow(std::sin(7 * x + 3 * y), 2.0)) + (std::hypot(x - 0.3, y - 0.6) < 0.12 ? 0.1 + 0.4 * base : 0);
    const double d = error(x, y, base, sigma, random);
    Vec3 t, p;
    for (int c = 0; c < 3; ++c) {
      t[c] = float(base * (1.1 - 0.15 * c));
      p[c] = float(t[c] + d * (0.9 + 0.1 * c));
      const double e = double(p[c]) - t[c];
      squared[i] += e * e / 3;
      relative[i] += e * e / (double(t[c]) * t[c] + kRelMseEpsilon) / 3;
    }
    out.truth.push_back(t), out.picture.push_back(p), out.sigma.push_back(sigma);
  }
  const auto trimmed = [n](std::vector<double> e) {
    std::sort(e.begin(), e.end());
    std::vector<double> sums(n + 1, 0);
    double sum = 0;
    for (size_t k = 0; k < n; ++k) sums[n - k - 1] = (sum += e[k]) / double(n);
    return sums;
  };
  out.squaredSums = trimmed(squared);
  out.relativeSums = trimmed(relative);
  out.rmse = std::sqrt(out.squaredSums[0]);
  out.relMse = out.relativeSums[0];
  return out;
}

/// Every case, on size x size pictures.
inline std::vector<CertificateCase> certificateCases(int size) {
  const HalfNoise even{1, Tail::Gauss}, strong{4, Tail::Gauss}, skewed{1, Tail::LogNormal}, fireflies{1, Tail::Firefly};
  const HalfNoise quiet{0.25, Tail::Gauss};
  const auto none = [](double, double, double, double, Stream&) { return 0.0; };
  const auto gauss = [](double, double, double, double s, Stream& r) { return s * r.normal(); };
  const auto logNormal = [](double, double, double, double s, Stream& r) { return s * 0.6 * (r.logNormal(1.0) - 1); };
  const auto firefly = [](double, double, double, double s, Stream& r) {
    return std::min(s, 0.15) * (r.normal() + (r.uniform() < 0.02 ? 5 * r.exponential() : 0.0));
  };
  const auto rareFirefly = [](double, double, double, double s, Stream& r) {
    return s * (0.6 * r.normal() + (r.uniform() < 0.01 ? 8 * r.exponential() : 0.0));
  };
  const auto pareto = [](double, double, double, double s, Stream& r) { return s * r.pareto(4.5); };
  const auto offset = [](double, double, double, double, Stream&) { return 0.05; };
  const auto blur = [](double x, double y, double t, double, Stream&) { return 0.2 * t * std::sin(9 * x) * std::cos(5 * y); };
  const auto band = [](double width, double depth) {  // a shadow's edge: signed error inside a ring of this width
    return [=](double x, double y, double, double, Stream&) {
      const double d = (std::hypot(x - 0.55, y - 0.45) - 0.3) / width;
      return std::fabs(d) < 1 ? depth * (1 - std::fabs(d)) * (d < 0 ? -1 : 1) : 0.0;
    };
  };
  const auto blob = [](double area, double depth) {  // a missing caustic
    return [=](double x, double y, double, double, Stream&) { return std::hypot(x - 0.611, y - 0.377) < std::sqrt(area / 3.14159265) ? depth : 0.0; };
  };
  const auto line = [](double area, double depth) {  // a missing contact shadow, 0.4 long, slanted
    return [=](double x, double y, double, double, Stream&) {
      const double across = (y - 0.7 - 0.21 * (x - 0.3));
      return x > 0.3 && x < 0.7 && std::fabs(across) < area / 0.8 ? depth : 0.0;
    };
  };
  const auto scattered = [](double area, double depth) { return [=](double, double, double, double, Stream& r) { return r.uniform() < area ? depth : 0.0; }; };
  const auto both = [](ErrorOf a, ErrorOf b, double scaleB = 1) {
    return [=](double x, double y, double t, double s, Stream& r) { return a(x, y, t, s, r) + scaleB * b(x, y, t, s, r); };
  };
  std::vector<CertificateCase> out;
  const auto add = [&](const char* name, Kind kind, HalfNoise noise, const ErrorOf& error, bool widthPromised = false) {
    out.push_back(makeCase(name, kind, noise, size, error));
    out.back().widthPromised = widthPromised;
  };
  add("noise, Gaussian", Kind::Noisy, even, gauss, true);
  add("noise, log-normal", Kind::Noisy, skewed, logNormal);
  add("noise, fireflies in both", Kind::Noisy, fireflies, firefly);
  add("noise, Pareto 4.5", Kind::Noisy, even, pareto);
  add("noise, halves 4x noisier", Kind::Noisy, strong, gauss);
  add("bias, constant", Kind::Biased, quiet, offset, true);
  add("bias, constant, noisy halves", Kind::Biased, even, offset);
  add("bias, constant, firefly halves", Kind::Biased, fireflies, offset);
  add("bias, blur-like", Kind::Biased, even, blur, true);
  add("bias, edges 5 % of pixels", Kind::Biased, quiet, band(0.0133, 0.4), true);
  add("bias, edges 5 %, skewed halves", Kind::Biased, {0.5, Tail::LogNormal}, band(0.0133, 0.4), true);
  add("bias, edges 2 % of pixels", Kind::Biased, quiet, band(0.0053, 0.4), true);
  add("bias, spot 1 % of pixels", Kind::Biased, quiet, blob(0.01, 0.5), true);
  add("mixed, noise + offset + edges", Kind::Mixed, even, both(both(gauss, offset), band(0.0133, 0.5)), true);
  add("mixed, log-normal + blur", Kind::Mixed, skewed, both(logNormal, blur));
  add("mixed, little noise + edges 2 %", Kind::Mixed, quiet, both(band(0.0053, 0.5), gauss, 0.1), true);
  add("hidden, spot 0.1 %", Kind::Hidden, quiet, blob(0.001, 2));
  add("hidden, spot 0.1 % + noise", Kind::Hidden, even, both(blob(0.001, 8), gauss, 0.3));
  add("hidden, line 0.1 % + noise", Kind::Hidden, even, both(line(0.001, -0.4), gauss, 0.1));
  add("hidden, line 0.1 %, firefly halves", Kind::Hidden, fireflies, both(line(0.001, -3), gauss, 0.3));
  add("hidden, scattered 0.1 %", Kind::Hidden, quiet, scattered(0.001, 3));
  add("hidden, scattered 0.1 % + offset", Kind::Hidden, even, both(scattered(0.001, 3), offset));
  add("hidden, fireflies mostly in a window", Kind::Hidden, fireflies, rareFirefly);
  add("hidden, spot 0.3 %", Kind::Hidden, quiet, blob(0.003, 2));
  add("exact, Gaussian halves", Kind::Exact, even, none);
  add("exact, log-normal halves", Kind::Exact, skewed, none);
  add("exact, firefly halves", Kind::Exact, fireflies, none);
  return out;
}

struct Coverage {
  double whole = 0;      ///< share of seeds whose interval holds the RMSE of the whole picture
  double trimmed = 0;    ///< ... for which rmseLow and rmseHighTrimmed hold
  double belowLow = 0;   ///< share with rmseLow above the RMSE of the whole picture
  double halfWidth = 0;  ///< median of (high - low) / 2 over the true RMSE (over 1 for an exact picture)
  double relWhole = 0, relTrimmed = 0, relHalfWidth = 0;
  double meanMse = 0, meanRelMse = 0;  ///< of the point estimates, over the truth
};

inline Coverage measureCoverage(const CertificateCase& picture, double fraction, int seeds, uint64_t firstSeed = 1) {
  Coverage out;
  std::vector<double> widths, relWidths;
  const std::vector<float> chances = picture.chances(fraction);
  for (int s = 0; s < seeds; ++s) {
    const CertificateFigures f = picture.run(chances, firstSeed + uint64_t(s));
    const double slack = 1 + 1e-6;  // float rounding of a noiseless constant error
    const bool low = f.rmseLow <= picture.rmse * slack, relLow = f.relMseLow <= picture.relMse * slack;
    out.belowLow += !low;
    out.whole += low && picture.rmse <= f.rmseHigh * slack;
    out.trimmed += low && picture.rmseWithout(f.unseenArea) <= f.rmseHighTrimmed * slack;
    out.relWhole += relLow && picture.relMse <= f.relMseHigh * slack;
    out.relTrimmed += relLow && picture.relMseWithout(f.unseenArea) <= f.relMseHighTrimmed * slack;
    widths.push_back((f.rmseHigh - f.rmseLow) / 2 / (picture.rmse > 0 ? picture.rmse : 1));
    relWidths.push_back((f.relMseHigh - f.relMseLow) / 2 / (picture.relMse > 0 ? picture.relMse : 1));
    out.meanMse += f.rmse * f.rmse, out.meanRelMse += f.relMse;
  }
  const auto median = [](std::vector<double>& v) {
    std::nth_element(v.begin(), v.begin() + v.size() / 2, v.end());
    return v[v.size() / 2];
  };
  for (double* share : {&out.whole, &out.trimmed, &out.belowLow, &out.relWhole, &out.relTrimmed, &out.meanMse, &out.meanRelMse}) *share /= seeds;
  if (picture.rmse > 0) out.meanMse /= picture.rmse * picture.rmse, out.meanRelMse /= picture.relMse;
  out.halfWidth = median(widths);
  out.relHalfWidth = median(relWidths);
  return out;
}

}  // namespace gobo::testing
