// SPDX-License-Identifier: Apache-2.0
// Poses and variants as new scenes. What counts as moved is decided by comparing with the rest pose, so an edited instance
// that its animation does not move keeps its edit.
#include <algorithm>

#include "scene/edit.h"
#include "scene/rig_sample.h"
#include "scene/scene.h"

namespace gobo {
inline namespace scene {
namespace {

/// A transform that tracers can invert: an axis of no length becomes thin, and where several have none the object becomes a
/// speck, as a node scaled to nothing is hidden.
Mat4 solid(Mat4 m) {
  if (std::fabs(glm::determinant(Mat3(m))) > 0.0f) return m;
  int flat = -1, flats = 0;
  float longest = 0.0f;
  for (int c = 0; c < 3; ++c) {
    const float length = glm::length(Vec3(m[c]));
    longest = std::fmax(longest, length);
    if (!(length > 0.0f)) {
      flat = c;
      ++flats;
    }
  }
  const Vec3 n = flats == 1 ? glm::cross(Vec3(m[(flat + 1) % 3]), Vec3(m[(flat + 2) % 3])) : Vec3(0.0f);
  const float area = glm::length(n);
  if (area > 0.0f) {
    m[flat] = Vec4(n * (1e-6f * longest / area), 0.0f);
    if (std::fabs(glm::determinant(Mat3(m))) > 0.0f) return m;
  }
  for (int c = 0; c < 3; ++c) {
    m[c] = Vec4(0.0f);
    m[c][c] = 1e-9f;
  }
  return m;
}

void placeLight(const RigFollower& f, const Mat4& world, const Mat4& frame, LightShape& s) {
  s.position = Vec3(frame[3]);
  s.axis = -Vec3(frame[2]);
  const float x = glm::length(Vec3(world[0])), y = glm::length(Vec3(world[1]));
  if (s.kind == LightKind::Rect) {
    s.u = Vec3(frame[0]) * (f.half.x * x);
    s.v = Vec3(frame[1]) * (f.half.y * y);
  }
  if (hasProfile(s)) s.u = Vec3(frame[0]);
  if (s.kind == LightKind::Disk || s.kind == LightKind::Sphere) s.radius = f.radius * x;
}

bool movable(LightKind k) { return k != LightKind::Mesh && k != LightKind::Environment; }

/// What differs between the poses goes into the scene; without `rest` everything does.
Status applyPose(const Rig& rig, const RigPose* rest, const RigPose& pose, Scene& scene, const StopToken& stop) {
  std::vector<char> moved(rig.nodes.size(), 1);
  if (rest)
    for (size_t i = 0; i < moved.size(); ++i) moved[i] = Mat4(rest->world[i]) != Mat4(pose.world[i]);
  for (const RigFollower& f : rig.followers) {
    if (!moved[f.node]) continue;
    const Mat4 world(pose.world[f.node] * glm::dmat4(f.local));
    Mat4 frame;
    if (f.kind == RigKind::Instance) scene.instances[f.object].toWorld = solid(world);
    else if (!rigidFrame(world, frame)) continue;  // scaled to nothing: it stays where it was
    else if (f.kind == RigKind::Camera) scene.cameras[f.object].toWorld = frame;
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
  std::string out;
  for (const auto& item : items) {
    if (out.size() > 300) return out + ", ...";
    out += (out.empty() ? "" : ", ") + std::string(name(item));
  }
  return out.empty() ? "none" : out;
}

}  // namespace

bool rigidFrame(const Mat4& m, Mat4& out) {
  const Vec3 z = glm::normalize(Vec3(m[2])), x = glm::normalize(glm::cross(Vec3(m[1]), z));
  out = Mat4(Vec4(x, 0), Vec4(glm::cross(z, x), 0), Vec4(z, 0), m[3]);
  return isFinite(z) && isFinite(x);
}

Status applyRestPose(const Rig& rig, Scene& scene, const StopToken& stop) {
  const RigPose pose = evaluatePose(rig, {}, 0.0);
  return applyPose(rig, nullptr, pose, scene, stop);
}

Result<ScenePtr> posedScene(const ScenePtr& base, std::string_view animation, double time, const StopToken& stop) {
  const Rig* rig = base->rig.get();
  std::vector<const RigAnimation*> chosen;
  if (rig)
    for (const RigAnimation& a : rig->animations)
      if (animation == "*" || a.name == animation || (animation.empty() && chosen.empty())) chosen.push_back(&a);
  if (chosen.empty()) {
    if (animation.empty() || animation == "*") return base;
    return notFound("no animation '" + std::string(animation) +
                    "' (has: " + (rig ? listed(rig->animations, [](const RigAnimation& a) { return a.name; }) : "none") + ")");
  }
  if (!std::isfinite(time)) return invalidArgument("time is not finite");
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
