// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/style.h"

#include <algorithm>
#include <string>

#include "filters/parameter.h"
#include "filters/stylised/abstraction.h"
#include "filters/stylised/distance_field.h"
#include "filters/stylised/sampled_distance.h"
#include "filters/stylised/style_levels.h"
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
  d.levels = std::max(int(number("levels")), 1);
  const auto samples = uint32_t(number("samples"));
  const auto approximate = [&](NodePtr node, std::vector<NodeId> inputs, const std::string& what, bool transient = false) {
    GraphNode n{std::move(node), std::move(inputs), {}, what + ":" + input.scene->lights[size_t(input.light)].name};
    n.transient = transient;
    n.approximate = "a style in the place of the light's own shadow";
    return graph.add(std::move(n));
  };
  const auto planLevel = [&](int level) {
    d.level = level;
    const std::string of = d.levels > 1 ? " " + std::to_string(level + 1) + "/" + std::to_string(d.levels) : "";
    const NodePtr field = samples > 0 ? makeSampledDistanceNode({d, samples, input.seed, input.place}) : makeStyleDistanceNode(d);
    NodeId distance = addShadowFilter(graph, field, {v, input.gbuffer}, "style_distance" + of, input);
    if (const float sigma = number("abstraction"); sigma > 0.0f)
      distance = addShadowFilter(graph, makeStyleAbstractionNode({extent, sigma, angle}), {distance, input.gbuffer}, "style_abstraction" + of, input);
    const StyleTransferSettings t{number("inflation"), number("softness"), number("brightness")};
    std::vector<NodeId> inputs{distance};
    if (input.clear && d.levels == 1) inputs.push_back(v);
    return approximate(makeStyleTransferNode(t), std::move(inputs), "style_transfer" + of,
                       d.levels > 1);  // the distances of levels are kept: the transfer is cheap
  };
  if (d.levels == 1) return planLevel(0);
  std::vector<NodeId> levels;
  if (input.clear) levels.push_back(v);
  for (int level = 0; level < d.levels; ++level) levels.push_back(planLevel(level));
  return approximate(makeStyleLevelsNode(extent, d.levels, input.clear), std::move(levels), "style_levels");
}

}  // namespace gobo
