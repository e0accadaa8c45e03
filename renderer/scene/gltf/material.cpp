// SPDX-License-Identifier: Apache-2.0
#include "scene/gltf/texture.h"

namespace gobo::gltf {
namespace {

/// A factor that the format bounds: a value outside is clamped and said.
float bounded(const Cursor& at, double otherwise, double lo, double hi) {
  const double v = at.number(otherwise);
  if (v >= lo && v <= hi) return float(v);
  at.document->warn(at.pointer, "factor " + std::to_string(v) + " is clamped to " + std::to_string(lo) + ".." + std::to_string(hi));
  return float(std::fmin(std::fmax(v, lo), hi));
}

template <typename V>
V boundedVector(const Cursor& at, V otherwise, float hi) {
  const V v = at.vector(otherwise), c = glm::clamp(v, V(0.0f), V(hi));
  if (c != v) at.document->warn(at.pointer, "factor is clamped to 0.." + std::to_string(hi));
  return c;
}

Material readMaterial(Document& d, const Cursor& at, Textures& textures) {
  Material m;
  m.name = at["name"].text();
  const Cursor pbr = at["pbrMetallicRoughness"];
  const Vec4 base = boundedVector(pbr["baseColorFactor"], Vec4(1.0f), 1.0f);
  m.albedo.factor = Vec3(base);
  m.albedo.texture = textures.ref(pbr["baseColorTexture"], true);
  m.bsdf.metallic = bounded(pbr["metallicFactor"], 1.0, 0.0, 1.0);
  m.bsdf.roughness = bounded(pbr["roughnessFactor"], 1.0, 0.0, 1.0);
  m.bsdf.metallicRoughness = textures.ref(pbr["metallicRoughnessTexture"], false);
  m.bsdf.normal = textures.ref(at["normalTexture"], false);
  m.bsdf.normalScale = float(at["normalTexture"]["scale"].number(1.0, -1e6, 1e6));

  const std::string mode = at["alphaMode"].text("OPAQUE");
  if (mode == "MASK") m.coverage.mode = AlphaMode::Mask;
  else if (mode == "BLEND") m.coverage.mode = AlphaMode::Blend;
  else if (mode != "OPAQUE") at["alphaMode"].fail("\"" + mode + "\" is not OPAQUE, MASK or BLEND");
  m.coverage.cutoff = float(at["alphaCutoff"].number(0.5, 0.0, 3e38));
  m.coverage.doubleSided = at["doubleSided"].boolean(false);
  if (m.coverage.mode != AlphaMode::Opaque) {  // OPAQUE ignores alpha
    m.coverage.factor = base.w;
    m.coverage.texture = m.albedo.texture;
  }

  const float strength = float(at.extension("KHR_materials_emissive_strength")["emissiveStrength"].number(1.0, 0.0, 1e12));
  m.emission.radiance = boundedVector(at["emissiveFactor"], Vec3(0.0f), 1.0f) * strength;
  m.emission.texture = textures.ref(at["emissiveTexture"], true);

  const Cursor specular = at.extension("KHR_materials_specular");
  m.bsdf.specular = bounded(specular["specularFactor"], 1.0, 0.0, 1.0);
  if (specular["specularTexture"].exists() || specular["specularColorTexture"].exists() || specular["specularColorFactor"].exists())
    d.warn(specular.pointer, "only specularFactor is used");
  const Cursor ior = at.extension("KHR_materials_ior")["ior"];
  m.bsdf.ior = float(ior.number(1.5, 0.0, 1e3));
  if (m.bsdf.ior < 1.0f) {
    d.warn(ior.pointer, "ior " + std::to_string(m.bsdf.ior) + " is below 1; 1.5 is used");
    m.bsdf.ior = 1.5f;
  }
  const Cursor transmission = at.extension("KHR_materials_transmission");
  m.bsdf.transmission = bounded(transmission["transmissionFactor"], 0.0, 0.0, 1.0);
  if (transmission["transmissionTexture"].exists()) d.warn(transmission.pointer, "transmissionTexture is ignored");
  return m;
}

}  // namespace

Status readMaterials(Document& d, Scene& scene) {
  Textures textures(d, scene);
  const Cursor list = d.list("materials");
  std::set<std::string> names;
  for (size_t i = 0; i < list.size() && d.ok(); ++i) {
    scene.materials.push_back(readMaterial(d, list.at(i), textures));
    std::string& name = scene.materials.back().name;
    if (name.empty()) name = "material" + std::to_string(i);
    const std::string wanted = name;
    for (int k = 2; !names.insert(name).second; ++k) name = wanted + "#" + std::to_string(k);
  }
  Material plain;
  plain.bsdf.metallic = 1.0f;  // the format's default material
  plain.coverage.doubleSided = false;
  plain.name = "default";
  for (int k = 2; names.count(plain.name); ++k) plain.name = "default#" + std::to_string(k);
  scene.materials.push_back(plain);
  return d.status;
}

}  // namespace gobo::gltf
