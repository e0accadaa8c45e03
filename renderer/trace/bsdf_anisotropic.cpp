// SPDX-License-Identifier: Apache-2.0
#include "trace/bsdf_anisotropic.h"

#include "trace/bsdf_anisotropic_grid.h"
#include "trace/bsdf_anisotropic_inside_data.h"
#include "trace/bsdf_anisotropic_outside_data.h"
#include "trace/bsdf_anisotropic_reflection_data.h"
#include "trace/table_lookup.h"

namespace gobo {
inline namespace trace {
namespace {

namespace grid = anisotropic;
using Cell = grid::Cell<float>;

constexpr float kStep = 1.0f / 250.0f;  // of glass

}  // namespace

AnisotropicAlbedo::AnisotropicAlbedo(float roughness, float anisotropy) : ax_(grid::alphaX(roughness, anisotropy)), ay_(grid::alphaY(roughness)) {
  const Cell r = grid::cell(roughness, grid::kR), s = grid::cell(anisotropy, grid::kS);
  r_ = r.k;
  fR_ = r.f;
  s_ = s.k;
  fS_ = s.f;
  constexpr int n = grid::fine(grid::kS);
  const Cell a = grid::cell(roughness, grid::fine(grid::kR)), b = grid::cell(anisotropy, n);
  const auto of = [&](const uint16_t* t) {
    const uint16_t* p = t + a.k * n + b.k;
    return mix(mix(float(p[0]), float(p[1]), b.f), mix(float(p[n]), float(p[n + 1]), b.f), a.f) * 2e-5f;
  };
  deficitMean = sqr(of(data::kAnisotropicRoot));
  schlickMean = of(data::kAnisotropicSchlickMean);
}

ReflectionAlbedo::Value AnisotropicAlbedo::at(const Vec3& d) const {
  const float mu = std::fabs(d.z);
  float sin2, cos2;
  grid::azimuth(d.x, d.y, sin2, cos2);
  const Cell m = grid::cell(grid::cosineAxis(mu, grid::reflectionScale(ax_, ay_, cos2)), grid::kMu);
  const grid::Pair<float> p = grid::azimuthPair(cos2, 1.0f, grid::kPhi, grid::kPhi);
  float deficit = 0, extra = 0;
  for (int c = 0; c < 8; ++c) {
    const int at = grid::reflectionIndex(r_ + (c & 1), s_ + (c >> 1 & 1), c & 4 ? p.b : p.a, m.k);
    const float w = (c & 1 ? fR_ : 1.0f - fR_) * (c & 2 ? fS_ : 1.0f - fS_) * (c & 4 ? p.f : 1.0f - p.f);
    deficit += w * mix(float(data::kAnisotropicDeficit[at]), float(data::kAnisotropicDeficit[at + 1]), m.f);
    extra += w * mix(float(data::kAnisotropicExtra[at]), float(data::kAnisotropicExtra[at + 1]), m.f);
  }
  deficit *= 1e-4f;
  const float w = clamp01(1.0f - mu), w2 = w * w;
  return {deficit, minOf(clamp01(extra * 1e-4f + w2 * w2 * w * (1.0f - deficit)), 1.0f - deficit)};
}

AnisotropicGlassAlbedo::AnisotropicGlassAlbedo(float roughness, float anisotropy, float ior)
    : ior_(minOf(maxOf(ior, 1.0002f), 3.0f)), ax_(grid::alphaX(roughness, anisotropy)) {
  const float x = grid::iorAxis(ior_);
  const Cell r = grid::cell(roughness, grid::kGlassR), s = grid::cell(anisotropy, grid::kGlassS), i = grid::cell(x, grid::kGlassIor);
  r_ = r.k;
  fR_ = r.f;
  s_ = s.k;
  fS_ = s.f;
  i_ = i.k;
  fIor_ = i.f;
  constexpr int nS = grid::fine(grid::kGlassS), nI = grid::fine(grid::kGlassIor);
  const Cell a = grid::cell(roughness, grid::fine(grid::kGlassR)), b = grid::cell(anisotropy, nS), c = grid::cell(x, nI);
  const uint16_t* roots[2] = {data::kAnisotropicOutsideRoot, data::kAnisotropicInsideRoot};
  for (int side = 0; side < 2; ++side) {
    float sum = 0;
    for (int k = 0; k < 4; ++k) {
      const uint16_t* p = roots[side] + ((a.k + (k & 1)) * nS + b.k + (k >> 1)) * nI + c.k;
      sum += (k & 1 ? a.f : 1.0f - a.f) * (k & 2 ? b.f : 1.0f - b.f) * mix(float(p[0]), float(p[1]), c.f);
    }
    mean[side] = sqr(sum * 2e-5f);
  }
}

float AnisotropicGlassAlbedo::deficit(const Vec3& d, bool inside) const {
  float sin2, cos2;
  grid::azimuth(d.x, d.y, sin2, cos2);
  const int side = inside ? 1 : 0;
  const uint8_t* table = inside ? data::kAnisotropicInside : data::kAnisotropicOutside;
  const Cell m = grid::cell(grid::cosineAxis(std::fabs(d.z), 2.0f * ax_), grid::kGlassMu);
  const grid::Pair<float> p = grid::azimuthPair(cos2, grid::edge2(inside, ior_, sin2), grid::kFirstPiece[side], grid::kGlassPhi[side]);
  float sum = 0;
  for (int c = 0; c < 16; ++c) {
    const int at = grid::glassIndex(side, i_ + (c >> 3), r_ + (c & 1), s_ + (c >> 1 & 1), c & 4 ? p.b : p.a, m.k);
    const float w = (c & 1 ? fR_ : 1.0f - fR_) * (c & 2 ? fS_ : 1.0f - fS_) * (c & 4 ? p.f : 1.0f - p.f) * (c & 8 ? fIor_ : 1.0f - fIor_);
    sum += w * mix(float(table[at]), float(table[at + 1]), m.f);
  }
  return sum * kStep;
}

}  // namespace trace
}  // namespace gobo
