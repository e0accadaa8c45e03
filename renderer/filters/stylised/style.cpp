// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/style.h"

#include <algorithm>
#include <limits>
#include <string>

#include "filters/parameter.h"
#include "filters/stylised/abstraction.h"
#include "filters/stylised/distance_field.h"
#include "filters/stylised/edge_mean.h"
#include "filters/stylised/elongation.h"
#include "filters/stylised/half_width.h"
#include "filters/stylised/hidden_contours.h"
#include "filters/stylised/pattern.h"
#include "filters/stylised/sampled_distance.h"
#include "filters/stylised/style_levels.h"
#include "filters/stylised/style_parameters.h"
#include "filters/stylised/surface_distance.h"
#include "filters/stylised/target.h"
#include "filters/stylised/transfer.h"
#include "terms/occluder_distance.h"

namespace gobo {
inline namespace filters {

namespace {

StyleTransition transitionOf(const v1::ShadowStyle& style) {
  switch (style.transition()) {
    case v1::ShadowStyle::QUINTIC: return StyleTransition::Quintic;
    case v1::ShadowStyle::STAIRCASE: return StyleTransition::Staircase;
    case v1::ShadowStyle::CURVE: return StyleTransition::Curve;
    default: return StyleTransition::Smoothstep;
  }
}

const StyleFormulaList kNoFormulas;

/// Where light comes from for walks along surfaces: its centre, of a mesh that of its box.
StyleLight styleLightOf(const Scene& scene, const LightShape& shape) {
  if (shape.kind == LightKind::Directional) return {shape.axis, true};
  if (shape.kind != LightKind::Mesh) return {shape.position, false};
  const Instance& instance = scene.instances[shape.instance];
  Vec3 low(std::numeric_limits<float>::max()), high(-std::numeric_limits<float>::max());
  for (const Vec3& p : scene.meshes[size_t(instance.mesh)]->positions) {
    const Vec3 at(instance.toWorld * Vec4(p, 1.0f));
    low = glm::min(low, at), high = glm::max(high, at);
  }
  return {0.5f * (low + high), false};
}

template <class Layer>
void markVarying(Layer& l, const StyleFormulaList& formulas) {
  for (const auto& [field, f] : formulas) {
    l.varyingInflation |= field == StyleField::Inflation;
    l.varyingSoftness |= field == StyleField::Softness;
    l.varyingBrightness |= field == StyleField::Brightness;
  }
}

/// The nodes of one light's style, as they come.
class StylePlan {
 public:
  StylePlan(Graph& graph, const ShadowInput& input, NodeId v, const v1::ShadowStyle& style, const StyleFormulas& formulas)
      : graph_(graph),
        input_(input),
        v_(v),
        style_(style),
        formulas_(formulas),
        extent_{input.width, input.height, input.viewSamples},
        angle_(number("angle_deg") * (kPi / 180.0f)) {}

  NodeId plan() {
    StyleDistanceSettings d;
    d.extent = extent_;
    d.power = int(number("power"));
    d.norm = choiceParameter(style_, "norm") == v1::ShadowStyle::PUBLISHED ? StyleNorm::Published : StyleNorm::Local;
    d.angle = angle_;
    d.levels = std::max(int(number("levels")), 1);
    d.pixel = pixel();
    d.hidden = int(number("hidden_layers"));
    hidden_ = planHiddenContours(graph_, input_, d.hidden);
    std::vector<Level> levels;
    for (d.level = 0; d.level < d.levels; ++d.level) levels.push_back(planLevel(d));
    const Level& middle = levels[levels.size() / 2];
    if (levels.size() == 1) return pattern(middle.styled, middle);
    std::vector<NodeId> inputs;
    if (input_.clear) inputs.push_back(v_);
    for (const Level& l : levels) inputs.push_back(l.styled);
    return pattern(approximate(makeStyleLevelsNode(extent_, d.levels, input_.clear), std::move(inputs), "style_levels"), middle);
  }

 private:
  struct Level {
    NodeId styled = -1;
    StyleTransferSettings transfer;
    NodeId parameters = -1;               ///< of the style's own fields, where they vary
    std::vector<NodeId> layerParameters;  ///< of each layer, -1: none
  };

  /// Distance, shape, abstraction and transfer of one contour of soft visibility.
  Level planLevel(const StyleDistanceSettings& d) {
    of_ = d.levels > 1 ? " " + std::to_string(d.level + 1) + "/" + std::to_string(d.levels) : "";
    std::vector<NodeId> sources{v_, input_.gbuffer};
    sources.insert(sources.end(), hidden_.begin(), hidden_.end());
    distance_ = shaped(filter(distanceNode(d), std::move(sources), "style_distance" + of_));
    halfWidths_.clear();
    const NodeId own = abstracted();
    Level level;
    StyleTransferSettings& t = level.transfer;
    t.inflation = number("inflation"), t.softness = number("softness"), t.brightness = number("brightness");
    t.transition = transitionOf(style_);
    if (style_.has_steps()) t.steps = int(style_.steps());
    if (t.transition == StyleTransition::Curve) t.curve.assign(style_.curve().begin(), style_.curve().end());
    t.tinted = input_.clear && d.levels == 1;
    StyleFormulaList formulas;
    for (const auto& f : formulas_.all)
      if (f.first != StyleField::Abstraction) formulas.push_back(f);
    markVarying(t, formulas);
    if (!formulas.empty()) level.parameters = parametersOf(std::move(formulas), own, "");
    std::vector<NodeId> inputs{kept(own, t.inflation, t.varyingInflation ? level.parameters : -1, "")};
    addLayers(level, own, inputs);
    t.distances = int(inputs.size());
    if (t.tinted) inputs.push_back(v_);
    if (level.parameters >= 0) inputs.push_back(level.parameters);
    for (const NodeId id : level.layerParameters)
      if (id >= 0) inputs.push_back(id);
    level.styled = approximate(makeStyleTransferNode(t), std::move(inputs), "style_transfer" + of_,
                               d.levels > 1);  // the distances of levels are kept: the transfer is cheap
    return level;
  }

  /// What elongation and a target make of the distance.
  NodeId shaped(NodeId distance) {
    if (const float length = number("elongation"); length > 0.0f) {
      const StyleLight light = styleLightOf(*input_.scene, input_.scene->lights[size_t(input_.light)].shape);
      distance =
          filter(makeStyleElongationNode({extent_, length, angle_, light, input_.camera, input_.place}), {distance, input_.gbuffer}, "style_elongation" + of_);
    }
    if (const float target = number("target"); target > 0.0f)
      distance = filter(makeStyleTargetNode({extent_, target, number("angularity"), angle_}), {distance, input_.gbuffer}, "style_target" + of_);
    return distance;
  }

  /// The distance with what keep leaves of a deflation by `inflation`, or by plane inflation of `parameters`.
  NodeId kept(NodeId distance, float inflation, NodeId parameters, const std::string& whose) {
    const float keep = number("keep");
    if (!(keep > 0.0f) || (parameters < 0 && inflation >= 0.0f)) return distance;
    NodeId widths = -1;
    for (const auto& [of, id] : halfWidths_)
      if (of == distance) widths = id;
    if (widths < 0) {
      widths = filter(makeStyleHalfWidthNode({extent_, angle_}), {distance, input_.gbuffer}, "style_half_width" + whose + of_);
      halfWidths_.emplace_back(distance, widths);
    }
    std::vector<NodeId> inputs{distance, widths, input_.gbuffer};
    if (parameters >= 0) inputs.push_back(parameters);
    return filter(makeStyleKeepNode({extent_, angle_, keep, inflation, parameters >= 0}), std::move(inputs), "style_keep" + whose + of_);
  }

  float pixel() const { return style_.metric() == v1::ShadowStyle::SCREEN ? 1.0f / float(input_.filmHeight()) : 0.0f; }
  NodePtr distanceNode(const StyleDistanceSettings& d) const {
    const auto samples = uint32_t(number("samples"));
    if (style_.metric() == v1::ShadowStyle::SURFACE) return makeSurfaceDistanceNode(d);
    return samples > 0 ? makeSampledDistanceNode({d, samples, input_.seed, input_.place}) : makeStyleDistanceNode(d);
  }
  float number(const char* name) const { return float(numberParameter(style_, name)); }
  NodeId filter(NodePtr node, std::vector<NodeId> inputs, const std::string& what) {
    return addShadowFilter(graph_, std::move(node), std::move(inputs), what, input_);
  }
  NodeId approximate(NodePtr node, std::vector<NodeId> inputs, const std::string& what, bool transient = false) {
    GraphNode n{std::move(node), std::move(inputs), {}, what + ":" + input_.scene->lights[size_t(input_.light)].name};
    n.transient = transient;
    n.approximate = "a style in the place of the light's own shadow";
    return graph_.add(std::move(n));
  }

  NodeId parametersOf(StyleFormulaList formulas, NodeId edge, const std::string& whose) {
    std::vector<NodeId> inputs{input_.gbuffer};
    const auto reads = [&](StyleName name) {
      for (const auto& [field, f] : formulas)
        if (f.reads(name)) return true;
      return false;
    };
    bool edges = false;
    for (const auto& [field, f] : formulas) edges = edges || f.readsEdges();
    if (edges) inputs.push_back(occluder());
    if (reads(StyleName::Edge)) inputs.push_back(edge);
    return filter(makeStyleParametersNode(extent_, std::move(formulas), formulas_.time, input_.place), std::move(inputs), "style_parameters" + whose + of_);
  }
  NodeId occluder() {
    if (occluder_ >= 0) return occluder_;
    const std::string& light = input_.scene->lights[size_t(input_.light)].name;
    const NodeId rays =
        graph_.add({makeOccluderDistanceNode(extent_), {input_.gbuffer, v_}, {input_.light}, "occluder_distance:" + light, 0, input_.scene, false});
    return occluder_ = filter(makeEdgeMeanNode({extent_, angle_, formulas_.casters}), {rays, v_, input_.gbuffer}, "style_occluder");
  }

  NodeId blurred(float sigma) {
    return sigma > 0.0f ? filter(makeStyleAbstractionNode({extent_, sigma, angle_, false, pixel()}), {distance_, input_.gbuffer}, "style_abstraction" + of_)
                        : distance_;
  }
  NodeId abstracted() {
    const StyleFormula* varying = formulas_.find(StyleField::Abstraction);
    if (!varying) return blurred(number("abstraction"));
    const NodeId widths = parametersOf({{StyleField::Abstraction, *varying}}, -1, "");
    return filter(makeStyleAbstractionNode({extent_, 0.0f, angle_, true, pixel()}), {distance_, input_.gbuffer, widths}, "style_abstraction" + of_);
  }

  /// Layers of equal abstraction, and without a share kept of their own, have one distance. `own`: the style's, before that.
  void addLayers(Level& level, NodeId own, std::vector<NodeId>& inputs) {
    std::vector<std::pair<float, NodeId>> made;
    if (!formulas_.find(StyleField::Abstraction)) made.emplace_back(number("abstraction"), own);
    for (int k = 0; k < style_.layers_size(); ++k) {
      const v1::ShadowStyleLayer& layer = style_.layers(k);
      const auto of = [&](const char* name) { return float(numberParameter(layer, name)); };
      StyleTransferLayer l{of("inflation"), of("softness"), of("brightness"), numberParameter(layer, "weight"), -1};
      if (!(l.weight > 0.0)) continue;
      const std::string whose = " of layer " + std::to_string(k);
      const float sigma = of("abstraction");
      NodeId distance = -1;
      for (const auto& [width, id] : made)
        if (width == sigma) distance = id;
      if (distance < 0) made.emplace_back(sigma, distance = blurred(sigma));
      const StyleFormulaList& formulas = size_t(k) < formulas_.layers.size() ? formulas_.layers[size_t(k)] : kNoFormulas;
      markVarying(l, formulas);
      const NodeId parameters = formulas.empty() ? -1 : parametersOf(formulas, distance, whose);
      level.layerParameters.push_back(parameters);
      distance = kept(distance, l.inflation, l.varyingInflation ? parameters : -1, whose);
      l.distance = int(std::find(inputs.begin(), inputs.end(), distance) - inputs.begin());
      if (size_t(l.distance) == inputs.size()) inputs.push_back(distance);
      level.transfer.layers.push_back(l);
    }
  }

  NodeId pattern(NodeId styled, const Level& level) {
    const StyleTransferSettings& t = level.transfer;
    if (style_.pattern() == v1::ShadowStyle::PATTERN_UNSPECIFIED || style_.pattern() == v1::ShadowStyle::NONE) return styled;
    StylePatternSettings p;
    p.extent = extent_;
    p.place = input_.place;
    p.pattern = style_.pattern() == v1::ShadowStyle::STIPPLING        ? StylePattern::Stippling
                : style_.pattern() == v1::ShadowStyle::CROSS_HATCHING ? StylePattern::CrossHatching
                                                                      : StylePattern::Hatching;
    if (style_.has_pattern_px()) p.spacing = float(style_.pattern_px());
    if (style_.has_pattern_deg()) p.angle = float(style_.pattern_deg() * (double(kPi) / 180.0));
    p.brightness = t.brightness;
    p.varyingBrightness = t.varyingBrightness;
    double weights = 1;
    for (const StyleTransferLayer& l : t.layers) weights += l.weight, p.rest += l.varyingBrightness ? 0.0 : l.weight * double(l.brightness);
    p.ownShare = 1 / weights;
    p.rest /= weights;
    std::vector<NodeId> inputs{styled};
    if (p.varyingBrightness) inputs.push_back(level.parameters);
    for (size_t k = 0; k < t.layers.size(); ++k)
      if (t.layers[k].varyingBrightness) inputs.push_back(level.layerParameters[k]), p.layerShares.push_back(t.layers[k].weight / weights);
    return approximate(makeStylePatternNode(p), std::move(inputs), "style_pattern");
  }

  Graph& graph_;
  const ShadowInput& input_;
  NodeId v_;
  const v1::ShadowStyle& style_;
  const StyleFormulas& formulas_;
  Extent extent_;
  float angle_;
  NodeId distance_ = -1, occluder_ = -1;
  std::vector<std::pair<NodeId, NodeId>> halfWidths_;  ///< of distances that have them
  std::vector<NodeId> hidden_;                         ///< further inputs of distances
  std::string of_;                                     ///< of labels: which level
};

}  // namespace

NodeId planStyle(Graph& graph, const ShadowInput& input, NodeId v, const v1::ShadowStyle& style, const StyleFormulas& formulas) {
  return StylePlan(graph, input, v, style, formulas).plan();
}

Result<NodeId> planStyleDistance(Graph& graph, NodeId styled) {
  const GraphNode& n = graph.at(styled);
  const std::string type = n.node->type();
  if (type == "style_transfer") return n.inputs.at(0);
  const NodeId before = n.inputs.empty() ? -1 : n.inputs[0];  // a copy: the graph may grow below
  if (type == "style_pattern") return planStyleDistance(graph, before);
  if (type == "style_levels") {  // the middle one of the plan, with or without the visibility before them
    const size_t first = graph.at(n.inputs.at(0)).node->type() == "style_transfer" ? 0 : 1;
    const NodeId middle = n.inputs.at(first + (n.inputs.size() - first) / 2);
    return planStyleDistance(graph, middle);
  }
  if (type != "crop") return invalidArgument("no style is what makes this light's shadow (shadows.style)");
  GraphNode window{n.node, {}, {}, "style_crop distance"};
  GOBO_ASSIGN(const NodeId whole, planStyleDistance(graph, before));
  window.inputs = {whole};
  return graph.add(std::move(window));
}

}  // namespace filters
}  // namespace gobo
