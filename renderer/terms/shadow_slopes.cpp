// SPDX-License-Identifier: Apache-2.0
#include "terms/shadow_slopes.h"

#include <algorithm>
#include <cmath>

#include "base/sobol.h"
#include "formulas/axis_aligned.glsl.h"
#include "terms/light_points.h"
#include "terms/shadow_light.h"
#include "terms/surface_reader.h"
#include "terms/surface_samples.h"
#include "terms/visibility.h"
#include "trace/straight.h"

namespace gobo {
namespace {

Facet facets(bool clear) {
  const Facet plain = kAccelFacets | Facet::LightShape;
  return clear ? plain | kSurfaceFacets : plain;  // tints
}

class ShadowSlopesNode final : public Node {
 public:
  explicit ShadowSlopesNode(const ShadowSlopesSettings& s) : s_(s) {}
  std::string type() const override { return "shadow_slopes"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.facets = facets(s_.clear);
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    h.add(s_.pilot).add(s_.seed);
    if (s_.clear) h.add("clear");
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 1);
    SurfaceSamples::reads(w.over(0, s_.extent), 0);
    return w.gives({type(),
                    Domain::ViewSample,
                    s_.extent,
                    {plane<float>("sMax"), plane<float>("sMin"), plane<float>("sumV", s_.clear ? 3 : 1), plane<float>("sumW"), plane<uint8_t>("occluded")}});
  }
  Cost cost(const TermShape&, uint32_t) const override {
    // Blocked ones look back.
    const double rays = 1.3 * kReceiving * double(s_.extent.elements()) * s_.pilot;
    return {rays, 60.0 * rays};
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const int index = ctx.scene->lightSubset().at(0);
    GOBO_CHECK(hasShadowLightFrame(ctx.scene->lightShape(index).kind));
    GOBO_ASSIGN(const AccelPtr accel, ctx.accel());
    const LightPoints light(*ctx.scene, index);
    const SurfaceSamples surface(*ctx.inputs.at(0));
    const FilmElements film(s_.extent, s_.place);
    const auto& term = ctx.result;
    const auto sMax = term->writable<float>("sMax"), sMin = term->writable<float>("sMin");
    const size_t C = s_.clear ? 3 : 1;
    const auto sumV = term->writable<float>("sumV"), sumW = term->writable<float>("sumW");
    SurfaceTable surfaces;
    if (s_.clear) surfaces.build(*ctx.scene, *accel);
    const auto occluded = term->writable<uint8_t>("occluded");
    const bool complete = ctx.arena->parallelFor(
        surface.size(), 128,
        [&](size_t from, size_t to) {
          uint64_t rays = 0;
          for (size_t e = from; e < to; ++e) {
            if (!surface.hit(e)) continue;
            const Vec3 p = surface.position(e), N = surface.normal(e), Ng = surface.geometricNormal(e);
            const uint64_t seed = viewSampleSeed(s_.seed, film(e));
            DVec3 v(0.0);
            double w = 0;
            float largest = 0, smallest = AA_SLOPE_MAX;
            for (uint32_t i = 0; i < s_.pilot; ++i) {
              LightPoint point;
              if (!light.sample(p, N, Ng, SobolSampler(seed, i).next2D(), point)) continue;
              w += point.weight;
              if (point.belowSurface) continue;
              const Ray ray = shadowRay(*accel, p, Ng, point);
              Hit first, last;
              ++rays;
              if (!accel->intersect(ray, first)) {
                v += DVec3(point.weight);
                continue;
              }
              if (s_.clear) v += DVec3(transmittance(*accel, surfaces, ray, nullptr, rays)) * double(point.weight);
              // Back from the light: the occluder nearest to it. Where rounding lets that ray through, the first one serves.
              Ray back;
              back.origin = ray.origin + ray.direction * ray.tmax;
              back.direction = -ray.direction;
              back.tmax = ray.tmax;
              ++rays;
              const float tLast = accel->intersect(back, last) ? std::max(ray.tmax - last.t, first.t) : first.t;
              const float moved = point.distance - ray.tmax / kShadowRayEnd;  // the ray starts this much off the receiver
              smallest = std::min(smallest, formulas::aaSlope(first.t + moved, point.distance));
              largest = std::max(largest, formulas::aaSlope(tLast + moved, point.distance));
              occluded[e] = 1;
            }
            for (size_t c = 0; c < C; ++c) sumV[C * e + c] = float(v[int(c)]);
            sumW[e] = float(w);
            if (occluded[e]) {
              sMax[e] = largest;
              sMin[e] = smallest;
            }
          }
          if (ctx.counters) ctx.counters->rays.fetch_add(rays, std::memory_order_relaxed);
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "shadow_slopes: stopped");
    return TermPtr(term);
  }

 private:
  ShadowSlopesSettings s_;
};

class ShadowAdaptiveNode final : public Node {
 public:
  explicit ShadowAdaptiveNode(const ShadowAdaptiveSettings& s) : s_(s) {}
  std::string type() const override { return "shadow_adaptive"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.facets = facets(s_.clear);
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    h.add(s_.pilot).add(s_.seed);
    if (s_.clear) h.add("clear");
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 3);
    const int C = s_.clear ? 3 : 1;
    SurfaceSamples::reads(w.over(0, s_.extent), 0);
    w.over(1, s_.extent).reads<float>(1, "sumV", {C}).reads<float>(1, "sumW").over(2, s_.extent).reads<uint32_t>(2, "n");
    return w.gives({"visibility", Domain::ViewSample, s_.extent, {plane<float>("V", C)}});
  }
  Cost cost(const TermShape&, uint32_t) const override {
    // As many as the pilot had, on the mean: where the filter is wide, none.
    const double rays = kReceiving * double(s_.extent.elements()) * s_.pilot;
    return {rays, 60.0 * rays};
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const size_t C = s_.clear ? 3 : 1;
    GOBO_ASSIGN(const AccelPtr accel, ctx.accel());
    const LightPoints light(*ctx.scene, ctx.scene->lightSubset().at(0));
    const SurfaceSamples surface(*ctx.inputs[0]);
    const FilmElements film(s_.extent, s_.place);
    const auto sumV = ctx.inputs[1]->floats("sumV"), sumW = ctx.inputs[1]->floats("sumW");
    const auto n = ctx.inputs[2]->plane<uint32_t>("n");
    const auto& term = ctx.result;
    const auto V = term->writable<float>("V");
    SurfaceTable surfaces;
    if (s_.clear) surfaces.build(*ctx.scene, *accel);
    const bool complete = ctx.arena->parallelFor(
        surface.size(), 32,
        [&](size_t from, size_t to) {
          uint64_t rays = 0;
          for (size_t e = from; e < to; ++e) {
            for (size_t c = 0; c < C; ++c) V[C * e + c] = 1.0f;
            if (!surface.hit(e)) continue;
            const Vec3 p = surface.position(e), N = surface.normal(e), Ng = surface.geometricNormal(e);
            const uint64_t seed = viewSampleSeed(s_.seed, film(e));
            DVec3 v(0.0);
            for (size_t c = 0; c < C; ++c) v[int(c)] = sumV[C * e + c];
            double w = sumW[e];
            for (uint32_t i = s_.pilot; i < n[e]; ++i) {
              LightPoint point;
              if (!light.sample(p, N, Ng, SobolSampler(seed, i).next2D(), point)) continue;
              w += point.weight;
              if (point.belowSurface) continue;
              const Ray ray = shadowRay(*accel, p, Ng, point);
              if (s_.clear) {
                v += DVec3(transmittance(*accel, surfaces, ray, nullptr, rays)) * double(point.weight);
                continue;
              }
              ++rays;
              if (!accel->occluded(ray)) v += DVec3(point.weight);
            }
            if (w > 0)
              for (size_t c = 0; c < C; ++c) V[C * e + c] = clamp01(float(v[int(c)] / w));
          }
          if (ctx.counters) ctx.counters->rays.fetch_add(rays, std::memory_order_relaxed);
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "shadow_adaptive: stopped");
    return TermPtr(term);
  }

 private:
  ShadowAdaptiveSettings s_;
};

}  // namespace

NodePtr makeShadowSlopesNode(const ShadowSlopesSettings& settings) { return std::make_shared<ShadowSlopesNode>(settings); }
NodePtr makeShadowAdaptiveNode(const ShadowAdaptiveSettings& settings) { return std::make_shared<ShadowAdaptiveNode>(settings); }

}  // namespace gobo
