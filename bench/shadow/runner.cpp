// SPDX-License-Identifier: Apache-2.0
#include "shadow/runner.h"

#include <algorithm>
#include <chrono>
#include <ctime>
#include <optional>

#include "base/sobol.h"
#include "terms/gbuffer.h"
#include "terms/light_points.h"
#include "terms/surface_samples.h"

namespace gobo::shadowbench {
namespace {

constexpr int kSharedRepeat = 3;  // what is timed once for all that share it: the first touch of its memory is no part of that
constexpr size_t kSharedBytes = 600u << 20, kJitteredBytes = size_t(2) << 30;

class Given final : public Node {
 public:
  explicit Given(TermPtr t) : term_(std::move(t)) {}
  std::string type() const override { return "given"; }
  NodeTraits traits() const override { return {}; }
  void hashParameters(Hasher& h) const override { h.add(uint64_t(reinterpret_cast<uintptr_t>(term_.get()))); }
  Result<TermShape> infer(std::span<const TermShape>) const override { return shapeOf(*term_); }
  Result<TermPtr> run(const RunContext&) const override { return term_; }

 private:
  TermPtr term_;
};

double* passOf(Passes& p, const std::string& type, Domain domain) {
  if (type == "light_depth_map") return &p.depth;
  if (type == "shadow_encode") return &p.encode;
  return domain == Domain::LightTexel ? &p.filter : &p.lookup;
}

}  // namespace

double median(std::vector<double> v) {
  std::sort(v.begin(), v.end());
  return v.size() % 2 ? v[v.size() / 2] : 0.5 * (v[v.size() / 2 - 1] + v[v.size() / 2]);
}

Runner::Runner(ScenePtr scene, int light, const Camera& camera, int width, int height, int repeat, Clock clock)
    : scene_(std::move(scene)), light_(light), width_(width), height_(height), repeat_(std::max(repeat, 1)), clock_(clock), camera_(camera) {
  gbuffer_ = gbuffer(camera_);  // builds the acceleration structure too, outside every measurement
}

double Runner::now() const {
  if (clock_ == Clock::Wall) return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now().time_since_epoch()).count();
  timespec t;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return 1e3 * double(t.tv_sec) + 1e-6 * double(t.tv_nsec);
}

TermPtr Runner::gbuffer(const Camera& camera, int viewSamples, double* ms) {
  GBufferSettings g;
  g.camera = camera;
  g.width = width_;
  g.height = height_;
  g.viewSamples = viewSamples;
  Graph graph;
  graph.add({makeGBufferNode(g), {}, {}, "gbuffer", 0, scene_, false});
  const double begin = now();
  auto term = evaluate(graph, 0, 1, nullptr, nullptr);
  if (ms) *ms = now() - begin;
  GOBO_CHECK(term.ok());
  return *term;
}

Camera Runner::shifted(double dx, double dy) const {
  Camera c = camera_;  // the window moves with the place in the pixel; its unit is the picture's height
  c.centre.x += float(dx / height_);
  c.centre.y -= float(dy / height_);
  return c;
}

Vec2 Runner::jitter(int k) { return SobolSampler(0x71773e, uint32_t(k)).next2D() - Vec2(0.5f); }

namespace {
double meanCount(const Term& counts, const Term& gbuffer) {
  const auto n = counts.plane<uint32_t>("n"), instance = gbuffer.plane<uint32_t>("instance");
  double sum = 0, surfaces = 0;
  for (size_t p = 0; p < instance.size() && p < n.size(); ++p)
    if (instance[p] != ~0u) sum += n[p], ++surfaces;
  return surfaces > 0 ? sum / surfaces : 0;
}
}  // namespace

bool Runner::supported(const v1::ShadowTechnique& t) const {
  const ShadowTechniqueEntry* e = findShadowTechnique(t.technique_case());
  return e && e->does(scene_->lights[size_t(light_)].shape);
}

Result<TermPtr> Runner::evaluate(const Graph& graph, NodeId wanted, int repeat, Keep* keep, Measured* m) {
  std::vector<char> needed(size_t(graph.size()), 0), ofView(size_t(graph.size()), 0);
  needed[size_t(wanted)] = 1;
  for (NodeId id = graph.size() - 1; id >= 0; --id)
    if (needed[size_t(id)])
      for (NodeId i : graph.at(id).inputs) needed[size_t(i)] = 1;
  std::vector<NodeId> last(size_t(graph.size()), -1);  // where a term is read last: big maps go as soon as they may
  for (NodeId id = 0; id < graph.size(); ++id)
    for (NodeId i : graph.at(id).inputs) last[size_t(i)] = id;
  std::vector<TermPtr> terms(size_t(graph.size()));
  std::vector<Hash128> keys(size_t(graph.size()));
  for (NodeId id = 0; id < graph.size(); ++id) {
    if (!needed[size_t(id)]) continue;
    const GraphNode& n = graph.at(id);
    const std::string type = n.node->type();
    Hasher h(type);
    n.node->hashParameters(h);
    if (n.scene) h.add(n.scene->hash());
    ofView[size_t(id)] = type == "given" || type == "gbuffer";
    for (NodeId i : n.inputs) {
      h.add(keys[size_t(i)]);
      ofView[size_t(id)] |= ofView[size_t(i)];
    }
    const Hash128 key = keys[size_t(id)] = h.digest();
    const bool shareable = type == "light_depth_map" || type == "depth_bounds";
    Kept kept;
    if (shareable) {
      for (auto it = shared_.begin(); it != shared_.end(); ++it)
        if (it->first == key) {
          kept = it->second;
          shared_.splice(shared_.begin(), shared_, it);
          break;
        }
    } else if (keep) {
      if (auto it = keep->find(key); it != keep->end()) kept = it->second;
    }
    if (!kept.term) {
      std::optional<SceneView> view;
      if (n.scene) view.emplace(*n.scene, n.node->traits().facets, n.lights);
      RunCounters counters;
      RunContext ctx;
      ctx.scene = view ? &*view : nullptr;
      for (NodeId i : n.inputs) ctx.inputs.push_back(terms[size_t(i)]);
      ctx.arena = &arena_;
      ctx.accels = &accels_;
      ctx.counters = &counters;
      std::vector<double> times;
      for (int r = 0; r < (type == "given" ? 1 : shareable ? std::max(repeat, kSharedRepeat) : repeat); ++r) {
        kept.term.reset();
        const double begin = now();
        auto out = runNode(*n.node, ctx);
        times.push_back(now() - begin);
        if (!out.ok()) return Status(out.status().code(), n.label + ": " + out.status().toString());
        kept.term = *out;
      }
      kept.ms = type == "given" ? 0 : median(times);
      if (m) m->rays += double(counters.rays) / double(times.size()) / double(pixels());
      if (shareable) {
        shared_.emplace_front(key, kept);
        sharedBytes_ += kept.term->bytes();
        while (sharedBytes_ > kSharedBytes && shared_.size() > 1) {
          sharedBytes_ -= shared_.back().second.term->bytes();
          shared_.pop_back();
        }
      } else if (keep && !ofView[size_t(id)]) {
        (*keep)[key] = kept;
      }
    }
    terms[size_t(id)] = kept.term;
    if (m) {
      *passOf(m->ms, type, kept.term->domain()) += kept.ms;
      m->byType[type] += kept.ms;
      if (type == "shadow_sample_count" || type == "shadow_penumbra_count") m->samples = meanCount(*kept.term, *gbuffer_);
      if (kept.term->domain() == Domain::LightTexel) {
        m->bytes += kept.term->bytes();
        if (!shareable) m->mapBytes = kept.term->bytes();
      }
    }
    for (NodeId i : n.inputs)
      if (last[size_t(i)] == id && i != wanted) terms[size_t(i)].reset();
  }
  return terms[size_t(wanted)];
}

Runner::Plan Runner::planOf(const v1::ShadowTechnique& t) const {
  return [t = fitted(t)](Graph& graph, const ShadowInput& input) -> Result<NodeId> {
    const ShadowTechniqueEntry* entry = findShadowTechnique(t.technique_case());
    if (!entry) return notFound("technique is not registered");
    return entry->plan(graph, input, t);
  };
}

Result<Measured> Runner::run(const Plan& plan, const TermPtr& gbuffer, const Camera& camera, int viewSamples, uint64_t seed, int repeat, Keep* keep) {
  Graph graph;
  ShadowInput input;
  input.scene = scene_;
  input.light = light_;
  input.gbuffer = graph.add({std::make_shared<Given>(gbuffer), {}, {}, "gbuffer", 0, nullptr, false});
  input.camera = camera;
  input.width = width_;
  input.height = height_;
  input.viewSamples = viewSamples;
  input.seed = seed;
  GOBO_ASSIGN(const NodeId node, plan(graph, input));
  Measured m;
  GOBO_ASSIGN(m.term, evaluate(graph, node, repeat, keep, &m));
  const auto V = m.term->floats("V");
  if (viewSamples == 1) m.V.assign(V.begin(), V.end());
  return m;
}

v1::ShadowTechnique Runner::fitted(v1::ShadowTechnique t) const {
  if (cameraFit_ && t.has_map()) t.mutable_map()->set_fit(v1::ShadowMapSettings::CAMERA);
  return t;
}

Result<Measured> Runner::measure(const v1::ShadowTechnique& t, uint64_t seed) { return measure(planOf(t), seed); }
Result<Measured> Runner::measure(const Plan& plan, uint64_t seed) { return run(plan, gbuffer_, camera_, 1, seed, repeat_, nullptr); }

Result<Measured> Runner::supersampled(int samples) {
  double oneMs = 0, allMs = 0;
  gbuffer(camera_, 1, &oneMs);
  const TermPtr g = gbuffer(camera_, samples, &allMs);
  v1::ShadowTechnique t;
  t.mutable_ray_traced()->set_samples(1);
  GOBO_ASSIGN(Measured m, run(planOf(t), g, camera_, samples, 1, repeat_, nullptr));
  m.ms.view = std::max(0.0, allMs - oneMs);
  const SurfaceSamples surface(*g);
  const std::vector<int> subset{light_};
  const SceneView view(*scene_, Facet::All, subset);
  const LightPoints points(view, light_);
  const auto V = m.term->floats("V");
  m.V.assign(pixels(), 1.0f);
  const double begin = now();
  arena_.parallelFor(pixels(), 1024, [&](size_t from, size_t to) {
    for (size_t p = from; p < to; ++p) {
      double sum = 0, count = 0;
      for (int s = 0; s < samples; ++s) {
        const size_t e = size_t(s) * pixels() + p;
        LightPoint q;
        if (!surface.hit(e) || !points.sample(surface.position(e), surface.normal(e), surface.geometricNormal(e), Vec2(0.5f), q)) continue;
        sum += V[e];
        ++count;
      }
      if (count > 0) m.V[p] = float(sum / count);
    }
  });
  m.ms.lookup += now() - begin;
  return m;
}

Result<TermPtr> Runner::depthBounds(const v1::ShadowTechnique& t, int rim, PlannedShadowMap& planned) {
  Graph graph;
  ShadowInput input;
  input.scene = scene_;
  input.light = light_;
  input.camera = camera_;
  input.width = width_;
  input.height = height_;
  input.viewSamples = 1;
  GOBO_ASSIGN(planned, planShadowMap(graph, input, fitted(t), rim));
  return evaluate(graph, planDepthBounds(graph, input, planned), repeat_, nullptr, nullptr);
}

Status Runner::jittered(const v1::ShadowTechnique& t, int count, const std::function<void(int, const std::vector<float>&)>& visit) {
  Keep keep;
  for (int k = 0; k < count; ++k) {
    const Vec2 j = jitter(k);
    const Camera camera = shifted(j.x, j.y);
    TermPtr g = size_t(k) < jittered_.size() ? jittered_[size_t(k)] : gbuffer(camera);
    if (size_t(k) == jittered_.size() && (jittered_.size() + 1) * g->bytes() <= kJitteredBytes) jittered_.push_back(g);
    GOBO_ASSIGN(const Measured m, run(planOf(t), g, camera, 1, uint64_t(k) + 1, 1, &keep));
    visit(k, m.V);
  }
  return {};
}

}  // namespace gobo::shadowbench
