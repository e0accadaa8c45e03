// SPDX-License-Identifier: Apache-2.0
#include "filters/soft_shadow/techniques.h"

#include <cmath>

#include "filters/parameter.h"
#include "filters/shadow_map/techniques.h"
#include "filters/soft_shadow/moment_sums.h"

namespace gobo {
inline namespace filters {

namespace {

/// 2 tan(half angle) of the side of a square at infinity that has the solid angle of a disk of this full angle:
/// 4 asin(h^2 / (1 + h^2)) = 2 pi (1 - cos(angle / 2)), h the tangent of half its side.
float squareAtInfinity(double angle) {
  const double sine = std::sin(0.5 * angle), gap = sine * sine / (1.0 + std::sqrt(1.0 - sine * sine)), share = std::sin(0.5 * M_PI * gap);
  return float(2.0 * std::sqrt(share / (1.0 - share)));
}

}  // namespace

SoftLight softLight(const LightShape& l) {
  SoftLight s;
  const float square = std::sqrt(kPi) * l.radius;  // side of the square of a disk's area
  switch (l.kind) {
    case LightKind::Rect:
      s.half = Vec2(glm::length(l.u), glm::length(l.v));
      s.size = 2.0f * s.half;
      break;
    case LightKind::Disk:
    case LightKind::Sphere:
      s.half = Vec2(l.radius);
      s.size = Vec2(square);
      s.shape = l.kind == LightKind::Disk ? SoftLight::Disk : SoftLight::Sphere;
      break;
    case LightKind::Directional:
      if (l.angularSize != 0.0f) {
        s.size = Vec2(squareAtInfinity(l.angularSize));
        s.half = Vec2(std::tan(0.5f * l.angularSize));
        s.shape = SoftLight::Disk;
      } else {
        s.size = l.skyRectangle;
        s.half = 0.5f * l.skyRectangle;
      }
      break;
    default: break;
  }
  return s;
}

namespace {

using Settings = v1::ShadowMapSettings;

struct Planned {
  PlannedShadowMap map;
  NodeId bounds = -1;
};

/// The depth map, its bounds and what all lookups share.
Result<Planned> planMap(Graph& graph, const ShadowInput& input, const v1::ShadowTechnique& technique, SoftLookup& l) {
  const Light& light = input.scene->lights.at(size_t(input.light));
  if (!softShadowSupports(light.shape.kind))
    return invalidArgument("light '" + light.name + "' has no width: soft shadow maps are made for rectangles, disks, spheres and distant lights", "shadows");
  if (!isFinite(light.shape.u) || !isFinite(light.shape.v) || !std::isfinite(light.shape.radius))
    return invalidArgument("light '" + light.name + "': its size is not finite", "shadows");
  Planned p;
  GOBO_ASSIGN(p.map, planShadowMap(graph, input, technique, 1, MapWindow::Corners));
  p.bounds = planDepthBounds(graph, input, p.map);
  l.frames = p.map.frames;
  l.map = p.map.map;
  l.view = p.map.view;
  l.light = softLight(light.shape);
  l.place = input.place;
  return p;
}

Status checkBytes(const PlannedShadowMap& p, double bytesPerTexel) {
  const double bytes = double(p.map.resolution) * p.map.resolution * p.frames.count * bytesPerTexel;
  if (bytes <= 4.0 * (1ull << 30)) return {};
  return Status(Code::ResourceExhausted,
                "shadows.map.resolution = " + std::to_string(p.map.resolution) + ": this technique's images of " + std::to_string(p.frames.count) +
                    " map faces take " + std::to_string(int64_t(bytes / (1 << 20))) + " MiB; at most 4096 MiB",
                "shadows.map.resolution");
}

}  // namespace

bool softShadowSupports(LightKind kind) {
  return kind == LightKind::Rect || kind == LightKind::Disk || kind == LightKind::Sphere || kind == LightKind::Directional;
}

namespace {

Result<NodeId> planComparisons(Graph& graph, const ShadowInput& input, const v1::ShadowTechnique& technique, bool work) {
  const v1::PercentageCloserSoftShadow& m = technique.percentage_closer_soft();
  PercentageCloserSoftLookup l;
  l.work = work;
  l.searchTaps = int(numberParameter(m, "search_taps"));
  l.filterTaps = int(numberParameter(m, "filter_taps"));
  l.dense = m.dense();
  l.skip = boolParameter(m, "skip");
  GOBO_TRY(checkShadowRange("percentage_closer_soft.search_taps", l.searchTaps, 1, 1024));
  GOBO_TRY(checkShadowRange("percentage_closer_soft.filter_taps", l.filterTaps, 1, 1024));
  GOBO_ASSIGN(const Planned p, planMap(graph, input, technique, l));
  return addShadowFilter(graph, makePercentageCloserSoftNode(l), {input.gbuffer, p.bounds}, "visibility", input);
}

}  // namespace

Result<NodeId> planPercentageCloserSoft(Graph& graph, const ShadowInput& input, const v1::ShadowTechnique& technique) {
  return planComparisons(graph, input, technique, false);
}
Result<NodeId> planPercentageCloserSoftWork(Graph& graph, const ShadowInput& input, const v1::ShadowTechnique& technique) {
  return planComparisons(graph, input, technique, true);
}

Result<NodeId> planConvolutionSoft(Graph& graph, const ShadowInput& input, const v1::ShadowTechnique& technique) {
  const v1::ConvolutionSoftShadow& m = technique.convolution_soft();
  ConvolutionSoftLookup l;
  l.order = int(numberParameter(m, "order"));
  l.correction = m.correction() == v1::ConvolutionShadow::CORRECTION_UNSPECIFIED ? v1::ConvolutionShadow::SHIFTED_SCALING : m.correction();
  l.search = m.search() == v1::ConvolutionSoftShadow::SEARCH_UNSPECIFIED ? v1::ConvolutionSoftShadow::Z_MIN : m.search();
  l.sharpening = float(numberParameter(m, "sharpening"));
  l.sharpeningExtent = float(numberParameter(m, "sharpening_extent"));
  GOBO_TRY(checkShadowRange("convolution_soft.order", l.order, 1, 32));
  GOBO_TRY(checkShadowRange("convolution_soft.sharpening", l.sharpening, 0, 100));
  GOBO_TRY(checkShadowRange("convolution_soft.sharpening_extent", l.sharpeningExtent, 0, 10000));
  GOBO_ASSIGN(const Planned p, planMap(graph, input, technique, l));
  if (l.map.lookup == Settings::ANISOTROPIC)
    return invalidArgument("shadows.map.lookup = ANISOTROPIC: soft shadows read SUMMED_AREA boxes or a TRILINEAR chain at the penumbra's width",
                           "shadows.map.lookup");
  const bool mips = l.map.lookup == Settings::TRILINEAR;
  GOBO_TRY(checkBytes(p.map, 4.0 * (4 * l.order + 1) * (mips ? 7.0 / 3.0 : 2.004)));
  const ShadowBasisPtr basis = makeConvolutionSoftBasis(l.order);
  const int resolution = l.map.resolution, faces = l.frames.count;
  NodeId map = addShadowFilter(graph, makeShadowEncodeNode(basis, 0, resolution, faces, false), {p.map.depth}, "convolution_soft_map", input);
  if (mips) map = addShadowFilter(graph, makeShadowMipmapNode(basis, resolution, faces, false), {map}, "shadow_mipmap", input);
  else map = addShadowFilter(graph, makeShadowSummedAreaNode(basis, resolution, faces), {map}, "shadow_summed_area", input);
  return addShadowFilter(graph, makeConvolutionSoftNode(l), {input.gbuffer, p.bounds, map}, "visibility", input);
}

Result<NodeId> planVarianceSoft(Graph& graph, const ShadowInput& input, const v1::ShadowTechnique& technique) {
  const v1::VarianceSoftShadow& m = technique.variance_soft();
  VarianceSoftLookup l;
  l.minVariance = float(numberParameter(m, "min_variance"));
  l.subdivide = boolParameter(m, "subdivide");
  GOBO_TRY(checkShadowRange("variance_soft.min_variance", l.minVariance, 0, 1));
  GOBO_ASSIGN(const Planned p, planMap(graph, input, technique, l));
  GOBO_TRY(checkBytes(p.map, 16));
  const NodeId sums = addShadowFilter(graph, makeMomentSumsNode(l.map.resolution, l.frames.count), {p.map.depth}, "shadow_moment_sums", input);
  return addShadowFilter(graph, makeVarianceSoftNode(l), {input.gbuffer, p.bounds, sums}, "visibility", input);
}

Result<NodeId> planExponentialVarianceSoft(Graph& graph, const ShadowInput& input, const v1::ShadowTechnique& technique) {
  const v1::ExponentialVarianceSoftShadow& m = technique.exponential_variance_soft();
  ExponentialVarianceSoftLookup l;
  l.searchTaps = int(numberParameter(m, "search_taps"));
  l.cPositive = float(numberParameter(m, "c_positive"));
  l.cNegative = float(numberParameter(m, "c_negative"));
  l.bleedingReduction = float(numberParameter(m, "bleeding_reduction"));
  GOBO_TRY(checkShadowRange("exponential_variance_soft.search_taps", l.searchTaps, 1, 1024));
  GOBO_TRY(checkShadowRange("exponential_variance_soft.c_positive", l.cPositive, 0.1, 42));
  GOBO_TRY(checkShadowRange("exponential_variance_soft.c_negative", l.cNegative, 0.1, 42));
  GOBO_TRY(checkShadowRange("exponential_variance_soft.bleeding_reduction", l.bleedingReduction, 0, 0.99));
  GOBO_ASSIGN(const Planned p, planMap(graph, input, technique, l));
  GOBO_TRY(checkBytes(p.map, 16 * 7.0 / 3.0));
  const ShadowBasisPtr basis = makeExponentialVarianceBasis(l.cPositive, l.cNegative, 1e-7f, l.bleedingReduction);
  const NodeId map =
      addShadowFilter(graph, makeShadowEncodeNode(basis, 0, l.map.resolution, l.frames.count, false), {p.map.depth}, "exponential_variance_soft_map", input);
  const NodeId chain = addShadowFilter(graph, makeShadowMipmapNode(basis, l.map.resolution, l.frames.count, false), {map}, "shadow_mipmap", input);
  return addShadowFilter(graph, makeExponentialVarianceSoftNode(l), {input.gbuffer, p.bounds, chain}, "visibility", input);
}

}  // namespace filters
}  // namespace gobo
