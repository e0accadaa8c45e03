// SPDX-License-Identifier: Apache-2.0
// Points and lines as geometry: a path tracer has no pixels to draw them with. A point is a ball (icosahedron), a line a hexagonal tube
// with a tip at each end, so that strips close at their joints; both smooth, of a radius of kRadius of the primitive's own bounding
// diagonal (1 mm where that is 0), scaled by the node. Each takes colour and texture coordinates of its vertices. Normals of the file
// are left aside: they are of the curve, not of the tube. At most kMost a primitive.
#include "import/gltf/document.h"

namespace gobo::gltf {
namespace {

constexpr float kRadius = 1.0f / 500.0f, kPointRadius = 1e-3f;
constexpr size_t kMost = size_t(1) << 20;
constexpr int kSides = 6;

/// Unit ball of 12 corners and 20 faces, outside outwards.
struct Ball {
  Vec3 corner[12];
  uint32_t face[20][3];
  Ball() {
    const float g = 0.5f * (1.0f + std::sqrt(5.0f));
    int n = 0;
    for (float a : {-1.0f, 1.0f})
      for (float b : {-g, g})
        for (const Vec3& v : {Vec3(0, a, b), Vec3(a, b, 0), Vec3(b, 0, a)}) corner[n++] = glm::normalize(v);
    int faces = 0;
    for (uint32_t i = 0; i < 12; ++i)
      for (uint32_t j = i + 1; j < 12; ++j)
        for (uint32_t k = j + 1; k < 12; ++k) {
          const auto adjacent = [&](uint32_t a, uint32_t b) { return glm::dot(corner[a], corner[b]) > 0.4f; };  // 0.447 for neighbours, below 0 for others
          if (!adjacent(i, j) || !adjacent(j, k) || !adjacent(i, k)) continue;
          const bool outwards = glm::dot(glm::cross(corner[j] - corner[i], corner[k] - corner[i]), corner[i]) > 0.0f;
          face[faces][0] = i;
          face[faces][1] = outwards ? j : k;
          face[faces++][2] = outwards ? k : j;
        }
  }
};

/// The mesh that replaces vertices and order.
struct Builder {
  const Mesh& from;
  std::vector<Vec3> positions, normals;
  std::vector<uint32_t> indices, source;  ///< source: the vertex that a new one stands for

  explicit Builder(const Mesh& mesh) : from(mesh) {}
  uint32_t vertex(uint32_t of, const Vec3& offset, const Vec3& normal) {
    positions.push_back(from.positions[of] + offset);
    normals.push_back(normal);
    source.push_back(of);
    return uint32_t(positions.size() - 1);
  }
  void ball(uint32_t at, float radius) {
    static const Ball unit;
    const uint32_t first = uint32_t(positions.size());
    for (const Vec3& c : unit.corner) vertex(at, c * radius, c);
    for (const auto& f : unit.face)
      for (uint32_t i : f) indices.push_back(first + i);
  }
  void tube(uint32_t a, uint32_t b, float radius) {
    const Vec3 along = from.positions[b] - from.positions[a];
    const float length = glm::length(along);
    if (!(length > 0.0f) || !std::isfinite(length)) return;
    const Frame frame(along / length);
    const uint32_t first = uint32_t(positions.size());
    for (int k = 0; k < kSides; ++k) {
      const float phi = 2.0f * kPi * float(k) / float(kSides);
      const Vec3 out = frame.x * std::cos(phi) + frame.y * std::sin(phi);
      vertex(a, out * radius, out);
      vertex(b, out * radius, out);
    }
    const uint32_t start = vertex(a, -frame.z * radius, -frame.z), end = vertex(b, frame.z * radius, frame.z);
    for (uint32_t k = 0; k < kSides; ++k) {
      const uint32_t i = first + 2 * k, j = first + 2 * ((k + 1) % kSides);
      for (uint32_t v : {i, j, i + 1, j, j + 1, i + 1, start, j, i, end, i + 1, j + 1}) indices.push_back(v);
    }
  }
  template <typename T>
  void copy(const Array<T>& in, Array<T>& out) const {
    if (in.empty()) return;
    std::vector<T> values;
    values.reserve(source.size());
    for (uint32_t v : source) values.push_back(in[v]);
    out = std::move(values);
  }
};

}  // namespace

bool thicken(Document& d, const Cursor& primitive, int64_t mode, Mesh& mesh) {
  const Array<uint32_t>& order = std::as_const(mesh).indices;
  const size_t n = order.size(), elements = mode == 0 ? n : mode == 1 ? n / 2 : n < 2 ? 0 : mode == 2 ? n : n - 1;
  if (elements == 0) {
    d.warn(primitive.pointer, mode == 0 ? "primitive has no points" : "primitive has no lines");
    return false;
  }
  if (elements > kMost) {
    d.warn(primitive.pointer,
           std::to_string(elements) + (mode == 0 ? " points" : " lines") + " are more than the " + std::to_string(kMost) + " that are drawn; left out");
    return false;
  }
  if (!d.account(elements * 14 * (sizeof(Vec3) * 2 + sizeof(Vec4) + sizeof(Vec2) * kUvSets + 4) + elements * 24 * 12, primitive)) return false;
  Vec3 lo(3e38f), hi(-3e38f);
  for (size_t k = 0; k < n; ++k) {
    const Vec3& p = std::as_const(mesh).positions[order[k]];
    lo = glm::min(lo, p);
    hi = glm::max(hi, p);
  }
  const float diagonal = glm::length(hi - lo), radius = diagonal > 0.0f && std::isfinite(diagonal) ? kRadius * diagonal : kPointRadius;
  Builder b(mesh);
  if (mode == 0)
    for (size_t k = 0; k < n; ++k) b.ball(order[k], radius);
  if (mode == 1)
    for (size_t k = 0; k + 1 < n; k += 2) b.tube(order[k], order[k + 1], radius);
  if (mode == 2 || mode == 3)
    for (size_t k = 0; k + 1 < n; ++k) b.tube(order[k], order[k + 1], radius);
  if (mode == 2) b.tube(order[n - 1], order[0], radius);
  if (b.indices.empty()) {
    d.warn(primitive.pointer, "the primitive's lines have no length");
    return false;
  }
  Mesh made;
  made.name = mesh.name;
  made.material = mesh.material;
  for (int k = 0; k < kUvSets; ++k) b.copy(std::as_const(mesh).uv[k], made.uv[k]);
  b.copy(std::as_const(mesh).colours, made.colours);
  made.positions = std::move(b.positions);
  made.normals = std::move(b.normals);
  made.indices = std::move(b.indices);
  mesh = std::move(made);
  return true;
}

}  // namespace gobo::gltf
