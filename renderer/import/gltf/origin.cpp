// SPDX-License-Identifier: Apache-2.0
#include "import/gltf/origin.h"

#include <algorithm>
#include <cmath>

#include "scene/coordinates.h"

namespace gobo::gltf {

namespace {
constexpr double kFar = 64.0;
double longest(const DVec3& v) { return std::max({std::fabs(v.x), std::fabs(v.y), std::fabs(v.z)}); }
}  // namespace

Box boxOf(const Mesh& mesh) {
  Vec3 lo(std::numeric_limits<float>::infinity()), hi(-std::numeric_limits<float>::infinity());
  for (const Vec3& p : mesh.positions) {
    lo = glm::min(lo, p);
    hi = glm::max(hi, p);
  }
  Box box;
  if (!mesh.positions.empty()) {
    box.add(DVec3(lo));
    box.add(DVec3(hi));
  }
  return box;
}

Box transformed(const Box& box, const DMat4& by) {
  Box out;
  if (box.empty()) return out;
  for (int k = 0; k < 8; ++k) out.add(DVec3(by * glm::dvec4(k & 1 ? box.hi.x : box.lo.x, k & 2 ? box.hi.y : box.lo.y, k & 4 ? box.hi.z : box.lo.z, 1.0)));
  return out;
}

DVec3 originFor(const Box& box) {
  if (box.empty()) return DVec3(0.0);
  const double size = longest(box.hi - box.lo);
  const DVec3 middle = 0.5 * (box.lo + box.hi);
  const double distance = longest(middle);
  if (!(size > 0.0) || !(distance > kFar * size) || !(distance <= double(kLargestCoordinate))) return DVec3(0.0);
  const double step = std::exp2(std::floor(std::log2(size)));
  return glm::round(middle / step) * step;
}

}  // namespace gobo::gltf
