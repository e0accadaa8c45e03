// SPDX-License-Identifier: Apache-2.0
// Rig: what moves in a scene file. Node tree, skins, morph targets, animations, and which instances, cameras, lights and
// meshes hang on which node; and the material variants. Immutable and shared between scenes, null in scenes without
// animation. posedScene and withVariant make new sealed scenes that share everything that did not change.
// All fields of these structs are listed by visitFields: PODs, strings, Array<POD>, std::vector of such structs, and
// `meshes`, a vector of MeshPtr.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "base/array.h"
#include "base/hash.h"
#include "base/status.h"
#include "base/stop.h"
#include "base/vec.h"
#include "scene/fields.h"
#include "scene/material.h"

namespace gobo {
inline namespace scene {

struct Mesh;
struct Scene;
using MeshPtr = std::shared_ptr<const Mesh>;
using ScenePtr = std::shared_ptr<const Scene>;

/// A node's transform to its parent: translation * rotation * scale, or a matrix, which no animation may move.
struct RigNode {
  int parent = -1;         ///< index below this node's own, or -1
  bool fixed = false;      ///< `matrix` counts, the other three do not
  DVec3 translation{0.0};  ///< double, as the text of a file far from its origin has it
  Vec3 scale{1.0f};
  Vec4 rotation{0, 0, 0, 1};  ///< unit quaternion x y z w
  DMat4 matrix{1.0};
};

struct RigSkin {
  Array<int32_t> joints;    ///< nodes
  Array<Mat4> inverseBind;  ///< one a joint
};

/// Displacements of one morph target; an empty array leaves its attribute alone.
struct RigTarget {
  Array<Vec3> positions, normals, tangents;
  std::array<Array<Vec2>, kUvSets> uv;
  Array<Vec4> colours;
};

/// A primitive that deforms: its geometry before morphing and skinning.
struct RigSource {
  int mesh = 0;  ///< in Rig::meshes
  std::vector<RigTarget> targets;
  int influences = 0;      ///< joints a vertex (4 a set); 0: not skinned
  Array<uint16_t> joints;  ///< [vertex][influence], into RigSkin::joints
  Array<float> weights;    ///< [vertex][influence], sum 1 a vertex
};

/// One scene mesh that is made from a source: morphed by its node's weights, then skinned.
struct RigDeformed {
  int mesh = 0;  ///< in Scene::meshes
  int source = 0;
  int node = 0;          ///< whose weights count
  int skin = -1;         ///< -1: morphed only
  Array<float> weights;  ///< at rest, one a target
};

enum class RigKind : uint8_t { Instance, Camera, Light };
/// Something that follows a node: its transform is that of the node times `local`.
struct RigFollower {
  RigKind kind = RigKind::Instance;
  int object = 0;  ///< in Scene::instances, cameras or lights
  int node = 0;
  Mat4 local{1.0f};     ///< EXT_mesh_gpu_instancing
  Vec2 half{0.5f};      ///< rect lights: half sizes before the node's scale
  float radius = 0.5f;  ///< disk and sphere lights: before the node's scale
};

enum class RigPath : uint8_t { Translation, Rotation, Scale, Weights };
enum class RigInterpolation : uint8_t { Step, Linear, CubicSpline };
/// Key frames: times increase; a value is 3, 4 or the number of targets floats wide. CubicSpline holds in-tangent, value and
/// out-tangent a key.
struct RigSampler {
  RigInterpolation interpolation = RigInterpolation::Linear;
  Array<float> times, values;
};
struct RigChannel {
  int node = 0;
  RigPath path = RigPath::Translation;
  int sampler = 0;
};
struct RigAnimation {
  std::string name;                ///< unique
  float start = 0.0f, end = 0.0f;  ///< seconds: first and last key of all channels
  std::vector<RigSampler> samplers;
  std::vector<RigChannel> channels;
};

struct Rig {
  std::vector<RigNode> nodes;  ///< parents before children
  DVec3 origin{0.0};           ///< Scene::origin: taken from what has no parent
  std::vector<RigSkin> skins;
  std::vector<MeshPtr> meshes;  ///< geometry of the sources, undeformed; materials do not count
  std::vector<RigSource> sources;
  std::vector<RigDeformed> deformed;
  std::vector<RigFollower> followers;
  std::vector<RigAnimation> animations;
  Hash128 content;  ///< set by sealRig
};
using RigPtr = std::shared_ptr<const Rig>;

/// KHR_materials_variants: scene mesh `mesh` has `material` when `variant` is chosen.
struct VariantUse {
  int variant = 0, mesh = 0, material = 0;
};
struct Variants {
  std::vector<std::string> names;
  std::vector<VariantUse> uses;
};

/// Checks every index and size against `scene` (InvalidArgument that names the field), then fills `content`.
Status sealRig(Rig& rig, const Scene& scene);
size_t rigBytes(const Rig& rig);

/// What posedScene takes a name for: all that it chooses, none where there are none and none is named. Errors: NotFound that lists the names.
Result<std::vector<const RigAnimation*>> chosenAnimations(const Scene& scene, std::string_view animation);
/// The scene at `time` seconds of an animation: "" = the first, "*" = all at once (a later one wins where two move the same
/// thing). Time is clamped to each channel's keys. Nodes that no channel of it moves stay as the rest pose has them, and
/// what stays is shared: unchanged meshes keep their MeshPtr. A scene without animations is returned as it is when no name
/// is given. Errors: NotFound that lists the names. O(vertices of the meshes that deform) + O(nodes).
/// Cancelled soon after `stop`.
Result<ScenePtr> posedScene(const ScenePtr& base, std::string_view animation, double time, const StopToken& stop = {});
/// The scene with the materials of a variant; "" = the scene as it is. Errors: NotFound that lists the names.
Result<ScenePtr> withVariant(const ScenePtr& base, std::string_view variant);

/// Sets every follower and deformed mesh of `scene` to the rig's rest pose (the loader's last step before seal).
/// Errors: Cancelled; the scene is of no use then.
Status applyRestPose(const Rig& rig, Scene& scene, const StopToken& stop = {});

template <Same<RigNode> S, typename V>
void visitFields(S& s, V&& v) {
  v("parent", s.parent);
  v("fixed", s.fixed);
  v("translation", s.translation);
  v("scale", s.scale);
  v("rotation", s.rotation);
  v("matrix", s.matrix);
}
template <Same<RigSkin> S, typename V>
void visitFields(S& s, V&& v) {
  v("joints", s.joints);
  v("inverseBind", s.inverseBind);
}
template <Same<RigTarget> S, typename V>
void visitFields(S& s, V&& v) {
  v("positions", s.positions);
  v("normals", s.normals);
  v("tangents", s.tangents);
  for (auto& set : s.uv) v("uv", set);
  v("colours", s.colours);
}
template <Same<RigSource> S, typename V>
void visitFields(S& s, V&& v) {
  v("mesh", s.mesh);
  v("targets", s.targets);
  v("influences", s.influences);
  v("joints", s.joints);
  v("weights", s.weights);
}
template <Same<RigDeformed> S, typename V>
void visitFields(S& s, V&& v) {
  v("mesh", s.mesh);
  v("source", s.source);
  v("node", s.node);
  v("skin", s.skin);
  v("weights", s.weights);
}
template <Same<RigFollower> S, typename V>
void visitFields(S& s, V&& v) {
  v("kind", s.kind);
  v("object", s.object);
  v("node", s.node);
  v("local", s.local);
  v("half", s.half);
  v("radius", s.radius);
}
template <Same<RigSampler> S, typename V>
void visitFields(S& s, V&& v) {
  v("interpolation", s.interpolation);
  v("times", s.times);
  v("values", s.values);
}
template <Same<RigChannel> S, typename V>
void visitFields(S& s, V&& v) {
  v("node", s.node);
  v("path", s.path);
  v("sampler", s.sampler);
}
template <Same<RigAnimation> S, typename V>
void visitFields(S& s, V&& v) {
  v("name", s.name);
  v("start", s.start);
  v("end", s.end);
  v("samplers", s.samplers);
  v("channels", s.channels);
}
/// Without `content`.
template <Same<Rig> S, typename V>
void visitFields(S& s, V&& v) {
  v("nodes", s.nodes);
  v("origin", s.origin);
  v("skins", s.skins);
  v("meshes", s.meshes);
  v("sources", s.sources);
  v("deformed", s.deformed);
  v("followers", s.followers);
  v("animations", s.animations);
}
template <Same<VariantUse> S, typename V>
void visitFields(S& s, V&& v) {
  v("variant", s.variant);
  v("mesh", s.mesh);
  v("material", s.material);
}
template <Same<Variants> S, typename V>
void visitFields(S& s, V&& v) {
  v("names", s.names);
  v("uses", s.uses);
}

}  // namespace scene
}  // namespace gobo
