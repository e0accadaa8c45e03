// SPDX-License-Identifier: Apache-2.0
// Morph targets and linear blend skinning. Sums in float64: a vertex far from the origin is a small difference of large
// products. About 60 ns a vertex with four influences.
#include "scene/rig_sample.h"
#include "scene/scene.h"

namespace gobo {
inline namespace scene {
namespace {

constexpr size_t kPoll = 4096;  // vertices between two looks at a stop token

/// base + sum of weight * displacement, in float64.
template <typename V>
Array<V> morphed(const Array<V>& base, const RigSource& source, const std::vector<double>& weights, const StopToken& stop,
                 const Array<V>& (*of)(const RigTarget&)) {
  bool any = false;
  for (size_t t = 0; t < source.targets.size(); ++t) any = any || (weights[t] != 0.0 && !of(source.targets[t]).empty());
  if (!any || base.empty()) return base;
  using D = glm::vec<V::length(), double>;
  std::vector<V> out(base.size());
  for (size_t i = 0; i < out.size(); ++i) {
    if (i % kPoll == 0 && stop.stopRequested()) return base;
    D sum(base[i]);
    for (size_t t = 0; t < source.targets.size(); ++t) {
      const Array<V>& delta = of(source.targets[t]);
      if (weights[t] != 0.0 && !delta.empty()) sum += weights[t] * D(delta[i]);
    }
    out[i] = V(sum);
  }
  return Array<V>(std::move(out));
}

/// Tangents move in x, y and z; their handedness stays.
Array<Vec4> morphedTangents(const Array<Vec4>& base, const RigSource& source, const std::vector<double>& weights, const StopToken& stop) {
  std::vector<Vec3> xyz(base.size());
  for (size_t i = 0; i < xyz.size(); ++i) xyz[i] = Vec3(base[i]);
  const Array<Vec3> moved =
      morphed<Vec3>(Array<Vec3>(std::move(xyz)), source, weights, stop, [](const RigTarget& t) -> const Array<Vec3>& { return t.tangents; });
  std::vector<Vec4> out(base.size());
  for (size_t i = 0; i < out.size(); ++i) out[i] = Vec4(moved[i], base[i].w);
  return Array<Vec4>(std::move(out));
}

/// Unit vector, or `otherwise` when there is none.
Vec3 unitOr(const glm::dvec3& v, const Vec3& otherwise) {
  const double length = glm::length(v);
  return length > 1e-30 && std::isfinite(length) ? Vec3(v / length) : otherwise;
}

void skin(const RigSource& source, const RigSkin& skin, const RigPose& pose, Mesh& mesh, const StopToken& stop) {
  std::vector<glm::dmat4> joint(skin.joints.size());
  for (size_t j = 0; j < joint.size(); ++j) joint[j] = pose.world[skin.joints[j]] * glm::dmat4(skin.inverseBind[j]);
  const size_t vertices = mesh.positions.size(), influences = size_t(source.influences);
  std::vector<Vec3> positions(vertices), normals(mesh.normals.size());
  std::vector<Vec4> tangents(mesh.tangents.size());
  const Mesh& from = mesh;
  for (size_t i = 0; i < vertices; ++i) {
    if (i % kPoll == 0 && stop.stopRequested()) return;
    glm::dmat4 m(0.0);
    for (size_t k = 0; k < influences; ++k) {
      const double w = source.weights[i * influences + k];
      if (w != 0.0) m += joint[source.joints[i * influences + k]] * w;
    }
    positions[i] = Vec3(m * glm::dvec4(glm::dvec3(from.positions[i]), 1.0));
    if (!normals.empty()) {
      // Cofactors turn normals where the blend scales or shears; the sign keeps outside outside where it mirrors.
      const glm::dvec3 a(m[0]), b(m[1]), c(m[2]), n(from.normals[i]), x = glm::cross(b, c);
      const glm::dvec3 turned = x * n.x + glm::cross(c, a) * n.y + glm::cross(a, b) * n.z;
      normals[i] = unitOr(glm::dot(a, x) < 0 ? -turned : turned, from.normals[i]);
    }
    if (!tangents.empty()) tangents[i] = Vec4(unitOr(glm::dmat3(m) * glm::dvec3(Vec3(from.tangents[i])), Vec3(from.tangents[i])), from.tangents[i].w);
  }
  mesh.positions = Array<Vec3>(std::move(positions));
  if (!normals.empty()) mesh.normals = Array<Vec3>(std::move(normals));
  if (!tangents.empty()) mesh.tangents = Array<Vec4>(std::move(tangents));
}

}  // namespace

MeshPtr deformMesh(const Rig& rig, size_t index, const RigPose& pose, const Mesh& like, const StopToken& stop) {
  const RigDeformed& d = rig.deformed[index];
  const RigSource& source = rig.sources[d.source];
  const std::vector<double>& w = pose.weights[index];
  auto mesh = std::make_shared<Mesh>(*rig.meshes[source.mesh]);  // arrays are shared until they change
  mesh->name = like.name;
  mesh->material = like.material;
  mesh->positions = morphed<Vec3>(mesh->positions, source, w, stop, [](const RigTarget& t) -> const Array<Vec3>& { return t.positions; });
  mesh->normals = morphed<Vec3>(mesh->normals, source, w, stop, [](const RigTarget& t) -> const Array<Vec3>& { return t.normals; });
  bool tangents = false, colours = false;
  for (size_t t = 0; t < source.targets.size(); ++t) {
    tangents = tangents || (w[t] != 0.0 && !source.targets[t].tangents.empty());
    colours = colours || (w[t] != 0.0 && !source.targets[t].colours.empty());
  }
  if (tangents) mesh->tangents = morphedTangents(mesh->tangents, source, w, stop);
  mesh->uv[0] = morphed<Vec2>(mesh->uv[0], source, w, stop, [](const RigTarget& t) -> const Array<Vec2>& { return t.uv[0]; });
  mesh->uv[1] = morphed<Vec2>(mesh->uv[1], source, w, stop, [](const RigTarget& t) -> const Array<Vec2>& { return t.uv[1]; });
  mesh->uv[2] = morphed<Vec2>(mesh->uv[2], source, w, stop, [](const RigTarget& t) -> const Array<Vec2>& { return t.uv[2]; });
  mesh->uv[3] = morphed<Vec2>(mesh->uv[3], source, w, stop, [](const RigTarget& t) -> const Array<Vec2>& { return t.uv[3]; });
  mesh->colours = morphed<Vec4>(mesh->colours, source, w, stop, [](const RigTarget& t) -> const Array<Vec4>& { return t.colours; });
  if (colours)
    for (Vec4& c : mesh->colours) c = glm::clamp(c, Vec4(0.0f), Vec4(1.0f));  // the format's rule for sums of colours
  if (d.skin >= 0) skin(source, rig.skins[d.skin], pose, *mesh, stop);
  if (stop.stopRequested()) return nullptr;
  const Array<Vec3>& rest = rig.meshes[source.mesh]->normals;
  if (d.skin < 0 && mesh->normals.size() == rest.size() && std::as_const(*mesh).normals.data() != rest.data())
    for (size_t i = 0; i < rest.size(); ++i) mesh->normals[i] = unitOr(glm::dvec3(mesh->normals[i]), rest[i]);
  if (d.skin < 0 && tangents)
    for (Vec4& t : mesh->tangents) {
      const Vec3 unit = unitOr(glm::dvec3(Vec3(t)), Vec3(1, 0, 0));
      t = Vec4(unit, t.w);
    }
  sealMesh(*mesh);
  return mesh;
}

}  // namespace scene
}  // namespace gobo
