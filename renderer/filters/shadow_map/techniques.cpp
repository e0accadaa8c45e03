// SPDX-License-Identifier: Apache-2.0
#include "filters/shadow_map/techniques.h"

#include <algorithm>
#include <cmath>

#include "device/egl/egl_device.h"
#include "device/vulkan/vulkan_device.h"
#include "filters/parameter.h"
#include "filters/shadow_map/camera_fit.h"

namespace gobo {
inline namespace filters {

namespace {

using Settings = v1::ShadowMapSettings;

constexpr double kTableMomentBias = 2e-4;  // tables round moments to 1/32767: below 5e-5 umbras of a single depth are lit here and there

}  // namespace

ShadowMapSettings shadowMapSettings(const Settings& m) {
  ShadowMapSettings s;
  s.resolution = int(numberParameter(m, "resolution"));
  s.blur = int(numberParameter(m, "blur"));
  s.anisotropy = int(numberParameter(m, "anisotropy"));
  s.bias = float(numberParameter(m, "bias"));
  s.slopeBias = float(numberParameter(m, "slope_bias"));
  s.cameraFit = m.fit() == Settings::CAMERA;
  s.lookup = m.lookup() == Settings::LOOKUP_UNSPECIFIED ? Settings::BILINEAR : m.lookup();
  return s;
}

namespace {

/// Soft techniques measure the distance to casters and look beside the receiver's own texel by the light's size.
bool isSoft(const v1::ShadowTechnique& t) {
  using T = v1::ShadowTechnique;
  switch (t.technique_case()) {
    case T::kPercentageCloserSoft:
    case T::kConvolutionSoft:
    case T::kVarianceSoft:
    case T::kExponentialVarianceSoft: return true;
    default: return false;
  }
}

/// The camera that sees a picture with so many pixels more around it.
Camera seesAround(Camera camera, int height, int around) {
  const double larger = 1.0 + 2.0 * around / height;
  if (camera.perspective) camera.optics.focal = 1.0 / (camera.windowHeight64() * larger);
  else camera.yheight = float(camera.yheight * larger);
  camera.centre /= float(larger);
  return camera;
}

CameraFit cameraFit(const ShadowInput& input, const v1::ShadowTechnique& technique, const LightShape& light, const LightFrame& frame) {
  CameraFit fit;
  const int width = std::max(input.filmWidth(), 1), height = std::max(input.filmHeight(), 1), around = std::max(-input.place.x, 0);
  fit.camera = around > 0 ? seesAround(input.camera, height, around) : input.camera;  // a style's guard band (ShadowStyle.guard_px)
  fit.aspect = float(width + 2 * around) / float(height + 2 * around);
  fit.pancake = !isSoft(technique);
  switch (light.kind) {
    case LightKind::Directional: fit.lightHalf = light.angularSize != 0.0f ? Vec2(std::tan(0.5f * light.angularSize)) : 0.5f * light.skyRectangle; break;
    case LightKind::Disk:
    case LightKind::Sphere: fit.lightHalf = Vec2(light.radius); break;
    case LightKind::Rect:
      fit.lightHalf = Vec2(std::fabs(glm::dot(light.u, frame.right)) + std::fabs(glm::dot(light.v, frame.right)),
                           std::fabs(glm::dot(light.u, frame.up)) + std::fabs(glm::dot(light.v, frame.up)));
      break;
    default: break;
  }
  return fit;
}

}  // namespace

bool shadowMapSupports(LightKind kind) { return kind != LightKind::Environment && kind != LightKind::Mesh; }

int percentageCloserRim(const v1::ShadowTechnique& technique) {
  const v1::PercentageCloserShadow& m = technique.percentage_closer();
  const int taps = int(numberParameter(m, "taps"));
  switch (m.pattern()) {
    case v1::PercentageCloserShadow::GAUSSIAN: return int(numberParameter(technique.map(), "blur")) + 1;
    case v1::PercentageCloserShadow::FOOTPRINT: return 9;
    case v1::PercentageCloserShadow::POISSON: return taps / 2 + 1;
    default: return (taps + 1) / 2;
  }
}

Result<PlannedShadowMap> fitShadowMap(const ShadowInput& input, const v1::ShadowTechnique& technique, int rim, MapWindow window) {
  const Light& light = input.scene->lights.at(size_t(input.light));
  if (!shadowMapSupports(light.shape.kind) || !oneSided(light.shape))
    return invalidArgument("light '" + light.name + "' is a mesh, an environment or shines to both sides: a shadow map is not made for it");
  PlannedShadowMap p;
  p.map = shadowMapSettings(technique.map());
  GOBO_TRY(checkShadowRange("map.resolution", p.map.resolution, 1, 8192));
  GOBO_TRY(checkShadowRange("map.blur", p.map.blur, 0, 64));
  GOBO_TRY(checkShadowRange("map.bias", p.map.bias, 0, 1));
  GOBO_TRY(checkShadowRange("map.slope_bias", p.map.slopeBias, 0, 16));
  // In steps of 8 texels where that costs less than an eighth of the map: moving the blur's slider keeps the depth map.
  const int stepped = (rim + 7) / 8 * 8;
  if (p.map.resolution >= 16 * stepped) rim = stepped;
  Vec3 lo, hi;
  input.scene->bounds(lo, hi);
  GOBO_ASSIGN(p.frames, fitLightFrames(light.shape, lo, hi, p.map.resolution, rim, window));
  if (p.map.cameraFit) fitToCamera(p.frames, cameraFit(input, technique, light.shape, p.frames.face[0]), lo, hi, p.map.resolution, rim);
  p.view.perspective = input.camera.perspective;
  p.view.eye = input.camera.perspective ? Vec3(input.camera.toWorld[3]) : Vec3(input.camera.toWorld[2]);
  return p;
}

Result<PlannedShadowMap> planShadowMap(Graph& graph, const ShadowInput& input, const v1::ShadowTechnique& technique, int rim, MapWindow window) {
  GOBO_ASSIGN(PlannedShadowMap p, fitShadowMap(input, technique, rim, window));
  GraphNode depth;
  depth.node = makeLightDepthMapNode(p.frames, p.map.resolution, DepthMethod::Automatic, input.clear);
  depth.scene = input.scene;
  depth.label = "light_depth_map:" + input.scene->lights[size_t(input.light)].name;
  p.depth = graph.add(std::move(depth));
  return p;
}

NodeId planDepthBounds(Graph& graph, const ShadowInput& input, const PlannedShadowMap& p) {
  return addShadowFilter(graph, makeDepthBoundsNode(p.map.resolution, p.frames.count), {p.depth}, "depth_bounds", input);
}

bool marksFailures(const v1::ShadowTechnique& t) {
  return t.technique_case() == v1::ShadowTechnique::kExponential && t.exponential().classification() > v1::ExponentialShadow::OFF;
}

Result<NodeId> planBasisMosaic(Graph& graph, NodeId visibility) {
  NodeId depth = -1, basis = -1;
  std::vector<NodeId> open{visibility};
  while (!open.empty()) {
    const NodeId id = open.back();
    open.pop_back();
    const GraphNode& n = graph.at(id);
    if (n.node->type() == "light_depth_map") depth = id;
    if (n.node->type() == "shadow_encode") basis = id;
    open.insert(open.end(), n.inputs.begin(), n.inputs.end());
  }
  if (depth < 0) return notFound("the light's shadow technique has no map to show");
  const TermShape& map = graph.at(basis < 0 ? depth : basis).shape;
  const PlaneShape* images = map.find(basis < 0 ? "z" : "B");
  if (!images) return graph.wiring();
  GraphNode n;
  n.node = makeBasisMosaicNode(map.extent.width, images->channels, map.extent.layers);
  n.inputs = {basis < 0 ? depth : basis};
  n.label = "shadow_basis";
  return graph.add(std::move(n));
}

Result<NodeId> planHardShadowMap(Graph& graph, const ShadowInput& input, const v1::ShadowTechnique& technique) {
  GOBO_ASSIGN(const PlannedShadowMap p, planShadowMap(graph, input, technique, 1));
  PercentageCloserLookup l{p.frames, p.map, p.view};
  l.hard = true;
  return addShadowFilter(graph, makePercentageCloserNode(l), {input.gbuffer, p.depth}, "visibility", input);
}

Result<NodeId> planPercentageCloser(Graph& graph, const ShadowInput& input, const v1::ShadowTechnique& technique) {
  const v1::PercentageCloserShadow& m = technique.percentage_closer();
  const int taps = int(numberParameter(m, "taps"));
  GOBO_TRY(checkShadowRange("percentage_closer.taps", taps, 1, 16));
  const auto pattern = m.pattern() == v1::PercentageCloserShadow::PATTERN_UNSPECIFIED ? v1::PercentageCloserShadow::REGULAR : m.pattern();
  GOBO_ASSIGN(const PlannedShadowMap p, planShadowMap(graph, input, technique, percentageCloserRim(technique)));
  PercentageCloserLookup l{p.frames, p.map, p.view};
  l.pattern = pattern;
  l.taps = taps;
  l.skip = boolParameter(m, "skip");
  l.place = input.place;
  return addShadowFilter(graph, makePercentageCloserNode(l), {input.gbuffer, readsDepthBounds(l) ? planDepthBounds(graph, input, p) : p.depth}, "visibility",
                         input);
}

namespace {

/// Basis -> pre-filter -> chain or table -> lookup.
Result<NodeId> planFiltered(Graph& graph, const ShadowInput& input, const v1::ShadowTechnique& technique, ShadowBasisPtr basis, bool bytes,
                            ComputeDevicePtr device = nullptr, const v1::ExponentialShadow* exponential = nullptr) {
  const int blur = int(numberParameter(technique.map(), "blur"));
  GOBO_ASSIGN(const PlannedShadowMap p, planShadowMap(graph, input, technique, blur + 1));
  const int resolution = p.map.resolution, faces = p.frames.count;
  if (p.map.lookup == Settings::SUMMED_AREA && !basis->bounded())
    return invalidArgument(std::string("shadows.map.lookup = SUMMED_AREA: sums of the ") + basis->name() +
                               " map span too many orders of magnitude for a table; use BILINEAR, TRILINEAR or ANISOTROPIC",
                           "shadows.map.lookup");
  if (p.map.lookup == Settings::SUMMED_AREA && bytes)
    return invalidArgument("shadows.map.lookup = SUMMED_AREA needs shadows.convolution.bytes = false: tables are made from float images",
                           "shadows.convolution.bytes");
  if (device && (faces > 1 || p.map.lookup != Settings::BILINEAR || (exponential && exponential->classification() > v1::ExponentialShadow::OFF)))
    return Status(Code::Unimplemented, "shadows.exponential.device: devices do one map face, BILINEAR lookups and no classification so far",
                  "shadows.exponential.device");
  if (device && uint64_t(resolution) * uint64_t(resolution) * 4 > device->maxBufferBytes())
    return Status(Code::ResourceExhausted,
                  std::to_string(resolution) + " texels squared are more than the " + std::to_string(device->maxBufferBytes()) + " bytes that a buffer of " +
                      device->name() + " may have",
                  "shadows.map.resolution");
  NodeId map =
      addShadowFilter(graph, makeShadowEncodeNode(basis, p.map.blur, resolution, faces, bytes, device), {p.depth}, std::string(basis->name()) + "_map", input);
  if (p.map.lookup == Settings::TRILINEAR || p.map.lookup == Settings::ANISOTROPIC)
    map = addShadowFilter(graph, makeShadowMipmapNode(basis, resolution, faces, bytes), {map}, "shadow_mipmap", input);
  else if (p.map.lookup == Settings::SUMMED_AREA)
    map = addShadowFilter(graph, makeShadowSummedAreaNode(basis, resolution, faces), {map}, "shadow_summed_area", input);
  ShadowLookup l{p.frames, p.map, p.view};
  std::vector<NodeId> inputs{input.gbuffer, map};
  if (exponential && exponential->classification() > v1::ExponentialShadow::OFF) {
    l.classification = exponential->classification();
    l.epsilon = float(numberParameter(*exponential, "epsilon"));
    l.fallbackKernel = boolParameter(*exponential, "fallback_kernel");
    inputs.push_back(planDepthBounds(graph, input, p));
  }
  return addShadowFilter(graph, makeShadowLookupNode(std::move(basis), l, device), std::move(inputs), "visibility", input);
}

}  // namespace

Result<NodeId> planVarianceShadow(Graph& graph, const ShadowInput& input, const v1::ShadowTechnique& t) {
  return planFiltered(graph, input, t, makeVarianceBasis(t.variance()), false);
}
Result<NodeId> planConvolutionShadow(Graph& graph, const ShadowInput& input, const v1::ShadowTechnique& t) {
  GOBO_TRY(checkShadowRange("convolution.order", numberParameter(t.convolution(), "order"), 1, 32));
  return planFiltered(graph, input, t, makeConvolutionBasis(t.convolution()), t.convolution().bytes());
}
Result<NodeId> planExponentialVarianceShadow(Graph& graph, const ShadowInput& input, const v1::ShadowTechnique& t) {
  const auto number = [&](const char* name) { return float(numberParameter(t.exponential_variance(), name)); };
  GOBO_TRY(checkShadowRange("exponential_variance.c_positive", number("c_positive"), 0.1, 42));
  GOBO_TRY(checkShadowRange("exponential_variance.c_negative", number("c_negative"), 0.1, 42));
  return planFiltered(graph, input, t,
                      makeExponentialVarianceBasis(number("c_positive"), number("c_negative"), number("min_variance"), number("bleeding_reduction")), false);
}
Result<NodeId> planMomentShadow(Graph& graph, const ShadowInput& input, const v1::ShadowTechnique& t) {
  v1::MomentShadow m = t.moment();
  if (t.map().lookup() == Settings::SUMMED_AREA) m.set_moment_bias(std::max(numberParameter(m, "moment_bias"), kTableMomentBias));
  return planFiltered(graph, input, t, makeMomentBasis(m), false);
}

Result<NodeId> planExponentialShadow(Graph& graph, const ShadowInput& input, const v1::ShadowTechnique& t) {
  const v1::ExponentialShadow& e = t.exponential();
  const double c = numberParameter(e, "c");
  GOBO_TRY(checkShadowRange("exponential.c", c, 1, 2000));
  if (e.filtering() == v1::ExponentialShadow::LINEAR && c > 80)
    return invalidArgument("shadows.exponential.c = " + std::to_string(c) + ": LINEAR filtering leaves float above 80; use LOGARITHMIC or AUTO",
                           "shadows.exponential.c");
  const bool logarithmic = e.filtering() == v1::ExponentialShadow::LOGARITHMIC || c > 80;
  ComputeDevicePtr device;
  if (e.device() == v1::ExponentialShadow::VULKAN) {
    GOBO_ASSIGN(device, VulkanDevice::shared());
  } else if (e.device() == v1::ExponentialShadow::EGL) {
    GOBO_ASSIGN(device, EglDevice::shared());
  }
  if (device && logarithmic)
    return Status(Code::Unimplemented, "shadows.exponential.device: devices filter linearly so far (c at most 80)", "shadows.exponential.device");
  return planFiltered(graph, input, t, makeExponentialBasis(float(c), logarithmic), false, device, &e);
}

}  // namespace filters
}  // namespace gobo
