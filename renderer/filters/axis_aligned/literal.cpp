// SPDX-License-Identifier: Apache-2.0
#include "filters/axis_aligned/literal.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "filters/axis_aligned/sample_count.h"
#include "filters/ray_traced/technique.h"
#include "terms/shadow_slopes.h"

namespace gobo {
inline namespace filters {
namespace {

size_t placeOf(char c, std::string_view text) {
  size_t at = 0;
  while (at < text.size() && text[at] != c) ++at;
  return at;
}

bool setMode(AxisAlignedModes& m, std::string_view name, std::string_view value) {
  const auto one = [&](auto& field, std::initializer_list<std::pair<const char*, std::remove_reference_t<decltype(field)>>> values) {
    for (const auto& [word, meaning] : values)
      if (value == word) {
        field = meaning;
        return true;
      }
    return false;
  };
  using Distance = AxisAlignedDistance;
  using Thresholds = AxisAlignedThresholds;
  if (name == "beta") return one(m.codeBeta, {{"report_corrected", false}, {"code", true}});
  if (name == "n") return one(m.printedRate, {{"eq3.5", true}, {"capped", false}});
  if (name == "thresholds") return one(m.thresholds, {{"report", Thresholds::Report}, {"code", Thresholds::Code}, {"scale_free", Thresholds::ScaleFree}});
  if (name == "distance") return one(m.distance, {{"light_plane", Distance::LightPlane}, {"world", Distance::World}, {"ours", Distance::Line}});
  if (name == "filter") return one(m.full2d, {{"separable", false}, {"full2d", true}});
  if (name == "light")
    return one(
        m.profile.shape,
        {{"gaussian_truncated", ShadowLightProfile::GaussianTruncated}, {"gaussian", ShadowLightProfile::Gaussian}, {"uniform", ShadowLightProfile::Uniform}});
  if (name == "shade") return one(m.profile.flat, {{"centre", true}, {"ratio", false}});
  return false;
}

}  // namespace

Result<AxisAlignedModes> axisAlignedModes(std::string_view text, AxisAlignedModes modes) {
  while (!text.empty()) {
    const size_t end = placeOf(',', text);
    const std::string_view word = text.substr(0, end);
    text.remove_prefix(std::min(end + 1, text.size()));
    const size_t equals = placeOf('=', word);
    if (equals == word.size() || !setMode(modes, word.substr(0, equals), word.substr(equals + 1)))
      return invalidArgument("'" + std::string(word) + "' is no mode of axis-aligned filtering");
  }
  return modes;
}

float sigmaOf(const LightShape& shape, const AxisAlignedModes& modes) {
  const float matched = shadowLightFrame(shape).sigma;
  return modes.profile.shape == ShadowLightProfile::Uniform ? matched : std::sqrt(3.0f) * matched;  // a side of 2: 1 in the place of 2 / sqrt 12
}

Result<NodeId> planAxisAlignedModes(Graph& graph, const ShadowInput& input, const AxisAlignedModes& modes) {
  const Light& light = input.scene->lights[size_t(input.light)];
  if (!hasShadowLightFrame(light.shape)) return invalidArgument("light '" + light.name + "': axis-aligned filtering needs a light plane");
  if (modes.profile.shape != ShadowLightProfile::Uniform && light.shape.kind != LightKind::Rect)
    return invalidArgument("light '" + light.name + "' is no rectangle: Gaussian profiles are for those");
  const Extent extent{input.width, input.height, input.viewSamples};
  const uint64_t seed = shadowSeed(input);
  ShadowLightFrame frame = shadowLightFrame(light.shape);
  frame.sigma = sigmaOf(light.shape, modes);

  ShadowRateSettings rate;
  rate.sigma = frame.sigma;
  rate.distant = frame.distant;
  rate.printed = modes.printedRate;
  rate.pilot = modes.pilot;
  rate.maxSamples = modes.maxSamples;
  rate.uniform = modes.uniform ? std::max(modes.uniform, modes.pilot) : 0;
  const uint32_t most = std::bit_ceil(rate.uniform ? rate.uniform : std::max(rate.pilot, rate.maxSamples));
  const bool solve = rate.uniform == 0 && modes.meanSamples > 0;

  const auto source = [&](NodePtr node, std::vector<NodeId> inputs, const char* what) {
    return graph.add({std::move(node), std::move(inputs), {input.light}, what + (":" + light.name), 0, input.scene, false});
  };
  const auto filter = [&](NodePtr node, std::vector<NodeId> inputs, const char* what) {
    return graph.add({std::move(node), std::move(inputs), {}, what + (":" + light.name), 0, nullptr, false});
  };
  const NodeId g = input.gbuffer;
  const NodeId slopes = source(makeShadowSlopesNode({rate.pilot, most, true, seed, extent, input.place, input.clear, modes.profile}), {g}, "shadow_slopes");
  const NodeId dilated = filter(makeShadowSlopeDilation(modes.dilatePx, extent), {slopes, g}, "shadow_slope_dilation");
  const NodeId mu =
      filter(makeShadowMu(modes.mu, solve ? modes.meanSamples : 0.0f, rate), solve ? std::vector<NodeId>{dilated, g} : std::vector<NodeId>{}, "shadow_mu");
  const NodeId count = filter(makeShadowSampleCount(rate, extent), {dilated, g, mu}, "shadow_sample_count");
  const NodeId noisy =
      source(makeShadowAdaptiveNode({rate.pilot, most, seed, extent, input.place, input.clear, modes.profile}), {g, slopes, count}, "shadow_adaptive");

  AxisAlignedFilterSettings f;
  f.light = frame;
  f.k = modes.codeBeta ? std::sqrt(6.0f) : modes.k;
  f.cut = modes.codeBeta ? std::sqrt(6.0f) : 0.0f;
  f.radiusPx = modes.radiusPx;
  f.exact2d = modes.full2d;
  f.distance = modes.distance;
  f.thresholds = modes.thresholds;
  return filter(makeAxisAlignedFilter(f), {noisy, g, count}, "axis_aligned_filter");
}

}  // namespace filters
}  // namespace gobo
