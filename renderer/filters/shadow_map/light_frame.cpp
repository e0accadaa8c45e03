// SPDX-License-Identifier: Apache-2.0
#include "filters/shadow_map/light_frame.h"

#include <algorithm>

#include "scene/light_axes.h"

namespace gobo {
inline namespace filters {

LightFrame::Rows LightFrame::rows() const {
  const Vec2 scale = 1.0f / (hi - lo);
  const float depth = 1.0f / (far - near);
  Rows r;
  if (perspective) {  // u = (X/Z - lo) scale = (X scale - Z lo scale) / Z
    r.u = Vec4((right - forward * lo.x) * scale.x, 0.0f);
    r.v = Vec4((up - forward * lo.y) * scale.y, 0.0f);
    r.w = Vec4(forward, 0.0f);
  } else {
    r.u = Vec4(right * scale.x, -lo.x * scale.x);
    r.v = Vec4(up * scale.y, -lo.y * scale.y);
    r.w = Vec4(0.0f, 0.0f, 0.0f, 1.0f);
  }
  r.d = Vec4(forward * depth, -near * depth);
  return r;
}

Ray LightFrame::ray(float u, float v, float& startDepth, float& cosine) const {
  const float x = lo.x + (hi.x - lo.x) * u, y = lo.y + (hi.y - lo.y) * v;
  Ray ray;
  if (perspective) {
    const Vec3 d = forward + right * x + up * y;
    const float length = glm::length(d);
    ray.origin = origin;
    ray.direction = d / length;
    startDepth = 0.0f;
    cosine = 1.0f / length;
  } else {
    ray.origin = origin + right * x + up * y + forward * start;
    ray.direction = forward;
    startDepth = start;
    cosine = 1.0f;
  }
  return ray;
}

void LightFrame::hash(Hasher& h) const {
  h.add(perspective).addPod(origin).addPod(right).addPod(up).addPod(forward).addPod(lo).addPod(hi).add(near).add(far).add(start).add(sees);
}

namespace {

struct Tangents {
  Vec2 lo{3.0e38f}, hi{-3.0e38f};
  void add(const Vec2& t) {
    lo = glm::min(lo, t);
    hi = glm::max(hi, t);
  }
};

/// Those behind the light have tangents beyond any window, on their own side.
Tangents tangentsOfCorners(const Vec3 (&q)[8]) {
  Tangents t;
  for (const Vec3& corner : q) t.add(Vec2(corner.x, corner.y) / std::max(corner.z, 1e-20f));
  return t;
}

/// Of the part of a box that lies beyond `least` in front of the light: of its corners there, and of where its edges come from behind, whose tangents grow
/// without bound on the way, to a side that neither corner need lie on. `q`: the corners in the light's axes; bit k of a corner's number is its axis k.
Tangents tangentsInFront(const Vec3 (&q)[8], double least) {
  Tangents t;
  for (int corner = 0; corner < 8; ++corner) {
    const DVec3 a(q[corner]);
    if (a.z > least) t.add(Vec2(q[corner].x, q[corner].y) / q[corner].z);
    for (const int bit : {1, 2, 4}) {
      const DVec3 b(q[corner | bit]);
      if ((a.z > least) == (b.z > least)) continue;
      const DVec3 at = a + (b - a) * ((least - a.z) / (b.z - a.z));
      t.add(Vec2(float(at.x / least), float(at.y / least)));
    }
  }
  return t;
}

}  // namespace

Result<LightFrame> fitLightFrame(const LightShape& light, const Vec3& lo, const Vec3& hi, int resolution, int rimTexels, MapWindow window) {
  LightFrame f;
  float tangent = std::tan(kMaxHalfAngle);
  switch (light.kind) {
    case LightKind::Directional: break;
    case LightKind::Spot:
      f.perspective = true;
      // A full-width cone has cosOuter near 0; a point cone still needs a window.
      if (light.cosOuter > std::cos(kMaxHalfAngle)) {
        const float c = std::min(light.cosOuter, 0.999999f);
        tangent = std::sqrt(1.0f - c * c) / c;
      }
      break;
    case LightKind::Rect:
    case LightKind::Disk: f.perspective = true; break;
    default: return Status(Code::Unimplemented, "one shadow map does not serve this kind of light");
  }
  const bool empty = !(lo.x <= hi.x && lo.y <= hi.y && lo.z <= hi.z);
  const float axisLength = glm::length(light.axis);
  if (!isFinite(light.axis) || !(axisLength > 0.0f) || !isFinite(light.position) || !std::isfinite(tangent))
    return invalidArgument("the light's position or axis is not finite");
  if (!empty && !(isFinite(lo) && isFinite(hi))) return invalidArgument("the scene's bounds are not finite");
  f.forward = light.axis / axisLength;
  // The map is square to the light: penumbra kernels are boxes in it.
  const Frame basis = mapFrame(light);
  f.right = basis.x;
  f.up = basis.y;
  f.origin = f.perspective ? light.position : empty ? Vec3(0.0f) : 0.5f * lo + 0.5f * hi;

  Vec3 q[8] = {}, low(3.0e38f), high(-3.0e38f);  // the corners in the light's axes
  for (int corner = 0; corner < 8 && !empty; ++corner) {
    const Vec3 p = Vec3(corner & 1 ? hi.x : lo.x, corner & 2 ? hi.y : lo.y, corner & 4 ? hi.z : lo.z) - f.origin;
    q[corner] = Vec3(glm::dot(p, f.right), glm::dot(p, f.up), glm::dot(p, f.forward));
    low = glm::min(low, q[corner]);
    high = glm::max(high, q[corner]);
  }
  if (f.perspective) {
    f.lo = Vec2(-tangent);
    f.hi = Vec2(tangent);
    f.near = 0.0f;
    f.far = 1.0f;
    if (!empty && high.z > 0.0f) {
      f.far = high.z;
      f.near = std::max(low.z, 0.0f);
      const Tangents t = window == MapWindow::Corners ? tangentsOfCorners(q) : tangentsInFront(q, 1e-6 * glm::length(DVec3(hi) - DVec3(lo)));
      const Vec2 a = glm::max(f.lo, t.lo), b = glm::min(f.hi, t.hi);
      if (a.x <= b.x && a.y <= b.y) {
        f.lo = a;
        f.hi = b;
      }
    }
  } else if (!empty) {
    f.lo = Vec2(low);
    f.hi = Vec2(high);
    f.near = low.z;
    f.far = high.z;
  }
  // A flat or tiny scene still gets a window and a depth range; coordinates bound what float can tell apart: depths err by some 2e-7 of them, which
  // the default bias of 5e-4 ranges must exceed, or a floor square to its light would shade itself.
  const float extent = empty ? 1.0f : std::max({high.x - low.x, high.y - low.y, high.z - low.z, std::abs(f.near), std::abs(f.far), 1e-6f});
  const float pad = std::max(1e-3f * (f.far - f.near), 5e-4f * extent);
  f.near = f.perspective ? std::max(f.near - pad, 0.0f) : f.near - pad;
  f.far += pad;
  const Vec2 centre = 0.5f * (f.lo + f.hi);
  float half = 0.5f * std::max(f.hi.x - f.lo.x, f.hi.y - f.lo.y);
  half = std::max(half * 1.0001f, f.perspective ? 1e-4f : 1e-4f * extent);
  if (resolution > 4 * rimTexels) half *= float(resolution) / float(resolution - 2 * rimTexels);
  f.lo = centre - half;
  f.hi = centre + half;
  if (!f.perspective) f.start = f.near;
  f.sees = !empty && (!f.perspective || high.z > 0.0f);
  return f;
}

void LightFrames::hash(Hasher& h) const {
  h.add(count);
  for (int i = 0; i < count; ++i) face[size_t(i)].hash(h);
}

Result<LightFrames> fitLightFrames(const LightShape& light, const Vec3& lo, const Vec3& hi, int resolution, int rimTexels, MapWindow window) {
  LightFrames frames;
  if (light.kind != LightKind::Point && light.kind != LightKind::Sphere) {
    GOBO_ASSIGN(frames.face[0], fitLightFrame(light, lo, hi, resolution, rimTexels, window));
    return frames;
  }
  if (!isFinite(light.position)) return invalidArgument("the light's position is not finite");
  const bool empty = !(lo.x <= hi.x && lo.y <= hi.y && lo.z <= hi.z);
  if (!empty && !(isFinite(lo) && isFinite(hi))) return invalidArgument("the scene's bounds are not finite");
  frames.count = 6;
  for (int i = 0; i < 6; ++i) {
    LightFrame& f = frames.face[size_t(i)];
    f.perspective = true;
    f.origin = light.position;
    f.forward = Vec3(0.0f);
    f.forward[i / 2] = i % 2 ? -1.0f : 1.0f;
    f.right = Vec3(0.0f);
    f.right[(i / 2 + 1) % 3] = 1.0f;
    f.up = glm::cross(f.forward, f.right);
    // Depth range of the scene in this face's direction; a face that sees nothing keeps an empty one.
    float far = 0.0f, near = 3.0e38f;
    for (int corner = 0; corner < 8 && !empty; ++corner) {
      const Vec3 p = Vec3(corner & 1 ? hi.x : lo.x, corner & 2 ? hi.y : lo.y, corner & 4 ? hi.z : lo.z) - f.origin;
      far = std::max(far, glm::dot(p, f.forward));
      near = std::min(near, glm::dot(p, f.forward));
    }
    const float pad = std::max(1e-3f * far, 1e-6f);
    f.sees = !empty && far > 0.0f;
    f.near = empty || !(far > 0.0f) ? 0.0f : std::max(near - pad, 0.0f);
    f.far = empty || !(far > 0.0f) ? 1.0f : far + pad;
    float half = 1.0001f;
    if (resolution > 4 * (rimTexels + 1)) half *= float(resolution) / float(resolution - 2 * (rimTexels + 1));
    f.lo = Vec2(-half);
    f.hi = Vec2(half);
  }
  return frames;
}

}  // namespace filters
}  // namespace gobo
