// SPDX-License-Identifier: Apache-2.0
#include "techniques/subtractive/scene_lights.h"

#include "base/sobol.h"
#include "techniques/subtractive/samples_node.h"
#include "terms/dropped_samples.h"
#include "terms/visibility.h"

namespace gobo::subtractive {

namespace {

/// What unshadowed light reads: geometry and emission of mesh lights alone.
constexpr Facet kLightFacets = Facet::LightShape | Facet::Topology | Facet::Pose | Facet::Shading | Facet::Coverage | Facet::Emission;

void hashSceneLights(Hasher& h, const SceneLightsSettings& s) {
  for (const SceneLight& l : s.lights) h.addPod(l.power);  // which they are: by the digests of the facets
  h.add(s.samples).add(s.seed);
}

/// The lights, ready to be asked. Null sampler: `stop` fired first.
struct SceneLightList {
  std::shared_ptr<const LightSampler> sampler;
  std::vector<UnoccludedLight> lights;
  SceneLightList(const RunContext& ctx, const SceneLightsSettings& s) : sampler(LightSampler::build(*ctx.scene, ctx.stop)) {
    if (!sampler) return;
    for (const SceneLight& l : s.lights) lights.emplace_back(*sampler, ctx.scene->lightShape(l.light), l.light, s.samples, s.seed);
  }
};

class UnshadowedLightsNode final : public Node {
 public:
  explicit UnshadowedLightsNode(SceneLightsSettings s) : s_(std::move(s)) {}
  std::string type() const override { return "unshadowed_lights"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.facets = kLightFacets;
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    hashView(h, s_.view);
    s_.view.place.hash(h);
    hashSceneLights(h, s_);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 2);
    Receivers::reads(w, s_.view);
    return w.gives({type(), Domain::ViewSample, s_.view.extent(), {plane<float>("diffuse", 3), plane<float>("specular", 3), mayDrop()}});
  }
  Cost cost(const TermShape& result, uint32_t) const override {
    return {0.0, kReceiving * double(result.extent.elements()) * (60.0 + 60.0 * double(s_.lights.size()))};
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Receivers in(*ctx.inputs[0], *ctx.inputs[1], s_.view);
    const SceneLightList list(ctx, s_);
    if (!list.sampler) return Status(Code::Cancelled, "unshadowed_lights: stopped");
    const std::span<float> out[2] = {ctx.result->writable<float>("diffuse"), ctx.result->writable<float>("specular")};
    DroppedSamples dropped(*ctx.result);
    const FilmElements film(s_.view.extent(), s_.view.place);
    const size_t grain = std::clamp<size_t>((1 << 14) / std::max<size_t>(s_.lights.size(), 1), 16, 1 << 11);
    const bool complete = ctx.arena->parallelFor(
        in.instance.size(), grain,
        [&](size_t begin, size_t end) {
          for (size_t e = begin; e < end; ++e) {
            if (!in.lit(e)) continue;
            const LitPoint point = in.point(e, in.bsdf(e));
            DVec3 sum[2] = {DVec3(0.0), DVec3(0.0)};
            for (size_t i = 0; i < list.lights.size(); ++i) {
              const BsdfValue f = list.lights[i].lobes(point, film(e));
              sum[0] += DVec3(f.diffuse * s_.lights[i].power);
              sum[1] += DVec3(f.specular * s_.lights[i].power);
            }
            const Vec3 light[2] = {Vec3(sum[0]), Vec3(sum[1])};
            if (!isFinite(light[0]) || !isFinite(light[1])) {
              dropped.add(e, 1);
              continue;
            }
            for (size_t k = 0; k < 2; ++k)
              for (int c = 0; c < 3; ++c) out[k][3 * e + size_t(c)] = light[k][c];
          }
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "unshadowed_lights: stopped");
    return TermPtr(ctx.result);
  }

 private:
  SceneLightsSettings s_;
};

class SceneLightSamplesNode final : public SamplesNode {
 public:
  explicit SceneLightSamplesNode(LightSamplesSettings s) : SamplesNode(s.from.view, s.resampling), s_(std::move(s)) {}
  std::string type() const override { return "subtractive_light_samples"; }
  NodeTraits traits() const override {
    NodeTraits t = SamplesNode::traits();
    t.facets = t.facets | kLightFacets;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    SamplesNode::hashParameters(h);
    hashSceneLights(h, s_.from);
    h.add(rays());  // as many as there are, or more: the same
  }

 private:
  class Near final : public Lights {
   public:
    Near(const RunContext& ctx, const LightSamplesSettings& s, size_t most)
        : s_(s), most_(most), list_(ctx, s.from), film_(s.from.view.extent(), s.from.view.place) {
      for (const SceneLight& l : s.from.lights) points_.emplace_back(*ctx.scene, l.light);
    }
    bool complete() const { return list_.sampler != nullptr; }

    void at(const TracedSample& sample, Arrivals& out) const override {
      const std::vector<SceneLight>& lights = s_.from.lights;
      std::vector<Candidate> all;
      for (size_t i = 0; i < lights.size(); ++i) {
        BsdfValue f = list_.lights[i].lobes(sample.point, film_(sample.element));
        f.diffuse *= lights[i].power;
        f.specular *= lights[i].power;
        const float given = luminance(f.sum());  // NaN: left out; without end: first of all, and no more than byAlbedo() lets through
        if (given > 0.0f) all.push_back({given, i, f});
      }
      const auto before = [](const Candidate& a, const Candidate& b) { return a.given != b.given ? a.given > b.given : a.light < b.light; };
      if (all.size() > most_) {
        std::nth_element(all.begin(), all.begin() + std::ptrdiff_t(most_), all.end(), before);
        const auto byIndex = [](const Candidate& a, const Candidate& b) { return a.light < b.light; };  // sums in one order, whatever the library's way
        std::sort(all.begin(), all.begin() + std::ptrdiff_t(most_), byIndex);
        std::sort(all.begin() + std::ptrdiff_t(most_), all.end(), byIndex);
      }
      const uint64_t seed = viewSampleSeed(s_.from.seed, film_(sample.element));
      for (size_t k = 0; k < all.size(); ++k) {
        const Vec3 lobe[2] = {byAlbedo(all[k].f.diffuse, sample.by.diffuse), byAlbedo(all[k].f.specular, sample.by.specular)};
        if (k < most_) out.lights.push_back(towards(all[k].light, sample.point, lobe, seed));
        else out.rest[0] += DVec3(lobe[0]), out.rest[1] += DVec3(lobe[1]);
      }
    }

   private:
    struct Candidate {
      float given;
      size_t light;
      BsdfValue f;
    };
    Arrivals::Light towards(size_t i, const LitPoint& p, const Vec3* lobe, uint64_t seed) const {
      Arrivals::Light out{{lobe[0], lobe[1]}, {}};
      const Vec2 u = points_[i].pointLike() ? Vec2(0.5f) : SobolSampler(seed, uint32_t(i)).next2D();
      if (!points_[i].sample(p.p, p.n, p.ng, u, out.point)) out.way = Arrivals::Way::Open;
      else if (out.point.belowSurface) out.way = Arrivals::Way::Closed;
      return out;
    }

    const LightSamplesSettings& s_;
    size_t most_;
    SceneLightList list_;
    FilmElements film_;
    std::vector<LightPoints> points_;
  };

  std::unique_ptr<const Lights> lights(const RunContext& ctx) const override {
    auto out = std::make_unique<Near>(ctx, s_, rays());
    return out->complete() ? std::move(out) : nullptr;
  }
  size_t looked() const override { return s_.from.lights.size(); }
  size_t rays() const override { return std::min(s_.from.lights.size(), size_t(s_.most)); }

  LightSamplesSettings s_;
};

}  // namespace

NodePtr makeUnshadowedLightsNode(const SceneLightsSettings& settings) { return std::make_shared<UnshadowedLightsNode>(settings); }
NodePtr makeLightSamplesNode(const LightSamplesSettings& settings) { return std::make_shared<SceneLightSamplesNode>(settings); }

}  // namespace gobo::subtractive
