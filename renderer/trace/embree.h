// SPDX-License-Identifier: Apache-2.0
// The one place that knows which Embree is installed. Embree 4 renamed the context and put the ray query flags and filters
// into an arguments structure; the wrappers below are all that the tracer uses of either. `filter`: called for every hit of this call
// after the geometry's own filter; scenes have kSceneFlagCallFilter for it.
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
inline void intersect1(RTCScene s, Context& c, RTCRayHit& r, bool coherent, RTCFilterFunctionN filter = nullptr) {
  RTCIntersectArguments a;
  setCall(a, c, coherent, filter);
  rtcIntersect1(s, &r, &a);
}
inline void occluded1(RTCScene s, Context& c, RTCRay& r) {
  RTCOccludedArguments a; rtcInitOccludedArguments(&a);
  a.context = &c; rtcOccluded1(s, &r, &a);
}
inline void intersect16(const int* valid, RTCScene s, Context& c, RTCRayHit16& r, bool coherent, RTCFilterFunctionN filter = nullptr) {
  RTCIntersectArguments a;
  setCall(a, c, coherent, filter);
  rtcIntersect16(valid, s, &r, &a);
}
inline void occluded16(const int* valid, RTCScene s, Context& c, RTCRay16& r, bool coherent) {
  RTCOccludedArguments a; rtcInitOccludedArguments(&a);
  a.context = &c; a.flags = coherent ? RTC_RAY_QUERY_FLAG_COHERENT : RTC_RAY_QUERY_FLAG_INCOHERENT;
  rtcOccluded16(valid, s, &r, &a);
}
#else
using Context = RTCIntersectContext;
inline void initContext(Context& c) { rtcInitIntersectContext(&c); }
inline void setCoherent(Context& c, bool coherent) {
  c.flags = coherent ? RTC_INTERSECT_CONTEXT_FLAG_COHERENT : RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
}
inline constexpr RTCSceneFlags kSceneFlagCallFilter = RTC_SCENE_FLAG_CONTEXT_FILTER_FUNCTION;
inline void intersect1(RTCScene s, Context& c, RTCRayHit& r, bool coherent, RTCFilterFunctionN filter = nullptr) {
  setCoherent(c, coherent); c.filter = filter; rtcIntersect1(s, &c, &r);
}
inline void occluded1(RTCScene s, Context& c, RTCRay& r) { setCoherent(c, false); c.filter = nullptr; rtcOccluded1(s, &c, &r); }
inline void intersect16(const int* valid, RTCScene s, Context& c, RTCRayHit16& r, bool coherent, RTCFilterFunctionN filter = nullptr) {
  setCoherent(c, coherent); c.filter = filter; rtcIntersect16(valid, s, &c, &r);
}
inline void occluded16(const int* valid, RTCScene s, Context& c, RTCRay16& r, bool coherent) {
  setCoherent(c, coherent); c.filter = nullptr; rtcOccluded16(valid, s, &c, &r);
}
#endif

}  // namespace gobo::embree
