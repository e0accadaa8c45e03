// SPDX-License-Identifier: Apache-2.0
#include "terms/surface_reader.h"

namespace gobo {
inline namespace terms {

namespace {

Vec3 outsideNormal(const InstanceGeometry& g, uint32_t primitive) {
  const uint32_t* tri = g.indices + 3 * size_t(primitive);
  const Vec3 n = glm::cross(g.positions[tri[1]] - g.positions[tri[0]], g.positions[tri[2]] - g.positions[tri[0]]);
  return g.world ? (g.mirrored ? -n : n) : g.normalToWorld * n;
}

}  // namespace

SurfaceReader::SurfaceReader(const SceneView& view, AccelPtr accel, const Term& g, const Camera& camera)
    : accel_(std::move(accel)),
      camera_(camera),
      eye_(camera.toWorld[3]),
      forward_(-Vec3(camera.toWorld[2])),
      instance_(g.plane<uint32_t>("instance")),
      primitive_(g.plane<uint32_t>("primitive")),
      bary_(g.floats("bary")),
      P_(g.floats("P")),
      Ng_(g.floats("Ng")) {
  table_.build(view, *accel_);
}

Vec3 SurfaceReader::towardsViewer(size_t i) const {
  return camera_.perspective ? glm::normalize(eye_ - Vec3(P_[3 * i], P_[3 * i + 1], P_[3 * i + 2])) : -forward_;
}

void SurfaceReader::read(size_t i, Surface& out) const {
  const Vec3 d = -towardsViewer(i);
  // The G-buffer's normal is turned to the viewer; the outside normal decides which side of a dielectric this is.
  const Vec3 facing(Ng_[3 * i], Ng_[3 * i + 1], Ng_[3 * i + 2]);
  const Vec3 outside = outsideNormal(accel_->impl().instances[instance_[i]], primitive_[i]);
  table_.interact(instance_[i], primitive_[i], bary_[2 * i], bary_[2 * i + 1], glm::dot(outside, facing) < 0 ? -facing : facing, d, out);
}

}  // namespace terms
}  // namespace gobo
