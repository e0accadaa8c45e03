// SPDX-License-Identifier: Apache-2.0
#include "plan/denoised.h"

#include <algorithm>

#include "filters/composite.h"
#include "filters/denoise/band_limit/lens_blur.h"
#include "filters/denoise/band_limit/lens_features.h"
#include "filters/denoise/band_limit/lens_filter.h"
#include "filters/denoise/denoise_node.h"
#include "filters/denoise/features.h"
#include "filters/denoise/noisy_picture.h"
#include "filters/denoise/registry.h"
#include "filters/denoise/select/select.h"
#include "filters/denoise/view_sample_edges.h"
#include "filters/expression.h"
#include "plan/outliers.h"
#include "request/request.h"
#include "trace/sample_passes.h"

namespace gobo {
inline namespace plan {

namespace {

/// Noise that denoisers know: of path tracing states, whose first half is a picture too. Lights that the camera sees have none but at their edges.
bool noisy(const Contribution& k) { return k.state >= 0 && !overlaps(k.paths, PathSet::Emission); }

using Denoisers = std::vector<denoise::DenoiserPtr>;

Status add(Denoisers& to, v1::Denoise settings) {
  GOBO_TRY(resolveDefaults(settings));
  GOBO_ASSIGN(denoise::DenoiserPtr made, denoise::makeDenoiser(settings));
  if (made) to.push_back(std::move(made));
  return {};
}

constexpr float kLensShare = 0.3f;  // of the blur: found on spheres and trees through a lens (docs/noise.md)

/// What denoise.auto chooses from, by what is known of the light (docs/noise.md says what was left out, and why). Without halves, by which filters are judged,
/// the first alone.
enum class Known { Nothing, Direct, BendingDiffuse, BendingSpecular };
Result<Denoisers> choicesOf(Known light, bool fast, bool halves, bool lens) {
  v1::Denoise wavelet, nonLocalMeans, firstOrder, axisAligned;
  wavelet.mutable_wavelet();
  nonLocalMeans.mutable_non_local_means();
  firstOrder.mutable_first_order();
  axisAligned.mutable_axis_aligned();
  std::vector<v1::Denoise> wanted{wavelet, nonLocalMeans};
  if (light == Known::Nothing && !fast) wanted.push_back(firstOrder);
  const bool diffuse = light == Known::BendingDiffuse, specular = light == Known::BendingSpecular;
  if (diffuse || specular) wanted = fast ? std::vector{axisAligned, nonLocalMeans} : std::vector{firstOrder, axisAligned};
  if (specular && !fast) wanted.push_back(nonLocalMeans);
  if (!halves) wanted.resize(1);
  Denoisers denoisers;
  for (const v1::Denoise& d : wanted) { GOBO_TRY(add(denoisers, d)); }
  if (lens && halves && light == Known::Direct) denoisers.push_back(denoise::makeLensFilter(kLensShare));
  return denoisers;
}

}  // namespace

bool needsCurvature(const v1::RenderRequest& request, size_t groups) {
  const v1::Denoise& settings = request.denoise();
  if (!settings.has_auto_()) return settings.has_axis_aligned();
  // Samples that outliers were taken from do not say how their light bends. By the whole picture's size, so that a window of it is filtered alike.
  constexpr uint64_t kBytesOfPixel = 7 * 3 * (sizeof(double) + sizeof(float));  // sums and means of emission, direct light, both lobes' light and bending
  const uint64_t pixels = uint64_t(request.width()) * request.height();
  return !settings.has_outliers() && pixels * std::max<size_t>(groups, 1) * kBytesOfPixel <= kMostCurvatureBytes;
}

namespace {

/// Path-traced light that is filtered together, and what of it is. `label`: after that of the output.
struct NoisyPart {
  LobePart lobe = LobePart::Both;
  std::vector<Contribution> light;
  Denoisers by;
  std::string label;
  bool bends = false;        ///< its filters ask how it bends along surfaces
  bool orAsSampled = false;  ///< held against its noise, though there is one filter alone
};

/// Without light, in the order of summation; none: nothing is filtered. halves: there are two, by which a filter is judged.
Result<std::vector<NoisyPart>> kindsOf(const v1::Denoise& settings, bool bends, bool halves, bool lens) {
  const bool automatic = settings.has_auto_();
  std::vector<NoisyPart> parts(1);
  if (automatic) {
    GOBO_ASSIGN(parts[0].by, choicesOf(bends ? Known::BendingDiffuse : Known::Nothing, settings.auto_().fast(), halves, lens));
  } else {
    GOBO_TRY(add(parts[0].by, settings));
  }
  const bool closed = settings.has_axis_aligned() && settings.axis_aligned().radius_px() == 0;  // a window of no width, not even along edges
  if (parts[0].by.empty() || closed) return std::vector<NoisyPart>();
  if (!bends) return parts;
  Denoisers by = std::move(parts[0].by), specularBy = by;
  if (automatic) { GOBO_ASSIGN(specularBy, choicesOf(Known::BendingSpecular, settings.auto_().fast(), halves, lens)); }
  parts = {{LobePart::Diffuse, {}, std::move(by), "", true}, {LobePart::Specular, {}, std::move(specularBy), "", true}};
  if (automatic || settings.axis_aligned().direct() != v1::AxisAlignedDenoise::NONE) {
    parts.push_back({LobePart::Both, {}, {}, " direct", false, halves});
    GOBO_ASSIGN(parts[2].by, choicesOf(Known::Direct, true, halves, lens));
  }
  return parts;
}

/// kindsOf with their light. `untouched` gets what filters leave as it is.
Result<std::vector<NoisyPart>> partsOf(const PlanContext& c, std::vector<Contribution> traced, bool halves, std::vector<Contribution>& untouched) {
  GOBO_ASSIGN(std::vector<NoisyPart> parts, kindsOf(c.request().denoise(), c.apart().curvature, halves, c.view().camera.hasLens()));
  if (parts.size() == 1) parts[0].light = std::move(traced);
  if (parts.size() < 2) return parts;
  for (Contribution& k : traced) {
    const bool diffuse = contains(PathSet::IndirectDiffuse, k.paths), specular = contains(PathSet::IndirectSpecular, k.paths) && !c.kinds().lambert;
    const bool direct = parts.size() > 2 && contains(PathSet::Direct, k.paths);
    (diffuse ? parts[0].light : specular ? parts[1].light : direct ? parts[2].light : untouched).push_back(std::move(k));
  }
  return parts;
}

/// What a part becomes: planes "rgb" of the demodulated light, and "modulation".
struct SmoothPart {
  NodeId light = -1, features = -1;
};

/// What their sum `all` would be after so many passes. Where outliers are rejected, nodes say themselves what the samples of these are worth.
NodeId planFirst(PlanContext& c, std::span<const Contribution> traced, NodeId all, uint32_t passes) {
  std::vector<Contribution> earlier(traced.begin(), traced.end());
  bool said = false;
  for (Contribution& k : earlier) {
    if (c.graph().at(k.node).shape.find(kFirstSamples)) {
      k.plane = kFirstSamples;
      said = true;
    } else k.node = c.atPasses(k.node, passes);
  }
  if (!said) return c.atPasses(all, passes);
  return planSum(c, earlier, c.graph().at(all).label + ", its first samples");
}

/// What the filters make of it, the best of them at each pixel (orAsSampled: of one filter and the light as it was): the demodulated light.
NodeId planFilters(Graph& graph, const Denoisers& by, const NoisyNodes& n, bool orAsSampled, int width, int height, const std::string& label) {
  const auto add = [&](NodePtr node, std::vector<NodeId> inputs, const std::string& name) { return graph.add({std::move(node), std::move(inputs), {}, name}); };
  // The first half goes first, and the whole goes on from it.
  std::vector<NodeId> inputs{n.features};
  if (n.first >= 0) inputs.push_back(n.first);
  inputs.push_back(n.all);
  if (n.bending >= 0) inputs.push_back(n.bending);
  const NodeId halves = add(denoise::makeNoisyPictureNode(width, height, n.samples, n.firstSamples, n.bending >= 0), std::move(inputs), label + " in halves");
  std::vector<NodeId> smooth;
  const bool judged = by.size() > 1 || orAsSampled;
  for (const denoise::DenoiserPtr& d : by)
    smooth.push_back(add(denoise::makeDenoiseNode(d, width, height, n.samples, n.firstSamples, judged), {n.features, halves}, label + " by " + d->name()));
  if (!judged) return smooth[0];
  std::vector<NodeId> choice{halves};
  choice.insert(choice.end(), smooth.begin(), smooth.end());
  const float share = float(double(n.firstSamples) / double(n.samples));
  return add(denoise::makeSelectNode(width, height, int(by.size()), share), std::move(choice), label + " selected");
}

class DenoisePlan {
 public:
  DenoisePlan(PlanContext& c, std::string label) : c_(c), label_(std::move(label)), width_(c.view().width), height_(c.view().height) {
    // A plan that bounds what any count of samples holds is of one pass, and has a second picture of whatever count.
    any_ = c.bounding() && c.passes() == 1 && c.request().halt().spp() != 1;
    samples_ = any_ ? 2 : samplesOf(c.passes());
    half_ = passesFor(samples_ / 2);
    first_ = samples_ > 1 ? samplesOf(half_) : 0;
  }
  uint32_t samples() const { return samples_; }
  /// Of these in the first half; 0: there are no halves.
  uint32_t first() const { return first_; }

  Result<SmoothPart> plan(const NoisyPart& part) {
    const std::string label = withLobe(label_ + part.label, part.lobe);
    NoisyNodes noisy = gather(part.light, label);
    noisy.features = features(part.lobe);
    if (part.bends) { GOBO_ASSIGN(noisy.bending, curvature(part, label)); }
    NodeId light = planFilters(c_.graph(), part.by, noisy, part.orAsSampled, width_, height_, label);
    if (part.bends)
      light = c_.filter(denoise::makeViewSampleEdgesNode(width_, height_, c_.view().viewSamples, part.lobe),
                        {noisy.features, light, c_.gbuffer(), c_.surface()}, label + " along edges");
    return SmoothPart{light, noisy.features};
  }

  /// The light, and its first half.
  NoisyNodes gather(std::span<const Contribution> light, const std::string& label) {
    NoisyNodes n;
    n.all = planSum(c_, light, label + " traced");
    if (samples_ > 1) n.first = planFirst(c_, light, n.all, any_ ? c_.passes() + 1 : half_);
    n.samples = samples_;
    n.firstSamples = first_;
    return n;
  }
  /// Of what the camera sees, with the noise of a lens.
  NodeId seenFeatures(LobePart lobe) {
    return c_.filter(denoise::makeFeaturesNode(width_, height_, c_.view().viewSamples, lobe), {c_.gbuffer(), c_.surface()}, withLobe("features", lobe));
  }
  /// Of a pinhole 0.
  NodeId blur() {
    return c_.filter(denoise::makeLensBlurNode(c_.view().camera, c_.view().filmHeight(), width_, height_, c_.view().viewSamples), {c_.gbuffer()},
                     "blur of the lens");
  }

  /// How the part's light bends.
  Result<NodeId> curvature(const NoisyPart& part, const std::string& label) {
    std::vector<Contribution> bends = part.light;
    for (Contribution& k : bends) {
      if (k.curvature.empty()) return internalError("nobody says how light bends", label);
      k.plane = k.curvature;
    }
    return planSum(c_, bends, label + " bending");
  }

 private:
  /// Of what the camera sees; through a lens, without the noise of it.
  NodeId features(LobePart lobe) {
    const NodeId seen = seenFeatures(lobe);
    if (!c_.view().camera.hasLens()) return seen;
    return c_.filter(denoise::makeLensFeaturesNode(width_, height_, lobe), {seen, blur()}, withLobe("features", lobe) + " through the lens");
  }

  PlanContext& c_;
  std::string label_;
  int width_, height_;
  bool any_ = false;
  uint32_t samples_ = 1, half_ = 1, first_ = 0;
};

}  // namespace

Result<NodeId> planDenoised(PlanContext& c, std::span<const Contribution> brought, const std::string& label) {
  DenoisePlan plan(c, label);
  std::vector<Contribution> contributions(brought.begin(), brought.end()), traced, others;
  if (c.request().denoise().has_outliers()) contributions = withoutOutliers(c, brought, label, plan.first());
  for (const Contribution& k : contributions) (noisy(k) ? traced : others).push_back(k);
  GOBO_ASSIGN(std::vector<NoisyPart> parts, partsOf(c, traced, plan.samples() > 1, others));
  std::erase_if(parts, [](const NoisyPart& p) { return p.light.empty(); });
  if (parts.empty()) return planSum(c, contributions, label);
  // Modulated again, and the rest. The filtered light is the first input, so that its first half is made first, of samples that are the others' too; what was
  // traced is the last, for the samples that it lost, of which filters know nothing.
  Expression e;
  std::vector<NodeId> inputs;
  int sum = -1;
  for (const NoisyPart& part : parts) {
    GOBO_ASSIGN(const SmoothPart smooth, plan.plan(part));
    const int at = int(inputs.size());
    inputs.insert(inputs.end(), {smooth.light, smooth.features});
    const int light = e.plane(at, "rgb"), product = e.multiply(light, e.plane(at + 1, "modulation"));
    sum = sum < 0 ? product : e.add(sum, product);
  }
  addTo(e, inputs, sum, others);
  for (const Contribution& k : traced)
    if (std::find(inputs.begin(), inputs.end(), k.node) == inputs.end()) inputs.push_back(k.node);
  GraphNode picture{makeCompositeNode(std::move(e), c.view().width, c.view().height), std::move(inputs), {}, label};
  picture.approximate = kDenoisedApproximate;
  return c.graph().add(std::move(picture));
}

Result<NoisySlice> planNoisySlice(PlanContext& c, std::span<const Contribution> contributions, const std::string& label) {
  DenoisePlan plan(c, label);
  std::vector<Contribution> traced, others;
  for (const Contribution& k : contributions) (noisy(k) ? traced : others).push_back(k);
  NoisySlice slice;
  slice.light = plan.gather(traced, label);
  slice.light.features = plan.seenFeatures(LobePart::Both);
  if (c.lensAtTimes()) slice.blur = plan.blur();
  slice.others = planSum(c, others, label + " not traced");
  slice.lit = !traced.empty();
  return slice;
}

Result<NodeId> planFiltered(Graph& graph, const v1::Denoise& settings, const NoisyNodes& light, int width, int height, const std::string& label) {
  GOBO_ASSIGN(const std::vector<NoisyPart> parts, kindsOf(settings, false, true, false));
  if (parts.empty()) return NodeId(-1);
  return planFilters(graph, parts[0].by, light, parts[0].orAsSampled, width, height, label);
}

}  // namespace plan
}  // namespace gobo
