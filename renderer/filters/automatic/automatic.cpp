// SPDX-License-Identifier: Apache-2.0
#include "filters/automatic/automatic.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "base/sobol.h"
#include "filters/automatic/candidates.h"
#include "filters/automatic/decision.h"
#include "filters/automatic/shadow_probe.h"
#include "filters/parameter.h"
#include "filters/ray_traced/technique.h"
#include "filters/shadow_map/techniques.h"
#include "filters/soft_shadow/techniques.h"

namespace gobo {
inline namespace filters {
namespace {

constexpr uint32_t kEnvironmentRays = 4;  // bench/environment_bench
// Looks, each closer than those before: numbers of ProbeDesign. A later one is taken only where it can pay for itself (decision.h).
struct LookSize {
  int cells, split, judged;
};
constexpr LookSize kHardLooks[] = {{576, 64, 96}, {1152, 192, 384}, {2304, 512, 1536}};
constexpr LookSize kSoftLooks[] = {{576, 64, 96}, {1152, 128, 288}, {2304, 512, 1152}};
constexpr double kHardTaps = 4;    // rays a view sample that a virtual map takes
constexpr double kMapHelps = 0.5;  // chance that a soft map which was not judged yet keeps the error

class Chooser {
 public:
  using Expand = std::function<Result<TermPtr>(const Graph&, NodeId)>;
  Chooser(Graph& graph, const ShadowInput& input, const v1::ShadowTechnique& technique, Candidates candidates, const Expand& expand)
      : graph_(graph),
        input_(input),
        base_(shadowMapSettings(technique.map())),
        expand_(expand),
        light_(input.scene->lights[size_t(input.light)]),
        soft_(castsSoftShadows(light_.shape)),
        samples_(double(input.filmWidth()) * input.filmHeight() * input.viewSamples),
        costs_(std::move(candidates.costs)),
        rays_(candidates.rays.size()),
        probeRay_(candidates.probeRay),
        traced_(rays_),
        evidence_(candidates.list.size()) {
    choice_.candidates = std::move(candidates.list);
    const v1::AutomaticShadow& a = technique.auto_();
    budget_ = {numberParameter(a, "error"), a.has_time_ms() ? a.time_ms() : 0.0};
    probe_.rays = std::move(candidates.rays);
    probe_.camera = input.camera;
    probe_.width = input.filmWidth();
    probe_.height = input.filmHeight();
    probe_.viewSamples = input.viewSamples;
    probe_.clear = input.clear;
  }

  Result<AutomaticChoice> choose() {
    const std::span<const LookSize> looks = soft_ ? std::span<const LookSize>(kSoftLooks) : std::span<const LookSize>(kHardLooks);
    std::vector<size_t> maps(evidence_.size() - rays_);  // that a look is for
    std::iota(maps.begin(), maps.end(), rays_);
    for (size_t look = 0; look < looks.size(); ++look) {
      design(looks[look]);
      probe_.seed = look == 0 ? shadowSeed(input_) : hash64(shadowSeed(input_), look);
      GOBO_ASSIGN(const bool seen, judgeRays(look));
      if (!seen) {
        GOBO_TRY(boundOf(looks.back(), looks.size() - 1));
        return choice_;
      }
      while (!maps.empty()) {  // the cheapest first: others may be too dear then
        const auto at = std::min_element(maps.begin(), maps.end(), [&](size_t x, size_t y) { return evidence_[x].ms < evidence_[y].ms; });
        const size_t k = *at;
        maps.erase(at);
        if (look > 0 || worthJudging(k)) GOBO_TRY(judgeMap(k, look));
      }
      choice_.chosen = chooseByEvidence(evidence_, budget_);
      const std::vector<size_t> rivals = rivalsOf(evidence_, budget_, choice_.chosen);
      if (look + 1 == looks.size()) break;
      for (const size_t k : rivals)
        if (k >= rays_) maps.push_back(k);
      if (choice_.chosen >= rays_) maps.push_back(choice_.chosen);
      design(looks[look + 1]);
      const double taps = soft_ ? 0.0 : kHardTaps * double(maps.size()) * probe_.judged * input_.viewSamples;  // a soft lookup is nothing beside 60 rays
      if (!worthAnotherLook(evidence_, budget_, choice_.chosen, rivals, (shadowProbeRays(probe_) + taps) * probeRay_ * 1e-6)) break;
    }
    for (size_t k = 0; k < evidence_.size(); ++k) {
      AutomaticCandidate& c = choice_.candidates[k];
      c.ms = evidence_[k].ms;
      c.judged = evidence_[k].judged();
      c.rmse = evidence_[k].high();
    }
    return choice_;
  }

 private:
  void design(const LookSize& look) {
    probe_.cells = look.cells;
    probe_.split = look.split;
    probe_.judged = look.judged;
  }
  static std::string nameOf(size_t look) { return look == 0 ? "" : " look " + std::to_string(look + 1); }

  /// False: nothing is run while planning.
  Result<bool> judgeRays(size_t look) {
    node_ = graph_.add({makeShadowProbeNode(probe_), {}, {input_.light}, "shadow_probe:" + light_.name + nameOf(look), 0, input_.scene, false});
    GOBO_ASSIGN(const TermPtr judged, expand_(graph_, node_));
    if (!judged) return false;
    const double more = probe_.judged;
    choice_.receivers = (pixels_ * choice_.receivers + more * judged->plane<double>("share")[0]) / (pixels_ + more);
    pixels_ += more;
    for (size_t k = 0; k < rays_; ++k) traced_[k].add(judged->plane<double>("mse")[k], judged->plane<double>("variance")[k], more);
    const std::vector<ProbeEvidence> falling = fallingErrors(traced_);
    std::copy(falling.begin(), falling.end(), evidence_.begin());
    retime();
    return true;
  }

  /// Asks for what holds most of all that may be asked for: the closest look, by the largest map.
  Status boundOf(const LookSize& closest, size_t look) {
    design(closest);
    GOBO_TRY(judgeRays(look).status());
    if (rays_ < evidence_.size()) GOBO_TRY(errorsOf(evidence_.size() - 1, look).status());
    return {};
  }

  Result<TermPtr> errorsOf(size_t k, size_t look) {
    const std::string of = light_.name + " " + choice_.candidates[k].text + nameOf(look);
    GOBO_ASSIGN(const NodeId visibility, visibilityOf(k, of));
    return expand_(graph_, graph_.add({makeProbeErrorsNode(input_.viewSamples), {node_, visibility}, {}, "probe_errors:" + of, 0, nullptr, false}));
  }
  Status judgeMap(size_t k, size_t look) {
    AutomaticCandidate& candidate = choice_.candidates[k];
    GOBO_ASSIGN(const TermPtr term, errorsOf(k, look));
    const double before = evidence_[k].pixels, more = probe_.judged;
    if (term->hasPlane("work")) {
      const auto work = term->plane<double>("work");
      candidate.work.resize(work.size(), 0.0);
      for (size_t i = 0; i < work.size(); ++i) candidate.work[i] = (before * candidate.work[i] + more * work[i]) / (before + more);
    }
    evidence_[k].add(term->plane<double>("mse")[0], term->plane<double>("variance")[0], more);
    retime();
    return {};
  }
  /// What map k says of the pixels that the probe looks at.
  Result<NodeId> visibilityOf(size_t k, const std::string& of) {
    if (const std::optional<ProbeMap>& map = costs_[k].virtualMap)
      return graph_.add({makeMapProbeNode({*map, base_.bias, base_.slopeBias, input_.clear}), {node_}, {}, "map_probe:" + of, 0, input_.scene, false});
    ShadowInput there = input_;
    there.gbuffer = node_;
    const NodeId before = graph_.size();
    GOBO_ASSIGN(const NodeId visibility, planPercentageCloserSoftWork(graph_, there, choice_.candidates[k].technique));
    if (visibility >= before)  // structurally equal nodes are one
      graph_.addToLabels(visibility, " probe" + of.substr(light_.name.size()));
    return visibility;
  }

  void retime() {
    for (size_t k = 0; k < evidence_.size(); ++k) evidence_[k].ms = costs_[k].time(samples_, choice_.receivers, workOf(k));
  }
  /// Of a map that was not judged: at least what a smaller one with no more taps does.
  const std::vector<double>& workOf(size_t k) const {
    size_t from = k;
    for (size_t j = rays_; j < evidence_.size(); ++j)
      if (!evidence_[k].judged() && evidence_[j].judged() && costs_[j].taps <= costs_[k].taps && costs_[j].resolution <= costs_[k].resolution) from = j;
    return choice_.candidates[from].work;
  }

  /// One that cannot win by its time is not judged, nor a soft map whose making is probably lost.
  bool worthJudging(size_t k) const {
    if (std::none_of(evidence_.begin(), evidence_.end(), [](const ProbeEvidence& e) { return e.judged(); })) return true;
    const ProbeEvidence& best = evidence_[chooseByEvidence(evidence_, budget_)];
    if (budget_.timeMs > 0) return evidence_[k].ms <= budget_.timeMs || best.ms > budget_.timeMs;
    const bool keeps = best.high() <= budget_.error;
    if (keeps && evidence_[k].ms >= best.ms) return false;
    if (!soft_) return true;
    bool made = false;
    for (size_t j = rays_; j < evidence_.size(); ++j) {
      if (!evidence_[j].judged()) continue;
      made = made || costs_[j].resolution == costs_[k].resolution;
      // The share of pixels within a texel of an edge, the mean square error of edges, falls with the width of a texel; what only the light's corners see does
      // not fall at all.
      const double falls = std::min(1.0, double(costs_[j].resolution) / costs_[k].resolution), keep = std::max(budget_.error, keeps ? 0.0 : best.high());
      if (costs_[j].taps >= costs_[k].taps && falls * evidence_[j].low() * evidence_[j].low() > keep * keep) return false;
    }
    return made || !keeps || kMapHelps * (best.ms - evidence_[k].ms) > (1.0 - kMapHelps) * costs_[k].mapMs;
  }

  Graph& graph_;
  const ShadowInput& input_;
  ShadowMapSettings base_;
  const Expand& expand_;
  const Light& light_;
  bool soft_;
  double samples_;
  std::vector<CandidateCost> costs_;
  size_t rays_;  // the first candidates
  double probeRay_;
  ShadowBudget budget_;
  ShadowProbeSettings probe_;
  NodeId node_ = -1;
  double pixels_ = 0;
  std::vector<ProbeEvidence> traced_, evidence_;  // of the rays as they were judged; of all
  AutomaticChoice choice_;
};

}  // namespace

Result<AutomaticChoice> chooseShadow(Graph& graph, const ShadowInput& input, const v1::ShadowTechnique& technique,
                                     const std::function<Result<TermPtr>(const Graph&, NodeId)>& expand) {
  const Light& light = input.scene->lights[size_t(input.light)];
  if (light.shape.kind == LightKind::Directional &&
      light.shape.skyRectangle != Vec2(0.0f)) {  // one of many lights that stand for an environment: their noise averages out, a map's errors add up
    AutomaticChoice choice;
    AutomaticCandidate c;
    c.technique.mutable_ray_traced()->set_samples(kEnvironmentRays);
    c.text = "ray_traced, " + std::to_string(kEnvironmentRays) + " rays";
    choice.candidates.push_back(std::move(c));
    return choice;
  }
  GOBO_ASSIGN(Candidates candidates, shadowCandidates(input, technique));
  if (candidates.list.empty()) return invalidArgument("light '" + light.name + "': no shadow technique is left for shadows.auto");
  return Chooser(graph, input, technique, std::move(candidates), expand).choose();
}

}  // namespace filters
}  // namespace gobo
