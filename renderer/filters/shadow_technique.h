// SPDX-License-Identifier: Apache-2.0
// A shadow technique turns (G-buffer, one light) into a visibility term by adding its sources and filters to the graph.
// Registering one: a line in filters/registry.cpp; parameters: a message in proto/gobo/v1/filters.proto.
#pragma once

#include <string>
#include <vector>

#include "base/status.h"
#include "gobo/v1/filters.pb.h"
#include "scene/camera.h"
#include "scene/scene.h"
#include "terms/graph.h"
#include "terms/view_place.h"

namespace gobo {
inline namespace filters {

struct ShadowInput {
  ScenePtr scene;       ///< effective scene
  int light = 0;        ///< index into scene->lights
  NodeId gbuffer = -1;  ///< term "gbuffer" (terms/gbuffer.h)
  Camera camera;
  int width = 0, height = 0, viewSamples = 1;
  ViewPlace place;
  int filmWidth() const { return place.whole() ? width : place.filmWidth; }
  int filmHeight() const { return place.whole() ? height : place.filmHeight; }
  uint64_t seed = 0;
  bool clear = false;  ///< hasClearSurfaces(scene) (trace/straight.h): visibility is RGB
};

/// False of rectangles and disks that shine to both sides: a map is one view from the light, of what lies on its axis' side.
inline bool oneSided(const LightShape& shape) { return !(shape.twoSided && (shape.kind == LightKind::Rect || shape.kind == LightKind::Disk)); }

struct ShadowTechniqueEntry {
  v1::ShadowTechnique::TechniqueCase key;
  const char* name;
  /// Which light kinds it can do; others fall back to ray tracing, reported in the plan.
  bool (*supports)(LightKind kind);
  /// Adds nodes; returns the one whose term holds plane "V" (float, [0,1], view-sample domain; one channel, or RGB where the scene is
  /// `clear`). Techniques that use a map leave clear surfaces to planTint (filters/tinted_visibility.h).
  Result<NodeId> (*plan)(Graph& graph, const ShadowInput& input, const v1::ShadowTechnique& technique);
  bool usesMap = false;  ///< reads ShadowTechnique.map; then lights must be oneSided
  /// Which lights of those kinds it can do; null: all of them.
  bool (*suits)(const LightShape& shape) = nullptr;
  bool does(const LightShape& shape) const {
    if (usesMap && !oneSided(shape)) return false;
    return supports(shape.kind) && (!suits || suits(shape));
  }
};

/// Adds a filter labelled "what:LIGHT".
NodeId addShadowFilter(Graph& graph, NodePtr node, std::vector<NodeId> inputs, const std::string& what, const ShadowInput& input);
/// InvalidArgument, naming "shadows.field" and the value, unless low <= value <= high.
Status checkShadowRange(const std::string& field, double value, double low, double high);

/// Null if the technique is not a visibility technique (path_traced, or not set).
const ShadowTechniqueEntry* findShadowTechnique(v1::ShadowTechnique::TechniqueCase key);
const std::vector<ShadowTechniqueEntry>& shadowTechniques();

}  // namespace filters
}  // namespace gobo
