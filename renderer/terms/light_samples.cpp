// SPDX-License-Identifier: Apache-2.0
#include "terms/light_samples.h"

#include <algorithm>
#include <cmath>

#include "terms/light_points.h"
#include "terms/screen_sequence.h"
#include "terms/surface_samples.h"

namespace gobo {
inline namespace terms {
namespace {

class LightSamplesNode final : public Node {
 public:
  explicit LightSamplesNode(const LightSamplesSettings& s) : s_(s) {
    GOBO_CHECK(s.kept % 4 == 0 && s.kept >= s.pilot && s.pilot <= 32);
    GOBO_CHECK(s.bands.rims.empty() || s.bands.rims.back() == 0.0f);
  }
  std::string type() const override { return "light_samples"; }
  int version() const override { return 2; }  // 2: rays begin nearer to the surface
  NodeTraits traits() const override {
    NodeTraits t;
    t.facets = kAccelFacets | Facet::LightShape;
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    h.add(s_.pilot).add(s_.most).add(s_.kept).add(s_.samples).add(s_.seed);
    for (float r : s_.bands.rims) h.add(r);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 3);
    SurfaceSamples::reads(w.over(0, s_.extent), 0);
    w.over(1, s_.extent).reads<uint32_t>(1, "blocked").over(2, s_.extent).reads<uint32_t>(2, "n");
    TermShape shape{type(), Domain::ViewSample, s_.extent, {plane<float>("V")}};
    if (s_.samples) shape.planes.push_back(plane<float>("point", int(4 * s_.kept)));
    if (s_.bands.count() > 0) shape.planes.push_back(plane<float>("band", s_.bands.count()));
    return w.gives(std::move(shape));
  }
  Cost cost(const TermShape&, uint32_t) const override {
    const double rays = kReceiving * double(s_.extent.elements()) * s_.pilot;
    return {rays, 60.0 * rays};
  }
  Result<TermPtr> run(const RunContext& ctx) const override;

 private:
  LightSamplesSettings s_;
};

Result<TermPtr> LightSamplesNode::run(const RunContext& ctx) const {
  const int index = ctx.scene->lightSubset().at(0);
  GOBO_CHECK(hasLightRectangle(ctx.scene->lightShape(index).kind));
  const LightRectangle rectangle = lightRectangle(ctx.scene->lightShape(index));
  GOBO_ASSIGN(const AccelPtr accel, ctx.accel());
  const LightPoints light(*ctx.scene, index);
  const SurfaceSamples surface(*ctx.inputs[0]);
  const ScreenSequence points(s_.seed, s_.extent, s_.place, s_.most);
  const auto blocked = ctx.inputs[1]->plane<uint32_t>("blocked");
  const auto n = ctx.inputs[2]->plane<uint32_t>("n");
  const auto& term = ctx.result;
  const auto V = term->writable<float>("V");
  const size_t K = s_.kept, J = size_t(s_.bands.count());
  const auto point = s_.samples ? term->writable<float>("point") : std::span<float>();
  const auto band = J > 0 ? term->writable<float>("band") : std::span<float>();
  std::vector<float> mean;
  for (size_t j = 0; j < J; ++j) mean.push_back(s_.bands.mean(int(j)));
  struct Sample {
    float u, v, weight;
    bool seen, below;
  };
  const bool complete = ctx.arena->parallelFor(
      surface.size(), 128,
      [&](size_t from, size_t to) {
        uint64_t rays = 0;
        std::vector<Sample> samples((to - from) * K, Sample{0, 0, 0, false, false});
        Ray ray[16];
        Sample* of[16] = {};
        int count = 0;
        auto flush = [&] {
          if (count == 0) return;
          const uint32_t hit = accel->occluded16(ray, count);
          rays += uint64_t(count);
          for (int i = 0; i < count; ++i) of[i]->seen = !(hit >> i & 1);
          count = 0;
        };
        for (size_t e = from; e < to; ++e) {
          if (!surface.hit(e)) continue;
          const Vec3 p = surface.position(e), N = surface.normal(e), Ng = surface.geometricNormal(e), reach = surface.reach(e, *accel);
          for (uint32_t i = 0; i < std::min(n[e], s_.kept); ++i) {
            LightPoint q;
            if (!light.sample(p, N, Ng, points(e, i).next2D(), q)) continue;
            Sample& s = samples[(e - from) * K + i];
            const Vec3 at = p + q.direction * q.distance - rectangle.centre;
            s.u = std::clamp(glm::dot(at, rectangle.u) / rectangle.halfU, -1.0f, 1.0f);
            s.v = std::clamp(glm::dot(at, rectangle.v) / rectangle.halfV, -1.0f, 1.0f);
            s.weight = q.belowSurface ? 0.0f : q.weight;
            s.below = q.belowSurface;
            if (i < s_.pilot) {
              s.seen = !(blocked[e] >> i & 1);
            } else if (!q.belowSurface) {
              ray[count] = shadowRay(reach, p, Ng, q);
              of[count++] = &s;
              if (count == 16) flush();
            }
          }
        }
        flush();
        std::vector<double> seen(J), all(J);
        for (size_t e = from; e < to; ++e) {
          const Sample* s = &samples[(e - from) * K];
          double sum = 0, weight = 0;
          bool below = false;
          std::fill(seen.begin(), seen.end(), 0.0);
          std::fill(all.begin(), all.end(), 0.0);
          for (size_t i = 0; i < K; ++i) {
            const double w = s[i].weight;
            weight += w;
            below |= s[i].below;
            sum += s[i].seen ? w : 0.0;
            for (size_t j = 0; w > 0 && j < J; ++j) {
              const double l = w * double(s_.bands.profile(int(j), s[i].u, s[i].v));
              all[j] += l;
              seen[j] += s[i].seen ? l : 0.0;
            }
            if (!s_.samples) continue;
            point[4 * K * e + i] = s[i].u;
            point[4 * K * e + K + i] = s[i].v;
            point[4 * K * e + 2 * K + i] = s[i].weight;
            point[4 * K * e + 3 * K + i] = s[i].seen ? s[i].weight : 0.0f;
          }
          const double value = weight > 0 ? std::clamp(sum / weight, 0.0, 1.0) : below ? 0.0 : 1.0;
          V[e] = float(value);
          for (size_t j = 0; j < J; ++j) band[J * e + j] = float(weight > 0 ? seen[j] / weight + (double(mean[j]) - all[j] / weight) * value : double(mean[j]));
        }
        if (ctx.counters) ctx.counters->rays.fetch_add(rays, std::memory_order_relaxed);
      },
      ctx.stop);
  if (!complete) return Status(Code::Cancelled, "light_samples: stopped");
  return TermPtr(term);
}

float rise(float z) {
  const float x = std::clamp(z, 0.0f, 1.0f);
  return x * x * (3.0f - 2.0f * x);
}

}  // namespace

LightRectangle lightRectangle(const LightShape& shape) {
  GOBO_CHECK(hasLightRectangle(shape.kind));
  LightRectangle r;
  r.centre = shape.position;
  r.axis = glm::normalize(shape.axis);
  r.halfU = glm::length(shape.u);
  r.halfV = glm::length(shape.v);
  r.u = shape.u / r.halfU;
  r.v = shape.v / r.halfV;
  return r;
}
void hashLightRectangle(Hasher& h, const LightRectangle& r) { h.addPod(r.centre).addPod(r.axis).addPod(r.u).addPod(r.v).add(r.halfU).add(r.halfV); }

float LightBands::taper(int j, float u, float v) const {
  const float rim = rims[size_t(j)];
  if (!(rim > 0.0f)) return 1.0f;
  return rise((1.0f - std::fabs(u)) / rim) * rise((1.0f - std::fabs(v)) / rim);
}
float LightBands::mean(int j) const {
  // Along an axis a taper loses half of its rim at either end.
  auto of = [&](int k) { return k < 0 ? 0.0f : (1.0f - 0.5f * rims[size_t(k)]) * (1.0f - 0.5f * rims[size_t(k)]); };
  return of(j) - of(j - 1);
}

NodePtr makeLightSamplesNode(const LightSamplesSettings& settings) { return std::make_shared<LightSamplesNode>(settings); }

}  // namespace terms
}  // namespace gobo
