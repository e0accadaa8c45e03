// SPDX-License-Identifier: Apache-2.0
#include "filters/automatic/probe_windows.h"

#include <algorithm>
#include <cmath>

#include "base/sobol.h"
#include "filters/automatic/probe_pixels.h"
#include "filters/automatic/probe_surfaces.h"
#include "terms/gbuffer.h"

namespace gobo {
inline namespace filters {
namespace {

constexpr double kEven = 0.03;           // added to V (1 - V): pixels without a penumbra may have one beside them
constexpr double kEvenDark = 0.008;      // the same where the light cannot shine, but may beside it
constexpr int kCore = 4, kCoreStep = 2;  // judged: every second pixel of those about the middle; those farther out see less than the picture has around them
constexpr uint32_t kNoiseRays[] = {1, 4, 8, 16};
constexpr size_t kNoises = std::size(kNoiseRays);

/// Elements of a layer that are judged.
std::vector<size_t> corePixels(const ProbeWindowsSettings& s) {
  std::vector<size_t> out;
  for (int y = -kCore; y <= kCore; y += kCoreStep)
    for (int x = -kCore; x <= kCore; x += kCoreStep) out.push_back(size_t(s.radius + y) * size_t(s.side()) + size_t(s.radius + x));
  return out;
}

class ProbeWindowsNode final : public Node {
 public:
  explicit ProbeWindowsNode(const ProbeWindowsSettings& s) : s_(s) { GOBO_CHECK(s.windows >= 2 && s.radius >= kCore && s.viewSamples > 0); }
  std::string type() const override { return "probe_windows"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.facets = kAccelFacets | Facet::Shading | Facet::LightShape;
    if (s_.camera.cullBackFaces) t.facets = t.facets | kBackFaceFacets;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    hashCamera(h, s_.camera);
    h.add(s_.width).add(s_.height).add(s_.viewSamples).add(s_.windows).add(s_.radius).add(s_.seed);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 1);
    w.over(0, {s_.judged * s_.viewSamples, 1, 1});
    for (const char* each : {"a", "b", "lit"}) w.reads<float>(0, each);
    w.reads<double>(0, "weight");
    for (const char* each : {"x", "y"}) w.reads<uint32_t>(0, each);
    return w.gives(
        {type(),
         Domain::ViewSample,
         s_.extent(),
         {plane<float>("P", 3), plane<float>("N", 3), plane<float>("Ng", 3), plane<float>("footprint"), plane<uint32_t>("instance"), plane<float>("a"),
          plane<float>("b"), plane<float>("noise", int(kNoises)), plane<float>("lit"), plane<uint8_t>("inside"), plane<double>("weight")}});
  }
  Cost cost(const TermShape&, uint32_t) const override {
    const double rays = double(s_.extent().elements()) + probeWindowsRays(s_);
    return {rays, 80.0 * rays};
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    GOBO_ASSIGN(const AccelPtr accel, ctx.accel());
    const BackFaces passed = s_.camera.cullBackFaces ? BackFaces(*ctx.scene, *accel) : BackFaces();
    std::vector<MeshView<Facet::Shading>> meshes;
    for (size_t m = 0; m < ctx.scene->meshCount(); ++m) meshes.push_back(ctx.scene->mesh<Facet::Shading>(int(m)));
    const Term& probe = *ctx.inputs.at(0);
    const size_t S = size_t(s_.viewSamples), area = size_t(s_.side()) * size_t(s_.side());
    std::vector<double> weight;
    const std::vector<size_t> middle = draw(probe, weight);
    const auto& term = ctx.result;
    const auto P = term->writable<float>("P"), N = term->writable<float>("N"), Ng = term->writable<float>("Ng"), footprint = term->writable<float>("footprint");
    const auto instance = term->writable<uint32_t>("instance");
    const auto a = term->writable<float>("a"), b = term->writable<float>("b"), noise = term->writable<float>("noise"), lit = term->writable<float>("lit");
    const auto weights = term->writable<double>("weight");
    const auto inside = term->writable<uint8_t>("inside");
    std::fill(instance.begin(), instance.end(), kNoHit);
    for (size_t w = 0; w < middle.size(); ++w) weights[w * S * area] = weight[w];
    const Surfaces surfaces{P, N, Ng, instance};
    const SolidScene scene(*ctx.scene, accel, false);
    const LightPoints light(*ctx.scene, ctx.scene->lightSubset().at(0));
    const FilmRays film(s_.camera, s_.width, s_.height);
    const auto px = probe.plane<uint32_t>("x"), py = probe.plane<uint32_t>("y");
    const bool done = ctx.arena->parallelFor(
        middle.size(), 1,
        [&](size_t from, size_t to) {
          uint64_t rays = 0;
          for (size_t layer = from * S; layer < to * S; ++layer) {
            const size_t at = middle[layer / S] * S;
            const int x0 = int(px[at]) - s_.radius, y0 = int(py[at]) - s_.radius;
            const Vec2 offset = viewSamplePosition(int(layer % S), s_.viewSamples);
            Ray ray[16];
            size_t element[16] = {};
            int count = 0;
            const auto flush = [&] {
              Hit hit[16];
              accel->intersect16(ray, count, hit, &passed);
              rays += uint64_t(count);
              for (int i = 0; i < count; ++i) {
                if (!hit[i].valid()) continue;
                const size_t e = element[i];
                const InstanceGeometry& g = accel->impl().instances[hit[i].instance];
                const MeshView<Facet::Shading>& mesh = meshes[size_t(ctx.scene->instances()[hit[i].instance].mesh)];
                const Vec3 p = hitPosition(*accel, hit[i]);
                const HitNormals normal = hitNormals(mesh.normals, g, ray[i].direction, hit[i]);
                for (int c = 0; c < 3; ++c) {
                  P[3 * e + c] = p[c];
                  N[3 * e + c] = normal.shading[c];
                  Ng[3 * e + c] = normal.geometric[c];
                }
                footprint[e] = film.footprint(glm::length(p - ray[i].origin));
                instance[e] = hit[i].instance;
              }
              count = 0;
            };
            for (size_t k = 0; k < area; ++k) {
              const int x = x0 + int(k) % s_.side(), y = y0 + int(k) / s_.side();
              if (x < 0 || y < 0 || x >= s_.width || y >= s_.height) continue;
              inside[layer * area + k] = 1;
              Vec2 onLens(0.0f);
              if (s_.camera.hasLens()) onLens = viewSampleLens(int(layer % S), s_.viewSamples, uint64_t(y) * uint64_t(s_.width) + uint64_t(x));
              ray[count] = film.at(float(x) + offset.x, float(y) + offset.y, onLens);
              element[count++] = layer * area + k;
              if (count == 16) flush();
            }
            if (count) flush();
          }
          for (size_t w = from; w < to; ++w)
            for (const size_t k : corePixels(s_)) {
              double half[2] = {}, few[2][kNoises] = {}, among = 0;
              for (size_t s = 0; s < S; ++s) {
                const size_t e = (w * S + s) * area + k;
                if (!surfaces.hit(e)) continue;
                float prefix[2][kMostProbeRays];
                bool shines = true;
                for (uint64_t h = 0; h < 2 && shines; ++h) {
                  const uint64_t seed = hash64(hash64(s_.seed, 0x7a1f + h), e);
                  shines = 2 * visibilityOfPoints(scene, light, surfaces, e, seed, kWindowTruthRays, prefix[h], rays) >= kWindowTruthRays;
                }
                if (!shines) continue;
                lit[e] = 1.0f;
                ++among;
                for (size_t h = 0; h < 2; ++h) {
                  half[h] += prefix[h][kWindowTruthRays - 1];
                  for (size_t n = 0; n < kNoises; ++n) few[h][n] += prefix[h][kNoiseRays[n] - 1];
                }
              }
              if (!(among > 0)) continue;
              a[w * S * area + k] = float(half[0] / among);
              b[w * S * area + k] = float(half[1] / among);
              for (size_t n = 0; n < kNoises; ++n) {  // two independent estimates differ by twice their variance
                const double apart = (few[0][n] - few[1][n]) / among;
                noise[kNoises * (w * S * area + k) + n] = float(0.5 * apart * apart);
              }
            }
          if (ctx.counters) ctx.counters->rays += rays;
        },
        ctx.stop);
    if (!done) return Status(Code::Cancelled, "probe_windows stopped");
    return TermPtr(term);
  }

 private:
  /// The probe's pixels in the middle of the windows, and by what the mean over windows weighs each. None where the light can shine on nothing.
  std::vector<size_t> draw(const Term& probe, std::vector<double>& weight) const {
    const auto a = probe.floats("a"), b = probe.floats("b"), lit = probe.floats("lit");
    const auto stands = probe.plane<double>("weight");
    const size_t S = size_t(s_.viewSamples), pixels = lit.size() / S;
    std::vector<double> width(pixels, 0.0);
    double sum = 0;
    for (size_t p = 0; p < pixels; ++p) {
      const bool shines = std::any_of(lit.begin() + long(p * S), lit.begin() + long((p + 1) * S), [](float l) { return l != 0.0f; });
      const double v = std::clamp(0.5 * (double(a[p * S]) + double(b[p * S])), 0.0, 1.0);
      width[p] = std::sqrt(shines ? v * (1.0 - v) + kEven : kEvenDark);
      sum += stands[p * S] * width[p];
    }
    std::vector<size_t> out;
    if (!(sum > 0)) return out;
    const double start = double(hash64(s_.seed, 0x317d) >> 11) * 0x1p-53, step = sum / s_.windows;
    double passed = 0;
    size_t at = pixels;
    for (size_t p = 0; p < pixels && out.size() < size_t(s_.windows); ++p) {
      if (!(width[p] > 0)) continue;
      at = p;
      passed += stands[p * S] * width[p];
      while (out.size() < size_t(s_.windows) && (double(out.size()) + start) * step < passed) out.push_back(p);
    }
    while (out.size() < size_t(s_.windows)) out.push_back(at);  // rounding
    for (const size_t p : out) weight.push_back(sum / width[p]);
    return out;
  }

  ProbeWindowsSettings s_;
};

class WindowErrorsNode final : public Node {
 public:
  explicit WindowErrorsNode(const WindowErrorsSettings& s) : s_(s) {
    const auto at = std::find(std::begin(kNoiseRays), std::end(kNoiseRays), s.rays);
    GOBO_CHECK(at != std::end(kNoiseRays));
    compared_ = size_t(at - std::begin(kNoiseRays));
  }
  std::string type() const override { return "window_errors"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.smallOutput = true;
    return t;
  }
  void hashParameters(Hasher& h) const override { h.add(s_.windows.viewSamples).add(s_.windows.windows).add(s_.windows.radius).add(s_.rays); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 3);
    for (size_t i = 0; i < 3; ++i) w.over(i, s_.windows.extent());
    for (const char* each : {"a", "b", "lit"}) w.reads<float>(0, each);
    w.reads<float>(0, "noise", {int(kNoises)}).reads<double>(0, "weight").reads<uint8_t>(0, "inside");
    w.reads<float>(1, "V", {1}).reads<float>(2, "width");
    return w.gives({type(), Domain::Table, {1, 1, 1}, {plane<double>("ratio"), plane<double>("variance"), plane<double>("work", 2)}});
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    if (ctx.stop.stopRequested()) return Status(Code::Cancelled, "window_errors stopped");
    const Term& windows = *ctx.inputs.at(0);
    const auto a = windows.floats("a"), b = windows.floats("b"), lit = windows.floats("lit"), noise = windows.floats("noise");
    const auto V = ctx.inputs.at(1)->floats("V"), width = ctx.inputs.at(2)->floats("width");
    const auto weight = windows.plane<double>("weight");
    const auto inside = windows.plane<uint8_t>("inside");
    const size_t S = size_t(s_.windows.viewSamples), area = size_t(s_.windows.side()) * size_t(s_.windows.side()), K = size_t(s_.windows.windows);
    const std::vector<size_t> core = corePixels(s_.windows);
    std::vector<double> filtered(K, 0.0), plain(K, 0.0);  // by window
    double work[2] = {}, sums[2] = {};
    for (size_t w = 0; w < K; ++w) {
      const size_t of = w * S * area;
      double error = 0, noises = 0, here[2] = {}, pixels = 0;
      for (const size_t k : core) {
        if (!inside[of + k]) continue;
        ++pixels;
        double v = 0, among = 0;
        for (size_t s = 0; s < S; ++s) {
          const size_t e = of + s * area + k;
          if (lit[e] != 0.0f) v += double(V[e]), ++among;
          if (!(width[e] > 0.0f)) continue;
          here[0] += 1.0 / double(S);
          here[1] += 2.0 * (2.0 * std::min(std::ceil(3.0 * double(width[e])), kWidest) + 1.0) / double(S);
        }
        if (!(among > 0)) continue;
        error += (v / among - double(a[of + k])) * (v / among - double(b[of + k]));
        noises += double(noise[kNoises * (of + k) + compared_]);
      }
      if (!(pixels > 0)) continue;
      const double z = weight[of] / double(K) / pixels;
      sums[0] += filtered[w] = z * error;
      sums[1] += plain[w] = z * noises;
      for (int c = 0; c < 2; ++c) work[c] += z * here[c];
    }
    const auto& term = ctx.result;
    const double ratio = sums[1] > 0 ? std::max(sums[0], 0.0) / sums[1] : -1.0;
    double spread = 0;
    if (sums[1] > 0)
      for (size_t w = 0; w < K; ++w) spread += (filtered[w] - ratio * plain[w]) * (filtered[w] - ratio * plain[w]);
    term->writable<double>("ratio")[0] = ratio;
    term->writable<double>("variance")[0] = sums[1] > 0 ? double(K) / double(K - 1) * spread / (sums[1] * sums[1]) : 0.0;
    for (int c = 0; c < 2; ++c) term->writable<double>("work")[c] = work[c];
    return TermPtr(term);
  }

 private:
  static constexpr double kWidest = 32;  // the filter's radius unless a request says otherwise
  WindowErrorsSettings s_;
  size_t compared_ = 0;
};

}  // namespace

double probeWindowsRays(const ProbeWindowsSettings& s) { return double(s.windows) * s.viewSamples * double(corePixels(s).size()) * 2.0 * kWindowTruthRays; }
NodePtr makeProbeWindowsNode(const ProbeWindowsSettings& settings) { return std::make_shared<ProbeWindowsNode>(settings); }
NodePtr makeWindowErrorsNode(const WindowErrorsSettings& settings) { return std::make_shared<WindowErrorsNode>(settings); }

}  // namespace filters
}  // namespace gobo
