// SPDX-License-Identifier: Apache-2.0
#include "filters/automatic/shadow_probe.h"

#include <algorithm>
#include <cmath>

#include "base/sobol.h"
#include "filters/automatic/probe_pixels.h"
#include "filters/automatic/probe_surfaces.h"
#include "terms/gbuffer.h"
#include "terms/light_points.h"
#include "terms/visibility.h"
#include "trace/back_faces.h"
#include "trace/solid_scene.h"
#include "trace/view_samples.h"

namespace gobo {
inline namespace filters {
namespace {

constexpr size_t kGrain = 8;       // pixels a task
constexpr size_t kLookGrain = 64;  // the same of the first looks
constexpr int kTruthSamples = 8;   // over a pixel, each half: both in one packet
constexpr int kMostViewSamples = 16;
constexpr int kSequences = 3;  // soft shadows: of the ray counts, and two for the truth

class ShadowProbeNode final : public Node {
 public:
  explicit ShadowProbeNode(const ShadowProbeSettings& s) : s_(s) {}
  std::string type() const override { return "shadow_probe"; }
  int version() const override { return 5; }  // 4: says where its pixels are; 5: rays begin nearer to the surface
  NodeTraits traits() const override {
    NodeTraits t;
    t.facets = kAccelFacets | Facet::LightShape;
    if (s_.clear) t.facets = t.facets | Facet::Bsdf;
    if (s_.camera.cullBackFaces) t.facets = t.facets | kBackFaceFacets;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    hashCamera(h, s_.camera);
    h.add(s_.width).add(s_.height).add(s_.viewSamples).add(s_.cells).add(s_.split).add(s_.judged).add(s_.truthRays).add(s_.seed);
    for (const uint32_t n : s_.rays) h.add(n);
    if (s_.clear) h.add("clear");
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    GOBO_CHECK(size_t(s_.judged) * size_t(s_.viewSamples) >= s_.rays.size());
    return Wiring(type(), in, 0)
        .gives({type(),
                Domain::Table,
                {s_.judged * s_.viewSamples, 1, 1},
                {plane<float>("P", 3), plane<float>("N", 3), plane<float>("Ng", 3), plane<uint32_t>("instance"), plane<float>("a"), plane<float>("b"),
                 plane<float>("lit"), plane<double>("weight"), plane<uint32_t>("stratum"), plane<uint32_t>("x"), plane<uint32_t>("y"), plane<double>("barely"),
                 plane<double>("barely_variance"), plane<double>("mse"), plane<double>("variance"), plane<double>("share")}});
  }
  Cost cost(const TermShape&, uint32_t) const override {
    const double rays = shadowProbeRays(s_);
    return {rays, 100.0 * rays};
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    GOBO_ASSIGN(AccelPtr accel, ctx.accel());
    const Eye eye{FilmRays(s_.camera, s_.width, s_.height), s_.camera.cullBackFaces ? BackFaces(*ctx.scene, *accel) : BackFaces()};
    const SolidScene scene(*ctx.scene, std::move(accel), s_.clear);
    const LightPoints light(*ctx.scene, ctx.scene->lightSubset().at(0));
    const auto& term = ctx.result;
    const Surfaces at{term->writable<float>("P"), term->writable<float>("N"), term->writable<float>("Ng"), term->writable<uint32_t>("instance")};
    const auto a = term->writable<float>("a"), b = term->writable<float>("b"), lit = term->writable<float>("lit");
    const auto weight = term->writable<double>("weight");
    const auto stratum = term->writable<uint32_t>("stratum"), x = term->writable<uint32_t>("x"), y = term->writable<uint32_t>("y");
    ProbeDesign design;
    design.width = s_.width;
    design.height = s_.height;
    design.cells = s_.cells;
    design.split = s_.split;
    design.judged = s_.judged;
    design.seed = hash64(s_.seed, 0x9e0be);
    GOBO_ASSIGN(const ProbePixels chosen, chooseProbePixels(design, [&](std::span<const PixelPlace> pixels, std::span<ProbeSeen> seen) {
                  return ctx.arena->parallelFor(
                      pixels.size(), kLookGrain,
                      [&](size_t from, size_t to) {
                        uint64_t rays = 0;
                        for (size_t i = from; i < to; i += 16)
                          glance(scene, light, eye, pixels.subspan(i, std::min<size_t>(16, to - i)), seen.subspan(i), rays);
                        if (ctx.counters) ctx.counters->rays += rays;
                      },
                      ctx.stop);
                }));
    const size_t S = size_t(s_.viewSamples), K = s_.rays.size(), pixels = chosen.judged.size();
    GOBO_CHECK(pixels == size_t(s_.judged));
    std::vector<double> errors(pixels * K, 0.0);
    std::vector<char> barely(pixels, 0);  // little of the light can shine there
    const bool done = ctx.arena->parallelFor(
        pixels, kGrain,
        [&](size_t from, size_t to) {
          uint64_t rays = 0;
          for (size_t p = from; p < to; ++p) {
            const std::span<double> e = std::span(errors).subspan(p * K, K);
            if (light.pointLike()) judgeHard(scene, light, eye, chosen.judged[p].at, at, p, a, b, lit, e, rays);
            else barely[p] = judgeSoft(scene, light, eye, chosen.judged[p].at, at, p, a, b, lit, e, rays);
          }
          if (ctx.counters) ctx.counters->rays += rays;
        },
        ctx.stop);
    if (!done) return Status(Code::Cancelled, "shadow_probe stopped");
    for (size_t p = 0; p < pixels; ++p) {
      weight[p * S] = chosen.judged[p].weight;
      stratum[p * S] = chosen.judged[p].stratum;
      x[p * S] = uint32_t(chosen.judged[p].at.x);
      y[p * S] = uint32_t(chosen.judged[p].at.y);
    }
    for (const bool all : {true, false}) {
      const auto mse = term->writable<double>(all ? "mse" : "barely"), variance = term->writable<double>(all ? "variance" : "barely_variance");
      for (size_t k = 0; k < K && chosen.receivers > 0; ++k) {
        StratifiedSum sum;
        for (size_t p = 0; p < pixels; ++p) sum.add(chosen.judged[p], all || barely[p] ? errors[p * K + k] : 0.0);
        mse[k] = sum.sum() / chosen.receivers;
        variance[k] = sum.variance() / (chosen.receivers * chosen.receivers);
      }
    }
    term->writable<double>("share")[0] = chosen.receivers;
    return TermPtr(term);
  }

 private:
  /// What up to 16 pixels show: one view ray each, and a shadow ray, two to lights of some size.
  void glance(const SolidScene& scene, const LightPoints& light, const Eye& eye, std::span<const PixelPlace> pixels, std::span<ProbeSeen> seen,
              uint64_t& rays) const {
    const int count = int(pixels.size());
    float P[3 * 16], N[3 * 16], Ng[3 * 16];
    uint32_t instance[16];
    const Surfaces at{P, N, Ng, instance};
    Ray ray[16];
    const Vec2 offset = viewSamplePosition(0, s_.viewSamples);
    for (int i = 0; i < count; ++i) ray[i] = eye.film.at(float(pixels[size_t(i)].x) + offset.x, float(pixels[size_t(i)].y) + offset.y);
    look(scene, eye, ray, count, at, 0);
    rays += uint64_t(count);
    bool open[16] = {}, shut[16] = {};
    for (int k = 0; k < (light.pointLike() ? 1 : 2); ++k) {
      int of[16] = {}, waiting = 0;
      for (int i = 0; i < count; ++i) {
        if (!at.hit(size_t(i))) continue;
        const uint64_t place = uint64_t(pixels[size_t(i)].y) * uint64_t(s_.width) + uint64_t(pixels[size_t(i)].x);
        const Vec2 u = light.pointLike() ? Vec2(0.5f) : SobolSampler(hash64(hash64(s_.seed, 0x91a9ce), place), uint32_t(k)).next2D();
        LightPoint point;
        if (!light.sample(at.position(size_t(i)), at.normal(size_t(i)), at.normal(size_t(i)), u, point)) continue;
        if (point.belowSurface) {
          shut[i] = true;
          continue;
        }
        ray[waiting] = shadowRay(scene.accel().reach(at.instance[size_t(i)]), at.position(size_t(i)), at.normal(size_t(i)), point);
        of[waiting++] = i;
      }
      const uint32_t blocked = waiting ? scene.occluded16(ray, waiting) : 0;
      rays += uint64_t(waiting);
      for (int w = 0; w < waiting; ++w) (blocked >> w & 1 ? shut : open)[of[w]] = true;
    }
    for (int i = 0; i < count; ++i) seen[size_t(i)] = open[i] ? (shut[i] ? ProbeSeen::Both : ProbeSeen::Lit) : shut[i] ? ProbeSeen::Dark : ProbeSeen::Nothing;
  }

  /// Hard shadows: view samples, then the pixel's area in two halves, all in packets.
  void judgeHard(const SolidScene& scene, const LightPoints& light, const Eye& eye, PixelPlace pixel, const Surfaces& at, size_t p, std::span<float> outA,
                 std::span<float> outB, std::span<float> outLit, std::span<double> errors, uint64_t& rays) const {
    const size_t S = size_t(s_.viewSamples), first = p * S;
    const float x = float(pixel.x), y = float(pixel.y);
    Ray view[kMostViewSamples];
    for (size_t s = 0; s < S; ++s) {
      const Vec2 offset = viewSamplePosition(int(s), s_.viewSamples);
      view[s] = eye.film.at(x + offset.x, y + offset.y);
    }
    look(scene, eye, view, int(S), at, first);
    float sampleV[kMostViewSamples];
    bool sampleLit[kMostViewSamples];
    open(scene, light, at, first, int(S), sampleV, sampleLit, rays);
    double v = 0, lit = 0;
    for (size_t s = 0; s < S; ++s)
      if (sampleLit[s]) {
        outLit[first + s] = 1.0f;
        v += sampleV[s];
        ++lit;
      }
    if (!(lit > 0)) return;
    constexpr int kBoth = 2 * kTruthSamples;
    static_assert(kBoth <= kMostViewSamples);
    float P[3 * kBoth], N[3 * kBoth], Ng[3 * kBoth], V[kBoth];
    uint32_t instance[kBoth];
    bool can[kBoth];
    const Surfaces area{P, N, Ng, instance};
    for (int i = 0; i < kBoth; ++i) {
      const uint64_t half = uint64_t(i / kTruthSamples) + 1;
      const Vec2 u = SobolSampler(hash64(s_.seed, hash64(p, half)), uint32_t(i % kTruthSamples)).next2D();
      view[i] = eye.film.at(x + u.x, y + u.y);
    }
    look(scene, eye, view, kBoth, area, 0);
    open(scene, light, area, 0, kBoth, V, can, rays);
    rays += uint64_t(S) + kBoth;
    double half[2];
    for (int h = 0; h < 2; ++h) {
      double seen = 0, count = 0;
      for (int i = h * kTruthSamples; i < (h + 1) * kTruthSamples; ++i)
        if (can[i]) seen += V[i], ++count;
      half[h] = count > 0 ? seen / count : 1.0;
    }
    outA[first] = float(half[0]);
    outB[first] = float(half[1]);
    for (double& e : errors) e = (v / lit - outA[first]) * (v / lit - outB[first]);
  }

  /// Whether a point-like light can shine on surfaces first .. first + count - 1 (at most 16), and does.
  static void open(const SolidScene& scene, const LightPoints& light, const Surfaces& at, size_t first, int count, float* V, bool* can, uint64_t& rays) {
    Ray ray[16];
    int of[16] = {}, waiting = 0;
    for (int i = 0; i < count; ++i) {
      const size_t e = first + size_t(i);
      LightPoint point;
      V[i] = 0.0f;
      can[i] = at.hit(e) && light.sample(at.position(e), at.normal(e), at.normal(e), Vec2(0.5f), point);
      if (!can[i] || point.belowSurface) continue;
      ray[waiting] = shadowRay(scene.accel().reach(at.instance[e]), at.position(e), at.normal(e), point);
      of[waiting++] = i;
    }
    const uint32_t blocked = waiting ? scene.occluded16(ray, waiting) : 0;
    for (int w = 0; w < waiting; ++w) V[of[w]] = blocked >> w & 1 ? 0.0f : 1.0f;
    rays += uint64_t(waiting);
  }

  /// Soft shadows at the pixel's view samples: truth in two halves, ray counts by their own sequences. Whether little of the light
  /// can shine there.
  bool judgeSoft(const SolidScene& scene, const LightPoints& light, const Eye& eye, PixelPlace pixel, const Surfaces& at, size_t p, std::span<float> outA,
                 std::span<float> outB, std::span<float> outLit, std::span<double> errors, uint64_t& rays) const {
    const size_t S = size_t(s_.viewSamples), first = p * S;
    Ray view[kMostViewSamples];
    for (size_t s = 0; s < S; ++s) {
      const Vec2 offset = viewSamplePosition(int(s), s_.viewSamples);
      view[s] = eye.film.at(float(pixel.x) + offset.x, float(pixel.y) + offset.y);
    }
    look(scene, eye, view, int(S), at, first);
    rays += uint64_t(S);
    // Independent sequences of one distribution: the beginnings of each are what ray counts would see, and the whole of the others the truth.
    const uint32_t length[kSequences] = {std::max(s_.truthRays, s_.rays.empty() ? 1 : s_.rays.back()), s_.truthRays, s_.truthRays};
    const size_t K = s_.rays.size();
    bool little = false;
    double lit = 0, whole[kSequences] = {}, estimate[kSequences][kMostProbeRays] = {};
    for (size_t s = 0; s < S; ++s) {
      const size_t e = first + s;
      if (!at.hit(e)) continue;
      float prefix[kSequences][kMostProbeRays];
      bool shines = true;
      for (int q = 0; q < kSequences && shines; ++q) {
        const uint64_t seed = q == 0 ? viewSampleSeed(s_.seed, e) : hash64(s_.seed, hash64(e, uint64_t(q)));
        const uint32_t from = visibilityOfPoints(scene, light, at, e, seed, length[q], prefix[q], rays);
        if (q > 0) continue;
        shines = from > 0;
        little |= shines && 2 * from < length[0];
      }
      if (!shines) continue;
      outLit[e] = 1.0f;
      ++lit;
      for (int q = 0; q < kSequences; ++q) {
        whole[q] += prefix[q][length[q] - 1];
        for (size_t k = 0; k < K; ++k)
          if (s_.rays[k] <= length[q]) estimate[q][k] += prefix[q][s_.rays[k] - 1];
      }
    }
    if (!(lit > 0)) return false;
    for (double& w : whole) w /= lit;
    outA[first] = float(whole[0]);
    outB[first] = float(0.5 * (whole[1] + whole[2]));
    for (size_t k = 0; k < K; ++k) {
      double sum = 0, count = 0;
      for (int q = 0; q < kSequences; ++q) {
        if (s_.rays[k] > length[q]) continue;
        const double v = estimate[q][k] / lit;
        sum += (v - whole[(q + 1) % kSequences]) * (v - whole[(q + 2) % kSequences]);
        ++count;
      }
      errors[k] = sum / count;
    }
    return little;
  }

  ShadowProbeSettings s_;
};

}  // namespace

double shadowProbeRays(const ShadowProbeSettings& s) {
  const double looks = s.cells + 4.0 * s.split * ProbeDesign{}.levels, most = s.rays.empty() ? 1 : s.rays.back();
  const double each = s.rays.size() > 1 ? s.viewSamples * (1.0 + most + 2.0 * s.truthRays) : 2.0 * s.viewSamples + 4.0 * kTruthSamples;
  return 2.0 * looks + s.judged * each;
}

NodePtr makeShadowProbeNode(const ShadowProbeSettings& settings) {
  GOBO_CHECK_LT(0, settings.viewSamples);
  GOBO_CHECK_LE(settings.viewSamples, kMostViewSamples);
  GOBO_CHECK_LE(settings.rays.size(), size_t(kMostProbeRays));
  return std::make_shared<ShadowProbeNode>(settings);
}

}  // namespace filters
}  // namespace gobo
