// SPDX-License-Identifier: Apache-2.0
// Accel: Embree over a scene's triangles (facets kAccelFacets). Immutable after build; any thread may trace.
// Alpha-masked texels let rays through; Blend surfaces are passed with probability 1 - alpha, decided by a hash of the ray,
// so that the same ray always gets the same answer.
#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <future>
#include <list>
#include <memory>
#include <mutex>
#include <string>

#include "base/status.h"
#include "base/stop.h"
#include "base/task_arena.h"
#include "scene/camera.h"
#include "scene/ray_packet.h"
#include "scene/scene.h"

namespace gobo {
inline namespace trace {

inline constexpr uint32_t kNoHit = ~0u;

/// What an Accel reads of a scene, alpha tests included. A node that asks for one declares at least these, so that its key
/// holds whatever a ray may meet; the cache keys by their digest.
inline constexpr Facet kAccelFacets = Facet::Topology | Facet::Pose | Facet::Coverage;

struct Hit {
  float t = 3.0e38f;
  uint32_t instance = kNoHit;  ///< index into Scene::instances
  uint32_t primitive = 0;      ///< triangle of its mesh
  float u = 0, v = 0;          ///< barycentrics of vertices 1 and 2
  Vec3 Ng{0.0f};               ///< unit geometric normal in world space by the triangle's winding (not turned to the ray);
                               ///< a mirroring instance turns the winding over, as glTF says, so that outside stays outside
  bool valid() const { return instance != kNoHit; }
};

/// What 16 rays hit, a lane each; the fields of Hit. Where nothing is hit `instance` is kNoHit, and only that is of use.
struct alignas(64) HitPacket {
  float t[RayPacket::kLanes], u[RayPacket::kLanes], v[RayPacket::kLanes], Ng[3][RayPacket::kLanes];
  uint32_t instance[RayPacket::kLanes], primitive[RayPacket::kLanes];
  Hit lane(int i) const { return instance[i] == kNoHit ? Hit() : Hit{t[i], instance[i], primitive[i], u[i], v[i], {Ng[0][i], Ng[1][i], Ng[2][i]}}; }
};

class BackFaces;  // trace/back_faces.h

class Accel {
 public:
  /// Whose vectors Embree traces with: "avx512", "avx2", as the processor has them, or as GOBO_EMBREE_ISA=avx2 says: then the last bits are those of
  /// processors without AVX-512. Of the process, read once. Errors: InvalidArgument.
  static Result<std::string> kernels();
  /// Reads facets kAccelFacets of `view` (CHECKed). Null when `stop` fired, which is polled every few milliseconds.
  static std::shared_ptr<const Accel> build(const SceneView& view, const TaskArena& arena, const StopToken& stop = {});
  ~Accel();
  /// `passed`: back faces that the ray goes through; null: none.
  bool intersect(const Ray& ray, Hit& hit, const BackFaces* passed = nullptr) const;
  /// The same for up to 16 rays that run side by side (camera and light rays): several times as fast as one by one. hits[i].instance is
  /// kNoHit where ray i hits nothing. May differ from intersect() in the last bits.
  void intersect16(const Ray* rays, int count, Hit* hits, const BackFaces* passed = nullptr) const;
  /// The same bits for whoever has lanes and wants lanes; those from `count` on are not traced.
  void intersect16(const RayPacket& rays, int count, HitPacket& hits, const BackFaces* passed = nullptr) const;
  /// Anything between ray.tmin and ray.tmax?
  bool occluded(const Ray& ray) const;
  /// The same for up to 16 rays that run side by side: bit i of the result is set where ray i is blocked.
  uint32_t occluded16(const Ray* rays, int count) const;
  size_t bytes() const;
  /// The size of the scene's coordinates: a power of two not below the largest absolute coordinate (1 when empty).
  float unit() const;
  /// At least what offsetOrigin() takes as `reach` for any point of the scene, by axis; 1 when empty.
  Vec3 reach() const;
  /// The same for points of an instance alone: something wide elsewhere does not widen the step off a small thing.
  Vec3 reach(uint32_t instance) const;
  struct Impl;
  const Impl& impl() const { return *impl_; }

 private:
  Accel();
  std::unique_ptr<Impl> impl_;
};
using AccelPtr = std::shared_ptr<const Accel>;

/// Keeps the last few structures by the digest of kAccelFacets and the mapping (SceneView::mapping). Thread-safe; concurrent asks for one digest build once. A
/// build that throws or is stopped leaves nothing behind: the next ask builds again.
class AccelCache {
 public:
  using Build = std::function<AccelPtr(const SceneView&, const TaskArena&, const StopToken&)>;
  /// `build`: a seam for tests.
  explicit AccelCache(size_t maxBytes = 4ull << 30, Build build = Accel::build) : maxBytes_(maxBytes), build_(std::move(build)) {}
  /// Null when `stop` fired first, also while another thread builds. Throws what the build throws (std::bad_alloc).
  AccelPtr get(const SceneView& view, const TaskArena& arena, const StopToken& stop = {});
  size_t bytes() const;
  void shrink(size_t most);  ///< the least recently used go; who renders with one keeps it
  uint64_t builds() const;
  /// Milliseconds that the structure kept for this view took to build; 0 when none is kept.
  double buildMs(const SceneView& view) const;

 private:
  struct Entry {
    Hash128 key;
    uint64_t build = 0;
    std::shared_future<AccelPtr> accel;
    double ms = 0;
  };
  void drop(uint64_t build);
  void trim(size_t most, bool keepFirst);  // under mutex_
  mutable std::mutex mutex_;
  std::list<Entry> entries_;  // most recent first
  size_t maxBytes_;
  Build build_;
  uint64_t builds_ = 0;
};

/// p moved to the side of `side` (unit, the geometric normal or its opposite) past every point that rounding could have put on the wrong side of its
/// triangle (pbrt-v4 section 6.8.6, with room for Embree's own rounding: 2.5 units in the last place at least). `reach`: the sum of the absolute values
/// that went into p, or a bound of it: of a point of an instance Accel::reach(instance), of any other Accel::reach(). It moves by 1.3e-6 of the largest
/// coordinate at most.
inline Vec3 offsetOrigin(const Vec3& p, const Vec3& side, const Vec3& reach) {
  // The second part is for planes along an axis: Embree takes t = 0 for a hit, and rounding of its normal counts there.
  const float d = 6e-7f * glm::dot(glm::abs(side), reach) + 3e-7f * std::max(reach.x, std::max(reach.y, reach.z));
  return p + side * d;
}
/// `reach` of a point of Embree's instances, from that of the point in object space: Embree takes the ray there and back, the translation counts twice.
inline Vec3 instanceReach(const Mat4& toWorld, const Vec3& local, const Vec3& world) {
  return 2.0f *
             (glm::abs(Vec3(toWorld[0])) * local.x + glm::abs(Vec3(toWorld[1])) * local.y + glm::abs(Vec3(toWorld[2])) * local.z + glm::abs(Vec3(toWorld[3]))) +
         glm::abs(world);
}

}  // namespace trace
}  // namespace gobo
