// SPDX-License-Identifier: Apache-2.0
#include "terms/environment_cells.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/to_index.h"
#include "scene/environment_tents.h"

namespace gobo {

namespace {
/// NaN, Inf and negative channels count as black, before neighbours are interpolated with them.
bool valid(const Vec3& c) { return isFinite(c) && c.x >= 0.0f && c.y >= 0.0f && c.z >= 0.0f; }
}  // namespace

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
  const double step = 0.5 * (0.5 * std::numbers::pi / kSide);  // half a cell
  Environment repaired;
  const Environment* clean = &map;
  if (!std::all_of(map.texels.begin(), map.texels.end(), valid)) {
    repaired = map;
    for (Vec3& c : repaired.texels)
      for (int k = 0; k < 3; ++k) c[k] = valid(Vec3(c[k])) ? c[k] : 0.0f;
    clean = &repaired;
  }
  if (2.0 * std::numbers::pi / map.width <= step && std::numbers::pi / map.height <= step) addTexels(*clean, stop);
  else addPieces(*clean, stop);
  for (const EnvironmentCell& cell : cells) {
    flux += cell.flux;
    weight += cell.weight;
  }
}

void EnvironmentCells::add(const DVec3& d, double solidAngle, const DVec3& radiance, double own) {
  const int face = faceOf(d);
  double u = 0, v = 0;
  project(face, d, u, v);
  const int i = toIndex((u + 1.0) * 0.5 * kSide, kSide), j = toIndex((v + 1.0) * 0.5 * kSide, kSide);
  EnvironmentCell& cell = cells[(size_t(face) * kSide + j) * kSide + i];
  cell.solidAngle += solidAngle;
  const DVec3 part = radiance * solidAngle;
  const double w = 0.2126 * part.x + 0.7152 * part.y + 0.0722 * part.z;
  cell.flux += part;
  cell.weight += w;
  cell.moment += w * d;
  cell.extent += w * own;
}

void EnvironmentCells::addTexels(const Environment& map, const StopToken& stop) {
  const EnvironmentTents tents(map.width, map.height);
  const double dPhi = 2.0 * std::numbers::pi / map.width, dTheta = std::numbers::pi / map.height;
  for (int y = 0; y < map.height && !stop.stopRequested(); ++y) {
    const double theta = (y + 0.5) * dTheta, s = std::sin(theta), c = std::cos(theta), omega = tents.weight(y);
    const double own = (dTheta * dTheta + s * s * dPhi * dPhi) / 6.0;  // a tent's variance is a sixth of its texel's width squared
    for (int x = 0; x < map.width; ++x) {
      const double phi = (x + 0.5) * dPhi - std::numbers::pi;
      add(DVec3(s * std::cos(phi), c, s * std::sin(phi)), omega, DVec3(map.texels[size_t(y) * map.width + x]), own);
    }
  }
}

void EnvironmentCells::addPieces(const Environment& map, const StopToken& stop) {
  const double step = 0.5 * (0.5 * std::numbers::pi / kSide);
  // An even number of pieces a texel: none spans a texel's centre, so that radiance is linear along both axes of each.
  const int cutX = 2 * std::max(1, int(std::ceil(std::numbers::pi / map.width / step))),
            cutY = 2 * std::max(1, int(std::ceil(0.5 * std::numbers::pi / map.height / step)));
  const int columns = map.width * cutX, rows = map.height * cutY;
  const double dPhi = 2.0 * std::numbers::pi / columns, dTheta = std::numbers::pi / rows;
  for (int y = 0; y < rows && !stop.stopRequested(); ++y) {
    const double middle = (y + 0.5) * dTheta, half = 0.5 * dTheta;
    const double omega = dPhi * 2.0 * std::sin(middle) * std::sin(half);  // cos(middle - half) - cos(middle + half) without cancellation
    // Looked up at the mean of the polar angle by solid angle, a linear function gives its own mean: fluxes are exact.
    const double theta = middle + std::cos(middle) / std::sin(middle) * (1.0 - half * std::cos(half) / std::sin(half)), s = std::sin(theta),
                 c = std::cos(theta);
    const double own = (dTheta * dTheta + s * s * dPhi * dPhi) / 12.0;
    for (int x = 0; x < columns; ++x) {
      const double phi = (x + 0.5) * dPhi - std::numbers::pi;
      add(DVec3(s * std::cos(phi), c, s * std::sin(phi)), omega, DVec3(interpolateTexels(map, (x + 0.5) / cutX, theta / std::numbers::pi * map.height)), own);
    }
  }
}

}  // namespace gobo
