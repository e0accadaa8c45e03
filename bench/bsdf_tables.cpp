// SPDX-License-Identifier: Apache-2.0
// Writes the tables of renderer/trace/bsdf_*_data.h (argument: that folder; 20 s on one core), or without an argument prints how
// far the interpolated tables are from the quadrature at random points between the nodes (a second).
#include "bsdf_tables.h"

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

using namespace gobo::tables;

namespace {

constexpr int kMu = 32, kReflectR = 32, kGlassMu = 32, kGlassR = 22, kGlassIor = 17, kSheenN = 32, kFine = 4, kGlassFine = 2;
constexpr double kMargin = 0.001, kGlassMargin = 0.004, kStretch = 2.0, kLargest = 0.5;  // kLargest: (ior - 1)/(ior + 1) at the last node

double alphaAt(double k, int n) { return std::max(sq(k / (n - 1)), 1e-4); }
/// Cosine of node k: t = k/(n-1), x = t^2, mu = s x / (1 + s - x), s = kStretch alpha. The deficit of small alpha is a function of
/// mu/alpha.
double muAt(double t, double alpha) {
  const double x = t * t, s = kStretch * alpha;
  return std::max(s * x / (1 + s - x), 1e-6);
}
double tAt(double mu, double alpha) {
  const double s = kStretch * alpha;
  return std::sqrt(mu * (1 + s) / (mu + s));
}
double iorAt(double k) {
  const double x = kLargest * sq(k / (kGlassIor - 1));
  return std::max((1 + x) / (1 - x), 1.0002);
}
double quantise(double v, double margin) { return std::clamp(std::round((v - margin) * 1e4), 0.0, 9999.0) * 1e-4; }

struct Cell {
  int k;
  double f;
};
Cell cell(double x, int n) {
  const double p = std::clamp(x, 0.0, 1.0) * (n - 1);
  const int k = std::min(int(p), n - 2);
  return {k, p - k};
}

struct Grid2 {
  int nx, ny;
  std::vector<double> v;
  Grid2(int nx, int ny) : nx(nx), ny(ny), v(size_t(nx) * ny) {}
  double& at(int x, int y) { return v[size_t(y) * nx + x]; }
  double get(double x, double y) const {
    const Cell a = cell(x, nx), b = cell(y, ny);
    const double* p = &v[size_t(b.k) * nx + a.k];
    return (1 - b.f) * ((1 - a.f) * p[0] + a.f * p[1]) + b.f * ((1 - a.f) * p[nx] + a.f * p[nx + 1]);
  }
};

// Integral of g(mu) 2 mu dmu for a function of the grid's t.
template <class F>
double hemisphere(double alpha, const F& g) {
  double sum = 0;
  const int n = 2048;
  double last = 0;
  for (int k = 0; k < n; ++k) {
    const double t1 = double(k + 1) / n, s = kStretch * alpha, x1 = t1 * t1, next = s * x1 / (1 + s - x1);
    const double m = 0.5 * (last + next);
    sum += g(tAt(m, alpha), m) * (next * next - last * last);
    last = next;
  }
  return sum;
}

struct Tables {
  Grid2 deficit{kMu, kReflectR}, extra{kMu, kReflectR}, sheenE{kSheenN, kSheenN};
  std::vector<Grid2> glass[2];
  std::vector<double> deficitRoot, schlickMean, glassRoot[2];
  void build() {
    for (int j = 0; j < kReflectR; ++j)
      for (int i = 0; i < kMu; ++i) {
        const double a = alphaAt(j, kReflectR), m = muAt(double(i) / (kMu - 1), a);
        const Albedo e = reflection(direction(m), a, a, 192);
        deficit.at(i, j) = quantise(1 - e.all, kMargin);
        extra.at(i, j) = std::round((e.schlick - std::pow(1 - m, 5) * e.all + kMargin) * 1e4) * 1e-4;
      }
    for (int k = 0; k <= kFine * (kReflectR - 1); ++k) {
      const double r = double(k) / (kFine * (kReflectR - 1)), a = std::max(r * r, 1e-6);
      deficitRoot.push_back(std::sqrt(hemisphere(a, [&](double t, double) { return deficit.get(t, r); })));
      schlickMean.push_back(hemisphere(a, [&](double t, double m) { return extra.get(t, r) + std::pow(1 - m, 5) * (1 - deficit.get(t, r)); }));
    }
    for (int side = 0; side < 2; ++side) {
      for (int k = 0; k < kGlassIor; ++k) {
        Grid2 g(kGlassMu, kGlassR);
        for (int j = 0; j < kGlassR; ++j)
          for (int i = 0; i < kGlassMu; ++i) {
            const double a = alphaAt(j, kGlassR), n = iorAt(k);
            g.at(i, j) = quantise(1 - dielectric(direction(muAt(double(i) / (kGlassMu - 1), a)), a, side ? 1 / n : n, 64), kGlassMargin);
          }
        glass[side].push_back(g);
      }
      for (int k = 0; k <= kGlassFine * (kGlassR - 1); ++k)
        for (int n = 0; n < kGlassIor; ++n) {
          const double r = double(k) / (kGlassFine * (kGlassR - 1)), a = std::max(r * r, 1e-6);
          glassRoot[side].push_back(std::sqrt(hemisphere(a, [&](double t, double) { return glass[side][n].get(t, r); })));
        }
    }
    for (int j = 0; j < kSheenN; ++j)
      for (int i = 0; i < kSheenN; ++i) {
        const double r = sheenRoughness(double(j) / (kSheenN - 1)), m = std::max(sq(double(i) / (kSheenN - 1)), 1e-5);
        sheenE.at(i, j) = std::clamp(std::round((sheen(direction(m), r * r, 192) + 0.003) * 1e4), 0.0, 65535.0) * 1e-4;
      }
  }
  static double sheenRoughness(double y) { return 0.07 + 0.93 * y; }
  double glassAt(double mu, double r, double ior, int side) const {
    const Cell c = cell(std::sqrt((ior - 1) / (ior + 1) / kLargest), kGlassIor);
    const double t = tAt(mu, r * r);
    return (1 - c.f) * glass[side][c.k].get(t, r) + c.f * glass[side][c.k + 1].get(t, r);
  }
};

struct Writer {
  FILE* f;
  int column = 0;
  void number(double v, double scale) {
    char s[32];
    if (scale > 0) std::snprintf(s, sizeof s, "%.0f,", std::round(v * scale));
    else std::snprintf(s, sizeof s, "%.6gf,", v);
    const int l = int(std::string(s).size());
    if (column + l > 138) {
      std::fprintf(f, "\n");
      column = 0;
    }
    column += std::fprintf(f, "%s", s);
  }
  void array(const char* type, const char* name, const std::vector<double>& v, double scale) {
    std::fprintf(f, "inline constexpr %s %s[%zu] = {\n", type, name, v.size());
    column = 0;
    for (double x : v) number(x, scale);
    std::fprintf(f, "};\n");
  }
};
Writer open(const std::string& path, const char* what) {
  FILE* f = std::fopen(path.c_str(), "w");
  if (!f) {
    std::perror(path.c_str());
    std::exit(1);
  }
  std::fprintf(f,
               "// SPDX-License-Identifier: Apache-2.0\n// Written by bench/bsdf_tables.cpp; do not edit. %s\n#pragma once\n\n"
               "#include <cstdint>\n\nnamespace gobo::data {\n\n",
               what);
  return {f};
}
void close(Writer& w) {
  std::fprintf(w.f, "\n}  // namespace gobo::data\n");
  std::fclose(w.f);
}

}  // namespace

int main(int argc, char** argv) {
  Tables t;
  t.build();
  if (argc > 1) {
    const std::string dir = argv[1];
    Writer w = open(dir + "/bsdf_reflection_data.h", "GGX reflection, row = roughness, column = cosine.");
    w.array("uint16_t", "kDeficit", t.deficit.v, 1e4);
    w.array("int16_t", "kSchlickExtra", t.extra.v, 1e4);
    w.array("float", "kDeficitRoot", t.deficitRoot, 0);
    w.array("float", "kSchlickMean", t.schlickMean, 0);
    w.array("uint16_t", "kSheenAlbedo", t.sheenE.v, 1e4);
    close(w);
    for (int side = 0; side < 2; ++side) {
      Writer g = open(dir + (side ? "/bsdf_glass_inside_data.h" : "/bsdf_glass_outside_data.h"), "Rough dielectric: ior, roughness, cosine.");
      std::vector<double> all;
      for (const Grid2& k : t.glass[side]) all.insert(all.end(), k.v.begin(), k.v.end());
      g.array("uint16_t", side ? "kGlassInside" : "kGlassOutside", all, 1e4);
      g.array("uint16_t", side ? "kGlassInsideRoot" : "kGlassOutsideRoot", t.glassRoot[side], 5e4);
      close(g);
    }
    return 0;
  }
  uint64_t state = 1;
  const auto uniform = [&] {
    state = state * 6364136223846793005ull + 1442695040888963407ull;
    return double(state >> 11) * 0x1p-53;
  };
  double lo[4] = {0, 0, 0, 0}, hi[4] = {0, 0, 0, 0};
  for (int k = 0; k < 1500; ++k) {
    const double r = 0.0317 + (1 - 0.0317) * uniform(), a = r * r, m = k & 1 ? muAt(uniform(), a) : 0.02 + 0.98 * uniform();
    const double ior = 1.02 + 1.58 * uniform();
    const Albedo e = reflection(direction(m), a, a, 128);
    const double errors[4] = {
        e.all + t.deficit.get(tAt(m, a), r) - 1, t.extra.get(tAt(m, a), r) + std::pow(1 - m, 5) * (1 - t.deficit.get(tAt(m, a), r)) - e.schlick,
        dielectric(direction(m), a, ior, 64) + t.glassAt(m, r, ior, 0) - 1, dielectric(direction(m), a, 1 / ior, 64) + t.glassAt(m, r, ior, 1) - 1};
    for (int q = 0; q < 4; ++q) {
      lo[q] = std::min(lo[q], errors[q]);
      hi[q] = std::max(hi[q], errors[q]);
    }
  }
  const char* names[4] = {"GGX, albedo + deficit - 1", "GGX, Schlick albedo", "glass from outside, albedo + deficit - 1",
                          "glass from inside, albedo + deficit - 1"};
  for (int q = 0; q < 4; ++q) std::printf("%-42s %+.4f .. %+.4f\n", names[q], lo[q], hi[q]);
}
