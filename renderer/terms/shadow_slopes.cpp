// SPDX-License-Identifier: Apache-2.0
#include "terms/shadow_slopes.h"

#include <algorithm>
#include <cmath>

#include "formulas/axis_aligned.glsl.h"
#include "terms/light_points.h"
#include "terms/screen_sequence.h"
#include "terms/shadow_light.h"
#include "terms/surface_reader.h"
#include "terms/surface_samples.h"
#include "trace/straight.h"

namespace gobo {
inline namespace terms {
namespace {

Facet facets(bool clear) {
  const Facet plain = kAccelFacets | Facet::LightShape;
  return clear ? plain | kSurfaceFacets : plain;  // tints
}

class ShadowSlopesNode final : public Node {
 public:
  explicit ShadowSlopesNode(const ShadowSlopesSettings& s) : s_(s) {}
  std::string type() const override { return "shadow_slopes"; }
  int version() const override { return 3; }  // 2: points of a screen sequence, rays in packets; 3: as visibility
  NodeTraits traits() const override {
    NodeTraits t;
    t.facets = facets(s_.clear);
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    h.add(s_.pilot).add(s_.most).add(s_.bothEnds).add(s_.seed);
    if (s_.clear) h.add("clear");
    hashShadowLightProfile(h, s_.profile);
    if (s_.keepBlocked) h.add("blocked");
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 1);
    SurfaceSamples::reads(w.over(0, s_.extent), 0);
    TermShape shape{type(),
                    Domain::ViewSample,
                    s_.extent,
                    {plane<float>("sMax"), plane<float>("sMin"), plane<float>("sumV", s_.clear ? 3 : 1), plane<float>("sumW"), plane<uint8_t>("occluded")}};
    if (s_.keepBlocked) shape.planes.push_back(plane<uint32_t>("blocked"));
    return w.gives(std::move(shape));
  }
  Cost cost(const TermShape&, uint32_t) const override {
    // Blocked ones look back.
    const double rays = (s_.bothEnds ? 1.3 : 1.0) * kReceiving * double(s_.extent.elements()) * s_.pilot;
    return {rays, 60.0 * rays};
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const int index = ctx.scene->lightSubset().at(0);
    GOBO_CHECK(hasShadowLightFrame(ctx.scene->lightShape(index)));
    const ShadowLightFrame frame = shadowLightFrame(ctx.scene->lightShape(index));
    GOBO_ASSIGN(const AccelPtr accel, ctx.accel());
    const ProfiledPoints light(*ctx.scene, index, s_.profile);
    const SurfaceSamples surface(*ctx.inputs.at(0));
    const ScreenSequence points(s_.seed, s_.extent, s_.place, s_.most);
    const auto& term = ctx.result;
    Planes out{term->writable<float>("sMax"), term->writable<float>("sMin"),       term->writable<float>("sumV"),
               term->writable<float>("sumW"), term->writable<uint8_t>("occluded"), {}};
    if (s_.keepBlocked) out.blocked = term->writable<uint32_t>("blocked");
    SurfaceTable surfaces;
    if (s_.clear) surfaces.build(*ctx.scene, *accel);
    const bool complete = ctx.arena->parallelFor(
        surface.size(), 256,
        [&](size_t from, size_t to) {
          std::vector<DVec3> seen(to - from, DVec3(0.0));
          Pilot pilot(*accel, surfaces, s_, frame, out, from, seen);
          for (size_t e = from; e < to; ++e) {
            if (!surface.hit(e)) continue;
            const Vec3 p = surface.position(e), N = surface.normal(e), Ng = surface.geometricNormal(e), reach = surface.reach(e, *accel);
            double w = 0;
            for (uint32_t i = 0; i < s_.pilot; ++i) {
              LightPoint point;
              if (!light.sample(p, N, Ng, points(e, i).next2D(), point)) continue;
              if (point.belowSurface) {
                if (s_.keepBlocked && i < 32) out.blocked[e] |= 1u << i;
                continue;
              }
              w += point.weight;
              pilot.add(e, i, p, shadowRay(reach, p, Ng, point), point);
            }
            out.sumW[e] = float(w);
          }
          pilot.flush();
          const size_t C = s_.clear ? 3 : 1;
          for (size_t e = from; e < to; ++e)
            for (size_t c = 0; c < C; ++c) out.sumV[C * e + c] = float(seen[e - from][int(c)]);
          if (ctx.counters) ctx.counters->rays.fetch_add(pilot.rays, std::memory_order_relaxed);
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "shadow_slopes: stopped");
    return TermPtr(term);
  }

 private:
  struct Planes {
    std::span<float> sMax, sMin, sumV, sumW;
    std::span<uint8_t> occluded;
    std::span<uint32_t> blocked;
  };
  /// Rays of neighbours go together, 16 at a time; what they find is taken in the order they came in.
  struct Pilot {
    Pilot(const Accel& a, const SurfaceTable& t, const ShadowSlopesSettings& s, const ShadowLightFrame& l, Planes& o, size_t f, std::vector<DVec3>& v)
        : accel(a), surfaces(t), settings(s), light(l), out(o), from(f), seen(v) {}

    void add(size_t e, uint32_t i, const Vec3& p, const Ray& r, const LightPoint& point) {
      ray[count] = r;
      bit[count] = i < 32 ? 1u << i : 0u;
      lift[count] = light.distant ? -glm::dot(r.origin - p, light.axis) : 0.0f;
      element[count] = e;
      weight[count] = point.weight;
      distance[count++] = point.distance;
      if (count == 16) flush();
    }
    void flush() {
      if (count == 0) return;
      Hit first[16], last[16];
      accel.intersect16(ray, count, first);
      rays += uint64_t(count);
      float tLast[16];
      for (int i = 0; i < count; ++i) tLast[i] = first[i].t;
      // Past everything as any receiver sees it: no two places are more than 2 sqrt(3) units apart.
      const float beyond = 4.0f * accel.unit();
      if (settings.bothEnds) {  // back from the light: the occluder nearest to it. Where rounding lets that ray through, the first one serves.
        Ray back[16];
        int of[16], blocked = 0;
        for (int i = 0; i < count; ++i) {
          if (!first[i].valid()) continue;
          const float length = light.distant ? beyond : ray[i].tmax;
          back[blocked].origin = ray[i].origin + ray[i].direction * length;
          back[blocked].direction = -ray[i].direction;
          back[blocked].tmax = length;
          of[blocked++] = i;
        }
        if (blocked) accel.intersect16(back, blocked, last);
        rays += uint64_t(blocked);
        for (int k = 0; k < blocked; ++k)
          if (last[k].valid()) tLast[of[k]] = std::max(back[k].tmax - last[k].t, first[of[k]].t);
      }
      for (int i = 0; i < count; ++i) {
        const size_t e = element[i];
        if (!first[i].valid()) {
          seen[e - from] += DVec3(weight[i]);
          continue;
        }
        if (settings.clear) seen[e - from] += DVec3(transmittance(accel, surfaces, ray[i], nullptr, rays)) * double(weight[i]);
        const auto slope = [&](float t) {
          if (light.distant) return formulas::aaDistance(lift[i] - t * glm::dot(ray[i].direction, light.axis));
          const float moved = distance[i] - ray[i].tmax / kShadowRayEnd;  // the ray starts this much off the receiver
          return formulas::aaSlope(t + moved, distance[i]);
        };
        const float near = slope(first[i].t), far = slope(tLast[i]);
        out.sMin[e] = out.occluded[e] ? std::min(out.sMin[e], near) : near;
        out.sMax[e] = std::max(out.sMax[e], far);
        out.occluded[e] = 1;
        if (settings.keepBlocked) out.blocked[e] |= bit[i];
      }
      count = 0;
    }

    const Accel& accel;
    const SurfaceTable& surfaces;
    const ShadowSlopesSettings& settings;
    const ShadowLightFrame& light;
    Planes& out;
    size_t from;
    std::vector<DVec3>& seen;
    Ray ray[16];
    size_t element[16];
    uint32_t bit[16];
    float weight[16], distance[16], lift[16];
    int count = 0;
    uint64_t rays = 0;
  };
  ShadowSlopesSettings s_;
};

class ShadowAdaptiveNode final : public Node {
 public:
  explicit ShadowAdaptiveNode(const ShadowAdaptiveSettings& s) : s_(s) {}
  std::string type() const override { return "shadow_adaptive"; }
  int version() const override { return 3; }  // as shadow_slopes
  NodeTraits traits() const override {
    NodeTraits t;
    t.facets = facets(s_.clear);
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    h.add(s_.pilot).add(s_.most).add(s_.seed);
    if (s_.clear) h.add("clear");
    hashShadowLightProfile(h, s_.profile);
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
    const ProfiledPoints light(*ctx.scene, ctx.scene->lightSubset().at(0), s_.profile);
    const SurfaceSamples surface(*ctx.inputs[0]);
    const ScreenSequence points(s_.seed, s_.extent, s_.place, s_.most);
    const auto sumV = ctx.inputs[1]->floats("sumV"), sumW = ctx.inputs[1]->floats("sumW");
    const auto n = ctx.inputs[2]->plane<uint32_t>("n");
    const auto& term = ctx.result;
    const auto V = term->writable<float>("V");
    SurfaceTable surfaces;
    if (s_.clear) surfaces.build(*ctx.scene, *accel);
    const bool complete = ctx.arena->parallelFor(
        surface.size(), 128,
        [&](size_t from, size_t to) {
          uint64_t rays = 0;
          std::vector<DVec3> seen(to - from, DVec3(0.0));
          std::vector<double> sum(to - from, 0.0);
          std::vector<float> nothing(to - from, 1.0f);
          Ray ray[16];
          size_t element[16] = {};
          float weight[16] = {};
          int count = 0;
          auto flush = [&] {
            Vec3 left[16];
            if (s_.clear && count) {
              transmittance16(*accel, surfaces, ray, nullptr, count, left, rays);
            } else if (count) {
              const uint32_t blocked = accel->occluded16(ray, count);
              rays += uint64_t(count);
              for (int i = 0; i < count; ++i) left[i] = Vec3(blocked >> i & 1 ? 0.0f : 1.0f);
            }
            for (int i = 0; i < count; ++i) seen[element[i]] += DVec3(left[i]) * double(weight[i]);
            count = 0;
          };
          for (size_t e = from; e < to; ++e) {
            if (!surface.hit(e)) continue;
            const Vec3 p = surface.position(e), N = surface.normal(e), Ng = surface.geometricNormal(e), reach = surface.reach(e, *accel);
            for (size_t c = 0; c < C; ++c) seen[e - from][int(c)] = sumV[C * e + c];
            double w = sumW[e];
            bool below = false;
            for (uint32_t i = s_.pilot; i < n[e]; ++i) {
              LightPoint point;
              if (!light.sample(p, N, Ng, points(e, i).next2D(), point)) continue;
              if (point.belowSurface) {
                below = true;
                continue;
              }
              w += point.weight;
              ray[count] = shadowRay(reach, p, Ng, point);
              element[count] = e - from;
              weight[count++] = point.weight;
              if (count == 16) flush();
            }
            for (uint32_t i = 0; !(w > 0) && !below && i < s_.pilot; ++i) {  // which of the pilot's kinds of nothing it was
              LightPoint point;
              below = light.sample(p, N, Ng, points(e, i).next2D(), point) && point.belowSurface;
            }
            sum[e - from] = w;
            nothing[e - from] = below ? 0.0f : 1.0f;
          }
          flush();
          for (size_t e = from; e < to; ++e)
            for (size_t c = 0; c < C; ++c) V[C * e + c] = sum[e - from] > 0 ? clamp01(float(seen[e - from][int(c)] / sum[e - from])) : nothing[e - from];
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

}  // namespace terms
}  // namespace gobo
