// SPDX-License-Identifier: Apache-2.0
#include "terms/hit_packet.h"

#include <limits>

namespace gobo {
inline namespace terms {

namespace {

constexpr int kLanes = RayPacket::kLanes;

/// Attributes of the three vertices that each lane's hit lies between. Where one triangle fills the packet they are read once.
template <int kComponents, class Value>
void gather(const Value* values, const InstanceGeometry& g, const HitPacket& hits, float (&out)[3][kComponents][kLanes]) {
  uint32_t others = 0;
  for (int i = 0; i < kLanes; ++i) others |= hits.primitive[i] ^ hits.primitive[0];
  if (others == 0) {
    const uint32_t* tri = g.indices + 3 * size_t(hits.primitive[0]);
    for (int k = 0; k < 3; ++k)
      for (int c = 0; c < kComponents; ++c) {
        const float value = values[tri[k]][c];
        for (int i = 0; i < kLanes; ++i) out[k][c][i] = value;
      }
    return;
  }
  for (int i = 0; i < kLanes; ++i) {
    const uint32_t* tri = g.indices + 3 * size_t(hits.primitive[i]);
    for (int k = 0; k < 3; ++k)
      for (int c = 0; c < kComponents; ++c) out[k][c][i] = values[tri[k]][c];
  }
}

/// Sums from 0 up, as loops over a triangle's vertices have it.
template <int kComponents>
void interpolate(const float (&vertices)[3][kComponents][kLanes], const HitPacket& hits, float (&out)[kComponents][kLanes]) {
  for (int c = 0; c < kComponents; ++c)
    for (int i = 0; i < kLanes; ++i) {
      const float u = hits.u[i], v = hits.v[i], w = 1.0f - u - v;
      out[c][i] = ((0.0f + w * vertices[0][c][i]) + u * vertices[1][c][i]) + v * vertices[2][c][i];
    }
}

float dot(const float (&a)[3][kLanes], const float (&b)[3][kLanes], int i) { return a[0][i] * b[0][i] + a[1][i] * b[1][i] + a[2][i] * b[2][i]; }

}  // namespace

bool ofOneInstance(const HitPacket& hits) {
  uint32_t others = 0;
  for (int i = 0; i < kLanes; ++i) others |= hits.instance[i] ^ hits.instance[0];
  return others == 0 && hits.instance[0] != kNoHit;
}

void hitPositions(const InstanceGeometry& g, const RayPacket& rays, const HitPacket& hits, HitSurface& out) {
  alignas(64) float vertices[3][3][kLanes];
  gather<3>(g.positions, g, hits, vertices);
  interpolate<3>(vertices, hits, out.P);
  if (!g.world) {
    alignas(64) float p[3][kLanes];
    const Mat4& m = g.toWorld;
    for (int c = 0; c < 3; ++c)
      for (int i = 0; i < kLanes; ++i) p[c][i] = (m[0][c] * out.P[0][i] + m[1][c] * out.P[1][i]) + (m[2][c] * out.P[2][i] + m[3][c] * 1.0f);
    for (int c = 0; c < 3; ++c)
      for (int i = 0; i < kLanes; ++i) out.P[c][i] = p[c][i];
  }
  for (int i = 0; i < kLanes; ++i) {
    const float x = out.P[0][i] - rays.origin[0][i], y = out.P[1][i] - rays.origin[1][i], z = out.P[2][i] - rays.origin[2][i];
    out.depth[i] = std::sqrt(x * x + y * y + z * z);
  }
}

void hitShading(const InstanceGeometry& g, const Vec3* normals, const Vec2* uv, const RayPacket& rays, const HitPacket& hits, HitSurface& out) {
  for (int i = 0; i < kLanes; ++i) {
    const bool towards = dot(hits.Ng, rays.direction, i) < 0;
    for (int c = 0; c < 3; ++c) out.N[c][i] = out.Ng[c][i] = towards ? hits.Ng[c][i] : -hits.Ng[c][i];
  }
  if (normals) {
    alignas(64) float vertices[3][3][kLanes], own[3][kLanes];
    gather<3>(normals, g, hits, vertices);
    interpolate<3>(vertices, hits, own);
    const Mat3& m = g.normalToWorld;
    for (int i = 0; i < kLanes; ++i) {
      float n[3];
      for (int c = 0; c < 3; ++c) n[c] = m[0][c] * own[0][i] + m[1][c] * own[1][i] + m[2][c] * own[2][i];
      const float length = std::sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
      const bool usable = length > 1e-18f && length < std::numeric_limits<float>::infinity();
      for (int c = 0; c < 3; ++c) n[c] = usable ? n[c] / length : out.Ng[c][i];
      const bool inside = n[0] * out.Ng[0][i] + n[1] * out.Ng[1][i] + n[2] * out.Ng[2][i] < 0;
      for (int c = 0; c < 3; ++c) n[c] = inside ? -n[c] : n[c];
      const bool away = n[0] * rays.direction[0][i] + n[1] * rays.direction[1][i] + n[2] * rays.direction[2][i] >= 0;
      for (int c = 0; c < 3; ++c) out.N[c][i] = away ? out.Ng[c][i] : n[c];
    }
  }
  if (uv) {
    alignas(64) float vertices[3][2][kLanes];
    gather<2>(uv, g, hits, vertices);
    interpolate<2>(vertices, hits, out.uv);
    for (int c = 0; c < 2; ++c)
      for (int i = 0; i < kLanes; ++i) out.uv[c][i] = std::fabs(out.uv[c][i]) < std::numeric_limits<float>::infinity() ? out.uv[c][i] : 0.0f;
  } else {
    for (int c = 0; c < 2; ++c)
      for (int i = 0; i < kLanes; ++i) out.uv[c][i] = 0.0f;
  }
}

}  // namespace terms
}  // namespace gobo
