// SPDX-License-Identifier: Apache-2.0
// BsdfLook: one look at a material from one viewer, for light from many directions: bsdfEval (bsdf.h) in vector registers, 8 directions at once, with what
// depends on material and viewer alone found once. Opaque isotropic materials without layers or film, whose gloss is no mirror; `facing` as in bsdfEval.
// Each lobe is a few constant colours times numbers, so that coloured lights are summed up without a look at the colours for each:
//   diffuse = albedo * diffuse,   specular = facets * facets + grazing * grazing + bounced * bounced     (colour of the class * number of Lobes)
// Error against bsdfEval: rounding, 1e-5 of a lobe's value at alpha 0.01, 1e-6 at 0.1 (both round the half vector; its test). Finite and >= 0 for unit
// directions. Cost: 100 ns to make, then 1 ns a direction for Lambert, 4 ns for glossy materials. Pure, any thread.
#pragma once

#include <cstddef>

#include "trace/bsdf.h"
#include "trace/bsdf_albedo.h"

namespace gobo {
inline namespace trace {

class BsdfLook {
 public:
  static constexpr size_t kMost = 64;  ///< directions at once
  struct alignas(32) Directions {
    float x[kMost], y[kMost], z[kMost];  ///< local: z along the shading normal; unit
  };
  /// f cos by its parts; all 0 for directions below the surface.
  struct alignas(32) Lobes {
    float diffuse[kMost], facets[kMost], grazing[kMost], bounced[kMost];
    /// How fast the glossy lobe changes with the direction: 1 / (c s)^2 per radian^2, c the cosine between viewer and half vector h, s^2 = sin^2 h +
    /// alpha^2 cos^2 h (GGX is s^-4, and s changes by no more than the half vector turns: 1 / 2c of what the direction does). Where `facing` tilts, with that
    /// of the mirrored lobe and 1 / cos^2 of its direction, which bends where it enters. 0 without such a lobe.
    float sharpness[kMost];
  };

  /// Whether the material is one of these.
  static bool covers(const BsdfParams& p);
  /// `p`: covered. wo: towards the viewer, local, unit.
  BsdfLook(const BsdfParams& p, const Vec3& wo);
  /// The first `count` <= kMost of `in`, rounded up to a multiple of 8 (what lies there is read).
  void at(const Directions& in, size_t count, Lobes& out) const;
  /// Only Lobes::diffuse is written.
  bool lambert() const { return lambert_; }
  float alpha2() const { return alpha2_; }  ///< of the glossy lobe; 1 without one

  Vec3 albedo{0.0f}, facets{0.0f}, grazing{0.0f}, bounced{0.0f};

 private:
  static constexpr int kNodes = ReflectionAlbedo::kNodes;
  Vec3 wo_, facing_;
  bool lambert_, tilted_, dark_ = false;
  float alpha2_ = 1, oz_ = 1, root_ = 1;                         // of the viewer: cosine, masking
  float stretch_ = 2, interface_[3] = {0, 0, 0};                 // of the albedo's tables; of the interface's albedo
  float diffuseScale_ = 0, facetScale_ = 0, bounceScale_ = 0;    // 0: no such lobe
  alignas(32) float deficit_[kNodes] = {}, extra_[kNodes] = {};  // bsdf_albedo.h, of this roughness
};

}  // namespace trace
}  // namespace gobo
