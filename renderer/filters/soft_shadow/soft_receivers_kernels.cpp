// SPDX-License-Identifier: Apache-2.0
#include "filters/soft_shadow/soft_receivers.h"

#include <algorithm>
#include <cmath>

#include "formulas/soft_shadow.glsl.h"

namespace gobo {

using namespace formulas;

void SoftLookup::hash(Hasher& h) const {
  frames.hash(h);
  light.hash(h);
  h.add(map.bias);
}

SoftReceivers::SoftReceivers(const Term& gbuffer, const SoftLookup& l, bool slopes)
    : receivers_(gbuffer, l.frames, l.map.resolution, l.view, {.slopes = slopes, .facing = false}), P_(gbuffer.floats("P")), N_(gbuffer.floats("N")),
      Ng_(gbuffer.floats("Ng")), frames_(l.frames), light_(l.light), resolution_(float(l.map.resolution)), bias_(l.map.bias),
      perspective_(l.frames.face[0].perspective) {}

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
    if (!(shadingHeight + shadingHalf > 0.0f)) continue;                        // the light cannot shine
    if (!(height + half > 0.0f)) { V[i] = 0.0f; continue; }                     // the surface itself is in the way
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
    if (perspective_) {   // a texel at (x, y) is O + Z (forward + tx right + ty up): its height over the plane is height + Z n.(...)
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

SoftSearch softSearch(const SoftReceivers& receivers, const DepthBounds& bounds, const SoftBlock& b, int i) {
  SoftSearch s;
  const int face = b.at.face[i], last = bounds.resolution() - 1;
  const auto measure = [&] {
    s.box = receivers.box(b, i, s.wx, s.wy);
    bounds.range(face, int(s.box.x0), int(s.box.y0), std::min(int(std::ceil(s.box.x1)) - 1, last), std::min(int(std::ceil(s.box.y1)) - 1, last), s.lo, s.hi);
  };
  s.plane = receivers.metric(face, 0.0f);
  receivers.width(b, i, s.plane, s.wx, s.wy);
  measure();
  for (int step = 0; step < 6; ++step) {   // each cut can only move away from the light: whatever is nearer lies outside the cone
    const float plane = receivers.metric(face, s.lo);
    if (!(plane > s.plane) || s.wx + s.wy <= 2.0f) break;
    float wx, wy;
    receivers.width(b, i, plane, wx, wy);
    const bool settled = wx + wy > 0.9f * (s.wx + s.wy);
    s.plane = plane;
    s.wx = wx;
    s.wy = wy;
    measure();
    if (settled) break;
  }
  s.verdict = softVerdict(b, i, s.box, s.lo, s.hi);
  return s;
}

}  // namespace gobo
