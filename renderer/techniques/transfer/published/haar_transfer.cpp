// SPDX-License-Identifier: Apache-2.0
#include "techniques/transfer/published/haar_transfer.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <numbers>
#include <string>

#include "techniques/transfer/environment_split.h"
#include "techniques/transfer/point_rays.h"
#include "terms/environment_cells.h"

namespace gobo::transfer::published {

namespace {

/// Solid angle of [-1, x] x [-1, y] of a face's plane but for a constant of each alone: differences of it are those of rectangles.
double cornerAngle(double x, double y) { return std::atan2(x * y, std::sqrt(x * x + y * y + 1)); }
double rectangleAngle(double x0, double x1, double y0, double y1) {
  return cornerAngle(x1, y1) - cornerAngle(x0, y1) - cornerAngle(x1, y0) + cornerAngle(x0, y0);
}
/// Half the sum of arc lengths times the normals of their planes (Lambert): the integral of the direction over a polygon of great circles.
DVec3 polygonIntegral(const DVec3 (&corner)[4], const DVec3& inside) {
  DVec3 sum(0.0);
  for (int k = 0; k < 4; ++k) {
    const DVec3 across = glm::cross(corner[k], corner[(k + 1) % 4]);
    const double sine = glm::length(across);
    sum += across * (0.5 * std::atan2(sine, glm::dot(corner[k], corner[(k + 1) % 4])) / sine);
  }
  return glm::dot(sum, inside) < 0 ? -sum : sum;
}
double edgeOf(int k, int side) { return -1 + 2.0 * k / side; }

std::vector<double> anglesOfCells(int side) {
  std::vector<double> out;
  for (int face = 0; face < 6; ++face)
    for (int row = 0; row < side; ++row)
      for (int column = 0; column < side; ++column)
        out.push_back(rectangleAngle(edgeOf(column, side), edgeOf(column + 1, side), edgeOf(row, side), edgeOf(row + 1, side)));
  return out;
}

}  // namespace

Result<HaarCells> HaarCells::of(int side) {
  if (side < 1 || side > CubeWavelets::kMostSide || (side & (side - 1)) != 0)
    return invalidArgument("Haar cells: a face of " + std::to_string(side) + " cells; 1, 2, 4 to " + std::to_string(CubeWavelets::kMostSide));
  return HaarCells(side);
}

HaarCells::HaarCells(int side) : wavelets_(side, anglesOfCells(side)) {
  for (int face = 0; face < 6; ++face)
    for (int row = 0; row < side; ++row)
      for (int column = 0; column < side; ++column) {
        const double x0 = edgeOf(column, side), x1 = edgeOf(column + 1, side), y0 = edgeOf(row, side), y1 = edgeOf(row + 1, side);
        const DVec3 middle = EnvironmentCells::direction(face, 0.5 * (x0 + x1), 0.5 * (y0 + y1));
        middles_.push_back(glm::normalize(Vec3(middle)));
        integrals_.push_back(polygonIntegral({EnvironmentCells::direction(face, x0, y0), EnvironmentCells::direction(face, x1, y0),
                                              EnvironmentCells::direction(face, x1, y1), EnvironmentCells::direction(face, x0, y1)},
                                             middle));
      }
}

std::vector<HaarTerm> haarLight(const HaarCells& cells, const Environment& map, HaarOrder order, const TaskArena& arena, const StopToken& stop) {
  const CubeWavelets& wavelets = cells.wavelets();
  const int side = wavelets.side();
  const double texel = std::numbers::pi / std::max(map.height, map.width / 2);
  const int across = std::clamp(int(std::ceil(0.5 * std::numbers::pi / side / (0.5 * texel))), 4, 64);
  std::vector<DVec3> value(wavelets.size(), DVec3(0.0));
  const bool complete = arena.parallelFor(
      value.size(), 16,
      [&](size_t begin, size_t end) {
        for (size_t i = begin; i < end; ++i) {
          const int face = int(i) / (side * side), row = int(i) / side % side, column = int(i) % side;
          DVec3 sum(0.0);
          double weights = 0;
          for (int v = 0; v < across; ++v)
            for (int u = 0; u < across; ++u) {
              const double x = -1 + 2 * (column * across + u + 0.5) / (side * across), y = -1 + 2 * (row * across + v + 0.5) / (side * across);
              const double square = 1 + x * x + y * y, weight = 1 / (square * std::sqrt(square));  // solid angle by area of the face
              sum += weight * DVec3(map.eval(glm::normalize(Vec3(EnvironmentCells::direction(face, x, y)))));
              weights += weight;
            }
          value[i] = sum / weights * std::sqrt(wavelets.solidAngles()[i]);
        }
      },
      stop);
  if (!complete) return {};
  wavelets.forward(value);
  std::vector<HaarTerm> terms;
  std::vector<double> rank;
  for (size_t i = 0; i < value.size(); ++i) {
    terms.push_back({uint32_t(i), value[i]});
    rank.push_back(std::fabs(luminanceOf(value[i])) * (order == HaarOrder::ByArea ? std::sqrt(wavelets.supports()[i]) : 1.0));
  }
  std::stable_sort(terms.begin(), terms.end(), [&](const HaarTerm& a, const HaarTerm& b) { return rank[a.index] > rank[b.index]; });
  return terms;
}

Result<HaarTransfer> HaarTransfer::of(const HaarCells& cells, const Term& points, const Accel& accel, double drop, const TaskArena& arena,
                                      const StopToken& stop) {
  if (!(drop >= 0 && drop < 1)) return invalidArgument("Haar transfer: drops terms below " + std::to_string(drop) + " of the norm; 0 to 1");
  const RaysOfPoints leaving(points, accel);
  const CubeWavelets& wavelets = cells.wavelets();
  HaarTransfer out;
  out.points_ = leaving.size();
  struct Kept {
    uint16_t wavelet;
    float value;
  };
  std::vector<std::vector<Kept>> rows(out.points_);
  std::atomic<uint64_t> rays{0};
  const bool complete = arena.parallelFor(
      out.points_, 4,
      [&](size_t begin, size_t end) {
        std::vector<double> value(wavelets.size());
        for (size_t p = begin; p < end; ++p) {
          const Vec3 n = leaving.normal(p);
          const PointRays from = leaving.of(p, 0);
          std::fill(value.begin(), value.end(), 0.0);
          Ray ray[kLanes];
          size_t of[kLanes];
          int count = 0;
          const auto look = [&] {
            const uint32_t blocked = count > 0 ? accel.occluded16(ray, count) : 0;
            for (int k = 0; k < count; ++k)
              if (!(blocked >> k & 1u)) value[of[k]] = glm::dot(DVec3(n), cells.integrals()[of[k]]) / std::sqrt(wavelets.solidAngles()[of[k]]);
            rays += uint64_t(count);
            count = 0;
          };
          for (size_t i = 0; i < wavelets.size(); ++i) {
            if (!(glm::dot(DVec3(n), cells.integrals()[i]) > 0) || !(glm::dot(n, cells.middles()[i]) > 0)) continue;
            ray[count] = from.along(cells.middles()[i]);
            of[count] = i;
            if (++count == int(kLanes)) look();
          }
          look();
          wavelets.forward(value);
          double norm = 0;
          for (const double v : value) norm += v * v;
          const double least = drop * std::sqrt(norm);
          for (size_t i = 0; i < value.size(); ++i)
            if (value[i] != 0 && std::fabs(value[i]) >= least) rows[p].push_back({uint16_t(i), float(value[i])});
          rows[p].shrink_to_fit();
        }
      },
      stop);
  if (!complete) return Status(Code::Cancelled, "stopped");
  out.rays_ = rays;
  out.first_.assign(wavelets.size() + 1, 0);
  for (const auto& row : rows)
    for (const Kept& k : row) ++out.first_[size_t(k.wavelet) + 1];
  for (size_t i = 0; i < wavelets.size(); ++i) out.first_[i + 1] += out.first_[i];
  out.entries_.resize(out.first_.back());
  std::vector<size_t> next(out.first_.begin(), out.first_.end() - 1);
  for (size_t p = 0; p < rows.size(); ++p) {
    for (const Kept& k : rows[p]) out.entries_[next[k.wavelet]++] = {uint32_t(p), k.value};
    rows[p] = {};
  }
  return out;
}

std::vector<DVec3> HaarTransfer::irradiance(std::span<const HaarTerm> terms) const {
  std::vector<DVec3> out(points_, DVec3(0.0));
  for (const HaarTerm& t : terms) {
    if (t.value == DVec3(0.0)) continue;
    for (size_t k = first_[t.index]; k < first_[size_t(t.index) + 1]; ++k) out[entries_[k].point] += double(entries_[k].value) * t.value;
  }
  return out;
}

}  // namespace gobo::transfer::published
