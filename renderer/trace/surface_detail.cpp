// SPDX-License-Identifier: Apache-2.0
// The textured part of a surface look-up: every texture of a material, normal maps, and the direction of anisotropy.
#include "trace/surface.h"
#include "trace/texture_lookup.h"

namespace gobo {
inline namespace trace {

Vec2 SurfaceTable::uvAt(const SurfaceInstance& s, const Place& at, const TextureRef& ref) {
  const Vec2* set = s.uv[ref.texcoord];
  return transformUv(ref, set ? at.w * set[at.a] + at.u * set[at.b] + at.v * set[at.c] : Vec2(0.0f));
}

/// Of the three textures that most materials have.
void SurfaceTable::texels(const SurfaceInstance& s, uint32_t primitive, float u, float v) {
  const SurfaceMaterial& m = *s.material;
  const uint32_t* tri = s.indices + 3 * size_t(primitive);
  const Place at{tri[0], tri[1], tri[2], 1.0f - u - v, u, v};
  if (m.albedo) m.albedo.texture->prefetch(uvAt(s, at, m.albedo.ref));
  if (m.normal) m.normal.texture->prefetch(uvAt(s, at, m.normal.ref));
  if (m.metallicRoughness && !m.lambert) m.metallicRoughness.texture->prefetch(uvAt(s, at, m.metallicRoughness.ref));
}

/// The mesh's (MikkTSpace) tangents, else the gradient of the coordinates that `ref` is looked up at. False where there is neither.
bool SurfaceTable::tangentSpace(const SurfaceInstance& s, const Place& at, const TextureRef& ref, const Surface& out, TangentSpace& space) {
  Vec3 normal = s.normals ? at.w * s.normals[at.a] + at.u * s.normals[at.b] + at.v * s.normals[at.c] : Vec3(0.0f);
  Vec3 tangent;
  float handed = 1.0f;
  if (s.tangents) {
    const Vec4 t = at.w * s.tangents[at.a] + at.u * s.tangents[at.b] + at.v * s.tangents[at.c];
    tangent = Mat3(s.toWorld) * Vec3(t);
    handed = t.w < 0.0f ? -1.0f : 1.0f;
  } else {
    const Vec2* set = s.uv[ref.texcoord];
    if (!set) return false;
    const Vec3 e1 = s.positions[at.b] - s.positions[at.a], e2 = s.positions[at.c] - s.positions[at.a];
    const Vec2 d1 = transformUvDifference(ref, set[at.b] - set[at.a]), d2 = transformUvDifference(ref, set[at.c] - set[at.a]);
    const float det = d1.x * d2.y - d1.y * d2.x;
    if (det == 0.0f) return false;
    tangent = (e1 * d2.y - e2 * d1.y) / det;
    if (!s.world) tangent = Mat3(s.toWorld) * tangent;
    // v points down in glTF pictures and normal maps are +Y up: the bitangent goes against the v gradient's handedness.
    handed = det < 0.0f ? 1.0f : -1.0f;
    if (s.mirrored) handed = -handed;
  }
  if (s.normals) {
    if (!s.identity) normal = s.normalToWorld * normal;
  } else {
    normal = out.Ng;
  }
  const float nl = glm::dot(normal, normal);
  if (!(nl > 0.0f)) return false;
  normal *= 1.0f / std::sqrt(nl);
  tangent -= normal * glm::dot(normal, tangent);
  const float tl = glm::dot(tangent, tangent);
  if (!(tl > 0.0f) || !std::isfinite(tl)) return false;
  tangent *= 1.0f / std::sqrt(tl);
  if (s.tangents && s.mirrored) handed = -handed;
  space = {normal, tangent, glm::cross(normal, tangent) * handed};
  return true;
}

/// The shading normal of a normal map on the viewer's side; the surface's own where it cannot be had.
Vec3 SurfaceTable::mapped(const SurfaceInstance& s, const Place& at, const SurfaceTexture& map, float scale, const Vec3& d, const Surface& out) {
  TangentSpace space;
  if (!tangentSpace(s, at, map.ref, out, space)) return out.n;
  const Vec4 t = map.texture->sample(uvAt(s, at, map.ref));
  const Vec3 local((2.0f * t.x - 1.0f) * scale, (2.0f * t.y - 1.0f) * scale, 2.0f * t.z - 1.0f);
  const Vec3 n = space.tangent * local.x + space.bitangent * local.y + space.normal * local.z;
  // The side of the map belongs to the vertex normal; seen from behind, or with inverted normals, the whole frame turns over.
  const Vec3 facing = out.facing();
  return usable(glm::dot(space.normal, facing) < 0.0f ? -n : n, facing, d);
}

void SurfaceTable::lobes(const SurfaceInstance& s, const Place& at, Surface& out) {
  const SurfaceMaterial& m = *s.material;
  BsdfParams& p = out.bsdf;
  const auto texel = [&](const SurfaceTexture& t) { return t.texture->sample(uvAt(s, at, t.ref)); };
  if (m.specular) p.specular *= texel(m.specular).w;
  if (m.specularColor) p.specularColor *= Vec3(texel(m.specularColor));
  if (m.transmission) p.transmission *= texel(m.transmission).x;
  if (m.diffuseTransmission) p.diffuseTransmission *= texel(m.diffuseTransmission).w;
  if (m.diffuseTransmissionColor)
    p.diffuseTransmissionColor = glm::clamp(p.diffuseTransmissionColor * Vec3(texel(m.diffuseTransmissionColor)), Vec3(0.0f), Vec3(1.0f));
  if (m.clearcoat) p.clearcoat *= texel(m.clearcoat).x;
  if (m.clearcoatRoughness) p.clearcoatRoughness *= texel(m.clearcoatRoughness).y;
  if (m.sheenColor) p.sheenColor *= Vec3(texel(m.sheenColor));
  if (m.sheenRoughness) p.sheenRoughness *= texel(m.sheenRoughness).w;
  if (m.iridescence) p.iridescence *= texel(m.iridescence).x;
  if (m.iridescenceThickness) {
    const float g = texel(m.iridescenceThickness).y;
    p.iridescenceThickness = m.iridescenceThicknessMin * (1.0f - g) + p.iridescenceThickness * g;
  }
}

/// The frame's x: the texture's direction turned by the rotation, in the plane of tangent and bitangent. A mesh with neither
/// tangents nor texture coordinates has no direction; it gets the one of Frame(n).
void SurfaceTable::anisotropy(const SurfaceInstance& s, const Place& at, Surface& out) {
  const SurfaceMaterial& m = *s.material;
  Vec2 direction(1.0f, 0.0f);
  if (m.anisotropy) {
    const Vec4 t = m.anisotropy.texture->sample(uvAt(s, at, m.anisotropy.ref));
    out.bsdf.anisotropy *= t.z;
    direction = Vec2(2.0f * t.x - 1.0f, 2.0f * t.y - 1.0f);
  }
  TangentSpace space;
  const TextureRef plain{};
  const TextureRef& ref = m.anisotropy ? m.anisotropy.ref : m.normal ? m.normal.ref : plain;
  if (!(out.bsdf.anisotropy > 0.0f) || !tangentSpace(s, at, ref, out, space)) return;
  const float c = std::cos(m.anisotropyRotation), r = std::sin(m.anisotropyRotation);
  const Vec3 t = space.tangent * (c * direction.x - r * direction.y) + space.bitangent * (r * direction.x + c * direction.y);
  const Vec3 across = t - out.n * glm::dot(out.n, t);
  if (!(glm::dot(across, across) > 1e-8f)) return;  // a texel of direction 0, or a normal map that turned the normal onto it
  out.tangent = t;
  out.hasTangent = true;
}

void SurfaceTable::detail(const SurfaceInstance& s, uint32_t a, uint32_t b, uint32_t c, float w, float u, float v, const Vec3& d, Surface& out) {
  const SurfaceMaterial& m = *s.material;
  const Place at{a, b, c, w, u, v};
  if (s.colours) out.bsdf.albedo *= Vec3(w * s.colours[a] + u * s.colours[b] + v * s.colours[c]);
  if (m.albedo) out.bsdf.albedo *= Vec3(m.albedo.texture->sample(uvAt(s, at, m.albedo.ref)));
  out.bsdf.albedo = glm::clamp(out.bsdf.albedo, Vec3(0.0f), Vec3(1.0f));  // an albedo above 1 would make energy
  if (m.metallicRoughness && !m.lambert) {
    const Vec4 t = m.metallicRoughness.texture->sample(uvAt(s, at, m.metallicRoughness.ref));
    out.bsdf.roughness *= t.y;
    out.bsdf.metallic *= t.z;
  }
  const Vec3 plain = out.n;
  if (m.normal) out.n = mapped(s, at, m.normal, m.normalScale, d, out);
  if (!m.lobeTextured) return;
  lobes(s, at, out);
  if (out.bsdf.anisotropy > 0.0f) anisotropy(s, at, out);
  // The coat lies over the bumps of the base: its normal is its own map's, or the plain one.
  if (out.bsdf.clearcoat > 0.0f && (m.normal || m.clearcoatNormal)) {
    const Vec3 base = out.n;
    out.n = plain;
    const Vec3 coat = m.clearcoatNormal ? mapped(s, at, m.clearcoatNormal, m.coatNormalScale, d, out) : plain;
    out.n = base;
    out.bsdf.clearcoatNormal = out.frame().toLocal(coat);
  }
}

}  // namespace trace
}  // namespace gobo
