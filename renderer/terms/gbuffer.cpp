// SPDX-License-Identifier: Apache-2.0
#include "terms/gbuffer.h"

#include <cstring>
#include <limits>
#include <utility>

#include "terms/hit_packet.h"
#include "trace/back_faces.h"
#include "trace/film_runs.h"

namespace gobo {
inline namespace terms {

void hashCamera(Hasher& h, const Camera& c) {
  h.addPod(c.toWorld).add(c.perspective).add(c.perspective ? c.yfov : c.yheight).add(c.centre.x).add(c.centre.y);
  if (c.cullBackFaces) h.add("cullBackFaces");
  hashOptics(h, c);
}

void hashView(Hasher& h, const GBufferSettings& view) {
  hashCamera(h, view.camera);
  h.add(view.width).add(view.height).add(view.viewSamples);
}

namespace {

class GBufferNode final : public Node {
 public:
  explicit GBufferNode(const GBufferSettings& s) : s_(s) {}
  std::string type() const override { return "gbuffer"; }
  int version() const override { return 3; }  // 2: in packets; 3: normals of tiny instances
  NodeTraits traits() const override {
    NodeTraits t;
    t.facets = kAccelFacets;
    if (all()) t.facets = t.facets | Facet::Shading;
    t.tileable = true;
    if (s_.camera.cullBackFaces) t.facets = t.facets | kBackFaceFacets;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    hashView(h, s_);
    s_.place.hash(h);
    if (!s_.place.whole()) h.add("aligned");  // packets of before were counted from the window's corner
    if (!all()) h.add("part").add(s_.part);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    std::vector<PlaneShape> planes{unsetPlane<float>("depth"), unsetPlane<uint32_t>("instance"), unsetPlane<uint32_t>("primitive")};
    if (s_.part != GBufferPart::Hits) planes.push_back(unsetPlane<float>("P", 3));
    if (all())
      for (PlaneShape& p : std::vector{unsetPlane<float>("N", 3), unsetPlane<float>("Ng", 3), unsetPlane<float>("uv", 2), unsetPlane<float>("bary", 2),
                                       unsetPlane<float>("footprint")})
        planes.push_back(std::move(p));
    return Wiring(type(), in, 0).gives({type(), Domain::ViewSample, s_.extent(), std::move(planes)});
  }
  Cost cost(const TermShape&, uint32_t) const override {
    const double rays = double(s_.width) * s_.height * s_.viewSamples;
    return {rays, (all() ? 55.0 : 30.0) * rays};
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    GOBO_ASSIGN(const AccelPtr accel, ctx.accel());
    const BackFaces passed = s_.camera.cullBackFaces ? BackFaces(*ctx.scene, *accel) : BackFaces();
    const auto& instances = ctx.scene->instances();
    const int w = s_.width, h = s_.height, S = s_.viewSamples;
    const auto& out = ctx.result;
    const bool positions = s_.part != GBufferPart::Hits;
    const auto depth = out->writable<float>("depth");
    const auto instance = out->writable<uint32_t>("instance"), primitive = out->writable<uint32_t>("primitive");
    const auto P = positions ? out->writable<float>("P") : std::span<float>();
    Shading shading;
    if (all()) shading = {*ctx.scene, *out};

    const FilmRays film(s_.camera, s_.filmWidth(), s_.filmHeight());
    const bool straight = !s_.camera.hasLens() && !s_.camera.optics.panorama;
    // Packets of 4x4 pixels of one layer: rays that run side by side. Each has all the rays that it has in the whole picture, wanted or not: which go together
    // may decide between triangles at the same distance.
    const std::vector<FilmRun> columns = filmRuns(s_.place.x, w, s_.filmWidth(), kTile), bands = filmRuns(s_.place.y, h, s_.filmHeight(), kTile);
    const bool complete = ctx.arena->parallelFor(
        bands.size() * size_t(S), 1,
        [&](size_t begin, size_t end) {
          uint64_t rays = 0;
          for (size_t part = begin; part < end; ++part) {
            const int s = int(part / bands.size());
            const FilmRun band = bands[part % bands.size()];
            const int tall = band.count, y0 = band.first - s_.place.y;  // in the view; negative: it begins above
            const size_t layer = size_t(s) * size_t(h);                 // its first row
            const bool high = tall == kTile && y0 >= 0 && y0 + kTile <= h;
            const Vec2 offset = viewSamplePosition(s, S);
            for (const FilmRun& column : columns) {
              const int wide = column.count, count = wide * tall, x0 = column.first - s_.place.x;
              RayPacket ray;
              HitPacket hit;
              alignas(64) float px[RayPacket::kLanes], py[RayPacket::kLanes];
              for (int i = 0; i < RayPacket::kLanes; ++i) {
                const int lane = i < count ? i : 0;
                px[i] = float(column.first + lane % wide) + offset.x;
                py[i] = float(band.first + lane / wide) + offset.y;
              }
              if (straight) {
                filmPacket(film, px, py, ray);
              } else {
                for (int i = 0; i < RayPacket::kLanes; ++i) {
                  const int lane = i < count ? i : 0, x = column.first + lane % wide, y = band.first + lane / wide;
                  Vec2 onLens(0.0f);
                  if (s_.camera.hasLens()) onLens = viewSampleLens(s, S, uint64_t(y) * uint64_t(s_.filmWidth()) + uint64_t(x));
                  ray.set(i, film.at(px[i], py[i], onLens));
                }
              }
              accel->intersect16(ray, count, hit, &passed);
              rays += uint64_t(count);
              if (high && wide == kTile && x0 >= 0 && x0 + kTile <= w && ofOneInstance(hit)) {
                const size_t corner = (layer + size_t(y0)) * size_t(w) + size_t(x0);
                HitSurface surface;
                hitPositions(accel->impl().instances[hit.instance[0]], ray, hit, surface);
                writeRows(surface.depth, depth, corner, w);
                writeRows(hit.instance, instance, corner, w);
                writeRows(hit.primitive, primitive, corner, w);
                if (positions) writeRows(surface.P, P, corner, w);
                if (all()) shading.write(*accel, instances[hit.instance[0]].mesh, ray, hit, film, surface, corner, w);
                continue;
              }
              for (int i = 0; i < count; ++i) {
                const int x = x0 + i % wide, y = y0 + i / wide;
                if (x < 0 || y < 0 || x >= w || y >= h) continue;  // company from outside the view
                const size_t at = (layer + size_t(y)) * size_t(w) + size_t(x);
                if (hit.instance[i] == kNoHit) {
                  if (positions)
                    for (int c = 0; c < 3; ++c) P[3 * at + c] = 0.0f;
                  if (all()) shading.clear(at);
                  depth[at] = std::numeric_limits<float>::infinity();
                  instance[at] = primitive[at] = kNoHit;
                  continue;
                }
                const Hit one = hit.lane(i);
                const Vec3 p = hitPosition(*accel, one), d(ray.direction[0][i], ray.direction[1][i], ray.direction[2][i]);
                depth[at] = glm::length(p - Vec3(ray.origin[0][i], ray.origin[1][i], ray.origin[2][i]));
                instance[at] = one.instance;
                primitive[at] = one.primitive;
                if (positions)
                  for (int c = 0; c < 3; ++c) P[3 * at + c] = p[c];
                if (all()) shading.write(*accel, instances[one.instance].mesh, d, one, at, film.footprint(depth[at]));
              }
            }
          }
          if (ctx.counters) ctx.counters->rays += rays;
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "stopped");
    return TermPtr(out);
  }

 private:
  static constexpr int kTile = 4;

  /// The lanes of a whole tile to its rows; `corner`: element of its first pixel.
  template <class T>
  static void writeRows(const T (&lanes)[RayPacket::kLanes], std::span<T> plane, size_t corner, int width) {
    for (int y = 0; y < kTile; ++y) std::memcpy(&plane[corner + size_t(y) * size_t(width)], lanes + y * kTile, kTile * sizeof(T));
  }
  template <int kComponents>
  static void writeRows(const float (&lanes)[kComponents][RayPacket::kLanes], std::span<float> plane, size_t corner, int width) {
    for (int y = 0; y < kTile; ++y) {
      float* row = &plane[kComponents * (corner + size_t(y) * size_t(width))];
      for (int x = 0; x < kTile; ++x)
        for (int c = 0; c < kComponents; ++c) row[kComponents * x + c] = lanes[c][y * kTile + x];
    }
  }

  bool all() const { return s_.part == GBufferPart::All; }

  /// The planes beside places and ids.
  struct Shading {
    std::vector<MeshView<Facet::Shading>> meshes;
    std::span<float> N, Ng, uv, bary, footprint;

    Shading() = default;
    Shading(const SceneView& scene, Term& out)
        : N(out.writable<float>("N")),
          Ng(out.writable<float>("Ng")),
          uv(out.writable<float>("uv")),
          bary(out.writable<float>("bary")),
          footprint(out.writable<float>("footprint")) {
      for (size_t m = 0; m < scene.meshCount(); ++m) meshes.push_back(scene.mesh<Facet::Shading>(int(m)));
    }
    void clear(size_t at) {
      for (int c = 0; c < 3; ++c) N[3 * at + c] = Ng[3 * at + c] = 0.0f;
      for (int c = 0; c < 2; ++c) uv[2 * at + c] = bary[2 * at + c] = 0.0f;
      footprint[at] = 0.0f;
    }
    void write(const Accel& accel, int meshIndex, const RayPacket& rays, const HitPacket& hits, const FilmRays& film, HitSurface& surface, size_t corner,
               int w) {
      const MeshView<Facet::Shading>& mesh = meshes[size_t(meshIndex)];
      hitShading(accel.impl().instances[hits.instance[0]], mesh.normals.empty() ? nullptr : std::as_const(mesh.normals).data(),
                 mesh.uv[0].empty() ? nullptr : std::as_const(mesh.uv[0]).data(), rays, hits, surface);
      writeRows(surface.N, N, corner, w);
      writeRows(surface.Ng, Ng, corner, w);
      writeRows(surface.uv, uv, corner, w);
      alignas(64) float width[RayPacket::kLanes], barycentric[2][RayPacket::kLanes];
      for (int i = 0; i < RayPacket::kLanes; ++i) {
        width[i] = film.footprint(surface.depth[i]);
        barycentric[0][i] = hits.u[i];
        barycentric[1][i] = hits.v[i];
      }
      writeRows(width, footprint, corner, w);
      writeRows(barycentric, bary, corner, w);
    }
    /// Normals towards the viewer.
    void write(const Accel& accel, int meshIndex, const Vec3& direction, const Hit& hit, size_t at, float width) {
      const MeshView<Facet::Shading>& mesh = meshes[size_t(meshIndex)];
      const InstanceGeometry& g = accel.impl().instances[hit.instance];
      const uint32_t* tri = g.indices + 3 * size_t(hit.primitive);
      const HitNormals normal = hitNormals(mesh.normals, g, direction, hit);
      const float b[3] = {1.0f - hit.u - hit.v, hit.u, hit.v};
      Vec2 t(0.0f);
      if (!mesh.uv[0].empty())
        for (int k = 0; k < 3; ++k) t += b[k] * mesh.uv[0][tri[k]];
      for (int c = 0; c < 3; ++c) {
        N[3 * at + c] = normal.shading[c];
        Ng[3 * at + c] = normal.geometric[c];
      }
      uv[2 * at] = std::isfinite(t.x) ? t.x : 0.0f;
      uv[2 * at + 1] = std::isfinite(t.y) ? t.y : 0.0f;
      bary[2 * at] = hit.u;
      bary[2 * at + 1] = hit.v;
      footprint[at] = width;
    }
  };

  GBufferSettings s_;
};

}  // namespace

NodePtr makeGBufferNode(const GBufferSettings& settings) { return std::make_shared<GBufferNode>(settings); }

}  // namespace terms
}  // namespace gobo
