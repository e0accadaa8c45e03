// SPDX-License-Identifier: Apache-2.0
// Reading a G-buffer sample by sample.
#pragma once

#include "base/vec.h"
#include "terms/term_shape.h"
#include "trace/accel.h"

namespace gobo {
inline namespace terms {

/// The planes of a "gbuffer" that sources start rays from. A view: the term must outlive it.
struct SurfaceSamples {
  explicit SurfaceSamples(const Term& g)
      : P(g.floats("P")), N(g.floats("N")), Ng(g.floats("Ng")), footprint(g.floats("footprint")), instance(g.plane<uint32_t>("instance")) {}
  /// What it needs of a node's input.
  static void reads(Wiring& w, size_t i) {
    w.reads<float>(i, "P", {3}).reads<float>(i, "N", {3}).reads<float>(i, "Ng", {3}).reads<float>(i, "footprint").reads<uint32_t>(i, "instance");
  }
  std::span<const float> P, N, Ng, footprint;
  std::span<const uint32_t> instance;

  size_t size() const { return instance.size(); }
  bool hit(size_t e) const { return instance[e] != ~0u; }
  Vec3 position(size_t e) const { return Vec3(P[3 * e], P[3 * e + 1], P[3 * e + 2]); }
  Vec3 normal(size_t e) const { return Vec3(N[3 * e], N[3 * e + 1], N[3 * e + 2]); }
  Vec3 geometricNormal(size_t e) const { return Vec3(Ng[3 * e], Ng[3 * e + 1], Ng[3 * e + 2]); }
  /// For shadowRay().
  Vec3 reach(size_t e, const Accel& accel) const { return accel.reach(instance[e]); }
};

}  // namespace terms
}  // namespace gobo
