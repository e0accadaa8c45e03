// SPDX-License-Identifier: Apache-2.0
#include "trace/surface.h"

#include "trace/straight.h"
#include "trace/texture_lookup.h"

namespace gobo {
inline namespace trace {

namespace {

float unit(float v) { return clamp01(v); }
Vec3 unit(const Vec3& v) { return glm::clamp(v, Vec3(0.0f), Vec3(1.0f)); }

}  // namespace

SurfaceMaterial makeSurfaceMaterial(const Albedo& albedo, const Bsdf& b, const std::vector<std::shared_ptr<const Texture>>& textures) {
  const auto texture = [&](const TextureRef& ref) { return SurfaceTexture{ref.valid() ? textures[ref.texture].get() : nullptr, ref}; };
  SurfaceMaterial m;
  BsdfParams& p = m.constant;
  p.albedo = unit(albedo.factor);
  p.metallic = b.metallic;
  p.roughness = b.roughness;
  p.specular = b.specular;
  p.ior = b.ior;
  p.transmission = b.transmission;
  p.thin = !(b.thickness > 0.0f);
  p.specularColor = glm::max(b.specularColor, Vec3(0.0f));
  p.anisotropy = unit(b.anisotropy);
  p.clearcoat = unit(b.clearcoat);
  p.clearcoatRoughness = unit(b.clearcoatRoughness);
  p.sheenColor = unit(b.sheenColor);
  p.sheenRoughness = unit(b.sheenRoughness);
  p.iridescence = unit(b.iridescence);
  p.iridescenceIor = b.iridescenceIor;
  p.iridescenceThickness = b.iridescenceThicknessMax;
  p.diffuseTransmission = unit(b.diffuseTransmission);
  p.diffuseTransmissionColor = unit(b.diffuseTransmissionColor);
  m.unlit = b.unlit;
  m.straight = maySendStraight(b);
  m.albedo = texture(albedo.texture);
  m.metallicRoughness = texture(b.metallicRoughness);
  m.normal = texture(b.normal);
  m.normalScale = b.normalScale;
  m.specular = texture(b.specularTexture);
  m.specularColor = texture(b.specularColorTexture);
  m.transmission = texture(b.transmissionTexture);
  m.diffuseTransmission = texture(b.diffuseTransmissionTexture);
  m.diffuseTransmissionColor = texture(b.diffuseTransmissionColorTexture);
  m.clearcoat = texture(b.clearcoatTexture);
  m.clearcoatRoughness = texture(b.clearcoatRoughnessTexture);
  m.clearcoatNormal = texture(b.clearcoatNormal);
  m.coatNormalScale = b.clearcoatNormalScale;
  m.sheenColor = texture(b.sheenColorTexture);
  m.sheenRoughness = texture(b.sheenRoughnessTexture);
  m.anisotropy = texture(b.anisotropyTexture);
  m.anisotropyRotation = b.anisotropyRotation;
  m.iridescence = texture(b.iridescenceTexture);
  m.iridescenceThickness = texture(b.iridescenceThicknessTexture);
  m.iridescenceThicknessMin = b.iridescenceThicknessMin;

  const bool coat = p.clearcoat > 0.0f, sheen = maxComponent(p.sheenColor) > 0.0f, film = p.iridescence > 0.0f, behind = p.diffuseTransmission > 0.0f;
  m.transmissive = p.transmission > 0.0f || behind;
  // A texture times 0 is 0, so the factors decide.
  m.lambert = p.metallic <= 0.0f && p.specular <= 0.0f && !m.transmissive && !coat && !sheen && !film && !m.unlit;
  if (m.transmissive && !p.thin) m.dispersion = std::fmax(b.dispersion, 0.0f);
  m.lobeTextured = !m.lambert && (m.specular || m.specularColor || m.transmission || m.diffuseTransmission || m.diffuseTransmissionColor || m.clearcoat ||
                                  m.clearcoatRoughness || m.clearcoatNormal || (coat && m.normal) || m.sheenColor || m.sheenRoughness || m.iridescence ||
                                  m.iridescenceThickness || p.anisotropy > 0.0f);
  m.textured = m.albedo || m.normal || (m.metallicRoughness && !m.lambert) || m.lobeTextured;
  m.extended = coat || sheen || film || behind || p.anisotropy > 0.0f || p.specularColor != Vec3(1.0f) || m.specularColor ||
               (p.transmission > 0.0f && p.thin) || m.dispersion > 0.0f;
  return m;
}

void SurfaceTable::build(const SceneView& view, const Accel& accel) {
  keep_ = view.keepMeshes();
  textures_ = view.textures();
  materials_.resize(view.materialCount());
  for (size_t i = 0; i < materials_.size(); ++i) {
    const Albedo& albedo = view.albedo(int(i));
    const Bsdf& bsdf = view.bsdf(int(i));
    materials_[i] = makeSurfaceMaterial(albedo, bsdf, textures_);
    if (!boundsVolume(bsdf)) continue;
    materials_[i].interior = int(interiors_.size());
    interiors_.push_back(makeInterior(bsdf));
  }
  const std::vector<Instance>& instances = view.instances();
  instances_.resize(instances.size());
  for (size_t i = 0; i < instances.size(); ++i) {
    const auto mesh = view.mesh<Facet::Topology | Facet::Pose | Facet::Shading>(instances[i].mesh);
    const InstanceGeometry& g = accel.impl().instances[i];
    SurfaceInstance& s = instances_[i];
    s.indices = mesh.indices.data();
    s.positions = g.positions;
    s.normals = mesh.normals.empty() ? nullptr : mesh.normals.data();
    s.tangents = mesh.tangents.empty() ? nullptr : mesh.tangents.data();
    for (int k = 0; k < kUvSets; ++k) s.uv[k] = mesh.uv[k].empty() ? nullptr : mesh.uv[k].data();
    s.colours = mesh.colours.empty() ? nullptr : mesh.colours.data();
    s.material = &materials_[mesh.material];
    s.world = g.world;
    s.toWorld = g.toWorld;
    s.normalToWorld = g.normalToWorld;
    s.mirrored = g.mirrored;
    s.identity = g.toWorld == Mat4(1.0f);
    s.unlit = s.material->unlit;
    anyUnlit_ = anyUnlit_ || s.unlit;
    anyStraight_ = anyStraight_ || s.material->straight || (s.material->interior >= 0 && interiors_[size_t(s.material->interior)].scatters);
    s.plainLambert = s.world && !s.mirrored && !s.colours && s.material->lambert && !s.material->textured;
    // Scaled to order 1, so that normals of scenes of any scale stay inside float's comfortable range when squared.
    float most = 0.0f;
    for (int c = 0; c < 3; ++c)
      for (int r = 0; r < 3; ++r) most = std::fmax(most, std::fabs(s.normalToWorld[c][r]));
    if (most > 0.0f && std::isfinite(most)) s.normalToWorld /= most;
  }
}

void SurfaceTable::toWorld(const SurfaceInstance& s, Surface& out) {
  const Mat4& m = s.toWorld;
  out.p = Vec3(m * Vec4(out.p, 1.0f));
  out.reach = instanceReach(m, out.reach, out.p);
}

}  // namespace trace
}  // namespace gobo
