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

namespace {

/// Adds the contributions to `sum` (-1: nothing yet).
void addTo(Expression& e, std::vector<NodeId>& inputs, int& sum, std::span<const Contribution> contributions) {
  for (const Contribution& k : contributions) {
    auto at = std::find(inputs.begin(), inputs.end(), k.node);
    if (at == inputs.end()) at = inputs.insert(inputs.end(), k.node);
    const int plane = e.plane(int(at - inputs.begin()), k.plane);
    if (sum < 0) sum = e.constant(Vec3(0.0f));
    sum = e.multiplyAdd(sum, k.weight, plane);
  }
}

}  // namespace

NodeId planSum(PlanContext& c, std::span<const Contribution> contributions, const std::string& label) {
  Expression e;
  std::vector<NodeId> inputs;
  int sum = -1;
  addTo(e, inputs, sum, contributions);
  if (sum < 0) e.constant(Vec3(0.0f));
  return c.filter(makeCompositeNode(std::move(e), c.view().width, c.view().height), std::move(inputs), label);
}

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

/// In the order of summation; none: nothing is filtered. `untouched` gets what filters leave as it is. halves: there are two, by which a filter is judged.
Result<std::vector<NoisyPart>> partsOf(const PlanContext& c, std::vector<Contribution> traced, bool halves, std::vector<Contribution>& untouched) {
  const v1::Denoise& settings = c.request().denoise();
  const bool automatic = settings.has_auto_(), bends = c.apart().curvature, lens = c.view().camera.hasLens();
  std::vector<NoisyPart> parts(1);
  if (automatic) {
    GOBO_ASSIGN(parts[0].by, choicesOf(bends ? Known::BendingDiffuse : Known::Nothing, settings.auto_().fast(), halves, lens));
  } else {
    GOBO_TRY(add(parts[0].by, settings));
  }
  const bool closed = settings.has_axis_aligned() && settings.axis_aligned().radius_px() == 0;  // a window of no width, not even along edges
  if (parts[0].by.empty() || traced.empty() || closed) return std::vector<NoisyPart>();
  if (!bends) {
    parts[0].light = std::move(traced);
    return parts;
  }
  Denoisers by = std::move(parts[0].by), specularBy = by;
  if (automatic) { GOBO_ASSIGN(specularBy, choicesOf(Known::BendingSpecular, settings.auto_().fast(), halves, lens)); }
  parts = {{LobePart::Diffuse, {}, std::move(by), "", true},
           {LobePart::Specular, {}, std::move(specularBy), "", true},
           {LobePart::Both, {}, {}, " direct", false, halves}};
  const bool filtersDirect = automatic || settings.axis_aligned().direct() != v1::AxisAlignedDenoise::NONE;
  if (filtersDirect) { GOBO_ASSIGN(parts[2].by, choicesOf(Known::Direct, true, halves, lens)); }
  for (Contribution& k : traced) {
    const bool diffuse = contains(PathSet::IndirectDiffuse, k.paths), specular = contains(PathSet::IndirectSpecular, k.paths) && !c.kinds().lambert;
    const bool direct = filtersDirect && contains(PathSet::Direct, k.paths);
    (diffuse ? parts[0].light : specular ? parts[1].light : direct ? parts[2].light : untouched).push_back(std::move(k));
  }
  std::erase_if(parts, [](const NoisyPart& p) { return p.light.empty(); });
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
    const NodeId all = planSum(c_, part.light, label + " traced");
    const NodeId features = planFeatures(part.lobe);
    std::vector<NodeId> inputs{features, all};
    // The first half goes first, and the whole goes on from it.
    if (samples_ > 1) inputs.insert(inputs.begin() + 1, planFirst(c_, part.light, all, any_ ? c_.passes() + 1 : half_));
    if (part.bends) { GOBO_TRY(addCurvature(part, label, inputs)); }
    const NodeId halves = c_.filter(denoise::makeNoisyPictureNode(width_, height_, samples_, first_, part.bends), std::move(inputs), label + " in halves");
    std::vector<NodeId> smooth;
    const bool judged = part.by.size() > 1 || part.orAsSampled;
    for (const denoise::DenoiserPtr& d : part.by)
      smooth.push_back(c_.filter(denoise::makeDenoiseNode(d, width_, height_, samples_, first_, judged), {features, halves}, label + " by " + d->name()));
    if (judged) {
      std::vector<NodeId> choice{halves};
      choice.insert(choice.end(), smooth.begin(), smooth.end());
      const float share = float(double(first_) / double(samples_));
      smooth.assign(1, c_.filter(denoise::makeSelectNode(width_, height_, int(part.by.size()), share), std::move(choice), label + " selected"));
    }
    if (part.bends)
      smooth[0] = c_.filter(denoise::makeViewSampleEdgesNode(width_, height_, c_.view().viewSamples, part.lobe),
                            {features, smooth[0], c_.gbuffer(), c_.surface()}, label + " along edges");
    return SmoothPart{smooth[0], features};
  }

 private:
  /// Of what the camera sees; through a lens, without the noise of it.
  NodeId planFeatures(LobePart lobe) {
    const NodeId seen =
        c_.filter(denoise::makeFeaturesNode(width_, height_, c_.view().viewSamples, lobe), {c_.gbuffer(), c_.surface()}, withLobe("features", lobe));
    if (!c_.view().camera.hasLens()) return seen;
    const NodeId blur = c_.filter(denoise::makeLensBlurNode(c_.view().camera, c_.view().filmHeight(), width_, height_, c_.view().viewSamples), {c_.gbuffer()},
                                  "blur of the lens");
    return c_.filter(denoise::makeLensFeaturesNode(width_, height_, lobe), {seen, blur}, withLobe("features", lobe) + " through the lens");
  }

  /// How the part's light bends, as one more input of the halves.
  Status addCurvature(const NoisyPart& part, const std::string& label, std::vector<NodeId>& inputs) {
    std::vector<Contribution> bends = part.light;
    for (Contribution& k : bends) {
      if (k.curvature.empty()) return internalError("nobody says how light bends", label);
      k.plane = k.curvature;
    }
    inputs.push_back(planSum(c_, bends, label + " bending"));
    return {};
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
  GOBO_ASSIGN(const std::vector<NoisyPart> parts, partsOf(c, traced, plan.samples() > 1, others));
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
  picture.approximate = "without noise, and without what of the light looks like it";
  return c.graph().add(std::move(picture));
}

}  // namespace gobo
