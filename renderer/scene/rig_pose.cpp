// SPDX-License-Identifier: Apache-2.0
// Poses and variants as new scenes. What counts as moved is decided by comparing with the rest pose, so an edited instance
// that its animation does not move keeps its edit.
#include <algorithm>

#include "base/closest.h"
#include "scene/edit.h"
#include "scene/rig_sample.h"
#include "scene/scene.h"

namespace gobo {
inline namespace scene {
namespace {

/// Of unit length, also where its square is no float; not finite where it has no length.
Vec3 unitAxis(const Vec3& v) { return glm::dot(v, v) > 1e-30f ? glm::normalize(v) : Vec3(glm::normalize(DVec3(v))); }

void placeLight(const RigFollower& f, const Mat4& world, const Mat4& frame, LightShape& s) {
  s.position = Vec3(frame[3]);
  s.axis = -Vec3(frame[2]);
  const float x = glm::length(Vec3(world[0])), y = glm::length(Vec3(world[1]));
  if (s.kind == LightKind::Rect) {
    s.u = Vec3(frame[0]) * std::max(f.half.x * x, kLeastLampSize);
    s.v = Vec3(frame[1]) * std::max(f.half.y * y, kLeastLampSize);
  }
  if (hasProfile(s)) s.u = Vec3(frame[0]);
  if (s.kind == LightKind::Disk || s.kind == LightKind::Sphere) s.radius = std::max(f.radius * x, kLeastLampSize);
}

bool movable(LightKind k) { return k != LightKind::Mesh && k != LightKind::Environment; }

/// What differs between the poses goes into the scene; without `rest` everything does.
Status applyPose(const Rig& rig, const RigPose* rest, const RigPose& pose, Scene& scene, const StopToken& stop) {
  std::vector<char> moved(rig.nodes.size(), 1);
  if (rest)
    for (size_t i = 0; i < moved.size(); ++i) {
      const bool flat = glm::determinant(glm::dmat3(pose.world[i])) == 0.0;  // it may turn and have the same matrix
      moved[i] = Mat4(rest->world[i]) != Mat4(pose.world[i]) || (flat && rest->turn[i] != pose.turn[i]);
    }
  for (const RigFollower& f : rig.followers) {
    if (!moved[f.node]) continue;
    const Mat4 world(pose.world[f.node] * glm::dmat4(f.local));
    Mat4 frame;
    if (f.kind == RigKind::Instance) {
      solidTransform(world, scene.instances[f.object].toWorld);
      continue;
    }
    if (!rigidFrame(world, frame, Vec3(pose.facing[f.node]))) frame = turnedFrame(pose, f.node);  // scaled to nothing
    if (f.kind == RigKind::Camera) scene.cameras[f.object].toWorld = frame;
    else if (movable(scene.lights[f.object].shape.kind)) placeLight(f, world, frame, scene.lights[f.object].shape);
  }
  for (size_t i = 0; i < rig.deformed.size(); ++i) {
    const RigDeformed& d = rig.deformed[i];
    bool changed = !rest || rest->weights[i] != pose.weights[i];
    if (d.skin >= 0)
      for (const int32_t j : rig.skins[d.skin].joints) changed = changed || moved[j];
    if (!changed) continue;
    MeshPtr deformed = deformMesh(rig, i, pose, *scene.meshes[d.mesh], stop);
    if (!deformed) return Status(Code::Cancelled, "stopped");
    scene.meshes[d.mesh] = std::move(deformed);
  }
  return {};
}

template <typename Items, typename Name>
std::string listed(const Items& items, Name name) {
  std::vector<std::string> names;
  for (const auto& item : items) names.emplace_back(name(item));
  return someOf(names);
}

}  // namespace

bool solidTransform(const Mat4& m, Mat4& out) {
  const auto invertible = [](const Mat4& t) { return std::fabs(glm::determinant(Mat3(t))) > 0.0f; };
  const Mat4 given = m;  // `out` may be `m`
  out = given;
  if (invertible(out)) return true;
  int flat = 0;  // the axis beside the two that span the plane
  float longest = 0.0f, area = 0.0f;
  Vec3 normal(0.0f);
  for (int c = 0; c < 3; ++c) {
    longest = std::fmax(longest, glm::length(Vec3(given[c])));
    const Vec3 n = glm::cross(Vec3(given[(c + 1) % 3]), Vec3(given[(c + 2) % 3]));
    if (!(glm::length(n) > area)) continue;
    flat = c;
    area = glm::length(n);
    normal = n;
  }
  if (area > 0.0f) {
    out[flat] += Vec4(normal * (1e-8f * longest / area), 0.0f);
    if (invertible(out)) return true;
  }
  for (int c = 0; c < 3; ++c) {
    out[c] = Vec4(0.0f);
    out[c][c] = 1e-9f;
  }
  return false;
}

bool rigidFrame(const Mat4& m, Mat4& out, const Vec3& towards) {
  Vec3 z = unitAxis(Vec3(m[2]));
  if (!isFinite(z)) {
    z = unitAxis(glm::cross(unitAxis(Vec3(m[0])), unitAxis(Vec3(m[1]))));
    if (isFinite(z) && towards != Vec3(0.0f)) z = unitAxis(towards);  // that one may be its mirror image, or sheared
  }
  Vec3 x = unitAxis(glm::cross(Vec3(m[1]), z));
  if (!isFinite(x)) x = unitAxis(Vec3(m[0]) - glm::dot(Vec3(m[0]), z) * z);
  out = Mat4(Vec4(x, 0), Vec4(glm::cross(z, x), 0), Vec4(z, 0), m[3]);
  return isFinite(z) && isFinite(x);
}

Mat4 turnedFrame(const RigPose& pose, int node) {
  Mat4 frame(glm::mat4_cast(pose.turn[node]));
  frame[3] = Vec4(pose.world[node][3]);
  return frame;
}

Status applyRestPose(const Rig& rig, Scene& scene, const StopToken& stop) {
  const RigPose pose = evaluatePose(rig, {}, 0.0);
  return applyPose(rig, nullptr, pose, scene, stop);
}

Result<std::vector<const RigAnimation*>> chosenAnimations(const Scene& scene, std::string_view animation) {
  const Rig* rig = scene.rig.get();
  std::vector<const RigAnimation*> chosen;
  if (rig)
    for (const RigAnimation& a : rig->animations)
      if (animation == "*" || a.name == animation || (animation.empty() && chosen.empty())) chosen.push_back(&a);
  if (chosen.empty() && !animation.empty() && animation != "*")
    return notFound("no animation '" + std::string(animation) +
                    "' (has: " + (rig ? listed(rig->animations, [](const RigAnimation& a) { return a.name; }) : "none") + ")");
  return chosen;
}

Result<ScenePtr> posedScene(const ScenePtr& base, std::string_view animation, double time, const StopToken& stop) {
  GOBO_ASSIGN(const std::vector<const RigAnimation*> chosen, chosenAnimations(*base, animation));
  if (chosen.empty()) return base;
  if (!std::isfinite(time)) return invalidArgument("time is not finite");
  const Rig* rig = base->rig.get();
  const RigPose rest = evaluatePose(*rig, {}, 0.0), pose = evaluatePose(*rig, chosen, time);
  return editScene(*base, [&](Scene& scene) -> Status { return applyPose(*rig, &rest, pose, scene, stop); });
}

Result<ScenePtr> withVariant(const ScenePtr& base, std::string_view name) {
  if (name.empty()) return base;
  const auto& names = base->variants.names;
  const auto at = std::find(names.begin(), names.end(), name);
  if (at == names.end()) return notFound("no variant '" + std::string(name) + "' (has: " + listed(names, [](const std::string& n) { return n; }) + ")");
  return editScene(*base, [&](Scene& scene) -> Status {
    std::vector<char> changed(scene.meshes.size(), 0);
    for (const VariantUse& use : scene.variants.uses) {
      if (use.variant != int(at - names.begin()) || scene.meshes[use.mesh]->material == use.material) continue;
      auto mesh = std::make_shared<Mesh>(*scene.meshes[use.mesh]);
      mesh->material = use.material;
      scene.meshes[use.mesh] = std::move(mesh);
      changed[use.mesh] = 1;
    }
    // Lights of meshes whose material is another one now: seal() makes those that shine.
    std::erase_if(scene.lights, [&](const Light& l) { return l.shape.kind == LightKind::Mesh && changed[scene.instances[l.shape.instance].mesh]; });
    return {};
  });
}

}  // namespace scene
}  // namespace gobo
