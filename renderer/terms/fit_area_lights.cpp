// SPDX-License-Identifier: Apache-2.0
#include "terms/fit_area_lights.h"

#include <algorithm>
#include <numbers>

#include "formulas/harmonics.glsl.h"
#include "terms/environment_cells.h"

namespace gobo {
inline namespace terms {

namespace {

constexpr int kSide = EnvironmentCells::kSide;
constexpr double kBlur = 0.006;  // W0, sr: a square of 4.4 degrees
constexpr double kSpread = 1.6;  // largest square, in shares 4 pi / N
constexpr double kLeast = 1e-5;  // a light of less than this share of the flux is not worth a shadow map
constexpr int kRounds = 12;
constexpr double kWidest = 2.0;  // largest tangent of half a light's side

/// Solid angle of a square at distance 1 that is seen face on, half side t.
double squareSolidAngle(double t) { return 4.0 * std::asin(t * t / (1.0 + t * t)); }
/// 1 - |mean direction|^2 of such a square: mean squared chord about the mean. The vector irradiance of a square is closed (Lambert 1760).
double squareSpread(double t) {
  if (t < 1e-3) return 2.0 * t * t / 3.0;
  const double a = t / std::sqrt(1.0 + t * t), mean = 4.0 * a * std::atan(a) / squareSolidAngle(t);
  return 1.0 - mean * mean;
}
double squareOfSpread(double spread) {
  double lo = 0, hi = kWidest;
  for (int i = 0; i < 60; ++i) {
    const double mid = 0.5 * (lo + hi);
    (squareSpread(mid) < spread ? lo : hi) = mid;
  }
  return 0.5 * (lo + hi);
}

/// Flux by luminance that is gathered in a set of cells, with its moments.
struct Moments {
  DVec3 flux{0.0}, moment{0.0};
  double weight = 0, extent = 0;
  void add(const EnvironmentCell& c) {
    flux += c.flux;
    moment += c.moment;
    weight += c.weight;
    extent += c.extent;
  }
  DVec3 direction() const { return glm::normalize(moment); }
  /// Mean squared chord about the centre: 1 - |mean|^2 for what lies on the unit sphere, and the texels' own.
  double spread() const {
    const DVec3 mean = moment / weight;
    return std::max(1.0 - glm::dot(mean, mean), 0.0) + extent / weight;
  }
};

/// Six charts, each a face of the cube and what lies around it up to 60 degrees from its axis, with sums over rectangles.
class Charts {
 public:
  static constexpr int kRim = 24, kWidth = kSide + 2 * kRim, kStride = kWidth + 1;  // tangents to 1.75

  explicit Charts(const EnvironmentCells& cells) : cells_(cells), left_(cells.cells.size(), 1), places_(6) {
    for (int face = 0; face < 6; ++face)
      for (size_t c = 0; c < cells.cells.size(); ++c) {
        double x, y;
        if (!EnvironmentCells::project(face, EnvironmentCells::cellDirection(c), x, y)) continue;
        const int i = int(std::floor((x + 1.0) * 0.5 * kSide)) + kRim, j = int(std::floor((y + 1.0) * 0.5 * kSide)) + kRim;
        if (i >= 0 && j >= 0 && i < kWidth && j < kWidth) places_[face].push_back({uint32_t(c), uint32_t(j * kWidth + i)});
      }
    for (int face = 0; face < 6; ++face) {
      solid_[face] = table(face, [&](size_t c) { return cells_.cells[c].solidAngle; });
      update(face);
    }
  }

  struct Square {
    double gain = 0;
    int face = 0, x = 0, y = 0, side = 0;
  };
  Square best(double largest, const StopToken& stop) const {
    static constexpr int kSides[] = {1, 2, 3, 4, 6, 8, 11, 16, 22, 32, 44, 64};
    Square best;
    for (int face = 0; face < 6; ++face)
      for (const int side : kSides) {
        if (stop.stopRequested()) return best;
        for (int y = kRim - side / 2; y + side <= kRim + kSide + side / 2; ++y)
          for (int x = kRim - side / 2; x + side <= kRim + kSide + side / 2; ++x) {
            if (x < 0 || y < 0 || x + side > kWidth || y + side > kWidth) continue;
            const double f = sum(flux_[face], x, y, side), w = sum(solid_[face], x, y, side), gain = f * f / (w + kBlur);
            if (gain > best.gain * (1.0 + 1e-9) && (w <= largest || side == 1)) best = {gain, face, x, y, side};
          }
      }
    return best;
  }
  /// What is left in the square, which is empty then.
  Moments take(const Square& s) {
    Moments m;
    for (const Place& p : places_[s.face]) {
      const int i = int(p.at) % kWidth, j = int(p.at) / kWidth;
      if (i < s.x || j < s.y || i >= s.x + s.side || j >= s.y + s.side || !left_[p.cell]) continue;
      left_[p.cell] = 0;
      m.add(cells_.cells[p.cell]);
    }
    for (int face = 0; face < 6; ++face) update(face);
    return m;
  }

 private:
  struct Place {
    uint32_t cell, at;
  };
  using Table = std::vector<double>;
  template <typename F>
  Table table(int face, const F& value) const {
    Table t(size_t(kStride) * kStride, 0.0);
    for (const Place& p : places_[face]) t[(p.at / kWidth + 1) * kStride + p.at % kWidth + 1] += value(p.cell);
    for (int y = 1; y < kStride; ++y) {
      double row = 0;
      for (int x = 1; x < kStride; ++x) {
        row += t[y * kStride + x];
        t[y * kStride + x] = t[(y - 1) * kStride + x] + row;
      }
    }
    return t;
  }
  void update(int face) {
    flux_[face] = table(face, [&](size_t c) { return left_[c] ? cells_.cells[c].weight : 0.0; });
  }
  static double sum(const Table& t, int x, int y, int side) {
    const double* a = &t[y * kStride + x];
    const double* b = a + side * kStride;
    return b[side] - b[0] - a[side] + a[0];
  }

  const EnvironmentCells& cells_;
  std::vector<uint8_t> left_;
  std::vector<std::vector<Place>> places_;
  Table solid_[6], flux_[6];
};

std::vector<Moments> pursue(const EnvironmentCells& cells, int lights, const StopToken& stop) {
  Charts charts(cells);
  std::vector<Moments> found;
  while (int(found.size()) < lights) {
    const Charts::Square s = charts.best(kSpread * 4.0 * std::numbers::pi / lights, stop);
    if (stop.stopRequested()) return {};
    const Moments m = charts.take(s);
    if (!(m.weight > 0)) break;  // nothing is left, or no more than rounding of the table's sums
    found.push_back(m);
  }
  return found;
}

/// Cells to the light or background that they are likeliest of, lights to their cells, in turn.
std::vector<Moments> refine(const EnvironmentCells& cells, std::vector<Moments> lights, const StopToken& stop) {
  struct Gaussian {
    DVec3 centre;
    double scale, logVariance;
  };
  const double widest = squareSpread(kWidest);
  for (int round = 0; round < kRounds && !lights.empty(); ++round) {
    std::vector<Gaussian> g;
    for (const Moments& m : lights) {
      const double variance = 0.5 * m.spread();
      g.push_back({m.moment / m.weight, 0.5 / variance, std::log(variance)});
    }
    std::vector<Moments> next(lights.size());
    for (size_t at = 0; at < cells.cells.size(); ++at) {
      const EnvironmentCell& c = cells.cells[at];
      if (at % 1024 == 0 && stop.stopRequested()) return {};
      if (!(c.weight > 0)) continue;
      const DVec3 centre = c.centre();
      const double own = std::max(1.0 - glm::dot(centre, centre), 0.0) + c.extent / c.weight;
      double least = std::log(2.0);  // uniform density 1 / (4 pi), by the 1 / (2 pi) that the Gaussians leave out
      int best = -1;
      for (size_t k = 0; k < g.size(); ++k) {
        const DVec3 d = centre - g[k].centre;
        const double cost = (glm::dot(d, d) + own) * g[k].scale + g[k].logVariance;
        if (cost < least) {
          least = cost;
          best = int(k);
        }
      }
      if (best >= 0) next[size_t(best)].add(c);
    }
    lights.clear();
    // What is too wide for a square (a whole floor) is no light: as one direction it would be wrong, the remainder holds it well.
    for (const Moments& m : next)
      if (m.spread() < widest && m.weight > kLeast * cells.weight && glm::length(m.moment) > 1e-3 * m.weight) lights.push_back(m);
  }
  return lights;
}

using Harmonics = std::array<double, 9>;
Harmonics harmonics(const DVec3& d) {
  return {0.282094791773878,
          0.488602511902920 * d.y,
          0.488602511902920 * d.z,
          0.488602511902920 * d.x,
          1.092548430592079 * d.x * d.y,
          1.092548430592079 * d.y * d.z,
          0.315391565252520 * (3 * d.z * d.z - 1),
          1.092548430592079 * d.x * d.z,
          0.546274215296040 * (d.x * d.x - d.y * d.y)};
}

double irradiance0(const std::array<DVec3, 9>& c, int k) { return formulas::harmonicIrradiance0(float(c[0][k])); }
double irradiance12(const std::array<DVec3, 9>& c, const DVec3& n, int k) {
  const float x = float(n.x), y = float(n.y), z = float(n.z);
  const auto at = [&](size_t i) { return float(c[i][k]); };
  return formulas::harmonicIrradiance1(x, y, z, at(1), at(2), at(3)) + formulas::harmonicIrradiance2(x, y, z, at(4), at(5), at(6), at(7), at(8));
}

void findRemainder(const EnvironmentCells& cells, AreaLightFit& fit) {
  for (const EnvironmentCell& c : cells.cells) {
    if (!(c.weight > 0)) continue;
    const Harmonics y = harmonics(glm::normalize(c.moment));
    for (size_t i = 0; i < 9; ++i) fit.remainder[i] += c.flux * y[i];
  }
  for (const AreaLight& l : fit.lights) {
    const Harmonics y = harmonics(l.direction);
    for (size_t i = 0; i < 9; ++i) fit.remainder[i] -= l.irradiance * y[i];
  }
  constexpr int kDirections = 4096;  // 3.2 degrees apart: between them a band-2 function is at most 0.5 % of its range lower
  for (int k = 0; k < 3; ++k) {
    const double mean = irradiance0(fit.remainder, k);
    if (!(mean > 1e-12 * fit.flux[k])) {  // nothing, but for rounding
      for (DVec3& c : fit.remainder) c[k] = 0;
      continue;
    }
    double lowest = 0;
    for (int i = 0; i < kDirections; ++i) {  // Fibonacci lattice
      const double z = 1.0 - (2.0 * i + 1.0) / kDirections, phi = i * 2.399963229728653, r = std::sqrt(1.0 - z * z);
      lowest = std::min(lowest, irradiance12(fit.remainder, DVec3(r * std::cos(phi), r * std::sin(phi), z), k));
    }
    lowest *= 1.01;
    if (mean + lowest < 0)
      for (size_t i = 1; i < 9; ++i) fit.remainder[i][k] *= mean / -lowest;
  }
}

}  // namespace

double AreaLight::solidAngle() const { return squareSolidAngle(0.5 * angularSize); }
DVec3 AreaLightFit::remainderFlux() const { return remainder[0] * (4.0 * std::numbers::pi * 0.282094791773878); }
DVec3 AreaLightFit::remainderIrradiance(const DVec3& n) const {
  DVec3 e;
  for (int k = 0; k < 3; ++k) e[k] = irradiance0(remainder, k) + irradiance12(remainder, n, k);
  return e;
}

AreaLightFit fitAreaLights(const Environment& map, int lights, const StopToken& stop) {
  const EnvironmentCells cells(map, stop);
  AreaLightFit fit;
  if (stop.stopRequested()) return fit;
  fit.flux = cells.flux;
  if (!(cells.weight > 0)) return fit;
  for (const Moments& m : refine(cells, pursue(cells, lights, stop), stop)) {
    AreaLight l;
    l.direction = m.direction();
    const double across = std::hypot(l.direction.x, l.direction.z);
    l.right = across > 1e-6 ? DVec3(l.direction.z / across, 0.0, -l.direction.x / across) : glm::normalize(DVec3(1, 0, 0) - l.direction * l.direction.x);
    l.angularSize = 2.0 * squareOfSpread(m.spread());
    l.irradiance = m.flux;
    fit.lights.push_back(l);
  }
  std::stable_sort(fit.lights.begin(), fit.lights.end(),
                   [](const AreaLight& a, const AreaLight& b) { return luminance(Vec3(a.irradiance)) > luminance(Vec3(b.irradiance)); });
  findRemainder(cells, fit);
  return fit;
}

}  // namespace terms
}  // namespace gobo
