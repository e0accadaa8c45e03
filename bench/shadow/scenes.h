// SPDX-License-Identifier: Apache-2.0
// Scenes that shadows are measured on: built-in ones, glTF files, and a few that only measuring needs: "planes" and "boxes", whose shadows
// have closed forms, "two-trees", and "blobs", a model of 400 000 triangles.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "scene/scene.h"

namespace gobo::shadowbench {

/// One comparison: which lights and camera of a scene the tables use.
struct SceneEntry {
  std::string scene;       ///< name for benchScene
  std::string hard, soft;  ///< light for hard and for soft shadows; hard may be an area light: its centre casts then
  std::string camera;
  std::string note;
};
/// The scenes of the tables in docs/shadow_maps.md. A glTF file that is not on this machine is left out.
std::vector<SceneEntry> sceneEntries();

/// A name above, a built-in scene, or a path to a .gltf/.glb file. "two-trees", "sponza" (data/derived/sponza.glb): with an
/// area light "key" added. "pergola": the fence under slats; "bench": a park bench.
Result<ScenePtr> benchScene(const std::string& name);

/// The same scene with an area light replaced by a spot at its centre, which is what a hard shadow map of it shows; delta lights stay.
Result<ScenePtr> withHardLight(const Scene& scene, int light);
/// The same scene with a rectangle's edges, or a disk's or sphere's radius, scaled.
Result<ScenePtr> withLightSize(const Scene& scene, int light, float scale);

/// The same scene with a directional light that many degrees wide.
Result<ScenePtr> withSunSize(const Scene& scene, int light, double degrees);

/// Visibility in closed form of a receiver at p for a point q of the light (or direction q, w = 0): scenes "planes" and "boxes" only; empty
/// for others.
std::function<bool(const DVec3& p, const DVec3& q, bool direction)> closedForm(const std::string& scene);

}  // namespace gobo::shadowbench
