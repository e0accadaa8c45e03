// SPDX-License-Identifier: Apache-2.0
#include "techniques/prefilter/lobe_cache.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "base/halton.h"
#include "base/to_index.h"
#include "trace/bsdf.h"
#include "trace/bsdf_albedo.h"
#include "trace/bsdf_ggx.h"

namespace gobo::prefilter {

namespace {

constexpr float kLeastFacing = 0.02f;
constexpr float kMost = 1e30f;

/// A direction to the eye above the horizon of `n`, in the plane of both, and that plane's frame.
struct Facing {
  DVec3 x, y, z;
  Vec3 out;  // local
  Facing(const DVec3& n, const DVec3& towards) : z(n) {
    const double mu = glm::dot(n, towards);
    DVec3 across = towards - mu * n;
    double sine = glm::length(across);
    if (!(sine > 1e-9)) {  // any plane will do
      across = glm::cross(n, std::fabs(n.y) < 0.9 ? DVec3(0, 1, 0) : DVec3(1, 0, 0));
      sine = glm::length(across);
    }
    x = across / sine;
    y = glm::cross(z, x);
    const float cosine = std::clamp(float(mu), kLeastFacing, 1.0f);
    out = Vec3(std::sqrt(1.0f - cosine * cosine), 0.0f, cosine);
  }
  Vec3 toMap(const Vec3& v) const { return Vec3(double(v.x) * x + double(v.y) * y + double(v.z) * z); }
};

void store(const DVec3& value, float* to) {
  for (int c = 0; c < 3; ++c) to[c] = value[c] > 0.0 ? float(std::min(value[c], double(kMost))) : 0.0f;  // NaN: nothing
}

/// What the microfacets lose of light at a cosine, times it, and what Schlick's term adds: tabulated, linear between 4096 cosines.
class LostByCosine {
 public:
  explicit LostByCosine(const ReflectionAlbedo& table) {
    for (int i = 0; i <= kSteps; ++i) {
      const float mu = float(i) / float(kSteps);
      const ReflectionAlbedo::Value v = table.at(mu);
      at_.push_back(mu * Vec2(v.deficit, v.schlick));
    }
  }
  Vec2 at(float cosine) const {
    const float place = cosine * float(kSteps);
    const size_t i = size_t(toInteger(place, 0, kSteps - 1));
    return glm::mix(at_[i], at_[i + 1], place - float(i));
  }

 private:
  static constexpr int kSteps = 4096;
  std::vector<Vec2> at_;
};

/// f(texel, its normal), of all.
template <class F>
bool overTexels(const NormalPicture& picture, size_t grain, const TaskArena& arena, const StopToken& stop, F&& f) {
  const auto run = [&](size_t begin, size_t end) {
    for (size_t i = begin; i < end; ++i) f(i, picture.normal(int(i) % picture.side(), int(i) / picture.side()));
  };
  return arena.parallelFor(picture.texels(), grain, run, stop) && !stop.stopRequested();
}

}  // namespace

bool cosineMeans(const NormalPicture& picture, std::span<const MapLight> lights, const TaskArena& arena, const StopToken& stop, std::span<float> out) {
  return overTexels(picture, 64, arena, stop, [&](size_t i, const DVec3& n) {
    DVec3 sum(0.0);
    for (const MapLight& light : lights) sum += light.flux * std::max(glm::dot(n, light.direction), 0.0);
    store(sum * std::numbers::inv_pi, out.data() + 3 * i);
  });
}

bool lobeMeans(const NormalPicture& picture, const EnvironmentPyramid& map, std::span<const MapLight> lights, float roughness, int samples,
               const TaskArena& arena, const StopToken& stop, std::span<float> out) {
  const float alpha = maxOf(sqr(clamp01(roughness)), kDeltaAlpha);
  const Ggx ggx(alpha);
  const ReflectionAlbedo table(alpha, std::sqrt(alpha));
  const LostByCosine lost(table);
  std::vector<Vec2> points;
  for (int i = 0; i < samples; ++i) points.emplace_back((float(i) + 0.5f) / float(samples), (float(radicalInverse(uint32_t(i), 2) >> 8) + 0.5f) * 0x1p-24f);
  const double byDeficit = std::numbers::pi * double(table.deficitMean), bySchlick = std::numbers::pi * double(table.schlickMean);

  return overTexels(picture, 16, arena, stop, [&](size_t i, const DVec3& n) {
    const Facing facing(n, picture.towards());
    DVec3 lobe(0.0), grazing(0.0), deficit(0.0), schlick(0.0);
    double weights = 0, grazingWeights = 0;
    for (const Vec2& u : points) {
      const Vec3 h = ggx.sample(facing.out, u), in = 2.0f * glm::dot(facing.out, h) * h - facing.out;
      float f, density, c;
      if (!(in.z > 0.0f) || !ggxReflection(ggx, facing.out, in, f, density, c) || !(density > 0.0f)) continue;
      const double weight = double(f) / double(density), risen = weight * double(schlickWeight(c));
      const DVec3 radiance(map.mean(glm::normalize(facing.toMap(in)), 1.0f / (float(samples) * density)));
      lobe += weight * radiance;
      grazing += risen * radiance;
      weights += weight;
      grazingWeights += risen;
    }
    DVec3 cosine(0.0);
    for (const MapLight& light : lights) {
      const double along = glm::dot(n, light.direction);
      if (!(along > 0.0)) continue;
      const Vec2 parts = lost.at(float(along));
      deficit += light.flux * double(parts.x);
      schlick += light.flux * double(parts.y);
      cosine += light.flux * along;
    }
    // Without a weight to speak of, the next best mean: the lobe's, or that of the cosine.
    cosine *= std::numbers::inv_pi;
    float* to = out.data() + size_t(3 * kLobeMeans) * i;
    store(weights > 0.0 ? lobe / weights : cosine, to);
    store(grazingWeights > 1e-12 * weights ? grazing / grazingWeights : weights > 0.0 ? lobe / weights : cosine, to + 3);
    store(byDeficit > 1e-9 ? deficit / byDeficit : cosine, to + 6);
    store(bySchlick > 1e-9 ? schlick / bySchlick : cosine, to + 9);
  });
}

}  // namespace gobo::prefilter
