// SPDX-License-Identifier: Apache-2.0
#include "filters/denoise/temporal/reprojection.h"

#include <algorithm>
#include <cmath>

namespace gobo::denoise {

namespace {

bool sameCamera(const Camera& a, const Camera& b) {
  return a.toWorld == b.toWorld && a.perspective == b.perspective && a.windowHeight64() == b.windowHeight64() && a.centre == b.centre &&
         a.optics.pixelAspect == b.optics.pixelAspect && a.optics.panorama == b.optics.panorama;
}

Vec3 vectorAt(std::span<const float> plane, size_t i) { return {plane[3 * i], plane[3 * i + 1], plane[3 * i + 2]}; }

}  // namespace

bool sameSurface(const SeenSurfaces& a, size_t p, const SeenSurfaces& b, size_t q, const SameSurface& by) {
  const bool hitP = a.coverage[p] > 0.0f, hitQ = b.coverage[q] > 0.0f;
  if (!hitP || !hitQ) return hitP == hitQ;
  if (!a.object.empty() && !b.object.empty() && !(a.object[p] == b.object[q])) return false;
  const Vec3 n = vectorAt(a.normal, p), m = vectorAt(b.normal, q), way = vectorAt(b.position, q) - vectorAt(a.position, p);
  const float lengthN = glm::length(n), lengthM = glm::length(m), width = std::max(a.footprint[p], b.footprint[q]);
  // Normals that cancel out span no plane: the whole distance counts then.
  if (std::min(lengthN, lengthM) < 1e-6f) return glm::length(way) <= by.planePixels * width;
  if (!(glm::dot(n, m) >= by.cosAngle * lengthN * lengthM)) return false;
  const float fromP = std::abs(glm::dot(n, way)) / lengthN, fromQ = std::abs(glm::dot(m, way)) / lengthM;
  return fromP <= by.planePixels * width && fromQ <= by.planePixels * width;
}

Reprojection::Reprojection(const Camera& now, const SeenSurfaces& seen, const Camera& before, const SeenSurfaces& seenBefore, const SameSurface& by)
    : now_(now), before_(before), seen_(seen), seenBefore_(seenBefore), by_(by), rests_(sameCamera(now, before)) {}

bool Reprojection::moved(size_t pixel, glm::dvec2& way) const {
  way = glm::dvec2(0.0);
  if (rests_) return true;
  glm::dvec2 from, to;
  if (seen_.coverage[pixel] > 0.0f) {
    const glm::dvec4 place(DVec3(vectorAt(seen_.position, pixel)), 1.0);
    if (!filmPosition(now_, seen_.width, seen_.height, place, from) || !filmPosition(before_, seen_.width, seen_.height, place, to)) return false;
  } else {
    from = glm::dvec2(double(pixel % size_t(seen_.width)) + 0.5, double(pixel / size_t(seen_.width)) + 0.5);
    const Ray ray = cameraRay(now_, seen_.width, seen_.height, float(from.x), float(from.y));
    if (!filmPosition(before_, seen_.width, seen_.height, glm::dvec4(DVec3(ray.direction), 0.0), to)) return false;
  }
  way = to - from;
  return true;
}

EarlierPixels Reprojection::of(size_t pixel) const {
  EarlierPixels found;
  glm::dvec2 way;
  if (!moved(pixel, way)) return found;
  const double u = double(pixel % size_t(seen_.width)) + way.x, v = double(pixel / size_t(seen_.width)) + way.y;
  if (!(u > -1.0 && v > -1.0 && u < double(seen_.width) && v < double(seen_.height))) return found;
  const int x = int(std::floor(u)), y = int(std::floor(v));
  const float right = float(u - x), down = float(v - y);
  for (int k = 0; k < 4; ++k) {
    const int px = x + (k & 1), py = y + (k >> 1);
    const float weight = (k & 1 ? right : 1.0f - right) * (k >> 1 ? down : 1.0f - down);
    if (!(weight > 0.0f) || px < 0 || py < 0 || px >= seen_.width || py >= seen_.height) continue;
    const size_t q = size_t(py) * size_t(seen_.width) + size_t(px);
    if (!sameSurface(seen_, pixel, seenBefore_, q, by_)) continue;
    found.at[found.count] = q;
    found.weight[found.count++] = weight;
  }
  return found;
}

}  // namespace gobo::denoise
