// SPDX-License-Identifier: Apache-2.0
// What a request makes of a scene: the effective scene (shapes moved, lights added, environment replaced) and, apart from
// it, the gain of each light. Powers of the effective scene stay nominal, so a change of colour or strength is a gain and
// re-keys nothing but the composite.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "base/status.h"
#include "gobo/v1/render.pb.h"
#include "request/background.h"
#include "request/posed_scene.h"
#include "scene/scene.h"

namespace gobo {
inline namespace request {

struct EffectiveScene {
  ScenePtr scene;
  std::vector<Vec3> gains;        ///< per light of `scene`: RGB factor on nominal() of that light traced alone
  std::vector<Vec3> gainChanges;  ///< per light: gains less what the scene itself says, which is what a cluster holds of it; 0 = unedited
  std::vector<float> scales;      ///< per light: what request.photometric makes of its file's intensity, 1 or 1/683; part of its gain
  bool asInFile = false;          ///< some light shines whose strength is the file's in candela or lux, read as W/sr or W/m^2
  Camera camera;
  Background background;
  EnvironmentPtr sky;  ///< of a request that has one, before it is turned
  std::vector<std::string> warnings;
};

/// Loads the environment file that a request names, by path or digest (the engine checks roots and caches).
using EnvironmentLoader = std::function<Result<EnvironmentPtr>(const v1::EnvironmentSettings& settings)>;

/// Makes the request's variant and pose of a scene (posed_scene.h; the engine caches).
using ScenePoser = std::function<Result<ScenePtr>(const ScenePtr& base, const v1::RenderRequest& request, const StopToken& stop)>;

/// `request` must be resolved. Errors name the field: unknown light, camera, animation or variant, missing kind, degenerate
/// direction. Cancelled soon after `stop` (the loader has its own). `sky`: what another request with the same sky has of it.
Result<EffectiveScene> makeEffectiveScene(const ScenePtr& loaded, const v1::RenderRequest& request, const EnvironmentLoader& load,
                                          const ScenePoser& pose = requestedScene, const StopToken& stop = {}, const EnvironmentPtr& sky = nullptr);

/// Applies a light edit's shape fields (not power) to a light of a scene that is not sealed yet. `path` is used in errors.
Status applyLightShape(const v1::LightEdit& edit, Scene& scene, size_t light, const std::string& path);

/// Power that an added light is traced with: its intensity rounded to a power of 16, white. Edits of colour and small edits
/// of strength then stay gains, and sampling still knows the order of magnitude.
float nominalBucket(float intensity);

/// Estimated radiant flux of a light reaching the scene, W (order of magnitude; used to rank relight groups only). Of no use after `stop`.
double estimatedFlux(const Scene& scene, int light, const StopToken& stop = {});

struct RelightGroups {
  int count = 0;
  std::vector<int> groupOf;               ///< per light
  std::vector<std::vector<int>> members;  ///< per group, ascending
  std::vector<Vec3> nominal;              ///< per light: what it is traced with (path_tracer.h)
  std::vector<float> scales;              ///< per group, for clusters: factor on what it is traced with; all 1 if empty
  bool single(int group) const { return members[group].size() == 1; }
  float scaleOf(int group) const { return scales.empty() ? 1.0f : scales[size_t(group)]; }
};
/// A map and the strongest lights get a group each, the rest share the last. Depends on the effective scene only, not on gains. Of no use after `stop`.
RelightGroups makeGroups(const Scene& scene, int maxGroups, const StopToken& stop = {});
/// A scale (EffectiveScene::scales) that some lights of a cluster have becomes the cluster's: nothing has changed for them then, and the others are
/// traced apart on top of what it leaves of them.
void scaleClusters(EffectiveScene& effective, RelightGroups& groups);

}  // namespace request
}  // namespace gobo
