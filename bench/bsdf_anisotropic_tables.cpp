// SPDX-License-Identifier: Apache-2.0
// Writes renderer/trace/bsdf_anisotropic_*_data.h (argument: that folder; a minute on one core), or without an argument prints how far a fresh
// table is from the quadrature at random points. Nodes are fitted so that interpolation is not above the truth (of what Schlick adds: not
// below) at the points tried: bounced light must not be more than what was lost.
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include "../renderer/trace/bsdf_anisotropic_grid.h"
#include "bsdf_tables.h"

using namespace gobo::tables;
using namespace gobo::anisotropic;

namespace {

constexpr int kPoints = 48, kGlassPoints = 32;  // of the quadratures, squared
constexpr double kStep = 1.0 / 250;             // of glass, in bytes

struct Random {
  uint64_t state;
  double operator()() {
    state = state * 6364136223846793005ull + 1442695040888963407ull;
    return double(state >> 11) * 0x1p-53;
  }
};
V3 directionOf(double mu, double cos2Phi) {
  const double s = std::sqrt(std::max(1 - mu * mu, 0.0));
  return {s * std::sqrt(cos2Phi), s * std::sqrt(std::max(1 - cos2Phi, 0.0)), mu};
}
double pow5(double x) { return x * x * x * x * x; }

struct Taps {
  int n = 0, at[32];
  double w[32];
  void add(int i, double weight) {
    at[n] = i;
    w[n++] = weight;
  }
  double of(const std::vector<double>& v) const {
    double s = 0;
    for (int k = 0; k < n; ++k) s += w[k] * v[size_t(at[k])];
    return s;
  }
};
Taps reflectionTaps(double r, double s, const V3& o) {
  double sin2, cos2;
  azimuth(o.x, o.y, sin2, cos2);
  const double scale = reflectionScale(alphaX(r, s), alphaY(r), cos2);
  const Cell<double> a = cell(r, kR), b = cell(s, kS), m = cell(cosineAxis(o.z, scale), kMu);
  const Pair<double> p = azimuthPair(cos2, 1.0, kPhi, kPhi);
  Taps t;
  for (int c = 0; c < 16; ++c)
    t.add(reflectionIndex(a.k + (c & 1), b.k + (c >> 1 & 1), c & 4 ? p.b : p.a, m.k + (c >> 3)),
          (c & 1 ? a.f : 1 - a.f) * (c & 2 ? b.f : 1 - b.f) * (c & 4 ? p.f : 1 - p.f) * (c & 8 ? m.f : 1 - m.f));
  return t;
}
Taps glassTaps(int side, double r, double s, double n, const V3& o) {
  double sin2, cos2;
  azimuth(o.x, o.y, sin2, cos2);
  const Cell<double> a = cell(r, kGlassR), b = cell(s, kGlassS), m = cell(cosineAxis(o.z, 2 * alphaX(r, s)), kGlassMu), i = cell(iorAxis(n), kGlassIor);
  const Pair<double> p = azimuthPair(cos2, edge2(side == 1, n, sin2), kFirstPiece[side], kGlassPhi[side]);
  Taps t;
  for (int c = 0; c < 32; ++c)
    t.add(glassIndex(side, i.k + (c >> 4), a.k + (c & 1), b.k + (c >> 1 & 1), c & 4 ? p.b : p.a, m.k + (c >> 3 & 1)),
          (c & 1 ? a.f : 1 - a.f) * (c & 2 ? b.f : 1 - b.f) * (c & 4 ? p.f : 1 - p.f) * (c & 8 ? m.f : 1 - m.f) * (c & 16 ? i.f : 1 - i.f));
  return t;
}
/// Fits nodes to points by projections (Kaczmarz): first to the truth less a margin from both sides, which halves the error that
/// nodes with exact values have between them, then only downwards until no point is above the truth.
struct Fit {
  static constexpr double kMargin = 0.003;
  struct Point {
    Taps t;
    double truth;
  };
  std::vector<Point> points;
  void add(const Taps& t, double truth) { points.push_back({t, truth}); }
  void run(std::vector<double>& v) const {
    for (int sweep = 0; sweep < 40; ++sweep) {
      const bool fitting = sweep < 20;
      for (const Point& p : points) {
        double squares = 0;
        for (int k = 0; k < p.t.n; ++k) squares += sq(p.t.w[k]);
        const double above = p.t.of(v) - p.truth + (fitting ? kMargin : 0.0);
        if (!fitting && above <= 0) continue;
        const double step = (fitting ? 0.15 : 1.0) * above / squares;
        for (int k = 0; k < p.t.n; ++k) v[size_t(p.t.at[k])] -= step * p.t.w[k];
      }
    }
  }
};

/// What fresh points still find above the truth lowers all nodes around them by that much.
struct Lowering {
  std::vector<double> need;
  explicit Lowering(size_t n) : need(n, 0.0) {}
  void point(const Taps& t, double excess) {
    for (int k = 0; k < t.n && excess > 0; ++k)
      if (t.w[k] > 0.02) need[size_t(t.at[k])] = std::max(need[size_t(t.at[k])], excess);
  }
  void apply(std::vector<double>& v, double sign) const {
    for (size_t k = 0; k < v.size(); ++k) v[k] -= sign * need[k];
  }
};

/// Cosine-weighted mean over the hemisphere (2/pi of an integral over a quarter of azimuths).
template <class F>
double hemisphere(double ax, const F& f) {
  double sum = 0, last = 0;
  const int nm = 96, np = 48;
  const double s = 2 * ax;
  for (int j = 0; j < nm; ++j) {
    const double next = j + 1 == nm ? 1.0 : cosineAt(double(j + 1) / nm, s), mu = 0.5 * (last + next);
    double row = 0;
    for (int k = 0; k < np; ++k) {
      const double u = (k + 0.5) / np, phi = 0.5 * pi * (1 - u * u * u), weight = 3 * u * u;  // dense across the brushed direction
      row += weight * f(directionOf(mu, sq(std::cos(phi)))) / np;
    }
    sum += row * (next * next - last * last);
    last = next;
  }
  return sum;
}

struct Reflection {
  std::vector<double> deficit, extra, deficitRoot, schlickMean;
  void build() {
    const size_t n = size_t(kR) * kS * kPhi * kMu;
    deficit.resize(n);
    extra.resize(n);
    for (int a = 0; a < kR; ++a)
      for (int b = 0; b < kS; ++b)
        for (int p = 0; p < kPhi; ++p)
          for (int m = 0; m < kMu; ++m) {
            const double r = double(a) / (kR - 1), s = double(b) / (kS - 1), ax = alphaX(r, s), ay = alphaY(r), cos2 = azimuthAt(p, 1.0, kPhi, kPhi),
                         mu = cosineAt(double(m) / (kMu - 1), reflectionScale(ax, ay, cos2));
            const Albedo e = reflection(directionOf(mu, cos2), ax, ay, kPoints, true);
            deficit[size_t(reflectionIndex(a, b, p, m))] = 1 - e.all;
            extra[size_t(reflectionIndex(a, b, p, m))] = e.schlick - pow5(1 - mu) * e.all;
          }
    Random u{1};
    Fit fitDeficit, fitExtra;  // of -extra: what Schlick adds is kept above the truth
    for (int k = 0; k < 60000; ++k) {
      double r, s, all, schlick;
      const Taps t = tried(u, k, r, s, all, schlick);
      fitDeficit.add(t, 1 - all);
      fitExtra.add(t, -schlick);
    }
    fitDeficit.run(deficit);
    for (double& e : extra) e = -e;
    fitExtra.run(extra);
    for (double& e : extra) e = -e;
    Lowering down(n), up(n);
    for (int k = 0; k < 80000; ++k) {
      double r, s, all, schlick;
      const Taps t = tried(u, k, r, s, all, schlick);
      down.point(t, t.of(deficit) - (1 - all));
      up.point(t, schlick - t.of(extra));
    }
    down.apply(deficit, 1);
    up.apply(extra, -1);
    for (double& d : deficit) d = std::floor(std::max(d, 0.0) * 1e4) * 1e-4;
    for (double& e : extra) e = std::ceil(e * 1e4) * 1e-4;
    for (int a = 0; a < fine(kR); ++a)
      for (int b = 0; b < fine(kS); ++b) {
        const double r = double(a) / (fine(kR) - 1), s = double(b) / (fine(kS) - 1), ax = alphaX(r, s);
        deficitRoot.push_back(std::sqrt(hemisphere(ax, [&](const V3& o) { return reflectionTaps(r, s, o).of(deficit); })));
        schlickMean.push_back(hemisphere(ax, [&](const V3& o) {
          const Taps t = reflectionTaps(r, s, o);
          return t.of(extra) + pow5(1 - o.z) * (1 - t.of(deficit));
        }));
      }
  }
  /// A random point and its truth: deficit's albedo and Schlick's part above (1 - mu)^5 of it.
  static Taps tried(Random& u, int k, double& r, double& s, double& all, double& extra) {
    r = u();
    s = u();
    const double mu = 0.01 + 0.99 * (k & 1 ? u() : sq(u())), phi = 0.5 * pi * (k & 2 ? u() : 1 - sq(u()));
    const V3 o = directionOf(mu, sq(std::cos(phi)));
    const Albedo e = reflection(o, alphaX(r, s), alphaY(r), kPoints, true);
    all = e.all;
    extra = e.schlick - pow5(1 - mu) * e.all;
    return reflectionTaps(r, s, o);
  }
};

struct Glass {
  std::vector<double> deficit[2], root[2];
  void build() {
    for (int side = 0; side < 2; ++side) {
      const size_t n = size_t(kGlassIor) * kGlassR * kGlassS * size_t(kGlassPhi[side]) * kGlassMu;
      std::vector<double>& v = deficit[side];
      v.resize(n);
      for (int i = 0; i < kGlassIor; ++i)
        for (int a = 0; a < kGlassR; ++a)
          for (int b = 0; b < kGlassS; ++b)
            for (int m = 0; m < kGlassMu; ++m)
              for (int p = 0; p < kGlassPhi[side]; ++p) {
                const double r = double(a) / (kGlassR - 1), s = double(b) / (kGlassS - 1), ax = alphaX(r, s), ior = iorAt(double(i) / (kGlassIor - 1));
                const double mu = cosineAt(double(m) / (kGlassMu - 1), 2 * ax),
                             cos2 = azimuthAt(p, edge2(side == 1, ior, 1 - mu * mu), kFirstPiece[side], kGlassPhi[side]);
                v[size_t(glassIndex(side, i, a, b, p, m))] = lost(side, ior, r, s, directionOf(mu, cos2));
              }
      Random u{11};
      Fit fit;
      for (int k = 0; k < 160000; ++k) {
        double truth;
        const Taps t = tried(side, u, k, truth);
        fit.add(t, truth);
      }
      fit.run(v);
      Lowering down(n);
      for (int k = 0; k < 200000; ++k) {
        double truth;
        const Taps t = tried(side, u, k, truth);
        down.point(t, t.of(v) - truth + 0.001);
      }
      down.apply(v, 1);
      for (double& d : v) d = std::round(std::clamp(d - 0.25 * kStep, 0.0, 1.0) / kStep) * kStep;
      for (int a = 0; a < fine(kGlassR); ++a)
        for (int b = 0; b < fine(kGlassS); ++b)
          for (int i = 0; i < fine(kGlassIor); ++i) {
            const double r = double(a) / (fine(kGlassR) - 1), s = double(b) / (fine(kGlassS) - 1), ior = iorAt(double(i) / (fine(kGlassIor) - 1));
            root[side].push_back(std::sqrt(hemisphere(alphaX(r, s), [&](const V3& o) { return glassTaps(side, r, s, ior, o).of(v); })));
          }
    }
  }
  static double lost(int side, double ior, double r, double s, const V3& o) {
    return 1 - dielectric(o, alphaX(r, s), alphaY(r), side ? 1 / ior : ior, kGlassPoints);
  }
  static Taps tried(int side, Random& u, int k, double& truth) {
    const double r = u(), s = u(), low = u(), mu = 0.01 + 0.99 * (k & 1 ? low : low * low * low), across = u();
    const double phi = 0.5 * pi * (k & 2 ? across : 1 - across * across * across), ior = iorAt(k & 4 ? 0.08 + 0.92 * u() : 0.3 + 0.7 * u());
    const V3 o = directionOf(mu, sq(std::cos(phi)));
    truth = lost(side, ior, r, s, o);
    return glassTaps(side, r, s, ior, o);
  }
};

void array(FILE* f, const char* type, const char* name, const std::vector<double>& v, double scale) {
  std::fprintf(f, "inline constexpr %s %s[%zu] = {\n", type, name, v.size());
  int column = 0;
  for (double x : v) {
    char s[32];
    const int l = std::snprintf(s, sizeof s, "%.0f,", std::round(x * scale));
    if (column + l > 138) {
      std::fprintf(f, "\n");
      column = 0;
    }
    column += std::fprintf(f, "%s", s);
  }
  std::fprintf(f, "};\n");
}
FILE* open(const std::string& path, const char* what) {
  FILE* f = std::fopen(path.c_str(), "w");
  if (!f) {
    std::perror(path.c_str());
    std::exit(1);
  }
  std::fprintf(f,
               "// SPDX-License-Identifier: Apache-2.0\n// Written by bench/bsdf_anisotropic_tables.cpp; do not edit. %s\n#pragma once\n\n#include "
               "<cstdint>\n\nnamespace gobo::data {\n\n",
               what);
  return f;
}
void close(FILE* f) {
  std::fprintf(f, "\n}  // namespace gobo::data\n");
  std::fclose(f);
}
void print(const char* name, std::vector<double>& e) {
  std::sort(e.begin(), e.end());
  const size_t n = e.size();
  std::printf("%-44s lowest %+.4f, 1 %% %+.4f, 5 %% %+.4f, median %+.4f, 99 %% %+.4f, highest %+.4f\n", name, e[0], e[n / 100], e[n / 20], e[n / 2],
              e[n - 1 - n / 100], e[n - 1]);
}

}  // namespace

int main(int argc, char** argv) {
  Reflection t;
  t.build();
  Glass g;
  g.build();
  if (argc > 1) {
    const std::string dir = argv[1];
    FILE* f = open(dir + "/bsdf_anisotropic_reflection_data.h", "GGX reflection with two alphas: roughness, anisotropy, azimuth, cosine.");
    array(f, "uint16_t", "kAnisotropicDeficit", t.deficit, 1e4);
    array(f, "int16_t", "kAnisotropicExtra", t.extra, 1e4);
    array(f, "uint16_t", "kAnisotropicRoot", t.deficitRoot, 5e4);
    array(f, "uint16_t", "kAnisotropicSchlickMean", t.schlickMean, 5e4);
    close(f);
    for (int side = 0; side < 2; ++side) {
      f = open(dir + (side ? "/bsdf_anisotropic_inside_data.h" : "/bsdf_anisotropic_outside_data.h"),
               "Rough dielectric with two alphas: ior, roughness, anisotropy, azimuth, cosine.");
      array(f, "uint8_t", side ? "kAnisotropicInside" : "kAnisotropicOutside", g.deficit[side], 1 / kStep);
      array(f, "uint16_t", side ? "kAnisotropicInsideRoot" : "kAnisotropicOutsideRoot", g.root[side], 5e4);
      close(f);
    }
  }
  Random u{77};
  std::vector<double> errors, schlick;
  for (int k = 0; k < 3000; ++k) {
    double r, s, all, extra;
    const Taps p = Reflection::tried(u, k, r, s, all, extra);
    errors.push_back(p.of(t.deficit) - (1 - all));
    schlick.push_back(p.of(t.extra) - extra);
  }
  print("reflection, albedo + deficit - 1", errors);
  print("reflection, Schlick's part", schlick);
  for (int side = 0; side < 2; ++side) {
    errors.clear();
    for (int k = 0; k < 4000; ++k) {
      double truth;
      const Taps p = Glass::tried(side, u, k, truth);
      errors.push_back(p.of(g.deficit[side]) - truth);
    }
    print(side ? "glass from inside, albedo + deficit - 1" : "glass from outside, albedo + deficit - 1", errors);
  }
}
