// SPDX-License-Identifier: Apache-2.0
// Hard shadows of the published lights, blended by how much of the sky a place does not see (the thesis of 2007, chapter 6.2, as future work; digest of seed
// 004, C9 and row 30). A light of some size has no hard shadow where its occluder hides little of the sky; so the shadow is drawn with the place's occlusion o
// as its opacity: V' = 1 - o (1 - V). o = 0, an open place: the shadow is not drawn; o = 1, a closed one: it is the published shadow in full. Between them the
// light is never less than with the hard shadow and never more than without one.
// The thesis names two sources of o, and both are here:
//   Hemisphere  what the direct transfer of Y_0 lacks of that of an open place: one number a place
//   Towards     the zeros of the transfer's expansion: its value in the light's direction by that of an open place
// What it does to the error is measured by bench/transfer_table_bench (docs/environment.md). Pure; any thread.
#pragma once

#include <span>
#include <vector>

#include "base/stop.h"
#include "base/task_arena.h"
#include "techniques/transfer/published/light_powers.h"
#include "terms/term.h"
#include "trace/accel.h"

namespace gobo::transfer::published {

enum class ShadowBlend {
  Hard,        ///< as published: o = 1 everywhere
  Hemisphere,  ///< one o a place
  Towards,     ///< one a place and light
};

/// 1 - T_0 / (pi Y_0), within 0 .. 1. `first`: transfer of harmonic 0 without albedo (nodes.h), irradiance under Y_0.
double occlusionFactor(double first);
/// 1 - what the transfer (bands^2) gives in direction `towards` by what the cosine about `normal` cut to as many bands gives there, within 0 .. 1. Where that
/// is below a twentieth of its top (grazing, or below the horizon) the cut lobe rings: occlusionFactor. Unit vectors, of the transfer's axes.
double occlusionTowards(std::span<const float> transfer, int bands, const DVec3& normal, const DVec3& towards);
/// V' of a shadow V, both in 0 .. 1.
inline double blendedVisibility(double visible, double occlusion) { return 1 - occlusion * (1 - visible); }

/// A view's places with their transfer. Terms of one scene: G-buffer, surface, transfer places (nodes.h), direct transfer of `bands`.
struct ShadowedView {
  const Term &gbuffer, &surface, &places, &direct;
  int bands = 0;
};
/// W/m^2 by view sample, 0 where nothing is hit: of harmonics (bands^2 x 3) by the transfer there and of every light with one shadow ray, blended. All in the
/// world's axes. Not below 0 once all are added. Empty if `stop` fired first.
std::vector<DVec3> publishedIrradiance(const std::vector<double>& harmonics, const std::vector<PublishedLight>& lights, const ShadowedView& view,
                                       const Accel& accel, ShadowBlend blend, const TaskArena& arena, const StopToken& stop = {});

}  // namespace gobo::transfer::published
