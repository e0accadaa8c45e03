// SPDX-License-Identifier: Apache-2.0
#include <glm/gtc/matrix_transform.hpp>

#include "base/sobol.h"
#include "scene/builtin/build.h"

namespace gobo::builtin {

Mat4 translate(const Vec3& t) { return glm::translate(Mat4(1.0f), t); }
Mat4 scale(const Vec3& s) { return glm::scale(Mat4(1.0f), s); }
Mat4 rotate(const Vec3& axis, float radians) { return glm::rotate(Mat4(1.0f), radians, axis); }
Mat4 rotateY(float radians) { return rotate(Vec3(0, 1, 0), radians); }
Vec3 random3(uint64_t seed, uint64_t i) { return Vec3(toUnit(hash32(seed, 3 * i)), toUnit(hash32(seed, 3 * i + 1)), toUnit(hash32(seed, 3 * i + 2))); }

float noise(float u, float v, int cells, uint32_t seed) {
  const float x = (u - std::floor(u)) * cells, y = (v - std::floor(v)) * cells;
  const int x0 = int(x) % cells, y0 = int(y) % cells, x1 = (x0 + 1) % cells, y1 = (y0 + 1) % cells;
  auto at = [&](int i, int j) { return toUnit(hash32(seed, uint64_t(j) * 65536 + i)); };
  auto ease = [](float t) { return t * t * (3.0f - 2.0f * t); };
  const float a = ease(x - std::floor(x)), b = ease(y - std::floor(y));
  return glm::mix(glm::mix(at(x0, y0), at(x1, y0), a), glm::mix(at(x0, y1), at(x1, y1), a), b);
}

float fractalNoise(float u, float v, int cells, int octaves, uint32_t seed) {
  float sum = 0.0f, weight = 0.0f, amplitude = 1.0f;
  for (int o = 0; o < octaves; ++o, amplitude *= 0.5f, cells *= 2) {
    sum += amplitude * noise(u, v, cells, seed + o);
    weight += amplitude;
  }
  return sum / weight;
}

uint32_t MeshBuilder::vertex(const Vec3& p, const Vec3& n, const Vec2& uv) {
  mesh_.positions.push_back(p);
  mesh_.normals.push_back(n);
  mesh_.uv[0].push_back(uv);
  return uint32_t(mesh_.positions.size() - 1);
}

void MeshBuilder::triangle(uint32_t a, uint32_t b, uint32_t c) { mesh_.indices.insert(mesh_.indices.end(), {a, b, c}); }

void MeshBuilder::quad(const Vec3& corner, const Vec3& eu, const Vec3& ev, int nu, int nv, const Vec2& uvScale) {
  const Vec3 n = glm::normalize(glm::cross(eu, ev));
  const uint32_t first = uint32_t(mesh_.positions.size());
  for (int j = 0; j <= nv; ++j)
    for (int i = 0; i <= nu; ++i) {
      const float s = float(i) / nu, t = float(j) / nv;
      vertex(corner + eu * s + ev * t, n, Vec2(s, 1.0f - t) * uvScale);
    }
  for (int j = 0; j < nv; ++j)
    for (int i = 0; i < nu; ++i) {
      const uint32_t a = first + j * (nu + 1) + i, b = a + 1, c = b + nu + 1, d = a + nu + 1;
      triangle(a, b, c);
      triangle(a, c, d);
    }
}

void MeshBuilder::box(const Vec3& centre, const Vec3& half, const Mat4& frame, float uvPerMetre) {
  const Mat3 r(frame);
  for (int axis = 0; axis < 3; ++axis)
    for (float side : {-1.0f, 1.0f}) {
      Vec3 n(0.0f), u(0.0f), v(0.0f);
      n[axis] = side;
      u[(axis + 1) % 3] = side * half[(axis + 1) % 3];
      v[(axis + 2) % 3] = half[(axis + 2) % 3];
      const Vec3 middle = centre + r * (n * half[axis]);
      quad(middle - r * u - r * v, r * u * 2.0f, r * v * 2.0f, 1, 1, Vec2(glm::length(u), glm::length(v)) * 2.0f * uvPerMetre);
    }
}

void MeshBuilder::sphere(const Vec3& centre, float radius, int slices, int stacks) {
  const uint32_t first = uint32_t(mesh_.positions.size());
  for (int j = 0; j <= stacks; ++j)
    for (int i = 0; i <= slices; ++i) {
      const float polar = kPi * j / stacks, azimuth = 2.0f * kPi * (i % slices) / slices;
      const float s = j == 0 || j == stacks ? 0.0f : std::sin(polar);
      const Vec3 n(s * std::cos(azimuth), std::cos(polar), -s * std::sin(azimuth));
      vertex(centre + n * radius, n, Vec2(float(i) / slices, float(j) / stacks));
    }
  for (int j = 0; j < stacks; ++j)
    for (int i = 0; i < slices; ++i) {
      const uint32_t a = first + j * (slices + 1) + i, b = a + 1, c = a + slices + 1, d = c + 1;
      if (j > 0) triangle(a, c, b);  // pole rows are single triangles: no degenerate faces
      if (j + 1 < stacks) triangle(b, c, d);
    }
}

void MeshBuilder::lathe(const Vec3& base, const std::vector<Vec2>& profile, int slices, float uvPerMetre) {
  const uint32_t first = uint32_t(mesh_.positions.size());
  const int rows = int(profile.size());
  float along = 0.0f, widest = 0.0f;
  for (const Vec2& p : profile) widest = std::fmax(widest, p.x);
  const float around = std::fmax(1.0f, std::round(2.0f * kPi * widest * uvPerMetre));  // whole repeats: no seam
  for (int j = 0; j < rows; ++j) {
    if (j > 0) along += glm::length(profile[j] - profile[j - 1]);
    const Vec2 tangent = glm::normalize(profile[std::min(j + 1, rows - 1)] - profile[std::max(j - 1, 0)]);
    for (int i = 0; i <= slices; ++i) {
      const float azimuth = 2.0f * kPi * (i % slices) / slices, c = std::cos(azimuth), s = -std::sin(azimuth);
      vertex(base + Vec3(profile[j].x * c, profile[j].y, profile[j].x * s), glm::normalize(Vec3(tangent.y * c, -tangent.x, tangent.y * s)),
             Vec2(around * i / slices, -along * uvPerMetre));
    }
  }
  for (int j = 0; j + 1 < rows; ++j)
    for (int i = 0; i < slices; ++i) {
      const uint32_t a = first + j * (slices + 1) + i, b = a + 1, c = a + slices + 1, d = c + 1;
      triangle(a, b, d);
      triangle(a, d, c);
    }
}

void MeshBuilder::tube(const std::vector<Vec3>& path, const std::vector<float>& radii, int slices) {
  const uint32_t first = uint32_t(mesh_.positions.size());
  const int rows = int(path.size());
  Vec3 side = Frame(glm::normalize(path[1] - path[0])).x;
  for (int j = 0; j < rows; ++j) {
    // Parallel transport of the side vector: the tube does not twist where the path bends.
    const Vec3 t = glm::normalize(path[std::min(j + 1, rows - 1)] - path[std::max(j - 1, 0)]);
    side = glm::normalize(side - t * glm::dot(side, t));
    const Vec3 other = glm::cross(t, side);
    for (int i = 0; i <= slices; ++i) {
      const float a = 2.0f * kPi * (i % slices) / slices;
      const Vec3 n = side * std::cos(a) + other * std::sin(a);
      vertex(path[j] + n * radii[j], n, Vec2(float(i) / slices, float(j) / (rows - 1)));
    }
  }
  for (int j = 0; j + 1 < rows; ++j)
    for (int i = 0; i < slices; ++i) {
      const uint32_t a = first + j * (slices + 1) + i, b = a + 1, c = a + slices + 1, d = c + 1;
      triangle(a, b, d);
      if (radii[j + 1] > 0.0f) triangle(a, d, c);
    }
}

MeshPtr MeshBuilder::finish(std::string name, int material, bool smooth) {
  auto mesh = std::make_shared<Mesh>(std::move(mesh_));
  mesh_ = {};
  mesh->name = std::move(name);
  mesh->material = material;
  if (!smooth) mesh->normals.clear();
  sealMesh(*mesh);
  return mesh;
}

}  // namespace gobo::builtin
