// SPDX-License-Identifier: Apache-2.0
// Digests of meshes and facets. A field is hashed into exactly the facets whose sources may read it; the test
// scene_hash_test mutates every field and checks that list.
#include <algorithm>

#include "base/check.h"
#include "scene/fields.h"
#include "scene/scene.h"

namespace gobo {
inline namespace scene {
namespace {

template <typename V>
void addVector(Hasher& h, const V& v) {
  for (int i = 0; i < V::length(); ++i) h.add(v[i]);
}
void addMatrix(Hasher& h, const Mat4& m) {
  for (int i = 0; i < 4; ++i) addVector(h, m[i]);
}

Hash128 shapeHash(const Light& light, const std::vector<LightProfilePtr>& profiles) {
  const LightShape& s = light.shape;
  Hasher h("light-shape");
  visitFields(s, [&](const char* name, const auto& field) {
    if (const std::string_view n(name); n == "profile" || n == "profileRotation") {
      return;  // below: by content
    } else if (n == "angularSize" || n == "skyRectangle") {
      // Few lights have them; the others keep the digests that they had without.
      if (field == std::remove_cvref_t<decltype(field)>(0)) return;
      h.add(n);
    }
    if constexpr (requires { field.length(); }) addVector(h, field);
    else h.add(field);
  });
  h.add(light.cameraVisible);
  if (hasProfile(s)) h.add("profile").add(profiles[size_t(s.profile)]->content).add(s.profileRotation);
  return h.digest();
}

int facetIndex(Facet f) { return __builtin_ctz(uint32_t(f)); }

}  // namespace

void sealMesh(Mesh& mesh) {
  mesh.topologyHash = Hasher("mesh-topology").addArray(mesh.indices).add(uint64_t(mesh.positions.size())).digest();
  mesh.positionsHash = Hasher("mesh-positions").addArray(mesh.positions).digest();
  Hasher shading("mesh-shading");
  shading.addArray(mesh.normals).addArray(mesh.tangents).addArray(mesh.colours);
  for (const Array<Vec2>& set : mesh.uv) shading.addArray(set);
  mesh.shadingHash = shading.digest();
}

/// By content, not by index: adding a texture elsewhere in the list must not change what a material looks like.
Hash128 Scene::refHash(const TextureRef& ref) const {
  Hasher h("texture-ref");
  if (!ref.valid()) return h.digest();
  h.add(textures[ref.texture]->content).add(ref.texcoord);
  addVector(h, ref.offset);
  addVector(h, ref.scale);
  return h.add(ref.rotation).digest();
}

void Scene::computeDigests() {
  const auto addField = [&](Hasher& h, const auto& field) {
    using Field = std::remove_cvref_t<decltype(field)>;
    if constexpr (std::is_same_v<Field, TextureRef>) h.add(refHash(field));
    else if constexpr (requires { field.length(); }) addVector(h, field);
    else h.add(field);
  };
  Hasher topology("topology"), pose("pose"), shading("shading"), coverage("coverage"), albedo("albedo"), bsdf("bsdf"), emission("emission");
  for (const MeshPtr& m : meshes) {
    topology.add(m->topologyHash).add(m->material);
    pose.add(m->positionsHash);
    shading.add(m->shadingHash);
    // Alpha tests read texture coordinates and vertex alpha: whoever sees geometry sees them.
    if (materials[size_t(m->material)].coverage.mode != AlphaMode::Opaque) coverage.add(m->shadingHash);
  }
  for (const Instance& i : instances) {
    topology.add(i.mesh);
    addMatrix(pose, i.toWorld);
  }
  std::vector<Hash128> emissionOf(materials.size());
  for (size_t k = 0; k < materials.size(); ++k) {
    const Material& m = materials[k];
    const auto into = [&](Hasher& h) { return [&](const char*, const auto& field) { addField(h, field); }; };
    visitFields(m.coverage, into(coverage));
    visitFields(m.albedo, into(albedo));
    visitFields(m.bsdf, into(bsdf));
    emissionOf[k] = Hasher("material-emission").add(m.emits()).add(refHash(m.emission.texture)).digest();
    emission.add(emissionOf[k]);
  }

  lightShape_.assign(lights.size(), {});
  lightPower_.assign(lights.size(), {});
  Hasher shapes("light-shapes"), powers("light-powers"), names("names");
  for (size_t k = 0; k < lights.size(); ++k) {
    const Light& light = lights[k];
    lightShape_[k] = shapeHash(light, profiles);
    if (light.shape.kind == LightKind::Mesh) {
      const Instance& instance = instances[light.shape.instance];
      const Mesh& mesh = *meshes[instance.mesh];
      Hasher h("mesh-light");
      h.add(lightShape_[k]).add(mesh.topologyHash).add(mesh.positionsHash).add(emissionOf[mesh.material]);
      addMatrix(h, instance.toWorld);
      if (materials[mesh.material].emission.texture.valid()) h.add(mesh.shadingHash);  // its texture coordinates
      lightShape_[k] = h.digest();
    }
    Hasher power("light-power");
    addVector(power, light.power);
    lightPower_[k] = power.digest();
    shapes.add(lightShape_[k]);
    powers.add(lightPower_[k]);
    names.add(light.name);
  }

  Hasher sky("environment-facet"), views("cameras");
  sky.add(environment != nullptr);
  if (environment) sky.add(environment->content).add(environment->rotation);
  for (const Camera& c : cameras) {
    addMatrix(views, c.toWorld);
    views.add(c.perspective).add(c.yfov).add(c.yheight);
    addVector(views, c.centre);
    names.add(c.name);
  }
  for (const Instance& i : instances) names.add(i.name);
  for (const Material& m : materials) names.add(m.name);

  auto set = [&](Facet f, const Hasher& h) { facet_[facetIndex(f)] = h.digest(); };
  set(Facet::Topology, topology);
  set(Facet::Pose, pose);
  set(Facet::Shading, shading);
  set(Facet::Coverage, coverage);
  set(Facet::Albedo, albedo);
  set(Facet::Bsdf, bsdf);
  set(Facet::Emission, emission);
  set(Facet::LightShape, shapes);
  set(Facet::LightPower, powers);
  set(Facet::Environment, sky);
  set(Facet::Cameras, views);
  Hasher root("scene");
  for (const Hash128& f : facet_) root.add(f);
  // No node reads them, but edits go by them. White lights, and those of which nothing is known, have none but what their power says.
  for (size_t k = 0; k < lights.size(); ++k) {
    if (lights[k].intensity < 0.0f || lights[k].color == Vec3(1.0f)) continue;
    addVector(root, lights[k].color);
    root.add(uint64_t(k)).add(lights[k].intensity);
  }
  root.add(names.digest()).add(rig ? rig->content : Hash128{});
  Hasher choices("variants");
  for (const std::string& n : variants.names) choices.add(n);
  for (const VariantUse& u : variants.uses) choices.add(u.variant).add(u.mesh).add(u.material);
  root_ = root.add(choices.digest()).digest();
}

bool Scene::seesEnvironment(Facet set, const std::vector<int>& lightSubset) const {
  if (!has(set, Facet::Environment)) return false;
  if (!has(set, Facet::LightShape)) return true;
  return std::any_of(lightSubset.begin(), lightSubset.end(),
                     [&](int i) { return i >= 0 && size_t(i) < lights.size() && lights[size_t(i)].shape.kind == LightKind::Environment; });
}

Hash128 Scene::facetHash(Facet set, const std::vector<int>& lightSubset) const {
  GOBO_CHECK_EQ(lightShape_.size(), lights.size());  // sealed
  Hasher h("facets");
  h.add(set);
  for (uint32_t bit = 1; bit < uint32_t(Facet::All); bit <<= 1) {
    if (!has(set, Facet(bit)) || Facet(bit) == Facet::LightShape || Facet(bit) == Facet::LightPower) continue;
    if (Facet(bit) == Facet::Environment && !seesEnvironment(set, lightSubset)) continue;
    h.add(facet_[facetIndex(Facet(bit))]);
  }
  // Light facets cover the subset only, in its order: sums over lights are folded in that order.
  for (const auto& [facet, digests] : {std::pair{Facet::LightShape, &lightShape_}, std::pair{Facet::LightPower, &lightPower_}}) {
    if (!has(set, facet)) continue;
    h.add(uint64_t(lightSubset.size()));
    for (const int i : lightSubset) {
      GOBO_CHECK(i >= 0 && size_t(i) < digests->size());
      h.add((*digests)[i]);
    }
  }
  return h.digest();
}

}  // namespace scene
}  // namespace gobo
