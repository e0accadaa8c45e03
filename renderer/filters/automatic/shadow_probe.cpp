// SPDX-License-Identifier: Apache-2.0
#include "filters/automatic/shadow_probe.h"

#include <algorithm>
#include <cmath>

#include "base/sobol.h"
#include "filters/shadow_map/depth_compare.h"
#include "formulas/soft_shadow.glsl.h"
#include "terms/gbuffer.h"
#include "terms/light_points.h"
#include "terms/visibility.h"
#include "trace/back_faces.h"
#include "trace/solid_scene.h"
#include "trace/view_samples.h"

namespace gobo::inline filters {
namespace {

constexpr int kGrain = 8;          // pixels a task
constexpr int kTruthSamples = 12;  // over a pixel, each half
constexpr uint32_t kMostRays = 64;
constexpr int kSearch = 6, kFilter = 8;  // taps a side of the soft kernels

/// Depths of a map that is not there, by a ray per texel asked for.
class VirtualMap {
 public:
  VirtualMap(const SolidScene& scene, const ProbeMap& map) : scene_(scene), map_(map) {}
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
      scene_.intersect16(ray, n, hit);
      for (int i = 0; i < n; ++i) z[first + i] = hit[i].valid() ? formulas::shadowDepth((start[i] + hit[i].t * cosine[i] - f.near) * scale) : 1.0f;
    }
    rays += uint64_t(count);
  }

 private:
  const SolidScene& scene_;
  const ProbeMap& map_;
};

/// Squared errors by task, added in order afterwards: the same for any number of threads.
class Errors {
 public:
  Errors(size_t tasks, size_t columns) : columns_(columns), sums_(tasks * columns, 0.0), squares_(sums_), counts_(tasks, 0.0) {}
  void count(size_t task) { counts_[task] += 1; }
  void add(size_t task, size_t column, double v, double a, double b) {
    const double e = (v - a) * (v - b);
    sums_[task * columns_ + column] += e;
    squares_[task * columns_ + column] += e * e;
  }
  double judged() const {
    double n = 0;
    for (const double c : counts_) n += c;
    return n;
  }
  /// Root of the mean squared error plus its standard error: few pixels hold most of the error, and a probe sees few of them.
  double rmse(size_t column) const {
    double sum = 0, squares = 0;
    for (size_t t = 0; t < counts_.size(); ++t) {
      sum += sums_[t * columns_ + column];
      squares += squares_[t * columns_ + column];
    }
    const double n = judged();
    if (!(n > 1)) return 0.0;
    const double mean = sum / n, variance = std::max(0.0, squares / n - mean * mean) / (n - 1);
    return std::sqrt(std::max(0.0, mean + std::sqrt(variance)));
  }

 private:
  size_t columns_;
  std::vector<double> sums_, squares_, counts_;
};

struct Surfaces {
  std::span<float> P, Ng;
  std::span<uint32_t> instance;
  bool hit(size_t e) const { return instance[e] != kNoHit; }
  Vec3 position(size_t e) const { return Vec3(P[3 * e], P[3 * e + 1], P[3 * e + 2]); }
  Vec3 normal(size_t e) const { return Vec3(Ng[3 * e], Ng[3 * e + 1], Ng[3 * e + 2]); }
};
struct Eye {
  FilmRays film;
  BackFaces passed;
};

/// Elements first .. first + count - 1: what the rays see. Shading normals are left out: a probe can do without them.
void look(const SolidScene& scene, const Eye& eye, const Ray* ray, int count, const Surfaces& at, size_t first) {
  Hit hit[16];
  scene.accel().intersect16(ray, count, hit, &eye.passed);
  for (int i = 0; i < count; ++i) {
    const size_t e = first + size_t(i);
    at.instance[e] = hit[i].instance;
    const Vec3 p = hit[i].valid() ? ray[i].origin + ray[i].direction * hit[i].t : Vec3(0.0f);
    const Vec3 n = !hit[i].valid() ? Vec3(0.0f) : glm::dot(hit[i].Ng, ray[i].direction) < 0 ? hit[i].Ng : -hit[i].Ng;
    for (int c = 0; c < 3; ++c) {
      at.P[3 * e + c] = p[c];
      at.Ng[3 * e + c] = n[c];
    }
  }
}

class ShadowProbeNode final : public Node {
 public:
  explicit ShadowProbeNode(const ShadowProbeSettings& s) : s_(s) {}
  std::string type() const override { return "shadow_probe"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.facets = kAccelFacets | Facet::LightShape;
    if (s_.clear) t.facets = t.facets | Facet::Bsdf;
    if (s_.camera.cullBackFaces) t.facets = t.facets | kBackFaceFacets;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    hashCamera(h, s_.camera);
    h.add(s_.width).add(s_.height).add(s_.viewSamples).add(s_.pixels).add(s_.truthRays).add(s_.seed);
    for (const uint32_t n : s_.rays) h.add(n);
    if (s_.clear) h.add("clear");
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    return Wiring(type(), in, 0)
        .gives({type(),
                Domain::Table,
                {int(std::max(cells() * size_t(s_.viewSamples), s_.rays.size())), 1, 1},
                {plane<float>("P", 3), plane<float>("Ng", 3), plane<uint32_t>("instance"), plane<float>("a"), plane<float>("b"), plane<float>("lit"),
                 plane<double>("rays"), plane<double>("share")}});
  }
  Cost cost(const TermShape&, uint32_t) const override {
    double each = 1.0 + 2.0 * s_.truthRays;
    for (const uint32_t n : s_.rays) each += n;
    const double rays = double(s_.pixels) * s_.viewSamples * each;
    return {rays, 200.0 * rays};
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    GOBO_ASSIGN(AccelPtr accel, ctx.accel());
    const Eye eye{FilmRays(s_.camera, s_.width, s_.height), s_.camera.cullBackFaces ? BackFaces(*ctx.scene, *accel) : BackFaces()};
    const SolidScene scene(*ctx.scene, std::move(accel), s_.clear);
    const LightPoints light(*ctx.scene, ctx.scene->lightSubset().at(0));
    // Cells about as wide as high; one pixel of each.
    const int across = this->across(), down = this->down();
    const size_t cells = this->cells(), tasks = (cells + kGrain - 1) / kGrain;
    const auto& term = ctx.result;
    const Surfaces at{term->writable<float>("P"), term->writable<float>("Ng"), term->writable<uint32_t>("instance")};
    const auto a = term->writable<float>("a"), b = term->writable<float>("b"), lit = term->writable<float>("lit");
    const auto rmse = term->writable<double>("rays"), share = term->writable<double>("share");
    Errors errors(tasks, s_.rays.size());
    const bool done = ctx.arena->parallelFor(
        tasks, 1,
        [&](size_t from, size_t to) {
          uint64_t rays = 0;
          for (size_t task = from; task < to; ++task)
            for (size_t c = task * kGrain; c < std::min((task + 1) * kGrain, cells); ++c) {
              const auto pick = [&](size_t cell, int count, int size, uint64_t salt) {  // a pixel of the cell
                const int lo = int(int64_t(cell) * size / count), hi = std::max(lo + 1, int(int64_t(cell + 1) * size / count));
                return float(lo + int(hash64(hash64(0x9e0be, c), salt) % uint64_t(hi - lo)));
              };
              if (judge(scene, light, eye, pick(c % size_t(across), across, s_.width, 1), pick(c / size_t(across), down, s_.height, 2), at, c, a, b, lit,
                        errors, task, rays))
                errors.count(task);
            }
          if (ctx.counters) ctx.counters->rays += rays;
        },
        ctx.stop);
    if (!done) return Status(Code::Cancelled, "shadow_probe stopped");
    for (size_t k = 0; k < s_.rays.size(); ++k) rmse[k] = errors.rmse(k);
    share[0] = errors.judged() / double(cells);
    return TermPtr(term);
  }

 private:
  int across() const { return std::clamp(int(std::lround(std::sqrt(s_.pixels * (double(s_.width) / s_.height)))), 1, s_.width); }
  int down() const { return std::clamp(s_.pixels / across(), 1, s_.height); }
  size_t cells() const { return size_t(across()) * size_t(down()); }
  /// View samples, truth and ray counts of one pixel. False where the light cannot shine.
  bool judge(const SolidScene& scene, const LightPoints& light, const Eye& eye, float px, float py, const Surfaces& at, size_t cell, std::span<float> outA,
             std::span<float> outB, std::span<float> outLit, Errors& errors, size_t task, uint64_t& rays) const {
    const size_t S = size_t(s_.viewSamples), first = cell * S;
    Ray view[16];
    for (size_t s = 0; s < S; ++s) {
      const Vec2 offset = viewSamplePosition(int(s), s_.viewSamples);
      view[s] = eye.film.at(px + offset.x, py + offset.y);
    }
    look(scene, eye, view, int(S), at, first);
    const uint32_t most = light.pointLike() || s_.rays.empty() ? 1 : s_.rays.back();
    double a = 0, b = 0, lit = 0, estimate[kMostRays] = {};
    for (size_t s = 0; s < S; ++s) {
      const size_t e = first + s;
      float prefix[kMostRays];
      if (!at.hit(e) || !trace(scene, light, at.position(e), at.normal(e), viewSampleSeed(s_.seed, e), most, prefix, rays)) continue;
      outLit[e] = 1.0f;
      ++lit;
      for (size_t k = 0; k < s_.rays.size(); ++k) estimate[k] += prefix[std::min(s_.rays[k], most) - 1];
      if (light.pointLike()) continue;
      a += part(scene, light, at.position(e), at.normal(e), hash64(e, 1), rays);
      b += part(scene, light, at.position(e), at.normal(e), hash64(e, 2), rays);
    }
    if (!(lit > 0)) return false;
    outA[first] = light.pointLike() ? area(scene, light, eye, px, py, hash64(cell, 1), rays) : float(a / lit);
    outB[first] = light.pointLike() ? area(scene, light, eye, px, py, hash64(cell, 2), rays) : float(b / lit);
    for (size_t k = 0; k < s_.rays.size(); ++k) errors.add(task, k, estimate[k] / lit, outA[first], outB[first]);
    return true;
  }

  /// Hard visibility over a pixel's area, where the light can shine.
  float area(const SolidScene& scene, const LightPoints& light, const Eye& eye, float px, float py, uint64_t seed, uint64_t& rays) const {
    float P[3 * kTruthSamples], Ng[3 * kTruthSamples];
    uint32_t instance[kTruthSamples];
    const Surfaces at{P, Ng, instance};
    Ray ray[kTruthSamples];
    for (int i = 0; i < kTruthSamples; ++i) {
      const Vec2 u = SobolSampler(hash64(s_.seed, seed), uint32_t(i)).next2D();
      ray[i] = eye.film.at(px + u.x, py + u.y);
    }
    look(scene, eye, ray, kTruthSamples, at, 0);
    double seen = 0, count = 0;
    for (size_t i = 0; i < kTruthSamples; ++i) {
      float v = 1.0f;
      if (!at.hit(i) || !trace(scene, light, at.position(i), at.normal(i), 0, 1, &v, rays)) continue;
      seen += v;
      ++count;
    }
    return count > 0 ? float(seen / count) : 1.0f;
  }
  float part(const SolidScene& scene, const LightPoints& light, const Vec3& p, const Vec3& n, uint64_t seed, uint64_t& rays) const {
    float prefix[kMostRays];
    return trace(scene, light, p, n, hash64(s_.seed, seed), s_.truthRays, prefix, rays) ? prefix[s_.truthRays - 1] : 1.0f;
  }

  /// prefix[i]: visibility by the first i + 1 points of a sequence. False where the light cannot shine.
  static bool trace(const SolidScene& scene, const LightPoints& light, const Vec3& p, const Vec3& n, uint64_t seed, uint32_t count, float* prefix,
                    uint64_t& rays) {
    Ray packet[16];
    uint32_t at[16];
    int waiting = 0;
    float weight[kMostRays] = {};
    bool open[kMostRays] = {};
    GOBO_CHECK(count <= kMostRays);
    const auto flush = [&] {
      const uint32_t blocked = waiting ? scene.occluded16(packet, waiting) : 0;
      for (int i = 0; i < waiting; ++i) open[at[i]] = !(blocked >> i & 1);
      rays += uint64_t(waiting);
      waiting = 0;
    };
    for (uint32_t i = 0; i < count; ++i) {
      LightPoint point;
      const Vec2 u = light.pointLike() ? Vec2(0.5f) : SobolSampler(seed, i).next2D();
      if (!light.sample(p, n, n, u, point)) continue;
      weight[i] = point.weight;
      if (point.belowSurface) continue;
      packet[waiting] = shadowRay(scene.accel(), p, n, point);
      at[waiting++] = i;
      if (waiting == 16) flush();
    }
    flush();
    double seen = 0, sum = 0;
    for (uint32_t i = 0; i < count; ++i) {
      sum += weight[i];
      if (open[i]) seen += weight[i];
      prefix[i] = sum > 0 ? float(seen / sum) : 1.0f;
    }
    return sum > 0;
  }

  ShadowProbeSettings s_;
};

constexpr ReceiverNeeds kNeeds{.slopes = true, .facing = false};

class MapProbeNode final : public Node {
 public:
  explicit MapProbeNode(const MapProbeSettings& s) : s_(s) {}
  std::string type() const override { return "map_probe"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.facets = kAccelFacets;
    if (s_.clear) t.facets = t.facets | Facet::Bsdf;
    t.smallOutput = true;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    s_.map.frames.hash(h);
    h.add(s_.map.resolution).add(s_.bias).add(s_.slopeBias).add(s_.size.x).add(s_.size.y).add(s_.viewSamples);
    if (s_.clear) h.add("clear");
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 1);
    Receivers::reads(w, 0, kNeeds);
    w.reads<float>(0, "a").reads<float>(0, "b").reads<float>(0, "lit");
    return w.gives({type(), Domain::Table, {1, 1, 1}, {plane<double>("rmse")}});
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term& probe = *ctx.inputs.at(0);
    GOBO_ASSIGN(AccelPtr accel, ctx.accel());
    const SolidScene scene(*ctx.scene, std::move(accel), s_.clear);
    const auto a = probe.floats("a"), b = probe.floats("b"), lit = probe.floats("lit");
    const Receivers receivers(probe, s_.map.frames, s_.map.resolution, ShadowView{}, kNeeds);
    const size_t S = size_t(s_.viewSamples), cells = lit.size() / S, tasks = (cells + kGrain - 1) / kGrain;
    Errors errors(tasks, 1);
    const bool done = ctx.arena->parallelFor(
        tasks, 1,
        [&](size_t from, size_t to) {
          uint64_t rays = 0;
          for (size_t task = from; task < to; ++task)
            for (size_t c = task * kGrain; c < std::min((task + 1) * kGrain, cells); ++c) {
              double v = 0, count = 0;
              for (size_t e = c * S; e < (c + 1) * S; ++e) {
                if (lit[e] == 0.0f) continue;
                ReceiverBlock r;
                receivers.fill(e, 1, r);
                v += !r.covered[0] ? 1.0f : s_.size == Vec2(0.0f) ? hard(scene, s_.map, r, rays) : soft(scene, s_.map, receivers, r, rays);
                ++count;
              }
              if (!(count > 0)) continue;
              errors.count(task);
              errors.add(task, 0, v / count, a[c * S], b[c * S]);
            }
          if (ctx.counters) ctx.counters->rays += rays;
        },
        ctx.stop);
    if (!done) return Status(Code::Cancelled, "map_probe stopped");
    const auto& term = ctx.result;
    term->writable<double>("rmse")[0] = errors.rmse(0);
    return TermPtr(term);
  }

 private:
  float hard(const SolidScene& scene, const ProbeMap& map, const ReceiverBlock& b, uint64_t& rays) const {
    const ReceiverPlane r = receiverPlane(b, 0, s_.bias, s_.slopeBias);
    AxisKernel kx, ky;
    boxKernel(r.x, 1.0f, kx);
    boxKernel(r.y, 1.0f, ky);
    int x[9], y[9];
    float z[9];
    const int count = kx.count * ky.count;
    for (int i = 0; i < count; ++i) {
      x[i] = kx.first + i % kx.count;
      y[i] = ky.first + i / kx.count;
    }
    VirtualMap(scene, map).depths(b.face[0], x, y, count, z, rays);
    float sum = 0;
    for (int i = 0; i < count; ++i) sum += z[i] < r.at(x[i], y[i]) ? 0.0f : kx.weight[i % kx.count] * ky.weight[i / kx.count];
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

  float soft(const SolidScene& scene, const ProbeMap& map, const Receivers& receivers, const ReceiverBlock& b, uint64_t& rays) const {
    const VirtualMap depths(scene, map);
    const LightFrame& f = map.frames.face[size_t(b.face[0])];
    const ReceiverPlane r = receiverPlane(b, 0, s_.bias, s_.slopeBias);
    const float d = receivers.metric(b.face[0], b.d[0]), texelsX = float(map.resolution) / (f.hi.x - f.lo.x),
                texelsY = float(map.resolution) / (f.hi.y - f.lo.y);
    const auto width = [&](float z, float size, float texels) {
      // limit: a window without width has infinitely many texels a metre, and no width times that is no number.
      return formulas::limit(formulas::softWidth(d, z, size, f.perspective) * texels, 1.0f, float(map.resolution));
    };
    int x[64], y[64];
    float z[64];
    float plane = std::max(f.near, 1e-3f * d);
    double blocked = 0, share = 0;
    for (int pass = 0; pass < 2; ++pass) {  // the search kernel is measured on the near plane, then on the nearest blocker found
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

  MapProbeSettings s_;
};

}  // namespace

NodePtr makeShadowProbeNode(const ShadowProbeSettings& settings) { return std::make_shared<ShadowProbeNode>(settings); }
NodePtr makeMapProbeNode(const MapProbeSettings& settings) { return std::make_shared<MapProbeNode>(settings); }

}  // namespace gobo::inline filters
