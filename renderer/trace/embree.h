// SPDX-License-Identifier: Apache-2.0
// The one place that knows which Embree is installed. Embree 4 renamed the context and put the ray query flags and filters
// into an arguments structure; the wrappers below are all that the tracer uses of either. `filter`: called for every hit of this call
// after the geometry's own filter; scenes have kSceneFlagCallFilter for it.
// Embree's traversal is not defined for rays with a NaN or an Inf in origin or direction, or with a NaN for an end (its assertions end the
// process). Coordinates of scenes are bounded (scene/coordinates.h); whatever gets so far all the same meets nothing where it looks for a
// hit, and something where it asks for a light.
// Occlusion is never asked for as coherent: built by GCC for AVX-512, Embree's way of doing so (3.13.5 of Debian 12 and others until the end of 2025,
// RenderKit/embree#574) writes the 16 bits of a mask and reads 64, so that what lay on the stack decides whether it ever ends. The bits are the same without,
// and so is the time (0.95 to 1.11 of it by two or three runs each: atrium, sponza, trees, lights8, with AVX-512 and with AVX2).
#pragma once

#include <limits>

#if __has_include(<embree4/rtcore.h>)
#include <embree4/rtcore.h>
#define GOBO_EMBREE 4
#else
#include <embree3/rtcore.h>
#define GOBO_EMBREE 3
#endif

namespace gobo::embree {

#if GOBO_EMBREE == 4
using Context = RTCRayQueryContext;
inline void initContext(Context& c) { rtcInitRayQueryContext(&c); }
inline constexpr RTCSceneFlags kSceneFlagCallFilter = RTC_SCENE_FLAG_FILTER_FUNCTION_IN_ARGUMENTS;
inline void setCall(RTCIntersectArguments& a, Context& c, bool coherent, RTCFilterFunctionN filter) {
  rtcInitIntersectArguments(&a);
  a.context = &c;
  a.filter = filter;
  a.flags = RTCRayQueryFlags((coherent ? RTC_RAY_QUERY_FLAG_COHERENT : RTC_RAY_QUERY_FLAG_INCOHERENT) |
                             (filter ? RTC_RAY_QUERY_FLAG_INVOKE_ARGUMENT_FILTER : RTC_RAY_QUERY_FLAG_NONE));
}
inline void intersect1Unchecked(RTCScene s, Context& c, RTCRayHit& r, bool coherent, RTCFilterFunctionN filter = nullptr) {
  RTCIntersectArguments a;
  setCall(a, c, coherent, filter);
  rtcIntersect1(s, &r, &a);
}
inline void occluded1Unchecked(RTCScene s, Context& c, RTCRay& r) {
  RTCOccludedArguments a;
  rtcInitOccludedArguments(&a);
  a.context = &c;
  rtcOccluded1(s, &r, &a);
}
inline void intersect16Unchecked(const int* valid, RTCScene s, Context& c, RTCRayHit16& r, bool coherent, RTCFilterFunctionN filter = nullptr) {
  RTCIntersectArguments a;
  setCall(a, c, coherent, filter);
  rtcIntersect16(valid, s, &r, &a);
}
inline void occluded16Unchecked(const int* valid, RTCScene s, Context& c, RTCRay16& r) {
  RTCOccludedArguments a;
  rtcInitOccludedArguments(&a);
  a.context = &c;
  a.flags = RTC_RAY_QUERY_FLAG_INCOHERENT;
  rtcOccluded16(valid, s, &r, &a);
}
#else
using Context = RTCIntersectContext;
inline void initContext(Context& c) { rtcInitIntersectContext(&c); }
inline void setCoherent(Context& c, bool coherent) { c.flags = coherent ? RTC_INTERSECT_CONTEXT_FLAG_COHERENT : RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT; }
inline constexpr RTCSceneFlags kSceneFlagCallFilter = RTC_SCENE_FLAG_CONTEXT_FILTER_FUNCTION;
inline void intersect1Unchecked(RTCScene s, Context& c, RTCRayHit& r, bool coherent, RTCFilterFunctionN filter = nullptr) {
  setCoherent(c, coherent);
  c.filter = filter;
  rtcIntersect1(s, &c, &r);
}
inline void occluded1Unchecked(RTCScene s, Context& c, RTCRay& r) {
  setCoherent(c, false);
  c.filter = nullptr;
  rtcOccluded1(s, &c, &r);
}
inline void intersect16Unchecked(const int* valid, RTCScene s, Context& c, RTCRayHit16& r, bool coherent, RTCFilterFunctionN filter = nullptr) {
  setCoherent(c, coherent);
  c.filter = filter;
  rtcIntersect16(valid, s, &c, &r);
}
inline void occluded16Unchecked(const int* valid, RTCScene s, Context& c, RTCRay16& r) {
  setCoherent(c, false);
  c.filter = nullptr;
  rtcOccluded16(valid, s, &c, &r);
}
#endif

/// 0 times each number is 0 unless it is NaN or Inf; compares are false for NaN.
inline bool isTraceable(float ox, float oy, float oz, float dx, float dy, float dz, float tnear, float tfar) {
  return 0.0f * ox + 0.0f * oy + 0.0f * oz + 0.0f * dx + 0.0f * dy + 0.0f * dz == 0.0f && tnear == tnear && tfar == tfar;
}
inline bool isTraceable(const RTCRay& r) { return isTraceable(r.org_x, r.org_y, r.org_z, r.dir_x, r.dir_y, r.dir_z, r.tnear, r.tfar); }
/// The lanes of `valid` that can be traced, and the others out of the way while Embree looks: where the processor has no vectors for 16 lanes (no AVX-512)
/// Embree 3 does not read the mask, but passes rays whose interval is empty.
class TracedLanes {
 public:
  TracedLanes(const int* valid, RTCRay16& ray) : ray_(ray) {
    for (int i = 0; i < 16; ++i) {
      near_[i] = ray.tnear[i];
      far_[i] = ray.tfar[i];
      lanes_[i] = isTraceable(ray.org_x[i], ray.org_y[i], ray.org_z[i], ray.dir_x[i], ray.dir_y[i], ray.dir_z[i], near_[i], far_[i]) ? valid[i] : 0;
      ray.tnear[i] = lanes_[i] ? near_[i] : kInf;
      ray.tfar[i] = lanes_[i] ? far_[i] : -kInf;
    }
  }
  ~TracedLanes() {
    for (int i = 0; i < 16; ++i) {
      ray_.tnear[i] = near_[i];
      ray_.tfar[i] = lanes_[i] ? ray_.tfar[i] : far_[i];
    }
  }
  TracedLanes(const TracedLanes&) = delete;
  TracedLanes& operator=(const TracedLanes&) = delete;
  const int* lanes() const { return lanes_; }

 private:
  static constexpr float kInf = std::numeric_limits<float>::infinity();
  RTCRay16& ray_;
  alignas(64) int lanes_[16];
  alignas(64) float near_[16], far_[16];
};

inline void intersect1(RTCScene s, Context& c, RTCRayHit& r, bool coherent, RTCFilterFunctionN filter = nullptr) {
  if (isTraceable(r.ray)) intersect1Unchecked(s, c, r, coherent, filter);
}
inline void occluded1(RTCScene s, Context& c, RTCRay& r) {
  if (isTraceable(r)) occluded1Unchecked(s, c, r);
  else r.tfar = -1.0f;
}
/// Lanes that are not valid are left as they are.
inline void intersect16(const int* valid, RTCScene s, Context& c, RTCRayHit16& r, bool coherent, RTCFilterFunctionN filter = nullptr) {
  const TracedLanes traced(valid, r.ray);
  intersect16Unchecked(traced.lanes(), s, c, r, coherent, filter);
}
inline void occluded16(const int* valid, RTCScene s, Context& c, RTCRay16& r) {
  alignas(64) int lost[16];
  {
    const TracedLanes traced(valid, r);
    for (int i = 0; i < 16; ++i) lost[i] = valid[i] & ~traced.lanes()[i];
    occluded16Unchecked(traced.lanes(), s, c, r);
  }
  for (int i = 0; i < 16; ++i) r.tfar[i] = lost[i] ? -1.0f : r.tfar[i];
}

}  // namespace gobo::embree
