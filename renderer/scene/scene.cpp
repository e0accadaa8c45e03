// SPDX-License-Identifier: Apache-2.0
// What seal() makes (lights, camera) and the look-ups; checks are in scene_check.cpp, digests in scene_hash.cpp.
#include "scene/scene.h"

#include <limits>

#include "base/check.h"
#include "base/mapped_file.h"
#include "scene/coordinates.h"
#include "scene/texture_seal.h"

namespace gobo {
inline namespace scene {

Status Scene::seal() {
  for (size_t i = 0; i < instances.size(); ++i)
    if (instances[i].name.empty()) instances[i].name = "instance" + std::to_string(i);
  for (size_t i = 0; i < lights.size(); ++i)
    if (lights[i].name.empty()) lights[i].name = "light" + std::to_string(i);
  if (!isCoordinate(origin)) return invalidArgument("origin is not finite or beyond 1e9", name + "#/origin");
  GOBO_TRY(checkMeshes());
  GOBO_TRY(checkMaterials());
  GOBO_TRY(checkVariants());
  addLights();
  addCamera();
  GOBO_TRY(checkLights());
  GOBO_TRY(checkNames());
  computeDigests();
  return {};
}

void Scene::addLights() {
  std::vector<char> lit(instances.size(), 0);
  bool hasEnvironment = false;
  for (const Light& light : lights) {
    if (light.shape.kind == LightKind::Mesh && light.shape.instance < instances.size()) lit[light.shape.instance] = 1;
    if (light.shape.kind == LightKind::Environment) hasEnvironment = true;
  }
  for (size_t i = 0; i < instances.size(); ++i) {
    const Mesh& mesh = *meshes[instances[i].mesh];
    const Material& material = materials[mesh.material];
    if (lit[i] || !material.emits() || mesh.indices.empty()) continue;
    Light light;
    light.name = instances[i].name;
    light.shape.kind = LightKind::Mesh;
    light.shape.instance = uint32_t(i);
    light.power = material.emission.radiance;
    lights.push_back(std::move(light));
  }
  if (environment && !hasEnvironment) {
    Light light;
    light.name = "environment";
    light.shape.kind = LightKind::Environment;
    lights.push_back(std::move(light));
  }
}

void Scene::addCamera() {
  if (!cameras.empty()) return;
  Vec3 lo, hi;
  bounds(lo, hi);
  if (lo.x > hi.x) {
    lo = Vec3(-1.0f);
    hi = Vec3(1.0f);
  }
  Camera camera;
  // Halves first: corners near the largest float must not overflow.
  const Vec3 centre = lo * 0.5f + hi * 0.5f;
  const float radius = std::fmax(glm::length(hi * 0.5f - lo * 0.5f), 1e-3f);
  const Vec3 back = glm::normalize(Vec3(0.45f, 0.35f, 1.0f));
  const Vec3 right = glm::normalize(glm::cross(Vec3(0, 1, 0), back));
  const Vec3 up = glm::cross(back, right);
  const float distance = radius / std::sin(0.5f * camera.yfov);  // the bounding sphere touches the window's top and bottom
  const Vec3 position = glm::clamp(centre + back * distance, Vec3(-kLargestCoordinate), Vec3(kLargestCoordinate));
  camera.toWorld = Mat4(Vec4(right, 0), Vec4(up, 0), Vec4(back, 0), Vec4(position, 1));
  cameras.push_back(camera);
}

namespace {
template <typename Items>
int findByName(const Items& items, std::string_view name) {
  for (size_t i = 0; i < items.size(); ++i)
    if (items[i].name == name) return int(i);
  return -1;
}
}  // namespace

int Scene::findLight(std::string_view n) const { return findByName(lights, n); }
int Scene::findCamera(std::string_view n) const { return findByName(cameras, n); }
int Scene::findInstance(std::string_view n) const { return findByName(instances, n); }
int Scene::findMaterial(std::string_view n) const { return findByName(materials, n); }

size_t Scene::triangleCount() const {
  size_t count = 0;
  for (const Instance& instance : instances) count += meshes[instance.mesh]->triangles();
  return count;
}

size_t Scene::bytes() const {
  size_t total = instances.size() * sizeof(Instance) + materials.size() * sizeof(Material) + lights.size() * sizeof(Light);
  for (const MeshPtr& m : meshes)
    total += m->indices.size() * 4 + (m->positions.size() + m->normals.size()) * sizeof(Vec3) + (m->tangents.size() + m->colours.size()) * sizeof(Vec4);
  for (const MeshPtr& m : meshes)
    for (const Array<Vec2>& set : m->uv) total += set.size() * sizeof(Vec2);
  if (rig) total += rigBytes(*rig);
  TexelBytes texels;
  for (const auto& t : textures) total += texels.add(*t);
  for (const LightProfilePtr& p : profiles) total += profileBytes(*p);
  if (environment) total += environment->texels.size() * sizeof(Vec3);
  return total;
}

void Scene::bounds(Vec3& lo, Vec3& hi) const {
  constexpr float inf = std::numeric_limits<float>::infinity();
  lo = Vec3(inf);
  hi = Vec3(-inf);
  for (const Instance& instance : instances) {
    if (size_t(instance.mesh) >= checked_.size()) continue;
    const MeshCheck& box = checked_[instance.mesh];
    if (box.lo.x > box.hi.x) continue;
    for (int corner = 0; corner < 8; ++corner) {
      const Vec3 p(corner & 1 ? box.hi.x : box.lo.x, corner & 2 ? box.hi.y : box.lo.y, corner & 4 ? box.hi.z : box.lo.z);
      const Vec3 w(instance.toWorld * Vec4(p, 1));
      lo = glm::min(lo, w);
      hi = glm::max(hi, w);
    }
  }
}

const char* facetName(Facet single) {
  switch (single) {
    case Facet::None: return "none";
    case Facet::Topology: return "topology";
    case Facet::Pose: return "pose";
    case Facet::Shading: return "shading";
    case Facet::Coverage: return "coverage";
    case Facet::Albedo: return "albedo";
    case Facet::Bsdf: return "bsdf";
    case Facet::Emission: return "emission";
    case Facet::LightShape: return "light-shape";
    case Facet::LightPower: return "light-power";
    case Facet::Environment: return "environment";
    case Facet::Cameras: return "cameras";
    case Facet::All: return "all";
  }
  return "several";
}

uint64_t SceneView::mapping() const { return scene_->file ? scene_->file->id() : 0; }

void SceneView::require(Facet f) const {
  if (has(allowed_, f)) return;
  std::cerr << "CHECK failed: a node read a scene facet that it did not declare:";
  for (uint32_t bit = 1; bit < uint32_t(Facet::All); bit <<= 1)
    if (has(f, Facet(bit)) && !has(allowed_, Facet(bit))) std::cerr << " " << facetName(Facet(bit));
  std::cerr << std::endl;
  std::abort();
}

void SceneView::requireSeen() const {
  if (scene_->seesEnvironment(allowed_, *lights_)) return;
  std::cerr << "CHECK failed: a node read the environment, which is not in its light-shape subset" << std::endl;
  std::abort();
}

void SceneView::requireLight(int i) const {
  for (const int allowed : *lights_)
    if (allowed == i) return;
  const bool inRange = i >= 0 && size_t(i) < scene_->lights.size();
  std::cerr << "CHECK failed: a node read light " << i << " (" << (inRange ? scene_->lights[i].name : std::string("out of range"))
            << ") that is not in its light-shape/light-power subset" << std::endl;
  std::abort();
}

}  // namespace scene
}  // namespace gobo
