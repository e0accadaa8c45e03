// SPDX-License-Identifier: Apache-2.0
#include "trace/alpha_filter.h"

#include <bit>

#include "base/sobol.h"
#include "trace/accel_impl.h"
#include "trace/texture_lookup.h"

namespace gobo {
inline namespace trace {

float AlphaGeometry::alpha(uint32_t primitive, float u, float v) const {
  const uint32_t* tri = indices + 3 * size_t(primitive);
  const float w = 1.0f - u - v;
  float a = factor;
  if (!colours->empty()) a *= w * (*colours)[tri[0]].w + u * (*colours)[tri[1]].w + v * (*colours)[tri[2]].w;
  if (texture) {
    Vec2 at(0.0f);
    if (!uv->empty()) at = w * (*uv)[tri[0]] + u * (*uv)[tri[1]] + v * (*uv)[tri[2]];
    a *= texture->sample(transformUv(ref, at)).w;
  }
  return a;
}

namespace {
// One answer per (ray line, surface): hashes the ray's bits, so shadow and closest-hit queries of the same ray agree.
float blendThreshold(const RTCFilterFunctionNArguments* args, unsigned lane, unsigned primitive, unsigned geometry, unsigned instance) {
  const unsigned N = args->N;
  const auto bits = [](float f) { return uint64_t(std::bit_cast<uint32_t>(f)); };
  uint64_t h = hash64(bits(RTCRayN_org_x(args->ray, N, lane)) << 32 | bits(RTCRayN_org_y(args->ray, N, lane)),
                      bits(RTCRayN_org_z(args->ray, N, lane)) << 32 | bits(RTCRayN_dir_x(args->ray, N, lane)));
  h = hash64(h, bits(RTCRayN_dir_y(args->ray, N, lane)) << 32 | bits(RTCRayN_dir_z(args->ray, N, lane)));
  h = hash64(h, uint64_t(primitive) << 32 | (instance == RTC_INVALID_GEOMETRY_ID ? geometry : instance));
  return toUnit(uint32_t(h >> 32));
}
}  // namespace

void alphaFilter(const RTCFilterFunctionNArguments* args) {
  const auto& g = *static_cast<const AlphaGeometry*>(args->geometryUserPtr);
  const unsigned N = args->N;
  for (unsigned i = 0; i < N; ++i) {
    if (args->valid[i] == 0) continue;
    const unsigned primitive = RTCHitN_primID(args->hit, N, i);
    const float a = g.alpha(primitive, RTCHitN_u(args->hit, N, i), RTCHitN_v(args->hit, N, i));
    const float threshold =
        g.mode == AlphaMode::Mask ? g.cutoff : blendThreshold(args, i, primitive, RTCHitN_geomID(args->hit, N, i), RTCHitN_instID(args->hit, N, i, 0));
    // Mask keeps alpha >= cutoff (glTF); Blend keeps with probability alpha (threshold < alpha, so alpha 0 never).
    const bool keep = g.mode == AlphaMode::Mask ? a >= threshold : threshold < a;
    if (!keep) args->valid[i] = 0;
  }
}

}  // namespace trace
}  // namespace gobo
