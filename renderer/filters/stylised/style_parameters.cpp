// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/style_parameters.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdio>

#include "filters/stylised/edge_mean.h"

namespace gobo {
inline namespace filters {

namespace {

class StyleParametersNode final : public Node {
 public:
  StyleParametersNode(const Extent& e, StyleFormulaList formulas, double time, const ViewPlace& place)
      : extent_(e), formulas_(std::move(formulas)), time_(time), place_(place) {
    GOBO_CHECK(!formulas_.empty());
  }
  std::string type() const override { return "style_parameters"; }
  int version() const override { return 1; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    for (const auto& [field, f] : formulas_) {
      h.add(int(field)).add(f.formula.text()).add(f.low).add(f.high);
      for (const StyleFormula::Object& o : f.objects) {
        h.add(o.caster).add(uint64_t(o.instances.size()));
        for (const uint32_t i : o.instances) h.add(i);
      }
    }
    if (reads(StyleName::Time)) h.add(time_);
    // No place: it is of errors alone, and the G-buffer's key has it anyhow.
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    const size_t distance = readsEdges() ? 1 : 0, edge = reads(StyleName::Edge) ? 1 : 0;
    Wiring w(type(), in, 1 + distance + edge);
    w.over(0, extent_).reads<float>(0, "P", {3}).reads<float>(0, "N", {3}).reads<float>(0, "depth").reads<uint32_t>(0, "instance");
    if (distance) w.over(1, extent_).reads<float>(1, "d");
    for (const auto& [field, f] : formulas_)
      for (const StyleFormula::Object& o : f.objects)
        if (o.caster >= 0) w.reads<float>(1, edgeCasterPlane(o.caster));
    if (edge) w.over(1 + distance, extent_).reads<float>(1 + distance, "D");
    TermShape shape{type(), Domain::ViewSample, extent_, {}};
    for (const auto& [field, f] : formulas_) shape.planes.push_back(unsetPlane<float>(kStyleFields[size_t(field)]));
    return w.gives(shape);
  }
  Cost cost(const TermShape& result, uint32_t) const override { return {0.0, 60.0 * double(formulas_.size()) * double(result.extent.elements())}; }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Inputs in(ctx, readsEdges(), reads(StyleName::Edge));
    for (const auto& entry : formulas_) {
      const auto& f = entry.second;
      const auto out = ctx.result->writable<float>(kStyleFields[size_t(entry.first)]);
      std::atomic<size_t> wrong{SIZE_MAX};
      const bool complete = ctx.arena->parallelFor(
          out.size(), 1 << 13,
          [&](size_t begin, size_t end) {
            Formula::Evaluator evaluator(f.formula);
            for (size_t e = begin; e < end; ++e) {
              if (in.instance[e] == ~0u) {
                out[e] = 0.0f;
                continue;
              }
              const double value = in.at(e, f, time_, evaluator);
              out[e] = std::isfinite(value) ? float(std::clamp(value, f.low, f.high)) : 0.0f;
              if (std::isfinite(value)) continue;
              for (size_t first = wrong.load(); e < first && !wrong.compare_exchange_weak(first, e);) {}
            }
          },
          ctx.stop);
      if (!complete) return Status(Code::Cancelled, "style_parameters: stopped");
      if (wrong != SIZE_MAX) return refuse(in, wrong, f);
    }
    return TermPtr(ctx.result);
  }

 private:
  struct Inputs {
    Inputs(const RunContext& ctx, bool distance, bool edge)
        : P(ctx.inputs[0]->floats("P")),
          N(ctx.inputs[0]->floats("N")),
          depth(ctx.inputs[0]->floats("depth")),
          instance(ctx.inputs[0]->plane<uint32_t>("instance")) {
      if (distance) {
        d = ctx.inputs[1]->floats("d");
        for (size_t k = 0; k < kMostCasters; ++k)
          if (ctx.inputs[1]->hasPlane(edgeCasterPlane(int(k)))) casters[k] = ctx.inputs[1]->floats(edgeCasterPlane(int(k)));
      }
      if (edge) D = ctx.inputs[distance ? 2 : 1]->floats("D");
    }
    double value(StyleName name, size_t e, double time) const {
      switch (name) {
        case StyleName::Time: return time;
        case StyleName::Distance: return d.empty() ? 0.0 : double(d[e]);
        case StyleName::Depth: return double(depth[e]);
        case StyleName::X:
        case StyleName::Y:
        case StyleName::Z: return double(P[3 * e + size_t(name) - size_t(StyleName::X)]);
        case StyleName::Nx:
        case StyleName::Ny:
        case StyleName::Nz: return double(N[3 * e + size_t(name) - size_t(StyleName::Nx)]);
        case StyleName::Edge: return D.empty() ? 0.0 : double(D[e]);
      }
      return 0.0;
    }
    double at(size_t e, const StyleFormula& f, double time, Formula::Evaluator& evaluator) const {
      for (size_t k = 0; k < kStyleNames.size(); ++k)
        if (f.formula.reads(k)) evaluator.name(k) = value(StyleName(k), e, time);
      for (size_t k = 0; k < f.objects.size(); ++k) {
        const StyleFormula::Object& o = f.objects[k];
        evaluator.object(k) = o.caster >= 0                                                             ? double(casters[size_t(o.caster)][e])
                              : std::binary_search(o.instances.begin(), o.instances.end(), instance[e]) ? 1.0
                                                                                                        : 0.0;
      }
      return evaluator();
    }
    std::span<const float> P, N, depth, d, D;
    std::array<std::span<const float>, kMostCasters> casters;
    std::span<const uint32_t> instance;
  };

  bool reads(StyleName name) const {
    return std::any_of(formulas_.begin(), formulas_.end(), [&](const auto& f) { return f.second.reads(name); });
  }

  bool readsEdges() const {
    return std::any_of(formulas_.begin(), formulas_.end(), [](const auto& f) { return f.second.readsEdges(); });
  }

  Status refuse(const Inputs& in, size_t e, const StyleFormula& f) const {
    const int64_t x = int64_t(e % size_t(extent_.width)) + place_.x, y = int64_t(e / size_t(extent_.width) % size_t(extent_.height)) + place_.y;
    std::string read;
    for (size_t k = 0; k < kStyleNames.size(); ++k) {
      if (!f.formula.reads(k)) continue;
      char text[64];
      std::snprintf(text, sizeof text, "%s%s = %g", read.empty() ? "" : ", ", kStyleNames[k].data(), in.value(StyleName(k), e, time_));
      read += text;
    }
    return invalidArgument(f.place + ": is no finite number at pixel " + std::to_string(x) + ", " + std::to_string(y) + (read.empty() ? "" : ", where " + read),
                           f.place);
  }

  Extent extent_;
  StyleFormulaList formulas_;
  double time_;
  ViewPlace place_;
};

}  // namespace

NodePtr makeStyleParametersNode(const Extent& extent, StyleFormulaList formulas, double time, const ViewPlace& place) {
  return std::make_shared<StyleParametersNode>(extent, std::move(formulas), time, place);
}

}  // namespace filters
}  // namespace gobo
