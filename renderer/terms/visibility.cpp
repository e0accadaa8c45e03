// SPDX-License-Identifier: Apache-2.0
#include "terms/visibility.h"

#include <algorithm>

#include "base/sobol.h"
#include "terms/light_points.h"
#include "terms/surface_reader.h"
#include "terms/surface_samples.h"
#include "trace/straight.h"

namespace gobo {
inline namespace terms {

uint64_t viewSampleSeed(uint64_t seed, size_t element) { return hash64(hash64(0x5ead0e5ull, seed), element); }

namespace {

class VisibilityNode final : public Node {
 public:
  explicit VisibilityNode(const VisibilitySettings& s) : s_(s) { GOBO_CHECK_GT(s.samples, 0u); }
  std::string type() const override { return "visibility"; }
  int version() const override { return 3; }  // 2: in packets; 3: rays begin nearer to the surface, further points, of what is above both normals
  NodeTraits traits() const override {
    NodeTraits t;
    t.facets = kAccelFacets | Facet::LightShape;
    t.tileable = true;
    if (s_.glass != Glass::Solid) t.facets = t.facets | kSurfaceFacets;  // tints
    return t;
  }
  void hashParameters(Hasher& h) const override {
    h.add(s_.samples).add(s_.seed);
    if (s_.glass != Glass::Solid) h.add("glass").add(s_.glass);
    if (s_.hard) h.add("hard");
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 1);
    SurfaceSamples::reads(w.over(0, s_.extent), 0);
    return w.gives({type(), Domain::ViewSample, s_.extent, {unsetPlane<float>("V", channels())}});
  }
  Cost cost(const TermShape&, uint32_t) const override {
    const double rays = kReceiving * double(s_.extent.elements()) * s_.samples;
    return {rays, 40.0 * rays};
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    GOBO_ASSIGN(const AccelPtr accel, ctx.accel());
    const LightPoints light(*ctx.scene, ctx.scene->lightSubset().at(0));
    const SurfaceSamples surface(*ctx.inputs[0]);
    const FilmElements film(s_.extent, s_.place);
    const auto& term = ctx.result;
    const size_t C = size_t(channels());
    const auto V = term->writable<float>("V");
    SurfaceTable surfaces;
    if (s_.glass != Glass::Solid) surfaces.build(*ctx.scene, *accel);
    const uint32_t samples = light.pointLike() || s_.hard ? 1 : s_.samples;
    const size_t grain = std::clamp<size_t>(8192 / samples, 1, 1024);  // a few milliseconds between looks at `stop`
    const bool complete = ctx.arena->parallelFor(
        surface.size(), grain,
        [&](size_t from, size_t to) {
          std::vector<double> seen((to - from) * C, 0.0), sum(to - from, 0.0);
          std::vector<char> below(to - from, 0);
          Packet packet(*accel, surfaces, s_.glass, seen);
          for (size_t e = from; e < to; ++e) {
            if (!surface.hit(e)) continue;
            const Vec3 p = surface.position(e), N = surface.normal(e), Ng = surface.geometricNormal(e), reach = surface.reach(e, *accel);
            if (light.surelyDark(p, N)) continue;
            const uint64_t seed = viewSampleSeed(s_.seed, film(e));
            // Points that cannot shine here say nothing: where none of the few can, others are drawn, or a surface in the dark would count as lit.
            const uint32_t most = light.pointLike() || s_.hard ? samples : std::max(samples, kLeastLooked);
            for (uint32_t i = 0; i < samples || (i < most && !(sum[e - from] > 0)); ++i) {
              LightPoint point;
              const Vec2 u = light.pointLike() || s_.hard ? Vec2(0.5f) : SobolSampler(seed, i).next2D();
              if (!light.sample(p, N, Ng, u, point)) continue;
              if (point.belowSurface) {
                below[e - from] = 1;
                continue;
              }
              sum[e - from] += point.weight;
              packet.add(shadowRay(reach, p, Ng, point), e - from, point.weight);
            }
          }
          packet.flush();
          for (size_t e = from; e < to; ++e) {
            const float nothing = below[e - from] && s_.glass != Glass::Alone ? 0.0f : 1.0f;
            for (size_t c = 0; c < C; ++c) V[C * e + c] = sum[e - from] > 0 ? float(seen[C * (e - from) + c] / sum[e - from]) : nothing;
          }
          if (ctx.counters) ctx.counters->rays.fetch_add(packet.rays, std::memory_order_relaxed);
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "visibility: stopped");
    return TermPtr(term);
  }

 private:
  /// Shadow rays of neighbours and of one receiver go together, 16 at a time; what they see is added in the order they came in.
  struct Packet {
    Packet(const Accel& a, const SurfaceTable& t, Glass g, std::vector<double>& s) : accel(a), surfaces(t), glass(g), seen(s) {}
    void add(const Ray& r, size_t e, float w) {
      ray[count] = r;
      element[count] = e;
      weight[count++] = w;
      if (count == 16) flush();
    }
    void flush() {
      if (glass != Glass::Solid) {
        flushTinted();
        return;
      }
      const uint32_t blocked = count ? accel.occluded16(ray, count) : 0;
      for (int i = 0; i < count; ++i)
        if (!(blocked >> i & 1)) seen[element[i]] += weight[i];
      rays += uint64_t(count);
      count = 0;
    }
    void flushTinted() {
      Vec3 left[16];
      if (glass == Glass::Seen && count) transmittance16(accel, surfaces, ray, nullptr, count, left, rays);
      for (int i = 0; i < count; ++i) {
        if (glass == Glass::Alone) left[i] = tint(accel, surfaces, ray[i], rays);
        for (int c = 0; c < 3; ++c) seen[3 * element[i] + size_t(c)] += double(weight[i]) * left[i][c];
      }
      count = 0;
    }
    const Accel& accel;
    const SurfaceTable& surfaces;
    Glass glass;
    std::vector<double>& seen;
    Ray ray[16];
    size_t element[16];
    float weight[16];
    int count = 0;
    uint64_t rays = 0;
  };

  int channels() const { return s_.glass == Glass::Solid ? 1 : 3; }
  VisibilitySettings s_;
};

}  // namespace

NodePtr makeVisibilityNode(const VisibilitySettings& settings) { return std::make_shared<VisibilityNode>(settings); }

}  // namespace terms
}  // namespace gobo
