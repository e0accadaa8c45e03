// SPDX-License-Identifier: Apache-2.0
// Internal to posing: animation samplers and the state of all nodes at a time. Pure functions; arithmetic in float64, because
// a chain of joints multiplies its rounding.
#pragma once

#include <glm/gtc/quaternion.hpp>
#include <vector>

#include "scene/rig.h"

namespace gobo {
inline namespace scene {

/// Value of a sampler at `time`, `width` numbers, clamped to its first and last key (glTF 2.0, 3.11 and appendix C).
/// `rotation`: width 4, spherical for Linear, normalised for CubicSpline. O(log keys).
void sampleAt(const RigSampler& sampler, double time, size_t width, bool rotation, double* out);

struct RigPose {
  std::vector<glm::dmat4> world;             ///< a node
  std::vector<std::vector<double>> weights;  ///< an entry of Rig::deformed
};
/// Nodes with the animations of `chosen` applied in order; none: the rest pose.
RigPose evaluatePose(const Rig& rig, const std::vector<const RigAnimation*>& chosen, double time);

/// Geometry of a deformed mesh in `pose`: morphed, then skinned; named and given the material of `like`. Sealed. Null if `stop`, polled
/// every few thousand vertices, fired first.
MeshPtr deformMesh(const Rig& rig, size_t deformed, const RigPose& pose, const Mesh& like, const StopToken& stop = {});

/// Unit axes of a transform, its scale dropped, right-handed. False when two axes coincide or one has no length.
bool rigidFrame(const Mat4& m, Mat4& out);

}  // namespace scene
}  // namespace gobo
