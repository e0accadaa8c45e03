// SPDX-License-Identifier: Apache-2.0
// The checks of Scene::seal(): after them every index in a scene is in range, every number that geometry, lights and cameras use is
// finite and every coordinate within kLargestCoordinate, so that sources need no checks of their own.
#include <algorithm>
#include <limits>
#include <sstream>
#include <unordered_set>

#include "base/check.h"
#include "scene/coordinates.h"
#include "scene/fields.h"
#include "scene/scene.h"

namespace gobo {
inline namespace scene {
namespace {

bool finite(const Vec2& v) { return std::isfinite(v.x) && std::isfinite(v.y); }
constexpr const char* kBeyond = " is not finite or beyond 1e9";  // kLargestCoordinate

Status fail(const Scene& scene, const std::string& list, size_t index, const std::string& name, const std::string& field, const std::string& message) {
  return invalidArgument((name.empty() ? std::string() : "\"" + name + "\": ") + message,
                         scene.name + "#/" + list + "/" + std::to_string(index) + (field.empty() ? "" : "/" + field));
}

std::string text(const Vec3& v) {
  std::ostringstream s;
  s << "(" << v.x << ", " << v.y << ", " << v.z << ")";
  return s.str();
}

template <typename T>
bool sizeFits(const Array<T>& values, size_t vertices) {
  return values.empty() || values.size() == vertices;
}

}  // namespace

Status Scene::checkMeshes() {
  std::vector<MeshCheck> checked;
  checked.reserve(meshes.size());
  for (size_t i = 0; i < meshes.size(); ++i) {
    if (!meshes[i]) return fail(*this, "meshes", i, "", "", "mesh is null");
    const Mesh& mesh = *meshes[i];
    if (mesh.material < 0 || size_t(mesh.material) >= materials.size())
      return fail(*this, "meshes", i, mesh.name, "material",
                  "material " + std::to_string(mesh.material) + " of " + std::to_string(materials.size()) + " is out of range");
    if (i < checked_.size() && checked_[i].mesh == meshes[i]) {  // meshes are immutable: walked once is walked for good
      checked.push_back(checked_[i]);
      continue;
    }
    GOBO_CHECK(!mesh.topologyHash.isZero());  // sealMesh was not called
    if (mesh.indices.size() % 3 != 0)
      return fail(*this, "meshes", i, mesh.name, "indices", std::to_string(mesh.indices.size()) + " indices are not whole triangles");
    const size_t n = mesh.positions.size();
    for (size_t k = 0; k < mesh.indices.size(); ++k)
      if (mesh.indices[k] >= n)
        return fail(*this, "meshes", i, mesh.name, "indices/" + std::to_string(k),
                    "index " + std::to_string(mesh.indices[k]) + " of " + std::to_string(n) + " vertices is out of range");
    if (!sizeFits(mesh.normals, n) || !sizeFits(mesh.tangents, n) || !sizeFits(mesh.colours, n) ||
        !std::all_of(mesh.uv.begin(), mesh.uv.end(), [&](const Array<Vec2>& set) { return sizeFits(set, n); }))
      return fail(*this, "meshes", i, mesh.name, "", "vertex arrays of different lengths");
    constexpr float inf = std::numeric_limits<float>::infinity();
    MeshCheck box{meshes[i], Vec3(inf), Vec3(-inf)};
    for (size_t k = 0; k < n; ++k) {
      if (!isCoordinate(mesh.positions[k]))
        return fail(*this, "meshes", i, mesh.name, "positions/" + std::to_string(k), "position " + text(mesh.positions[k]) + kBeyond);
      box.lo = glm::min(box.lo, mesh.positions[k]);
      box.hi = glm::max(box.hi, mesh.positions[k]);
    }
    checked.push_back(std::move(box));
  }
  for (size_t i = 0; i < instances.size(); ++i) {
    const Instance& instance = instances[i];
    if (instance.mesh < 0 || size_t(instance.mesh) >= meshes.size())
      return fail(*this, "instances", i, instance.name, "mesh",
                  "mesh " + std::to_string(instance.mesh) + " of " + std::to_string(meshes.size()) + " is out of range");
    if (!isCoordinate(instance.toWorld)) return fail(*this, "instances", i, instance.name, "toWorld", std::string("transform") + kBeyond);
  }
  checked_ = std::move(checked);
  Vec3 lo, hi;
  bounds(lo, hi);
  if (lo.x <= hi.x && !(isCoordinate(lo) && isCoordinate(hi)))
    return invalidArgument("transformed positions from " + text(lo) + " to " + text(hi) + " go beyond 1e9", name + "#/instances");
  return {};
}

Status Scene::checkMaterials() const {
  for (size_t i = 0; i < textures.size(); ++i) {
    if (!textures[i]) return fail(*this, "textures", i, "", "", "texture is null");
    GOBO_CHECK(!textures[i]->content.isZero());  // sealTexture was not called
  }
  for (size_t i = 0; i < materials.size(); ++i) {
    const Material& m = materials[i];
    Status status;
    const auto check = [&](const std::string& field, const auto& value) {
      using Field = std::remove_cvref_t<decltype(value)>;
      if constexpr (std::is_same_v<Field, TextureRef>) {
        if (value.texture >= int(textures.size()))
          status = fail(*this, "materials", i, m.name, field,
                        "texture " + std::to_string(value.texture) + " of " + std::to_string(textures.size()) + " is out of range");
        if (value.valid() && (value.texcoord < 0 || value.texcoord >= kUvSets))
          status = fail(*this, "materials", i, m.name, field, "texcoord " + std::to_string(value.texcoord) + " is not 0.." + std::to_string(kUvSets - 1));
        if (!finite(value.offset) || !finite(value.scale) || !std::isfinite(value.rotation))
          status = fail(*this, "materials", i, m.name, field, "texture transform is not finite");
      } else if constexpr (std::is_same_v<Field, Vec3>) {
        if (!isFinite(value)) status = fail(*this, "materials", i, m.name, field, "a factor is not finite");
      } else if constexpr (std::is_same_v<Field, float>) {
        if (!std::isfinite(value)) status = fail(*this, "materials", i, m.name, field, "a factor is not finite");
      }
    };
    visitFields(m, [&](const std::string& facet, const auto& group) {
      visitFields(group, [&](const char* name, const auto& value) {
        if (status.ok()) check(facet + "/" + name, value);
      });
    });
    if (!status.ok()) return status;
    if (!(m.bsdf.ior > 0.0f)) return fail(*this, "materials", i, m.name, "bsdf/ior", "ior " + std::to_string(m.bsdf.ior) + " is not positive");
  }
  return {};
}

Status Scene::checkLights() const {
  for (size_t i = 0; i < profiles.size(); ++i) {
    if (!profiles[i]) return fail(*this, "profiles", i, "", "", "profile is null");
    if (const Status shape = checkProfileShape(*profiles[i]); !shape.ok()) return fail(*this, "profiles", i, profiles[i]->name, "", shape.message());
  }
  int environments = 0;
  for (size_t i = 0; i < lights.size(); ++i) {
    const Light& light = lights[i];
    const LightShape& s = light.shape;
    if (!isFinite(light.power) || light.power.x < 0 || light.power.y < 0 || light.power.z < 0)
      return fail(*this, "lights", i, light.name, "power", "power is not finite and >= 0");
    if (!isFinite(light.color) || light.color.x < 0 || light.color.y < 0 || light.color.z < 0 || !std::isfinite(light.intensity))
      return fail(*this, "lights", i, light.name, "color", "color and intensity are not finite and >= 0");
    if (!isCoordinate(s.position)) return fail(*this, "lights", i, light.name, "shape/position", "position " + text(s.position) + kBeyond);
    if (!isCoordinate(s.u) || !isCoordinate(s.v) || !isCoordinate(s.radius))
      return fail(*this, "lights", i, light.name, "shape", std::string("size") + kBeyond);
    if (!isFinite(s.axis) || !std::isfinite(s.cosInner) || !std::isfinite(s.cosOuter) || !std::isfinite(s.range))
      return fail(*this, "lights", i, light.name, "shape", "a number is not finite");
    const bool aimed = s.kind == LightKind::Spot || s.kind == LightKind::Directional || s.kind == LightKind::Rect || s.kind == LightKind::Disk;
    if (aimed && std::fabs(glm::length(s.axis) - 1.0f) > 1e-3f) return fail(*this, "lights", i, light.name, "shape/axis", "axis is not of unit length");
    if ((s.kind == LightKind::Disk || s.kind == LightKind::Sphere) && !(s.radius > 0.0f))
      return fail(*this, "lights", i, light.name, "shape/radius", "radius " + std::to_string(s.radius) + " is not positive");
    if (s.kind == LightKind::Rect) {
      const Vec3 n = glm::cross(s.u, s.v);
      const float area = glm::length(n);
      if (!(area > 0.0f)) return fail(*this, "lights", i, light.name, "shape/u", "rectangle has no area");
      if (std::fabs(glm::dot(s.u, s.v)) > 1e-3f * glm::length(s.u) * glm::length(s.v))
        return fail(*this, "lights", i, light.name, "shape/v", "u and v are not perpendicular");
      if (std::fabs(glm::dot(n, s.axis)) < 0.999f * area) return fail(*this, "lights", i, light.name, "shape/axis", "axis is not along cross(u, v)");
    }
    if (!isCoordinate(s.angularSize) || !isCoordinate(s.skyRectangle))
      return fail(*this, "lights", i, light.name, "shape", std::string("angular size") + kBeyond);
    if (s.kind == LightKind::Directional && s.angularSize != 0.0f && !(s.angularSize >= kLeastAngularSize && s.angularSize <= 0.5f * kPi))
      return fail(*this, "lights", i, light.name, "shape/angularSize",
                  "angular size " + std::to_string(s.angularSize) + " is neither 0 nor within 1.7e-6 .. pi/2 radians");
    if (s.kind == LightKind::Directional && !(s.skyRectangle == Vec2(0.0f) || (s.angularSize == 0.0f && s.skyRectangle.x > 0.0f && s.skyRectangle.y > 0.0f)))
      return fail(*this, "lights", i, light.name, "shape/skyRectangle", "a rectangle at infinity has two sides above 0 and is no disk");
    if (s.kind == LightKind::Spot && !(s.cosInner >= s.cosOuter && s.cosOuter >= -1.0f && s.cosInner <= 1.0f))
      return fail(*this, "lights", i, light.name, "shape/cosInner", "cone angles are not inner <= outer");
    if (s.profile >= int(profiles.size()) || s.profile < -1)
      return fail(*this, "lights", i, light.name, "shape/profile",
                  "profile " + std::to_string(s.profile) + " of " + std::to_string(profiles.size()) + " is out of range");
    if (s.kind == LightKind::Point && s.profile >= 0 && profiles[size_t(s.profile)]->kind == ProfileKind::Picture)
      return fail(*this, "lights", i, light.name, "shape/profile", "a picture needs the cone of a spot");
    if (!isCoordinate(s.profileRotation)) return fail(*this, "lights", i, light.name, "shape/profileRotation", std::string("rotation") + kBeyond);
    if (s.kind == LightKind::Mesh && s.instance >= instances.size())
      return fail(*this, "lights", i, light.name, "shape/instance",
                  "instance " + std::to_string(s.instance) + " of " + std::to_string(instances.size()) + " is out of range");
    if (s.kind == LightKind::Environment) {
      if (!environment) return fail(*this, "lights", i, light.name, "", "environment light in a scene without a map");
      if (++environments > 1) return fail(*this, "lights", i, light.name, "", "second environment light");
    }
  }
  for (size_t i = 0; i < cameras.size(); ++i) {
    const Camera& c = cameras[i];
    if (!isCoordinate(c.toWorld) || !isCoordinate(c.centre)) return fail(*this, "cameras", i, c.name, "", std::string("a number") + kBeyond);
    if (c.perspective ? !(c.yfov > 0.0f && c.yfov < kPi) : !(c.yheight > 0.0f && isCoordinate(c.yheight)))
      return fail(*this, "cameras", i, c.name, c.perspective ? "yfov" : "yheight", std::string("window is empty or") + kBeyond);
    // The other kind of window may be asked for by a request.
    if (!std::isfinite(c.yfov) || !isCoordinate(c.yheight))
      return fail(*this, "cameras", i, c.name, c.perspective ? "yheight" : "yfov", "a number is not finite");
  }
  if (environment && (environment->width <= 0 || environment->height <= 0 || environment->content.isZero() ||
                      environment->texels.size() != size_t(environment->width) * environment->height || !std::isfinite(environment->rotation)))
    return invalidArgument("environment map is malformed", name + "#/environment");
  return {};
}

Status Scene::checkVariants() const {
  for (size_t i = 0; i < variants.uses.size(); ++i) {
    const VariantUse& u = variants.uses[i];
    if (u.variant < 0 || size_t(u.variant) >= variants.names.size() || u.mesh < 0 || size_t(u.mesh) >= meshes.size() || u.material < 0 ||
        size_t(u.material) >= materials.size())
      return fail(*this, "variants/uses", i, "", "", "variant, mesh or material is out of range");
  }
  GOBO_CHECK(!rig || !rig->content.isZero());  // sealRig was not called
  return {};
}

Status Scene::checkNames() const {
  auto unique = [&](const auto& items, const char* list, bool mayBeEmpty) -> Status {
    std::unordered_set<std::string_view> seen;
    for (size_t i = 0; i < items.size(); ++i) {
      if (items[i].name.empty() && mayBeEmpty) continue;
      if (!seen.insert(items[i].name).second) return fail(*this, list, i, items[i].name, "name", "duplicate name");
    }
    return {};
  };
  GOBO_TRY(unique(instances, "instances", false));
  GOBO_TRY(unique(lights, "lights", false));
  GOBO_TRY(unique(cameras, "cameras", false));
  return unique(materials, "materials", true);
}

}  // namespace scene
}  // namespace gobo
