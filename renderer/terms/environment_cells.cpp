// SPDX-License-Identifier: Apache-2.0
#include "terms/environment_cells.h"

#include <algorithm>

namespace gobo {

namespace {
constexpr double kDPi = 3.14159265358979323846;
}

int EnvironmentCells::faceOf(const DVec3& d) {
  const DVec3 a = glm::abs(d);
  if (a.x >= a.y && a.x >= a.z) return d.x < 0;
  if (a.y >= a.z) return 2 + (d.y < 0);
  return 4 + (d.z < 0);
}

bool EnvironmentCells::project(int face, const DVec3& d, double& x, double& y) {
  const int axis = face / 2;
  const double along = face % 2 ? -d[axis] : d[axis];
  if (!(along > 0)) return false;
  x = d[(axis + 1) % 3] / along;
  y = d[(axis + 2) % 3] / along;
  return true;
}

DVec3 EnvironmentCells::direction(int face, double x, double y) {
  const int axis = face / 2;
  DVec3 d(0.0);
  d[axis] = face % 2 ? -1.0 : 1.0;
  d[(axis + 1) % 3] = x;
  d[(axis + 2) % 3] = y;
  return glm::normalize(d);
}

DVec3 EnvironmentCells::cellDirection(size_t cell) {
  const int face = int(cell / (kSide * kSide)), j = int(cell / kSide) % kSide, i = int(cell % kSide);
  return direction(face, (2.0 * i + 1.0) / kSide - 1.0, (2.0 * j + 1.0) / kSide - 1.0);
}

EnvironmentCells::EnvironmentCells(const Environment& map, const StopToken& stop) : cells(size_t(6) * kSide * kSide) {
  const double step = 0.5 * (0.5 * kDPi / kSide);   // half a cell
  const int cutX = std::max(1, int(std::ceil(2.0 * kDPi / map.width / step))), cutY = std::max(1, int(std::ceil(kDPi / map.height / step)));
  const int columns = map.width * cutX, rows = map.height * cutY;
  std::vector<double> cosine(columns), sine(columns);
  for (int x = 0; x < columns; ++x) {
    const double phi = (x + 0.5) / columns * 2.0 * kDPi - kDPi;
    cosine[x] = std::cos(phi);
    sine[x] = std::sin(phi);
  }
  const double dPhi = 2.0 * kDPi / columns, dTheta = kDPi / rows;
  for (int y = 0; y < rows; ++y) {
    if (stop.stopRequested()) return;
    const double theta = (y + 0.5) * dTheta, s = std::sin(theta), c = std::cos(theta);
    const double omega = dPhi * 2.0 * s * std::sin(0.5 * dTheta);   // cos(theta - h) - cos(theta + h) without cancellation
    const double own = (dTheta * dTheta + s * s * dPhi * dPhi) / 12.0;
    for (int x = 0; x < columns; ++x) {
      const DVec3 d(s * cosine[x], c, s * sine[x]);
      const int face = faceOf(d);
      double u = 0, v = 0;
      project(face, d, u, v);
      const int i = std::clamp(int((u + 1.0) * 0.5 * kSide), 0, kSide - 1), j = std::clamp(int((v + 1.0) * 0.5 * kSide), 0, kSide - 1);
      EnvironmentCell& cell = cells[(size_t(face) * kSide + j) * kSide + i];
      cell.solidAngle += omega;
      DVec3 radiance(map.texels[size_t(y / cutY) * map.width + x / cutX]);
      for (int k = 0; k < 3; ++k) radiance[k] = radiance[k] > 0 && std::isfinite(radiance[k]) ? radiance[k] : 0.0;   // NaN, Inf and negative texels count as black
      const DVec3 texel = radiance * omega;
      const double w = 0.2126 * texel.x + 0.7152 * texel.y + 0.0722 * texel.z;
      cell.flux += texel;
      cell.weight += w;
      cell.moment += w * d;
      cell.extent += w * own;
    }
  }
  for (const EnvironmentCell& cell : cells) {
    flux += cell.flux;
    weight += cell.weight;
  }
}

}  // namespace gobo
