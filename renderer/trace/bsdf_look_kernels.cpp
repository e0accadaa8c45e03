// SPDX-License-Identifier: Apache-2.0
#include "trace/bsdf_look.h"

#include <immintrin.h>

#include "trace/bsdf_base_impl.h"

namespace gobo {
inline namespace trace {

namespace {

using F = __m256;

inline F all(float v) { return _mm256_set1_ps(v); }
inline F less(const F& a, const F& b) { return _mm256_cmp_ps(a, b, _CMP_LT_OQ); }
inline F within01(const F& v) { return _mm256_min_ps(_mm256_max_ps(v, all(0.0f)), all(1.0f)); }
inline F fifth(const F& w) {
  const F w2 = w * w;
  return w2 * w2 * w;
}

/// The covered specular lobes at 8 directions above the surface.
struct Gloss {
  F facets, grazing, sharpness;
};
inline Gloss gloss(const F& x, const F& y, const F& z, const Vec3& o, float alpha2, float root, float scale) {
  const F mx = x + all(o.x), my = y + all(o.y), mz = z + all(o.z), a2 = all(alpha2), tiny = all(1e-30f);
  const F len2 = _mm256_max_ps(mx * mx + my * my + mz * mz, tiny), inverse = all(1.0f) / len2;
  const F s2 = (mx * mx + my * my) * inverse + a2 * (mz * mz * inverse);
  const F c = _mm256_min_ps(all(0.5f) * _mm256_sqrt_ps(len2), all(1.0f)), si = _mm256_sqrt_ps(z * z + a2 * (x * x + y * y));
  Gloss out;
  out.facets = all(scale) * z / _mm256_max_ps(s2 * s2 * (all(o.z) * si + all(root) * z), tiny);
  out.grazing = out.facets * fifth(all(1.0f) - c);
  out.sharpness = all(1.0f) / _mm256_max_ps(c * c * s2, tiny);
  return out;
}

inline Vec3 mixed(float a, const Vec3& x, float b, const Vec3& y) { return a * x + b * y; }

}  // namespace

bool BsdfLook::covers(const BsdfParams& p) {
  if (p.transmission > 0.0f || p.diffuseTransmission > 0.0f || p.iridescence > 0.0f || p.anisotropy > 0.0f || p.clearcoat > 0.0f || p.sheenColor != Vec3(0.0f))
    return false;
  if (!(p.metallic > 0.0f) && !(p.specular > 0.0f)) return true;
  const float roughness = clamp01(p.roughness);
  return roughness * roughness >= kDeltaAlpha;
}

BsdfLook::BsdfLook(const BsdfParams& p, const Vec3& wo)
    : wo_(wo), facing_(p.facing), lambert_(!(p.metallic > 0.0f) && !(p.specular > 0.0f)), tilted_(p.facing != Vec3(0, 0, 1)) {
  albedo = clamped(p.albedo);
  dark_ = !(wo.z > 0.0f);
  if (lambert_ || dark_) {
    tilted_ = tilted_ && !lambert_;  // Lambert alone is not cut at the plane: what is behind it does not arrive
    diffuseScale_ = kInvPi;
    return;
  }
  BaseLobes base(p);
  base.view(wo);
  alpha2_ = base.g.x * base.g.y;
  oz_ = wo.z;
  root_ = base.g.root(wo);
  stretch_ = 2.0f * base.g.x;
  if (base.hasDielectric()) {
    interface_[0] = base.f0Bound;
    interface_[1] = base.f90Bound - base.f0Bound;
    interface_[2] = base.msBound;
  }
  if (base.upP > 0.0f) diffuseScale_ = kInvPi * base.opaque * base.diffuseO * (base.hasDielectric() ? base.diffuseNorm : 1.0f);
  if (base.interfaceP > 0.0f) facetScale_ = 0.5f * alpha2_ * kInvPi;
  if (base.bounceUpP > 0.0f) bounceScale_ = base.kernel * base.ao.deficit;
  facets = mixed(base.metal, base.albedo, base.opaque, base.f0);
  grazing = mixed(base.metal, Vec3(1.0f) - base.albedo, base.opaque, Vec3(base.f90) - base.f0);
  bounced = base.msUp;
  base.table.nodes(deficit_, extra_);
}

void BsdfLook::at(const Directions& in, size_t count, Lobes& out) const {
  const F zero = all(0.0f), one = all(1.0f);
  for (size_t k = 0; k < count; k += 8) {
    const F x = _mm256_load_ps(in.x + k), y = _mm256_load_ps(in.y + k), z = _mm256_load_ps(in.z + k);
    F up = dark_ ? zero : less(zero, z);
    if (lambert_) {
      _mm256_store_ps(out.diffuse + k, _mm256_and_ps(up, z * all(diffuseScale_)));
      continue;
    }
    const F side = x * all(facing_.x) + y * all(facing_.y) + z * all(facing_.z);
    if (tilted_) up = _mm256_and_ps(up, less(zero, side));
    // The albedos' cell, as ReflectionAlbedo::at has it.
    F deficit, schlick;
    const auto lookUp = [&](const F& cosine) {
      const F mu = within01(cosine), s = all(stretch_);
      const F position = within01(_mm256_sqrt_ps(mu * (one + s) / (mu + s))) * all(float(kNodes - 1));
      const __m256i cell = _mm256_min_epi32(_mm256_cvttps_epi32(position), _mm256_set1_epi32(kNodes - 2));
      const F f = position - _mm256_cvtepi32_ps(cell);
      const F d0 = _mm256_i32gather_ps(deficit_, cell, 4), d1 = _mm256_i32gather_ps(deficit_ + 1, cell, 4);
      const F e0 = _mm256_i32gather_ps(extra_, cell, 4), e1 = _mm256_i32gather_ps(extra_ + 1, cell, 4);
      deficit = d0 + (d1 - d0) * f;
      schlick = within01(e0 + (e1 - e0) * f + fifth(one - mu) * (one - deficit));
    };
    lookUp(z);
    const F reflected = all(interface_[0]) * (one - deficit) + all(interface_[1]) * schlick + all(interface_[2]) * deficit;
    const F diffuse = z * all(diffuseScale_) * _mm256_max_ps(one - reflected, zero);
    _mm256_store_ps(out.diffuse + k, _mm256_and_ps(up, diffuse));
    F bounce = _mm256_and_ps(up, all(bounceScale_) * deficit * z);
    Gloss g = gloss(x, y, z, wo_, alpha2_, root_, facetScale_);
    g.facets = _mm256_and_ps(up, g.facets);
    g.grazing = _mm256_and_ps(up, g.grazing);
    if (tilted_) {
      const F twice = all(2.0f) * side, u = x - twice * all(facing_.x), v = y - twice * all(facing_.y), w = z - twice * all(facing_.z);
      const F folds = _mm256_and_ps(up, less(zero, w));
      g.sharpness = g.sharpness + one / _mm256_max_ps(w * w, all(1e-30f));  // a bend where light begins to fold
      if (_mm256_movemask_ps(folds)) {
        lookUp(w);
        const Gloss m = gloss(u, v, w, wo_, alpha2_, root_, facetScale_);
        g.facets = g.facets + _mm256_and_ps(folds, m.facets);
        g.grazing = g.grazing + _mm256_and_ps(folds, m.grazing);
        g.sharpness = g.sharpness + _mm256_and_ps(folds, m.sharpness);
        bounce = bounce + _mm256_and_ps(folds, all(bounceScale_) * deficit * w);
      }
    }
    _mm256_store_ps(out.facets + k, g.facets);
    _mm256_store_ps(out.grazing + k, g.grazing);
    _mm256_store_ps(out.bounced + k, bounce);
    _mm256_store_ps(out.sharpness + k, facetScale_ > 0.0f ? g.sharpness : zero);
  }
}

}  // namespace trace
}  // namespace gobo
