// SPDX-License-Identifier: Apache-2.0
// The one place that knows which Embree is installed. Embree 4 renamed the context and put the ray query flags and filters
// into an arguments structure; the wrappers below are all that the tracer uses of either. `filter`: called for every hit of this call
// after the geometry's own filter; scenes have kSceneFlagCallFilter for it.
// Embree's traversal is not defined for rays with a NaN or an Inf in origin or direction, or with a NaN for an end (its assertions end the
// process). Coordinates of scenes are bounded (scene/coordinates.h); whatever gets so far all the same meets nothing where it looks for a
// hit, and something where it asks for a light.
#pragma once

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
inline void occluded16Unchecked(const int* valid, RTCScene s, Context& c, RTCRay16& r, bool coherent) {
  RTCOccludedArguments a;
  rtcInitOccludedArguments(&a);
  a.context = &c;
  a.flags = coherent ? RTC_RAY_QUERY_FLAG_COHERENT : RTC_RAY_QUERY_FLAG_INCOHERENT;
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
inline void occluded16Unchecked(const int* valid, RTCScene s, Context& c, RTCRay16& r, bool coherent) {
  setCoherent(c, coherent);
  c.filter = nullptr;
  rtcOccluded16(valid, s, &c, &r);
}
#endif

/// 0 times each number is 0 unless it is NaN or Inf; compares are false for NaN.
inline bool isTraceable(float ox, float oy, float oz, float dx, float dy, float dz, float tnear, float tfar) {
  return 0.0f * ox + 0.0f * oy + 0.0f * oz + 0.0f * dx + 0.0f * dy + 0.0f * dz == 0.0f && tnear == tnear && tfar == tfar;
}
inline bool isTraceable(const RTCRay& r) { return isTraceable(r.org_x, r.org_y, r.org_z, r.dir_x, r.dir_y, r.dir_z, r.tnear, r.tfar); }
/// `valid` without the lanes that cannot be traced.
inline void traceableLanes(const int* valid, const RTCRay16& r, int* lanes) {
  for (int i = 0; i < 16; ++i)
    lanes[i] = isTraceable(r.org_x[i], r.org_y[i], r.org_z[i], r.dir_x[i], r.dir_y[i], r.dir_z[i], r.tnear[i], r.tfar[i]) ? valid[i] : 0;
}

inline void intersect1(RTCScene s, Context& c, RTCRayHit& r, bool coherent, RTCFilterFunctionN filter = nullptr) {
  if (isTraceable(r.ray)) intersect1Unchecked(s, c, r, coherent, filter);
}
inline void occluded1(RTCScene s, Context& c, RTCRay& r) {
  if (isTraceable(r)) occluded1Unchecked(s, c, r);
  else r.tfar = -1.0f;
}
inline void intersect16(const int* valid, RTCScene s, Context& c, RTCRayHit16& r, bool coherent, RTCFilterFunctionN filter = nullptr) {
  alignas(64) int lanes[16];
  traceableLanes(valid, r.ray, lanes);
  intersect16Unchecked(lanes, s, c, r, coherent, filter);
}
inline void occluded16(const int* valid, RTCScene s, Context& c, RTCRay16& r, bool coherent) {
  alignas(64) int lanes[16];
  traceableLanes(valid, r, lanes);
  occluded16Unchecked(lanes, s, c, r, coherent);
  for (int i = 0; i < 16; ++i) r.tfar[i] = lanes[i] == valid[i] ? r.tfar[i] : -1.0f;
}

}  // namespace gobo::embree
