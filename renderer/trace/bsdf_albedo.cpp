// SPDX-License-Identifier: Apache-2.0
#include "trace/bsdf_albedo.h"

#include <array>

#include "trace/bsdf_glass_inside_data.h"
#include "trace/bsdf_glass_outside_data.h"
#include "trace/bsdf_reflection_data.h"
#include "trace/table_lookup.h"

namespace gobo {
inline namespace trace {
namespace {

constexpr int kMu = 32, kRows = 32, kFineRows = 125;
constexpr int kGlassRows = 22, kGlassIors = 17, kGlassFineRows = 43;
constexpr float kStretch = 2.0f, kLargest = 0.5f;
constexpr int kSheen = 32;

/// Deficit and extra (schlick - (1-mu)^5 (1 - deficit)) side by side.
constexpr auto interleave() {
  std::array<float, 2 * kMu * kRows> out{};
  for (size_t k = 0; k < size_t(kMu * kRows); ++k) {
    out[2 * k] = float(data::kDeficit[k]) * 1e-4f;
    out[2 * k + 1] = float(data::kSchlickExtra[k]) * 1e-4f;
  }
  return out;
}
constexpr auto kReflection = interleave();

/// Cell of x in 0..1 over n nodes.
inline int cell(float x, int n, float& f) {
  const float p = clamp01(x) * float(n - 1);
  const int k = p < float(n - 2) ? int(p) : n - 2;
  f = p - float(k);
  return k;
}
inline int cosineCell(float mu, float s, float& f) { return cell(std::sqrt(mu * (1.0f + s) / (mu + s)), kMu, f); }

}  // namespace

ReflectionAlbedo::ReflectionAlbedo(float alpha, float roughness) : s_(kStretch * alpha) {
  row_ = cell(roughness, kRows, f_);
  float f;
  const int k = cell(roughness, kFineRows, f);
  deficitMean = sqr(mix(data::kDeficitRoot[k], data::kDeficitRoot[k + 1], f));
  schlickMean = mix(data::kSchlickMean[k], data::kSchlickMean[k + 1], f);
}

ReflectionAlbedo::Value ReflectionAlbedo::at(float mu) const {
  float f;
  const int column = cosineCell(mu, s_, f);
  const float* a = kReflection.data() + 2 * (row_ * kMu + column);
  const float* b = a + 2 * kMu;
  const float deficit = mix(mix(a[0], a[2], f), mix(b[0], b[2], f), f_), extra = mix(mix(a[1], a[3], f), mix(b[1], b[3], f), f_);
  const float w = clamp01(1.0f - mu), w2 = w * w;
  return {deficit, clamp01(extra + w2 * w2 * w * (1.0f - deficit))};
}

void ReflectionAlbedo::nodes(float* deficit, float* extra) const {
  static_assert(kNodes == kMu);
  const float* a = kReflection.data() + 2 * (row_ * kMu);
  const float* b = a + 2 * kMu;
  for (int k = 0; k < kNodes; ++k) {
    deficit[k] = mix(a[2 * k], b[2 * k], f_);
    extra[k] = mix(a[2 * k + 1], b[2 * k + 1], f_);
  }
}

GlassAlbedo::GlassAlbedo(float alpha, float ior) : s_(kStretch * alpha) {
  const float r = std::sqrt(alpha), x = maxOf(ior - 1.0f, 0.0f) / (ior + 1.0f);
  const int k = cell(std::sqrt(x / kLargest), kGlassIors, fIor_), row = cell(r, kGlassRows, fRow_);
  base_ = (k * kGlassRows + row) * kMu;
  float f;
  const int fine = cell(r, kGlassFineRows, f);
  const uint16_t* roots[2] = {data::kGlassOutsideRoot, data::kGlassInsideRoot};
  for (int side = 0; side < 2; ++side) {
    const uint16_t* a = roots[side] + fine * kGlassIors + k;
    const uint16_t* b = a + kGlassIors;
    mean[side] = sqr(mix(mix(float(a[0]), float(a[1]), fIor_), mix(float(b[0]), float(b[1]), fIor_), f) * 2e-5f);
  }
}

float GlassAlbedo::deficit(float mu, bool inside) const {
  float f;
  const int column = cosineCell(mu, s_, f);
  const uint16_t* t = (inside ? data::kGlassInside : data::kGlassOutside) + base_ + column;
  const auto plane = [&](const uint16_t* p) { return mix(mix(float(p[0]), float(p[1]), f), mix(float(p[kMu]), float(p[kMu + 1]), f), fRow_); };
  return mix(plane(t), plane(t + kGlassRows * kMu), fIor_) * 1e-4f;
}

float sheenAlbedo(float mu, float roughness) {
  float fm, fr;
  const int column = cell(std::sqrt(mu), kSheen, fm), row = cell((roughness - 0.07f) / 0.93f, kSheen, fr);
  const uint16_t* a = data::kSheenAlbedo + row * kSheen + column;
  return mix(mix(float(a[0]), float(a[1]), fm), mix(float(a[kSheen]), float(a[kSheen + 1]), fm), fr) * 1e-4f;
}

}  // namespace trace
}  // namespace gobo
