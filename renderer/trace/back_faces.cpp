// SPDX-License-Identifier: Apache-2.0
#include "trace/back_faces.h"

#include <algorithm>

#include "trace/accel_impl.h"
#include "trace/interior.h"

namespace gobo {
inline namespace trace {

namespace {
constexpr uint8_t kSingleSided = 1, kTurned = 2;  // kTurned: Embree's normal of the instance points inside
}

bool showsFrontOnly(const Coverage& coverage, const Bsdf& bsdf) {
  return !coverage.doubleSided && !(bsdf.transmission > 0.0f) && !(bsdf.diffuseTransmission > 0.0f) && !boundsVolume(bsdf);
}

BackFaces::BackFaces(const SceneView& view, const Accel& accel) {
  const std::vector<Instance>& instances = view.instances();
  sides_.assign(instances.size(), 0);
  bool any = false;
  for (size_t i = 0; i < instances.size(); ++i) {
    const int material = view.mesh<Facet::Topology>(instances[i].mesh).material;
    if (!showsFrontOnly(view.coverage(material), view.bsdf(material))) continue;
    // Inside an Embree instance ray and normal are the object's, where the winding is the file's; copies have the world's winding.
    const InstanceGeometry& g = accel.impl().instances[i];
    sides_[i] = uint8_t(kSingleSided | (g.world && g.mirrored ? kTurned : 0));
    any = true;
  }
  if (!any) sides_.clear();
}

void BackFaces::init(Context& c) const {
  embree::initContext(c.context);
  c.faces = this;
}

void BackFaces::filter(const RTCFilterFunctionNArguments* args) {
  const std::vector<uint8_t>& sides = reinterpret_cast<const Context*>(args->context)->faces->sides_;
  const unsigned N = args->N;
  for (unsigned i = 0; i < N; ++i) {
    if (args->valid[i] == 0 || RTCRayN_id(args->ray, N, i) != kPasses) continue;
    const unsigned instance = RTCHitN_instID(args->hit, N, i, 0);
    const uint8_t side = sides[instance == RTC_INVALID_GEOMETRY_ID ? RTCHitN_geomID(args->hit, N, i) : instance];
    if (!(side & kSingleSided)) continue;
    const float along = RTCHitN_Ng_x(args->hit, N, i) * RTCRayN_dir_x(args->ray, N, i) + RTCHitN_Ng_y(args->hit, N, i) * RTCRayN_dir_y(args->ray, N, i) +
                        RTCHitN_Ng_z(args->hit, N, i) * RTCRayN_dir_z(args->ray, N, i);
    if (side & kTurned ? along < 0.0f : along > 0.0f) args->valid[i] = 0;
  }
}

}  // namespace trace
}  // namespace gobo
