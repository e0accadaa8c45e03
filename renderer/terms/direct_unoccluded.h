// SPDX-License-Identifier: Apache-2.0
// Direct light of one light with visibility 1. Term type "direct_unoccluded", domain ViewSample, plane "L" (3): reflected
// radiance for nominal power (white * nominal scalar), one scattering event by a non-delta lobe, from the viewer's side of the
// surface. Light that comes through it from behind (diffuse or rough transmission) is left to the path tracer (planner.cpp).
// A rectangle at infinity (those fitted to environments) reaches the diffuse lobe from its centre and the others from all of it: a gloss that
// is narrower than the light would show one blinding point of it (by light and BSDF samples). A sun of some angular size reaches every lobe
// from all of its disk.
// Inputs: G-buffer, surface. Lambert surfaces have a closed form for point, spot, directional, rectangle (polygon form
// factor, Lambert 1760), disk and sphere lights, suns and mesh lights of few triangles; gloss under all these has quadrature where terms/light_list.h bounds
// its error; everything else is the mean over `samples` Owen-scrambled points (16 times as many where a light of some angular size at infinity lies in the
// highlight of a narrow lobe).
#pragma once

#include "terms/gbuffer.h"

namespace gobo {
inline namespace terms {

/// Which lobe of the scattering event counts. Both parts are found in the same way: they add up to the whole.
enum class LobePart : uint8_t { Both, Diffuse, Specular };

struct DirectUnoccludedSettings {
  GBufferSettings view;
  int light = 0;       ///< index into the scene's lights; the node's subset must be {light}
  Vec3 nominal{1.0f};  ///< power it is evaluated for
  int samples = 32;
  uint64_t seed = 0;
  bool extended = false;  ///< the scene has materials with more lobes than the surface term's planes hold: those are read again
  LobePart lobe = LobePart::Both;
  bool ruled = false;  ///< the light has rules of terms/light_list.h: to estimate time, not a part of the key
};
NodePtr makeDirectUnoccludedNode(const DirectUnoccludedSettings& settings);

/// Irradiance factor of a rectangle at p with normal n: integral of max(cos,0) d(omega) over the part of the rectangle above
/// the horizon, divided by pi (so that Lambert radiance = albedo * radiance * factor). In [0,1].
double rectFormFactor(const DVec3& p, const DVec3& n, const DVec3& corner, const DVec3& edgeU, const DVec3& edgeV);
/// The same of a triangle, its corners from the point.
double triangleFormFactor(const DVec3 (&corners)[3], const DVec3& n);
/// The same of a disk that lies above the receiver's horizon, all of it, and faces it. Exact (Naraghi 1988: the irradiance vector of a disk has a closed
/// form). axis: its unit normal, on the receiver's side.
double diskFormFactor(const DVec3& p, const DVec3& n, const DVec3& centre, const DVec3& axis, double radius);
/// The same of what a ball covers of the sky, up to 90 degrees: sine of its half angle, > 0; cosine of its centre to the normal.
double capFormFactor(double cosine, double sine);
/// The same for a sphere; -1 when p is inside.
double sphereFormFactor(const DVec3& p, const DVec3& n, const DVec3& centre, double radius);

}  // namespace terms
}  // namespace gobo
