// SPDX-License-Identifier: Apache-2.0
// What the path kernel carries by lane from event to event, and rays in and out of Embree's packets.
#pragma once

#include "trace/embree.h"
#include "trace/lambert_lanes.h"
#include "trace/path_kernel.h"

namespace gobo {
inline namespace trace {

// Lanes never move: Embree masks the dead ones, and vector code computes them along.
struct PathLanes {
  Lane3 throughput;
  Lane3 specularPart;             // share of the first event's specular lobe in the throughput
  Lane3 from, fromNormal;         // the last vertex, as the light selector saw it
  alignas(64) float pdf[kLanes];  // density of the ray's direction; 0 after the camera or a delta event: nothing else finds its light
  float passed[kLanes] = {};      // way from the last vertex to the ray's origin: surfaces passed straight on are no vertices
  float reach[kLanes] = {};       // while it is the camera's: how far from the ray's origin it sees
  int free[kLanes] = {};          // passes of the loop that were no scattering event of their own (path_media.h, straight.h)
  // Bit per lane. firstDelta: reaches light by an indirect path, whatever the number of events. specularOnly: delta events, if any.
  // fromCamera: the camera still looks straight on, so that lights hidden from it (trace/reach.h) and back faces that it culls are passed;
  // no question of the density.
  uint32_t fromHasNormal = 0, firstDelta = 0, specularOnly = ~0u, fromCamera = ~0u;
};

inline Vec3 rayDirection(const RTCRay16& r, int i) { return Vec3(r.dir_x[i], r.dir_y[i], r.dir_z[i]); }
inline Vec3 rayOrigin(const RTCRay16& r, int i) { return Vec3(r.org_x[i], r.org_y[i], r.org_z[i]); }
inline void setRayOrigin(RTCRay16& r, int i, const Vec3& o) {
  r.org_x[i] = o.x;
  r.org_y[i] = o.y;
  r.org_z[i] = o.z;
}
inline void setRayDirection(RTCRay16& r, int i, const Vec3& d) {
  r.dir_x[i] = d.x;
  r.dir_y[i] = d.y;
  r.dir_z[i] = d.z;
}
inline uint32_t hitInstance(const RTCHit16& h, int i) { return h.instID[0][i] == RTC_INVALID_GEOMETRY_ID ? h.geomID[i] : h.instID[0][i]; }

inline void putShadowRay(RTCRay16& r, int i, const Vec3& origin, const Vec3& aim, float reach) {
  setRayOrigin(r, i, origin);
  setRayDirection(r, i, aim);
  r.tfar[i] = reach;
}
// From the moved origin to the same point of the light; t counts in units of that way. It ends short of the light by what
// rounding may have put between the sampled point and the light's own surface.
inline void aimShadowRay(RTCRay16& r, int i, const Vec3& p, const Vec3& origin, const LightSample& light) {
  if (light.distance >= 3.0e38f) {
    putShadowRay(r, i, origin, light.direction, 3.0e38f);
    return;
  }
  const float slack = 3e-6f * std::max(std::fabs(p.x), std::max(std::fabs(p.y), std::fabs(p.z)));
  putShadowRay(r, i, origin, (p - origin) + light.direction * light.distance, std::max(0.0f, 1.0f - 2e-5f - slack / light.distance));
}

inline void recordRays(uint32_t lanes, const RTCRay16& r, std::vector<Ray>& to) {
  for (; lanes; lanes &= lanes - 1) {
    const int i = __builtin_ctz(lanes);
    to.push_back({rayOrigin(r, i), rayDirection(r, i), r.tnear[i], r.tfar[i]});
  }
}

}  // namespace trace
}  // namespace gobo
