// SPDX-License-Identifier: Apache-2.0
// The fields of scene structs as lists: visitor(name, field) for each, in a fixed order. Digests (scene_hash.cpp), checks
// (scene_check.cpp) and the scene blob go through these lists, so a new field cannot be forgotten in one of them.
// Works on const and non-const structs. TextureRef fields are visited whole.
#pragma once

#include <type_traits>

#include "scene/camera.h"
#include "scene/light.h"
#include "scene/material.h"

namespace gobo {
inline namespace scene {

template <typename S, typename T>
concept Same = std::is_same_v<std::remove_cvref_t<S>, T>;

template <Same<TextureRef> S, typename V>
void visitFields(S& s, V&& v) {
  v("texture", s.texture);
  v("texcoord", s.texcoord);
  v("offset", s.offset);
  v("scale", s.scale);
  v("rotation", s.rotation);
}

template <Same<Coverage> S, typename V>
void visitFields(S& s, V&& v) {
  v("mode", s.mode);
  v("cutoff", s.cutoff);
  v("factor", s.factor);
  v("texture", s.texture);
  v("doubleSided", s.doubleSided);
}

template <Same<Albedo> S, typename V>
void visitFields(S& s, V&& v) {
  v("factor", s.factor);
  v("texture", s.texture);
}

template <Same<Bsdf> S, typename V>
void visitFields(S& s, V&& v) {
  v("metallic", s.metallic);
  v("roughness", s.roughness);
  v("metallicRoughness", s.metallicRoughness);
  v("normal", s.normal);
  v("normalScale", s.normalScale);
  v("ior", s.ior);
  v("unlit", s.unlit);
  v("specular", s.specular);
  v("specularTexture", s.specularTexture);
  v("specularColor", s.specularColor);
  v("specularColorTexture", s.specularColorTexture);
  v("transmission", s.transmission);
  v("transmissionTexture", s.transmissionTexture);
  v("thickness", s.thickness);
  v("attenuationColor", s.attenuationColor);
  v("attenuationDistance", s.attenuationDistance);
  v("dispersion", s.dispersion);
  v("scatterAlbedo", s.scatterAlbedo);
  v("scatterAnisotropy", s.scatterAnisotropy);
  v("diffuseTransmission", s.diffuseTransmission);
  v("diffuseTransmissionTexture", s.diffuseTransmissionTexture);
  v("diffuseTransmissionColor", s.diffuseTransmissionColor);
  v("diffuseTransmissionColorTexture", s.diffuseTransmissionColorTexture);
  v("clearcoat", s.clearcoat);
  v("clearcoatRoughness", s.clearcoatRoughness);
  v("clearcoatTexture", s.clearcoatTexture);
  v("clearcoatRoughnessTexture", s.clearcoatRoughnessTexture);
  v("clearcoatNormal", s.clearcoatNormal);
  v("clearcoatNormalScale", s.clearcoatNormalScale);
  v("sheenColor", s.sheenColor);
  v("sheenRoughness", s.sheenRoughness);
  v("sheenColorTexture", s.sheenColorTexture);
  v("sheenRoughnessTexture", s.sheenRoughnessTexture);
  v("anisotropy", s.anisotropy);
  v("anisotropyRotation", s.anisotropyRotation);
  v("anisotropyTexture", s.anisotropyTexture);
  v("iridescence", s.iridescence);
  v("iridescenceIor", s.iridescenceIor);
  v("iridescenceThicknessMin", s.iridescenceThicknessMin);
  v("iridescenceThicknessMax", s.iridescenceThicknessMax);
  v("iridescenceTexture", s.iridescenceTexture);
  v("iridescenceThicknessTexture", s.iridescenceThicknessTexture);
}

template <Same<Emission> S, typename V>
void visitFields(S& s, V&& v) {
  v("radiance", s.radiance);
  v("texture", s.texture);
}

/// The four facets of a material, without its name.
template <Same<Material> S, typename V>
void visitFields(S& s, V&& v) {
  v("coverage", s.coverage);
  v("albedo", s.albedo);
  v("bsdf", s.bsdf);
  v("emission", s.emission);
}

template <Same<LightShape> S, typename V>
void visitFields(S& s, V&& v) {
  v("kind", s.kind);
  v("position", s.position);
  v("axis", s.axis);
  v("u", s.u);
  v("v", s.v);
  v("radius", s.radius);
  v("cosInner", s.cosInner);
  v("cosOuter", s.cosOuter);
  v("range", s.range);
  v("twoSided", s.twoSided);
  v("instance", s.instance);
  v("angularSize", s.angularSize);
  v("skyRectangle", s.skyRectangle);
  v("profile", s.profile);
  v("profileRotation", s.profileRotation);
}

template <Same<Camera> S, typename V>
void visitFields(S& s, V&& v) {
  v("toWorld", s.toWorld);
  v("perspective", s.perspective);
  v("yfov", s.yfov);
  v("yheight", s.yheight);
  v("cullBackFaces", s.cullBackFaces);
  v("centre", s.centre);
}

}  // namespace scene
}  // namespace gobo
