// SPDX-License-Identifier: Apache-2.0
// Emissive triangles of one instance: an alias table over area x mean emission; of a few one-sided triangles only those that face the
// receiver (facing_triangles.h). Inside a triangle uniform in solid angle where the receiver is near (spherical_triangle.h), else over
// the area, with the density turned to solid angle. Memory: 64 bytes a triangle. Immutable; any thread may sample.
#pragma once

#include <memory>
#include <vector>

#include "base/stop.h"
#include "scene/scene.h"
#include "trace/alias_table.h"
#include "trace/area_lights.h"
#include "trace/facing_triangles.h"
#include "trace/light_facet.h"

namespace gobo {
inline namespace trace {

class MeshLight {
 public:
  /// `stop` is polled every few hundred triangles; a light whose making it ended is not to be used.
  MeshLight(const SceneView& view, uint32_t instance, const StopToken& stop = {});
  /// Radiance is the emission texture (white without one) x alpha coverage at the point: what a ray sees there on average.
  bool sample(const Vec3& p, const Vec2& u, AreaSample& out, Vec3& radiance) const;
  float pdf(const Vec3& p, const Vec3& direction, float t, uint32_t primitive) const;
  /// Emission texture at a point of a triangle, 0 behind a one-sided one. Coverage is not applied: the ray that hit has passed it.
  Vec3 emitted(const Vec3& direction, uint32_t primitive, float u, float v) const;
  double area() const { return area_; }
  /// A light of a few triangles that shine evenly, without texture or coverage: those that have an area, at most `most`. Empty else.
  std::vector<LightFacet> facets(size_t most) const;
  bool doubleSided() const { return coverage_.doubleSided; }

 private:
  struct Triangle {
    Vec3 p, e1, e2;     // world space
    Vec3 n;             // unit, by winding and the sign of the transform's determinant (glTF 3.7.4)
    float areaDensity;  // chance of the triangle over its area, 1/m^2
  };
  Vec3 texel(uint32_t primitive, float u, float v) const;
  float coverage(uint32_t primitive, float u, float v) const;
  Vec2 uv(const TextureRef& ref, uint32_t primitive, float u, float v) const;

  MeshView<Facet::Topology | Facet::Pose | Facet::Shading> mesh_;
  std::vector<std::shared_ptr<const void>> keep_;  // its arrays
  TextureRef emissionRef_;
  std::shared_ptr<const Texture> emission_, alpha_;
  Coverage coverage_;
  std::vector<Triangle> triangles_;
  AliasTable table_;
  FacingTriangles facing_;  // empty: by the table alone
  double area_ = 0;
};

}  // namespace trace
}  // namespace gobo
