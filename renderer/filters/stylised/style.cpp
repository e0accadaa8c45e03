// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/style.h"

#include <algorithm>
#include <string>

#include "filters/parameter.h"
#include "filters/stylised/abstraction.h"
#include "filters/stylised/distance_field.h"
#include "filters/stylised/edge_mean.h"
#include "filters/stylised/pattern.h"
#include "filters/stylised/sampled_distance.h"
#include "filters/stylised/style_levels.h"
#include "filters/stylised/style_parameters.h"
#include "filters/stylised/transfer.h"
#include "terms/occluder_distance.h"

namespace gobo {

namespace {

using StyleFormulaList = std::vector<std::pair<StyleField, StyleFormula>>;

StyleTransition transitionOf(const v1::ShadowStyle& style) {
  if (style.transition() == v1::ShadowStyle::QUINTIC) return StyleTransition::Quintic;
  return style.transition() == v1::ShadowStyle::STAIRCASE ? StyleTransition::Staircase : StyleTransition::Smoothstep;
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
    NodeId styled = -1, parameters = -1;
    StyleTransferSettings transfer;
  };

  /// Distance, abstraction and transfer of one contour of soft visibility.
  Level planLevel(const StyleDistanceSettings& d) {
    of_ = d.levels > 1 ? " " + std::to_string(d.level + 1) + "/" + std::to_string(d.levels) : "";
    const auto samples = uint32_t(number("samples"));
    const NodePtr field = samples > 0 ? makeSampledDistanceNode({d, samples, input_.seed, input_.place}) : makeStyleDistanceNode(d);
    distance_ = filter(field, {v_, input_.gbuffer}, "style_distance" + of_);
    const NodeId own = abstracted();
    Level level;
    StyleTransferSettings& t = level.transfer;
    t.inflation = number("inflation"), t.softness = number("softness"), t.brightness = number("brightness");
    t.transition = transitionOf(style_);
    if (style_.has_steps()) t.steps = int(style_.steps());
    t.tinted = input_.clear && d.levels == 1;
    std::vector<NodeId> inputs{own};
    addLayers(t, inputs);
    t.distances = int(inputs.size());
    if (t.tinted) inputs.push_back(v_);
    level.parameters = transferParameters(own, t);
    if (level.parameters >= 0) inputs.push_back(level.parameters);
    level.styled = approximate(makeStyleTransferNode(t), std::move(inputs), "style_transfer" + of_,
                               d.levels > 1);  // the distances of levels are kept: the transfer is cheap
    return level;
  }

  float pixel() const { return style_.metric() == v1::ShadowStyle::SCREEN ? 1.0f / float(input_.filmHeight()) : 0.0f; }
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

  NodeId parametersOf(StyleFormulaList formulas, NodeId edge) {
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
    return filter(makeStyleParametersNode(extent_, std::move(formulas), formulas_.time), std::move(inputs), "style_parameters" + of_);
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
    const NodeId widths = parametersOf({{StyleField::Abstraction, *varying}}, -1);
    return filter(makeStyleAbstractionNode({extent_, 0.0f, angle_, true, pixel()}), {distance_, input_.gbuffer, widths}, "style_abstraction" + of_);
  }

  /// Layers of equal abstraction have one distance.
  void addLayers(StyleTransferSettings& t, std::vector<NodeId>& inputs) {
    std::vector<std::pair<float, int>> made;
    if (!formulas_.find(StyleField::Abstraction)) made.emplace_back(number("abstraction"), 0);
    for (const v1::ShadowStyleLayer& layer : style_.layers()) {
      const auto of = [&](const char* name) { return float(numberParameter(layer, name)); };
      StyleTransferLayer l{of("inflation"), of("softness"), of("brightness"), numberParameter(layer, "weight"), -1};
      if (!(l.weight > 0.0)) continue;
      const float sigma = of("abstraction");
      for (const auto& [width, at] : made)
        if (width == sigma) l.distance = at;
      if (l.distance < 0) {
        l.distance = int(inputs.size());
        inputs.push_back(blurred(sigma));
        made.emplace_back(sigma, l.distance);
      }
      t.layers.push_back(l);
    }
  }

  NodeId transferParameters(NodeId own, StyleTransferSettings& t) {
    StyleFormulaList formulas;
    for (const auto& [field, f] : formulas_.all) {
      if (field == StyleField::Abstraction) continue;
      formulas.emplace_back(field, f);
      t.varyingInflation |= field == StyleField::Inflation;
      t.varyingSoftness |= field == StyleField::Softness;
      t.varyingBrightness |= field == StyleField::Brightness;
    }
    return formulas.empty() ? -1 : parametersOf(std::move(formulas), own);
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
    for (const StyleTransferLayer& l : t.layers) weights += l.weight, p.rest += l.weight * double(l.brightness);
    p.ownShare = 1 / weights;
    p.rest /= weights;
    std::vector<NodeId> inputs{styled};
    if (p.varyingBrightness) inputs.push_back(level.parameters);
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
  std::string of_;  ///< of labels: which level
};

}  // namespace

NodeId planStyle(Graph& graph, const ShadowInput& input, NodeId v, const v1::ShadowStyle& style, const StyleFormulas& formulas) {
  return StylePlan(graph, input, v, style, formulas).plan();
}

}  // namespace gobo
