// SPDX-License-Identifier: Apache-2.0
#include "techniques/transfer/published/occlusion_factor.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "base/check.h"
#include "techniques/transfer/harmonics.h"
#include "techniques/transfer/receiver_mesh.h"

namespace gobo::transfer::published {

namespace {

constexpr double kLeastOpen = 0.05;  // of the open lobe's top

/// The clamped cosine of the angle whose cosine is c, cut to some bands: sum of A_l (2 l + 1) / (4 pi) P_l(c).
double openLobe(int bands, double c) {
  double before = 1, now = c, sum = cosineCoefficient(0);  // P_0, P_1
  for (int l = 1; l < bands; ++l) {
    sum += cosineCoefficient(l) * (2 * l + 1) * now;
    const double next = ((2 * l + 1) * c * now - l * before) / (l + 1);
    before = now;
    now = next;
  }
  return sum / (4 * std::numbers::pi);
}

}  // namespace

double occlusionFactor(double first) {
  static const double open = std::numbers::pi / std::sqrt(4 * std::numbers::pi);
  return std::clamp(1 - first / open, 0.0, 1.0);
}

double occlusionTowards(std::span<const float> transfer, int bands, const DVec3& normal, const DVec3& towards) {
  GOBO_CHECK(bands >= 1 && bands <= kMaxBands && transfer.size() == size_t(bands * bands));
  const double cosine = glm::dot(normal, towards), open = openLobe(bands, cosine);
  if (!(cosine > 0) || open < kLeastOpen * openLobe(bands, 1.0)) return occlusionFactor(double(transfer[0]));
  std::array<double, kMaxHarmonics> Y;
  harmonics(towards, bands, Y.data());
  double seen = 0;
  for (size_t h = 0; h < transfer.size(); ++h) seen += double(transfer[h]) * Y[h];
  return std::clamp(1 - seen / open, 0.0, 1.0);
}

std::vector<DVec3> publishedIrradiance(const std::vector<double>& harmonics, const std::vector<PublishedLight>& lights, const ShadowedView& view,
                                       const Accel& accel, ShadowBlend blend, const TaskArena& arena, const StopToken& stop) {
  const size_t n = size_t(view.bands * view.bands);
  GOBO_CHECK(harmonics.size() == 3 * n);
  const auto instance = view.gbuffer.plane<uint32_t>("instance"), point = view.places.plane<uint32_t>("point");
  const auto P = view.gbuffer.floats("P"), Ng = view.gbuffer.floats("Ng"), N = view.surface.floats("N"), weight = view.places.floats("weight"),
             direct = view.direct.floats("transfer");
  const auto vectorAt = [](std::span<const float> plane, size_t i) { return Vec3(plane[3 * i], plane[3 * i + 1], plane[3 * i + 2]); };
  std::vector<DVec3> out(instance.size(), DVec3(0.0));
  const bool complete = arena.parallelFor(
      out.size(), 256,
      [&](size_t begin, size_t end) {
        std::vector<float> transfer(n);
        for (size_t i = begin; i < end; ++i) {
          if (instance[i] == kNoHit) continue;
          std::fill(transfer.begin(), transfer.end(), 0.0f);
          for (size_t k = 0; k < kCorners; ++k)
            for (size_t h = 0; h < n; ++h) transfer[h] += weight[kCorners * i + k] * direct[size_t(point[kCorners * i + k]) * n + h];
          DVec3 sum(0.0);
          for (size_t h = 0; h < n; ++h) sum += double(transfer[h]) * DVec3(harmonics[3 * h], harmonics[3 * h + 1], harmonics[3 * h + 2]);
          const DVec3 normal(vectorAt(N, i)), geometric(vectorAt(Ng, i));
          for (const PublishedLight& light : lights) {
            const double cosine = glm::dot(normal, light.direction);
            if (!(cosine > 0)) continue;
            double visible = 0;
            if (glm::dot(geometric, light.direction) > 0) {
              Ray ray;
              ray.origin = offsetOrigin(vectorAt(P, i), Vec3(geometric), accel.reach(instance[i]));
              ray.direction = glm::normalize(Vec3(light.direction));
              visible = accel.occluded(ray) ? 0.0 : 1.0;
            }
            const double o = blend == ShadowBlend::Hard         ? 1.0
                             : blend == ShadowBlend::Hemisphere ? occlusionFactor(double(transfer[0]))
                                                                : occlusionTowards(transfer, view.bands, normal, light.direction);
            sum += cosine * blendedVisibility(visible, o) * light.irradiance;
          }
          out[i] = glm::max(sum, DVec3(0.0));
        }
      },
      stop);
  if (!complete) return {};
  return out;
}

}  // namespace gobo::transfer::published
