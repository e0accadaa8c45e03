// SPDX-License-Identifier: Apache-2.0
// An opaque isotropic material without layers, film or transmission (which are left out), seen from one direction, as a sum of kernels that depend on its
// roughness alone: what a table for a roughness holds of some light makes the light of every material of that roughness. With means of radiance over i,
//   M by D G / (4 cos o) of the microfacets          S by the same times (1 - cos)^5 about the half vector, of Schlick's Fresnel
//   B by deficit(i) cos i                            G by schlick(i) cos i (bsdf_albedo.h)                      E by cos i
//   specular   microfacets M + grazing S + bounced B          diffuse   diffuse (open E + deficit B + schlick G)
// is the integral of bsdfEval over that radiance, but for the error of the tabulated albedos, and for `facing` where the shading normal is not the
// triangle's. Of uniform light it is bsdfLobeAlbedos.
#pragma once

#include "trace/bsdf.h"

namespace gobo {
inline namespace trace {

struct LobeTerms {
  Vec3 diffuse{0.0f}, microfacets{0.0f}, grazing{0.0f}, bounced{0.0f};
  float open = 1, deficit = 0, schlick = 0;  ///< together 1; parts may be negative
};
/// `mu`: cosine of the viewer above the surface; nothing unless > 0. A mirror has no specular terms.
LobeTerms bsdfLobeTerms(const BsdfParams& p, float mu);

}  // namespace trace
}  // namespace gobo
