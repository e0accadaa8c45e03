// SPDX-License-Identifier: Apache-2.0
// Signed L_p-averaged distance to the contour of a shadow: the dear stage of stylised shadows (DeCoro, Cole, Finkelstein, Rusinkiewicz 2007, equation 3.2 of
// DeCoro's thesis).
//
// Computes     D(x) of filters/stylised/averaged_distance.h at every view sample, negative in shadow (V < 1/2), against the contour of its layer
//              (filters/stylised/contour.h), in the world. Segments whose normals differ from the sample's by more than `angle` do not count.
// Inputs       0: a visibility term, plane V (1 or 3 channels), of any technique: it is hard at 1/2, or at the middle of one of `levels` steps. 1: "gbuffer"
// (P, N, Ng, instance, footprint). Output       term "style_distance", domain ViewSample, plane D f32 in scene units: never 0, so that its sign says what V
// does; +-1e30 where there is no contour to
//              see, and +1e30 where nothing is hit.
// Parameters   power 2 .. 64; norm; angle 0 .. pi; level, levels.
// Error        The sum within kFieldError (p - 1) of itself, so D within kFieldError, by bounds that add up as if every piece were at its worst; what is seen
// is below 1e-4.
//              Marching squares over hard visibility make oblique contours up to 8 % too long: that is 1.1 % of D at p = 8, and 8 % at p = 2.
// Cost         Contour and tree by the layer, then some tens of sources a sample near the contour, and one polynomial a sample on planes far from it
//              (filters/stylised/contour_tree.h, interpolated_sums.h): docs/intent.md has times. Two segments a square and their tree are the bound of what it
//              holds, 350 bytes a sample; a contour of a few thousand segments is one of a few hundred kB.
// Fails where  contours lie outside the extent or behind something (their distance is missing); normals bend: D jumps where a contour is at `angle`;
// `instance`s that
//              touch see each other's contours, which is meant, and so do walls back to back, which is not.
// Determinism  bit-identical for any number of threads: patches of 8 x 8 samples, and those of patches, are the same for all.
// Windows      D depends on the whole picture: no window (not tileable). Plans make it of the whole, with a guard band where one is asked for, and cut
// (techniques/direct_visibility).
#pragma once

#include <functional>

#include "filters/stylised/averaged_distance.h"
#include "terms/node.h"

namespace gobo {
inline namespace filters {

struct StyleDistanceSettings {
  Extent extent;
  int power = 8;
  StyleNorm norm = StyleNorm::Local;
  float angle = 0.78539816f;  ///< radians (45 degrees)
  int level = 0, levels = 1;  ///< of soft visibility: the contour, and sign, of (level + 1/2) / levels
  float pixel = 0;            ///< above 0: in the picture, with pixels of that width (filters/stylised/screen_metric.h); 0: in the world
  int hidden = 0;             ///< surfaces behind those that are seen whose contours count, too (filters/stylised/hidden_contours.h): two inputs each
  /// Without the extent. One level, the world, no hidden layers say nothing: keys of before hold.
  void hash(Hasher& h) const;
};
/// Of a node of these settings: a visibility term and a "gbuffer", as the contour reads them.
void readsContour(Wiring& w, const StyleDistanceSettings& settings);
/// Calls body(ContourInput of a layer, layer), layer by layer, in the world or in the picture; stops at an error.
Status forEachContourLayer(const StyleDistanceSettings& settings, const Term& visibility, const Term& gbuffer,
                           const std::function<Status(const ContourInput&, size_t)>& body);

inline constexpr float kLeastStyleDistance = 1e-30f;  ///< what a sample on the contour has, so that D has a sign
inline constexpr double kFieldError = 2e-3;           ///< bound of the relative error of D; what is seen is a twentieth of it, and tests hold it to 1e-4

NodePtr makeStyleDistanceNode(const StyleDistanceSettings& settings);

/// How many terms (sources at points, polynomials at points) the node adds up, for tests of what its work grows with.
uint64_t styleDistanceTerms(const StyleDistanceSettings& settings, const Term& visibility, const Term& gbuffer, const TaskArena& arena);

}  // namespace filters
}  // namespace gobo
