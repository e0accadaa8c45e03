// SPDX-License-Identifier: Apache-2.0
#include "filters/shadow_map/exponential_device.h"

#include <algorithm>

namespace gobo::inline filters {
namespace {

constexpr uint32_t kEncodeCode[] =
#include "shaders/exponential_encode.inc"
    ;
constexpr char kEncodeText[] =
#include "shaders/exponential_encode.glsl.inc"
    ;
constexpr uint32_t kFilterCode[] =
#include "shaders/exponential_filter.inc"
    ;
constexpr char kFilterText[] =
#include "shaders/exponential_filter.glsl.inc"
    ;
constexpr uint32_t kLookupCode[] =
#include "shaders/exponential_lookup.inc"
    ;
constexpr char kLookupText[] =
#include "shaders/exponential_lookup.glsl.inc"
    ;

struct EncodePush {
  uint32_t count;
  float c;
};
struct FilterPush {
  int32_t width, height, radius, columns;
};
struct LookupPush {
  float u[4], v[4], w[4], d[4];
  float origin[3];
  float c, bias;
  int32_t width, height;
  uint32_t count;
};
static_assert(sizeof(LookupPush) == 96);

const ComputeKernel kEncode{"exponential_encode", kEncodeCode, 2, sizeof(EncodePush), kEncodeText};
const ComputeKernel kFilter{"exponential_filter", kFilterCode, 3, sizeof(FilterPush), kFilterText};
const ComputeKernel kLookup{"exponential_lookup", kLookupCode, 4, sizeof(LookupPush), kLookupText};

template <typename T>
std::span<const uint8_t> pushBytes(const T& push) {
  return {reinterpret_cast<const uint8_t*>(&push), sizeof push};
}

}  // namespace

Status deviceEncode(ComputeDevice& device, std::span<const float> z, int width, int height, float c, std::span<const float> weights, std::span<float> e) {
  GOBO_ASSIGN(const ComputeBufferPtr first, device.upload(z));
  GOBO_ASSIGN(const ComputeBufferPtr second, device.buffer(z.size_bytes()));
  GOBO_ASSIGN(const ComputeBufferPtr taps, device.upload(weights));
  const int radius = int(weights.size() / 2);
  const EncodePush encode{uint32_t(z.size()), c};
  const FilterPush rows{width, height, radius, 0}, columns{width, height, radius, 1};
  std::vector<ComputeDispatch> passes{{&kEncode, {first, second}, pushBytes(encode), {}}};
  setLinearGroups(passes[0], z.size(), 64);
  if (radius > 0) {
    const uint32_t gx = uint32_t(width + 15) / 16, gy = uint32_t(height + 15) / 16;
    passes.push_back({&kFilter, {second, taps, first}, pushBytes(rows), {gx, gy, 1}});
    passes.push_back({&kFilter, {first, taps, second}, pushBytes(columns), {gx, gy, 1}});
  }
  GOBO_TRY(device.run(passes));
  return device.download(*second, e.data(), e.size_bytes());
}

Status deviceLookup(ComputeDevice& device, const DeviceLookup& lookup, std::span<const float> map, std::span<const float> positions,
                    std::span<const uint32_t> instances, std::span<float> visibility, const StopToken& stop) {
  const size_t total = visibility.size(), piece = std::min<size_t>(total, size_t(1) << 20);
  if (total == 0) return {};
  const LightFrame::Rows rows = lookup.frame.rows();
  LookupPush p{};
  for (int i = 0; i < 4; ++i) {
    p.u[i] = rows.u[i];
    p.v[i] = rows.v[i];
    p.w[i] = rows.w[i];
    p.d[i] = rows.d[i];
  }
  for (int i = 0; i < 3; ++i) p.origin[i] = lookup.frame.origin[i];
  p.c = lookup.c;
  p.bias = lookup.bias;
  p.width = lookup.width;
  p.height = lookup.height;
  GOBO_ASSIGN(const ComputeBufferPtr texels, device.upload(map));
  GOBO_ASSIGN(const ComputeBufferPtr points, device.buffer(piece * 12));
  GOBO_ASSIGN(const ComputeBufferPtr surfaces, device.buffer(piece * 4));
  GOBO_ASSIGN(const ComputeBufferPtr result, device.buffer(piece * 4));
  for (size_t begin = 0; begin < total; begin += piece) {
    if (stop.stopRequested()) return {Code::Cancelled, "shadow_lookup stopped"};
    const size_t n = std::min(piece, total - begin);
    p.count = uint32_t(n);
    GOBO_TRY(device.upload(*points, &positions[3 * begin], n * 12));
    GOBO_TRY(device.upload(*surfaces, &instances[begin], n * 4));
    ComputeDispatch d{&kLookup, {texels, points, surfaces, result}, pushBytes(p), {}};
    setLinearGroups(d, n, 64);
    GOBO_TRY(device.run({&d, 1}));
    GOBO_TRY(device.download(*result, &visibility[begin], n * 4));
  }
  return {};
}

}  // namespace gobo::inline filters
