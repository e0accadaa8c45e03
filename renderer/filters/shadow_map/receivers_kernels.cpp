// SPDX-License-Identifier: Apache-2.0
#include "filters/shadow_map/receivers.h"

#include "formulas/shadow_map.glsl.h"

namespace gobo {
inline namespace filters {

using namespace formulas;

void Receivers::reads(Wiring& w, size_t i, ReceiverNeeds needs) {
  w.reads<float>(i, "P", {3}).reads<uint32_t>(i, "instance");
  if (needs.facing && w.input(i).find("N")) w.reads<float>(i, "N", {3});
  if (needs.slopes || needs.footprints) w.reads<float>(i, "Ng", {3});
  if (needs.footprints) w.reads<float>(i, "footprint");
}

Receivers::Receivers(const Term& gbuffer, const LightFrames& frames, int resolution, const ShadowView& view, ReceiverNeeds needs)
    : P_(gbuffer.floats("P")),
      instance_(gbuffer.plane<uint32_t>("instance")),
      count_(frames.count),
      origin_(frames.face[0].origin),
      perspective_(frames.face[0].perspective),
      resolution_(float(resolution)),
      view_(view),
      needs_(needs) {
  needs_.facing = needs.facing && gbuffer.hasPlane("N");
  if (needs_.facing) N_ = gbuffer.floats("N");
  if (needs.slopes || needs.footprints) Ng_ = gbuffer.floats("Ng");
  if (needs.footprints) footprint_ = gbuffer.floats("footprint");
  for (int f = 0; f < count_; ++f) {
    const LightFrame& frame = frames.face[f];
    const LightFrame::Rows rows = frame.rows();
    Face& to = faces_[f];
    for (int i = 0; i < 4; ++i) {
      to.u[i] = rows.u[i];
      to.v[i] = rows.v[i];
      to.w[i] = rows.w[i];
      to.d[i] = rows.d[i];
    }
    to.near = frame.near;
    to.range = frame.far - frame.near;
    to.right = frame.right;
    to.up = frame.up;
    to.forward = frame.forward;
    to.scaleX = (frame.hi.x - frame.lo.x) / resolution_ / to.range;
    to.scaleY = (frame.hi.y - frame.lo.y) / resolution_ / to.range;
  }
}

void Receivers::fill(size_t begin, int count, ReceiverBlock& b) const {
  const float* P = P_.data() + 3 * begin;
  const uint32_t* instance = instance_.data() + begin;
  const float ox = origin_.x, oy = origin_.y, oz = origin_.z, size = resolution_;
  const auto place = [&](const Face& f, int i) {
    const float x = P[3 * i] - ox, y = P[3 * i + 1] - oy, z = P[3 * i + 2] - oz;
    const float inverseW = shadowInverse(shadowRow(f.w[0], f.w[1], f.w[2], f.w[3], x, y, z));
    const float u = shadowRow(f.u[0], f.u[1], f.u[2], f.u[3], x, y, z) * inverseW;
    const float v = shadowRow(f.v[0], f.v[1], f.v[2], f.v[3], x, y, z) * inverseW;
    b.x[i] = shadowTexel(u, size);
    b.y[i] = shadowTexel(v, size);
    b.d[i] = shadowRow(f.d[0], f.d[1], f.d[2], f.d[3], x, y, z);
    b.covered[i] = CHOOSE(shadowCovered(u, v, inverseW) && instance[i] != ~0u, 1, 0);
  };
  if (count_ == 1) {
    const Face f = faces_[0];  // a local copy: no store below can change it
    for (int i = 0; i < count; ++i) place(f, i);
    for (int i = 0; i < count; ++i) b.face[i] = 0;
  } else {
    for (int i = 0; i < count; ++i) {
      b.face[i] = cubeFace(Vec3(P[3 * i] - ox, P[3 * i + 1] - oy, P[3 * i + 2] - oz));
      place(faces_[b.face[i]], i);
    }
  }
  facing(begin, count, b);
  if (needs_.slopes) slopes(begin, count, b);
  else
    for (int i = 0; i < count; ++i) b.slopeX[i] = b.slopeY[i] = 0.0f;
  if (needs_.footprints) footprints(begin, count, b);
  else
    for (int i = 0; i < count; ++i) b.majorX[i] = b.majorY[i] = b.minorX[i] = b.minorY[i] = 0.0f;
}

void Receivers::facing(size_t begin, int count, ReceiverBlock& b) const {
  if (!needs_.facing) return;
  const float* P = P_.data() + 3 * begin;
  const float* N = N_.data() + 3 * begin;
  const Vec3 forward = faces_[0].forward;
  if (perspective_) {
    const float ox = origin_.x, oy = origin_.y, oz = origin_.z;
    for (int i = 0; i < count; ++i) {
      const float c = (P[3 * i] - ox) * N[3 * i] + (P[3 * i + 1] - oy) * N[3 * i + 1] + (P[3 * i + 2] - oz) * N[3 * i + 2];
      b.covered[i] &= CHOOSE(c < 0.0f, 1, 0);
    }
  } else {
    for (int i = 0; i < count; ++i) b.covered[i] &= CHOOSE(forward.x * N[3 * i] + forward.y * N[3 * i + 1] + forward.z * N[3 * i + 2] < 0.0f, 1, 0);
  }
}

void Receivers::slopes(size_t begin, int count, ReceiverBlock& b) const {
  const float* P = P_.data() + 3 * begin;
  const float* N = Ng_.data() + 3 * begin;
  for (int i = 0; i < count; ++i) {
    const Face& f = faces_[b.face[i]];
    const float nr = N[3 * i] * f.right.x + N[3 * i + 1] * f.right.y + N[3 * i + 2] * f.right.z;
    const float nu = N[3 * i] * f.up.x + N[3 * i + 1] * f.up.y + N[3 * i + 2] * f.up.z;
    const float nf = N[3 * i] * f.forward.x + N[3 * i + 1] * f.forward.y + N[3 * i + 2] * f.forward.z;
    float ray = nf, z = 1.0f;
    if (perspective_) {
      // n . (forward + x right + y up) is n . p over p's planar depth.
      const float x = P[3 * i] - origin_.x, y = P[3 * i + 1] - origin_.y, h = P[3 * i + 2] - origin_.z;
      z = formulas::maxOf(finiteOr(x * f.forward.x + y * f.forward.y + h * f.forward.z, 1.0f), 1e-20f);
      ray = finiteOr((N[3 * i] * x + N[3 * i + 1] * y + N[3 * i + 2] * h) / z, 1.0f);
    }
    b.slopeX[i] = shadowSlope(nr, ray, z, f.scaleX);
    b.slopeY[i] = shadowSlope(nu, ray, z, f.scaleY);
  }
}

void Receivers::footprints(size_t begin, int count, ReceiverBlock& b) const {
  constexpr float kGrazing = 0.05f;  // footprints grow to at most 20 times their width: the pixel is a sliver there
  for (int i = 0; i < count; ++i) {
    const size_t e = begin + size_t(i);
    const Vec3 p(P_[3 * e], P_[3 * e + 1], P_[3 * e + 2]), n(Ng_[3 * e], Ng_[3 * e + 1], Ng_[3 * e + 2]);
    const Vec3 to = view_.perspective ? view_.eye - p : view_.eye;
    const float length = std::sqrt(glm::dot(to, to)), inverse = length > 0.0f ? 1.0f / length : 0.0f;
    const Vec3 w = to * inverse;
    const float cosine = glm::dot(w, n);
    Vec3 along = w - n * cosine;
    const float l = std::sqrt(glm::dot(along, along));
    along = l > 1e-4f ? along * (1.0f / l) : Frame(n).x;
    const Vec3 across = glm::cross(n, along);
    const float width = footprint_[e];
    const float stretched = width / formulas::maxOf(std::fabs(cosine), kGrazing);
    const Face& f = faces_[b.face[i]];
    const Vec3 q = p - origin_;
    const float inverseW = shadowInverse(shadowRow(f.w[0], f.w[1], f.w[2], f.w[3], q.x, q.y, q.z));
    const auto texels = [&](const Vec3& t, const float* row, float at) {  // derivative of row / w along t
      const float num = row[0] * t.x + row[1] * t.y + row[2] * t.z;
      const float den = f.w[0] * t.x + f.w[1] * t.y + f.w[2] * t.z;
      return limit(finiteOr((num - at * den) * inverseW * resolution_, 0.0f), -resolution_, resolution_);
    };
    const float u = (b.x[i] + 0.5f) / resolution_, v = (b.y[i] + 0.5f) / resolution_;
    const Vec3 major = along * stretched, minor = across * width;
    b.majorX[i] = texels(major, f.u, u);
    b.majorY[i] = texels(major, f.v, v);
    b.minorX[i] = texels(minor, f.u, u);
    b.minorY[i] = texels(minor, f.v, v);
  }
}

}  // namespace filters
}  // namespace gobo
