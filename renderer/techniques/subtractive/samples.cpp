// SPDX-License-Identifier: Apache-2.0
#include "techniques/subtractive/samples.h"

#include <array>

#include "terms/light_points.h"
#include "trace/accel.h"

namespace gobo::subtractive {

namespace {

class SamplesNode final : public Node {
 public:
  explicit SamplesNode(SamplesSettings s) : s_(std::move(s)) {}
  std::string type() const override { return "subtractive_samples"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.facets = kAccelFacets;
    t.tileable = true;
    t.halo = s_.resampling.reach();
    return t;
  }
  void hashParameters(Hasher& h) const override {
    hashCamera(h, s_.view.camera);
    h.add(s_.view.width).add(s_.view.height).add(s_.view.viewSamples);
    s_.view.place.hash(h);
    s_.resampling.hash(h);
    for (const DistantLightSample& l : s_.lights) h.addPod(l.direction).addPod(l.irradiance);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 2);
    Receivers::reads(w, s_.view);
    return w.gives({type(),
                    Domain::ViewSample,
                    s_.view.extent(),
                    {plane<float>("unshadowed", 6), plane<float>("visible", 6), plane<float>("moments", 4), plane<uint8_t>("traced")}});
  }
  Cost cost(const TermShape& result, uint32_t) const override {
    const double traced = kReceiving * double(result.extent.elements()) / (double(s_.resampling.resolution) * s_.resampling.resolution);
    return {traced * double(s_.lights.size()), 100.0 * traced * double(s_.lights.size()) + 100.0 * double(result.extent.elements())};
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    GOBO_ASSIGN(const AccelPtr accel, ctx.accel());
    const Receivers in(*ctx.inputs[0], *ctx.inputs[1], s_.view);
    const auto unshadowed = ctx.result->writable<float>("unshadowed"), visible = ctx.result->writable<float>("visible"),
               moments = ctx.result->writable<float>("moments");
    const auto traced = ctx.result->writable<uint8_t>("traced");
    const size_t width = size_t(s_.view.width), pixels = width * size_t(s_.view.height);
    // Some 4000 rays between looks at `stop`, where all samples are traced.
    const size_t grain = std::clamp<size_t>(4096 / std::max<size_t>(s_.lights.size(), 1), 8, 256);
    const bool complete = ctx.arena->parallelFor(
        pixels * size_t(s_.view.viewSamples), grain,
        [&](size_t begin, size_t end) {
          uint64_t rays = 0;
          for (size_t e = begin; e < end; ++e) {
            if (!in.lit(e) || !speaksForItself(in, e)) continue;
            Sums sums;
            trace(*accel, in, e, sums, rays);
            write(sums, unshadowed.data() + 6 * e, visible.data() + 6 * e, moments.data() + 4 * e);
            traced[e] = 1;
          }
          if (ctx.counters) ctx.counters->rays.fetch_add(rays, std::memory_order_relaxed);
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "subtractive_samples: stopped");
    return TermPtr(ctx.result);
  }

 private:
  struct Sums {
    DVec3 unshadowed[2] = {DVec3(0.0), DVec3(0.0)}, visible[2] = {DVec3(0.0), DVec3(0.0)};
    double squares[2] = {0, 0}, seen[2] = {0, 0};
  };
  struct Arriving {
    Vec3 lobe[2];
  };

  /// On the grid, or nothing there speaks for it.
  bool speaksForItself(const Receivers& in, size_t e) const {
    const size_t width = size_t(s_.view.width), p = e % (width * size_t(s_.view.height));
    const int x = int(p % width), y = int(p / width);
    if (onGrid(s_.resampling, s_.view, x, y)) return true;
    float sum = 0;
    forNeighbours(s_.resampling, in, x, y, e, [&](size_t, float weight) { sum += weight; });
    return !(sum >= kLeastWeight);  // NaN: nothing does
  }

  static BsdfParams brightened(const Receivers& in, size_t e) {
    BsdfParams b = in.bsdf(e);
    for (int c = 0; c < 3; ++c) b.albedo[c] = std::max(b.albedo[c], kLeastAlbedo);
    return b;
  }

  void trace(const Accel& accel, const Receivers& in, size_t e, Sums& sums, uint64_t& rays) const {
    const Vec3 p = Receivers::at(in.P, e), n = Receivers::at(in.N, e), ng = Receivers::at(in.Ng, e);
    const Frame frame(n);
    const Vec3 wo = frame.toLocal(in.out(e));
    BsdfParams b = brightened(in, e);
    const bool lambert = b.metallic == 0 && b.specular == 0 && b.transmission == 0;
    if (!lambert && n != ng) b.facing = frame.toLocal(ng);
    const LobeAlbedos by = in.albedos(e, b);
    const auto over = [](const Vec3& light, const Vec3& albedo) {
      Vec3 out(0.0f);
      for (int c = 0; c < 3; ++c) out[c] = albedo[c] > 1e-6f ? minOf(light[c] / albedo[c], 1e18f) : 0.0f;
      return out;
    };
    Ray ray[16];
    Arriving arriving[16];
    int count = 0;
    const auto flush = [&] {
      const uint32_t blocked = count ? accel.occluded16(ray, count) : 0;
      for (int i = 0; i < count; ++i) {
        const bool seen = !(blocked >> i & 1);
        for (int k = 0; k < 2; ++k) {
          const DVec3 value(arriving[i].lobe[k]);
          const double square = double(luminance(arriving[i].lobe[k])) * double(luminance(arriving[i].lobe[k]));
          sums.unshadowed[k] += value;
          sums.squares[k] += square;
          if (seen) sums.visible[k] += value, sums.seen[k] += square;
        }
      }
      rays += uint64_t(count);
      count = 0;
    };
    for (const DistantLightSample& light : s_.lights) {
      if (!(glm::dot(light.direction, ng) > 0) || !(glm::dot(light.direction, n) > 0)) continue;
      const BsdfValue f = bsdfEval(b, wo, frame.toLocal(light.direction));
      const Arriving a{{over(f.diffuse * light.irradiance, by.diffuse), over(f.specular * light.irradiance, by.specular)}};
      if (a.lobe[0] == Vec3(0.0f) && a.lobe[1] == Vec3(0.0f)) continue;
      LightPoint point;
      point.direction = light.direction;
      point.distance = 3.0e38f;
      ray[count] = shadowRay(accel, p, ng, point);
      arriving[count++] = a;
      if (count == 16) flush();
    }
    flush();
  }

  static void write(const Sums& sums, float* unshadowed, float* visible, float* moments) {
    for (int k = 0; k < 2; ++k) {
      for (int c = 0; c < 3; ++c) {
        unshadowed[3 * k + c] = float(std::min(sums.unshadowed[k][c], kMost));
        visible[3 * k + c] = float(std::min(sums.visible[k][c], kMost));
      }
      moments[2 * k] = float(std::min(sums.squares[k], kMost));
      moments[2 * k + 1] = float(std::min(sums.seen[k], kMost));
    }
  }
  static constexpr double kMost = 1e36;

  SamplesSettings s_;
};

}  // namespace

NodePtr makeSamplesNode(const SamplesSettings& settings) { return std::make_shared<SamplesNode>(settings); }

}  // namespace gobo::subtractive
