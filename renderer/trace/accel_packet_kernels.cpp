// SPDX-License-Identifier: Apache-2.0
// Packets of 16 rays through Embree, and their hits as lanes.
#include <cstring>

#include "trace/accel_impl.h"
#include "trace/back_faces.h"

namespace gobo {
inline namespace trace {

namespace {

constexpr int kLanes = RayPacket::kLanes;

/// Accel::Impl::worldNormal of every lane, bit for bit: at once where one instance fills the packet.
void worldNormals(const Accel::Impl& impl, const RTCRayHit16& r, HitPacket& hits) {
  uint32_t others = 0;
  for (int i = 0; i < kLanes; ++i) others |= hits.instance[i] ^ hits.instance[0];
  if (others == 0 && hits.instance[0] != kNoHit) {
    const InstanceGeometry& g = impl.instances[hits.instance[0]];
    alignas(64) float n[3][kLanes];
    if (g.world) {
      const float turn = g.mirrored ? -1.0f : 1.0f;
      for (int i = 0; i < kLanes; ++i) {
        n[0][i] = turn * r.hit.Ng_x[i];
        n[1][i] = turn * r.hit.Ng_y[i];
        n[2][i] = turn * r.hit.Ng_z[i];
      }
    } else {
      const Mat3& m = g.normalToWorld;
      for (int c = 0; c < 3; ++c) {
        const float x = m[0][c], y = m[1][c], z = m[2][c];
        for (int i = 0; i < kLanes; ++i) n[c][i] = x * r.hit.Ng_x[i] + y * r.hit.Ng_y[i] + z * r.hit.Ng_z[i];
      }
    }
    int usual = 1;  // squares stay in float's range
    for (int i = 0; i < kLanes; ++i) {
      const float x = std::fabs(n[0][i]), y = std::fabs(n[1][i]), z = std::fabs(n[2][i]);
      const float yz = y > z ? y : z, m = x > yz ? x : yz;
      usual &= int(m > 1e-15f) & int(m < 1e15f) & int(x == x) & int(y == y) & int(z == z);
    }
    if (usual) {
      for (int i = 0; i < kLanes; ++i) {
        const float s = 1.0f / std::sqrt(n[0][i] * n[0][i] + n[1][i] * n[1][i] + n[2][i] * n[2][i]);
        hits.Ng[0][i] = n[0][i] * s;
        hits.Ng[1][i] = n[1][i] * s;
        hits.Ng[2][i] = n[2][i] * s;
      }
      return;
    }
  }
  for (int i = 0; i < kLanes; ++i) {
    if (hits.instance[i] == kNoHit) continue;
    const Vec3 n = impl.worldNormal(hits.instance[i], Vec3(r.hit.Ng_x[i], r.hit.Ng_y[i], r.hit.Ng_z[i]));
    for (int c = 0; c < 3; ++c) hits.Ng[c][i] = n[c];
  }
}

}  // namespace

void Accel::intersect16(const RayPacket& rays, int count, HitPacket& hits, const BackFaces* passed) const {
  if (passed && !passed->any()) passed = nullptr;
  alignas(64) RTCRayHit16 r;
  alignas(64) int valid[kLanes];
  std::memcpy(r.ray.org_x, rays.origin[0], sizeof r.ray.org_x);
  std::memcpy(r.ray.org_y, rays.origin[1], sizeof r.ray.org_y);
  std::memcpy(r.ray.org_z, rays.origin[2], sizeof r.ray.org_z);
  std::memcpy(r.ray.dir_x, rays.direction[0], sizeof r.ray.dir_x);
  std::memcpy(r.ray.dir_y, rays.direction[1], sizeof r.ray.dir_y);
  std::memcpy(r.ray.dir_z, rays.direction[2], sizeof r.ray.dir_z);
  std::memcpy(r.ray.tnear, rays.tmin, sizeof r.ray.tnear);
  std::memcpy(r.ray.tfar, rays.tmax, sizeof r.ray.tfar);
  const unsigned id = passed ? BackFaces::kPasses : 0;
  for (int i = 0; i < kLanes; ++i) {
    valid[i] = i < count ? -1 : 0;
    r.ray.time[i] = 0;
    r.ray.mask[i] = ~0u;
    r.ray.flags[i] = 0;
    r.ray.id[i] = id;
    r.hit.geomID[i] = r.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
  }
  BackFaces::Context context;
  if (passed) passed->init(context);
  else embree::initContext(context.context);
  embree::intersect16(valid, impl_->scene, context.context, r, true, passed ? BackFaces::filter : nullptr);
  static_assert(kNoHit == RTC_INVALID_GEOMETRY_ID);
  for (int i = 0; i < kLanes; ++i) hits.instance[i] = r.hit.instID[0][i] == kNoHit ? r.hit.geomID[i] : r.hit.instID[0][i];
  std::memcpy(hits.primitive, r.hit.primID, sizeof hits.primitive);
  std::memcpy(hits.t, r.ray.tfar, sizeof hits.t);
  std::memcpy(hits.u, r.hit.u, sizeof hits.u);
  std::memcpy(hits.v, r.hit.v, sizeof hits.v);
  worldNormals(*impl_, r, hits);
}

}  // namespace trace
}  // namespace gobo
