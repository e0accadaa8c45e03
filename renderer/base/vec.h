// SPDX-License-Identifier: Apache-2.0
// Vector types (GLM) and the few helpers that GLM lacks. Right-handed, +Y up, metres, radians.
// Colours are linear Rec.709 triples in a Vec3 (radiance W m^-2 sr^-1 unless a comment names another unit).
#pragma once

#define GLM_FORCE_EXPLICIT_CTOR
#include <cmath>
#include <glm/glm.hpp>

namespace gobo {
inline namespace base {

using Vec2 = glm::vec2;
using Vec3 = glm::vec3;
using Vec4 = glm::vec4;
using DVec3 = glm::dvec3;
using Mat3 = glm::mat3;
using DMat4 = glm::dmat4;
using Mat4 = glm::mat4;  ///< column-major, acts on column vectors: p' = M * vec4(p, 1)

inline constexpr float kPi = 3.14159265358979323846f;
inline constexpr float kInvPi = 0.31830988618379067154f;

/// Rec.709 luminance.
inline float luminance(const Vec3& c) { return 0.2126f * c.x + 0.7152f * c.y + 0.0722f * c.z; }
/// fmax and fmin (a NaN loses), inline: the library's are calls of 3 ns unless the compiler may ignore NaN.
inline float maxOf(float a, float b) { return a > b || b != b ? a : b; }
inline float minOf(float a, float b) { return a < b || b != b ? a : b; }
inline float maxComponent(const Vec3& c) { return maxOf(c.x, maxOf(c.y, c.z)); }
inline bool isFinite(const Vec3& v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }
inline float sqr(float x) { return x * x; }
inline float clamp01(float x) { return minOf(maxOf(x, 0.0f), 1.0f); }

/// Orthonormal tangent frame with z = n (Duff et al. 2017, branch-free but for the sign).
struct Frame {
  Vec3 x, y, z;
  explicit Frame(const Vec3& n) : z(n) {
    const float s = std::copysign(1.0f, n.z);
    const float a = -1.0f / (s + n.z), b = n.x * n.y * a;
    x = Vec3(1.0f + s * n.x * n.x * a, s * b, -s * n.x);
    y = Vec3(b, s + n.y * n.y * a, -n.y);
  }
  /// z = n, x along t as far as n allows (t must not be parallel to n).
  Frame(const Vec3& n, const Vec3& t) : z(n) {
    x = t - n * glm::dot(n, t);
    x *= 1.0f / std::sqrt(glm::dot(x, x));
    y = glm::cross(n, x);
  }
  Vec3 toWorld(const Vec3& v) const { return x * v.x + y * v.y + z * v.z; }
  Vec3 toLocal(const Vec3& v) const { return Vec3(glm::dot(v, x), glm::dot(v, y), glm::dot(v, z)); }
};

}  // namespace base
}  // namespace gobo
