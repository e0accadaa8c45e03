// SPDX-License-Identifier: Apache-2.0
#include "techniques/transfer/exhaustive_light.h"

#include <atomic>
#include <cmath>
#include <numbers>
#include <string>

#include "trace/bsdf.h"

namespace gobo::transfer {

namespace {

/// One place's sum. Shadow rays go sixteen at a time; what they see is added in the order of the directions.
class ExhaustivePlace {
 public:
  ExhaustivePlace(const Accel& accel, const Surface& surface, const Vec3& out)
      : accel_(accel), surface_(surface), frame_(surface.frame()), out_(frame_.toLocal(out)), facing_(surface.facing()) {
    above_ = surface.origin(facing_);
    below_ = surface.origin(-facing_);
  }
  void add(const ExhaustiveSky::Direction& d) {
    const float height = glm::dot(facing_, d.towards);
    if (height == 0.0f || (height < 0.0f && !surface_.material->transmissive)) return;
    const BsdfValue f = bsdfEval(surface_.bsdf, out_, frame_.toLocal(d.towards));
    if (f.diffuse == Vec3(0.0f) && f.specular == Vec3(0.0f)) return;
    rays_[count_] = Ray{height > 0.0f ? above_ : below_, d.towards};
    diffuse_[count_] = DVec3(f.diffuse) * DVec3(d.irradiance);
    specular_[count_] = DVec3(f.specular) * DVec3(d.irradiance);
    if (++count_ == kPacket) flush();
  }
  void flush() {
    const uint32_t blocked = count_ > 0 ? accel_.occluded16(rays_, count_) : 0;
    for (int k = 0; k < count_; ++k) {
      if (blocked >> k & 1u) continue;
      diffuse += diffuse_[k];
      specular += specular_[k];
    }
    rays += uint64_t(count_);
    count_ = 0;
  }
  DVec3 diffuse{0.0}, specular{0.0};
  uint64_t rays = 0;

 private:
  static constexpr int kPacket = 16;
  const Accel& accel_;
  const Surface& surface_;
  Frame frame_;
  Vec3 out_, facing_, above_, below_;
  Ray rays_[kPacket];
  DVec3 diffuse_[kPacket], specular_[kPacket];
  int count_ = 0;
};

}  // namespace

Result<ExhaustiveSky> ExhaustiveSky::of(const Environment& map, int across, const Vec3& scale) {
  if (across < 1 || across > 16) return invalidArgument("exhaustive light: " + std::to_string(across) + " directions along a texel; 1 to 16");
  const size_t columns = size_t(map.width) * size_t(across), rows = size_t(map.height) * size_t(across);
  if (columns * rows > kMost)
    return invalidArgument("exhaustive light: " + std::to_string(columns * rows) + " directions of " + map.name + "; at most " + std::to_string(kMost));
  ExhaustiveSky sky;
  const double step = 2 * std::numbers::pi / double(columns);
  const auto polar = [&](double row) { return std::numbers::pi * row / double(rows); };
  for (size_t y = 0; y < size_t(map.height); ++y)
    for (size_t x = 0; x < size_t(map.width); ++x)
      for (size_t v = y * size_t(across); v < (y + 1) * size_t(across); ++v) {
        const double solidAngle = step * (std::cos(polar(double(v))) - std::cos(polar(double(v) + 1))), theta = polar(double(v) + 0.5);
        for (size_t u = x * size_t(across); u < (x + 1) * size_t(across); ++u) {
          const Vec3 towards = map.toDirection(Vec2(float((double(u) + 0.5) / double(columns)), float(theta / std::numbers::pi)));
          const DVec3 irradiance = DVec3(map.eval(towards)) * DVec3(scale) * solidAngle;
          if (const Vec3 rounded(irradiance); rounded != Vec3(0.0f)) sky.directions_.push_back({towards, rounded});
        }
      }
  return sky;
}

ExhaustivePicture exhaustivePicture(const ExhaustiveSky& sky, const SceneView& scene, const AccelPtr& accel, const Term& gbuffer, const Camera& camera,
                                    const TaskArena& arena, const StopToken& stop) {
  const SurfaceReader surfaces(scene, accel, gbuffer, camera);
  const Extent extent = gbuffer.extent();
  const size_t pixels = size_t(extent.width) * size_t(extent.height), layers = size_t(extent.layers);
  ExhaustivePicture out;
  out.diffuse = Image(extent.width, extent.height, 3);
  out.specular = Image(extent.width, extent.height, 3);
  std::atomic<uint64_t> rays{0};
  const bool complete = arena.parallelFor(
      pixels, 1,
      [&](size_t begin, size_t end) {
        for (size_t p = begin; p < end; ++p) {
          DVec3 diffuse(0.0), specular(0.0);
          for (size_t layer = 0; layer < layers; ++layer) {
            const size_t i = layer * pixels + p;
            if (!surfaces.hit(i)) continue;
            Surface surface;
            surfaces.read(i, surface);
            if (surface.material->unlit) continue;
            const Vec3 towardsEye = camera.perspective ? glm::normalize(Vec3(camera.toWorld[3]) - surface.p) : Vec3(camera.toWorld[2]);
            ExhaustivePlace place(*accel, surface, towardsEye);
            for (size_t k = 0; k < sky.directions().size(); ++k) {
              if (k % 65536 == 0 && stop.stopRequested()) return;
              place.add(sky.directions()[k]);
            }
            place.flush();
            diffuse += place.diffuse;
            specular += place.specular;
            rays += place.rays;
          }
          for (int c = 0; c < 3; ++c) {
            out.diffuse.data[3 * p + size_t(c)] = float(diffuse[c] / double(layers));
            out.specular.data[3 * p + size_t(c)] = float(specular[c] / double(layers));
          }
        }
      },
      stop);
  if (!complete || stop.stopRequested()) return {};
  out.rays = rays;
  return out;
}

}  // namespace gobo::transfer
