// SPDX-License-Identifier: Apache-2.0
#include "techniques/transfer/published/peaks.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/to_index.h"
#include "scene/environment_tents.h"
#include "techniques/transfer/environment_split.h"

namespace gobo::transfer::published {

namespace {

constexpr double kLeastDifference = 1e-5;
constexpr double kStep = 0.5 * kDegree;
constexpr int kFirstStep = 2, kLastStep = 60;  // of Radius::Best

double radiusOfAngle(double solidAngle) { return std::acos(std::clamp(1 - solidAngle / (2 * std::numbers::pi), -1.0, 1.0)); }

constexpr size_t kWhiteTexels = size_t(1) << 21;

/// By cell the integral of direction over its solid angle, as EnvironmentCells gathers maps of that size.
std::vector<DVec3> openMoments(int width, int height, const TaskArena& arena) {
  constexpr size_t n = EnvironmentCells::kSide;
  std::vector<DVec3> out;
  if (size_t(width) * size_t(height) <= kWhiteTexels) {
    Environment white;
    white.width = width;
    white.height = height;
    white.texels = std::vector<Vec3>(size_t(width) * size_t(height), Vec3(1.0f));
    for (const EnvironmentCell& cell : EnvironmentCells(white, {}, &arena).cells) out.push_back(cell.moment);
    return out;
  }
  // Too large for a white map beside it; such maps go into cells texel by texel. In stripes of rows that are summed in order.
  constexpr size_t kStripes = 16;
  const EnvironmentTents tents(width, height);
  std::vector<std::vector<DVec3>> stripes(kStripes, std::vector<DVec3>(6 * n * n, DVec3(0.0)));
  arena.parallelFor(kStripes, 1, [&](size_t begin, size_t end) {
    for (size_t s = begin; s < end; ++s)
      for (int y = int(s * size_t(height) / kStripes); y < int((s + 1) * size_t(height) / kStripes); ++y) {
        const double theta = (y + 0.5) * std::numbers::pi / height, sine = std::sin(theta), weight = tents.weight(y);
        for (int x = 0; x < width; ++x) {
          const double phi = (x + 0.5) * 2 * std::numbers::pi / width - std::numbers::pi;
          const DVec3 d(sine * std::cos(phi), std::cos(theta), sine * std::sin(phi));
          const int face = EnvironmentCells::faceOf(d);
          double u = 0, v = 0;
          EnvironmentCells::project(face, d, u, v);
          const size_t i = size_t(toIndex((u + 1) * 0.5 * double(n), int(n))), j = size_t(toIndex((v + 1) * 0.5 * double(n), int(n)));
          stripes[s][(size_t(face) * n + j) * n + i] += weight * d;
        }
      }
  });
  out.assign(6 * n * n, DVec3(0.0));
  for (const std::vector<DVec3>& stripe : stripes)
    for (size_t i = 0; i < out.size(); ++i) out[i] += stripe[i];
  return out;
}

double basinRadius(const std::vector<double>& difference, const std::vector<double>& angles, const std::vector<int>& root, int top) {
  double held = 0;
  for (size_t v = 0; v < root.size(); ++v)
    if (root[v] == top) held += angles[v] * std::max(difference[v], 0.0);
  return radiusOfAngle(held / difference[size_t(top)]);
}

double bestRadius(const std::vector<double>& difference, const std::vector<double>& angles, const std::vector<int>& root, int top, const DVec3& centre) {
  // By step of radius what its disk changes of the squared miss: (D - height)^2 - D^2 for what is within.
  const double height = difference[size_t(top)];
  std::vector<double> change(size_t(kLastStep) + 1, 0.0);
  const Icosphere& sphere = icosphere(kSmoothLevel);
  for (size_t v = 0; v < root.size(); ++v) {
    if (root[v] != top) continue;
    const double step = std::acos(std::clamp(glm::dot(sphere.vertices[v], centre), -1.0, 1.0)) / kStep;
    if (step <= kLastStep) change[std::max(size_t(std::ceil(step)), size_t(kFirstStep))] += angles[v] * height * (height - 2 * std::max(difference[v], 0.0));
  }
  double sum = 0, least = 0;
  int best = kFirstStep;
  for (int k = kFirstStep; k <= kLastStep; ++k) {
    sum += change[size_t(k)];
    if (k == kFirstStep || sum < least) {
      least = sum;
      best = k;
    }
  }
  return best * kStep;
}

}  // namespace

double kernelRadius() { return std::acos(1 - kSmooth * kSmooth * (1 - std::exp((std::cos(kSupport) - 1) / (kSmooth * kSmooth)))); }

SmoothedRadiance::SmoothedRadiance(const EnvironmentCells& cells, int width, int height, const TaskArena& arena) : cells_(cells) {
  const std::vector<DVec3> moment = openMoments(width, height, arena);
  for (size_t i = 0; i < moment.size(); ++i) {
    open_.push_back(glm::length(moment[i]) > 0 ? glm::normalize(moment[i]) : cellDirections()[i]);
    light_.push_back(glm::length(cells.cells[i].moment) > 0 ? glm::normalize(cells.cells[i].moment) : open_[i]);
  }
}

DVec3 SmoothedRadiance::at(const DVec3& direction) const {
  DVec3 light(0.0);
  double all = 0;
  cellsWithin(direction, kSupport, [&](size_t i, double) {
    const EnvironmentCell& cell = cells_.cells[i];
    all += std::exp((glm::dot(direction, open_[i]) - 1) / (kSmooth * kSmooth)) * cell.solidAngle;
    if (cell.weight > 0) light += std::exp((glm::dot(direction, light_[i]) - 1) / (kSmooth * kSmooth)) * cell.flux;
  });
  return all > 0 ? light / all : DVec3(0.0);
}

std::vector<DVec3> SmoothedRadiance::atVertices(const TaskArena& arena, const StopToken& stop) const {
  const Icosphere& sphere = icosphere(kSmoothLevel);
  std::vector<DVec3> out(sphere.vertices.size());
  const bool complete = arena.parallelFor(
      out.size(), 256,
      [&](size_t begin, size_t end) {
        for (size_t v = begin; v < end; ++v) out[v] = at(sphere.vertices[v]);
      },
      stop);
  return complete ? out : std::vector<DVec3>();
}

std::vector<double> vertexAngles(const Icosphere& sphere) {
  std::vector<double> out(sphere.vertices.size(), 0.0);
  for (size_t v = 0; v < out.size(); ++v)
    for (const int a : sphere.neighbours[v])
      for (const int b : sphere.neighbours[v]) {
        if (a < 0 || b <= a || std::find(sphere.neighbours[size_t(a)].begin(), sphere.neighbours[size_t(a)].end(), b) == sphere.neighbours[size_t(a)].end())
          continue;
        const DVec3 &p = sphere.vertices[v], &q = sphere.vertices[size_t(a)], &r = sphere.vertices[size_t(b)];
        out[v] += 2.0 / 3 * std::atan2(std::fabs(glm::dot(p, glm::cross(q, r))), 1 + glm::dot(p, q) + glm::dot(q, r) + glm::dot(r, p));
      }
  return out;
}

std::vector<Candidate> candidatesOf(const std::vector<DVec3>& smoothed, const std::vector<DVec3>& harmonics, const PeakSettings& settings) {
  const Icosphere& sphere = icosphere(kSmoothLevel);
  static const std::vector<double> angles = vertexAngles(icosphere(kSmoothLevel));
  std::vector<double> value, difference;
  double mean = 0;
  for (size_t v = 0; v < smoothed.size(); ++v) {
    value.push_back(luminanceOf(smoothed[v]));
    difference.push_back(value[v] - luminanceOf(harmonics[v]));
    mean += value[v] / double(smoothed.size());
  }
  const std::vector<int> root = climbed(value, sphere);
  const double fixed = settings.fixed > 0 ? settings.fixed : kernelRadius();
  std::vector<Candidate> all, kept;
  for (size_t v = 0; v < root.size(); ++v) {
    if (root[v] != int(v) || !(difference[v] > kLeastDifference * mean)) continue;
    Candidate c{int(v), summitOf(value, sphere, int(v), settings.refine).direction, difference[v], fixed};
    if (settings.radius == Radius::Basin) c.radius = basinRadius(difference, angles, root, int(v));
    if (settings.radius == Radius::Best) c.radius = bestRadius(difference, angles, root, int(v), c.direction);
    if (settings.radius == Radius::Curvature)
      if (const double steepness = summitOf(difference, sphere, int(v), Refine::LogQuadric).steepness; steepness > 0)
        c.radius = radiusOfAngle(2 * std::numbers::pi / steepness);
    c.radius = std::clamp(c.radius, kLeastRadius, kMostRadius);
    all.push_back(c);
  }
  std::stable_sort(all.begin(), all.end(), [](const Candidate& a, const Candidate& b) { return a.difference > b.difference; });
  for (const Candidate& c : all) {
    const auto overlaps = [&](const Candidate& k) { return glm::dot(k.direction, c.direction) > std::cos(std::min(k.radius + c.radius, std::numbers::pi)); };
    if (std::none_of(kept.begin(), kept.end(), overlaps)) kept.push_back(c);
  }
  return kept;
}

}  // namespace gobo::transfer::published
