// SPDX-License-Identifier: Apache-2.0
#include "trace/mesh_light.h"

#include <algorithm>
#include <bit>

#include "base/check.h"
#include "base/sobol.h"
#include "trace/spherical_triangle.h"
#include "trace/texture_lookup.h"

namespace gobo {
inline namespace trace {
namespace {

/// Barycentrics of 16 points, the centres of a triangle's 4 x 4 subdivision: where mean emission is estimated.
constexpr int kProbes = 4;
/// Part of every textured triangle's weight that is the light's mean, because probes may miss a bright texel.
constexpr double kMeanShare = 0.1;
/// Below this cosine at the light the solid-angle density overflows.
constexpr double kEdgeOn = 1e-9;

template <typename T>
T interpolate(const Array<T>& values, const uint32_t* tri, float u, float v) {
  return values[tri[0]] * (1.0f - u - v) + values[tri[1]] * u + values[tri[2]] * v;
}

/// Uniform in the triangle with little distortion of the square (Heitz 2019).
Vec2 squareToTriangle(float x, float y) {
  if (y > x) {
    x *= 0.5f;
    y -= x;
  } else {
    y *= 0.5f;
    x -= y;
  }
  return Vec2(x, y);
}

}  // namespace

namespace {
const Instance& checkedInstance(const SceneView& view, uint32_t instance) {
  GOBO_CHECK_LT(size_t(instance), view.instances().size());
  return view.instances()[instance];
}
}  // namespace

MeshLight::MeshLight(const SceneView& view, uint32_t instance, const StopToken& stop)
    : mesh_(view.mesh<Facet::Topology | Facet::Pose | Facet::Shading>(checkedInstance(view, instance).mesh)), keep_(view.keepMeshes()) {
  const Instance& placed = view.instances()[instance];
  coverage_ = view.coverage(mesh_.material);
  emissionRef_ = view.emission(mesh_.material).texture;
  if (emissionRef_.valid()) emission_ = view.textures()[emissionRef_.texture];
  if (coverage_.texture.valid()) alpha_ = view.textures()[coverage_.texture.texture];

  const glm::dmat4 m(placed.toWorld);
  const double flip = glm::determinant(glm::dmat3(m)) < 0 ? -1.0 : 1.0;
  const size_t count = mesh_.triangles();
  triangles_.resize(count);
  std::vector<double> areas(count), mean(count, 1.0);
  double power = 0;
  for (size_t k = 0; k < count; ++k) {
    if (k % 512 == 0 && stop.stopRequested()) return;
    const uint32_t* tri = mesh_.indices.data() + 3 * k;
    DVec3 p[3];
    for (int c = 0; c < 3; ++c) p[c] = DVec3(m * glm::dvec4(DVec3(mesh_.positions[tri[c]]), 1.0));
    const DVec3 n = glm::cross(p[1] - p[0], p[2] - p[0]);
    const double length = glm::length(n);
    areas[k] = 0.5 * length;
    triangles_[k] = {Vec3(p[0]), Vec3(p[1] - p[0]), Vec3(p[2] - p[0]), length > 0 ? Vec3(n * (flip / length)) : Vec3(0, 0, 1), 0.0f};
    if (emission_) {
      double sum = 0;
      for (int i = 0; i < kProbes; ++i)
        for (int j = 0; j < 2 * (kProbes - i) - 1; ++j) {
          const float third = (j & 1) ? 2.0f / 3.0f : 1.0f / 3.0f;
          sum += luminance(texel(uint32_t(k), (float(i) + third) / kProbes, (float(j / 2) + third) / kProbes));
        }
      mean[k] = sum / (kProbes * kProbes);
    }
    area_ += areas[k];
    power += areas[k] * mean[k];
  }
  if (!(area_ > 0)) return;
  // A texture that looks black to every probe may still hold bright texels: then area alone decides.
  const double share = power > 0 ? kMeanShare * power / area_ : 1.0;
  std::vector<double> weights(count);
  double total = 0;
  for (size_t k = 0; k < count; ++k) total += weights[k] = areas[k] * (emission_ ? (1.0 - kMeanShare) * mean[k] + share : 1.0);
  for (size_t k = 0; k < count; ++k) triangles_[k].areaDensity = areas[k] > 0 ? float(weights[k] / (total * areas[k])) : 0.0f;
  table_ = AliasTable(weights);
  if (coverage_.doubleSided || count > FacingTriangles::kMost) return;
  for (size_t k = 0; k < count; ++k) facing_.add(triangles_[k].p, triangles_[k].n, areas[k] > 0 ? weights[k] / total : 0.0);
}

std::vector<LightFacet> MeshLight::facets(size_t most) const {
  std::vector<LightFacet> out;
  if (emission_ || coverage_.mode != AlphaMode::Opaque || triangles_.size() > most) return out;
  for (const Triangle& t : triangles_)
    if (t.areaDensity > 0.0f) out.push_back({t.p, t.e1, t.e2, t.n});
  return out;
}

Vec2 MeshLight::uv(const TextureRef& ref, uint32_t primitive, float u, float v) const {
  const Array<Vec2>& set = mesh_.uv[ref.texcoord];
  return transformUv(ref, set.empty() ? Vec2(0.0f) : interpolate(set, mesh_.indices.data() + 3 * size_t(primitive), u, v));
}

Vec3 MeshLight::texel(uint32_t primitive, float u, float v) const {
  return emission_ ? Vec3(emission_->sample(uv(emissionRef_, primitive, u, v))) : Vec3(1.0f);
}

float MeshLight::coverage(uint32_t primitive, float u, float v) const {
  if (coverage_.mode == AlphaMode::Opaque) return 1.0f;
  float a = coverage_.factor;
  if (!mesh_.colours.empty()) a *= interpolate(mesh_.colours, mesh_.indices.data() + 3 * size_t(primitive), u, v).w;
  if (alpha_) a *= alpha_->sample(uv(coverage_.texture, primitive, u, v)).w;
  return coverage_.mode == AlphaMode::Mask ? (a >= coverage_.cutoff ? 1.0f : 0.0f) : clamp01(a);
}

bool MeshLight::sample(const Vec3& p, const Vec2& u, AreaSample& out, Vec3& radiance) const {
  if (table_.empty()) return false;
  float x = u.x;
  const double mass = facing_.empty() ? 1.0 : facing_.mass(DVec3(p));
  if (!(mass > 0)) return false;
  const uint32_t primitive = facing_.empty() ? table_.sample(x) : facing_.pick(DVec3(p), mass, x);
  // What is left of u.x has lost log2(triangles) of its 24 bits: a hash of the pair fills the places that became empty.
  const float quantum = float(double(table_.size()) * 0x1p-24);
  x += quantum * toUnit(hash32(std::bit_cast<uint32_t>(u.x), std::bit_cast<uint32_t>(u.y)));
  x = x < 1.0f ? x : x - 1.0f;
  const Triangle& tri = triangles_[primitive];
  Vec2 b = squareToTriangle(clamp01(x), u.y);
  DVec3 d = DVec3(tri.p) - DVec3(p) + DVec3(tri.e1) * double(b.x) + DVec3(tri.e2) * double(b.y);
  double density = 0;  // over solid angle, of a near triangle
  if (nearTriangle(p, tri.p, tri.e1, tri.e2)) {
    const SphericalTriangle near(p, tri.p, tri.e1, tri.e2);
    if (near.valid()) {
      d = near.sample(clamp01(x), u.y, b);
      density = near.area() / near.solidAngle();
    }
  }
  const double d2 = glm::dot(d, d);
  if (!(d2 > 0)) return false;
  const double length = std::sqrt(d2), side = glm::dot(d, DVec3(tri.n)) / length;
  if (coverage_.doubleSided ? std::fabs(side) < kEdgeOn : side > -kEdgeOn) return false;
  out.direction = Vec3(d / length);
  out.distance = float(length);
  out.pdf = float(std::min(tri.areaDensity / mass * (density > 0 ? density : d2 / std::fabs(side)), 1e37));
  if (!(out.pdf > 0.0f && out.distance > 0.0f)) return false;
  radiance = texel(primitive, b.x, b.y) * coverage(primitive, b.x, b.y);
  return maxComponent(radiance) > 0.0f;
}

float MeshLight::pdf(const Vec3& p, const Vec3& direction, float t, uint32_t primitive) const {
  GOBO_CHECK_LT(size_t(primitive), triangles_.size());
  const Triangle& tri = triangles_[primitive];
  const double side = glm::dot(DVec3(direction), DVec3(tri.n));
  if (coverage_.doubleSided ? std::fabs(side) < kEdgeOn : side > -kEdgeOn) return 0.0f;
  if (!facing_.empty() && !facing_.faces(primitive, DVec3(p))) return 0.0f;
  const double mass = facing_.empty() ? 1.0 : facing_.mass(DVec3(p));
  if (nearTriangle(p, tri.p, tri.e1, tri.e2)) {
    const SphericalTriangle near(p, tri.p, tri.e1, tri.e2);
    if (near.valid()) return float(std::min(tri.areaDensity / mass * near.area() / near.solidAngle(), 1e37));
  }
  return float(std::min(tri.areaDensity / mass * double(t) * t / std::fabs(side), 1e37));
}

Vec3 MeshLight::emitted(const Vec3& direction, uint32_t primitive, float u, float v) const {
  GOBO_CHECK_LT(size_t(primitive), triangles_.size());
  if (!coverage_.doubleSided && glm::dot(direction, triangles_[primitive].n) > 0.0f) return Vec3(0.0f);
  return texel(primitive, u, v);
}

}  // namespace trace
}  // namespace gobo
