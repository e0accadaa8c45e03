// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/style.h"

#include "filters/parameter.h"
#include "filters/stylised/abstraction.h"
#include "filters/stylised/distance_field.h"
#include "filters/stylised/transfer.h"

namespace gobo {

NodeId planStyle(Graph& graph, const ShadowInput& input, NodeId v, const v1::ShadowStyle& style) {
  const auto number = [&](const char* name) { return float(numberParameter(style, name)); };
  const Extent extent{input.width, input.height, input.viewSamples};
  const float angle = number("angle_deg") * (kPi / 180.0f);
  StyleDistanceSettings d;
  d.extent = extent;
  d.power = int(number("power"));
  d.norm = choiceParameter(style, "norm") == v1::ShadowStyle::PUBLISHED ? StyleNorm::Published : StyleNorm::Local;
  d.angle = angle;
  NodeId distance = addShadowFilter(graph, makeStyleDistanceNode(d), {v, input.gbuffer}, "style_distance", input);
  if (const float sigma = number("abstraction"); sigma > 0.0f)
    distance = addShadowFilter(graph, makeStyleAbstractionNode({extent, sigma, angle}), {distance, input.gbuffer}, "style_abstraction", input);
  const StyleTransferSettings t{number("inflation"), number("softness"), number("brightness")};
  std::vector<NodeId> inputs{distance};
  if (input.clear) inputs.push_back(v);
  GraphNode n{makeStyleTransferNode(t), std::move(inputs), {}, "style_transfer:" + input.scene->lights[size_t(input.light)].name};
  n.approximate = "a style in the place of the light's own shadow";
  return graph.add(std::move(n));
}

}  // namespace gobo
