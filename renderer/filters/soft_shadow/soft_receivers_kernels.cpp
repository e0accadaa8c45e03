// SPDX-License-Identifier: Apache-2.0
#include "filters/soft_shadow/soft_receivers.h"

#include <algorithm>
#include <cmath>

#include "formulas/soft_shadow.glsl.h"

namespace gobo {
inline namespace filters {

using namespace formulas;

void SoftLookup::hash(Hasher& h) const {
  frames.hash(h);
  light.hash(h);
  h.add(map.bias);
  place.hash(h);
}

SoftReceivers::SoftReceivers(const Term& gbuffer, const SoftLookup& l, bool slopes)
    : receivers_(gbuffer, l.frames, l.map.resolution, l.view, {.slopes = slopes, .facing = false}),
      P_(gbuffer.floats("P")),
      N_(gbuffer.floats("N")),
      Ng_(gbuffer.floats("Ng")),
      frames_(l.frames),
      light_(l.light),
      resolution_(float(l.map.resolution)),
      bias_(l.map.bias),
      perspective_(l.frames.face[0].perspective),
      film_(gbuffer.extent(), l.place) {}

void SoftReceivers::reads(Wiring& w, size_t i) {
  Receivers::reads(w, i, {.slopes = true, .facing = false});
  w.reads<float>(i, "N", {3});
}

void SoftReceivers::fill(size_t begin, int count, SoftBlock& b, float* V) const {
  receivers_.fill(begin, count, b.at);
  planes(begin, count, b, V);
}

void SoftReceivers::planes(size_t begin, int count, SoftBlock& b, float* V) const {
  b.activeCount = 0;
  b.perspective = perspective_;
  for (int i = 0; i < count; ++i) {
    V[i] = 1.0f;
    if (!b.at.covered[i]) continue;
    const size_t e = 3 * (begin + size_t(i));
    const Vec3 p(P_[e], P_[e + 1], P_[e + 2]), n(Ng_[e], Ng_[e + 1], Ng_[e + 2]), shading(N_[e], N_[e + 1], N_[e + 2]);
    const LightFrame& f = frames_.face[size_t(b.at.face[i])];
    const Vec3 q = p - f.origin;
    // Heights of the light's centre over a plane through the receiver, and half the light's extent along its normal (directional: per unit distance).
    const auto horizon = [&](const Vec3& m, float& half) {
      const float mx = glm::dot(m, f.right), my = glm::dot(m, f.up);
      switch (light_.shape) {
        case SoftLight::Sphere: half = light_.half.x * glm::length(m); break;
        case SoftLight::Disk: half = light_.half.x * std::sqrt(mx * mx + my * my); break;
        default: half = std::fabs(mx) * light_.half.x + std::fabs(my) * light_.half.y;
      }
      return perspective_ ? -glm::dot(m, q) : -glm::dot(m, f.forward);
    };
    float half, shadingHalf;
    const float height = horizon(n, half), shadingHeight = horizon(shading, shadingHalf);
    if (!(shadingHeight + shadingHalf > 0.0f)) continue;  // the light cannot shine
    if (!(height + half > 0.0f)) {
      V[i] = 0.0f;
      continue;
    }  // the surface itself is in the way
    const float range = f.far - f.near, texelX = (f.hi.x - f.lo.x) / resolution_, texelY = (f.hi.y - f.lo.y) / resolution_;
    const float d = f.near + b.at.d[i] * range;
    b.metric[i] = d;
    b.near[i] = f.near;
    b.range[i] = range;
    b.limit[i] = b.at.d[i] - bias_;
    b.margin[i] = bias_ * range;
    b.above[i] = softAbove(height, half);
    const float right = glm::dot(n, f.right), up = glm::dot(n, f.up), forward = glm::dot(n, f.forward);
    float tx = 0, ty = 0;
    if (perspective_) {  // a texel at (x, y) is O + Z (forward + tx right + ty up): its height over the plane is height + Z n.(...)
      tx = f.lo.x + (b.at.x[i] + 0.5f) * texelX;
      ty = f.lo.y + (b.at.y[i] + 0.5f) * texelY;
      const float along = forward + tx * right + ty * up, alongX = right * texelX, alongY = up * texelY;
      b.a[i] = height + f.near * along;
      b.ax[i] = f.near * alongX;
      b.ay[i] = f.near * alongY;
      b.b[i] = range * along;
      b.bx[i] = range * alongX;
      b.by[i] = range * alongY;
    } else {
      b.a[i] = (f.near - d) * forward;
      b.ax[i] = right * texelX;
      b.ay[i] = up * texelY;
      b.b[i] = range * forward;
      b.bx[i] = b.by[i] = 0.0f;
    }
    b.scaleX[i] = light_.size.x * (light_.shape == SoftLight::Sphere ? softStretch(tx) : 1.0f) / texelX;
    b.scaleY[i] = light_.size.y * (light_.shape == SoftLight::Sphere ? softStretch(ty) : 1.0f) / texelY;
    b.active[b.activeCount++] = i;
  }
}

SoftSearch::Verdict softVerdict(const SoftBlock& b, int i, const SoftBox& box, float lo, float hi) {
  if (lo >= b.limit[i]) return SoftSearch::Lit;
  // Centres of the texels that the box touches; heights are linear in each of x, y and z: extremes lie at corners.
  const float xs[2] = {std::floor(box.x0) - b.at.x[i], std::ceil(box.x1) - 1.0f - b.at.x[i]};
  const float ys[2] = {std::floor(box.y0) - b.at.y[i], std::ceil(box.y1) - 1.0f - b.at.y[i]};
  float least = 3.0e38f, most = -3.0e38f;
  for (float x : xs)
    for (float y : ys)
      for (float z : {lo, hi}) {
        const float h = softHeight(b.a[i], b.ax[i], b.ay[i], b.b[i], b.bx[i], b.by[i], x, y, z);
        least = std::min(least, h);
        most = std::max(most, h);
      }
  // Rounding of heights inside the box against those at its corners.
  const float slack = 1e-5f * (std::fabs(b.a[i]) + std::fabs(b.b[i]));
  if (most + slack <= b.margin[i]) return SoftSearch::Lit;
  if (hi < b.limit[i] && least - slack > b.margin[i]) return SoftSearch::Dark;
  return SoftSearch::Mixed;
}

namespace {

/// One number of each of a block's active receivers, side by side.
struct SearchLanes {
  static constexpr int kSize = SoftBlock::kSize;
  int count = 0;
  float x[kSize], y[kSize], metric[kSize], scaleX[kSize], scaleY[kSize], near[kSize], range[kSize];
  int32_t base[kSize];
  float wx[kSize], wy[kSize], plane[kSize], lo[kSize], hi[kSize];
  float x0[kSize], x1[kSize], y0[kSize], y1[kSize];
  int32_t go[kSize];
};

struct SearchLevels {
  explicit SearchLevels(const DepthBounds& bounds) : texels(bounds.level(0).lo), last(bounds.levels() - 1) {
    for (int l = 0; l < DepthBounds::kMaxLevels; ++l) {
      const DepthBounds::Level v = bounds.level(l);
      lo[l] = int32_t(v.lo - texels);
      hi[l] = int32_t(v.hi - texels);
      side[l] = v.side;
    }
  }
  const float* texels;
  int32_t lo[DepthBounds::kMaxLevels], hi[DepthBounds::kMaxLevels], side[DepthBounds::kMaxLevels];
  int last;
};

/// Boxes of the widths, and bounds of the depths in them, for lanes that go on.
void measureLanes(const SearchLevels& levels, float resolution, SearchLanes* __restrict k) {
  const int n = k->count, end = int(resolution) - 1;
  int32_t at[4][SearchLanes::kSize], low[SearchLanes::kSize], high[SearchLanes::kSize];
  int32_t level[SearchLanes::kSize], ix0[SearchLanes::kSize], ix1[SearchLanes::kSize], iy0[SearchLanes::kSize], iy1[SearchLanes::kSize];
  for (int i = 0; i < n; ++i) {
    const float cx = k->x[i] + 0.5f, cy = k->y[i] + 0.5f, hx = 0.5f * k->wx[i], hy = 0.5f * k->wy[i];
    const float x0 = formulas::maxOf(cx - hx, 0.0f), x1 = formulas::minOf(cx + hx, resolution), y0 = formulas::maxOf(cy - hy, 0.0f),
                y1 = formulas::minOf(cy + hy, resolution);
    k->x0[i] = x0;
    k->x1[i] = x1;
    k->y0[i] = y0;
    k->y1[i] = y1;
    ix0[i] = int(x0);
    iy0[i] = int(y0);
    const int ex = int(-floorOf(-x1)) - 1, ey = int(-floorOf(-y1)) - 1;
    ix1[i] = CHOOSE(ex < end, ex, end);
    iy1[i] = CHOOSE(ey < end, ey, end);
    // Texels of side 2^l >= the box's: it meets at most two along each axis. l is the exponent of 2 (width) - 1.
    const int dx = ix1[i] - ix0[i], dy = iy1[i] - iy0[i], d = CHOOSE(dx > dy, dx, dy), w = CHOOSE(d > 1, d, 1);
    const int l = (bitsOf(float(2 * w - 1)) >> 23) - 127;
    level[i] = CHOOSE(l < levels.last, l, levels.last);
  }
  for (int i = 0; i < n; ++i) {
    const int l = level[i], side = levels.side[l];
    const int ax = ix0[i] >> l, bx = ix1[i] >> l, ay = (iy0[i] >> l) * side, by = (iy1[i] >> l) * side;
    at[0][i] = ay + ax;
    at[1][i] = ay + bx;
    at[2][i] = by + ax;
    at[3][i] = by + bx;
    low[i] = k->base[i] + levels.lo[l];
    high[i] = k->base[i] + levels.hi[l];
  }
  const float* __restrict texels = levels.texels;
  for (int i = 0; i < n; ++i) {
    const float a = formulas::minOf(texels[low[i] + at[0][i]], texels[low[i] + at[1][i]]),
                b = formulas::minOf(texels[low[i] + at[2][i]], texels[low[i] + at[3][i]]);
    const float c = formulas::maxOf(texels[high[i] + at[0][i]], texels[high[i] + at[1][i]]),
                d = formulas::maxOf(texels[high[i] + at[2][i]], texels[high[i] + at[3][i]]);
    k->lo[i] = formulas::minOf(a, b);
    k->hi[i] = formulas::maxOf(c, d);
  }
}

template <bool perspective>
void widthsAt(const float* __restrict plane, float resolution, const SearchLanes* __restrict k, float* __restrict wx, float* __restrict wy) {
  for (int i = 0; i < k->count; ++i) {
    const float w = softWidth(k->metric[i], plane[i], 1.0f, perspective);
    wx[i] = formulas::limit(w * k->scaleX[i], 1.0f, 2.0f * resolution);
    wy[i] = formulas::limit(w * k->scaleY[i], 1.0f, 2.0f * resolution);
  }
}

}  // namespace

void softSearches(const SoftReceivers& receivers, const DepthBounds& bounds, const SoftBlock& b, SoftSearch* out) {
  const SearchLevels levels(bounds);
  const float resolution = receivers.resolution();
  SearchLanes k;
  k.count = b.activeCount;
  for (int j = 0; j < k.count; ++j) {
    const int i = b.active[j];
    k.x[j] = b.at.x[i];
    k.y[j] = b.at.y[i];
    k.metric[j] = b.metric[i];
    k.scaleX[j] = b.scaleX[i];
    k.scaleY[j] = b.scaleY[i];
    k.near[j] = b.near[i];
    k.range[j] = b.range[i];
    k.base[j] = b.at.face[i] * int32_t(bounds.faceTexels());
    k.plane[j] = b.near[i];
    k.go[j] = 1;
  }
  const auto widths = [&](const float* plane, float* wx, float* wy) {
    if (receivers.perspective()) widthsAt<true>(plane, resolution, &k, wx, wy);
    else widthsAt<false>(plane, resolution, &k, wx, wy);
  };
  widths(k.plane, k.wx, k.wy);
  measureLanes(levels, resolution, &k);
  for (int step = 0; step < 6; ++step) {  // each cut can only move away from the light: whatever is nearer lies outside the cone
    float plane[SearchLanes::kSize], wx[SearchLanes::kSize], wy[SearchLanes::kSize];
    for (int i = 0; i < k.count; ++i) plane[i] = k.near[i] + k.lo[i] * k.range[i];
    widths(plane, wx, wy);
    int any = 0;
    for (int i = 0; i < k.count; ++i) {
      const int go = CHOOSE((k.go[i] != 0) & (plane[i] > k.plane[i]) & (k.wx[i] + k.wy[i] > 2.0f), 1, 0);
      const int settled = CHOOSE(wx[i] + wy[i] > 0.9f * (k.wx[i] + k.wy[i]), 1, 0);
      k.plane[i] = CHOOSE(go != 0, plane[i], k.plane[i]);
      k.wx[i] = CHOOSE(go != 0, wx[i], k.wx[i]);  // lanes that have ended keep their box, and measure it again
      k.wy[i] = CHOOSE(go != 0, wy[i], k.wy[i]);
      k.go[i] = go & (1 - settled);
      any |= go;
    }
    if (!any) break;
    measureLanes(levels, resolution, &k);
  }
  for (int j = 0; j < k.count; ++j) {
    const int i = b.active[j];
    SoftSearch& s = out[i];
    s.wx = k.wx[j];
    s.wy = k.wy[j];
    s.box = {k.x0[j], k.x1[j], k.y0[j], k.y1[j]};
    s.lo = k.lo[j];
    s.hi = k.hi[j];
    s.plane = k.plane[j];
    s.verdict = softVerdict(b, i, s.box, s.lo, s.hi);
  }
}

}  // namespace filters
}  // namespace gobo
