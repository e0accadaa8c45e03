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
  std::vector<glm::dquat> turn;              ///< a node: the rotations down to it alone, which a scale of 0 leaves
  std::vector<glm::dvec3> facing;            ///< a node: its z axis, of some length even where its own scale leaves none
  std::vector<std::vector<double>> weights;  ///< an entry of Rig::deformed
};
/// Nodes with the animations of `chosen` applied in order; none: the rest pose.
RigPose evaluatePose(const Rig& rig, const std::vector<const RigAnimation*>& chosen, double time);

/// Geometry of a deformed mesh in `pose`: morphed, then skinned; named and given the material of `like`. Sealed. Null if `stop`, polled
/// every few thousand vertices, fired first.
MeshPtr deformMesh(const Rig& rig, size_t deformed, const RigPose& pose, const Mesh& like, const StopToken& stop = {});

/// Unit axes of a transform, its scale dropped, right-handed; a z axis of no length is `towards`, any other that has none follows from
/// the two others. False when the axes span less than a plane.
bool rigidFrame(const Mat4& m, Mat4& out, const Vec3& towards = Vec3(0.0f));
/// Where rigidFrame has none: the node's place, turned as its and its parents' rotations say.
Mat4 turnedFrame(const RigPose& pose, int node);
/// A transform that tracers can invert: one that flattens becomes thin. False where it makes a line or a point, which `out` hides as a speck.
bool solidTransform(const Mat4& m, Mat4& out);

/// Half sides and radii of lamps, metres: not less, however small their node is scaled, so that the light of a given radiance goes to nothing
/// with its area. Half of the narrowest side that a file may give.
inline constexpr float kLeastLampSize = 5e-10f;

}  // namespace scene
}  // namespace gobo
