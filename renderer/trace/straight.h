// SPDX-License-Identifier: Apache-2.0
// Light that goes straight on: what surfaces that bend nothing leave of a shadow ray, RGB. Such a surface is
//   a thin-walled smooth pane    (1 - F) base colour, textures and layers included (KHR_materials_transmission)
//   a boundary of index 1        base colour: index 1 against what is outside it, so matched indices inside each other too
//   a boundary inside volumes    that changes nothing by the rule of nested volumes (trace/interior.h)
// and between them volumes absorb (Beer-Lambert; of what scatters, all that is scattered is lost to the ray). Mirrors, glass that
// refracts, and rough panes block a shadow ray like any solid; masked and blended coverage is Accel's.
// One owner: shadow rays, the path tracer's own rays (for which such a pass is no event), photons and visibility terms agree.
#pragma once

#include "trace/surface.h"

namespace gobo {
inline namespace trace {

/// Boundaries that change nothing and reflections inside a scattering volume are no events of a path, but not endlessly so: meshes may
/// be broken.
inline constexpr int kMostFree = 1 << 12;

/// True if light may pass a surface of this material straight on in air, by its factors (textures only scale them).
bool maySendStraight(const Bsdf& bsdf);
/// Some instance has such a material: visibility is RGB. Reads facets Topology and Bsdf.
bool hasClearSurfaces(const Scene& scene);
/// Some instance has such a material, or bounds a volume that scatters (which asks for lights beyond its boundary): shadow rays have
/// to find out what is left of the light. Reads facets Topology and Bsdf; SurfaceTable::anyStraight says the same.
bool lightGoesStraight(const Scene& scene);

/// True if all channels meet the same index at the surface (false: dispersive, and its index is not 1).
inline bool bendsAlike(const SurfaceMaterial& m) { return !(m.dispersion > 0.0f) || std::fabs(m.constant.ior - 1.0f) < kStraightIor; }

/// What surface `s`, met by a ray of unit direction `d`, leaves of light that goes straight on: 0 where it blocks. Goes through its
/// boundary in `around`, the volumes in front of it. Equals the expected weight of what bsdfSample calls `straight`.
Vec3 straightThrough(const SurfaceTable& surfaces, const Surface& s, const Vec3& d, MediumStack& around);

/// What of the light from the ray's end arrives at its origin without a turn, per channel, 0..1. ray: unit direction, tmax 3e38 to
/// infinity; `around`: the volumes at its origin (null: none). Adds the rays traced to `rays`. Boundaries beyond kMostPasses block.
Vec3 transmittance(const Accel& accel, const SurfaceTable& surfaces, const Ray& ray, const MediumStack* around, uint64_t& rays);
/// The same for up to 16 rays side by side; around: one stack for each, or null.
void transmittance16(const Accel& accel, const SurfaceTable& surfaces, const Ray* rays, const MediumStack* around, int count, Vec3* out, uint64_t& traced);
/// What straight-through surfaces alone (maySendStraight) do to the light: every other one is passed as if it were not there. For
/// techniques that find the solid shadow in another way (shadow maps).
Vec3 tint(const Accel& accel, const SurfaceTable& surfaces, const Ray& ray, uint64_t& rays);

inline constexpr int kMostPasses = 1 << 12;  ///< meshes may be broken

}  // namespace trace
}  // namespace gobo
