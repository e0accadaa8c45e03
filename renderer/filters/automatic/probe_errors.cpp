// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "filters/automatic/probe_pixels.h"
#include "filters/automatic/shadow_probe.h"

namespace gobo {
inline namespace filters {
namespace {

class ProbeErrorsNode final : public Node {
 public:
  explicit ProbeErrorsNode(int viewSamples) : viewSamples_(viewSamples) {}
  std::string type() const override { return "probe_errors"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.smallOutput = true;
    return t;
  }
  void hashParameters(Hasher& h) const override { h.add(viewSamples_); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 2);
    for (const char* each : {"a", "b", "lit"}) w.reads<float>(0, each);
    w.reads<double>(0, "weight").reads<uint32_t>(0, "stratum").reads<double>(0, "share");
    w.over(1, w.input(0).extent).reads<float>(1, "V");
    TermShape out{type(), Domain::Table, {1, 1, 1}, {plane<double>("mse"), plane<double>("variance")}};
    if (const int channels = w.channels(1, "work")) {
      w.reads<float>(1, "work", {channels});
      out.planes.push_back(plane<double>("work", channels));
    }
    return w.gives(out);
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    if (ctx.stop.stopRequested()) return Status(Code::Cancelled, "probe_errors stopped");
    const Term& probe = *ctx.inputs.at(0);
    const auto a = probe.floats("a"), b = probe.floats("b"), lit = probe.floats("lit"), V = ctx.inputs.at(1)->floats("V");
    const auto weight = probe.plane<double>("weight");
    const auto stratum = probe.plane<uint32_t>("stratum");
    const double share = probe.plane<double>("share")[0];
    const size_t S = size_t(viewSamples_), pixels = lit.size() / S;
    const std::span<const float> work = ctx.inputs.at(1)->hasPlane("work") ? ctx.inputs.at(1)->floats("work") : std::span<const float>();
    const size_t C = work.size() / V.size();
    StratifiedSum errors;
    std::vector<StratifiedSum> done(C);
    for (size_t p = 0; p < pixels; ++p) {
      const size_t first = p * S;
      double v = 0, among = 0;
      for (size_t e = first; e < first + S; ++e)
        if (lit[e] != 0.0f) v += V[e], ++among;
      const ProbePixel pixel{{}, stratum[first], weight[first]};
      errors.add(pixel, among > 0 ? (v / among - a[first]) * (v / among - b[first]) : 0.0);
      for (size_t c = 0; c < C; ++c) {
        double sum = 0;
        for (size_t e = first; e < first + S; ++e) sum += work[C * e + c];
        done[c].add(pixel, sum / double(S));
      }
    }
    const auto& term = ctx.result;
    term->writable<double>("mse")[0] = share > 0 ? errors.sum() / share : 0.0;
    term->writable<double>("variance")[0] = share > 0 ? errors.variance() / (share * share) : 0.0;
    for (size_t c = 0; c < C; ++c) term->writable<double>("work")[c] = std::max(done[c].sum(), 0.0);
    return TermPtr(term);
  }

 private:
  int viewSamples_;
};

}  // namespace

NodePtr makeProbeErrorsNode(int viewSamples) { return std::make_shared<ProbeErrorsNode>(viewSamples); }

}  // namespace filters
}  // namespace gobo
