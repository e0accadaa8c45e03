// SPDX-License-Identifier: Apache-2.0
// What the materials of a scene ask of a plan, from their factors (a texture only scales a factor) and the lowest texels of roughness
// textures. Pure function.
#pragma once

#include <string>
#include <vector>

#include "scene/scene.h"
#include "trace/reach.h"

namespace gobo {
inline namespace request {

struct MaterialKinds {
  bool extended = false;     ///< the surface term's planes do not hold every material
  bool translucent = false;  ///< some surface passes direct light from behind by a non-delta lobe
  bool volumes = false;      ///< some mesh bounds a volume
  bool scatters = false;     ///< some volume scatters
  bool unlit = false;
  bool lambert = true;  ///< no surface has a specular lobe
  bool clear = false;   ///< light passes some surface straight on (trace/straight.h): visibility is RGB
  /// Some delta lobe passes light on as Passage (trace/reach.h) has it. Boundaries of volumes in each other, which may change nothing,
  /// are not looked for: shadow rays pass them.
  bool boundary = false, pane = false, specular = false;
  bool occurs(Passage p) const { return p == Passage::Open || (p == Passage::Boundary ? boundary : p == Passage::Pane ? pane : specular); }
};
/// Materials that some instance uses.
MaterialKinds materialKinds(const Scene& scene);

/// Path classes that a unidirectional tracer cannot join in this scene, for certificates.
/// `caustics`: photons are traced for them too (trace/photon_tracer.h).
std::vector<std::string> classesNotCovered(const Scene& scene, bool caustics = false);

}  // namespace request
}  // namespace gobo
