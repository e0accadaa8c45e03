// SPDX-License-Identifier: Apache-2.0
#include "terms/hidden_surface.h"

#include <algorithm>
#include <limits>

#include "terms/hit_place.h"
#include "trace/back_faces.h"
#include "trace/film_runs.h"

namespace gobo {
inline namespace terms {

namespace {

class HiddenSurfaceNode final : public Node {
 public:
  explicit HiddenSurfaceNode(const GBufferSettings& s) : s_(s) {}
  std::string type() const override { return "hidden_surface"; }
  int version() const override { return 2; }  // 2: rays begin nearer to the surface
  NodeTraits traits() const override {
    NodeTraits t;
    t.facets = kAccelFacets | Facet::Shading;
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    hashView(h, s_);
    s_.place.hash(h);
    if (!s_.place.whole()) h.add("aligned");  // rays of a guard band went with the film's before
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 1);
    w.over(0, s_.extent()).reads<float>(0, "P", {3}).reads<float>(0, "Ng", {3}).reads<float>(0, "depth").reads<uint32_t>(0, "instance");
    return w.gives({type(),
                    Domain::ViewSample,
                    s_.extent(),
                    {unsetPlane<float>("P", 3), unsetPlane<float>("N", 3), unsetPlane<float>("Ng", 3), unsetPlane<float>("depth"),
                     unsetPlane<uint32_t>("instance"), unsetPlane<float>("footprint")}});
  }
  Cost cost(const TermShape& result, uint32_t) const override {
    const double rays = 1.5 * double(result.extent.elements());
    return {rays, 55.0 * rays};
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    GOBO_ASSIGN(const AccelPtr accel, ctx.accel());
    const Planes planes(*ctx.scene, *ctx.result);
    const Seen seen(*ctx.inputs.at(0));
    const FilmRays film(s_.camera, s_.filmWidth(), s_.filmHeight());
    const size_t w = size_t(s_.width);
    // A row of the film goes together, and what a guard band has on its sides apart: the picture has the company that it has without one. A window's rows would
    // lack what they have beside it; none is planned (techniques/direct_visibility: styles are made of whole pictures).
    const std::vector<FilmRun> runs = filmRuns(s_.place.x, s_.width, s_.filmWidth(), s_.filmWidth());
    const bool complete = ctx.arena->parallelFor(
        size_t(s_.height) * size_t(s_.viewSamples), 1,
        [&](size_t begin, size_t end) {
          Packet packet(*accel, planes, film);
          for (size_t row = begin; row < end; ++row) {
            const int layer = int(row / size_t(s_.height)), y = s_.place.y + int(row % size_t(s_.height));
            const Vec2 offset = viewSamplePosition(layer, s_.viewSamples);
            for (const FilmRun& run : runs) {
              const int first = std::max(run.first, s_.place.x), last = std::min(run.first + run.count, s_.place.x + s_.width);
              for (int x = first; x < last; ++x) {
                const size_t e = row * w + size_t(x - s_.place.x);
                if (seen.instance[e] == kNoHit) {
                  planes.clear(e);
                  continue;
                }
                Vec2 onLens(0.0f);
                if (s_.camera.hasLens()) onLens = viewSampleLens(layer, s_.viewSamples, uint64_t(y) * uint64_t(s_.filmWidth()) + uint64_t(x));
                packet.add(e, film.at(float(x) + offset.x, float(y) + offset.y, onLens), seen.at(seen.P, e), seen.at(seen.Ng, e), seen.depth[e],
                           seen.instance[e]);
              }
              packet.flush();
            }
          }
          if (ctx.counters) ctx.counters->rays += packet.rays;
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "hidden_surface: stopped");
    return TermPtr(ctx.result);
  }

 private:
  struct Seen {
    explicit Seen(const Term& g) : P(g.floats("P")), Ng(g.floats("Ng")), depth(g.floats("depth")), instance(g.plane<uint32_t>("instance")) {}
    static Vec3 at(std::span<const float> plane, size_t e) { return Vec3(plane[3 * e], plane[3 * e + 1], plane[3 * e + 2]); }
    std::span<const float> P, Ng, depth;
    std::span<const uint32_t> instance;
  };
  struct Planes {
    Planes(const SceneView& scene, Term& out)
        : instances(scene.instances()),
          P(out.writable<float>("P")),
          N(out.writable<float>("N")),
          Ng(out.writable<float>("Ng")),
          depth(out.writable<float>("depth")),
          footprint(out.writable<float>("footprint")),
          instance(out.writable<uint32_t>("instance")) {
      for (size_t m = 0; m < scene.meshCount(); ++m) meshes.push_back(scene.mesh<Facet::Shading>(int(m)));
    }
    void clear(size_t e) const {
      for (size_t c = 0; c < 3; ++c) P[3 * e + c] = N[3 * e + c] = Ng[3 * e + c] = 0.0f;
      depth[e] = std::numeric_limits<float>::infinity();
      footprint[e] = 0.0f;
      instance[e] = kNoHit;
    }
    void write(const Accel& accel, size_t e, const Vec3& p, const Vec3& direction, const Hit& hit, float t, float width) const {
      const HitNormals n = hitNormals(meshes[size_t(instances[hit.instance].mesh)].normals, accel.impl().instances[hit.instance], direction, hit);
      for (size_t c = 0; c < 3; ++c) P[3 * e + c] = p[int(c)], N[3 * e + c] = n.shading[int(c)], Ng[3 * e + c] = n.geometric[int(c)];
      depth[e] = t;
      footprint[e] = width;
      instance[e] = hit.instance;
    }
    const std::vector<Instance>& instances;
    std::vector<MeshView<Facet::Shading>> meshes;
    std::span<float> P, N, Ng, depth, footprint;
    std::span<uint32_t> instance;
  };

  /// Rays of neighbours go on together, 16 at a time, until each has met a surface that faces it, or nothing.
  struct Packet {
    Packet(const Accel& a, const Planes& p, const FilmRays& f) : accel(a), planes(p), film(f) {}
    /// Behind a surface of `instance` at `p` with normal `n` towards the viewer, `depth` along the view's ray.
    void add(size_t e, const Ray& view, const Vec3& p, const Vec3& n, float depth, uint32_t instance) {
      element[count] = e;
      beyond(count++, view, p, n, depth, instance);
      if (count == 16) flush();
    }
    void flush() {
      for (int passed = 0; count > 0; ++passed) {
        Hit hit[16];
        accel.intersect16(ray, count, hit);
        rays += uint64_t(count);
        int left = 0;
        for (int i = 0; i < count; ++i) {
          const size_t e = element[i];
          if (!hit[i].valid()) {
            planes.clear(e);
            continue;
          }
          const Vec3 p = hitPosition(accel, hit[i]);
          const float t = glm::length(p - view[i].origin);
          if (glm::dot(hit[i].Ng, view[i].direction) < 0) {
            planes.write(accel, e, p, view[i].direction, hit[i], t, film.footprint(t));
            continue;
          }
          if (passed == kMostPassed) {
            planes.clear(e);
            continue;
          }
          const Ray along = view[i];
          element[left] = e;
          beyond(left++, along, p, -hit[i].Ng, t, hit[i].instance);
        }
        count = left;
      }
    }
    void beyond(int i, const Ray& along, const Vec3& p, const Vec3& n, float depth, uint32_t instance) {
      view[i] = along;
      ray[i] = along;
      ray[i].origin = offsetOrigin(p, -n, accel.reach(instance));
      ray[i].tmin = 0.0f;
      if (along.tmax < CameraOptics::kNoEnd) ray[i].tmax = std::max(along.tmax - depth, 0.0f);
    }
    const Accel& accel;
    const Planes& planes;
    const FilmRays& film;
    Ray view[16], ray[16];
    size_t element[16];
    int count = 0;
    uint64_t rays = 0;
  };

  GBufferSettings s_;
};

}  // namespace

NodePtr makeHiddenSurfaceNode(const GBufferSettings& view) { return std::make_shared<HiddenSurfaceNode>(view); }

}  // namespace terms
}  // namespace gobo
