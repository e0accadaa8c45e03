// SPDX-License-Identifier: Apache-2.0
#include "filters/shadow_map/exponential_device.h"

#include <algorithm>

namespace gobo {
inline namespace filters {
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

Status deviceEncode(ResidentPlanes& on, const TermPtr& depth, float c, std::span<const float> weights, const std::shared_ptr<Term>& result) {
  ComputeDevice& device = on.device();
  const int width = depth->extent().width, height = depth->extent().height;
  const std::span<float> e = result->writable<float>("B");
  GOBO_ASSIGN(const ComputeBufferPtr z, on.get(depth, "z", 0, e.size()));
  const int radius = int(weights.size() / 2);
  const auto passes = [&]() -> Result<ComputeBufferPtr> {
    GOBO_ASSIGN(const ComputeBufferPtr encoded, device.buffer(e.size_bytes()));
    const EncodePush encode{uint32_t(e.size()), c};
    const FilterPush rows{width, height, radius, 0}, columns{width, height, radius, 1};
    std::vector<ComputeDispatch> passes{{&kEncode, {z, encoded}, pushBytes(encode), {}}};
    setLinearGroups(passes[0], e.size(), 64);
    if (radius > 0) {
      GOBO_ASSIGN(const ComputeBufferPtr filtered, device.buffer(e.size_bytes()));
      GOBO_ASSIGN(const ComputeBufferPtr taps, device.upload(weights));
      const uint32_t gx = uint32_t(width + 15) / 16, gy = uint32_t(height + 15) / 16;
      passes.push_back({&kFilter, {encoded, taps, filtered}, pushBytes(rows), {gx, gy, 1}});
      passes.push_back({&kFilter, {filtered, taps, encoded}, pushBytes(columns), {gx, gy, 1}});
    }
    GOBO_TRY(device.run(passes));
    GOBO_TRY(device.download(*encoded, e.data(), e.size_bytes()));
    return encoded;
  };
  const Result<ComputeBufferPtr> encoded = passes();
  if (!encoded.ok()) return on.checked(encoded.status());
  on.adopt(result, "B", *encoded);
  return {};
}

Status deviceLookup(ResidentPlanes& on, const DeviceLookup& lookup, const TermPtr& map, const TermPtr& gbuffer, std::span<float> visibility,
                    const StopToken& stop) {
  ComputeDevice& device = on.device();
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
  p.width = map->extent().width;
  p.height = map->extent().height;
  GOBO_ASSIGN(const ComputeBufferPtr texels, on.get(map, "B", 0, map->floats("B").size()));
  Result<ComputeBufferPtr> result = device.buffer(piece * 4);
  if (!result.ok()) return on.checked(result.status());
  for (size_t begin = 0; begin < total; begin += piece) {
    if (stop.stopRequested()) return {Code::Cancelled, "shadow_lookup stopped"};
    const size_t n = std::min(piece, total - begin);
    p.count = uint32_t(n);
    GOBO_ASSIGN(const ComputeBufferPtr points, on.get(gbuffer, "P", begin, n));
    GOBO_ASSIGN(const ComputeBufferPtr surfaces, on.get(gbuffer, "instance", begin, n));
    ComputeDispatch d{&kLookup, {texels, points, surfaces, *result}, pushBytes(p), {}};
    setLinearGroups(d, n, 64);
    GOBO_TRY(on.checked(device.run({&d, 1})));
    GOBO_TRY(on.checked(device.download(**result, &visibility[begin], n * 4)));
  }
  return {};
}

}  // namespace filters
}  // namespace gobo
