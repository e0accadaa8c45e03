// SPDX-License-Identifier: Apache-2.0
#include "plan/slices.h"

#include <algorithm>
#include <iterator>

#include "filters/slice_sum.h"
#include "filters/with_alpha.h"
#include "plan/denoised_slices.h"
#include "plan/filtered_light.h"
#include "plan/moment.h"
#include "plan/output_plans.h"
#include "request/shutter.h"

namespace gobo {
inline namespace plan {

namespace {

/// What a shutter's slices of an output are together.
SlicePlane::How togetherOf(const std::string& output) {
  if (output == "sample_count") return SlicePlane::How::Sum;
  return infoOf(output).kind == OutputKind::Matte ? SlicePlane::How::Ranked : SlicePlane::How::Mean;
}

/// Poses of a shutter's slices are made before anything is admitted, and are there at once.
constexpr uint64_t kMostPoseBytes = 1ull << 30;

/// Of what a pose does not share with the loaded scene: its lists, and mesh arrays that are others. (Meshes of a variant share theirs.)
uint64_t bytesOfPose(const Scene& posed, const Scene& base) {
  if (&posed == &base) return 0;
  uint64_t bytes = posed.instances.size() * sizeof(Instance) + posed.lights.size() * sizeof(Light) + posed.materials.size() * sizeof(Material);
  const auto add = [&](const auto& array, const auto& rest) {
    if (array.data() != rest.data()) bytes += array.size() * sizeof(array[0]);
  };
  static const Mesh none;
  for (size_t i = 0; i < posed.meshes.size(); ++i) {  // an edit of an object may add one
    const Mesh &m = *posed.meshes[i], &rest = i < base.meshes.size() ? *base.meshes[i] : none;
    if (&m == &rest) continue;
    add(m.indices, rest.indices);
    add(m.positions, rest.positions);
    add(m.normals, rest.normals);
    add(m.tangents, rest.tangents);
    add(m.colours, rest.colours);
    for (size_t u = 0; u < std::size(m.uv); ++u) add(m.uv[u], rest.uv[u]);
  }
  return bytes;
}

}  // namespace

Result<uint64_t> planSlices(Plan& plan, const ScenePtr& base, const v1::RenderRequest& request, uint32_t passes, const PixelWindow& window,
                            const PlannerServices& services) {
  const uint32_t slices = shutterSlices(request);
  std::vector<NodeId> pictures;
  std::vector<SlicePlane> planes;
  std::vector<OutputPlane> middle;  // outputs of one slice
  std::vector<size_t> first;        // of each output's planes
  std::vector<NoisyPlanes> noisy;   // of those that are filtered
  std::vector<bool> lit;            // whether filters have something to do in any slice
  uint64_t reserved = 0, poses = 0;
  Sky sky;
  for (uint32_t k = 0; k < slices; ++k) {
    GOBO_ASSIGN(Moment moment, momentOf(base, request, k, sky, services));
    sky = moment.sky;
    poses += bytesOfPose(*moment.effective.scene, *base);  // the graph has all of them
    if (const uint64_t all = poses / (k + 1) * slices; all > kMostPoseBytes)
      return Status(Code::ResourceExhausted,
                    "request.camera.shutter_slices = " + std::to_string(slices) + ": that many poses of the scene are " + std::to_string(all >> 20) +
                        " MiB; must be at most " + std::to_string(kMostPoseBytes >> 20),
                    "request.camera.shutter_slices");
    const NodeId begin = plan.graph.size();
    std::vector<PlannedOutput> planned;
    std::vector<OutputPlane> outputs;
    GOBO_ASSIGN(const uint64_t held, planMoment(plan, planned, outputs, base, moment, passes, window, services));
    plan.graph.addToLabels(begin, ":slice " + std::to_string(k + 1));
    reserved = std::max(reserved, held);
    lit.resize(outputs.size());
    bool seen = false;  // features are shared
    for (size_t i = 0; i < outputs.size(); ++i) {
      const OutputPlane& o = outputs[i];
      if (k == 0) first.push_back(planes.size());
      if (o.noisy) {
        lit[i] = lit[i] || o.noisy->lit;
        if (k == 0) noisy.push_back(slicedPlanes(*o.noisy, planes, noisy.empty() ? nullptr : &noisy[0]));
        addNoisySlice(*o.noisy, pictures, seen);
        seen = true;
        if (o.clear >= 0) pictures.push_back(o.clear);
        if (o.clear >= 0 && k == 0) planes.push_back({"s0", 3});
        continue;
      }
      if (o.clear >= 0) {  // to be filtered before it gets its alpha
        pictures.insert(pictures.end(), {o.node, o.clear});
        if (k == 0) planes.insert(planes.end(), {{o.plane, 3}, {"s0", 3}});
        continue;
      }
      pictures.push_back(o.node);
      if (k == 0) planes.push_back({o.plane, plan.graph.at(o.node).shape.find(o.plane)->channels, togetherOf(planned[i].name)});
    }
    if (k == slices / 2) {
      middle = std::move(outputs);
      plan.effective = std::move(moment.effective);
      plan.groups = std::move(moment.groups);
      plan.outputs = std::move(planned);
    }
  }
  const int width = window.width ? window.width : int(request.width()), height = window.width ? window.height : int(request.height());
  const size_t all = planes.size();
  size_t filtered = 0;
  const NodeId sum = plan.graph.add({makeSliceSumNode(std::move(planes), width, height, int(slices)), std::move(pictures), {}, "shutter"});
  GOBO_TRY(plan.graph.wiring());
  for (size_t i = 0; i < plan.outputs.size(); ++i) {
    PlannedOutput& o = plan.outputs[i];
    o.node = sum;
    o.plane = slicedPlane(first[i]);
    const Chain chain = o.name == "beauty" ? chainOf(request, o.name) : Chain{};
    if (middle[i].noisy) {
      GOBO_ASSIGN(o.node, planDenoisedSlices(plan.graph, request, sum, noisy[filtered++], *middle[i].noisy, lit[i], int(slices), width, height, o.name));
    } else if (!chain.empty()) {
      o.node = plan.graph.add({makeSlicePartNode("picture", {{"rgb", 3}}, first[i], width, height), {sum}, {}, o.name});
    } else continue;
    o.plane = "rgb";
    o.node = addChain(plan.graph, o.node, chain, pictureShape(width, height), o.name);
    if (middle[i].clear < 0) continue;
    const size_t last = (i + 1 < first.size() ? first[i + 1] : all) - 1;
    const NodeId clear = plan.graph.add({makeSlicePartNode("radiance", {{"s0", 3}}, last, width, height), {sum}, {}, o.name + " background"});
    o.node = plan.graph.add({makeWithAlphaNode(width, height), {o.node, clear}, {}, o.name + " with alpha"});
    o.plane = "rgba";
    o.channels.push_back("A");
  }
  GOBO_TRY(plan.graph.wiring());
  return reserved + poses;
}

}  // namespace plan
}  // namespace gobo
