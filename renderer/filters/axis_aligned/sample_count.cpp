// SPDX-License-Identifier: Apache-2.0
#include "filters/axis_aligned/sample_count.h"

#include <algorithm>
#include <cmath>

#include "formulas/axis_aligned.glsl.h"

namespace gobo {
inline namespace filters {
namespace {

float samples(const ShadowRateSettings& r, float sMin, float sMax, float footprint, float mu) {
  if (r.distant)
    return r.printed ? formulas::aaDistantSamplesPrinted(sMin, sMax, r.sigma, footprint, mu) : formulas::aaDistantSamples(sMin, sMax, r.sigma, footprint, mu);
  return r.printed ? formulas::aaSamplesPrinted(sMin, sMax, r.sigma, footprint, mu) : formulas::aaSamplesCapped(sMin, sMax, r.sigma, footprint, mu);
}

uint32_t sampleCount(const ShadowRateSettings& r, float sMin, float sMax, float footprint, float mu) {
  if (r.uniform > 0) return r.uniform;
  if (!(sMin > 0.0f)) return r.pilot;
  const float n = samples(r, sMin, sMax, footprint, mu);
  if (!(n < float(r.maxSamples))) return std::max(r.pilot, r.maxSamples);
  return std::max(r.pilot, uint32_t(n + 0.5f));
}

float bandLimit(const ShadowRateSettings& r, float sMin, float footprint, float mu) {
  return r.distant ? formulas::aaDistantBandLimit(sMin, r.sigma, footprint, mu) : formulas::aaBandLimit(sMin, r.sigma, footprint, mu);
}

void hashRate(Hasher& h, const ShadowRateSettings& r) {
  h.add(r.sigma).add(r.pilot).add(r.maxSamples).add(r.uniform);
  if (r.distant) h.add("distant");
  if (r.printed) h.add("printed");
}

class ShadowSlopeDilation final : public Node {
 public:
  ShadowSlopeDilation(int radius, const Extent& extent) : radius_(radius), extent_(extent) {}
  std::string type() const override { return "shadow_slope_dilation"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.tileable = true;
    t.halo = radius_;
    return t;
  }
  void hashParameters(Hasher& h) const override { h.add(radius_); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 2);
    w.over(0, extent_).reads<float>(0, "sMax").reads<float>(0, "sMin").reads<uint8_t>(0, "occluded").over(1, extent_).reads<uint32_t>(1, "instance");
    return w.gives({type(), Domain::ViewSample, extent_, {plane<float>("sMax"), plane<float>("sMin")}});
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const auto inMax = ctx.inputs.at(0)->floats("sMax"), inMin = ctx.inputs[0]->floats("sMin");
    const auto occluded = ctx.inputs[0]->plane<uint8_t>("occluded");
    const auto instance = ctx.inputs.at(1)->plane<uint32_t>("instance");
    const Extent e = ctx.inputs[0]->extent();
    const auto& term = ctx.result;
    const auto sMax = term->writable<float>("sMax"), sMin = term->writable<float>("sMin");
    std::vector<float> rowMax(inMax.begin(), inMax.end()), rowMin(inMin.begin(), inMin.end());
    const size_t rows = size_t(e.height) * e.layers;
    // A slope of 0 stands for "none": sMin is the smallest positive one.
    auto take = [](float& largest, float& smallest, float a, float b) {
      if (!(b > 0.0f)) return;
      largest = std::max(largest, a);
      smallest = smallest > 0.0f ? std::min(smallest, b) : b;
    };
    bool complete = ctx.arena->parallelFor(
        rows, 16,
        [&](size_t y0, size_t y1) {
          for (size_t y = y0; y < y1; ++y)
            for (int x = 0; x < e.width; ++x) {
              const size_t p = y * e.width + x;
              for (int q = std::max(0, x - radius_); q <= std::min(e.width - 1, x + radius_); ++q)
                if (instance[y * e.width + q] == instance[p]) take(rowMax[p], rowMin[p], inMax[y * e.width + q], inMin[y * e.width + q]);
            }
        },
        ctx.stop);
    complete = complete && ctx.arena->parallelFor(
                               rows, 16,
                               [&](size_t y0, size_t y1) {
                                 for (size_t row = y0; row < y1; ++row) {
                                   const int y = int(row % e.height);
                                   for (int x = 0; x < e.width; ++x) {
                                     const size_t p = row * e.width + x;
                                     sMax[p] = inMax[p];
                                     sMin[p] = inMin[p];
                                     if (occluded[p] || instance[p] == ~0u) continue;
                                     for (int j = std::max(-radius_, -y); j <= std::min(radius_, e.height - 1 - y); ++j) {
                                       const size_t q = size_t(int64_t(p) + int64_t(j) * e.width);
                                       if (instance[q] == instance[p]) take(sMax[p], sMin[p], rowMax[q], rowMin[q]);
                                     }
                                   }
                                 }
                               },
                               ctx.stop);
    if (!complete) return Status(Code::Cancelled, "shadow_slope_dilation: stopped");
    return TermPtr(term);
  }

 private:
  int radius_;
  Extent extent_;
};

class ShadowMu final : public Node {
 public:
  ShadowMu(float mu, float mean, const ShadowRateSettings& r) : mu_(mu), mean_(mean), rate_(r) {}
  std::string type() const override { return "shadow_mu"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.smallOutput = true;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    h.add(mean_);
    if (mean_ > 0.0f) hashRate(h, rate_);
    else h.add(mu_);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, mean_ > 0.0f ? 2 : 0, 2);
    if (mean_ > 0.0f) w.reads<float>(0, "sMin").reads<float>(0, "sMax").over(1, w.input(0).extent).reads<float>(1, "footprint").reads<uint32_t>(1, "instance");
    return w.gives({type(), Domain::Table, {1, 1, 1}, {plane<float>("mu"), plane<float>("filterMu")}});
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const auto& term = ctx.result;
    const float mu = mean_ > 0.0f ? solve(*ctx.inputs.at(0), *ctx.inputs.at(1), ctx.stop) : mu_;
    if (ctx.stop.stopRequested()) return Status(Code::Cancelled, "shadow_mu: stopped");
    term->writable<float>("mu")[0] = mu;
    term->writable<float>("filterMu")[0] = mean_ > 0.0f ? std::max(mu, 1.0f) : mu;
    return TermPtr(term);
  }

 private:
  float solve(const Term& slopes, const Term& gbuffer, const StopToken& stop) const {
    const auto sMin = slopes.floats("sMin"), sMax = slopes.floats("sMax"), footprint = gbuffer.floats("footprint");
    const auto instance = gbuffer.plane<uint32_t>("instance");
    const size_t step = sMin.size() < 65536 ? 1 : 8;
    std::vector<size_t> list;
    for (size_t e = 0; e < sMin.size(); e += step)
      if (instance[e] != ~0u) list.push_back(e);
    if (list.empty()) return 1.0f;
    auto mean = [&](double mu) {
      uint64_t sum = 0;
      for (size_t i = 0; i < list.size(); ++i) {
        if (i % 4096 == 0 && stop.stopRequested()) break;
        const size_t e = list[i];
        sum += sampleCount(rate_, sMin[e], sMax[e], footprint[e], float(mu));
      }
      return double(sum) / double(list.size());
    };
    double lo = std::log(0.25), hi = std::log(64.0);
    for (int i = 0; i < 20 && !stop.stopRequested(); ++i) {
      const double middle = 0.5 * (lo + hi);
      (mean(std::exp(middle)) < mean_ ? lo : hi) = middle;
    }
    return float(std::exp(0.5 * (lo + hi)));
  }

  float mu_, mean_;
  ShadowRateSettings rate_;
};

class ShadowSampleCount final : public Node {
 public:
  ShadowSampleCount(const ShadowRateSettings& r, const Extent& e) : rate_(r), extent_(e) {}
  std::string type() const override { return "shadow_sample_count"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override { hashRate(h, rate_); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 3);
    w.over(0, extent_).reads<float>(0, "sMin").reads<float>(0, "sMax").over(1, extent_).reads<float>(1, "footprint").reads<uint32_t>(1, "instance");
    w.over(2, {1, 1, 1}).reads<float>(2, "mu").reads<float>(2, "filterMu");
    return w.gives({type(), Domain::ViewSample, extent_, {plane<uint32_t>("n"), plane<float>("Omega")}});
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const auto sMin = ctx.inputs.at(0)->floats("sMin"), sMax = ctx.inputs[0]->floats("sMax");
    const auto footprint = ctx.inputs.at(1)->floats("footprint");
    const auto instance = ctx.inputs[1]->plane<uint32_t>("instance");
    const float mu = ctx.inputs.at(2)->floats("mu")[0], filterMu = ctx.inputs[2]->floats("filterMu")[0];
    const auto& term = ctx.result;
    const auto n = term->writable<uint32_t>("n");
    const auto omega = term->writable<float>("Omega");
    const bool complete = ctx.arena->parallelFor(
        sMin.size(), 1 << 13,
        [&](size_t begin, size_t end) {
          for (size_t e = begin; e < end; ++e) {
            if (instance[e] == ~0u) continue;
            n[e] = sampleCount(rate_, sMin[e], sMax[e], footprint[e], mu);
            const float w = sMin[e] > 0.0f ? bandLimit(rate_, sMin[e], footprint[e], filterMu) : 0.0f;
            omega[e] = std::isfinite(w) ? w : 0.0f;
          }
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "shadow_sample_count: stopped");
    return TermPtr(term);
  }

 private:
  ShadowRateSettings rate_;
  Extent extent_;
};

}  // namespace

NodePtr makeShadowSlopeDilation(int radiusPx, const Extent& extent) { return std::make_shared<ShadowSlopeDilation>(radiusPx, extent); }
NodePtr makeShadowMu(float mu, float meanSamples, const ShadowRateSettings& rate) { return std::make_shared<ShadowMu>(mu, meanSamples, rate); }
NodePtr makeShadowSampleCount(const ShadowRateSettings& rate, const Extent& extent) { return std::make_shared<ShadowSampleCount>(rate, extent); }

}  // namespace filters
}  // namespace gobo
