// SPDX-License-Identifier: Apache-2.0
// UnoccludedLight: what one light sends to a viewer by one scattering event at a point, if nothing is in the way; from the viewer's side of the surface, by
// non-delta lobes. The one implementation for the term of a light (direct_unoccluded.h, which says what is exact and what is sampled) and for sums over many.
// Radiance for power 1 (white), W m^-2 sr^-1, >= 0 unless a part of it overflows. Immutable; any thread. The sampler must outlive it.
// Cost: 20 ns (delta lights over Lambert) to `samples` times 0.3 us (glossy surfaces under lights of some size).
#pragma once

#include <span>
#include <vector>

#include "scene/camera.h"
#include "terms/direct_unoccluded.h"
#include "trace/bsdf.h"
#include "trace/interior.h"
#include "trace/light_sampling.h"

namespace gobo {
inline namespace terms {

/// A point of a surface, and who looks at it.
struct LitPoint {
  Vec3 p, n, ng, wo;  ///< world; n: shading normal on the viewer's side; ng: geometric one; wo: towards the viewer
  BsdfParams bsdf;
  bool extended = false, hasTangent = false;
  Vec3 tangent{0.0f};
  float dispersion = 0;
  bool lambert() const { return !extended && bsdf.metallic == 0 && bsdf.specular == 0 && bsdf.transmission == 0; }
  Frame frame() const { return hasTangent ? Frame(n, tangent) : Frame(n); }
  /// f cos, with the index of each channel where the material is dispersive.
  BsdfValue value(const Vec3& wo, const Vec3& wi) const {
    float pdf;
    return value(wo, wi, pdf);
  }
  /// With the density of BSDF samples.
  BsdfValue value(const Vec3& wo, const Vec3& wi, float& pdf) const { return dispersed(bsdfEvalPdf(bsdf, wo, wi, pdf), wo, wi); }
  /// The same for who has a view of the material.
  BsdfValue value(const BsdfView& view, const Vec3& wo, const Vec3& wi, float& pdf) const { return dispersed(view.evalPdf(wi, pdf), wo, wi); }
  /// And for who has the value by one index.
  BsdfValue dispersed(BsdfValue all, const Vec3& wo, const Vec3& wi) const {
    if (!(dispersion > 0.0f)) return all;
    BsdfParams p = bsdf;
    for (int c = 0; c < 3; ++c) {
      p.ior = dispersedIor(bsdf.ior, dispersion, c);
      const BsdfValue f = bsdfEval(p, wo, wi);
      all.diffuse[c] = f.diffuse[c];
      all.specular[c] = f.specular[c];
    }
    return all;
  }
};

inline Vec3 partOf(const BsdfValue& f, LobePart lobe) { return lobe == LobePart::Both ? f.sum() : lobe == LobePart::Diffuse ? f.diffuse : f.specular; }

class UnoccludedLight {
 public:
  /// `light`: its index in the scene, one of the sampler's subset, which may hold others. `samples`, `seed`: for what has no closed form.
  UnoccludedLight(const LightSampler& sampler, const LightShape& shape, int light, int samples, uint64_t seed)
      : sampler_(&sampler), shape_(shape), light_(light), samples_(samples), seed_(seed), facets_(sampler.facets(light, kMostFacets, twoSided_)) {}
  /// `element`: of the whole picture's view samples; decides the random numbers. 0 where the surface is a delta one (bsdfIsDelta).
  Vec3 at(const LitPoint& r, size_t element, LobePart lobe) const;
  /// Both lobes apart: at() of each.
  BsdfValue lobes(const LitPoint& r, size_t element) const;
  /// The same, exactly, for Lambert receivers of rectangles and balls whose visible part is the same by both normals, and of disks above both horizons.
  /// And of mesh lights with facets(). False: it is none of these.
  bool closedForm(const LitPoint& r, LobePart lobe, Vec3& value) const;
  /// Triangles of a mesh light that shines evenly and has few of them (kMostFacets); empty of others.
  std::span<const LightFacet> facets() const { return facets_; }
  /// A facet as a point has it: its corners from there.
  struct SeenFacet {
    DVec3 corners[3];
    bool crossed;  ///< by the geometric horizon
  };
  /// False: none of it shines there, as it is turned away or below a horizon; to 1e-5 of its distance, for a surface that shines is in its own.
  bool sees(const LitPoint& r, const LightFacet& facet, SeenFacet& out) const;
  static constexpr size_t kMostFacets = 32;

 private:
  bool sunlit(const LitPoint& r, Vec3& value) const;
  struct Seen;
  Vec3 sampled(const Seen& seen, size_t element, LobePart lobe) const;
  template <class Add>
  void drawn(const Seen& seen, size_t element, const Add& add) const;
  Vec3 distant(const Seen& seen, size_t element, LobePart lobes) const;

  const LightSampler* sampler_;
  LightShape shape_;
  int light_, samples_;
  uint64_t seed_;
  bool twoSided_ = false;
  std::vector<LightFacet> facets_;
};

}  // namespace terms
}  // namespace gobo
