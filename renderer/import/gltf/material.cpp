// SPDX-License-Identifier: Apache-2.0
#include "import/gltf/texture.h"
#include "import/gltf/unique_names.h"

namespace gobo::gltf {
namespace {

/// A factor that the format bounds: a value outside is clamped and said.
float bounded(const Cursor& at, double otherwise, double lo, double hi) {
  const double v = at.number(otherwise);
  if (v >= lo && v <= hi) return float(v);
  at.document->warnOnce(at.pointer, "factor " + std::to_string(v) + " is clamped to " + std::to_string(lo) + ".." + std::to_string(hi));
  return float(std::fmin(std::fmax(v, lo), hi));
}

/// The structure's check names the element.
bool saidOf(const Cursor& at) {
  for (size_t i = 0; i < at.size(); ++i)
    if (at.document->warned.count(at.at(i).pointer)) return true;
  return false;
}

template <typename V>
V boundedVector(const Cursor& at, V otherwise, float hi) {
  const V v = at.vector(otherwise), c = glm::clamp(v, V(0.0f), V(hi));
  if (c != v && !saidOf(at)) at.document->warn(at.pointer, "factor is clamped to 0.." + std::to_string(hi));
  return c;
}

/// KHR_materials_ior: 0 stands for an infinite index (F0 = 1), for which a finite one does (F0 = 0.999996).
constexpr float kInfiniteIor = 1e6f;

void readDielectric(const Cursor& at, Textures& textures, Bsdf& b) {
  const Cursor specular = at.extension("KHR_materials_specular"), ior = at.extension("KHR_materials_ior")["ior"];
  b.specular = bounded(specular["specularFactor"], 1.0, 0.0, 1.0);
  b.specularTexture = textures.ref(specular["specularTexture"], false);
  b.specularColor = boundedVector(specular["specularColorFactor"], Vec3(1.0f), 1e6f);
  b.specularColorTexture = textures.ref(specular["specularColorTexture"], true);
  b.ior = float(ior.number(1.5, 0.0, 1e6));
  if (b.ior == 0.0f) b.ior = kInfiniteIor;
  if (b.ior < 1.0f) {
    at.document->warn(ior.pointer, "ior " + std::to_string(b.ior) + " is below 1; 1.5 is used");
    b.ior = 1.5f;
  }
  b.dispersion = bounded(at.extension("KHR_materials_dispersion")["dispersion"], 0.0, 0.0, 1e3);
}

void readInterior(Document& d, const Cursor& at, Textures& textures, Bsdf& b) {
  const Cursor transmission = at.extension("KHR_materials_transmission"), volume = at.extension("KHR_materials_volume");
  b.transmission = bounded(transmission["transmissionFactor"], 0.0, 0.0, 1.0);
  b.transmissionTexture = textures.ref(transmission["transmissionTexture"], false);
  b.thickness = bounded(volume["thicknessFactor"], 0.0, 0.0, 3e38);
  if (volume["thicknessTexture"].exists() && !d.thicknessSaid) {
    d.thicknessSaid = true;
    d.warn(volume["thicknessTexture"].pointer, "thickness textures are not used: rays cross the true shape");
  }
  b.attenuationColor = boundedVector(volume["attenuationColor"], Vec3(1.0f), 1.0f);
  b.attenuationDistance = bounded(volume["attenuationDistance"], 0.0, 0.0, 3e38);  // absent: infinite, which 0 stands for
  if (volume["attenuationDistance"].exists() && b.attenuationDistance == 0.0f)
    d.warnOnce(volume["attenuationDistance"].pointer, "distance 0 is not allowed; nothing is absorbed");
  const Cursor scatter = at.extension("KHR_materials_volume_scatter"), diffuse = at.extension("KHR_materials_diffuse_transmission");
  b.scatterAlbedo = boundedVector(scatter["multiscatterColor"], Vec3(0.0f), 1.0f);
  b.scatterAnisotropy = bounded(scatter["scatterAnisotropy"], 0.0, -0.999, 0.999);
  b.diffuseTransmission = bounded(diffuse["diffuseTransmissionFactor"], 0.0, 0.0, 1.0);
  b.diffuseTransmissionTexture = textures.ref(diffuse["diffuseTransmissionTexture"], false);
  b.diffuseTransmissionColor = boundedVector(diffuse["diffuseTransmissionColorFactor"], Vec3(1.0f), 1.0f);
  b.diffuseTransmissionColorTexture = textures.ref(diffuse["diffuseTransmissionColorTexture"], true);
}

void readLayers(const Cursor& at, Textures& textures, Bsdf& b) {
  const Cursor coat = at.extension("KHR_materials_clearcoat"), sheen = at.extension("KHR_materials_sheen");
  b.clearcoat = bounded(coat["clearcoatFactor"], 0.0, 0.0, 1.0);
  b.clearcoatTexture = textures.ref(coat["clearcoatTexture"], false);
  b.clearcoatRoughness = bounded(coat["clearcoatRoughnessFactor"], 0.0, 0.0, 1.0);
  b.clearcoatRoughnessTexture = textures.ref(coat["clearcoatRoughnessTexture"], false);
  b.clearcoatNormal = textures.ref(coat["clearcoatNormalTexture"], false);
  b.clearcoatNormalScale = float(coat["clearcoatNormalTexture"]["scale"].number(1.0, -1e6, 1e6));
  b.sheenColor = boundedVector(sheen["sheenColorFactor"], Vec3(0.0f), 1.0f);
  b.sheenColorTexture = textures.ref(sheen["sheenColorTexture"], true);
  b.sheenRoughness = bounded(sheen["sheenRoughnessFactor"], 0.0, 0.0, 1.0);
  b.sheenRoughnessTexture = textures.ref(sheen["sheenRoughnessTexture"], false);
  const Cursor anisotropy = at.extension("KHR_materials_anisotropy"), film = at.extension("KHR_materials_iridescence");
  b.anisotropy = bounded(anisotropy["anisotropyStrength"], 0.0, 0.0, 1.0);
  b.anisotropyRotation = float(anisotropy["anisotropyRotation"].number(0.0, -1e6, 1e6));
  b.anisotropyTexture = textures.ref(anisotropy["anisotropyTexture"], false);
  b.iridescence = bounded(film["iridescenceFactor"], 0.0, 0.0, 1.0);
  b.iridescenceTexture = textures.ref(film["iridescenceTexture"], false);
  b.iridescenceIor = bounded(film["iridescenceIor"], 1.3, 1.0, 1e3);
  b.iridescenceThicknessMin = bounded(film["iridescenceThicknessMinimum"], 100.0, 0.0, 1e6);
  b.iridescenceThicknessMax = bounded(film["iridescenceThicknessMaximum"], 400.0, 0.0, 1e6);
  b.iridescenceThicknessTexture = textures.ref(film["iridescenceThicknessTexture"], false);
}

/// KHR_materials_pbrSpecularGlossiness (archived) is a dielectric of infinite index whose F0 is the specular colour: what
/// KHR_materials_ior's 0 was made for. Glossiness in alpha becomes roughness in green.
void readSpecularGlossiness(Document& d, const Cursor& at, Textures& textures, Material& m, Vec4& base) {
  d.warn(at.pointer, "KHR_materials_pbrSpecularGlossiness is shown as a dielectric with this specular colour; diffuse light loses its Fresnel share");
  base = boundedVector(at["diffuseFactor"], Vec4(1.0f), 1.0f);
  m.albedo.texture = textures.ref(at["diffuseTexture"], true);
  m.bsdf.metallic = 0.0f;
  m.bsdf.ior = kInfiniteIor;
  m.bsdf.specularColor = boundedVector(at["specularFactor"], Vec3(1.0f), 1.0f);
  m.bsdf.specularColorTexture = textures.ref(at["specularGlossinessTexture"], true);
  const float gloss = bounded(at["glossinessFactor"], 1.0, 0.0, 1.0);
  m.bsdf.metallicRoughness = textures.roughnessFromGloss(at["specularGlossinessTexture"], gloss);
  m.bsdf.roughness = m.bsdf.metallicRoughness.valid() ? 1.0f : 1.0f - gloss;
}

Material readMaterial(Document& d, const Cursor& at, Textures& textures) {
  Material m;
  m.name = at["name"].text();
  const Cursor pbr = at["pbrMetallicRoughness"], glossy = at.extension("KHR_materials_pbrSpecularGlossiness");
  readDielectric(at, textures, m.bsdf);
  Vec4 base = boundedVector(pbr["baseColorFactor"], Vec4(1.0f), 1.0f);
  if (glossy.exists()) readSpecularGlossiness(d, glossy, textures, m, base);
  else {
    m.albedo.texture = textures.ref(pbr["baseColorTexture"], true);
    m.bsdf.metallic = bounded(pbr["metallicFactor"], 1.0, 0.0, 1.0);
    m.bsdf.roughness = bounded(pbr["roughnessFactor"], 1.0, 0.0, 1.0);
    m.bsdf.metallicRoughness = textures.ref(pbr["metallicRoughnessTexture"], false);
  }
  m.albedo.factor = Vec3(base);
  m.bsdf.normal = textures.ref(at["normalTexture"], false);
  m.bsdf.normalScale = float(at["normalTexture"]["scale"].number(1.0, -1e6, 1e6));
  m.bsdf.unlit = at.extension("KHR_materials_unlit").exists();
  // occlusionTexture: left aside on purpose, a path tracer computes what it stands for.

  const std::string mode = at["alphaMode"].text("OPAQUE");
  if (mode == "MASK") m.coverage.mode = AlphaMode::Mask;
  else if (mode == "BLEND") m.coverage.mode = AlphaMode::Blend;
  else if (mode != "OPAQUE") at["alphaMode"].fail("\"" + mode + "\" is not OPAQUE, MASK or BLEND");
  m.coverage.cutoff = bounded(at["alphaCutoff"], 0.5, 0.0, 3e38);
  m.coverage.doubleSided = at["doubleSided"].boolean(false);
  if (m.coverage.mode != AlphaMode::Opaque) {  // OPAQUE ignores alpha
    m.coverage.factor = base.w;
    m.coverage.texture = m.albedo.texture;
  }

  const float strength = float(at.extension("KHR_materials_emissive_strength")["emissiveStrength"].number(1.0, 0.0, 1e12));
  m.emission.radiance = boundedVector(at["emissiveFactor"], Vec3(0.0f), 1.0f) * strength;
  m.emission.texture = textures.ref(at["emissiveTexture"], true);
  if (m.bsdf.unlit && m.emits()) {
    d.warn(at["emissiveFactor"].pointer, "an unlit material shows its base colour alone; its emission is ignored");
    m.emission = {};
  }
  readInterior(d, at, textures, m.bsdf);
  readLayers(at, textures, m.bsdf);
  return m;
}

}  // namespace

Status readMaterials(Document& d, Scene& scene) {
  Textures textures(d, scene);
  const Cursor list = d.list("materials");
  UniqueNames names;
  for (size_t i = 0; i < list.size() && d.ok(); ++i) {
    scene.materials.push_back(readMaterial(d, list.at(i), textures));
    std::string& name = scene.materials.back().name;
    if (name.empty()) name = "material" + std::to_string(i);
    name = names.take(name);
  }
  Material plain;
  plain.bsdf.metallic = 1.0f;  // the format's default material
  plain.coverage.doubleSided = false;
  plain.name = names.take("default");
  scene.materials.push_back(plain);
  return d.status;
}

}  // namespace gobo::gltf
