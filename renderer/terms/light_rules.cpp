// SPDX-License-Identifier: Apache-2.0
#include "terms/light_rules.h"

#include <cmath>
#include <numbers>
#include <utility>

namespace gobo {
inline namespace terms {

namespace {

void add(LightRule& r, double x, double y, double weight) {
  r.x.push_back(float(x));
  r.y.push_back(float(y));
  r.r2.push_back(float(x * x + y * y));
  r.weight.push_back(float(weight));
}
void fill(LightRule& r) {
  while (r.x.size() % 8) add(r, 0.25, 0.25, 0.0);
}

LightRule oneAt(double x, double y) {
  LightRule r;
  add(r, x, y, 1.0);
  fill(r);
  return r;
}

/// Of Gauss and Legendre on -1..1, weights that sum to 1: roots of the n-th Legendre polynomial by Newton's method.
std::vector<std::pair<double, double>> gaussLegendre(int n) {
  std::vector<std::pair<double, double>> out;
  for (int k = 0; k < n; ++k) {
    double x = std::cos(std::numbers::pi * (n - k - 0.25) / (n + 0.5)), slope = 1;
    for (int step = 0; step < 8; ++step) {
      double p = x, before = 1;
      for (int m = 2; m <= n; ++m) {
        const double next = ((2.0 * m - 1.0) * x * p - (m - 1.0) * before) / m;
        before = p;
        p = next;
      }
      slope = n * (x * p - before) / (x * x - 1.0);
      x -= p / slope;
    }
    out.emplace_back(x, 1.0 / ((1.0 - x * x) * slope * slope));
  }
  return out;
}

LightRule sevenOfADisk() {
  LightRule r;
  add(r, 0, 0, 0.25);
  for (int k = 0; k < 6; ++k) {
    const double phi = std::numbers::pi * k / 3.0, radius = std::sqrt(2.0 / 3.0);
    add(r, radius * std::cos(phi), radius * std::sin(phi), 0.125);
  }
  fill(r);
  return r;
}

LightRule ofADisk(int rings, int spokes) {
  LightRule r;
  const auto nodes = gaussLegendre(rings);
  for (int ring = 0; ring < rings; ++ring)
    for (int k = 0; k < spokes; ++k) {
      const double phi = 2.0 * std::numbers::pi * (k + 0.5 * (ring % 2)) / spokes, radius = std::sqrt(0.5 + 0.5 * nodes[size_t(ring)].first);
      add(r, radius * std::cos(phi), radius * std::sin(phi), nodes[size_t(ring)].second / spokes);
    }
  return r;
}

LightRule ofASquare(int n) {
  LightRule r;
  const auto nodes = gaussLegendre(n);
  for (const auto& [x, wx] : nodes)
    for (const auto& [y, wy] : nodes) add(r, x, y, wx * wy);
  return r;
}

/// The square's, folded onto the triangle (Duffy 1982): the factor that this takes is one that the rules have exactly.
LightRule ofATriangle(int n) {
  LightRule r;
  const auto nodes = gaussLegendre(n);
  for (const auto& [x, wx] : nodes)
    for (const auto& [y, wy] : nodes) {
      const double u = 0.5 + 0.5 * x, v = 0.5 + 0.5 * y;
      add(r, u, v * (1.0 - u), 2.0 * (1.0 - u) * wx * wy);
    }
  return r;
}

}  // namespace

const LightRule& lightRule(RuleShape shape, RuleSize size) {
  static const LightRule disks[] = {oneAt(0, 0), sevenOfADisk(), ofADisk(3, 8), ofADisk(4, 16), ofADisk(8, 32), ofADisk(16, 64)};
  static const LightRule squares[] = {oneAt(0, 0), ofASquare(4), ofASquare(4), ofASquare(8), ofASquare(16), ofASquare(32)};
  static const LightRule triangles[] = {oneAt(1.0 / 3.0, 1.0 / 3.0), ofATriangle(4), ofATriangle(4), ofATriangle(8), ofATriangle(16), ofATriangle(32)};
  return (shape == RuleShape::Disk ? disks : shape == RuleShape::Square ? squares : triangles)[size_t(size)];
}

}  // namespace terms
}  // namespace gobo
