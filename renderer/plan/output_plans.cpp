// SPDX-License-Identifier: Apache-2.0
#include "plan/output_plans.h"

#include <algorithm>

#include "filters/axis_aligned/maps.h"
#include "filters/composite.h"
#include "filters/picture/chain.h"
#include "filters/sample_statistics.h"
#include "filters/shadow_map/techniques.h"
#include "filters/shadow_technique.h"
#include "filters/stylised/style.h"
#include "filters/view_depth.h"
#include "filters/with_alpha.h"
#include "plan/denoised.h"
#include "plan/denoised_slices.h"
#include "plan/filtered_light.h"
#include "request/curves.h"
#include "request/expressions.h"
#include "techniques/direct_visibility/filtered.h"
#include "techniques/direct_visibility/visibility.h"
#include "terms/ids.h"
#include "terms/motion.h"
#include "terms/path_trace.h"
#include "trace/sample_passes.h"

namespace gobo {
inline namespace plan {

namespace {

OutputPlane pixelMean(PlanContext& c, NodeId node, const std::string& plane, int channels, bool overValid, const std::string& label) {
  std::vector<NodeId> inputs{node, c.gbuffer()};
  const NodePtr mean = makePixelMeanNode(plane, channels, c.view().width, c.view().height, c.view().viewSamples, overValid);
  return {c.filter(mean, std::move(inputs), label), plane};
}

enum class Shown { Styled, Plain };  ///< with shadows.style; or as the technique makes it
/// The light's technique; for one that is path traced, rays.
Result<NodeId> visibilityOf(PlanContext& c, const std::string& light, Shown shown, v1::ShadowTechnique* used = nullptr) {
  const int l = c.scene()->findLight(light);
  v1::ShadowTechnique t = shadowTechniqueOf(c, l, c.scene(), light);
  if (!findShadowTechnique(t.technique_case())) t.mutable_ray_traced()->set_samples(16);
  if (shown == Shown::Plain) t.clear_style();
  if (used) *used = t;
  return planVisibility(c, l, c.scene(), t);
}

}  // namespace

Result<OutputPlane> planComposite(OutputContext& o, const std::string& output, const std::string& light) {
  PlanContext& c = o.plan;
  const PathSet shows = findOutput(output)->shows;
  const int group = light.empty() ? -1 : c.groups().groupOf[size_t(c.scene()->findLight(light))];
  std::vector<Contribution> shown;
  for (const Contribution& k : c.contributions()) {
    if (cuts(shows, k.paths))
      return internalError("output " + output + " shows " + names(shows & k.paths) + " of a plane that also holds " + names(k.paths - shows) + " (" +
                           c.graph().at(k.node).label + ")");
    if (!light.empty() && overlaps(shows, k.paths) && std::find(k.together.begin(), k.together.end(), group) != k.together.end())
      return invalidArgument("request.outputs: '" + output + "': the light has subtractive shadows together with " + std::to_string(k.together.size() - 1) +
                                 " others, and no picture of its own; give it another shadow technique",
                             "request.outputs");
    if (overlaps(shows, k.paths) && (light.empty() || k.group == group)) shown.push_back(k);
  }
  if (shown.empty() && shows == PathSet::All && !c.scene()->lights.empty())
    c.warn(output + " is black: no light is left in it; every gain is zero (lights.NAME.enabled, gain, intensity, environment.gain)");
  const NodeId clear = output == "beauty" ? c.clear() : -1;
  if (c.share().of > 1 && filtersMeanOfSlices(c.request())) {
    GOBO_TRY(checkDenoisedSlices(c, shows));
    GOBO_ASSIGN(const NoisySlice slice, planNoisySlice(c, shown, output));
    return OutputPlane{slice.others, "rgb", std::make_shared<const NoisySlice>(slice), clear};
  }
  GOBO_ASSIGN(NodeId picture, planFilteredLight(c, shown, {output, shows, !light.empty()}));
  if (output == "beauty") {
    const Chain chain = chainOf(c.request(), output);
    if (c.share().of > 1 && !chain.empty()) return OutputPlane{picture, "rgb", nullptr, clear};  // the mean of all slices is filtered (plan/planner.cpp)
    picture = addChain(c.graph(), picture, chain, pictureShape(c.view().width, c.view().height), output);
  }
  if (clear < 0) return OutputPlane{picture, "rgb"};
  return OutputPlane{c.filter(makeWithAlphaNode(c.view().width, c.view().height), {picture, clear}, output + " with alpha"), "rgba"};
}

Result<OutputPlane> planFilteredStage(OutputContext& o, const std::string& output, const std::string&) {
  PlanContext& c = o.plan;
  GOBO_ASSIGN(const int last, filterOfOutput(c.request(), output));
  const std::string term = filteredTerm(c.request().filters(last));
  const OutputInfo* info = findOutput(term);
  if (!info || !sumsLight(*info))
    return invalidArgument("request.outputs: '" + output + "': request.filters[" + std::to_string(last) + "] is of '" + term +
                               "', which is no light; ask for that output and leave out the filters after it",
                           "request.outputs");
  std::vector<Contribution> shown;
  for (const Contribution& k : c.contributions())
    if (overlaps(info->shows, k.paths)) shown.push_back(k);
  GOBO_ASSIGN(NodeId picture, planFilteredLight(c, shown, {term, info->shows, false, last}));
  if (term == "beauty") picture = addChain(c.graph(), picture, chainOf(c.request(), term, last), pictureShape(c.view().width, c.view().height), term);
  return OutputPlane{picture, "rgb"};
}

Result<OutputPlane> planNegativeLight(OutputContext& o, const std::string& output, const std::string&) {
  if (o.plan.negative().empty()) o.plan.warn(output + " is black: no light has subtractive shadows (shadows.subtractive, environment.subtractive)");
  return OutputPlane{planSum(o.plan, o.plan.negative(), output), "rgb"};
}

Result<OutputPlane> planAlbedo(OutputContext& o, const std::string& output, const std::string&) {
  return pixelMean(o.plan, o.plan.surface(), "albedo", 3, false, output);
}
Result<OutputPlane> planNormal(OutputContext& o, const std::string& output, const std::string&) {
  return pixelMean(o.plan, o.plan.surface(), "N", 3, true, output);
}
Result<OutputPlane> planPosition(OutputContext& o, const std::string& output, const std::string&) {
  return pixelMean(o.plan, o.plan.gbuffer(), "P", 3, true, output);
}
Result<OutputPlane> planDepth(OutputContext& o, const std::string& output, const std::string&) {
  return pixelMean(o.plan, o.plan.gbuffer(), "depth", 1, true, output);
}
Result<OutputPlane> planZDepth(OutputContext& o, const std::string& output, const std::string&) {
  const GBufferSettings& v = o.plan.view();
  return OutputPlane{o.plan.filter(makeViewDepthNode(v.camera, v.width, v.height, v.viewSamples), {o.plan.gbuffer()}, output), "z_depth"};
}
Result<OutputPlane> planAlpha(OutputContext& o, const std::string& output, const std::string&) {
  const GBufferSettings& v = o.plan.view();
  return OutputPlane{o.plan.filter(makeAlphaNode(v.width, v.height, v.viewSamples), {o.plan.gbuffer()}, output), "alpha"};
}
Result<OutputPlane> planObjectId(OutputContext& o, const std::string& output, const std::string&) {
  return OutputPlane{o.plan.filter(makeIdNode(IdKind::Object, o.plan.view().width, o.plan.view().height), {o.plan.gbuffer()}, output), "id"};
}
Result<OutputPlane> planMaterialId(OutputContext& o, const std::string& output, const std::string&) {
  const NodePtr node = makeIdNode(IdKind::Material, o.plan.view().width, o.plan.view().height);
  return OutputPlane{o.plan.source(node, {o.plan.gbuffer()}, {}, output, o.plan.scene()), "id"};
}

/// Screen motion since motion_step_s before the request's moment.
Result<OutputPlane> planMotion(OutputContext& o, const std::string&, const std::string&) {
  PlanContext& c = o.plan;
  MotionSettings s{c.view(), c.scene(), c.view().camera};
  if (c.request().has_time_s() || !c.request().curves().empty() || expressionsMove(c.request())) {
    v1::RenderRequest earlier = c.request();  // its messages are there, with their defaults: the same curves were applied to it
    earlier.set_time_s(c.request().time_s() - c.request().motion_step_s());
    GOBO_TRY(applyCurves(earlier));
    v1::RenderRequest byFormulas = earlier;
    if (const Status valid = applyExpressions(byFormulas); valid.ok()) earlier = std::move(byFormulas);
    else c.warn("motion: what request.expressions move counts as at rest: " + valid.message());  // sqrt(time) on the first frame
    if (!c.request().has_time_s()) earlier.clear_time_s();                                       // without a time the scene's own animation rests
    GOBO_ASSIGN(const EffectiveScene before, makeEffectiveScene(o.base, earlier, o.services.loadEnvironment, o.services.poseScene, o.services.stop));
    s.earlierScene = before.scene;
    s.earlierCamera = before.camera;
  }
  return OutputPlane{c.source(makeMotionNode(s), {c.gbuffer()}, {}, "motion", c.scene()), "motion"};
}

Result<OutputPlane> planSampleCount(OutputContext& o, const std::string& output, const std::string&) {
  return OutputPlane{o.plan.filter(makeSampleCountNode(o.plan.view().width, o.plan.view().height), o.plan.states(), output), "count"};
}

Result<OutputPlane> planVariance(OutputContext& o, const std::string&, const std::string&) {
  PlanContext& c = o.plan;
  const std::vector<NodeId>& states = c.states();
  std::vector<VarianceWeight> weights;
  std::string without;
  for (const Contribution& k : c.contributions()) {
    if (k.state >= 0) weights.push_back({int(std::find(states.begin(), states.end(), k.state) - states.begin()), k.slot, k.weight});
    else without += (without.empty() ? "" : ", ") + c.graph().at(k.node).label;
  }
  if (!without.empty()) c.warn("variance: of the path-traced part alone, without " + without);
  const uint32_t samples = samplesOf(c.passes()), blocks = (samples + kBlockSamples - 1) / kBlockSamples;
  if (blocks < uint32_t(kVarianceStreams) && !weights.empty())
    c.warn("variance: from " + std::to_string(blocks) + " independent blocks of " + std::to_string(std::min(samples, kBlockSamples)) + " samples" +
           (blocks < 2 ? ": unknown (-1)" : "") + "; " + std::to_string(kVarianceStreams) + " want halt.spp of at least " +
           std::to_string(kVarianceStreams * 16));
  const NodePtr node = makeVarianceNode(std::move(weights), int(states.size()), c.view().width, c.view().height, kVarianceStreams);
  return OutputPlane{c.filter(node, states, "variance"), "variance"};
}

Result<OutputPlane> planUnoccludedOutput(OutputContext& o, const std::string& output, const std::string& light) {
  PlanContext& c = o.plan;
  const int l = c.scene()->findLight(light);
  return pixelMean(c, planUnoccluded(c, l, c.scene(), Vec3(nominalScalar(c.scene()->lights[size_t(l)]))), "L", 3, false, output);
}

Result<OutputPlane> planVisibilityOutput(OutputContext& o, const std::string& output, const std::string& light) {
  GOBO_ASSIGN(const NodeId v, visibilityOf(o.plan, light, Shown::Styled));
  return pixelMean(o.plan, planFilteredVisibility(o.plan, v, light), "V", 1, true, output);
}

Result<OutputPlane> planShadowDistance(OutputContext& o, const std::string& output, const std::string& light) {
  GOBO_ASSIGN(const NodeId v, visibilityOf(o.plan, light, Shown::Styled));
  const Result<NodeId> distance = planStyleDistance(o.plan.graph(), v);
  if (!distance.ok()) return invalidArgument("request.outputs: '" + output + "': " + distance.status().message(), "request.outputs");
  return pixelMean(o.plan, *distance, "D", 1, true, output);
}

Result<OutputPlane> planShadowFlags(OutputContext& o, const std::string& output, const std::string& light) {
  v1::ShadowTechnique used;
  GOBO_ASSIGN(const NodeId v, visibilityOf(o.plan, light, Shown::Plain, &used));
  if (marksFailures(used)) return pixelMean(o.plan, v, "flags", 1, true, output);
  return invalidArgument("request.outputs: '" + output + "' needs shadows.exponential.classification = THRESHOLD or Z_MAX", "request.outputs");
}

namespace {
Result<OutputPlane> shadowFilterMap(OutputContext& o, const std::string& output, const std::string& light, const char* plane) {
  GOBO_ASSIGN(const NodeId v, visibilityOf(o.plan, light, Shown::Plain));
  const Result<NodeId> maps = planShadowFilterMaps(o.plan.graph(), v);
  if (!maps.ok()) return invalidArgument("request.outputs: '" + output + "': " + maps.status().message(), "request.outputs");
  return pixelMean(o.plan, *maps, plane, 1, true, output);
}
}  // namespace

Result<OutputPlane> planShadowRays(OutputContext& o, const std::string& output, const std::string& light) { return shadowFilterMap(o, output, light, "rays"); }
Result<OutputPlane> planShadowWidth(OutputContext& o, const std::string& output, const std::string& light) {
  return shadowFilterMap(o, output, light, "width");
}

Result<OutputPlane> planShadowBasis(OutputContext& o, const std::string& output, const std::string& light) {
  GOBO_ASSIGN(const NodeId v, visibilityOf(o.plan, light, Shown::Plain));
  const Result<NodeId> mosaic = planBasisMosaic(o.plan.graph(), v);
  if (!mosaic.ok()) return invalidArgument("request.outputs: '" + output + "': " + mosaic.status().message(), "request.outputs");
  return OutputPlane{*mosaic, "image"};
}

}  // namespace plan
}  // namespace gobo
