// SPDX-License-Identifier: Apache-2.0
#include "path_density/combined.h"

#include <array>
#include <cmath>
#include <cstdio>
#include <functional>
#include <string>
#include <vector>

#include "base/sobol.h"
#include "filters/outliers/combined_sampling.h"
#include "filters/outliers/sample_estimators.h"
#include "filters/outliers/white.h"
#include "filters/path_density/path_density.h"

namespace gobo::pathdensitybench {

namespace {

constexpr int kWidth = 64, kHeight = 48;
constexpr double kBall = 0.3;

/// A lamp of radiance 1 facing down at height `up`, 2 x 1.4, above the middle of a floor of 4 x 3 and a ball.
struct Floor {
  double up, ballUp;

  DVec3 at(int x, int y) const { return {(x + 0.5) / kWidth * 4 - 2, 0.0, (y + 0.5) / kHeight * 3 - 1.5}; }
  DVec3 lamp(double u, double v) const { return {2 * u - 1, up, 1.4 * v - 0.7}; }
  /// Of a point of the lamp, by its area, over pi: albedo 1.
  double light(const DVec3& p, const DVec3& q) const {
    const DVec3 d = q - p;
    const double r2 = glm::dot(d, d);
    return 2.8 * d.y * d.y / (r2 * r2 * M_PI);
  }
  bool seen(const DVec3& p, const DVec3& q) const {
    const DVec3 d = glm::normalize(q - p), c = DVec3(0.0, ballUp, 0.0) - p;
    const double along = glm::dot(c, d);
    return along < 0 || glm::dot(c, c) - along * along > kBall * kBall;
  }
  /// Lambert 1760: half the sum over the edges of the angle that they take times the cosine of their plane's normal.
  double whole(const DVec3& p) const {
    const DVec3 corners[] = {lamp(0, 0), lamp(1, 0), lamp(1, 1), lamp(0, 1)};
    double sum = 0;
    for (size_t i = 0; i < 4; ++i) {
      const DVec3 a = glm::normalize(corners[i] - p), b = glm::normalize(corners[(i + 1) % 4] - p);
      sum += std::acos(glm::dot(a, b)) * glm::normalize(glm::cross(a, b)).y;
    }
    return std::abs(sum) / (2 * M_PI);
  }
};

struct Truth {
  std::vector<double> light, shown;  // radiance; share of the lamp
  double mean = 0;
};
Truth truthOf(const Floor& floor, const TaskArena& arena) {
  constexpr int kSide = 256;
  Truth t{std::vector<double>(kWidth * kHeight), std::vector<double>(kWidth * kHeight), 0.0};
  arena.parallelFor(kHeight, 1, [&](size_t y, size_t) {
    for (int x = 0; x < kWidth; ++x) {
      const DVec3 p = floor.at(x, int(y));
      double missing = 0, hidden = 0;
      for (int i = 0; i < kSide * kSide; ++i) {
        const DVec3 q = floor.lamp((i % kSide + 0.5) / kSide, (i / kSide + 0.5) / kSide);
        if (floor.seen(p, q)) continue;
        missing += floor.light(p, q) / (kSide * kSide);
        hidden += 1.0 / (kSide * kSide);
      }
      t.light[y * kWidth + size_t(x)] = hidden >= 1 - 1e-12 ? 0.0 : floor.whole(p) - missing;
      t.shown[y * kWidth + size_t(x)] = 1 - hidden;
    }
  });
  for (const double l : t.light) t.mean += l / double(t.light.size());
  return t;
}

struct FloorSamples {
  std::vector<double> f, g;  // n a pixel
  pathdensity::PathSamples paths{kWidth, kHeight};
};
FloorSamples floorSamples(const Floor& floor, int n, uint64_t seed) {
  FloorSamples s;
  const auto unit = [&](uint64_t i, uint64_t k) { return double(hash64(hash64(seed, i), k) >> 11) * 0x1p-53; };
  uint64_t i = 0;
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x)
      for (int k = 0; k < n; ++k, ++i) {
        const DVec3 p = floor.at(x, y), q = floor.lamp(unit(i, 0), unit(i, 1));
        s.g.push_back(floor.light(p, q));
        s.f.push_back(floor.seen(p, q) ? s.g.back() : 0.0);
        const Vec2 film(float(x) + float(unit(i, 2)), float(y) + float(unit(i, 3)));
        if (const Status added = s.paths.add(x, y, film, Vec3(0.0f), Vec3(float(s.f.back()))); !added.ok()) std::printf("%s\n", added.toString().c_str());
      }
  return s;
}

}  // namespace

int combinedSampling(const TaskArena& arena) {
  using outliers::Combination;
  std::printf("%-22s %4s %-14s %9s %9s %9s %9s %9s\n", "lamp", "spp", "estimator", "all", "lit", "partly", "shadow", "energy");
  for (const auto& [name, floor] : {std::pair{"near, small shadow", Floor{1.0, 0.3}}, {"low, large shadow", Floor{0.7, 0.38}}}) {
    const Truth truth = truthOf(floor, arena);
    for (const int n : {4, 16, 64}) {
      const FloorSamples s = floorSamples(floor, n, 7);
      const auto v = s.paths.view();
      const auto bins = pathdensity::binSamples(v);
      const auto grey = [](const std::vector<float>& rgb) {
        std::vector<double> out;
        for (size_t i = 0; i < rgb.size(); i += 3) out.push_back(double(rgb[i]));
        return out;
      };
      const auto combined = [&](Combination how) {
        std::vector<double> out;
        for (size_t p = 0; p < truth.light.size(); ++p) {
          const auto own = [&](const std::vector<double>& all) { return std::span(all).subspan(p * size_t(n), size_t(n)); };
          out.push_back(outliers::combinedEstimate(own(s.f), own(s.g), floor.whole(floor.at(int(p) % kWidth, int(p) / kWidth)), how));
        }
        return out;
      };
      const auto shared = [&] {  // beta from the 3 x 3 pixels
        std::vector<double> out;
        const auto known = [&](int x, int y) { return floor.whole(floor.at(x, y)); };
        for (int y = 0; y < kHeight; ++y)
          for (int x = 0; x < kWidth; ++x) {
            outliers::PairSums around;
            for (int b = std::max(y - 1, 0); b <= std::min(y + 1, kHeight - 1); ++b)
              for (int a = std::max(x - 1, 0); a <= std::min(x + 1, kWidth - 1); ++a)
                for (size_t i = 0; i < size_t(n) && (a != x || b != y); ++i) {
                  const size_t at = size_t(b * kWidth + a) * size_t(n) + i;
                  around.add(s.f[at], s.g[at], known(a, b));
                }
            const auto own = [&](const std::vector<double>& all) { return std::span(all).subspan(size_t(y * kWidth + x) * size_t(n), size_t(n)); };
            out.push_back(outliers::combinedWith(own(s.f), own(s.g), known(x, y), around));
          }
        return out;
      };
      const auto density = [&] {
        pathdensity::Settings settings;
        settings.fewer = true;
        const auto white = outliers::whiteOf(outliers::meanPicture(v, bins), kWidth, kHeight, arena);
        if (white.ok()) settings.metric.white = *white;
        const auto filtered = pathdensity::rejectOutliers(v, settings, arena);
        return filtered.ok() ? grey(filtered->rgb) : std::vector<double>(truth.light.size());
      };
      const std::pair<const char*, std::function<std::vector<double>()>> estimators[] = {
          {"additive", [&] { return combined(Combination::Additive); }},
          {"subtractive", [&] { return combined(Combination::Subtractive); }},
          {"combined", [&] { return combined(Combination::Combined); }},
          {"combined, 3x3", shared},
          {"ratio", [&] { return combined(Combination::Ratio); }},
          {"path density", density},
          {"trimmed 10%", [&] { return grey(outliers::trimmedMean(v, bins, 0.1)); }},
      };
      for (const auto& [estimator, picture] : estimators) {
        const auto got = picture();
        double squares[3] = {}, count[3] = {}, energy = 0;
        for (size_t p = 0; p < got.size(); ++p) {
          const size_t kind = truth.shown[p] >= 1 ? 0 : truth.shown[p] > 0 ? 1 : 2;
          squares[kind] += std::pow(got[p] - truth.light[p], 2);
          count[kind] += 1;
          energy += got[p] / double(got.size());
        }
        const auto relative = [&](double sum, double many) { return many > 0 ? std::sqrt(sum / many) / truth.mean : 0.0; };
        std::printf("%-22s %4d %-14s %9.5f %9.5f %9.5f %9.5f %9.4f\n", name, n, estimator,
                    relative(squares[0] + squares[1] + squares[2], count[0] + count[1] + count[2]), relative(squares[0], count[0]),
                    relative(squares[1], count[1]), relative(squares[2], count[2]), energy / truth.mean);
      }
    }
  }
  return 0;
}

}  // namespace gobo::pathdensitybench
