// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "filters/outliers/nodes.h"
#include "filters/path_density/nodes.h"
#include "terms/dropped_samples.h"

namespace gobo::pathdensity {

namespace {

class PathDensityNode final : public Node {
 public:
  PathDensityNode(const Settings& settings, int width, int height) : s_(settings), width_(width), height_(height) {}
  std::string type() const override { return "path_density"; }
  NodeTraits traits() const override { return {}; }  // not tileable: a lone sample is compared with others at any distance
  void hashParameters(Hasher& h) const override {
    h.add(width_).add(height_).add(s_.metric.filmScale).add(s_.metric.colourScale).add(s_.metric.white).add(int(s_.metric.space));
    h.add(s_.neighbours)
        .add(s_.fewer)
        .add(s_.soft)
        .add(s_.hard)
        .add(int(s_.judged))
        .add(int(s_.border))
        .add(s_.density)
        .add(s_.first)
        .add(s_.spread)
        .add(s_.mostSpread)
        .add(s_.treeEpsilon);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, s_.metric.white > 0 ? 1 : 2);
    const Extent all{width_, height_, 1};
    readPathSamples(w, 0, width_, height_);
    if (w.size() > 1) w.over(1, all).reads<float>(1, "rgb", {3});
    TermShape out{type(), Domain::Pixel, all, {unsetPlane<float>("rgb", 3), unsetPlane<float>("rejected", 3), unsetPlane<float>("weight")}};
    passOnDropped(w.input(0), out);
    if (s_.first > 0) out.planes.push_back(unsetPlane<float>("first", 3));
    if (s_.density) out.planes.push_back(unsetPlane<float>("density"));
    return w.gives(std::move(out));
  }
  Cost cost(const TermShape& result, uint32_t) const override {
    // Samples are not known here: 16 a pixel.
    return {0.0, 16.0 * (s_.density ? 1500.0 : 700.0) * double(result.extent.elements()) * (s_.judged == Judged::Apart ? 2 : 1)};
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const SampleView samples = pathSamplesOf(*ctx.inputs[0]);
    Settings own = s_;
    if (ctx.inputs.size() > 1) { GOBO_ASSIGN(own.metric.white, outliers::whiteOfSamples(samples, ctx.inputs[1]->floats("rgb"), *ctx.arena, ctx.stop)); }
    GOBO_ASSIGN(const Filtered f, rejectOutliers(samples, own, *ctx.arena, ctx.stop));
    const auto& out = ctx.result;
    const auto fill = [&](const char* name, const std::vector<float>& from) { std::copy(from.begin(), from.end(), out->writable<float>(name).begin()); };
    fill("rgb", f.rgb);
    fill("rejected", f.rejected);
    fill("weight", f.weight);
    if (s_.first > 0) fill("first", f.first);
    if (s_.density) fill("density", f.density);
    passOnDropped(*ctx.inputs[0], *out);
    return TermPtr(out);
  }

 private:
  Settings s_;
  int width_, height_;
};

}  // namespace

NodePtr makePathDensityNode(const Settings& settings, int width, int height) { return std::make_shared<PathDensityNode>(settings, width, height); }

}  // namespace gobo::pathdensity
