// SPDX-License-Identifier: Apache-2.0
// What lies on the base: sheen (KHR_materials_sheen, Charlie) and above it clearcoat (KHR_materials_clearcoat), as seen from one
// direction. Each layer lets min(1 - albedo(o), 1 - albedo(i)) through to what is below (the sheen extension's rule; for the coat it
// is reciprocal where the extension's 1 - F(o) is not), so no stack of layers gives more than it gets.
// A base that transmits into a volume has its layers outside: from inside they only dim what leaves.
// Internal to bsdf.cpp.
#pragma once

#include "trace/bsdf.h"
#include "trace/bsdf_albedo.h"
#include "trace/bsdf_ggx.h"

namespace gobo {
inline namespace trace {

struct Layers {
  float coat, sheenAlpha, sheenRoughness, sheenMost;
  bool coatSmooth, inside, hasCoat, hasSheen;
  Vec3 sheenColor;
  Ggx g;
  ReflectionAlbedo table;
  Frame coatFrame;              // z: the coat's normal, turned towards the viewer if it faces away
  Vec3 oc;                      // viewer in it
  float coatO = 1, sheenO = 1;  // passed towards the viewer
  float sheenScaleO = 1;
  float coatP = 0, sheenP = 0, baseP = 1;

  Layers(const BsdfParams& p, const Vec3& o);
  void choose(float baseEnergy);
  static bool any(const BsdfParams& p) { return p.clearcoat > 0.0f || maxComponent(p.sheenColor) > 0.0f; }
  /// A rough coat or a sheen can be evaluated.
  static bool evaluable(const BsdfParams& p);

  /// Share of the base's light that passes both layers.
  float passed(const Vec3& i) const;
  /// Adds the layers' own light and density; i.z > 0.
  void evaluate(const Vec3& o, const Vec3& i, BsdfValue& value, float& pdf) const;
  /// uLobe < coatP + sheenP. Delta coats come with their weight.
  bool sample(float uLobe, const Vec2& u, BsdfSample& out) const;

 private:
  float coatAlbedo(float mu) const;
};

}  // namespace trace
}  // namespace gobo
