// SPDX-License-Identifier: Apache-2.0
#include "techniques/transfer/published/published_split.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "base/check.h"
#include "techniques/transfer/environment_harmonics.h"
#include "techniques/transfer/environment_split.h"
#include "techniques/transfer/harmonics.h"
#include "techniques/transfer/published/least_squares.h"

namespace gobo::transfer::published {

namespace {

bool lies(const PublishedLight& light, const DVec3& direction) { return glm::dot(light.direction, direction) >= std::cos(light.radius); }

/// Harmonics and radiances of the lights' disks that together miss least of the smoothed map at the vertices, by their solid angles.
std::vector<double> fit(std::vector<PublishedLight>& lights, const std::vector<DVec3>& smoothed, int bands, bool nonNegative, const TaskArena& arena) {
  const Icosphere& sphere = icosphere(kSmoothLevel);
  const std::vector<double> angles = vertexAngles(sphere);
  const size_t h = size_t(bands * bands), n = h + lights.size();
  struct Sums {
    std::vector<double> gram, moment;
  };
  constexpr size_t kBlock = 1024;
  const size_t blocks = (angles.size() + kBlock - 1) / kBlock;
  std::vector<Sums> parts(blocks, {std::vector<double>(n * n), std::vector<double>(3 * n)});
  arena.parallelFor(blocks, 1, [&](size_t begin, size_t end) {
    std::vector<double> row(n);
    for (size_t b = begin; b < end; ++b)
      for (size_t v = b * kBlock; v < std::min((b + 1) * kBlock, angles.size()); ++v) {
        harmonics(sphere.vertices[v], bands, row.data());
        for (size_t k = 0; k < lights.size(); ++k) row[h + k] = lies(lights[k], sphere.vertices[v]) ? 1.0 : 0.0;
        for (size_t i = 0; i < n; ++i) {
          if (row[i] == 0) continue;
          const double w = angles[v] * row[i];
          for (size_t j = 0; j <= i; ++j) parts[b].gram[i * n + j] += w * row[j];
          for (size_t c = 0; c < 3; ++c) parts[b].moment[c * n + i] += w * smoothed[v][int(c)];
        }
      }
  });
  Sums all{std::vector<double>(n * n), std::vector<double>(3 * n)};
  for (const Sums& part : parts) {
    for (size_t i = 0; i < n * n; ++i) all.gram[i] += part.gram[i];
    for (size_t i = 0; i < 3 * n; ++i) all.moment[i] += part.moment[i];
  }
  for (size_t i = 0; i < n; ++i)
    for (size_t j = i + 1; j < n; ++j) all.gram[i * n + j] = all.gram[j * n + i];
  std::vector<double> used(3 * h);
  for (size_t c = 0; c < 3; ++c) {
    const std::vector<double> moment(all.moment.begin() + long(c * n), all.moment.begin() + long((c + 1) * n));
    const std::vector<double> x = nonNegative ? solveNonNegative(all.gram, moment, h) : solveSymmetric(all.gram, moment);
    for (size_t i = 0; i < h; ++i) used[3 * i + c] = x[i];
    for (size_t k = 0; k < lights.size(); ++k) lights[k].radiance[int(c)] = x[h + k];
  }
  for (PublishedLight& light : lights) light.irradiance = light.solidAngle * light.radiance;
  return used;
}

/// Largest luminance of a difference by vertex.
double largest(const std::vector<DVec3>& difference) {
  double out = 0;
  for (const DVec3& d : difference) out = std::max(out, std::fabs(luminanceOf(d)));
  return out;
}

}  // namespace

PublishedSplit publishedSplit(const Environment& map, const PublishedSettings& settings, const TaskArena& arena, const StopToken& stop) {
  GOBO_CHECK(settings.bands >= 1 && settings.bands <= kMaxBands && settings.weber > 0 && settings.weber < 1);
  const bool fitted = settings.power == Power::Least || settings.power == Power::NonNegative;
  GOBO_CHECK(!fitted || settings.window == Window::None);
  const int bands = settings.bands;
  PublishedSplit out;
  const std::vector<double> full = environmentHarmonics(map, bands, arena, stop);
  if (full.empty()) return {};
  const EnvironmentCells cells(map, stop, &arena);
  if (stop.stopRequested()) return {};
  const SmoothedRadiance smooth(cells, map.width, map.height, arena);
  const std::vector<DVec3> smoothed = smooth.atVertices(arena, stop);
  if (smoothed.empty()) return {};
  const auto factorsFor = [&](const std::vector<double>& coefficients) {
    out.damping = settings.window == Window::Least ? leastDamping(coefficients, bands, kSmoothLevel) : 0.0;
    return windowFactors(settings.window, bands, out.damping);
  };
  out.flux = cells.flux;
  out.full = full;
  out.factors = factorsFor(full);
  const std::vector<double> shown = windowed(full, out.factors);
  const std::vector<DVec3> shownThere = radianceAtVertices(shown, bands, kSmoothLevel);
  const std::vector<Candidate> candidates = candidatesOf(smoothed, shownThere, settings.peaks);
  out.candidates = candidates.size();
  std::vector<double> differences;
  for (const Candidate& c : candidates) differences.push_back(c.difference);
  for (size_t k = 0; k < std::min(elbow(differences, settings.weber), settings.lights); ++k) {
    PublishedLight light;
    light.direction = candidates[k].direction;
    light.radius = candidates[k].radius;
    light.solidAngle = diskCoefficient(0, light.radius);
    light.difference = candidates[k].difference;
    light.seen = smooth.at(light.direction);
    out.lights.push_back(light);
  }
  if (settings.power == Power::Published) {
    out.used = shown;
    givePublishedPower(out.lights, shown, bands);
  } else if (settings.power == Power::Residual) {
    out.used = giveResidualPower(out.lights, full, out.factors, bands);
    out.factors = factorsFor(out.used);  // the least one is of what is left
    out.used = windowed(out.used, out.factors);
  } else {
    out.used = fit(out.lights, smoothed, bands, settings.power == Power::NonNegative, arena);
  }

  const Icosphere& sphere = icosphere(kSmoothLevel);
  const std::vector<double> angles = vertexAngles(sphere);
  const std::vector<DVec3> usedThere = radianceAtVertices(out.used, bands, kSmoothLevel);
  std::vector<DVec3> difference(smoothed.size());
  for (size_t v = 0; v < smoothed.size(); ++v) {
    difference[v] = smoothed[v] - usedThere[v];
    out.least = v == 0 ? luminanceOf(usedThere[v]) : std::min(out.least, luminanceOf(usedThere[v]));
  }
  if (settings.power == Power::Published) out.maximum.push_back(largest(difference));
  for (const PublishedLight& light : out.lights) {
    for (size_t v = 0; v < smoothed.size(); ++v)
      if (lies(light, sphere.vertices[v])) difference[v] -= light.radiance;
    if (settings.power == Power::Published) out.maximum.push_back(largest(difference));
  }
  if (settings.power != Power::Published) out.maximum.push_back(largest(difference));
  double missed = 0, all = 0;
  for (size_t v = 0; v < smoothed.size(); ++v) {
    missed += angles[v] * luminanceOf(difference[v]) * luminanceOf(difference[v]);
    all += angles[v] * luminanceOf(smoothed[v]) * luminanceOf(smoothed[v]);
  }
  out.squared = all > 0 ? std::sqrt(missed / all) : 0.0;
  out.given = std::sqrt(4 * std::numbers::pi) * DVec3(out.used[0], out.used[1], out.used[2]);
  for (const PublishedLight& light : out.lights) out.given += light.irradiance;
  return out;
}

DVec3 openIrradiance(const std::vector<double>& coefficients, int bands, const std::vector<PublishedLight>& lights, const DVec3& normal) {
  std::vector<double> cosine;
  for (int l = 0; l < bands; ++l) cosine.push_back(cosineCoefficient(l));
  DVec3 sum = radianceOf(windowed(coefficients, cosine), bands, normal);
  for (const PublishedLight& light : lights) sum += std::max(glm::dot(normal, light.direction), 0.0) * light.irradiance;
  return sum;
}

}  // namespace gobo::transfer::published
