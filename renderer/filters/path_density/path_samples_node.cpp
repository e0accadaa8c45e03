// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "filters/path_density/nodes.h"
#include "filters/path_density/trace_samples.h"

namespace gobo::pathdensity {

namespace {

class PathSamplesNode final : public Node {
 public:
  explicit PathSamplesNode(const PathSamplesSettings& settings) : s_(settings) {}
  std::string type() const override { return "path_samples"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.facets = kPathTracerFacets;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    s_.path.hash(h);
    h.add(s_.blocks);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 0);
    w.require(count() < double(1u << 31), "fewer than 2^31 samples");
    TermShape out{type(),
                  Domain::List,
                  {int(std::min(count(), double((1u << 31) - 1))), 1, 1},
                  {unsetPlane<float>("film", 2), unsetPlane<float>("direct", 3), unsetPlane<float>("indirect", 3)}};
    out.atMost = true;
    return w.gives(std::move(out));
  }
  /// The samples before they are the result's.
  size_t workingBytes() const override { return std::min(s_.bytes, size_t(count()) * PathSamples::kBytesOfSample); }
  Cost cost(const TermShape&, uint32_t) const override { return {8 * kReceiving * count(), 1300.0 * count()}; }

  Result<TermPtr> run(const RunContext& ctx) const override {
    GOBO_ASSIGN(const AccelPtr accel, ctx.accel());
    const auto tracer = PathTracer::create(*ctx.scene, accel, s_.path, ctx.stop);
    if (!tracer) return Status(Code::Cancelled, "stopped");
    uint64_t rays = 0, dropped = 0;
    GOBO_ASSIGN(const PathSamples samples, traceSamples(*tracer, s_.path, 0, s_.blocks, s_.bytes, *ctx.arena, rays, dropped, ctx.stop));
    if (ctx.counters) ctx.counters->rays += rays;
    const SampleView v = samples.view();
    auto out = std::make_shared<Term>(type(), Domain::List, Extent{int(v.size()), 1, 1});
    const auto fill = [&](const char* name, int channels, std::span<const float> from) {
      const auto to = out->addUnsetPlane<float>(name, channels);
      return ctx.arena->parallelFor(
          from.size(), 1 << 16,
          [&](size_t begin, size_t end) { std::copy(from.begin() + ptrdiff_t(begin), from.begin() + ptrdiff_t(end), to.begin() + ptrdiff_t(begin)); },
          ctx.stop);
    };
    if (!fill("film", 2, v.film) || !fill("direct", 3, v.direct) || !fill("indirect", 3, v.indirect)) return Status(Code::Cancelled, "stopped");
    return TermPtr(out);
  }

 private:
  double count() const { return double(s_.path.width) * s_.path.height * double(s_.blocks) * s_.path.blockSize; }
  PathSamplesSettings s_;
};

}  // namespace

NodePtr makePathSamplesNode(const PathSamplesSettings& settings) { return std::make_shared<PathSamplesNode>(settings); }

}  // namespace gobo::pathdensity
