// SPDX-License-Identifier: Apache-2.0
#include "filters/soft_shadow/soft_kernels.h"

#include <algorithm>
#include <cmath>

#include "base/sobol.h"
#include "formulas/soft_shadow.glsl.h"

namespace gobo {
inline namespace filters {

using namespace formulas;

namespace {

constexpr int kPolledTexels = 1 << 20;

// One row of a box: columns' sums of weight wy over what blocks, and of its depths.
template <SoftAsk ask>
void row(const float* __restrict z, int n, float dx0, float limit, float margin, float a, float ax, float b, float bx, float wy, float* __restrict blocked,
         float* __restrict depth) {
  for (int i = 0; i < n; ++i) {
    const float dx = dx0 + float(i), height = softHeight(a, ax, 0.0f, b, bx, 0.0f, dx, 0.0f, z[i]);
    const float w = wy * softBlocks(z[i], limit, height, margin);
    blocked[i] += w;
    if (ask == SoftAsk::Blockers) depth[i] += w * z[i];
  }
}

template <SoftAsk ask>
SoftSums dense(const float* z, int side, const SoftBlock& b, int i, const SoftBox& box, float* __restrict scratch, const StopToken& stop) {
  const int x0 = int(box.x0), x1 = std::min(int(std::ceil(box.x1)), side), y0 = int(box.y0), y1 = std::min(int(std::ceil(box.y1)), side), n = x1 - x0;
  // Whole vectors a row: what is read beyond the box is not counted, and behind the map's last row the bounds go on (depth_bounds.h).
  const int lanes = side >= 8 ? (n + 7) & ~7 : n;
  float* blocked = scratch;
  float* depth = scratch + side + 8;
  std::fill_n(blocked, lanes, 0.0f);
  if (ask == SoftAsk::Blockers) std::fill_n(depth, lanes, 0.0f);
  const int often = std::max(kPolledTexels / std::max(lanes, 1), 1);  // rows
  for (int y = y0; y < y1; ++y) {
    if ((y - y0) % often == often - 1 && stop.stopRequested()) return {.stopped = true};
    const float wy = std::min(box.y1, float(y + 1)) - std::max(box.y0, float(y)), dy = float(y) - b.at.y[i];
    row<ask>(z + size_t(y) * size_t(side) + size_t(x0), lanes, float(x0) - b.at.x[i], b.limit[i], b.margin[i], b.a[i] + b.ay[i] * dy, b.ax[i],
             b.b[i] + b.by[i] * dy, b.bx[i], wy, blocked, depth);
  }
  // In a fixed order, in double.
  double share = 0, sum = 0;
  for (int k = 0; k < n; ++k) {
    const double wx = double(std::min(box.x1, float(x0 + k + 1)) - std::max(box.x0, float(x0 + k)));
    share += wx * double(blocked[k]);
    if (ask == SoftAsk::Blockers) sum += wx * double(depth[k]);
  }
  return {box.area(), float(share), float(sum)};
}

}  // namespace

SoftSums softDense(SoftAsk ask, const float* z, int side, const SoftBlock& b, int i, const SoftBox& box, float* scratch, const StopToken& stop) {
  return ask == SoftAsk::Share ? dense<SoftAsk::Share>(z, side, b, i, box, scratch, stop) : dense<SoftAsk::Blockers>(z, side, b, i, box, scratch, stop);
}

void SoftTaps::add(const SoftBlock& block, int i, const SoftBox& box, size_t faceTexels, uint64_t element) {
  const int k = count++;
  receiver[k] = i;
  base[k] = int32_t(size_t(block.at.face[i]) * faceTexels);
  x0[k] = box.x0;
  y0[k] = box.y0;
  sx[k] = box.x1 - box.x0;
  sy[k] = box.y1 - box.y0;
  px[k] = block.at.x[i];
  py[k] = block.at.y[i];
  limit[k] = block.limit[i];
  margin[k] = block.margin[i];
  a[k] = block.a[i];
  ax[k] = block.ax[i];
  ay[k] = block.ay[i];
  b[k] = block.b[i];
  bx[k] = block.bx[i];
  by[k] = block.by[i];
  near[k] = block.near[i];
  range[k] = block.range[i];
  metric[k] = block.metric[i];
  scaleX[k] = block.scaleX[i];
  scaleY[k] = block.scaleY[i];
  const uint64_t h = hash64(element, 0x50f7);
  shiftU[k] = float(uint32_t(h) >> 8) * 0x1p-24f;
  shiftV[k] = float(uint32_t(h >> 32) >> 8) * 0x1p-24f;
}

namespace {

enum class Pass { Probe, Blockers, Share };

template <Pass pass, bool perspective>
void taps(const float* __restrict z, int side, const SoftPattern& pattern, SoftTaps* __restrict k) {
  const int n = k->count;
  const float last = float(side - 1);
  for (int i = 0; i < n; ++i) {
    k->blocked[i] = k->depth[i] = 0.0f;
    k->nearest[i] = 2.0f;
  }
  for (int t = 0; t < pattern.taps; ++t) {
    const float pu = pattern.u[size_t(t)], pv = pattern.v[size_t(t)], shrink = pattern.shrink[size_t(t)];
    for (int i = 0; i < n; ++i) {
      float u = pu + k->shiftU[i], v = pv + k->shiftV[i];
      u -= CHOOSE(u >= 1.0f, 1.0f, 0.0f);
      v -= CHOOSE(v >= 1.0f, 1.0f, 0.0f);
      float x = k->x0[i] + k->sx[i] * u, y = k->y0[i] + k->sy[i] * v;
      if (pass == Pass::Probe) {  // the box drawn together towards the receiver
        x = k->px[i] + 0.5f + (x - (k->px[i] + 0.5f)) * shrink;
        y = k->py[i] + 0.5f + (y - (k->py[i] + 0.5f)) * shrink;
      }
      x = formulas::minOf(floorOf(x), last);
      y = formulas::minOf(floorOf(y), last);
      const float depth = z[k->base[i] + int(y) * side + int(x)];
      const float dx = x - k->px[i], dy = y - k->py[i];
      const float height = softHeight(k->a[i], k->ax[i], k->ay[i], k->b[i], k->bx[i], k->by[i], dx, dy, depth);
      float w = softBlocks(depth, k->limit[i], height, k->margin[i]);
      if (pass == Pass::Probe) {  // in the cone to the light at their own depth
        const float metric = k->near[i] + depth * k->range[i];
        w *= CHOOSE(softInside(dx, k->metric[i], metric, k->scaleX[i], perspective) & softInside(dy, k->metric[i], metric, k->scaleY[i], perspective), 1.0f,
                    0.0f);
        k->nearest[i] = formulas::minOf(k->nearest[i], CHOOSE(w > 0.0f, depth, 2.0f));
      } else {
        k->blocked[i] += w;
        if (pass == Pass::Blockers) k->depth[i] += w * depth;
      }
    }
  }
  const float inverse = 1.0f / float(pattern.taps);
  for (int i = 0; i < n; ++i) {
    k->blocked[i] *= inverse;
    k->depth[i] *= inverse;
  }
}

}  // namespace

SoftPattern::SoftPattern(int n) : taps(n), u(size_t(n)), v(size_t(n)), shrink(size_t(n)) {
  for (int t = 0; t < n; ++t) {
    u[size_t(t)] = (float(t) + 0.5f) / float(n);
    const double g = 0.6180339887498949 * t, h = 0.7548776662466927 * t;
    v[size_t(t)] = float(g - std::floor(g));
    shrink[size_t(t)] = float(std::exp2(-5.0 * (h - std::floor(h))));  // 1 .. 1/32, evenly in its logarithm
  }
}

void softTaps(SoftAsk ask, const float* z, int side, const SoftPattern& pattern, SoftTaps& k) {
  if (ask == SoftAsk::Share) taps<Pass::Share, true>(z, side, pattern, &k);
  else taps<Pass::Blockers, true>(z, side, pattern, &k);
}

void softProbe(const float* z, int side, const SoftPattern& pattern, bool perspective, SoftTaps& k) {
  if (perspective) taps<Pass::Probe, true>(z, side, pattern, &k);
  else taps<Pass::Probe, false>(z, side, pattern, &k);
}

}  // namespace filters
}  // namespace gobo
