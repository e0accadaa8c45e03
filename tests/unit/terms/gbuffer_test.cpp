// SPDX-License-Identifier: Apache-2.0
// The G-buffer's packets against the formulas of one ray and one hit (FilmRays::at, Accel::Impl::worldNormal, hit_place.h), bit for bit.
#include "terms/gbuffer.h"

#include <gtest/gtest.h>

#include <bit>
#include <limits>

#include "support/run_node.h"
#include "support/tiny_scenes.h"
#include "terms/hit_place.h"
#include "trace/back_faces.h"
#include "trace/view_samples.h"

namespace gobo {
namespace {

using namespace tests;

/// Ground of texture coordinates as large as there are, whose means may be larger, smooth spheres many times (Embree's instances, moved, stretched and
/// mirrored), once and mirrored (flattened), one with normals of no length, and a flat box.
ScenePtr shapes() {
  SceneMaker m;
  const int grey = m.material(Vec3(0.5f));
  Mesh floor = ground(30.0f, -1.0f);
  constexpr float kMost = std::numeric_limits<float>::max();
  floor.uv[0] = {Vec2(kMost, 0), Vec2(kMost, 0), Vec2(kMost, -3e38f), Vec2(kMost, -3e38f)};
  floor.normals = {Vec3(0, 1, 0), Vec3(0.6f, 0.8f, 0), Vec3(0, 1, 0), Vec3(0, 0.6f, -0.8f)};
  m.instance(m.mesh(floor, grey));
  const int many = m.mesh(sphere(Vec3(0.0f), 0.5f, 48, true), grey);
  for (int i = 0; i < 24; ++i) {
    const float side = i % 2 ? -1.0f : 1.0f;
    m.instance(many, translate(Vec3(float(i % 6) * 1.3f - 3.2f, float(i / 6) * 0.9f - 0.4f, -1.5f * float(i / 6))) *
                         scaling(Vec3(side, 0.6f + 0.1f * float(i % 5), 1.2f)));
  }
  m.instance(m.mesh(sphere(Vec3(0, 0, 2), 0.7f, 16, true), grey), scaling(Vec3(1, -1, 1)));
  Mesh none = sphere(Vec3(2.2f, 0.4f, 2), 0.5f, 12, true);
  for (Vec3& n : none.normals) n = Vec3(0.0f);
  m.instance(m.mesh(none, grey));
  m.instance(m.mesh(box(Vec3(-2.5f, -1, 1.5f), Vec3(-1.5f, 0.5f, 2.5f)), grey), translate(Vec3(0.1f, 0, 0)));
  m.camera(Vec3(0.4f, 1.2f, 7), Vec3(0, 0, 0), 0.9f);
  return m.finish();
}

std::vector<std::pair<std::string, Camera>> cameras(const Scene& scene) {
  std::vector<std::pair<std::string, Camera>> all{{"perspective", scene.cameras[0]}};
  const auto add = [&](const std::string& name, const std::function<void(Camera&)>& change) {
    all.emplace_back(name, scene.cameras[0]);
    change(all.back().second);
  };
  add("orthographic", [](Camera& c) { c.perspective = false, c.yheight = 5.0f; });
  add("clipped", [](Camera& c) { c.optics.clipNear = 5.0f, c.optics.clipFar = 9.0f; });
  add("clipped orthographic", [](Camera& c) { c.perspective = false, c.yheight = 5.0f, c.optics.clipNear = 5.5f, c.optics.clipFar = 9.0f; });
  add("measured", [](Camera& c) { c.optics.focal = 1.3, c.optics.pixelAspect = 1.2f, c.centre = Vec2(0.1f, -0.2f); });
  add("panorama", [](Camera& c) { c.optics.panorama = true; });
  add("lens", [](Camera& c) { c.optics.lensRadius = 0.1f, c.optics.focus = 6.0f; });
  add("back faces", [](Camera& c) { c.cullBackFaces = true; });
  return all;
}

TEST(GBuffer, PacketsHaveTheBitsOfSingleRaysAndHits) {
  const ScenePtr scene = shapes();
  const TaskArena arena(2);
  NodeRunner run(*scene, arena);
  const std::vector<int> none;
  const SceneView view(*scene, kAccelFacets | Facet::Shading | kBackFaceFacets, none);
  const AccelPtr accel = Accel::build(view, arena);
  size_t instanced = 0, flattened = 0;
  for (const InstanceGeometry& g : accel->impl().instances) ++(g.world ? flattened : instanced);
  ASSERT_GT(instanced, 20u);
  ASSERT_EQ(flattened, 4u);
  for (const auto& [name, camera] : cameras(*scene)) {
    const BackFaces passed = camera.cullBackFaces ? BackFaces(view, *accel) : BackFaces();
    for (const auto& [w, h] : {std::pair(64, 48), std::pair(37, 23)}) {  // whole tiles, and rims
      SCOPED_TRACE(name + " " + std::to_string(w));
      GBufferSettings s{camera, w, h, 2};
      const TermPtr term = run(makeGBufferNode(s), {});
      const FilmRays film(camera, w, h);
      size_t whole = 0, hits = 0, beyond = 0;
      for (int layer = 0; layer < 2; ++layer)
        for (int y0 = 0; y0 < h; y0 += 4)
          for (int x0 = 0; x0 < w; x0 += 4) {
            std::vector<Ray> rays;
            std::vector<size_t> at;
            for (int y = y0; y < std::min(y0 + 4, h); ++y)
              for (int x = x0; x < std::min(x0 + 4, w); ++x) {
                const Vec2 offset = viewSamplePosition(layer, 2);
                const Vec2 lens = camera.hasLens() ? viewSampleLens(layer, 2, uint64_t(y) * uint64_t(w) + uint64_t(x)) : Vec2(0.0f);
                rays.push_back(film.at(float(x) + offset.x, float(y) + offset.y, lens));
                at.push_back((size_t(layer) * size_t(h) + size_t(y)) * size_t(w) + size_t(x));
              }
            std::vector<Hit> hit(rays.size());
            accel->intersect16(rays.data(), int(rays.size()), hit.data(), &passed);
            bool one = rays.size() == 16 && hit[0].valid();
            for (const Hit& h : hit) one = one && h.instance == hit[0].instance;
            for (size_t i = 0; i < rays.size(); ++i) {
              hits += hit[i].valid();
              const auto same = [&](const char* plane, const Vec3& v, int channels) {
                for (int c = 0; c < channels; ++c)
                  EXPECT_EQ(std::bit_cast<uint32_t>(term->floats(plane)[size_t(channels) * at[i] + size_t(c)]), std::bit_cast<uint32_t>(v[c]))
                      << plane << "[" << c << "] of element " << at[i] << ": " << term->floats(plane)[size_t(channels) * at[i] + size_t(c)] << ", " << v[c];
              };
              EXPECT_EQ(term->plane<uint32_t>("instance")[at[i]], hit[i].instance);
              if (!hit[i].valid()) {
                same("depth", Vec3(std::numeric_limits<float>::infinity()), 1);
                for (const char* p : {"P", "N", "Ng"}) same(p, Vec3(0.0f), 3);
                continue;
              }
              const MeshView<Facet::Shading> mesh = view.mesh<Facet::Shading>(scene->instances[hit[i].instance].mesh);
              const Vec3 p = hitPosition(*accel, hit[i]);
              const InstanceGeometry& g = accel->impl().instances[hit[i].instance];
              const HitNormals n = hitNormals(mesh.normals, g, rays[i].direction, hit[i]);
              EXPECT_EQ(term->plane<uint32_t>("primitive")[at[i]], hit[i].primitive);
              same("P", p, 3);
              same("N", n.shading, 3);
              same("Ng", n.geometric, 3);
              same("depth", Vec3(glm::length(p - rays[i].origin)), 1);
              same("footprint", Vec3(film.footprint(glm::length(p - rays[i].origin))), 1);
              same("bary", Vec3(hit[i].u, hit[i].v, 0), 2);
              Vec2 t(0.0f);
              const float b[3] = {1.0f - hit[i].u - hit[i].v, hit[i].u, hit[i].v};
              if (!mesh.uv[0].empty())
                for (int k = 0; k < 3; ++k) t += b[k] * mesh.uv[0][g.indices[3 * size_t(hit[i].primitive) + size_t(k)]];
              beyond += one && !std::isfinite(t.x);
              same("uv", Vec3(std::isfinite(t.x) ? t.x : 0.0f, std::isfinite(t.y) ? t.y : 0.0f, 0), 2);
              if (::testing::Test::HasFailure()) return;
            }
            whole += one;
          }
      EXPECT_GT(hits, 400u);
      if (w == 64 && name != "panorama") EXPECT_GT(whole, 40u) << "packets of one instance are what is compared";
      if (w == 64 && name == "perspective") EXPECT_GT(beyond, 0u) << "texture coordinates that are no numbers";
    }
  }
}

TEST(GBuffer, NormalsOfWholePacketsAreThoseOfSingleLanes) {
  const ScenePtr scene = shapes();
  const TaskArena arena(1);
  const std::vector<int> none;
  const AccelPtr accel = Accel::build(SceneView(*scene, kAccelFacets, none), arena);
  const FilmRays film(scene->cameras[0], 64, 48);
  size_t compared = 0;
  for (int y0 = 0; y0 < 48; y0 += 4)
    for (int x0 = 0; x0 < 64; x0 += 4) {
      RayPacket rays;
      for (int i = 0; i < 16; ++i) rays.set(i, film.at(float(x0 + i % 4) + 0.5f, float(y0 + i / 4) + 0.5f));
      HitPacket all, fewer;
      accel->intersect16(rays, 16, all);
      accel->intersect16(rays, 15, fewer);  // the last lane meets nothing, so no instance fills the packet
      EXPECT_EQ(fewer.instance[15], kNoHit);
      for (int i = 0; i < 15; ++i) {
        ASSERT_EQ(all.instance[i], fewer.instance[i]);
        if (all.instance[i] == kNoHit) continue;
        for (int c = 0; c < 3; ++c) ASSERT_EQ(std::bit_cast<uint32_t>(all.Ng[c][i]), std::bit_cast<uint32_t>(fewer.Ng[c][i])) << x0 << " " << y0;
        ++compared;
      }
    }
  EXPECT_GT(compared, 1000u);
}

// A mesh in micrometres: its normals by the cofactors are of 1e-12.
TEST(GBuffer, NormalsOfTinyInstancesAreSmooth) {
  const auto normals = [](float unit, bool mirrored) {
    SceneMaker m;
    Mesh bent = quad(Vec3(-unit, -unit, 0), Vec3(2 * unit, 0, 0), Vec3(0, 2 * unit, 0));
    for (const Vec3& n : {Vec3(-0.5f, -0.3f, 1), Vec3(0.4f, -0.2f, 1), Vec3(0.3f, 0.5f, 1), Vec3(-0.1f, 0.6f, 1)}) bent.normals.push_back(glm::normalize(n));
    const float scale = 1.0f / unit;
    m.instance(m.mesh(std::move(bent), m.material(Vec3(0.5f))), scaling(Vec3(mirrored ? -scale : scale, scale, scale)));
    m.camera(Vec3(0, 0, 4), Vec3(0.0f), 0.2f);
    const ScenePtr scene = m.finish();
    const TaskArena arena(1);
    NodeRunner run(*scene, arena);
    const TermPtr term = run(makeGBufferNode(GBufferSettings{scene->cameras[0], 10, 6, 1}), {});  // whole tiles, and rims
    const auto n = term->floats("N");
    return std::vector<float>(n.begin(), n.end());
  };
  for (const bool mirrored : {false, true}) {
    const std::vector<float> truth = normals(1.0f, mirrored);
    float most = 0.0f;
    for (size_t i = 0; i < truth.size() / 3; ++i) most = std::max(most, truth[3 * i + 2]);
    EXPECT_GT(most, 0.9f);
    EXPECT_GT(std::fabs(truth[0]), 0.05f) << "they lean";
    for (const float unit : {1e5f, 1e6f, 1e7f}) {
      const std::vector<float> found = normals(unit, mirrored);
      ASSERT_EQ(found.size(), truth.size());
      for (size_t i = 0; i < truth.size(); ++i) EXPECT_NEAR(found[i], truth[i], 1e-3f) << unit << " " << mirrored << " element " << i;
    }
  }
}

// Triangles so small or large that the squares of their normals leave float's range.
TEST(GBuffer, NormalsOfTinyAndHugeTrianglesAreUnit) {
  for (const float size : {1e-9f, 1e-4f, 1.0f, 1e6f, 2e8f}) {
    SceneMaker m;
    m.instance(m.mesh(quad(Vec3(-size, -size, 0), Vec3(2 * size, 0, 0), Vec3(0, 2 * size, size)), m.material(Vec3(0.5f))));
    m.camera(Vec3(0, 0, 4 * size), Vec3(0.0f), 0.1f);
    const ScenePtr scene = m.finish();
    const TaskArena arena(1);
    const std::vector<int> none;
    const AccelPtr accel = Accel::build(SceneView(*scene, kAccelFacets, none), arena);
    const FilmRays film(scene->cameras[0], 4, 4);
    RayPacket rays;
    for (int i = 0; i < 16; ++i) rays.set(i, film.at(float(i % 4) + 0.5f, float(i / 4) + 0.5f));
    HitPacket hits;
    accel->intersect16(rays, 16, hits);
    for (int i = 0; i < 16; ++i) {
      ASSERT_EQ(hits.instance[i], 0u) << size;
      const Vec3 n(hits.Ng[0][i], hits.Ng[1][i], hits.Ng[2][i]), truth = glm::normalize(Vec3(0, -1, 2));
      EXPECT_NEAR(glm::length(n - truth), 0.0f, 1e-5f) << size << " lane " << i;
    }
  }
}

}  // namespace
}  // namespace gobo
