// SPDX-License-Identifier: Apache-2.0
// What request.meshes makes of a posed scene: objects with simplified, smoothed or inflated meshes (scene/mesh_filters).
#pragma once

#include "base/stop.h"
#include "gobo/v1/render.pb.h"
#include "scene/scene.h"

namespace gobo {
inline namespace request {

/// Digest of the edits as they are written; requests with equal edits have equal ones.
Hash128 meshEditsHash(const v1::RenderRequest& request);

/// `scene` itself if no edit changes anything. An object's edit touches that object alone: others with the same mesh keep it; all with the same edit
/// and scale share the new one. Lights of emissive objects follow their mesh, with the radiance that they had. Objects of less than a micrometre, which
/// animations hide so, stay as they are.
/// What '*' would simplify away stays unsimplified, with a line in the new scene's warnings (after those of `scene`).
/// Errors name the field: NotFound, no such object; InvalidArgument: a Taubin step above kLargestTaubinStep, an edit by name that leaves nothing of its
/// object or moves a vertex beyond 1e9 m, more than 1e9 triangles of new meshes times passes of smoothing and 40; ResourceExhausted: new meshes of more than
/// 1 GiB. The last two are found before any is made. Cancelled soon after `stop`.
Result<ScenePtr> withMeshEdits(const ScenePtr& scene, const v1::RenderRequest& request, const StopToken& stop = {});

}  // namespace request
}  // namespace gobo
