// SPDX-License-Identifier: Apache-2.0
// The volumes that the lanes of a chunk are in, and the random walk through those that scatter. Touched only in scenes that
// have volumes.
//   absorption  Beer-Lambert over every segment, for shadow rays too (trace/straight.h)
//   scattering  analog distances of one channel, chosen by throughput; weights by the one-sample balance heuristic over the
//               channels (Wrenninge, Villemin & Hery 2017; Chiang, Kutz & Burley 2016), so that no channel's weight grows.
//   lights      of every kind are asked at every event where they can be seen: inside the volume, or through boundaries that bend
//               nothing (index 1). Those that a ray can hit are found by the walk too: the segment after an event has the phase
//               function's density, and both are weighted by the power heuristic (Veach 1997), whatever lets light straight on.
// A walk is no event of its own: with its reflections at the inside of its boundary it belongs to the event that entered.
// It is bounded by unbiased roulette: against the throughput it began with, and from kLongWalk steps on by 2 % a step.
#pragma once

#include "base/sobol.h"
#include "trace/interior.h"
#include "trace/lambert_lanes.h"
#include "trace/path_kernel.h"

namespace gobo {
inline namespace trace {

struct PathMedia {
  static constexpr int kLongWalk = 1024, kMostSteps = 1 << 16;  // 0.98^64512: the last is never reached
  MediumStack stack[kLanes];
  Vec3 chance[kLanes];         ///< of the channels, on the segment that a walking lane is on
  MediumStack shadow[kLanes];  ///< volumes at the start of the lane's shadow ray
  int8_t hero[kLanes];         ///< the only channel left after a dispersive event; -1: all
  uint32_t walking = 0;        ///< lanes whose segment is in a scattering interior
  uint32_t strayed = 0;        ///< lanes that came into it straight on, by no event: the first of their walk is one
  const std::vector<Interior>* interiors = nullptr;

  void start(const std::vector<Interior>& all, const MediumStack& around) {
    interiors = &all;
    walking = strayed = 0;
    for (int i = 0; i < kLanes; ++i) {
      stack[i] = around;
      hero[i] = -1;
    }
  }
  const Interior* around(int i) const {
    const int k = stack[i].top();
    return k < 0 ? nullptr : &(*interiors)[size_t(k)];
  }
  /// What is left of the throughput after way t of the present segment; over the chance of getting there for walking lanes.
  Vec3 through(int i, float t) const {
    const Interior* m = around(i);
    if (!m || !m->absorbs) return Vec3(1.0f);
    const Vec3 left = m->transmittance(t);
    if (!(walking >> i & 1u)) return left;
    const float got = glm::dot(chance[i], left);
    return got > 0.0f ? left / got : Vec3(0.0f);
  }
  float relativeIor(int i, int volume, float ior, bool entering) const { return stack[i].relativeIor(*interiors, volume, ior, entering); }
  bool passes(int i, int volume, bool entering) const { return stack[i].passes(volume, entering); }
  void cross(int i, int volume, bool entering) {
    if (entering) stack[i].enter(volume);
    else stack[i].leave(volume);
  }
  /// The volumes at the start of lane i's shadow ray, on the far side of a boundary that it meets or on the near one.
  void startShadow(int i) { shadow[i] = stack[i]; }
  void startShadowBehind(int i, int volume, bool entering) {
    shadow[i] = stack[i];
    if (entering) shadow[i].enter(volume);
    else shadow[i].leave(volume);
  }

  /// Carries lane i through the scattering interior that it is in: from the ray in `rh` with its hit to the last segment,
  /// whose end is the hit (or a miss). collect(origin, direction, t): lights along a segment. False: the path ended.
  /// scatter(point, direction of arrival, direction of departure, throughput, random bits): at every event.
  template <typename Collect, typename Scatter>
  bool walk(int i, RTCRayHit16& rh, RTCScene scene, Lane3& throughput, uint64_t key, uint64_t& rays, bool& scattered, Collect&& collect, Scatter&& scatter) {
    const Interior& m = *around(i);
    Vec3 o(rh.ray.org_x[i], rh.ray.org_y[i], rh.ray.org_z[i]), d(rh.ray.dir_x[i], rh.ray.dir_y[i], rh.ray.dir_z[i]);
    Vec3 beta = throughput.get(i);
    const float first = maxComponent(beta);
    scattered = false;
    RTCRayHit ray;
    for (int step = 0; step < kMostSteps; ++step) {
      const float sum = beta.x + beta.y + beta.z;
      if (!(sum > 0.0f) || !std::isfinite(sum)) return false;
      chance[i] = beta / sum;
      const uint64_t a = hash64(key, uint64_t(step) * 2), b = hash64(key, uint64_t(step) * 2 + 1);
      const float pick = toUnit(uint32_t(a)), free = toUnit(uint32_t(a >> 32));
      const int c = pick < chance[i].x ? 0 : pick < chance[i].x + chance[i].y ? 1 : chance[i].z > 0.0f ? 2 : chance[i].y > 0.0f ? 1 : 0;
      const float s = m.sigma[c] > 0.0f ? -std::log(1.0f - free) / m.sigma[c] : 3.0e38f;
      if (step > 0) {
        ray.ray = {o.x, o.y, o.z, 0.0f, d.x, d.y, d.z, 0.0f, s, ~0u, 0, 0};
        ray.hit.geomID = ray.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
        embree::Context context;
        embree::initContext(context);
        embree::intersect1(scene, context, ray, false);
        ++rays;
      }
      const float surface = step > 0 ? ray.hit.geomID == RTC_INVALID_GEOMETRY_ID ? 3.0e38f : ray.ray.tfar : rh.ray.tfar[i];
      throughput.set(i, beta);
      collect(o, d, std::fmin(s, surface));
      if (s >= surface || s >= 3.0e38f) {
        if (step > 0) put(rh, i, ray);
        return true;
      }
      const Vec3 left = m.transmittance(s);
      const float density = glm::dot(chance[i], m.sigma * left);
      if (!(density > 0.0f)) return false;
      beta *= m.albedo * m.sigma * left / density;
      scattered = true;
      float survive = std::fmin(1.0f, maxComponent(beta) / first);
      if (step >= kLongWalk) survive *= 0.98f;
      if (survive < 1.0f) {
        if (!(toUnit(uint32_t(hash64(a, 3))) < survive)) return false;
        beta /= survive;
      }
      o += d * s;
      const Vec3 next = sampleHenyeyGreenstein(d, m.g, Vec2(toUnit(uint32_t(b)), toUnit(uint32_t(b >> 32))));
      scatter(o, d, next, beta, hash64(b, 5));
      d = next;
    }
    return false;
  }

 private:
  static void put(RTCRayHit16& rh, int i, const RTCRayHit& r) {
    rh.ray.org_x[i] = r.ray.org_x;
    rh.ray.org_y[i] = r.ray.org_y;
    rh.ray.org_z[i] = r.ray.org_z;
    rh.ray.dir_x[i] = r.ray.dir_x;
    rh.ray.dir_y[i] = r.ray.dir_y;
    rh.ray.dir_z[i] = r.ray.dir_z;
    rh.ray.tfar[i] = r.hit.geomID == RTC_INVALID_GEOMETRY_ID ? 3.0e38f : r.ray.tfar;
    rh.hit.geomID[i] = r.hit.geomID;
    rh.hit.primID[i] = r.hit.primID;
    rh.hit.instID[0][i] = r.hit.instID[0];
    rh.hit.u[i] = r.hit.u;
    rh.hit.v[i] = r.hit.v;
    rh.hit.Ng_x[i] = r.hit.Ng_x;
    rh.hit.Ng_y[i] = r.hit.Ng_y;
    rh.hit.Ng_z[i] = r.hit.Ng_z;
  }
};

}  // namespace trace
}  // namespace gobo
