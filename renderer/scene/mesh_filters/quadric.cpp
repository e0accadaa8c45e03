// SPDX-License-Identifier: Apache-2.0
#include "scene/mesh_filters/quadric.h"

#include <algorithm>
#include <cmath>

namespace gobo {
inline namespace scene {

SymmetricEigen symmetricEigen(glm::dmat3 m) {
  glm::dmat3 v(1.0);
  for (int sweep = 0; sweep < 32; ++sweep) {
    const double off = std::fabs(m[1][0]) + std::fabs(m[2][0]) + std::fabs(m[2][1]);
    const double on = std::fabs(m[0][0]) + std::fabs(m[1][1]) + std::fabs(m[2][2]);
    if (!(off > 1e-18 * on)) break;  // quadratic convergence: a handful of sweeps
    for (int p = 0; p < 2; ++p)
      for (int q = p + 1; q < 3; ++q) {
        const double apq = m[q][p];
        if (apq == 0.0) continue;
        // Rutishauser's tangent of the smaller of the two angles that make entry (p, q) zero.
        const double theta = (m[q][q] - m[p][p]) / (2.0 * apq);
        const double t = std::copysign(1.0, theta) / (std::fabs(theta) + std::sqrt(theta * theta + 1.0));
        const double c = 1.0 / std::sqrt(t * t + 1.0), s = t * c;
        for (int k = 0; k < 3; ++k) {  // columns, then rows
          const double x = m[p][k], y = m[q][k];
          m[p][k] = c * x - s * y;
          m[q][k] = s * x + c * y;
        }
        for (int k = 0; k < 3; ++k) {
          const double x = m[k][p], y = m[k][q];
          m[k][p] = c * x - s * y;
          m[k][q] = s * x + c * y;
        }
        m[q][p] = m[p][q] = 0.0;
        for (int k = 0; k < 3; ++k) {
          const double x = v[p][k], y = v[q][k];
          v[p][k] = c * x - s * y;
          v[q][k] = s * x + c * y;
        }
      }
  }
  return {DVec3(m[0][0], m[1][1], m[2][2]), v};
}

DVec3 leastNear(const Quadric& q, const DVec3& near) {
  const SymmetricEigen e = symmetricEigen(q.a);
  const double most = std::max({e.value.x, e.value.y, e.value.z});
  if (!(most > 0.0)) return near;
  const DVec3 slope = q.b - q.a * near;
  DVec3 x = near;
  for (int k = 0; k < 3; ++k)
    if (e.value[k] > kFlat * most) x += e.vector[k] * (glm::dot(e.vector[k], slope) / e.value[k]);
  return x;
}

DVec3 leastInBox(const Quadric& q, const DVec3& near, const DVec3& centre, double half) {
  const DVec3 way = leastNear(q, near) - near;
  double share = 1.0;
  for (int k = 0; k < 3; ++k) {
    const double room = way[k] > 0.0 ? centre[k] + half - near[k] : near[k] - (centre[k] - half);
    if (std::fabs(way[k]) > room) share = std::min(share, std::max(room, 0.0) / std::fabs(way[k]));
  }
  return near + way * share;
}

}  // namespace scene
}  // namespace gobo
