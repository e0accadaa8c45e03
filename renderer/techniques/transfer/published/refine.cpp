// SPDX-License-Identifier: Apache-2.0
#include "techniques/transfer/published/refine.h"

#include <cmath>

#include "techniques/transfer/published/least_squares.h"

namespace gobo::transfer::published {

Summit summitOf(const std::vector<double>& value, const Icosphere& sphere, int vertex, Refine refine) {
  const DVec3 n = sphere.vertices[size_t(vertex)];
  Summit out{n, 0};
  if (refine == Refine::None) return out;
  std::vector<int> about{vertex};
  for (const int k : sphere.neighbours[size_t(vertex)])
    if (k >= 0) about.push_back(k);
  bool logarithm = refine == Refine::LogQuadric;
  double edge = 0;
  for (const int k : about) {
    logarithm &= value[size_t(k)] > 0;
    edge = std::max(edge, glm::length(sphere.vertices[size_t(k)] - n));
  }
  const DVec3 u = glm::normalize(glm::cross(std::fabs(n.x) < 0.7 ? DVec3(1, 0, 0) : DVec3(0, 1, 0), n)), w = glm::cross(n, u);
  // q(x, y) = a + b x + c y + d x^2 + e x y + f y^2, edges long. Values relative to the vertex's: what is far above 0 costs no digits.
  const double own = value[size_t(vertex)];
  std::vector<double> gram(36, 0.0), moment(6, 0.0);
  for (const int k : about) {
    const DVec3 p = sphere.vertices[size_t(k)];
    const double x = glm::dot(p, u) / edge, y = glm::dot(p, w) / edge;
    const double row[6] = {1, x, y, x * x, x * y, y * y}, v = logarithm ? std::log(value[size_t(k)] / own) : value[size_t(k)] - own;
    for (size_t i = 0; i < 6; ++i) {
      moment[i] += row[i] * v;
      for (size_t j = 0; j < 6; ++j) gram[6 * i + j] += row[i] * row[j];
    }
  }
  const std::vector<double> q = solveSymmetric(gram, moment);
  const double b = q[1], c = q[2], d = q[3], e = q[4], f = q[5], determinant = 4 * d * f - e * e;
  if (!(determinant > 0) || !(d < 0)) return out;
  const double x = (c * e - 2 * f * b) / determinant, y = (b * e - 2 * d * c) / determinant;
  if (!(x * x + y * y <= 1)) return out;
  out.direction = glm::normalize(n + edge * (x * u + y * w));
  const double top = logarithm ? 1.0 : own + q[0] + 0.5 * (b * x + c * y);
  if (top > 0) out.steepness = std::sqrt(determinant) / (top * edge * edge);
  return out;
}

}  // namespace gobo::transfer::published
