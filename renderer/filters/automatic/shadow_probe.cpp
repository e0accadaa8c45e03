// SPDX-License-Identifier: Apache-2.0
#include "filters/automatic/shadow_probe.h"

#include <algorithm>
#include <cmath>

#include "base/sobol.h"
#include "filters/shadow_map/depth_compare.h"
#include "formulas/soft_shadow.glsl.h"
#include "terms/light_points.h"
#include "terms/surface_samples.h"
#include "terms/visibility.h"
#include "trace/accel.h"

namespace gobo {
namespace {

constexpr int kGrain = 8;                 // receivers a task
constexpr int kSearch = 6, kFilter = 8;   // taps a side of the soft kernels

/// Depths of a map that is not there, by a ray per texel asked for.
class VirtualMap {
 public:
  VirtualMap(const Accel& accel, const ProbeMap& map) : accel_(accel), map_(map) {}
  int side() const { return map_.resolution; }
  /// z[i] of texels (x[i], y[i]), which repeat the rim outside.
  void depths(int face, const int* x, const int* y, int count, float* z, uint64_t& rays) const {
    const LightFrame& f = map_.frames.face[size_t(face)];
    const float texel = 1.0f / float(side()), scale = 1.0f / (f.far - f.near);
    for (int first = 0; first < count; first += 16) {
      const int n = std::min(16, count - first);
      Ray ray[16];
      Hit hit[16];
      float start[16], cosine[16];
      for (int i = 0; i < n; ++i) {
        const int tx = std::clamp(x[first + i], 0, side() - 1), ty = std::clamp(y[first + i], 0, side() - 1);
        ray[i] = f.ray((float(tx) + 0.5f) * texel, (float(ty) + 0.5f) * texel, start[i], cosine[i]);
      }
      accel_.intersect16(ray, n, hit);
      for (int i = 0; i < n; ++i) z[first + i] = hit[i].valid() ? formulas::shadowDepth((start[i] + hit[i].t * cosine[i] - f.near) * scale) : 1.0f;
    }
    rays += uint64_t(count);
  }

 private:
  const Accel& accel_;
  const ProbeMap& map_;
};

class ShadowProbeNode final : public Node {
 public:
  explicit ShadowProbeNode(const ShadowProbeSettings& s) : s_(s), gaussian_(shadowGaussian(1)) {}
  std::string type() const override { return "shadow_probe"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.facets = Facet::Topology | Facet::Pose | Facet::Coverage | Facet::LightShape;
    t.smallOutput = true;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    for (const ProbeMap& m : s_.maps) {
      m.frames.hash(h);
      h.add(m.resolution);
    }
    for (const uint32_t n : s_.rays) h.add(n);
    h.add(s_.bias).add(s_.slopeBias).add(s_.size.x).add(s_.size.y).add(s_.truthRays).add(s_.seed);
  }
  size_t outputBytes() const override { return columns() * 16; }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term& gbuffer = *ctx.inputs.at(0);
    const AccelPtr accel = ctx.accels->get(*ctx.scene, *ctx.arena);
    const LightPoints light(*ctx.scene, ctx.scene->lightSubset().at(0));
    const SurfaceSamples surface(gbuffer);
    const size_t tasks = (surface.size() + kGrain - 1) / kGrain;
    // Squared errors by task, added in order afterwards: the same for any number of threads.
    std::vector<double> sums(tasks * columns(), 0.0);
    std::vector<double> counts(tasks, 0.0);
    std::vector<Receivers> receivers;
    for (const ProbeMap& m : s_.maps) receivers.emplace_back(gbuffer, m.frames, m.resolution, ShadowView{}, ReceiverNeeds{.slopes = true, .facing = false});
    const bool done = ctx.arena->parallelFor(tasks, 1, [&](size_t from, size_t to) {
      uint64_t rays = 0;
      for (size_t task = from; task < to; ++task) {
        const size_t begin = task * kGrain, end = std::min(begin + kGrain, surface.size());
        for (size_t e = begin; e < end; ++e) {
          std::vector<float> estimates(s_.rays.size());
          float truth = 1.0f;
          if (!surface.hit(e) || !trace(*accel, light, surface, e, truth, estimates.data(), rays)) continue;
          counts[task] += 1;
          double* sum = &sums[task * columns()];
          for (size_t k = 0; k < s_.rays.size(); ++k) sum[k] += sqr(double(estimates[k]) - truth);
          for (size_t k = 0; k < s_.maps.size(); ++k) {
            ReceiverBlock b;
            receivers[k].fill(e, 1, b);
            const float v = !b.covered[0] ? 1.0f : s_.size == Vec2(0.0f) ? hard(*accel, s_.maps[k], b, rays) : soft(*accel, s_.maps[k], receivers[k], b, rays);
            sum[s_.rays.size() + k] += sqr(double(v) - truth);
          }
        }
      }
      if (ctx.counters) ctx.counters->rays += rays;
    }, ctx.stop);
    if (!done) return Status(Code::Cancelled, "shadow_probe stopped");
    auto term = std::make_shared<Term>("shadow_probe", Domain::Table, Extent{int(columns()), 1, 1});
    const auto rmse = term->addPlane<double>("rmse"), judged = term->addPlane<double>("receivers");
    double count = 0;
    for (const double c : counts) count += c;
    for (size_t k = 0; k < columns(); ++k) {
      double sum = 0;
      for (size_t t = 0; t < tasks; ++t) sum += sums[t * columns() + k];
      rmse[k] = count > 0 ? std::sqrt(sum / count) : 0.0;
    }
    judged[0] = count;
    return TermPtr(term);
  }

 private:
  static double sqr(double x) { return x * x; }
  size_t columns() const { return s_.rays.size() + s_.maps.size(); }

  /// Visibility by truthRays points, and by the first rays[k] of the sequence that the ray-traced technique would use. The first n of N points
  /// share their noise with the truth: the error of n is larger by 1 / (1 - n/N). False where the light cannot shine.
  bool trace(const Accel& accel, const LightPoints& light, const SurfaceSamples& surface, size_t e, float& truth, float* estimates, uint64_t& rays) const {
    const Vec3 p = surface.position(e), N = surface.normal(e), Ng = surface.geometricNormal(e);
    const uint64_t seed = viewSampleSeed(s_.seed, e);
    double seen = 0, sum = 0;
    size_t next = 0;
    std::vector<float> partial(s_.rays.size(), 1.0f);
    const uint32_t count = light.pointLike() ? 1 : s_.truthRays;
    for (uint32_t i = 0; i < count; ++i) {
      LightPoint point;
      const Vec2 u = light.pointLike() ? Vec2(0.5f) : SobolSampler(seed, i).next2D();
      if (light.sample(p, N, Ng, u, point)) {
        sum += point.weight;
        if (!point.belowSurface) {
          ++rays;
          if (!accel.occluded(shadowRay(accel, p, Ng, point))) seen += point.weight;
        }
      }
      while (next < s_.rays.size() && s_.rays[next] == i + 1) partial[next++] = sum > 0 ? float(seen / sum) : 1.0f;
    }
    if (!(sum > 0)) return false;
    truth = float(seen / sum);
    for (size_t k = 0; k < s_.rays.size(); ++k) {
      const double share = double(s_.rays[k]) / count;
      const double grow = count > 1 && share < 1 ? 1.0 / std::sqrt(1.0 - share) : 1.0;
      estimates[k] = k < next ? float(truth + grow * (double(partial[k]) - truth)) : truth;
    }
    return true;
  }

  float hard(const Accel& accel, const ProbeMap& map, const ReceiverBlock& b, uint64_t& rays) const {
    AxisKernel kx, ky;
    interpolatedKernel(b.x[0], gaussian_.data(), 1, kx);
    interpolatedKernel(b.y[0], gaussian_.data(), 1, ky);
    int x[16], y[16];
    float z[16];
    for (int i = 0; i < 16; ++i) {
      x[i] = kx.first + i % 4;
      y[i] = ky.first + i / 4;
    }
    VirtualMap(accel, map).depths(b.face[0], x, y, 16, z, rays);
    const ReceiverPlane r = receiverPlane(b, 0, s_.bias, s_.slopeBias);
    float sum = 0;
    for (int i = 0; i < 16; ++i) sum += r.at(x[i], y[i]) <= z[i] ? kx.weight[i % 4] * ky.weight[i / 4] : 0.0f;
    return std::min(sum, 1.0f);
  }

  /// taps x taps texels spread over the box of width (wx, wy) texels around the receiver.
  static int grid(const ReceiverPlane& r, float wx, float wy, int taps, int* x, int* y) {
    for (int i = 0; i < taps * taps; ++i) {
      x[i] = int(std::floor(r.x + wx * ((float(i % taps) + 0.5f) / float(taps) - 0.5f) + 0.5f));
      y[i] = int(std::floor(r.y + wy * ((float(i / taps) + 0.5f) / float(taps) - 0.5f) + 0.5f));
    }
    return taps * taps;
  }

  float soft(const Accel& accel, const ProbeMap& map, const Receivers& receivers, const ReceiverBlock& b, uint64_t& rays) const {
    const VirtualMap depths(accel, map);
    const LightFrame& f = map.frames.face[size_t(b.face[0])];
    const ReceiverPlane r = receiverPlane(b, 0, s_.bias, s_.slopeBias);
    const float d = receivers.metric(b.face[0], b.d[0]), texelsX = float(map.resolution) / (f.hi.x - f.lo.x), texelsY = float(map.resolution) / (f.hi.y - f.lo.y);
    const auto width = [&](float z, float size, float texels) {
      return std::clamp(formulas::softWidth(d, z, size, f.perspective) * texels, 1.0f, float(map.resolution));
    };
    int x[64], y[64];
    float z[64];
    float plane = std::max(f.near, 1e-3f * d);
    double blocked = 0, share = 0;
    for (int pass = 0; pass < 2; ++pass) {   // the search kernel is measured on the near plane, then on the nearest blocker found
      const int n = grid(r, width(plane, s_.size.x, texelsX), width(plane, s_.size.y, texelsY), kSearch, x, y);
      depths.depths(b.face[0], x, y, n, z, rays);
      blocked = share = 0;
      float nearest = 1.0f;
      for (int i = 0; i < n; ++i)
        if (z[i] < r.at(x[i], y[i])) {
          blocked += receivers.metric(b.face[0], z[i]);
          share += 1;
          nearest = std::min(nearest, z[i]);
        }
      if (share == 0) return 1.0f;
      plane = std::max(plane, receivers.metric(b.face[0], nearest));
    }
    const float blocker = float(blocked / share);
    const int n = grid(r, width(blocker, s_.size.x, texelsX), width(blocker, s_.size.y, texelsY), kFilter, x, y);
    depths.depths(b.face[0], x, y, n, z, rays);
    int lit = 0;
    for (int i = 0; i < n; ++i) lit += r.at(x[i], y[i]) <= z[i];
    return float(lit) / float(n);
  }

  ShadowProbeSettings s_;
  std::vector<float> gaussian_;
};

}  // namespace

NodePtr makeShadowProbeNode(const ShadowProbeSettings& settings) { return std::make_shared<ShadowProbeNode>(settings); }

}  // namespace gobo
