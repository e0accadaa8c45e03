// SPDX-License-Identifier: Apache-2.0
#include "filters/shadow_map/camera_fit.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace gobo {
inline namespace filters {
namespace {

struct ClipPlane {
  DVec3 n;
  double c;
};  // n . p + c >= 0 inside; n is unit
using Planes = std::vector<ClipPlane>;

void add(Planes& planes, const DVec3& n, const DVec3& through, double slack) {
  const double l = glm::length(n);
  if (l > 0.0) planes.push_back({n / l, slack - glm::dot(n / l, through)});
}

void addBox(Planes& planes, const Vec3& lo, const Vec3& hi, double slack) {
  for (int a = 0; a < 3; ++a) {
    DVec3 n(0.0);
    n[a] = 1.0;
    add(planes, n, DVec3(lo), slack);
    add(planes, -n, DVec3(hi), slack);
  }
}

// What a window [lo, hi] of tangents (perspective, in front of the origin) or metres shows.
struct View {
  DVec3 origin, right, up, forward;
  bool perspective;
  glm::dvec2 lo, hi;
};
void addView(Planes& planes, const View& v, double slack) {
  if (v.perspective) {
    add(planes, v.right - v.forward * v.lo.x, v.origin, slack);
    add(planes, v.forward * v.hi.x - v.right, v.origin, slack);
    add(planes, v.up - v.forward * v.lo.y, v.origin, slack);
    add(planes, v.forward * v.hi.y - v.up, v.origin, slack);
    add(planes, v.forward, v.origin, slack);
  } else {
    add(planes, v.right, v.origin + v.right * v.lo.x, slack);
    add(planes, -v.right, v.origin + v.right * v.hi.x, slack);
    add(planes, v.up, v.origin + v.up * v.lo.y, slack);
    add(planes, -v.up, v.origin + v.up * v.hi.y, slack);
  }
}

// Corners of the convex body that the half spaces share: where three planes meet inside all others. Bodies here have at most 17 planes.
std::vector<DVec3> cornersOf(const Planes& planes, double tolerance) {
  std::vector<DVec3> corners;
  const size_t n = planes.size();
  for (size_t i = 0; i < n; ++i)
    for (size_t j = i + 1; j < n; ++j) {
      const DVec3 along = glm::cross(planes[i].n, planes[j].n);
      if (!(glm::dot(along, along) > 1e-18)) continue;
      for (size_t k = j + 1; k < n; ++k) {
        const double det = glm::dot(along, planes[k].n);
        if (!(std::fabs(det) > 1e-9)) continue;
        const DVec3 p = -(planes[i].c * glm::cross(planes[j].n, planes[k].n) + planes[j].c * glm::cross(planes[k].n, planes[i].n) + planes[k].c * along) / det;
        bool inside = true;
        for (size_t m = 0; m < n && inside; ++m) inside = m == i || m == j || m == k || glm::dot(planes[m].n, p) + planes[m].c >= -tolerance;
        if (inside) corners.push_back(p);
      }
    }
  return corners;
}

View lightView(const LightFrame& f) {
  return {DVec3(f.origin), DVec3(f.right), DVec3(f.up), DVec3(f.forward), f.perspective, glm::dvec2(f.lo), glm::dvec2(f.hi)};
}

View cameraView(const CameraFit& fit) {
  const Camera& c = fit.camera;
  const double scale = c.windowHeight64();
  // A ten-thousandth wider than the picture: rays are rounded to float.
  const glm::dvec2 centre = glm::dvec2(c.centre) * scale, half = 0.5 * scale * 1.0001 * glm::dvec2(double(fit.aspect) * double(c.optics.pixelAspect), 1.0);
  return {DVec3(c.toWorld[3]), DVec3(c.toWorld[0]), DVec3(c.toWorld[1]), -DVec3(c.toWorld[2]), c.perspective, centre - half, centre + half};
}

struct Box {
  glm::dvec2 lo{1e300}, hi{-1e300};
  double near = 1e300, far = -1e300;
};
Box seenFrom(const View& v, const std::vector<DVec3>& points, double least) {
  Box b;
  for (const DVec3& p : points) {
    const DVec3 d = p - v.origin;
    const double z = glm::dot(d, v.forward);
    glm::dvec2 at(glm::dot(d, v.right), glm::dot(d, v.up));
    if (v.perspective) at = glm::clamp(at / std::max(z, least), v.lo, v.hi);  // inside the window but for the slack; at the light anywhere in it
    b.lo = glm::min(b.lo, at);
    b.hi = glm::max(b.hi, at);
    b.near = std::min(b.near, z);
    b.far = std::max(b.far, z);
  }
  return b;
}

void fitFace(LightFrame& f, const CameraFit& fit, const Vec3& lo, const Vec3& hi, double extent, int resolution, int rimTexels) {
  const double slack = 1e-5 * extent, tolerance = 1e-7 * extent, sceneNear = f.near, sceneFar = f.far, sceneRange = sceneFar - sceneNear;
  const View light = lightView(f);
  Planes body;
  addBox(body, lo, hi, slack);
  addView(body, light, slack);
  Planes receivers = body;
  if (!fit.camera.optics.panorama) addView(receivers, cameraView(fit), slack);  // which sees all of it
  const std::vector<DVec3> corners = cornersOf(receivers, tolerance);
  if (corners.empty()) {
    f.sees = false;
    return;
  }
  Box box = seenFrom(light, corners, 1e-6 * sceneFar);
  // A body that reaches the light covers every direction.
  if (f.perspective && box.near <= 2.0 * slack) {
    box.lo = light.lo;
    box.hi = light.hi;
  }
  if (!fit.pancake) {  // casters beside the window: what a receiver sees of the whole light, down to the nearest caster
    const double reach = f.perspective ? (sceneNear > 0.0 ? 1.0 / sceneNear - 1.0 / std::max(box.far, sceneNear) : 1e30) : std::max(box.far - sceneNear, 0.0);
    box.lo -= glm::dvec2(fit.lightHalf) * reach;
    box.hi += glm::dvec2(fit.lightHalf) * reach;
  }
  const glm::dvec2 sceneSide = light.hi - light.lo;
  const double least = sceneSide.x / 1024.0;
  const glm::dvec2 middle = 0.5 * (box.lo + box.hi);
  const double side = std::max({box.hi.x - box.lo.x, box.hi.y - box.lo.y, least});
  const double rim = resolution > 4 * rimTexels ? double(resolution) / double(resolution - 2 * rimTexels) : 1.0;
  const Interval x = snappedInterval(middle.x - 0.5 * side, middle.x + 0.5 * side), y = snappedInterval(middle.y - 0.5 * side, middle.y + 0.5 * side);
  const double half = 0.5 * (x.hi - x.lo) * rim;
  if (2.0 * half < sceneSide.x) {
    const glm::dvec2 centre(0.5 * (x.lo + x.hi), 0.5 * (y.lo + y.hi));
    f.lo = Vec2(centre - half);
    f.hi = Vec2(centre + half);
  }
  double near = box.near, far = box.far;
  if (!fit.pancake) {  // of all that lies in the new window
    Planes casters;
    addBox(casters, lo, hi, slack);
    addView(casters, lightView(f), slack);
    for (const DVec3& p : cornersOf(casters, tolerance)) near = std::min(near, glm::dot(p - light.origin, light.forward));
  }
  const double range = std::max({1.002 * (far - near), sceneRange / 1024.0, 1e-3 * (f.perspective ? far : extent)}), centre = 0.5 * (near + far);
  const Interval z = snappedInterval(centre - 0.5 * range, centre + 0.5 * range);
  f.near = float(std::max(z.lo, sceneNear));
  f.far = float(std::min(z.hi, sceneFar));
  if (!(f.far - f.near >= float(1e-4 * sceneRange))) {
    f.near = float(sceneNear);
    f.far = float(sceneFar);
  }
}

}  // namespace

double snappedSize(double v) {
  const double unit = std::ldexp(1.0, std::ilogb(v) - 3);
  return std::ceil(v / unit) * unit;
}

Interval snappedInterval(double a, double b) {
  const double size = snappedSize((b - a) * (8.0 / 7.0)), step = size / 8.0, lo = std::floor(a / step) * step;
  return {lo, lo + size};
}

void fitToCamera(LightFrames& frames, const CameraFit& fit, const Vec3& lo, const Vec3& hi, int resolution, int rimTexels) {
  if (!(lo.x <= hi.x && lo.y <= hi.y && lo.z <= hi.z)) return;
  for (int i = 0; i < frames.count; ++i) {
    LightFrame& f = frames.face[size_t(i)];
    if (!f.sees) continue;
    // What float coordinates can tell apart: the scene, and how far from it the light is.
    const double extent = std::max({glm::length(DVec3(hi) - DVec3(lo)), glm::length(DVec3(f.origin) - 0.5 * (DVec3(lo) + DVec3(hi))), 1e-6});
    fitFace(f, fit, lo, hi, extent, resolution, rimTexels + (frames.count > 1));
  }
}

}  // namespace filters
}  // namespace gobo
