// SPDX-License-Identifier: Apache-2.0
// What fills a closed mesh: KHR_materials_volume absorption, homogeneous scattering (draft KHR_materials_volume_scatter), and
// the stack of volumes that a path is inside of. Pure functions; no state.
//   extinction  sigma = -ln(attenuationColor) / attenuationDistance, per channel, 1/m (Beer-Lambert)
//   scattering  sigma_s = albedo sigma; the material's colour is the albedo of a thick slab, turned into the albedo of one
//               event by the inverse of van de Hulst's formula (Kulla & Conty 2017, "Revisiting Physically Based Shading")
//   phase       Henyey & Greenstein 1941
// Overlaps: the volume entered last counts. Leaving another one, or meeting the boundary of the medium that one is in
// already, changes nothing: such a boundary is passed straight. So liquid may overlap the glass around it, and the optical
// index at every boundary is that of the volume over that of what is outside it there.
#pragma once

#include <cstdint>
#include <vector>

#include "base/vec.h"
#include "scene/material.h"

namespace gobo {
inline namespace trace {

struct Interior {
  Vec3 sigma{0.0f};   ///< extinction, 1/m
  Vec3 albedo{0.0f};  ///< of one scattering event
  float g = 0;        ///< mean cosine, -0.99 .. 0.99
  float ior = 1.5f;
  bool absorbs = false;  ///< some sigma > 0
  bool scatters = false;

  Vec3 transmittance(float t) const { return Vec3(std::exp(-sigma.x * t), std::exp(-sigma.y * t), std::exp(-sigma.z * t)); }
};
Interior makeInterior(const Bsdf& bsdf);
/// True if the material bounds a volume that light can enter.
inline bool boundsVolume(const Bsdf& b) { return b.thickness > 0.0f && (b.transmission > 0.0f || b.diffuseTransmission > 0.0f) && !b.unlit; }

/// Albedo of one event for the diffuse reflectance `multiple` of a thick slab.
float singleScatteringAlbedo(float multiple, float g);
/// Phase function, 1/sr; c = cosine between the directions of travel.
float henyeyGreenstein(float c, float g);
/// New direction of travel; its density is henyeyGreenstein.
Vec3 sampleHenyeyGreenstein(const Vec3& d, float g, const Vec2& u);

/// Index of channel 0..2 under dispersion = 20 / Abbe number: KHR_materials_dispersion puts red and blue symmetrically about
/// the green (d) line, so that their distance is (ior - 1) / Abbe number.
inline float dispersedIor(float ior, float dispersion, int channel) { return ior + float(channel - 1) * (ior - 1.0f) * 0.025f * dispersion; }

/// Volumes around a point of a path, by index into SurfaceTable::interiors(). Four deep; what is deeper is not noticed.
struct MediumStack {
  static constexpr int kMost = 4;
  int depth;
  int32_t id[kMost];  // by material: there may be more than 32767

  void clear() { depth = 0; }
  int top() const { return depth > 0 ? id[depth - 1] : -1; }
  bool holds(int volume) const {
    for (int k = 0; k < depth; ++k)
      if (id[k] == volume) return true;
    return false;
  }
  /// Its boundary changes nothing: the path is in that medium already, or in one that it entered later.
  bool passes(int volume, bool entering) const {
    if (entering) return top() == volume;
    if (!holds(volume)) return false;
    if (top() != volume) return true;
    return depth > 1 && id[depth - 2] == volume;
  }
  /// Index of the volume (`ior` as its surface has it) over what is outside it at its boundary; 1 where that changes nothing.
  float relativeIor(const std::vector<Interior>& interiors, int volume, float ior, bool entering) const {
    if (entering) return top() < 0 ? ior : top() == volume ? 1.0f : ior / interiors[size_t(top())].ior;
    if (!holds(volume)) return ior;
    MediumStack outside = *this;
    outside.leave(volume);
    return outside.top() < 0 ? ior : ior / interiors[size_t(outside.top())].ior;
  }
  void enter(int volume) {
    if (depth < kMost) id[depth++] = int32_t(volume);
  }
  /// Takes away the latest entry of `volume`, if any.
  void leave(int volume) {
    for (int k = depth - 1; k >= 0; --k) {
      if (id[k] != volume) continue;
      for (--depth; k < depth; ++k) id[k] = id[k + 1];
      return;
    }
  }
};

}  // namespace trace
}  // namespace gobo
