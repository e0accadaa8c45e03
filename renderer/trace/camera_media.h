// SPDX-License-Identifier: Apache-2.0
// Which volumes a point lies in, by the generalized winding number of each closed mesh (the signed solid angle of its
// triangles, Van Oosterom & Strackee 1983, over 4 pi; Jacobson et al. 2013): above one half is inside. No ray can miss an edge,
// and an open mesh counts as far as it surrounds the point. Cost: O(vertices) of volume meshes, O(triangles) of those whose
// box holds the point. Pure function; facets Topology, Pose, Bsdf.
#pragma once

#include <vector>

#include "base/stop.h"
#include "scene/scene.h"

namespace gobo {
inline namespace trace {

/// Materials (indices) of the volumes around p, outermost first: by the size of the instances' boxes. `stop` is polled every few thousand
/// triangles; what it returns then is of no use.
std::vector<int> volumesAround(const SceneView& view, const Vec3& p, const StopToken& stop = {});
/// Where the camera's rays start: its position; for an orthographic camera the middle of its window.
Vec3 cameraPoint(const Camera& camera);

}  // namespace trace
}  // namespace gobo
