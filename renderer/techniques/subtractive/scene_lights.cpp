// SPDX-License-Identifier: Apache-2.0
#include "techniques/subtractive/scene_lights.h"

#include "base/sobol.h"
#include "techniques/subtractive/samples_node.h"
#include "terms/dropped_samples.h"
#include "terms/visibility.h"

namespace gobo::subtractive {

namespace {

/// As byAlbedo() (samples_node.h) has them, of a sum.
constexpr float kLeastDivisor = 1e-6f;
constexpr double kMostRest = 1e21;

/// What unshadowed light reads: geometry and emission of mesh lights alone.
constexpr Facet kLightFacets = Facet::LightShape | Facet::Topology | Facet::Pose | Facet::Shading | Facet::Coverage | Facet::Emission;

void hashSceneLights(Hasher& h, const SceneLightsSettings& s) {
  for (const SceneLight& l : s.lights) h.addPod(l.power);  // which they are: by the digests of the facets
  h.add(s.samples).add(s.seed);
}

/// The lights, ready to be asked. Null sampler: `stop` fired first.
struct AskedLights {
  std::shared_ptr<const LightSampler> sampler;
  std::unique_ptr<const LightList> list;
  AskedLights(const RunContext& ctx, const SceneLightsSettings& s) : sampler(LightSampler::build(*ctx.scene, ctx.stop)) {
    if (sampler) list = std::make_unique<const LightList>(*ctx.scene, *sampler, s.lights, s.samples, s.seed);
  }
};

/// Four sums side by side, of every fourth value each: in one order whatever the machine's registers.
double sumOf(std::span<const float> v) {
  double sum[4] = {0, 0, 0, 0};
  for (size_t i = 0; i + 4 <= v.size(); i += 4)
    for (size_t k = 0; k < 4; ++k) sum[k] += double(v[i + k]);
  return (sum[0] + sum[1]) + (sum[2] + sum[3]);
}

class UnshadowedLightsNode final : public Node {
 public:
  explicit UnshadowedLightsNode(SceneLightsSettings s) : s_(std::move(s)) {}
  std::string type() const override { return "unshadowed_lights"; }
  int version() const override { return 4; }  // 2: lights of some size by quadrature where that is as good; 3: nearly everywhere; 4: mesh lights too
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
    return {0.0, kReceiving * double(result.extent.elements()) * (200.0 + 8.0 * double(s_.lights.size()))};
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Receivers in(*ctx.inputs[0], *ctx.inputs[1], s_.view);
    const AskedLights lights(ctx, s_);
    if (!lights.sampler) return Status(Code::Cancelled, "unshadowed_lights: stopped");
    const std::span<float> out[2] = {ctx.result->writable<float>("diffuse"), ctx.result->writable<float>("specular")};
    DroppedSamples dropped(*ctx.result);
    const FilmElements film(s_.view.extent(), s_.view.place);
    const size_t grain = std::clamp<size_t>((1 << 14) / std::max<size_t>(s_.lights.size(), 1), 16, 1 << 11);
    const bool complete = ctx.arena->parallelFor(
        in.instance.size(), grain,
        [&](size_t begin, size_t end) {
          LightList::Values values;
          for (size_t e = begin; e < end; ++e) {
            if (!in.lit(e)) continue;
            lights.list->at(in.point(e, in.bsdf(e)), film(e), values);
            Vec3 light[2] = {Vec3(0.0f), Vec3(0.0f)};
            for (int c = 0; c < 3; ++c) {
              light[0][c] = float(sumOf(values.diffuse[c]));
              if (values.glossy) light[1][c] = float(sumOf(values.specular[c]));
            }
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
  // as unshadowed_lights; 5: gloss of glass; 6: rays begin nearer to the surface, from points that can shine; 7: what the specular lobe reflects without its
  // table's padding
  int version() const override { return 7; }
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
        : s_(s), most_(most), asked_(ctx, s.from), film_(s.from.view.extent(), s.from.view.place) {
      for (const SceneLight& l : s.from.lights) points_.emplace_back(*ctx.scene, l.light);
    }
    bool complete() const { return asked_.sampler != nullptr; }

    void at(const TracedSample& sample, Arrivals& out) const override {
      LightList::Values f;
      LightList::Choice choice;
      asked_.list->at(sample.point, film_(sample.element), f);
      asked_.list->choose(f, most_, choice);
      const uint64_t seed = viewSampleSeed(s_.from.seed, film_(sample.element));
      for (const auto& [light, place] : choice.chosen) {
        const Vec3 diffuse(f.diffuse[0][place], f.diffuse[1][place], f.diffuse[2][place]);
        const Vec3 specular = f.glossy ? Vec3(f.specular[0][place], f.specular[1][place], f.specular[2][place]) : Vec3(0.0f);
        const Vec3 lobes[2] = {byAlbedo(diffuse, sample.by.diffuse), byAlbedo(specular, sample.by.specular)};
        out.lights.push_back(towards(size_t(light), sample.point, lobes, seed));
      }
      for (int k = 0; k < 2; ++k)
        for (int c = 0; c < 3; ++c) {
          const float by = k == 0 ? sample.by.diffuse[c] : sample.by.specular[c];
          if (by > kLeastDivisor) out.rest[k][c] = std::min(choice.rest[k][c] / double(by), kMostRest);
        }
    }

   private:
    Arrivals::Light towards(size_t i, const LitPoint& p, const Vec3* lobe, uint64_t seed) const {
      Arrivals::Light out{{lobe[0], lobe[1]}, {}};
      const bool pointLike = points_[i].pointLike();
      // The one point stands for all of the light that arrives: one that cannot shine here, beyond a horizon or on the far side of a lamp, says nothing of it.
      bool below = false;
      const bool dark = points_[i].surelyDark(p.p, p.n);
      for (uint32_t k = 0; !dark && k < (pointLike ? 1 : kLeastLooked); ++k) {
        const Vec2 u = pointLike ? Vec2(0.5f) : SobolSampler(seed, uint32_t(i + k * points_.size())).next2D();
        if (!points_[i].sample(p.p, p.n, p.ng, u, out.point)) continue;
        if (!out.point.belowSurface) return out;
        below = true;
      }
      out.way = below ? Arrivals::Way::Closed : Arrivals::Way::Open;
      return out;
    }

    const LightSamplesSettings& s_;
    size_t most_;
    AskedLights asked_;
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
