// SPDX-License-Identifier: Apache-2.0
#include "techniques/transfer/environment_report.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "techniques/transfer/gloss_levels.h"
#include "techniques/transfer/harmonics.h"
#include "terms/environment_cells.h"

namespace gobo::transfer {

namespace {

bool fill(EnvironmentReport::Part& part, const Environment& map, std::span<const float> left, const std::vector<double>& coefficients, int bands,
          const TaskArena& arena, const StopToken& stop) {
  const int width = kGlossLevels[0].width, height = kGlossLevels[0].height;
  part.radiance = Image(width, height, 3);
  part.harmonics = Image(width, height, 3);
  if (!sharpLevel(map, left, arena, stop, part.radiance.data)) return false;
  struct Row {
    double missed = 0, all = 0, least = std::numeric_limits<double>::infinity();
  };
  std::vector<Row> rows(static_cast<size_t>(height));
  const bool complete = arena.parallelFor(
      size_t(height), 8,
      [&](size_t begin, size_t end) {
        std::vector<double> Y(size_t(bands * bands));
        for (size_t y = begin; y < end; ++y) {
          const double theta = (double(y) + 0.5) * std::numbers::pi / height, s = std::sin(theta);
          for (int x = 0; x < width; ++x) {
            const double phi = ((x + 0.5) / width - 0.5) * 2 * std::numbers::pi;
            harmonics(DVec3(s * std::cos(phi), std::cos(theta), s * std::sin(phi)), bands, Y.data());
            DVec3 sum(0.0);
            for (size_t h = 0; h < Y.size(); ++h) sum += Y[h] * DVec3(coefficients[3 * h], coefficients[3 * h + 1], coefficients[3 * h + 2]);
            const float* own = part.radiance.at(x, int(y));
            for (int c = 0; c < 3; ++c) part.harmonics.at(x, int(y))[c] = float(sum[c]);
            const double found = luminanceOf(sum), there = luminanceOf(DVec3(own[0], own[1], own[2]));
            rows[y].missed += s * (found - there) * (found - there);
            rows[y].all += s * there * there;
            rows[y].least = std::min(rows[y].least, found);
          }
        }
      },
      stop);
  if (!complete) return false;
  Row sum;
  for (const Row& row : rows) {
    sum.missed += row.missed;
    sum.all += row.all;
    sum.least = std::min(sum.least, row.least);
  }
  part.error = sum.all > 0 ? std::sqrt(sum.missed / sum.all) : 0.0;
  part.least = sum.least;
  return true;
}

}  // namespace

EnvironmentReport reportEnvironment(const Environment& map, int bands, int lights, double share, const TaskArena& arena, const StopToken& stop) {
  EnvironmentReport out;
  out.split = splitEnvironment(map, bands, lights, share, arena, stop);
  if (out.split.full.empty()) return {};
  const std::vector<float> all(size_t(6) * EnvironmentCells::kSide * EnvironmentCells::kSide, 1.0f);
  const std::vector<float> left = out.split.left.empty() ? all : std::vector<float>(out.split.left.begin(), out.split.left.end());
  if (!fill(out.whole, map, all, out.split.full, bands, arena, stop) || !fill(out.rest, map, left, out.split.rest, bands, arena, stop)) return {};
  // Y_0 is constant: its coefficient is flux times it.
  const double flux = std::sqrt(4 * std::numbers::pi) * luminanceOf(DVec3(out.split.full[0], out.split.full[1], out.split.full[2]));
  double inLights = 0;
  for (const SkyDisk& disk : out.split.lights) inLights += luminanceOf(disk.flux);
  out.lightShare = flux > 0 ? inLights / flux : 0.0;
  return out;
}

}  // namespace gobo::transfer
