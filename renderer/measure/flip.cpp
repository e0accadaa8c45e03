// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/check.h"
#include "measure/display.h"
#include "measure/perceptual.h"

namespace gobo {
inline namespace measure {
namespace {

using Plane = std::vector<double>;
struct Triple {
  Plane c[3];
};

/// Linear Rec.709 to XYZ and the D65 white that belongs to it: the rational form that FLIP fixes (Section 4.1 and its errata).
constexpr double kToXyz[3][3] = {{10135552.0 / 24577794, 8788810.0 / 24577794, 4435075.0 / 24577794},
                                 {2613072.0 / 12288897, 8788810.0 / 12288897, 887015.0 / 12288897},
                                 {1425312.0 / 73733382, 8788810.0 / 73733382, 70074185.0 / 73733382}};
const DVec3 kWhite(kToXyz[0][0] + kToXyz[0][1] + kToXyz[0][2], kToXyz[1][0] + kToXyz[1][1] + kToXyz[1][2], kToXyz[2][0] + kToXyz[2][1] + kToXyz[2][2]);
/// GLM matrices are column-major.
const glm::dmat3 kRgbToXyz(kToXyz[0][0], kToXyz[1][0], kToXyz[2][0], kToXyz[0][1], kToXyz[1][1], kToXyz[2][1], kToXyz[0][2], kToXyz[1][2], kToXyz[2][2]);
const glm::dmat3 kXyzToRgb = glm::inverse(kRgbToXyz);

/// Linear opponent space Y Cx Cz (Flohr et al. 1993), white normalised.
DVec3 toOpponent(const DVec3& rgb) {
  const DVec3 r = (kRgbToXyz * rgb) / kWhite;
  return DVec3(116 * r.y - 16, 500 * (r.x - r.y), 200 * (r.y - r.z));
}
DVec3 fromOpponent(const DVec3& o) {
  const double y = (o.x + 16) / 116;
  return kXyzToRgb * (DVec3(y + o.y / 500, y, y - o.z / 200) * kWhite);
}

/// CIELAB of a linear colour with the Hunt effect: chroma scaled by 0.01 L.
DVec3 toHuntLab(const DVec3& rgb) {
  DVec3 r = (kRgbToXyz * rgb) / kWhite;
  constexpr double delta = 6.0 / 29;
  for (int i = 0; i < 3; ++i) r[i] = r[i] > delta * delta * delta ? std::cbrt(r[i]) : r[i] / (3 * delta * delta) + 4.0 / 29;
  const double l = 116 * r.y - 16;
  return DVec3(l, 0.01 * l * 500 * (r.x - r.y), 0.01 * l * 200 * (r.y - r.z));
}

/// HyAB distance: city block in lightness, Euclidean in chroma.
double hyab(const DVec3& a, const DVec3& b) { return std::fabs(a.x - b.x) + std::hypot(a.y - b.y, a.z - b.z); }

/// out = in filtered by the outer product of two odd kernels of the same length, borders replicated.
Plane filter(const Plane& in, int w, int h, const std::vector<double>& across, const std::vector<double>& down) {
  const int r = int(across.size()) / 2;
  Plane rows(in.size()), out(in.size(), 0.0), padded(size_t(w) + 2 * r);
  for (int y = 0; y < h; ++y) {
    const double* line = in.data() + size_t(y) * w;
    for (int x = -r; x < w + r; ++x) padded[size_t(x + r)] = line[std::clamp(x, 0, w - 1)];
    double* to = rows.data() + size_t(y) * w;
    std::fill(to, to + w, 0.0);
    for (int k = 0; k <= 2 * r; ++k)
      for (int x = 0; x < w; ++x) to[x] += across[k] * padded[size_t(x + k)];
  }
  for (int y = 0; y < h; ++y)
    for (int k = -r; k <= r; ++k) {
      const double* from = rows.data() + size_t(std::clamp(y + k, 0, h - 1)) * w;
      double* to = out.data() + size_t(y) * w;
      for (int x = 0; x < w; ++x) to[x] += down[k + r] * from[x];
    }
  return out;
}

/// A contrast sensitivity function as one or two Gaussians in the pixel domain, a sqrt(pi/b) exp(-pi^2 x^2 / b) (Table 1).
struct Sensitivity {
  double a1, b1, a2, b2;
};
constexpr Sensitivity kSensitivity[3] = {{1, 0.0047, 0, 1e-5}, {1, 0.0053, 0, 1e-5}, {34.1, 0.04, 13.5, 0.025}};

Plane contrastFiltered(const Plane& in, int w, int h, const Sensitivity& s, double ppd) {
  const int r = int(std::ceil(3 * std::sqrt(0.04 / (2 * std::numbers::pi * std::numbers::pi)) * ppd));  // of the widest of them all
  const auto gaussian = [&](double b) {
    std::vector<double> g(2 * size_t(r) + 1);
    for (int i = -r; i <= r; ++i) g[size_t(i + r)] = std::exp(-std::numbers::pi * std::numbers::pi * (i / ppd) * (i / ppd) / b);
    return g;
  };
  const auto weight = [](double a, double b) { return a * std::sqrt(std::numbers::pi / b); };
  const auto sumOf = [](const std::vector<double>& g) {
    double sum = 0;
    for (double v : g) sum += v;
    return sum;
  };
  const auto g1 = gaussian(s.b1), g2 = gaussian(s.b2);
  const double w1 = weight(s.a1, s.b1), w2 = weight(s.a2, s.b2);
  const double total = w1 * sumOf(g1) * sumOf(g1) + w2 * sumOf(g2) * sumOf(g2);
  Plane out = filter(in, w, h, g1, g1);
  for (double& v : out) v *= w1 / total;
  if (w2 > 0) {
    const Plane second = filter(in, w, h, g2, g2);
    for (size_t i = 0; i < out.size(); ++i) out[i] += second[i] * (w2 / total);
  }
  return out;
}

/// Length of the (x, y) response to an edge (first derivative) or point (second derivative) detector, Section 4.2.
Plane featureLength(const Plane& luminance, int w, int h, double ppd, bool point) {
  const double sd = 0.5 * 0.082 * ppd;
  const int r = int(std::ceil(3 * sd));
  std::vector<double> g(2 * size_t(r) + 1), d(g.size());
  double sum = 0, positive = 0, negative = 0;
  for (int i = -r; i <= r; ++i) {
    const double value = std::exp(-i * i / (2 * sd * sd)), derivative = point ? (i * i / (sd * sd) - 1) * value : -i * value;
    g[size_t(i + r)] = value, d[size_t(i + r)] = derivative;
    sum += value;
    (derivative > 0 ? positive : negative) += std::fabs(derivative);
  }
  for (double& v : g) v /= sum;  // positive weights sum to 1, negative ones to -1
  for (double& v : d) v /= v > 0 ? positive : negative;
  const Plane x = filter(luminance, w, h, d, g), y = filter(luminance, w, h, g, d);
  Plane out(x.size());
  for (size_t i = 0; i < out.size(); ++i) out[i] = std::hypot(x[i], y[i]);
  return out;
}

struct Prepared {
  std::vector<DVec3> lab;
  Plane edges, points;
};

Prepared prepare(const Image& image, double ppd) {
  const int w = image.width, h = image.height;
  Triple opponent;
  for (Plane& p : opponent.c) p.resize(image.pixels());
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x) {
      const Vec3 c = image.rgb(x, y);
      // The sRGB encoding and FLIP's own decoding cancel, so the clamped linear colour goes in.
      const DVec3 o = toOpponent(DVec3(displayLinear(c.x), displayLinear(c.y), displayLinear(c.z)));
      for (int k = 0; k < 3; ++k) opponent.c[k][size_t(y) * w + x] = o[k];
    }
  Prepared out;
  Plane luminance(image.pixels());
  for (size_t i = 0; i < luminance.size(); ++i) luminance[i] = (opponent.c[0][i] + 16) / 116;
  out.edges = featureLength(luminance, w, h, ppd, false);
  out.points = featureLength(luminance, w, h, ppd, true);
  for (int k = 0; k < 3; ++k) opponent.c[k] = contrastFiltered(opponent.c[k], w, h, kSensitivity[k], ppd);
  out.lab.reserve(image.pixels());
  for (size_t i = 0; i < image.pixels(); ++i) {
    const DVec3 rgb = fromOpponent(DVec3(opponent.c[0][i], opponent.c[1][i], opponent.c[2][i]));
    out.lab.push_back(toHuntLab(glm::clamp(rgb, 0.0, 1.0)));
  }
  return out;
}

}  // namespace

double flipPixelsPerDegree() { return 0.7 * (3840 / 0.7) * (std::numbers::pi / 180); }

std::vector<double> flipMap(const Image& reference, const Image& test, double ppd) {
  GOBO_CHECK(reference.width == test.width && reference.height == test.height && reference.pixels() > 0 && ppd > 0);
  constexpr double qc = 0.7, pc = 0.4, pt = 0.95, qf = 0.5;
  const Prepared a = prepare(reference, ppd), b = prepare(test, ppd);
  const double largest = std::pow(hyab(toHuntLab(DVec3(0, 1, 0)), toHuntLab(DVec3(0, 0, 1))), qc), knee = pc * largest;
  std::vector<double> out(reference.pixels());
  for (size_t i = 0; i < out.size(); ++i) {
    const double powered = std::pow(hyab(a.lab[i], b.lab[i]), qc);
    const double colour = powered < knee ? pt / knee * powered : pt + (powered - knee) / (largest - knee) * (1 - pt);
    const double edges = std::fabs(a.edges[i] - b.edges[i]), points = std::fabs(a.points[i] - b.points[i]);
    const double feature = std::pow(std::max(edges, points) / std::sqrt(2.0), qf);
    out[i] = colour <= 0 ? 0.0 : std::clamp(std::pow(colour, 1 - feature), 0.0, 1.0);
  }
  return out;
}

}  // namespace measure
}  // namespace gobo
