// SPDX-License-Identifier: Apache-2.0
#include "plan/outliers.h"

#include <algorithm>
#include <cstdio>

#include "filters/outliers/nodes.h"
#include "filters/path_density/nodes.h"
#include "plan/denoised.h"
#include "trace/sample_passes.h"

namespace gobo {
inline namespace plan {

namespace {

/// Of the samples of one class of light: 2 GiB.
constexpr uint64_t kMostBytes = 2ull << 30;
/// Beside its samples a filter holds: coordinates, order and mean distances of each; sums and pictures in double.
constexpr uint64_t kWorkingBytesOfSample = 28, kWorkingBytesOfPixel = 320;
constexpr double kLeastOutlierWhite = 1e-12;  // what path density takes

uint64_t pixelsOf(const v1::RenderRequest& r) { return r.has_window() ? uint64_t(r.window().width()) * r.window().height() : uint64_t(r.width()) * r.height(); }
uint64_t fitting(const v1::RenderRequest& r) { return kMostBytes / (pathdensity::kTermBytesOfSample * std::max<uint64_t>(pixelsOf(r), 1)); }

/// Samples of a state that count together.
struct JudgedLight {
  NodeId state = -1;
  PathSet paths = PathSet::None;  // Direct or Indirect
  std::shared_ptr<const TracedPaths> traced;
  std::vector<Vec3> weights;  // by slot
};

bool isJudged(const v1::OutlierRejection& settings, const Contribution& k) {
  return k.traced && !overlaps(k.paths, PathSet::Emission) && (overlaps(k.paths, PathSet::Indirect) || settings.judged() == v1::OutlierRejection::APART);
}

struct RejectionNode {
  NodePtr node;
  bool picture = false;  // it reads the rest of the picture too, for its white
  const char* approximate = "";
  uint64_t bytes = 0;  ///< it holds beside what all methods do
};

/// samples: of a pixel.
RejectionNode rejectionNode(const v1::OutlierRejection& o, int width, int height, uint64_t samples, int first) {
  const float white = float(o.white());
  switch (o.method_case()) {
    case v1::OutlierRejection::kReweighting: {
      outliers::Reweighting s;
      s.start = white;
      s.base = float(o.reweighting().base());
      s.enough = float(o.reweighting().enough());
      outliers::Reweighting most = s;  // of whatever white
      if (!(white > 0)) most.start = float(kLeastOutlierWhite);
      return {outliers::makeReweightedMeanNode(s, width, height, first), !(white > 0), "bright samples without others of their brightness around count less",
              outliers::reweightingBytes(width, height, samples, most)};
    }
    case v1::OutlierRejection::kMedianOfMeans:
      return {outliers::makeMedianOfMeansNode(int(o.median_of_means().buckets()), width, height, first), false,
              "a pixel's extreme samples are left out, and with them some of its light"};
    case v1::OutlierRejection::kTrimmed:
      return {outliers::makeTrimmedMeanNode(o.trimmed().share(), width, height, first), false,
              "a pixel's lowest and highest samples are left out, and with them some of its light"};
    default: break;
  }
  const v1::PathDensityRejection& d = o.path_density();
  pathdensity::Settings s;
  s.metric.white = white;
  s.metric.colourScale = float(d.color());
  s.neighbours = int(d.neighbours());
  s.fewer = true;
  s.first = first;
  s.soft = float(d.soft());
  s.hard = float(d.hard());
  s.spread = float(d.spread_px());
  s.mostSpread = float(d.most_spread());
  return {pathdensity::makePathDensityNode(s, width, height), !(white > 0),
          "samples that no others near by resemble are left out, and what of the light comes as such"};
}

/// Passes whose samples a plan has to be ready for.
uint32_t passesOf(const PlanContext& c) {
  if (!c.bounding()) return c.passes();
  const uint32_t most = c.request().halt().has_spp() ? c.request().halt().spp() : mostSamples(c.request(), ~0u);
  return std::max(c.passes(), passesFor(most));
}

}  // namespace

std::vector<Contribution> withoutOutliers(PlanContext& c, std::span<const Contribution> brought, const std::string& label, uint32_t first) {
  const v1::OutlierRejection& settings = c.request().denoise().outliers();
  std::vector<Contribution> out;
  std::vector<JudgedLight> judged;
  for (const Contribution& k : brought) {
    if (!isJudged(settings, k)) {
      out.push_back(k);
      continue;
    }
    const PathSet paths = overlaps(k.paths, PathSet::Indirect) ? PathSet::Indirect : PathSet::Direct;
    auto at = std::find_if(judged.begin(), judged.end(), [&](const JudgedLight& j) { return j.state == k.state && j.paths == paths; });
    if (at == judged.end()) {
      const PathTracerSettings& s = k.traced->settings;
      const size_t slots = size_t(s.groups) * size_t(slotsPerGroup(s.split, s.maxBounces));
      at = judged.insert(judged.end(), {k.state, paths, k.traced, std::vector<Vec3>(slots, Vec3(0.0f))});
    }
    at->weights[size_t(k.slot)] += k.weight;
  }
  const int width = c.view().width, height = c.view().height;
  const uint32_t passes = passesOf(c);
  const uint64_t pixels = uint64_t(width) * uint64_t(height), samples = pixels * samplesOf(passes);
  for (const JudgedLight& j : judged) {
    const TracedPaths& t = *j.traced;
    const NodePtr source = pathdensity::makePathSamplesNode({t.settings, j.weights, t.streams, c.view()});
    std::vector<NodeId> inputs{c.graph().add({source, {}, t.lights, label + " samples of " + t.label, passes, t.scene})};
    RejectionNode rejection = rejectionNode(settings, width, height, samplesOf(passes), int(first));
    if (rejection.picture) {
      std::vector<Contribution> rest;
      for (const Contribution& k : c.contributions())
        if (!isJudged(settings, k)) rest.push_back(k);
      inputs.push_back(planSum(c, rest, "light that is not judged"));
    }
    GraphNode n{std::move(rejection.node), std::move(inputs), {}, label + " " + t.label + " without outliers"};
    n.approximate = rejection.approximate;
    c.reserve(kWorkingBytesOfSample * samples + kWorkingBytesOfPixel * pixels + rejection.bytes);
    Contribution kept{c.graph().add(std::move(n)), "rgb"};
    kept.paths = j.paths;
    kept.state = j.state;  // what it was traced as
    out.push_back(std::move(kept));
  }
  return out;
}

uint32_t mostSamples(const v1::RenderRequest& r, uint32_t most) {
  if (!r.denoise().has_outliers()) return most;
  const uint64_t fit = fitting(r);
  uint32_t passes = passesFor(uint32_t(std::min<uint64_t>(fit, 1u << 20)));
  while (passes > 1 && samplesOf(passes) > fit) --passes;
  return std::min(most, samplesOf(passes));
}

Status checkOutliers(const v1::RenderRequest& r) {
  if (!r.denoise().has_outliers()) return {};
  const v1::OutlierRejection& o = r.denoise().outliers();
  if (r.denoise().has_axis_aligned())
    return invalidArgument("request.denoise.outliers: not before axis_aligned, which is told of each lobe's light by all samples", "request.denoise.outliers");
  if (o.white() > 0 && o.white() < kLeastOutlierWhite) {
    const std::string field = "request.denoise.outliers.white";
    char text[160];
    std::snprintf(text, sizeof text, " = %g: must be 0 or at least %g", o.white(), kLeastOutlierWhite);
    return invalidArgument(field + text, field);
  }
  if (o.has_path_density() && o.path_density().hard() < o.path_density().soft()) {
    const std::string field = "request.denoise.outliers.path_density.hard";
    char text[160];
    std::snprintf(text, sizeof text, " = %g: must be at least `soft`, which is %g", o.path_density().hard(), o.path_density().soft());
    return invalidArgument(field + text, field);
  }
  const uint64_t fit = fitting(r), wanted = r.halt().has_spp() ? samplesOf(passesFor(r.halt().spp())) : 1;
  if (wanted <= fit) return {};
  const std::string field = r.halt().has_spp() ? "request.halt.spp" : "request.width";
  return {Code::ResourceExhausted,
          field + " = " + std::to_string(r.halt().has_spp() ? r.halt().spp() : r.width()) + ": request.denoise.outliers holds every sample, " +
              std::to_string(pathdensity::kTermBytesOfSample) + " bytes each: " + std::to_string(wanted) + " of " + std::to_string(pixelsOf(r)) +
              " pixels are more than the " + std::to_string(kMostBytes >> 20) + " MiB that it may take (" + std::to_string(fit) + " samples a pixel)",
          field};
}

}  // namespace plan
}  // namespace gobo
