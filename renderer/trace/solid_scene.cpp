// SPDX-License-Identifier: Apache-2.0
#include "trace/solid_scene.h"

#include "trace/straight.h"

namespace gobo {
inline namespace trace {

SolidScene::SolidScene(const SceneView& view, AccelPtr accel, bool clear) : accel_(std::move(accel)) {
  if (!clear) return;
  for (const Instance& i : view.instances()) passable_.push_back(maySendStraight(view.bsdf(view.mesh<Facet::Topology>(i.mesh).material)));
}

/// The first solid hit from `hit` on, along the same line.
void SolidScene::beyond(Ray ray, Hit& hit) const {
  for (int passes = 0; hit.valid() && !solid(hit.instance); ++passes) {
    if (passes == kMostPasses) return;
    ray.tmin = hit.t + std::max(hit.t, accel_->unit()) * 2.4e-7f;  // two units in the last place
    if (!(ray.tmin < ray.tmax)) {
      hit = Hit();
      return;
    }
    accel_->intersect(ray, hit);
  }
}

void SolidScene::intersect16(const Ray* rays, int count, Hit* hits) const {
  accel_->intersect16(rays, count, hits);
  if (passable_.empty()) return;
  for (int i = 0; i < count; ++i) beyond(rays[i], hits[i]);
}

uint32_t SolidScene::occluded16(const Ray* rays, int count) const {
  if (passable_.empty()) return accel_->occluded16(rays, count);
  Hit hits[16];
  intersect16(rays, count, hits);
  uint32_t blocked = 0;
  for (int i = 0; i < count; ++i) blocked |= uint32_t(hits[i].valid()) << i;
  return blocked;
}

}  // namespace trace
}  // namespace gobo
