// SPDX-License-Identifier: Apache-2.0
#include "plan/denoised_slices.h"

#include <array>

#include "filters/composite.h"
#include "filters/denoise/band_limit/lens_features.h"

namespace gobo {
inline namespace plan {

namespace {

using How = SlicePlane::How;

/// Planes of features (filters/denoise/features.h), and what they are together.
struct FeaturePlane {
  const char* name;
  int channels;
  How how;
};
constexpr std::array<FeaturePlane, 8> kFeatures{{{"coverage", 1, How::Mean},  // first: others are by it
                                                 {"albedo", 3, How::Mean},
                                                 {"normal", 3, How::Mean},
                                                 {"position", 3, How::MeanOverSeen},
                                                 {"depth", 1, How::MeanOverSeen},
                                                 {"footprint", 1, How::MeanOverSeen},
                                                 {"even", 1, How::Least},
                                                 {"modulation", 3, How::MeanOfSeen}}};

}  // namespace

bool filtersMeanOfSlices(const v1::RenderRequest& request) { return request.has_denoise() && !request.denoise().has_axis_aligned(); }

NoisyPlanes slicedPlanes(const NoisySlice& slice, std::vector<SlicePlane>& planes, const NoisyPlanes* shared) {
  NoisyPlanes at{shared ? shared->features : planes.size(), 0};
  if (!shared) {
    for (const FeaturePlane& f : kFeatures) {
      const bool seen = f.how == How::MeanOverSeen || f.how == How::MeanOfSeen;
      planes.push_back({f.name, f.channels, f.how, seen ? int(at.features) : -1});
    }
    if (slice.blur >= 0) planes.push_back({"blur", 1, How::Least});  // what is sharp in one of them gives and takes nothing
  }
  at.light = planes.size();
  // One sample a slice has no half: every other slice is one.
  planes.push_back({"rgb", 3, slice.light.first >= 0 ? How::Mean : How::MeanOfEven});
  planes.push_back({"rgb", 3});
  planes.push_back({"rgb", 3});
  return at;
}

void addNoisySlice(const NoisySlice& slice, std::vector<NodeId>& nodes, bool seen) {
  if (!seen) {
    nodes.insert(nodes.end(), kFeatures.size(), slice.light.features);
    if (slice.blur >= 0) nodes.push_back(slice.blur);
  }
  nodes.insert(nodes.end(), {slice.light.first >= 0 ? slice.light.first : slice.light.all, slice.light.all, slice.others});
}

Result<NodeId> planDenoisedSlices(Graph& graph, const v1::RenderRequest& request, NodeId sum, const NoisyPlanes& at, const NoisySlice& of, bool lit, int slices,
                                  int width, int height, const std::string& label) {
  const auto part = [&](const char* term, std::vector<NamedPlane> planes, size_t first, const std::string& name) {
    return graph.add({makeSlicePartNode(term, std::move(planes), first, width, height), {sum}, {}, name});
  };
  std::vector<NamedPlane> planes;
  for (const FeaturePlane& f : kFeatures) planes.push_back({f.name, f.channels});
  NoisyNodes light;
  light.features = part("denoise_features", std::move(planes), at.features, "features of all slices");
  if (of.blur >= 0) {
    const NodeId blur = part("lens_blur", {{"blur", 1}}, at.features + kFeatures.size(), "blur of the lens in all slices");
    light.features = graph.add({denoise::makeLensFeaturesNode(width, height, LobePart::Both), {light.features, blur}, {}, "features through the lens"});
  }
  light.first = part("picture", {{"rgb", 3}}, at.light, label + " traced, first half");
  light.all = part("picture", {{"rgb", 3}}, at.light + 1, label + " traced");
  const NodeId others = part("picture", {{"rgb", 3}}, at.light + 2, label + " not traced");
  light.samples = of.light.samples * uint32_t(slices);
  light.firstSamples = of.light.first >= 0 ? of.light.firstSamples * uint32_t(slices) : uint32_t(slices + 1) / 2;
  NodeId smooth = -1;
  if (lit) { GOBO_ASSIGN(smooth, planFiltered(graph, request.denoise(), light, width, height, label)); }
  // The sum is the last input for the samples that it lost.
  Expression e;
  std::vector<NodeId> inputs;
  if (smooth >= 0) {
    inputs = {smooth, light.features, others, sum};
    const int filtered = e.plane(0, "rgb"), product = e.multiply(filtered, e.plane(1, "modulation"));
    e.add(product, e.plane(2, "rgb"));
  } else {
    inputs = {light.all, others, sum};
    const int traced = e.plane(0, "rgb");
    e.add(traced, e.plane(1, "rgb"));
  }
  GraphNode picture{makeCompositeNode(std::move(e), width, height), std::move(inputs), {}, label};
  if (smooth >= 0) picture.approximate = kDenoisedApproximate;
  return graph.add(std::move(picture));
}

}  // namespace plan
}  // namespace gobo
