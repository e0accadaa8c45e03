// SPDX-License-Identifier: Apache-2.0
#include "techniques/environment_lights/worth.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "base/hash.h"
#include "base/sobol.h"
#include "technique/plan_sum.h"
#include "techniques/direct_visibility/visibility.h"
#include "techniques/environment_lights/stand_ins.h"
#include "techniques/environment_lights/technique.h"
#include "techniques/path_traced/trace_paths.h"

namespace gobo {
inline namespace techniques {

namespace {

constexpr double kLookPixels = 1024;
constexpr uint32_t kLookSamples = 128;  // of path tracing, each of two pictures
constexpr uint32_t kLeastSide = 4;
constexpr double kLeastGain = 1.5;  // what the lights get wrong no sample cures

/// Direct light of a small picture of the request's view. `part`: which of the look's pictures; each has numbers of its own.
v1::RenderRequest smallRequest(const v1::RenderRequest& request, uint64_t part) {
  v1::RenderRequest r = request;
  const double shrink = std::sqrt(kLookPixels / (double(r.width()) * r.height()));
  const auto side = [&](uint32_t full) { return std::clamp(uint32_t(std::lround(full * shrink)), std::min(kLeastSide, full), full); };
  r.set_width(side(request.width()));
  r.set_height(side(request.height()));
  r.mutable_integrator()->set_max_bounces(0);
  r.mutable_integrator()->set_at_view_samples(true);  // edges are no error of the lights
  r.set_seed(hash64(hash64(request.seed(), 0x10014), part));
  return r;
}

/// Direct light of the map by path tracing, as contributions of `c`.
Status tracePathsTo(PlanContext& c, int map, const std::string& label) {
  const char* name = environmentLights().name();
  GOBO_TRY(c.cover().claim(map, PathSet::Direct, name));
  return tracePaths(c, name, {map}, PathSet::Direct, label);
}

struct Expense {
  double ns = 0;
  uint64_t bytes = 0;
};
/// What running all that `plan` adds to the graph would take, which is then taken away again.
template <typename Add>
Result<Expense> expenseOf(Graph& graph, Add&& plan) {
  const Graph::Mark mark = graph.mark();
  const Status planned = plan();
  Expense out;
  for (NodeId id = mark.nodes; id < graph.size(); ++id) {
    const GraphNode& n = graph.at(id);
    out.ns += n.node->cost(n.shape, n.blocks).ns;
    out.bytes += outputBytes(n);
  }
  graph.rollBack(mark);
  GOBO_TRY(planned);
  return out;
}

LookedAt compared(std::span<const float> x, std::span<const float> a, std::span<const float> b) {
  LookedAt out;
  const double n = double(x.size());
  double squares = 0, quartics = 0;
  for (size_t i = 0; i < x.size(); ++i) {
    const double error2 = (double(x[i]) - a[i]) * (double(x[i]) - b[i]), apart = double(a[i]) - b[i], variance = 0.5 * apart * apart * kLookSamples;
    out.mean += 0.5 * (double(a[i]) + b[i]) / n;
    out.error2 += error2 / n;
    squares += error2 * error2 / n;
    out.variance += variance / n;
    quartics += variance * variance / n;
  }
  out.doubt = std::sqrt(std::max(0.0, squares - out.error2 * out.error2) / n);
  out.varianceDoubt = std::sqrt(std::max(0.0, quartics - out.variance * out.variance) / n);
  return out;
}

std::string number(const char* format, double v) {
  char text[32];
  std::snprintf(text, sizeof text, format, v);
  return text;
}

}  // namespace

LightsWorth worthBy(const LookedAt& seen, const std::string& lights) {
  if (!(seen.mean > 0)) return {true, "a look at a small picture found no light of the map: " + lights + " were asked for"};
  // Each a standard error to the lights' disadvantage: few pixels hold most of an error, and a look sees few of them.
  const double error2 = std::max(seen.error2, 0.0) + seen.doubt;
  const double paths2 = std::max(seen.variance - seen.varianceDoubt, 0.0) / std::max(seen.samples, 1.0);
  const double gain = error2 > 0 ? paths2 / error2 : kLeastGain;
  return {gain >= kLeastGain, (gain >= kLeastGain ? "worth it" : "not worth it") + std::string(", by a look at a small picture: path tracing would take ") +
                                  number("%.2g", gain) + " times as long as " + lights + " to their error, at most " +
                                  number("%.2g", 100.0 * std::sqrt(error2) / seen.mean) + " % of the mean"};
}

Result<LightsWorth> worthOfAreaLights(PlanContext& c, int map) {
  if (c.lensAtTimes()) return LightsWorth{false, "a lens needs path-traced light"};
  if (c.kinds().translucent)
    return LightsWorth{true, "not weighed: what passes surfaces is path traced beside the lights, and a look does not tell it from what does not"};
  GOBO_ASSIGN(const StandIns lights, standInsOf(c));
  if (lights.count() > 0 && shadowTechniqueOf(c, lights.first, lights.extended, "environment").has_style())
    return LightsWorth{true, "not weighed: shadows of a style are not what path tracing comes to"};

  const uint32_t passes = passesFor(kLookSamples);
  PlanContext full = c.otherPicture(c.request(), passes, c.apart()), traced = c.otherPicture(c.request(), passes, c.apart());
  GOBO_ASSIGN(const Expense byLights, expenseOf(c.graph(), [&] { return bringStandIns(full, map, lights); }));
  GOBO_ASSIGN(const Expense byPaths, expenseOf(c.graph(), [&] { return tracePathsTo(traced, map, "direct"); }));

  std::vector<TermPtr> pictures;
  for (uint64_t part = 0; part < 3; ++part) {
    const v1::RenderRequest request = smallRequest(c.request(), part);
    PlanContext small = c.otherPicture(request, passes, {.seen = GBufferPart::All});
    const char* label[] = {"look by area lights", "look by paths", "look by other paths"};
    const NodeId all = c.graph().size();
    if (part == 0) small.surface();  // kept: each light reads it
    const NodeId made = c.graph().size();
    if (part == 0) GOBO_TRY(bringStandIns(small, map, lights));
    else GOBO_TRY(tracePathsTo(small, map, "direct"));
    c.graph().addToLabels(all, std::string(" (") + label[part] + ")");
    const NodeId sum = planSum(small, small.contributions(), label[part]);
    if (sum > made) c.graph().markTransient(made, sum - 1);
    GOBO_ASSIGN(TermPtr picture, c.expand(sum));
    pictures.push_back(std::move(picture));
  }
  if (c.bounding()) {
    // Of the window that is rendered; what decides is of the whole picture.
    c.reserve(uint64_t(double(byPaths.bytes) * c.view().width * c.view().height / (double(c.request().width()) * c.request().height())));
    return LightsWorth{true, "a look at a small picture decides whether they are worth it"};
  }
  LookedAt seen = compared(pictures[0]->floats("rgb"), pictures[1]->floats("rgb"), pictures[2]->floats("rgb"));
  seen.samples = byPaths.ns > 0 ? byLights.ns / byPaths.ns * samplesOf(passes) : 0.0;
  return worthBy(seen, lights.words());
}

}  // namespace techniques
}  // namespace gobo
