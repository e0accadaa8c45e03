// SPDX-License-Identifier: Apache-2.0
// The Lambert case of a scattering event for all lanes of a chunk, 8 at a time in AVX registers (GCC/Clang vector types).
// Arrays are indexed by lane; nothing here depends on which other lanes are active.
#pragma once

#include <immintrin.h>

#include "trace/plain_mesh_light.h"
#include "trace/sample_set.h"

namespace gobo {
inline namespace trace {

struct alignas(64) Lane3 {
  float x[kLanes], y[kLanes], z[kLanes];
  Vec3 get(int i) const { return Vec3(x[i], y[i], z[i]); }
  void set(int i, const Vec3& v) {
    x[i] = v.x;
    y[i] = v.y;
    z[i] = v.z;
  }
};

/// A vertex per lane, as Surface has it.
struct alignas(64) LaneSurface {
  Lane3 a, b, c;  // triangle in world space (plain lanes; n: what the vertices give smooth ones), then
  Lane3 p, reach, facing, n, albedo;
  Lane3 origin;  // p moved to the viewer's side
};

namespace lanes {

using F = __m256;
struct F3 {
  F x, y, z;
};
inline F load(const float* p) { return _mm256_load_ps(p); }
inline F3 load(const Lane3& v, int at) { return {load(v.x + at), load(v.y + at), load(v.z + at)}; }
inline void store(float* p, const F& v) { _mm256_store_ps(p, v); }
inline void store(Lane3& o, int at, const F3& v) {
  store(o.x + at, v.x);
  store(o.y + at, v.y);
  store(o.z + at, v.z);
}
inline F set(float v) { return _mm256_set1_ps(v); }
inline F select(const F& mask, const F& yes, const F& no) { return _mm256_blendv_ps(no, yes, mask); }
inline F dot(const F3& a, const F3& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline F3 operator+(const F3& a, const F3& b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline F3 operator-(const F3& a, const F3& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline F3 operator*(const F3& a, const F& b) { return {a.x * b, a.y * b, a.z * b}; }
inline F3 operator*(const F3& a, const F3& b) { return {a.x * b.x, a.y * b.y, a.z * b.z}; }
inline F abs(const F& v) { return _mm256_andnot_ps(set(-0.0f), v); }
inline F3 abs(const F3& v) { return {abs(v.x), abs(v.y), abs(v.z)}; }
inline F max3(const F3& v) { return _mm256_max_ps(v.x, _mm256_max_ps(v.y, v.z)); }
inline F less(const F& a, const F& b) { return _mm256_cmp_ps(a, b, _CMP_LT_OQ); }
inline F both(const F& a, const F& b) { return _mm256_and_ps(a, b); }
/// Mask register of 8 bits.
inline F maskOf(uint32_t bits) {
  const __m256i bit = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
  return _mm256_castsi256_ps(_mm256_cmpeq_epi32(_mm256_and_si256(_mm256_set1_epi32(int(bits)), bit), bit));
}
inline uint32_t bitsOf(const F& mask) { return uint32_t(_mm256_movemask_ps(mask)); }

/// Surface::origin for 8 lanes.
inline F3 leave(const F3& p, const F3& side, const F3& reach) {
  const F d = set(6e-7f) * dot(abs(side), reach) + set(3e-7f) * max3(reach);
  return p + side * d;
}

/// SurfaceTable::usable for 8 lanes: the vertices' normal, made unit and turned to the side of `facing`; `facing` where it is unusable or turns away
/// from the viewer, and in lanes that are not in `smooth`.
inline F3 shadingNormal(const F3& vertex, const F3& facing, const F3& d, uint32_t smooth) {
  const F l2 = dot(vertex, vertex), scale = set(1.0f) / _mm256_sqrt_ps(l2);
  const F3 unit = vertex * scale;
  const F turn = both(less(dot(unit, facing), set(0.0f)), set(-0.0f));  // signs of zeros too: they choose the side of a Frame
  const F3 m = {_mm256_xor_ps(unit.x, turn), _mm256_xor_ps(unit.y, turn), _mm256_xor_ps(unit.z, turn)};
  const F good = both(both(both(less(set(1e-24f), l2), less(l2, set(1e24f))), less(dot(m, d), set(-1e-4f))), maskOf(smooth));
  return {select(good, m.x, facing.x), select(good, m.y, facing.y), select(good, m.z, facing.z)};
}

/// Positions, bounds, facing and shading normals of plain lanes from triangles, barycentrics and Embree's normals; those in `smooth` have a vertex
/// normal of any length in n. Returns the lanes whose normal has an ordinary length; the others are left to scalar code.
inline uint32_t plainSurface(LaneSurface& s, int at, uint32_t bits, uint32_t smooth, const float* u, const float* v, const float* ngx, const float* ngy,
                             const float* ngz, const float* dx, const float* dy, const float* dz) {
  const F lu = _mm256_loadu_ps(u + at), lv = _mm256_loadu_ps(v + at), w = set(1.0f) - lu - lv;
  const F3 pa = load(s.a, at) * w, pb = load(s.b, at) * lu, pc = load(s.c, at) * lv;
  const F3 ng = {_mm256_loadu_ps(ngx + at), _mm256_loadu_ps(ngy + at), _mm256_loadu_ps(ngz + at)};
  const F3 d = {_mm256_loadu_ps(dx + at), _mm256_loadu_ps(dy + at), _mm256_loadu_ps(dz + at)};
  const F l2 = dot(ng, ng);
  const F good = both(both(less(set(1e-30f), l2), less(l2, set(1e30f))), maskOf(bits));
  const F scale = set(1.0f) / _mm256_sqrt_ps(l2);
  const F turned = select(less(dot(ng, d), set(0.0f)), scale, set(0.0f) - scale);
  const F3 n = ng * turned;
  store(s.p, at, pa + pb + pc);
  store(s.reach, at, abs(pa) + abs(pb) + abs(pc));
  store(s.facing, at, n);
  store(s.n, at, smooth ? shadingNormal(load(s.n, at), n, d, smooth) : n);
  return bitsOf(good);
}

inline void moveOrigins(LaneSurface& s, int at) { store(s.origin, at, leave(load(s.p, at), load(s.facing, at), load(s.reach, at))); }

struct LightLanes {
  Lane3 p, e1, e2, n;
  float area[kLanes];
};  // the triangle that each lane picked, and the area that it picked from

/// Next-event estimation towards a plain mesh light: shadow rays from s.origin, values to add where they are free. Returns
/// the lanes that have one.
inline uint32_t sampleLight(const LaneSurface& s, const Lane3& throughput, const LightLanes& light, bool doubleSided, const Vec3& nominal, int at,
                            uint32_t bits, const float* ux, const float* uy, float* dirX, float* dirY, float* dirZ, float* tfar, Lane3& value) {
  // Square to triangle (Heitz 2019), as MeshLight does.
  const F x = load(ux + at), y = load(uy + at), half = set(0.5f);
  const F upper = less(x, y);
  const F bx = select(upper, x * half, x - y * half), by = select(upper, y - x * half, y * half);
  const F3 p = load(s.p, at), n = load(s.n, at), facing = load(s.facing, at);
  const F3 d = (load(light.p, at) - p) + load(light.e1, at) * bx + load(light.e2, at) * by;
  const F d2 = dot(d, d), distance = _mm256_sqrt_ps(d2), inverse = set(1.0f) / distance;
  const F3 w = d * inverse;
  F cosLight = set(0.0f) - dot(w, load(light.n, at));
  if (doubleSided) cosLight = abs(cosLight);
  const F cosine = dot(w, n), side = dot(w, facing), zero = set(0.0f);
  const F ok = both(both(both(less(zero, cosine), less(zero, side)), both(less(set(1e-9f), cosLight), less(set(1e-30f), d2))), maskOf(bits));
  // weight / pdf of the light with the power heuristic against cosine / pi: l = d^2 / (cosLight area), b = cosine / pi.
  const F inverseL = cosLight * load(light.area + at) / d2, f = cosine * set(kInvPi), ratio = f * inverseL;
  const F scale = inverseL * f / (set(1.0f) + ratio * ratio);
  const F3 c = load(throughput, at) * load(s.albedo, at) * scale;
  const F3 v = {c.x * set(nominal.x), c.y * set(nominal.y), c.z * set(nominal.z)};
  store(value, at, v);
  const F3 aim = (p - load(s.origin, at)) + d;
  _mm256_storeu_ps(dirX + at, aim.x);
  _mm256_storeu_ps(dirY + at, aim.y);
  _mm256_storeu_ps(dirZ + at, aim.z);
  const F slack = set(3e-6f) * max3(abs(p)) * inverse;
  _mm256_storeu_ps(tfar + at, _mm256_max_ps(zero, set(1.0f - 2e-5f) - slack));
  return bitsOf(both(ok, _mm256_cmp_ps(max3(v), zero, _CMP_NLE_UQ)));  // NaN goes on, to be found and counted
}

/// Next directions (cosine-distributed, local in vx, vy, vz), throughput, roulette. Returns the lanes that go on; their rays
/// start at s.origin.
inline uint32_t bounce(const LaneSurface& s, int at, uint32_t bits, const float* vx, const float* vy, const float* vz, const float* roulette, Lane3& throughput,
                       float* dirX, float* dirY, float* dirZ, float* pdf) {
  const F3 n = load(s.n, at), local = {load(vx + at), load(vy + at), load(vz + at)};
  const F one = set(1.0f), zero = set(0.0f);
  // Frame of Duff et al. 2017, as in base/vec.h.
  const F sign = _mm256_or_ps(_mm256_and_ps(n.z, set(-0.0f)), one);
  const F a = set(-1.0f) / (sign + n.z), b = n.x * n.y * a;
  const F3 fx = {one + sign * n.x * n.x * a, sign * b, zero - sign * n.x}, fy = {b, sign + n.y * n.y * a, zero - n.y};
  const F3 w = fx * local.x + fy * local.y + n * local.z;
  F ok = both(both(less(zero, local.z), less(zero, dot(w, load(s.facing, at)))), maskOf(bits));
  F3 t = load(throughput, at) * load(s.albedo, at);
  const F most = max3(t);
  ok = both(ok, less(zero, most));
  if (roulette) {
    const F survive = _mm256_min_ps(set(0.95f), _mm256_sqrt_ps(most));  // see path_tracer.h
    ok = both(ok, less(load(roulette + at), survive));
    t = t * (one / survive);
  }
  const F mask = maskOf(bits);
  store(throughput, at, {select(mask, t.x, load(throughput.x + at)), select(mask, t.y, load(throughput.y + at)), select(mask, t.z, load(throughput.z + at))});
  const auto put = [&](float* o, const F& v) { _mm256_storeu_ps(o + at, select(mask, v, _mm256_loadu_ps(o + at))); };
  put(dirX, w.x);
  put(dirY, w.y);
  put(dirZ, w.z);
  put(pdf, local.z * set(kInvPi));
  return bitsOf(ok);
}

}  // namespace lanes
}  // namespace trace
}  // namespace gobo
