// SPDX-License-Identifier: Apache-2.0
#include "trace/surface.h"

#include "trace/texture_lookup.h"

namespace gobo {

void SurfaceTable::build(const SceneView& view, const Accel& accel) {
  const auto& meshes = view.meshes(Facet::Topology | Facet::Pose | Facet::Shading);
  keep_ = meshes;
  textures_ = view.textures();
  const auto texture = [&](const TextureRef& ref) -> const Texture* { return ref.valid() ? textures_[ref.texture].get() : nullptr; };
  materials_.resize(view.materialCount());
  for (size_t i = 0; i < materials_.size(); ++i) {
    const Albedo& albedo = view.albedo(int(i));
    const Bsdf& bsdf = view.bsdf(int(i));
    SurfaceMaterial& m = materials_[i];
    m.constant.albedo = glm::clamp(albedo.factor, Vec3(0.0f), Vec3(1.0f));
    m.constant.metallic = bsdf.metallic;
    m.constant.roughness = bsdf.roughness;
    m.constant.specular = bsdf.specular;
    m.constant.ior = bsdf.ior;
    m.constant.transmission = bsdf.transmission;
    m.albedo = texture(albedo.texture); m.albedoRef = albedo.texture;
    m.metallicRoughness = texture(bsdf.metallicRoughness); m.metallicRoughnessRef = bsdf.metallicRoughness;
    m.normal = texture(bsdf.normal); m.normalRef = bsdf.normal; m.normalScale = bsdf.normalScale;
    m.lambert = bsdf.metallic <= 0.0f && bsdf.specular <= 0.0f && bsdf.transmission <= 0.0f;  // a metallic texture times 0 is 0
    m.transmissive = bsdf.transmission > 0.0f;
    m.textured = m.albedo || m.normal || (m.metallicRoughness && !m.lambert);
  }
  const std::vector<Instance>& instances = view.instances();
  instances_.resize(instances.size());
  for (size_t i = 0; i < instances.size(); ++i) {
    const Mesh& mesh = *meshes[instances[i].mesh];
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
    s.flatLambert = s.world && !s.mirrored && !s.normals && !s.colours && s.material->lambert && !s.material->textured;
    if (!s.material->lambert) allLambert_ = false;
    // Scaled to order 1, so that normals of scenes of any scale stay inside float's comfortable range when squared.
    float most = 0.0f;
    for (int c = 0; c < 3; ++c) for (int r = 0; r < 3; ++r) most = std::fmax(most, std::fabs(s.normalToWorld[c][r]));
    if (most > 0.0f && std::isfinite(most)) s.normalToWorld /= most;
  }
}

void SurfaceTable::toWorld(const SurfaceInstance& s, Surface& out) {
  const Mat4& m = s.toWorld;
  const Vec3 local = out.p, reach = out.reach, translation(m[3]);
  out.p = Vec3(m * Vec4(local, 1.0f));
  // Embree takes the ray into object space and back: the translation counts twice.
  out.reach = 2.0f * (glm::abs(Vec3(m[0])) * reach.x + glm::abs(Vec3(m[1])) * reach.y + glm::abs(Vec3(m[2])) * reach.z + glm::abs(translation)) +
              glm::abs(out.p);
}

void SurfaceTable::detail(const SurfaceInstance& s, uint32_t a, uint32_t b, uint32_t c, float w, float u, float v, const Vec3& d, Surface& out) {
  const SurfaceMaterial& m = *s.material;
  const auto uvAt = [&](const TextureRef& ref) {
    const Vec2* set = s.uv[ref.texcoord];
    return transformUv(ref, set ? w * set[a] + u * set[b] + v * set[c] : Vec2(0.0f));
  };
  if (s.colours) out.bsdf.albedo *= Vec3(w * s.colours[a] + u * s.colours[b] + v * s.colours[c]);
  if (m.albedo) out.bsdf.albedo *= Vec3(m.albedo->sample(uvAt(m.albedoRef)));
  out.bsdf.albedo = glm::clamp(out.bsdf.albedo, Vec3(0.0f), Vec3(1.0f));     // an albedo above 1 would make energy
  if (m.metallicRoughness && !m.lambert) {
    const Vec4 t = m.metallicRoughness->sample(uvAt(m.metallicRoughnessRef));
    out.bsdf.roughness *= t.y;
    out.bsdf.metallic *= t.z;
  }
  if (!m.normal) return;

  // Tangent frame in object space: the mesh's (MikkTSpace) tangents, else the gradient of the texture coordinates.
  const Vec3 facing = out.facing();
  Vec3 normal = s.normals ? w * s.normals[a] + u * s.normals[b] + v * s.normals[c] : Vec3(0.0f);
  Vec3 tangent;
  float handed = 1.0f;
  const Vec3 e1 = s.positions[b] - s.positions[a], e2 = s.positions[c] - s.positions[a];
  const Vec2* set = s.uv[m.normalRef.texcoord];
  if (s.tangents) {
    const Vec4 t = w * s.tangents[a] + u * s.tangents[b] + v * s.tangents[c];
    tangent = Mat3(s.toWorld) * Vec3(t);
    handed = t.w < 0.0f ? -1.0f : 1.0f;
  } else {
    if (!set) return;
    const Vec2 d1 = set[b] - set[a], d2 = set[c] - set[a];
    const float det = d1.x * d2.y - d1.y * d2.x;
    if (det == 0.0f) return;
    tangent = (e1 * d2.y - e2 * d1.y) / det;
    if (!s.world) tangent = Mat3(s.toWorld) * tangent;
    // v points down in glTF pictures and normal maps are +Y up: the bitangent goes against the v gradient's handedness.
    handed = det < 0.0f ? 1.0f : -1.0f;
    if (s.mirrored) handed = -handed;
  }
  if (s.normals) { if (!s.identity) normal = s.normalToWorld * normal; } else { normal = out.Ng; }
  const float nl = glm::dot(normal, normal);
  if (!(nl > 0.0f)) return;
  normal *= 1.0f / std::sqrt(nl);
  tangent -= normal * glm::dot(normal, tangent);
  const float tl = glm::dot(tangent, tangent);
  if (!(tl > 0.0f) || !std::isfinite(tl)) return;
  tangent *= 1.0f / std::sqrt(tl);
  if (s.tangents && s.mirrored) handed = -handed;
  const Vec3 bitangent = glm::cross(normal, tangent) * handed;
  const Vec4 t = m.normal->sample(uvAt(m.normalRef));
  const Vec3 local((2.0f * t.x - 1.0f) * m.normalScale, (2.0f * t.y - 1.0f) * m.normalScale, 2.0f * t.z - 1.0f);
  const Vec3 mapped = tangent * local.x + bitangent * local.y + normal * local.z;
  // The side of the map belongs to the vertex normal; seen from behind, or with inverted normals, the whole frame turns over.
  out.n = usable(glm::dot(normal, facing) < 0.0f ? -mapped : mapped, facing, d);
}

}  // namespace gobo
