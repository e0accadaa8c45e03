// SPDX-License-Identifier: Apache-2.0
#include "filters/automatic/automatic.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "base/sobol.h"
#include "filters/automatic/candidates.h"
#include "filters/automatic/decision.h"
#include "filters/automatic/probe_windows.h"
#include "filters/automatic/shadow_probe.h"
#include "filters/axis_aligned/maps.h"
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
constexpr LookSize kSoftLooks[] = {{576, 64, 96}, {1152, 128, 288}, {2304, 512, 1152}, {4608, 1024, 4608}};
constexpr double kCoarse = 0.1;  // errors allowed from which fewer rays of the truth do
constexpr uint32_t kFewTruthRays = 8;
constexpr double kHardTaps = 4;           // rays a view sample that a virtual map takes
constexpr double kMapHelps = 0.5;         // chance that a soft map or a filter which was not judged yet keeps the error
constexpr double kShareOfFilters = 0.25;  // of a time budget, for windows that one filter is judged by

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
        barely_(rays_),
        ratio_(candidates.list.size()),
        evidence_(candidates.list.size()) {
    choice_.candidates = std::move(candidates.list);
    const v1::AutomaticShadow& a = technique.auto_();
    budget_ = {numberParameter(a, "error"), a.has_time_ms() ? a.time_ms() : 0.0};
    probe_.rays = counts_ = std::move(candidates.rays);
    if (soft_ && budget_.error >= kCoarse) probe_.truthRays = kFewTruthRays;
    probe_.camera = input.camera;
    probe_.width = input.filmWidth();
    probe_.height = input.filmHeight();
    probe_.viewSamples = input.viewSamples;
    probe_.clear = input.clear;
  }

  Result<AutomaticChoice> choose() {
    const std::span<const LookSize> looks = soft_ ? std::span<const LookSize>(kSoftLooks) : std::span<const LookSize>(kHardLooks);
    std::vector<size_t> open(evidence_.size() - rays_);  // not judged yet
    std::iota(open.begin(), open.end(), rays_);
    std::vector<size_t> again;
    for (size_t look = 0; look < looks.size(); ++look) {
      if (look == 0) design(looks[look]);
      probe_.seed = look == 0 ? shadowSeed(input_) : hash64(shadowSeed(input_), look);
      GOBO_ASSIGN(const bool seen, judgeRays(look));
      if (!seen) {
        GOBO_TRY(boundOf(looks.back(), looks.size() - 1));
        return choice_;
      }
      for (const size_t k : again) GOBO_TRY(judge(k, look));
      GOBO_TRY(judgeOpen(open, look, false));
      // What waits for news of others: a closer look, if that is worth it, or else now.
      bool closer = false;
      for (int turn = 0; turn < 2 && !closer; ++turn) {
        if (turn == 1) {
          const size_t waiting = open.size();
          GOBO_TRY(judgeOpen(open, look, true));
          if (open.size() == waiting) break;
        }
        choice_.chosen = chooseByEvidence(evidence_, budget_);
        closer = look + 1 < looks.size() && anotherLook(looks[look + 1], again);
      }
      if (!closer) break;
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
  /// Judges those that it is worth doing for, the cheapest first: others may be too dear then. They leave `open`, and so do those which cannot win. `now`:
  /// those too that a closer look at others may save.
  Status judgeOpen(std::vector<size_t>& open, size_t look, bool now) {
    std::vector<size_t> left = std::move(open);
    open.clear();
    while (!left.empty()) {
      const auto at = std::min_element(left.begin(), left.end(), [&](size_t x, size_t y) { return evidence_[x].ms < evidence_[y].ms; });
      const size_t k = *at;
      left.erase(at);
      if (!worthJudging(k)) continue;
      if (!now && mayBeSpared(k)) open.push_back(k);
      else GOBO_TRY(judge(k, look));
    }
    return {};
  }
  /// Whether to look closer, at the choice and what may be better, `again`; designs the look.
  bool anotherLook(const LookSize& look, std::vector<size_t>& again) {
    const std::vector<size_t> rivals = rivalsOf(evidence_, budget_, choice_.chosen);
    again.clear();
    for (const size_t k : rivals)
      if (k >= rays_) again.push_back(k);
    if (choice_.chosen >= rays_) again.push_back(choice_.chosen);
    design(look);
    // Of ray counts, those that it is for, and fewer; all of them if nothing is known of any.
    size_t most = choice_.chosen < rays_ ? choice_.chosen : 0;
    if (rays_ > 0 && blindChoice(evidence_, budget_, choice_.chosen)) most = rays_ - 1;
    for (const size_t k : rivals) most = std::max(most, k < rays_ ? k : 0);
    if (rays_ > 0) {
      probe_.rays.assign(counts_.begin(), counts_.begin() + long(most) + 1);
      if (soft_ && probe_.rays.back() <= kFewTruthRays) probe_.truthRays = kFewTruthRays;
    }
    const double taps = soft_ ? 0.0 : kHardTaps * double(again.size()) * probe_.judged * input_.viewSamples;  // a soft lookup is nothing beside 60 rays
    double costMs = (shadowProbeRays(probe_) + taps) * probeRay_ * 1e-6;
    for (const size_t k : again)
      if (costs_[k].filtered) costMs += costs_[k].judgeMs;  // maps are there by now
    return worthAnotherLook(evidence_, budget_, choice_.chosen, rivals, costMs);
  }

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
    judged_ = more;
    choice_.receivers = (pixels_ * choice_.receivers + more * judged->plane<double>("share")[0]) / (pixels_ + more);
    pixels_ += more;
    for (size_t k = 0; k < probe_.rays.size(); ++k) traced_[k].add(judged->plane<double>("mse")[k], judged->plane<double>("variance")[k], more);
    for (size_t k = 0; k < probe_.rays.size(); ++k) barely_[k].add(judged->plane<double>("barely")[k], judged->plane<double>("barely_variance")[k], more);
    const std::vector<ProbeEvidence> falling = fallingErrors(traced_);
    std::copy(falling.begin(), falling.end(), evidence_.begin());
    compareFilters();
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
    if (costs_[k].filtered) return filterErrors(k, look, of);
    GOBO_ASSIGN(const NodeId visibility, visibilityOf(k, of));
    return expand_(graph_, graph_.add({makeProbeErrorsNode(input_.viewSamples), {node_, visibility}, {}, "probe_errors:" + of, 0, nullptr, false}));
  }
  /// The same of a filter over neighbours.
  Result<TermPtr> filterErrors(size_t k, size_t look, const std::string& of) {
    ProbeWindowsSettings w = filterWindows(input_.viewSamples);
    w.camera = input_.camera;
    w.width = input_.filmWidth();
    w.height = input_.filmHeight();
    w.judged = int(judged_);
    w.seed = probe_.seed;
    ShadowInput there = input_;
    there.gbuffer = graph_.add({makeProbeWindowsNode(w), {node_}, {input_.light}, "probe_windows:" + light_.name + nameOf(look), 0, input_.scene, false});
    there.width = there.height = w.side();
    there.viewSamples = w.extent().layers;
    there.place = {};
    const NodeId before = graph_.size();
    const v1::ShadowTechnique& technique = choice_.candidates[k].technique;
    GOBO_ASSIGN(const NodeId visibility, findShadowTechnique(technique.technique_case())->plan(graph_, there, technique));
    for (NodeId id = before; id < graph_.size(); ++id) graph_.addToLabels(id, " probe" + of.substr(light_.name.size()));
    GOBO_ASSIGN(const NodeId maps, planShadowFilterMaps(graph_, visibility));
    return expand_(graph_,
                   graph_.add({makeWindowErrorsNode({w, comparedWith(k)}), {there.gbuffer, visibility, maps}, {}, "window_errors:" + of, 0, nullptr, false}));
  }
  Status judge(size_t k, size_t look) {
    AutomaticCandidate& candidate = choice_.candidates[k];
    GOBO_ASSIGN(const TermPtr term, errorsOf(k, look));
    const bool filter = costs_[k].filtered > 0;
    const double before = evidence_[k].pixels, more = filter ? filterWindows(1).windows : judged_;
    if (term->hasPlane("work")) {
      const auto work = term->plane<double>("work");
      candidate.work.resize(work.size(), 0.0);
      for (size_t i = 0; i < work.size(); ++i) candidate.work[i] = (before * candidate.work[i] + more * work[i]) / (before + more);
    }
    if (filter) ratio_[k].add(std::max(term->plane<double>("ratio")[0], 0.0), term->plane<double>("variance")[0], more);
    else evidence_[k].add(term->plane<double>("mse")[0], term->plane<double>("variance")[0], more);
    compareFilters();
    retime();
    return {};
  }
  uint32_t comparedWith(size_t k) const { return std::min(costs_[k].filtered, kWindowTruthRays); }
  /// A filter's error: what windows say of it beside as many rays, times what looks say of these; where little of the light can shine, that of the rays.
  void compareFilters() {
    for (size_t k = rays_; k < evidence_.size(); ++k) {
      if (!ratio_[k].judged()) continue;
      const size_t of = size_t(std::find(counts_.begin(), counts_.end(), comparedWith(k)) - counts_.begin());
      GOBO_CHECK(of < rays_);
      const ProbeEvidence &r = ratio_[k], &traced = evidence_[of], &barely = barely_[of];
      const double noise = std::max(traced.mse - barely.mse, 0.0);
      evidence_[k].mse = r.mse * noise + barely.mse;
      evidence_[k].variance = r.variance * (noise * noise + traced.variance) + r.mse * r.mse * traced.variance + barely.variance;
      evidence_[k].pixels = r.pixels;
    }
  }
  /// What map k says of the pixels that the probe looks at.
  Result<NodeId> visibilityOf(size_t k, const std::string& of) {
    if (const std::optional<ProbeMap>& map = costs_[k].virtualMap)
      return graph_.add({makeMapProbeNode({*map, base_.bias, base_.slopeBias, input_.clear}), {node_}, {}, "map_probe:" + of, 0, input_.scene, false});
    ShadowInput there = input_;
    there.gbuffer = node_;
    if (there.place.x >= 0) {  // taps are turned by the order of the probe's pixels, whatever the window; a style's guard stays, for map.fit = CAMERA
      there.width = input_.filmWidth();
      there.height = input_.filmHeight();
      there.place = {};
    }
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
      if (!evidence_[k].judged() && evidence_[j].judged() && alike(j, k) && costs_[j].taps <= costs_[k].taps && costs_[j].resolution <= costs_[k].resolution &&
          costs_[j].filtered <= costs_[k].filtered)
        from = j;
    return choice_.candidates[from].work;
  }

  /// One that cannot win by its time is not judged, nor a soft map whose making is probably lost.
  bool worthJudging(size_t k) const {
    if (std::none_of(evidence_.begin(), evidence_.end(), [](const ProbeEvidence& e) { return e.judged(); })) return true;
    const ProbeEvidence& best = evidence_[chooseByEvidence(evidence_, budget_)];
    if (budget_.timeMs > 0 && costs_[k].filtered && costs_[k].judgeMs > kShareOfFilters * budget_.timeMs) return false;
    if (budget_.timeMs > 0) return evidence_[k].ms <= budget_.timeMs || best.ms > budget_.timeMs;
    const bool keeps = best.high() <= budget_.error;
    if (keeps && evidence_[k].ms >= best.ms) return false;
    if (!soft_) return true;
    const double keep = std::max(budget_.error, keeps ? 0.0 : best.high());
    bool made = false;
    for (size_t j = rays_; j < evidence_.size(); ++j) {
      if (!evidence_[j].judged() || !alike(j, k)) continue;
      if (costs_[k].filtered) {  // noise and bias of filters fall about as their rays
        if (evidence_[j].mse * costs_[j].filtered > keep * keep * costs_[k].filtered) return false;
        continue;
      }
      made = made || costs_[j].resolution == costs_[k].resolution;
      // The share of pixels within a texel of an edge, the mean square error of edges, falls with the width of a texel; what only the light's corners see does
      // not fall at all.
      const double falls = std::min(1.0, double(costs_[j].resolution) / costs_[k].resolution);
      if (costs_[j].taps >= costs_[k].taps && falls * evidence_[j].low() * evidence_[j].low() > keep * keep) return false;
    }
    if (!keeps && (!costs_[k].filtered || costs_[k].judgeMs < best.ms)) return true;
    return made || kMapHelps * (best.ms - evidence_[k].ms) > (1.0 - kMapHelps) * costs_[k].judgeMs;
  }
  /// There is something to make, and a cheaper one of its kind may do, of which another look tells more; filters are compared with rays, of which it does too.
  bool mayBeSpared(size_t k) const {
    if (budget_.timeMs > 0 || !(costs_[k].judgeMs > 0)) return false;
    if (costs_[k].filtered) return true;
    for (size_t j = rays_; j < evidence_.size(); ++j)
      if (evidence_[j].judged() && alike(j, k) && evidence_[j].ms < evidence_[k].ms && costs_[j].resolution < costs_[k].resolution &&
          evidence_[j].low() <= budget_.error)
        return true;
    return false;
  }
  /// Both maps or both filters: one says something of the other.
  bool alike(size_t j, size_t k) const { return (costs_[j].filtered > 0) == (costs_[k].filtered > 0); }

  Graph& graph_;
  const ShadowInput& input_;
  ShadowMapSettings base_;
  const Expand& expand_;
  const Light& light_;
  bool soft_;
  double samples_;
  std::vector<CandidateCost> costs_;
  std::vector<uint32_t> counts_;  // of the rays
  size_t rays_;                   // the first candidates
  double probeRay_;
  ShadowBudget budget_;
  ShadowProbeSettings probe_;
  NodeId node_ = -1;
  double pixels_ = 0, judged_ = 0;              // of all looks, of the last
  std::vector<ProbeEvidence> traced_, barely_;  // of the rays as they were judged; the part where little light can shine
  std::vector<ProbeEvidence> ratio_;            // of filters over as many rays
  std::vector<ProbeEvidence> evidence_;         // of all
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
